"""What a pixel takes of prefiltered images: a cell, and bilinear accesses in it. Shared by ripmap and fipmap.

Along its long axis a footprint, a parallelogram, is the convolution of two boxes as long as its sides are along that
axis: a trapezoid. The texels of a chain are boxes themselves; each counts by how high the trapezoid is over it, and two
that lie side by side are one bilinear access. All that is read follows from rows of the Jacobian, which float32 has
exactly, and not from the quadratic form of an ellipse, which it has not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.filters.shears import FINE_DIRECTIONS

__all__ = [
    "FLOOR",
    "SEAM",
    "Choice",
    "Rows",
    "Taps",
    "chain_taps",
    "gauss_octaves_needed",
    "octaves_needed",
    "own_taps",
    "short_level",
    "usable",
]

LIFT = 1.5
"""Texels of a level that the short side of a footprint spans at least, beyond level 0."""

RAMP = 0.5
"""Share of the shorter side of a parallelogram that counts for how many boxes there are: its ends weigh little."""

SLACK = 0.25
"""Boxes that a footprint may have more than are read: ends are rather cut than all boxes made twice as long."""

EQUAL = 1.0001
"""Ratio of squared lengths up to which neither axis is the longer one, as where a square faces the camera."""

SEAM = 1e-5
"""Share of a period by which an access before a seam counts as behind it: rounding shall not choose its side."""

FLOOR = 1e-30
"""Keeps logarithms and quotients finite where a Jacobian is 0."""

_LARGEST = 1e9  # texels per pixel; more, or not a number, is the whole image
_LEAST = 1e-60  # texels per pixel; less is 0, so that no square of a square underflows

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Choice:
    """Cells of pixels.

    Attributes
    ----------
    direction : (K,) int64
        Of `fexel.filters.shears.FINE_DIRECTIONS`; 0 or 3 (nothing is moved) where `octaves` is 0.
    octaves : (K,) int64
        Of the chain; 0: the image's own mip levels.
    level : (K,) int64
        Of the chain, or of the image.
    compact : (K,) bool
        The image's own, without a long axis.
    length : (K, 2) float64
        Texels of level 0 along the long axis that the sides of the footprint take, the longer first; axes of the
        ellipse where compact.
    width : (K,) float64
        Texels of level 0 across, in the moved image.
    tilt : (K,) float64
        Texels along the moved axis per texel along the long one, that the shear leaves.
    stride : (K,) float64, optional
        Periods of the long axis per box where more than all boxes are seen, else 0; see `fexel.filters.tiles`.
    drift : (K,) float64, optional
        Texels along the moved axis per such period, without whole periods of that axis.
    """

    direction: _Ints
    octaves: _Ints
    level: _Ints
    compact: NDArray[np.bool_]
    length: _Floats
    width: _Floats
    tilt: _Floats
    stride: _Floats | None = None
    drift: _Floats | None = None


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


@dataclass(frozen=True, eq=False)
class Rows:
    """Jacobians by row: how x and y change.

    Attributes
    ----------
    jacobian : (K, 2, 2) float64
    square : (K, 2) float64
        Squared lengths of the rows, texels^2.
    product : (K,) float64
        Of the two rows.
    area : (K,) float64
        Of a pixel, texels^2.
    """

    jacobian: _Floats
    square: _Floats
    product: _Floats
    area: _Floats

    @classmethod
    def of(cls, jacobian: _Floats) -> Rows:
        """Of (K, 2, 2), column j per pixel along x, y; finite."""
        (a, b), (c, d) = np.moveaxis(jacobian, 0, -1)
        return cls(jacobian, np.sum(jacobian**2, axis=2), a * c + b * d, np.abs(a * d - b * c))

    def long_axis(self) -> _Ints:
        """The axis along which a footprint is longer; x of equals, or what but for rounding is equal."""
        return (self.square[:, 1] > EQUAL * self.square[:, 0]).astype(np.int64)

    def along(self, axis: _Ints) -> tuple[_Floats, _Floats]:
        """Length along an axis, and the tangent of the footprint against it."""
        square = np.maximum(self.square[np.arange(len(axis)), axis], FLOOR)
        return np.sqrt(square), self.product / square

    def sides(self, axis: _Ints) -> _Floats:
        """(K, 2) of the sides of the parallelogram along an axis, the longer first."""
        sides = np.abs(self.jacobian[np.arange(len(axis)), axis])
        return np.maximum(np.sort(sides, axis=1)[:, ::-1], FLOOR)


def usable(jacobian: _Floats) -> _Floats:
    """Jacobians with those replaced that are not finite, or too large for what follows: they see the whole image.

    What is too small is 0.
    """
    jacobian = np.asarray(jacobian, np.float64)
    with np.errstate(invalid="ignore"):
        fits = (np.abs(jacobian) < _LARGEST).all(axis=(1, 2), keepdims=True)
        kept = np.where(np.abs(jacobian) < _LEAST, 0.0, jacobian)
    return np.where(fits, kept, _LARGEST * np.eye(2))


def short_level(width: _Floats) -> _Ints:
    """The coarsest level of which `width` texels of level 0 are `LIFT` texels at least."""
    return np.maximum(np.floor(np.log2(np.maximum(width, FLOOR) / LIFT)), 0).astype(np.int64)


def octaves_needed(sides: _Floats, level: _Ints, probes: int | _Ints) -> _Floats:
    """By how many octaves a texel must be longer than wide, for `probes` accesses to do; may be negative."""
    return np.ceil(np.log2((sides[:, 0] + RAMP * sides[:, 1]) / (2.0 * probes + SLACK))) - level


def gauss_octaves_needed(length: _Floats, level: _Ints, probes: int | _Ints) -> _Floats:
    """As `octaves_needed`, for a Gaussian of a standard deviation of half of `length`; 2 to either side count."""
    return np.ceil(np.log2(np.maximum(length, FLOOR) / probes)) - level


def own_taps(at: _Floats, offsets: _Floats) -> Taps:
    """Accesses of equal weights at (K, T, 2) offsets from (K, 2) places."""
    return Taps(at[:, None] + offsets, np.full(offsets.shape[:2], 1 / offsets.shape[1]))


def chain_taps(
    choice: Choice,
    xy: _Floats,
    size: tuple[int, int],
    probes: int,
    *,
    mirrored: tuple[bool, bool] = (False, False),
    gauss: bool = False,
) -> Taps:
    """Accesses along the long axis.

    Parameters
    ----------
    choice : Choice
        Of pixels that are not compact.
    xy : (K, 2) float64
        Their places, texels of level 0, y down.
    size : (int, int)
        Width and height of the image.
    probes : int
        T.
    mirrored : (bool, bool)
        Along x, y: chains hold the image and its mirror image.
    gauss : bool
        Weighted by a Gaussian of a standard deviation of half a pixel, not by the box of a pixel.
    """
    axis = np.array([direction.long_axis for direction in FINE_DIRECTIONS])[choice.direction]
    shear = np.array([direction.shear for direction in FINE_DIRECTIONS])[choice.direction]
    length, folds = np.array(size)[axis], np.array(mirrored)[axis].astype(np.int64)
    halvings = np.minimum(choice.octaves + choice.level, 62)
    columns = (length << folds) >> halvings
    # Of the image's own levels, and its mirror image, each has whole texels.
    columns = np.where(choice.octaves == 0, np.maximum(length >> halvings, 1) << folds, columns)
    texel = (length << folds) / np.maximum(columns, 1)
    center = xy[np.arange(len(xy)), axis]
    middle = center / texel
    stride = np.zeros(len(xy)) if choice.stride is None else choice.stride
    spread = stride > 0
    texel = np.where(spread, (length << folds) * stride, texel)
    middle = np.where(spread, 0.0, middle)
    first = np.round(middle - probes)[:, None] + 0.5 + 2.0 * np.arange(probes) - middle[:, None]
    height = _gauss if gauss else _trapezoid
    left, right = (height(first + next_, choice.length / texel[:, None]) for next_ in (0, 1))
    weight = left + right
    share = np.divide(right, weight, out=np.zeros_like(right), where=weight > 0)
    along = (first + share) * texel[:, None]
    # What the moved axis gains by the shear, a place in the image that is not moved has not.
    across = (choice.tilt - shear)[:, None] * along
    if choice.drift is not None:
        period = length << folds
        inward = ((np.floor(center / period) + 0.5) * period - center)[:, None]  # to the middle of the line
        gained = (choice.tilt - shear)[:, None] * inward + choice.drift[:, None] * (first + share) * stride[:, None]
        along = np.where(spread[:, None], inward, along)
        across = np.where(spread[:, None], gained, across)
    offset = np.where((axis == 0)[:, None, None], np.stack([along, across], 2), np.stack([across, along], 2))
    return Taps(xy[:, None] + offset, weight / weight.sum(axis=1, keepdims=True))


def _trapezoid(at: _Floats, length: _Floats) -> _Floats:
    """Its height in the middle of texels, 0 to 1: (K, T) and the two boxes' lengths (K, 2) in texels of the cell."""
    ramp = np.maximum(length[:, 1:], 1.0)
    half = 0.5 * (np.maximum(length[:, :1], 1.0) + ramp)
    return np.clip((half - np.abs(at)) / ramp, 0, 1)


def _gauss(at: _Floats, length: _Floats) -> _Floats:
    """As `_trapezoid`; narrower by the variance of a texel, which is a box."""
    variance = np.maximum(0.25 * np.sum(length**2, axis=1, keepdims=True) - 1 / 12, 0.01)
    return np.exp(-0.5 * at**2 / variance)
