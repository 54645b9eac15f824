"""Pinch strength: a discontinuity fades where the source's own boundary is soft.

Section 7.2, last paragraph, of Tarini and Cignoni 2005 sets the strength of a texel to zero where alpha around the
discontinuity is far from 0 and 1. Here it falls gradually. At every place where the source's side crosses 1/2 the width
w of its transition is the range of the side thereabouts over the gradient at the crossing, and

    strength = 1 - min(1, w' / f)^0.6,   w' = max(0, w - 3 px)

where f is the width of a signal texel: what the transition would be without a pinch. The exponent is a fit to the
strength of least mean squared error between a ramp of width w and the profile that a fexel pinched by that strength
shows (section 6.2, eq. (4); gamma = 0, signal and pinchmap of one size): 0.90, 0.74, 0.51, 0.34, 0.12 and 0 at w / f =
0.02, 0.1, 0.3, 0.5, 0.8 and 1, which the formula meets within 0.01. Three pixels are what the edge of an anti-aliased
or resampled drawing may take: such an edge is hard, and its strength exactly 1.

A texel's strength is the mean over the crossings within one texel of it, weighted as in bilinear interpolation, so
that it changes smoothly along the line (section 6.2: smooth starts).
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["HARD_WIDTH_PX", "boundary_strength", "strength_of_width"]

HARD_WIDTH_PX = 3.0
"""Transitions up to this width, in source pixels, are hard edges."""
_EXPONENT = 0.6
_LEAST = 0.02  # weaker pinches are none: a hundredth of a texel could not be told apart


def boundary_strength(
    side: NDArray[np.floating],
    pinchmap: NDArray[np.floating],
    signal_shape: tuple[int, int],
    *,
    wrap: tuple[str, str] = ("clamp", "clamp"),
) -> NDArray[np.float64]:
    """Strength of every texel, by which d_s and d_t are to be multiplied.

    Parameters
    ----------
    side : (H, W) float
        Of the source, in [0, 1]; soft where its boundary is soft. Not finite: no crossing there.
    pinchmap : (Nh, Nw, 4) float
        Of which only the size and which texels are active (k = 0) count.
    signal_shape : (int, int)
        Rows and columns of the signal: the finer it is, the narrower the transition of a fexel that is not pinched.
    wrap : (str, str)
        Along s and t; ``repeat`` joins the borders.

    Returns
    -------
    (Nh, Nw) float64
        In [0, 1]; 1 in texels that are not active, and in active ones without a crossing nearby.

    Examples
    --------
    >>> side = np.zeros((64, 64)); side[:, 32:] = 1
    >>> pinchmap = np.zeros((4, 4, 4))
    >>> boundary_strength(side, pinchmap, (4, 4)).min()
    np.float64(1.0)
    """
    side = np.ascontiguousarray(side, np.float32)
    shape = pinchmap.shape[:2]
    wraps = (wrap[0] == "repeat", wrap[1] == "repeat")
    fexel = np.sqrt(side.shape[0] / signal_shape[0] * (side.shape[1] / signal_shape[1]))
    deficit, weight = _deficits(side, _ranges(side, shape, wraps), shape, wraps, fexel)
    strength = 1.0 - np.divide(deficit, weight, out=np.zeros(shape), where=weight > 0)
    strength[strength < _LEAST] = 0.0
    return np.where(np.asarray(pinchmap)[..., 2] == 0, strength[::-1], 1.0)


def strength_of_width(width_px: float, fexel_px: float) -> float:
    """Strength that shows a transition of some width best, in [0, 1].

    Parameters
    ----------
    width_px : float
        Of the source's transition, from 0 to 1 at the slope that it has in the middle; source pixels.
    fexel_px : float
        Width of a signal texel in source pixels.

    Returns
    -------
    float
    """
    return 1.0 - _deficit(width_px, fexel_px)


@numba.njit(cache=True, inline="always")
def _deficit(width, fexel):
    return min(1.0, max(0.0, width - HARD_WIDTH_PX) / fexel) ** _EXPONENT


@numba.njit(cache=True, nogil=True)
def _ranges(side, shape, wraps):
    """Largest less smallest side in the three by three cells around every cell; rows down. (Nh, Nw) float64."""
    height, width = side.shape
    low, high = np.full(shape, np.inf), np.full(shape, -np.inf)
    for y in range(height):
        row = y * shape[0] // height
        for x in range(width):
            column = x * shape[1] // width
            low[row, column] = min(low[row, column], side[y, x])
            high[row, column] = max(high[row, column], side[y, x])
    result = np.empty(shape)
    for row in range(shape[0]):
        for column in range(shape[1]):
            most, least = -np.inf, np.inf
            for step in range(9):
                y, x = row + step // 3 - 1, column + step % 3 - 1
                y = y % shape[0] if wraps[1] else min(max(y, 0), shape[0] - 1)
                x = x % shape[1] if wraps[0] else min(max(x, 0), shape[1] - 1)
                most, least = max(most, high[y, x]), min(least, low[y, x])
            result[row, column] = max(most - least, 0.0)
    return result


@numba.njit(cache=True, inline="always")
def _slope(side, y, x, wraps):
    """Gradient per pixel by central differences, one-sided at borders that do not repeat."""
    height, width = side.shape
    left, right, up, down = x - 1, x + 1, y - 1, y + 1
    if wraps[0]:
        left, right = left % width, right % width
    if wraps[1]:
        up, down = up % height, down % height
    left, right, up, down = max(left, 0), min(right, width - 1), max(up, 0), min(down, height - 1)
    dx = (side[y, right] - side[y, left]) / (2.0 if right != x and left != x else 1.0)
    dy = (side[down, x] - side[up, x]) / (2.0 if up != y and down != y else 1.0)
    return np.sqrt(dx * dx + dy * dy)


@numba.njit(cache=True, nogil=True)
def _deficits(side, ranges, shape, wraps, fexel):
    """Sums over crossings of 1 - strength and of weights, at the texels; rows upwards. 2 x (Nh, Nw) float64."""
    height, width = side.shape
    deficit, weight = np.zeros(shape), np.zeros(shape)
    for y in range(height):
        for x in range(width):
            above = side[y, x] > 0.5
            for direction in range(2):
                ny, nx = (y, x + 1) if direction == 0 else (y + 1, x)
                if (nx == width and not wraps[0]) or (ny == height and not wraps[1]):
                    continue
                if (side[ny % height, nx % width] > 0.5) == above:
                    continue
                slope = max(_slope(side, y, x, wraps), _slope(side, ny % height, nx % width, wraps))
                amplitude = ranges[y * shape[0] // height, x * shape[1] // width]
                if not (np.isfinite(slope) and np.isfinite(amplitude) and slope > 0.0):
                    continue
                lost = _deficit(amplitude / slope, fexel)
                u = (0.5 * (x + nx) + 0.5) / width * shape[1]
                v = (1.0 - (0.5 * (y + ny) + 0.5) / height) * shape[0]
                i, j = int(np.floor(u)), int(np.floor(v))
                for dj in range(2):
                    row = (j + dj) % shape[0] if wraps[1] else min(max(j + dj, 0), shape[0] - 1)
                    for di in range(2):
                        column = (i + di) % shape[1] if wraps[0] else min(max(i + di, 0), shape[1] - 1)
                        share = (u - i if di else 1.0 - (u - i)) * (v - j if dj else 1.0 - (v - j))
                        deficit[row, column] += share * lost
                        weight[row, column] += share
    return deficit, weight
