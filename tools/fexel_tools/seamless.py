"""Pictures that tile: whether one does, and one made of a photo that does not.

A photo is made to tile in two steps. What differs slowly between opposite borders, such as the light, is shared between
them as in seamless tiling by Poisson's equation (Perez, Gangnet and Blake, Poisson image editing, 2003, section 4).
Then opposite borders overlap, and are cut along the path on which they differ least (the minimum error boundary cut of
Efros and Freeman, Image quilting, 2001), a little softened. Nothing is mirrored: a mirrored photo shows axes.

Pictures are (H, W, C) float32, linear light or data, row 0 at the top.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["OVERLAP", "seamless", "tiles"]

OVERLAP = 1 / 7  # of a side: how much of a photo goes into making it tile
_SEAM = 1.25  # difference across the borders over the median one between neighbouring rows: up to here it tiles
_COARSE = 8  # reduced so much, a picture must tile as well: light that falls off
_LEAST_COARSE_PX = 16
_SLOW = 1 / 12  # of a side: standard deviation of the blur that leaves slow differences
_FEATHER_PX = 1.5

_Picture = NDArray[np.float32]


def tiles(picture: _Picture) -> bool:
    """Whether a picture can be repeated without a seam: its borders differ as neighbouring rows and columns do."""
    encoded = np.sqrt(np.maximum(picture, 0))
    if not _borders_meet(encoded):
        return False
    size = tuple(side // _COARSE for side in picture.shape[1::-1])
    if min(size) < _LEAST_COARSE_PX:
        return True
    return _borders_meet(cv2.resize(encoded, size, interpolation=cv2.INTER_AREA).reshape(*size[::-1], -1))


def seamless(picture: _Picture) -> _Picture:
    """A picture that tiles, made of a photo.

    Parameters
    ----------
    picture : (H, W, C) float32

    Returns
    -------
    (H - h, W - w, C) float32
        Smaller by `OVERLAP`, rounded; within the range of the photo's values. A side below 4 pixels is left as it is.
    """
    low, high = picture.min(axis=(0, 1)), picture.max(axis=(0, 1))
    joined = _joined_columns(_evened(picture), is_periodic=False)
    joined = _joined_columns(joined.swapaxes(0, 1), is_periodic=True).swapaxes(0, 1)
    return np.ascontiguousarray(np.clip(joined, low, high), np.float32)


def _borders_meet(picture: _Picture) -> bool:
    for axis in (0, 1):
        lines = np.moveaxis(picture, axis, 0)
        inner = np.abs(np.diff(lines, axis=0)).mean(axis=(1, 2)) if len(lines) > 1 else np.zeros(1)
        if np.abs(lines[0] - lines[-1]).mean() > _SEAM * float(np.median(inner)) + 1e-4:  # 1e-4: an even picture's
            return False
    return True


def _evened(picture: _Picture) -> _Picture:
    """The photo plus a harmonic function that brings the slow part of opposite borders to their mean."""
    from fexel_tools.poisson import clone, ring_of  # takes a while to import; only photos that do not tile need it

    height, width = picture.shape[:2]
    if min(height, width) < 4:
        return picture
    wanted = picture.copy()
    across = _slow(0.5 * (picture[-1] - picture[0]), width)
    along = _slow(0.5 * (picture[:, -1] - picture[:, 0]), height)
    wanted[0] += across
    wanted[-1] -= across
    wanted[:, 0] += along
    wanted[:, -1] -= along
    return clone(np.ascontiguousarray(picture), ring_of(wanted))


def _slow(line: NDArray[np.float32], length: int) -> NDArray[np.float32]:
    """(N, C) without its detail."""
    sigma = max(_SLOW * length, 1.0)
    return cv2.GaussianBlur(line[None], (0, 0), sigma, borderType=cv2.BORDER_REFLECT_101).reshape(line.shape)


def _joined_columns(picture: _Picture, *, is_periodic: bool) -> _Picture:
    """The last columns laid over the first; `is_periodic`: the cut ends in the column in which it begins."""
    width = picture.shape[1]
    overlap = round(OVERLAP * width)
    if width < 4 or overlap < 1:
        return picture
    last, first = picture[:, width - overlap :], picture[:, :overlap]
    encoded = np.sqrt(np.maximum(last, 0)) - np.sqrt(np.maximum(first, 0))
    cut = _least_cut(np.square(encoded).sum(axis=2, dtype=np.float64), is_periodic)
    share = (np.arange(overlap)[None] >= cut[:, None]).astype(np.float32)  # of `first`
    border = cv2.BORDER_WRAP if is_periodic else cv2.BORDER_REPLICATE
    margin = int(4 * _FEATHER_PX)
    padded = cv2.copyMakeBorder(share, margin, margin, 0, 0, border)
    padded = cv2.copyMakeBorder(padded, 0, 0, margin, margin, cv2.BORDER_REPLICATE)
    soft = cv2.GaussianBlur(padded, (0, 0), _FEATHER_PX)[margin:-margin, margin:-margin, None]
    return np.concatenate([last + soft * (first - last), picture[:, overlap : width - overlap]], axis=1)


def _least_cut(error: NDArray[np.float64], is_periodic: bool) -> NDArray[np.int64]:
    """The column of each row through which the path of least sum runs, from top to bottom, a column a row at most."""
    path = _path(error)
    if not is_periodic:
        return path
    middle = _path(np.concatenate([error, error, error]))[len(error) : 2 * len(error)]
    closed = error.copy()
    closed[[0, -1]] = np.inf
    closed[[0, -1], middle[0]] = error[[0, -1], middle[0]]
    return _path(closed)


def _path(error: NDArray[np.float64]) -> NDArray[np.int64]:
    rows, columns = error.shape
    total = error.copy()
    for y in range(1, rows):
        padded = np.pad(total[y - 1], 1, constant_values=np.inf)
        total[y] += np.minimum(np.minimum(padded[:-2], padded[1:-1]), padded[2:])
    path = np.empty(rows, np.int64)
    path[-1] = int(np.argmin(total[-1]))
    for y in range(rows - 2, -1, -1):
        low, high = max(path[y + 1] - 1, 0), min(path[y + 1] + 2, columns)
        path[y] = low + int(np.argmin(total[y, low:high]))
    return path
