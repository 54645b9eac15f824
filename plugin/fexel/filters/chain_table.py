"""Where shaders/filter_chains.glsl finds the cells of an image: by direction, octaves and level.

The table is complete: whatever a pixel chooses, it names texels that are resident. A direction without any is replaced
by the one whose footprints are most alike; a cell by one of its direction that is as near as there is, coarser rather
than finer.

Layout:
    0         where the directions are, from the image's record on; codes = first level + 16 log2 levels + 256 octaves;
              width and height of the page
    then per long axis, x and y, and shear in quarters from -4 to 4, of the direction that serves it: shear; where its
              cells are, from the first of these texels on; fewest octaves; 1 where its long axis is x, else 0
    then whatever else a filter knows of the image
    then the cells of each direction that there is, `PLAIN` ones first, levels within octaves from 0 on: page
              coordinates of a period, or of all of the cell where it does not repeat, along the long axis and along the
              moved one; then of its begin
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.filters.shears import DIRECTIONS, Direction

__all__ = ["MOST_LEVELS", "PLAIN", "Cells", "chain_table"]

PLAIN = (0, 3)
"""Directions that move nothing: of these the image itself is the chain of 0 octaves."""

MOST_LEVELS = 16
"""Levels that a table can have; the coarsest stands for those beyond."""

_SLANTS = tuple(Direction(axis, quarters / 4) for axis in (0, 1) for quarters in range(-4, 5))
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


def chain_table(cells: Mapping[int, Cells], first: int, page: tuple[int, int], facts: NDArray) -> NDArray[np.float64]:
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
    start = {direction: len(_SLANTS) + len(facts) + row * number for number, direction in enumerate(order)}
    serving = [_most_alike(slant, list(cells)) for slant in _SLANTS]
    directions = [
        (DIRECTIONS[used].shear, start[used], int(cells[used].octaves.min()), DIRECTIONS[used].long_axis == 0)
        for used in serving
    ]
    head = [first + 1, lowest + 16 * bits + 256 * (len(octaves) - 1), *page]
    return np.concatenate([[head], directions, facts, *(_row(cells[each], octaves, levels) for each in order)])


def _row(cells: Cells, octaves: NDArray[np.int64], levels: NDArray[np.int64]) -> NDArray[np.float64]:
    """(octaves * levels, 4): of each the cell that is nearest."""
    level = np.tile(levels, len(octaves))[:, None]
    long_level = np.repeat(octaves, len(levels))[:, None] + level
    off = np.stack([cells.level - level, cells.octaves + cells.level - long_level])
    return cells.place[np.where(off > 0, off, -_FINER * off).sum(axis=0).argmin(axis=1)]


def _most_alike(slant: Direction, among: list[int]) -> int:
    """The direction whose footprints include the least angle with those of `slant`; of equals one of its long axis."""
    off = [abs(math.sin(_angle(DIRECTIONS[each]) - _angle(slant))) for each in among]
    other_axis = [DIRECTIONS[each].long_axis != slant.long_axis for each in among]
    return min(zip(np.round(off, 6), other_axis, among, strict=True))[2]


def _angle(slant: Direction) -> float:
    """Of the footprints that are brought onto the long axis, radians from x towards y."""
    return math.atan2(-slant.shear, 1.0) if slant.long_axis == 0 else math.atan2(1.0, -slant.shear)
