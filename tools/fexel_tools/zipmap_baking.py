"""A zipmap as one image: eq. (1) of the zipmap paper at many points of every pixel, averaged over the pixel.

Each output pixel is a box of S x S sample points (S up to 4). At a point the layers are composited as
``C = sum_i w_i C_i, w_i = alpha_i prod_{j>i} (1 - alpha_j)`` (Eisemann and Magnor 2010, eq. 1) from bilinear lookups in
premultiplied, linear texels. A layer that has more than four texels per pixel along either axis is read from the
coarser level that has two to four, so that samples never skip a texel and a 50-megapixel patch costs no more than what
the picture shows of it. Coordinates are float64. Output is made tile by tile; only the windows a tile needs are read.

A layer of another kind is looked up through that kind's own baker (`baking`), with the footprint of a sample.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numba
import numpy as np

from fexel import homography
from fexel.mipmaps import level_count, level_size
from fexel.textures.image_source import ImageSource
from fexel.textures.page_texels import decode_page
from fexel.textures.pyramid_cache import ImageFacts, PyramidCache
from fexel.textures.zipmap import ZipmapData
from fexel_tools.baking import NestedBaker, Storage, nested_baker, storage_of

__all__ = ["bake_zipmap", "baked_size", "baker"]

_TILE = 256  # output pixels a side: 16 MB of samples
_MOST_SAMPLES = 4  # per axis and pixel
_NEAREST_W = 1e-9  # of a layer's homogeneous coordinate: what lies nearer to infinity is not drawn
_WRAPS = {"patch": 0, "black": 0, "useMetadata": 0, "clamp": 1, "repeat": 2, "mirror": 3}
_MOST_NESTED_SAMPLES = 2  # of layers of other kinds, which filter for themselves


@dataclass(frozen=True)
class _Window:
    """Texels of a layer that a tile needs: linear, premultiplied (h, w, 4) float32, from column x0 - 1, row y0 - 1."""

    texels: np.ndarray
    x0: int
    y0: int
    width: int
    height: int
    wrap: tuple[int, int]


class _Layers:
    """A zipmap's layers with what is known of their images."""

    def __init__(self, data: ZipmapData, cache: PyramidCache) -> None:
        self.data = data
        self.cache = cache
        self.nested: dict[int, NestedBaker] = {
            nested.layer: nested_baker(nested.kind, nested.data, data.paths[nested.layer]) for nested in data.nested
        }

    def source(self, layer: int) -> ImageSource:
        """Image of a layer; one that is black outside keeps its border texels whole up to the border of the picture."""
        source = self.data.sources[self.data.source_index[layer]]
        wrap = tuple("clamp" if mode in ("black", "useMetadata") else mode for mode in source.wrap)
        return replace(source, wrap=wrap)

    def facts(self, layer: int) -> ImageFacts:
        return self.cache.facts(self.source(layer), self.data.paths[layer])

    def texels(self, layer: int) -> tuple[int, int]:
        """Width and height of what is to be seen of a layer."""
        return self.nested[layer].texels if layer in self.nested else self.facts(layer).size


class _ZipmapBaker:
    """`fexel_tools.baking.TextureBaker` of a zipmap."""

    def __init__(self, data: ZipmapData) -> None:
        self._data = data
        self._cache = PyramidCache()

    @property
    def storage(self) -> Storage:
        data = self._data
        return storage_of(data.sources[data.source_index[0]], self._cache, data.paths[0], data.scale, data.bias)

    def size(self, largest: int) -> tuple[int, int]:
        return baked_size(self._data, self._cache, largest)

    def bake(self, width: int, height: int) -> np.ndarray:
        return bake_zipmap(self._data, width, height, self._cache)


def baker(data: ZipmapData, path: str) -> _ZipmapBaker:  # noqa: ARG001 - every layer has its own path
    """Baker of a zipmap, or of a UsdUVTexture."""
    return _ZipmapBaker(data)


def baked_size(data: ZipmapData, cache: PyramidCache, largest: int) -> tuple[int, int]:
    """Compute width and height of the picture: the root's shape, as fine as the finest layer, at most `largest` a side.

    A root without an image is square.
    """
    layers = _Layers(data, cache)
    root = layers.facts(0)
    has_image = root.info is not None
    width, height = root.size if has_image else (1, 1)
    finest = 1.0
    for layer in range(1, len(data.paths)):
        corners = _seen(data.root_to_patch[layer], (0.0, 0.0, 1.0, 1.0), is_patch=True)
        if len(corners) >= 3:
            density = _texels_per_pixel(data.root_to_patch[layer], corners, layers.texels(layer), (width, height))
            finest = max(finest, float(np.median(density)))
    scale = min(largest / max(width, height), finest)
    return max(1, round(width * scale)), max(1, round(height * scale))


def bake_zipmap(
    data: ZipmapData,
    width: int,
    height: int,
    cache: PyramidCache | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> np.ndarray:
    """Composite of the unit square of ``inputs:st``.

    Parameters
    ----------
    data : ZipmapData
    width, height : int
    cache : PyramidCache, optional
    progress : callable, optional
        Called with tiles done and tiles in all.

    Returns
    -------
    (height, width, 4) float32
        Linear, premultiplied; ``scale`` and ``bias`` that all layers share (`ZipmapData.scale`) are not applied. A file
        that cannot be read warns once and shows its fallback colour.
    """
    layers = _Layers(data, cache or PyramidCache())
    out = np.empty((height, width, 4), np.float32)
    tiles = [(x, y) for y in range(0, height, _TILE) for x in range(0, width, _TILE)]
    for done, (x, y) in enumerate(tiles):
        box = (x, y, min(x + _TILE, width), min(y + _TILE, height))
        out[box[1] : box[3], box[0] : box[2]] = _bake_tile(layers, box, (width, height))
        if progress:
            progress(done + 1, len(tiles))
    return out


def _bake_tile(layers: _Layers, box: tuple[int, int, int, int], size: tuple[int, int]) -> np.ndarray:
    width, height = size
    data = layers.data
    bounds = (box[0] / width, 1 - box[3] / height, box[2] / width, 1 - box[1] / height)
    shown, samples = [], 1
    for layer in _layers_in(data, bounds):
        corners = _seen(data.root_to_patch[layer], bounds, is_patch=layer > 0)
        if len(corners) < 3:
            continue
        texels = layers.texels(layer)
        dense = float(_texels_per_pixel(data.root_to_patch[layer], corners, texels, size).max(initial=0.0))
        level = int(np.ceil(np.log2(max(dense / _MOST_SAMPLES, 1.0))))
        level = min(level, level_count(*texels) - 1)
        most = _MOST_NESTED_SAMPLES if layer in layers.nested else _MOST_SAMPLES
        samples = max(samples, int(np.clip(np.ceil(dense / 2**level), 2, most)))
        shown.append((layer, level, corners))
    rows, columns = (box[3] - box[1]) * samples, (box[2] - box[0]) * samples
    color = np.zeros((rows, columns, 4), np.float32)
    raster = (bounds[0], bounds[3], 1 / (width * samples), 1 / (height * samples))
    for layer, level, corners in shown:
        matrix, opacity = np.ascontiguousarray(data.root_to_patch[layer]), float(data.opacity[layer])
        if layer in layers.nested:
            _composite_nested(color, raster, matrix, layers.nested[layer], corners, opacity)
            continue
        window = _window(layers, layer, level, corners)
        place = (window.x0, window.y0, window.width, window.height, *window.wrap)
        _composite(color, raster, matrix, window.texels, place, opacity)
    return color.reshape(box[3] - box[1], samples, box[2] - box[0], samples, 4).mean(axis=(1, 3), dtype=np.float64)


def _composite_nested(
    color: np.ndarray,
    raster: tuple[float, float, float, float],
    matrix: np.ndarray,
    baker: NestedBaker,
    corners: np.ndarray,
    opacity: float,
) -> None:
    """Draw a layer of another kind over the samples of a tile, within its `corners` in the root's st."""
    s0, t1, ds, dt = raster
    rows, columns = color.shape[:2]
    x0, y0 = np.floor(np.array([corners[:, 0].min() - s0, t1 - corners[:, 1].max()]) / (ds, dt)).clip(0).astype(int)
    x1, y1 = np.ceil(np.array([corners[:, 0].max() - s0, t1 - corners[:, 1].min()]) / (ds, dt)).astype(int)
    x, y = np.meshgrid(np.arange(x0, min(x1, columns)), np.arange(y0, min(y1, rows)))
    points = np.stack([s0 + (x + 0.5) * ds, t1 - (y + 0.5) * dt], axis=-1).reshape(-1, 2)
    in_front = points @ matrix[:2, 2] + matrix[2, 2] > _NEAREST_W
    st = homography.apply(matrix, points[in_front])
    inside = ((st >= 0) & (st <= 1)).all(axis=1)
    seen = np.flatnonzero(in_front)[inside]
    jacobian = homography.jacobian(matrix, points[seen]) * np.array([ds, -dt])
    layer = (baker.sample(st[inside], jacobian) * opacity).astype(np.float32)
    row, column = y.ravel()[seen], x.ravel()[seen]
    color[row, column] = layer + color[row, column] * (1 - layer[:, 3:])


def _layers_in(data: ZipmapData, bounds: tuple[float, float, float, float]) -> np.ndarray:
    """Layers whose bounds overlap, in draw order."""
    s0, t0, s1, t1 = bounds
    b = data.bounds
    return np.flatnonzero((b[:, 0] < s1) & (b[:, 2] > s0) & (b[:, 1] < t1) & (b[:, 3] > t0))


def _seen(matrix: np.ndarray, bounds: tuple[float, float, float, float], is_patch: bool) -> np.ndarray:
    """Corners (N, 2) of the part of the root's rectangle `bounds` where a layer is; empty where it is not.

    Layer coordinates [u v w] = [s t 1] @ matrix are linear in s and t, so that 0 <= u <= w, 0 <= v <= w and w > 0 are
    half-planes, and the part is a convex polygon whose image is spanned by its corners' images.
    """
    s0, t0, s1, t1 = bounds
    corners = np.array([[s0, t0, 1.0], [s1, t0, 1.0], [s1, t1, 1.0], [s0, t1, 1.0]])
    u, v, w = matrix.T
    front = w - np.array([0.0, 0.0, _NEAREST_W])
    for plane in (front, u, w - u, v, w - v) if is_patch else (front,):
        side = corners @ plane
        following, side_following = np.roll(corners, -1, axis=0), np.roll(side, -1)
        kept = []
        for here, there, a, b in zip(corners, following, side, side_following, strict=True):
            if a >= 0:
                kept.append(here)
            if (a < 0) != (b < 0):
                kept.append(here + (there - here) * (a / (a - b)))
        corners = np.array(kept).reshape(-1, 3)
    return corners[:, :2]


def _texels_per_pixel(
    matrix: np.ndarray, points: np.ndarray, texels: tuple[int, int], pixels: tuple[int, int]
) -> np.ndarray:
    """Largest number of texels that a pixel's step crosses at each point (N,): the larger singular value."""
    jacobian = homography.jacobian(matrix, points) * (np.array(texels)[:, None] / np.array(pixels)[None, :])
    jacobian = jacobian[np.isfinite(jacobian).all(axis=(1, 2))]
    return np.linalg.svd(jacobian, compute_uv=False)[:, 0] if len(jacobian) else np.zeros(0)


def _window(layers: _Layers, layer: int, level: int, corners: np.ndarray) -> _Window:
    source, path, data = layers.source(layer), layers.data.paths[layer], layers.data
    facts = layers.facts(layer)
    width, height = (level_size(size, level) for size in facts.size)
    wrap_s, wrap_t = data.sources[data.source_index[layer]].wrap
    st = homography.apply(data.root_to_patch[layer], corners)
    low, high = st.min(axis=0), st.max(axis=0)
    if layer == 0 and ((low < 0).any() or (high > 1).any()):
        low, high = np.zeros(2), np.ones(2)  # wraps around: any part may be seen
    x0, x1 = _span(low[0], high[0], width)
    y0, y1 = _span(1 - high[1], 1 - low[1], height)
    stored = layers.cache.window(source, path, level, (x0, y0, x1, y1))
    return _Window(decode_page(stored, facts.page_class), x0, y0, width, height, (_WRAPS[wrap_s], _WRAPS[wrap_t]))


def _span(low: float, high: float, size: int) -> tuple[int, int]:
    """Texels that bilinear lookups between two coordinates in [0, 1] read."""
    first = int(np.clip(np.floor(low * size - 0.5), 0, size - 1))
    return first, int(np.clip(np.ceil(high * size + 0.5), first + 1, size))


@numba.njit(cache=True, nogil=True)
def _wrapped(coordinate, mode):
    """Texture coordinate after wrapping, and whether anything is there: 0 none outside, 1 clamp, 2 repeat, 3 mirror."""
    if mode == 2:
        return coordinate - np.floor(coordinate), True
    if mode == 3:
        folded = coordinate - 2 * np.floor(coordinate / 2)
        return (2 - folded if folded > 1 else folded), True
    if mode == 1:
        return min(1.0, max(0.0, coordinate)), True
    return coordinate, 0 <= coordinate <= 1


@numba.njit(cache=True, nogil=True)
def _composite(color, raster, matrix, texels, place, opacity):
    """Draw one layer over the samples of a tile: color = layer + color (1 - alpha)."""
    s0, t1, ds, dt = raster
    x0, y0, width, height, wrap_s, wrap_t = place
    rows, columns = texels.shape[:2]
    layer = np.zeros(4, np.float32)
    for j in range(color.shape[0]):
        t = t1 - (j + 0.5) * dt
        for i in range(color.shape[1]):
            s = s0 + (i + 0.5) * ds
            w = s * matrix[0, 2] + t * matrix[1, 2] + matrix[2, 2]
            if w <= 0:
                continue
            u, inside_u = _wrapped((s * matrix[0, 0] + t * matrix[1, 0] + matrix[2, 0]) / w, wrap_s)
            v, inside_v = _wrapped((s * matrix[0, 1] + t * matrix[1, 1] + matrix[2, 1]) / w, wrap_t)
            if not (inside_u and inside_v):
                continue
            x, y = u * width - 0.5, (1 - v) * height - 0.5
            column, row = np.floor(x), np.floor(y)
            fx, fy = np.float32(x - column), np.float32(y - row)
            left = min(max(int(column) - x0 + 1, 0), columns - 1)
            right = min(left + 1, columns - 1)
            top = min(max(int(row) - y0 + 1, 0), rows - 1)
            bottom = min(top + 1, rows - 1)
            for c in range(4):
                upper = texels[top, left, c] + fx * (texels[top, right, c] - texels[top, left, c])
                lower = texels[bottom, left, c] + fx * (texels[bottom, right, c] - texels[bottom, left, c])
                layer[c] = (upper + fy * (lower - upper)) * np.float32(opacity)
            rest = np.float32(1) - layer[3]
            for c in range(4):
                color[j, i, c] = layer[c] + color[j, i, c] * rest
