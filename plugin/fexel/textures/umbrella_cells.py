"""Which umbrellas a point may see: a grid over the unit square whose cells list them front to back.

A cell lists every umbrella that touches it, or touches it moved against the shadow offset (notes U3), however often it
comes in over the borders of the unit square. The list ends at an opaque umbrella that covers the whole cell (occlusion
culling, U7), and what only casts shadows ends where one of opaque umbrellas covers the cell. Never is one missing that
a point of the cell needs; one more may be listed than touches it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.textures.umbrella_arrangement import Arrangement
from fexel.textures.umbrella_coverage import (
    Grid,
    Pictures,
    contour_edges,
    coverage,
    picture_boxes,
    umbrella_bounds,
)
from fexel.textures.umbrella_sectors import Sectors

__all__ = [
    "CASTS",
    "COVERS",
    "SHADES",
    "VISIBLE",
    "CellStatistics",
    "Cells",
    "build_cells",
    "cell_statistics",
    "fine_size",
]

VISIBLE, CASTS, COVERS, SHADES = 1, 2, 4, 8
"""Flags of entries: may be seen in the cell; may cast a shadow there; surely covers, surely shades the whole of it."""

_MOST_PICTURE = 1 << 22  # cells of umbrellas' pictures at a time, for memory
_MOST_EDGES = 1 << 19  # edges at a time, likewise
_MOST_CELLS = 1 << 20  # that `fine_size` proposes


@dataclass(frozen=True, eq=False)
class Cells:
    """Umbrellas of each cell, front to back.

    Attributes
    ----------
    size : (int, int)
        Cells along s and t; cell ``(i, j)`` is number ``j * size[0] + i``.
    first : (cells + 1,) int64
        Where the entries of each cell begin.
    umbrella : (entries,) int32
    shift : (entries, 2) int8
        Whole periods to add to a point of [0, 1]^2 for the umbrella's own coordinates.
    flags : (entries,) uint8
        `VISIBLE`, `CASTS`, `COVERS`, `SHADES`.
    """

    size: tuple[int, int]
    first: NDArray[np.int64]
    umbrella: NDArray[np.int32]
    shift: NDArray[np.int8]
    flags: NDArray[np.uint8]

    @property
    def counts(self) -> NDArray[np.int64]:
        """(cells,) length of each list."""
        return np.diff(self.first)

    def find(self, st: NDArray[np.float64]) -> NDArray[np.int64]:
        """Number of the cell that holds each point of [0, 1]^2, its upper borders included.

        Parameters
        ----------
        st : (M, 2) float64

        Returns
        -------
        (M,) int64
        """
        size = np.array(self.size)
        i, j = np.clip((st * size).astype(np.int64), 0, size - 1).T
        return j * self.size[0] + i


@dataclass(frozen=True)
class CellStatistics:
    """How many umbrellas the cells of the authored grid hold; shadows aside.

    Attributes
    ----------
    most, mean : int, float
        That touch a cell: `most` is k of the storage formula (section 7.1, eq. 2).
    most_seen, mean_seen : int, float
        Without those that opaque ones hide.
    """

    most: int
    mean: float
    most_seen: int
    mean_seen: float


def build_cells(
    arrangement: Arrangement,
    size: tuple[int, int],
    margin: float | tuple[float, float] = 0.0,
    *,
    opaque: NDArray[np.bool_] | None = None,
    cull: bool = True,
    shadows: bool = True,
) -> Cells:
    """List the umbrellas of each cell of a grid.

    Parameters
    ----------
    arrangement : Arrangement
    size : (int, int)
        Cells along s and t, each at least 1. The grid is the caller's choice: it changes the speed, not the picture.
    margin : float or (float, float)
        In st, along s and t: how far from a point its umbrellas are needed.
    opaque : (shapes,) bool, optional
        Shapes whose image has no alpha; by default those without an image. An umbrella hides others where its coverage
        is 1 as well.
    cull : bool
        Leave out what cannot be seen.
    shadows : bool
        List what casts them as well.

    Returns
    -------
    Cells
        Entries of a cell in the order of their umbrellas; of one that comes in several times, by shift.
    """
    columns, rows = max(1, int(size[0])), max(1, int(size[1]))
    margins = np.broadcast_to(np.asarray(margin, np.float64), 2) * (columns, rows)
    grid = Grid(columns, rows, margins)
    hides = _hides(arrangement, opaque)
    casts = shadows and arrangement.shadow_strength > 0
    offset = np.array(arrangement.shadow_offset) * grid.scale if casts else None
    is_star = Sectors(arrangement).is_star
    closed, dark = np.zeros(columns * rows, bool), np.zeros(columns * rows, bool)
    parts: list[_Entries] = []
    for umbrellas, pictures in _portions(arrangement, grid, offset):
        entries = _entries(arrangement, umbrellas, pictures, grid, offset, is_star[umbrellas])
        if cull:
            entries = _culled(entries, hides, closed, dark)
        parts.append(entries)
        if cull and closed.all():
            break
    return _gathered(parts, (columns, rows))


def cell_statistics(arrangement: Arrangement, opaque: NDArray[np.bool_] | None = None) -> CellStatistics:
    """Lengths of the lists of the authored grid, without and with culling; parameters as of `build_cells`."""
    whole, seen = (_seen_counts(arrangement, opaque, cull) for cull in (False, True))
    return CellStatistics(int(whole.max()), float(whole.mean()), int(seen.max()), float(seen.mean()))


def _seen_counts(arrangement: Arrangement, opaque: NDArray[np.bool_] | None, cull: bool) -> NDArray[np.int64]:
    cells = build_cells(arrangement, arrangement.grid, opaque=opaque, cull=cull)
    visible = np.concatenate([[0], np.cumsum(cells.flags & VISIBLE > 0)])
    return np.diff(visible[cells.first])


def fine_size(arrangement: Arrangement, list_length: float = 3.0, most: int = _MOST_CELLS) -> tuple[int, int]:
    """Propose a grid whose lists, culled, are about so long where umbrellas are opaque and dense.

    An umbrella of extent e touches a cell of side c as often as (e + c)^2, and covers it as often as (a e - c)^2, with
    a^2 the share of its bounding box that it fills; the ratio of the two is how many are listed until one covers.

    Parameters
    ----------
    arrangement : Arrangement
    list_length : float
        More than 1.
    most : int
        Cells at most.
    """
    if not len(arrangement):
        return 1, 1
    low, high = umbrella_bounds(arrangement)
    extent = np.median(high - low, axis=0)
    boxes = np.maximum(np.prod(high - low, axis=1), 1e-300)  # of a point, which fills nothing
    filled = np.sqrt(np.median(_areas(arrangement) / boxes))
    root = np.sqrt(max(list_length, 1.0 + 1e-6))
    side = np.clip((filled * root - 1.0) / (1.0 + root), 1 / 32, 1.0) * np.maximum(extent, 1e-6)
    size = np.clip(1.0 / side, 1.0, most)
    size *= min(1.0, np.sqrt(most / np.prod(size)))
    return max(1, int(size[0])), max(1, int(size[1]))


@dataclass(frozen=True, eq=False)
class _Entries:
    """As `Cells`, each with its cell."""

    cell: NDArray[np.int64]
    umbrella: NDArray[np.int32]
    shift: NDArray[np.int8]
    flags: NDArray[np.uint8]

    def take(self, which: NDArray) -> _Entries:
        return _Entries(self.cell[which], self.umbrella[which], self.shift[which], self.flags[which])


def _hides(arrangement: Arrangement, opaque: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
    """(n,) umbrellas that nothing is seen through."""
    if not len(arrangement):
        return np.zeros(0, bool)
    if opaque is None:
        opaque = np.array([shape.image is None for shape in arrangement.shapes])
    whole = arrangement.coverages >= 1.0 if len(arrangement.coverages) else True
    return np.asarray(opaque, bool)[arrangement.shape_of] & whole


def _areas(arrangement: Arrangement) -> NDArray[np.float64]:
    """(n,) of the contours in st."""
    begin, end = contour_edges(arrangement, np.arange(len(arrangement)))
    origin = np.repeat(arrangement.vertices[arrangement.first_vertex[:-1]], arrangement.vertex_counts - 1, axis=0)
    a, b = arrangement.vertices[begin] - origin, arrangement.vertices[end] - origin
    first = arrangement.first_vertex[:-1] - np.arange(len(arrangement))
    return 0.5 * np.abs(np.add.reduceat(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], first))


def _portions(
    arrangement: Arrangement, grid: Grid, offset: NDArray[np.float64] | None
) -> Iterator[tuple[NDArray[np.int64], Pictures]]:
    """Consecutive umbrellas, as many as fit into memory at a time, and their pictures to be filled."""
    if not len(arrangement):
        return
    low, high = picture_boxes(arrangement, grid, offset)
    cells = np.cumsum(np.prod(high - low + (1, 0), axis=1))
    edges = np.cumsum(arrangement.vertex_counts)
    done, count = 0, len(arrangement)
    while done < count:
        used_cells, used_edges = (cells[done - 1], edges[done - 1]) if done else (0, 0)
        fits = min(
            np.searchsorted(cells, used_cells + _MOST_PICTURE, "right"),
            np.searchsorted(edges, used_edges + _MOST_EDGES, "right"),
        )
        end = max(int(fits), done + 1)
        yield np.arange(done, end), Pictures(low[done:end], high[done:end])
        done = end


def _entries(
    arrangement: Arrangement,
    umbrellas: NDArray[np.int64],
    pictures: Pictures,
    grid: Grid,
    offset: NDArray[np.float64] | None,
    is_star: NDArray[np.bool_],
) -> _Entries:
    """Cells that umbrellas and their shadows touch, umbrella by umbrella."""
    begin, end = contour_edges(arrangement, umbrellas)
    owner = np.repeat(np.arange(len(umbrellas)), arrangement.vertex_counts[umbrellas] - 1)
    p, q = arrangement.vertices[begin] * grid.scale, arrangement.vertices[end] * grid.scale
    touches, covers = coverage(pictures, owner, p, q, grid.margin, is_star)
    flags = touches * np.uint8(VISIBLE) + covers * np.uint8(COVERS)
    if offset is not None:
        touches, covers = coverage(pictures, owner, p + offset, q + offset, grid.margin, is_star)
        flags += touches * np.uint8(CASTS) + covers * np.uint8(SHADES)
    place = np.flatnonzero(flags)
    number, column, row = pictures.locate(place)
    shift_s, i = np.divmod(column, grid.columns)
    shift_t, j = np.divmod(row, grid.rows)
    shift = np.stack([shift_s, shift_t], axis=1).astype(np.int8)
    return _Entries(j * grid.columns + i, umbrellas[number].astype(np.int32), shift, flags[place])


def _culled(
    entries: _Entries, hides: NDArray[np.bool_], closed: NDArray[np.bool_], dark: NDArray[np.bool_]
) -> _Entries:
    """Without what earlier entries hide; `closed` and `dark`, cells with no more to see or to shade, are updated."""
    entries = entries.take(~closed[entries.cell])
    entries = entries.take(np.argsort(entries.cell, kind="stable"))
    if not len(entries.cell):
        return entries
    begin = np.flatnonzero(np.concatenate([[True], np.diff(entries.cell) > 0]))
    cells = entries.cell[begin]
    hiding = hides[entries.umbrella]
    covers, shades = hiding & (entries.flags & COVERS > 0), hiding & (entries.flags & SHADES > 0)
    keep = _until_first(covers, begin)
    lit = _until_first(shades, begin) & ~np.repeat(dark[cells], np.diff(np.append(begin, len(entries.cell))))
    flags = np.where(lit, entries.flags, entries.flags & np.uint8(~(CASTS | SHADES) & 0xFF))
    closed[cells[np.logical_or.reduceat(covers, begin)]] = True
    dark[cells[np.logical_or.reduceat(shades, begin)]] = True
    keep &= flags & (VISIBLE | CASTS) > 0
    return _Entries(entries.cell, entries.umbrella, entries.shift, flags).take(keep)


def _until_first(condition: NDArray[np.bool_], begin: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Entries of each group up to the first that meets a condition, that one included."""
    before = np.cumsum(condition) - condition
    counts = np.diff(np.append(begin, len(condition)))
    return before == np.repeat(before[begin], counts)


def _gathered(parts: list[_Entries], size: tuple[int, int]) -> Cells:
    """All portions in one list, sorted by cell."""
    empty = _Entries(np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros((0, 2), np.int8), np.zeros(0, np.uint8))
    joined = [np.concatenate([getattr(part, name) for part in (empty, *parts)]) for name in _Entries.__annotations__]
    order = np.argsort(joined[0], kind="stable")
    entries = _Entries(*joined).take(order)
    first = np.searchsorted(entries.cell, np.arange(size[0] * size[1] + 1))
    return Cells(size, first.astype(np.int64), entries.umbrella, entries.shift, entries.flags)
