"""Footprints that see more of a small repeating image than accesses can read one by one; and chains of narrow images.

Once a single line is left of a chain, nothing coarser is to be had along its long axis: every box is a period of the
image. Where a footprint sees more periods than boxes are read, the line is all that counts, as a signal of one
dimension: from period to period the footprint gains so much along the moved axis, less whole periods of that (the
*drift*). The boxes are then spread over all of the footprint, so many periods apart (the *stride*), in the middle of
the line, and of a level of which a texel is as long as the drift from one to the next: what lies between is in it.

Nothing of it has a part in images of which a footprint sees fewer periods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fexel.filters.lookup import FLOOR, RAMP, SLACK, Choice
from fexel.filters.shears import FINE_DIRECTIONS

__all__ = ["Tile", "halvings", "spread"]

ACCESS = math.sqrt(2)
"""Drifts from box to box that a texel of the level spans at least: between one, and the two of an access."""

SINGLE = 0.5
"""Periods per box from which boxes are spread over an image of a single line; over any other, 1."""

_AXES = np.array([direction.long_axis for direction in FINE_DIRECTIONS])
_SHEARS = np.array([direction.shear for direction in FINE_DIRECTIONS])
_FEWEST = np.array([direction.octaves for direction in FINE_DIRECTIONS])
_PLAIN = np.array([0, 3])  # by long axis


@dataclass(frozen=True)
class Tile:
    """What chains know of how an image goes on.

    Attributes
    ----------
    extent : (int, int)
        Texels along x, y; twice the image's along a mirrored axis.
    repeats : (bool, bool)
        After these; along x, y.
    """

    extent: tuple[int, int]
    repeats: tuple[bool, bool]

    @classmethod
    def of(cls, size: tuple[int, int], wrap: tuple[str, str]) -> Tile:
        """Of an image and its wrap modes along x, y."""
        x, y = (texels << (mode == "mirror") for texels, mode in zip(size, wrap, strict=True))
        s, t = (
            mode in ("repeat", "mirror") or (mode == "clamp" and texels == 1)
            for mode, texels in zip(wrap, (x, y), strict=True)
        )
        return cls((x, y), (s, t))


def halvings(lines: int) -> int:
    """How often lines can be halved until one is left."""
    return lines.bit_length() - 1


def spread(choice: Choice, tile: Tile, probes: int, *, gauss: bool = False) -> Choice:
    """What pixels choose of an image of that extent.

    Parameters
    ----------
    choice : Choice
        Of `fexel.filters.fipmap.choose`, or that of ripmaps, which know nothing of the image.
    tile : Tile
    probes : int
        Accesses along the long axis.
    gauss : bool

    Returns
    -------
    Choice
        Without octaves that the image has not; with `stride` and `drift`.
    """
    chained = ~choice.compact
    axis = _AXES[choice.direction]
    extent, repeats = np.array(tile.extent), np.array(tile.repeats)
    lines = extent[axis]
    slope = choice.tilt - _SHEARS[choice.direction]
    stride = _boxes_seen(choice, probes, gauss) / lines
    # A single line is not moved by any shear: the image itself is what there is.
    single = chained & (lines == 1)
    stride = np.where(chained & repeats[axis] & (stride > np.where(single, SINGLE, 1.0)), stride, 0.0)
    drift = slope * lines
    across = extent[1 - axis]
    drift = drift - np.where(repeats[1 - axis], np.round(drift / across), 0) * across
    least = np.ceil(np.log2(np.maximum(ACCESS * stride * np.abs(drift), FLOOR)))
    level = np.maximum(choice.level, np.where(stride > 0, least, 0)).astype(np.int64)
    last = np.array([halvings(each) for each in tile.extent])[axis]
    fewest = np.where(choice.octaves > 0, _FEWEST[choice.direction], 0)
    octaves = np.minimum(choice.octaves, np.maximum(last - level, fewest))
    return replace(
        choice,
        direction=np.where(single, _PLAIN[axis], choice.direction),
        octaves=np.where(single, 0, octaves),
        level=level,
        tilt=np.where(single, slope, choice.tilt),
        stride=stride,
        drift=drift,
    )


def _boxes_seen(choice: Choice, probes: int, gauss: bool) -> NDArray[np.float64]:
    """Length of boxes, in texels of level 0, of which a footprint is as long as accesses can read."""
    if gauss:
        return np.linalg.norm(choice.length, axis=1) / probes
    return choice.length @ np.array([1.0, RAMP]) / (2.0 * probes + SLACK)
