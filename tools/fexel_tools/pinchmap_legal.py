"""The nearest mask that a pinchmap can express, found by a local search that always ends in one; compiled.

`fexel_tools.pinchmap_mask` says which masks are legal. What a mask costs is of two kinds: a cell on the wrong side of
the image's majority (a little: gamma moves the boundary within the cells beside it), and an inactive texel whose side
the image contradicts (much: gamma cannot turn its sign). Moves set rectangles of cells to one side. Where no small one
lowers the number of broken rules, larger squares are tried, up to the whole map, which is legal: so the search ends.
"""

from __future__ import annotations

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from fexel_tools.pinchmap_changes import (
    broken_at,
    broken_near,
    cost_near,
    random,
    set_side,
    tied,
    total_cost,
    update_active,
    wrapped,
)

__all__ = ["legalise"]

_HEAT, _COOLING = 0.3, 0.01  # first temperature, in pixels of a cell, and the last one over it
_MOST_MOVES = 1_500_000  # of a restart: about a second
_ENOUGH_MOVES = 80_000  # for a third restart and more
_MOST_TRIED = 2000  # places mended one by one in one go; of noise the rest is left to larger squares
_MOST_TRIED_EVER = 6000  # in all: about a second or two
_compiled = numba.njit(cache=True, nogil=True, error_model="numpy")


def legalise(
    mask: NDArray[np.bool_],
    cell_cost: NDArray[np.float64],
    texel_cost: NDArray[np.float64],
    repeat: tuple[bool, bool],
    *,
    unit: float,
    restarts: int = 8,
    trials: int = 200,
    seed: int = 0,
) -> NDArray[np.bool_]:
    """A legal mask of low cost.

    Parameters
    ----------
    mask : (Nh, Nw) bool
        Where to start.
    cell_cost : (Nh, Nw) float64
        Cost of a cell on the + side less that of one on the - side.
    texel_cost : (Nh, Nw) float64
        Cost of an inactive texel: positive numbers where it is on the - side, negative ones, by their amount, where it
        is on the + side.
    repeat : (bool, bool)
        Along s and t: whether the map repeats.
    unit : float
        Pixels of a cell; a texel that costs less than a hundredth of it is not worth annealing.
    restarts, trials : int
        Annealing runs at most, of which the best is taken at each place, and moves per cell in each.
    seed : int
    """
    best = np.array(mask, np.uint8)
    if not repeat[1]:
        best[:1] = best[1:2] if len(best) > 1 else best[:1]
    if not repeat[0]:
        best[:, -1:] = best[:, -2:-1] if best.shape[1] > 1 else best[:, -1:]
    active = np.empty_like(best)
    update_active(best, active, 0, 0, *best.shape, repeat[1], repeat[0])
    budget = np.array([_MOST_TRIED_EVER])
    least = _make_legal(best, active, (0, 0, *best.shape), cell_cost, texel_cost, unit, repeat, budget)
    spent, idle = 0, 0
    for run in range(restarts):
        near = _dilated(_wrong_texels(best, active, texel_cost, 0.01 * unit), repeat)
        moves = min(trials, _MOST_MOVES // max(int(near.sum()), 1))
        spent += moves * int(near.sum())
        if idle == 2 or budget[0] <= 0 or (run >= 2 and spent > _ENOUGH_MOVES):
            break
        idle += 1
        number, labels, boxes, _ = cv2.connectedComponentsWithStats(near.astype(np.uint8), connectivity=8)
        for label in range(1, number):  # each for itself: one place's luck must not hang on another's
            left, top, width, height, _ = boxes[label]
            places = np.argwhere(labels[top : top + height, left : left + width] == label) + (top, left)
            cells, around = best.copy(), active.copy()
            chance = (seed * restarts + run) * 65537 + label
            count = moves * len(places)
            _anneal(cells, around, cell_cost, texel_cost, places, unit, count, repeat[1], repeat[0], chance)
            box = (max(top - 3, 0), max(left - 3, 0), top + height + 3, left + width + 3)
            cost = _make_legal(cells, around, box, cell_cost, texel_cost, unit, repeat, budget)
            if cost < least:
                best, active, least, idle = cells, around, cost, 0
    return best.astype(bool)


def _make_legal(cells, active, box, cell_cost, texel_cost, unit: float, repeat: tuple[bool, bool], budget) -> float:
    """Mend what is broken within a box of cells, or else anywhere, in place, and return the cost.

    `budget` (1,) is how many places may yet be mended one by one.
    """
    top = max(float(np.abs(texel_cost).max()), float(np.abs(cell_cost).max()), unit)
    for penalty in (unit, 4 * unit, 1e9 * top):
        _improve(cells, active, cell_cost, texel_cost, penalty, repeat[1], repeat[0], 8, box, budget)
    _force(cells, active, cell_cost, repeat[1], repeat[0])
    return total_cost(cells, active, cell_cost, texel_cost)


def _wrong_texels(mask, active, texel_cost, least: float):
    """Inactive texels whose side costs more than `least`."""
    return (active == 0) & (np.where(mask > 0, -texel_cost, texel_cost) > least)


def _dilated(places: NDArray[np.bool_], repeat: tuple[bool, bool]) -> NDArray[np.bool_]:
    """With all within five rows and columns."""
    reach = 5
    modes = [("wrap" if joined else "constant") for joined in repeat]
    for axis, mode in ((0, modes[1]), (1, modes[0])):
        before = places
        for shift in range(1, reach + 1):
            for step in (shift, -shift):
                moved = np.roll(before, step, axis)
                if mode == "constant":
                    edge = slice(None, step) if step > 0 else slice(step, None)
                    moved[edge if axis == 0 else (slice(None), edge)] = False
                places = places | moved
    return places


@_compiled
def _anneal(mask, active, cell_cost, texel_cost, places, unit, trials, repeat_t, repeat_s, seed):
    """Simulated annealing by rectangles of up to 2 x 2 or 1 x 4 cells about `places` (P, 2)."""
    nh, nw = mask.shape
    state = np.array([seed * 2 + 0x9E3779B97F4A7C15], np.uint64)
    saved, fresh = np.empty((6, 6), mask.dtype), np.empty((8, 8), np.uint8)
    broken = np.empty((nh, nw), np.uint8)
    for r in range(nh):
        for c in range(nw):
            broken[r, c] = broken_at(mask, active, r, c, repeat_t, repeat_s)
    for trial in range(trials):
        progress = trial / trials
        heat = unit * _HEAT * _COOLING**progress
        penalty = unit * (0.5 + 2 * progress)
        place = int(random(state) * len(places))
        height, width = min(1 + int(random(state) * 2), nh), min(1 + int(random(state) * 2), nw)
        if random(state) < 0.3:  # a stretch of a staircase
            length = 2 + int(random(state) * 3)
            height, width = (1, min(length, nw)) if random(state) < 0.5 else (min(length, nh), 1)
        r0 = places[place, 0] - int(random(state) * height)
        c0 = places[place, 1] - int(random(state) * width)
        if not repeat_t:
            r0 = min(max(r0, 0), nh - height)
        if not repeat_s:
            c0 = min(max(c0, 0), nw - width)
        r0, c0, height, width = tied(r0, c0, height, width, nh, nw, repeat_t, repeat_s)
        side = 1 - mask[places[place, 0], places[place, 1]]
        before = cost_near(mask, active, cell_cost, texel_cost, r0, c0, height, width, repeat_t, repeat_s)
        first_row, last_row = r0 - 1, r0 + height + 1
        first_column, last_column = c0 - 1, c0 + width + 1
        if not repeat_t or last_row - first_row > nh:
            first_row, last_row = max(first_row, 0), min(last_row, nh)
        if not repeat_s or last_column - first_column > nw:
            first_column, last_column = max(first_column, 0), min(last_column, nw)
        count = 0
        for i in range(first_row, last_row):
            for j in range(first_column, last_column):
                count += broken[wrapped(i, nh, repeat_t), wrapped(j, nw, repeat_s)]
        for i in range(height):
            for j in range(width):
                saved[i, j] = mask[wrapped(r0 + i, nh, repeat_t), wrapped(c0 + j, nw, repeat_s)]
        set_side(mask, active, r0, c0, height, width, side, repeat_t, repeat_s)
        # Metropolis: accepted if exp((before - after) / heat) exceeds a uniform number, decided as early as possible.
        limit = before + penalty * count - heat * np.log(max(random(state), 1e-12))
        after = cost_near(mask, active, cell_cost, texel_cost, r0, c0, height, width, repeat_t, repeat_s)
        for i in range(first_row, last_row):
            if after > limit:
                break
            for j in range(first_column, last_column):
                now = broken_at(mask, active, wrapped(i, nh, repeat_t), wrapped(j, nw, repeat_s), repeat_t, repeat_s)
                fresh[i - first_row, j - first_column] = now
                after += penalty * now
        if after <= limit:
            for i in range(first_row, last_row):
                for j in range(first_column, last_column):
                    broken[wrapped(i, nh, repeat_t), wrapped(j, nw, repeat_s)] = fresh[i - first_row, j - first_column]
            continue
        for i in range(height):
            for j in range(width):
                mask[wrapped(r0 + i, nh, repeat_t), wrapped(c0 + j, nw, repeat_s)] = saved[i, j]
        update_active(mask, active, r0, c0, height, width, repeat_t, repeat_s)


@_compiled
def _penalised(mask, active, cell_cost, texel_cost, penalty, r0, c0, height, width, repeat_t, repeat_s):
    plain = cost_near(mask, active, cell_cost, texel_cost, r0, c0, height, width, repeat_t, repeat_s)
    return plain + penalty * broken_near(mask, active, r0, c0, height, width, repeat_t, repeat_s)


@_compiled
def _best_move(mask, active, cell_cost, texel_cost, penalty, r, c, largest, repeat_t, repeat_s, saved):
    """Make the rectangle move near cell [r, c] that lowers the cost most; return by how much."""
    nh, nw = mask.shape
    best, move = -1e-9, (0, 0, 0, 0, 0)  # 1e-9: rounding is no gain
    for rows in range(1, min(largest, nh) + 1):
        for columns in range(1, min(largest, nw) + 1):
            for first_row in range(r - rows, r + 2):
                if not repeat_t and (first_row < 0 or first_row + rows > nh):
                    continue
                for first_column in range(c - columns, c + 2):
                    if not repeat_s and (first_column < 0 or first_column + columns > nw):
                        continue
                    r0, c0, height, width = tied(first_row, first_column, rows, columns, nh, nw, repeat_t, repeat_s)
                    before = np.nan
                    for side in range(2):
                        changed = False
                        for i in range(height):
                            for j in range(width):
                                value = mask[wrapped(r0 + i, nh, repeat_t), wrapped(c0 + j, nw, repeat_s)]
                                saved[i, j] = value
                                changed = changed or value != side
                        if not changed:
                            continue
                        if np.isnan(before):
                            before = _penalised(
                                mask, active, cell_cost, texel_cost, penalty, r0, c0, height, width, repeat_t, repeat_s
                            )
                        set_side(mask, active, r0, c0, height, width, side, repeat_t, repeat_s)
                        gain = (
                            _penalised(
                                mask, active, cell_cost, texel_cost, penalty, r0, c0, height, width, repeat_t, repeat_s
                            )
                            - before
                        )
                        if gain < best:
                            best, move = gain, (r0, c0, height, width, side)
                        for i in range(height):
                            for j in range(width):
                                mask[wrapped(r0 + i, nh, repeat_t), wrapped(c0 + j, nw, repeat_s)] = saved[i, j]
                        update_active(mask, active, r0, c0, height, width, repeat_t, repeat_s)
    if move[2] == 0:
        return 0.0
    set_side(mask, active, move[0], move[1], move[2], move[3], move[4], repeat_t, repeat_s)
    return -best


@_compiled
def _improve(mask, active, cell_cost, texel_cost, penalty, repeat_t, repeat_s, passes, box, budget):
    """Moves of up to 3 x 3 cells wherever a rule is broken or a texel is on the wrong side."""
    saved = np.empty((5, 5), mask.dtype)
    tried = 0
    for _ in range(passes):
        gain = 0.0
        for r in range(box[0], min(box[2], mask.shape[0])):
            for c in range(box[1], min(box[3], mask.shape[1])):
                cost = texel_cost[r, c]
                wrong = not active[r, c] and ((mask[r, c] and cost < 0) or (not mask[r, c] and cost > 0))
                if wrong or broken_at(mask, active, r, c, repeat_t, repeat_s):
                    tried += 1
                    if tried > _MOST_TRIED or budget[0] <= 0:
                        return
                    budget[0] -= 1
                    gain += _best_move(mask, active, cell_cost, texel_cost, penalty, r, c, 3, repeat_t, repeat_s, saved)
        if gain == 0:
            return


@_compiled
def _force(mask, active, cell_cost, repeat_t, repeat_s):
    """Set ever larger squares about what is still broken to the side that costs less, until nothing is."""
    nh, nw = mask.shape
    size = 2
    while True:
        total = 0
        for r in range(nh):
            for c in range(nw):
                if broken_at(mask, active, r, c, repeat_t, repeat_s) == 0:
                    continue
                total += 1
                r0, c0 = max(r - size // 2, 0), max(c - size // 2, 0)
                height, width = min(size, nh - r0), min(size, nw - c0)
                cost = 0.0
                for i in range(r0, r0 + height):
                    for j in range(c0, c0 + width):
                        cost += cell_cost[i, j]
                set_side(mask, active, r0, c0, height, width, 1 if cost < 0 else 0, repeat_t, repeat_s)
        if total == 0:
            return
        size += 1
        if size > 2 * max(nh, nw):
            mask[:] = mask[0, 0]
            active[:] = 0
            return
