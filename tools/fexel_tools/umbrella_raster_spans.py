"""Rows of samples that umbrellas cover, and blocks of samples of which some are yet open.

Sectors are triangles: a sample belongs to the one triangle that its centre lies in; neighbours share edges computed
alike, so that nothing is drawn twice and nothing between them is missed. The contour of a star is filled as a whole, to
the same samples.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = [
    "BLOCK",
    "MOST_CROSSINGS",
    "OPAQUE",
    "any_open",
    "contour_crossings",
    "is_hidden",
    "open_blocks",
    "triangle_spans",
]

MOST_CROSSINGS = 64
"""Of a contour with a row of samples; contours of more edges are filled sector by sector."""

OPAQUE = 1e-4
"""Transmittance below which nothing behind is seen: a 26th of an 8-bit step."""

BLOCK = 16
"""Samples a side of the blocks of which open samples are counted, so that what is hidden is passed over."""


@numba.njit(cache=True, nogil=True)
def triangle_spans(cx, cy, ax, ay, bx, by, columns, rows, spans):
    """Samples whose centres lie in a triangle, row by row; returns first row and the one after the last."""
    top = max(0, int(np.ceil(min(max(min(cy, ay, by), -1.0), rows + 1.0) - 0.5)))
    bottom = min(rows, int(np.ceil(max(min(max(cy, ay, by), rows + 1.0), -1.0) - 0.5)))
    if top >= bottom or max(cx, ax, bx) < 0 or min(cx, ax, bx) > columns:
        return 0, 0
    for y in range(top, bottom):
        spans[y, 0], spans[y, 1] = columns, 0
    _edge(cx, cy, ax, ay, top, bottom, columns, spans)
    _edge(ax, ay, bx, by, top, bottom, columns, spans)
    _edge(bx, by, cx, cy, top, bottom, columns, spans)
    return top, bottom


@numba.njit(cache=True, nogil=True)
def _edge(px, py, qx, qy, top, bottom, columns, spans):
    """Widen the spans to where an edge crosses the rows; the same whichever of its ends comes first."""
    if py > qy or (py == qy and px > qx):
        px, py, qx, qy = qx, qy, px, py
    first = max(top, int(np.ceil(max(py, -1.0) - 0.5)))
    last = min(bottom, int(np.ceil(min(qy, bottom + 1.0) - 0.5)))
    if first >= last:
        return
    slope = (qx - px) / (qy - py)
    for y in range(first, last):
        x = min(max(px + (y + 0.5 - py) * slope, -1.0), columns + 1.0)
        column = min(max(int(np.ceil(x - 0.5)), 0), columns)
        spans[y, 0] = min(spans[y, 0], column)
        spans[y, 1] = max(spans[y, 1], column)


@numba.njit(cache=True, nogil=True)
def contour_crossings(corners, dx, dy, columns, crossings, spans):
    """Where a contour crosses the rows of a tile, from left to right, as `_edge` finds it; first row and the one after.

    `spans[y, 0]` is how many crossings row y has.
    """
    rows, count = len(spans), len(corners)
    top, bottom = rows, 0
    for k in range(1, count):
        y = corners[k, 1] + dy
        top = min(top, max(0, int(np.ceil(min(max(y, -1.0), rows + 1.0) - 0.5))))
        bottom = max(bottom, min(rows, int(np.ceil(max(min(y, rows + 1.0), -1.0) - 0.5))))
    for y in range(top, bottom):
        spans[y, 0] = 0
    for k in range(1, count):
        following = k + 1 if k + 1 < count else 1
        px, py = corners[k, 0] + dx, corners[k, 1] + dy
        qx, qy = corners[following, 0] + dx, corners[following, 1] + dy
        if py > qy or (py == qy and px > qx):
            px, py, qx, qy = qx, qy, px, py
        first = max(top, int(np.ceil(max(py, -1.0) - 0.5)))
        last = min(bottom, int(np.ceil(min(qy, bottom + 1.0) - 0.5)))
        if first >= last:
            continue
        slope = (qx - px) / (qy - py)
        for y in range(first, last):
            x = min(max(px + (y + 0.5 - py) * slope, -1.0), columns + 1.0)
            place, column = spans[y, 0], min(max(int(np.ceil(x - 0.5)), 0), columns)
            while place > 0 and crossings[y, place - 1] > column:
                crossings[y, place] = crossings[y, place - 1]
                place -= 1
            crossings[y, place] = column
            spans[y, 0] += 1
    return top, bottom


@numba.njit(cache=True, nogil=True)
def open_blocks(rows, columns):
    """Samples of each block of a tile: none is closed yet."""
    blocks = np.empty((-(-rows // BLOCK), -(-columns // BLOCK)), np.int64)
    for j in range(blocks.shape[0]):
        for i in range(blocks.shape[1]):
            blocks[j, i] = min(BLOCK, rows - j * BLOCK) * min(BLOCK, columns - i * BLOCK)
    return blocks


@numba.njit(cache=True, nogil=True)
def is_hidden(corners, dx, dy, blocks):
    """Whether no sample is open where an umbrella lies."""
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for k in range(len(corners)):
        low_x, high_x = min(low_x, corners[k, 0]), max(high_x, corners[k, 0])
        low_y, high_y = min(low_y, corners[k, 1]), max(high_y, corners[k, 1])
    return not any_open(low_x + dx, low_y + dy, high_x + dx, high_y + dy, blocks)


@numba.njit(cache=True, nogil=True)
def any_open(low_x, low_y, high_x, high_y, blocks):
    """Whether a block that a box of samples touches has any that is still open."""
    count_y, count_x = blocks.shape
    if high_x < 0 or high_y < 0 or low_x > count_x * BLOCK or low_y > count_y * BLOCK:
        return False
    first_x, last_x = int(max(low_x, 0.0)) // BLOCK, int(min(high_x, count_x * BLOCK - 1.0)) // BLOCK
    first_y, last_y = int(max(low_y, 0.0)) // BLOCK, int(min(high_y, count_y * BLOCK - 1.0)) // BLOCK
    for j in range(first_y, last_y + 1):
        for i in range(first_x, last_x + 1):
            if blocks[j, i] > 0:
                return True
    return False
