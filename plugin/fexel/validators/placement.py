"""Where patches lie: their matrices, their parents, their nesting depth.

A patch is the unit square of its own coordinates; its inverse matrix carries that square to its parent, where it may be
any convex quadrilateral (zipmaps, section 3). Only the ratio of a matrix's nine numbers matters.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from fexel.homography import UNIT_SQUARE, is_usable
from fexel.schema.wrapper import is_a
from fexel.validators.fault import Fault, authored_values

__all__ = ["MAX_DEPTH", "check_depth", "check_matrix", "check_parent"]

MAX_DEPTH = 32
"""Deepest nest without a warning; 4x per level would magnify 2^64 times, past what float64 can place."""

# How far a patch may reach beyond its parent without a warning, in parent coordinates: rounding of authored matrices.
_MARGIN = 1e-6


def check_matrix(prim: Usd.Prim) -> Iterator[Fault]:
    """Matrices that place nothing, or only part of their patch."""
    attribute = prim.GetAttribute("inputs:matrix")
    for when, value in authored_values(attribute):
        if (problem := _problem(np.array(value, dtype=np.float64))) is not None:
            yield Fault(attribute.GetPath(), f"{problem}{when}; the patch is not shown")


def _problem(matrix: NDArray[np.float64]) -> str | None:
    if not np.isfinite(matrix).all():
        return f"matrix is not finite {matrix.tolist()}, expected nine finite numbers"
    if is_usable(matrix):
        return None
    # Scaled so that the determinant is a measure of how dependent the rows are, whatever the patch's size.
    scaled = matrix / max(float(np.abs(matrix).max()), 1e-300)
    rows = scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), 1e-300)
    if abs(np.linalg.det(rows)) < 1e-15 or _corner_w(matrix) is None:
        return f"matrix is singular, determinant {np.linalg.det(matrix):.3g}, expected an invertible one"
    corners = _corner_w(matrix)
    if corners is not None and corners.min() < 0 < corners.max():
        return "w is negative in a part of the patch, expected one sign at all four corners"
    return f"matrix is singular to working precision, determinant {np.linalg.det(matrix):.3g}"


def _corner_w(matrix: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Homogeneous coordinate of the patch's corners in its parent; None when there is no inverse."""
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return None
    return UNIT_SQUARE @ inverse[:2, 2] + inverse[2, 2]


def check_parent(prim: Usd.Prim) -> Iterator[Fault]:
    """Patches of a zipmap that reach beyond the unit square of their parent."""
    parent = prim.GetParent()
    if not is_a(parent, "ZipmapTexture"):
        return
    attribute = prim.GetAttribute("inputs:matrix")
    for when, value in authored_values(attribute):
        matrix = np.array(value, dtype=np.float64)
        if not is_usable(matrix):
            continue  # `check_matrix` says so
        low, high = _bounds_in_parent(matrix)
        extent = f"s {low[0]:.4g} to {high[0]:.4g}, t {low[1]:.4g} to {high[1]:.4g}{when}"
        if (high <= _MARGIN).any() or (low >= 1 - _MARGIN).any():
            yield Fault(
                attribute.GetPath(), f"patch lies wholly outside its parent {parent.GetPath()}: {extent}", False
            )
        elif (low < -_MARGIN).any() or (high > 1 + _MARGIN).any():
            yield Fault(
                attribute.GetPath(), f"patch lies partly outside its parent {parent.GetPath()}: {extent}", False
            )


def _bounds_in_parent(matrix: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    inverse = np.linalg.inv(matrix)
    corners = UNIT_SQUARE @ inverse[:2] + inverse[2]
    corners = corners[:, :2] / corners[:, 2:]
    return corners.min(axis=0), corners.max(axis=0)


def check_depth(prim: Usd.Prim) -> Iterator[Fault]:
    """The first level of a nest that is deeper than `MAX_DEPTH`."""
    depth = 0
    parent = prim.GetParent()
    while is_a(parent, "ZipmapTexture"):
        depth, parent = depth + 1, parent.GetParent()
    if depth == MAX_DEPTH + 1:
        message = f"nested {depth} levels deep, expected at most {MAX_DEPTH}: double precision places no deeper patch"
        yield Fault(prim.GetPath(), message, is_error=False)
