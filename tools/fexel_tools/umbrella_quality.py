"""How sure one can be that a segment is one whole element.

Quality is the product of parts, each in [0, 1]; the lowest names the reason.

- how little of the rim lies on the edge of the picture;
- how little of it is a cut to another segment rather than a rim against the ground;
- contrast to the ground along the rim, CIELAB, and how much of it is reached within two pixels;
- how plain the ground is: its noise against that contrast;
- how smooth the outline is: its length after smoothing over before;
- solidity (area over that of the convex hull) and area against the medians of the photo, and how many pixels it has.
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
_HOLLOW = 0.75  # solidity over the median, where nothing is left of the quality
_FEW_PX, _ENOUGH_PX = 10.0, 28.0  # root of the area: nothing is left of the quality, all is
_PLAIN, _BUSY = 0.06, 0.3  # noise of the ground over the contrast: all of the quality, nothing
_CLIPPED = 8.0  # one over the share of the rim on the edge of the picture where nothing is left of the quality
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


def segment_qualities(
    labels: NDArray[np.int32], distance: NDArray[np.float32], *, noise: float = 0.0, factor: int = 1
) -> list[Quality]:
    """Judge all segments of a photo.

    Parameters
    ----------
    labels : (h, w) int32
        1 to n.
    distance : (h, w) float32
        CIELAB, of each pixel from the ground.
    noise : float
        Standard deviation of the ground, CIELAB.
    factor : int
        Pixels of the photo on a side of one of `labels`.

    Returns
    -------
    list of Quality
        Of 1 to n.
    """
    count = int(labels.max())
    boxes = _boxes(labels, count)
    areas = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    typical = float(np.median(areas)) if count else 1.0
    solidities = [_solidity(_filled(labels[_slices(box)] == number + 1)) for number, box in enumerate(boxes)]
    usual = float(np.median(solidities)) if count >= 3 else 0.0
    return [
        _quality(
            _Segment(number + 1, box, int(area), solidities[number] / max(usual, solidities[number])),
            labels,
            distance,
            typical if count >= 3 else float(area),
            noise,
            factor,
        )
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


@dataclass(frozen=True)
class _Segment:
    """Its label, box and area; and its solidity over the photo's median where that is more."""

    number: int
    box: tuple[int, int, int, int]
    area: int
    solid: float


def _quality(
    segment: _Segment,
    labels: NDArray[np.int32],
    distance: NDArray[np.float32],
    typical: float,
    noise: float,
    factor: int,
) -> Quality:
    number, box, area = segment.number, segment.box, segment.area
    height, width = labels.shape
    rows, columns = slice(max(box[1] - 4, 0), box[3] + 4), slice(max(box[0] - 4, 0), box[2] + 4)
    own = _filled(labels[rows, columns] == number)
    other = (labels[rows, columns] > 0) & ~own
    rim = _rim(own)
    y, x = np.nonzero(rim)
    y, x = y + rows.start, x + columns.start
    on_edge = float(((y == 0) | (y == height - 1) | (x == 0) | (x == width - 1)).mean())
    cuts = float((rim & _grown(other, 1)).sum() / rim.sum())
    inner, outer = _contrast(own, other, distance[rows, columns])
    parts = {
        "clipped by the edge of the photo": 1 - min(_CLIPPED * on_edge, 1),
        "touches its neighbours": 1 - min(max(cuts - 0.1, 0) * 1.25, 1),
        "hardly differs from the ground": min(inner / _FULL_CONTRAST, 1),
        "its rim is blurred": min(max(inner - outer, 0) / max(0.5 * inner, 1e-6), 1),
        "the ground around it is not plain": 1 - _ramp(noise / max(inner, 1e-6), _PLAIN, _BUSY),
        "its outline is ragged": _smoothness(own),
        "its outline is not like the others'": _ramp(segment.solid, _HOLLOW, 0.97),
        "it has few pixels": _ramp(factor * np.sqrt(area), _FEW_PX, _ENOUGH_PX),
        "much smaller than the others": _ramp(area / typical, _SMALL, 3 * _SMALL),
        "much larger than the others": _ramp(typical / area, 1 / _LARGE, 2 / _LARGE),
    }
    return Quality(float(np.prod(list(parts.values()))), min(parts, key=parts.__getitem__), box, area, on_edge > 0)


def _slices(box: tuple[int, int, int, int]) -> tuple[slice, slice]:
    return slice(box[1], box[3]), slice(box[0], box[2])


def _filled(own: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The segment with its holes: what is judged is its outline."""
    contours, _ = cv2.findContours(own.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return cv2.drawContours(np.zeros(own.shape, np.uint8), contours, -1, 1, cv2.FILLED) > 0


def _solidity(own: NDArray[np.bool_]) -> float:
    rows = np.flatnonzero(own.any(axis=1))
    ends = [own[rows].argmax(axis=1), own.shape[1] - 1 - own[rows, ::-1].argmax(axis=1)]  # of each row: the hull's are
    hull = cv2.convexHull(np.stack([np.concatenate(ends), np.tile(rows, 2)], axis=1).astype(np.int32))
    filled = cv2.fillConvexPoly(np.zeros(own.shape, np.uint8), hull, 1)
    return float(own.sum() / max(filled.sum(), 1))


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
