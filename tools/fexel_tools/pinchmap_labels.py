"""Images that say by hand which side, or which region, a pixel belongs to.

Two meanings are told apart by what the image holds. If at least `_LEVELS` values (or colours) fill areas, each a fair
share, and these cover most of it, they are labels of regions. Otherwise it is the side itself: above half is one
side, and values between are where the boundary is soft. Two values on one half, such as the labels 0 and 1 in 8 bits,
are stretched.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

__all__ = ["find_labels", "stretched_side"]

_LEVELS = 3
_SHARE = 0.002  # of the pixels: what one label has at least, without its rim
_COVERED = 0.7  # of the pixels: what all labels have together, without their rims
_STRETCHED = 0.9  # of the pixels: what the two values of a side that is stretched have at least


def find_labels(values: NDArray[np.float32]) -> NDArray[np.int32] | None:
    """Labels of an image that holds such.

    Parameters
    ----------
    values : (H, W, 3) float32
        Stored values.

    Returns
    -------
    (H, W) int32 or None
        0..L-1 in ascending order of the values; pixels at anti-aliased rims have the nearest label. None where the
        image is no label image.
    """
    keys = _keys(values)
    levels, index = np.unique(keys, return_inverse=True)
    index = index.reshape(keys.shape).astype(np.int32)
    inside = (ndimage.minimum_filter(index, 3) == index) & (ndimage.maximum_filter(index, 3) == index)
    counts = np.bincount(index[inside], minlength=len(levels))
    is_label = counts >= max(_SHARE * keys.size, 1)
    if np.count_nonzero(is_label) < _LEVELS or counts[is_label].sum() < _COVERED * keys.size:
        return None
    number = np.where(is_label, np.cumsum(is_label) - 1, -1).astype(np.int32)
    labels = number[index]
    if (labels < 0).any():
        nearest = ndimage.distance_transform_edt(labels < 0, return_distances=False, return_indices=True)
        labels = labels[tuple(nearest)]
    return labels


def _keys(values: NDArray[np.float32]) -> NDArray[np.int64]:
    """One integer for each value or colour, to 16 bits a channel."""
    whole = np.rint(np.clip(values, 0, 1) * 65535).astype(np.int64)
    return (whole[..., 0] << 32) + (whole[..., 1] << 16) + whole[..., 2]


def stretched_side(side: NDArray[np.float32]) -> NDArray[np.float32]:
    """A side of two values, brought to 0 and 1 where both are on one half; any other as it is.

    Parameters
    ----------
    side : (H, W) float32
        0..1.
    """
    least, most = float(side.min()), float(side.max())
    if least == most or least <= 0.5 < most:
        return side
    extremes = np.count_nonzero((side == least) | (side == most))
    return (side - least) / (most - least) if extremes >= _STRETCHED * side.size else side
