"""Primvars of a mesh, checked against its topology and brought to one form: a value per corner, through an index.

A corner is an entry of ``faceVertexIndices``. Every interpolation becomes ``values[corner_rows]``: constant primvars
have one row for all corners, uniform ones a row per face, vertex and varying ones a row per point, faceVarying ones a
row per corner; a primvar's own indices are folded in. A primvar whose length does not fit the mesh is dropped with a
warning that names both lengths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from fexel.scene.sampling import Faults, Sampler

__all__ = ["CornerValues", "Topology", "read_normals", "read_primvar", "st_primvar_names"]

_TEXTURE_COORDINATE_TYPES = frozenset(
    str(name.type.typeName)
    for name in (
        Sdf.ValueTypeNames.Float2Array,
        Sdf.ValueTypeNames.Double2Array,
        Sdf.ValueTypeNames.Half2Array,
        Sdf.ValueTypeNames.Float2,
        Sdf.ValueTypeNames.Double2,
        Sdf.ValueTypeNames.Half2,
    )
)


@dataclass(frozen=True, eq=False)
class Topology:
    """Faces of a mesh.

    Attributes
    ----------
    counts : (F,) int64
        Corners per face.
    indices : (C,) int64
        Point of each corner.
    point_count : int
    """

    counts: np.ndarray
    indices: np.ndarray
    point_count: int

    def face_of_corner(self) -> np.ndarray:
        """(C,) int64, face of each corner."""
        return np.repeat(np.arange(len(self.counts)), self.counts)


@dataclass(frozen=True, eq=False)
class CornerValues:
    """``values[corner_rows]`` is one row per corner.

    Attributes
    ----------
    values : (R, k) array
    corner_rows : (C,) int64
    interpolation : str
        USD's token.
    """

    values: np.ndarray
    corner_rows: np.ndarray
    interpolation: str

    @property
    def by_point(self) -> bool:
        """Whether corners at the same point always have the same value."""
        return self.interpolation not in (UsdGeom.Tokens.faceVarying, UsdGeom.Tokens.uniform)

    def at(self, corners: np.ndarray) -> np.ndarray:
        """Values of some corners."""
        return self.values[self.corner_rows[corners]]


def st_primvar_names(prim: Usd.Prim) -> list[str]:
    """Names of the primvars of a prim that can serve as texture coordinates (two components, with a value)."""
    primvars = UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithAuthoredValues()
    return [p.GetPrimvarName() for p in primvars if str(p.GetTypeName().type.typeName) in _TEXTURE_COORDINATE_TYPES]


def read_primvar(
    prim: Usd.Prim, name: str, width: int, topology: Topology, sampler: Sampler, faults: Faults
) -> CornerValues | None:
    """Primvar `name` with `width` components (float64); None where it is absent or was dropped with a warning."""
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar(name)
    if not primvar or not primvar.HasValue():
        return None
    values = sampler.array(primvar.GetAttr(), np.float64, width)
    values = values[:, None] if values is not None and width == 1 else values
    indices = sampler.array(primvar.GetIndicesAttr(), np.int64) if primvar.IsIndexed() else None
    return _resolve(primvar.GetAttr(), values, indices, primvar.GetInterpolation(), topology, faults)


def read_normals(prim: Usd.Prim, topology: Topology, sampler: Sampler, faults: Faults) -> CornerValues | None:
    """Authored normals: ``primvars:normals``, else the ``normals`` attribute; None where there are none to use."""
    if (resolved := read_primvar(prim, "normals", 3, topology, sampler, faults)) is not None:
        return resolved
    mesh = UsdGeom.Mesh(prim)
    values = sampler.array(mesh.GetNormalsAttr(), np.float64, 3)
    if values is None or not len(values):
        return None
    return _resolve(mesh.GetNormalsAttr(), values, None, mesh.GetNormalsInterpolation(), topology, faults)


def _resolve(
    attribute: Usd.Attribute,
    values: np.ndarray | None,
    indices: np.ndarray | None,
    interpolation: str,
    topology: Topology,
    faults: Faults,
) -> CornerValues | None:
    """Check lengths, fold the primvar's indices in; None with a warning where they do not fit."""
    path = attribute.GetPath()
    rows = _corner_elements(interpolation, topology)
    if values is None or rows is None:
        faults.warn(
            path, f"{attribute.GetTypeName()} with interpolation {interpolation!r} cannot be used; primvar dropped"
        )
        return None
    element_count = _element_count(interpolation, topology)
    found = len(values) if indices is None else len(indices)
    if found < element_count or (found > element_count and interpolation != UsdGeom.Tokens.constant):
        what = "values" if indices is None else "indices"
        faults.warn(
            path, f"{found} {what}, expected {element_count} for {interpolation} interpolation; primvar dropped"
        )
        return None
    if indices is not None:
        if len(indices) and (indices.min() < 0 or indices.max() >= len(values)):
            bad = int(indices.max() if indices.max() >= len(values) else indices.min())
            faults.warn(path, f"index {bad}, expected 0 to {len(values) - 1}; primvar dropped")
            return None
        rows = indices[rows]
    if not np.isfinite(values).all():
        faults.warn(path, "values that are NaN or infinite, expected finite ones; they count as 0")
        values = np.where(np.isfinite(values), values, 0.0)
    return CornerValues(values, rows, interpolation)


def _element_count(interpolation: str, topology: Topology) -> int:
    """How many elements a primvar of this interpolation has."""
    return {
        UsdGeom.Tokens.constant: 1,
        UsdGeom.Tokens.uniform: len(topology.counts),
        UsdGeom.Tokens.faceVarying: len(topology.indices),
    }.get(interpolation, topology.point_count)


def _corner_elements(interpolation: str, topology: Topology) -> np.ndarray | None:
    """Element of each corner; None for an interpolation that USD does not know."""
    if interpolation == UsdGeom.Tokens.constant:
        return np.zeros(len(topology.indices), np.int64)
    if interpolation == UsdGeom.Tokens.uniform:
        return topology.face_of_corner()
    if interpolation in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying):
        return topology.indices
    if interpolation == UsdGeom.Tokens.faceVarying:
        return np.arange(len(topology.indices))
    return None
