"""Mask and gamma of a pinchmap from a two-sided image.

A point shows the + side where k^B > gamma^B (Tarini and Cignoni 2005, section 5.1), so that the shape depends on the
level g = k - gamma alone: the line is the zero set of its bilinear interpolation. The fit goes through four steps:

1. levels without regard to a mask: least squares on the boundary (`pinchmap_start`), descent and search on the exact
   error (`pinchmap_gamma`, `pinchmap_search`);
2. the legal mask that contradicts the signs of these levels least (`pinchmap_legal`): an inactive texel has the sign of
   its side, an active one is free;
3. rounds of reweighted least squares, of which each place takes what lowers its error;
4. search of levels and mask together, on the grid of the file's bits.

An image with more than 64 pixels along a cell is averaged down to at most that for the fit, so that its lines are then
found to about a hundredth of a cell; one with less than 8 is enlarged smoothly. The mismatch is counted on the source's
own pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel_tools.pinchmap_changes import update_active
from fexel_tools.pinchmap_faults import Fault, find_faults
from fexel_tools.pinchmap_gamma import Lattice, cell_errors, lattice_of, wrong_pixels
from fexel_tools.pinchmap_legal import legalise
from fexel_tools.pinchmap_mask import channels
from fexel_tools.pinchmap_search import clip_levels, costs_of_turning, exchange, search, sweep, sweep_freely
from fexel_tools.pinchmap_start import boundary_points, least_squares_levels, reweighted_levels, source_levels

__all__ = ["Fault", "PinchmapFit", "fit"]

_UNITS = {8: 1 / 127, 16: 1 / 32767, 32: 1 / 32767}
_MOST_PIXELS, _FEWEST_PIXELS = 64, 8  # along a cell, of the image that is fitted
_FREE_TRIALS, _TRIALS = 1.5, 3.5  # of the search without and with a mask, per cell with an error
_MOST_TRIALS = 15_000  # about three seconds; only maps with edges in thousands of cells ask for more
_MASK_SHARE = 0.2  # of the trials
_FREE_UNIT = 1 / 127
_COARSE = 0.0625  # first step of a descent
_NEAR = 0.05  # cost of a cell on the wrong side, per pixel: gamma can make up for it
_MOST_REWEIGHTED = 50_000  # cells with an error in all rounds of reweighting
_HALF = 0.45  # share of + pixels that makes a cell +; not 0.5: rough edges midway through cells must not zigzag
_ROUNDS = ((0.2, 3.0), (0.5, 1.5), (0.2, 1.5), (1.0, 3.0), (0.1, 1.0))  # of reweighting: nearest, farthest; pixels

Window = tuple[float, float, float, float]
"""Left, top, right and bottom of a map in pixels of its image."""


@dataclass(frozen=True)
class PinchmapFit:
    """A pinchmap and how well it shows its source.

    Attributes
    ----------
    pinchmap : (Nh, Nw, 4) float64
        d_s, d_t, k, gamma at strength 1, on the grid of the file's bits.
    mask : (Nh, Nw) bool
        Side of every cell, legal.
    mismatch : float
        Share of the source's pixels on the wrong side.
    window : (float, float, float, float)
        Left, top, right and bottom of the map in source pixels.
    faults : tuple of Fault
        Most important first.
    """

    pinchmap: NDArray[np.float64]
    mask: NDArray[np.bool_]
    mismatch: float
    window: Window
    faults: tuple[Fault, ...] = field(default=())


def fit(
    side: NDArray[np.float32],
    shape: tuple[int, int],
    *,
    wrap: tuple[str, str] = ("clamp", "clamp"),
    seed: int = 0,
    bits: int = 8,
    window: Window | None = None,
) -> PinchmapFit:
    """Fit a pinchmap to a two-sided image.

    Parameters
    ----------
    side : (H, W) float32
        In [0, 1], row 0 at the top; above 0.5 is the + side. NaN counts as 0.
    shape : (int, int)
        Rows and columns of texels, at least 1.
    wrap : (str, str)
        Along s and t; ``repeat`` joins the borders.
    seed : int
        Of the search; equal seeds give equal maps.
    bits : {8, 16, 32}
        Of the file that will hold the map.
    window : (float, float, float, float), optional
        Left, top, right and bottom of the map in source pixels; the whole image where not given.
    """
    side = np.nan_to_num(np.asarray(side, np.float32), nan=0.0)
    if side.ndim != 2 or side.size == 0:
        raise FexelError(f"side image of a pinchmap: shape {side.shape}, expected (H, W) with pixels")
    if min(shape) < 1:
        raise FexelError(f"pinchmap of {shape[1]}x{shape[0]} texels, expected at least 1x1")
    if bits not in _UNITS:
        raise FexelError(f"pinchmap of {bits} bits, expected 8, 16 or 32")
    repeat = (wrap[0] == "repeat", wrap[1] == "repeat")
    full = window or (0.0, 0.0, float(side.shape[1]), float(side.shape[0]))
    unit = _UNITS[bits]
    image, scaled = _at_working_size(side, shape, full)
    lattice = lattice_of((image > 0.5).astype(np.uint8), shape, repeat, scaled)
    if lattice.ones.sum() in (0, lattice.pixels.sum()):
        mask = np.full(shape, bool(lattice.ones.any()))
        levels = np.where(mask, 1.0, -1.0)
    else:
        levels, mask = _solve(image, lattice, shape, repeat, scaled, _locked(side.shape, shape, full), unit, seed)
    pinchmap = _pinchmap_of(levels, mask, wrap, unit)
    plus = (side > 0.5).astype(np.uint8)
    wrong = wrong_pixels(plus, pinchmap[..., 2] - pinchmap[..., 3], repeat, full)
    faults = find_faults(plus, wrong, ((full[2] - full[0]) / shape[1], (full[3] - full[1]) / shape[0]))
    return PinchmapFit(pinchmap, mask, float(wrong.mean()), full, faults)


def _at_working_size(side: NDArray, shape: tuple[int, int], window: Window) -> tuple[NDArray, Window]:
    """The image about the window, so resized that a cell has 8 to 64 pixels a side, and the window in its pixels."""
    left, top = max(int(window[0]) - 2, 0), max(int(window[1]) - 2, 0)  # 2: what the resampling looks at
    side = side[top : int(window[3]) + 3, left : int(window[2]) + 3]
    window = (window[0] - left, window[1] - top, window[2] - left, window[3] - top)
    factors = []
    for first, last, cells in ((window[0], window[2], shape[1]), (window[1], window[3], shape[0])):
        size = (last - first) / cells
        factors.append(1 / ceil(size / _MOST_PIXELS) if size > _MOST_PIXELS else max(ceil(_FEWEST_PIXELS / size), 1))
    if factors == [1, 1]:
        return np.ascontiguousarray(side), window
    target = tuple(max(round(n * f), 1) for n, f in zip(side.shape[::-1], factors, strict=True))
    fx, fy = target[0] / side.shape[1], target[1] / side.shape[0]
    for size in ((target[0], side.shape[0]), target):  # one axis after the other: they may differ in direction
        smaller = size[0] < side.shape[1] or size[1] < side.shape[0]
        side = cv2.resize(side, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_CUBIC)
    return np.ascontiguousarray(side, np.float32), (window[0] * fx, window[1] * fy, window[2] * fx, window[3] * fy)


def _solve(
    image: NDArray, lattice: Lattice, shape: tuple[int, int], repeat: tuple[bool, bool], window, locked, unit, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Levels on the grid of `unit` and a legal mask."""
    points = boundary_points(image, shape, window)
    pixel = max(shape[1] / (window[2] - window[0]), shape[0] / (window[3] - window[1]))  # in cells
    plus = (_side_at_texels(image, shape, window) > 0.5) & (locked == 0)
    distance = source_levels(points, len(points), plus, repeat[1], repeat[0])
    low, high = np.where(plus, 0.01, -1.0), np.where(plus, 1.0, -0.01)
    first = _swept_freely(lattice, least_squares_levels(points, distance, low, high, repeat, pixel))
    second = _searched_freely(lattice, first, seed)
    coarse = unit * 2.0 ** max(round(np.log2(_COARSE / unit)), 0)
    attempts = []
    for free in (first, second):  # the better levels need not suit the better mask
        cells = _legal_mask(lattice, free, distance, locked, repeat, seed).astype(np.uint8)
        if attempts and (cells == attempts[0][0]).all():
            continue
        active = np.empty(shape, np.uint8)
        update_active(cells, active, 0, 0, *shape, repeat[1], repeat[0])
        levels = second.copy()
        errors = _reweighted(lattice, cells, active, levels, points, repeat, pixel, unit, coarse)
        attempts.append((cells, active, levels, errors))
    cells, active, levels, errors = min(attempts, key=lambda attempt: int(attempt[3].sum()))
    trials = _trials(_TRIALS, errors)
    search(lattice, cells, active, levels, errors, locked, unit, coarse, trials, _MASK_SHARE, seed)
    return levels, cells.astype(bool)


def _swept_freely(lattice: Lattice, levels):
    """Levels of any sign in [-1, 1], as if every texel were active, after two sweeps of descent."""
    levels = levels.copy()
    errors = np.zeros(levels.shape, np.int64)
    cell_errors(lattice, levels, errors)
    for _ in range(2):
        sweep_freely(lattice, levels, errors, 0.1, 0.004)
    return levels


def _searched_freely(lattice: Lattice, levels, seed: int):
    """The same after a search."""
    levels = levels.copy()
    errors = np.zeros(levels.shape, np.int64)
    cell_errors(lattice, levels, errors)
    free, locked = np.ones(levels.shape, np.uint8), np.zeros(levels.shape, np.uint8)
    trials = _trials(_FREE_TRIALS, errors)
    search(lattice, free, free, levels, errors, locked, _FREE_UNIT, 8 * _FREE_UNIT, trials, 0.0, seed)
    return levels


def _legal_mask(lattice: Lattice, levels, distance, locked, repeat, seed: int) -> NDArray[np.bool_]:
    """The legal mask that suits the signs of the levels best."""
    errors = np.empty(levels.shape, np.int64)
    cell_errors(lattice, levels, errors)
    area = float(lattice.pixels.max())
    turning = costs_of_turning(lattice, levels, errors)
    turning = np.where(np.abs(distance) < 1, turning, np.sign(distance) * 2 * area)
    surplus = lattice.ones - _HALF * lattice.pixels
    cost = -2 * _NEAR * surplus + 1e3 * area * locked
    majority = (surplus > 0) & (locked == 0)
    return legalise(majority, cost, turning, repeat, unit=area, seed=seed)


def _reweighted(lattice: Lattice, cells, active, levels, points, repeat, pixel: float, unit: float, coarse: float):
    """Bring the levels under a mask, in place, take what is best of some rounds, and return the errors."""
    clip_levels(cells, active, levels, unit)
    errors, other_errors = np.empty(levels.shape, np.int64), np.empty(levels.shape, np.int64)
    cell_errors(lattice, levels, errors)
    for _ in range(2):
        sweep(lattice, cells, active, levels, errors, unit, coarse)
    low = np.where(active, unit - 1, np.where(cells, unit, unit - 2))
    high = np.where(active, 1 - unit, np.where(cells, 2 - unit, -unit))
    rounds = _MOST_REWEIGHTED // max(int((errors > 0).sum()), 1)
    for nearest, farthest in _ROUNDS[: max(rounds, 1)]:
        other = reweighted_levels(points, levels, low, high, repeat, nearest * pixel, farthest * pixel)
        clip_levels(cells, active, other, unit)
        cell_errors(lattice, other, other_errors)
        sweep(lattice, cells, active, other, other_errors, unit, coarse)
        for size in (4, 2):
            if size <= min(levels.shape):
                exchange(lattice, levels, errors, other, size)
    return errors


def _trials(per_cell: float, errors: NDArray[np.int64]) -> int:
    return min(int(per_cell * (errors > 0).sum()), _MOST_TRIALS)


def _locked(size, shape, window):
    """Cells that must be on the - side, since clamping carries them on over what the window leaves out of the image."""
    locked = np.zeros(shape, np.uint8)
    if window[0] > 0:
        locked[:, :1] = 1
    if window[1] > 0:
        locked[:2] = 1
    if window[2] < size[1] - 0.5:
        locked[:, -2:] = 1
    if window[3] < size[0] - 0.5:
        locked[-1:] = 1
    return locked


def _side_at_texels(image, shape, window):
    """The image, bilinearly interpolated, at the texels."""
    x = window[0] + np.arange(shape[1]) * (window[2] - window[0]) / shape[1]
    y = window[1] + (np.arange(shape[0]) + 1) * (window[3] - window[1]) / shape[0]
    columns, rows = np.meshgrid(x - 0.5, y - 0.5)
    return cv2.remap(
        image, columns.astype(np.float32), rows.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )


def _pinchmap_of(levels, mask, wrap, unit):
    parts = channels(mask, wrap)
    gamma = np.rint((parts[..., 2] - levels) / unit) * unit
    return np.concatenate([parts, np.clip(gamma, -1 + unit, 1 - unit)[..., None]], axis=2)
