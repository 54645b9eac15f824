"""fexel:UmbrellaArrays."""

from __future__ import annotations

import pytest
from pxr import Gf, Usd

import fexel
from fexel.textures.umbrella import DIGEST_KEY, extract, level_digest

SQUARE = [(0.5, 0.5), (0, 0), (1, 0), (1, 1), (0, 1)]
IDENTITY = Gf.Matrix3d(1)
NEARLY_FLAT = Gf.Matrix3d(1, 1, 0, 1, 1 + 1e-14, 0, 0, 0, 1)
INFINITE = Gf.Matrix3d(1, 0, 1.5, 0, 1, 0, 0, 0, -0.5)  # w is 0 at x = 1/3, left of the centre
HUGE = Gf.Matrix3d(17, 0, 0, 0, 17, 0, 0, 0, 1)


@pytest.fixture
def lawn(sample):
    """Two umbrellas of one square leaf, and a level of one merged umbrella."""
    path = "/World/Wall/Photo/Lawn"
    umbrella = fexel.UmbrellaTexture.Define(sample.stage, path)
    umbrella.CreateGridAttr(Gf.Vec2i(2, 2))
    umbrella.CreatePatchIndicesAttr([0, 0])
    umbrella.CreateMatricesAttr([IDENTITY, IDENTITY])
    leaf = fexel.UmbrellaPatch.Define(sample.stage, f"{path}/Leaf")
    leaf.CreatePointsAttr(SQUARE)
    leaf.CreateTexCoordsAttr(SQUARE)
    level = fexel.UmbrellaLevel.Define(sample.stage, f"{path}/Level1")
    level.CreatePatchIndicesAttr([-1])
    level.CreateVertexCountsAttr([5])
    level.CreatePointsAttr(SQUARE)
    level.CreateColorsAttr([(1, 0, 0)] * 5)
    level.CreateCoveragesAttr([0.5])
    sample.stage.WriteFallbackPrimTypes()
    sample.umbrella, sample.leaf, sample.level = umbrella, leaf, level
    return sample


def test_consistent_arrays_are_no_fault(lawn):
    lawn.umbrella.CreateMorphsAttr([0.0, 1.0])
    lawn.umbrella.CreateColorsAttr([(0, 0, 0)] * 10)
    lawn.leaf.CreateMorphPointsAttr(SQUARE)
    assert lawn.findings() == []


@pytest.mark.parametrize(
    ("prim", "attribute", "value", "message"),
    [
        ("umbrella", "Matrices", [IDENTITY], "matrices: 1 entries, expected 2"),
        ("umbrella", "Morphs", [0.5], "morphs: 1 entries, expected 2"),
        ("umbrella", "Colors", [(0, 0, 0)] * 9, "colors: 9 entries, expected 10"),
        ("umbrella", "PatchIndices", [0, 1], "patchIndices: entry 1 is 1, expected 0 to 0"),
        ("umbrella", "PatchIndices", [-1, 0], "patchIndices: entry 0 is -1, expected 0 to 0"),
        ("umbrella", "Matrices", [IDENTITY, Gf.Matrix3d(0)], "matrices: entry 1 is singular"),
        ("umbrella", "Matrices", [Gf.Matrix3d(float("nan")), IDENTITY], "matrices: entry 0 is not finite"),
        ("umbrella", "Matrices", [IDENTITY, NEARLY_FLAT], "matrices: entry 1 is singular"),
        ("umbrella", "Matrices", [INFINITE, IDENTITY], "matrices: entry 0 maps infinity into the umbrella"),
        ("umbrella", "Matrices", [IDENTITY, HUGE], "matrices: entry 1 spans 17 times the unit square"),
        ("umbrella", "Grid", Gf.Vec2i(0, 4), "grid: grid of 0 x 4 cells"),
        ("leaf", "TexCoords", SQUARE[:4], "texCoords: 4 entries, expected 5"),
        ("leaf", "MorphPoints", SQUARE[:3], "morphPoints: 3 entries, expected 5"),
        ("level", "VertexCounts", [5, 5], "vertexCounts: 2 entries, expected 1"),
        ("level", "Points", SQUARE[:4], "points: 4 entries, expected 5"),
        ("level", "Colors", [(0, 0, 0)], "colors: 1 entries, expected 5"),
        ("level", "Coverages", [0.1, 0.2], "coverages: 2 entries, expected 1"),
        ("level", "Matrices", [NEARLY_FLAT], "matrices: entry 0 is singular"),
        ("level", "Matrices", [HUGE], "matrices: entry 0 spans 17 times the unit square"),
        ("level", "PatchIndices", [1], "patchIndices: entry 0 is 1, expected -1 to 0"),
    ],
)
def test_disagreement_names_the_array_and_both_numbers(lawn, prim, attribute, value, message):
    view = getattr(lawn, prim)
    getattr(view, f"Create{attribute}Attr")(value)
    found = lawn.found("fexel:UmbrellaArrays")
    assert all(finding.severity == "error" for finding in found)
    assert any(finding.path == str(view.GetPath()) and message in finding.message for finding in found), found


def test_patch_needs_a_centre_and_a_contour(lawn):
    lawn.leaf.CreatePointsAttr(SQUARE[:3])
    lawn.leaf.CreateTexCoordsAttr(SQUARE[:3])
    assert "3 points, expected a centre" in lawn.the_only("fexel:UmbrellaArrays").message


def test_points_that_are_not_finite_are_found(lawn):
    lawn.leaf.CreatePointsAttr([(float("nan"), 0), *SQUARE[1:]])
    assert "points: holds values that are not finite" in lawn.the_only("fexel:UmbrellaArrays").message


def test_faults_of_a_later_time_are_found_and_say_it_once(lawn):
    matrices = lawn.umbrella.GetMatricesAttr()
    for time, second in enumerate((IDENTITY, NEARLY_FLAT, NEARLY_FLAT)):
        matrices.Set([IDENTITY, second], time)
    finding = lawn.the_only("fexel:UmbrellaArrays")
    assert "matrices: entry 1 is singular" in finding.message
    assert finding.message.endswith(" at time 1")


def test_arrays_of_different_lengths_at_a_later_time_are_found(lawn):
    lawn.umbrella.GetPatchIndicesAttr().Set([0, 0], 0)
    lawn.umbrella.GetPatchIndicesAttr().Set([0, 0, 0], 24)
    finding = lawn.the_only("fexel:UmbrellaArrays")
    assert "matrices: 2 entries, expected 3, as many as patchIndices at time 24" in finding.message


def test_shape_that_infinity_enters_at_a_later_time_is_found_at_the_texture(lawn):
    lawn.umbrella.CreateMatricesAttr([IDENTITY, Gf.Matrix3d(1, 0, -0.6, 0, 1, 0, 0, 0, 1)])  # w is 0 at x = 5/3
    lawn.leaf.GetPointsAttr().Set(SQUARE, 0)
    lawn.leaf.GetPointsAttr().Set([(2 * x, y) for x, y in SQUARE], 1)
    finding = lawn.the_only("fexel:UmbrellaArrays")
    assert finding.path == str(lawn.umbrella.GetPath())
    assert "matrices: entry 1 maps infinity into the umbrella" in finding.message


def test_empty_umbrella_is_no_fault(lawn):
    lawn.umbrella.CreatePatchIndicesAttr([])
    lawn.umbrella.CreateMatricesAttr([])
    assert lawn.findings() == []


# Shapes, morphs and levels that are mended or left out


def test_clockwise_contour_is_a_warning(lawn):
    backward = [SQUARE[0], *SQUARE[:0:-1]]
    lawn.leaf.CreatePointsAttr(backward)
    finding = lawn.the_only("fexel:UmbrellaArrays")
    assert finding.severity == "warning"
    assert "points: contour runs clockwise, expected counter-clockwise" in finding.message


def test_centre_outside_of_its_contour_is_a_warning(lawn):
    lawn.leaf.CreatePointsAttr([(0.5, 3), *SQUARE[1:]])
    finding = lawn.the_only("fexel:UmbrellaArrays")
    assert finding.severity == "warning"
    assert "points: the centre does not see the whole contour" in finding.message


def test_morph_that_folds_is_a_warning_at_base_and_texture(lawn):
    folded = list(SQUARE)
    folded[2:4] = SQUARE[3], SQUARE[2]
    lawn.leaf.CreateMorphPointsAttr(folded)
    assert "morphPoints: a sector folds at a morph of 0.5" in lawn.the_only("fexel:UmbrellaArrays").message
    lawn.umbrella.CreateMorphsAttr([0.25, 0.75])
    found = lawn.found("fexel:UmbrellaArrays")
    assert {finding.severity for finding in found} == {"warning"}
    assert any("morphs: entry 1 is 0.75, which folds its base, expected at most 0.5" in f.message for f in found)


def test_morph_out_of_range_is_an_error(lawn):
    lawn.umbrella.CreateMorphsAttr([0.25, 1.5])
    finding = lawn.the_only("fexel:UmbrellaArrays")
    assert finding.severity == "error"
    assert "morphs: entry 1 is 1.5, expected 0 to 1" in finding.message


@pytest.mark.parametrize(("prim", "count"), [("umbrella", 10), ("level", 5)])
def test_colours_that_are_not_finite_are_found(lawn, prim, count):
    getattr(lawn, prim).CreateColorsAttr([(float("inf"), 0, 0)] + [(0, 0, 0)] * (count - 1))
    assert "colors: holds values that are not finite" in lawn.the_only("fexel:UmbrellaArrays").message


def test_level_of_another_arrangement_is_a_warning(lawn):
    data = extract(lawn.umbrella.GetPrim(), Usd.TimeCode.Default())
    lawn.level.GetPrim().SetCustomDataByKey(DIGEST_KEY, level_digest(data))
    assert lawn.findings() == []
    lawn.umbrella.CreateShadowStrengthAttr(0.5)
    finding = lawn.the_only("fexel:UmbrellaArrays")
    assert finding.severity == "warning"
    assert finding.path == str(lawn.level.GetPath())
    assert "made from another arrangement than its texture has now" in finding.message
