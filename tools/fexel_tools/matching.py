"""Descriptor matches between two photos, and the placement that each match votes for.

A RootSIFT feature has a position, a size and an orientation, so one match fixes a similarity. Across a large zoom only
the photo's coarse features can appear in the parent; its fine ones are the majority and match nothing. Features are
therefore drawn evenly from the photo's octaves, and a match need not pass a ratio test: every one is a candidate, to be
judged by how the photos agree there (`fexel_tools.placement_search`).
"""

from __future__ import annotations

import cv2
import numpy as np

from fexel_tools.features import Features

__all__ = ["Matches", "coverage", "fit_homography", "guided_matches", "match_features", "similarities"]

NEIGHBOURS = 2
PER_OCTAVE = 350
_BLOCK = 512  # rows of the similarity matrix at a time


class Matches:
    """Candidate matches: `photo` and `parent` are (M,) indices of features, `cosine` (M,) their likeness."""

    def __init__(self, photo: np.ndarray, parent: np.ndarray, cosine: np.ndarray) -> None:
        self.photo, self.parent, self.cosine = photo, parent, cosine


def match_features(
    parent: Features, photo: Features, *, neighbours: int = NEIGHBOURS, per_octave: int = PER_OCTAVE
) -> Matches:
    """Nearest parent features of a sample of the photo's features.

    Parameters
    ----------
    parent, photo : Features
    neighbours : int
        Candidates per feature of the photo.
    per_octave : int
        Features of the photo taken from each octave of size.
    """
    rows = _sample(photo, per_octave)
    neighbours = min(neighbours, len(parent.points))
    if not len(rows) or not neighbours:
        return Matches(np.zeros(0, int), np.zeros(0, int), np.zeros(0))
    columns, cosines = [], []
    transposed = np.ascontiguousarray(parent.descriptors.T)
    for start in range(0, len(rows), _BLOCK):
        likeness = photo.descriptors[rows[start : start + _BLOCK]] @ transposed
        line = np.arange(len(likeness))
        for _ in range(neighbours):
            best = likeness.argmax(axis=1)
            columns.append(best)
            cosines.append(likeness[line, best])
            likeness[line, best] = -1
    sizes = [len(rows[start : start + _BLOCK]) for start in range(0, len(rows), _BLOCK)]
    photo_rows = np.concatenate([np.tile(part, neighbours) for part in np.split(rows, np.cumsum(sizes)[:-1])])
    return Matches(photo_rows, np.concatenate(columns), np.concatenate(cosines).astype(np.float64))


def similarities(parent: Features, photo: Features, matches: Matches) -> tuple[np.ndarray, np.ndarray]:
    """The similarity that each match votes for.

    Returns
    -------
    matrices : (M, 3, 3) float64
        Photo to parent.
    scales : (M,) float64
        Photo pixels per parent pixel.
    """
    scales = photo.sizes[matches.photo] / parent.sizes[matches.parent]
    turn = parent.angles[matches.parent] - photo.angles[matches.photo]
    cos, sin = np.cos(turn) / scales, np.sin(turn) / scales
    x, y = photo.points[matches.photo].T
    u, v = parent.points[matches.parent].T
    matrices = np.zeros((len(scales), 3, 3))
    matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 0, 2] = cos, -sin, u - cos * x + sin * y
    matrices[:, 1, 0], matrices[:, 1, 1], matrices[:, 1, 2] = sin, cos, v - sin * x - cos * y
    matrices[:, 2, 2] = 1
    return matrices, scales


def guided_matches(
    parent: Features, photo: Features, matches: Matches, matrix: np.ndarray, radius_px: float
) -> np.ndarray:
    """Matches that agree with a homography in position and roughly in size.

    Returns
    -------
    (N, 4) float64
        x, y in the photo and x, y in the parent; each feature of either photo at most once, the nearest pair first.
    """
    mapped = photo.points[matches.photo] @ matrix[:, :2].T + matrix[:, 2]
    in_front = mapped[:, 2] > 0
    mapped = mapped[:, :2] / np.where(in_front, mapped[:, 2], 1)[:, None]
    error = np.linalg.norm(mapped - parent.points[matches.parent], axis=1)
    # Features of one place come in several sizes: those of another size say nothing about the placement.
    scale = 1 / np.sqrt(max(abs(np.linalg.det(matrix[:2, :2])), 1e-12))
    ratio = photo.sizes[matches.photo] / parent.sizes[matches.parent] / scale
    agree = np.flatnonzero(in_front & (error < radius_px) & (ratio > 0.6) & (ratio < 1.7))
    agree = agree[np.argsort(error[agree], kind="stable")]
    seen_photo, seen_parent, kept = set(), set(), []
    for k in agree:
        place = tuple(np.round(parent.points[matches.parent[k]], 1))
        if matches.photo[k] not in seen_photo and place not in seen_parent:
            kept.append(k)
            seen_photo.add(matches.photo[k])
            seen_parent.add(place)
    return np.column_stack([photo.points[matches.photo[kept]], parent.points[matches.parent[kept]]])


def fit_homography(points: np.ndarray, radius_px: float) -> np.ndarray | None:
    """Robust homography through point pairs (MAGSAC++, Barath et al., CVPR 2020); deterministic.

    Parameters
    ----------
    points : (N, 4) float64
        x, y in the photo, x, y in the parent.
    radius_px : float
        Bound of an inlier's error, parent pixels.

    Returns
    -------
    (3, 3) float64 or None
        Photo to parent; None where the points determine none.
    """
    if len(points) < 8:  # four determine it, the others confirm
        return None
    matrix, _ = cv2.findHomography(points[:, :2], points[:, 2:], cv2.USAC_MAGSAC, radius_px)
    if matrix is None or not np.isfinite(matrix).all() or np.linalg.det(matrix) <= 0:
        return None
    return matrix


def coverage(points: np.ndarray, width: int, height: int) -> float:
    """Share of a photo that the convex hull of its points covers; points (N, 2)."""
    if len(points) < 3:
        return 0.0
    hull = cv2.convexHull(points.astype(np.float32))
    return float(cv2.contourArea(hull)) / (width * height)


def _sample(features, per_octave):
    """Indices of the strongest features of each octave of size."""
    if not len(features.sizes):
        return np.zeros(0, int)
    octave = np.floor(np.log2(features.sizes / features.sizes.min()) + 1e-9).astype(
        int
    )  # 1e-9: rounding of the smallest
    order = np.lexsort((-features.responses, octave))
    _, first, counts = np.unique(octave[order], return_index=True, return_counts=True)
    rank = np.arange(len(order)) - np.repeat(first, counts)
    return order[rank < per_octave]
