"""fexel:Matrix, fexel:PatchInsideParent, fexel:NestingDepth, fexel:Limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pxr import Gf

import fexel


def matrix(values):
    return Gf.Matrix3d(*np.asarray(values, float).ravel().tolist())


SHEARED = [[3, 0.5, 0.1], [0.2, 4, -0.2], [-1, -1, 1]]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.zeros((3, 3)), "singular"),
        (np.ones((3, 3)), "singular"),
        ([[4, 0, 0], [8, 0, 0], [0, 0, 1]], "singular"),
        (np.full((3, 3), math.nan), "not finite"),
        ([[4, 0, 0], [0, math.inf, 0], [0, 0, 1]], "not finite"),
        ([[4, 0, 0], [0, 4, 0], [0, 0, 0]], "singular"),
        (np.linalg.inv([[1, 0, -3], [0, 1, 0], [0, 0, 1]]), "w is negative in a part of the patch"),
    ],
)
def test_useless_matrix_is_an_error(sample, values, message):
    sample.patch.GetMatrixAttr().Set(matrix(values))
    finding = sample.the_only("fexel:Matrix")
    assert (finding.severity, finding.path) == ("error", "/World/Wall/Photo/Detail")
    assert message in finding.message
    assert sample.found("fexel:PatchInsideParent") == []


@pytest.mark.parametrize(
    "values",
    [
        SHEARED,
        np.negative(SHEARED),
        np.multiply(SHEARED, 1e-9),
        np.multiply(SHEARED, 1e9),
        [[-4, 0, 0], [0, 4, 0], [3, -1, 1]],
        [[2.0**24, 0, 0], [0, 2.0**24, 0], [-(2.0**23), -(2.0**23), 1]],
    ],
    ids=["sheared", "negated", "tiny factor", "huge factor", "mirrored", "deep"],
)
def test_usable_matrix_is_no_fault_whatever_its_factor(sample, values):
    sample.patch.GetMatrixAttr().Set(matrix(values))
    assert sample.found("fexel:Matrix") == []


def test_root_matrix_is_checked_but_has_no_parent_to_leave(sample):
    sample.root.CreateMatrixAttr(matrix([[0.1, 0, 0], [0, 0.1, 0], [5, 5, 1]]))
    assert sample.findings() == []
    sample.root.GetMatrixAttr().Set(matrix(np.zeros((3, 3))))
    assert sample.the_only("fexel:Matrix").path == "/World/Wall/Photo"


def test_bad_time_sample_is_named(sample):
    sample.patch.GetMatrixAttr().Set(matrix(SHEARED), 1.0)
    sample.patch.GetMatrixAttr().Set(matrix(np.zeros((3, 3))), 7.5)
    assert "at time 7.5" in sample.the_only("fexel:Matrix").message


@pytest.mark.parametrize(
    ("values", "found"),
    [
        ([[4, 0, 0], [0, 4, 0], [-1, -1, 1]], None),
        (np.eye(3), None),
        ([[4, 0, 0], [0, 4, 0], [0, 0, 1]], None),
        ([[4, 0, 0], [0, 4, 0], [1, 0, 1]], "wholly outside"),
        ([[4, 0, 0], [0, 4, 0], [-8, 0, 1]], "wholly outside"),
        ([[4, 0, 0], [0, 4, 0], [0.5, 0, 1]], "partly outside"),
        ([[0.5, 0, 0], [0, 0.5, 0], [0.25, 0.25, 1]], "partly outside"),
    ],
)
def test_patch_outside_its_parent_is_a_warning(sample, values, found):
    sample.patch.GetMatrixAttr().Set(matrix(values))
    if found is None:
        assert sample.found("fexel:PatchInsideParent") == []
    else:
        finding = sample.the_only("fexel:PatchInsideParent")
        assert finding.severity == "warning"
        assert found in finding.message
        assert "/World/Wall/Photo" in finding.message


def test_warning_tells_where_the_patch_lies(sample):
    sample.patch.GetMatrixAttr().Set(matrix([[4, 0, 0], [0, 2, 0], [0.5, 0, 1]]))
    assert "s -0.125 to 0.125, t 0 to 0.5" in sample.the_only("fexel:PatchInsideParent").message


@pytest.mark.parametrize(("levels", "warnings"), [(32, 0), (33, 1), (40, 1)])
def test_nest_deeper_than_32_is_warned_of_once(sample, levels, warnings):
    path = str(sample.root.GetPath())
    for _ in range(levels):
        path += "/P"
        fexel.ZipmapTexture.Define(sample.stage, path)
    assert len(sample.found("fexel:NestingDepth")) == warnings


@pytest.mark.parametrize(
    ("attribute", "value", "message"),
    [
        ("Opacity", -0.5, "-0.5, expected 0 to 1"),
        ("Opacity", 2.0, "2, expected 0 to 1"),
        ("Opacity", math.nan, "nan, expected 0 to 1"),
        ("WrapS", "Repeat", "Repeat, expected one of black, clamp, repeat, mirror, useMetadata"),
        ("SourceColorSpace", "srgb", "srgb, expected one of auto, raw, sRGB"),
    ],
)
def test_value_that_the_schema_does_not_allow_is_an_error(sample, attribute, value, message):
    getattr(sample.patch, f"Create{attribute}Attr")(value)
    finding = sample.the_only("fexel:Limits")
    assert finding.severity == "error"
    assert finding.message.endswith(message)


def test_soft_limits_may_be_left(sample):
    logo = fexel.PinchmapTexture.Define(sample.stage, "/World/Wall/Photo/Logo")
    logo.CreateAntialiasAttr(10.0)
    assert sample.findings() == []
    logo.CreateAntialiasAttr(-1.0)
    assert "expected at least 0" in sample.the_only("fexel:Limits").message
