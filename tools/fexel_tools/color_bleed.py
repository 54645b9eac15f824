"""Colour continued under transparent pixels, so that filtering across an edge never brings in a colour nobody meant.

Push and pull (Gortler et al., The Lumigraph, 1996, section 4.4): colours of the pixels whose alpha can be trusted are
averaged down to one pixel; on the way up, cells that lack such pixels take the coarser level's colour.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["bleed_color"]

_PIXELS_PER_CELL = 4  # one pixel of full weight makes a cell's colour its own


def bleed_color(
    color: NDArray[np.float32], alpha: NDArray[np.float32], *, trusted_alpha: float = 1 / 16
) -> NDArray[np.float32]:
    """Straight colour, plausible everywhere.

    Parameters
    ----------
    color : (H, W, 3) float32
        Straight; what it holds where alpha is 0 does not matter. Finite.
    alpha : (H, W) float32
        0..1.
    trusted_alpha : float
        From here on a pixel's colour is its own; below, where few of its digits are left after a multiplication by
        alpha in 8 bits, it is its neighbours'.

    Returns
    -------
    (H, W, 3) float32
        `color` itself where alpha >= `trusted_alpha`; within the bounds of those colours elsewhere. 0 throughout where
        no pixel has alpha.
    """
    own = (alpha >= trusted_alpha).astype(np.uint8)
    if own.all():
        return color
    filled = _enlarged(_coarse_fill(color, own), own.shape)
    cv2.copyTo(color, own, filled)
    return filled


def _coarse_fill(color: NDArray[np.float32], own: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Filled colours at half the resolution."""
    kept = cv2.copyTo(color, own, np.zeros_like(color))
    levels = [(_halved(kept), _halved(own.astype(np.float32)))]
    while max(levels[-1][1].shape) > 1:
        premultiplied, covered = levels[-1]
        levels.append((_halved(premultiplied), _halved(covered)))
    filled = _divided(*levels.pop())
    for premultiplied, covered in reversed(levels):
        weight = np.minimum(covered * _PIXELS_PER_CELL, 1)
        filled = cv2.blendLinear(_divided(premultiplied, covered), _enlarged(filled, covered.shape), weight, 1 - weight)
    return filled


def _divided(premultiplied: NDArray[np.float32], covered: NDArray[np.float32]) -> NDArray[np.float32]:
    return premultiplied / np.maximum(covered, 1e-12)[..., None]  # 1e-12 guards cells without any weight


def _halved(plane: NDArray[np.float32]) -> NDArray[np.float32]:
    height, width = plane.shape[:2]
    is_even = not (height % 2 or width % 2)
    even = plane if is_even else cv2.copyMakeBorder(plane, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE)
    return cv2.resize(even, (-(-width // 2), -(-height // 2)), interpolation=cv2.INTER_AREA)


def _enlarged(coarse: NDArray[np.float32], shape: tuple[int, int]) -> NDArray[np.float32]:
    """Twice the size, to rows and columns."""
    fine = cv2.resize(coarse, (2 * coarse.shape[1], 2 * coarse.shape[0]), interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(fine[: shape[0], : shape[1]])
