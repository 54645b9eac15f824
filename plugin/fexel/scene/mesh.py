"""UsdGeomMesh to triangles: topology, primvars, normals, one vertex array, material subsets as ranges of triangles.

Vertices are made by sharing: all corners at a point that agree in every primvar are one vertex, a corner that differs
(a seam in `st`, a hard edge) gets a vertex of its own. Points are widened to float64 before anything is done to them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from pxr import Usd, UsdGeom, UsdShade

from fexel.scene.model import Mesh
from fexel.scene.normals import corner_normals, triangle_vectors, unit_normals
from fexel.scene.primvars import CornerValues, Topology, read_normals, read_primvar, st_primvar_names
from fexel.scene.sampling import Faults, Sampler
from fexel.scene.subdivision import refine
from fexel.scene.triangulation import triangulate

__all__ = ["MeshParts", "Polygons", "extract_mesh", "polygons_to_mesh"]


@dataclass(frozen=True, eq=False)
class MeshParts:
    """A mesh and the ranges of its triangles that have a material binding of their own.

    Attributes
    ----------
    mesh : Mesh
    ranges : tuple of (str, int, int)
        Name of the GeomSubset ('' for faces in none), first triangle, triangle count (at least 1).
    """

    mesh: Mesh
    ranges: tuple[tuple[str, int, int], ...]


@dataclass(frozen=True, eq=False)
class Polygons:
    """A polygon mesh whose parts have been checked against each other.

    Attributes
    ----------
    points : (P, 3) float64
    topology : Topology
    channels : dict of str to CornerValues
        ``normals`` (3), ``displayColor`` (3), ``displayOpacity`` (1), and ``st:NAME`` (2) per texture coordinate set.
    holes : (H,) int64
        Faces that are not drawn.
    subset_of_face : (F,) int64
        Index into `subset_names`, -1 for none.
    subset_names : tuple of str
    left_handed, smooth : bool
        Orientation; whether normals that are not authored are smooth.
    """

    points: np.ndarray
    topology: Topology
    channels: dict[str, CornerValues]
    holes: np.ndarray
    subset_of_face: np.ndarray
    subset_names: tuple[str, ...] = ()
    left_handed: bool = False
    smooth: bool = True


def extract_mesh(prim: Usd.Prim, sampler: Sampler, faults: Faults, refine_level: int = 0) -> MeshParts | None:
    """Extract a UsdGeomMesh prim.

    Parameters
    ----------
    prim : Usd.Prim
        A Mesh; a prim in a prototype, not an instance proxy, so that instances share the result.
    refine_level : int
        Uniform subdivisions of a catmullClark or loop mesh; 0 draws the cage with smooth normals.

    Returns
    -------
    MeshParts or None
        None where nothing can be drawn: an empty mesh, or one so damaged that a warning was given.
    """
    polygons = _read_polygons(prim, sampler, faults)
    if polygons is None:
        return None
    scheme = sampler.get(UsdGeom.Mesh(prim).GetSubdivisionSchemeAttr(), UsdGeom.Tokens.catmullClark)
    if refine_level > 0 and scheme in (UsdGeom.Tokens.catmullClark, UsdGeom.Tokens.loop):
        polygons = refine(prim, polygons, scheme, refine_level, sampler, faults)
    return polygons_to_mesh(str(prim.GetPath()), polygons)


def _read_polygons(prim: Usd.Prim, sampler: Sampler, faults: Faults) -> Polygons | None:
    """Read a mesh prim's arrays; None where it is empty or too damaged to draw."""
    mesh, path = UsdGeom.Mesh(prim), prim.GetPath()
    points = sampler.array(mesh.GetPointsAttr(), np.float64, 3)
    counts = sampler.array(mesh.GetFaceVertexCountsAttr(), np.int64)
    indices = sampler.array(mesh.GetFaceVertexIndicesAttr(), np.int64)
    if points is None or counts is None or indices is None or not len(points) or not len(counts):
        return None
    if fault := _topology_fault(points, counts, indices):
        faults.warn(path, f"{fault}; mesh skipped")
        return None
    topology = Topology(counts, indices, len(points))
    holes = _face_indices(mesh.GetHoleIndicesAttr(), len(counts), sampler, faults)
    names, subset_of_face = _read_subsets(prim, len(counts), sampler, faults)
    scheme = sampler.get(mesh.GetSubdivisionSchemeAttr(), UsdGeom.Tokens.catmullClark)
    return Polygons(
        points=points,
        topology=topology,
        channels=_read_channels(prim, topology, sampler, faults),
        holes=holes,
        subset_of_face=subset_of_face,
        subset_names=names,
        left_handed=sampler.get(mesh.GetOrientationAttr()) == UsdGeom.Tokens.leftHanded,
        smooth=scheme in (UsdGeom.Tokens.catmullClark, UsdGeom.Tokens.loop),
    )


def _topology_fault(points: np.ndarray, counts: np.ndarray, indices: np.ndarray) -> str:
    """What is wrong with a mesh's arrays, or ''."""
    if counts.min() < 0:
        return f"faceVertexCounts holds {counts.min()}, expected counts of at least 3"
    if counts.sum() != len(indices):
        return f"faceVertexIndices has {len(indices)} entries, expected {counts.sum()}, the sum of faceVertexCounts"
    if len(indices) and (indices.min() < 0 or indices.max() >= len(points)):
        bad = indices.max() if indices.max() >= len(points) else indices.min()
        return f"faceVertexIndices holds {bad}, expected 0 to {len(points) - 1} for {len(points)} points"
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        return f"point {bad} of {len(points)} is NaN or infinite"
    return ""


def _read_channels(prim: Usd.Prim, topology: Topology, sampler: Sampler, faults: Faults) -> dict[str, CornerValues]:
    """All primvars that a picture can need."""
    channels = {
        "normals": read_normals(prim, topology, sampler, faults),
        "displayColor": read_primvar(prim, "displayColor", 3, topology, sampler, faults),
        "displayOpacity": read_primvar(prim, "displayOpacity", 1, topology, sampler, faults),
    }
    for name in st_primvar_names(prim):
        channels[f"st:{name}"] = read_primvar(prim, name, 2, topology, sampler, faults)
    return {name: values for name, values in channels.items() if values is not None}


def _face_indices(attribute: Usd.Attribute, face_count: int, sampler: Sampler, faults: Faults) -> np.ndarray:
    """Face indices of holes or a subset, those out of range left out with a warning."""
    faces = sampler.array(attribute, np.int64)
    if faces is None:
        return np.zeros(0, np.int64)
    valid = (faces >= 0) & (faces < face_count)
    if not valid.all():
        bad = int(faces[~valid][0])
        faults.warn(attribute.GetPath(), f"face {bad}, expected 0 to {face_count - 1}; entries out of range left out")
    return faces[valid]


def _read_subsets(
    prim: Usd.Prim, face_count: int, sampler: Sampler, faults: Faults
) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the ``materialBind`` face subsets, and each face's subset (-1: none); of overlapping ones the first."""
    names: list[str] = []
    subset_of_face = np.full(face_count, -1, np.int64)
    for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
        element_type = sampler.get(subset.GetElementTypeAttr(), UsdGeom.Tokens.face)
        if element_type != UsdGeom.Tokens.face:
            faults.warn(subset.GetPath(), f"elementType {element_type!r}, expected 'face'; subset left out")
            continue
        faces = _face_indices(subset.GetIndicesAttr(), face_count, sampler, faults)
        if (subset_of_face[faces] >= 0).any():
            faults.warn(
                subset.GetPath(), "faces that an earlier materialBind subset holds too; they keep the earlier one"
            )
        subset_of_face[faces[subset_of_face[faces] < 0]] = len(names)
        names.append(subset.GetPrim().GetName())
    return tuple(names), subset_of_face


def polygons_to_mesh(path: str, polygons: Polygons) -> MeshParts | None:
    """Triangulate polygons, make normals and vertices; None where no triangle is left."""
    topology = polygons.topology
    corners, faces = triangulate(polygons.points, topology.counts, topology.indices)
    vectors = triangle_vectors(polygons.points, topology.indices[corners])
    channels = dict(polygons.channels)
    if "normals" not in channels:
        channels["normals"] = corner_normals(vectors, faces, topology, polygons.smooth, polygons.left_handed)
    drawn = vectors.any(axis=1)  # not those without extent
    if len(polygons.holes):
        drawn &= ~np.isin(faces, polygons.holes)
    if not drawn.any():
        return None
    if not drawn.all():
        corners, faces = corners[drawn], faces[drawn]
    order = np.argsort(polygons.subset_of_face[faces], kind="stable") if polygons.subset_names else slice(None)
    corners, faces = corners[order], faces[order]
    vertex_corners, triangles = _share_vertices(topology, channels, corners)
    if polygons.left_handed:
        triangles = triangles[:, ::-1]
    mesh = _assemble(path, polygons, channels, vertex_corners, triangles)
    return MeshParts(mesh, _ranges(polygons, faces))


def _ranges(polygons: Polygons, faces: np.ndarray) -> tuple[tuple[str, int, int], ...]:
    """Ranges of the triangles, sorted by subset, of `faces`."""
    subsets = polygons.subset_of_face[faces]
    values, first, count = np.unique(subsets, return_index=True, return_counts=True)
    names = ("", *polygons.subset_names)  # -1, faces in no subset, comes first
    return tuple((names[v + 1], int(f), int(n)) for v, f, n in zip(values, first, count, strict=True))


def _share_vertices(
    topology: Topology, channels: dict[str, CornerValues], corners: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """One corner per vertex (V,), and the triangles as vertices (T, 3) int32.

    Each point's vertex stands for the corner seen last there; corners that differ from it in any channel get their own.
    """
    used = np.zeros(len(topology.indices), bool)
    used[corners] = True
    used_corners = np.flatnonzero(used)
    used_points = topology.indices[used_corners]
    representative = np.full(topology.point_count, -1, np.int64)
    representative[used_points] = used_corners
    own = np.zeros(len(used_corners), bool)
    for values in channels.values():
        if not values.by_point:
            other = representative[used_points]
            own |= (values.at(used_corners) != values.at(other)).any(axis=1)
    shared = np.flatnonzero(representative >= 0)
    vertex_of_point = np.empty(topology.point_count, np.int32)
    vertex_of_point[shared] = np.arange(len(shared), dtype=np.int32)
    vertex_of_corner = np.empty(len(topology.indices), np.int32)
    vertex_of_corner[used_corners] = vertex_of_point[used_points]
    split = used_corners[own]
    vertex_of_corner[split] = np.arange(len(shared), len(shared) + len(split), dtype=np.int32)
    return np.concatenate([representative[shared], split]), vertex_of_corner[corners]


def _assemble(
    path: str, polygons: Polygons, channels: dict[str, CornerValues], vertex_corners: np.ndarray, triangles: np.ndarray
) -> Mesh:
    """Gather every channel at the vertices."""
    points = polygons.points[polygons.topology.indices[vertex_corners]]
    mesh = Mesh(
        path=path,
        points=np.ascontiguousarray(points),
        normals=unit_normals(channels["normals"].at(vertex_corners), points, triangles),
        triangles=np.ascontiguousarray(triangles, np.int32),
        st={name[3:]: values.at(vertex_corners) for name, values in channels.items() if name.startswith("st:")},
    )
    if color := channels.get("displayColor"):
        mesh = replace(mesh, display_color=color.at(vertex_corners).astype(np.float32))
    if opacity := channels.get("displayOpacity"):
        mesh = replace(mesh, display_opacity=opacity.at(vertex_corners)[:, 0].astype(np.float32))
    return mesh
