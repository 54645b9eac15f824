"""Parts of segments that belong to something else: a neighbour that touches, or a shadow.

Such a part sticks out of the segment, and the colour changes where it begins. It is the neighbour's where it has the
neighbour's colour. It is a shadow where it is nearer to the ground's colour than the element is.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["returned_parts", "without_shadows"]

_BODY = 0.8  # of a segment's widest: a disc of that radius does not fit into what sticks out
_NEIGHBOUR = 0.5  # colour difference to the neighbour over that to the own body, below which a pixel is the neighbour's
_STEP = 0.4  # colour difference between a part and the body beside it, over that of the body from the ground
_PALER = 0.75  # distance of a shadow from the ground over that of the body beside it
_MOST_SHADOW = 0.25  # of a segment's area: more of it are petals rather than shadows
_LEAST_RADIUS_PX = 1.5  # of a disc that fits into a part: thinner ones are rims, mixtures of element and ground
_KERNEL = np.ones((3, 3), np.uint8)

_Window = tuple[slice, slice]


def returned_parts(labels: NDArray[np.int32], lab: NDArray[np.float32]) -> NDArray[np.int32]:
    """Give what sticks out of a segment and has a touching neighbour's colour to that neighbour.

    Parameters
    ----------
    labels : (h, w) int32
    lab : (h, w, 3) float32
        CIELAB.
    """
    result = labels.copy()
    for number, window in _windows(labels):
        own = labels[window] == number
        body = _body(own)
        parts = cv2.connectedComponents((own & ~body).astype(np.uint8), connectivity=4)[1]
        around = np.where(own, 0, labels[window])
        for part in range(1, int(parts.max()) + 1):
            beside = around[_grown(parts == part, 1)]
            neighbours = np.unique(beside[beside > 0])
            if len(neighbours) == 1:
                theirs = _near_body(labels, lab, int(neighbours[0]), window, parts == part)
                mine = _median(lab[window], _grown(parts == part, 4) & body)
                colors = lab[window][parts == part]
                to_mine, to_theirs = (np.linalg.norm(colors - color, axis=1) for color in (mine, theirs))
                given = np.zeros(own.shape, bool)
                given[parts == part] = to_theirs < _NEIGHBOUR * to_mine
                result[window][given] = neighbours[0]
    return result


def without_shadows(
    labels: NDArray[np.int32], lab: NDArray[np.float32], distance: NDArray[np.float32]
) -> NDArray[np.int32]:
    """Take away what sticks out of a segment and is a shadow.

    Parameters
    ----------
    labels : (h, w) int32
    lab : (h, w, 3) float32
        CIELAB.
    distance : (h, w) float32
        CIELAB, from the ground.
    """
    result = labels.copy()
    for number, window in _windows(labels):
        own = labels[window] == number
        body = _body(own)
        parts = cv2.connectedComponents((own & ~body).astype(np.uint8), connectivity=4)[1]
        depth = _depth(own & ~body)
        shadow = np.zeros(own.shape, bool)
        for part in range(1, int(parts.max()) + 1):
            inside = (parts == part) & (depth >= _LEAST_RADIUS_PX)
            beside = _grown(parts == part, 4) & (cv2.erode(body.astype(np.uint8), _KERNEL) > 0)
            if inside.any() and beside.any():
                far, far_beside = (float(np.median(distance[window][at])) for at in (inside, beside))
                step = float(np.linalg.norm(_median(lab[window], inside) - _median(lab[window], beside)))
                if far < _PALER * far_beside and step > _STEP * far_beside:
                    shadow |= parts == part
        if np.count_nonzero(shadow) <= _MOST_SHADOW * np.count_nonzero(own):
            result[window][shadow] = 0
    return result


def _windows(labels: NDArray[np.int32]) -> list[tuple[int, _Window]]:
    """Each segment with its box and some pixels around it."""
    found = []
    for number in range(1, int(labels.max()) + 1):
        left, top, width, height = cv2.boundingRect((labels == number).astype(np.uint8))
        if width > 0:
            rows = slice(max(top - 2, 0), top + height + 2)
            found.append((number, (rows, slice(max(left - 2, 0), left + width + 2))))
    return found


def _body(own: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The segment without what sticks out."""
    radius = max(round(_BODY * float(_depth(own).max())), 1)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    padded = np.pad(own.astype(np.uint8), radius)
    return cv2.morphologyEx(padded, cv2.MORPH_OPEN, disc)[radius:-radius, radius:-radius] > 0


def _near_body(
    labels: NDArray[np.int32], lab: NDArray[np.float32], number: int, window: _Window, part: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """Colour of another segment beside a part; of all of it where none is in the window."""
    theirs = labels[window] == number
    near = theirs & _grown(part, 4)
    return _median(lab[window], near) if near.any() else _median(lab, labels == number)


def _median(lab: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    return np.median(lab[mask], axis=0) if mask.any() else np.full(3, 1e6, np.float32)


def _depth(mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    padded = np.pad(mask.astype(np.uint8), 1)
    return cv2.distanceTransform(padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]


def _grown(mask: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    return cv2.dilate(mask.astype(np.uint8), _KERNEL, iterations=pixels) > 0
