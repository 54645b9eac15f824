"""A pinchmap as a USD stage: texture prim, material, a quad of the picture's aspect to see it on, and cameras.

::

    /World                       default prim
      Materials/Pinchmap         Material; Surface.inputs:diffuseColor, or what is driven <- Texture.outputs:rgb
        Texture                  PinchmapTexture; the fallback network goes inside (`fexel_tools.fallback`)
      Surface                    quad of height 1
      Cameras/Overview           the whole, hence what is rendered when no camera is named
      Cameras/Detail             a few texels of the pinchmap, where its lines are busiest

Alpha goes to ``inputs:opacity`` without an ``opacityThreshold``: the pinchmap's own anti-aliasing is a partial alpha
one pixel wide, which blends; a threshold would cut it back to stairs. A matt surface has ``ior`` 1, so that what is
transparent leaves no reflection behind and a colour shows as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdShade

import fexel
from fexel.homography import apply
from fexel_tools.framing import camera_poses
from fexel_tools.geometry import primitive
from fexel_tools.texture_stage import MATERIALS, begin_stage, define_preview_surface, finish_stage

__all__ = ["DRIVEN_INPUTS", "TEXTURE_PATH", "PinchmapPrim", "busiest_window", "create_stage", "define_texture"]

TEXTURE_PATH = f"{MATERIALS}/Pinchmap/Texture"
_DETAIL_TEXELS = 5  # of the pinchmap, along the side of what Detail shows
_GREY = 0.5  # diffuse colour of a surface whose texture is not its colour


@dataclass(frozen=True)
class _Driven:
    """An input of UsdPreviewSurface that a texture can drive: its type, and the texture's output that does."""

    type_name: Sdf.ValueTypeName
    output: str


DRIVEN_INPUTS = {
    "diffuseColor": _Driven(Sdf.ValueTypeNames.Color3f, "rgb"),
    "emissiveColor": _Driven(Sdf.ValueTypeNames.Color3f, "rgb"),
    "normal": _Driven(Sdf.ValueTypeNames.Normal3f, "rgb"),
    "roughness": _Driven(Sdf.ValueTypeNames.Float, "r"),
    "metallic": _Driven(Sdf.ValueTypeNames.Float, "r"),
    "occlusion": _Driven(Sdf.ValueTypeNames.Float, "r"),
    "opacity": _Driven(Sdf.ValueTypeNames.Float, "r"),
}
_OUTPUT_TYPES = {"rgb": Sdf.ValueTypeNames.Float3, "r": Sdf.ValueTypeNames.Float, "a": Sdf.ValueTypeNames.Float}


@dataclass(frozen=True)
class PinchmapPrim:
    """What the texture prim says.

    Attributes
    ----------
    file, pinchmap : str
        Signal and pinchmap, relative to the stage.
    source_color_space : str
        Of the signal: ``sRGB`` or ``raw``.
    drives : str
        One of `DRIVEN_INPUTS`.
    has_alpha : bool
        Whether the signal has an alpha channel, which then drives the opacity.
    is_biased : bool
        The signal stores (v + 1) / 2, as integer normal maps do.
    wrap : (str, str)
        Along s and t.
    antialias : float
        Pixels.
    line_width : float
        Pinchmap texels.
    line_color : 4 floats
        Linear, straight alpha.
    source : str
        Name of the file that it was made from.
    matrix : (3, 3) float64 or None
        From st of the picture to st of the pinchmap, row vectors: ``inputs:matrix``. None: they are the same.
    """

    file: str
    pinchmap: str
    source_color_space: str = "sRGB"
    drives: str = "diffuseColor"
    has_alpha: bool = False
    is_biased: bool = False
    wrap: tuple[str, str] = ("clamp", "clamp")
    antialias: float = 1.0
    line_width: float = 0.0
    line_color: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    source: str = ""
    matrix: np.ndarray | None = None


def create_stage(path: Path, texture: PinchmapPrim, aspect: float, detail_st: np.ndarray | None = None) -> Usd.Stage:
    """Author everything but the fallback. The stage is not saved.

    Parameters
    ----------
    path : Path
        File to create, ``.usd``, ``.usda`` or ``.usdc``.
    texture : PinchmapPrim
    aspect : float
        Width over height of the picture.
    detail_st : (4, 2) float64, optional
        Corners of what the camera Detail shows, from `busiest_window`; default: the middle quarter.
    """
    surface = primitive("quad", aspect)
    stage = begin_stage(path, surface)
    material = _define_material(stage, texture)
    poses = camera_poses(surface, detail_st, aspect, (0, 1))
    finish_stage(stage, surface, material, {name: poses[name] for name in ("Overview", "Detail")}, aspect)
    return stage


def busiest_window(mask: np.ndarray, st_to_texture: np.ndarray | None = None) -> np.ndarray | None:
    """Find the square of a few texels that holds most of the lines.

    Parameters
    ----------
    mask : (Nh, Nw) bool
        Row 0 at the top.
    st_to_texture : (3, 3) float64, optional
        Row vectors, from the picture's st to the mask's; default: they are the same.

    Returns
    -------
    (4, 2) float64 or None
        Its corners in the picture's st, counter-clockwise from the lower left; None for a mask without lines. Of
        equally busy ones the one nearest to the middle.
    """
    height, width = mask.shape
    lines = np.zeros(mask.shape)
    lines[:, 1:] += mask[:, 1:] != mask[:, :-1]
    lines[1:] += mask[1:] != mask[:-1]
    if not lines.any():
        return None
    rows, columns = min(_DETAIL_TEXELS, height), min(_DETAIL_TEXELS, width)
    windows = np.lib.stride_tricks.sliding_window_view(lines, (rows, columns)).sum(axis=(2, 3))
    y, x = np.indices(windows.shape)
    off_centre = np.hypot((2 * y + rows - height) / height, (2 * x + columns - width) / width)
    row, column = np.unravel_index(np.argmax(windows - 0.25 * off_centre), windows.shape)
    s0, s1 = column / width, (column + columns) / width
    t0, t1 = 1.0 - (row + rows) / height, 1.0 - row / height
    corners = np.array([[s0, t0], [s1, t0], [s1, t1], [s0, t1]])
    return corners if st_to_texture is None else apply(np.linalg.inv(st_to_texture), corners).clip(0.0, 1.0)


def _define_material(stage: Usd.Stage, prim: PinchmapPrim) -> UsdShade.Material:
    is_matt = prim.drives in ("diffuseColor", "emissiveColor", "opacity")
    values = {"roughness": 1.0, "ior": 1.0} if is_matt else {"roughness": 0.4}
    material, surface = define_preview_surface(stage, "Pinchmap", **values, metallic=0.0)
    texture = define_texture(stage, prim)
    driven = DRIVEN_INPUTS[prim.drives]
    if prim.drives != "diffuseColor":
        grey = 0.0 if prim.drives == "emissiveColor" else _GREY
        surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(grey))
    _connect(surface, prim.drives, driven.type_name, texture, driven.output)
    if prim.has_alpha and prim.drives != "opacity":
        _connect(surface, "opacity", Sdf.ValueTypeNames.Float, texture, "a")
    return material


def _connect(
    surface: UsdShade.Shader, name: str, type_name: Sdf.ValueTypeName, texture: fexel.PinchmapTexture, output: str
) -> None:
    surface.CreateInput(name, type_name).ConnectToSource(texture.CreateOutput(output, _OUTPUT_TYPES[output]))


def define_texture(stage: Usd.Stage, prim: PinchmapPrim, path: str = TEXTURE_PATH) -> fexel.PinchmapTexture:
    """Author the texture prim alone, without outputs, fallback and matrix.

    Parameters
    ----------
    stage : Usd.Stage
    prim : PinchmapPrim
    path : str
        Below another FexelTexture it is that one's patch.
    """
    texture = fexel.PinchmapTexture.Define(stage, path)
    texture.CreateFileAttr(Sdf.AssetPath(prim.file))
    texture.CreateSourceColorSpaceAttr(prim.source_color_space)
    texture.CreatePinchmapAttr(Sdf.AssetPath(prim.pinchmap)).SetColorSpace("raw")
    texture.CreateWrapSAttr(prim.wrap[0])
    texture.CreateWrapTAttr(prim.wrap[1])
    texture.CreateAntialiasAttr(prim.antialias)
    if prim.is_biased:
        texture.CreateScaleAttr(Gf.Vec4f(2.0, 2.0, 2.0, 1.0))
        texture.CreateBiasAttr(Gf.Vec4f(-1.0, -1.0, -1.0, 0.0))
    if prim.matrix is not None and not np.array_equal(prim.matrix, np.eye(3)):
        texture.CreateMatrixAttr(Gf.Matrix3d(*prim.matrix.ravel().tolist()))
    if prim.line_width > 0.0:
        texture.CreateLineWidthAttr(prim.line_width)
        texture.CreateLineColorAttr(Gf.Vec4f(*prim.line_color))
    if prim.source:
        texture.GetPrim().SetCustomDataByKey("fexel:source", prim.source)
    return texture
