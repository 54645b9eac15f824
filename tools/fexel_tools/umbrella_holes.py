"""What shows the ground within elements: holes, told from glints that look like it, and narrow notches.

A hole has the ground's colour, and the element begins at once around it. A glint is not exactly of the ground's colour,
or fades into the element over several pixels. In a notch a few pixels wide, blur mixes ground and element: what is
nearer to the ground than to the element around it, and reaches the ground, is ground.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel_tools.umbrella_ground import Ground

__all__ = ["ground_shown", "with_notches"]

_SAME = 4.0  # CIELAB: what lies nearer to the ground's colour has it
_NOISES = 2.0  # standard deviations of the ground that it may be off as well
_CRISP = 0.8  # distance from the ground two pixels off a hole over that farther off, from which on its edge is crisp
_NEAR_PX, _FAR_PX = 2.0, (4.0, 6.0)
_MARGIN_PX = 8
_HALF = 0.5  # of the elements' distance from the ground about a pixel: what is nearer to the ground is ground
_NOTCH_PX = 12  # how far ground reaches into notches
_ABOUT_PX = 4.0  # standard deviation


def ground_shown(mask: NDArray[np.bool_], ground: Ground) -> NDArray[np.bool_]:
    """Holes of a mask of elements through which the ground is seen.

    Parameters
    ----------
    mask : (h, w) bool
        Elements.
    ground : Ground

    Returns
    -------
    (h, w) bool
        Pixels of such holes. What reaches the edge of the picture is no hole.
    """
    _, labels, stats, _ = cv2.connectedComponentsWithStats((~mask).astype(np.uint8), connectivity=8)
    shown = np.zeros(len(stats), bool)
    for number, (left, top, width, height, _) in enumerate(stats):
        bottom, right = top + height, left + width
        if number == 0 or min(top, left) == 0 or bottom == mask.shape[0] or right == mask.shape[1]:
            continue
        rows = slice(max(top - _MARGIN_PX, 0), bottom + _MARGIN_PX)
        window = rows, slice(max(left - _MARGIN_PX, 0), right + _MARGIN_PX)
        shown[number] = _shows(labels[window] == number, mask[window], ground, window)
    return shown[labels]


def with_notches(mask: NDArray[np.bool_], ground: Ground) -> NDArray[np.bool_]:
    """The mask without what is ground in narrow notches."""
    weight = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), _ABOUT_PX)
    level = cv2.GaussianBlur(np.where(mask, ground.distance, np.float32(0)), (0, 0), _ABOUT_PX)
    level /= np.maximum(weight, 1e-6)  # 1e-6 guards bare ground
    candidates = (~mask | (ground.distance < _HALF * level)).astype(np.uint8)
    reached = (~mask).astype(np.uint8)
    for _ in range(_NOTCH_PX):
        reached = cv2.bitwise_and(cv2.dilate(reached, np.ones((3, 3), np.uint8)), candidates)
    return mask & (np.asarray(reached) == 0)


def _shows(hole: NDArray[np.bool_], elements: NDArray[np.bool_], ground: Ground, window: tuple[slice, slice]) -> bool:
    distance = ground.distance[window]
    inside = cv2.distanceTransform(np.pad(hole.astype(np.uint8), 1), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    deep = float(inside.max())
    core = hole & (inside >= min(2.0, deep))
    if float(np.median(distance[core])) > max(_SAME, _NOISES * ground.noise):
        return False
    outside = cv2.distanceTransform(1 - hole.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    near, *far = (_level(distance, elements & (np.abs(outside - radius) <= 0.5)) for radius in (_NEAR_PX, *_FAR_PX))
    return near >= _CRISP * max(far)


def _level(distance: NDArray[np.float32], ring: NDArray[np.bool_]) -> float:
    return float(np.median(distance[ring])) if ring.any() else 0.0
