"""Which cells of chains a view chooses, by piece of the view, and which windows of them it sees.

Every pixel chooses for itself; here the choice is made for Jacobians of a few places of each piece, and for such as are
a little larger, smaller or more slanted, so that what lies between is there as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.filters.lookup import usable
from fexel.filters.shears import DIRECTIONS, FINE_DIRECTIONS, margin

__all__ = ["Frame", "Wants", "cells_wanted"]

_SCALES = np.exp2([-0.2, 0.0, 0.2])  # octaves, as levels of residency have them
_SHEARS = np.array(
    [[[1, 0], [0, 1]], *([[1, e], [0, 1]] for e in (-0.06, 0.06)), *([[1, 0], [e, 1]] for e in (-0.06, 0.06))]
)

# Directions of either long axis in the order of their shears, from diagonal to diagonal.
_FANS = [
    [
        number
        for _, number in sorted(
            (each.shear, number)
            for number, each in enumerate(FINE_DIRECTIONS)
            if each.long_axis == axis or abs(each.shear) == 1
        )
    ]
    for axis in (0, 1)
]


@dataclass(frozen=True, eq=False)
class Wants:
    """Cells by piece of a view; arrays of length N.

    Attributes
    ----------
    piece, direction, octaves : (N,) int64
        0 octaves: mip levels of the image itself, direction 0.
    finest, coarsest : (N,) int64
    spread : bool
        Boxes of some are spread over more periods than are read one by one, see `fexel.filters.tiles`.
    """

    piece: NDArray[np.int64]
    direction: NDArray[np.int64]
    octaves: NDArray[np.int64]
    finest: NDArray[np.int64]
    coarsest: NDArray[np.int64]
    spread: bool = False


def cells_wanted(jacobian: NDArray[np.float64], chosen: Sequence[Callable], directions: int = len(DIRECTIONS)) -> Wants:
    """Cells that pieces may show.

    Parameters
    ----------
    jacobian : (K, P, 2, 2) float64
        Texels of level 0 per pixel, y down, at P places of each of K pieces.
    chosen : sequence of callables
        From Jacobians (M, 2, 2) to a `fexel.filters.lookup.Choice`; what any of them takes is wanted.
    directions : int
        How many of `FINE_DIRECTIONS` they choose from, from the first on.
    """
    pieces, places = jacobian.shape[:2]
    jacobian = usable(jacobian.reshape(-1, 2, 2))
    varied = (_SHEARS[:, None] * _SCALES[:, None, None]).reshape(-1, 2, 2)
    every = np.concatenate([each @ jacobian for each in varied])
    piece = np.tile(np.repeat(np.arange(pieces), places), len(varied))
    choices = [choose(every) for choose in chosen]
    piece = np.tile(piece, len(choices))
    octaves, level, direction = (
        np.concatenate([getattr(choice, name) for choice in choices]) for name in ("octaves", "level", "direction")
    )
    finest, coarsest = np.full(pieces, 64), np.zeros(pieces, np.int64)
    np.minimum.at(finest, piece, level)
    np.maximum.at(coarsest, piece, level)
    piece, direction, octaves = np.nonzero(_named(piece, direction, octaves, pieces)[:, :directions])
    spread = any(choice.stride is not None and bool(choice.stride.any()) for choice in choices)
    return Wants(piece, direction, octaves, finest[piece], coarsest[piece], spread)


def _named(
    piece: NDArray[np.int64], direction: NDArray[np.int64], octaves: NDArray[np.int64], pieces: int
) -> NDArray[np.bool_]:
    """(K, directions, octaves) what of each piece is wanted: of all octaves and directions that it names, and of those
    between them.

    Between two places some pixel may combine what is one's with what is the other's; were only what is named together
    there, it would read what lies beside a window.
    """
    directed = np.zeros((pieces, len(FINE_DIRECTIONS)), bool)
    lengthened = np.zeros((pieces, octaves.max(initial=0) + 1), bool)
    lengthened[piece, octaves] = True
    lengthened[:, 1:] = _between(lengthened[:, 1:])
    directed[piece[octaves > 0], direction[octaves > 0]] = True
    for along in _FANS:
        directed[:, along] |= _between(directed[:, along])
    fewest = np.array([each.octaves for each in FINE_DIRECTIONS])[:, None]
    wanted = directed[:, :, None] & lengthened[:, None] & (np.arange(lengthened.shape[1]) >= fewest)
    wanted[:, 0, 0] = lengthened[:, 0]
    return wanted


def _between(named: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(K, N) from the first that is named to the last."""
    return np.logical_or.accumulate(named, axis=1) & np.logical_or.accumulate(named[:, ::-1], axis=1)[:, ::-1]


@dataclass(frozen=True)
class Frame:
    """Coordinates of a direction's chains of an image, as shaders/filter_chains.glsl has them.

    Attributes
    ----------
    direction : int
    size : (int, int)
        Of the image.
    wrap : (str, str)
        Of the image.
    """

    direction: int
    size: tuple[int, int]
    wrap: tuple[str, str]

    @property
    def long_axis(self) -> int:
        """0: x, 1: y."""
        return FINE_DIRECTIONS[self.direction].long_axis

    def period(self, axis: int) -> int:
        """Texels after which the image repeats along an axis; 0 where it does not."""
        return {"repeat": 1, "mirror": 2}.get(self.wrap[axis], 0) * self.size[axis]

    @property
    def margin(self) -> int:
        """`fexel.filters.shears.margin`: chains have it, the shader's places in them begin and end within it."""
        return margin(self.wrap[1 - self.long_axis])

    @property
    def _padding(self) -> tuple[int, int]:
        length = self.period(self.long_axis) or self.size[self.long_axis]
        return FINE_DIRECTIONS[self.direction].padding(length, self.wrap[1 - self.long_axis])

    @property
    def extent(self) -> NDArray[np.float64]:
        """(2,) width and height of what is moved, texels of the image: twice the image along a mirrored axis."""
        extent = np.array([self.period(axis) or size for axis, size in enumerate(self.size)], np.float64)
        extent[1 - self.long_axis] += self._padding[1] - 2 * self.margin
        return extent

    def window(
        self, low: NDArray[np.float64], high: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Bounds of boxes once they are moved.

        Parameters
        ----------
        low, high : (N, 2) float64
            Of the boxes: texels of the image, y down, not wrapped.

        Returns
        -------
        low, high : (N, 2), (N, 2)
            In [0, 1]^2 of the chain, t up; beyond it where a box lies across a seam.
        """
        extent, long = self.extent, self.long_axis
        moved = 1 - long
        extent[moved] += 2 * self.margin
        bounds: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = [(low[:, 0], high[:, 0])] * 2
        along = self._folded(low[:, long], high[:, long], long)
        # Where the box crosses a seam of the long axis, what is moved may be anywhere.
        across = (along[0] < 0) | (along[1] > extent[long])
        shear = FINE_DIRECTIONS[self.direction].shear
        shifts = np.stack([shear * (along[0] - 0.5), shear * (along[1] - 0.5)])
        begin = low[:, moved] + shifts.min(axis=0) + self._padding[0]
        end = high[:, moved] + shifts.max(axis=0) + self._padding[0]
        sideways = self._folded(begin, end, moved)
        if shear:
            sideways = np.where(across, -1.0, sideways[0]), np.where(across, extent[moved] + 1.0, sideways[1])
        bounds[long], bounds[moved] = along, sideways
        (x0, x1), (y0, y1) = bounds
        return (
            np.stack([x0 / extent[0], 1 - y1 / extent[1]], axis=1),
            np.stack([x1 / extent[0], 1 - y0 / extent[1]], axis=1),
        )

    def _folded(
        self, low: NDArray[np.float64], high: NDArray[np.float64], axis: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Within a period; of a mirrored axis of which nothing is moved, within the image, as the shader reads it."""
        low, high = self._within(low, high, axis)
        if self.wrap[axis] != "mirror" or FINE_DIRECTIONS[self.direction].shear:
            return low, high
        size = self.size[axis]
        ends = np.stack([size - np.abs(size - bound % (2 * size)) for bound in (low, high)])
        first, turns = np.floor(low / size), np.floor(high / size) - np.floor(low / size)
        near = (turns > 1) | (turns == 1) & (first % 2 == 1)
        far = (turns > 1) | (turns == 1) & (first % 2 == 0)
        return np.where(near, 0.0, ends.min(axis=0)), np.where(far, size, ends.max(axis=0))

    def _within(
        self, low: NDArray[np.float64], high: NDArray[np.float64], axis: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Without whole periods; what still reaches beyond is all of it."""
        period = self.period(axis)
        if not period:
            return low, high
        whole = period * np.floor(low / period)
        low, high = low - whole, high - whole
        return low, high
