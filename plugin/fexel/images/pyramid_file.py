"""Tiled, mip-mapped image files, of which any window of any level can be read alone."""

from __future__ import annotations

import os
from collections.abc import Iterable
from itertools import chain, islice

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel.images.header import UNASSOCIATED, reason
from fexel.images.pixels import oiio_type
from fexel.images.srgb import linear_to_srgb

__all__ = ["write_pyramid"]


def write_pyramid(
    path: str, levels: Iterable[NDArray], dtype: str = "uint8", color_space: str = "sRGB", tile: int = 64
) -> None:
    """Write a tiled, mip-mapped TIFF or EXR that `read_pixels` loads in part; written beside, then renamed.

    Parameters
    ----------
    path : str
        ``.tif``, ``.tiff`` (any dtype, unassociated alpha) or ``.exr`` (float16, float32, linear, associated alpha).
    levels : iterable of (H, W, 3 or 4) float32
        Linear, premultiplied, from `mipmaps.pyramid`; or of type `dtype` if that is an integer type: values as the file
        shall hold them.
    dtype : str
        ``uint8``, ``uint16``, ``float16`` or ``float32``.
    color_space : str
        ``sRGB`` encodes the colour; ``raw`` stores it as it is.

    Raises
    ------
    FexelError
        The file cannot be written.
    """
    exr = path.lower().endswith(".exr")
    levels = iter(levels)  # one at a time: they need not be in memory together
    first = list(islice(levels, 2))
    several = len(first) > 1
    stem, extension = os.path.splitext(path)
    beside = f"{stem}.{os.getpid()}.part{extension}"
    writer = oiio.ImageOutput.create(beside)
    if writer is None:
        raise FexelError(f"{path}: {reason(oiio.geterror())}")
    try:
        for level, image in enumerate(chain(first, levels)):
            height, width, channels = image.shape
            spec = oiio.ImageSpec(width, height, channels, oiio_type(dtype))
            spec.tile_width = spec.tile_height = tile
            spec.attribute("compression", "zip")
            spec.attribute("DateTime", "")  # none: the same picture makes the same bytes
            if several:
                # By this a TIFF's further images are known as its mip levels, and an EXR announces all of them.
                spec.attribute("textureformat", "Plain Texture")
            spec.attribute("oiio:ColorSpace", "srgb_rec709_scene" if color_space == "sRGB" else "lin_rec709_scene")
            if not exr and channels == 4:
                spec.alpha_channel = 3
                spec.attribute(UNASSOCIATED, 1)
            append = "AppendMIPLevel" if writer.supports("mipmap") else "AppendSubimage"
            if not writer.open(beside, spec, append if level else "Create"):
                raise FexelError(f"{path}: {reason(writer.geterror())}")
            if not writer.write_image(_encode(image, dtype, color_space, associated=exr)):
                raise FexelError(f"{path}: {reason(writer.geterror())}")
        writer.close()
        os.replace(beside, path)
    finally:
        if os.path.exists(beside):
            os.remove(beside)


def _encode(image: NDArray, dtype: str, color_space: str, associated: bool) -> NDArray:
    """Linear premultiplied float to file values; integers of the file's type are file values already."""
    if image.dtype == dtype and image.dtype.kind == "u":
        return image
    image = np.asarray(image, np.float32).copy()
    colour = image[..., :3]
    if image.shape[-1] == 4 and not associated:
        colour /= np.maximum(image[..., 3:], 1e-6)  # transparent texels: colour is zero there
    if color_space == "sRGB":
        colour[:] = linear_to_srgb(colour)
    if dtype in ("uint8", "uint16"):
        largest = np.iinfo(dtype).max
        return (image.clip(0.0, 1.0) * largest + 0.5).astype(dtype)
    return np.ascontiguousarray(image.astype(dtype))
