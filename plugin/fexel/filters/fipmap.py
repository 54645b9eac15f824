"""The fipmap: ripmaps of a sheared texture, read with a few bilinear accesses (Bornik and Ferko 2002, section 3.2).

The paper chooses, per polygon, the shear that brings the footprint's long axis onto an axis of the texture, and then
looks a ripmap up. Here it is chosen per pixel, from the Jacobian, and no two levels are ever interpolated (notes, F6).
A pixel takes ``probes`` bilinear accesses of one level; 4 of them, 16 texels, by default:

- *compact* footprints take the image's own mip levels: two by two accesses at the points of a Gauss quadrature, which
  have the mean and the variance of a box; as footprints get longer, a row of four along the major axis;
- longer ones take a chain (`fexel.filters.chain`): one whose texels are boxes of at least 1 / (2 probes + 1/4) of the
  footprint's length. Two boxes that lie side by side are one access. The last boxes count by the part that the footprint
  covers, and each access lies on the line that the shear has left tilted.

How wide the footprint is across decides the level, how long it is the octaves, and these how finely there are
directions; all follow from rows of the Jacobian that are exact in float32 as well (notes, F9).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.filters.shears import DIRECTIONS
from fexel.textures.footprint import Footprint

__all__ = ["PROBES", "Choice", "Taps", "choose", "taps"]

PROBES = 4
"""Bilinear accesses along the long axis by default."""

COMPACT = 5.0
"""Texels of its level below which a footprint is taken from the image's own mip levels."""

COMPACT_LIFT = 1.5
LIFT = 1.5
"""Texels of a level that the short axis spans at least, beyond level 0; of compact and of longer footprints."""

OWN_TILT = (0.3, 0.68)
"""Tangents between which the image's own level is better than a chain of one octave, where it would do for the length."""

HALF_TILT = (0.42, 0.68)
"""Tangents between which two octaves, for which there are shears of 1/2, are better than one, for which there are none."""

ROUND = (2.3, 2.6)
"""Ratios of axes between which two by two accesses become a row of four."""

RAMP = 0.5
"""Share of the shorter side that counts for how many boxes there are: the ends of a skewed footprint weigh little."""

_SLACK = 0.25  # box texels more than fit: the ends are cut rather than all boxes made twice as long
_LARGEST = 1e9  # texels per pixel; more, or not a number, is the whole image
_FLOOR = 1e-30  # keeps logarithms and quotients finite where the Jacobian is 0

_CODES = np.full((2, 9), -1)  # of long axis, 4 k + 4
for _code, _direction in enumerate(DIRECTIONS):
    _CODES[_direction.long_axis, round(4 * _direction.shear) + 4] = _code

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Choice:
    """What pixels take.

    Attributes
    ----------
    direction : (K,) int64
        Of `fexel.filters.shears.DIRECTIONS`; 0 or 3 (nothing is moved) where `octaves` is 0.
    octaves : (K,) int64
        Of the chain; 0: the image's own mip levels.
    level : (K,) int64
        Of the chain, or of the image.
    compact : (K,) bool
        The image's own, without a long axis.
    length : (K, 2) float64
        Texels of level 0 along the long axis that the sides of the footprint, a parallelogram, take; the longer first.
    width : (K,) float64
        Texels of level 0 across, in the moved image.
    tilt : (K,) float64
        Texels along the moved axis per texel along the long one, that the shear leaves.
    """

    direction: _Ints
    octaves: _Ints
    level: _Ints
    compact: NDArray[np.bool_]
    length: _Floats
    width: _Floats
    tilt: _Floats


@dataclass(frozen=True, eq=False)
class Taps:
    """Bilinear accesses.

    Attributes
    ----------
    at : (K, T, 2) float64
        Places in the image (not moved), texels of level 0, x right, y down, not wrapped.
    weight : (K, T) float64
        Their sum is 1.
    """

    at: _Floats
    weight: _Floats


def usable(jacobian: _Floats) -> _Floats:
    """Jacobians with those replaced that are not finite: they see the whole image."""
    with np.errstate(invalid="ignore"):
        fits = (np.abs(jacobian) < _LARGEST).all(axis=(1, 2), keepdims=True)
    return np.where(fits, jacobian, _LARGEST * np.eye(2))


def choose(jacobian: _Floats, probes: int | _Ints = PROBES) -> Choice:
    """Level, octaves and direction of pixels.

    Parameters
    ----------
    jacobian : (K, 2, 2) float64
        d(texel)/d(pixel) at level 0, y down, column j per pixel along x, y; any values.
    probes : int or (K,) int
        Accesses along the long axis.
    """
    jacobian = usable(np.asarray(jacobian, np.float64))
    footprint = Footprint.of(jacobian)
    own_level = _level(footprint.minor, COMPACT_LIFT)
    compact = footprint.major < COMPACT * np.exp2(own_level)

    rows = np.sum(jacobian**2, axis=2)
    product = np.sum(jacobian[:, 0] * jacobian[:, 1], axis=1)
    area = np.abs(np.linalg.det(jacobian))
    axis = (rows[:, 1] > rows[:, 0]).astype(np.int64)
    longest, tangent = _along(rows, product, axis)
    level = _level(area / longest, LIFT)
    sides = _sides(jacobian, axis)
    needed = np.ceil(np.log2((sides[:, 0] + RAMP * sides[:, 1]) / (2.0 * probes + _SLACK))) - level
    plain = (needed <= 0) & _between(tangent, OWN_TILT)
    octaves = np.where(plain, 0, np.where((needed <= 1) & ~_between(tangent, HALF_TILT), 1, np.maximum(needed, 2)))
    octaves = octaves.astype(np.int64)
    steps = np.array([1.0, 1.0, 2.0, 4.0])[np.minimum(octaves, 3)]
    shear = np.where(plain, 0.0, -np.round(tangent * steps) / steps)
    axis = np.where((axis == 0) & (np.abs(shear) == 1), 1, axis)  # 1 of x is 1 of y
    longest, tangent = _along(rows, product, axis)
    direction = _CODES[axis, np.round(4 * shear).astype(np.int64) + 4]
    zero = np.zeros_like(octaves)
    return Choice(
        np.where(compact, zero, direction),
        np.where(compact, zero, octaves),
        np.where(compact, own_level, level),
        compact,
        _sides(jacobian, axis),
        np.where(compact, footprint.minor, area / longest),
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
    count = max(probes, PROBES)
    at = np.repeat(np.nan_to_num(xy)[:, None], count, axis=1)
    weight = np.zeros((len(at), count))
    pick = np.flatnonzero(choice.compact)
    at[pick, :PROBES] += _compact(choice.level[pick], Footprint.of(usable(jacobian[pick])))
    weight[pick, :PROBES] = 1 / PROBES
    pick = np.flatnonzero(~choice.compact)
    axes = np.array([direction.long_axis for direction in DIRECTIONS])[choice.direction[pick]]
    shears = np.array([direction.shear for direction in DIRECTIONS])[choice.direction[pick]]
    columns = np.maximum(np.array(extent)[axes] >> (choice.octaves + choice.level)[pick], 1)
    center = at[pick, 0, axes]
    along, weight[pick, :probes] = _boxes(center, choice.length[pick], np.array(extent)[axes] / columns, probes)
    along -= center[:, None]
    at[pick[:, None], np.arange(probes), axes[:, None]] += along
    # What the moved axis gains by the shear, an unmoved place does not have.
    at[pick[:, None], np.arange(probes), 1 - axes[:, None]] += (choice.tilt[pick] - shears)[:, None] * along
    return Taps(at, weight)


def _level(width: _Floats, lift: float) -> _Ints:
    return np.maximum(np.floor(np.log2(np.maximum(width, _FLOOR) / lift)), 0).astype(np.int64)


def _sides(jacobian: _Floats, axis: _Ints) -> _Floats:
    """(K, 2), the longer first."""
    sides = np.abs(jacobian[np.arange(len(axis)), axis])
    return np.maximum(np.sort(sides, axis=1)[:, ::-1], _FLOOR)


def _between(tangent: _Floats, bounds: tuple[float, float]) -> NDArray[np.bool_]:
    return (np.abs(tangent) > bounds[0]) & (np.abs(tangent) < bounds[1])


def _along(rows: _Floats, product: _Floats, axis: _Ints) -> tuple[_Floats, _Floats]:
    """Length along an axis, and tangent of the footprint against it."""
    square = np.maximum(rows[np.arange(len(rows)), axis], _FLOOR)
    return np.sqrt(square), product / square


def _compact(level: _Ints, footprint: Footprint) -> _Floats:
    """(K, 4, 2) offsets from the centre, texels of level 0."""
    major, minor = np.maximum(footprint.major, _FLOOR), np.maximum(footprint.minor, _FLOOR)
    ratio = major / minor
    row = np.clip((ratio - ROUND[0]) / (ROUND[1] - ROUND[0]), 0, 1)[:, None]
    narrow = row * np.clip((ratio - ROUND[1]) / 2.5, 0, 1)[:, None]
    boxes = (4.0**level - 1) / 4  # variance that the level has beyond level 0, texels^2
    along, across = (np.sqrt(np.maximum(axis**2 / 12 - boxes, 0))[:, None] / axis[:, None] for axis in (major, minor))
    alpha = (1 - row) * along * [-1, -1, 1, 1] + row * [-0.375, -0.125, 0.125, 0.375]
    beta = (1 - narrow) * across * [1, -1, 1, -1]
    direction = footprint.direction
    normal = np.stack([-direction[:, 1], direction[:, 0]], 1) * (minor / major)[:, None]
    return alpha[..., None] * direction[:, None] + beta[..., None] * normal[:, None]


def _boxes(center: _Floats, length: _Floats, texel: _Floats, probes: int) -> tuple[_Floats, _Floats]:
    """Places of the accesses along the long axis, (K, probes), and their weights.

    A parallelogram is, along the axis, the convolution of two boxes as long as its sides: a trapezoid.

    center, texel: (K,), length: (K, 2) texels of level 0; `texel` is one of the level that is read.
    """
    middle = (center / texel)[:, None]
    ramp = np.maximum(length[:, 1] / texel, 1.0)[:, None]
    half = 0.5 * (np.maximum(length[:, 0] / texel, 1.0)[:, None] + ramp)
    first = np.round(middle - probes) + 2.0 * np.arange(probes)
    left, right = (np.clip((half - np.abs(first + at - middle)) / ramp, 0, 1) for at in (0.5, 1.5))
    weight = left + right
    share = np.divide(right, weight, out=np.zeros_like(right), where=weight > 0)
    return (first + 0.5 + share) * texel[:, None], weight / weight.sum(axis=1, keepdims=True)
