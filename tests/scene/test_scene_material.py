"""Materials: bindings, interface inputs, textures and what feeds their coordinates, damage."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade

import fexel
from fexel.errors import FexelError
from fexel.scene import SceneReader, TextureInput

_GREY = (0.18, 0.18, 0.18)
_UNIT_ST = ("TexCoord2fArray", "vertex", [(0, 0), (1, 0), (1, 1), (0, 1)])


def shader(stage, path, kind, **inputs):
    """A shader with inputs given as (type name, value or output to connect to)."""
    prim = UsdShade.Shader.Define(stage, path)
    prim.CreateIdAttr(kind)
    for name, (type_name, value) in inputs.items():
        made = prim.CreateInput(name, getattr(Sdf.ValueTypeNames, type_name))
        if isinstance(value, (UsdShade.Output, UsdShade.Input)):
            made.ConnectToSource(value)
        else:
            made.Set(value)
    return prim


def preview_material(stage, path, **inputs):
    material = UsdShade.Material.Define(stage, path)
    surface = shader(stage, f"{path}/Surface", "UsdPreviewSurface", **inputs)
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return material


def bind(prim, material, **options):
    api = UsdShade.MaterialBindingAPI.Apply(prim.GetPrim() if hasattr(prim, "GetPrim") else prim)
    api.Bind(material, **options)
    return api


def uv_texture(stage, path, file="./a.png", **inputs):
    return shader(stage, path, "UsdUVTexture", file=("Asset", Sdf.AssetPath(file)), **inputs)


def output(prim, name="rgb", type_name="Float3"):
    return UsdShade.Shader(prim).CreateOutput(name, getattr(Sdf.ValueTypeNames, type_name))


def test_unbound_mesh_is_grey_or_its_display_colour(stage, define_mesh, read):
    define_mesh(stage, "/M")
    material = read(stage)[0].draws[0].material
    assert (material.path, material.inputs, material.uses_display_color) == ("", {"diffuseColor": _GREY}, True)


def test_inputs_that_differ_from_the_defaults_are_there(stage, define_mesh, read):
    material = preview_material(
        stage, "/Mat",
        diffuseColor=("Color3f", (0.5, 0.25, 0.125)), roughness=("Float", 0.75), metallic=("Float", 0.0),
        useSpecularWorkflow=("Int", 1), specularColor=("Color3f", (1, 0.5, 0.25)), clearcoat=("Float", 0.5),
        emissiveColor=("Color3f", (2, 2, 2)), opacity=("Float", 0.5), opacityThreshold=("Float", 0.25),
        ior=("Float", 2.0), occlusion=("Float", 0.5), clearcoatRoughness=("Float", 0.5), normal=("Normal3f", (0, 0, 1)),
    )  # fmt: skip
    bind(define_mesh(stage, "/M"), material)
    got = read(stage)[0].draws[0].material
    assert got.path == "/Mat" and not got.uses_display_color
    assert got.inputs == {
        "diffuseColor": (0.5, 0.25, 0.125), "roughness": 0.75, "useSpecularWorkflow": 1.0,
        "specularColor": (1, 0.5, 0.25), "clearcoat": 0.5, "emissiveColor": (2, 2, 2), "opacity": 0.5,
        "opacityThreshold": 0.25, "ior": 2.0, "occlusion": 0.5, "clearcoatRoughness": 0.5,
    }  # fmt: skip


def test_bindings_are_inherited_overridden_and_prefer_preview(stage, define_mesh, read):
    full, preview, strong = (preview_material(stage, f"/{n}") for n in ("Full", "Preview", "Strong"))
    bind(UsdGeom.Xform.Define(stage, "/A"), full)
    define_mesh(stage, "/A/Inherits")
    bind(define_mesh(stage, "/A/Preview"), preview, materialPurpose="preview")
    bind(UsdGeom.Xform.Define(stage, "/B"), strong, bindingStrength="strongerThanDescendants")
    bind(define_mesh(stage, "/B/Overruled"), full)
    got = {draw.path: draw.material.path for draw in read(stage)[0].draws}
    assert got == {"/A/Inherits": "/Full", "/A/Preview": "/Preview", "/B/Overruled": "/Strong"}


def test_collection_binding(stage, define_mesh, read):
    material = preview_material(stage, "/Mat")
    root = UsdGeom.Xform.Define(stage, "/A").GetPrim()
    define_mesh(stage, "/A/In")
    define_mesh(stage, "/A/Out")
    collection = Usd.CollectionAPI.Apply(root, "some")
    collection.CreateIncludesRel().SetTargets(["/A/In"])
    UsdShade.MaterialBindingAPI.Apply(root).Bind(collection, material)
    assert {d.path: d.material.path for d in read(stage)[0].draws} == {"/A/In": "/Mat", "/A/Out": ""}


def test_subsets_are_ranges_with_their_own_material_and_the_rest_keeps_the_mesh_s(stage, define_mesh, read):
    points = [(x, y, 0) for y in (0, 1) for x in range(5)]
    faces = [(i, i + 1, i + 6, i + 5) for i in range(4)]
    mesh = define_mesh(stage, "/M", points, (4,) * 4, [i for face in faces for i in face])
    bind(mesh, preview_material(stage, "/Base"))
    for name, indices in (("Right", [3, 1]), ("Left", [0]), ("Loose", [2])):
        subset = UsdGeom.Subset.CreateGeomSubset(mesh, name, "face", indices, "materialBind")
        if name != "Loose":
            bind(subset, preview_material(stage, f"/{name}Mat"))
    scene, warned = read(stage)
    covered = {}
    for draw in scene.draws:
        part = draw.mesh.triangles[draw.first_triangle : draw.first_triangle + draw.triangle_count]
        centres = np.floor(draw.mesh.points[part].mean(axis=1)[:, 0]).astype(int)
        covered.setdefault(draw.material.path, []).extend(centres.tolist())
    assert {name: sorted(set(x)) for name, x in covered.items()} == {"/Base": [2], "/LeftMat": [0], "/RightMat": [1, 3]}
    assert len({id(draw.mesh) for draw in scene.draws}) == 1
    assert sum(draw.triangle_count for draw in scene.draws) == 8
    assert warned == []


def test_damaged_subsets_warn_and_the_rest_is_drawn(stage, define_mesh, read):
    mesh = define_mesh(stage, "/M")
    UsdGeom.Subset.CreateGeomSubset(mesh, "A", "face", [0, 9], "materialBind")
    UsdGeom.Subset.CreateGeomSubset(mesh, "B", "face", [0], "materialBind")
    scene, warned = read(stage)
    assert sum(draw.triangle_count for draw in scene.draws) == 2
    assert any("/M/A.indices: face 9, expected 0 to 0" in w for w in warned)
    assert any(w.startswith("/M/B: ") for w in warned)


def test_texture_on_every_kind_of_input(stage, define_mesh, read):
    texture = uv_texture(stage, "/Mat/Tex")
    preview_material(
        stage, "/Mat",
        diffuseColor=("Color3f", output(texture)), opacity=("Float", output(texture, "a", "Float")),
        roughness=("Float", output(texture, "g", "Float")), metallic=("Float", output(texture)),
        normal=("Normal3f", output(texture)), emissiveColor=("Color3f", output(texture)),
    )  # fmt: skip
    bind(define_mesh(stage, "/M", st=_UNIT_ST), UsdShade.Material(stage.GetPrimAtPath("/Mat")))
    inputs = read(stage)[0].draws[0].material.inputs
    assert {name: value.output for name, value in inputs.items()} == {
        "diffuseColor": "rgb", "opacity": "a", "roughness": "g", "metallic": "r", "normal": "rgb",
        "emissiveColor": "rgb",
    }  # fmt: skip
    textures = {id(value.texture) for value in inputs.values()}
    assert len(textures) == 1
    assert inputs["diffuseColor"].texture.kind == "zipmap"


def test_zipmap_takes_the_place_of_a_texture_and_its_inside_is_not_entered(stage, define_mesh, read):
    zipmap = fexel.ZipmapTexture.Define(stage, "/Mat/Zip")
    prim = stage.GetPrimAtPath("/Mat/Zip")
    inner = uv_texture(stage, "/Mat/Zip/Fallback")
    rgb = UsdShade.NodeGraph(prim).CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    rgb.ConnectToSource(output(inner))
    fexel.ZipmapTexture.Define(stage, "/Mat/Zip/Patch")
    material = preview_material(stage, "/Mat", diffuseColor=("Color3f", rgb))
    bind(define_mesh(stage, "/M", st=_UNIT_ST), material)
    got = read(stage)[0].draws[0].material.inputs["diffuseColor"]
    assert isinstance(got, TextureInput)
    assert (got.texture.path, got.texture.kind, got.output, got.texture.st_primvar) == (
        "/Mat/Zip",
        "zipmap",
        "rgb",
        "st",
    )
    assert zipmap


def test_values_and_textures_come_through_interface_inputs_and_nested_node_graphs(stage, define_mesh, read):
    material = UsdShade.Material.Define(stage, "/Mat")
    rough = material.CreateInput("rough", Sdf.ValueTypeNames.Float)
    rough.Set(0.875)
    name = material.CreateInput("frame:stPrimvarName", Sdf.ValueTypeNames.Token)
    name.Set("map1")
    outer = UsdShade.NodeGraph.Define(stage, "/Mat/Outer")
    inner = UsdShade.NodeGraph.Define(stage, "/Mat/Outer/Inner")
    passed = inner.CreateInput("name", Sdf.ValueTypeNames.Token)
    passed.ConnectToSource(name)
    reader = shader(stage, "/Mat/Outer/Inner/Reader", "UsdPrimvarReader_float2", varname=("String", passed))
    texture = uv_texture(stage, "/Mat/Outer/Inner/Tex", st=("Float2", output(reader, "result", "Float2")))
    inner_rgb = inner.CreateOutput("out", Sdf.ValueTypeNames.Float3)
    inner_rgb.ConnectToSource(output(texture))
    outer_rgb = outer.CreateOutput("color", Sdf.ValueTypeNames.Float3)
    outer_rgb.ConnectToSource(inner_rgb)
    surface = shader(
        stage,
        "/Mat/Outer/Surface",
        "UsdPreviewSurface",
        diffuseColor=("Color3f", outer_rgb),
        roughness=("Float", rough),
    )
    through = outer.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    through.ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    material.CreateSurfaceOutput().ConnectToSource(through)
    bind(define_mesh(stage, "/M", map1=_UNIT_ST), material)
    inputs = read(stage)[0].draws[0].material.inputs
    assert inputs["roughness"] == 0.875
    assert inputs["diffuseColor"].texture.path == "/Mat/Outer/Inner/Tex"
    assert inputs["diffuseColor"].texture.st_primvar == "map1"


@pytest.mark.parametrize("type_name", ["Token", "String"])
def test_transform_2d_scales_then_rotates_then_translates(stage, define_mesh, read, type_name):
    reader = shader(stage, "/Mat/Reader", "UsdPrimvarReader_float2", varname=(type_name, "uv"))
    transform = shader(
        stage, "/Mat/Transform", "UsdTransform2d",
        scale=("Float2", (2, 3)), rotation=("Float", 90.0), translation=("Float2", (10, 20)),
    )  # fmt: skip
    transform.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(output(reader, "result", "Float2"))
    second = shader(stage, "/Mat/Second", "UsdTransform2d", scale=("Float2", (10, 10)))
    second.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(output(transform, "result", "Float2"))
    texture = uv_texture(stage, "/Mat/Tex", st=("Float2", output(second, "result", "Float2")))
    bind(
        define_mesh(stage, "/M", uv=_UNIT_ST),
        preview_material(stage, "/Mat", diffuseColor=("Color3f", output(texture))),
    )
    got = read(stage)[0].draws[0].material.inputs["diffuseColor"].texture
    assert got.st_primvar == "uv"
    for (s, t), expected in (((0, 0), (100, 200)), ((1, 0), (100, 220)), ((0, 1), (70, 200))):
        np.testing.assert_allclose((np.array([s, t, 1]) @ got.st_transform)[:2], expected, atol=1e-12)


def test_display_colour_and_opacity_through_primvar_readers(stage, define_mesh, read):
    color = shader(
        stage, "/Mat/C", "UsdPrimvarReader_float3", varname=("String", "displayColor"), fallback=("Float3", (1, 0, 0))
    )
    opacity = shader(stage, "/Mat/O", "UsdPrimvarReader_float", varname=("String", "displayOpacity"))
    other = shader(stage, "/Mat/X", "UsdPrimvarReader_float", varname=("String", "wetness"), fallback=("Float", 0.25))
    material = preview_material(
        stage, "/Mat",
        diffuseColor=("Color3f", output(color, "result")), opacity=("Float", output(opacity, "result", "Float")),
        roughness=("Float", output(other, "result", "Float")),
    )  # fmt: skip
    bind(define_mesh(stage, "/M"), material)
    scene, warned = read(stage)
    got = scene.draws[0].material
    assert got.uses_display_color and got.uses_display_opacity
    assert got.inputs["diffuseColor"] == (1, 0, 0) and got.inputs["roughness"] == 0.25
    assert len(warned) == 1 and "wetness" in warned[0]


@pytest.mark.parametrize("kind", ["ND_standard_surface_surfaceshader", "", None])
def test_unknown_surface_is_said_once_and_shown_grey(stage, define_mesh, read, kind):
    material = UsdShade.Material.Define(stage, "/Mat")
    if kind is not None:
        surface = shader(stage, "/Mat/S", kind)
        material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("out", Sdf.ValueTypeNames.Token))
    for name in ("A", "B"):
        bind(define_mesh(stage, f"/{name}"), material)
    scene, warned = read(stage)
    assert [d.material.inputs for d in scene.draws] == [{"diffuseColor": _GREY}] * 2
    assert scene.draws[0].material.uses_display_color
    assert len(warned) == 1 and warned[0].startswith("/Mat: ")


def test_unknown_node_dangling_connection_and_circle(stage, define_mesh, read):
    noise = shader(stage, "/Mat/Noise", "ND_noise2d_float")
    material = preview_material(
        stage, "/Mat", roughness=("Float", output(noise, "out", "Float")), metallic=("Float", 0.5)
    )
    surface = UsdShade.Shader(stage.GetPrimAtPath("/Mat/Surface"))
    surface.GetInput("metallic").GetAttr().AddConnection("/Mat/Gone.outputs:r")
    a = material.CreateInput("a", Sdf.ValueTypeNames.Float)
    b = material.CreateInput("b", Sdf.ValueTypeNames.Float)
    a.ConnectToSource(b)
    b.ConnectToSource(a)
    surface.CreateInput("opacity", Sdf.ValueTypeNames.Float).ConnectToSource(a)
    bind(define_mesh(stage, "/M"), material)
    scene, warned = read(stage)
    assert scene.draws[0].material.inputs == {"metallic": 0.5}
    assert len(warned) == 3


def test_value_that_is_not_finite_warns_and_becomes_the_default(stage, define_mesh, read):
    bind(define_mesh(stage, "/M"), preview_material(stage, "/Mat", roughness=("Float", float("nan"))))
    scene, warned = read(stage)
    assert scene.draws[0].material.inputs == {}
    assert len(warned) == 1 and warned[0].startswith("/Mat/Surface.inputs:roughness: ")


def test_texture_that_cannot_be_read_warns_once_and_shows_its_fallback(stage, define_mesh, read, monkeypatch):
    import fexel.textures

    def damaged(prim, _time):
        raise FexelError(f"{prim.GetPath()}.inputs:file: damaged")

    monkeypatch.setattr(fexel.textures, "extract_texture", damaged)
    texture = uv_texture(stage, "/Mat/Tex", fallback=("Float4", (0.25, 0.5, 0.75, 0.5)))
    material = preview_material(
        stage, "/Mat",
        diffuseColor=("Color3f", output(texture)), opacity=("Float", output(texture, "a", "Float")),
        roughness=("Float", output(texture, "g", "Float")), normal=("Normal3f", output(texture)),
    )  # fmt: skip
    for name in ("A", "B"):
        bind(define_mesh(stage, f"/{name}", st=_UNIT_ST), material)
    scene, warned = read(stage)
    assert scene.draws[0].material.inputs == {
        "diffuseColor": (0.25, 0.5, 0.75),
        "opacity": 0.5,
    }  # roughness: its default
    assert len(warned) == 1 and "damaged" in warned[0]


def test_mesh_without_texture_coordinates_is_an_error_that_names_the_remedy(stage, define_mesh):
    texture = uv_texture(stage, "/Mat/Tex")
    material = preview_material(stage, "/Mat", diffuseColor=("Color3f", output(texture)))
    bind(define_mesh(stage, "/World/Bare"), material)
    with pytest.raises(FexelError, match=r"^/World/Bare: .*'st'.*fexel unwrap STAGE -o OUT.usda$") as error:
        SceneReader(stage).at()
    assert "\n" not in str(error.value)


def test_error_names_the_primvar_and_the_file(tmp_path, define_mesh):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    reader = shader(stage, "/Mat/Reader", "UsdPrimvarReader_float2", varname=("String", "map2"))
    texture = uv_texture(stage, "/Mat/Tex", st=("Float2", output(reader, "result", "Float2")))
    material = preview_material(stage, "/Mat", diffuseColor=("Color3f", output(texture)))
    bind(define_mesh(stage, "/Bare", st=_UNIT_ST), material)
    with pytest.raises(FexelError, match=r"'map2'.*a\.usda -o OUT\.usda --primvar map2"):
        SceneReader(stage).at()


def test_hidden_mesh_without_texture_coordinates_does_no_harm(stage, define_mesh):
    texture = uv_texture(stage, "/Mat/Tex")
    mesh = define_mesh(stage, "/Bare")
    bind(mesh, preview_material(stage, "/Mat", diffuseColor=("Color3f", output(texture))))
    UsdGeom.Imageable(mesh).MakeInvisible()
    assert SceneReader(stage).at().draws == ()


def test_damaged_texture_coordinates_warn_and_show_the_texture_s_fallback(stage, define_mesh, read):
    texture = uv_texture(stage, "/Mat/Tex", fallback=("Float4", (0.5, 0.5, 0, 1)))
    mesh = define_mesh(stage, "/M", st=("TexCoord2fArray", "vertex", [(0, 0)] * 2))
    bind(mesh, preview_material(stage, "/Mat", diffuseColor=("Color3f", output(texture))))
    scene, warned = read(stage)
    assert scene.draws[0].material.inputs == {"diffuseColor": (0.5, 0.5, 0)}
    assert len(warned) == 1


def test_animated_input_gives_new_materials_and_static_ones_stay(stage, define_mesh):
    fading = preview_material(stage, "/Fading", opacity=("Float", 1.0))
    attribute = UsdShade.Shader(stage.GetPrimAtPath("/Fading/Surface")).GetInput("opacity").GetAttr()
    for time in (0.0, 1.0):
        attribute.Set(time, time)
    texture = uv_texture(stage, "/Still/Tex")
    still = preview_material(stage, "/Still", diffuseColor=("Color3f", output(texture)))
    bind(define_mesh(stage, "/A"), fading)
    bind(define_mesh(stage, "/B", st=_UNIT_ST), still)
    reader = SceneReader(stage)
    first, second = reader.at(0.25).draws, reader.at(0.5).draws
    assert (first[0].material.inputs["opacity"], second[0].material.inputs["opacity"]) == (0.25, 0.5)
    assert first[0].mesh is second[0].mesh
    assert first[1] is second[1]


def test_animated_texture_is_read_again_and_its_material_with_it(stage, define_mesh):
    texture = uv_texture(stage, "/Mat/Tex")
    scale = texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).GetAttr()
    for time in (0.0, 1.0):
        scale.Set((time, 1, 1, 1), time)
    bind(
        define_mesh(stage, "/M", st=_UNIT_ST),
        preview_material(stage, "/Mat", diffuseColor=("Color3f", output(texture))),
    )
    reader = SceneReader(stage)
    data = [reader.at(t).draws[0].material.inputs["diffuseColor"].texture.data for t in (0.25, 0.5)]
    assert data[0] != data[1]
    assert [d.scale[0] for d in data] == [0.25, 0.5]


def test_materials_inside_instances_are_shared(stage, define_mesh):
    texture = uv_texture(stage, "/Asset/Mat/Tex")
    material = preview_material(stage, "/Asset/Mat", diffuseColor=("Color3f", output(texture)))
    bind(define_mesh(stage, "/Asset/M", st=_UNIT_ST), material)
    for name in ("A", "B"):
        prim = stage.DefinePrim(f"/W/{name}", "Xform")
        prim.GetReferences().AddInternalReference("/Asset")
        prim.SetInstanceable(True)
    draws = SceneReader(stage, mask=["/W"]).at().draws
    assert len(draws) == 2
    assert draws[0].material is draws[1].material
