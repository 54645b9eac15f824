"""Shapes of merged umbrellas: which umbrellas of a cell become one, and its contour.

After "Just-in-time texture synthesis" (2012), section 5: the umbrellas of four cells are grouped by k-means of their
centres, a group's contour is its convex hull, and vertices are removed where edges are closest to 180 degrees.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["group", "hull", "signed_area_of", "simplify"]

_ROUNDS = 20  # of k-means, which mostly settles in five
_FLAT = 1e-9  # area, in square cells, below which a hull is a line


def group(features: NDArray[np.float64], weights: NDArray[np.float64], k: int) -> NDArray[np.int64]:
    """Groups of points by k-means, the same for the same input.

    Parameters
    ----------
    features : (m, d) float64
    weights : (m,) float64
        Positive.
    k : int
        At most so many groups.

    Returns
    -------
    (m,) int64
        Number of each point's group, from 0 on; with k >= m every point is its own.
    """
    if len(features) <= k:
        return np.arange(len(features))
    centers = _spread(features, weights, k)
    groups = np.full(len(features), -1)
    for _ in range(_ROUNDS):
        nearest = ((features[:, None] - centers) ** 2).sum(axis=2).argmin(axis=1)
        if (nearest == groups).all():
            break
        groups = nearest
        total = np.bincount(groups, weights, k)
        for axis in range(features.shape[1]):
            sums = np.bincount(groups, weights * features[:, axis], k)
            centers[:, axis] = np.where(total > 0, sums / np.where(total > 0, total, 1.0), centers[:, axis])
    return np.unique(groups, return_inverse=True)[1].reshape(-1)


def hull(points: NDArray[np.float64], vertices: int) -> NDArray[np.float64]:
    """Convex hull of points (m, 2), counter-clockwise, of at most so many vertices; (0, 2) where it has no area."""
    if len(points) < 3:
        return np.zeros((0, 2))
    middle = points.mean(axis=0)  # 32 bits are enough near the origin
    contour = cv2.convexHull((points - middle).astype(np.float32))[:, 0].astype(np.float64)
    if len(contour) < 3 or abs(signed_area_of(contour)) < _FLAT:
        return np.zeros((0, 2))
    contour = contour if signed_area_of(contour) > 0 else contour[::-1]
    return simplify(contour, vertices) + middle


def simplify(contour: NDArray[np.float64], vertices: int) -> NDArray[np.float64]:
    """Remove vertices of a convex contour (m, 2), where its edges are closest to 180 degrees first."""
    while len(contour) > max(vertices, 3):
        before, after = contour - np.roll(contour, 1, axis=0), np.roll(contour, -1, axis=0) - contour
        cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        bend = np.abs(np.arctan2(cross, (before * after).sum(axis=1)))
        contour = np.delete(contour, bend.argmin(), axis=0)
    return contour


def signed_area_of(contour: NDArray[np.float64]) -> float:
    """Area of a polygon (m, 2), positive where it runs counter-clockwise."""
    x, y = contour.T
    return 0.5 * float(x @ np.roll(y, -1) - np.roll(x, -1) @ y)


def _spread(features: NDArray[np.float64], weights: NDArray[np.float64], k: int) -> NDArray[np.float64]:
    """Points far from each other, to begin with: the heaviest, then always the one that is farthest from all others."""
    chosen = [int(weights.argmax())]
    distance = ((features - features[chosen[0]]) ** 2).sum(axis=1)
    while len(chosen) < k:
        chosen.append(int((distance * weights).argmax()))
        distance = np.minimum(distance, ((features - features[chosen[-1]]) ** 2).sum(axis=1))
    return features[chosen].copy()
