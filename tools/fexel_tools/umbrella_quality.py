"""How sure one can be that a segment is one whole element.

Quality is the product of five parts, each in [0, 1] and named by what is wrong where it is low.

- ``clipped``: share of the rim that lies on the edge of the picture;
- ``touching``: share of the rim that is a cut to another segment, not a rim against the ground;
- ``faint``: contrast to the ground along the rim, CIELAB;
- ``blurred``: how much of that contrast is reached within two pixels of the rim;
- ``ragged``: solidity (area over that of the convex hull) of what the rim encloses, and how smooth the rim is;
- ``too small``, ``too large``: area against the median of the photo.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Quality", "segment_qualities"]

_FULL_CONTRAST = 18.0  # CIELAB: from here on a rim is clear
_SMALL = 0.2  # of the median area, from here on down nothing is left of the quality; full from three times that on
_LARGE = 6.0
_RAGGED = 0.25  # length of the smoothed outline over that of the outline, where nothing is left of the quality


@dataclass(frozen=True)
class Quality:
    """Of a segment.

    Attributes
    ----------
    value : float
        In [0, 1].
    reason : str
        What is worst.
    box : (int, int, int, int)
        Left, top, right, bottom in pixels of the segmentation.
    area : int
        Pixels.
    on_edge : bool
        The rim reaches the edge of the picture.
    """

    value: float
    reason: str
    box: tuple[int, int, int, int]
    area: int
    on_edge: bool


def segment_qualities(labels: NDArray[np.int32], distance: NDArray[np.float32]) -> list[Quality]:
    """Judge all segments of a photo.

    Parameters
    ----------
    labels : (h, w) int32
        1 to n.
    distance : (h, w) float32
        CIELAB, of each pixel from the ground.

    Returns
    -------
    list of Quality
        Of 1 to n.
    """
    count = int(labels.max())
    boxes = _boxes(labels, count)
    areas = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    typical = float(np.median(areas)) if count else 1.0
    return [
        _quality(labels, distance, number + 1, box, int(area), typical if count >= 3 else float(area))
        for number, (box, area) in enumerate(zip(boxes, areas, strict=True))
    ]


def _boxes(labels: NDArray[np.int32], count: int) -> list[tuple[int, int, int, int]]:
    boxes = np.zeros((count + 1, 4), np.int64)
    rows, columns = np.nonzero(labels)
    found = labels[rows, columns]
    for index, (values, far) in enumerate(((columns, False), (rows, False), (columns, True), (rows, True))):
        limits = np.full(count + 1, -1 if far else 2**31)
        (np.maximum if far else np.minimum).at(limits, found, values)
        boxes[:, index] = limits + far
    return [tuple(int(v) for v in box) for box in boxes[1:]]


def _quality(
    labels: NDArray[np.int32],
    distance: NDArray[np.float32],
    number: int,
    box: tuple[int, int, int, int],
    area: int,
    typical: float,
) -> Quality:
    height, width = labels.shape
    rows, columns = slice(max(box[1] - 4, 0), box[3] + 4), slice(max(box[0] - 4, 0), box[2] + 4)
    own = labels[rows, columns] == number
    other = (labels[rows, columns] > 0) & ~own
    rim = _rim(own)
    edge = np.zeros_like(own)
    edge[0 if box[1] == 0 else slice(0, 0)] = True
    edge[-1 if box[3] == height else slice(0, 0)] = True
    edge[:, 0 if box[0] == 0 else slice(0, 0)] = True
    edge[:, -1 if box[2] == width else slice(0, 0)] = True
    on_edge = float((rim & edge).sum() / rim.sum())
    cuts = float((rim & _grown(other, 1)).sum() / rim.sum())
    inner, outer = _contrast(own, other, distance[rows, columns])
    parts = {
        "clipped by the edge of the photo": 1 - min(4 * on_edge, 1),
        "touches its neighbours": 1 - min(max(cuts - 0.1, 0) * 1.25, 1),
        "hardly differs from the ground": min(inner / _FULL_CONTRAST, 1),
        "its rim is blurred": min(max(inner - outer, 0) / max(0.5 * inner, 1e-6), 1),
        "its outline is ragged": _smoothness(own),
        "much smaller than the others": _ramp(area / typical, _SMALL, 3 * _SMALL),
        "much larger than the others": _ramp(typical / area, 1 / _LARGE, 2 / _LARGE),
    }
    return Quality(float(np.prod(list(parts.values()))), min(parts, key=parts.__getitem__), box, area, on_edge > 0)


def _ramp(value: float, low: float, high: float) -> float:
    return min(max((value - low) / (high - low), 0), 1)


def _grown(mask: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    return cv2.dilate(mask.astype(np.uint8), np.ones((2 * pixels + 1, 2 * pixels + 1), np.uint8)) > 0


def _rim(own: NDArray[np.bool_]) -> NDArray[np.bool_]:
    kernel = np.ones((3, 3), np.uint8)
    eroded = cv2.erode(own.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return own & (eroded == 0)


def _contrast(own: NDArray[np.bool_], other: NDArray[np.bool_], distance: NDArray[np.float32]) -> tuple[float, float]:
    """Median distance from the ground two pixels inside the rim, and two outside of it."""
    inside = cv2.distanceTransform(np.pad(own.astype(np.uint8), 1), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    outside = cv2.distanceTransform(1 - own.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    inner = own & (inside > 1.5) & (inside <= 4)
    outer = ~own & (outside > 1.5) & (outside <= 4) & ~_grown(other, 2)
    return tuple(
        float(np.median(distance[ring])) if ring.any() else fallback
        for ring, fallback in ((inner, float(distance[own].mean())), (outer, 0.0))
    )


def _smoothness(own: NDArray[np.bool_]) -> float:
    """How little of the outline is jags: its length after smoothing over before; 1 for any smooth outline."""
    contours, _ = cv2.findContours(own.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = max(contours, key=len)[:, 0].astype(np.float64)
    if len(outline) < 8:
        return 1.0
    reach = max(len(outline) // 60, 2)
    wrapped = np.concatenate([outline[-reach:], outline, outline[:reach]])
    kernel = np.ones(2 * reach + 1) / (2 * reach + 1)
    smooth = np.stack([np.convolve(wrapped[:, axis], kernel, "valid") for axis in (0, 1)], axis=1)
    fine = np.stack(
        [np.convolve(np.r_[outline[-2:, a], outline[:, a], outline[:2, a]], np.ones(5) / 5, "valid") for a in (0, 1)],
        axis=1,
    )
    ratio = _length(smooth) / max(_length(fine), 1e-9)
    return _ramp(ratio, _RAGGED, 0.9)


def _length(outline: NDArray[np.float64]) -> float:
    return float(np.hypot(*np.diff(outline, axis=0, append=outline[:1]).T).sum())
