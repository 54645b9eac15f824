"""Spatial index over what a view sees of a zipmap: which layers may be seen where, at which mip levels.

A tree of square grids over the visible local texture coordinates, built anew for every view: a fixed grid serves
neither a nested deep zoom nor a grazing view. Its leaves hold the layers that touch them, front to back, so that the
cost of a lookup follows overlap depth and not the number of patches. All arithmetic is float64 and vectorised over
(cell, layer) and (cell, piece) pairs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LocalPieces", "Tree", "build_tree"]

_ROOT_CELLS = 24
_CHILDREN = 4
_MAX_DEPTH = 6
_MAX_CELLS = 400_000
# A leaf longer than this is split while it is larger than _MIN_CELL_PX.
_LEAF_LENGTH = 3
_MIN_CELL_PX = 10.0


@dataclass(frozen=True, eq=False)
class LocalPieces:
    """Visible pieces in local st: bounds (P, 2) and Jacobians (P, 3, 2, 2), local units per pixel."""

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    jacobian: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Tree:
    """Cells of all grids and the layers in the leaves.

    Attributes
    ----------
    origin, cell_size : (2,) float64
        Of the outermost grid, local st.
    shape : (int, int)
        Its cells along s and t.
    first_child : (C,) int64
        Index of the first of a cell's children (row by row), or -1 for a leaf. The outermost grid comes first.
    children : int
        Cells per axis of every inner grid.
    low, high : (C, 2) float64
        Visible part of each cell.
    jacobian : (C, 3, 2, 2) float64
        In each cell, those of the smallest and of the narrowest footprint, then that of the largest.
    visible : (C,) bool
    pair_cell, pair_layer : (K,) int64
        Leaf and layer of every listed pair, in order of cells, then front to back (falling layer numbers).
    """

    origin: NDArray[np.float64]
    cell_size: NDArray[np.float64]
    shape: tuple[int, int]
    first_child: NDArray[np.int64]
    children: int
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    jacobian: NDArray[np.float64]
    visible: NDArray[np.bool_]
    pair_cell: NDArray[np.int64]
    pair_layer: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Grid:
    """One generation of cells with the pieces and layers that touch them."""

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    piece: tuple[NDArray[np.int64], NDArray[np.int64]]
    layer: tuple[NDArray[np.int64], NDArray[np.int64]]


def build_tree(
    pieces: LocalPieces,
    local_to_layer: NDArray[np.float64],
    layer_bounds: NDArray[np.float64],
    reach: float = 0.5,
) -> Tree:
    """Index what `pieces` show.

    Parameters
    ----------
    pieces : LocalPieces
        At least one.
    local_to_layer : (N, 3, 3) float64
        From local st to each layer's own [0, 1]^2, row vectors; layer 0 is the root and is in every leaf.
    layer_bounds : (N, 4) float64
        s_min, t_min, s_max, t_max of each layer in local st.
    reach : float
        How far beyond a pixel's place a lookup sees, in pixels: layers touch cells within it.
    """
    origin, size = pieces.low.min(axis=0), pieces.high.max(axis=0) - pieces.low.min(axis=0)
    size = np.maximum(size, 1e-12 * max(1.0, float(np.abs(origin).max())))  # a line or point still makes a grid
    longest = size.max()
    count = 1 if len(local_to_layer) == 1 else _ROOT_CELLS
    shape = tuple(int(n) for n in np.maximum(1, np.ceil(size / longest * count)))
    cell_size = size / shape
    column, row = np.meshgrid(np.arange(shape[0]), np.arange(shape[1]))
    low = origin + np.stack([column.ravel(), row.ravel()], axis=1) * cell_size
    # Layers outside of all that is seen never enter.
    seen = np.flatnonzero(
        (layer_bounds[:, :2] <= pieces.high.max(axis=0)).all(axis=1) & (layer_bounds[:, 2:] >= origin).all(axis=1)
    )
    seen = seen[seen > 0]
    piece_pairs = _boxes_in_grid(pieces.low, pieces.high, origin, cell_size, shape)
    layer_cells, layer_rows = _boxes_in_grid(layer_bounds[seen, :2], layer_bounds[seen, 2:], origin, cell_size, shape)
    grid = _Grid(low, low + cell_size, piece_pairs, (layer_cells, seen[layer_rows]))
    return _refine(grid, pieces, local_to_layer, reach, (origin, cell_size, shape))


def _refine(
    grid: _Grid,
    pieces: LocalPieces,
    local_to_layer: NDArray[np.float64],
    reach: float,
    outermost: tuple[NDArray[np.float64], NDArray[np.float64], tuple[int, int]],
) -> Tree:
    lows, highs, jacobians, visibles, firsts = [], [], [], [], []
    pair_cells, pair_layers = [], []
    total = 0
    for depth in range(_MAX_DEPTH + 1):
        count = len(grid.low)
        visible, low, high, jacobian = _visible_part(grid, pieces)
        grown = reach * np.abs(jacobian[:, 2]).sum(axis=2)
        cell, layer, covered = _touching(grid, visible, (low - grown, high + grown), local_to_layer)
        length = np.bincount(cell, minlength=count)
        # Where every layer covers the whole cell, as deep in a nest, smaller cells would list the same ones.
        divided = np.bincount(cell[~covered], minlength=count) > 0
        split = visible & divided & (length > _LEAF_LENGTH) & (_cell_px(low, high, jacobian[:, 0]) > _MIN_CELL_PX)
        next_total = total + count + int(split.sum()) * _CHILDREN**2
        if depth == _MAX_DEPTH or next_total > _MAX_CELLS:
            split[:] = False
        first = np.full(count, -1, np.int64)
        first[split] = total + count + np.arange(int(split.sum())) * _CHILDREN**2
        listed = ~split[cell]
        pair_cells.append(cell[listed] + total)
        pair_layers.append(layer[listed])
        for store, values in zip(
            (lows, highs, jacobians, visibles, firsts),
            (low, high, jacobian, visible, first),
            strict=True,
        ):
            store.append(values)
        total += count
        if not split.any():
            break
        grid = _children(grid, split, (cell, layer), pieces)
    cells, layers = np.concatenate(pair_cells), np.concatenate(pair_layers)
    order = np.lexsort((-layers, cells))
    join = np.concatenate
    return Tree(
        *outermost,
        join(firsts),
        _CHILDREN,
        join(lows),
        join(highs),
        join(jacobians),
        join(visibles),
        cells[order],
        layers[order],
    )


def _boxes_in_grid(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    origin: NDArray[np.float64],
    cell_size: NDArray[np.float64],
    shape: tuple[int, int],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(cell, box) pairs of boxes that touch cells of a grid; neighbours within rounding count."""
    limit = np.array(shape) - 1
    first = np.clip(np.floor((low - origin) / cell_size - 1e-6), 0, limit).astype(np.int64)
    last = np.clip(np.floor((high - origin) / cell_size + 1e-6), 0, limit).astype(np.int64)
    extent = last - first + 1
    count = extent[:, 0] * extent[:, 1]
    box = np.repeat(np.arange(len(low)), count)
    within = np.arange(len(box)) - np.repeat(np.cumsum(count) - count, count)
    column = first[box, 0] + within % extent[box, 0]
    row = first[box, 1] + within // extent[box, 0]
    return row * shape[0] + column, box


def _visible_part(grid: _Grid, pieces: LocalPieces) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Per cell: visible?, bounds of what is visible, Jacobians of the extreme footprints (`Tree.jacobian`)."""
    count = len(grid.low)
    cell, piece = grid.piece
    visible = np.zeros(count, bool)
    visible[cell] = True
    low, high = grid.low.copy(), grid.high.copy()
    jacobian = np.zeros((count, 3, 2, 2))
    if len(cell):
        order = np.argsort(cell, kind="stable")
        cell, piece = cell[order], piece[order]
        starts = np.flatnonzero(np.r_[True, cell[1:] != cell[:-1]])
        at = cell[starts]
        low[at] = np.maximum(low[at], np.minimum.reduceat(pieces.low[piece], starts))
        high[at] = np.minimum(high[at], np.maximum.reduceat(pieces.high[piece], starts))
        norm = np.linalg.norm(pieces.jacobian, axis=(2, 3))
        # 1e-300 guards a place where st is constant: its footprint has no width.
        width = np.abs(np.linalg.det(pieces.jacobian)) / np.maximum(norm, 1e-300)
        for slot, key in enumerate((norm, width, -norm)):
            corner = key.argmin(axis=1)
            rows = np.arange(len(corner))
            best = np.lexsort((key[rows, corner][piece], cell))[starts]
            jacobian[at, slot] = pieces.jacobian[rows, corner][piece[best]]
    return visible, np.minimum(low, high), np.maximum(low, high), jacobian


def _touching(
    grid: _Grid,
    visible: NDArray[np.bool_],
    box: tuple[NDArray[np.float64], NDArray[np.float64]],
    local_to_layer: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Pairs whose box does not lie wholly beyond one side of the layer, and whether the layer covers all of it."""
    cell, layer = grid.layer
    keep = visible[cell]
    cell, layer = cell[keep], layer[keep]
    corners = _corners(*box)[cell]
    matrix = local_to_layer[layer]
    mapped = corners @ matrix[:, :2] + matrix[:, 2:]
    u, v, w = mapped[..., 0], mapped[..., 1], mapped[..., 2]
    beyond = (
        (u < 0).all(axis=1) | (v < 0).all(axis=1) | (u > w).all(axis=1) | (v > w).all(axis=1) | (w <= 0).all(axis=1)
    )
    covered = ((u >= 0) & (v >= 0) & (u <= w) & (v <= w) & (w > 0)).all(axis=1)
    return cell[~beyond], layer[~beyond], covered[~beyond]


def _corners(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """(C, 4, 2)."""
    return np.stack([low, np.stack([high[:, 0], low[:, 1]], 1), high, np.stack([low[:, 0], high[:, 1]], 1)], axis=1)


def _cell_px(low: NDArray[np.float64], high: NDArray[np.float64], jacobian: NDArray[np.float64]) -> NDArray[np.float64]:
    """Square root of a cell's area in pixels, at its smallest footprint."""
    determinant = np.abs(np.linalg.det(jacobian))
    area = (high - low).prod(axis=1)
    return np.sqrt(area / np.maximum(determinant, 1e-300))


def _children(
    grid: _Grid,
    split: NDArray[np.bool_],
    touching: tuple[NDArray[np.int64], NDArray[np.int64]],
    pieces: LocalPieces,
) -> _Grid:
    parents = np.flatnonzero(split)
    number = np.full(len(split), -1, np.int64)
    number[parents] = np.arange(len(parents))
    step = (grid.high - grid.low)[parents] / _CHILDREN
    column, row = np.meshgrid(np.arange(_CHILDREN), np.arange(_CHILDREN))
    offsets = np.stack([column.ravel(), row.ravel()], axis=1)
    low = (grid.low[parents][:, None] + offsets * step[:, None]).reshape(-1, 2)
    high = low + np.repeat(step, _CHILDREN**2, axis=0)
    cell, piece = _inherit(grid.piece, number)
    overlap = ((pieces.low[piece] <= high[cell]) & (pieces.high[piece] >= low[cell])).all(axis=1)
    return _Grid(low, high, (cell[overlap], piece[overlap]), _inherit(touching, number))


def _inherit(
    pairs: tuple[NDArray[np.int64], NDArray[np.int64]], number: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Every pair of a split cell, for each of its children."""
    cell, other = pairs
    keep = number[cell] >= 0
    cell, other = number[cell[keep]], other[keep]
    each = np.arange(_CHILDREN**2)
    return (cell[:, None] * _CHILDREN**2 + each).ravel(), np.repeat(other, _CHILDREN**2)
