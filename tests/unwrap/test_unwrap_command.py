"""`fexel unwrap`: what is written over a stage, inside instances, and for mesh files."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from fexel.errors import FexelError
from fexel_tools.unwrap import unwrap

_SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


def define_square(stage, path, with_st=False):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(_SQUARE)
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    if with_st:
        primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
        primvar.Set(Vt.Vec2fArray([(0, 0), (1, 0), (1, 1), (0, 1)]))
    return mesh


def primvar_of(stage, path, name="st"):
    return UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path)).GetPrimvar(name)


@pytest.fixture
def room(tmp_path):
    """A z-up stage in centimetres: a mesh with st, one without, and a texture beside it."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "room.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(48)
    stage.SetTimeCodesPerSecond(48)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Room").GetPrim())
    define_square(stage, "/Room/Wall")
    define_square(stage, "/Room/Poster", with_st=True)
    stage.GetRootLayer().Save()
    return tmp_path / "room.usda"


def test_layer_adds_st_to_the_mesh_that_has_none(room, tmp_path):
    results = unwrap(room, tmp_path / "out.usda")
    assert [(r.path, r.chart_count) for r in results] == [("/Room/Wall", 1), ("/Room/Poster", 0)]
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    primvar = primvar_of(stage, "/Room/Wall")
    assert primvar.GetInterpolation() == "faceVarying"
    assert primvar.GetTypeName() == Sdf.ValueTypeNames.TexCoord2fArray
    st = np.array(primvar.ComputeFlattened())
    assert st.shape == (4, 2)
    np.testing.assert_allclose(np.linalg.norm(st - np.roll(st, 1, axis=0), axis=1), np.ptp(st), rtol=1e-4)
    assert primvar_of(stage, "/Room/Poster").GetInterpolation() == "vertex"


def test_layer_keeps_what_only_a_root_layer_can_say(room, tmp_path):
    unwrap(room, tmp_path / "out.usda")
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.01
    assert stage.GetDefaultPrim().GetPath() == "/Room"
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (1, 48, 48)


def test_sublayer_path_is_relative_so_that_the_folder_can_move(room, tmp_path):
    (tmp_path / "sub").mkdir()
    unwrap(room, tmp_path / "sub" / "out.usda")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "sub" / "out.usda"))
    assert layer.subLayerPaths[0] == "../room.usda"
    moved = tmp_path.parent / f"{tmp_path.name}_moved"
    tmp_path.rename(moved)
    stage = Usd.Stage.Open(str(moved / "sub" / "out.usda"))
    assert primvar_of(stage, "/Room/Wall").HasValue()


def test_all_redoes_meshes_that_have_coordinates(room, tmp_path):
    unwrap(room, tmp_path / "out.usda", redo=True)
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    assert primvar_of(stage, "/Room/Poster").GetInterpolation() == "faceVarying"


def test_mesh_option_limits_what_is_unwrapped(room, tmp_path):
    results = unwrap(room, tmp_path / "out.usda", redo=True, meshes=["/Room/Poster"], primvar="uv2")
    assert [r.path for r in results] == ["/Room/Poster"]
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    assert primvar_of(stage, "/Room/Poster", "uv2").HasValue()
    assert not primvar_of(stage, "/Room/Wall", "uv2").HasValue()


@pytest.mark.parametrize("orientation", ["rightHanded", "leftHanded"])
def test_images_are_not_mirrored_seen_from_outside(tmp_path, orientation):
    stage = Usd.Stage.CreateNew(str(tmp_path / "in.usda"))
    define_square(stage, "/M").CreateOrientationAttr(orientation)
    stage.GetRootLayer().Save()
    unwrap(tmp_path / "in.usda", tmp_path / "out.usda")
    result = Usd.Stage.Open(str(tmp_path / "out.usda"))
    st = np.array(primvar_of(result, "/M").ComputeFlattened())
    turn = np.linalg.det(np.stack([st[1] - st[0], st[2] - st[1]]))
    assert bool(turn > 0) is (orientation == "rightHanded")


def test_time_samples_of_points_are_unwrapped_at_the_first(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "in.usda"))
    mesh = define_square(stage, "/Flag")
    mesh.GetPointsAttr().Clear()
    for time in (1.0, 2.0):
        mesh.GetPointsAttr().Set(Vt.Vec3fArray([Gf.Vec3f(*p) * time for p in _SQUARE]), time)
    stage.GetRootLayer().Save()
    assert unwrap(tmp_path / "in.usda", tmp_path / "out.usda")[0].chart_count == 1


def test_mesh_in_a_referenced_asset_that_is_instanced_twice(tmp_path):
    """Opinions cannot be put on instance proxies; both instances get the coordinates and still share a prototype."""
    asset = Usd.Stage.CreateNew(str(tmp_path / "asset.usda"))
    asset.SetDefaultPrim(UsdGeom.Xform.Define(asset, "/Asset").GetPrim())
    define_square(asset, "/Asset/Geo/Panel")
    asset.GetRootLayer().Save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "in.usda"))
    for name in ("A", "B"):
        prim = UsdGeom.Xform.Define(stage, f"/World/{name}").GetPrim()
        prim.GetReferences().AddReference("./asset.usda")
        prim.SetInstanceable(True)
    stage.GetRootLayer().Save()

    assert len(unwrap(tmp_path / "in.usda", tmp_path / "out.usda")) == 1
    result = Usd.Stage.Open(str(tmp_path / "out.usda"))
    for name in ("A", "B"):
        assert result.GetPrimAtPath(f"/World/{name}").IsInstance()
        assert primvar_of(result, f"/World/{name}/Geo/Panel").HasValue()
    assert len(result.GetPrototypes()) == 1


def test_mesh_in_nested_instances(tmp_path):
    inner = Usd.Stage.CreateNew(str(tmp_path / "inner.usda"))
    inner.SetDefaultPrim(UsdGeom.Xform.Define(inner, "/Inner").GetPrim())
    define_square(inner, "/Inner/Panel")
    inner.GetRootLayer().Save()
    outer = Usd.Stage.CreateNew(str(tmp_path / "outer.usda"))
    outer.SetDefaultPrim(UsdGeom.Xform.Define(outer, "/Outer").GetPrim())
    for name in ("I1", "I2"):
        prim = UsdGeom.Xform.Define(outer, f"/Outer/{name}").GetPrim()
        prim.GetReferences().AddReference("./inner.usda")
        prim.SetInstanceable(True)
    outer.GetRootLayer().Save()
    stage = Usd.Stage.CreateNew(str(tmp_path / "in.usda"))
    for name in ("A", "B"):
        prim = UsdGeom.Xform.Define(stage, f"/World/{name}").GetPrim()
        prim.GetReferences().AddReference("./outer.usda")
        prim.SetInstanceable(True)
    lone = UsdGeom.Xform.Define(stage, "/World/Lone").GetPrim()
    lone.GetReferences().AddReference("./inner.usda")
    lone.SetInstanceable(True)
    stage.GetRootLayer().Save()

    unwrap(tmp_path / "in.usda", tmp_path / "out.usda")
    result = Usd.Stage.Open(str(tmp_path / "out.usda"))
    paths = [f"/World/{a}/{i}/Panel" for a in ("A", "B") for i in ("I1", "I2")] + ["/World/Lone/Panel"]
    assert all(primvar_of(result, path).HasValue() for path in paths)
    assert len(result.GetPrototypes()) == 2


def test_prototype_of_a_point_instancer_is_unwrapped_once(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "in.usda"))
    instancer = UsdGeom.PointInstancer.Define(stage, "/Many")
    stage.OverridePrim("/Many/Prototypes")
    define_square(stage, "/Many/Prototypes/Leaf")
    instancer.CreatePrototypesRel().SetTargets(["/Many/Prototypes/Leaf"])
    instancer.CreateProtoIndicesAttr([0, 0])
    instancer.CreatePositionsAttr([(0, 0, 0), (5, 0, 0)])
    stage.GetRootLayer().Save()
    assert [r.path for r in unwrap(tmp_path / "in.usda", tmp_path / "out.usda")] == ["/Many/Prototypes/Leaf"]


_OBJ = """# a house front: a concave pentagon and a quad, with a continued line
mtllib house.mtl
v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\nv 8 0 0\nv 8 4 0
f 1 2 3 \\
  4 5
f -2//1 -1//1 3//1 2//1
"""


def test_obj_keeps_its_polygons(tmp_path):
    (tmp_path / "house.obj").write_text(_OBJ)
    unwrap(tmp_path / "house.obj", tmp_path / "house.usda")
    stage = Usd.Stage.Open(str(tmp_path / "house.usda"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/house/Mesh"))
    assert list(mesh.GetFaceVertexCountsAttr().Get()) == [5, 4]
    assert list(mesh.GetFaceVertexIndicesAttr().Get()) == [0, 1, 2, 3, 4, 5, 6, 2, 1]
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    assert [tuple(p) for p in mesh.GetExtentAttr().Get()] == [(0, 0, 0), (8, 4, 0)]
    assert stage.GetDefaultPrim().GetPath() == "/house"
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert len(primvar_of(stage, "/house/Mesh").ComputeFlattened()) == 9


def test_obj_with_texture_keeps_its_coordinates_and_binds_the_image(tmp_path):
    (tmp_path / "tile.mtl").write_text("newmtl m\nmap_Kd -s 1 1 1 tile.png\n")
    (tmp_path / "tile.png").write_bytes(b"not looked at")
    (tmp_path / "tile.obj").write_text(
        "mtllib tile.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt .5 0\nvt .5 1\nf 1/1 2/2 3/3\n"
    )
    unwrap(tmp_path / "tile.obj", tmp_path / "tile.usda")
    stage = Usd.Stage.Open(str(tmp_path / "tile.usda"))
    np.testing.assert_array_equal(primvar_of(stage, "/tile/Mesh").ComputeFlattened(), [(0, 0), (0.5, 0), (0.5, 1)])
    material, _ = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/tile/Mesh")).ComputeBoundMaterial()
    texture = UsdShade.Shader(stage.GetPrimAtPath(material.GetPath().AppendChild("texture")))
    assert texture.GetInput("file").Get().path == "./tile.png"


def test_ply_with_quads_and_glb_with_two_nodes(tmp_path):
    (tmp_path / "quad.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n"
    )
    result = unwrap(tmp_path / "quad.ply", tmp_path / "quad.usda")
    assert result[0].chart_count == 1
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.Scene()
    box = trimesh.creation.box()
    scene.add_geometry(box, node_name="left", geom_name="box")
    scene.add_geometry(
        box, node_name="right", geom_name="box", transform=trimesh.transformations.translation_matrix([5, 0, 0])
    )
    scene.export(tmp_path / "boxes.glb")
    unwrap(tmp_path / "boxes.glb", tmp_path / "boxes.usda")
    stage = Usd.Stage.Open(str(tmp_path / "boxes.usda"))
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"])
    bounds = cache.ComputeWorldBound(stage.GetDefaultPrim()).ComputeAlignedRange()
    assert tuple(bounds.GetMin()) == (-0.5, -0.5, -0.5)
    assert tuple(bounds.GetMax()) == (5.5, 0.5, 0.5)


def empty_glb():
    text = json.dumps({"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], "scene": 0}).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON") + text


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("absent.obj", None, "no such file"),
        ("notes.txt", b"hello", r"format \.txt, expected one of \.usd"),
        ("broken.usda", b"#usda 1.0\ndef Mesh", "broken.usda"),
        ("empty.usda", b"#usda 1.0\n", "no mesh"),
        ("empty.obj", b"# nothing\n", "no faces"),
        ("empty.glb", empty_glb(), "empty.glb"),
        ("broken.glb", b"glTFgarbage", "cannot be read"),
        ("broken.obj", b"v 0 0 zero\n", "line 1"),
        ("outside.obj", b"v 0 0 0\nf 1 2 3\n", "vertex 3, expected 1 to 1"),
        ("flat.obj", b"v 0 0 0\nv 1 1 1\nf 1 2 1\n", "area"),
        ("nan.obj", b"v 0 0 nan\nv 1 1 1\nv 0 1 1\nf 1 2 3\n", "NaN"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing_behind(tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(FexelError, match=words) as error:
        unwrap(tmp_path / name, tmp_path / "out.usda")
    assert "\n" not in str(error.value)
    assert sorted(p.name for p in tmp_path.iterdir()) == ([] if content is None else [name])


def test_mesh_with_damaged_topology_is_named(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "in.usda"))
    define_square(stage, "/Bad").GetFaceVertexIndicesAttr().Set([0, 1, 2, 9])
    stage.GetRootLayer().Save()
    with pytest.raises(FexelError, match=r"^/Bad: face index 9, expected 0 to 3"):
        unwrap(tmp_path / "in.usda", tmp_path / "out.usda")


def test_output_must_be_a_layer_and_not_the_input(room, tmp_path):
    with pytest.raises(FexelError, match="usdc"):
        unwrap(room, tmp_path / "out.png")
    with pytest.raises(FexelError, match="input"):
        unwrap(room, room)
    with pytest.raises(FexelError, match="no such folder"):
        unwrap(room, tmp_path / "nowhere" / "out.usda")
    with pytest.raises(FexelError, match="/Room/Door"):
        unwrap(room, tmp_path / "out.usda", meshes=["/Room/Door"])
    with pytest.raises(FexelError, match="primvar"):
        unwrap(room, tmp_path / "out.usda", primvar="a b")


def test_command_prints_a_line_per_mesh_and_fails_with_one(room, tmp_path, capsys, monkeypatch):
    from fexel_tools.cli import main

    monkeypatch.setattr("sys.argv", ["fexel", "unwrap", str(room), "-o", str(tmp_path / "out.usda")])
    with pytest.raises(SystemExit) as done:
        main()
    assert done.value.code in (0, None)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("/Room/Wall: 1 faces, 1 charts")
    assert "has primvars:st" in lines[1]
    monkeypatch.setattr("sys.argv", ["fexel", "unwrap", "absent.usd", "-o", str(tmp_path / "out.usda")])
    with pytest.raises(SystemExit) as failed:
        main()
    assert failed.value.code == 1
    assert capsys.readouterr().err == "fexel: absent.usd: no such file\n"


def test_image_embedded_in_a_glb_is_written_beside_the_stage(tmp_path):
    trimesh, image = pytest.importorskip("trimesh"), pytest.importorskip("PIL.Image")
    picture = image.fromarray(np.arange(48, dtype=np.uint8).reshape(4, 4, 3))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=picture)
    visual = trimesh.visual.TextureVisuals(uv=np.array([(0, 0), (1, 0), (1, 1)]), material=material)
    mesh = trimesh.Trimesh(np.eye(3), [[0, 1, 2]], visual=visual, process=False)
    trimesh.Scene(mesh).export(tmp_path / "a.glb")
    unwrap(tmp_path / "a.glb", tmp_path / "out.usda")
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    (texture,) = [p for p in stage.Traverse() if p.GetName() == "texture"]
    written = tmp_path / texture.GetAttribute("inputs:file").Get().path
    np.testing.assert_array_equal(np.asarray(image.open(written).convert("RGB")), np.asarray(picture))
    (prim,) = [p for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)]
    np.testing.assert_allclose(
        primvar_of(stage, prim.GetPath()).ComputeFlattened(), [(0, 0), (1, 0), (1, 1)], atol=1e-6
    )
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(["a.glb", "out.usda", written.name])
