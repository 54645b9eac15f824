"""Where things are and whether they are drawn: transforms, visibility, purpose, mask, instances, point instancers."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from fexel.errors import FexelError
from fexel.scene import SceneReader


def places(scene):
    """World position of each draw's origin, with its path, in order."""
    return [(draw.path, *np.round(draw.object_to_world[3, :3], 6).tolist()) for draw in scene.draws]


def test_full_xform_stack_composes_as_usd_does(stage, define_mesh, read):
    parent = UsdGeom.Xform.Define(stage, "/P")
    parent.AddTranslateOp().Set((1, 2, 3))
    parent.AddRotateXYZOp().Set((10, 20, 30))
    pivot = parent.AddTranslateOp(opSuffix="pivot")
    pivot.Set((0.5, 0, 0))
    parent.AddScaleOp().Set((1, 2, 3))
    parent.AddTranslateOp(opSuffix="pivot", isInverseOp=True)
    mesh = define_mesh(stage, "/P/Scope/M")
    mesh.AddOrientOp().Set(Gf.Quatf(0.5, 0.5, 0.5, 0.5))
    mesh.AddTransformOp(opSuffix="extra").Set(Gf.Matrix4d(1).SetTranslate((0, 0, 4)))
    (draw,) = read(stage)[0].draws
    expected = np.array(mesh.ComputeLocalToWorldTransform(Usd.TimeCode.Default()))
    np.testing.assert_allclose(draw.object_to_world, expected, rtol=1e-15, atol=1e-15)


def test_transforms_compose_in_double(stage, define_mesh, read):
    outer = UsdGeom.Xform.Define(stage, "/P")
    outer.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set((1e9, 0, 0))
    define_mesh(stage, "/P/M").AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set((-1e9 + 2.0**-20, 0, 0))
    assert read(stage)[0].draws[0].object_to_world[3, 0] == 2.0**-20


def test_reset_xform_stack_leaves_the_parent_out(stage, define_mesh, read):
    UsdGeom.Xform.Define(stage, "/P").AddTranslateOp().Set((5, 0, 0))
    mesh = define_mesh(stage, "/P/M")
    mesh.AddTranslateOp().Set((0, 1, 0))
    mesh.SetResetXformStack(True)
    assert places(read(stage)[0]) == [("/P/M", 0, 1, 0)]


def test_animated_transforms_move_their_children_and_leave_the_rest(stage, define_mesh):
    moving = UsdGeom.Xform.Define(stage, "/A")
    translate = moving.AddTranslateOp()
    translate.Set((0, 0, 0), 0.0)
    translate.Set((10, 0, 0), 10.0)
    define_mesh(stage, "/A/B/M")
    define_mesh(stage, "/Still")
    reader = SceneReader(stage)
    scenes = [reader.at(t) for t in (0.0, 5.0, 5.0, 0.0)]
    assert [places(s)[0][1] for s in scenes] == [0, 5, 5, 0]
    assert scenes[0].draws[1] is scenes[1].draws[1] is scenes[3].draws[1]
    assert scenes[0].draws[0].mesh is scenes[1].draws[0].mesh
    assert scenes[1].draws is scenes[2].draws


def test_nothing_varies_so_the_draws_are_the_same_tuple(stage, define_mesh):
    define_mesh(stage, "/M")
    reader = SceneReader(stage)
    assert reader.at(1.0).draws is reader.at(2.0).draws


def test_transform_with_nan_is_skipped_with_a_warning_and_scale_zero_hides(stage, define_mesh, read):
    define_mesh(stage, "/Nan").AddTranslateOp().Set((float("nan"), 0, 0))
    define_mesh(stage, "/Zero").AddScaleOp().Set((0, 0, 0))
    define_mesh(stage, "/Good")
    scene, warned = read(stage)
    assert [draw.path for draw in scene.draws] == ["/Good"]
    assert len(warned) == 1 and warned[0].startswith("/Nan: ")


def test_visibility_is_inherited_and_animated(stage, define_mesh):
    hidden = UsdGeom.Xform.Define(stage, "/Hidden")
    hidden.MakeInvisible()
    UsdGeom.Imageable(define_mesh(stage, "/Hidden/M")).CreateVisibilityAttr("inherited")
    blinking = UsdGeom.Xform.Define(stage, "/Blinking").CreateVisibilityAttr()
    blinking.Set("invisible", 1.0)
    blinking.Set("inherited", 2.0)
    define_mesh(stage, "/Blinking/M")
    reader = SceneReader(stage)
    assert [[d.path for d in reader.at(t).draws] for t in (1.0, 1.5, 2.0, 1.0)] == [[], [], ["/Blinking/M"], []]


def test_purposes_default_and_proxy_unless_asked_otherwise(stage, define_mesh, read):
    for purpose in ("default", "render", "proxy", "guide"):
        UsdGeom.Imageable(UsdGeom.Xform.Define(stage, f"/{purpose}")).CreatePurposeAttr(purpose)
        define_mesh(stage, f"/{purpose}/M")
    UsdGeom.Imageable(define_mesh(stage, "/render/Own")).CreatePurposeAttr("guide")

    def drawn(**options):
        return {draw.path for draw in read(stage, **options)[0].draws}

    assert drawn() == {"/default/M", "/proxy/M"}
    assert drawn(purposes=("render",)) == {"/default/M", "/render/M"}
    assert drawn(purposes=("guide", "render")) == {"/default/M", "/render/M", "/render/Own", "/guide/M"}
    with pytest.raises(FexelError, match="'final', expected some of default, render, proxy, guide"):
        SceneReader(stage, purposes=("final",))


def test_inactive_abstract_and_undefined_prims_are_not_drawn(stage, define_mesh, read):
    define_mesh(stage, "/Off/M")
    stage.GetPrimAtPath("/Off").SetActive(False)
    stage.CreateClassPrim("/Class")
    define_mesh(stage, "/Class/M")
    stage.OverridePrim("/Over")
    define_mesh(stage, "/M")
    assert [draw.path for draw in read(stage)[0].draws] == ["/M"]


def test_mask_limits_draws_and_lights_but_not_materials_and_cameras(stage, define_mesh, read):
    from pxr import UsdLux

    for name in ("A", "AB", "C"):
        define_mesh(stage, f"/W/{name}/M")
    UsdLux.SphereLight.Define(stage, "/W/C/Light")
    UsdGeom.Camera.Define(stage, "/W/C/Cam")
    material = UsdShade.Material.Define(stage, "/W/C/Mat")
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/W/A/M")).Bind(material)
    scene, _ = read(stage, mask=["/W/A"], camera="Cam")
    assert [draw.path for draw in scene.draws] == ["/W/A/M"]
    assert scene.lights == () and scene.camera.path == "/W/C/Cam"
    assert scene.draws[0].material.path == "/W/C/Mat"
    assert [draw.path for draw in read(stage, mask=["/W/A", "/W/C"])[0].draws] == ["/W/A/M", "/W/C/M"]
    with pytest.raises(FexelError, match="/W/Absent"):
        SceneReader(stage, mask=["/W/Absent"])


def nested_instances(stage, define_mesh):
    """/Outer holds two instances of /Inner at y = 0, 10; /W holds two of /Outer at x = 0, 100."""
    define_mesh(stage, "/Inner/M").AddTranslateOp().Set((1, 0, 0))
    for name, y in (("I1", 0), ("I2", 10)):
        instance = UsdGeom.Xform.Define(stage, f"/Outer/{name}")
        instance.AddTranslateOp().Set((0, y, 0))
        instance.GetPrim().GetReferences().AddInternalReference("/Inner")
        instance.GetPrim().SetInstanceable(True)
    for name, x in (("O1", 0), ("O2", 100)):
        instance = UsdGeom.Xform.Define(stage, f"/W/{name}")
        instance.AddTranslateOp().Set((x, 0, 0))
        instance.GetPrim().GetReferences().AddInternalReference("/Outer")
        instance.GetPrim().SetInstanceable(True)


def test_nested_scenegraph_instances_are_where_they_belong_and_share_one_mesh(stage, define_mesh, read):
    nested_instances(stage, define_mesh)
    scene, _ = read(stage, mask=["/W"])
    assert places(scene) == [
        ("/W/O1/I1/M", 1, 0, 0),
        ("/W/O1/I2/M", 1, 10, 0),
        ("/W/O2/I1/M", 101, 0, 0),
        ("/W/O2/I2/M", 101, 10, 0),
    ]
    assert len({id(draw.mesh) for draw in scene.draws}) == 1
    assert [scene.prim_paths[draw.prim_id] for draw in scene.draws] == [draw.path for draw in scene.draws]


def test_instances_can_have_materials_and_colours_of_their_own(stage, define_mesh, read):
    nested_instances(stage, define_mesh)
    material = UsdShade.Material.Define(stage, "/Mat")
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath("/W/O1")).Bind(material)
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/W/O2")).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, "constant"
    )
    primvar.Set(Vt.Vec3fArray([(1, 0, 0)]))
    draws = read(stage, mask=["/W"])[0].draws
    assert [draw.material.path for draw in draws] == ["/Mat", "/Mat", "", ""]
    assert [draw.material.inputs["diffuseColor"] for draw in draws[2:]] == [(1, 0, 0), (1, 0, 0)]
    assert draws[0].mesh is draws[2].mesh and draws[2].material is draws[3].material


def define_instancer(stage, path, prototypes, indices, positions):
    instancer = UsdGeom.PointInstancer.Define(stage, path)
    instancer.CreatePrototypesRel().SetTargets(prototypes)
    instancer.CreateProtoIndicesAttr(indices)
    instancer.CreatePositionsAttr(positions)
    return instancer


def test_point_instances_have_position_orientation_scale_and_the_prototype_s_transform(stage, define_mesh, read):
    define_mesh(stage, "/I/Protos/A").AddTranslateOp().Set((1, 0, 0))
    instancer = define_instancer(stage, "/I", ["/I/Protos/A"], [0, 0], [(0, 0, 0), (0, 0, 5)])
    instancer.CreateOrientationsAttr([Gf.Quath(1, 0, 0, 0), Gf.Quath(np.sqrt(0.5), 0, 0, np.sqrt(0.5))])
    instancer.CreateScalesAttr([(1, 1, 1), (2, 2, 2)])
    instancer.AddTranslateOp().Set((100, 0, 0))
    scene, _ = read(stage)
    got = np.array([draw.object_to_world for draw in scene.draws])
    expected = np.array(
        instancer.ComputeInstanceTransformsAtTime(Usd.TimeCode.Default(), Usd.TimeCode.Default())
    ) @ np.array(instancer.ComputeLocalToWorldTransform(Usd.TimeCode.Default()))
    np.testing.assert_allclose(got, expected, atol=1e-12)
    np.testing.assert_allclose(got[1, 3, :3], (100, 2, 5), atol=2e-3)  # half-precision quaternion
    assert [draw.path for draw in scene.draws] == ["/I/Protos/A"] * 2
    assert scene.draws[0].mesh is scene.draws[1].mesh


def test_invisible_and_inactive_ids_are_left_out(stage, define_mesh):
    define_mesh(stage, "/I/A")
    instancer = define_instancer(stage, "/I", ["/I/A"], [0] * 4, [(x, 0, 0) for x in range(4)])
    instancer.CreateIdsAttr([10, 11, 12, 13])
    instancer.DeactivateId(12)
    instancer.CreateInvisibleIdsAttr().Set(Vt.Int64Array([10]), 1.0)
    instancer.GetInvisibleIdsAttr().Set(Vt.Int64Array([13]), 2.0)
    reader = SceneReader(stage)
    assert [[p[1] for p in places(reader.at(t))] for t in (1.0, 2.0)] == [[1, 3], [0, 1]]


def test_nested_point_instancers_multiply(stage, define_mesh, read):
    define_mesh(stage, "/Outer/Inner/A")
    define_instancer(stage, "/Outer/Inner", ["/Outer/Inner/A"], [0, 0], [(0, 0, 0), (1, 0, 0)])
    define_instancer(stage, "/Outer", ["/Outer/Inner"], [0, 0, 0], [(0, 0, 0), (0, 10, 0), (0, 20, 0)])
    got = {p[1:] for p in places(read(stage)[0])}
    assert got == {(x, y, 0) for x in (0, 1) for y in (0, 10, 20)}


def test_prototypes_may_be_overs_and_several(stage, define_mesh, read):
    stage.OverridePrim("/I/Protos")
    define_mesh(stage, "/I/Protos/A")
    UsdGeom.Sphere.Define(stage, "/I/Protos/B/Ball")
    define_instancer(stage, "/I", ["/I/Protos/A", "/I/Protos/B"], [1, 0, 1], [(0, 0, 0), (1, 0, 0), (2, 0, 0)])
    assert places(read(stage)[0]) == [
        ("/I/Protos/A", 1, 0, 0),
        ("/I/Protos/B/Ball", 0, 0, 0),
        ("/I/Protos/B/Ball", 2, 0, 0),
    ]


def test_instancer_inside_an_instance(stage, define_mesh, read):
    define_mesh(stage, "/Asset/I/A")
    define_instancer(stage, "/Asset/I", ["/Asset/I/A"], [0, 0], [(0, 0, 0), (1, 0, 0)])
    for name, y in (("X", 0), ("Y", 5)):
        prim = UsdGeom.Xform.Define(stage, f"/W/{name}")
        prim.AddTranslateOp().Set((0, y, 0))
        prim.GetPrim().GetReferences().AddInternalReference("/Asset")
        prim.GetPrim().SetInstanceable(True)
    got = {p[1:] for p in places(read(stage, mask=["/W"])[0])}
    assert got == {(0, 0, 0), (1, 0, 0), (0, 5, 0), (1, 5, 0)}


def test_instances_take_the_instancer_s_display_colours(stage, define_mesh, read):
    define_mesh(stage, "/I/A")
    instancer = define_instancer(stage, "/I", ["/I/A"], [0, 0], [(0, 0, 0), (1, 0, 0)])
    primvar = UsdGeom.PrimvarsAPI(instancer).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, "vertex")
    primvar.Set(Vt.Vec3fArray([(1, 0, 0), (0, 1, 0)]))
    assert [d.material.inputs["diffuseColor"] for d in read(stage)[0].draws] == [(1, 0, 0), (0, 1, 0)]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda i: i.GetPositionsAttr().Set([(0, 0, 0)]), "1 entries, expected 2"),
        (lambda i: i.CreateScalesAttr([(1, 1, 1)] * 3), "3 entries, expected 2"),
        (lambda i: i.CreateOrientationsAttr([Gf.Quath(1)]), "1 entries, expected 2"),
        (lambda i: i.GetProtoIndicesAttr().Set([0, 7]), "such as 7, expected 0 to 0"),
        (lambda i: i.GetPrototypesRel().SetTargets(["/Absent"]), "/Absent does not exist"),
        (lambda i: i.GetPositionsAttr().Set([(0, 0, 0), (float("nan"), 0, 0)]), "1 instances with NaN"),
    ],
)
def test_damaged_instancers_warn_once_and_draw_what_is_sound(stage, define_mesh, read, change, words):
    define_mesh(stage, "/I/A")
    define_mesh(stage, "/Other")
    change(define_instancer(stage, "/I", ["/I/A"], [0, 0], [(0, 0, 0), (1, 0, 0)]))
    scene, warned = read(stage)
    assert "/Other" in [draw.path for draw in scene.draws]
    assert len(scene.draws) == (2 if "such as" in words or "NaN" in words else 1)
    assert len(warned) == 1 and words in warned[0]


def test_instancer_that_is_its_own_prototype_ends(stage, read):
    define_instancer(stage, "/I", ["/I"], [0], [(1, 0, 0)])
    scene, warned = read(stage)
    assert scene.draws == () and len(warned) == 1


def test_ten_thousand_point_instances_share_mesh_and_material(stage, read, rng):
    UsdGeom.Sphere.Define(stage, "/I/A")
    positions = rng.random((10_000, 3)).astype(np.float32)
    define_instancer(stage, "/I", ["/I/A"], [0] * 10_000, Vt.Vec3fArray.FromNumpy(positions))
    scene, _ = read(stage)
    assert len(scene.draws) == 10_000
    assert len({(id(d.mesh), id(d.material)) for d in scene.draws}) == 1
    np.testing.assert_array_equal([d.object_to_world[3, :3] for d in scene.draws], positions)


@pytest.mark.parametrize("type_name", ["BasisCurves", "Points", "NurbsPatch", "Volume"])
def test_what_is_not_drawn_is_said_once(stage, define_mesh, type_name, read):
    stage.DefinePrim("/Hair", type_name)
    scene, warned = read(stage)
    assert scene.draws == ()
    assert len(warned) == 1 and warned[0].startswith(f"/Hair: {type_name} is not drawn")


def test_hierarchy_deeper_than_the_interpreter_s_stack(stage, define_mesh, read):
    path = "/D" + "/D" * 1500
    define_mesh(stage, f"{path}/M")
    assert read(stage)[0].draws[0].path == f"{path}/M"


def test_animated_inherited_display_colour(stage, define_mesh):
    define_mesh(stage, "/P/M")
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/P")).CreatePrimvar(
        "displayColor", Sdf.ValueTypeNames.Color3fArray, "constant"
    )
    for time in (0.0, 4.0):
        primvar.Set(Vt.Vec3fArray([(time, 0, 0)]), time)
    reader = SceneReader(stage)
    got = [reader.at(t).draws[0].material.inputs["diffuseColor"][0] for t in (1.0, 2.0, 1.0)]
    assert got == [1.0, 2.0, 1.0]
