"""Parts that the example stages have in common: an even light, a wall, a material, cameras that zoom in.

The scripts ``stages/<name>/make.py`` build the stages from them; nothing here is needed to open a stage.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, Vt

import fexel

__all__ = [
    "add_even_light",
    "add_image_material",
    "add_matt_surface",
    "add_scopes",
    "add_wall",
    "add_zipmap_material",
    "add_zoom_camera",
    "new_stage",
    "save",
    "write_png",
]

FOCAL_LENGTH = 24.0  # with an aperture as wide, a camera at distance d sees a width of d


def new_stage(path: Path, comment: str) -> Usd.Stage:
    """An empty stage, y up, metres, default prim ``/World``, in a hidden file that `save` renames to `path`.

    `comment` becomes the layer's documentation.
    """
    layer = Sdf.Layer.CreateNew(str(_part(path)))
    if not layer:
        raise fexel.FexelError(f"{path}: could not be created")
    stage = Usd.Stage.Open(layer)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    world = UsdGeom.Xform.Define(stage, "/World")
    Usd.ModelAPI(world).SetKind("component")
    stage.SetDefaultPrim(world.GetPrim())
    layer.documentation = comment
    return stage


def save(stage: Usd.Stage, path: Path) -> None:
    """Write the stage of `new_stage` as `path`, with its fallback types; asset paths are relative to it already."""
    stage.WriteFallbackPrimTypes()
    stage.GetRootLayer().Save()
    _part(path).replace(path)


def _part(path: Path) -> Path:
    return path.with_name(f".{path.name}")


def add_scopes(stage: Usd.Stage) -> None:
    """The scopes that hold materials, cameras and lights, in that order."""
    for scope in ("Materials", "Cameras", "Lights"):
        UsdGeom.Scope.Define(stage, f"/World/{scope}")


def add_even_light(stage: Usd.Stage) -> None:
    """A white dome of radiance 1, under which a matt surface shows its own colour."""
    dome = UsdLux.DomeLight.Define(stage, "/World/Lights/Even")
    dome.CreateIntensityAttr(1.0)


def add_wall(
    stage: Usd.Stage,
    width: float,
    height: float,
    material: UsdShade.Material,
    path: str = "/World/Wall",
    center: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> UsdGeom.Mesh:
    """A rectangle about `center`, facing +z, st over [0,1]^2."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    low, high = np.array(center) - (width / 2, height / 2, 0), np.array(center) + (width / 2, height / 2, 0)
    corners = np.array([low, (high[0], low[1], low[2]), high, (low[0], high[1], low[2])], np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(corners))
    mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(corners[[0, 2]]))
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateNormalsAttr([(0, 0, 1)] * 4)
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    add_st(mesh, np.array([(0, 0), (1, 0), (1, 1), (0, 1)]))
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    return mesh


def add_st(mesh: UsdGeom.Mesh, st: np.ndarray) -> None:
    """Author ``primvars:st``, one (s, t) per point."""
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    primvar.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(st, np.float32)))


def add_matt_surface(
    stage: Usd.Stage, path: str, roughness: float = 1.0, ior: float = 1.0
) -> tuple[UsdShade.Material, UsdShade.Shader]:
    """A material at `path` and its UsdPreviewSurface.

    With an index of refraction of 1 nothing is reflected specularly: under an even light the texture shows as it is.
    """
    material = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, f"{path}/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(roughness)
    surface.CreateInput("ior", Sdf.ValueTypeNames.Float).Set(ior)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    return material, surface


def add_image_material(stage: Usd.Stage, path: str, file: str) -> UsdShade.Material:
    """A matt surface that shows an image, read by a UsdUVTexture."""
    material, surface = add_matt_surface(stage, path)
    reader = UsdShade.Shader.Define(stage, f"{path}/St")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    image = UsdShade.Shader.Define(stage, f"{path}/Image")
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(file))
    st = image.CreateInput("st", Sdf.ValueTypeNames.Float2)
    st.ConnectToSource(reader.CreateOutput("result", Sdf.ValueTypeNames.Float2))
    for wrap in ("wrapS", "wrapT"):
        image.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("clamp")
    color = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    color.ConnectToSource(image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
    return material


def add_zipmap_material(
    stage: Usd.Stage, path: str, roughness: float = 1.0, ior: float = 1.0
) -> tuple[UsdShade.Material, fexel.ZipmapTexture]:
    """A matt surface whose diffuseColor is a ZipmapTexture, both below `path`."""
    material, surface = add_matt_surface(stage, path, roughness, ior)
    zipmap = fexel.ZipmapTexture.Define(stage, f"{path}/Texture")
    color = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    color.ConnectToSource(zipmap.ConnectableAPI(), "rgb")
    return material, zipmap


def add_zoom_camera(
    stage: Usd.Stage,
    path: str,
    target: tuple[float, float],
    widths: tuple[float, float],
    frames: tuple[int, int] = (1, 48),
    aspect: float = 1.0,
) -> UsdGeom.Camera:
    """A camera before the plane z = 0; the width it sees goes from one of `widths` to the other at a constant rate.

    It keeps `target` (x, y) fixed in the picture once it is centred: the centre moves from the origin to the target in
    proportion to the width seen, so that the path stays inside the wall. Equal widths make a still camera, looking at
    the target. The clipping distances follow the distance. At the default time the camera stands where it starts.
    """
    camera = UsdGeom.Camera.Define(stage, path)
    camera.CreateFocalLengthAttr(FOCAL_LENGTH)
    camera.CreateHorizontalApertureAttr(FOCAL_LENGTH)
    camera.CreateVerticalApertureAttr(FOCAL_LENGTH / aspect)
    translate = camera.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble)
    clipping = camera.CreateClippingRangeAttr()
    first, last = frames
    start, end = widths
    still = start == end
    for frame in [first] if still else range(first, last + 1):
        width = start * (end / start) ** ((frame - first) / (last - first))
        share = 1.0 if still else (start - width) / (start - end)
        for time in [Usd.TimeCode.Default()] * (frame == first) + [Usd.TimeCode(frame)] * (not still):
            translate.Set(Gf.Vec3d(target[0] * share, target[1] * share, width), time)
            clipping.Set(Gf.Vec2f(width / 4, width * 4), time)
    if not still:
        stage.SetStartTimeCode(first)
        stage.SetEndTimeCode(last)
    return camera


def write_png(path: Path, pixels: np.ndarray) -> None:
    """Write (H, W, 3 or 4) uint8, sRGB-encoded, straight alpha."""
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, oiio.UINT8)
    spec.attribute("oiio:ColorSpace", "sRGB")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.attribute("png:compressionLevel", 9)
    path.parent.mkdir(parents=True, exist_ok=True)
    output = oiio.ImageOutput.create(str(path))
    if not (output and output.open(str(path), spec) and output.write_image(pixels) and output.close()):
        raise fexel.FexelError(f"{path}: could not be written: {output.geterror() if output else 'no such format'}")
