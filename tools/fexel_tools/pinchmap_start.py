"""A start for the levels of a pinchmap: least squares on points of the source's boundary, compiled.

On the boundary k^B = gamma^B, so that the level g = k - gamma interpolates to 0 there: one linear equation in four
texels for every point where the side image crosses 0.5 between two pixels. Weighted by the gradient of the previous
solution the residual is a distance; weighted again by its inverse (iteratively reweighted least squares) the sum is the
area between the two curves. The signed distance of the texels, at a small weight, fixes the scale, which the zero set
leaves free.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["boundary_points", "least_squares_levels", "reweighted_levels", "source_levels"]

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
_OVER_RELAXATION = 1.5
_SWEEPS = 30


def boundary_points(
    side: NDArray[np.float32], shape: tuple[int, int], window: tuple[float, float, float, float]
) -> NDArray[np.float64]:
    """Where the side image crosses 0.5 between neighbouring pixels.

    Parameters
    ----------
    side : (H, W) float32
        In [0, 1]; above 0.5 is the + side.
    shape : (int, int)
        Rows and columns of the lattice.
    window : (float, float, float, float)
        Left, top, right, bottom of the lattice in pixels.

    Returns
    -------
    (P, 3) float64
        x and y in cells from the upper left corner of the lattice; 0 for a crossing along a row, 1 along a column.
        Points outside the lattice are left out.
    """
    left, top, right, bottom = window
    scale_x, scale_y = shape[1] / (right - left), shape[0] / (bottom - top)
    points = np.empty((_count_crossings(side), 3))
    count = _crossings(side, points, left, top, scale_x, scale_y, shape[0], shape[1])
    return points[:count]


def least_squares_levels(
    points: NDArray[np.float64],
    levels: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    repeat: tuple[bool, bool],
    pixel: float,
    rounds: int = 3,
) -> NDArray[np.float64]:
    """Levels within bounds whose zero set lies near the points.

    Parameters
    ----------
    points : (P, 3) float64
        Of :func:`boundary_points`.
    levels : (Nh, Nw) float64
        Start and, at a small weight, target; as of :func:`source_levels`.
    low, high : (Nh, Nw) float64
        Bounds.
    repeat : (bool, bool)
        Along s and t.
    pixel : float
        Size of a pixel in cells.
    rounds : int
        Of reweighting. More than three follow the corners at the cost of the rest.
    """
    g = np.clip(levels, low, high)
    normal, right_side = np.empty((*g.shape, 9)), np.empty_like(g)
    for turn in range(rounds):
        power = 2.0 if turn < 2 else 1.0
        _assemble(points, g, repeat[1], repeat[0], 0.5 * pixel, np.inf, power, normal, 1.0, right_side, levels)
        _relax(normal, right_side, g, low, high, repeat[1], repeat[0], _SWEEPS, _OVER_RELAXATION)
    return g


def reweighted_levels(
    points: NDArray[np.float64],
    g: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    repeat: tuple[bool, bool],
    nearest: float,
    farthest: float,
) -> NDArray[np.float64]:
    """One round of reweighting more, about levels that are nearly right.

    Parameters
    ----------
    nearest, farthest : float
        In cells: points nearer to the line than this weigh alike; points farther from it, which the map cannot reach,
        do not count.
    """
    result = g.copy()
    normal, right_side = np.empty((*g.shape, 9)), np.empty_like(g)
    _assemble(points, g, repeat[1], repeat[0], nearest, farthest, 1.0, normal, 0.01, right_side, g)
    _relax(normal, right_side, result, low, high, repeat[1], repeat[0], 20, 1.3)
    return result


@_compiled
def _count_crossings(side):
    height, width = side.shape
    count = 0
    for y in range(height):
        for x in range(width):
            plus = side[y, x] > 0.5
            if x + 1 < width and plus != (side[y, x + 1] > 0.5):
                count += 1
            if y + 1 < height and plus != (side[y + 1, x] > 0.5):
                count += 1
    return count


@_compiled
def _crossings(side, points, left, top, scale_x, scale_y, nh, nw):
    height, width = side.shape
    n = 0
    for y in range(height):
        for x in range(width):
            a = side[y, x] - 0.5
            for along in range(2):
                if (along == 0 and x + 1 >= width) or (along == 1 and y + 1 >= height):
                    continue
                b = (side[y, x + 1] if along == 0 else side[y + 1, x]) - 0.5
                if (a > 0) == (b > 0):
                    continue
                share = a / (a - b)
                u = (x + 0.5 + (share if along == 0 else 0.0) - left) * scale_x
                v = (y + 0.5 + (share if along == 1 else 0.0) - top) * scale_y
                if 0 <= u < nw and 0 <= v < nh:
                    points[n, 0], points[n, 1], points[n, 2] = u, v, along
                    n += 1
    return n


@_compiled
def source_levels(crossings, count, plus_at_texel, repeat_t, repeat_s):
    """Signed distance of every texel from the boundary, in cells, at most 1: positive on the + side.

    Parameters
    ----------
    crossings : (count, >= 2) float64
        Points of the boundary: x and y in cells from the upper left corner of the lattice.
    plus_at_texel : (Nh, Nw) bool
        Side of the source at the texels.
    """
    nh, nw = plus_at_texel.shape
    nearest = np.ones((nh, nw))
    for i in range(count):
        x, y = crossings[i, 0], crossings[i, 1]
        for row in range(int(y), int(y) + 2):  # the texels at the corners of its cell
            for column in range(int(x), int(x) + 2):
                square = (y - row) ** 2 + (x - column) ** 2
                r, c = row - 1, column
                if repeat_t:
                    r %= nh
                if repeat_s:
                    c %= nw
                if 0 <= r < nh and 0 <= c < nw and square < nearest[r, c]:
                    nearest[r, c] = square
    for r in range(nh):
        for c in range(nw):
            nearest[r, c] = np.sqrt(nearest[r, c]) * (1.0 if plus_at_texel[r, c] else -1.0)
    return nearest


@_compiled
def _texel(row, column, nh, nw, repeat_t, repeat_s):
    """Texel at a corner of the lattice; corner row 0 is the top side of cell row 0."""
    row -= 1
    if row < 0:
        row = nh - 1 if repeat_t else 0
    if column >= nw:
        column = 0 if repeat_s else nw - 1
    return row, column


@_compiled
def _assemble(points, g, repeat_t, repeat_s, nearest, farthest, power, normal, pull, right_side, target):
    """Normal equations as a stencil: [r, c, 3 (dr + 1) + dc + 1] couples texel [r, c] to [r + dr, c + dc]."""
    nh, nw = g.shape
    normal[:] = 0
    for r in range(nh):
        for c in range(nw):
            normal[r, c, 4] = pull
            right_side[r, c] = pull * target[r, c]
    weights = np.empty(4)
    rows, columns = np.empty(4, np.int64), np.empty(4, np.int64)
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        c, r = int(x), int(y)
        u, v = x - c, y - r
        for k in range(4):
            rows[k], columns[k] = _texel(r + k // 2, c + k % 2, nh, nw, repeat_t, repeat_s)
            weights[k] = (u if k % 2 else 1 - u) * (v if k // 2 else 1 - v)
        tl, tr, bl, br = g[rows[0], columns[0]], g[rows[1], columns[1]], g[rows[2], columns[2]], g[rows[3], columns[3]]
        level = tl * weights[0] + tr * weights[1] + bl * weights[2] + br * weights[3]
        along_x = (tr - tl) * (1 - v) + (br - bl) * v
        along_y = (bl - tl) * (1 - u) + (br - tr) * u
        square = along_x * along_x + along_y * along_y + 1e-3  # 1e-3: a flat spot must not outweigh all else
        slope = np.sqrt(square)
        distance = abs(level) / slope
        if distance > farthest:
            continue
        weight = abs(along_x if points[i, 2] == 0 else along_y) / slope  # of arc length, shared by rows and columns
        weight /= square * max(distance, nearest) ** (2 - power)
        for j in range(4):
            for k in range(4):
                place = 3 * (k // 2 - j // 2 + 1) + k % 2 - j % 2 + 1
                normal[rows[j], columns[j], place] += weight * weights[j] * weights[k]


@_compiled
def _relax(normal, right_side, g, low, high, repeat_t, repeat_s, sweeps, over):
    """Projected Gauss-Seidel with over-relaxation, forwards and backwards in turn."""
    nh, nw = g.shape
    for turn in range(sweeps):
        for i in range(nh):
            for j in range(nw):
                r = i if turn % 2 == 0 else nh - 1 - i
                c = j if turn % 2 == 0 else nw - 1 - j
                rest = right_side[r, c]
                for k in range(9):
                    factor = normal[r, c, k]
                    if k == 4 or factor == 0:
                        continue
                    row, column = r + k // 3 - 1, c + k % 3 - 1
                    if row < 0 or row >= nh:
                        row = row % nh if repeat_t else min(max(row, 0), nh - 1)
                    if column < 0 or column >= nw:
                        column = column % nw if repeat_s else min(max(column, 0), nw - 1)
                    rest -= factor * g[row, column]
                value = g[r, c] + over * (rest / normal[r, c, 4] - g[r, c])
                g[r, c] = min(max(value, low[r, c]), high[r, c])
