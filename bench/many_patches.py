"""A stage of ten thousand patches, and a camera that sees exactly five of them: input of the end-to-end benchmarks.

Every patch is a file of its own; the files are hard links to a few images, so that making them takes seconds while a
renderer cannot know it.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, Vt

import fexel

__all__ = ["CAMERA", "IN_VIEW", "write_stage"]

CAMERA = "/World/Cameras/Five"
IN_VIEW = 5
_DISTINCT_IMAGES = 16
_TEXTURE_PX = 64
_ROOT_PX = 1024
_SHARE = 0.7  # of its cell that a patch is wide; half of the root is covered
_SEED = 20100504


def write_stage(folder: Path, count: int = 10_000, suffix: str = "usdc") -> Path:
    """Write textures and stage; returns the path of the stage.

    The wall is 1 x 1 at z = 0. The patches stand on a square grid, odd rows shifted by half a cell, none overlapping.
    """
    rng = np.random.default_rng(_SEED)
    (folder / "textures").mkdir(parents=True, exist_ok=True)
    _write_textures(folder / "textures", count, rng)
    side = math.ceil(math.sqrt(count))
    corners = _corners(count, side)
    stage = Usd.Stage.CreateNew(str(folder / f"many.{suffix}"))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    material = _add_material(stage, corners, _SHARE / side)
    _add_wall(stage, material)
    UsdLux.DomeLight.Define(stage, "/World/Light")
    _add_camera(stage, corners, _SHARE / side, rng)
    stage.WriteFallbackPrimTypes()
    stage.Save()
    return folder / f"many.{suffix}"


def _corners(count: int, side: int) -> np.ndarray:
    """Lower left corner of every patch in the root's st, (count, 2)."""
    row, column = np.divmod(np.arange(count), side)
    shift = np.where(row % 2, 0.25, 0.0)
    return np.column_stack([column + shift + 0.025, row + 0.15]) / side


def _write_textures(folder: Path, count: int, rng: np.random.Generator) -> None:
    _write(folder / "root.png", rng.integers(60, 200, (_ROOT_PX, _ROOT_PX, 3), np.uint8))
    ramp = np.minimum(np.arange(_TEXTURE_PX), np.arange(_TEXTURE_PX)[::-1]) / 6.0
    alpha = np.round(255 * np.minimum(1.0, np.minimum.outer(ramp, ramp))).astype(np.uint8)
    for index in range(count):
        path = folder / f"patch_{index:05d}.png"
        if index < _DISTINCT_IMAGES:
            pixels = rng.integers(0, 256, (_TEXTURE_PX, _TEXTURE_PX, 3), np.uint8)
            _write(path, np.dstack([pixels, alpha]))
        else:
            path.hardlink_to(folder / f"patch_{index % _DISTINCT_IMAGES:05d}.png")


def _write(path: Path, pixels: np.ndarray) -> None:
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.UINT8)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    output = oiio.ImageOutput.create(str(path))
    if not (output.open(str(path), spec) and output.write_image(pixels) and output.close()):
        raise OSError(f"{path}: {output.geterror()}")


def _add_material(stage: Usd.Stage, corners: np.ndarray, width: float) -> UsdShade.Material:
    material = UsdShade.Material.Define(stage, "/World/Materials/Wall")
    surface = UsdShade.Shader.Define(stage, "/World/Materials/Wall/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    root = fexel.ZipmapTexture.Define(stage, "/World/Materials/Wall/Texture")
    root.CreateFileAttr(Sdf.AssetPath("./textures/root.png"))
    diffuse = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    diffuse.ConnectToSource(root.ConnectableAPI(), "rgb")
    with Sdf.ChangeBlock():  # prim specs at once: defining 10,000 prims one by one recomposes as often
        layer = stage.GetRootLayer()
        for index, (s, t) in enumerate(corners):
            path = root.GetPath().AppendChild(f"Patch{index:05d}")
            spec = Sdf.CreatePrimInLayer(layer, path)
            spec.specifier, spec.typeName = Sdf.SpecifierDef, "ZipmapTexture"
            file = Sdf.AttributeSpec(spec, "inputs:file", Sdf.ValueTypeNames.Asset)
            file.default = Sdf.AssetPath(f"./textures/patch_{index:05d}.png")
            matrix = Sdf.AttributeSpec(spec, "inputs:matrix", Sdf.ValueTypeNames.Matrix3d)
            matrix.default = Gf.Matrix3d(1 / width, 0, 0, 0, 1 / width, 0, -s / width, -t / width, 1)
    return material


def _add_wall(stage: Usd.Stage, material: UsdShade.Material) -> None:
    mesh = UsdGeom.Mesh.Define(stage, "/World/Wall")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    mesh.CreateExtentAttr([(0, 0, 0), (1, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    st.Set(Vt.Vec2fArray([(0, 0), (1, 0), (1, 1), (0, 1)]))
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def _add_camera(stage: Usd.Stage, corners: np.ndarray, width: float, rng: np.random.Generator) -> None:
    """Find a square window that touches exactly `IN_VIEW` patches, by drawing centres until one does."""
    view = 2.6 * width
    while True:
        low = rng.uniform(0.2, 0.8, 2)
        seen = ((corners < low + view) & (corners + width > low)).all(axis=1)
        if np.count_nonzero(seen) == IN_VIEW:
            break
    camera = UsdGeom.Camera.Define(stage, CAMERA)
    camera.CreateFocalLengthAttr(24.0)
    camera.CreateHorizontalApertureAttr(24.0)
    camera.CreateVerticalApertureAttr(24.0)
    camera.CreateClippingRangeAttr((view / 10, view * 10))
    camera.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*(low + view / 2), view))
