"""How well two photos agree where one was placed in the other: likeness, detail, local displacements.

A right placement agrees everywhere and down to the finest detail that the parent shows; a repeated window or a chance
likeness agrees in the coarse shapes only. The photo's footprint is divided into blocks. A textured block agrees when
its fine structure correlates; what remains of misplacement in it is measured by one Lucas-Kanade step, which
makes lens distortion and relief visible as a residual in pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from fexel_tools.alignment import Template, map_points, sample_parent, tone_fit
from fexel_tools.alignment_kernels import correlation
from fexel_tools.features import Features

__all__ = ["Evidence", "measure"]

_BLOCKS = 8  # across the footprint
_SMALLEST_BLOCK = 6  # grid spacings
_DETAIL_SIGMA = 2.0  # grid spacings; what is finer counts as detail
_FAINT = 1.2 / 255  # rms detail below which a block shows nothing but noise


@dataclass(frozen=True)
class Evidence:
    """Agreement of photo and parent.

    Attributes
    ----------
    correlation : float
        Of luminance over the footprint, in [-1, 1].
    detail : float
        The same for what is finer than a few parent pixels.
    blocks : int
        Textured blocks of the footprint.
    agreeing : float
        Share of them whose detail correlates, in [0, 1].
    rms_px : float
        Root mean square displacement left in the agreeing blocks, weighted by their gradients, parent pixels; inf
        where there are none.
    contrast : float
        Standard deviation of the photo's encoded luminance, in [0, 1].
    samples : int
        Grid points.
    """

    correlation: float
    detail: float
    blocks: int
    agreeing: float
    rms_px: float
    contrast: float
    samples: int


def measure(parent: Features, template: Template, matrix: np.ndarray) -> Evidence:
    """Compare the photo with the parent at one placement.

    Parameters
    ----------
    parent : Features
    template : Template
        Luminance; its grid should be about as dense as the parent's pixels.
    matrix : (3, 3) float64
        Photo to parent.
    """
    rows, columns = template.values.shape[:2]
    sampled = sample_parent(parent, template, matrix)
    valid = np.isfinite(sampled[:, 0])
    whole = float(correlation(template.values.reshape(-1, 1), sampled, 0.0))
    fitted = tone_fit(template.values.reshape(-1), sampled[:, 0])
    target = np.where(valid, sampled[:, 0], fitted)
    spacing = _spacing(template, matrix)
    a, b = (image.reshape(rows, columns).astype(np.float32) for image in (fitted, target))
    mask = valid.reshape(rows, columns)
    detail, blocks, agreeing, rms = _compare_blocks(a, b, mask)
    contrast = float(template.values.std())
    return Evidence(whole, detail, blocks, agreeing, rms * spacing, contrast, int(valid.sum()))


def _spacing(template, matrix):
    """Parent pixels per grid step at the photo's centre."""
    step = 1 / template.values.shape[1]
    ends = map_points((matrix @ template.photo_from_grid)[None], np.array([[-step, 0.0], [step, 0.0]]))[0]
    return float(np.linalg.norm(ends[1] - ends[0])) if np.isfinite(ends).all() else 1.0


def _compare_blocks(a, b, mask):
    """Detail correlation, textured blocks, share that agrees, rms displacement in grid spacings."""
    fine_a = a - cv2.GaussianBlur(a, (0, 0), _DETAIL_SIGMA)
    fine_b = b - cv2.GaussianBlur(b, (0, 0), _DETAIL_SIGMA)
    power = float((fine_a[mask] ** 2).sum() * (fine_b[mask] ** 2).sum())
    detail = float((fine_a * fine_b)[mask].sum() / np.sqrt(power)) if power > 0 else 0.0
    across = int(np.clip(a.shape[1] // _SMALLEST_BLOCK, 1, _BLOCKS))
    down = int(np.clip(a.shape[0] // _SMALLEST_BLOCK, 1, _BLOCKS))
    moments = _Moments(a, b, fine_a, fine_b, mask.astype(np.float32), down, across)
    textured = moments.texture > _FAINT
    agree = textured & (moments.likeness > 0.5)
    moved = moments.displacements()[agree]
    trust = (moments.xx + moments.yy)[agree] + 1e-12  # faint blocks hardly say where they are; 1e-12: all flat
    rms = float(np.sqrt(np.average(np.minimum(moved, 4.0) ** 2, weights=trust))) if len(moved) else np.inf
    return detail, int(textured.sum()), float(agree.sum() / max(textured.sum(), 1)), rms


class _Moments:
    """Sums over blocks of what likeness and displacement need."""

    def __init__(self, a, b, fine_a, fine_b, mask, down, across) -> None:
        def total(image):
            bounds_y = np.linspace(0, image.shape[0], down + 1).astype(int)[:-1]
            bounds_x = np.linspace(0, image.shape[1], across + 1).astype(int)[:-1]
            return np.add.reduceat(np.add.reduceat(image * mask, bounds_y, axis=0), bounds_x, axis=1)

        count = np.maximum(total(np.ones_like(a)), 1)
        mean_a, mean_b = total(a) / count, total(b) / count
        cross = total(a * b) - count * mean_a * mean_b
        self_a = np.maximum(total(a * a) - count * mean_a**2, 1e-12)
        self_b = np.maximum(total(b * b) - count * mean_b**2, 1e-12)
        self.likeness = cross / np.sqrt(self_a * self_b)
        self.texture = np.sqrt(np.minimum(total(fine_a**2), total(fine_b**2)) / count)
        dy, dx = np.gradient(a)
        residual = b - a
        self.xx, self.xy, self.yy = total(dx * dx), total(dx * dy), total(dy * dy)
        self.rx, self.ry = total(dx * residual), total(dy * residual)
        self.x, self.y, self.r, self.count = total(dx), total(dy), total(residual), count

    def displacements(self):
        """Length of the translation that explains each block's residual, along directions with texture."""
        xx, xy, yy = (
            self.xx - self.x * self.x / self.count,
            self.xy - self.x * self.y / self.count,
            self.yy - self.y * self.y / self.count,
        )
        rx, ry = self.rx - self.x * self.r / self.count, self.ry - self.y * self.r / self.count
        ridge = 0.05 * (xx + yy) + 1e-9  # an edge tells nothing of motion along it
        xx, yy = xx + ridge, yy + ridge
        determinant = xx * yy - xy * xy
        return np.hypot((yy * rx - xy * ry) / determinant, (xx * ry - xy * rx) / determinant)
