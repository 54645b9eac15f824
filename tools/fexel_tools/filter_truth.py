"""What a pixel should show: the mean of a texture over the pixel's preimage, exactly for a box, and for a Gaussian.

The texture is bilinear between the centres of its texels, as it is when magnified. Nothing here knows of mip levels.

*Box*: the mean over the parallelogram ``J [-1/2, 1/2]^2``. By Green's theorem it is an integral along the four edges,
of the texture's antiderivative along x; between two crossings of the grid of texel centres that is a cubic along the
edge, which Gauss's rule with two points integrates exactly. The cost is that of the outline, not of the area. Where the
parallelogram has no area, it is the mean along a segment, piecewise quadratic, and as exact.

*Gaussian*: of standard deviation `SIGMA` pixels (Heckbert's elliptical weighted average), out to `REACH` of these.
Along the ellipse's shorter axis by Gauss's rule between the kinks of the texture; along the longer one by the
trapezoidal rule from line to line, half a texel apart, where it converges faster than any power of that distance.

Coordinates are texels, x right, y down, texel (i, j) covering [i, i + 1) x [j, j + 1); images (H, W, 4) are linear,
premultiplied, row 0 at the top; wrap modes are UsdUVTexture's.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError

__all__ = ["REACH", "SIGMA", "TRUTHS", "FilterTruth"]

TRUTHS = ("box", "gauss")

SIGMA = 0.5
"""Standard deviation of the Gaussian, in pixels: exp(-2 r^2) at r pixels, as EWA has it."""

REACH = 4.5
"""Standard deviations out to which the Gaussian is summed; 4e-5 of its weight lies beyond."""

_BLOCK = 64  # pixels that a thread takes at a time
_FARTHEST = 1e9  # texels: beyond, coordinates have no fraction left to speak of

_CODES = {"repeat": 0, "mirror": 1, "clamp": 2, "black": 3}


@dataclass(frozen=True, eq=False)
class FilterTruth:
    """A texture, ready to be averaged.

    Attributes
    ----------
    texels : (H, W, 4) float64
    wrap : (int, int)
        Codes along x and y.
    along : (H, W + 1, 4) float64
        Texels of a row summed up from the left: the antiderivative at texel centres follows from it.
    """

    texels: NDArray[np.float64]
    wrap: tuple[int, int]
    along: NDArray[np.float64]

    @classmethod
    def of(cls, image: NDArray[np.floating], wrap: tuple[str, str] = ("repeat", "repeat")) -> FilterTruth:
        """Of (H, W, 4), linear, premultiplied.

        Raises
        ------
        FexelError
            An unknown wrap mode.
        """
        for mode in wrap:
            if mode not in _CODES:
                raise FexelError(f"wrap mode {mode!r}: expected one of {', '.join(_CODES)}")
        texels, codes = _unfolded(np.asarray(image, np.float64), wrap)
        middle = 0.5 * (texels + _next(texels, codes[0]))
        along = np.concatenate([np.zeros_like(texels[:, :1]), np.cumsum(middle, axis=1)], axis=1)
        return cls(np.ascontiguousarray(texels), codes, np.ascontiguousarray(along))

    def mean(self, kind: str, xy: NDArray[np.float64], jacobian: NDArray[np.float64]) -> NDArray[np.float64]:
        """What pixels should show.

        Parameters
        ----------
        kind : str
            ``box`` or ``gauss``.
        xy : (M, 2) float64
            Where their centres fall.
        jacobian : (M, 2, 2) or (2, 2) float64
            Texels per pixel, column j along the pixel's x, y.

        Returns
        -------
        (M, 4) float64
            Linear, premultiplied. NaN where the input is not finite, or farther off than 1e9 texels.

        Raises
        ------
        FexelError
            There is no such truth.
        """
        if kind not in TRUTHS:
            raise FexelError(f"truth {kind!r}: expected one of {', '.join(TRUTHS)}")
        xy = np.ascontiguousarray(xy, np.float64).reshape(-1, 2)
        jacobian = np.ascontiguousarray(np.broadcast_to(jacobian, (len(xy), 2, 2)), np.float64)
        result = np.empty((len(xy), 4))
        sure = np.isfinite(xy).all(axis=1) & (np.abs(jacobian).max(axis=(1, 2), initial=0.0) < _FARTHEST)
        sure &= np.abs(np.nan_to_num(xy)).max(axis=1, initial=0.0) < _FARTHEST
        result[~sure] = np.nan
        own = np.empty((int(sure.sum()), 4))
        places, footprints = xy[sure] - 0.5, jacobian[sure]

        def work(part: slice) -> None:
            if kind == "box":
                _box(self.texels, self.along, self.wrap, places[part], footprints[part], own[part])
            else:
                _gauss(self.texels, self.wrap, places[part], footprints[part], 1, own[part])

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(work, [slice(first, first + _BLOCK) for first in range(0, len(own), _BLOCK)]))
        result[sure] = own
        return result


def _unfolded(texels: NDArray[np.float64], wrap: tuple[str, str]) -> tuple[NDArray[np.float64], tuple[int, int]]:
    """The image as one that repeats, clamps or is black outside along each axis: a mirrored one is laid out twice."""
    codes = []
    for axis, mode in ((1, wrap[0]), (0, wrap[1])):
        if mode == "mirror":
            texels = np.concatenate([texels, np.flip(texels, axis)], axis=axis)
        codes.append(0 if mode in ("repeat", "mirror") else _CODES[mode])
    return texels, (codes[0], codes[1])


def _next(texels: NDArray[np.float64], code: int) -> NDArray[np.float64]:
    """The texel to the right of each."""
    if code == 0:
        return np.roll(texels, -1, axis=1)
    last = texels[:, -1:] if code == _CODES["clamp"] else np.zeros_like(texels[:, :1])
    return np.concatenate([texels[:, 1:], last], axis=1)


@numba.njit(cache=True, nogil=True)
def _row(y, height, code):
    """Index of a row by its whole coordinate; -1 where it is black."""
    if code == 0:
        return y % height
    if code == 3 and (y < 0 or y >= height):
        return -1
    return min(max(y, 0), height - 1)


@numba.njit(cache=True, nogil=True)
def _add_antiderivative(texels, along, wrap, x, y, weight, out):
    """Add weight times the integral along x from 0 to x of the texture in row y; texel centres are whole numbers."""
    height, width = texels.shape[:2]
    row = math.floor(y)
    for side in range(2):
        share = weight * ((y - row) if side else 1.0 - (y - row))
        j = _row(row + side, height, wrap[1])
        if j >= 0 and share != 0.0:
            _add_along_row(texels[j], along[j], width, wrap[0], x, share, out)


@numba.njit(cache=True, nogil=True)
def _add_along_row(texels, along, width, code, x, share, out):
    column = math.floor(x)
    if code == 0:
        turns = column // width
        i, part = column - turns * width, x - column
        following = i + 1 if i + 1 < width else 0
        for c in range(4):
            slope = texels[following, c] - texels[i, c]
            inside = along[i, c] + part * (texels[i, c] + 0.5 * part * slope)
            out[c] += share * (turns * along[width, c] + inside)
        return
    black = code == 3
    for c in range(4):
        before = 0.0 if black else texels[0, c]
        beyond = 0.0 if black else texels[width - 1, c]
        if column < -1:
            # From 0 leftwards: the texel between -1 and 0 rises from `before`, all farther ones are `before`.
            total = -0.5 * (before + texels[0, c]) + before * (x + 1.0)
        elif column == -1:
            part = x + 1.0
            total = -0.5 * (before + texels[0, c]) + part * (before + 0.5 * part * (texels[0, c] - before))
        elif column < width:
            part = x - column
            right = texels[column + 1, c] if column + 1 < width else beyond
            total = along[column, c] + part * (texels[column, c] + 0.5 * part * (right - texels[column, c]))
        else:
            total = along[width, c] + beyond * (x - width)
        out[c] += share * total


@numba.njit(cache=True, nogil=True)
def _add_bilinear(texels, wrap, x, y, weight, out):
    """Add weight times the texture at a place; texel centres are whole numbers."""
    height, width = texels.shape[:2]
    column, row = math.floor(x), math.floor(y)
    for side in range(4):
        right, below = side & 1, side >> 1
        share = weight * ((x - column) if right else 1.0 - (x - column)) * ((y - row) if below else 1.0 - (y - row))
        i, j = _row(column + right, width, wrap[0]), _row(row + below, height, wrap[1])
        if i >= 0 and j >= 0:
            for c in range(4):
                out[c] += share * texels[j, i, c]


@numba.njit(cache=True, nogil=True)
def _stops(ax, ay, bx, by, parts):
    """Where along the way from a to b, in [0, 1], a coordinate is whole, or one of so many parts ends; sorted."""
    room = int(abs(bx - ax) + abs(by - ay)) + 6 + parts
    stops = np.empty(room)
    count = 0
    for i in range(parts + 1):
        stops[count] = i / parts
        count += 1
    for start, end in ((ax, bx), (ay, by)):
        for whole in range(math.floor(min(start, end)) + 1, math.ceil(max(start, end))):
            stops[count] = (whole - start) / (end - start)
            count += 1
    return np.sort(stops[:count])


@numba.njit(cache=True, nogil=True)
def _add_edge(texels, along, wrap, ax, ay, bx, by, segment, out):
    """Add the integral along an edge: of the antiderivative times dy, or, of a segment, of the texture itself."""
    if not segment and ay == by:
        return
    stops = _stops(ax, ay, bx, by, 1)
    for i in range(len(stops) - 1):
        half = 0.5 * (stops[i + 1] - stops[i])
        for sign in (-1.0, 1.0):
            t = stops[i] + half * (1.0 + sign / math.sqrt(3.0))  # Gauss's two points
            x, y = ax + t * (bx - ax), ay + t * (by - ay)
            if segment:
                _add_bilinear(texels, wrap, x, y, half, out)
            else:
                _add_antiderivative(texels, along, wrap, x, y, half * (by - ay), out)


@numba.njit(cache=True, nogil=True)
def _box(texels, along, wrap, places, jacobians, result):
    for k in range(len(places)):
        # Whole turns of a repeating texture are taken off: coordinates near 0 keep their digits.
        x, y = places[k]
        if wrap[0] == 0:
            x -= texels.shape[1] * math.floor(x / texels.shape[1])
        if wrap[1] == 0:
            y -= texels.shape[0] * math.floor(y / texels.shape[0])
        a, b, c, d = jacobians[k, 0, 0], jacobians[k, 0, 1], jacobians[k, 1, 0], jacobians[k, 1, 1]
        area = a * d - b * c
        reach = abs(a) + abs(b) + abs(c) + abs(d)
        out = np.zeros(4)
        if abs(area) <= 1e-9 * reach * reach or abs(area) < 1e-200:  # dividing by it would cost nine digits, or all
            _add_segment(texels, along, wrap, x, y, a, b, c, d, out)
            result[k] = out
            continue
        corners = ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))
        for e in range(4):
            s, t = corners[e]
            u, v = corners[(e + 1) % 4]
            _add_edge(
                texels, along, wrap,
                x + a * s + b * t, y + c * s + d * t, x + a * u + b * v, y + c * u + d * v, False, out,
            )  # fmt: skip
        result[k] = out / area


@numba.njit(cache=True, nogil=True)
def _add_segment(texels, along, wrap, x, y, a, b, c, d, out):
    """A parallelogram without area: the mean along its longer side, of means along the shorter one."""
    if a * a + c * c < b * b + d * d:
        a, b, c, d = b, a, d, c
    steps = 1 if b == 0.0 and d == 0.0 else 16
    for i in range(steps):
        t = (i + 0.5) / steps - 0.5
        own = np.zeros(4)
        ax, ay = x + b * t - 0.5 * a, y + d * t - 0.5 * c
        _add_edge(texels, along, wrap, ax, ay, ax + a, ay + c, True, own)
        out += own / steps


@numba.njit(cache=True, nogil=True)
def _axes(a, b, c, d):
    """The axes of the ellipse that a matrix makes of the unit circle, (ux, uy), (vx, vy), the longer one first."""
    angle = 0.5 * math.atan2(2.0 * (a * b + c * d), (a * a + c * c) - (b * b + d * d))
    s, t = math.cos(angle), math.sin(angle)
    return a * s + b * t, c * s + d * t, -a * t + b * s, -c * t + d * s


@numba.njit(cache=True, nogil=True)
def _gauss(texels, wrap, places, jacobians, finer, result):
    for k in range(len(places)):
        x, y = places[k]
        ux, uy, vx, vy = _axes(jacobians[k, 0, 0], jacobians[k, 0, 1], jacobians[k, 1, 0], jacobians[k, 1, 1])
        step = _line_step(max(abs(ux), abs(uy))) / finer
        lines = int(4.5 / step)
        out, total = np.zeros(4), np.zeros(1)
        for i in range(-lines, lines + 1):
            s = i * step
            _add_line(
                texels, wrap, x + 0.5 * s * ux, y + 0.5 * s * uy, vx, vy, math.exp(-0.5 * s * s), 9 * finer, out, total
            )
        result[k] = out / total[0]


@numba.njit(cache=True, nogil=True)
def _line_step(extent):
    """Standard deviations from line to line: half a texel of the axis that the ellipse mostly runs along, or less."""
    deviation = 0.5 * extent
    if deviation < 0.3:
        return 0.5  # the ellipse is smaller than a texel: nothing changes from line to line but the Gaussian
    return (0.5 if deviation >= 2.0 else 0.125) / deviation


@numba.njit(cache=True, nogil=True)
def _add_line(texels, wrap, x, y, vx, vy, weight, parts, out, total):
    """Add the integral along the shorter axis of the ellipse: by Gauss's rule with three points between kinks."""
    ax, ay, bx, by = x - 2.25 * vx, y - 2.25 * vy, x + 2.25 * vx, y + 2.25 * vy
    stops = _stops(ax, ay, bx, by, parts)
    for i in range(len(stops) - 1):
        length = stops[i + 1] - stops[i]
        if length <= 0.0:
            continue
        for sign in (-1.0, 0.0, 1.0):
            t = stops[i] + 0.5 * length * (1.0 + sign * math.sqrt(0.6))
            s = 9.0 * t - 4.5
            share = weight * length * (8.0 if sign == 0.0 else 5.0) * math.exp(-0.5 * s * s)
            total[0] += share
            _add_bilinear(texels, wrap, ax + t * (bx - ax), ay + t * (by - ay), share, out)
