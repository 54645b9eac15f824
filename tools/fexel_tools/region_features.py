"""What regions of a picture are told apart by: numbers in which equal distances look equally different.

Features are CIELAB, multiplied by alpha, and transparency as a fourth of the same range; of normal maps the normals in
degrees of angle; of other data the values in per cent of their range.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel.images import linear_to_srgb

__all__ = ["RegionFeatures"]

_COARSE_PX = 512  # longer side of the reduced picture
_DEGREES = 180 / np.pi
_ENCODED = linear_to_srgb(np.linspace(0, 1, 4097) ** 2)


class RegionFeatures:
    """A picture, full and reduced, as features.

    Parameters
    ----------
    color : (H, W, 3) float32
        Linear Rec.709, straight; stored values where `is_data`. Finite.
    opacity : (H, W) float32
    is_data : bool
    """

    def __init__(self, color: NDArray[np.float32], opacity: NDArray[np.float32], is_data: bool) -> None:
        self.color, self.opacity, self.is_data = color, opacity, is_data
        self.is_opaque = bool(opacity.min() >= 1)
        height, width = opacity.shape
        scale = min(1.0, _COARSE_PX / max(height, width))
        size = (max(1, round(scale * width)), max(1, round(scale * height)))
        self.coarse_opacity = np.ones(size[::-1], np.float32) if self.is_opaque else _resized(opacity, size)
        self.coarse = _resized(color if self.is_opaque else color * opacity[..., None], size)
        if not self.is_opaque:
            self.coarse /= np.maximum(self.coarse_opacity, 1e-6)[..., None]  # 1e-6 guards transparent pixels

    def features(self) -> NDArray[np.float32]:
        """(h, w, 3 or 4) as the module says."""
        values = _data_features(self.coarse) if self.is_data else _lab(self.coarse)
        return _with_opacity(values, self.coarse_opacity, 100.0, self.is_opaque)

    def mixtures(self) -> NDArray[np.float32]:
        """(h, w, 3 or 4): what pixels at edges are mixtures of."""
        return self._mixtures(self.coarse, self.coarse_opacity)

    def gather(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.float32]:
        """`mixtures` of pixels of the full picture."""
        return self._mixtures(self.color[rows, columns], self.opacity[rows, columns])

    def _mixtures(self, color: NDArray[np.float32], opacity: NDArray[np.float32]) -> NDArray[np.float32]:
        # Anti-aliasing of drawings mixes encoded values, and half-way between those is where an edge is seen to be.
        return _with_opacity(color if self.is_data else _encoded(color), opacity, 1.0, self.is_opaque)


def _resized(plane: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    return cv2.resize(plane, size, interpolation=cv2.INTER_AREA)


def _with_opacity(
    values: NDArray[np.float32], opacity: NDArray[np.float32], full: float, is_opaque: bool
) -> NDArray[np.float32]:
    if is_opaque:
        return values
    return np.concatenate([values * opacity[..., None], np.float32(full) * (1 - opacity[..., None])], axis=-1)


def _encoded(color: NDArray[np.float32]) -> NDArray[np.float32]:
    """sRGB-encoded values by table, to 2e-4; of light brighter than 1 that of 1."""
    return _ENCODED[np.rint(np.sqrt(np.clip(color, 0, 1)) * (len(_ENCODED) - 1)).astype(np.int16)]


def _lab(color: NDArray[np.float32]) -> NDArray[np.float32]:
    return cv2.cvtColor(np.clip(color, 0, 1), cv2.COLOR_LRGB2Lab)


def _data_features(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Normals as unit vectors times 180/pi, so that small distances are angles in degrees; else per cent of range."""
    normals = values if values.min() < 0 else 2 * values - 1
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    if np.median(np.abs(length - 1)) < 0.1:
        return (normals * (_DEGREES / np.maximum(length, 1e-6))).astype(np.float32)  # 1e-6 guards zero vectors
    span = float(values.max() - values.min())
    return (values - values.min()) * np.float32(100 / max(span, 1e-6))  # 1e-6 guards constant data
