"""fexel:UmbrellaArrays."""

from __future__ import annotations

import pytest
from pxr import Gf

import fexel

SQUARE = [(0.5, 0.5), (0, 0), (1, 0), (1, 1), (0, 1)]
IDENTITY = Gf.Matrix3d(1)


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
        ("umbrella", "Grid", Gf.Vec2i(0, 4), "grid: grid of 0 x 4 cells"),
        ("leaf", "TexCoords", SQUARE[:4], "texCoords: 4 entries, expected 5"),
        ("leaf", "MorphPoints", SQUARE[:3], "morphPoints: 3 entries, expected 5"),
        ("level", "VertexCounts", [5, 5], "vertexCounts: 2 entries, expected 1"),
        ("level", "Points", SQUARE[:4], "points: 4 entries, expected 5"),
        ("level", "Colors", [(0, 0, 0)], "colors: 1 entries, expected 5"),
        ("level", "Coverages", [0.1, 0.2], "coverages: 2 entries, expected 1"),
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


def test_empty_umbrella_is_no_fault(lawn):
    lawn.umbrella.CreatePatchIndicesAttr([])
    lawn.umbrella.CreateMatricesAttr([])
    assert lawn.findings() == []
