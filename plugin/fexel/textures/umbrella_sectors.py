"""Which sector of an umbrella holds a point, and where in it the point lies, for all umbrellas of an arrangement.

A sector is the triangle of the centre and two neighbouring contour vertices; an umbrella of V vertices has V - 1 of
them. It is found by the angle about the centre (Just-in-time texture synthesis, 2012, section 6.1), which is measured
as the pseudo-angle of `pseudo_angle`: it orders directions as the angle does, without a trigonometric function. A
vertex at the centre inherits the angle of its predecessor (notes U2). All is done in patch space, where a mirrored
placement changes no orientation and perspective is exact.

A sector without area, of coincident vertices or seen from the centre along a line, draws nothing. Neither does a sector
that folds: what is drawn of a contour that the centre does not see in whole are the sectors that turn forward.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fexel.textures.umbrella_arrangement import Arrangement
from fexel.textures.umbrella_geometry import FLAT, FULL_TURN, cross, half_turn, pseudo_angle

__all__ = ["Sectors"]

_KEY = 2 * FULL_TURN  # from one umbrella to the next, so that all starts of sectors are one sorted array
_LAST = 1e-9  # before a full turn: with the umbrella's key added, a float64 must not round up to it
_NO_AREA = 1e-12  # of a sector, relative to the square of the umbrella's size: below it barycentrics are noise
_BESIDE = -1e-6  # barycentric coordinate beside a spoke: rounding gives less, a point in no sector more


@dataclass(frozen=True, eq=False)
class Sectors:
    """The sectors of all umbrellas of an arrangement, for points given in patch space.

    Sectors are counted through all umbrellas: number `s` of umbrella `u` has the spokes to vertices ``s + u + 1`` of
    `Arrangement.points` and the one after it.
    """

    arrangement: Arrangement

    @cached_property
    def first(self) -> NDArray[np.int64]:
        """(n + 1,) where the sectors of each umbrella begin."""
        return self.arrangement.first_vertex - np.arange(len(self.arrangement) + 1)

    @cached_property
    def umbrella(self) -> NDArray[np.int64]:
        """(S,) the umbrella of each sector."""
        return np.repeat(np.arange(len(self.arrangement)), np.diff(self.first))

    @cached_property
    def centers(self) -> NDArray[np.float64]:
        """(n, 2) centre of each umbrella."""
        return self.arrangement.points[self.arrangement.first_vertex[:-1]]

    @cached_property
    def spokes(self) -> NDArray[np.float64]:
        """(S, 2) from the centre to the vertex where each sector begins."""
        contour = np.arange(self.first[-1]) + self.umbrella + 1
        return self.arrangement.points[contour] - self.centers[self.umbrella]

    @cached_property
    def following(self) -> NDArray[np.int64]:
        """(S,) the sector after each, around the centre."""
        after = np.arange(1, self.first[-1] + 1)
        counts = np.diff(self.first)
        after[self.first[1:][counts > 0] - 1] = self.first[:-1][counts > 0]
        return after

    @cached_property
    def areas(self) -> NDArray[np.float64]:
        """(S,) twice the area of each sector; 0 where it draws nothing."""
        area = cross(self.spokes, self.spokes[self.following])
        return np.where(area > _NO_AREA * self._sizes[self.umbrella] ** 2, area, 0.0)

    @cached_property
    def _sizes(self) -> NDArray[np.float64]:
        """(n,) largest coordinate of a spoke."""
        if not len(self.spokes):
            return np.zeros(len(self.arrangement))
        return np.maximum.reduceat(np.abs(self.spokes).max(axis=1), self.first[:-1])

    @cached_property
    def angles(self) -> NDArray[np.float64]:
        """(S,) pseudo-angle of the first spoke of each sector; at the centre, that of the sector before."""
        angles = pseudo_angle(self.spokes)
        missing = ~self.spokes.any(axis=1)
        if missing.any():
            known = np.where(missing, -1, np.arange(len(angles)))
            known = np.maximum.accumulate(known)
            begin = self.first[:-1][self.umbrella]
            outside = known < begin  # the first spokes: they take the last known one around
            last = np.maximum.reduceat(np.where(missing, -1, np.arange(len(angles))), self.first[:-1])[self.umbrella]
            angles = angles[np.where(outside, np.maximum(last, 0), known)]
        return angles

    @cached_property
    def starts(self) -> NDArray[np.float64]:
        """(S,) where each sector begins, from the first one's on, never falling; + 8 for every umbrella before."""
        turns = half_turn(self.angles[self.following] - self.angles)
        summed = np.concatenate([[0.0], np.cumsum(turns)[:-1]])
        relative = np.clip(summed - summed[self.first[:-1]][self.umbrella], 0.0, FULL_TURN)
        return np.maximum.accumulate(relative + _KEY * self.umbrella)

    @cached_property
    def is_star(self) -> NDArray[np.bool_]:
        """(n,) whether the centre of each umbrella sees its whole contour."""
        if not len(self.spokes):
            return np.zeros(len(self.arrangement), bool)
        begin = self.first[:-1]
        turns = np.add.reduceat(half_turn(self.angles[self.following] - self.angles), begin)
        areas = np.minimum.reduceat(cross(self.spokes, self.spokes[self.following]), begin)
        return (np.abs(turns - FULL_TURN) < 1.0) & (areas >= -FLAT * self._sizes**2)

    def find(self, umbrella: NDArray[np.integer], point: NDArray[np.float64]) -> NDArray[np.int64]:
        """The sector that a direction from the centre lies in.

        Parameters
        ----------
        umbrella : (M,) int
        point : (M, 2) float64
            Patch space; at the centre any sector will do.

        Returns
        -------
        (M,) int64
        """
        angle = pseudo_angle(point - self.centers[umbrella])
        relative = np.mod(angle - self.angles[self.first[umbrella]], FULL_TURN)
        key = np.minimum(relative, FULL_TURN - _LAST) + _KEY * umbrella
        return np.searchsorted(self.starts, key, side="right") - 1

    def barycentric(
        self, umbrella: NDArray[np.integer], sector: NDArray[np.integer], point: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Coordinates in sectors, and whether there is something to draw.

        Parameters
        ----------
        umbrella, sector : (M,) int
        point : (M, 2) float64
            Patch space.

        Returns
        -------
        weights : (M, 3) float64
            Of the centre and the two contour vertices; the first is negative outside of the contour. 0 where nothing is
            drawn.
        drawn : (M,) bool
            False for a sector without area, and where the point lies in no sector.
        """
        place = point - self.centers[umbrella]
        area = self.areas[sector]
        inverse = np.where(area > 0, 1.0 / np.where(area > 0, area, 1.0), 0.0)
        begin = cross(place, self.spokes[self.following[sector]]) * inverse
        end = cross(self.spokes[sector], place) * inverse
        drawn = (area > 0) & (begin >= _BESIDE) & (end >= _BESIDE)
        weights = np.stack([1.0 - begin - end, begin, end], axis=-1)
        return np.where(drawn[:, None], weights, 0.0), drawn

    def vertices_of(
        self, umbrella: NDArray[np.integer], sector: NDArray[np.integer]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Numbers in `Arrangement.points` of the centre and the two contour vertices; (M,) each."""
        offset = umbrella + 1
        return self.arrangement.first_vertex[umbrella], sector + offset, self.following[sector] + offset
