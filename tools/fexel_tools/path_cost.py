"""Cheapest paths from every pixel to the border of an image, exact in integers and stopped at a limit.

Node-weighted shortest paths over 8 neighbours: ``d(p) = min(limit, c(p) + min d(q))`` over neighbours q, ``d = 0`` on
the border. Tiles are relaxed in the order in which they are reached (label correcting); within a tile, row sweeps run
down and up until nothing changes, each with a scan to the right and to the left. A tile is taken up again when its
neighbour's edge has changed. The fixed point is unique where costs are positive and, as the distances only ever fall
from the limit, the least-cost solution also where costs are zero. Tiles that only see the limit are never visited.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["TILE", "gradient", "integer_costs", "path_costs"]

TILE = 64  # pixels a side: the costs and distances of a tile, 32 KB, stay in the cache


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
def integer_costs(cost, unit, limit):
    """Costs as integers: rounded multiples of `unit`, at most `limit`."""
    height, width = cost.shape
    out = np.empty((height, width), np.int32)
    scale, most = 1.0 / unit, np.float64(limit)
    for y in range(height):
        for x in range(width):
            out[y, x] = np.int32(min(most, cost[y, x] * scale + 0.5))
    return out


@numba.njit(cache=True, nogil=True)
def path_costs(cost, border, limit):
    """Least path costs (H, W) int32.

    `cost` (H, W) int32 in [0, limit], `border` (H, W) bool, true at least on the outermost pixels, `limit` < 2^30.
    """
    height, width = cost.shape
    distance = np.empty((height, width), np.int32)
    for y in range(height):
        for x in range(width):
            distance[y, x] = np.int32(0) if border[y, x] else np.int32(limit)
    rows, columns = -(-(height - 2) // TILE), -(-(width - 2) // TILE)
    if rows <= 0 or columns <= 0:
        return distance
    queue, queued = np.empty(rows * columns, np.int32), np.zeros((rows, columns), np.bool_)
    count = 0
    for row in range(rows):
        for column in range(columns):
            if _sees_border(border, row, column):
                queue[count] = row * columns + column
                queued[row, column] = True
                count += 1
    head = 0
    changed = np.empty((3, 3), np.bool_)
    while count > 0:
        row, column = queue[head] // columns, queue[head] % columns
        head = (head + 1) % len(queue)
        count -= 1
        queued[row, column] = False
        _relax_tile(cost, distance, row, column, changed)
        for i in range(3):
            for j in range(3):
                r, c = row + i - 1, column + j - 1
                if changed[i, j] and 0 <= r < rows and 0 <= c < columns and not queued[r, c]:
                    queue[(head + count) % len(queue)] = r * columns + c
                    queued[r, c] = True
                    count += 1
    return distance


@numba.njit(cache=True, nogil=True)
def _bounds(shape, row, column):
    top, left = 1 + row * TILE, 1 + column * TILE
    return top, min(top + TILE, shape[0] - 1), left, min(left + TILE, shape[1] - 1)


@numba.njit(cache=True, nogil=True)
def _sees_border(border, row, column):
    top, bottom, left, right = _bounds(border.shape, row, column)
    for y in range(top - 1, bottom + 1):
        for x in range(left - 1, right + 1):
            if border[y, x]:
                return True
    return False


@numba.njit(cache=True, nogil=True)
def _relax_tile(cost, distance, row, column, changed):
    """Relax one tile until it is settled for its surroundings; `changed` says which neighbours (3, 3) see a change."""
    top, bottom, left, right = _bounds(cost.shape, row, column)
    before = (
        distance[top, left:right].copy(),
        distance[bottom - 1, left:right].copy(),
        distance[top:bottom, left].copy(),
        distance[top:bottom, right - 1].copy(),
    )
    # Step counts: when a row last changed, when it was last relaxed from above and from below.
    step = 1
    moved = np.ones(bottom - top + 2, np.int64)
    from_above, from_below = np.zeros(bottom - top + 2, np.int64), np.zeros(bottom - top + 2, np.int64)
    best = np.empty(right - left, np.int32)
    busy = True
    while busy:
        busy = False
        for y in range(top, bottom):
            i = y - top + 1
            if moved[i - 1] > from_above[i]:
                step += 1
                from_above[i] = step
                if _relax_row(cost[y, left:right], distance[y], distance[y - 1], left, right, best):
                    moved[i] = step
                    busy = True
        for y in range(bottom - 1, top - 1, -1):
            i = y - top + 1
            if moved[i + 1] > from_below[i]:
                step += 1
                from_below[i] = step
                if _relax_row(cost[y, left:right], distance[y], distance[y + 1], left, right, best):
                    moved[i] = step
                    busy = True
    changed[:] = False
    changed[0, 1] = np.any(before[0] != distance[top, left:right])
    changed[2, 1] = np.any(before[1] != distance[bottom - 1, left:right])
    changed[1, 0] = np.any(before[2] != distance[top:bottom, left])
    changed[1, 2] = np.any(before[3] != distance[top:bottom, right - 1])
    changed[0, 0] = before[0][0] != distance[top, left]
    changed[0, 2] = before[0][-1] != distance[top, right - 1]
    changed[2, 0] = before[1][0] != distance[bottom - 1, left]
    changed[2, 2] = before[1][-1] != distance[bottom - 1, right - 1]


@numba.njit(cache=True, nogil=True)
def _relax_row(cost, line, source, left, right, best):
    """Relax line[left:right] from the row `source`, then along itself both ways; whether anything changed."""
    count = right - left
    for i in range(count):
        x = left + i
        least = min(source[x - 1], source[x], source[x + 1])
        best[i] = min(line[x], np.int32(cost[i] + least))
    changed = np.int32(0)
    last = line[left - 1]
    for i in range(count):
        last = min(best[i], np.int32(last + cost[i]))
        changed |= last ^ line[left + i]
        best[i] = last
    last = line[right]
    for i in range(count - 1, -1, -1):
        last = min(best[i], np.int32(last + cost[i]))
        changed |= last ^ best[i]
        line[left + i] = last
    return changed != 0
