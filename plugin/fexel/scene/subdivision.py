"""Uniform refinement of subdivision surfaces: Catmull-Clark and Loop, with creases, corners and boundaries.

Rules: Catmull and Clark 1978; Loop 1987; semi-sharp creases as DeRose, Kass and Truong 1998, section 3, whose fractions
are blended by the mean sharpness at a vertex. Every level turns a polygon with n corners into n quadrilaterals
(Catmull-Clark) or a triangle into four (Loop). Points stay where the level puts them; they are not moved to the limit.
Vertex primvars follow the points, varying ones are averaged, faceVarying ones are refined over their own
connectivity, smooth within and along its rims, unless ``faceVaryingLinearInterpolation`` says ``all``; uniform
primvars, holes and subsets pass to the children. Authored normals belong to the cage and are dropped.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from pxr import Usd, UsdGeom

from fexel.scene.primvars import CornerValues, Topology
from fexel.scene.sampling import Faults, Sampler

if TYPE_CHECKING:
    from fexel.scene.mesh import Polygons

__all__ = ["refine"]

_BY_POINT = (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying)


@dataclass(frozen=True, eq=False)
class _Creases:
    """Sharpness of edges (pairs of points) and of points, in levels; infinite: sharp for ever."""

    edges: np.ndarray
    edge_sharpness: np.ndarray
    corners: np.ndarray
    corner_sharpness: np.ndarray
    sharp_boundary_corners: bool = True


@dataclass(frozen=True, eq=False)
class _Edges:
    """Edges of a mesh.

    Attributes
    ----------
    of_corner : (C,) int64
        Edge from each corner to the next of its face.
    ends : (E, 2) int64
        Points, the lower first.
    face_count : (E,) int64
    """

    of_corner: np.ndarray
    ends: np.ndarray
    face_count: np.ndarray


def refine(prim: Usd.Prim, polygons: Polygons, scheme: str, level: int, sampler: Sampler, faults: Faults) -> Polygons:
    """Refine a mesh `level` times; a loop mesh that has other faces than triangles stays as it is, with a warning.

    Parameters
    ----------
    scheme : str
        ``catmullClark`` or ``loop``.
    """
    counts = polygons.topology.counts
    if (counts < 3).any() or (scheme == UsdGeom.Tokens.loop and (counts != 3).any()):
        smallest = "triangles alone" if scheme == UsdGeom.Tokens.loop else "faces of at least 3 corners"
        faults.warn(prim.GetPath(), f"a {scheme} mesh needs {smallest}; it is drawn without refinement")
        return polygons
    mesh = UsdGeom.Mesh(prim)
    creases = _read_creases(mesh, polygons.topology.point_count, sampler, faults)
    linear = sampler.get(mesh.GetFaceVaryingLinearInterpolationAttr()) == UsdGeom.Tokens.all
    if sampler.get(mesh.GetInterpolateBoundaryAttr()) == UsdGeom.Tokens.none:
        polygons = _without_boundary_faces(polygons)
    channels = {name: values for name, values in polygons.channels.items() if name != "normals"}
    polygons = replace(polygons, channels=channels, smooth=True)
    for _ in range(level):
        polygons, creases = _refine_once(polygons, creases, scheme, linear)
    return polygons


def _refine_once(polygons: Polygons, creases: _Creases, scheme: str, linear: bool) -> tuple[Polygons, _Creases]:
    """One level: points and all that goes with them."""
    topology = polygons.topology
    edges = _find_edges(topology)
    child = _child_topology(topology, edges, scheme)
    points = _refine_values(polygons.points, topology, edges, creases, scheme)
    children = 4 if scheme == UsdGeom.Tokens.loop else topology.counts
    parent = np.repeat(np.arange(len(topology.counts)), children)
    channels = {
        name: _refine_channel(values, topology, edges, creases, child, parent, scheme, linear)
        for name, values in polygons.channels.items()
    }
    holes = np.flatnonzero(np.isin(parent, polygons.holes))
    refined = replace(
        polygons,
        points=points,
        topology=child,
        channels=channels,
        holes=holes,
        subset_of_face=polygons.subset_of_face[parent],
    )
    return refined, _child_creases(creases, topology, edges)


def _find_edges(topology: Topology) -> _Edges:
    a, b = topology.indices, topology.indices[_following(topology.counts)]
    low, high = np.minimum(a, b), np.maximum(a, b)
    keys, of_corner = np.unique(low * topology.point_count + high, return_inverse=True)
    ends = np.stack([keys // topology.point_count, keys % topology.point_count], axis=1)
    return _Edges(of_corner, ends, np.bincount(of_corner, minlength=len(keys)))


def _following(counts: np.ndarray) -> np.ndarray:
    """(C,) the next corner around the face of each corner."""
    first = np.cumsum(counts) - counts
    following = np.arange(1, counts.sum() + 1)
    following[first + counts - 1] = first
    return following


def _child_topology(topology: Topology, edges: _Edges, scheme: str) -> Topology:
    """Children of all faces; points are numbered vertex points, then edge points, then face points."""
    corner_points, edge_points = topology.indices, topology.point_count + edges.of_corner
    preceding = np.empty_like(edge_points)
    preceding[_following(topology.counts)] = edge_points
    if scheme == UsdGeom.Tokens.loop:
        outer = np.stack([corner_points, edge_points, preceding], axis=1).reshape(-1, 9)
        indices = np.concatenate([outer, edge_points.reshape(-1, 3)], axis=1).ravel()
        return Topology(np.full(4 * len(topology.counts), 3), indices, topology.point_count + len(edges.ends))
    face_points = topology.point_count + len(edges.ends) + topology.face_of_corner()
    indices = np.stack([corner_points, edge_points, face_points, preceding], axis=1).ravel()
    total = topology.point_count + len(edges.ends) + len(topology.counts)
    return Topology(np.full(len(corner_points), 4), indices, total)


def _sum_by(rows: np.ndarray, values: np.ndarray, size: int) -> np.ndarray:
    """Sum of the values with the same row: (size, k)."""
    return np.stack([np.bincount(rows, values[:, k], size) for k in range(values.shape[1])], axis=1)


def _refine_values(values: np.ndarray, topology: Topology, edges: _Edges, creases: _Creases, scheme: str) -> np.ndarray:
    """Values (P, k) at the child points."""
    sharpness = _edge_sharpness(creases, topology, edges)
    blend = np.minimum(sharpness, 1.0)[:, None]
    middles = values[edges.ends].mean(axis=1)
    if scheme == UsdGeom.Tokens.loop:
        opposite = _sum_by(
            edges.of_corner, values[np.roll(topology.indices.reshape(-1, 3), -2, axis=1).ravel()], len(blend)
        )
        smooth_edges = 0.75 * middles + 0.125 * opposite
        smooth, rest = _loop_vertices(values, edges), []
    else:
        faces = _sum_by(topology.face_of_corner(), values[topology.indices], len(topology.counts))
        faces /= topology.counts[:, None]
        around = _sum_by(edges.of_corner, np.repeat(faces, topology.counts, axis=0), len(blend))
        smooth_edges = (2 * middles + around) / 4
        smooth, rest = _catmull_clark_vertices(values, topology, edges, middles, faces), [faces]
    vertices = _sharpen_vertices(values, smooth, topology, edges, sharpness, creases)
    return np.concatenate([vertices, (1 - blend) * smooth_edges + blend * middles, *rest])


def _catmull_clark_vertices(
    values: np.ndarray, topology: Topology, edges: _Edges, middles: np.ndarray, faces: np.ndarray
) -> np.ndarray:
    """(Q + 2 R + (n - 3) S) / n: mean of the face points, mean of the edge middles, the vertex."""
    size = len(values)
    n = np.bincount(edges.ends.ravel(), minlength=size)[:, None]
    face_count = np.bincount(topology.indices, minlength=size)[:, None]
    q = _sum_by(topology.indices, np.repeat(faces, topology.counts, axis=0), size) / np.maximum(face_count, 1)
    r = _sum_by(edges.ends.ravel(), np.repeat(middles, 2, axis=0), size) / np.maximum(n, 1)
    return np.where(n > 0, (q + 2 * r + (n - 3) * values) / np.maximum(n, 1), values)


def _loop_vertices(values: np.ndarray, edges: _Edges) -> np.ndarray:
    """(1 - n b) S + b times the neighbours, b as Loop chose it."""
    size = len(values)
    n = np.bincount(edges.ends.ravel(), minlength=size)[:, None]
    neighbours = _sum_by(edges.ends.ravel(), values[edges.ends[:, ::-1]].reshape(-1, values.shape[1]), size)
    valence = np.maximum(n, 1)
    b = (5 / 8 - (3 / 8 + np.cos(2 * np.pi / valence) / 4) ** 2) / valence
    return np.where(n > 0, (1 - n * b) * values + b * neighbours, values)


def _edge_sharpness(creases: _Creases, topology: Topology, edges: _Edges) -> np.ndarray:
    """(E,) sharpness; rims and edges of more than two faces are infinitely sharp."""
    sharpness = np.where(edges.face_count == 2, 0.0, np.inf)
    if len(creases.edges):
        keys = edges.ends[:, 0] * topology.point_count + edges.ends[:, 1]
        wanted = np.sort(creases.edges, axis=1) @ np.array([topology.point_count, 1])
        at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        found = keys[at] == wanted
        np.maximum.at(sharpness, at[found], creases.edge_sharpness[found])
    return sharpness


def _sharpen_vertices(
    values: np.ndarray, smooth: np.ndarray, topology: Topology, edges: _Edges, sharpness: np.ndarray, creases: _Creases
) -> np.ndarray:
    """Blend in the crease rule where two sharp edges meet, and hold the vertex where more do or a corner is sharp."""
    size = len(values)
    sharp = np.flatnonzero(sharpness > 0)
    ends = edges.ends[sharp]
    count = np.bincount(ends.ravel(), minlength=size)
    across = _sum_by(ends.ravel(), values[ends[:, ::-1]].reshape(-1, values.shape[1]), size)
    crease = np.where((count == 2)[:, None], 0.75 * values + 0.125 * across, values)
    limited = np.repeat(np.minimum(sharpness[sharp], 1.0), 2)
    blend = np.where(count >= 2, np.bincount(ends.ravel(), limited, size) / np.maximum(count, 1), 0.0)[:, None]
    result = (1 - blend) * smooth + blend * crease
    corner = np.zeros(size)
    np.maximum.at(corner, creases.corners, np.minimum(creases.corner_sharpness, 1.0))
    if creases.sharp_boundary_corners:
        on_rim = np.bincount(edges.ends[edges.face_count == 1].ravel(), minlength=size) > 0
        corner[on_rim & (np.bincount(topology.indices, minlength=size) == 1)] = 1.0
    return (1 - corner[:, None]) * result + corner[:, None] * values


def _refine_channel(
    channel: CornerValues,
    topology: Topology,
    edges: _Edges,
    creases: _Creases,
    child: Topology,
    parent: np.ndarray,
    scheme: str,
    linear: bool,
) -> CornerValues:
    """A primvar at the corners of the children."""
    if channel.interpolation == UsdGeom.Tokens.constant:
        return CornerValues(channel.values, np.zeros(len(child.indices), np.int64), channel.interpolation)
    if channel.interpolation == UsdGeom.Tokens.uniform:
        faces = np.zeros(len(topology.counts), np.int64)
        faces[topology.face_of_corner()] = channel.corner_rows
        return CornerValues(channel.values, np.repeat(faces[parent], child.counts), channel.interpolation)
    if channel.interpolation in _BY_POINT:
        at_points = np.zeros((topology.point_count, channel.values.shape[1]))
        at_points[topology.indices] = channel.values[channel.corner_rows]
        is_linear = channel.interpolation == UsdGeom.Tokens.varying
        values = _refined(at_points, topology, edges, creases, scheme, is_linear)
        return CornerValues(values, child.indices, channel.interpolation)
    own = Topology(topology.counts, channel.corner_rows, len(channel.values))
    own_edges = _find_edges(own)
    no_creases = _Creases(np.zeros((0, 2), np.int64), np.zeros(0), np.zeros(0, np.int64), np.zeros(0))
    values = _refined(channel.values, own, own_edges, no_creases, scheme, linear)
    return CornerValues(values, _child_topology(own, own_edges, scheme).indices, channel.interpolation)


def _refined(
    values: np.ndarray, topology: Topology, edges: _Edges, creases: _Creases, scheme: str, linear: bool
) -> np.ndarray:
    """Smooth or averaged values at the child points."""
    if not linear:
        return _refine_values(values, topology, edges, creases, scheme)
    parts = [values, values[edges.ends].mean(axis=1)]
    if scheme != UsdGeom.Tokens.loop:
        sums = _sum_by(topology.face_of_corner(), values[topology.indices], len(topology.counts))
        parts.append(sums / topology.counts[:, None])
    return np.concatenate(parts)


def _child_creases(creases: _Creases, topology: Topology, edges: _Edges) -> _Creases:
    """Both halves of a crease, one level less sharp."""
    keys = edges.ends[:, 0] * topology.point_count + edges.ends[:, 1]
    wanted = np.sort(creases.edges, axis=1) @ np.array([topology.point_count, 1])
    at = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
    keep = (keys[at] == wanted) & (creases.edge_sharpness > 1) if len(wanted) else np.zeros(0, bool)
    middle = topology.point_count + at[keep]
    halves = [np.stack([creases.edges[keep, k], middle], axis=1) for k in (0, 1)]
    corner = creases.corner_sharpness > 1
    return replace(
        creases,
        edges=np.concatenate(halves),
        edge_sharpness=np.tile(creases.edge_sharpness[keep] - 1, 2),
        corners=creases.corners[corner],
        corner_sharpness=creases.corner_sharpness[corner] - 1,
    )


def _read_creases(mesh: UsdGeom.Mesh, point_count: int, sampler: Sampler, faults: Faults) -> _Creases:
    """Creases and corners of a mesh; those that do not fit are left out with a warning."""
    indices = _ints(mesh.GetCreaseIndicesAttr(), sampler)
    lengths = _ints(mesh.GetCreaseLengthsAttr(), sampler)
    sharpness = _floats(mesh.GetCreaseSharpnessesAttr(), sampler)
    corners = _ints(mesh.GetCornerIndicesAttr(), sampler)
    corner_sharpness = _floats(mesh.GetCornerSharpnessesAttr(), sampler)
    edges = np.zeros((0, 2), np.int64)
    if len(lengths):
        fits = lengths.min() >= 2 and lengths.sum() == len(indices) and _within(indices, point_count)
        if fits and len(sharpness) in (len(lengths), int((lengths - 1).sum())):
            last = np.cumsum(lengths) - 1
            starts = np.setdiff1d(np.arange(len(indices)), last)
            edges = np.stack([indices[starts], indices[starts + 1]], axis=1)
            sharpness = np.repeat(sharpness, lengths - 1) if len(sharpness) == len(lengths) else sharpness
        else:
            found = f"{len(indices)} creaseIndices, {len(sharpness)} creaseSharpnesses"
            faults.warn(mesh.GetPath(), f"{found}, expected {lengths.sum()} and {len(lengths)}; creases left out")
    if len(corners) != len(corner_sharpness) or not _within(corners, point_count):
        found = f"{len(corners)} cornerIndices, {len(corner_sharpness)} cornerSharpnesses"
        faults.warn(mesh.GetPath(), f"{found}, expected as many, each a point; corners left out")
        corners, corner_sharpness = np.zeros(0, np.int64), np.zeros(0)
    only_edges = sampler.get(mesh.GetInterpolateBoundaryAttr()) == UsdGeom.Tokens.edgeOnly
    return _Creases(edges, sharpness[: len(edges)], corners, corner_sharpness, not only_edges)


def _ints(attribute: Usd.Attribute, sampler: Sampler) -> np.ndarray:
    values = sampler.array(attribute, np.int64)
    return np.zeros(0, np.int64) if values is None else values


def _floats(attribute: Usd.Attribute, sampler: Sampler) -> np.ndarray:
    """Sharpnesses: finite or not, at least 0; USD's constant for infinity is 10."""
    values = sampler.array(attribute, np.float64)
    values = np.zeros(0) if values is None else np.nan_to_num(values, nan=0.0, posinf=10.0)
    return np.where(values >= UsdGeom.Mesh.SHARPNESS_INFINITE, np.inf, np.maximum(values, 0.0))


def _within(indices: np.ndarray, point_count: int) -> bool:
    return not len(indices) or bool(indices.min() >= 0 and indices.max() < point_count)


def _without_boundary_faces(polygons: Polygons) -> Polygons:
    """Faces at a rim are not part of the surface when ``interpolateBoundary`` is none; they become holes."""
    edges = _find_edges(polygons.topology)
    at_rim = edges.face_count[edges.of_corner] == 1
    faces = np.unique(polygons.topology.face_of_corner()[at_rim])
    return replace(polygons, holes=np.union1d(polygons.holes, faces))
