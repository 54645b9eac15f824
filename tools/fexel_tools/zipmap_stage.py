"""A zipmap as a USD stage: nested texture prims, a material, a surface to see it on, and cameras.

::

    /World                       default prim
      Surface                    quad, sphere, cylinder or mesh with `st`, bound to the material
      Materials/Zipmap           Material; UsdPreviewSurface.diffuseColor <- Texture.outputs:rgb
        Texture                  ZipmapTexture, the root; nested below it one ZipmapTexture per patch
      Cameras/Zoom               from Overview to Detail over frames 1 to 48, magnification growing by a constant factor
      Cameras/Overview, Detail   the whole surface; the sharpest patch filling the frame

Zoom comes first, so it is the camera that renderers take when none is named; at the default time it stands at Overview.

Conventions: matrices here are 3x3 float64 for column vectors on pixel coordinates; what goes into ``inputs:matrix`` is
parent to child in st for row vectors, scaled to w = 1 at the patch's centre.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdShade

import fexel
from fexel_tools.consistency import apply_homography
from fexel_tools.framing import Pose
from fexel_tools.geometry import Surface
from fexel_tools.texture_stage import MATERIALS, begin_stage, define_preview_surface, finish_stage

__all__ = ["FRAMES", "TEXTURE_PATH", "PatchPrim", "create_stage", "st_from_pixels", "st_matrix"]

FRAMES = (1, 48)
TEXTURE_PATH = f"{MATERIALS}/Zipmap/Texture"
_FRAMES_PER_SECOND = 24.0


@dataclass(frozen=True)
class PatchPrim:
    """One texture of the nest.

    Attributes
    ----------
    name : str
        Prim name, unique among all.
    parent : str
        Name of the patch above it, '' for the root texture.
    file : str
        Texture, relative to the stage.
    source_color_space : str
        ``sRGB`` or ``raw``.
    parent_to_child : (3, 3) float64
        For ``inputs:matrix``: st of the parent to st of this patch, row vectors.
    mask : str
        Artist's mask, relative to the stage; '' for none.
    opacity : float
    source : str
        Name of the photo it was made from.
    """

    name: str
    parent: str
    file: str
    source_color_space: str
    parent_to_child: np.ndarray = field(default_factory=lambda: np.eye(3))
    mask: str = ""
    opacity: float = 1.0
    source: str = ""


def st_from_pixels(window: tuple[float, float, float, float]) -> np.ndarray:
    """(3, 3) column vectors: pixels of a photo to st of its part `window` (x0, y0, x1, y1)."""
    x0, y0, x1, y1 = window
    width, height = x1 - x0, y1 - y0
    return np.array([[1.0 / width, 0.0, -x0 / width], [0.0, -1.0 / height, 1.0 + y0 / height], [0.0, 0.0, 1.0]])


def st_matrix(parent_st_from_root: np.ndarray, child_st_from_root: np.ndarray) -> np.ndarray:
    """Parent to child in st for row vectors, from column-vector maps of root pixels; w = 1 at the child's centre."""
    parent_from_child = parent_st_from_root @ np.linalg.inv(child_st_from_root)
    centre = parent_from_child @ np.array([0.5, 0.5, 1.0])
    child_from_parent = np.linalg.inv(parent_from_child)
    return (child_from_parent / (child_from_parent[2] @ (centre / centre[2]))).T


def create_stage(
    path: Path,
    root: PatchPrim,
    patches: list[PatchPrim],
    surface: Surface,
    cameras: dict[str, list[Pose]],
    aspect: float,
) -> Usd.Stage:
    """Author everything but the fallback.

    Parameters
    ----------
    path : Path
        File to create, ``.usd``, ``.usda`` or ``.usdc``.
    root : PatchPrim
    patches : list of PatchPrim
        Parents before children, in draw order among siblings.
    surface : Surface
    cameras : dict of str to list of (frame, camera to world, distance)
        From `fexel_tools.framing`; one entry with frame NaN is a camera that does not move.
    aspect : float
        Width over height of the pictures.
    """
    stage = begin_stage(path, surface)
    stage.SetTimeCodesPerSecond(_FRAMES_PER_SECOND)
    stage.SetFramesPerSecond(_FRAMES_PER_SECOND)
    stage.SetStartTimeCode(FRAMES[0])
    stage.SetEndTimeCode(FRAMES[1])
    material = _define_material(stage, root, patches, surface)
    finish_stage(stage, surface, material, cameras, aspect)
    return stage


def _define_material(
    stage: Usd.Stage, root: PatchPrim, patches: list[PatchPrim], surface: Surface
) -> UsdShade.Material:
    material, shader = define_preview_surface(stage, "Zipmap", roughness=1.0, metallic=0.0)
    texture = _define_texture(stage, TEXTURE_PATH, root)
    texture.GetPrim().GetAttribute("inputs:wrapS").Set(surface.wrap[0])
    texture.GetPrim().GetAttribute("inputs:wrapT").Set(surface.wrap[1])
    diffuse = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    diffuse.ConnectToSource(texture.CreateOutput("rgb", Sdf.ValueTypeNames.Color3f))
    paths = {"": TEXTURE_PATH}
    for patch in patches:
        paths[patch.name] = f"{paths[patch.parent]}/{patch.name}"
        _define_texture(stage, paths[patch.name], patch)
    return material


def _define_texture(stage: Usd.Stage, path: str, patch: PatchPrim) -> fexel.ZipmapTexture:
    texture = fexel.ZipmapTexture.Define(stage, path)
    prim = texture.GetPrim()
    texture.CreateFileAttr(Sdf.AssetPath(patch.file))
    texture.CreateSourceColorSpaceAttr(patch.source_color_space)
    if path != TEXTURE_PATH:
        texture.CreateMatrixAttr(Gf.Matrix3d(*patch.parent_to_child.ravel().tolist()))
    if patch.mask:
        texture.CreateMaskAttr(Sdf.AssetPath(patch.mask))
    if patch.opacity != 1.0:
        texture.CreateOpacityAttr(patch.opacity)
    if patch.source:
        prim.SetCustomDataByKey("fexel:source", patch.source)
    return texture


def outline_in_root(window: tuple[int, int, int, int], root_from_photo: np.ndarray) -> np.ndarray:
    """(4, 2) corners of a window of a photo in root pixels."""
    x0, y0, x1, y1 = window
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], np.float64)
    return apply_homography(root_from_photo, corners)
