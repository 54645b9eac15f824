"""Exact error of a bilinear boundary on a lattice of texels, and its descent one texel at a time, compiled.

A point is on the + side where k^B > gamma^B, so that only the *level* g = k - gamma matters to the shape: the boundary
is the zero set of its bilinear interpolation. Along a row of pixels within a lattice cell g is linear, hence crosses
zero at most once, and the wrong pixels of the row are a function of the crossing's column alone, which a table holds
(Tarini and Cignoni 2005, section 7.2). The error of a cell costs one division and one look-up per row of pixels.

Cell [r, c] of the lattice is cell [r, c] of the mask: texel [r, c] is its lower left corner, [r - 1, c] the upper left,
[r, c + 1] the lower right. Beyond the border the sampler repeats or clamps. The lattice covers a window of the
image, which may reach beyond it; cells there hold no pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["Lattice", "cell_errors", "cells_of", "descend", "lattice_of", "refresh", "wrong_pixels"]

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


class Lattice(NamedTuple):
    """A two-sided image seen through the cells of a pinchmap.

    Attributes
    ----------
    cells : (Nh, Nw, 5) int32
        Of every cell: where its table begins, the table's length for one row of pixels (0: all rows have the same),
        rows and columns of pixels, pixels on the + side.
    table : (T,) int16
        For a row of w pixels first the wrong ones if the leftmost m are - and the rest +, m from 0 to w, then those if
        the leftmost m are + and the rest -.
    share : (Nh, L) float64
        Of every row of pixels in a cell its distance from the cell's upper side, in cells.
    gap : (Nw,) float64
        Distance of the centre of a cell's first pixel from its left side, in pixels.
    width : float
        Of a cell, in pixels.
    above, right : (Nh,) and (Nw,) int64
        Texel row of a cell's upper corners, texel column of its right ones.
    repeat_t, repeat_s : bool
        Whether the lattice joins at the borders.
    scratch : (L,) int32
        Working memory: a lattice serves one thread at a time.
    """

    cells: NDArray[np.int32]
    table: NDArray[np.int16]
    share: NDArray[np.float64]
    gap: NDArray[np.float64]
    width: float
    above: NDArray[np.int64]
    right: NDArray[np.int64]
    repeat_t: bool
    repeat_s: bool
    scratch: NDArray[np.int32]

    @property
    def pixels(self) -> NDArray[np.int32]:
        """Pixels of every cell, (Nh, Nw)."""
        return self.cells[..., 2] * self.cells[..., 3]

    @property
    def ones(self) -> NDArray[np.int32]:
        """Pixels of every cell on the + side, (Nh, Nw)."""
        return self.cells[..., 4]


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
    rows, first = _split(plus.shape[0], top, height, nh)
    columns, gap = _split(plus.shape[1], left, width, nw)
    above, right_of = np.arange(nh) - 1, np.arange(nw) + 1
    above[0] = nh - 1 if repeat[1] else 0
    right_of[-1] = 0 if repeat[0] else nw - 1
    cells, table = _tables(np.ascontiguousarray(plus), rows, columns)
    most = max(int(np.diff(rows).max()), 1)
    share = (first[:, None] + np.arange(most)) / height
    scratch = np.zeros(most, np.int32)
    return Lattice(cells, table, share, gap, width, above, right_of, repeat[1], repeat[0], scratch)


def _split(pixels: int, origin: float, size: float, cells: int) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """First pixel of every cell, and how far its centre lies from the cell's first side."""
    sides = origin + np.arange(cells + 1) * size
    start = np.clip(np.ceil(sides - 0.5 - 1e-9), 0, pixels)  # 1e-9: a centre on a side belongs to the later cell
    return start.astype(np.int32), start[:-1] + 0.5 - sides[:-1]


@_compiled
def _tables(plus, rows, columns):
    nh, nw = len(rows) - 1, len(columns) - 1
    cells = np.zeros((nh, nw, 5), np.int32)
    size = 0
    for c in range(nw):
        size += 4 * (columns[c + 1] - columns[c] + 1)  # one row each for cells without and full of + pixels
    for r in range(nh):
        for y in range(rows[r], rows[r + 1]):
            for c in range(nw):
                count = 0
                for x in range(columns[c], columns[c + 1]):
                    count += plus[y, x]
                cells[r, c, 4] += count
        uniform = 0
        for c in range(nw):
            height, width = rows[r + 1] - rows[r], columns[c + 1] - columns[c]
            cells[r, c, 2], cells[r, c, 3] = height, width
            if cells[r, c, 4] == 0:
                cells[r, c, 0] = uniform
            elif cells[r, c, 4] == height * width:
                cells[r, c, 0] = uniform + 2 * (width + 1)
            else:
                cells[r, c, 0], cells[r, c, 1] = size, 2 * (width + 1)
                size += height * 2 * (width + 1)
            uniform += 4 * (width + 1)
    table = np.empty(size, np.int16)
    i = 0
    for c in range(nw):
        width = columns[c + 1] - columns[c]
        for m in range(width + 1):
            table[i + m] = table[i + 3 * (width + 1) + m] = width - m
            table[i + width + 1 + m] = table[i + 2 * (width + 1) + m] = m
        i += 4 * (width + 1)
    for r in range(nh):
        for c in range(nw):
            if cells[r, c, 1] == 0:
                continue
            i, width = cells[r, c, 0], cells[r, c, 3]
            for y in range(rows[r], rows[r + 1]):
                wrong = 0
                for x in range(columns[c], columns[c + 1]):
                    wrong += 1 - plus[y, x]
                for m in range(width + 1):
                    table[i + m] = wrong
                    table[i + width + 1 + m] = width - wrong
                    if m < width:
                        wrong += 2 * plus[y, columns[c] + m] - 1
                i += 2 * (width + 1)
    return cells, table


@numba.njit(inline="always")
def _cell_error(cells, table, shares, gaps, width, found, r, c, tl, tr, bl, br):
    """Wrong pixels of a cell whose corners have these levels (top left, top right, bottom left, bottom right)."""
    height, columns = cells[r, c, 2], cells[r, c, 3]
    if tl > 0 and tr > 0 and bl > 0 and br > 0:
        error = np.int64(height * columns - cells[r, c, 4])
    elif tl <= 0 and tr <= 0 and bl <= 0 and br <= 0:
        error = np.int64(cells[r, c, 4])
    else:
        share, gap = shares[r], gaps[c]
        left_slope, right_slope, most, flip = bl - tl, br - tr, float(columns), columns + 1.0
        for j in range(height):  # written for the vectoriser: no branches, no calls
            left, right = tl + share[j] * left_slope, tr + share[j] * right_slope
            # A pixel on the line itself counts as -; 1e-9 rounds a pixel in that case to the other side than 1 does.
            x = left / (left - right) * width - gap + (1.0 if left <= 0 else 1.0 - 1e-9)
            x = x if x > 0 else 0.0
            x = x if x < most else most
            x = x if left <= 0 else x + flip
            both = most if left <= 0 else 0.0
            found[j] = np.int32(x if (left > 0) != (right > 0) else both)
        i, stride = cells[r, c, 0], cells[r, c, 1]
        error = np.int64(0)
        for j in range(height):
            error += table[i + found[j]]
            i += stride
    return error


@_compiled
def refresh(m, g, r, c, errors):
    """Recompute the error of cell [r, c] in place."""
    a, d = m.above[r], m.right[c]
    errors[r, c] = _cell_error(
        m.cells, m.table, m.share, m.gap, m.width, m.scratch, r, c, g[a, c], g[a, d], g[r, c], g[r, d]
    )


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
        trial[i] = _cell_error(
            m.cells, m.table, m.share, m.gap, m.width, m.scratch, r, c, g[a, c], g[a, d], g[r, c], g[r, d]
        )
        total += trial[i]
        if total > limit:
            return total
    return total


@_compiled
def descend(m, g, errors, r, c, low, high, step, least, cells, trial):
    """Move the level of texel [r, c] within [low, high] while its cells' error falls, by steps halved down to `least`.

    `errors` must be current and stays so; `cells` (4, 2) and `trial` (4,) int64 are working memory. Returns the gain in
    pixels.
    """
    n = cells_of(m, r, c, g.shape, cells)
    best = 0
    for i in range(n):
        best += errors[cells[i, 0], cells[i, 1]]
    before = best
    direction = 1.0
    while step >= least and best > 0:
        here = g[r, c]
        moved = False
        for _ in range(2):
            there = min(max(here + direction * step, low), high)
            if there != here:
                g[r, c] = there
                total = _trial(m, g, cells, n, trial, best - 1)
                if total < best:
                    best = total
                    for i in range(n):
                        errors[cells[i, 0], cells[i, 1]] = trial[i]
                    moved = True
                    break
                g[r, c] = here
            direction = -direction
        if not moved:
            step *= 0.5
    return before - best


def wrong_pixels(
    plus: NDArray[np.uint8],
    levels: NDArray[np.float64],
    repeat: tuple[bool, bool],
    window: tuple[float, float, float, float],
) -> NDArray[np.uint8]:
    """1 where a map shows the other side than the image, straight from the definition.

    Parameters
    ----------
    plus : (H, W) uint8
    levels : (Nh, Nw) float64
        k - gamma.
    repeat : (bool, bool)
        Along s and t. Where not, the map is clamped, also over pixels outside the window.
    window : (float, float, float, float)
        Left, top, right and bottom of the map in pixels.

    Returns
    -------
    (H, W) uint8
    """
    height, width = plus.shape
    nh, nw = levels.shape
    x = (np.arange(width) + 0.5 - window[0]) * (nw / (window[2] - window[0]))
    y = (np.arange(height) + 0.5 - window[1]) * (nh / (window[3] - window[1])) - 1
    if not repeat[0]:
        x = np.clip(x, 0, nw - 1)
    if not repeat[1]:
        y = np.clip(y, 0, nh - 1)
    return _wrong_pixels(plus, np.ascontiguousarray(levels), x, y)


@_compiled
def _wrong_pixels(plus, g, x, y):
    nh, nw = g.shape
    wrong = np.zeros(plus.shape, np.uint8)
    for i in range(plus.shape[0]):
        r = int(np.floor(y[i]))
        v = y[i] - r
        upper, lower = g[r % nh], g[min(r + 1, nh - 1) if v == 0 else (r + 1) % nh]
        j = 0
        while j < plus.shape[1]:
            c = int(np.floor(x[j]))
            left, right = c % nw, (c + 1) % nw
            tl, tr, bl, br = upper[left], upper[right], lower[left], lower[right]
            top, bottom = tl + v * (bl - tl), tr + v * (br - tr)
            while j < plus.shape[1] and int(np.floor(x[j])) == c:
                shown = 1 if top + (x[j] - c) * (bottom - top) > 0 else 0
                wrong[i, j] = 1 if shown != plus[i, j] else 0
                j += 1
    return wrong
