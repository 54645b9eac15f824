"""Exact error of a bilinear boundary on a lattice of texels, and its descent one texel at a time, compiled.

A point is on the + side where k^B > gamma^B, so that only the *level* g = k - gamma matters to the shape: the boundary is
the zero set of its bilinear interpolation. Along a row of pixels within a lattice cell g is linear, hence crosses zero at
most once, and the wrong pixels of the row are a function of the crossing's column alone, which a table holds (Tarini and
Cignoni 2005, section 7.2). The error of a cell costs one division and one look-up per row of pixels.

Cell [r, c] of the lattice is cell [r, c] of the mask: texel [r, c] is its lower left corner, [r - 1, c] the upper left,
[r, c + 1] the lower right. Beyond the border the sampler repeats or clamps. The lattice covers a window of the
image, which may reach beyond it; cells there hold no pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["Lattice", "cell_errors", "cells_of", "descend", "lattice_of", "refresh"]

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


class Lattice(NamedTuple):
    """A two-sided image seen through the cells of a pinchmap.

    Attributes
    ----------
    rows, columns : (Nh + 1,) and (Nw + 1,) int32
        First pixel row and column of every cell.
    height, width : float
        Of a cell, in pixels.
    top, left : (Nh,) and (Nw,) float64
        Distance of the centre of a cell's first pixel from its upper and left side, in pixels.
    above, right : (Nh,) and (Nw,) int64
        Texel row of a cell's upper corners, texel column of its right ones.
    repeat_t, repeat_s : bool
        Whether the lattice joins at the borders.
    ones : (Nh, Nw) int32
        Pixels on the + side.
    start : (Nh, Nw) int64
        Where a cell's table begins; -1: all its pixels are on the - side, -2: on the +.
    table : (T,) int16
        For each row of a mixed cell and m from 0 to its width, the wrong pixels if the first m are - and the rest +.
    """

    rows: NDArray[np.int32]
    columns: NDArray[np.int32]
    height: float
    width: float
    top: NDArray[np.float64]
    left: NDArray[np.float64]
    above: NDArray[np.int64]
    right: NDArray[np.int64]
    repeat_t: bool
    repeat_s: bool
    ones: NDArray[np.int32]
    start: NDArray[np.int64]
    table: NDArray[np.int16]


def lattice_of(
    plus: NDArray[np.uint8],
    shape: tuple[int, int],
    repeat: tuple[bool, bool],
    window: tuple[float, float, float, float],
) -> Lattice:
    """Tables of an image for a lattice.

    Parameters
    ----------
    plus : (H, W) uint8
        1 on the + side, else 0; row 0 at the top.
    shape : (int, int)
        Rows and columns of texels.
    repeat : (bool, bool)
        Along s and t: whether the lattice joins at the borders.
    window : (float, float, float, float)
        Left, top, right and bottom of the lattice in pixels of the image; pixels outside it do not count.
    """
    nh, nw = shape
    left, top, right, bottom = window
    height, width = (bottom - top) / nh, (right - left) / nw
    rows, top_gap = _split(plus.shape[0], top, height, nh)
    columns, left_gap = _split(plus.shape[1], left, width, nw)
    above, right_of = np.arange(nh) - 1, np.arange(nw) + 1
    above[0] = nh - 1 if repeat[1] else 0
    right_of[-1] = 0 if repeat[0] else nw - 1
    ones, start, table = _tables(np.ascontiguousarray(plus), rows, columns)
    return Lattice(
        rows, columns, height, width, top_gap, left_gap, above, right_of, repeat[1], repeat[0], ones, start, table
    )


def _split(pixels: int, origin: float, size: float, cells: int) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """First pixel of every cell, and how far its centre lies from the cell's first side."""
    sides = origin + np.arange(cells + 1) * size
    start = np.clip(np.ceil(sides - 0.5 - 1e-9), 0, pixels)  # 1e-9: a centre on a side belongs to the later cell
    return start.astype(np.int32), start[:-1] + 0.5 - sides[:-1]


@_compiled
def _tables(plus, rows, columns):
    nh, nw = len(rows) - 1, len(columns) - 1
    ones = np.zeros((nh, nw), np.int32)
    start = np.empty((nh, nw), np.int64)
    size = 0
    for r in range(nh):
        for y in range(rows[r], rows[r + 1]):
            for c in range(nw):
                count = 0
                for x in range(columns[c], columns[c + 1]):
                    count += plus[y, x]
                ones[r, c] += count
        height = rows[r + 1] - rows[r]
        for c in range(nw):
            width = columns[c + 1] - columns[c]
            if ones[r, c] == 0:
                start[r, c] = -1
            elif ones[r, c] == height * width:
                start[r, c] = -2
            else:
                start[r, c] = size
                size += height * (width + 1)
    table = np.empty(size, np.int16)
    for r in range(nh):
        for c in range(nw):
            i = start[r, c]
            if i >= 0:
                for y in range(rows[r], rows[r + 1]):
                    wrong = 0
                    for x in range(columns[c], columns[c + 1]):
                        wrong += 1 - plus[y, x]
                    table[i] = wrong
                    i += 1
                    for x in range(columns[c], columns[c + 1]):
                        wrong += 2 * plus[y, x] - 1
                        table[i] = wrong
                        i += 1
    return ones, start, table


@_compiled
def _cell_error(m, r, c, tl, tr, bl, br):
    """Wrong pixels of a cell whose corners have these levels (top left, top right, bottom left, bottom right)."""
    height = m.rows[r + 1] - m.rows[r]
    width = m.columns[c + 1] - m.columns[c]
    if tl > 0 and tr > 0 and bl > 0 and br > 0:
        return height * width - m.ones[r, c]
    if tl <= 0 and tr <= 0 and bl <= 0 and br <= 0:
        return m.ones[r, c]
    shift = m.left[c]
    i = m.start[r, c]
    error = 0
    for j in range(height):
        v = (m.top[r] + j) / m.height
        left, right = tl + v * (bl - tl), tr + v * (br - tr)
        minus = 0 if left > 0 else width  # pixels on the - side; on the line itself counts as -
        if (left > 0) != (right > 0):
            x = left / (left - right) * m.width - shift
            first = min(max(int(x + 1.0) if left <= 0 else int(np.ceil(x)), 0), width)
            minus = first if left <= 0 else width - first
            if i >= 0:
                error += m.table[i + first] if left <= 0 else width - m.table[i + first]
        elif i >= 0:
            error += m.table[i + minus]
        if i >= 0:
            i += width + 1
        else:
            error += minus
    if i == -1:
        return height * width - error
    return error


@_compiled
def refresh(m, g, r, c, errors):
    """Recompute the error of cell [r, c] in place."""
    a, d = m.above[r], m.right[c]
    errors[r, c] = _cell_error(m, r, c, g[a, c], g[a, d], g[r, c], g[r, d])


@_compiled
def cell_errors(m, g, errors):
    """Fill `errors` (Nh, Nw) with the wrong pixels of every cell; return their sum."""
    total = 0
    for r in range(g.shape[0]):
        for c in range(g.shape[1]):
            refresh(m, g, r, c, errors)
            total += errors[r, c]
    return total


@_compiled
def cells_of(m, r, c, shape, cells):
    """The cells that texel [r, c] is a corner of, into `cells` (4, 2); return their number."""
    n = 0
    for i in range(2):
        row = r + i
        if row == shape[0]:
            if not m.repeat_t:
                continue
            row = 0
        for j in range(2):
            column = c - j
            if column < 0:
                if not m.repeat_s:
                    continue
                column = shape[1] - 1
            cells[n, 0], cells[n, 1] = row, column
            n += 1
    return n


@_compiled
def _trial(m, g, cells, n, trial, limit):
    """Error of some cells, into `trial` one by one; may stop early once above `limit`."""
    total = 0
    for i in range(n):
        r, c = cells[i, 0], cells[i, 1]
        a, d = m.above[r], m.right[c]
        trial[i] = _cell_error(m, r, c, g[a, c], g[a, d], g[r, c], g[r, d])
        total += trial[i]
        if total > limit:
            return total
    return total


@_compiled
def descend(m, g, errors, r, c, low, high, step, least):
    """Move the level of texel [r, c] within [low, high] while its cells' error falls, by steps halved down to `least`.

    `errors` must be current and stays so. Returns the gain in pixels.
    """
    cells = np.empty((4, 2), np.int64)
    n = cells_of(m, r, c, g.shape, cells)
    best = 0
    for i in range(n):
        best += errors[cells[i, 0], cells[i, 1]]
    before = best
    trial = np.empty(4, np.int64)
    while step >= least and best > 0:
        here = g[r, c]
        moved = False
        for direction in (1.0, -1.0):
            there = min(max(here + direction * step, low), high)
            if there == here:
                continue
            g[r, c] = there
            total = _trial(m, g, cells, n, trial, best)
            if total < best:
                best = total
                for i in range(n):
                    errors[cells[i, 0], cells[i, 1]] = trial[i]
                moved = True
                break
            g[r, c] = here
        if not moved:
            step *= 0.5
    return before - best
