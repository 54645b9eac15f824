"""Local search of a pinchmap's levels and mask together on the exact error, compiled.

One trial disturbs the levels of 2 x 2 texels, or sets a small rectangle of cells to one side where the mask stays legal,
descends the 16 texels around it one by one, and keeps the result if fewer pixels are wrong (after Tarini and Cignoni
2005, section 7.2 step 4, who do so at constant mask). Trials go where the error is. A level is g = k - gamma, so that
an active texel takes |g| < 1, an inactive one the sign of its side and |g| < 2.
"""

from __future__ import annotations

import numba
import numpy as np

from fexel_tools.pinchmap_gamma import cell_errors, cells_of, descend, refresh
from fexel_tools.pinchmap_legal import broken_near, update_active

__all__ = ["clip_levels", "costs_of_turning", "search", "sweep", "sweep_freely"]

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


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
    """Bring every level within the limits that the mask sets."""
    for r in range(g.shape[0]):
        for c in range(g.shape[1]):
            low, high = _limits(mask, active, r, c, unit)
            g[r, c] = min(max(g[r, c], low), high)


@_compiled
def sweep(m, mask, active, g, errors, unit, step, least):
    """Descend every texel at a cell with an error once; return the gain in pixels."""
    gain = 0
    for r in range(g.shape[0]):
        for c in range(g.shape[1]):
            low, high = _limits(mask, active, r, c, unit)
            gain += descend(m, g, errors, r, c, low, high, step, least)
    return gain


@_compiled
def sweep_freely(m, g, errors, step, least):
    """As :func:`sweep` for a map without a mask: every level may take either sign, up to 1."""
    gain = 0
    for r in range(g.shape[0]):
        for c in range(g.shape[1]):
            gain += descend(m, g, errors, r, c, -1.0, 1.0, step, least)
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
def _random(state):
    """Uniform in [0, 1); Marsaglia's xorshift64 (2003)."""
    x = state[0]
    x ^= x << np.uint64(13)
    x ^= x >> np.uint64(7)
    x ^= x << np.uint64(17)
    state[0] = x
    return (x >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@_compiled
def _wrapped(i, n, repeat):
    """Index of a row or column, or -1 where there is none."""
    if 0 <= i < n:
        return i
    if not repeat:
        return -1
    return i % n


@_compiled
def _pick(weights, total, state):
    """Index into the cumulative weights, by their share."""
    return np.searchsorted(weights, _random(state) * total, side="right")


@_compiled
def search(m, mask, active, g, errors, locked, unit, coarse, trials, mask_share, seed):
    """Run so many trials; `mask`, `active`, `g` and `errors` are kept current. Returns the wrong pixels left.

    Levels stay on the grid of `unit`; `coarse`, a power of two times `unit`, is the first step of a descent.
    """
    nh, nw = g.shape
    state = np.array([seed * 2 + 0x9E3779B97F4A7C15], np.uint64)
    weights = np.empty(nh * nw)
    saved_g, saved_mask, saved_errors = np.empty((8, 8)), np.empty((8, 8), mask.dtype), np.empty((8, 8), errors.dtype)
    saved_active = np.empty((8, 8), active.dtype)
    total = cell_errors(m, g, errors)
    for trial in range(trials):
        if trial % 64 == 0:
            weight = 0.0
            for i in range(nh * nw):
                weight += errors[i // nw, i % nw]
                weights[i] = weight
            if weight == 0:
                return total
        cell = min(_pick(weights, weight, state), nh * nw - 1)
        r, c = cell // nw, cell % nw
        # The cells and texels [r - 3, r + 5) x [c - 3, c + 5) are all that a trial can change.
        before = 0
        for i in range(8):
            row = _wrapped(r - 3 + i, nh, m.repeat_t)
            for j in range(8):
                column = _wrapped(c - 3 + j, nw, m.repeat_s)
                if row >= 0 and column >= 0:
                    saved_g[i, j], saved_mask[i, j] = g[row, column], mask[row, column]
                    saved_errors[i, j], saved_active[i, j] = errors[row, column], active[row, column]
                    before += errors[row, column]
        legal = True
        if _random(state) < mask_share:
            legal = _change_mask(m, mask, active, g, locked, r, c, unit, state)
        else:
            _disturb(m, mask, active, g, r, c, unit, state)
        if legal:
            after = _settle(m, mask, active, g, errors, r, c, unit, coarse)
        if legal and after <= before:
            total += after - before
            continue
        for i in range(8):
            row = _wrapped(r - 3 + i, nh, m.repeat_t)
            for j in range(8):
                column = _wrapped(c - 3 + j, nw, m.repeat_s)
                if row >= 0 and column >= 0:
                    g[row, column], mask[row, column] = saved_g[i, j], saved_mask[i, j]
                    errors[row, column], active[row, column] = saved_errors[i, j], saved_active[i, j]
    return total


@_compiled
def _disturb(m, mask, active, g, r, c, unit, state):
    """Add noise to the levels of the four corners of cell [r, c]."""
    nh, nw = g.shape
    size = 0.5 * _random(state) ** 2
    for i in range(2):
        row = m.above[r] if i == 0 else r
        for j in range(2):
            column = c if j == 0 else m.right[c]
            low, high = _limits(mask, active, row, column, unit)
            g[row, column] = min(
                max(g[row, column] + np.rint(size * (2 * _random(state) - 1) / unit) * unit, low), high
            )


@_compiled
def _change_mask(m, mask, active, g, locked, r, c, unit, state):
    """Set a rectangle of up to 2 x 2 cells at or beside cell [r, c] to one side; whether that is a legal change."""
    nh, nw = mask.shape
    height, width = 1 + int(_random(state) * 2), 1 + int(_random(state) * 2)
    r0 = r - height + int(_random(state) * (height + 2))
    c0 = c - width + int(_random(state) * (width + 2))
    if not m.repeat_t:
        r0 = min(max(r0, 0), nh - height)
    if not m.repeat_s:
        c0 = min(max(c0, 0), nw - width)
    side = 1 if _random(state) < 0.5 else 0
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
def _settle(m, mask, active, g, errors, r, c, unit, coarse):
    """Descend the texels around cell [r, c]; return the error of the cells [r - 3, r + 5) x [c - 3, c + 5)."""
    nh, nw = g.shape
    for i in range(-3, 5):
        row = _wrapped(r + i, nh, m.repeat_t)
        for j in range(-3, 5):
            column = _wrapped(c + j, nw, m.repeat_s)
            if row >= 0 and column >= 0:
                refresh(m, g, row, column, errors)
    for turn in range(2):
        gain = 0
        for i in range(-2, 2):
            row = _wrapped(r + i, nh, m.repeat_t)
            for j in range(-1, 3):
                column = _wrapped(c + j, nw, m.repeat_s)
                if row >= 0 and column >= 0:
                    low, high = _limits(mask, active, row, column, unit)
                    gain += descend(m, g, errors, row, column, low, high, coarse, unit)
        if gain == 0:
            break
    after = 0
    for i in range(-3, 5):
        row = _wrapped(r + i, nh, m.repeat_t)
        for j in range(-3, 5):
            column = _wrapped(c + j, nw, m.repeat_s)
            if row >= 0 and column >= 0:
                after += errors[row, column]
    return after
