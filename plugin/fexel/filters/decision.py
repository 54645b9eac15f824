"""The paper's decision between filters by the camera's direction, and the colour that shows it.

At a place of a surface the camera stands in an octant of three axes: B along u, G along the normal, R along v. The line
to it meets the triangle of the blue, green and red primary at the camera's colour (Bornik and Ferko 2002, section 3.2,
fig. 8). Greenish, near the normal, a mipmap will do; along the sides to blue or red, where it looks along u or v, a
ripmap; below, a fipmap, whose shear b or c is the tangent of the angle between the camera's place seen from above and
the nearer axis (fig. 16). The paper leaves the thresholds open: those here follow from the ratio of a footprint's axes,
which is one over the cosine to the normal, and from the tangents that there are.

Per pixel, the Jacobian says more than that: `fexel.filters.fipmap` and `fexel.filters.auto` decide by it. This is for
looking at: AOV ``decision``, oracle of shaders/decision.glsl.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.filters import FILTERS
from fexel.filters.shears import DIRECTIONS

__all__ = ["GREEN", "TANGENT", "TILTED", "Decision", "color", "decide"]

GREEN = 0.5**0.5
"""Cosine to the normal from which a mipmap will do: a ratio of axes of up to sqrt 2, half a mip level."""

TILTED = 0.5
"""Cosine below which shears are worth it: below a ratio of 2 the plain ripmap wins."""

TANGENT = 0.25
"""Tangent below which an axis is nearer than the first shear, of 1/2."""

_LEAST_SINE = 1e-3  # between u and v: keeps coordinates finite where both run alike


@dataclass(frozen=True, eq=False)
class Decision:
    """What the camera's direction calls for.

    Attributes
    ----------
    filter : (M,) int64
        Index in `fexel.filters.FILTERS`: mipmap, ripmap or fipmap.
    shear : (M, 2) float64
        (b, 0) where the camera stands nearer to the v axis, (0, c) nearer to the u axis: tan alpha, at most 1 by
        magnitude, v upwards; also of mipmaps and ripmaps, which do not use it.
    direction : (M,) int64
        The nearest one of `fexel.filters.shears.DIRECTIONS`, texels y down; of a ripmap 0 or 3.
    """

    filter: NDArray[np.int64]
    shear: NDArray[np.float64]
    direction: NDArray[np.int64]


def color(
    to_camera: NDArray[np.float64], frame: NDArray[np.float64], intensity: NDArray[np.float64] | float = 1.0
) -> NDArray[np.float64]:
    """Colours of cameras.

    Parameters
    ----------
    to_camera : (M, 3) float64
        Unit vectors from the surface.
    frame : (M, 3, 3) float64
        Columns: gradients of u and v along the surface, of any length, and the unit normal.
    intensity : (M,) float64 or float
        Falls with distance, from 1.

    Returns
    -------
    (M, 3) float64
        Linear Rec.709: R along v, G along the normal, B along u, of sum `intensity`; green where there are no u and v.

    Examples
    --------
    >>> color(np.array([[0.6, 0.8, 0.0]]), np.eye(3)[None]).round(3)
    array([[0.571, 0.   , 0.429]])
    """
    coordinates = np.abs(_coordinates(to_camera, frame))[:, ::-1]
    total = coordinates.sum(axis=1)
    safe = np.where(total > 1e-6, total, 1.0)[:, None]
    shares = np.where(total[:, None] > 1e-6, coordinates / safe, [0.0, 1.0, 0.0])
    return shares * np.broadcast_to(intensity, total.shape)[:, None]


def decide(to_camera: NDArray[np.float64], frame: NDArray[np.float64]) -> Decision:
    """Filter and shear for cameras; parameters as of `color`."""
    above = _coordinates(to_camera, frame)[:, [0, 2]]
    size = np.abs(above)
    along_u = size[:, 0] >= size[:, 1]
    tangent = -np.sign(above.prod(axis=1)) * size.min(axis=1) / np.maximum(size.max(axis=1), 1e-30)
    cosine = np.abs(np.sum(frame[:, :, 2] * to_camera, axis=1))
    plain = (np.abs(tangent) < TANGENT) | (cosine >= TILTED)
    chosen = np.select(
        [cosine >= GREEN, plain], [FILTERS.index("mipmap"), FILTERS.index("ripmap")], FILTERS.index("fipmap")
    )
    shear = np.where(along_u[:, None], np.stack([0 * tangent, tangent], 1), np.stack([tangent, 0 * tangent], 1))
    return Decision(chosen.astype(np.int64), shear, _direction(along_u, np.where(plain, 0.0, -tangent)))


def _coordinates(to_camera: NDArray[np.float64], frame: NDArray[np.float64]) -> NDArray[np.float64]:
    """(M, 3): along the unit vectors in which u alone, v alone change, and along the normal in the middle."""
    lengths = np.linalg.norm(frame[:, :, :2], axis=1)
    unit = frame[:, :, :2] / np.where(lengths > 0, lengths, 1.0)[:, None]
    sine = np.maximum(np.linalg.norm(np.cross(unit[:, :, 0], unit[:, :, 1]), axis=1), _LEAST_SINE)
    u, v = (np.sum(unit[:, :, i] * to_camera, axis=1) / sine for i in (0, 1))
    return np.stack([u, np.sum(frame[:, :, 2] * to_camera, axis=1), v], axis=1)


def _direction(along_u: NDArray[np.bool_], shear: NDArray[np.float64]) -> NDArray[np.int64]:
    """Number of the direction of that long axis and about that shear; a whole one is one of y: the diagonal is both."""
    rounded = np.round(2 * shear) / 2
    long_axis = np.where(along_u & (np.abs(rounded) < 1), 0, 1)
    known = np.array([(direction.long_axis, direction.shear) for direction in DIRECTIONS])
    return np.abs(known[None] - np.stack([long_axis, rounded], 1)[:, None]).sum(axis=2).argmin(axis=1)
