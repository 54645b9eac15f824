"""What applications without fexel show of a texture: one baked image, and the standard network that reads it.

Inside the texture prim, self-contained (names and values are literal, as importers do not follow interface inputs):

::

    Texture                      FexelTexture prim
      Fallback                   Shader UsdUVTexture: inputs:file = the baked image, wrapS and wrapT of the prim,
                                 sourceColorSpace sRGB or raw, inputs:scale and bias where all layers share them,
                                 inputs:st <- FallbackSt.outputs:result
      FallbackSt                 Shader UsdPrimvarReader_float2: inputs:varname (string) of the reader that feeds the
                                 prim's inputs:st, "st" where there is none; a FallbackTransform between the two
                                 where the prim reads it through a UsdTransform2d (`fallback_coordinates`)
      outputs:rgb, r, g, b, a    <- the outputs of Fallback

The image is the unit square of ``inputs:st``, baked as its kind does it (`baking`): a zipmap's eq. (1) in linear light
with area filtering, as fine as the finest layer; a pinchmap's reconstructed picture; never above `size`. Its colour
space is the root's: an sRGB root gives an 8-bit sRGB file, a raw integer root a 16-bit PNG of raw values, a
floating-point root a half-float EXR.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdShade

from fexel.errors import FexelError
from fexel.filters.minification import minification_of_prim
from fexel.textures import extract_texture
from fexel.textures.image_source import toned
from fexel_tools.baking import TextureBaker, texture_baker
from fexel_tools.color_bleed import bleed_color
from fexel_tools.fallback_coordinates import READER_NAME, author_coordinates
from fexel_tools.image_files import write_image
from fexel_tools.texture_files import encode

__all__ = ["FALLBACK_NAME", "READER_NAME", "author", "bake", "write_fallback", "write_picture"]

FALLBACK_NAME = "Fallback"
_EIGHT_BIT = (".png", ".jpg", ".jpeg")
_OUTPUTS = {
    "rgb": Sdf.ValueTypeNames.Float3,
    "r": Sdf.ValueTypeNames.Float,
    "g": Sdf.ValueTypeNames.Float,
    "b": Sdf.ValueTypeNames.Float,
    "a": Sdf.ValueTypeNames.Float,
}


def bake(texture_prim: Usd.Prim, size: int = 2048, time: Usd.TimeCode | float | None = None) -> np.ndarray:
    """Bake a texture into one image.

    Parameters
    ----------
    texture_prim : Usd.Prim
        A FexelTexture with its patches, or a UsdUVTexture shader.
    size : int
        Most pixels on the longer side.
    time : Usd.TimeCode or float, optional
        Default: the default time.

    Returns
    -------
    (H, W, 4) float32
        Linear, premultiplied; before ``inputs:scale`` and ``bias`` when all layers share them.

    Raises
    ------
    FexelError
        A prim that no texture kind reads, or a size below 1.
    """
    baker = _baker(texture_prim, size, time)
    return baker.bake(*baker.size(size))


def write_fallback(
    texture_prim: Usd.Prim, image_path: str | Path, size: int = 2048, time: Usd.TimeCode | float | None = None
) -> Path:
    """Bake a texture, write the image and author the network that shows it. The stage is not saved.

    Parameters
    ----------
    texture_prim : Usd.Prim
    image_path : str or Path
        ``.png``, ``.jpg`` or ``.jpeg``. A raw root gets ``.png`` and a floating-point root ``.exr`` instead.
    size, time
        As for `bake`.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    FexelError
        As `bake`; or the file cannot be written.
    """
    path = Path(image_path)
    if path.suffix.lower() not in _EIGHT_BIT:
        raise FexelError(f"{path}: expected a file name ending in {', '.join(_EIGHT_BIT)}")
    baker = _baker(texture_prim, size, time)
    storage = baker.storage
    if storage.dtype == "half":
        path = path.with_suffix(".exr")
    elif storage.color_space == "raw":
        path = path.with_suffix(".png")
    write_picture(path, baker.bake(*baker.size(size)), storage.color_space, storage.dtype)
    asked = minification_of_prim(texture_prim, _time(time))
    scale, bias = toned(storage.scale, storage.bias, asked)
    author(texture_prim, path, color_space=storage.color_space, scale=scale, bias=bias)
    return path


def author(
    texture_prim: Usd.Prim,
    image_path: str | Path,
    *,
    color_space: str = "sRGB",
    scale: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0),
    bias: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0),
) -> None:
    """Author the inner network on the stage's edit target and declare the fallback types of fexel's prims.

    Parameters
    ----------
    texture_prim : Usd.Prim
        A FexelTexture.
    image_path : str or Path
        Authored relative to the edit target's layer where that is a file, with a leading ``./``.
    color_space : str
        ``sRGB`` or ``raw``: inputs:sourceColorSpace.
    scale, bias : 4 floats
        inputs:scale and inputs:bias where they differ from 1 and 0.
    """
    stage, base = texture_prim.GetStage(), texture_prim.GetPath()
    texture = UsdShade.Shader.Define(stage, base.AppendChild(FALLBACK_NAME))
    texture.CreateIdAttr("UsdUVTexture")
    file = _asset_path(stage.GetEditTarget().GetLayer(), Path(image_path))
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(file))
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(color_space)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(author_coordinates(texture_prim))
    for name in ("wrapS", "wrapT"):
        texture.CreateInput(name, Sdf.ValueTypeNames.Token).Set(texture_prim.GetAttribute(f"inputs:{name}").Get())
    if tuple(scale) != (1.0, 1.0, 1.0, 1.0):
        texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*scale))
    if tuple(bias) != (0.0, 0.0, 0.0, 0.0):
        texture.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*bias))
    graph = UsdShade.NodeGraph(texture_prim)
    for name, type_name in _OUTPUTS.items():
        output = graph.GetOutput(name)
        output = output if output else graph.CreateOutput(name, type_name)
        output.ConnectToSource(texture.CreateOutput(name, type_name))
    stage.WriteFallbackPrimTypes()


def _baker(texture_prim: Usd.Prim, size: int, time: Usd.TimeCode | float | None) -> TextureBaker:
    if size < 1:
        raise FexelError(f"{texture_prim.GetPath()}: fallback size is {size}, expected at least 1 pixel")
    kind, data = extract_texture(texture_prim, _time(time))
    return texture_baker(kind, data, str(texture_prim.GetPath()))


def _time(time: Usd.TimeCode | float | None) -> Usd.TimeCode:
    return Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)


def write_picture(path: Path, rgba: np.ndarray, color_space: str, dtype: str, *, is_photo: bool = False) -> None:
    """Write a baked picture beside and rename; alpha is left out where the whole picture is opaque, and in JPEG.

    Parameters
    ----------
    path : Path
        Its extension chooses the format.
    rgba : (H, W, 4) float32
        Linear (or data), premultiplied.
    color_space, dtype : str
        As `fexel_tools.baking.Storage`.
    is_photo : bool
        As `fexel_tools.image_files.write_image` takes it.

    Raises
    ------
    FexelError
        The file cannot be written.
    """
    opaque = bool((rgba[:, :, 3] > 1 - 0.5 / 255).all())
    channels = 3 if opaque or path.suffix.lower() in (".jpg", ".jpeg") else 4
    if dtype == "half":
        pixels = rgba[:, :, :channels].astype(np.float16)
    else:
        pixels = _integers(rgba, channels == 4, dtype, color_space)
    write_image(path, pixels, color_space, is_photo=is_photo)


def _integers(rgba: np.ndarray, has_alpha: bool, dtype: str, color_space: str) -> np.ndarray:
    """Stored values; with alpha straight, the colours continued below it, since most applications filter them so."""
    if not has_alpha:
        return encode(rgba[:, :, :3], None, dtype, color_space)
    alpha = np.ascontiguousarray(rgba[:, :, 3])
    straight = rgba[:, :, :3] / np.maximum(alpha, np.float32(1e-6))[:, :, None]  # 1e-6 guards transparent pixels
    return encode(bleed_color(straight, alpha), alpha, dtype, color_space)


def _asset_path(layer: Sdf.Layer, path: Path) -> str:
    if not layer.realPath:
        return path.as_posix()
    relative = os.path.relpath(path.resolve(), Path(layer.realPath).resolve().parent)
    return f"./{Path(relative).as_posix()}"
