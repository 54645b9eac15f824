"""The directions in which a texture is prefiltered: plain ones along the two axes, and fourteen sheared ones.

Coordinates are texels of level 0, x to the right, y DOWN from the top, as rows are stored; texel (i, j) covers
[i, i + 1) x [j, j + 1). A direction has a *long* axis, along which its images are coarser, and a shear that makes
footprints of that direction run along it (Bornik and Ferko 2002, eq. 1 with a = d = 1 and b or c not 0):

    long axis x:  x' = x,  y' = y + k (x - 1/2)        long axis y:  x' = x + k (y - 1/2),  y' = y

so that column i (row j) moves by exactly k i (k j) texels: by whole ones, or by quarters. Tangents beyond 1 describe a
direction of the other axis a second time, and 1 of x is 1 of y, the diagonal: these sixteen are all in steps of 1/4.

The tilt that a shear leaves matters as the footprint is long. So the finer a direction, the coarser its images begin,
see `Direction.octaves`: with eight directions of all octaves the memory is the same, 12 times the texture, but lookups
of 4 accesses are up to 9 dB worse between these directions at an elevation of 1 degree.

Along the axis that is moved a repeating texture stays cyclic, with the same period. Any other texture is
padded there: the moved coordinate is then measured from the smallest one that there is, see `padding`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["DIRECTIONS", "FINE_DIRECTIONS", "Direction", "margin"]


def margin(wrap: str) -> int:
    """Texels that are added on either side of the moved axis, of its wrap mode.

    Chains are blurred along it: where nothing continues a texture it fades over one texel beyond its edge.
    """
    return 1 if wrap in ("black", "patch") else 0


@dataclass(frozen=True)
class Direction:
    """A long axis and a shear.

    Attributes
    ----------
    long_axis : int
        0: x, 1: y.
    shear : float
        k, in [-1, 1]; a multiple of 1/16.
    """

    long_axis: int
    shear: float

    @property
    def octaves(self) -> int:
        """Fewest octaves by which its images are coarser along the long axis: 1 of whole tangents, 2 of halves, ..."""
        return next(octaves for octaves in range(1, 6) if 2 ** (octaves - 1) * self.shear % 1 == 0)

    def padding(self, length: int, wrap: str) -> tuple[int, int]:
        """Of a texture that is `length` texels long along the long axis, with a wrap mode along the moved one.

        None where that repeats. Where nothing continues it there is a texel more on either side, see `margin`.

        Returns
        -------
        offset : int
            Added to the moved coordinate, so that none is negative.
        texels : int
            By how many the moved axis is longer.
        """
        if wrap in ("repeat", "mirror"):
            return 0, 0
        reach, fading = self.shear * (length - 1), margin(wrap)
        return math.ceil(max(-reach, 0.0)) + fading, math.ceil(abs(reach)) + 2 * fading


DIRECTIONS: tuple[Direction, ...] = (
    Direction(0, 0.0),
    Direction(0, 0.5),
    Direction(0, -0.5),
    Direction(1, 0.0),
    Direction(1, 0.5),
    Direction(1, -0.5),
    Direction(1, 1.0),
    Direction(1, -1.0),
    Direction(0, 0.25),
    Direction(0, -0.25),
    Direction(0, 0.75),
    Direction(0, -0.75),
    Direction(1, 0.25),
    Direction(1, -0.25),
    Direction(1, 0.75),
    Direction(1, -0.75),
)
"""By number, as records and shaders have them."""

FINE_DIRECTIONS: tuple[Direction, ...] = DIRECTIONS + tuple(
    Direction(axis, numerator / steps)
    for steps in (8, 16)
    for axis in (0, 1)
    for numerator in range(1 - steps, steps)
    if numerator % 2
)
"""And those in steps of 1/8 from 4 octaves on and of 1/16 from 5: another 5.3 times the texture (`fipmap.choose`)."""
