"""The fipmap: ripmaps of a sheared texture, read with a few bilinear accesses (Bornik and Ferko 2002, section 3.2).

The paper chooses, per polygon, the shear that brings the footprint's long axis onto an axis of the texture, and then
looks a ripmap up. Here it is chosen per pixel, from the Jacobian, and no two levels are ever interpolated (notes, F6).
A pixel takes ``probes`` bilinear accesses of one level; 4 of them, 16 texels, by default:

- *compact* footprints take the image's own mip levels: two by two accesses at the points of a Gauss quadrature, which
  have the mean and the variance of a box; as footprints get longer, a row of four along the major axis;
- longer ones take a chain (`fexel.filters.chain`), of texels that are at least 1 / (2 probes + 1/4) of the footprint's
  length: 2 probes of these, each pair one access, on the line that the shear has left tilted.

How wide the footprint is across decides the level, how long it is the octaves, and these how finely there are
directions (`fexel.filters.shears.Direction.octaves`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fexel.filters.lookup import FLOOR, Choice, Rows, Taps, chain_taps, octaves_needed, own_taps, short_level, usable
from fexel.filters.shears import DIRECTIONS
from fexel.textures.footprint import Footprint

__all__ = ["PROBES", "Choice", "Taps", "choose", "taps", "usable"]

PROBES = 4
"""Bilinear accesses along the long axis by default."""

COMPACT = 5.0
"""Texels of its level below which a footprint is taken from the image's own mip levels."""

OWN_TILT = (0.3, 0.68)
"""Tangents between which the image's own level is better than a chain of one octave, where it would do by length."""

HALF_TILT = (0.42, 0.68)
"""Tangents between which two octaves, for which there are shears of 1/2, are better than one, which has none."""

ROUND = (2.3, 2.6)
"""Ratios of axes between which two by two accesses become a row of four."""

NARROW = 2.5
"""Until the ratio of axes is so much more, the row is a zigzag."""

_CODES = np.full((2, 9), -1)  # of long axis, 4 k + 4
for _code, _direction in enumerate(DIRECTIONS):
    _CODES[_direction.long_axis, round(4 * _direction.shear) + 4] = _code

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]


def choose(jacobian: _Floats, probes: int | _Ints = PROBES) -> Choice:
    """Level, octaves and direction of pixels.

    Parameters
    ----------
    jacobian : (K, 2, 2) float64
        d(texel)/d(pixel) at level 0, y down, column j per pixel along x, y; any values.
    probes : int or (K,) int
        Accesses along the long axis.
    """
    rows = Rows.of(usable(jacobian))
    footprint = Footprint.of(rows.jacobian)
    own_level = short_level(footprint.minor)
    compact = footprint.major < COMPACT * np.exp2(own_level)

    axis = rows.long_axis()
    longest, tangent = rows.along(axis)
    sides = rows.sides(axis)
    level = short_level(rows.area / longest)
    octaves = _octaves(octaves_needed(sides, level, probes), np.abs(tangent))
    steps = np.array([1.0, 1.0, 2.0, 4.0])[np.minimum(octaves, 3)]
    shear = np.where(octaves == 0, 0.0, -np.round(tangent * steps) / steps)
    axis = np.where(np.abs(shear) == 1, 1, axis)  # 1 of x is 1 of y
    direction = _CODES[axis, np.round(4 * shear).astype(np.int64) + 4]
    longest, tangent = rows.along(axis)
    axes = np.stack([footprint.major, footprint.minor], 1)
    return Choice(
        np.where(compact, 0, direction),
        np.where(compact, 0, octaves),
        np.where(compact, own_level, level),
        compact,
        np.where(compact[:, None], axes, rows.sides(axis)),
        np.where(compact, footprint.minor, rows.area / longest),
        np.where(compact, 0.0, tangent + shear),
    )


def taps(choice: Choice, xy: _Floats, jacobian: _Floats, extent: tuple[int, int], probes: int = PROBES) -> Taps:
    """The accesses of pixels.

    Parameters
    ----------
    choice : Choice
        Of the same pixels, for as many probes.
    xy : (K, 2) float64
        Their places, texels of level 0, y down.
    jacobian : (K, 2, 2) float64
    extent : (int, int)
        Width and height of the image, twice along an axis that is mirrored.
    probes : int

    Returns
    -------
    Taps
        T is the larger of `probes` and 4; what a pixel does not need has weight 0.
    """
    chain = chain_taps(choice, xy, extent, probes)
    own = own_taps(xy, _points(choice.level, Footprint.of(usable(jacobian))))
    at = np.repeat(xy[:, None], max(probes, PROBES), axis=1)
    weight = np.zeros(at.shape[:2])
    compact = choice.compact[:, None]
    at[:, :probes], weight[:, :probes] = np.where(compact[..., None], xy[:, None], chain.at), ~compact * chain.weight
    at[:, :PROBES] = np.where(compact[..., None], own.at, at[:, :PROBES])
    weight[:, :PROBES] += compact * own.weight
    return Taps(at, weight)


def _octaves(needed: _Floats, tangent: _Floats) -> _Ints:
    """Of a chain, 0 for the image's own mip levels; tangent >= 0."""
    own = (needed <= 0) & (tangent > OWN_TILT[0]) & (tangent < OWN_TILT[1])
    halves = (needed > 1) | (tangent > HALF_TILT[0]) & (tangent < HALF_TILT[1])
    return np.where(own, 0, np.where(halves, np.maximum(needed, 2), 1)).astype(np.int64)


def _points(level: _Ints, footprint: Footprint) -> _Floats:
    """(K, 4, 2) offsets of compact footprints from their centre, texels of level 0."""
    major, minor = np.maximum(footprint.major, FLOOR), np.maximum(footprint.minor, FLOOR)
    ratio = major / minor
    row = np.clip((ratio - ROUND[0]) / (ROUND[1] - ROUND[0]), 0, 1)[:, None]
    narrow = row * np.clip((ratio - ROUND[1]) / NARROW, 0, 1)[:, None]
    boxes = (4.0**level - 1) / 4  # variance that the level has beyond level 0, texels^2
    along, across = (np.sqrt(np.maximum(axis**2 / 12 - boxes, 0))[:, None] for axis in (major, minor))
    alpha = (1 - row) * along * [-1, -1, 1, 1] + row * major[:, None] * [-0.375, -0.125, 0.125, 0.375]
    beta = (1 - narrow) * across * [1, -1, 1, -1]
    direction = footprint.direction / major[:, None]
    normal = np.stack([-direction[:, 1], direction[:, 0]], 1)
    return alpha[..., None] * direction[:, None] + beta[..., None] * normal[:, None]
