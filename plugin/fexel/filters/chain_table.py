"""Where shaders/filter_chains.glsl finds the cells of an image: by direction, octaves and level.

The table is complete: whatever a pixel chooses, it names texels that are resident. A direction without any is replaced
by the one whose footprints are most alike; a cell by one of its direction that is as near as there is, coarser rather
than finer.

Layout:
    0         where the directions are, from the image's record on; codes = first level + 16 log2 levels + 256 octaves;
              width and height of the page
    then per long axis, x and y, and shear from -1 to 1 in steps of a quarter (of a sixteenth where pixels are
              Gaussians), of the direction that serves it: shear; where its cells are, from the first of these texels
              on; fewest octaves; 1 where its long axis is x, else 0
    then whatever else a filter knows of the image
    then the cells of each direction that there is, `PLAIN` ones first, levels within octaves from 0 on: page
              coordinates of a period, or of all of the cell where it does not repeat, along the long axis and along the
              moved one, negative where the cell has a texel of the image more on either side of it; then of its begin
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.filters.shears import FINE_DIRECTIONS
from fexel.filters.tiles import halvings

__all__ = ["FINE_STEPS", "MOST_LEVELS", "PLAIN", "STEPS", "Cells", "chain_table"]

PLAIN = (0, 3)
"""Directions that move nothing: of these the image itself is the chain of 0 octaves."""

MOST_LEVELS = 16
"""Levels that a table can have; the coarsest stands for those beyond."""

STEPS, FINE_STEPS = 4, 16
"""Of 1 in the shears of a table: of `DIRECTIONS`, and of `FINE_DIRECTIONS`."""

_AXES = np.array([direction.long_axis for direction in FINE_DIRECTIONS])
_SHEARS = np.array([direction.shear for direction in FINE_DIRECTIONS])
_OTHER = 1e-3  # per octave that is another one of equal resolution, as where lines are down to one
_FINER = 8.0  # what a cell that is an octave finer than asked for costs, over one that is as much coarser


@dataclass(frozen=True, eq=False)
class Cells:
    """Resident cells of a direction.

    Attributes
    ----------
    octaves, level : (N,) int64
        0 octaves: mip levels of the image itself.
    place : (N, 4) float64
        As in the table.
    """

    octaves: NDArray[np.int64]
    level: NDArray[np.int64]
    place: NDArray[np.float64]


def chain_table(
    cells: Mapping[int, Cells],
    first: int,
    page: tuple[int, int],
    facts: NDArray,
    extent: tuple[int, int],
    steps: int = STEPS,
) -> NDArray[np.float64]:
    """The table of an image.

    Parameters
    ----------
    cells : mapping of int to Cells
        By number of a direction; none of them empty, `PLAIN` ones among them.
    first : int
        Where the table is, from the image's record on.
    page : (int, int)
        Width and height of the page.
    facts : (F, 4)
        What a filter knows of the image.
    extent : (int, int)
        Of its `fexel.filters.tiles.Tile`.
    steps : int
        `STEPS` or `FINE_STEPS`.

    Returns
    -------
    (N, 4) float64
    """
    octaves = np.arange(max(int(each.octaves.max()) for each in cells.values()) + 1)
    lowest = min(int(each.level.min()) for each in cells.values())
    highest = max(int(each.level.max()) for each in cells.values())
    bits = int(min(highest - lowest, MOST_LEVELS - 1)).bit_length()  # the shader multiplies by a shift
    levels = np.arange(lowest, lowest + (1 << bits))
    row = len(octaves) * len(levels)
    order = sorted(cells, key=lambda direction: (direction not in PLAIN, direction))
    serving = _most_alike(np.array(order), extent, steps)
    start = {direction: len(serving) + len(facts) + row * number for number, direction in enumerate(order)}
    directions = [
        (_SHEARS[used], start[used], int(cells[used].octaves.min()), _AXES[used] == 0) for used in serving.tolist()
    ]
    lines = [extent[axis] for axis in _AXES[order]]
    rows = [_row(cells[each], octaves, levels, halvings(length)) for each, length in zip(order, lines, strict=True)]
    head = [first + 1, lowest + 16 * bits + 256 * (len(octaves) - 1), *page]
    return np.concatenate([[head], directions, facts, *rows])


def _row(cells: Cells, octaves: NDArray[np.int64], levels: NDArray[np.int64], last: int) -> NDArray[np.float64]:
    """(octaves * levels, 4): of each the cell that is nearest; lines can be halved `last` times."""
    level = np.tile(levels, len(octaves))[:, None]
    long_level = np.repeat(octaves, len(levels))[:, None] + level
    halved = np.minimum(cells.octaves + cells.level, last) - np.minimum(long_level, last)
    off = np.stack([cells.level - level, halved])
    cost = np.where(off > 0, off, -_FINER * off).sum(axis=0)
    cost += _OTHER * np.abs(cells.octaves - np.repeat(octaves, len(levels))[:, None])
    return cells.place[cost.argmin(axis=1)]


def _most_alike(among: NDArray[np.int64], extent: tuple[int, int], steps: int) -> NDArray[np.int64]:
    """Of every slant of a table the direction whose footprints include the least angle with its.

    Of equals one of its long axis, else the first. No shear moves a single line.
    """
    axis = np.repeat([0, 1], 2 * steps + 1)
    shear = np.tile(np.arange(-steps, steps + 1) / steps, 2)
    angle = _angles(_AXES[among], _SHEARS[among]) - _angles(axis, shear)[:, None]
    off = np.round(np.abs(np.sin(angle)), 6) + 1e-7 * (_AXES[among] != axis[:, None])  # less than what is rounded off
    alike = among[np.argmin(off + 1e-10 * among, axis=1)]
    long_axis = np.where(np.abs(shear) == 1, 1, axis)  # 1 of x is 1 of y
    return np.where(np.array(extent)[long_axis] == 1, np.array(PLAIN)[long_axis], alike)


def _angles(axis: NDArray[np.int64], shear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the footprints that are brought onto the long axis, radians from x towards y."""
    return np.where(axis == 0, np.arctan(-shear), np.arctan2(1.0, -shear))
