"""Normals that a mesh does not author: smooth over its points, or one per face.

Smooth normals weight each face by its area (the vector area of Newell), as subdivision cages are shown by usdrecord;
faceted ones are for ``subdivisionScheme`` ``none`` and ``bilinear``.
"""

from __future__ import annotations

import numpy as np

from fexel.scene.primvars import CornerValues, Topology

__all__ = ["corner_normals", "face_vectors", "unit_normals"]


def corner_normals(points: np.ndarray, topology: Topology, smooth: bool, left_handed: bool) -> CornerValues:
    """Geometric normals at the corners of polygons, not yet of unit length."""
    vectors = face_vectors(points, topology)
    if left_handed:
        vectors = -vectors
    faces = topology.face_of_corner()
    if not smooth:
        return CornerValues(vectors, faces, by_point=False)
    summed = [
        np.bincount(topology.indices, weights=vectors[faces, axis], minlength=topology.point_count) for axis in range(3)
    ]
    return CornerValues(np.stack(summed, axis=1), topology.indices, by_point=True)


def face_vectors(points: np.ndarray, topology: Topology) -> np.ndarray:
    """Twice the vector area of each face (F, 3); zero for faces with fewer than three corners."""
    first = np.cumsum(topology.counts) - topology.counts
    corners = np.arange(len(topology.indices))
    following = corners + 1
    filled = topology.counts > 0
    following[(first + topology.counts - 1)[filled]] = first[filled]
    origin = points[
        topology.indices[np.repeat(first, topology.counts)]
    ]  # keeps the digits of a face far from the origin
    crossed = np.cross(points[topology.indices] - origin, points[topology.indices[following]] - origin)
    vectors = np.zeros((len(topology.counts), 3))
    if filled.any():
        vectors[filled] = np.add.reduceat(crossed, first[filled], axis=0)
    return vectors


def unit_normals(normals: np.ndarray, points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Scale normals (V, 3) to unit length, float32; one that is zero takes that of a triangle at its vertex."""
    length = np.linalg.norm(normals, axis=1)
    zero = np.flatnonzero(~(length > 0))
    if not len(zero):
        return (normals / length[:, None]).astype(np.float32)
    replaced = normals.copy()
    a, b, c = (points[triangles[:, k]] for k in range(3))
    geometric = np.zeros_like(replaced)
    geometric[triangles] = np.cross(b - a, c - a)[:, None]
    replaced[zero] = geometric[zero]
    replaced[~replaced.any(axis=1)] = (0.0, 0.0, 1.0)  # a vertex without a triangle: any direction
    return (replaced / np.linalg.norm(replaced, axis=1, keepdims=True)).astype(np.float32)
