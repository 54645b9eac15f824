"""`fexel bake`: any stage in, the same stage with explicit textures out, for applications without fexel."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade
from typer.testing import CliRunner

import fexel
from fexel.errors import FexelError, FexelWarning
from fexel.images import image_info, read_linear
from fexel.validators import validate_file
from fexel_tools.bake import bake_stage
from fexel_tools.cli import app
from fexel_tools.image_files import write_image
from fexel_tools.umbrella_stage import UmbrellaMap, create_stage
from fexel_tools.umbrella_textures import write_bases
from tests.authoring import ground

STANDARD = {"", "Camera", "DomeLight", "Material", "Mesh", "NodeGraph", "Scope", "Shader", "Xform"}
PLAIN = """
import json, sys
from pxr import Usd, UsdShade
stage = Usd.Stage.Open(sys.argv[1])
types = sorted({p.GetTypeName() for p in stage.TraverseAll()})
surface = UsdShade.Shader(stage.GetPrimAtPath("/World/Material/Surface"))
source = surface.GetInput("diffuseColor").GetConnectedSources()[0][0].source.GetPrim()
file = source.GetAttribute("inputs:file").Get()
schemas = sorted({s for p in stage.TraverseAll() for s in p.GetPrimTypeInfo().GetAppliedAPISchemas()})
print(json.dumps({"types": types, "id": UsdShade.Shader(source).GetShaderId(), "found": bool(file.resolvedPath),
                  "schemas": schemas, "fallbacks": bool(stage.GetRootLayer().pseudoRoot.HasInfo("fallbackPrimTypes"))}))
"""


def quadrants(size=64):
    """(size, size, 3) uint8: red, green / blue, grey."""
    picture = np.full((size, size, 3), 128, np.uint8)
    half = size // 2
    picture[:half, :half], picture[:half, half:], picture[half:, :half] = (220, 30, 30), (30, 200, 40), (40, 60, 210)
    return picture


@pytest.fixture
def stage(tmp_path):
    """A quad with a zipmap of a root and a patch; camera, light, an image of its own, and things that must not stay."""
    (tmp_path / "images").mkdir()
    write_image(tmp_path / "images" / "root.png", quadrants())
    write_image(tmp_path / "images" / "patch.png", np.full((16, 16, 3), 255, np.uint8))
    write_image(tmp_path / "images" / "sky.png", np.full((8, 16, 3), 90, np.uint8))
    stage = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    material = UsdShade.Material.Define(stage, "/World/Material")
    surface = UsdShade.Shader.Define(stage, "/World/Material/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
    surface.CreateInput("ior", Sdf.ValueTypeNames.Float).Set(1.0)
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    texture = fexel.ZipmapTexture.Define(stage, "/World/Material/Texture")
    texture.CreateFileAttr(Sdf.AssetPath("./images/root.png"))
    texture.CreateWrapSAttr("clamp")
    texture.CreateWrapTAttr("clamp")
    patch = fexel.ZipmapTexture.Define(stage, "/World/Material/Texture/Patch")
    patch.CreateFileAttr(Sdf.AssetPath("./images/patch.png"))
    patch.CreateMatrixAttr(Gf.Matrix3d(4, 0, 0, 0, 4, 0, -1.5, -1.5, 1))
    color = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    color.ConnectToSource(texture.CreateOutput("rgb", Sdf.ValueTypeNames.Color3f))
    mesh = UsdGeom.Mesh.Define(stage, "/World/Quad")
    mesh.CreatePointsAttr([(-1, -0.5, 0), (1, -0.5, 0), (1, 0.5, 0), (-1, 0.5, 0)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr("none")
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    camera = UsdGeom.Camera.Define(stage, "/World/Eye")
    camera.AddTranslateOp().Set((0, 0, 3))
    UsdLux.DomeLight.Define(stage, "/World/Light").CreateTextureFileAttr(Sdf.AssetPath("./images/sky.png"))
    stage.WriteFallbackPrimTypes()
    stage.GetRootLayer().Save()
    return stage


def scene(tmp_path):
    return tmp_path / "scene.usda"


def plain(path):
    """What usd-core alone makes of a stage."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PXR_PLUGINPATH", "PYTHONPATH"))}
    done = subprocess.run(
        [sys.executable, "-c", PLAIN, str(path)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("name", ["baked.usda", "baked.usdc", "baked.usd", "baked.usdz"])
def test_result_is_standard_and_complete(stage, tmp_path, name):
    out = tmp_path / "out"
    out.mkdir()
    bake_stage(scene(tmp_path), out / name, size=128)
    seen = plain(out / name)
    assert set(seen["types"]) <= STANDARD
    assert seen["id"] == "UsdUVTexture" and seen["found"] and not seen["fallbacks"]
    assert seen["schemas"] == ["MaterialBindingAPI"]
    assert validate_file(str(out / name)) == []
    for folder in (tmp_path / "images", scene(tmp_path)):  # nothing from elsewhere is needed
        folder.rename(folder.with_suffix(".gone"))
    assert plain(out / name)["found"]
    opened = Usd.Stage.Open(str(out / name))
    assert opened.GetPrimAtPath("/World/Eye") and opened.GetDefaultPrim().GetName() == "World"
    sky = opened.GetPrimAtPath("/World/Light").GetAttribute("inputs:texture:file").Get()
    assert sky.resolvedPath and not os.path.isabs(sky.path)


def test_picture_is_the_same(gl, stage, tmp_path):
    bake_stage(scene(tmp_path), tmp_path / "baked.usdz", size=512)
    options = {"camera": "Eye", "width": 160}
    before = fexel.render(str(scene(tmp_path)), **options)["color"]
    after = fexel.render(str(tmp_path / "baked.usdz"), **options)["color"]
    assert before[..., :3].max() > 0.09, "something is to be seen"
    assert np.abs(before - after).mean() < 0.0003


def test_umbrellas_become_explicit(gl, tmp_path):
    """A ground with its arrays in a layer of their own, and a roughness map of the same elements."""
    folder = tmp_path / "ground_textures"
    folder.mkdir()
    names = ("Oak", "Ash", "Lime")
    files = [f"./{folder.name}/{f}" for f in write_bases(folder, names, ground.textures(), [False] * 3).files]
    maps = [
        UmbrellaMap("Texture", "diffuseColor", tuple(files), background_color=(0.0, 0.0, 0.3, 1.0)),
        UmbrellaMap("Roughness", "roughness", tuple(files), "raw", has_colors=False),
    ]
    stage = create_stage(tmp_path / "ground.usda", folder, ground.arrangement(60), names, maps)
    stage.GetRootLayer().Save()
    baked = bake_stage(tmp_path / "ground.usda", tmp_path / "baked.usdz", size=512)
    assert [texture.prim.rsplit("/", 1)[1] for texture in baked] == ["Texture", "Roughness"]
    for texture in baked:
        assert texture.size == (512, pytest.approx(256, abs=1))
    result = Usd.Stage.Open(str(tmp_path / "baked.usdz"))
    assert {prim.GetTypeName() for prim in result.TraverseAll()} <= STANDARD
    before, after = (
        fexel.render(str(tmp_path / name), camera="Overview", width=128)["color"]
        for name in ("ground.usda", "baked.usdz")
    )
    assert np.abs(before - after).mean() < 0.01 < before[..., :3].std()


def test_size_is_that_of_the_longer_side_and_the_aspect_stays(stage, tmp_path):
    baked = bake_stage(scene(tmp_path), tmp_path / "a.usda", size=200)
    assert [texture.size for texture in baked] == [(200, 200)]
    write_image(tmp_path / "images" / "root.png", quadrants()[:32])
    (wide,) = bake_stage(scene(tmp_path), tmp_path / "b.usda", size=200)
    assert wide.size == (200, 100)
    (own,) = bake_stage(scene(tmp_path), tmp_path / "c.usda")
    assert own.size == (128, 64), "without a size as fine as the patch, whose texels are half as high as the root's"
    assert image_info(str(tmp_path / "c_textures" / own.file)).width == 128


@pytest.mark.parametrize(
    ("image_format", "dtype"), [("png", "uint8"), ("exr", "float16"), ("tif", "uint8"), ("jpg", "uint8")]
)
def test_formats(stage, tmp_path, image_format, dtype):
    (texture,) = bake_stage(scene(tmp_path), tmp_path / "a.usda", size=64, image_format=image_format)
    info = image_info(str(tmp_path / "a_textures" / texture.file))
    assert texture.file.endswith(f".{image_format}") and info.dtype == dtype
    result = Usd.Stage.Open(str(tmp_path / "a.usda"))
    prim = result.GetPrimAtPath(texture.prim)
    space = prim.GetAttribute("inputs:sourceColorSpace").Get()
    picture = read_linear(info.path, space)
    truth = read_linear(str(tmp_path / "images" / "root.png"))
    assert np.abs(picture[4, 4] - truth[4, 4]).max() < 0.02
    assert picture[32, 32, :3].min() > 0.95, "the patch in the middle"


def test_data_stay_raw_and_keep_their_scale(stage, tmp_path):
    texture = fexel.ZipmapTexture(stage.GetPrimAtPath("/World/Material/Texture"))
    for prim in (texture, fexel.ZipmapTexture(stage.GetPrimAtPath("/World/Material/Texture/Patch"))):
        prim.CreateSourceColorSpaceAttr("raw")
        prim.CreateScaleAttr(Gf.Vec4f(2, 2, 2, 1))
        prim.CreateBiasAttr(Gf.Vec4f(-1, -1, -1, 0))
    stage.GetRootLayer().Save()
    (baked,) = bake_stage(scene(tmp_path), tmp_path / "a.usda", size=64)
    result = Usd.Stage.Open(str(tmp_path / "a.usda"))
    prim = result.GetPrimAtPath(baked.prim)
    assert prim.GetAttribute("inputs:sourceColorSpace").Get() == "raw"
    assert prim.GetAttribute("inputs:scale").Get() == (2, 2, 2, 1)
    assert prim.GetAttribute("inputs:bias").Get() == (-1, -1, -1, 0)
    info = image_info(str(tmp_path / "a_textures" / baked.file))
    assert info.dtype == "uint16"
    assert read_linear(info.path, "raw")[4, 4, 0] == pytest.approx(220 / 255, abs=1e-3)


def test_one_texture_of_several(stage, tmp_path):
    """The other keeps its type and its patches."""
    other = fexel.ZipmapTexture.Define(stage, "/World/Material/Other")
    other.CreateFileAttr(Sdf.AssetPath("./images/patch.png"))
    stage.GetRootLayer().Save()
    baked = bake_stage(scene(tmp_path), tmp_path / "a.usda", size=32, prim="/World/Material/Other")
    assert [texture.prim for texture in baked] == ["/World/Material/Other"]
    result = Usd.Stage.Open(str(tmp_path / "a.usda"))
    assert result.GetPrimAtPath("/World/Material/Texture/Patch").GetTypeName() == "ZipmapTexture"
    assert Path(
        result.GetPrimAtPath("/World/Material/Texture").GetAttribute("inputs:file").Get().resolvedPath
    ).is_file()
    both = bake_stage(scene(tmp_path), tmp_path / "b.usda", size=32)
    assert len({texture.file for texture in both}) == 2


def test_coordinates_are_kept(stage, tmp_path):
    """A reader outside stays; one within the texture is made anew beside it; without one it is the primvar st."""
    texture = stage.GetPrimAtPath("/World/Material/Texture")

    def varname(place):
        if place:
            reader = UsdShade.Shader.Define(stage, place)
            reader.CreateIdAttr("UsdPrimvarReader_float2")
            reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("uv2")
            st = UsdShade.NodeGraph(texture).CreateInput("st", Sdf.ValueTypeNames.Float2)
            st.ConnectToSource(reader.CreateOutput("result", Sdf.ValueTypeNames.Float2))
        stage.GetRootLayer().Save()
        bake_stage(scene(tmp_path), tmp_path / "a.usda", size=16)
        result = Usd.Stage.Open(str(tmp_path / "a.usda"))
        shader = UsdShade.Shader(result.GetPrimAtPath("/World/Material/Texture"))
        source = shader.GetInput("st").GetConnectedSources()[0][0].source.GetPrim()
        assert UsdShade.Shader(source).GetShaderId() == "UsdPrimvarReader_float2"
        return source.GetPath().name, source.GetAttribute("inputs:varname").Get()

    assert varname("") == ("TextureSt", "st")
    assert varname("/World/Material/Texture/Inside") == ("TextureSt", "uv2")
    assert varname("/World/Material/Reader") == ("Reader", "uv2")


def test_what_is_only_declared_goes_too(stage, tmp_path):
    """Classes, inactive textures, applied schemas of fexel."""
    stage.CreateClassPrim("/Template").SetTypeName("UmbrellaTexture")
    fexel.ZipmapTexture.Define(stage, "/World/Material/Off").GetPrim().SetActive(False)
    reader = UsdShade.Shader.Define(stage, "/World/Material/Plain")
    reader.CreateIdAttr("UsdUVTexture")
    fexel.TextureMinificationAPI.Apply(reader.GetPrim())
    stage.GetRootLayer().Save()
    bake_stage(scene(tmp_path), tmp_path / "a.usda", size=16)
    text = (tmp_path / "a.usda").read_text()
    assert not any(word in text for word in ("UmbrellaTexture", "ZipmapTexture", "Minification", "minification"))
    assert "Plain" in text


def test_time_that_is_baked_can_be_chosen(stage, tmp_path):
    patch = fexel.ZipmapTexture(stage.GetPrimAtPath("/World/Material/Texture/Patch"))
    for frame, opacity in ((1, 0.0), (10, 1.0)):
        patch.CreateOpacityAttr().Set(opacity, frame)
    stage.GetRootLayer().Save()
    with pytest.warns(FexelWarning, match="/World/Material/Texture: varies over time; frame 1 is baked"):
        (first,) = bake_stage(scene(tmp_path), tmp_path / "a.usda", size=64)
    (last,) = bake_stage(scene(tmp_path), tmp_path / "b.usda", size=64, time=10)
    middle = [read_linear(str(tmp_path / f"{n}_textures" / t.file))[36, 36] for n, t in (("a", first), ("b", last))]
    assert middle[0][:3].max() < 0.5 < middle[1][:3].min()


def test_same_stage_makes_the_same_package_at_another_time(stage, tmp_path, move_clock):
    packages = []
    for _ in range(2):
        bake_stage(scene(tmp_path), tmp_path / "a.usdz", size=16)
        packages.append((tmp_path / "a.usdz").read_bytes())
        move_clock()
    assert packages[0] == packages[1]


def failure(*arguments):
    result = CliRunner().invoke(app, ["bake", *map(str, arguments)])
    assert isinstance(result.exception, FexelError), result.output
    assert "\n" not in str(result.exception)
    return str(result.exception)


def test_faults_are_named_in_one_line_and_leave_nothing(stage, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("broken.usda").write_text("#usda 1.0\ndef {")
    empty = Usd.Stage.CreateNew("empty.usda")
    empty.GetRootLayer().Save()
    before = sorted(p.name for p in tmp_path.iterdir())
    assert "missing.usda: no such file" in failure("missing.usda", "-o", "a.usda")
    assert failure("broken.usda", "-o", "a.usda").startswith("broken.usda")
    assert "empty.usda: has no fexel texture" in failure("empty.usda", "-o", "a.usda")
    assert "--size: 0" in failure("scene.usda", "-o", "a.usda", "--size", "0")
    assert "a.obj: output is '.obj', expected one of .usda, .usdc, .usd, .usdz" in failure("scene.usda", "-o", "a.obj")
    assert "expected one of png" in failure("scene.usda", "-o", "a.usda", "--format", "gif")
    assert "tif cannot go into" in failure("scene.usda", "-o", "a.usdz", "--format", "tif")
    assert "no such prim" in failure("scene.usda", "-o", "a.usda", "--prim", "/World/Nowhere")
    assert "--prim: 'x y'" in failure("scene.usda", "-o", "a.usda", "--prim", "x y")
    assert "is no fexel texture" in failure("scene.usda", "-o", "a.usda", "--prim", "/World/Quad")
    assert "part of one" in failure("scene.usda", "-o", "a.usda", "--prim", "/World/Material/Texture/Patch")
    assert "output is '.png'" in failure("scene.usda", "-o", "a.png")
    assert "does not exist" in failure("scene.usda", "-o", "nowhere/a.usdz")
    assert "is an input" in failure("scene.usda", "-o", "scene.usda")
    assert sorted(p.name for p in tmp_path.iterdir()) == before


def test_missing_images_are_told_and_baked_as_far_as_they_go(stage, tmp_path):
    (tmp_path / "images" / "patch.png").unlink()
    (tmp_path / "images" / "sky.png").unlink()
    with pytest.warns(FexelWarning) as warned:
        bake_stage(scene(tmp_path), tmp_path / "a.usda", size=64)
    told = " ".join(str(w.message) for w in warned)
    assert "patch.png" in told and "sky.png: no such file" in told


def test_command_prints_a_line_per_texture_and_overwrites_its_own_output(stage, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("baked.usdz", "baked.usda"):
        for size in (64, 32):
            result = CliRunner().invoke(app, ["bake", "scene.usda", "-o", name, "--size", str(size)])
            assert result.exit_code == 0, result.output
            assert result.output.startswith(f"/World/Material/Texture: Material_Texture.png, {size} x {size} pixels, ")
    assert len(zipfile.ZipFile("baked.usdz").namelist()) == 3
    assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]


def test_colour_beside_a_normal_map_is_the_same_as_alone(gl, tmp_path):
    """Vectors turn with their umbrella; colours of the same material do not."""
    pictures = []
    for companions in (False, True):
        folder = tmp_path / f"ground{companions}_textures"
        folder.mkdir()
        names = ("Oak", "Ash", "Lime")
        files = [f"./{folder.name}/{f}" for f in write_bases(folder, names, ground.textures(), [False] * 3).files]
        maps = [UmbrellaMap("Texture", "emissiveColor", tuple(files), background_color=(0.0, 0.0, 0.3, 1.0))]
        if companions:
            maps.append(UmbrellaMap("Normal", "normal", tuple(files), "raw", is_biased=True, has_colors=False))
        path = tmp_path / f"ground{companions}.usda"
        stage = create_stage(path, folder, ground.arrangement(60), names, maps)
        for light in ("Light", "Sun"):
            stage.RemovePrim(f"/World/{light}")
        UsdLux.DomeLight.Define(stage, "/World/Dark").CreateIntensityAttr(0.0)
        stage.GetRootLayer().Save()
        pictures.append(fexel.render(str(path), camera="Overview", width=96, aovs=("color",))["color"])
    assert np.abs(pictures[0] - pictures[1]).max() < 0.01 < pictures[0][..., :3].std()
