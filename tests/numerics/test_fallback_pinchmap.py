"""Pinchmaps baked into one image, alone and in a zipmap: against the twin, supersampled."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from pxr import Gf, Usd, UsdShade

import fexel
from fexel import homography
from fexel.errors import FexelWarning
from fexel.images import image_info, read_linear, read_pixels
from fexel.textures import extract_texture
from fexel.textures.pinchmap_twin import edge, sample_pinchmap
from fexel_tools import fallback
from fexel_tools.baking import texture_baker
from fexel_tools.image_files import write_image
from fexel_tools.pinchmap_baking import reconstruct
from fexel_tools.pinchmap_mask import channels
from fexel_tools.pinchmap_textures import as_stored, write_pinchmap, write_signal
from fexel_tools.texture_files import write_texture


def disc(rows, columns, wrap=("clamp", "clamp"), rng=None):
    """Pinchmap of a disc, as stored in 8 bits; with `rng` the line wanders within its fexels."""
    y, x = np.indices((rows, columns)) + 0.5
    mask = np.hypot(y - rows / 2, x - columns / 2) < 0.33 * min(rows, columns)
    pinchmap = np.zeros((rows, columns, 4))
    pinchmap[..., :3] = channels(mask, wrap)
    if rng is not None:
        pinchmap[..., 3] = rng.uniform(-0.4, 0.4, (rows, columns)) * (pinchmap[..., 2] == 0)
    return as_stored(pinchmap, "8"), mask


def centres(rows, columns):
    s, t = (np.arange(columns) + 0.5) / columns, 1 - (np.arange(rows) + 0.5) / rows
    return np.stack(np.meshgrid(s, t), axis=-1).reshape(-1, 2)


def premultiplied(signal):
    return np.concatenate([signal[..., :3] * signal[..., 3:], signal[..., 3:]], axis=-1).astype(np.float64)


@pytest.mark.parametrize("finer", [1, 4])
@pytest.mark.parametrize("wrap", [("clamp", "clamp"), ("repeat", "clamp"), ("mirror", "repeat")])
def test_magnified_picture_is_the_twin_at_every_pixel(rng, wrap, finer):
    """What is not pinched takes a shorter way; nobody may see which way a pixel took."""
    pinchmap, _ = disc(12, 16, wrap, rng)
    signal = rng.random((12 * finer, 16 * finer, 4)).astype(np.float32)
    line = {"line_width": 0.2, "line_color": (1.0, 0.5, 0.0, 0.5)}
    picture = reconstruct(pinchmap, signal, (97, 131), wrap, **line)
    twin = sample_pinchmap(
        pinchmap, premultiplied(signal), centres(97, 131), np.diag([1 / 131, -1 / 97]), wrap=wrap, **line
    )
    assert np.abs(picture - twin.reshape(97, 131, 4)).max() < 1e-6


def supersampled(pinchmap, signal, shape, samples):
    """Hard edges at samples x samples points of each pixel, averaged."""
    rows, columns = shape
    points = sample_pinchmap(pinchmap, premultiplied(signal), centres(rows * samples, columns * samples), None)
    return points.reshape(rows, samples, columns, samples, 4).mean(axis=(1, 3))


@pytest.mark.parametrize(("size", "mean", "largest"), [(128, 0.003, 0.5), (16, 0.03, 0.3), (4, 0.01, 0.05)])
def test_picture_of_any_size_is_the_supersampled_one(rng, size, mean, largest):
    """Above, at, and below the size of the pinchmap; no pixel is on the wrong side of black and white."""
    pinchmap, mask = disc(16, 16, rng=rng)
    signal = np.ones((16, 16, 4), np.float32)
    signal[..., :3] = mask[..., None]
    picture = reconstruct(pinchmap, signal, (size, size))
    error = np.abs(picture - supersampled(pinchmap, signal, (size, size), -(-256 // size)))
    assert error.mean() < mean
    assert error.max() < largest


def test_constant_signal_stays_constant(rng):
    pinchmap, _ = disc(16, 16, rng=rng)
    for shape in [(200, 200), (7, 9)]:
        picture = reconstruct(pinchmap, np.full((32, 32, 4), 0.5, np.float32), shape)
        assert np.allclose(picture[..., :3], 0.25, atol=1e-6) and np.allclose(picture[..., 3], 0.5, atol=1e-6)


@pytest.fixture
def stage(tmp_path):
    return Usd.Stage.CreateNew(str(tmp_path / "stage.usda"))


def define(stage, path, pinchmap, signal, *, is_data=False, has_alpha=True, bits=8):
    """A PinchmapTexture with its files beside the stage."""
    from pathlib import Path

    folder = Path(stage.GetRootLayer().realPath).parent / path.rpartition("/")[2]
    folder.mkdir()
    map_file, _ = write_pinchmap(folder, pinchmap, "8")
    written = write_signal(folder, signal, bits, is_data=is_data, has_alpha=has_alpha)
    texture = fexel.PinchmapTexture.Define(stage, path)
    texture.CreateFileAttr(f"./{folder.name}/{written.path.name}")
    texture.CreatePinchmapAttr(f"./{folder.name}/{map_file.name}")
    texture.CreateSourceColorSpaceAttr(written.color_space)
    return texture


def emblem(rng, side=16):
    """A red to yellow disc on nothing: pinchmap, signal."""
    pinchmap, mask = disc(side, side, rng=rng)
    signal = np.ones((side, side, 4), np.float32)
    signal[..., 1] = np.linspace(0, 1, side)
    signal[..., 2] = 0
    signal[..., 3] = mask
    return pinchmap, signal


def test_prim_is_baked_as_its_files_say(rng, stage):
    pinchmap, signal = emblem(rng)
    texture = define(stage, "/Mat/Texture", pinchmap, signal)
    baked = fallback.bake(texture.GetPrim(), 100)
    assert baked.shape == (100, 100, 4)
    assert np.abs(baked - reconstruct(pinchmap, signal, (100, 100))).max() < 0.02  # 8 bits of sRGB, linearised
    assert fallback.bake(texture.GetPrim(), 100_000).shape == (192, 192, 4), "12 pixels per texel show its curves"


def test_antialias_of_the_prim_does_not_blur_the_picture(rng, stage):
    texture = define(stage, "/Mat/Texture", *emblem(rng))
    sharp = fallback.bake(texture.GetPrim(), 64)
    texture.CreateAntialiasAttr(4.0)
    assert np.array_equal(fallback.bake(texture.GetPrim(), 64), sharp)


def test_line_is_baked_in_its_own_colour_whatever_the_scale(rng, stage):
    """inputs:scale and bias, which the fallback's network applies afterwards, are not the line's."""
    pinchmap, signal = emblem(rng)
    signal[..., :] = 0.25
    signal[..., 3] = 1.0
    texture = define(stage, "/Mat/Texture", pinchmap, signal, is_data=True, has_alpha=False)
    texture.CreateLineWidthAttr(0.5)
    texture.CreateLineColorAttr(Gf.Vec4f(0.5, 0.25, 0.75, 1.0))
    texture.CreateScaleAttr(Gf.Vec4f(2.0, 2.0, 2.0, 1.0))
    texture.CreateBiasAttr(Gf.Vec4f(-1.0, -1.0, -1.0, 0.0))
    shown = fallback.bake(texture.GetPrim(), 192)[..., :3] * 2 - 1
    on_line = np.abs(edge(pinchmap, centres(192, 192))).reshape(192, 192) < 0.02
    assert on_line.sum() > 100
    assert np.abs(shown[on_line] - (0.5, 0.25, 0.75)).max() < 0.02
    assert np.abs(shown[0, 0] + 0.5).max() < 0.01


def test_colour_goes_on_under_transparent_pixels(rng, tmp_path, stage):
    """Most applications filter straight colour: black there would darken every edge."""
    texture = define(stage, "/Mat/Texture", *emblem(rng))
    path = fallback.write_fallback(texture.GetPrim(), tmp_path / "fallback.png", 128)
    stored = read_pixels(image_info(str(path)))
    assert (stored[..., 3] == 0).any() and (stored[..., 3] == 255).any()
    assert (stored[..., 0] > 250).all() and (stored[..., 2] < 5).all()


@pytest.mark.parametrize(("bits", "dtype", "suffix"), [(8, "uint8", ".png"), (16, "uint16", ".png")])
def test_raw_pictures_keep_their_bits_and_their_scale(rng, tmp_path, stage, bits, dtype, suffix):
    pinchmap, signal = emblem(rng)
    texture = define(stage, "/Mat/Texture", pinchmap, signal, is_data=True, has_alpha=False, bits=bits)
    texture.CreateScaleAttr(Gf.Vec4f(2.0, 2.0, 2.0, 1.0))
    texture.CreateBiasAttr(Gf.Vec4f(-1.0, -1.0, -1.0, 0.0))
    path = fallback.write_fallback(texture.GetPrim(), tmp_path / "fallback.png", 64)
    assert path.suffix == suffix and image_info(str(path)).dtype == dtype
    shader = UsdShade.Shader(stage.GetPrimAtPath("/Mat/Texture/Fallback"))
    assert shader.GetInput("sourceColorSpace").Get() == "raw"
    assert shader.GetInput("scale").Get() == Gf.Vec4f(2, 2, 2, 1)
    assert shader.GetInput("bias").Get() == Gf.Vec4f(-1, -1, -1, 0)


def test_float_signal_makes_an_exr(rng, tmp_path, stage):
    pinchmap, signal = emblem(rng)
    signal[..., :3] *= 8
    texture = define(stage, "/Mat/Texture", pinchmap, signal, bits=32)
    path = fallback.write_fallback(texture.GetPrim(), tmp_path / "fallback.png", 64)
    assert path.suffix == ".exr" and image_info(str(path)).dtype == "float16"
    assert read_linear(str(path)).max() > 7.9


def test_without_a_pinchmap_the_image_is_shown(rng, stage):
    pinchmap, signal = emblem(rng)
    texture = define(stage, "/Mat/Texture", pinchmap, signal)
    texture.GetPrim().RemoveProperty("inputs:pinchmap")
    flat = np.zeros_like(pinchmap)
    flat[..., 2] = 1
    assert np.abs(fallback.bake(texture.GetPrim(), 16) - reconstruct(flat, signal, (16, 16))).max() < 0.02


@pytest.mark.parametrize("fault", ["channels", "ratio", "missing"])
def test_pinchmap_that_cannot_be_used_warns_once_and_shows_the_fallback_colour(rng, tmp_path, stage, fault):
    texture = define(stage, "/Mat/Texture", *emblem(rng))
    texture.CreateFallbackAttr(Gf.Vec4f(0.25, 0.5, 0.75, 1.0))
    if fault == "channels":
        write_image(tmp_path / "bad.png", np.zeros((16, 16, 3), np.uint8), "raw")
    elif fault == "ratio":
        write_image(tmp_path / "bad.png", np.full((12, 16, 4), 127, np.uint8), "raw")
    texture.GetPrim().GetAttribute("inputs:pinchmap").Set("./bad.png")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FexelWarning)
        baked = fallback.bake(texture.GetPrim(), 32)
    assert [w for w in caught if str(w.message).startswith("/Mat/Texture.inputs:pinchmap: ")] and len(caught) == 1
    assert np.allclose(baked, (0.25, 0.5, 0.75, 1.0), atol=1e-3)


PATCH_TO_ROOT = np.array([[0.55, 0.1, 0.05], [-0.08, 0.5, 0.03], [0.22, 0.2, 1.0]])


def zipmap_with_emblem(rng, tmp_path, stage, opacity=1.0):
    write_texture(tmp_path / "root.tif", np.full((40, 60, 3), 0.2, np.float32))
    zipmap = fexel.ZipmapTexture.Define(stage, "/Mat/Wall")
    zipmap.CreateFileAttr("./root.tif")
    pinchmap, signal = emblem(rng)
    texture = define(stage, "/Mat/Wall/Emblem", pinchmap, signal)
    texture.CreateMatrixAttr(Gf.Matrix3d(*np.linalg.inv(PATCH_TO_ROOT).ravel().tolist()))
    texture.CreateOpacityAttr(opacity)
    return zipmap, pinchmap, signal


@pytest.mark.parametrize("opacity", [1.0, 0.6])
def test_pinchmap_in_a_zipmap_is_baked_sharply_in_place(rng, tmp_path, stage, opacity):
    zipmap, pinchmap, signal = zipmap_with_emblem(rng, tmp_path, stage, opacity)
    baked = fallback.bake(zipmap.GetPrim(), 240)
    rows, columns = baked.shape[:2]
    assert columns == 240, "the emblem's curves ask for more than the root's 60 pixels"
    samples = 4
    points = centres(rows * samples, columns * samples)
    st = homography.apply(np.linalg.inv(PATCH_TO_ROOT), points)
    layer = np.zeros((len(points), 4))
    inside = ((st >= 0) & (st <= 1)).all(axis=1)
    layer[inside] = sample_pinchmap(pinchmap, premultiplied(signal), st[inside], None) * opacity
    truth = layer + (1 - layer[:, 3:]) * (0.2, 0.2, 0.2, 1.0)
    truth = truth.reshape(rows, samples, columns, samples, 4).mean(axis=(1, 3))
    error = np.abs(baked - truth)
    assert error.mean() < 0.004
    assert error.max() < 0.3, "no pixel is on the wrong side"
    assert (error > 0.05).mean() < 0.01


def test_zipmap_without_room_for_detail_is_not_larger_than_asked(rng, tmp_path, stage):
    zipmap, _, _ = zipmap_with_emblem(rng, tmp_path, stage)
    assert fallback.bake(zipmap.GetPrim(), 60).shape == (40, 60, 4)


@pytest.mark.parametrize(
    "matrix", [[[1.25, 0, 0], [0, 1.1, 0], [-0.1, 0.05, 1]], [[1, 0.2, 0.1], [-0.3, 1.2, 0], [0, 0, 1]]]
)
@pytest.mark.parametrize("size", [96, 10])
def test_matrix_of_the_prim_places_the_picture(rng, stage, matrix, size):
    """Also outside of the texture's own square, where it goes on as its wrap mode says."""
    pinchmap, signal = emblem(rng)
    texture = define(stage, "/Mat/Texture", pinchmap, signal)
    texture.CreateMatrixAttr(Gf.Matrix3d(*np.ravel(matrix).tolist()))
    baker = texture_baker("pinchmap", extract_texture(texture.GetPrim(), Usd.TimeCode.Default())[1], "/Mat/Texture")
    baked = baker.bake(size, size)
    samples = -(-192 // size)
    st = homography.apply(np.array(matrix), centres(size * samples, size * samples))
    truth = sample_pinchmap(pinchmap, premultiplied(signal), st, None)
    truth = truth.reshape(size, samples, size, samples, 4).mean(axis=(1, 3))
    error = np.abs(baked - truth)
    assert error.mean() < (0.005 if size == 96 else 0.04)
    assert error.max() < 0.5


def test_matrix_without_an_inverse_is_left_out_with_a_warning(rng, stage):
    texture = define(stage, "/Mat/Texture", *emblem(rng))
    plain = fallback.bake(texture.GetPrim(), 64)
    texture.CreateMatrixAttr(Gf.Matrix3d(0.0))
    with pytest.warns(FexelWarning, match=r"^/Mat/Texture\.inputs:matrix: is singular"):
        assert np.array_equal(fallback.bake(texture.GetPrim(), 64), plain)
