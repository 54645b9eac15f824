"""What the scripts of the minification stages share: filters as variants, flat meshes, cameras that move."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from pxr import Gf, Usd, UsdGeom

import fexel
from fexel.filters import PORTABLE_FILTERS

__all__ = ["FRAMES", "add_filter_variants", "add_moving_camera", "texture_file_of"]

FRAMES = (1, 48)
_SET = "filter"  # of /World

Pose = tuple[Sequence[float], Sequence[float], float]  # eye, target, width seen at the target


def add_filter_variants(stage: Usd.Stage, texture: str, selected: str = "fipmap") -> fexel.TextureMinificationAPI:
    """Apply TextureMinificationAPI to a texture; which filter it names is a variant of the default prim."""
    api = fexel.TextureMinificationAPI.Apply(stage.GetPrimAtPath(texture))
    variants = stage.GetDefaultPrim().GetVariantSets().AddVariantSet(_SET)
    for token in PORTABLE_FILTERS:
        variants.AddVariant(token)
        variants.SetVariantSelection(token)
        with variants.GetVariantEditContext():
            api.CreateFilterAttr(token)
    variants.SetVariantSelection(selected)
    return api


def texture_file_of(stage: Usd.Stage, texture: str) -> str:
    """Where the image of a texture lies."""
    return stage.GetPrimAtPath(texture).GetAttribute("inputs:file").Get().resolvedPath


def add_moving_camera(stage: Usd.Stage, name: str, poses: Iterable[Pose], aspect: float) -> UsdGeom.Camera:
    """A camera with y up that has a pose per frame of `FRAMES`; at the default time it stands where it starts."""
    camera = UsdGeom.Camera.Define(stage, f"/World/Cameras/{name}")
    camera.CreateHorizontalApertureAttr(24.0)
    camera.CreateVerticalApertureAttr(24.0 / aspect)
    focal, focus, clipping = (
        camera.CreateFocalLengthAttr(), camera.CreateFocusDistanceAttr(), camera.CreateClippingRangeAttr(),
    )  # fmt: skip
    transform = camera.AddTransformOp()
    for frame, (eye, target, width) in enumerate(poses, FRAMES[0]):
        distance = float(np.linalg.norm(np.subtract(target, eye)))
        world_to_camera = Gf.Matrix4d().SetLookAt(Gf.Vec3d(*eye), Gf.Vec3d(*target), Gf.Vec3d(0, 1, 0))
        for time in [Usd.TimeCode.Default()] * (frame == FRAMES[0]) + [Usd.TimeCode(frame)]:
            transform.Set(world_to_camera.GetInverse(), time)
            focal.Set(24.0 * distance / width, time)
            focus.Set(distance, time)
            clipping.Set(Gf.Vec2f(distance / 50, distance * 50), time)
    stage.SetStartTimeCode(FRAMES[0])
    stage.SetEndTimeCode(FRAMES[1])
    return camera
