"""Cheapest paths from every pixel to the border of an image, exact in integers and stopped at a limit.

Node-weighted shortest paths over 8 neighbours: ``d(p) = min(limit, c(p) + min d(q))`` over neighbours q, ``d = 0`` on
the border. Dijkstra's algorithm with a queue of cost buckets (Dial 1969), 2^15 of them up to the limit. As the cost is
the entered pixel's own, the first pixel that reaches another is its cheapest predecessor: each pixel is queued
once, up to the width of a bucket; where a bucket's order was wrong the pixel is queued again, so the result is exact.
Only pixels below the limit are visited. Each bucket is a linked list in one array over the pixels.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["LIMIT", "cost_bound", "gradient", "integer_costs", "path_costs"]

LIMIT = 1 << 29  # integer cost of the limit: a sum of two stays below 2^31
_SHIFT = 14  # 2^15 buckets
_NOT_QUEUED, _END = -2, -1


@numba.njit(cache=True, inline="always")
def _slope(before, here, after):
    """Half the absolute difference of two neighbours; one that is not a number is replaced by the pixel itself."""
    if not np.isfinite(before):
        before = here
    if not np.isfinite(after):
        after = here
    return abs(after - before) * np.float32(0.5)


@numba.njit(cache=True, nogil=True)
def gradient(channel):
    """|I_x| + |I_y| (H, W) float32 of a contiguous float32 channel; 0 on the outermost pixels and where not finite."""
    height, width = channel.shape
    out = np.zeros((height, width), np.float32)
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            here = channel[y, x]
            if np.isfinite(here):
                out[y, x] = _slope(channel[y, x - 1], here, channel[y, x + 1]) + _slope(
                    channel[y - 1, x], here, channel[y + 1, x]
                )
    return out


@numba.njit(cache=True, nogil=True)
def cost_bound(cost):
    """Bound of every path cost: half of the dearest row (or column, if less) plus the dearest pixel."""
    height, width = cost.shape
    rows, columns = np.zeros(height), np.zeros(width)
    dearest = 0.0
    for y in range(height):
        for x in range(width):
            value = np.float64(cost[y, x])
            rows[y] += value
            columns[x] += value
            dearest = max(dearest, value)
    return min(rows.max(), columns.max()) / 2 + dearest


@numba.njit(cache=True, nogil=True)
def integer_costs(cost, limit):
    """Costs (H, W) int32 in units of ``limit / LIMIT``, rounded, at most LIMIT."""
    height, width = cost.shape
    out = np.empty((height, width), np.int32)
    scale = LIMIT / limit
    for y in range(height):
        for x in range(width):
            out[y, x] = np.int32(min(np.float64(LIMIT), cost[y, x] * scale + 0.5))
    return out


@numba.njit(cache=True, nogil=True)
def path_costs(cost, border):
    """Least path costs (H, W) int32, at most LIMIT.

    `cost` (H, W) int32 in [0, LIMIT], contiguous; `border` (H, W) bool, true at least on the outermost pixels.
    """
    height, width = cost.shape
    distance = np.empty(height * width, np.int32)
    following = np.full(height * width, _NOT_QUEUED, np.int32)
    first = np.full((LIMIT >> _SHIFT) + 1, _END, np.int32)
    cost, on_border = cost.ravel(), border.ravel()
    for p in range(height * width):
        distance[p] = np.int32(0) if on_border[p] else np.int32(LIMIT)
    for p in range(height * width):
        if not on_border[p] and cost[p] < LIMIT and _touches(on_border, p, width):
            _queue(first, following, p, cost[p] >> _SHIFT)
            distance[p] = cost[p]
    for bucket in range(len(first)):
        while first[bucket] != _END:
            p = np.int64(first[bucket])
            first[bucket] = following[p]
            following[p] = _NOT_QUEUED
            for middle in (p - width, p, p + width):
                for q in range(middle - 1, middle + 2):
                    candidate = distance[p] + cost[q]
                    if candidate < distance[q]:
                        distance[q] = candidate
                        if following[q] == _NOT_QUEUED:
                            _queue(first, following, q, max(candidate >> _SHIFT, bucket))
    return distance.reshape(height, width)


@numba.njit(cache=True, inline="always")
def _queue(first, following, p, bucket):
    following[p] = first[bucket]
    first[bucket] = p


@numba.njit(cache=True, nogil=True)
def _touches(on_border, p, width):
    for middle in (p - width, p, p + width):
        if on_border[middle - 1] or on_border[middle] or on_border[middle + 1]:
            return True
    return False
