"""Which part of an image a pinchmap should cover.

A map that clamps has no texels at s = 1 and t = 1 (`pinchmap_mask`): a line that crosses the last column or top row of
cells is lost there. And texels over transparent margins are wasted. So the map may cover a *window* of the image:
beyond the right and upper side by one cell where a line comes that near, and no more than the content where the rest is
fully transparent. The prim's `inputs:matrix` takes texture coordinates of the image to those of the map.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["FloatWindow", "Window", "choose_window", "cut", "matrix_of", "roomy"]

Window = tuple[int, int, int, int]
"""Left, top, right and bottom of a map in pixels of its image; may reach beyond it."""

FloatWindow = tuple[float, float, float, float]
"""A `Window` that need not end at whole pixels."""

_ROOM = 2  # pixels per texel, at least
_MARGIN = 0.25  # cells left of and below cropped content: the outermost texels must lie outside it


def choose_window(
    side: NDArray[np.floating],
    shape: tuple[int, int],
    *,
    wrap: tuple[str, str] = ("clamp", "clamp"),
    content: NDArray[np.bool_] | None = None,
) -> Window:
    """The part of an image that a pinchmap of some shape should cover.

    Parameters
    ----------
    side : (H, W) float
        In [0, 1]; above 0.5 is the + side.
    shape : (int, int)
        Rows and columns of texels.
    wrap : (str, str)
        Along s and t; a direction that repeats is covered exactly.
    content : (H, W) bool, optional
        Where there is something to see; the window may leave out what lies around it. Where not given, it may not.
    """
    plus = side > 0.5
    visible = np.ones_like(plus) if content is None else np.asarray(content, bool) | plus
    rows, columns = np.flatnonzero(visible.any(1)), np.flatnonzero(visible.any(0))
    if wrap[0] == "repeat" or len(columns) == 0:
        left, right = 0, side.shape[1]
    else:
        left, right = _extent(plus, int(columns[0]), int(columns[-1]) + 1, shape[1])
    if wrap[1] == "repeat" or len(rows) == 0:
        top, bottom = 0, side.shape[0]
    else:  # the same, seen from below
        height = side.shape[0]
        low, high = _extent(plus.T[:, ::-1], height - 1 - int(rows[-1]), height - int(rows[0]), shape[0])
        top, bottom = height - high, height - low
    return left, top, right, bottom


def _extent(plus: NDArray[np.bool_], first: int, last: int, cells: int) -> tuple[int, int]:
    """Start and end of the window along the columns of `plus`, whose columns [first, last) are to be seen."""
    size = plus.shape[1]
    if cells < 6:  # too few to spare one
        return 0, size
    strip = plus[:, size - max(size // cells, 1) :]
    ones = strip.sum(1)
    lost = np.minimum(ones, strip.shape[1] - ones).sum() / plus.size
    # Dearer than what the other lines lose by one cell less? Measured: of the pixels 0.0015 (32 / cells)^2.7 are wrong
    # where the lines are five times as long as the image.
    length = ((plus[:, 1:] != plus[:, :-1]).sum() + (plus[1:] != plus[:-1]).sum()) / np.sqrt(plus.size)
    crossed = lost > 2.4e-5 * length * (32 / cells) ** 3.8
    best = (0, size) if not crossed else (0, int(np.ceil(size * cells / (cells - 1))))
    cell = (last - first) / (cells - 1 - _MARGIN)
    start = int(np.floor(first - _MARGIN * cell))
    if start < 0:
        start, cell = 0, last / (cells - 1)
    end = int(np.ceil(last + cell * 1.02))  # 1.02: the line stays clear of the last texels
    return (start, end) if end - start < best[1] - best[0] else best


def roomy(window: Window, shape: tuple[int, int], size: tuple[int, int]) -> Window:
    """Grow a window about its centre until its texels have two pixels along each axis, or it is as large as the image.

    A finer map of a small thing in a large picture would resolve nothing more.

    Parameters
    ----------
    window : Window
    shape : (int, int)
        Rows and columns of texels.
    size : (int, int)
        Rows and columns of the image.

    Examples
    --------
    >>> roomy((40, 40, 41, 41), (8, 8), (100, 100))
    (32, 32, 48, 48)
    """
    left, right = _grown(window[0], window[2], min(_ROOM * shape[1], size[1]))
    top, bottom = _grown(window[1], window[3], min(_ROOM * shape[0], size[0]))
    return left, top, right, bottom


def _grown(first: int, last: int, least: int) -> tuple[int, int]:
    if last - first >= least:
        return first, last
    start = (first + last - least) // 2
    return start, start + least


def cut(image: NDArray, window: Window) -> NDArray:
    """The window of an image, its border pixels repeated where it reaches beyond.

    Parameters
    ----------
    image : (H, W, ...) array
    """
    left, top, right, bottom = window
    rows = np.clip(np.arange(top, bottom), 0, image.shape[0] - 1)
    columns = np.clip(np.arange(left, right), 0, image.shape[1] - 1)
    return image[rows[:, None], columns]


def matrix_of(window: Window, size: tuple[int, int]) -> NDArray[np.float64]:
    """From texture coordinates of an image to those of a map that covers a window of it, for row vectors.

    Parameters
    ----------
    size : (int, int)
        Rows and columns of the image.

    Returns
    -------
    (3, 3) float64
        ``[s t 1] @ matrix``; what `inputs:matrix` holds.

    Examples
    --------
    >>> [0.5, 0.5, 1.0] @ matrix_of((0, 0, 100, 100), (100, 100))
    array([0.5, 0.5, 1. ])
    """
    left, top, right, bottom = window
    height, width = size
    matrix = np.eye(3)
    matrix[0, 0], matrix[1, 1] = width / (right - left), height / (bottom - top)
    matrix[2, 0], matrix[2, 1] = -left / (right - left), (bottom - height) / (bottom - top)
    return matrix
