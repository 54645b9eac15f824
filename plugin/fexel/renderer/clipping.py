"""Clipping triangles against the view frustum in float64, vectorised.

Sutherland and Hodgman 1974 ("Reentrant polygon clipping") on arrays of polygons padded to equal length. A clipped
vertex is given by its barycentric weights in the triangle it came from, so that any attribute can be interpolated
afterwards.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["clip_triangles", "frustum_codes", "frustum_planes"]


def frustum_planes(margin: tuple[float, float] = (0.0, 0.0)) -> NDArray[np.float64]:
    """Six planes (6, 4) in clip space; a point is inside where ``planes @ [x y z w] >= 0``.

    Parameters
    ----------
    margin : (float, float)
        Widens the sides in x and y by this share of half the view.
    """
    x, y = 1.0 + margin[0], 1.0 + margin[1]
    return np.array([[1, 0, 0, x], [-1, 0, 0, x], [0, 1, 0, y], [0, -1, 0, y], [0, 0, 1, 1], [0, 0, -1, 1]], np.float64)


def frustum_codes(clip: NDArray[np.float64], planes: NDArray[np.float64]) -> NDArray[np.uint8]:
    """(V,) bit i set where a point is outside of plane i. NaN counts as outside of everything."""
    codes = np.zeros(len(clip), np.uint8)
    for bit, plane in enumerate(planes):
        codes |= (~(clip @ plane >= 0)).astype(np.uint8) << np.uint8(bit)
    return codes


def clip_triangles(
    corners: NDArray[np.float64], planes: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Clip triangles by planes.

    Parameters
    ----------
    corners : (T, 3, 4) float64
        Clip space.
    planes : (6, 4) float64

    Returns
    -------
    source : (K,) int
        Which triangle each resulting triangle is part of.
    weights : (K, 3, 3) float64
        Barycentric weights of its corners in that triangle; orientation is kept.
    """
    source = np.arange(len(corners))
    polygons = np.broadcast_to(np.eye(3), (len(corners), 3, 3)).copy()
    counts = np.full(len(corners), 3)
    for plane in planes:
        distance = np.einsum("kni,ki->kn", polygons, (corners @ plane)[source])
        polygons, counts = _clip_by_plane(polygons, counts, distance)
        keep = counts >= 3
        source, polygons, counts = source[keep], polygons[keep], counts[keep]
    return _fans(source, polygons, counts)


def _clip_by_plane(
    polygons: NDArray[np.float64], counts: NDArray[np.intp], distance: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    count, length = distance.shape
    slots = np.arange(length)
    following = np.where(slots + 1 < counts[:, None], slots + 1, 0)
    next_distance = np.take_along_axis(distance, following, axis=1)
    next_vertex = np.take_along_axis(polygons, following[..., None], axis=1)
    real = slots < counts[:, None]
    inside, next_inside = distance >= 0, next_distance >= 0
    crosses = real & (inside != next_inside)
    span = np.where(crosses, distance - next_distance, 1.0)
    crossing = polygons + (np.where(crosses, distance, 0.0) / span)[..., None] * (next_vertex - polygons)
    # Every edge yields its crossing, if any, then its end, if inside.
    vertices = np.stack([crossing, next_vertex], axis=2).reshape(count, 2 * length, 3)
    valid = np.stack([crosses, real & next_inside], axis=2).reshape(count, 2 * length)
    order = np.argsort(~valid, axis=1, kind="stable")[:, : length + 1]
    return np.take_along_axis(vertices, order[..., None], axis=1), valid.sum(axis=1)


def _fans(
    source: NDArray[np.intp], polygons: NDArray[np.float64], counts: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    sources, triangles = [source[:0]], [np.zeros((0, 3, 3))]
    for corner in range(1, polygons.shape[1] - 1):
        full = counts > corner + 1
        sources.append(source[full])
        triangles.append(polygons[full][:, [0, corner, corner + 1]])
    return np.concatenate(sources), np.concatenate(triangles)
