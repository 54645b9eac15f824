"""Minification filters of umbrella textures, rendered: pictures of the whole, images of bases, backgrounds."""

import numpy as np
import pytest

import fexel
from bench.zipmap_stage import front_view, pixel_st, quad, render_texture, save, tilted_view
from fexel import images
from fexel.scene.model import Texture
from fexel.textures.system import TextureSystem
from tests.textures.umbrella_squares import add_patch, lawn_prim, placement, read, squares

SIZE, SUPER = (90, 60), 6
ALL = ["mipmap", "anisotropic", "ripmap", "fipmap"]


def lawn(rng, count=160, file="", grid=(12, 12)):
    places = [placement(*rng.random(2), rng.uniform(0.05, 0.12)) for _ in range(count)]
    stage = squares(places, rng.uniform(-0.1, 0.9, (count, 3)) if not file else np.zeros((count, 3)), grid=grid)
    if file:
        stage.RemovePrim("/Lawn/Square")
        add_patch(stage, "Square", file=file)
    return stage


def filtered(stage, token):
    api = fexel.TextureMinificationAPI.Apply(lawn_prim(stage).GetPrim())
    api.CreateFilterAttr(token)
    return stage


def shot(gl, stage, view, draw=None, **options):
    system = TextureSystem(gl, **options)
    picture = render_texture(gl, Texture("/Lawn", "umbrella", read(stage)), draw or quad(), view, system)
    system.release()
    assert np.isfinite(picture).all()
    return picture


def view_of(tilt, distance, factor=1):
    return tilted_view((0.5, 0.45), distance, tilt, SIZE[0] * factor, SIZE[1] * factor, fov=45)


def truth_of(gl, stage, tilt, distance):
    """Means over many points of each pixel, and which pixels lie well within the quad."""
    fine = view_of(tilt, distance, SUPER)
    shape = SIZE[1], SUPER, SIZE[0], SUPER
    inside = pixel_st(fine)[2].reshape(shape).all(axis=(1, 3))
    return shot(gl, stage, fine).reshape(*shape, 4).mean(axis=(1, 3)), inside


def psnr(picture, truth, at):
    error = images.linear_to_srgb(picture[at][:, :3].clip(0, 1)) - images.linear_to_srgb(truth[at][:, :3].clip(0, 1))
    return -10 * np.log10(np.mean(error**2))


@pytest.mark.parametrize(("tilt", "distance"), [(75, 1.6), (80, 2.4)])
def test_fipmap_beats_mipmap_clearly_where_an_umbrella_texture_is_minified(gl, rng, tilt, distance):
    stage = lawn(rng)
    truth, inside = truth_of(gl, stage, tilt, distance)
    error = {}
    for token in ("mipmap", "fipmap"):
        error[token] = psnr(shot(gl, filtered(stage, token), view_of(tilt, distance)), truth, inside)
    assert error["fipmap"] > error["mipmap"] + 2


def test_images_of_bases_are_filtered_where_probes_leave_footprints_long(gl, tmp_path, rng):
    """Stripes on every umbrella, in pixels that are 22 times as high as wide, of which two probes cover little."""
    stripes = np.zeros((256, 256, 3), np.float32)
    stripes[:, (np.arange(256) // 8) % 2 == 0] = (0.8, 0.7, 0.2)
    stage = lawn(rng, 60, save(tmp_path / "stripes.tif", stripes, color_space="sRGB", levels=20), grid=(2, 2))
    low, high = (0.48, 0.2), (0.52, 0.8)
    fine = shot(gl, stage, front_view(low, high, SIZE[0] * SUPER, SIZE[1] * 4 * SUPER))
    truth = fine.reshape(SIZE[1], 4 * SUPER, SIZE[0], SUPER, 4).mean(axis=(1, 3))
    error = {}
    for token in ("anisotropic", "fipmap"):
        picture = shot(gl, filtered(stage, token), front_view(low, high, *SIZE), anisotropy=2.0)
        error[token] = psnr(picture, truth, np.ones(SIZE[::-1], bool))
    assert error["fipmap"] > error["anisotropic"] + 3


@pytest.mark.parametrize("token", ["ripmap", "fipmap"])
@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
def test_constant_stays_constant_whatever_the_filter_wrap_mode_and_view(gl, tmp_path, rng, token, wrap):
    flat = save(tmp_path / "c.tif", np.full((24, 24, 3), (0.25, 0.5, 0.75), np.float32), "float32", levels=20)
    stage = filtered(lawn(rng, 40, flat), token)
    prim = lawn_prim(stage)
    prim.CreateWrapSAttr(wrap)
    prim.CreateWrapTAttr(wrap)
    prim.CreateFallbackAttr((0.25, 0.5, 0.75, 1))
    for tilt, distance in ((0, 0.1), (0, 6.0), (85, 1.0)):
        picture = shot(gl, stage, view_of(tilt, distance), quad((-1.2, -1.2), (2.2, 2.2)))
        seen = picture[..., 3] > 0
        assert seen.any()
        assert np.abs(picture[seen] - (0.25, 0.5, 0.75, 1)).max() < 4e-3


@pytest.mark.parametrize("token", ["mipmap", "anisotropic"])
def test_filters_of_mip_levels_are_the_lookups_without_a_filter(gl, rng, token):
    stage, view = lawn(rng), view_of(78, 1.6)
    expected = shot(gl, stage, view, anisotropy=1.0 if token == "mipmap" else 8.0)
    assert (shot(gl, filtered(stage, token), view) == expected).all()


@pytest.mark.parametrize("token", ALL)
def test_close_up_is_the_same_whatever_the_filter(gl, rng, token):
    stage = lawn(rng)
    view = front_view((0.4, 0.4), (0.6, 0.6), 64, 64)
    plain = shot(gl, stage, view)
    assert (shot(gl, filtered(stage, token), view) == plain).all()


@pytest.mark.parametrize("token", ["ripmap", "fipmap"])
def test_far_view_of_a_mirrored_texture_is_its_mirror_image(gl, rng, token):
    stage = filtered(lawn(rng), token)
    prim = lawn_prim(stage)
    prim.CreateWrapSAttr("mirror")
    prim.CreateWrapTAttr("mirror")
    view = front_view((0, 0), (1, 1), 24, 24)
    across = shot(gl, stage, view, quad((0, 0), (1, 1)))
    beyond = shot(gl, stage, view, quad((1, 1), (2, 2)))
    assert np.abs(beyond[::-1, ::-1] - across).max() < 5e-3
