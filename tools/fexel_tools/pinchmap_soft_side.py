"""Where exactly a boundary between two sides runs: from a coarse labelling to sub-pixel accuracy.

Across an edge that was anti-aliased, or blurred by a lens, a pixel is a mixture of the colours of the two sides; its
share of one is the side (the matting equation, Porter and Duff 1984, solved for alpha along the line between two known
colours). The two colours are local means of the pixels well within either side. Where they hardly differ, the coarse
boundary itself decides; away from it the side is 0 or 1 whatever the colour.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["soft_side"]

_BAND_PX = 3.0  # coarse pixels, on either side: where the colours decide
_INNER_PX = 4.0  # coarse pixels from the boundary: from here on a pixel counts fully as its side's
_MEAN_PX = 15  # coarse pixels, width of the local means
_CONTRAST = 0.02  # of the feature range: where the two sides differ by this, colours and coarse boundary weigh the same

Gather = Callable[[NDArray[np.int64], NDArray[np.int64]], NDArray[np.float32]]


def soft_side(
    coarse: NDArray[np.bool_], features: NDArray[np.float32], gather: Gather, shape: tuple[int, int]
) -> NDArray[np.float32]:
    """The side of every pixel, 0..1.

    Parameters
    ----------
    coarse : (h, w) bool
        Which side, at reduced resolution.
    features : (h, w, F) float32
        Of the reduced picture: values in about 0..1 in which pixels at edges are linear mixtures.
    gather : callable
        ``gather(rows, columns)``: the same features of the full picture's pixels, (N, F) float32.
    shape : (int, int)
        Rows and columns of the full picture.

    Returns
    -------
    (H, W) float32
    """
    distance = _signed_distance(coarse)
    height, width = shape
    side = cv2.resize(coarse.astype(np.float32), (width, height), interpolation=cv2.INTER_NEAREST)
    near = cv2.resize(
        (np.abs(distance) < _BAND_PX + 1).astype(np.uint8), (width, height), interpolation=cv2.INTER_LINEAR
    )
    rows, columns = np.nonzero(near)
    if not len(rows):
        return side
    at = [
        ((index + np.float32(0.5)) * np.float32(few / many) - np.float32(0.5)).astype(np.float32)
        for index, few, many in ((columns, coarse.shape[1], width), (rows, coarse.shape[0], height))
    ]
    plus, minus = (_local_mean(features, inside, at) for inside in (distance, -distance))
    side[rows, columns] = _mixture(gather(rows, columns), plus, minus, _sampled(distance, at))
    return side


def _signed_distance(coarse: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Coarse pixels to the boundary, positive on the + side; half a pixel at the pixels beside it."""
    inside, outside = (
        cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5) for mask in (coarse, ~coarse)
    )
    return np.where(coarse, inside - np.float32(0.5), np.float32(0.5) - outside)


def _local_mean(features: NDArray[np.float32], inside: NDArray[np.float32], at: list[NDArray]) -> NDArray[np.float32]:
    """(N, F) mean features of one side, mostly of pixels well within it."""
    weight = np.clip(inside * np.float32(1 / _INNER_PX), np.float32(0), np.float32(1)) ** 4
    window = (_MEAN_PX, _MEAN_PX)
    total = cv2.boxFilter(weight, -1, window, normalize=False)
    mean = cv2.boxFilter(features * weight[..., None], -1, window, normalize=False)
    mean = mean.reshape(features.shape) / np.maximum(total, 1e-9)[..., None]  # 1e-9 guards places far from that side
    return _sampled(mean, at)


def _sampled(plane: NDArray[np.float32], at: list[NDArray]) -> NDArray[np.float32]:
    """Bilinear values at N places, (N,) or (N, F)."""
    rows = [
        cv2.remap(plane, x[None], y[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0]
        for x, y in zip(*(np.array_split(axis, -(-len(axis) // 32000)) for axis in at), strict=True)
    ]  # remap's rows are short integers
    return np.concatenate(rows)


def _mixture(
    value: NDArray[np.float32], plus: NDArray[np.float32], minus: NDArray[np.float32], distance: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Share of the + side in each pixel; distance in coarse pixels."""
    apart = plus - minus
    squared = np.einsum("nf,nf->n", apart, apart)
    share = np.einsum("nf,nf->n", value - minus, apart) / np.maximum(squared, 1e-12)  # 1e-12 guards equal sides
    trust = squared / (squared + np.float32(_CONTRAST**2))
    share = trust * np.clip(share, 0, 1) + (1 - trust) * np.clip(distance + np.float32(0.5), 0, 1)
    known = np.clip(2 * np.abs(distance) / _BAND_PX - 1, 0, 1)  # 0 up to half the band, 1 at its end
    return np.clip(share, np.where(distance > 0, known, 0), np.where(distance < 0, 1 - known, 1))
