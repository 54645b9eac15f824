"""Texels of an image file as it stores them: whole, a mip level, a window, or strip by strip."""

from __future__ import annotations

from collections.abc import Iterator

import OpenImageIO as oiio
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel.images.header import ImageInfo, open_image, reason
from fexel.images.png_chunks import png_fault
from fexel.packages import local_file

__all__ = ["oiio_type", "read_pixels", "read_strips"]


def read_pixels(info: ImageInfo, level: int = 0, window: tuple[int, int, int, int] | None = None) -> NDArray:
    """Texels as the file stores them.

    Parameters
    ----------
    info : ImageInfo
    level : int
        One of ``info.level_sizes``.
    window : (x0, y0, x1, y1), optional
        Half-open, in texels of that level, y down from the top; default all.

    Returns
    -------
    (y1 - y0, x1 - x0, channels) of dtype ``info.dtype``

    Raises
    ------
    FexelError
        Truncated or damaged data.
    """
    width, height = info.level_sizes[level]
    handle = _open_undamaged(info.path)
    try:
        return _read_window(handle, info, level, window or (0, 0, width, height))
    finally:
        handle.close()


def read_strips(info: ImageInfo, rows: int) -> Iterator[NDArray]:
    """Level 0 from top to bottom, about `rows` rows at a time, as `read_pixels` returns them. Raises as that does."""
    handle = _open_undamaged(info.path)
    try:
        if info.tiled:
            tile = handle.spec().tile_height
            rows = -(-rows // tile) * tile
        for y0 in range(0, info.height, rows):
            yield _read_window(handle, info, 0, (0, y0, info.width, min(y0 + rows, info.height)))
    finally:
        handle.close()


def _open_undamaged(path: str) -> oiio.ImageInput:
    handle = open_image(path)
    fault = png_fault(local_file(path))
    if fault:
        handle.close()
        raise FexelError(f"{path}: {fault}")
    return handle


def _read_window(handle: oiio.ImageInput, info: ImageInfo, level: int, window: tuple[int, int, int, int]) -> NDArray:
    x0, y0, x1, y1 = window
    width = info.level_sizes[level][0]
    handle.seek_subimage(0, level)
    if info.tiled:
        pixels = _read_tiles(handle, level, window, info.dtype)
    else:
        pixels = handle.read_scanlines(0, level, y0, y1, 0, 0, info.channels, oiio_type(info.dtype))
        pixels = None if pixels is None else pixels.reshape(y1 - y0, width, info.channels)[:, x0:x1]
    if pixels is None or handle.has_error:
        raise FexelError(f"{info.path}: {reason(handle.geterror())}")
    return pixels


def oiio_type(dtype: str) -> str:
    """OpenImageIO's name of a dtype."""
    return {"float16": "half", "float32": "float"}.get(dtype, dtype)


def _read_tiles(handle: oiio.ImageInput, level: int, window: tuple[int, int, int, int], dtype: str) -> NDArray | None:
    x0, y0, x1, y1 = window
    spec = handle.spec()
    left, top = x0 // spec.tile_width * spec.tile_width, y0 // spec.tile_height * spec.tile_height
    right = min(spec.width, -(-x1 // spec.tile_width) * spec.tile_width)
    bottom = min(spec.height, -(-y1 // spec.tile_height) * spec.tile_height)
    tiles = handle.read_tiles(
        0,
        level,
        spec.x + left,
        spec.x + right,
        spec.y + top,
        spec.y + bottom,
        spec.z,
        spec.z + 1,
        0,
        spec.nchannels,
        oiio_type(dtype),
    )
    if tiles is None:
        return None
    tiles = tiles.reshape(bottom - top, right - left, spec.nchannels)
    return tiles[y0 - top : y1 - top, x0 - left : x1 - left]
