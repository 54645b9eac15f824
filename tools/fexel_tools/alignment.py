"""Photometric alignment: Gauss-Newton on a homography so that one photo looks like the other.

A template, the photo averaged to about the parent's resolution, lies on a grid. The parent is sampled where the grid
falls, the template is fitted to it in brightness (a quadratic per channel, which takes up exposure, white balance and
gamma), and the placement is updated from the residual. The update is inverse compositional, so that gradients come
from the template, which the averaging has made nearly free of noise; weights are Geman and McClure's, so that moving
content does not pull. The inner loops are in `fexel_tools.alignment_kernels`.

Sources: Baker and Matthews, "Lucas-Kanade 20 years on: a unifying framework", IJCV 2004, section 3.2; Evangelidis and
Psarakis, "Parametric image alignment using enhanced correlation coefficient maximization", PAMI 2008.

Conventions: matrices map continuous pixel coordinates of the photo to the parent's, column vectors.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from fexel_tools.alignment_kernels import correlate_many, correlation, gauss_newton_step, sample_grid, tone_curve
from fexel_tools.features import Features

__all__ = ["Template", "align", "correlations", "make_template", "map_points", "sample_parent", "tone_fit"]

_MIN_INSIDE = 0.5  # share of the grid that must fall into the parent


@dataclass(frozen=True, eq=False)
class Template:
    """The photo on a grid.

    Attributes
    ----------
    values : (rows, columns, C) float32
        C is 1 (luminance) or 3, perceptually encoded, in [0, 1].
    photo_from_grid : (3, 3) float64
        The photo spans [-1, 1] in the grid's x and [-aspect, aspect] in y.
    aspect : float
        Height over width.
    """

    values: np.ndarray
    photo_from_grid: np.ndarray
    aspect: float


def make_template(photo: Features, columns: int, *, color: bool = False) -> Template:
    """Average a photo down to a grid of so many columns (and as many rows as its shape asks for)."""
    aspect = photo.height / photo.width
    rows = max(2, round(columns * aspect))
    fine_enough = [k for k, image in enumerate(photo.pyramid) if image.shape[1] >= columns and image.shape[0] >= rows]
    image = photo.pyramid[max(fine_enough, default=0)]
    if not color:
        image = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    values = cv2.resize(image.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
    half = photo.width / 2
    frame = np.array([[half, 0, half], [0, half, photo.height / 2], [0, 0, 1.0]])
    return Template(values.reshape(rows, columns, -1) * np.float32(1 / 65535), frame, aspect)


def map_points(matrices: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Map N points through K homographies, (K, N, 2); NaN where w <= 0."""
    homogeneous = np.column_stack([points, np.ones(len(points))]) @ np.swapaxes(matrices, 1, 2)
    w = homogeneous[..., 2:]
    return np.where(w > 0, homogeneous[..., :2] / np.where(w > 0, w, 1), np.nan)


def sample_parent(parent: Features, template: Template, matrix: np.ndarray) -> np.ndarray:
    """Look up the parent where the template's grid falls, from the level whose pixels are about as large as its steps.

    Returns
    -------
    (rows * columns, C) float32
        Row by row; NaN outside the parent.
    """
    warp = _normalised((matrix @ template.photo_from_grid)[None])
    level = int(_levels(parent, warp, template.values.shape[1])[0])
    rows, columns, channels = template.values.shape
    warp = _level_from_parent(parent, level) @ warp[0]
    return sample_grid(parent.pyramid[level], warp, rows, columns, template.aspect, channels)


def correlations(parent: Features, template: Template, matrices: np.ndarray) -> np.ndarray:
    """Zero-mean normalised correlation of a luminance template with the parent at K placements, (K,) float64.

    -1 where too little lies inside the parent or nothing is to be seen.
    """
    warps = _normalised(matrices @ template.photo_from_grid)
    levels = _levels(parent, warps, template.values.shape[1])
    result = np.empty(len(warps))
    for level in np.unique(levels):
        chosen = levels == level
        local = _level_from_parent(parent, level) @ warps[chosen]
        values = template.values[:, :, 0]
        result[chosen] = correlate_many(parent.pyramid[level], local, values, template.aspect, _MIN_INSIDE)
    return result


def align(
    parent: Features, template: Template, matrix: np.ndarray, *, unknowns: int, iterations: int, tolerance: float
) -> tuple[np.ndarray, float]:
    """Improve a placement.

    Parameters
    ----------
    parent : Features
    template : Template
    matrix : (3, 3) float64
        Photo to parent.
    unknowns : {4, 6, 8}
        Similarity, affinity or homography: the fewer, the wider the basin and the less a small footprint suffers.
    iterations : int
        At most so many.
    tolerance : float
        Stop when the grid's rim moves by no more, in grid steps.

    Returns
    -------
    matrix : (3, 3) float64
    correlation : float
        Of the result, in [-1, 1]; -1 where the placement left the parent or degenerated.
    """
    rows, columns, channels = template.values.shape
    warp = _normalised((matrix @ template.photo_from_grid)[None])[0]
    level = int(_levels(parent, warp[None], columns)[0])
    to_level = _level_from_parent(parent, level)
    image = parent.pyramid[level]
    for _ in range(iterations):
        sampled = sample_grid(image, to_level @ warp, rows, columns, template.aspect, channels)
        step = gauss_newton_step(template.values, sampled, template.aspect, unknowns, _MIN_INSIDE)
        tx, ty, a, b, c, d, g, h = step
        motion = np.array([[1 + a, b, tx], [c, 1 + d, ty], [g, h, 1.0]])
        if abs(np.linalg.det(motion)) < 0.05:  # a step that collapses the grid
            break
        warp = _normalised((warp @ np.linalg.inv(motion))[None])[0]
        if np.abs(step).sum() * columns / 2 < tolerance:
            break
    if not _sane(warp, template.aspect):
        return matrix, -1.0
    sampled = sample_grid(image, to_level @ warp, rows, columns, template.aspect, channels)
    score = float(correlation(template.values.reshape(-1, channels), sampled, _MIN_INSIDE))
    return warp @ np.linalg.inv(template.photo_from_grid), score


def tone_fit(values: np.ndarray, sampled: np.ndarray) -> np.ndarray:
    """Template values as the parent would show them: a quadratic by least squares over finite samples; both (N,)."""
    constant, slope, bend, mean = tone_curve(values, sampled)
    offset = values - mean
    return constant + offset * (slope + offset * bend)


def _levels(parent, warps, columns):
    """Pyramid level whose pixels are about as large as the grid's steps, per warp."""
    jacobian = warps[:, :2, :2] - warps[:, :2, 2:] @ warps[:, 2:, :2]
    spacing = np.linalg.norm(jacobian[:, :, 0], axis=1) * 2 / columns
    relative = np.log2(np.maximum(spacing / np.sqrt(parent.reduction.prod()), 1))
    return np.clip(np.rint(relative), 0, len(parent.pyramid) - 1).astype(int)


def _level_from_parent(parent, level):
    height, width = parent.pyramid[level].shape[:2]
    return np.diag([width / parent.width, height / parent.height, 1.0])


def _normalised(warps):
    """Scaled to w = 1 at the photo's centre."""
    w = warps[:, 2, 2]
    return warps / np.where(np.abs(w) > 1e-12, w, 1)[:, None, None]  # 1e-12: the centre lies at infinity


def _sane(warp, aspect):
    """Not mirrored, all corners in front, the outline not far from a parallelogram."""
    if not np.isfinite(warp).all():
        return False
    corners = map_points(warp[None], np.array([[-1, -aspect], [1, -aspect], [1, aspect], [-1, aspect]]))[0]
    edges = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edges, -1, axis=0)
    turn = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    return bool(np.isfinite(turn).all() and turn.min() > 0.2 * turn.max())
