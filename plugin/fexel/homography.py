"""Projective maps of the plane in float64: compose, invert, apply, normalise, measure.

A homography is a (3, 3) matrix for row vectors as in USD: ``[s t w] = [s0 t0 1] @ matrix``, then divide by w. Products
read from left to right: ``root_to_patch = root_to_parent @ parent_to_patch``. All functions broadcast over leading
axes. A point with w <= 0 lies at or behind infinity and has no image. Only the ratio of the nine numbers matters; the
sign is fixed by `normalize`, which makes w = 1 at the centre of the patch (fixing the last element at 1 instead can
leave w < 0 inside the patch).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "UNIT_SQUARE",
    "apply",
    "corner_error",
    "invert",
    "is_usable",
    "jacobian",
    "normalize",
    "scale",
    "translate",
    "unit_square_bounds",
]

UNIT_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])

# A map worse conditioned than this (after scaling its rows and columns to length one) has no usable inverse in float64.
_SINGULAR = 1e-12
# Smallest w, relative to its value at the patch's centre, that counts as in front of infinity.
_MIN_W = 1e-12


def apply(matrix: ArrayLike, st: ArrayLike) -> NDArray[np.float64]:
    """Map points.

    Parameters
    ----------
    matrix : (..., 3, 3) float64
    st : (..., N, 2) float64

    Returns
    -------
    (..., N, 2) float64
        NaN where w <= 0.

    Examples
    --------
    >>> apply(np.eye(3), np.array([[0.25, 0.5]]))
    array([[0.25, 0.5 ]])
    """
    matrix = np.asarray(matrix, np.float64)
    st = np.asarray(st, np.float64)
    mapped = st @ matrix[..., :2, :] + matrix[..., 2:3, :]
    w = mapped[..., 2:3]
    in_front = w > 0
    return np.where(in_front, mapped[..., :2] / np.where(in_front, w, 1.0), np.nan)


def jacobian(matrix: ArrayLike, st: ArrayLike) -> NDArray[np.float64]:
    """Derivative of `apply` at points: ``J[..., i, j]`` = d(mapped_i)/d(st_j).

    Parameters
    ----------
    matrix : (..., 3, 3) float64
    st : (..., N, 2) float64

    Returns
    -------
    (..., N, 2, 2) float64
        NaN where w <= 0.
    """
    matrix = np.asarray(matrix, np.float64)
    st = np.asarray(st, np.float64)
    mapped = st @ matrix[..., :2, :] + matrix[..., 2:3, :]
    w = mapped[..., 2]
    in_front = w > 0
    inverse_w = np.where(in_front, 1.0 / np.where(in_front, w, 1.0), np.nan)[..., None, None]
    image = mapped[..., :2] * inverse_w[..., 0]
    linear = np.swapaxes(matrix[..., :2, :2], -1, -2)[..., None, :, :]
    perspective = matrix[..., None, :2, 2][..., None, :]
    return (linear - image[..., :, None] * perspective) * inverse_w


def is_usable(matrix: ArrayLike) -> NDArray[np.bool_]:
    """True for finite matrices with a usable inverse (mirrored ones included) whose patch lies in front of infinity.

    Parameters
    ----------
    matrix : (..., 3, 3) float64
        Parent to patch.
    """
    matrix = np.asarray(matrix, np.float64)
    finite = np.isfinite(matrix).all(axis=(-1, -2))
    safe = np.where(finite[..., None, None], matrix, np.eye(3))
    largest = np.abs(safe).max(axis=(-1, -2), keepdims=True)
    safe = safe / np.where(largest > 0, largest, 1.0)
    # Rows scaled to length one make the determinant a measure of how near the rows are to being dependent.
    with np.errstate(over="ignore", under="ignore"):
        columns = safe / np.maximum(np.linalg.norm(safe, axis=-2, keepdims=True), 1e-300)
        rows = columns / np.maximum(np.linalg.norm(columns, axis=-1, keepdims=True), 1e-300)
    regular = np.abs(np.linalg.det(rows)) > _SINGULAR
    usable = finite & regular
    inverse = np.linalg.inv(np.where(usable[..., None, None], safe, np.eye(3)))
    w = np.concatenate([UNIT_SQUARE, [[0.5, 0.5]]]) @ inverse[..., :2, 2:] + inverse[..., 2:, 2:]
    w = w[..., 0] / np.where(w[..., 4:5, 0] != 0, w[..., 4:5, 0], np.nan)
    return usable & (w > _MIN_W).all(axis=-1)


def invert(matrix: ArrayLike) -> NDArray[np.float64]:
    """Inverse map. Raises `numpy.linalg.LinAlgError` for an exactly singular matrix."""
    return np.linalg.inv(np.asarray(matrix, np.float64))


def normalize(root_to_patch: ArrayLike) -> NDArray[np.float64]:
    """Scale so that w = 1 at the centre of the patch, hence positive in all of it.

    The scale is found from the inverse: the patch's centre, carried to the root, has w' there; the product of both
    homogeneous maps is the identity times a constant, which fixes w.
    """
    matrix = np.asarray(root_to_patch, np.float64)
    inverse = np.linalg.inv(matrix)
    centre = np.array([0.5, 0.5, 1.0]) @ inverse
    # centre @ matrix = [.5 .5 1]; at the root's affine point centre / centre_w the patch's w is 1 / centre_w.
    return matrix * centre[..., 2][..., None, None]


def scale(sx: float, sy: float) -> NDArray[np.float64]:
    """Scaling about the origin."""
    return np.diag([sx, sy, 1.0])


def translate(dx: float, dy: float) -> NDArray[np.float64]:
    """Translation."""
    matrix = np.eye(3)
    matrix[2, :2] = dx, dy
    return matrix


def unit_square_bounds(root_to_patch: ArrayLike) -> NDArray[np.float64]:
    """Bounds in root coordinates of usable patches.

    Parameters
    ----------
    root_to_patch : (..., 3, 3) float64
        Usable (`is_usable`).

    Returns
    -------
    (..., 4) float64
        s_min, t_min, s_max, t_max.
    """
    inverse = np.linalg.inv(np.asarray(root_to_patch, np.float64))
    corners = UNIT_SQUARE @ inverse[..., :2, :] + inverse[..., 2:3, :]
    corners = corners[..., :2] / corners[..., 2:]
    return np.concatenate([corners.min(axis=-2), corners.max(axis=-2)], axis=-1)


def corner_error(matrix: ArrayLike, truth: ArrayLike, corners: ArrayLike = UNIT_SQUARE) -> float:
    """Largest distance between the images of `corners` under two maps, in units of the target; inf where none is."""
    a, b = apply(matrix, corners), apply(truth, corners)
    distance = np.linalg.norm(a - b, axis=-1)
    return float(np.where(np.isnan(distance), np.inf, distance).max())
