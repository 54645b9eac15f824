"""The ripmap: prefiltered by any power of two along x and along y (McReynolds 1998), read with two accesses.

It is the fipmap without shears: footprints that are slanted to the texture are taken as wide as the rectangle about
them. Of one level, as of the fipmap, the boxes that the longer side covers: no levels are interpolated.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fexel.filters.lookup import Choice, Rows, Taps, chain_taps, octaves_needed, short_level, usable

__all__ = ["PROBES", "choose", "taps"]

PROBES = 2
"""Bilinear accesses along the long axis."""

_Floats = NDArray[np.float64]


def choose(jacobian: _Floats) -> Choice:
    """Level and octaves of pixels, (K, 2, 2) as `fexel.filters.fipmap.choose` takes them; nothing is moved."""
    rows = Rows.of(usable(jacobian))
    axis = rows.long_axis()
    sides = rows.sides(axis)
    width = rows.along(1 - axis)[0]
    level = short_level(width)
    octaves = np.maximum(octaves_needed(sides, level, PROBES), 0).astype(np.int64)
    zeros = np.zeros(len(axis))
    return Choice(np.where(axis == 0, 0, 3), octaves, level, zeros.astype(bool), sides, width, rows.along(axis)[1])


def taps(choice: Choice, xy: _Floats, size: tuple[int, int], *, mirrored: tuple[bool, bool] = (False, False)) -> Taps:
    """The accesses of pixels at (K, 2), see `fexel.filters.fipmap.taps`; T is 2."""
    return chain_taps(choice, xy, size, PROBES, mirrored=mirrored)
