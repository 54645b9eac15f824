"""Polygons to triangles, right for concave faces, vectorised over all faces with the same number of corners.

Triangles are taken as they are, quadrilaterals are split along the diagonal that lies inside; larger faces become a
fan where some corner sees the whole face (every convex face), and are clipped ear by ear where none does (Meisters
1975, *Polygons have ears*). Faces are judged in the coordinate plane most nearly parallel to them, which keeps the
coordinates as they are and so does not turn straight angles into bends. A face need not be planar; of a face that
cuts itself the triangles still use every corner.

Corners are counted through all faces: corner ``c`` of a mesh is entry ``c`` of ``faceVertexIndices``.
"""

from __future__ import annotations

import numpy as np

__all__ = ["newell_normals", "triangulate"]

_FAN_TRIALS = 8  # apexes tried before a face goes to ear clipping
_FULL_RECOUNTS = 64  # bounds the O(n^2) recounts of a face that cuts itself
_CHUNK = 1 << 20  # corners handled at once, bounds memory
_STRAIGHT = 1e-14  # of the extent squared: below it three corners count as collinear (double rounding)


def newell_normals(corner_points: np.ndarray) -> np.ndarray:
    """Area-weighted normals of polygons.

    Parameters
    ----------
    corner_points : (F, n, 3) float64

    Returns
    -------
    (F, 3) float64
        Twice the vector area; zero for a degenerate face.
    """
    local = corner_points - corner_points[:, :1]  # relative to a corner, so that a far-away face keeps its digits
    return np.cross(local[:, 1:-1], local[:, 2:]).sum(axis=1)


def triangulate(points: np.ndarray, counts: np.ndarray, indices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangulate the faces of a mesh.

    Parameters
    ----------
    points : (P, 3) float64
    counts : (F,) int
        ``faceVertexCounts``; faces with fewer than three corners give no triangle.
    indices : (C,) int
        ``faceVertexIndices``, C = sum of `counts`, each in [0, P).

    Returns
    -------
    corners : (T, 3) int64
        Three corners per triangle, in the order of the face, sorted by face. T is the sum of ``counts - 2``.
    faces : (T,) int64
        Face of each triangle.
    """
    counts = np.asarray(counts, np.int64)
    first_corner = np.cumsum(counts) - counts
    triangle_counts = np.maximum(counts - 2, 0)
    first_triangle = np.cumsum(triangle_counts) - triangle_counts
    corners = np.empty((int(triangle_counts.sum()), 3), np.int64)
    for n in np.unique(counts[counts >= 3]).tolist():
        selected = np.flatnonzero(counts == n)
        for start in range(0, len(selected), max(1, _CHUNK // n)):
            faces = selected[start : start + max(1, _CHUNK // n)]
            face_corners = first_corner[faces, None] + np.arange(n)
            local = _split(points, indices, face_corners)
            rows = first_triangle[faces, None] + np.arange(n - 2)
            corners[rows] = local + first_corner[faces, None, None]
    return corners, np.repeat(np.arange(len(counts)), triangle_counts)


def _split(points: np.ndarray, indices: np.ndarray, face_corners: np.ndarray) -> np.ndarray:
    """Triangles (F, n - 2, 3) of faces with n corners each, as corner numbers within the face."""
    n = face_corners.shape[1]
    if n == 3:
        return np.arange(3)[None, None]
    xy = _flatten(points[indices[face_corners]])
    if n == 4:
        return _split_quadrilaterals(xy)
    return _split_polygons(xy)


def _flatten(corner_points: np.ndarray) -> np.ndarray:
    """Drop the coordinate along which a face's normal is longest: (F, n, 2), counter-clockwise in the plane."""
    normals = newell_normals(corner_points)
    axis = np.argmax(np.abs(normals), axis=1)
    faces = np.arange(len(axis))
    local = corner_points - corner_points[:, :1]
    x, y = local[faces, :, (axis + 1) % 3], local[faces, :, (axis + 2) % 3]
    clockwise = normals[faces, axis] < 0
    return np.stack([np.where(clockwise[:, None], y, x), np.where(clockwise[:, None], x, y)], axis=-1)


def _area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Twice the signed area of triangles in the plane, positive counter-clockwise."""
    u, v = b - a, c - a
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]


def _split_quadrilaterals(xy: np.ndarray) -> np.ndarray:
    """Split along corners 0-2 unless only the diagonal 1-3 lies inside."""
    p0, p1, p2, p3 = xy[:, 0], xy[:, 1], xy[:, 2], xy[:, 3]
    along_02 = np.minimum(_area(p0, p1, p2), _area(p0, p2, p3))
    along_13 = np.minimum(_area(p1, p2, p3), _area(p1, p3, p0))
    other = (along_02 <= 0) & (along_13 > along_02)
    return np.where(other[:, None, None], np.array([[1, 2, 3], [1, 3, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))


def _split_polygons(xy: np.ndarray) -> np.ndarray:
    """Fans where some corner sees the whole face, ear clipping for the rest."""
    n = xy.shape[1]
    result = np.empty((len(xy), n - 2, 3), np.int64)
    rest = np.arange(len(xy))
    fan = np.stack([np.zeros(n - 2, np.int64), np.arange(1, n - 1), np.arange(2, n)], axis=1)
    for apex in range(min(n, _FAN_TRIALS)):
        triangles = (fan + apex) % n
        corners = xy[rest][:, triangles]
        whole = (_area(corners[:, :, 0], corners[:, :, 1], corners[:, :, 2]) > 0).all(axis=1)
        whole &= _winds_once(xy[rest], apex)
        result[rest[whole]] = triangles
        rest = rest[~whole]
        if not len(rest):
            return result
    result[rest] = _clip_ears(xy[rest])
    return result


def _winds_once(xy: np.ndarray, apex: int) -> np.ndarray:
    """Whether a fan of positive triangles spans less than a full turn about its apex, so that none overlap."""
    spokes = np.roll(xy, -apex, axis=1)[:, 1:] - xy[:, apex][:, None]
    turns = np.diff(np.unwrap(np.arctan2(spokes[..., 1], spokes[..., 0]), axis=1), axis=1).sum(axis=1)
    return turns < 2 * np.pi - 1e-9  # 1e-9 rad: rounding of arctan2 over the sum


def _clip_ears(xy: np.ndarray) -> np.ndarray:
    """Clip ears off polygons (F, n, 2), best-shaped ear first: triangles (F, n - 2, 3)."""
    count, n = xy.shape[:2]
    loops = _Loops(xy)
    result = np.empty((count, n - 2, 3), np.int64)
    rows = np.arange(count)
    recounts = _FULL_RECOUNTS
    for step in range(n - 2):
        stuck = np.flatnonzero(loops.score.max(axis=1) <= _EAR)
        if step and len(stuck) and recounts:  # a corner that hid an ear may have been clipped since
            recounts -= 1
            for v in range(n):
                loops.update(stuck, np.full(len(stuck), v))
        best = np.argmax(loops.score, axis=1)
        result[:, step] = np.stack([loops.previous[rows, best], best, loops.following[rows, best]], axis=1)
        loops.remove(best)
    return result


_EAR = 2.0  # scores above it are ears; (1, 2] straight corners; (0, 1] convex corners that hide another; below, reflex


class _Loops:
    """What is left of each polygon while its ears are clipped, and how good an ear each corner is."""

    def __init__(self, xy: np.ndarray):
        count, n = xy.shape[:2]
        self.xy = xy
        self.alive = np.ones((count, n), bool)
        self.previous = np.tile(np.roll(np.arange(n), 1), (count, 1))
        self.following = np.tile(np.roll(np.arange(n), -1), (count, 1))
        self.score = np.empty((count, n))
        self.straight = _STRAIGHT * np.ptp(xy, axis=1).max(axis=1) ** 2
        for v in range(n):
            self.update(np.arange(count), np.full(count, v))

    def update(self, rows: np.ndarray, v: np.ndarray) -> None:
        """Score corner ``v[i]`` of polygon ``rows[i]``; a clipped corner keeps minus infinity."""
        alive = self.alive[rows, v]
        rows, v = rows[alive], v[alive]
        a, b, c = (self.xy[rows, k][:, None] for k in (self.previous[rows, v], v, self.following[rows, v]))
        area = _area(a, b, c)[:, 0]
        longest = np.maximum(np.maximum(_squared(b - a), _squared(c - b)), _squared(a - c))[:, 0]
        shape = area / np.maximum(longest, 1e-300)  # 1e-300: three equal corners score 0
        straight = np.abs(area) <= self.straight[rows]
        hides = self._hides_a_corner(rows, a, b, c)
        tier = np.where(straight, 1.0, np.where(area < 0, -2.0, np.where(hides, 0.0, _EAR)))
        self.score[rows, v] = tier + np.where(straight, 0.5, shape)

    def _hides_a_corner(self, rows: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        """Whether another corner lies in or on triangle a b c; corners that coincide with its own do not count."""
        p = self.xy[rows]
        inside = (_area(a, b, p) >= 0) & (_area(b, c, p) >= 0) & (_area(c, a, p) >= 0) & self.alive[rows]
        own = (p == a).all(axis=-1) | (p == b).all(axis=-1) | (p == c).all(axis=-1)
        return (inside & ~own).any(axis=1)

    def remove(self, v: np.ndarray) -> None:
        """Clip corner ``v[i]`` off polygon i and score its neighbours again."""
        rows = np.arange(len(v))
        a, c = self.previous[rows, v], self.following[rows, v]
        self.alive[rows, v] = False
        self.score[rows, v] = -np.inf
        self.following[rows, a], self.previous[rows, c] = c, a
        self.update(rows, a)
        self.update(rows, c)


def _squared(vector: np.ndarray) -> np.ndarray:
    return (vector * vector).sum(axis=-1)
