"""Poisson image editing on a rectangle: a child photo made to meet its parent on a one-pixel ring.

Perez, Gangnet and Blake 2003, *Poisson Image Editing*, as section 4 of the zipmap paper (Eisemann and Magnor 2010)
uses it: the guidance is the child's own gradient, the Dirichlet border the parent warped into the child's domain. The
solution is then the child plus the discrete harmonic function (five-point Laplacian zero) whose values on the ring are
parent minus child, so only ring values enter. That function is computed exactly:

1. The bilinear function through the four corners is harmonic; subtracting it leaves a ring that is zero at the corners.
2. A sine transform along the rows diagonalises the Laplacian in x. For each of the frequencies remains
   ``d u(y) - u(y-1) - u(y+1) = f(y)``, ``d = 4 - 2 cos(pi k / (W-1))``, where f is the left and right border's share.
   With ``d = r + 1/r`` it factors into two first-order recursions, one down and one up (float64 accumulators).
3. One inverse sine transform along the rows gives the function. There is no forward transform of the image.

Images are (H, W, C), linear light; every function keeps float64 when it is given float64 and computes in float32
otherwise. Nothing is clipped: a solution may leave [0, 1] where parent and child disagree.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import cv2
import numba
import numpy as np
import scipy.fft
from scipy.ndimage import map_coordinates

from fexel.errors import FexelError

__all__ = ["clone", "detailed_border", "good_size", "harmonic", "laplacian_residual", "ring_of", "ring_points"]

_WORKERS = 2  # threads of the transforms and recursions
_COLUMNS = 16  # frequencies per block: one cache line of float32, and a block of 3000 rows stays in the L2 cache


def ring_points(height: int, width: int) -> np.ndarray:
    """Pixel centres of the ring: the first row, the last row, then the rest of the first and of the last column.

    Returns
    -------
    (N, 2) float64
        Continuous pixel coordinates x, y: the centre of the first pixel is (0.5, 0.5). N = 2 (H + W) - 4; for an image
        of one row or one column, which is all ring, every pixel once.
    """
    rows, columns = _ring_indices(height, width)
    return np.stack([columns + 0.5, rows + 0.5], axis=1)


def ring_of(image: np.ndarray) -> np.ndarray:
    """Values (N, C) of an image (H, W, C) at `ring_points`."""
    return image[_ring_indices(*image.shape[:2])]


def good_size(length: int) -> int:
    """Largest size up to `length` whose size minus one has only the factors 2, 3 and 5: fast transforms.

    One of the two sides is enough (`clone` transforms along that one). Lengths below 3 are returned as they are.
    """
    return next((n + 1 for n in range(length - 1, 1, -1) if _roughness(n) <= 5), length)


def clone(child: np.ndarray, border: np.ndarray) -> np.ndarray:
    """Child plus the harmonic function that brings its ring to `border`: Perez 2003, eqs. (3)-(5).

    Parameters
    ----------
    child : (H, W, C) float32 or float64
        Linear light. Non-finite ring pixels count as missing samples; elsewhere NaN stays where it is.
    border : (N, C) float
        What the ring shall be, at `ring_points(H, W)`, linear light. A row with a non-finite value is a missing sample
        (the parent does not reach there): the correction is interpolated linearly along the ring between the
        neighbouring samples. With all of them missing the child is returned unchanged.

    Returns
    -------
    (H, W, C) of the child's dtype
        Exact to rounding for any size; the Laplacian inside is the child's to about 1e-6 in float32.

    Raises
    ------
    FexelError
        When the shapes do not fit each other.
    """
    child = np.asarray(child)
    if child.ndim != 3 or child.size == 0 or np.shape(border) != (len(ring_points(*child.shape[:2])), child.shape[2]):
        raise FexelError(
            f"Poisson: child {child.shape} with border {np.shape(border)}, expected (H, W, C) and (2 (H + W) - 4, C)"
        )
    dtype = np.float64 if child.dtype == np.float64 else np.float32
    child = child.astype(dtype, copy=False)
    ring = _filled(np.asarray(border, np.float64) - ring_of(child), *child.shape[:2])
    out = np.empty_like(child)
    scratch = _scratch(*child.shape[:2], child.dtype)
    for channel in range(child.shape[2]):
        _clone_channel(child, np.ascontiguousarray(ring[:, channel]), channel, out, scratch)
    return out


def detailed_border(child: np.ndarray, border: np.ndarray, texel_px: float) -> np.ndarray:
    """Border of a coarser parent, with the detail added that only the child has there.

    A parent's texel is a mean over `texel_px` child pixels; the child's ring is a line through its finest detail. Where
    that line runs along a dark joint, say, parent minus child is a bias that the harmonic function carries far inside.
    So the parent is compared with the child's means instead: border + child - (child averaged to the parent's
    resolution). The ring itself is transparent (`blend_mask`), so what is gained is the colour behind it. Measured on
    photos cut at scale 4 and 8: the error of the patch's colour falls from 3.3 to 2.3 and from 3.3 to 2.0 of 255.

    Parameters
    ----------
    child : (H, W, C) float
        Linear light.
    border : (N, C) float
        The parent at `ring_points(H, W)`; NaN rows stay NaN.
    texel_px : float
        Side of a parent's texel in child pixels; at 1 or below the border is returned as it is.

    Returns
    -------
    (N, C) float64
        For `clone`.
    """
    border = np.asarray(border, np.float64)
    height, width = child.shape[:2]
    size = max(1, round(width / max(texel_px, 1.0))), max(1, round(height / max(texel_px, 1.0)))
    if not texel_px > 1 or size == (width, height):
        return border
    means = cv2.resize(np.asarray(child, np.float32), size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], -1)
    at = ring_points(height, width) * (np.array(size) / (width, height)) - 0.5
    coarse = [map_coordinates(means[:, :, c], at.T[::-1], order=1, mode="nearest") for c in range(child.shape[2])]
    return border + (ring_of(child) - np.stack(coarse, axis=1))


def harmonic(ring: np.ndarray, height: int, width: int, dtype: type = np.float32) -> np.ndarray:
    """Compute the discrete harmonic function (H, W) with the finite values `ring` (N,) at `ring_points`."""
    out = np.empty((height, width, 1), dtype)
    _clone_channel(np.zeros_like(out), np.asarray(ring, np.float64), 0, out, _scratch(height, width, out.dtype))
    return out[:, :, 0]


def laplacian_residual(image: np.ndarray, guide: np.ndarray) -> float:
    """Largest absolute difference of the five-point Laplacians of two images (H, W, C) inside; 0 if there is none."""
    difference = np.asarray(image, np.float64) - np.asarray(guide, np.float64)
    inside = difference[1:-1, 1:-1]
    neighbours = difference[:-2, 1:-1] + difference[2:, 1:-1] + difference[1:-1, :-2] + difference[1:-1, 2:]
    return float(np.abs(neighbours - 4 * inside).max(initial=0.0))


def _along_rows(height: int, width: int) -> bool:
    """Whether the transform runs along the rows: it is the faster axis, unless only the other has a good size."""
    return _roughness(width - 1) <= max(5, _roughness(height - 1))


def _scratch(height: int, width: int, dtype: type) -> np.ndarray:
    """Make the array for a channel's spectrum, then its correction; reused, as fresh memory costs page faults."""
    inside = (max(height - 2, 0), max(width - 2, 0))
    return np.empty(inside if _along_rows(height, width) else inside[::-1], dtype)


def _clone_channel(child: np.ndarray, ring: np.ndarray, channel: int, out: np.ndarray, scratch: np.ndarray) -> None:
    """Write child plus the harmonic function of `ring` (N,) into one channel of `out`."""
    height, width = out.shape[:2]
    if min(height, width) > 2:
        top, bottom, left, right = _edges(ring, height, width)
        plane = _bilinear_coefficients(top, bottom)
        x, y = np.linspace(0, 1, width), np.linspace(0, 1, height)
        top, bottom = top - _bilinear(plane, x, 0.0), bottom - _bilinear(plane, x, 1.0)
        left, right = left - _bilinear(plane, 0.0, y), right - _bilinear(plane, 1.0, y)
        if _along_rows(height, width):
            inside = _solve(top, bottom, left, right, scratch)
        else:
            inside = _solve(left, right, top, bottom, scratch).T
        _in_parts(height - 2, 1, lambda low, high: _add_harmonic(child, inside, plane, channel, out, low + 1, high + 1))
    index = _ring_indices(height, width)
    out[(*index, channel)] = child[(*index, channel)] + ring


def _in_parts(length: int, unit: int, work: Callable[[int, int], None]) -> None:
    """Call ``work(start, stop)`` in threads for parts of range(length) that begin at multiples of `unit`."""
    bounds = [min(length, int(b) * unit) for b in np.linspace(0, -(-length // unit), _WORKERS + 1)]
    with ThreadPoolExecutor(_WORKERS) as pool:
        list(pool.map(work, bounds[:-1], bounds[1:]))


def _ring_indices(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.arange(width), np.arange(1, height - 1)
    parts = [
        (np.zeros_like(x), x),
        (np.full_like(x, height - 1), x),
        (y, np.zeros_like(y)),
        (y, np.full_like(y, width - 1)),
    ]
    parts = [parts[0], *parts[1 : 2 if height > 1 else 1], *parts[2 : 4 if width > 1 else 3]]
    return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])


def _edges(ring: np.ndarray, height: int, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Top and bottom (W,), left and right (H,), corners included in each."""
    top, bottom, sides = ring[:width], ring[width : 2 * width], ring[2 * width :]
    left = np.concatenate([top[:1], sides[: height - 2], bottom[:1]])
    right = np.concatenate([top[-1:], sides[height - 2 :], bottom[-1:]])
    return top, bottom, left, right


def _filled(ring: np.ndarray, height: int, width: int) -> np.ndarray:
    """Missing samples (rows with a non-finite value) interpolated along the closed ring."""
    known = np.isfinite(ring).all(axis=1)
    if known.all():
        return ring
    if not known.any():
        return np.zeros_like(ring)
    x, y = ring_points(height, width).T - np.array([[width / 2], [height / 2]])
    order = np.argsort(np.arctan2(y / height, x / width), kind="stable")
    place = np.empty(len(ring))
    place[order] = np.arange(len(ring))
    at, where = place[known], place[~known]
    filled = ring.copy()
    for channel in range(ring.shape[1]):
        filled[~known, channel] = np.interp(where, at, ring[known, channel], period=len(ring))
    return filled


def _bilinear_coefficients(top: np.ndarray, bottom: np.ndarray) -> tuple[float, float, float, float]:
    a, b, c = top[0], top[-1] - top[0], bottom[0] - top[0]
    return float(a), float(b), float(c), float(bottom[-1] - a - b - c)


def _bilinear(plane: tuple[float, float, float, float], x: np.ndarray | float, y: np.ndarray | float) -> np.ndarray:
    a, b, c, d = plane
    return a + b * np.asarray(x) + (c + d * np.asarray(x)) * np.asarray(y)


def _roughness(n: int) -> int:
    """Largest prime factor: what the cost of a transform of that length grows with."""
    factor, largest = 2, 1
    while factor * factor <= n:
        while n % factor == 0:
            n, largest = n // factor, factor
        factor += 1
    return max(largest, n)


def _solve(top: np.ndarray, bottom: np.ndarray, left: np.ndarray, right: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Harmonic function inside (H-2, W-2) for edges that vanish at the corners; sine transform along x, in `out`."""
    intervals = len(top) - 1
    k = np.arange(1, intervals)
    # Transform with the factor 1/intervals here, so that the inverse below needs none (scipy's type 1 is 2 sum).
    first, last = (scipy.fft.dst(edge[1:-1], type=1) / (2 * intervals) for edge in (top, bottom))
    weight = np.sin(np.pi * k / intervals) / intervals
    half = np.sin(np.pi * k / (2 * intervals))
    decay = np.exp(-2 * np.arcsinh(half))  # r with r + 1/r = d: cosh(mu) = d/2, sinh(mu/2) = sin(pi k / 2(W-1))
    sides = np.stack([left[1:-1] + right[1:-1], left[1:-1] - right[1:-1]])  # even and odd about the middle
    _in_parts(len(k), _COLUMNS, lambda low, high: _recursions(first, last, weight, decay, sides, out, low, high))
    return scipy.fft.dst(out, type=1, axis=1, workers=_WORKERS, overwrite_x=True)


@numba.njit(cache=True, nogil=True)
def _recursions(first, last, weight, decay, sides, spectrum, start, stop):
    """Solve ``(r + 1/r) u(y) - u(y-1) - u(y+1) = f(y)``, u = first above and last below, for columns start to stop.

    With M = rows + 1: (1 - r E^-1) v = r f downward, (1 - r E) u = v upward. v above the first row follows from
    first = sum_{y=0}^{M-1} r^y v(y) + r^M last.
    """
    tiny = 1e-30  # keeps decaying recursions out of denormal numbers, which are a hundred times slower
    rows, columns = spectrum.shape
    state, other, even, odd = (np.empty(_COLUMNS), np.empty(_COLUMNS), np.zeros(_COLUMNS), np.zeros(_COLUMNS))
    for low in range(start, stop, _COLUMNS):
        count = min(_COLUMNS, columns - low)
        r = decay[low : low + count]
        even[:count:2] = weight[low : low + count : 2]
        odd[1:count:2] = weight[low + 1 : low + count : 2]
        state[:] = 0.0
        other[:] = 0.0
        for y in range(rows):  # state = sum r^y f(y), other = sum r^(M-y) f(y), by Horner's rule
            for i in range(count):
                state[i] = r[i] * (sides[0, rows - 1 - y] * even[i] + sides[1, rows - 1 - y] * odd[i] + state[i] + tiny)
                other[i] = r[i] * (sides[0, y] * even[i] + sides[1, y] * odd[i] + other[i] + tiny)
        for i in range(count):
            power = r[i] ** (rows + 1)
            known = (1 - r[i] * r[i]) * (first[low + i] - power * last[low + i]) - r[i] * (state[i] - power * other[i])
            state[i] = known / (1 - power * power)
            other[i] = last[low + i]
        for y in range(rows):
            for i in range(count):
                state[i] = r[i] * (sides[0, y] * even[i] + sides[1, y] * odd[i] + state[i] + tiny)
                spectrum[y, low + i] = state[i]
        for y in range(rows - 1, -1, -1):
            for i in range(count):
                other[i] = spectrum[y, low + i] + r[i] * other[i]
                spectrum[y, low + i] = other[i]


@numba.njit(cache=True, nogil=True)
def _add_harmonic(child, inside, plane, channel, out, start, stop):
    """``out = child + inside + bilinear`` in rows start to stop, off the ring, one channel; `inside` is (H-2, W-2)."""
    a, b, c, d = plane
    height, width = out.shape[:2]
    for y in range(start, stop):
        t = y / (height - 1)
        base, slope = a + c * t, (b + d * t) / (width - 1)
        for x in range(1, width - 1):
            out[y, x, channel] = child[y, x, channel] + (inside[y - 1, x - 1] + (base + slope * x))
