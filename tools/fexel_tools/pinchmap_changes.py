"""What changing cells of a mask does to its legality and cost, compiled.

The same rules as `fexel_tools.pinchmap_mask`, for a few cells at a time. Masks are (Nh, Nw) uint8, `active` marks the
texels that are active under them. A change concerns the cells [r0, r0 + height) x [c0, c0 + width), the texels at their
corners, and the rules within a cell of them. `repeat_t` and `repeat_s` say whether the map joins at the borders.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = [
    "broken_at",
    "broken_near",
    "cost_near",
    "random",
    "set_side",
    "tied",
    "total_cost",
    "update_active",
    "wrapped",
]

_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def random(state):
    """Uniform in [0, 1); Marsaglia's xorshift64 (2003)."""
    x = state[0]
    x ^= x << np.uint64(13)
    x ^= x >> np.uint64(7)
    x ^= x << np.uint64(17)
    state[0] = x
    return (x >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@_compiled
def wrapped(i, n, repeat):
    """Index of a row or column that may lie outside; there the other border follows, or the same goes on."""
    return i % n if repeat else min(max(i, 0), n - 1)


@_compiled
def update_active(mask, active, r0, c0, height, width, repeat_t, repeat_s):
    """Recompute which texels at the corners of the cells [r0, r0 + height) x [c0, c0 + width) are active."""
    nh, nw = mask.shape
    for i in range(r0 - 1, r0 + height):
        if i < 0 and not repeat_t:
            continue
        r = wrapped(i, nh, repeat_t)
        below = wrapped(r + 1, nh, repeat_t)
        for j in range(c0, c0 + width + 1):
            if j >= nw and not repeat_s:
                continue
            c = wrapped(j, nw, repeat_s)
            left = wrapped(c - 1, nw, repeat_s)
            total = mask[r, left] + mask[r, c] + mask[below, left] + mask[below, c]
            active[r, c] = 1 if 0 < total < 4 else 0


@_compiled
def broken_at(mask, active, r, c, repeat_t, repeat_s):
    """How many rules the mask breaks at index [r, c] of `pinchmap_mask.violations`."""
    nh, nw = mask.shape
    up, right = wrapped(r - 1, nh, repeat_t), wrapped(c + 1, nw, repeat_s)
    here, beside, above, across = active[r, c], active[r, right], active[up, c], active[up, right]
    number = here + beside + above + across
    if number == 0:
        return 0
    count = 0
    if number == 4 or (number == 2 and here == across):
        count += 1
    if here:
        left, below = wrapped(c - 1, nw, repeat_s), wrapped(r + 1, nh, repeat_t)
        upper_left, upper_right, lower_left, lower_right = mask[r, left], mask[r, c], mask[below, left], mask[below, c]
        if (beside and upper_right == lower_right) or (above and upper_left == upper_right):
            count += 1
        if upper_left == lower_right and upper_right == lower_left:
            count += 1
        if c == nw - 1 and not repeat_s and (upper_left != upper_right or lower_left != lower_right):
            count += 1
        if r == 0 and not repeat_t and (upper_left != lower_left or upper_right != lower_right):
            count += 1
    return count


@_compiled
def broken_near(mask, active, r0, c0, height, width, repeat_t, repeat_s):
    """How many rules are broken where the cells [r0, r0 + height) x [c0, c0 + width) have a say."""
    nh, nw = mask.shape
    count = 0
    for i in range(r0 - 1, r0 + height + 1):
        if (i < 0 or i >= nh) and (not repeat_t or height + 2 > nh):
            continue
        for j in range(c0 - 1, c0 + width + 1):
            if (j < 0 or j >= nw) and (not repeat_s or width + 2 > nw):
                continue
            count += broken_at(mask, active, wrapped(i, nh, repeat_t), wrapped(j, nw, repeat_s), repeat_t, repeat_s)
    return count


@_compiled
def tied(r0, c0, height, width, nh, nw, repeat_t, repeat_s):
    """The rectangle with its twin cells: where the map clamps, the top two rows are equal, and the last two columns."""
    if not repeat_t and r0 < 2:
        height, r0 = min(max(r0 + height, 2), nh), 0
    if not repeat_s and c0 + width > nw - 2:
        c0 = max(min(c0, nw - 2), 0)
        width = nw - c0
    return r0, c0, height, width


@_compiled
def set_side(mask, active, r0, c0, height, width, side, repeat_t, repeat_s):
    """Set a rectangle of cells to one side."""
    for i in range(r0, r0 + height):
        for j in range(c0, c0 + width):
            mask[wrapped(i, mask.shape[0], repeat_t), wrapped(j, mask.shape[1], repeat_s)] = side
    update_active(mask, active, r0, c0, height, width, repeat_t, repeat_s)


@_compiled
def cost_near(mask, active, cell_cost, texel_cost, r0, c0, height, width, repeat_t, repeat_s):
    """Cost of the cells [r0, r0 + height) x [c0, c0 + width) and of the texels at their corners."""
    nh, nw = mask.shape
    cost = 0.0
    for i in range(r0, r0 + height):
        for j in range(c0, c0 + width):
            r, c = wrapped(i, nh, repeat_t), wrapped(j, nw, repeat_s)
            if mask[r, c]:
                cost += cell_cost[r, c]
    for i in range(r0 - 1, r0 + height):
        for j in range(c0, c0 + width + 1):
            if (i < 0 and not repeat_t) or (j >= nw and not repeat_s):
                continue
            r, c = wrapped(i, nh, repeat_t), wrapped(j, nw, repeat_s)
            if not active[r, c]:
                cost += max(-texel_cost[r, c], 0.0) if mask[r, c] else max(texel_cost[r, c], 0.0)
    return cost


@_compiled
def total_cost(mask, active, cell_cost, texel_cost):
    """Cost of all cells and inactive texels."""
    cost = 0.0
    for r in range(mask.shape[0]):
        for c in range(mask.shape[1]):
            if mask[r, c]:
                cost += cell_cost[r, c]
            if not active[r, c]:
                cost += max(-texel_cost[r, c], 0.0) if mask[r, c] else max(texel_cost[r, c], 0.0)
    return cost
