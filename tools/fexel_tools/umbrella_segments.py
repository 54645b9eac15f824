"""Segments of a mask, one per element: connected components, and touching elements told apart.

Elements that touch are split where they are narrow: the distance to the ground is flooded from its maxima downwards
(the watershed transform of Vincent and Soille, 1991), and two basins that meet are one element if the distance where
they meet is not much less than at the lower of their maxima. So a ring with a hole stays whole, and two discs that
touch do not.
"""

from __future__ import annotations

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

__all__ = [
    "components",
    "fill_holes",
    "fill_secluded",
    "largest_parts",
    "numbered",
    "split_touching",
    "trim_contacts",
    "without_specks",
]

_NECK = 0.8  # distance where two basins meet, over that at the lower maximum: above, they are one element
_SECLUDED = 3.5
_THIN = ((0.15, 0.1), (0.35, 0.02))  # of the widest, and of the area: a part larger than that is the segment's own
_WHOLE = 0.85  # of a segment's area: less left of it, and it has fallen apart
_SMOOTH = 0.04  # of the largest distance: so much it is smoothed, so that serrated rims make no maxima


def components(mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    """(h, w) int32: 0 on the ground, 1 to n on what hangs together by sides, corners not."""
    return cv2.connectedComponents(mask.astype(np.uint8), connectivity=4)[1]


def without_specks(mask: NDArray[np.bool_], least_area: float) -> NDArray[np.bool_]:
    """The mask without components, and without holes, of fewer pixels."""
    for _ in range(2):  # first the components, then, of the complement, the holes
        _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
        kept = stats[:, cv2.CC_STAT_AREA] >= least_area
        kept[0] = False
        mask = ~kept[labels]
    return mask


def fill_holes(labels: NDArray[np.int32], most_share: float) -> NDArray[np.int32]:
    """Fill the holes that one segment alone encloses where they are at most so large a share of it.

    Parameters
    ----------
    labels : (h, w) int32
    most_share : float
        Of the segment's area with its holes.
    """
    return _fill(labels, most_share * np.bincount(labels.ravel(), minlength=int(labels.max()) + 1))


def fill_secluded(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Fill the holes that lie deep inside elements, before touching elements are told apart.

    A hole counts as such when no other ground, nor the edge of the picture, is within `_SECLUDED` times the radius of
    a disc of its area: gaps between elements that touch are nearer to the next gap.
    """
    ground = (~mask).astype(np.uint8)
    _, holes, stats, _ = cv2.connectedComponentsWithStats(ground, connectivity=8)
    fills = np.zeros(len(stats), bool)
    for hole in range(1, len(stats)):
        left, top, width, height, area = stats[hole]
        reach = _SECLUDED * np.sqrt(area / np.pi)
        margin = int(np.ceil(reach))
        rows, columns = slice(top - margin, top + height + margin), slice(left - margin, left + width + margin)
        if min(rows.start, columns.start) < 0 or rows.stop > mask.shape[0] or columns.stop > mask.shape[1]:
            continue
        own = holes[rows, columns] == hole
        others = cv2.distanceTransform(1 - (ground[rows, columns] & ~own), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        fills[hole] = others[own].min() > reach
    return mask | fills[holes]


def _fill(labels: NDArray[np.int32], most_areas: NDArray) -> NDArray[np.int32]:
    _, holes, stats, _ = cv2.connectedComponentsWithStats((labels == 0).astype(np.uint8), connectivity=8)
    least, most = _neighbours(labels, holes, len(stats))
    fills = (least == most) & (stats[:, cv2.CC_STAT_AREA] <= most_areas[most])
    fills[0] = False
    height, width = labels.shape
    left, top = stats[:, cv2.CC_STAT_LEFT], stats[:, cv2.CC_STAT_TOP]
    right, bottom = left + stats[:, cv2.CC_STAT_WIDTH], top + stats[:, cv2.CC_STAT_HEIGHT]
    fills &= (left > 0) & (top > 0) & (right < width) & (bottom < height)
    return np.where(fills[holes], most[holes], labels).astype(np.int32)


def split_touching(labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Split every segment where it is narrow.

    Returns
    -------
    (h, w) int32
        1 to n, in no particular order; 0 where `labels` are.
    """
    distance = _distance(labels)
    sigma = max(_SMOOTH * float(distance.max()), 0.5)
    smooth = np.where(labels > 0, cv2.GaussianBlur(distance, (0, 0), sigma), 0).astype(np.float32)
    order = np.argsort(-smooth, axis=None, kind="stable")[: int(np.count_nonzero(labels))]
    basins = _flood(smooth.ravel(), order, labels.shape[1], _NECK).reshape(labels.shape)
    return np.unique(basins, return_inverse=True)[1].reshape(labels.shape).astype(np.int32)


def largest_parts(labels: NDArray[np.int32], kept: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Segments reduced to what is kept of them and hangs together; one that would fall apart stays as it is.

    Parameters
    ----------
    labels : (h, w) int32
    kept : (h, w) bool
    """
    result = labels.copy()
    for number in range(1, int(labels.max()) + 1):
        own = labels == number
        left, top, width, height = cv2.boundingRect(own.astype(np.uint8))
        found = slice(top, top + height), slice(left, left + width)
        _, parts, stats, _ = cv2.connectedComponentsWithStats((own & kept)[found].astype(np.uint8), connectivity=4)
        if len(stats) < 2:
            continue
        largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
        if stats[largest, cv2.CC_STAT_AREA] >= _WHOLE * np.count_nonzero(own):
            result[found][own[found] & (parts != largest)] = 0
    return result


def numbered(labels: NDArray[np.integer]) -> NDArray[np.int32]:
    """The same segments numbered 1 to n, without those of which nothing is left."""
    present = np.bincount(labels.ravel()) > 0
    present[0] = False
    return np.where(present, np.cumsum(present), 0).astype(np.int32)[labels]


def trim_contacts(labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Take away thin parts of segments that touch another one, or the photo's edge: remains of others, cut at the neck.

    Thin is what a disc of `_THIN` times the segment's widest does not fit into, the wider the smaller it may be; parts
    that touch nothing, such as the tips of leaves, stay.
    """
    for width, share in _THIN:
        labels = _trimmed(labels, width, share)
    return labels


def _trimmed(labels: NDArray[np.int32], width: float, share: float) -> NDArray[np.int32]:
    from scipy import ndimage  # takes a third of a second to import; only photos of many elements need it

    padded = np.pad(labels, 2, constant_values=-1)
    trimmed = padded.copy()
    kernel = np.ones((3, 3), np.uint8)
    widest = ndimage.maximum(_distance(labels), labels, np.arange(int(labels.max()) + 1))
    for number, found in enumerate(ndimage.find_objects(labels), start=1):
        if found is None:
            continue
        window = tuple(slice(part.start, part.stop + 4) for part in found)  # two pixels more on each side
        own = (padded[window] == number).astype(np.uint8)
        others = (padded[window] != 0) & (own == 0)
        if not others.any():
            continue
        size = 2 * max(round(width * float(widest[number])), 1) + 1
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
        thin = own & (1 - cv2.morphologyEx(own, cv2.MORPH_OPEN, disc))
        _, parts, stats, _ = cv2.connectedComponentsWithStats(thin, connectivity=4)
        touching = np.unique(parts[(cv2.dilate(others.astype(np.uint8), kernel) > 0) & (parts > 0)])
        small = stats[touching, cv2.CC_STAT_AREA] < share * own.sum()
        remain = np.isin(parts, touching[small])
        if _holds_together((own > 0) & ~remain, (1 - 2 * share) * own.sum()):
            trimmed[window][remain] = 0
    return trimmed[2:-2, 2:-2].copy()


def _holds_together(mask: NDArray[np.bool_], least_area: float) -> bool:
    """Whether the largest part of a mask has at least so many pixels."""
    stats = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)[2]
    return len(stats) > 1 and float(stats[1:, cv2.CC_STAT_AREA].max()) >= least_area


def _distance(labels: NDArray[np.int32]) -> NDArray[np.float32]:
    """Pixels to the nearest of label 0; elements are thought to go on past the edge of the picture."""
    inside = (labels > 0).astype(np.uint8)
    if inside.all():
        return np.full(labels.shape, max(labels.shape), np.float32)
    return cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)


@numba.njit(cache=True, nogil=True)
def _neighbours(labels, holes, count):
    """Least and most label around each hole."""
    least = np.full(count, 2**31 - 1, np.int64)
    most = np.zeros(count, np.int64)
    height, width = labels.shape
    for y in range(height):
        for x in range(width):
            hole = holes[y, x]
            if hole == 0:
                continue
            for dy, dx in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                v, u = y + dy, x + dx
                if 0 <= v < height and 0 <= u < width and labels[v, u] > 0:
                    least[hole] = min(least[hole], labels[v, u])
                    most[hole] = max(most[hole], labels[v, u])
    return least, most


@numba.njit(cache=True, nogil=True)
def _root(parents, basin):
    while parents[basin] != basin:
        parents[basin] = parents[parents[basin]]
        basin = parents[basin]
    return basin


@numba.njit(cache=True, nogil=True)
def _flood(heights, order, width, neck):
    """Basins of pixels in descending order of their heights; 0 where a pixel is not in `order`."""
    basins = np.zeros(len(heights), np.int64)
    parents = np.zeros(len(order) + 1, np.int64)
    peaks = np.zeros(len(order) + 1)
    count = 0
    for pixel in order:
        x = pixel % width
        best, highest = 0, -1.0
        for step in range(8):
            dy, dx = (step + (step >= 4)) // 3 - 1, (step + (step >= 4)) % 3 - 1
            other = pixel + dy * width + dx
            if x + dx < 0 or x + dx >= width or other < 0 or other >= len(heights) or basins[other] == 0:
                continue
            basin = _root(parents, basins[other])
            if best > 0 and basin != best and heights[pixel] > neck * min(peaks[basin], peaks[best]):
                low, high = (basin, best) if peaks[basin] < peaks[best] else (best, basin)
                parents[low] = high
                best = basin = high
            if heights[other] > highest:
                best, highest = basin, heights[other]
        if best == 0:
            count += 1
            parents[count] = count
            peaks[count] = heights[pixel]
            best = count
        basins[pixel] = best
    for pixel in order:
        basins[pixel] = _root(parents, basins[pixel])
    return basins
