"""Where the veins of a leaf converge.

Veins are lines: the structure tensor of the lightness tells their direction, and how much a place is a line rather than
a surface or noise (coherence). Every such place votes for all points on its line; the point of most votes, each falling
off with the point's distance from the line, is found on a grid and refined (a Hough transform for points, with
Cauchy's loss). It is believed only where it stands out: veins that are nearly parallel, and texture that is none,
give many points as many votes.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel.images import linear_to_srgb
from fexel_tools.umbrella_elements import Element

__all__ = ["vein_convergence"]

_SIDE = 192  # pixels of the longer side at which veins are looked for
_RIM = 0.03  # of the longer side: so far from the contour nothing is looked at, since the contour is a line as well
_SPREAD = 0.03  # of the longer side: distance from a line at which its vote has halved
_MOST_LINES = 1000
_MOST_CANDIDATES = 400
_CROWDED, _EVIDENCE = 90.0, 1.35  # percentile of the votes, and how much more the best point must have


def vein_convergence(element: Element) -> NDArray[np.float64] | None:
    """The point where lines within an element converge.

    Parameters
    ----------
    element : Element

    Returns
    -------
    (2,) float64 or None
        Pixels, y up; None where there is not a line to be seen, or no point in which clearly more of them meet.
    """
    height, width = element.opacity.shape
    scale = min(1.0, _SIDE / max(height, width))
    size = (max(round(width * scale), 1), max(round(height * scale), 1))
    gray = linear_to_srgb(np.clip(element.color, 0, 1)).mean(axis=2, dtype=np.float32)
    gray = cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
    mask = cv2.resize(element.opacity, size, interpolation=cv2.INTER_AREA) >= 0.5
    depth = cv2.distanceTransform(np.pad(mask.astype(np.uint8), 1), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    side = float(max(size))
    position, normal, weight = _lines(gray, depth > max(_RIM * side, 2.0))
    if len(weight) < 8:
        return None
    rows, columns = np.nonzero(mask)
    step = max(len(rows) // _MOST_CANDIDATES, 1)
    candidates = np.stack([columns, rows], axis=1)[::step] + 0.5
    votes = _votes(candidates, position, normal, weight, _SPREAD * side)
    if votes.max() < _EVIDENCE * np.percentile(votes, _CROWDED):
        return None
    best = candidates[int(np.argmax(votes))]
    for spread in (_SPREAD, _SPREAD / 2):
        best = _refined(best, position, normal, weight, spread * side)
    x, y = best / scale
    return np.array([x, height - y])


def _lines(
    gray: NDArray[np.float32], inside: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Places on lines: position (N, 2) in pixels, y down; normal (N, 2), weight (N,)."""
    smooth = cv2.GaussianBlur(gray, (0, 0), 1.0)
    dx, dy = (cv2.Scharr(smooth, cv2.CV_32F, *order) / 32 for order in ((1, 0), (0, 1)))
    xx, xy, yy = (cv2.GaussianBlur(product, (0, 0), 2.0) for product in (dx * dx, dx * dy, dy * dy))
    spread = np.sqrt((xx - yy) ** 2 + 4 * xy * xy)
    coherence = spread / np.maximum(xx + yy, 1e-9)  # 1e-9 guards even places
    strength = np.where(inside, np.sqrt(np.maximum(xx + yy, 0)), 0)
    if not inside.any():
        return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
    typical = float(np.median(strength[inside])) + 1e-6
    weight = np.where(inside, coherence**2 * np.minimum(strength / typical, 3.0), 0)
    rows, columns = np.nonzero(weight > 0.25 * weight.max()) if weight.max() > 0 else (np.zeros(0, int),) * 2
    step = max(len(rows) // _MOST_LINES, 1)
    rows, columns = rows[::step], columns[::step]
    angle = 0.5 * np.arctan2(2 * xy[rows, columns], xx[rows, columns] - yy[rows, columns])
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float64)
    return np.stack([columns, rows], axis=1) + 0.5, normal, weight[rows, columns].astype(np.float64)


def _votes(
    candidates: NDArray[np.float64],
    position: NDArray[np.float64],
    normal: NDArray[np.float64],
    weight: NDArray[np.float64],
    spread: float,
) -> NDArray[np.float64]:
    along = (position * normal).sum(axis=1)
    distance = candidates @ normal.T - along
    return (weight / (1 + np.square(distance / spread))).sum(axis=1)


def _refined(
    point: NDArray[np.float64],
    position: NDArray[np.float64],
    normal: NDArray[np.float64],
    weight: NDArray[np.float64],
    spread: float,
) -> NDArray[np.float64]:
    """Reweighted least squares of the distances to all lines."""
    along = (position * normal).sum(axis=1)
    for _ in range(20):
        votes = weight / np.square(1 + np.square((normal @ point - along) / spread))
        matrix = (normal * votes[:, None]).T @ normal + 1e-6 * votes.sum() * np.eye(2)  # guards parallel lines
        step = np.linalg.solve(matrix, normal.T @ (votes * (along - normal @ point)))
        point = point + step
        if np.hypot(*step) < 0.01:
            break
    return point
