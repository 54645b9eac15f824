"""Colour continued under transparent pixels, so that filtering across an edge never brings in a colour nobody meant.

Push and pull (Gortler et al., The Lumigraph, 1996, section 4.4): colours, weighted by how far their alpha can be
trusted, are averaged down to one pixel; on the way up, pixels that lack weight take the coarser level's colour.
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
        alpha in 8 bits, it blends over to its neighbours'.

    Returns
    -------
    (H, W, 3) float32
        `color` itself where alpha >= `trusted_alpha`; within the bounds of those colours elsewhere. 0 throughout where
        no pixel has alpha.
    """
    weight = np.minimum(alpha * np.float32(1 / trusted_alpha), np.float32(1))
    if weight.min() >= 1:
        return color
    filled = _blend(color, _coarse_fill(color, weight), weight)
    cv2.copyTo(color, np.uint8(weight >= 1), filled)
    return filled


def _coarse_fill(color: NDArray[np.float32], weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """Filled colours at half the resolution."""
    pushed = [_halved(cv2.multiply(color, cv2.merge([weight] * 3))), _halved(weight)]
    levels = [pushed]
    while max(levels[-1][1].shape) > 1:
        levels.append([_halved(plane) for plane in levels[-1]])
    filled = _divided(*levels.pop())
    for premultiplied, covered in reversed(levels):
        filled = _blend(_divided(premultiplied, covered), filled, np.minimum(covered * _PIXELS_PER_CELL, 1))
    return filled


def _divided(premultiplied: NDArray[np.float32], covered: NDArray[np.float32]) -> NDArray[np.float32]:
    return premultiplied / np.maximum(covered, 1e-12)[..., None]  # 1e-12 guards cells without any weight


def _halved(plane: NDArray[np.float32]) -> NDArray[np.float32]:
    height, width = plane.shape[:2]
    even = cv2.copyMakeBorder(plane, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE)
    return cv2.resize(even, (-(-width // 2), -(-height // 2)), interpolation=cv2.INTER_AREA)


def _blend(own: NDArray[np.float32], coarse: NDArray[np.float32], weight: NDArray[np.float32]) -> NDArray[np.float32]:
    """`own` where weight is 1, `coarse`, enlarged, where it is 0."""
    height, width = weight.shape
    fine = cv2.resize(coarse, (2 * coarse.shape[1], 2 * coarse.shape[0]), interpolation=cv2.INTER_LINEAR)
    return cv2.blendLinear(own, np.ascontiguousarray(fine[:height, :width]), weight, 1 - weight)
