"""Elements cut from a photo at full resolution: opacity along their rims, and colours free of the ground.

On a plain ground a rim pixel is a mixture of element and ground, in linear light: c = a f + (1 - a) g. The element's
colour f and the ground's colour g near a rim pixel are continued from pixels that are surely one or the other, and
a = (c - g).(f - g) / |f - g|^2 is the opacity. Where two elements touch, and where f and g hardly differ, the segment
itself tells.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel_tools.color_bleed import bleed_color

__all__ = ["cut_out", "rim_opacity"]

_BAND_PX = 2.0  # of the photo reduced for segmentation: so far from the segment's rim pixels may be mixtures
_LEAST_CONTRAST = 0.02  # |f - g| in linear light over the brighter of the two, below which a mixture tells nothing
_OWN_OPACITY = 0.98  # from here on the colour of a pixel is the element's own


def rim_opacity(
    color: NDArray[np.float32], own: NDArray[np.bool_], other: NDArray[np.bool_], factor: int
) -> NDArray[np.float32]:
    """Opacity of an element.

    Parameters
    ----------
    color : (H, W, 3) float32
        Linear, or data.
    own, other : (h, w) bool
        The element's segment, and those of all others, where one pixel stands for `factor` x `factor` of `color`.
    factor : int

    Returns
    -------
    (H, W) float32
        0..1.
    """
    smooth = _enlarged(own, color.shape[:2], factor)
    blocked = _enlarged(other, color.shape[:2], factor) > 0.05
    band = _BAND_PX * factor
    inside = _distance(smooth >= 0.5)
    outside = _distance(smooth < 0.5)
    deep = inside > min(band, 0.7 * float(inside.max()))
    clear = (outside > band) & ~blocked
    if not deep.any() or not clear.any():
        return smooth
    front = bleed_color(color, deep.astype(np.float32))
    behind = bleed_color(color, clear.astype(np.float32))
    mixed, contrast = _mixture(color, front, behind)
    opacity = np.where(contrast > _LEAST_CONTRAST, mixed, smooth)
    near_other = cv2.dilate(blocked.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    opacity = np.where(near_other, np.minimum(smooth, opacity), opacity)
    opacity = np.where(deep, 1, np.where(outside > band, 0, opacity))
    return _attached(opacity.astype(np.float32), deep)


def cut_out(color: NDArray[np.float32], opacity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Colour of the element alone, continued over pixels that also show what is behind it.

    Pixels that are translucent throughout the element, glass for instance, keep their colour.
    """
    own = opacity >= _OWN_OPACITY
    inside = _distance(opacity >= 0.5) > _BAND_PX
    trusted = own | (inside & (opacity > 1 / 16))
    if not trusted.any():
        trusted = opacity >= 0.9 * float(opacity.max())
    return bleed_color(color, trusted.astype(np.float32))


def _enlarged(mask: NDArray[np.bool_], shape: tuple[int, int], factor: int) -> NDArray[np.float32]:
    """Share of each pixel that a segment covers, its steps rounded off."""
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 0.6)
    if factor > 1:
        size = (mask.shape[1] * factor, mask.shape[0] * factor)
        soft = cv2.resize(soft, size, interpolation=cv2.INTER_CUBIC)[: shape[0], : shape[1]]
    return np.clip((soft - 0.5) * max(factor, 1) + 0.5, 0, 1)


def _distance(mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    return cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)


def _mixture(
    color: NDArray[np.float32], front: NDArray[np.float32], behind: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Share of `front`, and how much it differs from `behind`."""
    difference = front - behind
    squared = np.square(difference).sum(axis=2)
    share = ((color - behind) * difference).sum(axis=2) / np.maximum(squared, 1e-12)  # 1e-12 guards equal colours
    brightness = np.maximum(np.abs(front).max(axis=2), np.abs(behind).max(axis=2))
    return np.clip(share, 0, 1), np.sqrt(squared) / np.maximum(brightness, 1e-3)


def _attached(opacity: NDArray[np.float32], deep: NDArray[np.bool_]) -> NDArray[np.float32]:
    """What hangs together with the inside; the rest is ground that happens to look like the element."""
    labels = cv2.connectedComponents((opacity > 0.25).astype(np.uint8), connectivity=8)[1]
    kept = np.zeros(int(labels.max()) + 1, bool)
    kept[labels[deep]] = True
    kept[0] = False
    reach = cv2.dilate(kept[labels].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return np.where(reach, opacity, 0).astype(np.float32)
