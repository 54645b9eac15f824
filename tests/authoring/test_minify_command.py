"""`fexel minify`: the filter reaches every texture of a stage, wherever it comes from, and the stage stays as it is."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdUtils
from typer.testing import CliRunner

import fexel
from fexel.errors import FexelError
from fexel.filters import FILTERS, PORTABLE_FILTERS
from fexel_tools.cli import app
from fexel_tools.image_files import write_image
from fexel_tools.minify import MinifyOptions, minify

REPOSITORY = Path(__file__).resolve().parents[2]
STAGES = sorted(p for p in (REPOSITORY / "stages").glob("*/*.usd*") if p.stem == p.parent.name)
FIPMAP = MinifyOptions(filter="fipmap")
TEXTURE = "/World/Looks/Tile/Image"


def define_material(stage, path, file="./tile.png"):
    """A material as other applications write it: UsdPreviewSurface, UsdUVTexture, UsdPrimvarReader_float2."""
    material = UsdShade.Material.Define(stage, path)
    surface, reader, image = (UsdShade.Shader.Define(stage, f"{path}/{n}") for n in ("Surface", "Reader", "Image"))
    surface.CreateIdAttr("UsdPreviewSurface")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(file))
    image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
        reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    )
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
        image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    )
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return image


def define_floor(stage, path, material):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr("none")
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(UsdShade.Material.Get(stage, material))
    return mesh


@pytest.fixture
def asset(tmp_path):
    """An asset with its material inside, and its texture."""
    checks = np.indices((16, 16)).sum(0) % 2
    write_image(tmp_path / "tile.png", np.repeat(np.uint8(255 * checks)[..., None], 3, axis=-1))
    stage = Usd.Stage.CreateNew(str(tmp_path / "asset.usda"))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Asset").GetPrim())
    define_material(stage, "/Asset/Looks/Tile")
    define_floor(stage, "/Asset/Geo/Floor", "/Asset/Looks/Tile")
    stage.GetRootLayer().Save()
    return tmp_path / "asset.usda"


@pytest.fixture
def scene(asset, tmp_path):
    """A stage in centimetres, z up, animated, of which one texture is its own."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(48)
    stage.SetTimeCodesPerSecond(48)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    define_material(stage, "/World/Looks/Tile")
    define_floor(stage, "/World/Floor", "/World/Looks/Tile")
    stage.GetRootLayer().Save()
    return stage


def filters(path):
    """Filter of every prim that the API is applied to, instance proxies included."""
    stage = Usd.Stage.Open(str(path))
    prims = Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate))
    wrapped = {str(prim.GetPath()): fexel.TextureMinificationAPI(prim) for prim in prims}
    return {name: api.GetFilterAttr().Get() for name, api in wrapped.items() if api}


def authored(path, prim=TEXTURE, time=1.0):
    """Values of the API that are authored on a prim, by the name after the namespace."""
    stage = Usd.Stage.Open(str(path))
    attributes = stage.GetPrimAtPath(prim).GetAuthoredPropertiesInNamespace("minification")
    assert not any(attribute.IsCustom() for attribute in attributes)
    return {attribute.GetBaseName(): attribute.Get(time) for attribute in attributes}


def run(scene, tmp_path, options=FIPMAP, name="out.usda"):
    scene.GetRootLayer().Save()
    return minify(tmp_path / "scene.usda", tmp_path / name, options)


def test_plain_texture_of_a_stock_stage_gets_the_filter(scene, tmp_path):
    result = run(scene, tmp_path)
    assert [(t.prim, t.filter) for t in result.textures] == [(TEXTURE, "fipmap")]
    assert filters(tmp_path / "out.usda") == {TEXTURE: "fipmap"}
    assert fexel.validate(Usd.Stage.Open(str(tmp_path / "out.usda"))) == []


def test_layer_holds_nothing_but_what_was_asked_for(scene, tmp_path):
    run(scene, tmp_path)
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "out.usda"))
    assert list(layer.subLayerPaths) == ["./scene.usda"]
    specs = []
    layer.Traverse("/", lambda path: specs.append(str(path)))
    texture = TEXTURE
    assert sorted(specs) == sorted(
        ["/", "/World", "/World/Looks", "/World/Looks/Tile", texture, f"{texture}.minification:filter"]
    )


def test_stage_itself_is_untouched_and_its_metadata_is_kept(scene, tmp_path):
    scene.GetRootLayer().Save()
    before = hashlib.sha256((tmp_path / "scene.usda").read_bytes()).hexdigest()
    run(scene, tmp_path)
    assert hashlib.sha256((tmp_path / "scene.usda").read_bytes()).hexdigest() == before
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    assert (UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)) == ("Z", 0.01)
    assert (stage.GetDefaultPrim().GetPath(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (
        "/World",
        48,
        48,
    )


@pytest.mark.parametrize("arc", ["reference", "payload", "inherit", "specialize", "sublayer"])
def test_texture_behind_any_arc_gets_the_filter(scene, tmp_path, arc):
    stage = scene
    if arc == "sublayer":
        other = Usd.Stage.CreateNew(str(tmp_path / "other.usda"))
        define_material(other, "/Extra/Looks/Tile")
        other.GetRootLayer().Save()
        stage.GetRootLayer().subLayerPaths.append("./other.usda")
        expected = "/Extra/Looks/Tile/Image"
    elif arc in ("reference", "payload"):
        prim = stage.OverridePrim("/World/Thing")
        add = prim.GetReferences().AddReference if arc == "reference" else prim.GetPayloads().AddPayload
        add("./asset.usda")
        expected = "/World/Thing/Looks/Tile/Image"
    else:
        source = stage.CreateClassPrim("/_class")
        define_material(stage, "/_class/Tile")
        prim = stage.DefinePrim("/World/Thing")
        (prim.GetInherits().AddInherit if arc == "inherit" else prim.GetSpecializes().AddSpecialize)(source.GetPath())
        expected = "/World/Thing/Tile/Image"
    run(stage, tmp_path)
    assert filters(tmp_path / "out.usda") == {TEXTURE: "fipmap", expected: "fipmap"}


def test_instances_get_the_filter_and_stay_instances_of_one_prototype(scene, tmp_path):
    for name in ("A", "B"):
        prim = scene.DefinePrim(f"/World/{name}")
        prim.GetReferences().AddReference("./asset.usda")
        prim.SetInstanceable(True)
    result = run(scene, tmp_path)
    assert [t.note for t in result.textures] == ["", "shared by 2 instances"]
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    assert len(stage.GetPrototypes()) == 1
    assert all(stage.GetPrimAtPath(f"/World/{name}").IsInstance() for name in "AB")
    found = filters(tmp_path / "out.usda")
    assert {p for p in found if p.startswith("/World/")} == {
        TEXTURE, "/World/A/Looks/Tile/Image", "/World/B/Looks/Tile/Image",
    }  # fmt: skip


def test_nested_instances_get_the_filter(scene, asset, tmp_path):
    group = Usd.Stage.CreateNew(str(tmp_path / "group.usda"))
    group.SetDefaultPrim(UsdGeom.Xform.Define(group, "/Group").GetPrim())
    for name in ("I1", "I2"):
        prim = group.DefinePrim(f"/Group/{name}")
        prim.GetReferences().AddReference("./asset.usda")
        prim.SetInstanceable(True)
    group.GetRootLayer().Save()
    for name in ("A", "B"):
        prim = scene.DefinePrim(f"/World/{name}")
        prim.GetReferences().AddReference("./group.usda")
        prim.SetInstanceable(True)
    run(scene, tmp_path)
    found = filters(tmp_path / "out.usda")
    for outer in "AB":
        for inner in ("I1", "I2"):
            assert found[f"/World/{outer}/{inner}/Looks/Tile/Image"] == "fipmap"
    assert len(Usd.Stage.Open(str(tmp_path / "out.usda")).GetPrototypes()) == 2


def test_layers_can_be_stacked_over_instances(scene, tmp_path):
    """The second layer wins where both speak, and keeps of the first what it does not name."""
    prim = scene.DefinePrim("/World/A")
    prim.GetReferences().AddReference("./asset.usda")
    prim.SetInstanceable(True)
    run(scene, tmp_path, MinifyOptions(filter="ripmap", contrast=0.5))
    minify(tmp_path / "out.usda", tmp_path / "again.usda", FIPMAP)
    again = Usd.Stage.Open(str(tmp_path / "again.usda"))
    for path in ("/World/A/Looks/Tile/Image", TEXTURE):
        api = fexel.TextureMinificationAPI.Get(again, path)
        assert (api.GetFilterAttr().Get(), api.GetContrastAttr().Get()) == ("fipmap", 0.5)
        schemas = again.GetPrimAtPath(path).GetAppliedSchemas()
        assert schemas.count("TextureMinificationAPI") == 1


def add_look_variants(stage, path="/World/Thing"):
    """``look``: none by default, ``tile`` with a texture, ``rust`` with another that has an inner set ``age``."""
    prim = stage.DefinePrim(path)
    look = prim.GetVariantSets().AddVariantSet("look")
    for name in ("plain", "tile", "rust"):
        look.AddVariant(name)
    look.SetVariantSelection("tile")
    with look.GetVariantEditContext():
        define_material(stage, f"{path}/Tile")
    look.SetVariantSelection("rust")
    with look.GetVariantEditContext():
        define_material(stage, f"{path}/Rust")
        age = prim.GetVariantSets().AddVariantSet("age")
        for name in ("young", "old"):
            age.AddVariant(name)
        age.SetVariantSelection("old")
        with age.GetVariantEditContext():
            define_material(stage, f"{path}/Patina")
        age.SetVariantSelection("young")
    look.SetVariantSelection("plain")


def test_textures_of_every_variant_get_the_filter(scene, tmp_path):
    add_look_variants(scene)
    result = run(scene, tmp_path)
    assert {t.prim: t.variant for t in result.textures} == {
        TEXTURE: "",
        "/World/Thing/Tile/Image": "look=tile",
        "/World/Thing/Rust/Image": "look=rust",
        "/World/Thing/Patina/Image": "look=rust, age=old",
    }
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    sets = stage.GetPrimAtPath("/World/Thing").GetVariantSets()
    assert sets.GetVariantSelection("look") == "plain", "the selection is the stage's own"
    for look, age, path in (("tile", "", "Tile"), ("rust", "young", "Rust"), ("rust", "old", "Patina")):
        sets.SetSelection("look", look)
        if age:
            sets.SetSelection("age", age)
        api = fexel.TextureMinificationAPI.Get(stage, f"/World/Thing/{path}/Image")
        assert api and api.GetFilterAttr().Get() == "fipmap"


def test_variant_of_an_instance_gets_the_filter(scene, tmp_path):
    asset = Usd.Stage.CreateNew(str(tmp_path / "looks.usda"))
    asset.SetDefaultPrim(asset.DefinePrim("/Looks"))
    add_look_variants(asset, "/Looks")
    asset.GetRootLayer().Save()
    for name in ("A", "B"):
        prim = scene.DefinePrim(f"/World/{name}")
        prim.GetReferences().AddReference("./looks.usda")
        prim.SetInstanceable(True)
    run(scene, tmp_path)
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    stage.GetPrimAtPath("/World/B").GetVariantSets().SetSelection("look", "tile")
    assert stage.GetPrimAtPath("/World/B").IsInstance()
    api = fexel.TextureMinificationAPI.Get(stage, "/World/B/Tile/Image")
    assert api and api.GetFilterAttr().Get() == "fipmap"


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usd", ".usdz"])
def test_input_of_every_format(scene, tmp_path, suffix):
    scene.GetRootLayer().Save()
    source = tmp_path / f"in put{suffix}"
    if suffix == ".usdz":
        assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "scene.usda"), str(source))
    else:
        scene.GetRootLayer().Export(str(source))
    minify(source, tmp_path / "out.usda", FIPMAP)
    assert filters(tmp_path / "out.usda") == {TEXTURE: "fipmap"}
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    file = stage.GetPrimAtPath(TEXTURE).GetAttribute("inputs:file")
    assert file.Get().resolvedPath, "textures are found as before"


@pytest.mark.parametrize("name", ["out.usda", "out.usdc", "out.usd"])
def test_output_of_every_format(scene, tmp_path, name):
    run(scene, tmp_path, name=name)
    assert filters(tmp_path / name) == {TEXTURE: "fipmap"}


@pytest.mark.parametrize("name", ["a b", "größe", "a[1]", "a@b", "a@@@b", "100%", "it's"])
def test_folders_with_odd_names(scene, tmp_path, name):
    scene.GetRootLayer().Save()
    folder = tmp_path / name
    folder.mkdir()
    for file in ("scene.usda", "tile.png"):
        (folder / file).write_bytes((tmp_path / file).read_bytes())
    minify(folder / "scene.usda", tmp_path / "out.usda", FIPMAP)
    assert filters(tmp_path / "out.usda") == {TEXTURE: "fipmap"}


def test_all_values_are_authored_as_the_schema_has_them(scene, tmp_path):
    run(scene, tmp_path, MinifyOptions("ripmap", 0.5, -0.25, math.inf, (0.5, 0.25, 2.0)))
    assert authored(tmp_path / "out.usda") == {
        "filter": "ripmap",
        "contrast": 0.5,
        "brightness": -0.25,
        "attenuationDistance": math.inf,
        "attenuationColor": Gf.Vec3f(0.5, 0.25, 2.0),
    }


def test_value_replaces_an_animated_one(scene, tmp_path):
    api = fexel.TextureMinificationAPI.Apply(scene.GetPrimAtPath(TEXTURE))
    for time in (1.0, 48.0):
        api.CreateContrastAttr().Set(time, time)
    run(scene, tmp_path, MinifyOptions(contrast=0.5))
    for time in (1.0, 48.0):
        assert authored(tmp_path / "out.usda", time=time) == {"contrast": 0.5}, "and no filter was asked for"


def test_raw_texture_gets_the_filter_and_keeps_its_values_unless_it_is_named(scene, tmp_path):
    image = UsdShade.Shader.Get(scene, TEXTURE)
    image.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("raw")
    options = MinifyOptions(filter="fipmap", contrast=0.5, attenuation_distance=10.0)
    (texture,) = run(scene, tmp_path, options).textures
    assert "data" in texture.note
    assert authored(tmp_path / "out.usda") == {"filter": "fipmap"}
    (texture,) = run(scene, tmp_path, MinifyOptions(contrast=0.5, prims=(TEXTURE,)), "named.usda").textures
    assert texture.note == ""
    assert authored(tmp_path / "named.usda") == {"contrast": 0.5}


def test_prims_limit_what_is_changed(scene, tmp_path):
    define_material(scene, "/World/Looks/Other")
    run(scene, tmp_path, MinifyOptions(filter="mipmap", prims=("/World/Looks/Other",)))
    assert filters(tmp_path / "out.usda") == {"/World/Looks/Other/Image": "mipmap"}


def define_zipmap(stage):
    root = fexel.ZipmapTexture.Define(stage, "/World/Looks/Zip/Texture")
    for name in ("Plain", "Own"):
        fexel.ZipmapTexture.Define(stage, f"/World/Looks/Zip/Texture/{name}")
    define_material(stage, "/World/Looks/Zip/Texture/Fallback")
    own = fexel.TextureMinificationAPI.Apply(stage.GetPrimAtPath("/World/Looks/Zip/Texture/Own"))
    own.CreateFilterAttr("mipmap")
    return root


def test_patches_follow_their_texture_unless_they_have_a_filter_of_their_own(scene, tmp_path):
    define_zipmap(scene)
    run(scene, tmp_path, MinifyOptions(filter="ripmap", prims=("/World/Looks/Zip",)))
    texture = "/World/Looks/Zip/Texture"
    assert filters(tmp_path / "out.usda") == {texture: "ripmap", f"{texture}/Own": "ripmap"}


def test_patch_that_is_named_gets_a_filter_alone(scene, tmp_path):
    define_zipmap(scene)
    patch = "/World/Looks/Zip/Texture/Plain"
    run(scene, tmp_path, MinifyOptions(filter="fipmap", prims=(patch,)))
    found = filters(tmp_path / "out.usda")
    assert found == {patch: "fipmap", "/World/Looks/Zip/Texture/Own": "mipmap"}


@pytest.mark.parametrize("stage", STAGES, ids=[path.stem for path in STAGES])
def test_example_stage_takes_every_option_and_stays_valid(stage, tmp_path):
    options = MinifyOptions("fipmap", 0.9, 0.01, 100.0, (0.5, 0.6, 0.7))
    result = minify(stage, tmp_path / "out.usda", options)
    assert result.textures
    opened = Usd.Stage.Open(str(tmp_path / "out.usda"))
    for texture in result.textures:
        api = fexel.TextureMinificationAPI.Get(opened, texture.prim)
        assert api and api.GetFilterAttr().Get() == "fipmap"
    assert [str(finding) for finding in fexel.validate(opened)] == []


def test_command_prints_a_line_per_texture_and_writes_the_report(scene, tmp_path):
    scene.GetRootLayer().Save()
    arguments = [tmp_path / "scene.usda", "--filter", "fipmap", "--attenuationDistance", "inf"]
    arguments += ["--attenuationColor", "#808080", "-o", tmp_path / "out.usda", "--report", tmp_path / "r.json"]
    done = CliRunner().invoke(app, ["minify", *map(str, arguments)])
    assert done.exit_code == 0, done.output
    assert done.output.splitlines() == ["/World/Looks/Tile/Image: fipmap", str(tmp_path / "out.usda")]
    assert authored(tmp_path / "out.usda")["attenuationColor"][0] == pytest.approx(0.2158605)
    report = json.loads((tmp_path / "r.json").read_text("utf-8"))
    assert report["textures"] == [{"prim": TEXTURE, "filter": "fipmap", "variant": "", "note": "", "predicted_db": {}}]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "nothing to author"),
        ({"filter": "ewa"}, "'ewa', expected one of mipmap, anisotropic, ripmap, fipmap"),
        ({"contrast": math.nan}, "--contrast: nan"),
        ({"brightness": math.inf}, "--brightness: inf"),
        ({"attenuation_distance": 0.0}, "--attenuationDistance: 0, expected more than 0"),
        ({"attenuation_distance": math.nan}, "--attenuationDistance: nan"),
        ({"attenuation_color": (0.0, -1.0, 0.0)}, "--attenuationColor"),
        ({"filter": "fipmap", "prims": ("/Nowhere",)}, "--prim /Nowhere: no such prim in"),
        ({"filter": "fipmap", "prims": ("not a path",)}, "--prim not a path"),
        ({"filter": "fipmap", "prims": ("/World/Floor",)}, "no texture at or below /World/Floor"),
    ],
)
def test_wrong_option_is_one_line_and_writes_nothing(scene, tmp_path, options, words):
    before = sorted(p.name for p in tmp_path.iterdir())
    with pytest.raises(FexelError, match=words) as error:
        run(scene, tmp_path, MinifyOptions(**options))
    assert "\n" not in str(error.value)
    assert sorted(p.name for p in tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("absent.usda", None, "no such file"),
        ("broken.usda", b"#usda 1.0\ndef Mesh", "broken.usda"),
        ("broken.usdz", b"PK not a package", "broken.usdz"),
        ("picture.png", b"\x89PNG", "not a USD file"),
        ("empty.usda", b"#usda 1.0\n", "no texture, expected a fexel texture or a UsdUVTexture"),
    ],
)
def test_bad_stage_is_one_line_and_writes_nothing(tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(FexelError, match=words) as error:
        minify(tmp_path / name, tmp_path / "out.usda", FIPMAP)
    assert "\n" not in str(error.value)
    assert sorted(p.name for p in tmp_path.iterdir()) == ([] if content is None else [name])


def test_output_replaces_no_layer_of_the_stage(scene, asset, tmp_path):
    scene.DefinePrim("/World/A").GetReferences().AddReference("./asset.usda")
    with pytest.raises(FexelError, match="is the input as well"):
        run(scene, tmp_path, name="scene.usda")
    with pytest.raises(FexelError, match="is a layer of"):
        run(scene, tmp_path, name="asset.usda")
    with pytest.raises(FexelError, match=r"ends in \.usda"):
        run(scene, tmp_path, name="out.usdz")
    with pytest.raises(FexelError, match="another output"):
        minify(tmp_path / "scene.usda", tmp_path / "o.usda", FIPMAP, report=tmp_path / "o.usda")
    assert "UsdUVTexture" in asset.read_text("utf-8")


@pytest.mark.parametrize("token", PORTABLE_FILTERS)
def test_renderer_draws_instances_with_the_filter(gl, scene, tmp_path, token):
    """The AOV `filter` of two instances of an asset, before and after."""
    scene.RemovePrim("/World/Floor")
    for name, x in (("A", -1.5), ("B", 1.5)):
        prim = UsdGeom.Xform.Define(scene, f"/World/{name}")
        prim.GetPrim().GetReferences().AddReference("./asset.usda")
        prim.GetPrim().SetInstanceable(True)
        prim.AddTranslateOp().Set((x, 0, 0))
    camera = UsdGeom.Camera.Define(scene, "/World/Eye")
    look = Gf.Matrix4d().SetLookAt(Gf.Vec3d(0, 2, 8), Gf.Vec3d(0, 0, 0), Gf.Vec3d(0, 1, 0))
    camera.AddTransformOp().Set(look.GetInverse())
    run(scene, tmp_path, MinifyOptions(filter=token))
    drawn = {}
    for file in ("scene.usda", "out.usda"):
        images = fexel.render(str(tmp_path / file), camera="Eye", width=96, aovs=("filter", "primId"))
        seen = images["primId"][..., 0] >= 0
        assert len(np.unique(images["primId"][seen])) == 2
        drawn[file] = set(np.unique(images["filter"][seen]))
    assert drawn == {"scene.usda": {FILTERS.index("anisotropic")}, "out.usda": {FILTERS.index(token)}}
