"""Contrast and brightness of textures in baked stages and in fallbacks: as scale and bias, so that nothing is lost."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

import fexel
from fexel.errors import FexelWarning
from fexel_tools.bake import bake_stage
from fexel_tools.fallback import write_fallback
from fexel_tools.image_files import write_image

CONTRAST, BRIGHTNESS = 1.75, -0.375  # leaves [0, 1] on both sides


@pytest.fixture
def stage(tmp_path):
    """Two quads that emit: a zipmap and a plain UsdUVTexture with a scale, both with contrast and brightness."""
    ramp = np.broadcast_to(np.linspace(0, 255, 64).round().astype(np.uint8), (64, 64))
    write_image(tmp_path / "image.png", np.stack([ramp, ramp.T, ramp[:, ::-1]], axis=-1))
    stage = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    for x, name in ((-1, "Zipmap"), (1, "Plain")):
        _quad(stage, x, name)
    camera = UsdGeom.Camera.Define(stage, "/World/Eye")
    camera.AddTranslateOp().Set((0, 0, 5))
    stage.WriteFallbackPrimTypes()
    stage.Save()
    return stage


def _quad(stage, x, name):
    material = UsdShade.Material.Define(stage, f"/World/{name}")
    surface = UsdShade.Shader.Define(stage, f"/World/{name}/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(0))
    surface.CreateInput("useSpecularWorkflow", Sdf.ValueTypeNames.Int).Set(1)
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    prim = stage.DefinePrim(f"/World/{name}/Texture", "ZipmapTexture" if name == "Zipmap" else "Shader")
    if name == "Plain":
        shader = UsdShade.Shader(prim)
        shader.CreateIdAttr("UsdUVTexture")
        shader.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(0.5, 0.75, 1, 1))
        reader = UsdShade.Shader.Define(stage, f"/World/{name}/St")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        st = shader.CreateInput("st", Sdf.ValueTypeNames.Float2)
        st.ConnectToSource(reader.CreateOutput("result", Sdf.ValueTypeNames.Float2))
    for attribute, kind, value in (
        ("file", Sdf.ValueTypeNames.Asset, "./image.png"),
        ("wrapS", Sdf.ValueTypeNames.Token, "clamp"),
        ("wrapT", Sdf.ValueTypeNames.Token, "clamp"),
    ):
        UsdShade.ConnectableAPI(prim).CreateInput(attribute, kind).Set(value)
    output = UsdShade.ConnectableAPI(prim).CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    surface.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(output)
    api = fexel.TextureMinificationAPI.Apply(prim)
    api.CreateContrastAttr(CONTRAST)
    api.CreateBrightnessAttr(BRIGHTNESS)
    mesh = UsdGeom.Mesh.Define(stage, f"/World/{name}Quad")
    mesh.CreatePointsAttr([(x - 0.9, -0.9, 0), (x + 0.9, -0.9, 0), (x + 0.9, 0.9, 0), (x - 0.9, 0.9, 0)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr("none")
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    primvar.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def picture(stage):
    return fexel.render(str(stage), camera="Eye", width=64, height=48, samples=1, camera_light=False)["color"]


def test_baked_stage_shows_the_same_beyond_0_and_1(gl, stage, tmp_path):
    bake_stage(tmp_path / "scene.usda", tmp_path / "baked.usda")
    text = (tmp_path / "baked.usda").read_text()
    assert "inification" not in text
    before, after = picture(tmp_path / "scene.usda"), picture(tmp_path / "baked.usda")
    assert before[..., :3].min() < -0.3 and before[..., :3].max() > 1.2
    np.testing.assert_allclose(after, before, atol=6e-3)


def test_fallback_has_the_contrast_in_its_scale(stage, tmp_path):
    prim = stage.GetPrimAtPath("/World/Zipmap/Texture")
    write_fallback(prim, tmp_path / "fallback.png", size=16)
    inner = UsdShade.Shader(stage.GetPrimAtPath("/World/Zipmap/Texture/Fallback"))
    np.testing.assert_allclose(inner.GetInput("scale").Get(), [CONTRAST, CONTRAST, CONTRAST, 1.0])
    np.testing.assert_allclose(inner.GetInput("bias").Get(), [BRIGHTNESS, BRIGHTNESS, BRIGHTNESS, 0.0])


def test_fade_with_distance_cannot_be_baked_and_that_is_said(stage, tmp_path):
    stage.GetPrimAtPath("/World/Zipmap/Texture").GetAttribute("minification:attenuationDistance").Set(3.0)
    stage.Save()
    with pytest.warns(FexelWarning, match="/World/Zipmap/Texture: a picture cannot fade with distance"):
        bake_stage(tmp_path / "scene.usda", tmp_path / "baked.usda")


def test_texture_without_contrast_keeps_its_network(stage, tmp_path):
    for name in ("Zipmap", "Plain"):
        for attribute in ("contrast", "brightness"):
            stage.GetPrimAtPath(f"/World/{name}/Texture").GetAttribute(f"minification:{attribute}").Clear()
    stage.Save()
    with warnings.catch_warnings():
        warnings.simplefilter("error", FexelWarning)
        bake_stage(tmp_path / "scene.usda", tmp_path / "baked.usda")
    baked = Usd.Stage.Open(str(tmp_path / "baked.usda"))
    assert not UsdShade.Shader(baked.GetPrimAtPath("/World/Zipmap/Texture")).GetInput("bias")
    plain = UsdShade.Shader(baked.GetPrimAtPath("/World/Plain/Texture"))
    assert plain.GetInput("scale").Get() == Gf.Vec4f(0.5, 0.75, 1, 1) and not plain.GetInput("bias")
