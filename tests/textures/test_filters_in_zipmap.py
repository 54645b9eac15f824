"""Minification filters of zipmaps and plain textures, rendered: against supersampled truth and against each other."""

import numpy as np
import pytest
from pxr import Sdf

import fexel
from bench.zipmap_stage import (
    Patch,
    front_view,
    pixel_st,
    quad,
    render_texture,
    save,
    tilted_view,
    zipmap_stage,
    zipmap_texture,
)
from fexel import homography, images
from fexel.renderer.visible import visible_surface
from fexel.textures.system import TextureRequest, TextureSystem

BY_LEVELS = ["mipmap", "anisotropic"]
PREFILTERED = ["ripmap", "fipmap"]

# ewa and auto are this renderer's own, and slow to draw in software: one wrap mode will do.
OTHERS = [("ewa", "repeat"), ("auto", "mirror")]
ALL = [*BY_LEVELS, *PREFILTERED]
SUPER = 6


def placed(low, high):
    """Matrix of an axis-aligned patch over low..high of its parent."""
    low, high = np.array(low, float), np.array(high, float)
    return homography.translate(*-low) @ homography.scale(*(1 / (high - low)))


def turned(degrees, low, high):
    """The same, turned about its middle."""
    angle = np.radians(degrees)
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    return placed(low, high) @ homography.translate(-0.5, -0.5) @ turn @ homography.translate(0.5, 0.5)


def checker(size, cell, channels=3, degrees=17.0):
    """Squares of `cell` texels, turned so that they lie on no grid of mip levels; texels are averages."""
    angle = np.radians(degrees)
    y, x = (np.mgrid[: 4 * size, : 4 * size] + 0.5) / (4 * cell)
    u, v = np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y
    odd = ((np.floor(u) + np.floor(v)) % 2).astype(np.float32).reshape(size, 4, size, 4).mean(axis=(1, 3))
    color = np.stack([odd, 0.25 + 0.5 * odd, 1 - odd, np.ones_like(odd)], -1)
    return color[..., :channels]


def stage_of(root, filters=(), wrap="clamp"):
    """Filters by prim path; none authored elsewhere."""
    stage = zipmap_stage(root, wrap)
    for path, token in dict(filters).items():
        fexel.TextureMinificationAPI.Apply(stage.GetPrimAtPath(path)).CreateFilterAttr(token)
    return stage


def shot(gl, stage, view, draw=None, **options):
    system = TextureSystem(gl, **options)
    picture = render_texture(gl, zipmap_texture(stage), draw or quad(), view, system)
    system.release()
    assert np.isfinite(picture).all()
    return picture


def binding_of(gl, stage, view, **options):
    """Defines of the program that would draw the texture."""
    surface = visible_surface(quad(), view, ["st"])
    system = TextureSystem(gl, **options)
    request = TextureRequest(zipmap_texture(stage), surface)
    system.begin_view([request])
    defines = system.binding([request]).defines
    system.release()
    return defines


def tilted(tilt, factor=1, distance=1.2, target=(0.5, 0.4)):
    return tilted_view(target, distance, tilt, 120 * factor, 80 * factor, fov=45)


def truth_of(gl, stage, tilt, draw=None, **view):
    """Means over many points of each pixel, and which pixels lie well within the quad."""
    fine = shot(gl, stage, tilted(tilt, SUPER, **view), draw)
    fine = fine.reshape(80, SUPER, 120, SUPER, 4)
    _, _, shown = pixel_st(tilted(tilt, SUPER, **view))
    inside = shown.reshape(80, SUPER, 120, SUPER).all(axis=(1, 3))
    return fine.mean(axis=(1, 3)), inside


def psnr(picture, truth, at):
    error = images.linear_to_srgb(picture[at][:, :3].clip(0, 1)) - images.linear_to_srgb(truth[at][:, :3].clip(0, 1))
    return -10 * np.log10(np.mean(error**2))


@pytest.fixture
def texels(tmp_path):
    return save(tmp_path / "checker.tif", checker(256, 7.3), color_space="sRGB", levels=20)


@pytest.fixture
def patch_texels(tmp_path):
    return save(tmp_path / "patch.tif", checker(256, 7.3, 4), color_space="sRGB", levels=20)


@pytest.fixture
def grey(tmp_path):
    return save(tmp_path / "grey.tif", np.full((32, 32, 3), 0.25, np.float32), color_space="sRGB", levels=20)


@pytest.mark.parametrize("tilt", [70, 80])
def test_fipmap_in_a_turned_patch_beats_mipmap_clearly_at_grazing_view(gl, grey, patch_texels, tilt):
    root = Patch(grey, np.eye(3), children=(Patch(patch_texels, turned(25, (0.2, 0.1), (0.8, 0.7))),))
    truth, inside = truth_of(gl, stage_of(root), tilt)
    error = {token: psnr(shot(gl, stage_of(root, {"/Zipmap": token}), tilted(tilt)), truth, inside) for token in ALL}
    assert error["fipmap"] > error["mipmap"] + 8
    assert error["fipmap"] > error["ripmap"] + 1
    assert error["anisotropic"] > error["mipmap"] + 2


@pytest.mark.parametrize("token", PREFILTERED)
@pytest.mark.parametrize("tilt", [0, 60, 80])
def test_border_of_an_opaque_patch_has_neither_seam_nor_fringe(gl, tmp_path, grey, token, tilt):
    """White on black: coverage alone. Mip levels with cleared rims shrink a patch, prefiltered ones must not."""
    black = save(tmp_path / "black.tif", np.zeros((32, 32, 3), np.float32), color_space="sRGB", levels=20)
    white = save(tmp_path / "white.tif", np.ones((96, 96, 4), np.float32), color_space="sRGB", levels=20)
    root = Patch(black, np.eye(3), children=(Patch(white, placed((0.25, 0.2), (0.75, 0.7))),))
    truth, inside = truth_of(gl, stage_of(root), tilt, distance=2.5)
    picture = shot(gl, stage_of(root, {"/Zipmap": token}), tilted(tilt, distance=2.5))
    plain = shot(gl, stage_of(root), tilted(tilt, distance=2.5))
    assert picture[..., :3].min() >= 0
    assert picture[..., :3].max() <= 1 + 1e-3
    error, before = (np.abs(each - truth)[inside][:, 0] for each in (picture, plain))
    assert error.max() < 0.22  # of single pixels; anisotropic lookups have up to 0.9
    assert np.sqrt(np.mean(error**2)) < 0.5 * np.sqrt(np.mean(before**2))


@pytest.mark.parametrize("token", [*PREFILTERED, "ewa"])
def test_every_place_is_looked_up_where_it_lies_in_any_view(gl, tmp_path, token):
    """A ramp: a lookup that misses, or meets what a view has not loaded, shows another place's colour."""
    y, x = (np.mgrid[:256, :256] + 0.5) / 256
    ramp = save(tmp_path / "ramp.tif", np.stack([x, 1 - y, 0 * x], -1).astype(np.float32), "float32", levels=20)
    stage, system = stage_of(Patch(ramp, np.eye(3)), {"/Zipmap": token}), TextureSystem(gl)
    for tilt in range(20, 86, 5) if token in PREFILTERED else (60, 80):
        for distance in (0.3, 1.2):
            view = tilted(tilt, distance=distance)
            picture = render_texture(gl, zipmap_texture(stage), quad(), view, system)
            st, jacobian, shown = pixel_st(view)
            inside = shown & ((st > 0.3) & (st < 0.7)).all(axis=1)
            reach = np.abs(jacobian).sum(axis=2)
            off = np.abs(picture.reshape(-1, 4)[:, :2] - st)
            assert (off[inside] < 0.25 * reach[inside] + 1e-3).all(), (tilt, distance)
    system.release()


@pytest.mark.parametrize(
    ("token", "wrap"), [(t, w) for t in PREFILTERED for w in ("clamp", "repeat", "mirror")] + OTHERS
)
def test_constant_stays_constant_whatever_the_filter_wrap_mode_and_view(gl, tmp_path, token, wrap):
    flat = save(tmp_path / "c.tif", np.full((19, 37, 3), (0.25, 0.5, 0.75), np.float32), "float32", levels=20)
    soft = np.full((40, 21, 4), (0.25, 0.5, 0.75, 1), np.float32)
    soft = save(tmp_path / "s.exr", soft * np.linspace(0, 1, 21, dtype=np.float32)[None, :, None], "float16", levels=20)
    lean = placed((0.2, 0.2), (0.8, 0.7)) @ np.array([[1, 0, 0.2], [0.1, 1, 0.1], [0, 0, 0.9]])
    root = Patch(flat, np.eye(3), children=(Patch(soft, lean), Patch(soft, turned(40, (0.3, 0.3), (0.6, 0.9)), 0.5)))
    stage = stage_of(root, {"/Zipmap": token}, wrap)
    for tilt, distance in ((0.0, 0.05), (0.0, 8.0), (80.0, 1.0), (88.0, 1.0)):
        picture = shot(gl, stage, tilted(tilt, distance=distance), quad((-1.5, -1.5), (2.5, 2.5)))
        seen = picture[..., 3] > 0
        assert seen.any()
        assert np.abs(picture[seen] - (0.25, 0.5, 0.75, 1)).max() < 2e-3


@pytest.mark.parametrize(
    ("token", "wrap"), [(t, w) for t in PREFILTERED for w in ("clamp", "repeat", "mirror", "black")] + OTHERS
)
def test_root_that_is_seen_alone_is_looked_up_as_one_below_a_patch(gl, tmp_path, texels, token, wrap):
    """The path without an index against the index: a patch that is transparent changes nothing but the way."""
    clear = save(tmp_path / "clear.tif", np.zeros((16, 16, 4), np.float32), levels=20)
    alone = stage_of(Patch(texels, np.eye(3)), {"/Zipmap": token}, wrap)
    covered = Patch(texels, np.eye(3), children=(Patch(clear, placed((-9, -9), (9, 9))),))
    covered = stage_of(covered, {"/Zipmap": token, "/Zipmap/patch0": "mipmap"}, wrap)
    view = tilted(75)
    assert binding_of(gl, alone, view)["ZIPMAP_ROOTS"] == 1
    assert binding_of(gl, covered, view)["ZIPMAP_ROOTS"] == 0
    draw = quad((-1.3, -1.3), (2.2, 2.2))
    assert np.abs(shot(gl, alone, view, draw) - shot(gl, covered, view, draw)).max() < 2e-3


@pytest.mark.parametrize("token", PREFILTERED)
@pytest.mark.parametrize("wrap", ["repeat", "mirror"])
def test_wrapped_texture_is_filtered_as_the_picture_that_it_continues_to(gl, tmp_path, rng, token, wrap):
    tile = np.kron(rng.random((8, 8, 3)), np.ones((8, 8, 1))).astype(np.float32)
    flipped = [tile, tile[:, ::-1], tile[::-1], tile[::-1, ::-1]]
    rows = 4
    whole = np.concatenate(
        [
            np.concatenate(
                [flipped[(column % 2) + 2 * (row % 2)] if wrap == "mirror" else tile for column in range(rows)], 1
            )
            for row in reversed(range(rows))
        ]
    )
    one = save(tmp_path / "one.tif", tile, "float32", levels=20)
    many = save(tmp_path / "many.tif", whole, "float32", levels=20)
    view = tilted(72, distance=0.7)
    wrapped = stage_of(Patch(one, homography.scale(rows, rows)), {"/Zipmap": token}, wrap)
    drawn = shot(gl, wrapped, view)
    st, _, shown = pixel_st(view)
    shown = (shown & ((st > 0.15) & (st < 0.85)).all(axis=1)).reshape(80, 120)
    expected = shot(gl, stage_of(Patch(many, np.eye(3)), {"/Zipmap": token}), view)
    error = np.abs(drawn - expected)[shown]
    # The directions of both chains are the same; texels of coarse levels are not where the period is odd in them.
    assert np.sqrt(np.mean(error**2)) < 0.01
    assert error.max() < 0.1


def test_every_layer_is_seen_by_its_own_filter(gl, grey, patch_texels):
    boxes = [((0.05, 0.05), (0.3, 0.8)), ((0.38, 0.05), (0.63, 0.8)), ((0.7, 0.05), (0.95, 0.8))]
    root = Patch(grey, np.eye(3), children=tuple(Patch(patch_texels, placed(*box)) for box in boxes))
    tokens = ["mipmap", "anisotropic", "fipmap"]
    view = tilted(78)
    mixed = stage_of(root, {"/Zipmap": "ripmap"} | {f"/Zipmap/patch{n}": token for n, token in enumerate(tokens)})
    drawn = shot(gl, mixed, view)
    st, _, shown = pixel_st(view)
    for box, token in zip(boxes, tokens, strict=True):
        low, high = np.array(box)
        within = (shown & ((st > low + 0.06) & (st < high - 0.06)).all(axis=1)).reshape(80, 120)
        assert within.sum() > 50
        alike = shot(gl, stage_of(root, {"/Zipmap": token}), view)
        assert np.abs(drawn - alike)[within].max() < 1e-4, token


@pytest.mark.parametrize("token", BY_LEVELS)
def test_filters_of_mip_levels_are_the_lookups_without_a_filter(gl, grey, patch_texels, token):
    """mipmap is what one probe shows, anisotropic what a prim without the schema shows: to the last bit."""
    root = Patch(grey, np.eye(3), children=(Patch(patch_texels, turned(20, (0.2, 0.1), (0.8, 0.7))),))
    view = tilted(75)
    expected = shot(gl, stage_of(root), view, anisotropy=1.0 if token == "mipmap" else 8.0)
    assert (shot(gl, stage_of(root, {"/Zipmap": token}), view) == expected).all()
    assert (shot(gl, stage_of(root, {"/Zipmap": "fipmap"}), view, filter=token) == expected).all()


def test_texture_without_a_filter_compiles_nothing_of_filters(gl, grey, patch_texels):
    root = Patch(grey, np.eye(3), children=(Patch(patch_texels, turned(20, (0.2, 0.1), (0.8, 0.7))),))
    for view in (front_view((0, 0), (1, 1), 64, 64), tilted(75)):
        defines = binding_of(gl, stage_of(root), view)
        assert not any(name.startswith("IMAGE_") for name in defines)
        assert not any(defines[f"ZIPMAP_{name}"] for name in ("FILTERED", "MIXED", "ROOTS"))


@pytest.mark.parametrize("token", ALL)
def test_magnified_texture_is_bilinear_whatever_the_filter(gl, texels, token):
    view = front_view((0.4, 0.4), (0.5, 0.5), 80, 80)
    plain = shot(gl, stage_of(Patch(texels, np.eye(3))), view)
    assert (shot(gl, stage_of(Patch(texels, np.eye(3)), {"/Zipmap": token}), view) == plain).all()


def test_little_memory_shows_a_softer_picture_and_never_fails(gl, tmp_path, rng, recwarn):
    large = save(tmp_path / "large.tif", rng.random((512, 512, 3)).astype(np.float32), color_space="sRGB", levels=20)
    stage = stage_of(Patch(large, np.eye(3)), {"/Zipmap": "fipmap"}, "repeat")
    draw, view = quad((0, 0), (3, 3)), tilted(80)
    full = shot(gl, stage, view, draw)
    for megabytes in (0.25, 0.02):
        tight = shot(gl, stage, view, draw, memory_mb=megabytes)
        assert np.abs(tight - full).mean() < 0.1
    assert {warning.category for warning in recwarn} <= {fexel.FexelWarning}


def test_texture_of_a_stock_stage_takes_a_filter(gl, tmp_path, texels):
    """A UsdUVTexture shader with the schema applied, and nothing of fexel's otherwise."""
    stage = zipmap_stage(Patch(texels, np.eye(3)))
    shader = stage.DefinePrim("/Texture", "Shader")
    shader.CreateAttribute("info:id", Sdf.ValueTypeNames.Token).Set("UsdUVTexture")
    shader.CreateAttribute("inputs:file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(texels))
    fexel.TextureMinificationAPI.Apply(shader).CreateFilterAttr("fipmap")
    view = tilted(75)
    truth, inside = truth_of(gl, stage_of(Patch(texels, np.eye(3))), 75)
    picture = render_texture(gl, zipmap_texture(stage, "/Texture"), quad(), view)
    plain = shot(gl, stage_of(Patch(texels, np.eye(3)), {"/Zipmap": "mipmap"}), view)
    assert psnr(picture, truth, inside) > psnr(plain, truth, inside) + 6
