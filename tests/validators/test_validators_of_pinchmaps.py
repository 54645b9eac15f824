"""fexel:Pinchmap."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Sdf

import fexel

SIZE = 16  # of the sample's images


def write(folder, name, texels):
    """(H, W, C) uint8, uint16 or float32 as it is."""
    kind = {"uint8": "uint8", "uint16": "uint16", "float32": "float"}[str(texels.dtype)]
    spec = oiio.ImageSpec(texels.shape[1], texels.shape[0], texels.shape[2], kind)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    writer = oiio.ImageOutput.create(str(folder / name))
    assert writer.open(str(folder / name), spec)
    assert writer.write_image(np.ascontiguousarray(texels))
    writer.close()
    return f"./{name}"


@pytest.fixture
def logo(sample):
    """A pinchmap in the sample's zipmap; its signal is the sample's picture of 16 x 16 texels."""
    prim = fexel.PinchmapTexture.Define(sample.stage, "/World/Wall/Photo/Logo")
    prim.CreateFileAttr(sample.file)
    sample.logo = prim
    sample.stage.WriteFallbackPrimTypes()
    return sample


def zero(height=8, width=8, channels=4, dtype=np.uint8):
    value = {np.uint8: 127, np.uint16: 32767, np.float32: 0}[dtype]
    return np.full((height, width, channels), value, dtype)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("size", [1, 4, 16])
def test_good_pinchmap_has_no_findings(logo, tmp_path, dtype, size):
    logo.logo.CreatePinchmapAttr(write(tmp_path, "map.tif", zero(size, size, dtype=dtype)))
    assert logo.findings() == []


def test_texture_without_a_pinchmap_has_no_findings(logo):
    assert logo.findings() == []


def test_pinchmap_larger_than_the_renderer_takes_is_an_error(logo, tmp_path):
    logo.logo.CreatePinchmapAttr(write(tmp_path, "map.png", zero(4, 8200)))
    finding = logo.the_only("fexel:Pinchmap")
    assert finding.severity == "error"
    assert finding.message == "inputs:pinchmap: ./map.png: 8200 x 4 texels, expected at most 8192 along an axis"


@pytest.mark.parametrize("channels", [1, 3])
def test_wrong_number_of_channels_is_an_error(logo, tmp_path, channels):
    logo.logo.CreatePinchmapAttr(write(tmp_path, "map.png", zero(channels=channels)))
    finding = logo.the_only("fexel:Pinchmap")
    assert (finding.severity, finding.path) == ("error", "/World/Wall/Photo/Logo")
    assert finding.message == f"inputs:pinchmap: ./map.png: {channels} channels, expected 4 (d_s, d_t, k, gamma)"


@pytest.mark.parametrize("size", [(8, 4), (12, 12), (32, 32), (3, 5), (5, 5)])
def test_size_that_does_not_go_with_the_signal_is_an_error(logo, tmp_path, size):
    logo.logo.CreatePinchmapAttr(write(tmp_path, "map.png", zero(*size)))
    finding = logo.the_only("fexel:Pinchmap")
    assert finding.severity == "error"
    assert f"{size[1]} x {size[0]} texels for a signal of 16 x 16 (./wall.png), expected" in finding.message


def test_pinchmap_without_a_signal_is_an_error(logo, tmp_path):
    logo.logo.GetFileAttr().Set("")
    logo.logo.CreatePinchmapAttr(write(tmp_path, "map.png", zero()))
    assert "without inputs:file, expected a signal texture" in logo.the_only("fexel:Pinchmap").message


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_value_that_is_not_finite_is_an_error_that_says_where(logo, tmp_path, value):
    texels = zero(dtype=np.float32)
    texels[2, 5, 3] = value
    logo.logo.CreatePinchmapAttr(write(tmp_path, "map.exr", texels))
    finding = logo.the_only("fexel:Pinchmap")
    assert finding.severity == "error"
    assert f"gamma is {value:g} at column 5, row 2, expected finite values" in finding.message


def test_value_outside_of_the_range_is_a_warning(logo, tmp_path):
    texels = zero(dtype=np.float32)
    texels[1, 0, 0] = -1.25
    logo.logo.CreatePinchmapAttr(write(tmp_path, "map.exr", texels))
    finding = logo.the_only("fexel:Pinchmap")
    assert finding.severity == "warning"
    assert "d_s is -1.25 at column 0, row 1, clamped, expected values in [-1, 1]" in finding.message


@pytest.mark.parametrize(("dtype", "highest"), [(np.uint8, 255), (np.uint16, 65535)])
def test_highest_integer_is_a_warning(logo, tmp_path, dtype, highest):
    texels = zero(dtype=dtype)
    texels[0, 7, 2] = highest
    logo.logo.CreatePinchmapAttr(write(tmp_path, "map.png", texels))
    finding = logo.the_only("fexel:Pinchmap")
    assert finding.severity == "warning"
    assert f"k is {highest} at column 7, row 0, read as 1, expected at most {highest - 1}" in finding.message


def test_missing_or_unreadable_pinchmap_is_said_once_by_the_files_validator(logo, tmp_path):
    logo.logo.CreatePinchmapAttr("./gone.png")
    assert logo.the_only("fexel:Files").message == "inputs:pinchmap: ./gone.png: no such file"
    (tmp_path / "text.png").write_text("not an image")
    logo.logo.GetPinchmapAttr().Set("./text.png")
    assert "text.png" in logo.the_only("fexel:Files").message
    assert logo.found("fexel:Pinchmap") == []


def test_every_time_sample_is_looked_at(logo, tmp_path):
    attribute = logo.logo.CreatePinchmapAttr()
    attribute.Set(Sdf.AssetPath(write(tmp_path, "good.png", zero())), 1)
    attribute.Set(Sdf.AssetPath(write(tmp_path, "bad.png", zero(5, 5))), 2)
    assert logo.the_only("fexel:Pinchmap").message.endswith("along both axes at time 2")


def test_colour_space_of_a_pinchmap_must_be_raw(logo, tmp_path):
    attribute = logo.logo.CreatePinchmapAttr(write(tmp_path, "map.png", zero()))
    attribute.SetColorSpace("sRGB")
    assert logo.the_only("fexel:DataColorSpace").severity == "error"
