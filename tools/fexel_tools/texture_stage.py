"""What the stages that the tools author have in common, whatever the kind of texture.

::

    /World                       default prim
      Materials/<Kind>           Material with its UsdPreviewSurface, `Surface`; the texture prim beside it, `Texture`
      Surface                    what the material is bound to
      Cameras/<Name>             the first one is what renderers take when none is named

The kind's own module (`zipmap_stage`, `pinchmap_stage`) adds the texture prim and connects it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

from fexel_tools.framing import Pose
from fexel_tools.geometry import Surface, define_surface

__all__ = ["MATERIALS", "begin_stage", "define_preview_surface", "finish_stage"]

MATERIALS = "/World/Materials"
_FLOATS = Sdf.ValueTypeNames.Float


def begin_stage(path: Path, surface: Surface) -> Usd.Stage:
    """Create a stage with the surface's axis and unit, and the prims that hold everything else.

    Parameters
    ----------
    path : Path
        File to create, ``.usd``, ``.usda`` or ``.usdc``.
    surface : Surface
    """
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, surface.up_axis)
    UsdGeom.SetStageMetersPerUnit(stage, surface.meters_per_unit)
    world = UsdGeom.Xform.Define(stage, "/World")
    stage.SetDefaultPrim(world.GetPrim())
    Usd.ModelAPI(world.GetPrim()).SetKind("component")
    UsdGeom.Scope.Define(stage, MATERIALS)
    return stage


def define_preview_surface(stage: Usd.Stage, name: str, **values: float) -> tuple[UsdShade.Material, UsdShade.Shader]:
    """Author a material whose surface is a UsdPreviewSurface.

    Parameters
    ----------
    stage : Usd.Stage
    name : str
        Of the material.
    **values : float
        Inputs of the surface, such as ``roughness=1.0``.

    Returns
    -------
    (UsdShade.Material, UsdShade.Shader)
        The material and the surface, to connect textures to.
    """
    material = UsdShade.Material.Define(stage, f"{MATERIALS}/{name}")
    shader = UsdShade.Shader.Define(stage, f"{MATERIALS}/{name}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    for key, value in values.items():
        shader.CreateInput(key, _FLOATS).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return material, shader


def finish_stage(
    stage: Usd.Stage,
    surface: Surface,
    material: UsdShade.Material,
    cameras: dict[str, list[Pose]],
    aspect: float,
) -> None:
    """Author surface and cameras, and declare what fexel's prims are to applications without the plugin.

    Parameters
    ----------
    stage : Usd.Stage
        From `begin_stage`. It is not saved.
    surface : Surface
    material : UsdShade.Material
    cameras : dict of str to list of (frame, camera to world, distance)
        From `fexel_tools.framing`; one entry with frame NaN is a camera that does not move.
    aspect : float
        Width over height of the pictures.
    """
    define_surface(stage, "/World/Surface", surface, material)
    UsdGeom.Scope.Define(stage, "/World/Cameras")
    for name, poses in cameras.items():
        _define_camera(stage, f"/World/Cameras/{name}", poses, aspect)
    stage.WriteFallbackPrimTypes()


def _define_camera(stage: Usd.Stage, path: str, poses: list[Pose], aspect: float) -> None:
    camera = UsdGeom.Camera.Define(stage, path)
    camera.CreateFocalLengthAttr(50.0)
    camera.CreateHorizontalApertureAttr(36.0)
    camera.CreateVerticalApertureAttr(36.0 / aspect)
    transform = camera.AddTransformOp()
    clipping, focus = camera.CreateClippingRangeAttr(), camera.CreateFocusDistanceAttr()
    for k, (frame, matrix, distance) in enumerate(poses):
        times = [Usd.TimeCode(frame)] if np.isfinite(frame) else [Usd.TimeCode.Default()]
        if k == 0 and np.isfinite(frame):
            times.append(Usd.TimeCode.Default())
        for time in times:
            transform.Set(matrix, time)
            clipping.Set(Gf.Vec2f(0.02 * distance, 100.0 * distance + 1e3), time)
            focus.Set(distance, time)
