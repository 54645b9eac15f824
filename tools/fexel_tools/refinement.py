"""Photometric refinement of a placement, from coarse to the parent's own resolution.

The coarser levels widen the basin; the last has about one sample per parent pixel and all three channels, where the
homography is as exact as the parent allows.
"""

from __future__ import annotations

import numpy as np

from fexel_tools.alignment import align, make_template
from fexel_tools.features import Features
from fexel_tools.verification import Evidence, measure

__all__ = ["footprint_columns", "measure_placement", "refine_placement"]

_MOST_COLUMNS = 360
_COARSEST_COLUMNS = 32
_HOPELESS = 0.35  # correlation below which finer levels are not worth the time


def footprint_columns(parent: Features, photo: Features, matrix: np.ndarray) -> float:
    """Width of the photo's footprint in the parent's working pixels."""
    centre = np.array([photo.width / 2, photo.height / 2, 1.0])
    x, y, w = matrix @ centre
    jacobian = (matrix[:2, :2] - np.outer([x / w, y / w], matrix[2, :2])) / w
    per_pixel = np.sqrt(abs(np.linalg.det(jacobian)))
    return float(photo.width * per_pixel / np.sqrt(parent.reduction.prod()))


def refine_placement(
    parent: Features, photo: Features, matrix: np.ndarray, *, from_columns: int = _COARSEST_COLUMNS
) -> tuple[np.ndarray, Evidence]:
    """Align level by level and measure the agreement.

    Parameters
    ----------
    parent, photo : Features
    matrix : (3, 3) float64
        Photo to parent, right within a few per cent of the footprint.
    from_columns : int
        Samples across the photo at the first level.

    Returns
    -------
    matrix : (3, 3) float64
    Evidence
    """
    finest = _finest(parent, photo, matrix)
    for columns in _ladder(min(from_columns, finest), finest):
        last = columns == finest
        template = make_template(photo, columns, color=last)
        tolerance = 0.005 if last else 0.03
        matrix, score = align(parent, template, matrix, unknowns=8, iterations=12, tolerance=tolerance)
        if score < _HOPELESS:
            finest = columns
            break
    return matrix, measure(parent, make_template(photo, finest), matrix)


def measure_placement(parent: Features, photo: Features, matrix: np.ndarray) -> Evidence:
    """Measure the agreement at the finest level, without aligning."""
    return measure(parent, make_template(photo, _finest(parent, photo, matrix)), matrix)


def _finest(parent, photo, matrix):
    """Samples across the photo: one per pixel of a pyramid level of the parent, so that both are averaged alike."""
    columns = footprint_columns(parent, photo, matrix)
    while columns > _MOST_COLUMNS:
        columns /= 2
    return max(16, round(columns))


def _ladder(first: int, last: int) -> list[int]:
    """Numbers of columns from coarse to fine, doubling, up to the last."""
    ladder = [last]
    while ladder[0] >= 2 * first:
        ladder.insert(0, round(ladder[0] / 2))
    return ladder
