"""Small stages for the tests of the command and of textured rendering."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

__all__ = ["preview_material", "textured_quad", "two_camera_stage", "write_image"]


def write_image(path: Path, pixels: np.ndarray, pixel_type: str = "uint8") -> Path:
    """Write (H, W, C) pixels as they are."""
    import OpenImageIO as oiio

    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], pixel_type)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    writer = oiio.ImageOutput.create(str(path))
    assert writer.open(str(path), spec) and writer.write_image(np.ascontiguousarray(pixels)) and writer.close()
    return path


def two_camera_stage(path: Path) -> Usd.Stage:
    """A red cube that moves right by its time code / 10; a near and a far camera; times 1 to 4."""
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(4)
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    cube = UsdGeom.Cube.Define(stage, "/World/Cube")
    cube.CreateDisplayColorAttr([Gf.Vec3f(1, 0, 0)])
    move = cube.AddTranslateOp()
    for time in range(1, 5):
        move.Set(Gf.Vec3d(time / 10, 0, 0), time)
    for name, distance in (("Near", 6.0), ("Far", 30.0)):
        camera = UsdGeom.Camera.Define(stage, f"/World/Cameras/{name}")
        camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, distance))
        camera.CreateHorizontalApertureAttr(24.0)
        camera.CreateVerticalApertureAttr(12.0)
        camera.CreateFocalLengthAttr(24.0)
        camera.CreateClippingRangeAttr(Gf.Vec2f(0.1, 100))
    stage.Save()
    return stage


def preview_material(
    stage: Usd.Stage, path: str, textures: dict[str, tuple[str, str, dict]], **constants
) -> UsdShade.Material:
    """UsdPreviewSurface; `textures`: input to (file, output, further inputs of UsdUVTexture)."""
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    reader = UsdShade.Shader.Define(stage, f"{path}/St")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    st = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    kinds = {"float": Sdf.ValueTypeNames.Float, "tuple": Sdf.ValueTypeNames.Color3f, "int": Sdf.ValueTypeNames.Int}
    for name, value in constants.items():
        shader.CreateInput(name, kinds[type(value).__name__]).Set(
            Gf.Vec3f(*value) if isinstance(value, tuple) else value
        )
    for name, (file, output, more) in textures.items():
        texture = UsdShade.Shader.Define(stage, f"{path}/{name}")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(st)
        for key, value in more.items():
            kind = Sdf.ValueTypeNames.Token if isinstance(value, str) else Sdf.ValueTypeNames.Float4
            texture.CreateInput(key, kind).Set(value if isinstance(value, str) else Gf.Vec4f(*value))
        kind = Sdf.ValueTypeNames.Float3 if output == "rgb" else Sdf.ValueTypeNames.Float
        shader.CreateInput(name, kind).ConnectToSource(texture.CreateOutput(output, kind))
    return material


def textured_quad(
    path: Path, textures: dict[str, tuple[str, str, dict]], width=2.0, height=2.0, **constants
) -> Usd.Stage:
    """A quad that fills an orthographic camera's picture exactly, with st over [0, 1]^2."""
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    mesh = UsdGeom.Mesh.Define(stage, "/World/Quad")
    x, y = width / 2, height / 2
    mesh.CreatePointsAttr([Gf.Vec3f(-x, -y, 0), Gf.Vec3f(x, -y, 0), Gf.Vec3f(x, y, 0), Gf.Vec3f(-x, y, 0)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr("none")
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([Gf.Vec2f(0, 0), Gf.Vec2f(1, 0), Gf.Vec2f(1, 1), Gf.Vec2f(0, 1)])
    material = preview_material(stage, "/World/Material", textures, **constants)
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.AddTranslateOp().Set(Gf.Vec3d(0, 0, 5))
    camera.CreateProjectionAttr("orthographic")
    camera.CreateHorizontalApertureAttr(width * 10)  # tenths of a world unit
    camera.CreateVerticalApertureAttr(height * 10)
    camera.CreateClippingRangeAttr(Gf.Vec2f(1, 10))
    stage.Save()
    return stage
