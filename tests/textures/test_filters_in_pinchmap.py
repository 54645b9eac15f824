"""Minification filters of pinchmaps, rendered: probes where something is displaced, prefiltered pictures beyond."""

import numpy as np
import pytest
from pxr import Gf

import fexel
from bench.pinchmap_texture import pinchmap_stage, random_pinchmap, save_texels, two_sides
from bench.zipmap_stage import Patch, front_view, pixel_st, quad, render_texture, save, tilted_view, zipmap_stage
from bench.zipmap_stage import zipmap_texture as texture_of
from fexel import homography, images, mipmaps
from fexel.textures.pinchmap_encoding import encode_texels
from fexel.textures.pinchmap_twin import picture_image, picture_levels, sample_pinchmap
from fexel.textures.system import TextureSystem

SHAPE = (48, 64)
SUPER = 6
SIZE = (90, 60)


@pytest.fixture
def files(rng, tmp_path):
    """Signal and pinchmap: sharp edges between light and dark."""
    pinchmap, mask = random_pinchmap(rng, SHAPE, ("clamp", "clamp"))
    signal = np.round(two_sides(rng, mask, 0, True)) / 256
    signal[..., :3] = 0.15 * signal[..., :3] + 0.8 * mask[..., None]
    signal[..., 3] = 1
    return (
        save_texels(tmp_path / "signal.tif", signal.astype(np.float32)),
        save_texels(tmp_path / "pinchmap.png", encode_texels(pinchmap)),
    )


def stage_of(files, token=None, **inputs):
    stage = pinchmap_stage(*files, **inputs)
    if token:
        fexel.TextureMinificationAPI.Apply(stage.GetPrimAtPath("/Pinchmap")).CreateFilterAttr(token)
    return stage


def shot(gl, stage, view, path="/Pinchmap", **options):
    system = TextureSystem(gl, **options)
    picture = render_texture(gl, texture_of(stage, path), quad(), view, system)
    system.release()
    assert np.isfinite(picture).all()
    return picture


def view_of(tilt, distance, factor=1):
    return tilted_view((0.5, 0.45), distance, tilt, SIZE[0] * factor, SIZE[1] * factor, fov=45)


def truth_of(gl, stage, tilt, distance, path="/Pinchmap"):
    """Means over many points of each pixel, and which pixels lie well within the quad."""
    fine = view_of(tilt, distance, SUPER)
    shape = SIZE[1], SUPER, SIZE[0], SUPER
    inside = pixel_st(fine)[2].reshape(shape).all(axis=(1, 3))
    return shot(gl, stage, fine, path).reshape(*shape, 4).mean(axis=(1, 3)), inside


def psnr(picture, truth, at):
    error = images.linear_to_srgb(picture[at][:, :3].clip(0, 1)) - images.linear_to_srgb(truth[at][:, :3].clip(0, 1))
    return -10 * np.log10(np.mean(error**2))


@pytest.mark.parametrize(("tilt", "distance"), [(75, 1.6), (82, 1.2), (82, 3.0)])
def test_fipmap_beats_mipmap_clearly_where_a_pinchmap_is_minified(gl, files, tilt, distance):
    truth, inside = truth_of(gl, stage_of(files), tilt, distance)
    tokens = ("mipmap", "anisotropic", "fipmap")
    error = {token: psnr(shot(gl, stage_of(files, token), view_of(tilt, distance)), truth, inside) for token in tokens}
    assert error["fipmap"] > error["mipmap"] + 5
    assert error["fipmap"] > error["anisotropic"] - 0.5


@pytest.mark.parametrize("token", ["ripmap", "fipmap"])
def test_picture_changes_smoothly_from_displaced_to_prefiltered(gl, files, token):
    """Seen from further and further away, the error of the same places neither jumps nor grows."""
    stage = stage_of(files, token)
    distances = np.geomspace(0.6, 3.2, 16)
    grid = np.stack(np.meshgrid(np.linspace(0.25, 0.75, 9), np.linspace(0.3, 0.6, 7)), -1).reshape(-1, 2)
    system = TextureSystem(gl)
    errors = []
    for distance in distances:
        view, fine = view_of(60, distance), view_of(60, distance, SUPER)
        picture = render_texture(gl, texture_of(stage, "/Pinchmap"), quad(), view, system)
        truth = shot(gl, stage_of(files), fine).reshape(SIZE[1], SUPER, SIZE[0], SUPER, 4).mean(axis=(1, 3))
        nearest = ((pixel_st(view)[0][None] - grid[:, None]) ** 2).sum(axis=2).argmin(axis=1)
        errors.append(np.sqrt(np.mean((picture - truth).reshape(-1, 4)[nearest, :3] ** 2)))
    system.release()
    assert max(errors) < 0.12
    assert np.abs(np.diff(errors)).max() < 0.04


@pytest.mark.parametrize("token", ["ripmap", "fipmap"])
def test_magnified_pinchmap_is_as_sharp_whatever_the_filter(gl, files, token):
    for low, high in ((0.4, 0.5), (0.3, 0.9)):
        view = front_view((low, low), (high, high), 64, 64)
        assert (shot(gl, stage_of(files, token), view) == shot(gl, stage_of(files), view)).all()


@pytest.mark.parametrize("token", ["mipmap", "anisotropic"])
def test_filters_of_mip_levels_are_the_lookups_without_a_filter(gl, files, token):
    view = view_of(78, 1.2)
    expected = shot(gl, stage_of(files), view, anisotropy=1.0 if token == "mipmap" else 8.0)
    assert (shot(gl, stage_of(files, token), view) == expected).all()


@pytest.mark.parametrize("token", ["ripmap", "fipmap"])
@pytest.mark.parametrize("wrap", ["clamp", "repeat", "mirror", "black"])
def test_far_pinchmap_shows_its_mean_colour_without_garbage(gl, files, token, wrap):
    """Where a pixel is far larger than a cell all filters agree, lines included."""
    inputs = {"wrapS": wrap, "wrapT": wrap, "lineWidth": 0.5, "lineColor": (1.0, 0.0, 0.0, 0.5)}
    view = front_view((-0.25, -0.25), (1.25, 1.25), 12, 12)
    plain, filtered = (shot(gl, stage_of(files, each, **inputs), view) for each in (None, token))
    assert np.abs(plain - filtered)[2:-2, 2:-2].mean() < 0.03
    assert filtered.min() >= 0
    assert filtered[..., :3].max() <= 1.01


@pytest.mark.parametrize("token", ["ripmap", "fipmap"])
def test_signal_without_a_pinchmap_is_filtered_as_a_plain_image(gl, files, token):
    view = view_of(78, 1.2)
    stage = stage_of((files[0], ""), token, wrapS="clamp", wrapT="clamp")
    plain = zipmap_stage(Patch(files[0], np.eye(3), color_space="raw"))
    fexel.TextureMinificationAPI.Apply(plain.GetPrimAtPath("/Zipmap")).CreateFilterAttr(token)
    assert np.abs(shot(gl, stage, view) - shot(gl, plain, view, "/Zipmap")).max() < 2e-3


def test_pinchmap_in_a_zipmap_is_seen_by_the_filter_of_the_zipmap(gl, files, tmp_path):
    grey = save(tmp_path / "grey.tif", np.full((16, 16, 3), 0.25, np.float32))
    view = view_of(82, 1.6)

    def nested(token):
        stage = zipmap_stage(Patch(grey, np.eye(3)))
        prim = stage.DefinePrim("/Zipmap/pinched", "PinchmapTexture")
        for name, file in zip(("file", "pinchmap"), files, strict=True):
            prim.GetAttribute(f"inputs:{name}").Set(file)
        prim.GetAttribute("inputs:sourceColorSpace").Set("raw")
        matrix = homography.scale(1 / 0.8, 1 / 0.8) @ homography.translate(-0.125, -0.125)
        prim.GetAttribute("inputs:matrix").Set(Gf.Matrix3d(*np.ravel(matrix).tolist()))
        if token:
            fexel.TextureMinificationAPI.Apply(stage.GetPrimAtPath("/Zipmap")).CreateFilterAttr(token)
        return stage

    truth, inside = truth_of(gl, nested(None), 82, 1.6, "/Zipmap")
    error = {token: psnr(shot(gl, nested(token), view, "/Zipmap"), truth, inside) for token in ("mipmap", "fipmap")}
    assert error["fipmap"] > error["mipmap"] + 4


def test_picture_as_an_image_is_the_average_of_what_is_shown(rng):
    """Every texel that is pinched against many points of it; every other one is the signal's."""
    pinchmap, mask = random_pinchmap(rng, (10, 12), ("repeat", "clamp"))
    wrap = ("repeat", "clamp")
    signal = two_sides(rng, mask, 1, True) / 256
    picture = picture_image(pinchmap, signal, wrap=wrap)
    assert picture.shape == signal.shape
    changed = np.argwhere((picture != signal).any(axis=2))
    assert 20 < len(changed) < signal.shape[0] * signal.shape[1]
    x, y = np.meshgrid((np.arange(16) + 0.5) / 16, (np.arange(16) + 0.5) / 16)
    for row, column in changed[:: len(changed) // 12]:
        st = np.stack([(column + x.ravel()) / 24, 1 - (row + y.ravel()) / 20], 1)
        expected = sample_pinchmap(pinchmap, [signal], st, np.diag([1 / (24 * 16), 1 / (20 * 16)]), wrap=wrap).mean(0)
        assert np.abs(picture[row, column] - expected).max() < 0.02


def test_picture_as_an_image_agrees_with_its_coarse_levels(rng):
    pinchmap, mask = random_pinchmap(rng, (16, 16), ("clamp", "clamp"))
    signal = (two_sides(rng, mask, 2, True) / 256).astype(np.float32)
    levels = picture_levels(pinchmap, mipmaps.pyramid(signal))
    whole = mipmaps.pyramid(picture_image(pinchmap, signal))
    assert np.abs(levels[3] - whole[3]).max() < 0.02
