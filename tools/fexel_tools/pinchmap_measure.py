"""How well a pinchmap reproduces its source: wrong pixels, IoU, boundary distance, alpha error, colour PSNR.

A point lies on the + side where k^B > gamma^B (Tarini and Cignoni 2005, section 5.1): both are bilinear with the same
weights, so the side of a pixel is the sign of one bilinear surface, :func:`boundary_field`, evaluated at the pixel's
centre. Boundaries are the level lines of that surface and of the source's soft side at 1/2, extracted to sub-pixel
precision by marching squares over the pixel centres (`fexel_tools.pinchmap_contours`).

Conventions: pictures and sides are (H, W), row 0 at the top, pixel centres at (x + 1/2, y + 1/2); a pixel of the source
is on the + side where its side exceeds 1/2. Distances are in source pixels. No figure is ever NaN: what cannot be
measured is None, which JSON writes as null.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from fexel.images import linear_to_srgb
from fexel_tools.pinchmap_contours import boundary_segments, directed_distances
from fexel_tools.pinchmap_window import FloatWindow

__all__ = [
    "BEST_PSNR_DB",
    "Boundary",
    "ShapeMeasures",
    "alpha_error",
    "boundary_distance",
    "boundary_field",
    "coverage",
    "covered_share",
    "iou",
    "measure_shape",
    "mismatch",
    "psnr_db",
    "side_of_pixels",
]

BEST_PSNR_DB = 100.0  # what equal pictures have
_TABLE_SIZE = 4096


@dataclass(frozen=True)
class Boundary:
    """Distance between the boundaries of a source and its result, both ways.

    Attributes
    ----------
    mean_px : float or None
        Mean of the two directed means, each along the length of one boundary; source pixels.
    max_px : float or None
        The larger of the two directed maxima (Hausdorff); source pixels. None, like the mean, where exactly one of the
        two has no boundary at all; 0 where neither has.
    """

    mean_px: float | None
    max_px: float | None


@dataclass(frozen=True)
class ShapeMeasures:
    """Figures of one shape; `as_dict` gives what a report holds."""

    mismatch: float
    iou: float
    mean_px: float | None
    max_px: float | None

    def as_dict(self) -> dict[str, float | None]:
        """As plain data, ready for JSON."""
        return asdict(self)


def measure_shape(
    pinchmap: NDArray[np.floating],
    side: NDArray[np.floating],
    wrap: tuple[str, str] = ("clamp", "clamp"),
    *,
    window: FloatWindow | None = None,
) -> ShapeMeasures:
    """All figures of shape of a pinchmap against its source.

    Parameters
    ----------
    pinchmap : (Nh, Nw, 4) float
        Decoded: d_s, d_t, k, gamma in [-1, 1].
    side : (H, W) float
        Of the source, in [0, 1]; NaN counts as 0.
    wrap : (str, str)
        Along s and t.
    window : (float, float, float, float), optional
        As for :func:`boundary_field`.

    Returns
    -------
    ShapeMeasures
    """
    field = boundary_field(pinchmap, side.shape, wrap, window=window)
    result = field > 0
    boundary = boundary_distance(field, _level(side))
    return ShapeMeasures(mismatch(result, side), iou(result, side), boundary.mean_px, boundary.max_px)


def boundary_field(
    pinchmap: NDArray[np.floating],
    shape: tuple[int, int],
    wrap: tuple[str, str] = ("clamp", "clamp"),
    *,
    samples: int = 1,
    window: FloatWindow | None = None,
) -> NDArray[np.float32]:
    """k^B - gamma^B at the centres of pixels, or of the samples of a regular grid in each.

    Parameters
    ----------
    pinchmap : (Nh, Nw, 4) float
        Decoded. Only k and gamma are read.
    shape : (int, int)
        Rows and columns of the picture.
    wrap : (str, str)
        Along s and t; ``repeat`` joins the borders, at any other they go on (a mirrored texture never leaves [0, 1]).
    samples : int
        Along either axis of a pixel.
    window : (float, float, float, float), optional
        Left, top, right and bottom of what the map covers, in pixels of the picture; the map goes on around it as
        `wrap` says. Default: the whole picture.

    Returns
    -------
    (H * samples, W * samples) float32
        Positive on the + side. Rounded once, from float64, so that no sign is lost.
    """
    difference = np.subtract(pinchmap[..., 2], pinchmap[..., 3], dtype=np.float64)
    lines = [(np.arange(length * samples) + 0.5) / samples for length in shape]
    return _evaluated(difference, lines, shape, wrap, window)


def side_of_pixels(
    pinchmap: NDArray[np.floating],
    shape: tuple[int, int],
    wrap: tuple[str, str] = ("clamp", "clamp"),
    *,
    window: FloatWindow | None = None,
) -> NDArray[np.bool_]:
    """Whether the centre of every pixel lies on the + side: k^B > gamma^B.

    Parameters and edges as in :func:`boundary_field`. Returns (H, W) bool.
    """
    return boundary_field(pinchmap, shape, wrap, window=window) > 0


def coverage(
    pinchmap: NDArray[np.floating],
    shape: tuple[int, int],
    wrap: tuple[str, str] = ("clamp", "clamp"),
    *,
    samples: int = 4,
    window: FloatWindow | None = None,
) -> NDArray[np.float32]:
    """Share of every pixel that lies on the + side: an ideally anti-aliased edge, from samples x samples points.

    Pixels whose corners are all on one side are taken to lie there as a whole. Parameters otherwise as in
    :func:`boundary_field`. Returns (H, W) float32 in [0, 1].
    """
    difference = np.subtract(pinchmap[..., 2], pinchmap[..., 3], dtype=np.float64)
    return covered_share(difference, shape, wrap, samples=samples, window=window)


def covered_share(
    texels: NDArray[np.float64],
    shape: tuple[int, int],
    wrap: tuple[str, str] = ("clamp", "clamp"),
    *,
    samples: int = 4,
    window: FloatWindow | None = None,
) -> NDArray[np.float32]:
    """`coverage` of any channel that lies on the texels of a pinchmap, (Nh, Nw), and is positive on the + side."""
    corners = _evaluated(texels, [np.arange(length + 1) for length in shape], shape, wrap, window)
    rows, columns = ((np.arange(length * samples) + 0.5) / samples for length in shape)
    result = np.empty(shape, np.float32)
    lines = _lines(rows, columns, texels, shape, wrap, window)
    _count_positive(np.ascontiguousarray(texels, np.float64), corners, *lines, samples, result)
    return result


def mismatch(result: NDArray[np.bool_], side: NDArray[np.floating] | NDArray[np.bool_]) -> float:
    """Share of source pixels on the wrong side, in [0, 1]; 0 for a picture without pixels."""
    return float(np.mean(result != (side > 0.5))) if result.size else 0.0


def iou(result: NDArray[np.bool_], side: NDArray[np.floating] | NDArray[np.bool_]) -> float:
    """Intersection over union of the + side in pixels, in [0, 1]; 1 where neither picture has a pixel of it."""
    source = side > 0.5
    union = np.count_nonzero(result | source)
    return float(np.count_nonzero(result & source) / union) if union else 1.0


def alpha_error(result: NDArray[np.floating], alpha: NDArray[np.floating]) -> float:
    """Mean absolute difference of two coverages per pixel, in [0, 1]; NaN in either counts as 0."""
    difference = np.subtract(np.nan_to_num(result), np.nan_to_num(alpha), dtype=np.float32)
    return float(np.abs(difference).mean(dtype=np.float64)) if difference.size else 0.0


def boundary_distance(result: NDArray[np.float32], source: NDArray[np.float32]) -> Boundary:
    """Distance between the zero lines of two pictures, to sub-pixel precision.

    Both are traced by marching squares over the pixel centres; the distance from either end of every piece to the
    other boundary is exact (point to segment). The border of the picture is not a boundary.

    Parameters
    ----------
    result, source : (H, W) float32
        Positive on the + side: :func:`boundary_field`, a soft side less 1/2.

    Returns
    -------
    Boundary
    """
    ours, theirs = boundary_segments(result), boundary_segments(source)
    if not ours.count or not theirs.count:
        nothing = 0.0 if ours.count == theirs.count else None
        return Boundary(nothing, nothing)
    there, back = directed_distances(ours, theirs), directed_distances(theirs, ours)
    return Boundary((there.mean + back.mean) / 2, max(there.largest, back.largest))


def psnr_db(
    result: NDArray[np.floating],
    source: NDArray[np.floating],
    ground: Sequence[float] | None = (1.0, 1.0, 1.0),
    *,
    encode: bool = True,
) -> float | None:
    """Peak signal-to-noise ratio of two pictures as they are seen: composited over a ground, then sRGB-encoded.

    Parameters
    ----------
    result, source : (H, W, 4) float
        Linear Rec.709, premultiplied. Where `ground` is None, (H, W, C): compared channel by channel as they are.
        Clipped to [0, 1] first, so that pictures of another range (colours above 1, signed data) are to be scaled
        before, by `pinchmap_range`, which makes the peak their range; NaN counts as 0.
    ground : (3,) float or None
        Linear colour behind the pictures.
    encode : bool
        False for data such as normal maps: compared without encoding.

    Returns
    -------
    float or None
        Decibels over all pixels and channels against a peak of 1, at most 100 (8 bits resolve 59); None for pictures
        without pixels.

    Raises
    ------
    ValueError
        The shapes differ.
    """
    if result.shape != source.shape:
        raise ValueError(f"pictures are {result.shape} and {source.shape}, expected the same shape")
    if not result.size:
        return None
    behind = np.zeros(0, np.float32) if ground is None else np.asarray(ground, np.float32)
    table = _srgb_of_root() if encode else np.zeros(0, np.float32)
    pictures = (np.ascontiguousarray(picture, np.float32) for picture in (result, source))
    error = _mean_squared_error(*pictures, behind, table)
    return min(-10 * math.log10(error), BEST_PSNR_DB) if error > 0 else BEST_PSNR_DB


def _level(side: NDArray[np.floating]) -> NDArray[np.float32]:
    return np.nan_to_num(np.asarray(side, np.float32)) - np.float32(0.5)


def _evaluated(
    texels: NDArray, lines: Sequence[NDArray], shape: tuple[int, int], wrap: tuple[str, str], window: FloatWindow | None
) -> NDArray[np.float32]:
    """Bilinear interpolation at the crossings of rows and columns, continuous coordinates of a picture of `shape`."""
    result = np.empty((len(lines[0]), len(lines[1])), np.float32)
    where = _lines(lines[0], lines[1], texels, shape, wrap, window)
    _interpolate(np.ascontiguousarray(texels, np.float64), *where, result)
    return result


def _lines(
    rows: NDArray,
    columns: NDArray,
    texels: NDArray,
    shape: tuple[int, int],
    wrap: tuple[str, str],
    window: FloatWindow | None,
) -> tuple[NDArray, ...]:
    """Texels and weights of rows and columns. Texel [r, c] lies at the lower left corner of cell [r, c]."""
    left, top, right, bottom = window or (0, 0, shape[1], shape[0])
    down = (rows - top) * (texels.shape[0] / (bottom - top)) - 1
    across = (columns - left) * (texels.shape[1] / (right - left))
    return *_neighbours(down, texels.shape[0], wrap[1]), *_neighbours(across, texels.shape[1], wrap[0])


def _neighbours(positions: NDArray[np.float64], count: int, wrap: str) -> tuple[NDArray, NDArray, NDArray]:
    """Lower and upper texel of every position, and the weight of the upper."""
    low = np.floor(positions)
    weight = positions - low
    pair = [low.astype(np.int64), low.astype(np.int64) + 1]
    pair = [index % count if wrap == "repeat" else np.clip(index, 0, count - 1) for index in pair]
    return pair[0], pair[1], weight


@numba.njit(cache=True, nogil=True)
def _interpolate(texels, low_row, high_row, row_weight, low_column, high_column, column_weight, result):
    count = texels.shape[1]
    line = np.empty(count)
    for y in range(result.shape[0]):
        a, b, weight = low_row[y], high_row[y], row_weight[y]
        for c in range(count):
            line[c] = texels[a, c] * (1 - weight) + texels[b, c] * weight
        for x in range(result.shape[1]):
            left, right = line[low_column[x]], line[high_column[x]]
            result[y, x] = left + (right - left) * column_weight[x]


@numba.njit(cache=True, nogil=True)
def _count_positive(
    texels, corners, low_row, high_row, row_weight, low_column, high_column, column_weight, samples, result
):
    unit = np.float32(1 / (samples * samples))
    for y in range(result.shape[0]):
        for x in range(result.shape[1]):
            above = corners[y, x] > 0
            others = (corners[y, x + 1] > 0) + (corners[y + 1, x] > 0) + (corners[y + 1, x + 1] > 0)
            if others == 3 * above:
                result[y, x] = above
                continue
            count = 0
            for j in range(y * samples, (y + 1) * samples):
                a, b, down = low_row[j], high_row[j], row_weight[j]
                for i in range(x * samples, (x + 1) * samples):
                    c, d, right = low_column[i], high_column[i], column_weight[i]
                    upper = texels[a, c] * (1 - right) + texels[a, d] * right
                    lower = texels[b, c] * (1 - right) + texels[b, d] * right
                    count += upper * (1 - down) + lower * down > 0
            result[y, x] = count * unit


def _srgb_of_root() -> NDArray[np.float32]:
    """SRGB encoding over the square root of the linear value: nearly straight, so that interpolation errs by 1e-6."""
    root = np.linspace(0, 1, _TABLE_SIZE + 1)
    return np.append(linear_to_srgb(root * root), np.float32(1))  # once more, as the neighbour of 1


@numba.njit(cache=True, nogil=True, fastmath=False)
def _encoded(value, table):
    value = min(max(value, np.float32(0)), np.float32(1))
    if table.size == 0:
        return value
    position = math.sqrt(value) * np.float32(table.size - 2)
    index = int(position)
    return table[index] + (table[index + 1] - table[index]) * (position - index)


@numba.njit(cache=True, nogil=True)
def _mean_squared_error(result, source, ground, table):
    channels = ground.size if ground.size else result.shape[2]
    total = 0.0
    for y in range(result.shape[0]):
        for x in range(result.shape[1]):
            for c in range(channels):
                a, b = result[y, x, c], source[y, x, c]
                if ground.size:
                    a += (1 - min(max(result[y, x, 3], np.float32(0)), np.float32(1))) * ground[c]
                    b += (1 - min(max(source[y, x, 3], np.float32(0)), np.float32(1))) * ground[c]
                a = a if a == a else np.float32(0)
                b = b if b == b else np.float32(0)
                difference = _encoded(a, table) - _encoded(b, table)
                total += difference * difference
    return total / (result.shape[0] * result.shape[1] * channels)
