"""Bilinear and trilinear lookups in float64 NumPy, fast enough for a megapixel: what GL's sampler does for a pinchmap.

Images are (H, W, C), row 0 at the top; s runs right, t runs up; M points, taken in blocks that stay in the cache.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

__all__ = ["Lattice", "blocks", "trilinear"]

_BLOCK = 1 << 14


def blocks(count: int, length: int = _BLOCK) -> Iterator[slice]:
    """Slices of at most `length` that cover `count` points."""
    return (slice(start, min(start + length, count)) for start in range(0, count, length))


class Lattice:
    """A pinchmap's texels by cell of its mask, fetched at st + 0.5 / size, with the row and column at s = 1 and t = 1.

    A cell is the flat index of the texel at its lower left corner, a fraction in [0, 1]^2 the place within it.

    Parameters
    ----------
    texels : (Nh, Nw, C)
        d_s, d_t, k, gamma; C = 1 will do for `locate` and `interpolate`.
    wrap : (str, str)
        ``repeat``, ``mirror``; all else clamps.
    """

    def __init__(self, texels: NDArray[np.floating], wrap: tuple[str, str]) -> None:
        self._wrap = wrap
        self._size = np.array([texels.shape[1], texels.shape[0]], np.float64)
        self._stride = texels.shape[1] + 1
        margins = ["wrap" if mode == "repeat" else "edge" for mode in wrap]
        upward = np.pad(np.asarray(texels, np.float64)[::-1], ((0, 1), (0, 0), (0, 0)), mode=margins[1])  # pyright: ignore[reportCallIssue, reportArgumentType]
        upward = np.pad(upward, ((0, 0), (0, 1), (0, 0)), mode=margins[0])  # pyright: ignore[reportCallIssue, reportArgumentType]
        self._texels = upward.reshape(-1, texels.shape[2])
        moved = (np.abs(upward[..., :2]) > 0).any(2)
        active = np.zeros_like(moved)
        active[:-1, :-1] = moved[:-1, :-1] | moved[:-1, 1:] | moved[1:, :-1] | moved[1:, 1:]
        self._active = active.reshape(-1)

    @cached_property
    def _edge(self) -> NDArray[np.float64]:
        return self._texels[:, 2] - self._texels[:, 3]

    @property
    def size(self) -> NDArray[np.float64]:
        """(2,), width and height in texels."""
        return self._size

    def locate(self, st: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
        """Cells (M,), fractions (M, 2), and d(wrapped)/d(st), (M, 2): 1, -1 where mirrored, 0 where clamped."""
        position = np.empty_like(st)
        direction = np.ones_like(st)
        for axis, mode in enumerate(self._wrap):
            x = st[:, axis]
            if mode == "repeat":
                position[:, axis] = x - np.floor(x)
            elif mode == "mirror":
                x = x - 2 * np.floor(0.5 * x + 0.5)
                direction[:, axis] = np.where(x < 0, -1, 1)
                position[:, axis] = np.abs(x)
            else:
                position[:, axis] = np.clip(x, 0, 1)
                direction[:, axis] = position[:, axis] == x
        position *= self._size
        corner = np.minimum(np.floor(position), self._size - 1)
        return (corner[:, 1] * self._stride + corner[:, 0]).astype(np.intp), position - corner, direction

    def is_active(self, cell: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Whether any corner of the cells has a direction: elsewhere nothing is displaced."""
        return self._active[cell]

    def active_cells(self) -> NDArray[np.bool_]:
        """The same of all cells: (Nh, Nw), row 0 at the top."""
        return self._active.reshape(-1, self._stride)[-2::-1, :-1]

    def interpolate(self, cell: NDArray[np.intp], fraction: NDArray[np.float64]) -> NDArray[np.float64]:
        """Bilinear interpolation, (M, C)."""
        s, t = fraction[:, :1], fraction[:, 1:]
        low = self._texels[cell]
        low = low + s * (self._texels[cell + 1] - low)
        high = self._texels[cell + self._stride]
        high = high + s * (self._texels[cell + self._stride + 1] - high)
        return low + t * (high - low)

    def edge_slope(self, cell: NDArray[np.intp], fraction: NDArray[np.float64]) -> NDArray[np.float64]:
        """d(k - gamma)/d(position), (M, 2), per texel."""
        edge = self._edge
        across = edge[cell + 1] - edge[cell]
        twist = edge[cell + self._stride + 1] - edge[cell + self._stride] - across
        up = edge[cell + self._stride] - edge[cell]
        return np.stack([across + fraction[:, 1] * twist, up + fraction[:, 0] * twist], 1)


def trilinear(
    levels: Sequence[NDArray[np.floating]], st: NDArray[np.float64], lod: NDArray[np.float64], wrap: tuple[str, str]
) -> NDArray[np.float64]:
    """Look a mip-mapped image up.

    Parameters
    ----------
    levels : sequence of (H, W, C)
        Finest first.
    st : (M, 2)
    lod : (M,)
        Mip level, clamped to those there are.
    wrap : (str, str)
        ``repeat``, ``mirror``, ``black`` (zero outside), else clamp.

    Returns
    -------
    (M, C) float64
    """
    result = np.empty((len(st), levels[-1].shape[2]))
    for block in blocks(len(st)):
        level = np.clip(lod[block], 0, len(levels) - 1)
        place, low, high = st[block], int(level.min()), int(np.ceil(level.max()))
        if low == high:
            result[block] = _bilinear(levels[low], place, wrap)
            continue
        result[block] = 0.0
        for number in range(low, high + 1):
            weight = 1 - np.abs(level - number)
            used = np.flatnonzero(weight > 0)
            if len(used):
                result[block.start + used] += weight[used, None] * _bilinear(levels[number], place[used], wrap)
    return result


def _bilinear(image: NDArray[np.floating], st: NDArray[np.float64], wrap: tuple[str, str]) -> NDArray[np.float64]:
    height, width, count = image.shape
    x, y = st[:, 0] * width - 0.5, (1 - st[:, 1]) * height - 0.5
    column, row = np.floor(x), np.floor(y)
    left, left_weight = _wrapped(column, width, wrap[0], 1 - (x - column))
    right, right_weight = _wrapped(column + 1, width, wrap[0], x - column)
    top, top_weight = _wrapped(row, height, wrap[1], 1 - (y - row))
    bottom, bottom_weight = _wrapped(row + 1, height, wrap[1], y - row)
    texels = image.reshape(-1, count)
    upper = texels[top * width + left] * left_weight + texels[top * width + right] * right_weight
    lower = texels[bottom * width + left] * left_weight + texels[bottom * width + right] * right_weight
    return upper * top_weight + lower * bottom_weight


def _wrapped(
    index: NDArray[np.float64], size: int, mode: str, weight: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Texel numbers along an axis, and their weights (M, 1): 0 for the border of ``black``."""
    if mode == "repeat":
        number = np.mod(index, size)
    elif mode == "mirror":
        period = np.mod(index, 2 * size)
        number = np.where(period < size, period, 2 * size - 1 - period)
    else:
        number = np.clip(index, 0, size - 1)
        if mode == "black":
            weight = np.where((index >= 0) & (index < size), weight, 0.0)
    return number.astype(np.intp), weight[:, None]
