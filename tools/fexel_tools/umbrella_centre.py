"""Centres: points from which the whole contour is visible, and what to do where there is none.

Such points form the kernel of the polygon, the intersection of the half-planes to the left of its sides (Lee and
Preparata, An optimal algorithm for finding the kernel of a polygon, 1979). The centre is the point of the kernel
nearest to where it is wanted among those that stay clear of its sides. Where the kernel is empty, or a sliver, the
centre is the point that sees the most of the area, and the contour becomes what it sees.

Coordinates have y upwards, polygons run counter-clockwise; all is float64.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from fexel_tools.umbrella_contour import area

__all__ = ["Clearance", "centroid", "clearance", "kernel", "kernel_point", "most_visible", "sees_all", "visible_curve"]

_DIRECTIONS = 2048  # in which a repaired contour is looked at: steps of a third of a pixel at 100 pixels
_COARSE_DIRECTIONS = 192
_CANDIDATES = 160
_KEPT_CLEARANCE = 0.5  # of the greatest clearance: what a centre nearer to where it is wanted keeps at least
_PULL = 0.05
_JUMP = 0.02  # of the radius: a step of it between two directions is an edge along the line of sight


@dataclass(frozen=True)
class Clearance:
    """The point farthest from the sides of a kernel, and how far that is; 0 where the kernel is empty."""

    point: tuple[float, float]
    radius: float


def kernel(polygon: NDArray[np.float64], inset: float = 0.0) -> NDArray[np.float64]:
    """Points that see the whole polygon, at least `inset` away from the lines through its sides.

    Returns
    -------
    (M, 2) float64
        Convex, counter-clockwise; (0, 2) where there is none.
    """
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    box = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    return _clip(box, np.ascontiguousarray(polygon, np.float64), inset)


def clearance(polygon: NDArray[np.float64]) -> Clearance:
    """Centre and radius of the largest disc in the kernel, to 1e-4 of the polygon's size."""
    size = float(np.ptp(polygon, axis=0).max())
    low, high, point = 0.0, 0.5 * size, None
    while high - low > 1e-4 * size or (point is None and high > 1e-7 * size):
        middle = 0.5 * (low + high)
        region = kernel(polygon, middle)
        if len(region):
            low, point = middle, region.mean(axis=0)
        else:
            high = middle
    return Clearance((0.0, 0.0), 0.0) if point is None else Clearance((float(point[0]), float(point[1])), low)


def kernel_point(polygon: NDArray[np.float64], wanted: NDArray[np.float64], found: Clearance) -> NDArray[np.float64]:
    """The point nearest to `wanted` that keeps half of the greatest clearance."""
    region = kernel(polygon, _KEPT_CLEARANCE * found.radius)
    return _nearest_point(region, wanted) if len(region) else np.array(found.point)


def centroid(polygon: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centre of mass of the area; the mean of the vertices where there is none."""
    relative = polygon - polygon[0]
    after = np.roll(relative, -1, axis=0)
    cross = relative[:, 0] * after[:, 1] - relative[:, 1] * after[:, 0]
    total = float(cross.sum())
    if abs(total) < 1e-12 * max(float(np.abs(cross).sum()), 1e-300):
        return polygon.mean(axis=0)
    return polygon[0] + (cross[:, None] * (relative + after)).sum(axis=0) / (3 * total)


def sees_all(center: NDArray[np.float64], polygon: NDArray[np.float64], least: float = 0.0) -> bool:
    """Whether the centre is more than `least` to the left of every side."""
    after = np.roll(polygon, -1, axis=0)
    side = after - polygon
    cross = side[:, 0] * (center[1] - polygon[:, 1]) - side[:, 1] * (center[0] - polygon[:, 0])
    return bool((cross > least * np.hypot(*side.T)).all())


def most_visible(
    polygon: NDArray[np.float64], wanted: NDArray[np.float64] | None = None, pull: float = _PULL
) -> NDArray[np.float64]:
    """The point that sees the most of a polygon, less what it lies away from where it is wanted.

    Parameters
    ----------
    polygon : (N, 2) float64
    wanted : (2,) float64, optional
        Default: the centroid.
    pull : float
        Share of the area that a centre may lose to be nearer, at the radius of a disc of that area.
    """
    whole = abs(area(polygon))
    scale = np.sqrt(whole / np.pi)
    aim = centroid(polygon) if wanted is None else wanted

    def worth(point: NDArray[np.float64]) -> float:
        if not _contains(polygon, point):
            return -np.inf
        off = float(np.hypot(*(point - aim))) / scale
        return _visible_area(polygon, point, _COARSE_DIRECTIONS) / whole - pull * off * off

    candidates = [*_inside_points(polygon), aim]
    worths = [worth(point) for point in candidates]
    best, most = candidates[int(np.argmax(worths))], max(worths)
    step = np.sqrt(whole / _CANDIDATES)
    while step > 0.01 * scale:
        trials = [best + step * np.array(offset) for offset in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        values = [worth(trial) for trial in trials]
        if max(values) > most:
            best, most = trials[int(np.argmax(values))], max(values)
        else:
            step *= 0.5
    return best


def visible_curve(polygon: NDArray[np.float64], center: NDArray[np.float64]) -> NDArray[np.float64]:
    """What a centre sees of a polygon, as a curve whose points follow each other by their angle about the centre.

    Edges along the line of sight are tilted inwards by two directions, so that they can be seen.
    """
    distance = _distances(polygon, center, _DIRECTIONS)
    before, after = np.roll(distance, 1), np.roll(distance, -1)
    jump = _JUMP * float(distance.max())
    distance = np.where(distance - before > jump, before, np.where(distance - after > jump, after, distance))
    angle = np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
    return center + distance[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _inside_points(polygon: NDArray[np.float64]) -> NDArray[np.float64]:
    """(C, 2) points of a square grid that lie inside, and the one farthest from the sides."""
    low, size = polygon.min(axis=0), np.ptp(polygon, axis=0)
    step = np.sqrt(abs(area(polygon)) / _CANDIDATES)
    columns, rows = (np.arange(0.5 * step, extent, step) for extent in size)
    grid = low + np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    depths = np.array([_depth(polygon, point) for point in grid])
    if len(grid) and depths.max() > 0:
        return grid[depths > min(0.25 * step, 0.5 * float(depths.max()))]
    return centroid(polygon)[None]


def _depth(polygon: NDArray[np.float64], point: NDArray[np.float64]) -> float:
    return cv2.pointPolygonTest(polygon.astype(np.float32)[:, None], (float(point[0]), float(point[1])), True)


def _contains(polygon: NDArray[np.float64], point: NDArray[np.float64]) -> bool:
    return _depth(polygon, point) > 0


@numba.njit(cache=True, nogil=True)
def _clip(region, polygon, inset):
    """A convex region cut by the half-planes to the left of a polygon's sides (Sutherland and Hodgman, 1974)."""
    for k in range(len(polygon)):
        ax, ay = polygon[k]
        bx, by = polygon[(k + 1) % len(polygon)]
        length = np.hypot(bx - ax, by - ay)
        if length == 0.0:
            continue
        nx, ny = -(by - ay) / length, (bx - ax) / length
        kept = np.empty((len(region) + 1, 2))
        count = 0
        for i in range(len(region)):
            p, q = region[i], region[(i + 1) % len(region)]
            dp = nx * (p[0] - ax) + ny * (p[1] - ay) - inset
            dq = nx * (q[0] - ax) + ny * (q[1] - ay) - inset
            if dp >= 0:
                kept[count] = p
                count += 1
            if (dp > 0 and dq < 0) or (dp < 0 and dq > 0):
                t = dp / (dp - dq)
                kept[count, 0], kept[count, 1] = p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])
                count += 1
        region = kept[:count].copy()
        if count < 3:
            return np.zeros((0, 2))
    return region


@numba.njit(cache=True, nogil=True)
def _nearest_point(region, wanted):
    """Of a convex polygon."""
    inside = True
    best, nearest = region[0].copy(), np.inf
    for i in range(len(region)):
        a, b = region[i], region[(i + 1) % len(region)]
        dx, dy = b[0] - a[0], b[1] - a[1]
        if dx * (wanted[1] - a[1]) - dy * (wanted[0] - a[0]) < 0:
            inside = False
        squared = dx * dx + dy * dy
        t = 0.0
        if squared > 0:
            t = min(max(((wanted[0] - a[0]) * dx + (wanted[1] - a[1]) * dy) / squared, 0.0), 1.0)
        x, y = a[0] + t * dx, a[1] + t * dy
        distance = np.hypot(x - wanted[0], y - wanted[1])
        if distance < nearest:
            nearest = distance
            best[0], best[1] = x, y
    return wanted.copy() if inside else best


@numba.njit(cache=True, nogil=True)
def _distances(polygon, center, directions):
    """From the centre to the first side in each of so many directions, counter-clockwise from +x; 0 where none is.

    Sides are taken one after the other: each is met by the directions between those of its ends.
    """
    result = np.full(directions, np.inf)
    step = 2 * np.pi / directions
    for k in range(len(polygon)):
        ax, ay = polygon[k, 0] - center[0], polygon[k, 1] - center[1]
        bx, by = polygon[(k + 1) % len(polygon), 0] - center[0], polygon[(k + 1) % len(polygon), 1] - center[1]
        cross = ax * by - ay * bx
        start, turn = np.arctan2(ay, ax), np.arctan2(cross, ax * bx + ay * by)
        if turn < 0:
            start, turn = start + turn, -turn
        first = int(np.ceil(start / step))
        last = int(np.floor((start + turn) / step))
        for number in range(first, last + 1):
            c, s = np.cos(number * step), np.sin(number * step)
            towards = c * (by - ay) - s * (bx - ax)
            if towards == 0.0:
                distance = min(np.hypot(ax, ay), np.hypot(bx, by))
            else:
                distance = abs(cross / towards)
            index = number % directions
            result[index] = min(result[index], distance)
    return np.where(np.isfinite(result), result, 0.0)


@numba.njit(cache=True, nogil=True)
def _visible_area(polygon, center, directions):
    distance = _distances(polygon, center, directions)
    return 0.5 * np.sum(distance * distance) * 2 * np.pi / directions
