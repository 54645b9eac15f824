"""Filters, contrast and brightness of textures and of what is nested in them, as data."""

import warnings

import numpy as np
import pytest

import fexel
from bench.zipmap_stage import Patch, save, zipmap_stage
from fexel import homography
from fexel.errors import FexelWarning
from fexel.textures import extract_texture
from fexel_tools.fallback import bake

NEST = Patch("", np.eye(3), children=(Patch("", np.eye(3), children=(Patch("", np.eye(3)),)), Patch("", np.eye(3))))
OUTER, INNER = "/Zipmap/patch0", "/Zipmap/patch0/patch0"


def filtered(stage, path, token):
    api = fexel.TextureMinificationAPI.Apply(stage.GetPrimAtPath(path))
    api.CreateFilterAttr(token)
    return api


def data(stage, path="/Zipmap"):
    return extract_texture(stage.GetPrimAtPath(path), 0.0)[1]


def test_without_a_filter_a_zipmap_carries_none():
    assert data(zipmap_stage(NEST)).filters == ()


def test_patch_takes_the_filter_of_the_texture_that_it_is_nested_in():
    stage = zipmap_stage(NEST)
    filtered(stage, "/Zipmap", "fipmap")
    assert data(stage).filters == ("fipmap",) * 4
    filtered(stage, OUTER, "mipmap")
    assert data(stage).filters == ("fipmap", "mipmap", "mipmap", "fipmap")
    filtered(stage, INNER, "ripmap")
    assert data(stage).filters == ("fipmap", "mipmap", "ripmap", "fipmap")


def test_filter_is_part_of_what_makes_textures_equal():
    stage = zipmap_stage(NEST)
    before = data(stage)
    filtered(stage, INNER, "fipmap")
    assert data(stage) != before
    assert data(stage) == data(stage)


@pytest.mark.parametrize("kind", ["PinchmapTexture", "UmbrellaTexture"])
def test_texture_of_another_kind_takes_the_filter_of_the_zipmap_that_it_is_in(kind):
    stage = zipmap_stage(NEST)
    nested = stage.DefinePrim("/Zipmap/other", kind)
    assert data(stage).nested[0].data.filter is None
    filtered(stage, "/Zipmap", "fipmap")
    assert data(stage).nested[0].data.filter == "fipmap"
    filtered(stage, nested.GetPath(), "anisotropic")
    assert data(stage).nested[0].data.filter == "anisotropic"


@pytest.mark.parametrize("kind", ["ZipmapTexture", "PinchmapTexture", "UmbrellaTexture"])
def test_unknown_filter_is_said_once_and_counts_as_anisotropic(kind):
    stage = zipmap_stage(Patch("", np.eye(3)))
    prim = stage.DefinePrim("/Alone", kind)
    filtered(stage, "/Alone", "trilinear")
    with pytest.warns(FexelWarning) as caught:
        read = data(stage, "/Alone")
    assert [str(warning.message).split(":")[0] for warning in caught] == [f"{prim.GetPath()}.minification"]
    assert (read.filters[0] if kind == "ZipmapTexture" else read.filter) == "anisotropic"


@pytest.mark.parametrize("kind", ["PinchmapTexture", "UmbrellaTexture"])
def test_contrast_and_brightness_of_a_nested_texture_are_of_its_image(kind):
    stage = zipmap_stage(NEST)
    nested = stage.DefinePrim("/Zipmap/other", kind)
    nested.GetAttribute("inputs:scale").Set((2, 1, 1, 0.5))
    api = fexel.TextureMinificationAPI.Apply(nested)
    api.CreateContrastAttr(0.5)
    api.CreateBrightnessAttr(0.25)
    read = data(stage).nested[0].data
    holder = read.signal if kind == "PinchmapTexture" else read
    assert holder.scale == (1.0, 0.5, 0.5, 0.5)
    assert holder.bias == (0.25, 0.25, 0.25, 0.0)


@pytest.mark.parametrize("kind", ["ZipmapTexture", "PinchmapTexture", "UmbrellaTexture"])
def test_contrast_and_brightness_of_a_patch_hold_for_its_fallback_as_for_an_image(kind):
    stage = zipmap_stage(NEST)
    nested = stage.DefinePrim("/Zipmap/other", kind)
    nested.GetAttribute("inputs:scale").Set((2, 2, 2, 1))
    nested.GetAttribute("inputs:fallback").Set((0.8, 0.4, 0.0, 0.5))
    api = fexel.TextureMinificationAPI.Apply(nested)
    api.CreateContrastAttr(0.5)
    api.CreateBrightnessAttr(0.25)
    read = data(stage)
    if kind == "ZipmapTexture":
        shown = read.sources[read.source_index[read.paths.index("/Zipmap/other")]].fallback
    else:
        other = read.nested[0].data
        shown = (
            other.signal.fallback
            if kind == "PinchmapTexture"
            else [s * v + b for v, s, b in zip(other.background.fallback, other.scale, other.bias, strict=True)]
        )
    assert shown == pytest.approx((0.65, 0.45, 0.25, 0.5))


def test_patch_without_a_fallback_stays_transparent_whatever_its_brightness():
    stage = zipmap_stage(NEST)
    api = fexel.TextureMinificationAPI.Apply(stage.GetPrimAtPath(OUTER))
    api.CreateBrightnessAttr(0.25)
    read = data(stage)
    assert read.sources[read.source_index[1]].fallback == (0.0, 0.0, 0.0, 0.0)


def test_contrast_and_brightness_of_a_patch_are_of_its_image_and_of_a_root_of_nothing_here():
    stage = zipmap_stage(NEST)
    for path in ("/Zipmap", OUTER):
        api = fexel.TextureMinificationAPI.Apply(stage.GetPrimAtPath(path))
        api.CreateContrastAttr(0.5)
        api.CreateBrightnessAttr(0.25)
    read = data(stage)
    root, outer, inner = (read.sources[read.source_index[layer]] for layer in (0, 1, 2))
    assert (outer.scale, outer.bias) == ((0.5, 0.5, 0.5, 1.0), (0.25, 0.25, 0.25, 0.0))
    for source in (root, inner):
        assert (source.scale, source.bias) == ((1.0,) * 4, (0.0,) * 4)


@pytest.mark.parametrize("kind", ["ZipmapTexture", "PinchmapTexture", "UmbrellaTexture"])
def test_attenuation_of_a_patch_is_ignored_and_said_once(kind):
    stage = zipmap_stage(NEST)
    nested = stage.DefinePrim("/Zipmap/other", kind)
    fexel.TextureMinificationAPI.Apply(nested).CreateAttenuationDistanceAttr(5.0)
    with pytest.warns(FexelWarning) as caught:
        data(stage)
    (message,) = (str(warning.message) for warning in caught)
    assert message.startswith("/Zipmap/other.minification:attenuationDistance: is ignored on a patch")


def test_attenuation_of_a_root_is_not_for_its_kind_to_judge():
    stage = zipmap_stage(NEST)
    fexel.TextureMinificationAPI.Apply(stage.GetPrimAtPath("/Zipmap")).CreateAttenuationDistanceAttr(5.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        data(stage)


def test_baked_picture_is_the_same_whatever_the_filter(tmp_path, rng):
    """A bake averages areas: how a renderer filters is not part of the picture."""
    file = save(tmp_path / "root.tif", rng.random((48, 48, 3)).astype(np.float32), levels=20)
    stage = zipmap_stage(Patch(file, np.eye(3), children=(Patch(file, homography.scale(1.6, 1.6)),)))
    pinched = stage.DefinePrim("/Zipmap/pinched", "PinchmapTexture")
    pinched.GetAttribute("inputs:file").Set(file)
    before = bake(stage.GetPrimAtPath("/Zipmap"), size=20)
    filtered(stage, "/Zipmap", "fipmap")
    filtered(stage, OUTER, "mipmap")
    assert (bake(stage.GetPrimAtPath("/Zipmap"), size=20) == before).all()
