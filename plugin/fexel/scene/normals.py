"""Normals that a mesh does not author: smooth over its points, or one per face.

Smooth normals weight each face by its area (the vector area of Newell), as subdivision cages are shown by usdrecord;
faceted ones are for ``subdivisionScheme`` ``none`` and ``bilinear``.
"""

from __future__ import annotations

import numpy as np
from pxr import UsdGeom

from fexel.scene.primvars import CornerValues, Topology

__all__ = ["corner_normals", "triangle_vectors", "unit_normals"]


def triangle_vectors(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Twice the vector area of triangles.

    Parameters
    ----------
    points : (P, 3) float64
    triangles : (T, 3) int
        Indices into `points`.

    Returns
    -------
    (T, 3) float64
        Along the normal of the counter-clockwise side; exactly zero for a triangle without extent.
    """
    a = points[triangles[:, 0]]
    (ux, uy, uz), (vx, vy, vz) = (points[triangles[:, 1]] - a).T, (points[triangles[:, 2]] - a).T
    return np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=1)  # np.cross takes twice as long


def corner_normals(
    vectors: np.ndarray, faces: np.ndarray, topology: Topology, smooth: bool, left_handed: bool
) -> CornerValues:
    """Geometric normals at the corners of polygons, not yet of unit length.

    Parameters
    ----------
    vectors : (T, 3) float64
        Of the triangles that the faces were cut into, see `triangle_vectors`.
    faces : (T,) int
        Face of each triangle.
    """
    face_count = len(topology.counts)
    per_face = np.stack([np.bincount(faces, vectors[:, k], face_count) for k in range(3)], axis=1)
    if left_handed:
        per_face = -per_face
    face_of_corner = topology.face_of_corner()
    if not smooth:
        return CornerValues(per_face, face_of_corner, UsdGeom.Tokens.uniform)
    per_corner = per_face[face_of_corner]
    summed = [np.bincount(topology.indices, per_corner[:, k], topology.point_count) for k in range(3)]
    return CornerValues(np.stack(summed, axis=1), topology.indices, UsdGeom.Tokens.vertex)


def unit_normals(normals: np.ndarray, points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Scale normals (V, 3) to unit length, float32; one that is zero takes that of a triangle at its vertex."""
    length = np.linalg.norm(normals, axis=1)
    zero = np.flatnonzero(~(length > 0))
    if not len(zero):
        return (normals / length[:, None]).astype(np.float32)
    replaced = normals.copy()
    geometric = np.zeros_like(replaced)
    geometric[triangles] = triangle_vectors(points, triangles)[:, None]
    replaced[zero] = geometric[zero]
    replaced[~replaced.any(axis=1)] = (0.0, 0.0, 1.0)  # a vertex without a triangle: any direction
    return (replaced / np.linalg.norm(replaced, axis=1, keepdims=True)).astype(np.float32)
