"""Mip pyramids in linear, premultiplied float: area-exact for any size, rims cleared for patches.

Level l has ``max(1, size >> l)`` texels per axis. Each texel of a level is the mean of the level above over exactly the
area it covers: for odd sizes that is a box of 2 + 1/n texels with fractional weights, so no level is shifted or
cropped. Every level of a patch is computed from the *clean* level above and its rim is cleared afterwards (Eisemann and
Magnor 2010, section 3: zero alpha on the border of every mip level); clearing first would fade the patch twice as far
in at every level. Filtering premultiplied colour is what leaves no dark seam.

Images are (rows, columns, channels), row 0 at the top.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["RowHalver", "clear_rim", "halve", "halve_axis", "level_count", "level_size", "pyramid"]


def level_size(size: int, level: int) -> int:
    """Texels along an axis of `size` at `level`."""
    return max(1, size >> level)


def level_count(width: int, height: int) -> int:
    """Levels down to 1x1."""
    return max(width, height).bit_length()


def halve(image: NDArray[np.floating]) -> NDArray[np.float32]:
    """The next coarser level.

    Parameters
    ----------
    image : (H, W, C) float
        Linear, premultiplied.

    Returns
    -------
    (max(1, H // 2), max(1, W // 2), C) float32

    Examples
    --------
    >>> halve(np.array([[[0.0], [1.0], [2.0]]]))
    array([[[1.]]], dtype=float32)
    """
    return halve_axis(halve_axis(np.asarray(image, np.float32), 0), 1)


class RowHalver:
    """`halve` of an image that comes in strips of rows, to the bit; holds no more than two rows besides.

    Parameters
    ----------
    height : int
        Rows of the whole image.
    """

    def __init__(self, height: int) -> None:
        self._height = height
        self._pending: NDArray[np.float32] | None = None
        self._done = 0

    def feed(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        """The rows of the coarser level that these complete: (n, max(1, W // 2), C), n >= 0."""
        if self._pending is not None:
            rows = np.concatenate([self._pending, rows])
        if self._height == 1:
            return halve_axis(rows, 1)
        overlap = self._height % 2  # of an odd height, every row of the coarser level reaches into a third
        count = max((len(rows) - overlap) // 2, 0)
        self._pending = rows[2 * count :].copy()
        coarse = halve_axis(rows[: 2 * count + overlap], 0, self._height, self._done)
        self._done += count
        return halve_axis(coarse, 1)


def halve_axis(image: NDArray[np.float32], axis: int, whole: int | None = None, start: int = 0) -> NDArray[np.float32]:
    """Halve along an axis.

    Parameters
    ----------
    image : (...) float32
    axis : int
    whole : int, optional
        The image is a part of so many texels along the axis, and begins with the first that `start` needs.
    start : int
        First texel to make of the coarser level.
    """
    size: int = whole or image.shape[axis]
    if size == 1:
        return image
    if size % 2 == 0 and axis == 1 and image.ndim == 3:
        return _halve_pairs(image)
    image = np.moveaxis(image, axis, 0)
    half = size // 2
    if size % 2 == 0:
        coarse = (image[0::2] + image[1::2]) * np.float32(0.5)
    else:
        # Texel i covers [i, i + 1] * size / half: the end of one texel, a whole one, and the start of the next.
        count = max(len(image) - 1, 0) // 2
        i = np.arange(start, start + count, dtype=np.float32).reshape(-1, *[1] * (image.ndim - 1))
        first, last = (half - i) / size, (i + 1) / size
        coarse = first * image[0:-1:2] + image[1::2] * np.float32(half / size) + last * image[2::2]
    return np.moveaxis(coarse, 0, axis)


def _halve_pairs(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Halve along axis 1: channel by channel, in half the time of loops over channels within."""
    coarse = np.empty((image.shape[0], image.shape[1] // 2, image.shape[2]), np.float32)
    for channel in range(image.shape[2]):
        np.add(image[:, 0::2, channel], image[:, 1::2, channel], out=coarse[..., channel])
    coarse *= np.float32(0.5)
    return coarse


def clear_rim(image: NDArray) -> NDArray:
    """A copy with all channels of the outermost texels zero; an image under 3 texels wide or high vanishes."""
    cleared = np.zeros_like(image)
    cleared[1:-1, 1:-1] = image[1:-1, 1:-1]
    return cleared


def pyramid(image: NDArray[np.floating], levels: int | None = None) -> list[NDArray[np.float32]]:
    """All levels, the image itself first, rims as they are (see `clear_rim`).

    Parameters
    ----------
    image : (H, W, C) float
        Linear, premultiplied.
    levels : int, optional
        Stop after at most so many; default down to 1x1.
    """
    image = np.asarray(image, np.float32)
    result = [image]
    count = level_count(image.shape[1], image.shape[0])
    for _ in range(min(levels or count, count) - 1):
        result.append(halve(result[-1]))
    return result
