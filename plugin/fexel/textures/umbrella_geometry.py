"""Star-shaped polygons about a centre: directions, orientation, how far a shape may morph, how an umbrella is turned.

A sector is the triangle of the centre and two neighbouring contour vertices. A shape folds where one of them turns
backward, which the cross product of its spokes tells. Points are (V, 2), the centre first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fexel import homography
from fexel.textures.umbrella_arrangement import Arrangement

__all__ = [
    "FLAT",
    "FULL_TURN",
    "cross",
    "fold_weight",
    "half_turn",
    "is_star_shaped",
    "pseudo_angle",
    "signed_area",
    "turns",
]

FULL_TURN = 4.0
"""Of a pseudo-angle."""

FLAT = 1e-6
"""Area of a sector, relative to the square of the size, that 32-bit coordinates leave of a flat one."""


def pseudo_angle(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Direction of vectors, growing counter-clockwise from +x; half a turn adds 2.

    Parameters
    ----------
    xy : (..., 2) float64

    Returns
    -------
    (...) float64
        In [0, 4): ``y / (|x| + |y|)`` unrolled; 0 for the zero vector.
    """
    x, y = xy[..., 0], xy[..., 1]
    size = np.abs(x) + np.abs(y)
    ratio = y / np.where(size > 0, size, 1.0)
    angle = np.where(x < 0, 2.0 - ratio, np.where(ratio < 0, FULL_TURN + ratio, ratio))
    return np.where(angle >= FULL_TURN, 0.0, angle)  # 4 - 1e-17 is 4


def signed_area(contour: NDArray[np.float64]) -> float:
    """Area of a polygon (V, 2), negative where it runs clockwise."""
    x, y = (contour - contour[:1]).T
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(np.roll(x, -1), y))


def is_star_shaped(points: NDArray[np.float64]) -> bool:
    """Whether the centre, the first of (V, 2) points, sees all of the contour that follows it counter-clockwise.

    Sectors without area do not matter.
    """
    around = points[1:] - points[0]
    after = np.roll(around, -1, axis=0)
    size = np.abs(around).max(initial=0.0)
    if (cross(around, after) < -FLAT * size**2).any():
        return False
    turn = _turns(pseudo_angle(around[np.any(around != 0, axis=1)])).sum()
    return bool(abs(turn - FULL_TURN) < 1.0)


def fold_weight(points: NDArray[np.float64], morph_points: NDArray[np.float64]) -> float:
    """Largest morph in [0, 1] up to which no sector folds.

    The cross product of a sector's spokes is a quadratic in the morph weight (notes U2), so the weight at which it
    changes sign is exact. Sectors that are folded from the start are left aside, and so is what 32-bit coordinates
    make of a flat one.

    Parameters
    ----------
    points, morph_points : (V, 2) float64
        Centre first, then the contour, counter-clockwise.
    """
    start, end = points[1:] - points[0], morph_points[1:] - morph_points[0]
    size = max(np.abs(start).max(initial=0.0), np.abs(end).max(initial=0.0))
    if size == 0.0:
        return 1.0
    spoke, way = start / size, (end - start) / size
    following, its_way = np.roll(spoke, -1, axis=0), np.roll(way, -1, axis=0)
    c = cross(spoke, following)
    b = cross(spoke, its_way) + cross(way, following)
    a = cross(way, its_way)
    folds = (c >= -FLAT) & (_lowest(a, b, c) < -FLAT)
    roots = [_first_root(*abc) for abc in zip(a[folds], b[folds], c[folds], strict=True)]
    return float(min(roots, default=1.0))


def _lowest(a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smallest value of a m^2 + b m + c for m in [0, 1]."""
    curved = a > 0
    at = np.clip(np.where(curved, -b / np.where(curved, 2 * a, 1.0), 0.0), 0.0, 1.0)
    return np.minimum(np.minimum(c, a + b + c), (a * at + b) * at + c)


def _first_root(a: float, b: float, c: float) -> float:
    """Where a m^2 + b m + c, which is negative somewhere in [0, 1], first becomes so."""
    if c <= 0.0:
        return 0.0
    discriminant = max(b * b - 4 * a * c, 0.0)  # rounding where it only touches zero
    q = -0.5 * (b + np.copysign(np.sqrt(discriminant), b))  # without cancellation
    roots = [root for root in (q / a if a else np.inf, c / q if q else np.inf) if 0.0 < root <= 1.0]
    return min(roots, default=1.0)


def cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cross products of vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _turns(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """From each direction to the next around, in (-2, 2]."""
    return half_turn(np.roll(angles, -1) - angles)


def half_turn(difference: NDArray[np.float64]) -> NDArray[np.float64]:
    """A difference of pseudo-angles the short way around, in (-2, 2]."""
    return 2.0 - np.mod(2.0 - difference, FULL_TURN)


def turns(arrangement: Arrangement) -> NDArray[np.float64]:
    """How each umbrella is turned from patch space to st: the orthogonal part of its Jacobian at the centre.

    Returns
    -------
    (n, 2, 2) float64
        For column vectors; a mirrored umbrella mirrors. However st is stretched along its axes, an umbrella that lies
        undistorted on the surface is turned by its angle there.
    """
    if not len(arrangement):
        return np.zeros((0, 2, 2))
    centers = arrangement.points[arrangement.first_vertex[:-1]]
    jacobian = homography.jacobian(arrangement.matrices, centers[:, None])[:, 0]
    mirror = np.where(cross(jacobian[:, :, 0], jacobian[:, :, 1]) < 0, -1.0, 1.0)
    cosine = jacobian[:, 0, 0] + mirror * jacobian[:, 1, 1]
    sine = jacobian[:, 1, 0] - mirror * jacobian[:, 0, 1]
    size = np.hypot(cosine, sine)
    safe = np.where(size > 0, size, 1.0)  # 0 for a singular matrix alone
    cosine, sine = np.where(size > 0, cosine / safe, 1.0), sine / safe
    return np.stack([cosine, -mirror * sine, sine, mirror * cosine], axis=1).reshape(-1, 2, 2)
