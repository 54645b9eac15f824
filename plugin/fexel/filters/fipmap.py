"""The fipmap: ripmaps of a sheared texture, read with a few bilinear accesses (Bornik and Ferko 2002, section 3.2).

The paper chooses, per polygon, the shear that brings the footprint's long axis onto an axis of the texture, and then
looks a ripmap up. Here it is chosen per pixel, from the Jacobian, and no two levels are ever interpolated,
which would only blur.
A pixel takes ``probes`` bilinear accesses of one level; 4 of them, 16 texels, by default:

- *compact* footprints take the image's own mip levels: two rows of accesses, at places that have the mean and the
  variance of a box (of 4 accesses, the points of a Gauss quadrature); of longer ones a zigzag along the major axis;
- longer ones take a chain (`fexel.filters.chain`), of texels that are at least 1 / (2 probes + 1/4) of the footprint's
  length: 2 probes of these, each pair one access, on the line that the shear has left tilted.

How wide the footprint is across decides the level, how long it is the octaves, and these how finely there are
directions (`fexel.filters.shears.Direction.octaves`).

What a pixel shows is the mean over it, as a box; `GAUSS_PROBES` accesses also do for a Gaussian of a standard deviation
of half a pixel, which the elliptical weighted average takes (`fexel.filters.ewa`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fexel.filters.lookup import (
    FLOOR,
    Choice,
    Rows,
    Taps,
    chain_taps,
    gauss_octaves_needed,
    octaves_needed,
    own_taps,
    short_level,
    usable,
)
from fexel.filters.shears import FINE_DIRECTIONS
from fexel.textures.footprint import Footprint

__all__ = ["GAUSS_PROBES", "GAUSS_REACH", "PROBES", "Choice", "Taps", "choose", "taps", "usable"]

PROBES = 4
"""Bilinear accesses along the long axis by default."""

GAUSS_PROBES = 5
"""Accesses along the long axis that a Gaussian takes by default."""

GAUSS_REACH = 2.2
"""Pixels from its centre, at most, that a Gaussian is read: 10 boxes of up to 2 / `GAUSS_PROBES`, and half a one."""

COMPACT = 1.125
"""Texels of its level, per access, below which a footprint is taken from the image's own mip levels."""

GAUSS_COMPACT = 2.0
"""As `COMPACT`, of a Gaussian: altogether."""

OWN_TILT = (0.3, 0.8)
"""Tangents between which the image's own level is better than a chain of one octave, where it would do by length."""

HALF_TILT = (0.42, 0.68)
"""Tangents between which two octaves, for which there are shears of 1/2, are better than one, which has none."""

ROWS = (1.45, 1.6)
"""Texels of its level, per two accesses, between which two rows side by side become a zigzag."""

NARROW = (0.8, 1.6)
"""Texels of its level, per access, between which the zigzag becomes a line."""

CIRCLE = 1.01
"""Ratio of axes up to which a footprint is a circle."""

_CODES = np.full((2, 33), -1)  # of long axis, 16 k + 16
for _code, _direction in enumerate(FINE_DIRECTIONS):
    _CODES[_direction.long_axis, round(16 * _direction.shear) + 16] = _code

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]


def choose(jacobian: _Floats, probes: int | _Ints = PROBES, *, gauss: bool = False) -> Choice:
    """Level, octaves and direction of pixels.

    Parameters
    ----------
    jacobian : (K, 2, 2) float64
        d(texel)/d(pixel) at level 0, y down, column j per pixel along x, y; any values.
    probes : int or (K,) int
        Accesses along the long axis.
    gauss : bool
        Weighted by a Gaussian of a standard deviation of half a pixel, not by the box of a pixel. Twice as wide, it
        shows more of the tilt: it takes `FINE_DIRECTIONS`.
    """
    rows = Rows.of(usable(jacobian))
    footprint = Footprint.of(rows.jacobian)
    own_level = short_level(footprint.minor)
    largest = GAUSS_COMPACT if gauss else COMPACT * np.maximum(probes, PROBES)
    compact = footprint.major < largest * np.exp2(own_level)

    axis = rows.long_axis()
    longest, tangent = rows.along(axis)
    level = short_level(rows.area / longest)
    needed = gauss_octaves_needed(longest, level, probes) if gauss else octaves_needed(rows.sides(axis), level, probes)
    octaves = _octaves(needed, np.abs(tangent))
    steps = np.exp2(np.clip(octaves - 1, 0, 4 if gauss else 2))
    shear = np.where(octaves == 0, 0.0, -np.round(tangent * steps) / steps)
    axis = np.where(np.abs(shear) == 1, 1, axis)  # 1 of x is 1 of y
    direction = _CODES[axis, np.round(16 * shear).astype(np.int64) + 16]
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


def taps(
    choice: Choice,
    xy: _Floats,
    jacobian: _Floats,
    size: tuple[int, int],
    probes: int = PROBES,
    *,
    mirrored: tuple[bool, bool] = (False, False),
    gauss: bool = False,
) -> Taps:
    """The accesses of pixels.

    Parameters
    ----------
    choice : Choice
        Of the same pixels, for as many probes.
    xy : (K, 2) float64
        Their places, texels of level 0, y down.
    jacobian : (K, 2, 2) float64
    size : (int, int)
        Width and height of the image.
    probes : int
    mirrored : (bool, bool)
        Along x, y: chains hold the image and its mirror image.
    gauss : bool

    Returns
    -------
    Taps
        T is the larger of `probes` and 4; what a pixel does not need has weight 0.
    """
    footprint = Footprint.of(usable(jacobian))
    chain = chain_taps(choice, xy, size, probes, mirrored=mirrored, gauss=gauss)
    footprint = _steady(footprint, usable(jacobian)[:, :, 0])
    own = own_taps(xy, _gauss_points(footprint) if gauss else _points(choice.level, footprint, _even(probes)))
    compact = choice.compact[:, None]
    at = np.repeat(xy[:, None], max(probes, PROBES), axis=1)
    weight = np.zeros(at.shape[:2])
    for part, taken in ((chain, ~compact), (own, compact)):
        count = part.weight.shape[1]
        at[:, :count] = np.where(taken[..., None], part.at, at[:, :count])
        weight[:, :count] += taken * part.weight
    return Taps(at, weight)


def _octaves(needed: _Floats, tangent: _Floats) -> _Ints:
    """Of a chain, 0 for the image's own mip levels; tangent >= 0."""
    own = (needed <= 0) & (tangent > OWN_TILT[0]) & (tangent < OWN_TILT[1])
    halves = (needed > 1) | (tangent > HALF_TILT[0]) & (tangent < HALF_TILT[1])
    return np.where(own, 0, np.where(halves, np.maximum(needed, 2), 1)).astype(np.int64)


def _even(probes: int) -> int:
    return max(probes - probes % 2, PROBES)


def _steady(footprint: Footprint, first: _Floats) -> Footprint:
    """Circles have no axes but what rounding makes of them: they take the pixel's, of which `first` (K, 2) is one."""
    length = np.linalg.norm(first, axis=1)
    is_round = (footprint.major < CIRCLE * footprint.minor) & (length > 0)
    scale = (footprint.major / np.where(is_round, length, 1.0))[:, None]
    return replace(footprint, direction=np.where(is_round[:, None], scale * first, footprint.direction))


def _gauss_points(footprint: Footprint) -> _Floats:
    """(K, 4, 2) offsets of compact footprints: a standard deviation to either side along both axes."""
    normal = np.stack([-footprint.direction[:, 1], footprint.direction[:, 0]], 1)
    normal = normal * (footprint.minor / np.maximum(footprint.major, FLOOR))[:, None]
    signs = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
    return 0.5 * (signs[:, :1] * footprint.direction[:, None] + signs[:, 1:] * normal[:, None])


def _points(level: _Ints, footprint: Footprint, count: int) -> _Floats:
    """(K, count, 2) offsets of compact footprints from their centre, texels of level 0; `count` is even."""
    major, minor = (np.maximum(axis, FLOOR)[:, None] for axis in (footprint.major, footprint.minor))
    spacing = major * np.exp2(-level)[:, None] / count
    zigzag = np.clip((2 * spacing - ROWS[0]) / (ROWS[1] - ROWS[0]), 0, 1)
    narrow = zigzag * np.clip((spacing - NARROW[0]) / (NARROW[1] - NARROW[0]), 0, 1)
    boxes = (4.0 ** level[:, None] - 1) / 4  # variance that the level has beyond level 0, texels^2
    along, across = (np.sqrt(np.maximum(axis**2 / 12 - boxes, 0)) for axis in (major, minor))
    columns = np.repeat(np.arange(count // 2) + 0.5 - count / 4, 2)
    alpha = (1 - zigzag) * along * (columns / columns.std()) + zigzag * major * ((np.arange(count) + 0.5) / count - 0.5)
    beta = (1 - narrow) * across * np.tile([1.0, -1.0], count // 2)
    direction = footprint.direction / major
    normal = np.stack([-direction[:, 1], direction[:, 0]], 1)
    return alpha[..., None] * direction[:, None] + beta[..., None] * normal[:, None]
