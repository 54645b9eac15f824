"""Local search of a pinchmap's levels and mask together on the exact error, compiled.

One trial disturbs the levels of 2 x 2 texels, or sets a small rectangle of cells to one side where the mask stays
legal, descends the texels around it one by one, and keeps the result unless more pixels are wrong (after Tarini and
Cignoni 2005, section 7.2 step 4, who do so at constant mask). Trials go where the error is. A level is g = k - gamma,
so that an active texel takes |g| < 1, an inactive one the sign of its side and |g| < 2.
"""

from __future__ import annotations

import numba
import numpy as np

from fexel_tools.pinchmap_changes import broken_near, random, tied, update_active
from fexel_tools.pinchmap_gamma import cell_errors, cells_of, descend, refresh

__all__ = ["clip_levels", "costs_of_turning", "exchange", "search", "sweep", "sweep_freely"]

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")
_PASSES = 3  # of descent after a disturbance; texels whose neighbours have not changed are left out


@_compiled
def _limits(mask, active, r, c, unit):
    """Lowest and highest level of a texel; `unit` is the smallest step of gamma."""
    if active[r, c]:
        return -1.0 + unit, 1.0 - unit
    if mask[r, c]:
        return unit, 2.0 - unit
    return -2.0 + unit, -unit


@_compiled
def clip_levels(mask, active, g, unit):
    """Bring every level to the grid of `unit` and within the limits that the mask sets."""
    for r in range(g.shape[0]):
        for c in range(g.shape[1]):
            low, high = _limits(mask, active, r, c, unit)
            g[r, c] = min(max(np.rint(g[r, c] / unit) * unit, low), high)


@_compiled
def sweep(m, mask, active, g, errors, unit, coarse):
    """Descend every texel at a cell with an error once; return the gain in pixels."""
    cells, trial = np.empty((4, 2), np.int64), np.empty(4, np.int64)
    gain = 0
    for r in range(g.shape[0]):
        for c in range(g.shape[1]):
            low, high = _limits(mask, active, r, c, unit)
            gain += descend(m, g, errors, r, c, low, high, coarse, unit, cells, trial)
    return gain


@_compiled
def sweep_freely(m, g, errors, step, least):
    """As :func:`sweep` for a map without a mask: every level may take either sign, up to 1."""
    cells, trial = np.empty((4, 2), np.int64), np.empty(4, np.int64)
    gain = 0
    for r in range(g.shape[0]):
        for c in range(g.shape[1]):
            gain += descend(m, g, errors, r, c, -1.0, 1.0, step, least, cells, trial)
    return gain


@_compiled
def costs_of_turning(m, g, errors):
    """What turning the sign of each level alone would cost, in pixels, with the sign of the level."""
    nh, nw = g.shape
    result = np.empty((nh, nw))
    cells = np.empty((4, 2), np.int64)
    for r in range(nh):
        for c in range(nw):
            level = g[r, c]
            sign = 1.0 if level > 0 else -1.0
            n = cells_of(m, r, c, g.shape, cells)
            before = 0
            for i in range(n):
                before += errors[cells[i, 0], cells[i, 1]]
            g[r, c] = -0.02 * sign
            after = 0
            for i in range(n):
                row, column = cells[i, 0], cells[i, 1]
                old = errors[row, column]
                refresh(m, g, row, column, errors)
                after += errors[row, column]
                errors[row, column] = old
            g[r, c] = level
            result[r, c] = sign * (max(after - before, 0) + 0.01)  # 0.01: of equals keep the sign
    return result


@_compiled
def exchange(m, g, errors, other, size):
    """Take blocks of `size` x `size` levels from another map of the same mask where that lowers the error.

    Blocks do not cross the border.
    """
    nh, nw = g.shape
    saved_g, saved_errors = np.empty((size, size)), np.empty((size + 1, size + 1), errors.dtype)
    for r in range(nh - size + 1):
        last, lower = min(r + size + 1, nh), r
        for c in range(nw - size + 1):
            first = max(c - 1, 0)
            before, differs = 0, False
            for i in range(size):
                for j in range(size):
                    differs = differs or g[r + i, c + j] != other[r + i, c + j]
            if differs:
                for i in range(lower, last):
                    for j in range(first, c + size):
                        before += errors[i, j]
                        saved_errors[i - lower, j - first] = errors[i, j]
            if before == 0:
                continue
            for i in range(size):
                for j in range(size):
                    saved_g[i, j] = g[r + i, c + j]
                    g[r + i, c + j] = other[r + i, c + j]
            after = 0
            for i in range(lower, last):
                for j in range(first, c + size):
                    if after < before:
                        refresh(m, g, i, j, errors)
                        after += errors[i, j]
            if after >= before:
                for i in range(size):
                    for j in range(size):
                        g[r + i, c + j] = saved_g[i, j]
                for i in range(lower, last):
                    for j in range(first, c + size):
                        errors[i, j] = saved_errors[i - lower, j - first]


@_compiled
def _extent(n, repeat):
    """Rows or columns of the window that a trial can change: a small map that repeats has each of its own once."""
    return min(7, n) if repeat else 7


@_compiled
def _wrapped(i, n, repeat):
    """Index of a row or column, or -1 where there is none."""
    if 0 <= i < n:
        return i
    if not repeat:
        return -1
    return i % n


@_compiled
def search(m, mask, active, g, errors, locked, unit, coarse, trials, mask_share, seed):
    """Run so many trials; `mask`, `active`, `g` and `errors` are kept current. Returns the wrong pixels left.

    Levels stay on the grid of `unit`; `coarse`, a power of two times `unit`, is the first step of a descent. `locked`
    (Nh, Nw) marks cells whose side is given.
    """
    nh, nw = g.shape
    state = np.array([seed * 2 + 0x9E3779B97F4A7C15], np.uint64)
    weights = np.empty(nh * nw)
    saved_g, saved_errors = np.empty((7, 7)), np.empty((7, 7), errors.dtype)
    saved_mask, saved_active = np.empty((7, 7), mask.dtype), np.empty((7, 7), active.dtype)
    cells, each, stale = np.empty((4, 2), np.int64), np.empty(4, np.int64), np.empty((8, 8), np.uint8)
    total = cell_errors(m, g, errors)
    high, wide = _extent(nh, m.repeat_t), _extent(nw, m.repeat_s)
    weight = 0.0
    for trial in range(trials):
        if trial % 64 == 0:
            weight = 0.0
            for i in range(nh * nw):
                weight += errors[i // nw, i % nw]
                weights[i] = weight
            if weight == 0:
                return total
        cell = min(np.searchsorted(weights, random(state) * weight, side="right"), nh * nw - 1)
        r, c = cell // nw, cell % nw
        # The cells and texels [r - 3, r + 4) x [c - 3, c + 4) are all that a trial can change.
        before = 0
        for i in range(high):
            row = _wrapped(r - 3 + i, nh, m.repeat_t)
            for j in range(wide):
                column = _wrapped(c - 3 + j, nw, m.repeat_s)
                if row >= 0 and column >= 0:
                    saved_g[i, j], saved_mask[i, j] = g[row, column], mask[row, column]
                    saved_errors[i, j], saved_active[i, j] = errors[row, column], active[row, column]
                    before += errors[row, column]
        good = True
        if random(state) < mask_share:
            good = _change_mask(m, mask, active, g, locked, r, c, unit, state)
        else:
            _disturb(m, mask, active, g, r, c, unit, state)
        if good:
            after = _settle(m, mask, active, g, errors, r, c, unit, coarse, cells, each, stale)
            good = after <= before
            if good:
                total += after - before
        if not good:
            for i in range(high):
                row = _wrapped(r - 3 + i, nh, m.repeat_t)
                for j in range(wide):
                    column = _wrapped(c - 3 + j, nw, m.repeat_s)
                    if row >= 0 and column >= 0:
                        g[row, column], mask[row, column] = saved_g[i, j], saved_mask[i, j]
                        errors[row, column], active[row, column] = saved_errors[i, j], saved_active[i, j]
    return total


@_compiled
def _disturb(m, mask, active, g, r, c, unit, state):
    """Add noise to the levels of the four corners of cell [r, c]."""
    size = 0.5 * random(state) ** 2
    for i in range(2):
        row = m.above[r] if i == 0 else r
        for j in range(2):
            column = c if j == 0 else m.right[c]
            low, high = _limits(mask, active, row, column, unit)
            noise = np.rint(size * (2 * random(state) - 1) / unit) * unit
            g[row, column] = min(max(g[row, column] + noise, low), high)


@_compiled
def _change_mask(m, mask, active, g, locked, r, c, unit, state):
    """Set a rectangle of up to 2 x 2 cells that touches cell [r, c] to one side; whether that is a legal change."""
    nh, nw = mask.shape
    height, width = min(1 + int(random(state) * 2), nh), min(1 + int(random(state) * 2), nw)
    r0 = r - height + int(random(state) * (height + 2))
    c0 = c - width + int(random(state) * (width + 2))
    if not m.repeat_t:
        r0 = min(max(r0, 0), nh - height)
    if not m.repeat_s:
        c0 = min(max(c0, 0), nw - width)
    r0, c0, height, width = tied(r0, c0, height, width, nh, nw, m.repeat_t, m.repeat_s)
    side = 1 if random(state) < 0.5 else 0
    changed = False
    for i in range(height):
        for j in range(width):
            row, column = (r0 + i) % nh, (c0 + j) % nw
            if mask[row, column] != side:
                if locked[row, column]:
                    return False
                mask[row, column] = side
                changed = True
    if not changed:
        return False
    update_active(mask, active, r0, c0, height, width, m.repeat_t, m.repeat_s)
    if broken_near(mask, active, r0, c0, height, width, m.repeat_t, m.repeat_s):
        return False
    for i in range(r0 - 1, r0 + height):
        for j in range(c0, c0 + width + 1):
            row, column = _wrapped(i, nh, m.repeat_t), _wrapped(j, nw, m.repeat_s)
            if row >= 0 and column >= 0:
                low, high = _limits(mask, active, row, column, unit)
                g[row, column] = min(max(g[row, column], low), high)
    return True


@_compiled
def _settle(m, mask, active, g, errors, r, c, unit, coarse, cells, each, stale):
    """Descend the texels around cell [r, c]; return the error of the cells [r - 3, r + 4) x [c - 3, c + 4)."""
    nh, nw = g.shape
    for i in range(-3, 4):
        row = _wrapped(r + i, nh, m.repeat_t)
        for j in range(-3, 4):
            column = _wrapped(c + j, nw, m.repeat_s)
            if row >= 0 and column >= 0:
                refresh(m, g, row, column, errors)
    stale[:] = 1
    for _ in range(_PASSES):
        gain = 0
        for i in range(-2, 2):
            row = _wrapped(r + i, nh, m.repeat_t)
            if row < 0:
                continue
            for j in range(-1, 3):
                column = _wrapped(c + j, nw, m.repeat_s)
                if column < 0 or not stale[i + 3, j + 2]:
                    continue
                stale[i + 3, j + 2] = 0
                low, high = _limits(mask, active, row, column, unit)
                won = descend(m, g, errors, row, column, low, high, coarse, unit, cells, each)
                if won > 0:
                    gain += won
                    for a in range(3):
                        for b in range(3):
                            if a != 1 or b != 1:
                                stale[i + 2 + a, j + 1 + b] = 1
        if gain == 0:
            break
    after = 0
    for i in range(-3, _extent(nh, m.repeat_t) - 3):
        row = _wrapped(r + i, nh, m.repeat_t)
        for j in range(-3, _extent(nw, m.repeat_s) - 3):
            column = _wrapped(c + j, nw, m.repeat_s)
            if row >= 0 and column >= 0:
                after += errors[row, column]
    return after
