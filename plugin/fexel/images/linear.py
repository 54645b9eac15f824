"""From what a file stores to linear light with premultiplied alpha, finite whatever the file holds."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from fexel.images.header import ImageInfo, image_info
from fexel.images.pixels import read_pixels
from fexel.images.srgb import srgb_to_linear

__all__ = ["read_linear", "read_mask", "to_linear"]

_LARGEST_HALF = 65504.0
_SRGB8 = srgb_to_linear(np.arange(256) / np.float32(255))


def to_linear(
    pixels: NDArray, info: ImageInfo, color_space: str = "auto", mask: NDArray[np.float32] | None = None
) -> NDArray[np.float32]:
    """File values to linear, premultiplied RGBA.

    Parameters
    ----------
    pixels : (H, W, C)
        From `read_pixels`.
    info : ImageInfo
    color_space : str
        ``auto``, ``raw`` or ``sRGB``.
    mask : (H, W) float32, optional
        Alpha in [0, 1] that replaces the file's own; straight colour is kept where the file is transparent.

    Returns
    -------
    (H, W, 4) float32
        Finite; alpha in [0, 1], 1 where the file has none.
    """
    srgb = (info.color_space if color_space == "auto" else color_space) == "sRGB"
    colour_channels = [c for c in range(info.channels) if c != info.alpha_channel][:3]
    rgba = np.empty((*pixels.shape[:2], 4), np.float32)
    rgba[..., 3] = 1.0
    if info.alpha_channel >= 0:
        rgba[..., 3] = np.clip(_as_float(pixels[..., info.alpha_channel]), 0.0, 1.0)
    alpha = rgba[..., 3:]
    if len(colour_channels) < 3:
        colour_channels = (colour_channels or [0])[:1] * 3
    stored = pixels[..., colour_channels]
    associated = info.alpha_associated and info.alpha_channel >= 0
    if srgb and stored.dtype == np.uint8 and not associated:
        rgba[..., :3] = _SRGB8[stored]
    elif srgb:
        colour = _as_float(stored)
        rgba[..., :3] = srgb_to_linear(_straight(colour, alpha) if associated else colour)
    else:
        colour = _as_float(stored)
        rgba[..., :3] = _straight(colour, alpha) if associated and mask is not None else colour
    if mask is not None:
        rgba[..., 3] = mask
    if mask is not None or (info.alpha_channel >= 0 and (srgb or not associated)):
        rgba[..., :3] *= rgba[..., 3:]
    return rgba


def _straight(colour: NDArray[np.float32], alpha: NDArray[np.float32]) -> NDArray[np.float32]:
    """Associated colour divided by alpha; as it is where alpha is 0."""
    return np.where(alpha > 0, colour / np.maximum(alpha, 1e-6), colour)  # 1e-6 guards nearly transparent texels


def _as_float(values: NDArray) -> NDArray[np.float32]:
    """Integers to [0, 1]; floats cleaned of NaN and infinities."""
    if values.dtype.kind == "u":
        return values.astype(np.float32) / np.float32(np.iinfo(values.dtype).max)
    return np.nan_to_num(values.astype(np.float32), nan=0.0, posinf=_LARGEST_HALF, neginf=-_LARGEST_HALF).clip(
        -_LARGEST_HALF, _LARGEST_HALF
    )


def read_linear(path: str, color_space: str = "auto") -> NDArray[np.float32]:
    """A whole file as (H, W, 4) float32, linear, premultiplied. Raises `FexelError` as `image_info` and `read_pixels`
    do.
    """
    info = image_info(path)
    return to_linear(read_pixels(info), info, color_space)


def read_mask(path: str, size: tuple[int, int]) -> NDArray[np.float32]:
    """The first channel of a file, raw, resampled to `size`.

    Parameters
    ----------
    path : str
    size : (int, int)
        Width and height.

    Returns
    -------
    (height, width) float32
        In [0, 1].

    Raises
    ------
    FexelError
        As `image_info` and `read_pixels`.
    """
    info = image_info(path)
    mask = _as_float(read_pixels(info)[..., 0]).clip(0.0, 1.0)
    if (info.width, info.height) == size:
        return mask
    buffer = oiio.ImageBuf(np.ascontiguousarray(mask[..., None]))
    resized = oiio.ImageBufAlgo.resize(buffer, roi=oiio.ROI(0, size[0], 0, size[1]), filtername="triangle")
    return np.asarray(resized.get_pixels(oiio.FLOAT))[..., 0].clip(0.0, 1.0)
