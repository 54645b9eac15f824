"""What lies behind the umbrellas: an image repeated over the ground, or one colour.

A texture's background covers the unit square of st once, and is stored so. A photo of soil shows a stretch of it, not
the whole ground, so it is laid out in tiles, as many as keep its own resolution, and its aspect on the ground. A
picture that tiles is repeated as it is; another one is made to tile (`seamless`). What is seen of it are gaps between
elements, in their shade: fewer texels to a cell than elements have will do, and keep the file small.
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
from fexel_tools.seamless import OVERLAP, seamless, tiles
from fexel_tools.umbrella_elements import Elements

__all__ = ["AUTO", "CELL_TEXELS", "NONE", "Background", "choose_background", "laid_out"]

AUTO, NONE = "auto", "none"
_LARGEST_PX = 4096
CELL_TEXELS = 32.0
"""Texels of a background on a side of a cell of the grid."""

_MORE_TILES = 0.15  # what a tile more costs against distortion, both as logarithms
_STRETCH = 0.15  # of a tile: so much one is enlarged rather than repeated once more
_SHADE = 0.3  # of the elements' mean colour: what shows between cut-outs lies in their shade

Color = tuple[float, float, float, float]
Size = tuple[int, int]


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
    wanted: str | Color,
    sources: Sequence[Elements],
    grid: tuple[int, int],
    *,
    is_data: bool = False,
    cell_texels: float = CELL_TEXELS,
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
    cell_texels : float
        Texels of a picture on a side of a cell.

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
        return _of_image(_read(wanted, is_data), grid, cell_texels)
    grounds = [source for source in sources if source.kind == "many" and source.ground is not None]
    patches = [source.ground_patch for source in grounds if source.ground_patch is not None]
    if patches:
        return _of_image(max(patches, key=lambda patch: patch.shape[0] * patch.shape[1]), grid, cell_texels)
    if grounds:
        return Background(None, _color(np.mean([source.ground for source in grounds], axis=0)))
    means = [np.average(e.color.reshape(-1, 3), axis=0, weights=e.opacity.ravel() + 1e-9) for e in _all(sources)]
    mean = np.mean(means, axis=0) if means else np.zeros(3)
    return Background(None, _color(mean if is_data else _SHADE * mean))


def laid_out(
    picture: NDArray[np.float32], grid: tuple[int, int], cell_texels: float = CELL_TEXELS
) -> NDArray[np.float32]:
    """A photo laid out over the unit square of st.

    Parameters
    ----------
    picture : (H, W, C) float32
    grid : (int, int)
        Cells along s and t, square on the ground.
    cell_texels : float
        Texels of the result on a side of a cell.

    Returns
    -------
    (h, w, C) float32
        At most 4096 pixels a side; repeats without a seam.
    """
    cell_texels = min(cell_texels, _LARGEST_PX / max(grid))
    wanted = max(round(grid[0] * cell_texels), 1), max(round(grid[1] * cell_texels), 1)
    tile, counts = _repeatable(picture, wanted) if tiles(picture) else _made_repeatable(picture, wanted)
    whole = np.tile(tile, (counts[1], counts[0], 1))
    if whole.shape[1::-1] == wanted:
        return whole
    area = wanted[0] * wanted[1] < whole.shape[0] * whole.shape[1]
    resized = cv2.resize(whole, wanted, interpolation=cv2.INTER_AREA if area else cv2.INTER_CUBIC)
    return resized.reshape(wanted[1], wanted[0], -1).clip(picture.min(), picture.max())


def _repeatable(picture: NDArray[np.float32], wanted: Size) -> tuple[NDArray[np.float32], Size]:
    """A picture that tiles, and how often, along s and t, so that it is distorted least."""
    height, width = picture.shape[:2]
    scale = _scale(wanted, (width, height))
    first = max(round(wanted[0] / (scale * width)), 1)
    choices = []
    for columns in range(first, 4 * first + 1):
        scaled = wanted[0] / (columns * width)
        rows = max(round(wanted[1] / (scaled * height)), 1)
        distortion = abs(float(np.log(wanted[1] / (rows * height * scaled))))
        choices.append((distortion + _MORE_TILES * float(np.log(columns / first)), (columns, rows)))
    return picture, min(choices)[1]


def _made_repeatable(picture: NDArray[np.float32], wanted: Size) -> tuple[NDArray[np.float32], Size]:
    """A tile of a photo that does not tile, and how often; the photo's sides are cut rather than distorted."""
    height, width = picture.shape[:2]
    usable = width * (1 - OVERLAP), height * (1 - OVERLAP)
    scale = _scale(wanted, usable)
    counts = [max(int(np.ceil(wanted[k] / (scale * usable[k]) - _STRETCH)), 1) for k in (0, 1)]
    sides = [wanted[k] / (counts[k] * scale * (1 - OVERLAP)) for k in (0, 1)]
    columns, rows = (min(max(round(side), 1), most) for side, most in zip(sides, (width, height), strict=True))
    left, top = (width - columns) // 2, (height - rows) // 2
    return seamless(picture[top : top + rows, left : left + columns]), (counts[0], counts[1])


def _scale(wanted: Size, tile: tuple[float, float]) -> float:
    """Texels of the result per pixel of the photo: 1, or less where one photo is more than enough along s and t."""
    return min(1.0, max(wanted[0] / tile[0], wanted[1] / tile[1]))


def _of_image(picture: NDArray[np.float32], grid: tuple[int, int], cell_texels: float) -> Background:
    whole = laid_out(picture, grid, cell_texels)
    return Background(whole, _color(whole.reshape(-1, whole.shape[2]).mean(axis=0)))


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
