"""Umbrella textures on the GPU: what a view sees of one, and the records of shaders/umbrella*.glsl.

Arrangements are static (`umbrella_texels`): a view chooses only which levels of detail it sees, how far beyond a cell
its list must serve, and which mip levels of images it needs.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from fexel import homography
from fexel.filters.view import FilterView
from fexel.textures.image_source import ImageSource, holds_vectors
from fexel.textures.image_view import ImageView, write_image_records
from fexel.textures.index import build_tree
from fexel.textures.kind import Sight
from fexel.textures.page_format import FLOAT, HALF
from fexel.textures.pool import TexturePool
from fexel.textures.pyramid_cache import PyramidCache
from fexel.textures.residency import PairView, view_pairs
from fexel.textures.umbrella import BASE_IMAGE_BIAS, UmbrellaData
from fexel.textures.umbrella_arrangement import Arrangement
from fexel.textures.umbrella_binding import (
    ArrangementPlaces,
    ImagePlaces,
    UmbrellaFeatures,
    UmbrellaSlot,
    bind,
    umbrella_record,
)
from fexel.textures.umbrella_cells import fine_size
from fexel.textures.umbrella_detail import Detail, LevelView, PictureView, detail_of
from fexel.textures.umbrella_filtered import UmbrellaFilter
from fexel.textures.umbrella_picture import PictureTexels, umbrella_cells
from fexel.textures.umbrella_scales import texel_scales
from fexel.textures.umbrella_texels import ArrangementSource, ArrangementTexels, ColorSource, Layout

__all__ = ["bind", "plan"]

_SOFT = 0.7  # pixels beyond its contour that an umbrella is seen; at tips one, but hardly
_LIST_LENGTH = 2.5
_FEWEST_CELLS, _MOST_CELLS, _CELLS_PER_UMBRELLA = 1 << 14, 1 << 18, 16  # for memory: a list entry is 48 bytes
_LEAST_MARGIN = -3  # log2 of cells of lists: below it lists are hardly shorter, and every view has the same

_lists: WeakKeyDictionary[Arrangement, tuple[tuple[int, int], float]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class _Drawn:
    """An arrangement of a view: numbers in the pool of its static data, -1 for no colours, and its bases' images."""

    view: LevelView
    source: ArrangementSource
    layout: Layout
    texels: int
    colors: int
    bases: tuple[ImageView, ...]


@dataclass(frozen=True, eq=False)
class _UmbrellaPlan:
    """One umbrella texture of one view."""

    data: UmbrellaData
    sight: Sight
    detail: Detail
    drawn: tuple[_Drawn, ...]
    background: ImageView
    picture: ImageView | None
    filter: UmbrellaFilter
    filtered: bool
    probes: bool
    opaque: bool
    wrap: tuple[str, str]

    @property
    def layers_total(self) -> int:
        return len(self.data.arrangement) + 1

    @property
    def layers_seen(self) -> Collection[str]:
        return (self.sight.path,)

    @property
    def _images(self) -> list[ImageView]:
        """Of all bases, the background, the picture."""
        bases = [view for drawn in self.drawn for view in drawn.bases]
        return [*bases, self.background, *([self.picture] if self.picture else [])]

    def write(self, pool: TexturePool) -> UmbrellaSlot:
        images = self._images
        start, texels = write_image_records(images, pool)
        background = start + texels * (len(images) - (2 if self.picture else 1))
        picture = self.detail.picture
        after = (picture.level, 1) if picture else (0, 0)
        records = []
        bases = start
        for drawn in self.drawn or (None,):
            places = ImagePlaces(bases, background, background + texels, texels)
            records.append(
                umbrella_record(
                    self.data,
                    self.sight,
                    _places(drawn, pool) if drawn else None,
                    images=places,
                    wrap=self.wrap,
                    detail=(len(self.drawn) - 1, drawn.view.level if drawn else 0, *after),
                    most=self.filter.most,
                    filtered=self.filtered,
                )
            )
            bases += texels * len(drawn.bases) if drawn else 0
        classes = {int(pool.page_class[view.image]) for view in images}
        size = pool.facts(self.background.image).size
        has_file = pool.facts(self.background.image).info is not None
        classes |= {FLOAT} if self.drawn else set()
        features = self._features()
        return UmbrellaSlot(
            kind="umbrella",
            page_classes=frozenset(classes | ({HALF} if features.colors else set())),
            record=pool.records.append(np.concatenate(records)),
            local_to_texels=self.sight.local_to_st * [*(size if has_file else self.data.arrangement.grid), 1],
            filter=next((view.token for view in reversed(images) if isinstance(view, FilterView)), self.filter.token),
            vectors=self._holds_vectors(pool),
            features=features,
            images=tuple(images),
            constants=records[0],
            most=self.filter.most,
        )

    def _holds_vectors(self, pool: TexturePool) -> bool:
        """Whether all images do."""
        data, cache = self.data, pool.reader(PyramidCache)
        paths = data.paths or (self.sight.path,) * len(data.arrangement.shapes)
        used = [(shape.image, path) for shape, path in zip(data.arrangement.shapes, paths, strict=True) if shape.image]
        used += [(data.background, self.sight.path)] if data.background.file else []
        return bool(used) and all(
            holds_vectors(image, cache.facts(image, path).info, data.scale, data.bias) for image, path in used
        )

    def _features(self) -> UmbrellaFeatures:
        data = self.data
        arrangements = [drawn.view.arrangement for drawn in self.drawn]
        return UmbrellaFeatures(
            drawn=bool(self.drawn),
            merged=max(len(self.drawn) - 1, 0),
            picture=self.picture is not None,
            probes=self.probes,
            filtered=self.filtered,
            projective=any(drawn.layout.stride > 3 for drawn in self.drawn),
            morphs=any(drawn.layout.morphs for drawn in self.drawn),
            shadows=any(arrangement.shadow_strength > 0 for arrangement in arrangements),
            colors=any(drawn.colors >= 0 for drawn in self.drawn),
            alpha=not self.opaque,
            coverages=any(bool((arrangement.coverages < 1).any()) for arrangement in arrangements),
            vectors=data.turns_vectors,
            scaled=(tuple(data.scale), tuple(data.bias)) != ((1.0,) * 4, (0.0,) * 4),
            outside="black" in self.wrap or "patch" in self.wrap,
            perspective=bool((self.sight.local_to_st[:2, 2] != 0).any()),
        )


def plan(data: UmbrellaData, sight: Sight, pool: TexturePool) -> _UmbrellaPlan:
    """What a view sees of an umbrella texture; see `fexel.textures.kind.KindGpu`."""
    sight = replace(sight, local_to_st=sight.local_to_st @ np.array(data.st_to_texture))
    token = pool.filter(data.filter)
    most = 1.0 if token == "mipmap" else pool.anisotropy
    seen = _seen(sight, data.arrangement.grid, most)
    low, high = float(seen.lod_low[0]), float(seen.lod_high[0])
    cache = pool.reader(PyramidCache)
    usable = {level.path for level in data.levels if level.image and _is_readable(level.image, level.path, cache)}
    number = pool.image(data.background, sight.path)
    wrap = _wrap(data, pool, number)
    how = UmbrellaFilter(token, most, sight, "mirror" in wrap)
    left = 1.0 if how.of_levels else how.left(data.arrangement.grid)
    detail = detail_of(data, low, high, usable, wrap)
    drawn = tuple(_drawn(data, view, low, sight.path, (how, left), pool) for view in detail.levels)
    background = how.whole(pool, data.background, sight.path) if drawn and left > 1 else None
    background = background or _image_view(pool, number, data.arrangement.grid, (low, high))
    if drawn:
        background.ask(pool)
    return _UmbrellaPlan(
        data,
        sight,
        detail,
        drawn,
        background,
        _picture(detail.picture, data, (low, high), sight.path, how, pool) if detail.picture else None,
        filter=how,
        filtered=bool(drawn) and left > 1,
        probes=bool(seen.probes[0] > 1),
        opaque=all(all(each.source.opaque) for each in drawn),
        wrap=wrap,
    )


def _seen(sight: Sight, grid: tuple[int, int], anisotropy: float) -> PairView:
    """Footprints in cells of the authored grid."""
    matrix = homography.normalize(sight.local_to_st[None])
    bounds = homography.unit_square_bounds(matrix) if sight.nested else np.array([[-np.inf, -np.inf, np.inf, np.inf]])
    tree = build_tree(sight.pieces, matrix, bounds)
    return view_pairs(tree, matrix, bounds, np.array([grid], np.float64), anisotropy)


def _is_readable(image: ImageSource, path: str, cache: PyramidCache) -> bool:
    return cache.facts(image, path).info is not None


def _image_view(
    pool: TexturePool, number: int, grid: tuple[int, int], lods: tuple[float, float], bias: int = 0
) -> ImageView:
    """Of an image that covers the unit square; `lods` in cells of the authored grid."""
    size = np.log2(np.array(pool.facts(number).size) / grid)
    return ImageView.of(pool, number, lods[0] + size.min(), lods[1] + size.max(), bias)


def _picture(
    picture: PictureView,
    data: UmbrellaData,
    lods: tuple[float, float],
    path: str,
    how: UmbrellaFilter,
    pool: TexturePool,
) -> ImageView:
    path = picture.path or path
    reader = None if isinstance(picture.source, ImageSource) else pool.reader(PictureTexels, pool.reader(PyramidCache))
    number = pool.image(picture.source, path, reader)
    filtered = None if how.of_levels else how.whole(pool, picture.source, path, reader)
    view = filtered or _image_view(pool, number, data.arrangement.grid, lods, picture.bias)
    view.ask(pool)
    return view


def _drawn(
    data: UmbrellaData, view: LevelView, low: float, path: str, how: tuple[UmbrellaFilter, float], pool: TexturePool
) -> _Drawn:
    """Ask for an arrangement and its bases; `low` is the least footprint, log2 of cells of the full grid per pixel.

    `how` is the filter, and which ratio of axes it is to cover in images of bases.
    """
    arrangement, reader, cache = view.arrangement, pool.reader(ArrangementTexels), pool.reader(PyramidCache)
    own_grid = np.log2(np.array(arrangement.grid) / data.arrangement.grid)
    until = view.until + own_grid.max()
    neutral = arrangement.neutral
    size, margin = _list_layout(neutral, until)
    colored = bool(arrangement.colors.any()) and arrangement.color_blend != 0
    paths = data.paths if arrangement is data.arrangement and data.paths else (path,) * len(arrangement.shapes)
    opaque = tuple(
        _is_opaque(shape.image, where, cache) for shape, where in zip(arrangement.shapes, paths, strict=True)
    )
    source = ArrangementSource(neutral, size, margin, opaque, colored)
    texels = _ask_whole(pool, pool.image(source, path, reader))
    layout = reader.layout(source, path)
    colors = _ask_whole(pool, pool.image(ColorSource(neutral), path, reader)) if layout.colored else -1
    numbers = [
        pool.image(shape.image, where) for shape, where in zip(arrangement.shapes, paths, strict=True) if shape.image
    ]
    scales = texel_scales(arrangement, [pool.facts(number).size for number in numbers])
    lods = [(low + own_grid.min() + least, until + most) for least, most in scales]
    if how[1] > 1:
        sources = [(shape.image, where) for shape, where in zip(arrangement.shapes, paths, strict=True) if shape.image]
        bases = tuple(
            how[0].base(pool, image, where, seen, how[1]) for (image, where), seen in zip(sources, lods, strict=True)
        )
    else:
        bases = tuple(
            ImageView.of(pool, number, *seen, BASE_IMAGE_BIAS) for number, seen in zip(numbers, lods, strict=True)
        )
    for base in bases:
        base.ask(pool)
    return _Drawn(view, source, layout, texels, colors, bases)


def _list_layout(arrangement: Arrangement, until: float) -> tuple[tuple[int, int], tuple[float, float]]:
    """Cells along s and t that lists are made for, and their margin in st, in steps of octaves: views share lists.

    `until` is log2 of cells of the arrangement's grid per pixel.
    """
    if arrangement not in _lists:
        most = min(max(_CELLS_PER_UMBRELLA * len(arrangement), _FEWEST_CELLS), _MOST_CELLS)
        _lists[arrangement] = fine_size(arrangement, _LIST_LENGTH, most), umbrella_cells(arrangement)
    size, extent = _lists[arrangement]
    per_cell = max(size[0] / arrangement.grid[0], size[1] / arrangement.grid[1])
    reach = max(_SOFT * min(2.0**until, extent) * per_cell, 2.0**_LEAST_MARGIN)
    margin = min(2.0 ** math.ceil(math.log2(reach)) / per_cell, _SOFT * extent)
    return size, (margin / arrangement.grid[0], margin / arrangement.grid[1])


def _ask_whole(pool: TexturePool, image: int) -> int:
    level = np.array([0])
    pool.ask(np.array([image]), (level, level), (np.zeros((1, 2)), np.ones((1, 2))))
    return image


def _is_opaque(image: ImageSource | None, path: str, cache: PyramidCache) -> bool:
    if image is None:
        return True
    info = cache.facts(image, path).info
    return info is not None and info.alpha_channel < 0 and not image.mask


def _wrap(data: UmbrellaData, pool: TexturePool, background: int) -> tuple[str, str]:
    """Wrap modes; those of the background's file where none are authored, black without one."""
    facts = pool.facts(background)
    of_file = facts.wrap if facts.info else ("black", "black")
    s, t = (own if mode == "useMetadata" else mode for mode, own in zip(data.wrap, of_file, strict=True))
    return s, t


def _places(drawn: _Drawn, pool: TexturePool) -> ArrangementPlaces:
    """Where the static data of an arrangement have been loaded."""
    reader = pool.reader(ArrangementTexels)
    origins, bits = np.zeros((2, 2)), [0, 0]
    colors = ColorSource(drawn.source.arrangement)
    for which, (number, source) in enumerate(((drawn.texels, drawn.source), (drawn.colors, colors))):
        if number >= 0:
            page = pool.atlases[(FLOAT, HALF)[which]].size
            origins[which] = np.rint(pool.places[number, 0, 2:] * np.array(page))
            bits[which] = reader.row_bits(source)
    return ArrangementPlaces(drawn.view.arrangement, origins.ravel(), (bits[0], bits[1]), drawn.layout)
