"""What UmbrellaTexture, UmbrellaPatch and UmbrellaLevel prims say, as data; faults are said once and mended."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, Vt

import fexel
from fexel.errors import FexelWarning
from fexel.textures.umbrella import DIGEST_KEY, extract, level_digest
from fexel.textures.umbrella_geometry import signed_area
from fexel.textures.umbrella_sectors import Sectors

NOW = Usd.TimeCode.Default()
SQUARE = [(0, 0), (-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
TRIANGLE = [(0, 0.1), (-0.5, -0.5), (0.5, -0.5), (0, 0.7)]
NAN = float("nan")


def placement(x, y, size=0.1):
    return Gf.Matrix3d(size, 0, 0, 0, size, 0, x, y, 1)


def lawn(count=4, *, stage=None):
    """Squares and triangles in turn, along the diagonal."""
    assert fexel.__all__
    stage = stage or Usd.Stage.CreateInMemory()
    umbrella = fexel.UmbrellaTexture.Define(stage, "/Lawn")
    umbrella.CreateGridAttr(Gf.Vec2i(4, 3))
    umbrella.CreatePatchIndicesAttr([i % 2 for i in range(count)])
    umbrella.CreateMatricesAttr([placement((i + 0.5) / count, (i + 0.5) / count) for i in range(count)])
    for name, points in (("Square", SQUARE), ("Triangle", TRIANGLE)):
        patch = fexel.UmbrellaPatch.Define(stage, f"/Lawn/{name}")
        patch.CreatePointsAttr(points)
        patch.CreateTexCoordsAttr([(x + 0.5, y + 0.5) for x, y in points])
        patch.CreateFileAttr(Sdf.AssetPath(f"/nowhere/{name}.png"))
    return stage


def umbrella(stage):
    return fexel.UmbrellaTexture.Get(stage, "/Lawn")


def square(stage):
    return fexel.UmbrellaPatch.Get(stage, "/Lawn/Square")


def read(stage, time=NOW, nested=False):
    return extract(stage.GetPrimAtPath("/Lawn"), time, nested)


def said(stage, **how):
    """Data and what was said."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        data = read(stage, **how)
    assert all(issubclass(warning.category, FexelWarning) for warning in caught)
    return data, [str(warning.message) for warning in caught]


# What is authored


def test_arrays_are_read_as_they_are():
    stage = lawn()
    umbrella(stage).CreateMorphsAttr([0, 0.5, 1, 0.25])
    colors = np.linspace(-1, 1, 18 * 3, dtype=np.float32).reshape(-1, 3)
    umbrella(stage).CreateColorsAttr(Vt.Vec3fArray.FromNumpy(colors))
    umbrella(stage).CreateColorBlendAttr(0.5)
    umbrella(stage).CreateShadowOffsetAttr(Gf.Vec2f(0.01, -0.02))
    umbrella(stage).CreateShadowStrengthAttr(0.75)
    square(stage).CreateMorphPointsAttr([(2 * x, y) for x, y in SQUARE])
    data, messages = said(stage)
    arrangement = data.arrangement
    assert messages == []
    assert arrangement.grid == (4, 3)
    assert arrangement.shape_of.tolist() == [0, 1, 0, 1]
    assert np.array_equal(arrangement.matrices[1], np.array(placement(0.375, 0.375)))
    assert arrangement.morphs.tolist() == [0, 0.5, 1, 0.25]
    assert np.array_equal(arrangement.colors, colors)
    assert (arrangement.color_blend, arrangement.shadow_strength) == (0.5, 0.75)
    assert arrangement.shadow_offset == pytest.approx((0.01, -0.02))
    assert arrangement.coverages.tolist() == [1] * 4
    assert arrangement.shapes[0].image.file == "/nowhere/Square.png"
    assert np.array_equal(arrangement.shapes[0].morph_points[:, 0], 2 * np.array(SQUARE)[:, 0])
    assert np.array_equal(arrangement.shapes[1].morph_points, arrangement.shapes[1].points)
    assert data.paths == ("/Lawn/Square.file", "/Lawn/Triangle.file")


def test_equal_stages_compare_and_hash_equal_and_others_do_not():
    data = read(lawn())
    again = read(lawn())
    assert data == again
    assert hash(data) == hash(again)
    assert read(lawn(5)) != data
    stage = lawn()
    umbrella(stage).CreateShadowStrengthAttr(0.5)
    assert read(stage) != data
    stage = lawn()
    umbrella(stage).CreateFileAttr(Sdf.AssetPath("/nowhere/soil.png"))
    assert read(stage) != data


def test_time_samples_are_read_at_their_time():
    stage = lawn(1)
    attribute = umbrella(stage).GetMatricesAttr()
    attribute.Set([placement(0.25, 0.5)], 1)
    attribute.Set([placement(0.75, 0.5)], 2)
    colors = umbrella(stage).CreateColorsAttr()
    colors.Set([(0.1, 0, 0)] * 5, 1)
    colors.Set([(0.2, 0, 0)] * 5, 2)
    first, second = read(stage, Usd.TimeCode(1)), read(stage, Usd.TimeCode(2))
    assert first.arrangement.matrices[0, 2, 0] == 0.25
    assert second.arrangement.matrices[0, 2, 0] == 0.75
    assert second.arrangement.colors[0, 0] == pytest.approx(0.2)


def test_inactive_patches_do_not_count():
    stage = lawn(2)
    fexel.UmbrellaPatch.Define(stage, "/Lawn/Other").GetPrim().SetActive(False)
    stage.GetPrimAtPath("/Lawn/Square").SetActive(False)
    umbrella(stage).CreatePatchIndicesAttr([0, 0])
    data, messages = said(stage)
    assert messages == []
    assert data.paths == ("/Lawn/Triangle.file",)


def test_matrix_wrap_scale_and_fallback_are_those_of_a_texture():
    stage = lawn()
    texture = umbrella(stage)
    texture.CreateWrapSAttr("mirror")
    texture.CreateScaleAttr(Gf.Vec4f(2, 2, 2, 1))
    texture.CreateBiasAttr(Gf.Vec4f(-1, -1, -1, 0))
    texture.CreateFallbackAttr(Gf.Vec4f(0, 0, 1, 1))
    texture.CreateMatrixAttr(Gf.Matrix3d(2, 0, 0, 0, 3, 0, 0, 0, 1))
    data = read(stage)
    assert data.wrap == ("mirror", "useMetadata")
    assert data.st_to_texture == ((2, 0, 0), (0, 3, 0), (0, 0, 1))
    assert np.allclose(np.array(data.background.fallback) * data.scale + data.bias, (0, 0, 1, 1))
    nested = read(stage, nested=True)
    assert nested.wrap == ("patch", "patch")
    assert nested.st_to_texture == ((1, 0, 0), (0, 1, 0), (0, 0, 1))


def test_vectors_turn_only_where_texels_are_encoded_vectors():
    def turned(space):
        stage = lawn()
        umbrella(stage).CreateScaleAttr(Gf.Vec4f(2, 2, 2, 1))
        umbrella(stage).CreateBiasAttr(Gf.Vec4f(-1, -1, -1, 0))
        umbrella(stage).CreateSourceColorSpaceAttr(space)
        return read(stage)

    assert turned("raw").turns_vectors
    assert turned("raw").arrangement.shapes[0].image.color_space == "raw"
    assert not turned("sRGB").turns_vectors
    stage = lawn()
    umbrella(stage).CreateSourceColorSpaceAttr("raw")
    assert not read(stage).turns_vectors


def test_color_space_of_a_patch_is_its_own_where_it_has_one():
    stage = lawn()
    umbrella(stage).CreateSourceColorSpaceAttr("raw")
    square(stage).GetFileAttr().SetColorSpace("srgb_texture")
    images = [shape.image.color_space for shape in read(stage).arrangement.shapes]
    assert images == ["sRGB", "raw"]


def test_placements_are_moved_into_the_unit_square_by_whole_periods():
    stage = lawn(1)
    umbrella(stage).CreateMatricesAttr([placement(1000.25, -3.25)])
    arrangement = read(stage).arrangement
    assert arrangement.matrices[0, 2, :2].tolist() == [0.25, 0.75]
    tilted = np.array([[0.1, 0, 0.02], [0, 0.1, -0.01], [2.5, -1.25, 1]])
    umbrella(stage).CreateMatricesAttr([Gf.Matrix3d(*(-3 * tilted).ravel().tolist())])
    arrangement = read(stage).arrangement
    wanted = np.c_[np.array(SQUARE), np.ones(5)] @ tilted
    assert np.allclose(arrangement.vertices, wanted[:, :2] / wanted[:, 2:] - (2, -2))


def test_nothing_placed_is_the_background_alone():
    stage = lawn(0)
    data, messages = said(stage)
    assert messages == []
    assert len(data.arrangement) == 0
    assert data.arrangement.vertices.shape == (0, 2)


def test_hundred_thousand_umbrellas_are_read_whole():
    stage = lawn(0)
    rng = np.random.default_rng(3)
    count = 100_000
    matrices = np.zeros((count, 3, 3))
    matrices[:, 0, 0] = matrices[:, 1, 1] = 0.01
    matrices[:, 2, :2], matrices[:, 2, 2] = rng.uniform(-5, 5, (count, 2)), 1
    umbrella(stage).CreatePatchIndicesAttr(Vt.IntArray.FromNumpy(rng.integers(0, 2, count).astype(np.int32)))
    umbrella(stage).CreateMatricesAttr(Vt.Matrix3dArray.FromNumpy(matrices))
    data, messages = said(stage)
    assert messages == []
    assert len(data.arrangement) == count
    centers = data.arrangement.vertices[data.arrangement.first_vertex[:-1]]
    assert centers.min() >= -1e-8
    assert centers.max() < 1


# Faults


@pytest.mark.parametrize(
    ("attribute", "value", "message"),
    [
        ("Matrices", [placement(0, 0)] * 3, "matrices: 3 entries, expected 4, as many as patchIndices"),
        ("Morphs", [0.5] * 5, "morphs: 5 entries, expected 4, as many as patchIndices"),
        ("Colors", [(0, 0, 0)] * 17, "colors: 17 entries, expected 18, as many as vertices of all umbrellas"),
        ("PatchIndices", [0, 1], "matrices: 4 entries, expected 2, as many as patchIndices"),
    ],
)
def test_lengths_that_disagree_are_named_and_no_umbrella_is_drawn(attribute, value, message):
    stage = lawn()
    getattr(umbrella(stage), f"Create{attribute}Attr")(value)
    data, messages = said(stage)
    assert messages == [f"/Lawn.{message}; no umbrella is drawn"]
    assert len(data.arrangement) == 0


SINGULAR, FLAT = Gf.Matrix3d(0), Gf.Matrix3d(1, 2, 0, 2, 4, 0, 0, 0, 1)
BEHIND = Gf.Matrix3d(0.1, 0, 5, 0, 0.1, 0, 0, 0, 1)


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (Gf.Matrix3d(NAN), "matrices: entry 1 is not finite, expected an invertible matrix; left out"),
        (Gf.Matrix3d(float("inf")), "matrices: entry 1 is not finite, expected an invertible matrix; left out"),
        (SINGULAR, "matrices: entry 1 is singular, expected an invertible matrix; left out"),
        (FLAT, "matrices: entry 1 is singular, expected an invertible matrix; left out"),
        (BEHIND, "matrices: entry 1 maps infinity into the umbrella, expected w > 0 in all of it; left out"),
        (placement(0, 0, 1e6), "matrices: entry 1 spans 1.2e+06 times the unit square, expected at most 16; left out"),
        (
            placement(0, 0, 1e100),
            "matrices: entry 1 spans 1.2e+100 times the unit square, expected at most 16; left out",
        ),
        (placement(0, 0, 1e308), "matrices: entry 1 is singular, expected an invertible matrix; left out"),  # overflows
    ],
)
def test_unusable_matrix_leaves_its_umbrella_out(matrix, message):
    stage = lawn()
    matrices = [placement(0.1, 0.1), matrix, placement(0.2, 0.2), placement(0.3, 0.3)]
    umbrella(stage).CreateMatricesAttr(matrices)
    colors = np.arange(18 * 3, dtype=np.float32).reshape(-1, 3) / 100
    umbrella(stage).CreateColorsAttr(Vt.Vec3fArray.FromNumpy(colors))
    data, messages = said(stage)
    assert messages == [f"/Lawn.{message}"]
    assert data.arrangement.shape_of.tolist() == [0, 0, 1]
    assert np.array_equal(data.arrangement.colors, np.delete(colors, slice(5, 9), axis=0))
    assert np.isfinite(data.arrangement.vertices).all()


def test_faults_of_many_umbrellas_are_one_warning_with_their_number():
    stage = lawn()
    umbrella(stage).CreateMatricesAttr([SINGULAR, placement(0.1, 0.1), SINGULAR, SINGULAR])
    data, messages = said(stage)
    assert messages == [
        "/Lawn.matrices: entry 0 is singular, expected an invertible matrix; left out (3 entries in all)"
    ]
    assert len(data.arrangement) == 1


@pytest.mark.parametrize("index", [-1, 2, 2**31 - 1])
def test_index_without_a_patch_leaves_its_umbrella_out(index):
    stage = lawn()
    umbrella(stage).CreatePatchIndicesAttr([0, index, 0, 1])
    data, messages = said(stage)
    assert messages == [f"/Lawn.patchIndices: entry 1 is {index}, expected 0 to 1; left out"]
    assert data.arrangement.shape_of.tolist() == [0, 0, 1]
    colors = np.arange(18 * 3, dtype=np.float32).reshape(-1, 3) / 100  # as if it had four vertices
    umbrella(stage).CreateColorsAttr(Vt.Vec3fArray.FromNumpy(colors))
    data, _ = said(stage)
    assert np.array_equal(data.arrangement.colors, np.delete(colors, slice(5, 9), axis=0))


@pytest.mark.parametrize(
    ("attribute", "value", "message"),
    [
        ("Points", SQUARE[:3], "points: 3 points, expected a centre and at least 3 contour vertices"),
        ("Points", [], "points: 0 points, expected a centre and at least 3 contour vertices"),
        ("TexCoords", SQUARE[:4], "texCoords: 4 entries, expected 5, as many as points"),
        ("Points", [(0, NAN), *SQUARE[1:]], "points: holds values that are not finite, expected finite coordinates"),
        (
            "TexCoords",
            [(0, NAN), *SQUARE[1:]],
            "texCoords: holds values that are not finite, expected finite coordinates",
        ),
    ],
)
def test_unusable_patch_leaves_its_umbrellas_out(attribute, value, message):
    stage = lawn()
    getattr(square(stage), f"Create{attribute}Attr")(value)
    data, messages = said(stage)
    assert messages == [f"/Lawn/Square.{message}; its umbrellas are left out"]
    assert data.arrangement.shape_of.tolist() == [1, 1]
    assert np.isfinite(data.arrangement.vertices).all()


def test_patch_without_a_file_needs_no_texture_coordinates():
    stage = lawn()
    square(stage).CreateFileAttr(Sdf.AssetPath(""))
    square(stage).CreateTexCoordsAttr([])
    data, messages = said(stage)
    assert messages == []
    assert data.arrangement.shapes[0].image is None


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (SQUARE[:3], "3 entries, expected 5, as many as points"),
        ([(NAN, 0), *SQUARE[1:]], "holds values that are not finite, expected finite coordinates"),
    ],
)
def test_unusable_morph_points_are_no_morph(value, message):
    stage = lawn()
    square(stage).CreateMorphPointsAttr(value)
    data, messages = said(stage)
    assert messages == [f"/Lawn/Square.morphPoints: {message}; no morph"]
    assert np.array_equal(data.arrangement.shapes[0].morph_points, np.array(SQUARE))


def test_clockwise_contour_is_turned_with_all_that_belongs_to_it():
    stage = lawn(2)
    backward = [SQUARE[0], *SQUARE[:0:-1]]
    square(stage).CreatePointsAttr(backward)
    square(stage).CreateTexCoordsAttr([(x + 0.5, y + 0.5) for x, y in backward])
    square(stage).CreateMorphPointsAttr([(2 * x, y) for x, y in backward])
    colors = [(i / 10, 0, 0) for i in range(9)]
    umbrella(stage).CreateColorsAttr(colors)
    data, messages = said(stage)
    shape = data.arrangement.shapes[0]
    assert messages == []
    assert signed_area(shape.points[1:]) > 0
    assert np.array_equal(shape.points, SQUARE)
    assert np.allclose(shape.tex_coords, np.array(SQUARE) + 0.5)
    assert np.array_equal(shape.morph_points, np.array(SQUARE) * (2, 1))
    assert np.allclose(data.arrangement.colors[:, 0] * 10, [0, 4, 3, 2, 1, 5, 6, 7, 8])


def test_centre_that_does_not_see_its_contour_is_said():
    stage = lawn()
    square(stage).CreatePointsAttr([(0, 3), *SQUARE[1:]])
    data, messages = said(stage)
    assert messages == [
        "/Lawn/Square.points: the centre does not see the whole contour; only the sectors that turn forward are drawn"
    ]
    assert len(data.arrangement) == 4


def test_morph_that_would_fold_is_limited_to_the_largest_that_does_not():
    stage = lawn()
    folded = list(SQUARE)
    folded[2:4] = SQUARE[3], SQUARE[2]
    square(stage).CreateMorphPointsAttr(folded)
    umbrella(stage).CreateMorphsAttr([0.25, 1.0, 0.75, 0.5])
    data, messages = said(stage)
    assert messages == ["/Lawn.morphs: entry 2 is 0.75, which folds /Lawn/Square; expected at most 0.5; limited to it"]
    assert np.allclose(data.arrangement.morphs, [0.25, 1.0, 0.5, 0.5])
    assert (Sectors(data.arrangement).areas >= 0).all()


def test_numbers_out_of_range_are_limited_and_said():
    stage = lawn()
    umbrella(stage).CreateMorphsAttr([-0.5, 2.0, NAN, 0.5])
    umbrella(stage).CreateColorsAttr([(NAN, 0, float("inf"))] + [(0.5, 0, 0)] * 17)
    umbrella(stage).CreateColorBlendAttr(3.0)
    umbrella(stage).CreateShadowStrengthAttr(-1.0)
    umbrella(stage).CreateShadowOffsetAttr(Gf.Vec2f(NAN, 0))
    umbrella(stage).CreateGridAttr(Gf.Vec2i(0, -4))
    data, messages = said(stage)
    assert sorted(messages) == [
        "/Lawn.colors: entry 0 is not finite, expected finite offsets; 0 is used",
        "/Lawn.grid: is 0 x -4 cells, expected at least 1 x 1; 1 x 1 is used",
        "/Lawn.inputs:colorBlend: is 3, expected 0 to 1; 1 is used",
        "/Lawn.inputs:shadowOffset: is (nan, 0.0), expected finite values; (0.0, 0.0) is used",
        "/Lawn.inputs:shadowStrength: is -1, expected a finite value from 0; 0 is used",
        "/Lawn.morphs: entry 0 is -0.5, expected 0 to 1; limited to it (3 entries in all)",
    ]
    arrangement = data.arrangement
    assert arrangement.grid == (1, 1)
    assert arrangement.morphs.tolist() == [0, 1, 0, 0.5]
    assert arrangement.colors[0].tolist() == [0, 0, 0]
    assert (arrangement.color_blend, arrangement.shadow_strength, arrangement.shadow_offset) == (1.0, 0.0, (0.0, 0.0))


def test_unusable_matrix_of_the_texture_is_left_out():
    stage = lawn()
    umbrella(stage).CreateMatrixAttr(Gf.Matrix3d(0))
    data, messages = said(stage)
    assert len(messages) == 1
    assert "/Lawn.inputs:matrix: is singular" in messages[0]
    assert data.st_to_texture == ((1, 0, 0), (0, 1, 0), (0, 0, 1))


# Levels


def merged_level(stage, name="Level1", number=1):
    level = fexel.UmbrellaLevel.Define(stage, f"/Lawn/{name}")
    level.CreateLevelAttr(number)
    level.CreateGridAttr(Gf.Vec2i(2, 2))
    level.CreatePatchIndicesAttr([-1, -1])
    level.CreateVertexCountsAttr([5, 4])
    points = [(0.2 + 0.1 * x, 0.3 + 0.1 * y) for x, y in SQUARE] + [(0.6 + 0.1 * x, 0.7 + 0.1 * y) for x, y in TRIANGLE]
    level.CreatePointsAttr(points)
    level.CreateColorsAttr([(0.1 * i, 0, 0) for i in range(9)])
    level.CreateCoveragesAttr([0.5, 0.75])
    return level


def image_level(stage, name="Level2", number=2):
    level = fexel.UmbrellaLevel.Define(stage, f"/Lawn/{name}")
    level.CreateLevelAttr(number)
    level.CreateFileAttr(Sdf.AssetPath("/nowhere/level.tif"))
    return level


def test_levels_are_read_in_order_of_their_numbers():
    stage = lawn()
    image_level(stage, "A", 3)
    merged_level(stage, "B", 1)
    data, messages = said(stage)
    assert messages == []
    assert [(level.level, level.path) for level in data.levels] == [(1, "/Lawn/B.file"), (3, "/Lawn/A.file")]
    merged, image = data.levels
    assert image.image.file == "/nowhere/level.tif"
    assert merged.arrangement.grid == merged.grid == (2, 2)
    assert merged.arrangement.coverages.tolist() == [0.5, 0.75]
    assert merged.arrangement.shapes[0].image is None
    assert np.allclose(merged.arrangement.vertices[:5], np.array(SQUARE) * 0.1 + (0.2, 0.3))
    assert (merged.arrangement.color_blend, merged.arrangement.shadow_strength) == (1.0, 0.0)


def test_level_may_show_bases_and_place_its_points():
    stage = lawn()
    umbrella(stage).CreateColorBlendAttr(0.5)
    level = merged_level(stage)
    level.CreatePatchIndicesAttr([0, 1])
    level.CreateMatricesAttr([placement(0.1, 0.1, 1.0), placement(0.0, 0.0, 1.0)])
    arrangement = read(stage).levels[0].arrangement
    assert arrangement.shapes[0].image.file == "/nowhere/Square.png"
    assert np.allclose(arrangement.vertices[0], (0.3, 0.4))
    assert np.allclose(arrangement.colors[:, 0], 0.05 * np.arange(9))  # offsets, blended as the texture's


@pytest.mark.parametrize("suffix", ["usda", "usdc"])
def test_digest_is_the_same_before_and_after_a_stage_is_written(tmp_path, suffix):
    rng = np.random.default_rng(9)
    stage = lawn(40)
    umbrella(stage).CreateMatricesAttr(
        [Gf.Matrix3d(*(rng.normal(0, 0.1, (3, 3)) * [[1, 1, 0]] + np.diag([0, 0, 1])).ravel()) for _ in range(40)]
    )
    umbrella(stage).CreateMorphsAttr(rng.uniform(0, 1, 40).tolist())
    colors = rng.normal(0, 0.2, (180, 3)).astype(np.float32)
    umbrella(stage).CreateColorsAttr(Vt.Vec3fArray.FromNumpy(colors))
    umbrella(stage).CreateShadowOffsetAttr(Gf.Vec2f(0.1, -0.3))
    umbrella(stage).CreateFallbackAttr(Gf.Vec4f(0.1, 0.2, 0.3, 1))
    before = read(stage)
    image_level(stage).GetPrim().SetCustomDataByKey(DIGEST_KEY, level_digest(before))
    file = str(tmp_path / f"lawn.{suffix}")
    stage.GetRootLayer().Export(file)
    opened = Usd.Stage.Open(file)
    data, messages = said(opened)
    assert messages == []
    assert len(data.levels) == 1
    assert level_digest(data) == level_digest(before)


def test_digest_counts_numbers_as_the_stage_will_hold_them():
    data = read(lawn())
    arrangement = data.arrangement
    noise = 1 + 1e-9
    rounded = replace(arrangement, morphs=arrangement.morphs * noise, coverages=arrangement.coverages * noise)
    assert level_digest(replace(data, arrangement=rounded)) == level_digest(data)
    moved = replace(arrangement, matrices=arrangement.matrices * noise)
    assert level_digest(replace(data, arrangement=moved)) != level_digest(data)
    negative = replace(arrangement, matrices=np.where(arrangement.matrices == 0, -0.0, arrangement.matrices))
    assert level_digest(replace(data, arrangement=negative)) == level_digest(data)


@pytest.mark.parametrize(
    "change",
    [
        lambda u: u.CreateGridAttr(Gf.Vec2i(5, 3)),
        lambda u: u.CreateColorBlendAttr(0.5),
        lambda u: u.CreateShadowStrengthAttr(0.5),
        lambda u: u.CreateShadowOffsetAttr(Gf.Vec2f(0.5, 0)),
        lambda u: u.CreateFallbackAttr(Gf.Vec4f(1, 0, 0, 1)),
        lambda u: u.CreateFileAttr(Sdf.AssetPath("other.png")),
        lambda u: u.CreateMatricesAttr([placement(0.3, 0.3)] * 4),
        lambda u: u.CreatePatchIndicesAttr([1, 1, 0, 0]),
        lambda u: u.CreateColorsAttr([(0.1, 0, 0)] * 18),
        lambda u: u.CreateMorphsAttr([0.1] * 4),
    ],
)
def test_stale_level_is_said_once_and_left_out(change):
    stage = lawn()
    image_level(stage).GetPrim().SetCustomDataByKey(DIGEST_KEY, level_digest(read(stage)))
    merged_level(stage)  # without a digest: written by hand, used as it is
    assert len(read(stage).levels) == 2
    change(umbrella(stage))
    data, messages = said(stage)
    assert [level.path for level in data.levels] == ["/Lawn/Level1.file"]
    assert messages == [
        f"/Lawn/Level2.{DIGEST_KEY}: made from another arrangement than its texture has now; it is left out"
    ]


def test_digest_does_not_tell_where_files_lie(tmp_path):
    stages = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        file = str(tmp_path / folder / "lawn.usda")
        stage = lawn(stage=Usd.Stage.CreateNew(file))
        square(stage).CreateFileAttr(Sdf.AssetPath("./square.png"))
        stages.append(stage)
    assert level_digest(read(stages[0])) == level_digest(read(stages[1]))


@pytest.mark.parametrize(
    ("attribute", "value", "message"),
    [
        ("VertexCounts", [5], "vertexCounts: 1 entries, expected 2, as many as patchIndices; the level is not drawn"),
        (
            "Matrices",
            [placement(0, 0)],
            "matrices: 1 entries, expected 2, as many as patchIndices; the level is not drawn",
        ),
        ("Points", SQUARE, "points: 5 entries, expected 9, as many as the sum of vertexCounts; the level is not drawn"),
        (
            "Colors",
            [(0, 0, 0)],
            "colors: 1 entries, expected 9, as many as the sum of vertexCounts; the level is not drawn",
        ),
        ("Coverages", [1.0], "coverages: 1 entries, expected 2, as many as patchIndices; the level is not drawn"),
        ("Level", 0, "level: is 0, expected at least 1; it is left out"),
    ],
)
def test_unusable_level_is_left_out(attribute, value, message):
    stage = lawn()
    level = merged_level(stage)
    getattr(level, f"Create{attribute}Attr")(value)
    data, messages = said(stage)
    assert messages == [f"/Lawn/Level1.{message}"]
    assert data.levels == ()
    assert len(data.arrangement) == 4


def test_faults_of_merged_umbrellas_leave_them_alone_out():
    stage = lawn()
    level = merged_level(stage)
    level.CreatePatchIndicesAttr([7, -1])
    data, messages = said(stage)
    assert messages == ["/Lawn/Level1.patchIndices: entry 0 is 7, expected -1 to 1; left out"]
    assert len(data.levels[0].arrangement) == 1
    assert np.allclose(data.levels[0].arrangement.colors[:, 0], 0.1 * np.arange(5, 9))
    level.CreatePatchIndicesAttr([1, -1])
    _, messages = said(stage)
    assert messages == ["/Lawn/Level1.vertexCounts: entry 0 is 5, expected 4; left out"]
    level.CreatePatchIndicesAttr([-1, -1])
    level.CreateVertexCountsAttr([6, 3])
    _, messages = said(stage)
    assert messages == ["/Lawn/Level1.vertexCounts: entry 1 is 3, expected at least 4; left out"]


def test_second_level_of_a_number_is_left_out():
    stage = lawn()
    image_level(stage, "A", 1)
    merged_level(stage, "B", 1)
    data, messages = said(stage)
    assert [level.path for level in data.levels] == ["/Lawn/A.file"]
    assert messages == ["/Lawn/B.level: 1 is that of /Lawn/A as well; it is left out"]


# Perspective


KITE = [(0, 0), (-1, -0.1), (0.1, -0.1), (1, 0), (0.1, 0.1)]
"""Nothing of it is near the corner (1, 1) of its box."""


def test_perspective_that_only_a_corner_of_the_box_does_not_stand_is_drawn():
    stage = lawn(1)
    square(stage).CreatePointsAttr(KITE)
    tilted = Gf.Matrix3d(0.1, 0, -0.9, 0, 0.1, -2, 0.5, 0.5, 1)  # w < 0 at (1, 0.1), 0.1 at (1, 0)
    umbrella(stage).CreateMatricesAttr([tilted])
    data, messages = said(stage)
    assert messages == []
    assert len(data.arrangement) == 1
    flat = np.c_[np.array(KITE), np.ones(5)] @ np.array(tilted)
    assert np.allclose(data.arrangement.vertices, flat[:, :2] / flat[:, 2:])


@pytest.mark.parametrize(("morph", "drawn"), [(0, 1), (0.5, 1), (1, 0)])
def test_perspective_is_judged_by_the_shape_that_an_umbrella_takes(morph, drawn):
    stage = lawn(1)
    square(stage).CreateMorphPointsAttr([(2 * x, 2 * y) for x, y in SQUARE])
    umbrella(stage).CreateMorphsAttr([morph])
    umbrella(stage).CreateMatricesAttr([Gf.Matrix3d(0.1, 0, 1.2, 0, 0.1, 0, 0.5, 0.5, 1)])  # w > 0 from x = -5/6
    data, messages = said(stage)
    assert len(data.arrangement) == drawn
    assert len(messages) == 1 - drawn
    assert all("maps infinity into the umbrella" in message for message in messages)
