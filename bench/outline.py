"""Outlines of a raster silhouette as closed polygons with true corners: what a distance field is made from.

Level lines of the coverage at 1/2 (marching squares, contourpy) of a picture several times as fine as the one that is
judged. A raster rounds every corner by about a pixel; where the direction turns by over 30 degrees within a few pixels,
the corner is put back as the intersection of the lines fitted on both sides. Between corners the outline is smoothed by
1.5 pixels and kept in pieces that turn by less than 4 degrees: an edge colouring finds the corners and no others.
"""

from __future__ import annotations

import math

import contourpy
import numpy as np
from scipy.ndimage import gaussian_filter1d

__all__ = ["outlines"]

_SPACING = 0.5  # between points along the line, pixels of the fine picture
_GAP, _ARM = 2.0, 9.0  # of the line fits on both sides of a corner, pixels: beyond the rounding, short of the next turn
_CORNER = math.radians(30)
_FARTHEST = 4.0  # of a corner from the raster's line, pixels
_SMOOTHING = 1.5  # standard deviation, pixels
_TURN, _LENGTH = math.radians(4), 60.0  # of a piece


def outlines(alpha: np.ndarray) -> list[np.ndarray]:
    """Closed polygons around the covered parts.

    Parameters
    ----------
    alpha : (H, W) float32
        Coverage; outside the picture nothing is covered.

    Returns
    -------
    list of (N, 2) float64
        Corners in pixels of `alpha` (x right, y down, 0 at the outer corner of the first pixel); the last joins the
        first. Holes run the other way round than what they are in.
    """
    padded = np.pad(alpha, 1)
    lines = contourpy.contour_generator(z=padded).lines(0.5)
    polygons = [
        _polygon(np.asarray(line, np.float64) - 0.5) for line in lines
    ]  # padded pixel centre (1, 1) is at (0.5, 0.5)
    return [polygon for polygon in polygons if len(polygon) >= 3]


def _polygon(line: np.ndarray) -> np.ndarray:
    points = _resampled(line)
    if len(points) < 8:
        return points
    corners = _corners(points)
    if not corners:
        return _thinned(_smoothed(points, closed=True), closed=True)
    pieces = []
    for (index, at), (following, to) in zip(corners, corners[1:] + corners[:1], strict=True):
        count = (following - index) % len(points) or len(points)
        skipped = min(round(_GAP / _SPACING), count // 3)
        inner = points[(index + np.arange(skipped, count - skipped + 1)) % len(points)]
        piece = _smoothed(np.vstack([at, inner, to]), closed=False)
        pieces.append(_thinned(piece, closed=False)[:-1])
    return np.vstack(pieces)


def _resampled(line: np.ndarray) -> np.ndarray:
    """Points at equal distances along a closed line (its last point repeats the first)."""
    steps = np.hypot(*np.diff(line, axis=0).T)
    along = np.append(0.0, np.cumsum(steps))
    count = max(int(along[-1] / _SPACING), 3)
    at = np.arange(count) * (along[-1] / count)
    return np.stack([np.interp(at, along, line[:, axis]) for axis in range(2)], axis=1)


def _corners(points: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Index and true position of every corner, in order."""
    gap, arm = round(_GAP / _SPACING), round(_ARM / _SPACING)
    if len(points) < 4 * arm:
        return []
    before, after = _fitted(points, -arm, -gap), _fitted(points, gap, arm)
    turn = np.abs(_angle(before[1], after[1]))
    order = np.argsort(-turn, kind="stable")
    taken = np.zeros(len(points), bool)
    found = []
    for index in order:
        if turn[index] < _CORNER:
            break
        if taken[index]:
            continue
        taken[(index + np.arange(-arm, arm + 1)) % len(points)] = True
        at = _intersection(before[0][index], before[1][index], after[0][index], after[1][index])
        near = at is not None and np.hypot(*(at - points[index])) <= _FARTHEST
        found.append((int(index), at if near else points[index]))
    return sorted(found, key=lambda corner: corner[0])


def _fitted(points: np.ndarray, low: int, high: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and direction (least squares over the index) of the points low..high from every point."""
    window = np.arange(low, high + 1)
    around = points[(np.arange(len(points))[:, None] + window) % len(points)]
    centred = window - window.mean()
    direction = np.einsum("nka,k->na", around, centred)
    return around.mean(1), direction / np.maximum(np.hypot(*direction.T), 1e-12)[:, None]


def _angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(1))


def _intersection(p: np.ndarray, d: np.ndarray, q: np.ndarray, e: np.ndarray) -> np.ndarray | None:
    cross = d[0] * e[1] - d[1] * e[0]
    if abs(cross) < 0.1:  # nearly parallel, as at a spike: their intersection is far away
        return None
    offset = q - p
    return p + d * (offset[0] * e[1] - offset[1] * e[0]) / cross


def _smoothed(points: np.ndarray, closed: bool) -> np.ndarray:
    if len(points) < 5:
        return points
    if closed:
        return gaussian_filter1d(points, _SMOOTHING / _SPACING, axis=0, mode="wrap")
    # Odd continuation keeps the ends, which are corners, where they are.
    reach = min(round(4 * _SMOOTHING / _SPACING), len(points) - 1)
    extended = np.vstack([2 * points[0] - points[reach:0:-1], points, 2 * points[-1] - points[-2 : -reach - 2 : -1]])
    smooth = gaussian_filter1d(extended, _SMOOTHING / _SPACING, axis=0)[reach : reach + len(points)]
    smooth[0], smooth[-1] = points[0], points[-1]
    return smooth


def _thinned(points: np.ndarray, closed: bool) -> np.ndarray:
    """As few of the points as the limits of turn and length of a piece allow; the ends stay."""
    steps = np.diff(np.vstack([points, points[:1]]) if closed else points, axis=0)
    turn = np.abs(_angle(steps[:-1], steps[1:]))
    spent = np.append([0.0, 0.0], np.cumsum(turn))[: len(points)] / _TURN
    spent = spent + np.arange(len(points)) * (_SPACING / _LENGTH)
    keep = np.append(True, np.diff(np.floor(spent)) > 0)
    keep[-1] = keep[-1] or not closed
    return points[keep]
