"""What lies behind the umbrellas: an image repeated over the ground, or one colour.

A texture's background covers the unit square of st once. A photo of soil shows a stretch of it, not the whole ground,
so it is laid out in tiles, every other one mirrored: they meet without a seam, and keep the photo's aspect on the
ground. What is seen of it are gaps; the picture is bounded, the tiles are as many as keep the photo's own resolution,
as long as it has no more texels to a cell than umbrellas do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel.images import image_info, read_linear
from fexel_tools.umbrella_elements import Elements

__all__ = ["AUTO", "NONE", "Background", "choose_background", "tiled"]

AUTO, NONE = "auto", "none"
_LARGEST_PX = 4096
_CELL_PX = 32  # texels of the picture in a cell of the grid, at most
_SHADE = 0.3  # of the elements' mean colour: what shows between cut-outs lies in their shade

Color = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class Background:
    """A background.

    Attributes
    ----------
    picture : (H, W, 3 or 4) float32 or None
        Of the unit square of st: linear (or data), straight alpha, row 0 at the top.
    color : 4 floats
        Linear (or data), straight alpha: its mean, or what is seen without a picture.
    """

    picture: NDArray[np.float32] | None
    color: Color


def choose_background(
    wanted: str | Color, sources: Sequence[Elements], grid: tuple[int, int], *, is_data: bool = False
) -> Background:
    """The background that was asked for, or one that suits the elements.

    Parameters
    ----------
    wanted : str or 4 floats
        An image, a colour, ``none`` (transparent), or ``auto``: the ground that photos of many elements show; else the
        elements' mean colour, in the shade, since a single object lies on whatever it was photographed on.
    sources : sequence of Elements
    grid : (int, int)
    is_data : bool
        The umbrellas hold data; ``auto`` is their mean.

    Raises
    ------
    FexelError
        The image cannot be read.
    """
    if not isinstance(wanted, str):
        return Background(None, wanted)
    if wanted == NONE:
        return Background(None, (0.0, 0.0, 0.0, 0.0))
    if wanted != AUTO:
        return _of_image(_read(wanted, is_data), grid)
    grounds = [source for source in sources if source.kind == "many" and source.ground is not None]
    patches = [source.ground_patch for source in grounds if source.ground_patch is not None]
    if patches:
        return _of_image(max(patches, key=lambda patch: patch.shape[0] * patch.shape[1]), grid)
    if grounds:
        return Background(None, _color(np.mean([source.ground for source in grounds], axis=0)))
    means = [np.average(e.color.reshape(-1, 3), axis=0, weights=e.opacity.ravel() + 1e-9) for e in _all(sources)]
    mean = np.mean(means, axis=0) if means else np.zeros(3)
    return Background(None, _color(mean if is_data else _SHADE * mean))


def tiled(picture: NDArray[np.float32], grid: tuple[int, int]) -> NDArray[np.float32]:
    """A photo laid out over the unit square of st, mirrored tile by tile.

    Parameters
    ----------
    picture : (H, W, C) float32
    grid : (int, int)
        Cells along s and t, square on the ground.

    Returns
    -------
    (h, w, C) float32
        At most 4096 pixels a side; its aspect is the grid's, nearly.
    """
    longest = max(grid)
    cell_px = min(float(_CELL_PX), _LARGEST_PX / longest)
    height, width = picture.shape[:2]
    shrink = min(1.0, cell_px / _CELL_PX)
    tiles = [_tile_count(grid[axis] * cell_px, (width, height)[axis] * shrink) for axis in (0, 1)]
    size = [max(1, round(grid[axis] * cell_px / tiles[axis])) for axis in (0, 1)]
    area = size[0] * size[1] < width * height
    tile = cv2.resize(picture, (size[0], size[1]), interpolation=cv2.INTER_AREA if area else cv2.INTER_CUBIC)
    tile = tile.reshape(size[1], size[0], -1).clip(picture.min(), picture.max())
    row = np.concatenate([tile[:, :: 1 - 2 * (k % 2)] for k in range(tiles[0])], axis=1)
    return np.ascontiguousarray(np.concatenate([row[:: 1 - 2 * (k % 2)] for k in range(tiles[1])], axis=0))


def _tile_count(wanted_px: float, tile_px: float) -> int:
    """An even number of tiles, so that mirrored ones meet at the texture's own border, or one that is as large."""
    return max(2, 2 * round(wanted_px / (2 * tile_px)))


def _of_image(picture: NDArray[np.float32], grid: tuple[int, int]) -> Background:
    laid_out = tiled(picture, grid)
    mean = laid_out.reshape(-1, laid_out.shape[2]).mean(axis=0)
    return Background(laid_out, _color(mean))


def _read(file: str, is_data: bool) -> NDArray[np.float32]:
    """Straight colour, with alpha where the file has some below 1."""
    if not Path(file).is_file():
        raise FexelError(f"--background: {file}: no such file")
    info = image_info(file)
    rgba = read_linear(file, "raw" if is_data or info.dtype.startswith("float") else "sRGB")
    if float(rgba[..., 3].min()) >= 1.0:
        return rgba[..., :3]
    rgba[..., :3] /= np.maximum(rgba[..., 3:], 1e-6)  # 1e-6 guards transparent pixels
    return rgba


def _all(sources: Sequence[Elements]) -> list:
    return [element for source in sources for element in source.elements]


def _color(values: NDArray) -> Color:
    red, green, blue = (float(v) for v in values[:3])
    return red, green, blue, float(values[3]) if len(values) > 3 else 1.0
