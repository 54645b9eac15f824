"""Cells that contours touch, and those that they cover whole: a small picture of the cells around every umbrella.

Pieces of the contour, grown by a margin, mark the cells that it crosses; a winding number of cell centres, summed along
rows, tells which of the others lie inside. Coordinates are in cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.textures.umbrella_arrangement import Arrangement

__all__ = ["Grid", "Pictures", "contour_edges", "coverage", "picture_boxes", "umbrella_bounds"]

_PIECE = 0.5  # longest piece of a contour: its bounding box stands for it
_ROUNDING = 1e-7  # what float64 may be off by, with a thousand cells along an axis, a thousand times over


@dataclass(frozen=True, eq=False)
class Grid:
    """Cells over the unit square.

    Attributes
    ----------
    columns, rows : int
    margin : (2,) float64
        In cells: how far from a cell its umbrellas are needed.
    """

    columns: int
    rows: int
    margin: NDArray[np.float64]

    @property
    def scale(self) -> NDArray[np.float64]:
        """(2,) from st to cells."""
        return np.array([self.columns, self.rows], np.float64)


def umbrella_bounds(arrangement: Arrangement) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n, 2) lowest and highest coordinates of each umbrella, in st."""
    begin = arrangement.first_vertex[:-1]
    return np.minimum.reduceat(arrangement.vertices, begin), np.maximum.reduceat(arrangement.vertices, begin)


def contour_edges(
    arrangement: Arrangement, umbrellas: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Vertices at both ends of every contour edge of consecutive umbrellas."""
    low, high = arrangement.first_vertex[umbrellas[0]], arrangement.first_vertex[umbrellas[-1] + 1]
    begin = np.delete(np.arange(low, high), arrangement.first_vertex[umbrellas] - low)
    end = begin + 1
    last = np.cumsum(arrangement.vertex_counts[umbrellas] - 1) - 1
    end[last] = arrangement.first_vertex[umbrellas] + 1
    return begin, end


def picture_boxes(
    arrangement: Arrangement, grid: Grid, offset: NDArray[np.float64] | None
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(n, 2) first cells of the umbrellas' pictures, and those past the end, not wrapped; with shadows at an offset."""
    low, high = (bound * grid.scale for bound in umbrella_bounds(arrangement))
    if offset is not None:
        low, high = np.minimum(low, low + offset), np.maximum(high, high + offset)
    grown = grid.margin + _ROUNDING
    return np.floor(low - grown).astype(np.int64), np.floor(high + grown).astype(np.int64) + 1


class Pictures:
    """Cells around each umbrella, row by row, one umbrella after the other; every row has a slot past its end."""

    def __init__(self, low: NDArray[np.int64], high: NDArray[np.int64]) -> None:
        self.low = low
        self.width = high[:, 0] - low[:, 0] + 1
        self.height = high[:, 1] - low[:, 1]
        self.first = np.concatenate([[0], np.cumsum(self.width * self.height)])

    @property
    def total(self) -> int:
        """Slots of all."""
        return int(self.first[-1])

    def slot(self, owner: NDArray[np.int64], column: NDArray[np.int64], row: NDArray[np.int64]) -> NDArray[np.int64]:
        """Of cells that lie in the picture."""
        low = self.low[owner]
        return self.first[owner] + (row - low[:, 1]) * self.width[owner] + (column - low[:, 0])

    def locate(self, slot: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Umbrella, column and row of slots."""
        owner = np.searchsorted(self.first, slot, side="right") - 1
        row, column = np.divmod(slot - self.first[owner], self.width[owner])
        return owner, column + self.low[owner, 0], row + self.low[owner, 1]

    def is_cell(self) -> NDArray[np.bool_]:
        """(total,) False for the slots past the ends of rows."""
        result = np.ones(self.total, bool)
        ends = np.repeat(self.first[:-1] + self.width - 1, self.height)
        rows = np.arange(len(ends)) - np.repeat(np.cumsum(self.height) - self.height, self.height)
        result[ends + rows * np.repeat(self.width, self.height)] = False
        return result


def coverage(
    pictures: Pictures,
    owner: NDArray[np.int64],
    p: NDArray[np.float64],
    q: NDArray[np.float64],
    margin: NDArray[np.float64],
    is_star: NDArray[np.bool_],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Cells that contours p to q touch, and those that they cover whole; of an odd contour, all cells around touch."""
    crossed = np.zeros(pictures.total, bool)
    _mark_contours(crossed, pictures, owner, p, q, margin)
    inside = _windings(pictures, owner, p, q) != 0
    covers = inside & ~crossed
    touches = inside | crossed
    if not is_star.all():
        odd = np.repeat(~is_star, np.diff(pictures.first))
        covers[odd] = False
        touches |= odd & pictures.is_cell()
    return touches, covers


def _mark_contours(
    crossed: NDArray[np.bool_],
    pictures: Pictures,
    owner: NDArray[np.int64],
    p: NDArray[np.float64],
    q: NDArray[np.float64],
    margin: NDArray[np.float64],
) -> None:
    """Mark the cells that a contour grown by the margin touches: bounding boxes of short pieces."""
    pieces = np.maximum(np.ceil(np.abs(q - p).max(axis=1) / _PIECE), 1).astype(np.int64)
    number = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    step = np.repeat((q - p) / pieces[:, None], pieces, axis=0)
    begin = np.repeat(p, pieces, axis=0) + number[:, None] * step
    owner = np.repeat(owner, pieces)
    end = begin + step
    grown = margin + _ROUNDING
    low = np.floor(np.minimum(begin, end) - grown).astype(np.int64)
    extent = np.floor(np.maximum(begin, end) + grown).astype(np.int64) - low
    slot, width = pictures.slot(owner, low[:, 0], low[:, 1]), pictures.width[owner]
    widest, highest = extent.max(axis=0)
    for up in range(highest + 1):
        for across in range(widest + 1):
            used = (extent[:, 0] >= across) & (extent[:, 1] >= up)
            crossed[slot[used] + up * width[used] + across] = True


def _windings(
    pictures: Pictures, owner: NDArray[np.int64], p: NDArray[np.float64], q: NDArray[np.float64]
) -> NDArray[np.int32]:
    """How often contours run around each cell's centre; not exact where they cross the cell."""
    low = np.ceil(np.minimum(p[:, 1], q[:, 1]) - 0.5).astype(np.int64)  # rows whose centre lies at or above the one end
    count = np.ceil(np.maximum(p[:, 1], q[:, 1]) - 0.5).astype(np.int64) - low  # and below the other
    edge = np.repeat(np.arange(len(p)), count)
    row = low[edge] + np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    slope = (q[edge, 0] - p[edge, 0]) / (q[edge, 1] - p[edge, 1])
    at = p[edge, 0] + (row + 0.5 - p[edge, 1]) * slope
    column = np.ceil(np.clip(at, np.minimum(p[edge, 0], q[edge, 0]), np.maximum(p[edge, 0], q[edge, 0])) - 0.5)
    slot = pictures.slot(owner[edge], column.astype(np.int64), row)
    steps = np.zeros(pictures.total, np.int32)
    np.add.at(steps, slot, np.where(q[edge, 1] > p[edge, 1], np.int32(-1), np.int32(1)))
    return np.cumsum(steps, dtype=np.int32)  # the steps of a row sum to zero
