"""Where umbrellas are put: points on a torus of grid cells, uniformly random or as blue noise.

Blue noise is a Poisson disk set of an exact number of points: more uniformly random points than are wanted, of which
the most crowded one goes until as many are left as are wanted (Yuksel, Sample elimination for generating Poisson disk
sample sets, 2015). A heap and a grid of cells make that O(n log n). Only sums and comparisons decide, in one thread:
the same seed gives the same points everywhere.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["blue_noise_points", "random_points"]

_CANDIDATES = 5  # per wanted point; more than that no longer widens the smallest distance noticeably
_SMALLEST = 0.65  # Yuksel's beta: distances below that share of the largest possible one weigh no more
_GAMMA = 1.5


def random_points(count: int, grid: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float64]:
    """(count, 2) points, uniform and independent over ``[0, W) x [0, H)`` grid cells."""
    return rng.random((count, 2)) * np.asarray(grid, np.float64)


def blue_noise_points(count: int, grid: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float64]:
    """(count, 2) points that keep their distance from each other, over a torus of ``W x H`` grid cells.

    In random order. The smallest distance is about 0.7 of what a hexagonal packing has.
    """
    if count < 2:
        return random_points(count, grid, rng)
    area = float(grid[0]) * grid[1]
    radius = math.sqrt(area / (2.0 * math.sqrt(3.0) * count))  # half the spacing of the densest packing
    candidates = random_points(_CANDIDATES * count, grid, rng)
    cells = tuple(max(1, math.floor(side / (2.0 * radius))) for side in grid)
    cell = _cell_of(candidates, grid, cells)
    order = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[order], np.arange(cells[0] * cells[1] + 1))
    smallest = radius * (1.0 - _CANDIDATES**-_GAMMA) * _SMALLEST
    kept = _eliminate(
        candidates[order], first, cells[0], cells[1], float(grid[0]), float(grid[1]), 2 * radius, 2 * smallest, count
    )
    return candidates[np.sort(order[kept])]


def _cell_of(points: NDArray[np.float64], grid: tuple[int, int], cells: tuple[int, ...]) -> NDArray[np.int64]:
    column, row = (np.minimum((points[:, i] * (cells[i] / grid[i])).astype(np.int64), cells[i] - 1) for i in (0, 1))
    return row * cells[0] + column


@numba.njit(cache=True, nogil=True)
def _weight(squared, reach, smallest):
    """How much two points crowd each other, 0 from `reach` on: Yuksel's equation 4 with alpha = 8."""
    nearness = 1.0 - max(math.sqrt(squared), smallest) / reach
    fourth = nearness * nearness * nearness * nearness
    return fourth * fourth


@numba.njit(cache=True, nogil=True)
def _squared_distance(a, b, width, height):
    dx, dy = abs(a[0] - b[0]), abs(a[1] - b[1])
    dx, dy = min(dx, width - dx), min(dy, height - dy)
    return dx * dx + dy * dy


@numba.njit(cache=True, nogil=True)
def _around(cell, cells):
    """First neighbour along an axis and how many, none twice: three, or all where there are fewer."""
    return (0, cells) if cells < 3 else (cell - 1 + cells, 3)


@numba.njit(cache=True, nogil=True)
def _sift_down(heap, place, weight, at, size):
    item = heap[at]
    while 2 * at + 1 < size:
        child = 2 * at + 1
        if child + 1 < size and weight[heap[child + 1]] > weight[heap[child]]:
            child += 1
        if weight[heap[child]] <= weight[item]:
            break
        heap[at] = heap[child]
        place[heap[at]] = at
        at = child
    heap[at] = item
    place[item] = at


@numba.njit(cache=True, nogil=True)
def _crowd(i, points, first, nx, ny, width, height, reach, smallest, place, heap, weight, size):
    """Crowding of point i; where `size` is not 0, its neighbours are relieved of it instead."""
    total = 0.0
    column = min(int(points[i, 0] * (nx / width)), nx - 1)
    row = min(int(points[i, 1] * (ny / height)), ny - 1)
    left, columns = _around(column, nx)
    below, rows = _around(row, ny)
    for r in range(rows):
        for c in range(columns):
            cell = ((below + r) % ny) * nx + (left + c) % nx
            for j in range(first[cell], first[cell + 1]):
                if j == i or place[j] < 0:
                    continue
                squared = _squared_distance(points[i], points[j], width, height)
                if squared >= reach * reach:
                    continue
                crowding = _weight(squared, reach, smallest)
                total += crowding
                if size > 0:
                    weight[j] -= crowding
                    _sift_down(heap, place, weight, place[j], size)
    return total


@numba.njit(cache=True, nogil=True)
def _eliminate(points, first, nx, ny, width, height, reach, smallest, wanted):
    """Indices of the points that stay: a heap with the most crowded on top, `place` says where in it each lies."""
    count = len(points)
    heap, place, weight = np.arange(count), np.arange(count), np.zeros(count)
    for i in range(count):
        weight[i] = _crowd(i, points, first, nx, ny, width, height, reach, smallest, place, heap, weight, 0)
    for at in range(count // 2, -1, -1):
        _sift_down(heap, place, weight, at, count)
    for size in range(count - 1, wanted - 1, -1):
        gone = heap[0]
        place[gone] = -1
        heap[0] = heap[size]
        place[heap[0]] = 0
        _sift_down(heap, place, weight, 0, size)
        _crowd(gone, points, first, nx, ny, width, height, reach, smallest, place, heap, weight, size)
    return heap[:wanted].copy()
