"""What is merged: the umbrellas of a level with what each covers, all of it or what is seen of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fexel.textures.umbrella_arrangement import Arrangement
from fexel_tools.umbrella_raster import rasterize

__all__ = ["Members", "all_members", "visible_members"]

_PIXELS = 16  # along a cell, in which visible parts are found
_MOST_PIXELS = 2**24
_LEAST = 1e-3  # share of a part that counts at least: weights are divided by


@dataclass(frozen=True, eq=False)
class Members:
    """Umbrellas to be merged, those of which something counts.

    Attributes
    ----------
    place : (m, 2) float64
        In [0, 1): the centre of what counts.
    weight : (m,) float64
        Area in st that it covers, positive.
    color : (m, 3) float64
        Mean, linear.
    rank : (m,) int64
        Order from the front.
    first : (m + 1,) int64
    points : (p, 2) float64
        What each covers, in st, relative to its place.
    point_size : (float, float)
        Width and height in st of a point that is a pixel.
    """

    place: NDArray[np.float64]
    weight: NDArray[np.float64]
    color: NDArray[np.float64]
    rank: NDArray[np.int64]
    first: NDArray[np.int64]
    points: NDArray[np.float64]
    point_size: tuple[float, float] = (0.0, 0.0)

    def points_of(self, chosen: NDArray[np.int64]) -> NDArray[np.float64]:
        """(p, 2) what some members cover, in st; corners of pixels where points are pixels."""
        parts = [self.place[n] + self.points[self.first[n] : self.first[n + 1]] for n in chosen]
        points = np.concatenate(parts)
        if not any(self.point_size):
            return points
        corners = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * self.point_size
        return (points[:, None] + corners).reshape(-1, 2)


def all_members(arrangement: Arrangement) -> Members:
    """Every umbrella, by its centre and all its vertices."""
    first, vertices = arrangement.first_vertex, arrangement.vertices
    centers = vertices[first[:-1]]
    count = len(arrangement)
    relative = vertices - np.repeat(centers, np.diff(first), axis=0)
    place = centers - np.floor(centers)
    return Members(place, np.ones(count), np.zeros((count, 3)), np.arange(count), first, relative)


def visible_members(
    arrangement: Arrangement,
    textures: Sequence[NDArray | None],
    truth: NDArray[np.float32],
    jobs: int | None = None,
) -> Members:
    """Umbrellas of which something is seen, by their visible parts; a translucent part weighs as much as it covers.

    Parameters
    ----------
    arrangement : Arrangement
    textures : sequence of (h, w, 3 or 4) float or None
        One per shape.
    truth : (H, W, 3) float32
        Linear, of the unit square: where colours come from.
    jobs : int, optional
        Threads.
    """
    columns, rows = arrangement.grid
    pixels = _PIXELS
    while pixels > 1 and columns * rows * pixels**2 > _MOST_PIXELS:
        pixels //= 2
    size = (columns * pixels, rows * pixels)
    ids = _top(arrangement, size, jobs)
    covered = rasterize(arrangement, textures, None, size, supersample=1, jobs=jobs)[..., 3]
    row, column = np.nonzero(ids >= 0)
    order = np.argsort(ids[row, column], kind="stable")
    row, column = row[order], column[order]
    umbrella, first, count = np.unique(ids[row, column], return_index=True, return_counts=True)
    first = np.append(first, len(row))
    weight = np.add.reduceat(covered[row, column].astype(np.float64), first[:-1]) if len(row) else np.zeros(0)
    st = np.stack([(column + 0.5) / size[0], 1 - (row + 0.5) / size[1]], axis=1)
    # Parts across the border belong together: all relative to the centre, the shorter way round.
    centers = arrangement.vertices[arrangement.first_vertex[umbrella]]
    relative = st - np.repeat(centers, count, axis=0)
    relative -= np.rint(relative)
    middle = np.add.reduceat(relative, first[:-1], axis=0) / count[:, None] if len(umbrella) else np.zeros((0, 2))
    at = truth[row * truth.shape[0] // size[1], column * truth.shape[1] // size[0]].astype(np.float64)
    color = np.add.reduceat(at, first[:-1], axis=0) / count[:, None] if len(umbrella) else np.zeros((0, 3))
    place = centers + middle
    return Members(
        place - np.floor(place),
        np.maximum(weight, _LEAST * count) / (size[0] * size[1]),
        color,
        umbrella,
        first,
        relative - np.repeat(middle, count, axis=0),
        (1 / size[0], 1 / size[1]),
    )


def _top(arrangement: Arrangement, size: tuple[int, int], jobs: int | None) -> NDArray[np.int64]:
    """(H, W) number of the umbrella on top at every pixel's centre, -1 where there is none: drawn as colours."""
    shapes = tuple(replace(shape, image=None) for shape in arrangement.shapes)
    number = np.arange(len(arrangement))
    digits = np.stack([number % 256, number // 256 % 256, number // 65536], axis=1) / 255.0
    shown = replace(
        arrangement,
        shapes=shapes,
        colors=np.repeat(digits, arrangement.vertex_counts, axis=0).astype(np.float32),
        color_blend=1.0,
        shadow_strength=0.0,
        coverages=np.ones(len(arrangement)),
    )
    drawn = rasterize(shown, [None] * len(shapes), None, size, supersample=1, jobs=jobs)
    found = np.rint(drawn[..., :3] * 255.0).astype(np.int64) @ np.array([1, 256, 65536])
    return np.where(drawn[..., 3] > 0.5, found, -1)
