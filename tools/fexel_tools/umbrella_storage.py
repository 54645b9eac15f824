"""What umbrellas cost to store, beside the explicit texture that shows as much: eqs. (2) and (3) of the paper.

Just-in-time texture synthesis (2012), section 7.1, in four-byte words::

    J = b w h + 2 b v + n (1 + 3 v) + k W H                                                           (2)
    T = max(w / x_i) max(h / y_i) W H                                                                 (3)

x_i, y_i are the sides of a modified umbrella's bounding box in cells of the W x H grid. With the mean instead of the
maximum T is the explicit texture's average reading, with the minimum the least. Where bases differ in their number of
vertices or their texture, each counts with its own: the sums over them replace the products with b and v.

With both sides compressed the textures are JPEGs of quality 50, as in the paper. The explicit texture, of the average
resolution, is drawn in windows spread over it, which stand for the whole by their bytes per texel; on the other side
are the bases' textures, their contours, and the arrangement as `umbrella_code` has it. Neither side has mip levels or
levels of detail.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel.images import linear_to_srgb
from fexel.textures.umbrella_arrangement import Arrangement
from fexel_tools.umbrella_code import encode_arrangement
from fexel_tools.umbrella_raster import rasterize

__all__ = [
    "JPEG_QUALITY",
    "CompressedSizes",
    "ExplicitWords",
    "bounding_boxes",
    "compressed_sizes",
    "explicit_resolution",
    "explicit_words",
    "jpeg_bytes",
    "umbrella_words",
]

JPEG_QUALITY = 50
_WINDOW_PX = 768
_WINDOWS = 4
_MOST_SEEN = 1.0  # of the unit square: windows larger than it are cut

Window = tuple[float, float, float, float]
Draw = Callable[[tuple[int, int], Window], NDArray[np.float32]]


@dataclass(frozen=True)
class ExplicitWords:
    """T in its three readings (table 1), four-byte words: one per texel."""

    least: float
    average: float
    most: float


@dataclass(frozen=True)
class CompressedSizes:
    """Bytes of both sides, compressed.

    Attributes
    ----------
    textures, contours, arrangement : int
        Of the umbrellas: JPEGs (and alphas, deflated), deflated contours, deflated arrangement.
    explicit : int
        Of the explicit texture at its average resolution.
    """

    textures: int
    contours: int
    arrangement: int
    explicit: int

    @property
    def umbrellas(self) -> int:
        """Of the umbrellas altogether."""
        return self.textures + self.contours + self.arrangement

    @property
    def ratio(self) -> float:
        """Explicit over umbrellas."""
        return self.explicit / max(self.umbrellas, 1)


def umbrella_words(arrangement: Arrangement, texture_sizes: Sequence[tuple[int, int]], k: int) -> int:
    """J of eq. (2).

    Parameters
    ----------
    arrangement : Arrangement
    texture_sizes : sequence of (int, int)
        Width and height of each base's texture; (0, 0) without one.
    k : int
        Most umbrellas that touch a cell of the grid.
    """
    bases = sum(width * height for width, height in texture_sizes)
    bases += sum(2 * len(shape.points) for shape in arrangement.shapes)
    modified = len(arrangement) + 3 * int(arrangement.first_vertex[-1])
    return bases + modified + k * arrangement.grid[0] * arrangement.grid[1]


def explicit_words(arrangement: Arrangement, texture_sizes: Sequence[tuple[int, int]]) -> ExplicitWords:
    """T of eq. (3); all 0 without umbrellas."""
    across, up = _texels_per_cell(arrangement, texture_sizes)
    if not len(across):
        return ExplicitWords(0.0, 0.0, 0.0)
    cells = arrangement.grid[0] * arrangement.grid[1]
    readings = (np.min, np.mean, np.max)
    least, average, most = (float(of(across) * of(up) * cells) for of in readings)
    return ExplicitWords(least, average, most)


def explicit_resolution(arrangement: Arrangement, texture_sizes: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Width and height of the explicit texture in its average reading, texels; at least 1."""
    across, up = _texels_per_cell(arrangement, texture_sizes)
    if not len(across):
        return 1, 1
    width, height = float(np.mean(across)) * arrangement.grid[0], float(np.mean(up)) * arrangement.grid[1]
    return max(1, round(width)), max(1, round(height))


def bounding_boxes(arrangement: Arrangement) -> NDArray[np.float64]:
    """(n, 2) sides of each umbrella's bounding box, cells of the grid; 0 for what lies at infinity."""
    if not len(arrangement):
        return np.zeros((0, 2))
    first = arrangement.first_vertex[:-1]
    with np.errstate(all="ignore"):  # what is not finite becomes 0 below
        low = np.minimum.reduceat(arrangement.vertices, first)
        high = np.maximum.reduceat(arrangement.vertices, first)
        sides = (high - low) * np.array(arrangement.grid, np.float64)
    return np.where(np.isfinite(sides), sides, 0.0)


def compressed_sizes(
    arrangement: Arrangement,
    textures: Sequence[NDArray[np.float32] | None],
    background: NDArray[np.float32] | Sequence[float] | None,
    *,
    is_data: bool = False,
    vector_scale: tuple[float, float] | None = None,
    draw: Draw | None = None,
) -> CompressedSizes:
    """Bytes of both sides.

    Parameters
    ----------
    arrangement : Arrangement
    textures : sequence of (h, w, 3 or 4) float32 or None
        Of each base: linear (or data), straight alpha.
    background : (h, w, 3 or 4) float32, colour, or None
        Behind the umbrellas, for the explicit texture. It is the same on both sides, so it counts on neither.
    is_data : bool
        Values are stored without sRGB encoding.
    vector_scale : (float, float), optional
        Of vectors, as `rasterize` takes it: they turn with their umbrella in the explicit texture.
    draw : callable(size, window), optional
        The explicit texture's windows (s0, t0, s1, t1), premultiplied; default: `rasterize`.
    """
    sizes = [(0, 0) if t is None else (t.shape[1], t.shape[0]) for t in textures]
    pictures = sum(jpeg_bytes(texture, is_data=is_data) for texture in textures if texture is not None)
    draw = draw or partial(_drawn, arrangement, textures, background, vector_scale)
    explicit = _explicit_bytes(explicit_resolution(arrangement, sizes), draw, is_data)
    contours = sum(_contour_bytes(shape.points, shape.morph_points, shape.tex_coords) for shape in arrangement.shapes)
    return CompressedSizes(pictures, contours, encode_arrangement(arrangement).nbytes, explicit)


def _drawn(
    arrangement: Arrangement,
    textures: Sequence[NDArray[np.float32] | None],
    background: NDArray[np.float32] | Sequence[float] | None,
    vector_scale: tuple[float, float] | None,
    size: tuple[int, int],
    window: Window,
) -> NDArray[np.float32]:
    return rasterize(arrangement, textures, background, size, window=window, vector_scale=vector_scale)


def jpeg_bytes(picture: NDArray[np.float32], quality: int = JPEG_QUALITY, *, is_data: bool = False) -> int:
    """Bytes of a picture as JPEG, with its alpha, where it is not 1 throughout, as 8-bit PNG.

    Parameters
    ----------
    picture : (H, W, 3 or 4) float32
        Linear (or data), straight alpha.
    """
    color = picture[..., :3] if is_data else linear_to_srgb(picture[..., :3].clip(0, 1).astype(np.float32))
    stored = np.rint(color.clip(0, 1) * 255).astype(np.uint8)
    nbytes = len(cv2.imencode(".jpg", stored[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1])
    if picture.shape[2] == 4 and (picture[..., 3] < 1 - 0.5 / 255).any():
        alpha = np.rint(picture[..., 3].clip(0, 1) * 255).astype(np.uint8)
        nbytes += len(cv2.imencode(".png", alpha, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1])
    return nbytes


def _texels_per_cell(
    arrangement: Arrangement, texture_sizes: Sequence[tuple[int, int]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """w / x_i and h / y_i of the umbrellas that have a texture and an extent."""
    sizes = np.array(texture_sizes, np.float64).reshape(-1, 2)[arrangement.shape_of]
    sides = bounding_boxes(arrangement)
    counted = (sides > 0).all(axis=1) & (sizes > 0).all(axis=1)
    across, up = (sizes[counted] / sides[counted]).T
    return across, up


def _explicit_bytes(resolution: tuple[int, int], draw: Draw, is_data: bool) -> int:
    """Bytes of the whole, from windows spread over it."""
    size = (min(_WINDOW_PX, resolution[0]), min(_WINDOW_PX, resolution[1]))
    whole = resolution[0] * resolution[1]
    s, t = size[0] / resolution[0], size[1] / resolution[1]
    count = _WINDOWS if s * t < _MOST_SEEN else 1
    nbytes = 0
    for number in range(count):
        s0, t0 = (number + 0.5) / count * (1 - s), ((number * 0.618) % 1.0) * (1 - t)
        picture = draw(size, (s0, t0, s0 + s, t0 + t))
        straight = picture.copy()
        straight[..., :3] /= np.maximum(picture[..., 3:], 1e-6)  # 1e-6 guards transparent texels
        nbytes += jpeg_bytes(straight, is_data=is_data)
    return round(nbytes * whole / (count * size[0] * size[1]))


def _contour_bytes(*vertices: NDArray[np.float64]) -> int:
    """Vertices in 16 bits each, deflated."""
    import zlib

    values = np.concatenate([v.ravel() for v in vertices])
    largest = float(np.abs(values).max(initial=1e-9))
    return len(zlib.compress(np.rint(values / largest * 32767).astype("<i2").tobytes(), 9))
