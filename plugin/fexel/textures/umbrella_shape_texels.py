"""Base umbrellas as texels of a float page: contours about their centres, tables that find the sector of a direction.

A table by pseudo-angle gives the sector at once (Just-in-time texture synthesis, 2012, section 6.1), for every shape
and for parts of the range of its morph. Each shape is a block of texels of its own, see `umbrella_texels`.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fexel.textures.umbrella_arrangement import Shape
from fexel.textures.umbrella_geometry import FULL_TURN, pseudo_angle

__all__ = ["shape_blocks"]

_AFTER = 19  # vertices that follow again after the last: so far UMBRELLA_TRIES rounds of two sectors reach
_MOST_BINS = 1024
_SLICES = 8  # tables of a shape that morphs


def shape_blocks(shapes: tuple[Shape, ...], morphs: bool) -> tuple[list[NDArray[np.float64]], int, int]:
    """Texels of shapes.

    Parameters
    ----------
    shapes : tuple of Shape
    morphs : bool
        Whether any umbrella has another shape than its base.

    Returns
    -------
    blocks : list of (N, 4) float64
        One per shape; of one without vertices, which no umbrella has, there is nothing.
    bins, slices : int
        Of their tables.
    """
    most = max([len(shape.points) for shape in shapes] + [1])
    bins = min(_MOST_BINS, 2 ** math.ceil(math.log2(4 * most)))
    slices = _SLICES if morphs else 1
    images = np.cumsum([shape.image is not None for shape in shapes]) - 1
    blocks = []
    for number, shape in enumerate(shapes):
        if not len(shape.points):
            blocks.append(np.zeros((0, 4)))
            continue
        own = _Contour(shape)
        head = [*shape.tex_coords[0], images[number] if shape.image else -1, own.sectors]
        blocks.append(np.concatenate([[head], own.tables(bins, slices), own.vertices, own.tex_coords]))
    return blocks, bins, slices


@dataclass(frozen=True, eq=False)
class _Contour:
    """A shape about its centre."""

    shape: Shape

    @property
    def sectors(self) -> int:
        return len(self.shape.points) - 1

    @cached_property
    def spokes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """At a morph of 0, and on the way to one of 1."""
        start, end = (points[1:] - points[0] for points in (self.shape.points, self.shape.morph_points))
        return start, end - start

    @property
    def vertices(self) -> NDArray[np.float64]:
        start, way = self.spokes
        index = np.arange(self.sectors + _AFTER) % self.sectors
        return np.concatenate([start, way], axis=1)[index]

    @property
    def tex_coords(self) -> NDArray[np.float64]:
        contour = self.shape.tex_coords[1:]
        return np.concatenate([contour, np.roll(contour, -1, axis=0)], axis=1)

    def tables(self, bins: int, slices: int) -> NDArray[np.float64]:
        """(slices * bins, 4): for each bin, and each part of the range of the morph, the first sector that it may need.

        Seen from the centre a vertex that morphs turns one way only, so the sectors at both ends of a part tell.
        """
        angle = np.arange(bins) * (FULL_TURN / bins)
        at = [self._sectors_at(angle, morph) for morph in np.linspace(0, 1, slices + 1)]
        if slices == 1:
            at[1] = at[0]
        tables = np.zeros((slices * bins, 4))
        for number, (begin, end) in enumerate(itertools.pairwise(at)):
            ahead = np.mod(end - begin, self.sectors)
            first = np.where(ahead <= self.sectors // 2, begin, end)
            tables[number * bins : (number + 1) * bins, 0] = first
        return tables

    def _sectors_at(self, angle: NDArray[np.float64], morph: float) -> NDArray[np.int64]:
        start, way = self.spokes
        spoke = pseudo_angle(start + morph * way)
        order = np.argsort(spoke, kind="stable")
        return order[np.searchsorted(spoke[order], angle, "right") - 1]
