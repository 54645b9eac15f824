"""Levels of detail as authored: where each is seen, how pictures go on past the border, vectors that turn."""

import numpy as np
import pytest
from pxr import Gf, Sdf

import fexel
from bench.zipmap_stage import quad, render_texture, save
from fexel.scene.model import Texture
from fexel.textures.system import TextureSystem
from fexel.textures.umbrella_twin import UmbrellaTwin
from tests.textures.umbrella_squares import SOIL, SQUARE, WHOLE, add_patch, lawn_prim, placement, read, shown, squares

GRID = (8, 8)
GREEN, BLUE = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def plain(path, color):
    return save(path, np.tile(np.float32([*color, 1]), (16, 16, 1)), "float", levels=5)


def add_image_level(stage, number, file):
    level = fexel.UmbrellaLevel.Define(stage, f"/Lawn/Level{number}")
    level.CreateLevelAttr(number)
    level.CreateFileAttr(Sdf.AssetPath(str(file)))
    level.GetFileAttr().SetColorSpace("raw")


def add_merged_level(stage, number, grid, color, coverage, matrix=None):
    """One umbrella, by default one that covers the unit square once."""
    level = fexel.UmbrellaLevel.Define(stage, f"/Lawn/Level{number}")
    level.CreateLevelAttr(number)
    level.CreateGridAttr(Gf.Vec2i(*grid))
    level.CreatePatchIndicesAttr([-1])
    level.CreateVertexCountsAttr([5])
    level.CreatePointsAttr(SQUARE)
    level.CreateMatricesAttr([matrix or placement(0.5, 0.5, 1.0)])
    level.CreateColorsAttr([color] * 5)
    level.CreateCoveragesAttr([coverage])


def at_detail(gl, stage, detail, system=None, grid=GRID):
    """A view that shows cells of one width: log2 of the cells per pixel, from an eighth on."""
    cells = 0.125 * 2.0**detail
    extent = 64 * cells / np.array(grid)
    return shown(gl, stage, system=system, draw=quad((0, 0), extent))


def layered(tmp_path, level_grid=(4, 4)):
    """The ground, from level 1 on half green, from level 3 on blue."""
    stage = squares([], [], grid=GRID)
    add_merged_level(stage, 1, level_grid, GREEN, 0.5)
    add_image_level(stage, 3, plain(tmp_path / "blue.tif", BLUE))
    return stage


def blended(detail):
    half = 0.5 * np.array(SOIL) + (0, 0.5, 0, 0.5)
    return [np.interp(detail, [0, 1, 3], [SOIL[i], half[i], (*BLUE, 1)[i]]) for i in range(4)]


@pytest.mark.parametrize("level_grid", [(4, 4), (1, 1), (16, 16)])
@pytest.mark.parametrize("detail", [0.7, 1.0, 1.3, 1.5, 1.9, 2.5, 3.0, 4.0])
def test_level_of_a_footprint_does_not_depend_on_what_else_the_view_sees(gl, tmp_path, detail, level_grid):
    picture = at_detail(gl, layered(tmp_path, level_grid), detail)
    assert np.median(picture, axis=(0, 1)) == pytest.approx(blended(detail), abs=5e-3)  # its rim is soft


def test_slow_zoom_over_merged_umbrellas_and_picture_has_no_jump(gl, tmp_path):
    stage, system = layered(tmp_path), TextureSystem(gl)
    details = np.arange(0, 3.5, 0.05)
    means = np.array([np.median(at_detail(gl, stage, detail, system), axis=(0, 1)) for detail in details])
    system.release()
    steps = np.abs(np.diff(means, axis=0)).max(axis=1)
    assert steps.max() < 0.05 * 0.8  # nothing changes by more than that an octave


# Past the border


def halves():
    """Red above blue."""
    texels = np.zeros((16, 16, 4), np.float32)
    texels[:8, :, 0] = texels[8:, :, 2] = texels[..., 3] = 1
    return texels


@pytest.mark.parametrize("level", [None, 1], ids=["own picture", "level"])
@pytest.mark.parametrize("wrap", ["clamp", "mirror", "black", "useMetadata"])
def test_border_of_a_far_view_is_not_mixed_with_the_opposite_one(gl, tmp_path, wrap, level):
    stage = squares([], [], grid=GRID)
    file = save(tmp_path / "halves.tif", halves(), "float", levels=5)
    lawn_prim(stage).CreateFileAttr(Sdf.AssetPath(file))
    lawn_prim(stage).CreateSourceColorSpaceAttr("raw")
    lawn_prim(stage).CreateWrapSAttr("repeat")
    lawn_prim(stage).CreateWrapTAttr(wrap)
    if level:
        add_image_level(stage, level, file)
    # The texture is 8 pixels high, from pixel 28 to 36.
    picture = shown(gl, stage, draw=quad((-3.5, -3.5), (4.5, 4.5)))
    above, top, bottom, below = (picture[row, 16, :3] for row in (27, 28, 35, 36))
    weight = max(top[0], 1e-6)  # black fades over the pixel at the border
    assert top[2] < 0.02 * weight
    assert bottom[0] < 0.02 * bottom[2]
    if wrap in ("clamp", "mirror"):
        assert np.abs(above - (1, 0, 0)).max() < 0.02
        assert np.abs(below - (0, 0, 1)).max() < 0.02


def test_border_of_a_far_view_that_repeats_is_mixed_with_the_opposite_one(gl, tmp_path):
    stage = squares([], [], grid=GRID)
    add_image_level(stage, 1, save(tmp_path / "halves.tif", halves(), "float", levels=5))
    picture = shown(gl, stage, draw=quad((0.25, 0.25), (8.25, 8.25)))  # pixels lie on borders in turn
    assert np.abs(picture[::4, :, 0] + picture[::4, :, 2] - 1).max() < 0.02
    assert np.abs(picture - picture[16:17, 16:17]).max() <= 1.01


# Vectors


NORMAL = (0.75, 0.375, 0.875)
PLACEMENTS = [
    (0.25, 0.25, 40),
    (0.75, 0.25, 160),
    (0.25, 0.75, -75),
]


def turned(x, y, degrees, size=0.4, mirror=1):
    c, s = size * np.cos(np.radians(degrees)), size * np.sin(np.radians(degrees))
    return Gf.Matrix3d(mirror * c, mirror * s, 0, -s, c, 0, x, y, 1)


def normal_map(tmp_path, scale, bias):
    """Squares that show one vector, turned, the last one mirrored too; stored as scale and bias say."""
    matrices = [turned(*place) for place in PLACEMENTS] + [turned(0.75, 0.75, 25, mirror=-1)]
    stage = squares(matrices, np.zeros((4, 3)), grid=(4, 4))
    vector = 2 * np.array(NORMAL) - 1
    stored = (vector - bias[:3]) / scale[:3]
    file = save(tmp_path / "normal.tif", np.tile(np.float32(stored), (16, 16, 1)), "float")
    add_patch(stage, "Square", file=file)
    texture = lawn_prim(stage)
    texture.CreateSourceColorSpaceAttr("raw")
    texture.CreateScaleAttr(Gf.Vec4f(*scale))
    texture.CreateBiasAttr(Gf.Vec4f(*bias))
    texture.CreateFallbackAttr(Gf.Vec4f(0, 0, 1, 1))
    return stage


@pytest.mark.parametrize(
    ("scale", "bias"),
    [
        ((2, 2, 2, 1), (-1, -1, -1, 0)),
        ((2, 2, 2, 2), (-1, -1, -1, -1)),
        ((2, 2, 2, 0), (-1, -1, -1, 1)),
        ((2, -2, 2, 1), (-1, 1, -1, 0)),
        ((-2, 2, 2, 1), (1, -1, -1, 0)),
        ((-2, -2, 2, 1), (1, 1, -1, 0)),
    ],
)
def test_vectors_turn_with_their_umbrellas_however_they_are_stored(gl, tmp_path, scale, bias):
    stage = normal_map(tmp_path, scale, bias)
    data = read(stage)
    assert data.turns_vectors
    picture = render_texture(gl, Texture("/Lawn", "umbrella", data), quad(), WHOLE)
    x, y, z = 2 * np.array(NORMAL) - 1
    for (s, t, degrees), mirror in zip([*PLACEMENTS, (0.75, 0.75, 25)], (1, 1, 1, -1), strict=True):
        c, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        wanted = (mirror * c * x - sine * y, mirror * sine * x + c * y, z)
        row, column = int((1 - t) * 64), int(s * 64)
        assert picture[row, column, :3] == pytest.approx(wanted, abs=5e-3)
        point = UmbrellaTwin(data, "/Lawn").sample(np.array([[s, t]]))[0]
        assert point[:3] == pytest.approx(wanted, abs=2e-3)


@pytest.mark.parametrize(
    ("scale", "bias"),
    [((2, 2, 1, 1), (-1, -1, 0, 0)), ((2, 2, 2, 1), (-1, -1, 0, 0)), ((1, 1, 1, 1), (0, 0, 0, 0))],
)
def test_what_does_not_decode_to_vectors_does_not_turn(tmp_path, scale, bias):
    stage = normal_map(tmp_path, scale, bias)
    assert not read(stage).turns_vectors


def test_vectors_of_merged_umbrellas_turn_as_in_the_renderer(gl, tmp_path):
    stage = normal_map(tmp_path, (2, -2, 2, 1), (-1, 1, -1, 0))
    add_merged_level(stage, 1, (2, 2), NORMAL, 1.0, turned(0.5, 0.5, 30, 6.0))
    picture = at_detail(gl, stage, 1.0, grid=(4, 4))
    cells = 0.25 / 4
    wanted = UmbrellaTwin(read(stage), "/Lawn").sample(np.array([[0.3, 0.4]]), np.eye(2) * cells)[0]
    x, y = 2 * NORMAL[0] - 1, 1 - 2 * NORMAL[1]
    c, sine = np.cos(np.radians(30)), np.sin(np.radians(30))
    assert wanted[:2] == pytest.approx((c * x - sine * y, sine * x + c * y), abs=1e-3)
    assert picture[32, 32] == pytest.approx(wanted, abs=5e-3)
