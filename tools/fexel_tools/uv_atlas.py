"""Texture coordinates for a polygon mesh without overlaps, by xatlas, per corner of the original polygons.

xatlas (Jonathan Young, after Ignacio Castaño's thekla_atlas) cuts triangles into charts, flattens and packs them. Four
things are added. A polygon whose triangles fall into different charts would need two coordinates at one corner, and
now and then a chart folds over itself: such polygons are taken out and become charts of their own. Charts that lie face
down are turned over. Then all charts are packed again. And points are scaled so that a triangle has a mean area of 1,
because xatlas drops triangles with an area near 1e-7.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fexel.errors import FexelError
from fexel.scene.triangulation import newell_normals, triangulate
from fexel_tools.uv_overlap import covering_faces, overlapping_pairs

__all__ = ["Atlas", "make_atlas"]


@dataclass(frozen=True, eq=False)
class Atlas:
    """Texture coordinates of a mesh.

    Attributes
    ----------
    st : (U, 2) float32
        In [0, 1], the same scale along s and t; origin at the lower left.
    corner_indices : (C,) int32
        Row of `st` for each corner, in the order of ``faceVertexIndices``.
    chart_count : int
    utilization : float
        Share of the unit square that charts cover, [0, 1].
    """

    st: np.ndarray
    corner_indices: np.ndarray
    chart_count: int
    utilization: float


@dataclass(frozen=True, eq=False)
class _Charts:
    """Coordinates per triangle corner, with the chart of each triangle (-1: xatlas left it out)."""

    st: np.ndarray
    chart: np.ndarray


@dataclass(frozen=True, eq=False)
class _Polygons:
    """Points of all corners, first corner and corner count of each face; triangles as corners, and their faces."""

    corner_points: np.ndarray
    first: np.ndarray
    counts: np.ndarray
    corners: np.ndarray
    faces: np.ndarray


def make_atlas(
    points: np.ndarray, counts: np.ndarray, indices: np.ndarray, resolution: int = 1024, padding: int = 2
) -> Atlas:
    """Unwrap a mesh.

    Parameters
    ----------
    points : (P, 3) float
        Any unit; need not be welded.
    counts, indices : (F,), (C,) int
        Corners per face and point of each corner; any polygons, also non-manifold.
    resolution : int
        Side in texels of the texture that is meant; with `padding` it decides the distance between charts.
    padding : int
        Texels between charts.

    Raises
    ------
    FexelError
        No face with an area, points that are NaN or infinite, or indices out of range. It names no mesh; callers do.
    """
    points, counts, indices = np.asarray(points, np.float64), np.asarray(counts), np.asarray(indices)
    _check(points, counts, indices)
    corners, faces = triangulate(points, counts, indices)
    corner_points = points[indices[corners]]
    area = np.linalg.norm(
        np.cross(corner_points[:, 1] - corner_points[:, 0], corner_points[:, 2] - corner_points[:, 0]), axis=1
    )
    solid = area > 1e-12 * (area.max() if len(area) else 0.0)  # slivers below float32 precision, which xatlas refuses
    if not solid.any():
        raise FexelError("no face with an area, expected at least one")
    scaled = (points - points.mean(axis=0)) / np.sqrt(area[solid].mean() / 2)
    charts = _cut(scaled, indices[corners[solid]], resolution, padding)
    torn = _torn_faces(charts, faces[solid], len(counts))
    upright = _unmirrored(charts)
    if torn.any():
        polygons = _Polygons(scaled[indices], np.cumsum(counts) - counts, counts, corners[solid], faces[solid])
        upright = _with_own_charts(upright, torn, polygons)
    if upright is not charts:
        charts = _repack(upright, resolution, padding)
    return _per_corner(charts, corners[solid], len(indices))


def _check(points: np.ndarray, counts: np.ndarray, indices: np.ndarray) -> None:
    if not len(points) or not len(counts):
        raise FexelError("the mesh is empty")
    if not np.isfinite(points).all():
        raise FexelError("points hold NaN or infinity, expected finite numbers")
    if counts.min() < 0 or counts.sum() != len(indices):
        raise FexelError(f"{len(indices)} face indices, expected {counts.sum()}, the sum of the face counts")
    if len(indices) and (indices.min() < 0 or indices.max() >= len(points)):
        raise FexelError(f"face index {indices.max()}, expected 0 to {len(points) - 1}")


def _pack_options(resolution: int, padding: int) -> Any:
    import xatlas

    options = xatlas.PackOptions()
    options.resolution = resolution
    options.padding = padding
    options.bilinear = True  # a chart's rim is not read when its neighbour is filtered
    options.rotate_charts = False  # it swaps s and t, which mirrors
    return options


def _cut(points: np.ndarray, triangles: np.ndarray, resolution: int, padding: int) -> _Charts:
    """Cut, flatten and pack triangles."""
    import xatlas

    atlas = xatlas.Atlas()
    atlas.add_mesh(points.astype(np.float32), np.ascontiguousarray(triangles, np.uint32))
    atlas.generate(pack_options=_pack_options(resolution, padding))
    return _charts(atlas)


def _repack(charts: _Charts, resolution: int, padding: int) -> _Charts:
    """Pack charts that are flat already; corners with equal coordinates in one chart are one vertex."""
    import xatlas

    flat, chart = charts.st.reshape(-1, 2), np.repeat(charts.chart, 3)
    _, first, index = np.unique(np.column_stack([chart, flat]), axis=0, return_index=True, return_inverse=True)
    atlas = xatlas.Atlas()
    atlas.add_uv_mesh(
        flat[first].astype(np.float32), index.reshape(-1, 3).astype(np.uint32), charts.chart.astype(np.uint32)[:, None]
    )
    atlas.generate(pack_options=_pack_options(resolution, padding))
    return _charts(atlas)


def _charts(atlas: Any) -> _Charts:
    """Read an atlas of one mesh; coordinates keep one scale for s and t."""
    if atlas.atlas_count > 1:
        raise FexelError(f"xatlas needs {atlas.atlas_count} textures; try a greater resolution or less padding")
    _, triangles, st = atlas.get_mesh(0)
    _, vertex_chart = atlas.get_mesh_vertex_assignment(0)
    size = np.array([atlas.width, atlas.height], np.float64)
    triangles = triangles.reshape(-1, 3)
    scaled = st.astype(np.float64) * size / max(size.max(), 1.0)
    return _Charts(scaled[triangles], vertex_chart.astype(np.int32)[triangles[:, 0]].astype(np.int64))  # -1 for none


def _torn_faces(charts: _Charts, faces: np.ndarray, face_count: int) -> np.ndarray:
    """(F,) bool: faces in several charts or in none, or that cover another face of their chart."""
    low = np.full(face_count, np.iinfo(np.int64).max)
    high = np.full(face_count, -2, np.int64)
    np.minimum.at(low, faces, charts.chart)
    np.maximum.at(high, faces, charts.chart)
    torn = (low < np.iinfo(np.int64).max) & ((low != high) | (low < 0))
    pairs = faces[overlapping_pairs(charts.st, charts.chart)]
    torn[pairs[pairs[:, 0] == pairs[:, 1], 0]] = True
    torn[list(covering_faces(pairs[~torn[pairs].any(axis=1)]))] = True
    return torn


def _unmirrored(charts: _Charts) -> _Charts:
    """Turn over the charts that xatlas laid face down, so that images and normal maps are not mirrored."""
    named = charts.chart >= 0
    if not named.any():
        return charts
    area = np.bincount(charts.chart[named], _signed_areas(charts.st[named]))
    mirrored = named & (area[charts.chart] < 0)
    if not mirrored.any():
        return charts
    st = charts.st.copy()
    st[mirrored, :, 0] = 1.0 - st[mirrored, :, 0]
    return _Charts(st, charts.chart)


def _with_own_charts(charts: _Charts, torn: np.ndarray, polygons: _Polygons) -> _Charts:
    """Give each torn face a chart of its own, flat and at the scale of the others."""
    points = polygons.corner_points[polygons.corners]
    chart, st = charts.chart.copy(), charts.st * _scale(charts.st, points)
    affected = np.flatnonzero(torn[polygons.faces])
    _, number = np.unique(polygons.faces[affected], return_inverse=True)
    chart[affected] = chart.max() + 1 + number
    normals = np.zeros((number.max() + 1, 3))
    np.add.at(normals, number, newell_normals(points[affected]))
    st[affected] = _project(points[affected], normals[number])
    folded = np.unique(number[_signed_areas(st[affected]) <= 0])
    for k in folded:  # bent so far that its projection covers itself
        triangles = affected[number == k]
        face = polygons.faces[triangles[0]]
        corners = slice(polygons.first[face], polygons.first[face] + polygons.counts[face])
        st[triangles] = _on_circle(polygons.corner_points[corners])[polygons.corners[triangles] - polygons.first[face]]
    return _Charts(st, chart)


def _on_circle(loop: np.ndarray) -> np.ndarray:
    """A polygon's corners (n, 2) on a circle of its circumference, where any triangulation of it lies flat."""
    length = np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1)
    length = np.maximum(length, 1e-3 * length.max())  # corners that coincide still get an arc
    angle = 2 * np.pi * np.cumsum(length) / length.sum()
    return length.sum() / (2 * np.pi) * np.column_stack([np.cos(angle), np.sin(angle)])


def _signed_areas(st: np.ndarray) -> np.ndarray:
    u, v = st[:, 1] - st[:, 0], st[:, 2] - st[:, 0]
    return (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2


def _scale(st: np.ndarray, points: np.ndarray) -> float:
    """World units per unit of st, by the total areas of the triangles."""
    world = np.linalg.norm(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]), axis=1).sum() / 2
    flat = np.abs(_signed_areas(st)).sum()
    return float(np.sqrt(world / flat)) if flat > 0 else 1.0


def _project(corner_points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Coordinates (T, 3, 2) of corners in the plane across `normals`, counter-clockwise seen from their tip."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 0, normals / np.where(length > 0, length, 1.0), (0.0, 0.0, 1.0))
    helper = np.where(np.abs(normals[:, :1]) < 0.9, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    right = np.cross(helper, normals)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    up = np.cross(normals, right)
    return np.stack([(corner_points * right[:, None]).sum(-1), (corner_points * up[:, None]).sum(-1)], axis=-1)


def _per_corner(charts: _Charts, corners: np.ndarray, corner_count: int) -> Atlas:
    """Coordinates at the corners of the polygons; corners of faces without an area are at the origin."""
    values = np.zeros((corner_count, 2))
    values[corners.ravel()] = charts.st.reshape(-1, 2)
    st, index = np.unique(np.clip(values, 0.0, 1.0).astype(np.float32), axis=0, return_inverse=True)
    covered = float(np.abs(_signed_areas(charts.st)).sum())
    return Atlas(st, index.reshape(-1).astype(np.int32), len(np.unique(charts.chart[charts.chart >= 0])), covered)
