"""Where in the parent a photo could lie: every match is a candidate, and how the photos agree there is the judge.

Each feature match votes for a similarity. All votes are scored by the correlation of the photo, averaged to a few
hundred samples, with the parent sampled where the vote puts them; the best and those that most other votes support are
aligned photometrically, first as similarities, then as affinities, and scored again. One right match among thousands
is enough, which is what large zoom leaves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fexel_tools.alignment import align, correlations, make_template, map_points
from fexel_tools.alignment_kernels import count_agreeing
from fexel_tools.features import Features

__all__ = ["Placements", "search_placements"]

_COARSE_COLUMNS = 16
_FINE_COLUMNS = 32
_ALIGNED = 40  # candidates that are aligned
_FINE = 8  # of them, aligned once more on a finer grid
_MIN_SCALE = 0.7
_MAX_SCALE = 100.0


@dataclass(frozen=True, eq=False)
class Placements:
    """Distinct candidates, the best first: matrices (K, 3, 3), correlations (K,), supporting votes (K,)."""

    matrices: np.ndarray
    correlations: np.ndarray
    support: np.ndarray


def search_placements(parent: Features, photo: Features, votes: np.ndarray, scales: np.ndarray) -> Placements:
    """Score, align and rank the placements that matches vote for.

    Parameters
    ----------
    parent, photo : Features
    votes : (M, 3, 3) float64
        Similarities, photo to parent.
    scales : (M,) float64
        Photo pixels per parent pixel.
    """
    usable = (scales > _MIN_SCALE) & (scales < _MAX_SCALE) & _footprint_large_enough(parent, photo, scales)
    votes = votes[usable]
    if not len(votes):
        return Placements(np.zeros((0, 3, 3)), np.zeros(0), np.zeros(0, int))
    coarse = make_template(photo, _COARSE_COLUMNS)
    scores = correlations(parent, coarse, votes)
    corners = _corners(votes, photo)
    support = _support(corners)
    chosen = _choose(scores, support, corners)
    matrices, _ = _align_all(parent, coarse, votes[chosen], 4, 5)
    matrices, scores = _align_all(parent, coarse, matrices, 6, 5)
    support = support[chosen]
    order = _distinct(matrices, scores, photo)[:_FINE]
    fine = make_template(photo, _FINE_COLUMNS)
    matrices, scores = _align_all(parent, fine, matrices[order], 6, 8)
    support = support[order]
    order = _distinct(matrices, scores, photo)
    return Placements(matrices[order], scores[order], support[order])


def _footprint_large_enough(parent, photo, scales):
    """At least 16 working pixels across: less cannot be told from chance."""
    return photo.width / scales / parent.reduction[0] >= 16


def _align_all(parent, template, matrices, unknowns, iterations):
    """Align each; (K, 3, 3) and (K,)."""
    results = [align(parent, template, m, unknowns=unknowns, iterations=iterations, tolerance=0.05) for m in matrices]
    return np.array([m for m, _ in results]).reshape(-1, 3, 3), np.array([score for _, score in results])


def _corners(matrices, photo):
    """The photo's corners in the parent, (K, 4, 2)."""
    outline = np.array([[0, 0], [photo.width, 0], [photo.width, photo.height], [0, photo.height]], np.float64)
    return map_points(matrices, outline)


def _extent(corners):
    """Half the footprint's width, (K,)."""
    return np.maximum(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1) / 2, 1e-6)  # 1e-6: a collapsed footprint


def _support(corners):
    """How many votes agree with each at every corner, itself included."""
    radius = _extent(corners) * 0.35
    return count_agreeing(corners, np.argsort(corners[:, 0, 0], kind="stable"), radius)


def _choose(scores, support, corners):
    """The best by correlation and the best supported, no two of nearly the same place."""
    chosen = []
    half = _ALIGNED // 2
    by_support = np.lexsort((-scores, -support))
    for order, quota in ((by_support, half), (np.argsort(-scores, kind="stable"), _ALIGNED)):
        for k in order[: 20 * quota]:
            if len(chosen) >= quota:
                break
            if scores[k] > 0.2 and not _repeated(corners[k], corners[chosen], 0.12):
                chosen.append(int(k))
    return np.array(chosen, int)


def _distinct(matrices, scores, photo):
    """Order by score, leaving out what repeats a better one."""
    corners = _corners(matrices, photo)
    kept = []
    for k in np.argsort(-scores, kind="stable"):
        if scores[k] > 0 and np.isfinite(corners[k]).all() and not _repeated(corners[k], corners[kept], 0.1):
            kept.append(int(k))
    return np.array(kept, int)


def _repeated(corners, others, fraction):
    if not len(others):
        return False
    limit = fraction * np.linalg.norm(corners[1] - corners[0])
    return bool((np.abs(others - corners).max(axis=(1, 2)) < limit).any())
