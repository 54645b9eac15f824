"""Newell's teapot as a quad mesh: 32 bicubic Bezier patches, tessellated, with texture coordinates for the body.

Martin Newell measured his own teapot at the University of Utah in 1975 (*The Utilization of Procedure Models in Digital
Image Synthesis*); the numbers are in the public domain. The rim, body, lid and bottom are surfaces of revolution, so
that a profile in (radius, height) gives their patches; the handle and the spout mirror in the plane y = 0. Heights are
Blinn's (the ones in use everywhere, about 1.3 times lower than the teapot that was measured); the bottom is Crow's. The
lid is widened by 7.7 % so that no gap is left.

Newell's z is up; `teapot` returns y up, the spout toward +x.

Texture coordinates: on the rim and body s goes from 0 at the handle to 1 at the spout around either side (the two sides
mirror each other, so that there is no seam), t from 0 at the foot to 1 at the rim's edge by arc length. The other parts
have s and t over each patch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["PARTS", "Teapot", "teapot"]

# Profiles: four control points (radius, height) from top to bottom, or from the axis outward.
_RIM = [(1.4, 2.4), (1.3375, 2.53125), (1.4375, 2.53125), (1.5, 2.4)]
_BODY_UPPER = [(1.5, 2.4), (1.75, 1.875), (2.0, 1.35), (2.0, 0.9)]
_BODY_LOWER = [(2.0, 0.9), (2.0, 0.45), (1.5, 0.225), (1.5, 0.15)]
_KNOB = [(0.0, 3.15), (0.8, 3.15), (0.0, 2.85), (0.2, 2.7)]
_LID = [(0.2, 2.7), (0.4, 2.55), (1.3, 2.55), (1.3, 2.4)]
_BOTTOM = [(0.0, 0.0), (1.425, 0.0), (1.5, 0.075), (1.5, 0.15)]
_LID_WIDENING = 1.077
_QUARTER = 0.56  # Newell's handle length for a quarter circle; 0.5523 would be the closest

# Handle and spout, the half y <= 0, two patches each: per cross-section two points (x, z) in the plane y = 0 and the
# half width between them.
_HANDLE = [
    [
        ((-1.6, 2.025), (-1.5, 2.25), 0.3),
        ((-2.3, 2.025), (-2.5, 2.25), 0.3),
        ((-2.7, 2.025), (-3.0, 2.25), 0.3),
        ((-2.7, 1.8), (-3.0, 1.8), 0.3),
    ],
    [
        ((-2.7, 1.8), (-3.0, 1.8), 0.3),
        ((-2.7, 1.575), (-3.0, 1.35), 0.3),
        ((-2.5, 1.125), (-2.65, 0.9375), 0.3),
        ((-2.0, 0.9), (-1.9, 0.6), 0.3),
    ],
]
_SPOUT = [
    [
        ((1.7, 1.425), (1.7, 0.6), 0.66),
        ((2.6, 1.425), (3.1, 0.825), 0.66),
        ((2.3, 2.1), (2.4, 2.025), 0.25),
        ((2.7, 2.4), (3.3, 2.4), 0.25),
    ],
    [
        ((2.7, 2.4), (3.3, 2.4), 0.25),
        ((2.8, 2.475), (3.525, 2.49375), 0.25),
        ((2.9, 2.475), (3.45, 2.5125), 0.15),
        ((2.8, 2.4), (3.2, 2.4), 0.15),
    ],
]

PARTS = ("body", "lid", "handle", "spout", "bottom")


@dataclass(frozen=True)
class Teapot:
    """Quads (degenerate ones already triangles) with a part name per face.

    Attributes
    ----------
    points, normals : (V, 3) float64
    st : (V, 2) float64
    face_counts : (F,) int
        3 or 4.
    face_indices : (sum of face_counts,) int
        Counter-clockwise seen from outside.
    faces : dict of str to (N,) int
        Indices of the faces of each of `PARTS`.
    """

    points: np.ndarray
    normals: np.ndarray
    st: np.ndarray
    face_counts: np.ndarray
    face_indices: np.ndarray
    faces: dict[str, np.ndarray]


def teapot(segments: int = 12) -> Teapot:
    """Tessellate the teapot with `segments` quads along each side of a Bezier patch."""
    points, normals, st, polygons, parts = [], [], [], [], []
    first = 0
    for part, patch, corners in _patches():
        p, n = _evaluate(patch, segments)
        points.append(p)
        normals.append(n)
        st.append(_corner_st(corners, segments) if part != "body" else _body_st(p, corners, segments))
        faces = [_without_repeats(face, p, first) for face in _grid_faces(segments)]
        polygons += [face for face in faces if len(face) >= 3]
        parts += [part for face in faces if len(face) >= 3]
        first += len(p)
    return Teapot(
        points=_y_up(np.concatenate(points)),
        normals=_y_up(np.concatenate(normals)),
        st=np.concatenate(st),
        face_counts=np.array([len(polygon) for polygon in polygons]),
        face_indices=np.concatenate(polygons),
        faces={part: np.flatnonzero(np.array(parts) == part) for part in PARTS},
    )


def _patches():
    """Yield part, (4, 4, 3) control points whose u x v normal points outward, and the st range (s0, t0, s1, t1)."""
    lengths = np.array([_arc_length(profile) for profile in (_BODY_LOWER, _BODY_UPPER, _RIM)])
    t = np.concatenate([[0.0], np.cumsum(lengths) / lengths.sum()])
    body = ((_RIM, t[3], t[2]), (_BODY_UPPER, t[2], t[1]), (_BODY_LOWER, t[1], t[0]))
    for profile, t_top, t_bottom in body:
        yield from (("body", patch, (0.0, t_top, 1.0, t_bottom)) for patch in _revolve(profile))
    lid = [np.array([(r * _LID_WIDENING, z) for r, z in profile]) for profile in (_KNOB, _LID)]
    for profile in lid:
        yield from (("lid", patch, (0.0, 1.0, 1.0, 0.0)) for patch in _revolve(profile))
    for patch in _revolve(_BOTTOM):
        yield "bottom", patch[:, ::-1], (0.0, 0.0, 1.0, 1.0)
    for part, curves in (("handle", _HANDLE), ("spout", _SPOUT)):
        for sections in curves:
            near = np.array([_half_section(*section) for section in sections])
            far = (near * (1.0, -1.0, 1.0))[:, ::-1]
            yield from ((part, patch[:, ::-1], (0.0, 0.0, 1.0, 1.0)) for patch in (near, far))


def _revolve(profile):
    """Four patches (4, 4, 3), one per quarter turn; u runs along the profile, v around the axis."""
    radius, height = np.array(profile, float).T
    for quarter in range(4):
        a = np.array([np.cos(quarter * np.pi / 2), np.sin(quarter * np.pi / 2)])
        b = np.array([-a[1], a[0]])
        around = np.array([a, a + _QUARTER * b, b + _QUARTER * a, b]).round(12)
        flat = radius[:, None, None] * around[None]
        yield np.concatenate([flat, np.broadcast_to(height[:, None, None], (4, 4, 1))], axis=-1)


def _half_section(inner, outer, half_width):
    """Four control points of half a cross-section, from the plane y = 0 around -y back to it."""
    (x0, z0), (x1, z1) = inner, outer
    return [(x0, 0.0, z0), (x0, -half_width, z0), (x1, -half_width, z1), (x1, 0.0, z1)]


def _arc_length(profile) -> float:
    points = _bernstein(np.linspace(0, 1, 257)) @ np.array(profile, float)
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _bernstein(t):
    return np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], axis=-1)


def _bernstein_slope(t):
    return np.stack([-3 * (1 - t) ** 2, 3 * (1 - t) * (1 - 3 * t), 3 * t * (2 - 3 * t), 3 * t**2], axis=-1)


def _evaluate(patch, segments):
    """Points and unit normals on the (segments + 1)^2 grid, (N, 3) each, u slowest."""
    t = np.linspace(0, 1, segments + 1)
    inside = np.clip(t, 1e-4, 1 - 1e-4)  # where an edge of control points collapses (axis, cusp) a slope vanishes
    points = np.einsum("ui,vj,ijk->uvk", _bernstein(t), _bernstein(t), patch)
    du = np.einsum("ui,vj,ijk->uvk", _bernstein_slope(inside), _bernstein(inside), patch)
    dv = np.einsum("ui,vj,ijk->uvk", _bernstein(inside), _bernstein_slope(inside), patch)
    normals = np.cross(du, dv)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return points.reshape(-1, 3), normals.reshape(-1, 3)


def _corner_st(corners, segments):
    s0, t0, s1, t1 = corners
    t, s = np.meshgrid(np.linspace(t0, t1, segments + 1), np.linspace(s0, s1, segments + 1), indexing="ij")
    return np.stack([s, t], axis=-1).reshape(-1, 2)


def _body_st(points, corners, segments):
    """S from the angle to the spout, t by parameter between the profile's ends."""
    st = _corner_st(corners, segments)
    st[:, 0] = 1.0 - np.abs(np.arctan2(points[:, 1], points[:, 0])) / np.pi
    return st


def _grid_faces(segments):
    """Corner indices of the quads, counter-clockwise about du x dv."""
    index = np.arange((segments + 1) ** 2).reshape(segments + 1, segments + 1)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1)
    return quads.reshape(-1, 4)


def _without_repeats(face, points, first):
    """Drop corners that coincide with the next one: quads at the axis become triangles."""
    kept = [i for k, i in enumerate(face) if np.abs(points[i] - points[face[(k + 1) % 4]]).max() > 1e-9]
    return [first + int(i) for i in kept]


def _y_up(xyz):
    return np.stack([xyz[:, 0], xyz[:, 2], -xyz[:, 1]], axis=-1)
