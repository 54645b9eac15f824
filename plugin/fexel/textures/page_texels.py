"""Texels of images in the format of their pages, and the border of one texel that every stored window has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fexel import images
from fexel.textures.page_format import HALF

__all__ = ["bordered", "decode_page", "encode_page", "inner_box", "texel_items"]

_Box = tuple[int, int, int, int]
# sRGB encoding to 8 bits by table: 2^16 steps of linear light are finer than half an 8-bit step even at black.
_ENCODE = (images.linear_to_srgb(np.arange(65536) / np.float32(65535)) * 255 + 0.5).astype(np.uint8)

_DECODE = images.srgb_to_linear(np.arange(256) / np.float32(255))


def encode_page(texels: NDArray[np.float32], page_class: int) -> NDArray:
    """Linear, premultiplied rgba (H, W, 4) as pages of SRGB or HALF store it: uint8 or float16."""
    if page_class == HALF:
        return texels.astype(np.float16)
    steps = texels.clip(0, 1)
    alpha = steps[..., 3] * 255 + 0.5
    steps *= 65535
    steps += 0.5
    encoded = np.take(_ENCODE, steps.astype(np.uint16), mode="wrap")  # no index is out of its range
    encoded[..., 3] = alpha
    return encoded


def decode_page(texels: NDArray, page_class: int) -> NDArray[np.float32]:
    """What a shader reads of stored texels: the inverse of `encode_page`."""
    if page_class == HALF:
        return texels.astype(np.float32)
    values = np.take(_DECODE, texels, mode="wrap")
    values[..., 3] = texels[..., 3] / np.float32(255)
    return values


def texel_items(texels: NDArray) -> NDArray:
    """(..., 4) contiguous texels seen as (...) items of one word each, which are moved about several times as fast."""
    word = {1: np.uint32, 2: np.uint64, 4: np.complex128}[texels.dtype.itemsize]
    return texels.view(word)[..., 0]


def inner_box(box: _Box, size: tuple[int, int]) -> _Box:
    """The part of a window and its border that lies within a level of `size`, width and height."""
    x0, y0, x1, y1 = box
    return max(x0 - 1, 0), max(y0 - 1, 0), min(x1 + 1, size[0]), min(y1 + 1, size[1])


def bordered(texels: NDArray, box: _Box, size: tuple[int, int], wrap: tuple[str, str]) -> NDArray:
    """A window with its border; where that leaves the image, what the wrap mode continues it with.

    Parameters
    ----------
    texels : (y1 - y0, x1 - x0, 4)
        Of `inner_box`; whole along an axis that repeats and is seen across its seam.
    box : (x0, y0, x1, y1)
    size : (int, int)
    wrap : (str, str)
        ``clamp``, ``mirror``, ``repeat``; zero for all else.
    """
    inner = inner_box(box, size)
    texels = _pad(texels, 1, (inner[0] - box[0] + 1, box[2] + 1 - inner[2]), wrap[0])
    return np.ascontiguousarray(_pad(texels, 0, (inner[1] - box[1] + 1, box[3] + 1 - inner[3]), wrap[1]))


def _pad(texels: NDArray, axis: int, pad: tuple[int, int], mode: str) -> NDArray:
    if pad == (0, 0):
        return texels
    widths = [(0, 0)] * texels.ndim
    widths[axis] = pad
    numpy_mode = {"clamp": "edge", "mirror": "symmetric", "repeat": "wrap"}.get(mode)
    if mode == "repeat" and min(pad) == 0:
        numpy_mode = "edge"  # a window that does not reach the other end is not seen across the seam
    return np.pad(texels, widths, mode=numpy_mode) if numpy_mode else np.pad(texels, widths)
