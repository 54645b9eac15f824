"""Umbrella textures on the GPU: what a view sees of one, and the records of shaders/umbrella*.glsl.

The arrangement itself is static (`umbrella_texels`): a view chooses only how far beyond a cell its list must serve,
which images and levels are seen, and whether it sees umbrellas, the prefiltered level or both.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from fexel import homography
from fexel.textures.image_view import ImageView
from fexel.textures.index import build_tree
from fexel.textures.kind import Sight
from fexel.textures.page_format import FLOAT, HALF
from fexel.textures.pool import TexturePool
from fexel.textures.pyramid_cache import PyramidCache
from fexel.textures.residency import PairView, view_pairs
from fexel.textures.umbrella import LEVEL_IMAGE_BIAS, UmbrellaData
from fexel.textures.umbrella_arrangement import Arrangement
from fexel.textures.umbrella_binding import (
    ImagePlaces,
    StaticPlaces,
    UmbrellaFeatures,
    UmbrellaSlot,
    bind,
    umbrella_record,
)
from fexel.textures.umbrella_cells import fine_size
from fexel.textures.umbrella_texels import ArrangementSource, ArrangementTexels, ColorSource

__all__ = ["bind", "plan"]

_LEVEL_0 = 3.0  # -log2 of the cells per pixel up to which umbrellas are seen alone
_FOOTPRINTS = (-6.0, -4.0, -2.0)  # log2 of the cells per pixel that lists are made for
_TEXEL_MARGIN = 0.7  # octaves by which mip levels of a base may differ from those of its least-squares placement


@dataclass(frozen=True, eq=False)
class _UmbrellaPlan:
    """One umbrella texture of one view."""

    data: UmbrellaData
    sight: Sight
    source: ArrangementSource
    numbers: tuple[int, int]
    bases: tuple[ImageView, ...]
    background: ImageView
    picture: ImageView | None
    blend: tuple[float, float]
    features: UmbrellaFeatures
    wrap: tuple[str, str]

    @property
    def layers_total(self) -> int:
        return len(self.data.arrangement) + 1

    @property
    def layers_seen(self) -> Collection[str]:
        return (self.sight.path,)

    def write(self, pool: TexturePool) -> UmbrellaSlot:
        views = [*self.bases, self.background, *([self.picture] if self.picture else [])]
        records = [view.record(pool) for view in views]
        texels = max(len(record) for record in records)
        start = pool.records.next
        for record in records:
            pool.records.append(np.concatenate([record, np.zeros((texels - len(record), 4))]))
        background = start + texels * len(self.bases)
        record = umbrella_record(
            self.data,
            self.sight,
            static=self._static(pool),
            images=ImagePlaces(start, background, background + texels, texels),
            wrap=self.wrap,
            blend=self.blend,
        )
        classes = {int(pool.page_class[view.image]) for view in views} | {FLOAT}
        return UmbrellaSlot(
            kind="umbrella",
            page_classes=frozenset(classes | ({HALF} if self.features.colors else set())),
            record=pool.records.append(record),
            features=self.features,
            images=tuple(views),
            constants=record,
        )

    def _static(self, pool: TexturePool) -> StaticPlaces:
        reader = pool.reader(ArrangementTexels)
        sources = (self.source, ColorSource(self.data.arrangement))
        origins = np.zeros((2, 2))
        for which, (number, page_class) in enumerate(zip(self.numbers, (FLOAT, HALF), strict=True)):
            if number >= 0:
                page = np.array(pool.atlases[page_class].size)
                origins[which] = np.rint(pool.places[number, 0, 2:] * page)
        bits = tuple(reader.row_bits(source) if self.numbers[0] >= 0 else 0 for source in sources)
        return StaticPlaces(origins.ravel(), (bits[0], bits[1]), reader.layout(self.source))


def plan(data: UmbrellaData, sight: Sight, pool: TexturePool) -> _UmbrellaPlan:
    """What a view sees of an umbrella texture; see `fexel.textures.kind.KindGpu`."""
    arrangement = data.arrangement
    sight = replace(sight, local_to_st=sight.local_to_st @ np.array(data.st_to_texture))
    seen = _seen(sight, arrangement.grid, pool.anisotropy)
    probes = bool(seen.probes[0] > 1)
    low, high = float(seen.lod_low[0]), float(seen.lod_high[0])
    cache, reader = pool.reader(PyramidCache), pool.reader(ArrangementTexels)
    picture, blend = None, (1.0, 1.0)
    finer = 0
    for level in data.levels:
        if level.image is not None:
            picture, blend = level.image, (float(level.level), float(level.level - finer))
            break
        finer = level.level
    drawn = picture is None or low + _LEVEL_0 < blend[0]
    shown = picture is not None and high + _LEVEL_0 > blend[0] - blend[1]
    footprint = min(high, blend[0] - _LEVEL_0) if picture is not None else high
    fits = [octave for octave in _FOOTPRINTS if octave >= footprint]
    margin = 0.5 * 2.0 ** (fits[0] if fits else _FOOTPRINTS[-1])
    opaque = tuple(_is_opaque(shape.image, sight.path, cache) for shape in arrangement.shapes)
    source = ArrangementSource(
        arrangement,
        fine_size(arrangement),
        (margin / arrangement.grid[0], margin / arrangement.grid[1]),
        opaque,
    )
    colors = bool(arrangement.colors.any()) and arrangement.color_blend != 0
    numbers = [-1, -1]
    if drawn:
        numbers[0] = pool.image(source, sight.path, reader)
        _ask_whole(pool, numbers[0])
        if colors:
            numbers[1] = pool.image(ColorSource(arrangement), sight.path, reader)
            _ask_whole(pool, numbers[1])
    bases = []
    scales = _texel_scales(arrangement, pool, sight.path)
    for number, shape in enumerate(arrangement.shapes):
        if shape.image is not None:
            image = pool.image(shape.image, data.paths[number] if data.paths else sight.path)
            least, most = scales[number]
            view = ImageView.of(pool, image, low + least - _TEXEL_MARGIN, min(high, footprint) + most + _TEXEL_MARGIN)
            bases.append(view)
    number = pool.image(data.background, sight.path)
    size = np.log2(np.array(pool.facts(number).size) / arrangement.grid)
    background = ImageView.of(pool, number, low + size.min(), high + size.max())
    pictured = None
    if shown and picture is not None:
        number = pool.image(picture, sight.path)
        size = np.log2(np.array(pool.facts(number).size) / arrangement.grid)
        pictured = ImageView.of(pool, number, low + size.min(), high + size.max(), LEVEL_IMAGE_BIAS)
        pictured.ask(pool)
    if drawn:
        for view in (*bases, background):
            view.ask(pool)
    facts = pool.facts(background.image)
    wrap = tuple(
        (of_file if facts.info else "black") if mode == "useMetadata" else mode
        for mode, of_file in zip(data.wrap, facts.wrap, strict=True)
    )
    layout = reader.layout(source)
    features = UmbrellaFeatures(
        drawn=drawn,
        picture=pictured is not None,
        probes=probes,
        stride=layout.stride,
        projective=layout.projective,
        morphs=layout.morphs,
        shadows=arrangement.shadow_strength > 0,
        colors=colors,
        alpha=not all(opaque),
        coverages=bool((arrangement.coverages < 1).any()),
        vectors=data.turns_vectors,
        scaled=(tuple(data.scale), tuple(data.bias)) != ((1.0,) * 4, (0.0,) * 4),
        outside="black" in wrap or "patch" in wrap,
        perspective=bool((sight.local_to_st[:2, 2] != 0).any()),
    )
    return _UmbrellaPlan(
        data, sight, source, (numbers[0], numbers[1]), tuple(bases), background, pictured, blend, features, wrap
    )


def _seen(sight: Sight, grid: tuple[int, int], anisotropy: float) -> PairView:
    """Footprints in cells of the authored grid."""
    matrix = homography.normalize(sight.local_to_st[None])
    bounds = homography.unit_square_bounds(matrix) if sight.nested else np.array([[-np.inf, -np.inf, np.inf, np.inf]])
    tree = build_tree(sight.pieces, matrix, bounds)
    return view_pairs(tree, matrix, bounds, np.array([grid], np.float64), anisotropy)


def _ask_whole(pool: TexturePool, image: int) -> None:
    level = np.array([0])
    pool.ask(np.array([image]), (level, level), (np.zeros((1, 2)), np.ones((1, 2))))


def _is_opaque(image, path: str, cache: PyramidCache) -> bool:
    if image is None:
        return True
    info = cache.facts(image, path).info
    return info is not None and info.alpha_channel < 0 and not image.mask


def _texel_scales(arrangement: Arrangement, pool: TexturePool, path: str) -> list[tuple[float, float]]:
    """Per shape: log2 of the least and the most texels of its image per cell of the authored grid."""
    scales = []
    centers = arrangement.points[arrangement.first_vertex[:-1]]
    jacobian = homography.jacobian(arrangement.matrices, centers[:, None])[:, 0] * np.array(arrangement.grid)[:, None]
    for number, shape in enumerate(arrangement.shapes):
        users = arrangement.shape_of == number
        if shape.image is None or not users.any():
            scales.append((0.0, 0.0))
            continue
        size = np.array(pool.facts(pool.image(shape.image, path)).size)
        # The affine map from patch space to texels that is nearest to the shape's.
        away = np.column_stack([shape.points, np.ones(len(shape.points))])
        texels = np.linalg.lstsq(away, shape.tex_coords * size, rcond=None)[0][:2].T
        stretch = np.linalg.svd(texels @ np.linalg.inv(jacobian[users]), compute_uv=False)
        # 1e-12 guards an image that is seen along a line.
        scales.append((float(np.log2(max(stretch.min(), 1e-12))), float(np.log2(max(stretch.max(), 1e-12)))))
    return scales
