"""ZipmapTexture.GetPatches: draw order, composed matrices, what counts as a patch."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Gf, Sdf, Usd, UsdShade

import fexel


def define(stage, path, matrix=None, kind=fexel.ZipmapTexture):
    texture = kind.Define(stage, path)
    if matrix is not None:
        texture.CreateMatrixAttr(Gf.Matrix3d(*np.asarray(matrix, float).ravel().tolist()))
    return texture


def paths(patches):
    return [str(patch.path) for patch in patches]


def test_patches_come_parents_first_siblings_in_namespace_order_depth_first():
    stage = Usd.Stage.CreateInMemory()
    root = define(stage, "/R")
    for path in ("/R/B", "/R/A", "/R/B/Y", "/R/B/X", "/R/A/Z", "/R/B/Y/Q"):
        define(stage, path)
    patches = root.GetPatches()
    assert paths(patches) == ["/R", "/R/B", "/R/B/Y", "/R/B/Y/Q", "/R/B/X", "/R/A", "/R/A/Z"]
    assert [patch.depth for patch in patches] == [0, 1, 2, 3, 2, 1, 2]
    assert [patch.parent_index for patch in patches] == [-1, 0, 1, 2, 1, 0, 5]
    stage.GetPrimAtPath("/R").SetChildrenReorder(["A", "B"])
    assert paths(root.GetPatches())[1] == "/R/A"


def test_fallback_network_and_other_prims_are_no_patches():
    stage = Usd.Stage.CreateInMemory()
    root = define(stage, "/R")
    UsdShade.Shader.Define(stage, "/R/Fallback")
    UsdShade.NodeGraph.Define(stage, "/R/Graph")
    stage.DefinePrim("/R/Scope", "Scope")
    define(stage, "/R/Scope/Hidden")
    stage.DefinePrim("/R/Untyped")
    stage.OverridePrim("/R/Over")
    stage.CreateClassPrim("/C")
    assert paths(root.GetPatches()) == ["/R"]


def test_every_kind_is_a_patch_but_only_zipmaps_have_patches():
    stage = Usd.Stage.CreateInMemory()
    root = define(stage, "/R")
    define(stage, "/R/Logo", kind=fexel.PinchmapTexture)
    define(stage, "/R/Logo/Inner")
    define(stage, "/R/Lawn", kind=fexel.UmbrellaTexture)
    assert paths(root.GetPatches()) == ["/R", "/R/Logo", "/R/Lawn"]


def test_inactive_patch_disappears_with_all_below_it():
    stage = Usd.Stage.CreateInMemory()
    root = define(stage, "/R")
    for path in ("/R/A", "/R/A/Below", "/R/B"):
        define(stage, path)
    stage.GetPrimAtPath("/R/A").SetActive(False)
    assert paths(root.GetPatches()) == ["/R", "/R/B"]


def test_layers_can_add_move_and_retype_patches():
    weak = Sdf.Layer.CreateAnonymous(".usda")
    stage = Usd.Stage.Open(weak)
    define(stage, "/R/A", np.diag([2, 2, 1]))
    define(stage, "/R")
    strong = Sdf.Layer.CreateAnonymous(".usda")
    strong.subLayerPaths = [weak.identifier]
    stage = Usd.Stage.Open(strong)
    define(stage, "/R/A", np.diag([3, 3, 1]))
    define(stage, "/R/New")
    patches = fexel.ZipmapTexture.Get(stage, "/R").GetPatches()
    assert paths(patches) == ["/R", "/R/A", "/R/New"]
    assert np.array_equal(patches[1].root_to_patch, np.diag([3.0, 3.0, 1.0]))


def test_instanced_zipmap_has_its_patches():
    stage = Usd.Stage.CreateInMemory()
    define(stage, "/Prototype/R")
    define(stage, "/Prototype/R/A")
    instance = stage.DefinePrim("/Instance")
    instance.GetReferences().AddInternalReference("/Prototype")
    instance.SetInstanceable(True)
    assert paths(fexel.ZipmapTexture.Get(stage, "/Instance/R").GetPatches()) == ["/Instance/R", "/Instance/R/A"]


def test_wrapper_of_another_type_has_no_patches_and_an_empty_one_raises_as_usd_does():
    stage = Usd.Stage.CreateInMemory()
    assert fexel.ZipmapTexture(define(stage, "/L", kind=fexel.PinchmapTexture)).GetPatches() == []
    with pytest.raises(RuntimeError, match="invalid prim"):
        fexel.ZipmapTexture().GetPatches()


def test_time_samples_are_evaluated():
    stage = Usd.Stage.CreateInMemory()
    root = define(stage, "/R")
    attribute = define(stage, "/R/A").CreateMatrixAttr()
    attribute.Set(Gf.Matrix3d(1), 1.0)
    attribute.Set(Gf.Matrix3d(3), 3.0)
    opacity = fexel.ZipmapTexture.Get(stage, "/R/A").CreateOpacityAttr()
    opacity.Set(0.0, 1.0)
    opacity.Set(1.0, 3.0)
    middle = root.GetPatches(2.0)[1]
    assert np.array_equal(middle.root_to_patch, 2 * np.eye(3))
    assert middle.opacity == 0.5
    assert root.GetPatches(Usd.TimeCode(3.0))[1].opacity == 1.0


def test_connected_inputs_are_followed_to_their_source():
    stage = Usd.Stage.CreateInMemory()
    root = define(stage, "/R")
    fade = root.CreateInput("fade", Sdf.ValueTypeNames.Float)
    fade.Set(0.25)
    UsdShade.Input(define(stage, "/R/A").CreateOpacityAttr()).ConnectToSource(fade)
    assert root.GetPatches()[1].opacity == 0.25


def test_root_matrix_is_part_of_every_placement():
    stage = Usd.Stage.CreateInMemory()
    root = define(stage, "/R", np.diag([2, 1, 1]))
    define(stage, "/R/A", [[1, 0, 0], [0, 1, 0], [-0.5, 0, 1]])
    point = np.array([0.25, 0.5, 1.0])
    assert np.allclose(point @ root.GetPatches()[1].root_to_patch, [0.0, 0.5, 1.0])


@pytest.mark.parametrize("bad", [math.nan, math.inf, 0.0])
def test_useless_matrix_is_passed_on_without_a_warning(bad):
    stage = Usd.Stage.CreateInMemory()
    root = define(stage, "/R")
    define(stage, "/R/A", np.full((3, 3), bad))
    define(stage, "/R/A/B", np.diag([1e200, 1e200, 1]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        patches = root.GetPatches()
    assert len(patches) == 3
    assert patches[1].root_to_patch.shape == (3, 3)


def test_deep_nest_does_not_exhaust_the_stack():
    stage = Usd.Stage.CreateInMemory()
    path = "/R"
    root = define(stage, path)
    for _ in range(1500):
        path += "/P"
    layer = stage.GetRootLayer()
    with Sdf.ChangeBlock():
        for prefix in Sdf.Path(path).GetPrefixes():
            spec = Sdf.CreatePrimInLayer(layer, prefix)
            spec.specifier, spec.typeName = Sdf.SpecifierDef, "ZipmapTexture"
    patches = root.GetPatches()
    assert len(patches) == 1501
    assert patches[-1].depth == 1500


numbers = st.floats(-2, 2, allow_nan=False, width=32)
homographies = st.lists(numbers, min_size=9, max_size=9).map(lambda values: np.array(values).reshape(3, 3))


@settings(max_examples=40, deadline=None)
@given(st.lists(homographies, min_size=1, max_size=12))
def test_matrices_compose_in_double_from_root_to_patch(matrices):
    stage = Usd.Stage.CreateInMemory()
    path = "/R"
    root = define(stage, path)
    expected = [np.eye(3)]
    for matrix in matrices:
        path += "/P"
        define(stage, path, matrix)
        expected.append(expected[-1] @ matrix)
    for patch, composed in zip(root.GetPatches(), expected, strict=True):
        assert patch.root_to_patch.dtype == np.float64
        assert np.array_equal(patch.root_to_patch, composed)


def test_placement_stays_exact_at_magnification_2_to_the_24():
    """12 levels of 4x about a point that float32 cannot hold: the composed map sends it to where it belongs."""
    stage = Usd.Stage.CreateInMemory()
    path, s = "/R", 1 / 3
    root = define(stage, path)
    for _ in range(12):
        path += "/P"
        define(stage, path, [[4, 0, 0], [0, 4, 0], [-4 * s + s, -4 * s + s, 1]])
    mapped = np.array([s + 0.25 / 4**12, s, 1.0]) @ root.GetPatches()[-1].root_to_patch
    assert abs(mapped[0] - (s + 0.25)) < 1e-8
    assert abs(mapped[1] - s) < 1e-8
