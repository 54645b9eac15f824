"""Arrays of umbrellas: one entry per modified umbrella, one per vertex, and indices that exist."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pxr import Usd

from fexel.schema.umbrella import UmbrellaLevel, UmbrellaPatch, UmbrellaTexture
from fexel.schema.wrapper import is_a
from fexel.validators.fault import Fault
from fexel.validators.prim_validator import PrimValidator

__all__ = ["VALIDATORS", "check_umbrella_arrays"]

_MIN_VERTICES = 4  # a centre and a triangle around it


def check_umbrella_arrays(prim: Usd.Prim) -> Iterator[Fault]:
    """Lengths and indices of the arrays of an UmbrellaTexture, UmbrellaPatch or UmbrellaLevel."""
    if is_a(prim, "UmbrellaTexture"):
        yield from _check_texture(UmbrellaTexture(prim))
    elif is_a(prim, "UmbrellaPatch"):
        yield from _check_patch(UmbrellaPatch(prim))
    elif is_a(prim, "UmbrellaLevel"):
        yield from _check_level(UmbrellaLevel(prim))


def _array(attribute: Usd.Attribute) -> np.ndarray:
    value = attribute.Get(Usd.TimeCode.EarliestTime()) if attribute else None
    return np.array(value if value is not None else [])


def _check_texture(umbrella: UmbrellaTexture) -> Iterator[Fault]:
    indices = _array(umbrella.GetPatchIndicesAttr())
    patches = umbrella.GetPatches()
    yield from _check_length(umbrella.GetMatricesAttr(), len(indices), "patchIndices")
    yield from _check_length(umbrella.GetMorphsAttr(), len(indices), "patchIndices", may_be_empty=True)
    yield from _check_matrices(umbrella.GetMatricesAttr())
    in_range = yield from _check_indices(umbrella.GetPatchIndicesAttr(), 0, len(patches))
    if in_range:
        vertices = np.array([len(_array(patch.GetPointsAttr())) for patch in patches], dtype=int)
        total = int(vertices[indices].sum()) if len(indices) else 0
        yield from _check_length(umbrella.GetColorsAttr(), total, "vertices of all umbrellas", may_be_empty=True)
    yield from _check_grid(umbrella.GetGridAttr())


def _check_patch(patch: UmbrellaPatch) -> Iterator[Fault]:
    count = len(_array(patch.GetPointsAttr()))
    if count < _MIN_VERTICES:
        message = f"{count} points, expected a centre and at least {_MIN_VERTICES - 1} contour vertices"
        yield Fault(patch.GetPointsAttr().GetPath(), message)
    has_file = bool(patch.GetFileAttr().Get() and patch.GetFileAttr().Get().path)
    yield from _check_length(patch.GetTexCoordsAttr(), count, "points", may_be_empty=not has_file)
    yield from _check_length(patch.GetMorphPointsAttr(), count, "points", may_be_empty=True)
    for attribute in (patch.GetPointsAttr(), patch.GetTexCoordsAttr(), patch.GetMorphPointsAttr()):
        if not np.isfinite(_array(attribute).astype(float)).all():
            yield Fault(attribute.GetPath(), "holds values that are not finite, expected finite coordinates")


def _check_level(level: UmbrellaLevel) -> Iterator[Fault]:
    count = len(_array(level.GetPatchIndicesAttr()))
    counts = _array(level.GetVertexCountsAttr())
    yield from _check_length(level.GetVertexCountsAttr(), count, "patchIndices")
    yield from _check_length(level.GetMatricesAttr(), count, "patchIndices", may_be_empty=True)
    yield from _check_length(level.GetCoveragesAttr(), count, "patchIndices", may_be_empty=True)
    total = int(counts.sum())
    yield from _check_length(level.GetPointsAttr(), total, "the sum of vertexCounts")
    yield from _check_length(level.GetColorsAttr(), total, "the sum of vertexCounts", may_be_empty=True)
    yield from _check_matrices(level.GetMatricesAttr())
    parent = UmbrellaTexture(level.GetPrim().GetParent())
    yield from _check_indices(level.GetPatchIndicesAttr(), -1, len(parent.GetPatches()) if parent else 0)
    yield from _check_grid(level.GetGridAttr())


def _check_length(attribute: Usd.Attribute, expected: int, of: str, may_be_empty: bool = False) -> Iterator[Fault]:
    found = len(_array(attribute))
    if found != expected and not (may_be_empty and found == 0):
        yield Fault(attribute.GetPath(), f"{found} entries, expected {expected}, as many as {of}")


def _check_indices(attribute: Usd.Attribute, low: int, count: int) -> Iterator[Fault]:
    """Yields at most one fault; returns whether all indices exist."""
    indices = _array(attribute)
    wrong = np.flatnonzero((indices < low) | (indices >= count)) if len(indices) else []
    if len(wrong):
        first = int(wrong[0])
        message = (
            f"entry {first} is {indices[first]}, expected {low} to {count - 1}: there are {count} UmbrellaPatch prims"
        )
        yield Fault(attribute.GetPath(), message)
    return not len(wrong)


def _check_matrices(attribute: Usd.Attribute) -> Iterator[Fault]:
    matrices = _array(attribute).astype(float).reshape(-1, 3, 3)
    finite = np.isfinite(matrices).all(axis=(1, 2))
    determinants = np.where(finite, np.linalg.det(np.where(finite[:, None, None], matrices, np.eye(3))), 0.0)
    for entry in np.flatnonzero(determinants == 0)[:1]:
        what = "singular" if finite[entry] else "not finite"
        yield Fault(attribute.GetPath(), f"entry {entry} is {what}, expected an invertible matrix")


def _check_grid(attribute: Usd.Attribute) -> Iterator[Fault]:
    grid = attribute.Get()
    if grid is not None and min(grid) < 1:
        yield Fault(attribute.GetPath(), f"grid of {grid[0]} x {grid[1]} cells, expected at least 1 x 1")


VALIDATORS = (
    PrimValidator(
        "fexel:UmbrellaArrays",
        "Arrays of umbrellas must have matching lengths and existing indices.",
        ("FexelUmbrellaTexture", "FexelUmbrellaPatch", "FexelUmbrellaLevel"),
        check_umbrella_arrays,
    ),
)
