"""Cameras for a zipmap: the whole surface, the sharpest patch, and a zoom between the two.

The zoom is exponential: the distance to the surface shrinks by the same factor from frame to frame, so magnification
grows at a constant rate, and the point that ends in the middle of the picture drifts there in a straight line of the
picture.

Conventions: world units; camera matrices are camera to world for row vectors, looking down -z with y up; a distance is
the one from the camera to the surface point in the middle of its picture.
"""

from __future__ import annotations

import numpy as np
from pxr import Gf

from fexel_tools.geometry import Location, Surface, locate, look_at

__all__ = ["Pose", "camera_poses"]

_FOCAL_PER_APERTURE = 50.0 / 36.0  # of the cameras that zipmap_stage writes, horizontally
_SOLO_DETAIL = 0.25  # share of the texture that Detail shows where there is no patch

Pose = tuple[float, Gf.Matrix4d, float]  # frame (NaN: stands still), camera to world, distance


def camera_poses(
    surface: Surface, detail_st: np.ndarray | None, aspect: float, frames: tuple[int, int]
) -> dict[str, list[Pose]]:
    """Poses of the cameras Zoom, Overview and Detail.

    Parameters
    ----------
    surface : Surface
    detail_st : (4, 2) float64 or None
        Corners of the sharpest patch in the root's st, in order around it; None shows a quarter of the texture.
    aspect : float
        Width over height of the picture.
    frames : (int, int)
        First and last frame of the zoom.

    Returns
    -------
    dict of str to list of (frame, camera to world, distance)
        Frame NaN for a camera that stands still.
    """
    overview = _overview(surface, aspect)
    detail = _detail(surface, detail_st, aspect)
    count = frames[1] - frames[0]
    zoom = [_between(overview, detail, k / count) for k in range(count + 1)]
    return {
        "Zoom": [(float(frames[0] + k), *_pose(view)) for k, view in enumerate(zoom)],
        "Overview": [(float("nan"), *_pose(overview))],
        "Detail": [(float("nan"), *_pose(detail))],
    }


_View = tuple[np.ndarray, np.ndarray, np.ndarray, float]  # target, direction to the eye, up, distance


def _pose(view: _View) -> tuple[Gf.Matrix4d, float]:
    target, direction, up, distance = view
    return look_at(target + distance * direction, target, up), distance


def _overview(surface: Surface, aspect: float) -> _View:
    low, high = surface.points.min(axis=0), surface.points.max(axis=0)
    center, extent = 0.5 * (low + high), high - low
    if surface.up_axis == "Z":
        direction, up, width, height, depth = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0]), *extent[[0, 2, 1]]
    else:
        direction, up, width, height, depth = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]), *extent
    distance = _FOCAL_PER_APERTURE * max(width, height * aspect) + 0.5 * depth
    return center, direction, up, float(max(distance, 1e-12))  # a mesh may be a single point


def _detail(surface: Surface, detail_st: np.ndarray | None, aspect: float) -> _View:
    if detail_st is None:
        low, high = np.full(2, 0.5 - _SOLO_DETAIL / 2.0), np.full(2, 0.5 + _SOLO_DETAIL / 2.0)
    else:  # the axis-parallel rectangle with the patch's centre and mean side lengths
        centre = detail_st.mean(axis=0)
        sides = np.abs(np.roll(detail_st, -1, axis=0) - detail_st).max(axis=0)
        low, high = centre - 0.5 * sides, centre + 0.5 * sides
    place: Location = locate(surface, (low[0], high[0]), (low[1], high[1]))
    width = min(place.width, place.height * aspect)
    return place.center, place.normal, place.up, float(max(_FOCAL_PER_APERTURE * width, 1e-12))


def _between(start: _View, end: _View, share: float) -> _View:
    distance = start[3] * (end[3] / start[3]) ** share
    span = start[3] - end[3]
    left = (distance - end[3]) / span if abs(span) > 1e-9 * start[3] else 1.0 - share
    target = end[0] + left * (start[0] - end[0])
    return target, _turn(start[1], end[1], share), _turn(start[2], end[2], share), distance


def _turn(a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray:
    """Spherical interpolation of unit vectors; opposite ones turn by way of any perpendicular."""
    cosine = float(np.clip(a @ b, -1.0, 1.0))
    if cosine > 1.0 - 1e-12:
        return a
    side = b - cosine * a
    if np.linalg.norm(side) < 1e-6:
        side = np.cross(a, [1.0, 0.0, 0.0] if abs(a[0]) < 0.9 else [0.0, 1.0, 0.0])
    angle = np.arccos(cosine) * share
    return np.cos(angle) * a + np.sin(angle) * side / np.linalg.norm(side)
