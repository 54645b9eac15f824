"""Pinchmaps on the GPU: which texels of pinchmap and signal a view sees, and the constants of shaders/pinchmap*.glsl.

Positions are in texels of the pinchmap, t up. Mip levels of the signal down to the resolution of the pinchmap are its
own; coarser ones are averages of the picture. A texture without a usable pinchmap has one that displaces nothing, of
the signal's own resolution.

A filter that reads prefiltered images takes those of the picture as a whole, which has its discontinuities, where
nothing is displaced any more; in between both lookups are blended as the displacement fades.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fexel import homography
from fexel.filters.view import FilterView
from fexel.textures.image_source import holds_vectors
from fexel.textures.image_view import write_image_records
from fexel.textures.index import build_tree
from fexel.textures.kind import Sight
from fexel.textures.layer_footprints import layer_footprints
from fexel.textures.pinchmap import PinchmapData
from fexel.textures.pinchmap_binding import PinchmapConstants, PinchmapSlot, bind, pinchmap_slot
from fexel.textures.pinchmap_picture import PictureImage, PictureImages, PictureLevels, PictureSource
from fexel.textures.pinchmap_texels import CONSTANT, PinchmapTexels
from fexel.textures.pool import TexelReader, TexturePool
from fexel.textures.pyramid_cache import PyramidCache
from fexel.textures.residency import MAX_LEVELS, PairView, view_pairs

__all__ = ["bind", "plan"]

# How far away what is displaced comes from, in texels of the pinchmap.
_REACH = 1.5
# Log2 of the pixels that a texel may be wide before it is interpolated in full precision: filters of hardware have
# weights of 8 bits.
_DEEP = 7
# Log2 of the texels that a pixel is wide where nothing is displaced any more: `pinchmap_segment.FADE_END`.
_FADED = 1.0
# Log2 of the texels that a pixel is wide where that begins (`pinchmap_segment.FADE_START`), less residency's margin.
_FADING = -0.2
_BY_LEVELS = ("mipmap", "anisotropic")
# Far below a texel; a surface whose st end at 0 and 1 may exceed them by rounding.
_ROUNDING = 1e-5


@dataclass(frozen=True, eq=False)
class _Images:
    """Numbers in the pool, and how they go together.

    `size` is that of the pinchmap, `octaves` K: the signal is 2^K as fine. `has_edges`: there is a pinchmap, whose
    picture has the coarse levels. `is_pinched`: it is also read; where not, `pinchmap` displaces nothing. `whole` is
    the plain image that shows the same and who reads it, None for files.
    """

    pinchmap: int
    signal: int
    picture: int
    size: NDArray[np.int64]
    octaves: int
    has_edges: bool
    is_pinched: bool
    whole: tuple[Hashable, TexelReader | None]

    def level(self, level: int) -> tuple[int, int]:
        """Image that has a mip level of the texture, and which of its own it is."""
        if self.has_edges and level > self.octaves:
            return self.picture, level - self.octaves
        return self.signal, level


@dataclass(frozen=True, eq=False)
class _PinchmapPlan:
    """One pinchmap of one view."""

    data: PinchmapData
    sight: Sight
    images: _Images
    levels: tuple[int, int]
    seen: PairView
    bounds: tuple[NDArray[np.float64], NDArray[np.float64]]
    wrap: tuple[str, str]
    most: float
    filter: str
    filtered: FilterView | None

    @property
    def layers_total(self) -> int:
        return 1

    @property
    def layers_seen(self) -> Collection[str]:
        return (self.sight.path,)

    def write(self, pool: TexturePool) -> PinchmapSlot:
        images, data, seen = self.images, self.data, self.seen
        finest, coarsest = self._levels_within(pool)
        matrix = homography.normalize(self.sight.local_to_st[None])[0]
        shown = [images.level(level) for level in range(finest, coarsest + 1)]
        alpha = data.line_color[3]
        record = write_image_records([self.filtered], pool)[0] if self.filtered else -1
        constants = PinchmapConstants(
            matrix=matrix * [*images.size, 1],
            nearest=self._nearest(),
            size=images.size,
            h=min(0.5 * 2.0 ** (finest - images.octaves), 0.5),
            antialias=data.antialias,
            line_width=data.line_width if images.is_pinched else 0.0,
            line_color=(*(alpha * value for value in data.line_color[:3]), alpha),
            octaves=images.octaves,
            finest=finest,
            places=np.array([_upright(pool.places[image, level], pool, image, images.size) for image, level in shown]),
            texel_zero=self._texel_zero(pool),
            page_size=np.array(pool.atlases[pool.page_class[images.pinchmap]].size, np.float64),
            page_classes=(int(pool.page_class[images.pinchmap]), int(pool.page_class[images.signal])),
            is_pinched=images.is_pinched,
            nested=self.sight.nested,
            most=self.most,
            filtered=record,
        )
        # What is displaced, and samples just beside a triangle, may reach across the border.
        low, high = self.bounds
        near = _REACH / images.size
        return pinchmap_slot(
            constants,
            pool.records,
            wrap=self.wrap,
            affine=bool((matrix[:2, 2] == 0).all()),
            deep=bool(seen.lod_low[0] - images.octaves < -_DEEP),
            minified=bool(seen.lod_high[0] > 0),
            probes=bool(seen.probes[0] > 1),
            outside=bool((low < -_ROUNDING).any() or (high > 1 + _ROUNDING).any()),
            across=bool((seen.low[0] < near).any() or (seen.high[0] > 1 - near).any()),
            filtered=self.filtered,
            local_to_texels=matrix * [*pool.facts(images.signal).size, 1],
            filter=self.filtered.token if self.filtered else self.filter,
            vectors=holds_vectors(data.signal, pool.facts(images.signal).info, data.signal.scale, data.signal.bias),
        )

    def _levels_within(self, pool: TexturePool) -> tuple[int, int]:
        """Levels that are resident: the budget may have left out the finest of either image."""
        images = self.images
        finest, coarsest = self.levels
        if finest <= images.octaves or not images.has_edges:
            finest = max(finest, int(pool.finest[images.signal]))
            if images.has_edges and finest > images.octaves:
                finest = images.octaves + 1
        if images.has_edges and finest > images.octaves:
            finest = max(finest, images.octaves + int(pool.finest[images.picture]))
        return finest, max(coarsest, finest)

    def _nearest(self) -> NDArray[np.float64]:
        """Local st where the footprint is smallest: there float32 needs its digits."""
        pieces = self.sight.pieces
        nearest = np.linalg.norm(pieces.jacobian, axis=(2, 3)).max(axis=1).argmin()
        return (pieces.low[nearest] + pieces.high[nearest]) / 2

    def _texel_zero(self, pool: TexturePool) -> NDArray[np.float64]:
        """Page texel of the pinchmap's texel at position (0, 0), its lower left corner."""
        place = pool.places[self.images.pinchmap, 0]
        page = np.array(pool.atlases[pool.page_class[self.images.pinchmap]].size)
        rows = pool.facts(self.images.pinchmap).size[1]
        return np.rint(place[2:] * page) + [0, rows - 1]


def plan(data: PinchmapData, sight: Sight, pool: TexturePool) -> _PinchmapPlan:
    """What a view sees of a pinchmap; see `fexel.textures.kind.KindGpu`."""
    images = _images(data, sight.path, pool)
    sight = replace(sight, local_to_st=sight.local_to_st @ np.array(data.st_to_texture))
    token = pool.filter(data.filter)
    most = 1.0 if token == "mipmap" else pool.anisotropy
    matrix = homography.normalize(sight.local_to_st[None])
    bounds = homography.unit_square_bounds(matrix) if sight.nested else np.array([[-np.inf, -np.inf, np.inf, np.inf]])
    tree = build_tree(sight.pieces, matrix, bounds)
    facts = pool.facts(images.signal)
    size = np.array([facts.size], np.float64)
    seen = view_pairs(tree, matrix, bounds, size, most)
    plain = view_pairs(tree, matrix, bounds, size, 1.0)
    if plain.lod_high[0] <= 0:  # nowhere is the longest axis of a pixel as long as a texel: nothing to probe
        seen = plain
    faded = seen.lod_low[0] - images.octaves >= _FADED
    fading = seen.lod_high[0] - images.octaves > _FADING if images.has_edges else plain.lod_high[0] > 0
    filtered = None
    if fading and token not in _BY_LEVELS:
        filtered = _filtered(images, token, sight, bounds[0], pool)
    last = min(facts.last_level, MAX_LEVELS - 1)
    finest = int(np.floor(seen.lod_low[0]).clip(0, last))
    coarsest = int((np.floor(seen.lod_high[0]) + 1).clip(0, last))
    if filtered and (faded or not images.has_edges):
        finest = coarsest  # is not seen
    if faded:
        images = replace(
            images, pinchmap=pool.image(CONSTANT, sight.path, pool.reader(PinchmapTexels)), is_pinched=False
        )
    reach = _REACH / images.size
    uv = seen.low - reach, seen.high + reach
    for level in range(finest, coarsest + 1):
        image, own = images.level(level)
        _ask(pool, image, own, uv)
    _ask(pool, images.pinchmap, 0, uv)
    bounds_seen = _bounds(sight)
    return _PinchmapPlan(
        data, sight, images, (finest, coarsest), seen, bounds_seen, facts.wrap, most, filter=token, filtered=filtered
    )


def _filtered(
    images: _Images, token: str, sight: Sight, bounds: NDArray[np.float64], pool: TexturePool
) -> FilterView | None:
    """What is wanted of the picture as a whole; None where nothing is seen of it."""
    source, reader = images.whole
    size = pool.facts(pool.image(source, sight.path, reader)).size
    matrix = homography.normalize(sight.local_to_st[None])[0]
    seen = layer_footprints(sight.pieces, matrix, size, bounds)
    if not len(seen.jacobian):
        return None
    view = FilterView.of(pool, source, sight.path, token, seen.jacobian, seen.low, seen.high, reader=reader)
    view.ask(pool)
    return view


def _bounds(sight: Sight) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least and largest st of the texture that are seen; NaN, which nothing lies within, beyond a horizon."""
    low, high = sight.pieces.low.min(axis=0), sight.pieces.high.max(axis=0)
    corners = homography.apply(sight.local_to_st, low + homography.UNIT_SQUARE * (high - low))
    return corners.min(axis=0), corners.max(axis=0)


def _ask(pool: TexturePool, image: int, level: int, uv: tuple[NDArray[np.float64], NDArray[np.float64]]) -> None:
    levels = np.array([level])
    pool.ask(np.array([image]), (levels, levels), uv)


def _images(data: PinchmapData, path: str, pool: TexturePool) -> _Images:
    """Images of a texture; that of `inputs:fallback` where its pinchmap cannot be used."""
    cache = pool.reader(PyramidCache)
    reader = pool.reader(PinchmapTexels)
    facts = cache.facts(data.signal, path)
    source = reader.source(data.pinchmap, path, facts.info, facts.wrap)
    signal = data.signal
    if source is None:
        source, signal = CONSTANT, replace(signal, file="", wrap=("clamp", "clamp"))
    number = pool.image(signal, path)
    pinchmap = pool.image(source, path, reader)
    signal_size = np.array(pool.facts(number).size)
    if source is CONSTANT:
        whole = (signal, None)
        return _Images(pinchmap, number, number, signal_size, 0, has_edges=False, is_pinched=False, whole=whole)
    size = np.array(pool.facts(pinchmap).size)
    octaves = int(signal_size[0] // size[0]).bit_length() - 1
    pictures = pool.reader(PictureLevels, cache, reader)
    picture = PictureSource(signal, source, data.line_width, data.line_color if data.line_width else (0.0,) * 4)
    coarse = pool.image(picture, path, pictures)
    whole = (PictureImage(picture), pool.reader(PictureImages, cache, reader))
    return _Images(pinchmap, number, coarse, size, octaves, has_edges=True, is_pinched=True, whole=whole)


def _upright(place: NDArray[np.float64], pool: TexturePool, image: int, size: NDArray[np.int64]) -> NDArray[np.float64]:
    """Scale and offset from positions, t up, where the pool has them from texels of an image's level 0, y down."""
    texels = np.array(pool.facts(image).size) / size
    scale = place[:2] * texels
    return np.array([scale[0], -scale[1], place[2], place[3] + scale[1] * size[1]])
