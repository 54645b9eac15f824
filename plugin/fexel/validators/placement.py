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
from fexel.validators.prim_validator import TEXTURES, PrimValidator

__all__ = ["MAX_DEPTH", "VALIDATORS", "check_depth", "check_matrix", "check_parent"]

MAX_DEPTH = 32
"""Deepest nest without a warning; 4x per level would magnify 2^64 times, past what float64 can place."""

# How far a patch may reach beyond its parent without a warning, in parent coordinates: rounding of authored matrices.
_MARGIN = 1e-6
# Determinant of unit rows below which they are dependent but for rounding.
_SINGULAR = 1e-15


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
    corners = _corners(matrix)
    if abs(np.linalg.det(rows)) < _SINGULAR or corners is None:
        return f"matrix is singular, determinant {np.linalg.det(matrix):.3g}, expected an invertible one"
    if corners[:, 2].min() <= 0 <= corners[:, 2].max():
        return "w is negative in a part of the patch, expected one sign at all four corners"
    return f"matrix is singular to working precision, determinant {np.linalg.det(matrix):.3g}"


def _corners(matrix: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Homogeneous coordinates (4, 3) of the patch's corners in its parent; None when there is no finite inverse."""
    if not np.isfinite(matrix).all():
        return None
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return None
    return UNIT_SQUARE @ inverse[:2] + inverse[2] if np.isfinite(inverse).all() else None


def check_parent(prim: Usd.Prim) -> Iterator[Fault]:
    """Patches of a zipmap that reach beyond the unit square of their parent."""
    parent = prim.GetParent()
    if not is_a(parent, "ZipmapTexture"):
        return
    attribute = prim.GetAttribute("inputs:matrix")
    for when, value in authored_values(attribute):
        bounds = _bounds_in_parent(np.array(value, dtype=np.float64))
        if bounds is None:
            continue  # `check_matrix` says so
        low, high = bounds
        extent = f"s {low[0]:.4g} to {high[0]:.4g}, t {low[1]:.4g} to {high[1]:.4g}{when}"
        if (high <= _MARGIN).any() or (low >= 1 - _MARGIN).any():
            yield Fault(
                attribute.GetPath(), f"patch lies wholly outside its parent {parent.GetPath()}: {extent}", False
            )
        elif (low < -_MARGIN).any() or (high > 1 + _MARGIN).any():
            yield Fault(
                attribute.GetPath(), f"patch lies partly outside its parent {parent.GetPath()}: {extent}", False
            )


def _bounds_in_parent(matrix: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Lowest and highest s and t of the patch's corners in its parent; None when not all are in front of infinity."""
    corners = _corners(matrix)
    if corners is None or corners[:, 2].min() <= 0 <= corners[:, 2].max():
        return None
    st = corners[:, :2] / corners[:, 2:]
    return st.min(axis=0), st.max(axis=0)


def check_depth(prim: Usd.Prim) -> Iterator[Fault]:
    """The first level of a nest that is deeper than `MAX_DEPTH`."""
    depth = 0
    parent = prim.GetParent()
    while is_a(parent, "ZipmapTexture"):
        depth, parent = depth + 1, parent.GetParent()
    if depth == MAX_DEPTH + 1:
        message = f"nested {depth} levels deep, expected at most {MAX_DEPTH}: double precision places no deeper patch"
        yield Fault(prim.GetPath(), message, is_error=False)


VALIDATORS = (
    PrimValidator(
        "fexel:Matrix",
        "inputs:matrix must be finite and invertible, with w of one sign over the patch.",
        TEXTURES,
        check_matrix,
    ),
    PrimValidator(
        "fexel:PatchInsideParent", "A patch should lie inside the unit square of its parent.", TEXTURES, check_parent
    ),
    PrimValidator("fexel:NestingDepth", "Nests should be at most 32 levels deep.", TEXTURES, check_depth),
)
