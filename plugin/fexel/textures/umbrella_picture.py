"""The prefiltered picture of an umbrella texture that has none: made from its twin when a view is far enough away.

A stage that was edited by hand has no level of detail that goes with it, and is to be stable to the horizon too.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fexel import mipmaps
from fexel.textures.atlas import Box
from fexel.textures.image_source import SCALE_ONE
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.page_format import HALF, SRGB
from fexel.textures.page_texels import bordered, encode_page, inner_box
from fexel.textures.pinchmap_lattice import blocks
from fexel.textures.pyramid_cache import ImageFacts, PyramidCache
from fexel.textures.umbrella import UmbrellaData
from fexel.textures.umbrella_arrangement import Arrangement
from fexel.textures.umbrella_composite import CompositeTwin
from fexel.textures.umbrella_images import TwinImage, base_images
from fexel.textures.umbrella_layers import ArrangementTwin

__all__ = ["PictureSource", "PictureTexels", "picture_level", "picture_source", "picture_wrap", "umbrella_cells"]

_CELL_TEXELS = 8  # along an axis of a cell: as many as there are pixels at full detail
_MOST_TEXELS = 1 << 18
_SAMPLES = 2  # along an axis of a texel, where that makes not too many of them
_MOST_SAMPLES = 1 << 18  # of a picture: seconds
_MOST_KEPT = 1 << 20  # vertices of umbrellas that are kept for the next look: 100 bytes each
_TYPICAL_CELLS = 1.5  # how wide umbrellas are meant to be
_BLOCK = 1 << 15


@dataclass(frozen=True)
class PictureSource:
    """A picture to be made.

    Attributes
    ----------
    data : UmbrellaData
        The texture without levels, matrix and bias; its scale tells only which way vectors turn.
    size : (int, int)
        Texels along s and t.
    """

    data: UmbrellaData
    size: tuple[int, int]

    @property
    def key(self) -> Hashable:
        """Equal where sources are; it keeps no arrangement alive."""
        data = self.data
        return data.arrangement.digest, data.background, data.paths, data.wrap, data.vector_hand, self.size


def picture_wrap(wrap: tuple[str, str]) -> tuple[str, str]:
    """How a picture of the unit square goes on past its border in a texture of these wrap modes.

    Coordinates have been wrapped before: only where the texture repeats do opposite borders lie side by side.
    """
    s, t = ("repeat" if mode == "repeat" else "clamp" for mode in wrap)
    return s, t


def picture_source(data: UmbrellaData, wrap: tuple[str, str]) -> PictureSource:
    """What the picture of a texture is made from.

    Parameters
    ----------
    data : UmbrellaData
    wrap : (str, str)
        Of the texture, ``useMetadata`` resolved.
    """
    own = picture_wrap(wrap)
    whole = UmbrellaData(
        background=replace(data.background, wrap=own),
        arrangement=data.arrangement,
        paths=data.paths,
        wrap=own,
        scale=data.scale if data.turns_vectors else SCALE_ONE,
        turns_vectors=data.turns_vectors,
    )
    per_cell = 2.0 * _CELL_TEXELS / 2.0 ** picture_level(data.arrangement)
    width, height = (max(1, round(cells * per_cell)) for cells in data.arrangement.grid)
    return PictureSource(whole, (width, height))


def picture_level(arrangement: Arrangement) -> int:
    """From which level of detail on the picture is seen alone: where an umbrella is a few pixels wide.

    A level is log2 of cells of the authored grid, which may be anything: it can be negative. Later where so many texels
    would take too long.
    """
    texels = math.prod(arrangement.grid) * _CELL_TEXELS**2
    least = 1 + math.ceil(math.log2(texels / _MOST_TEXELS) / 2)
    return max(least, 1 + round(math.log2(umbrella_cells(arrangement) / _TYPICAL_CELLS)))


def umbrella_cells(arrangement: Arrangement) -> float:
    """Median extent of umbrellas in cells of the authored grid; of none, that which `_TYPICAL_CELLS` says."""
    if not len(arrangement):
        return _TYPICAL_CELLS
    begin = arrangement.first_vertex[:-1]
    low, high = (of.reduceat(arrangement.vertices, begin) for of in (np.minimum, np.maximum))
    extent = np.sqrt(np.prod((high - low) * arrangement.grid, axis=1))
    return max(float(np.median(extent)), 1e-6)  # 1e-6 guards umbrellas that are points


class PictureTexels:
    """Reads `PictureSource`; see `fexel.textures.pool.TexelReader`.

    Parameters
    ----------
    kept : KeptTexels
    cache : PyramidCache
        Of the images in it.
    """

    def __init__(self, kept: KeptTexels, cache: PyramidCache) -> None:
        self._kept, self._cache = kept, cache
        self._umbrellas: tuple[Hashable, ArrangementTwin | None] = None, None

    def facts(self, source: PictureSource, path: str) -> ImageFacts:
        """Size and page class."""
        data = source.data
        images = [shape.image for shape in data.arrangement.shapes if shape.image] + [data.background]
        classes = {self._cache.facts(image, path).page_class for image in images if image.file}
        page_class = SRGB if classes == {SRGB} else HALF
        return ImageFacts(source.size, page_class, data.wrap, None)

    def window(self, source: PictureSource, path: str, level: int, box: Box) -> NDArray:
        """Texels of a window with its border."""
        levels = self._kept.get(source.key)
        if levels is None:
            page_class = self.facts(source, path).page_class
            levels = [encode_page(texels, page_class) for texels in mipmaps.pyramid(self._made(source, path))]
            self._kept.keep(source.key, levels, sum(texels.nbytes for texels in levels))
        size = (levels[level].shape[1], levels[level].shape[0])
        x0, y0, x1, y1 = inner_box(box, size)
        return bordered(levels[level][y0:y1, x0:x1], box, size, source.data.wrap)

    def _made(self, source: PictureSource, path: str) -> NDArray[np.float32]:
        """(H, W, 4) means of a few soft lookups per texel."""
        width, height = source.size
        samples = _SAMPLES if width * height * _SAMPLES**2 <= _MOST_SAMPLES else 1
        columns, rows = width * samples, height * samples
        s, t = (np.arange(columns) + 0.5) / columns, (np.arange(rows)[::-1] + 0.5) / rows
        st = np.stack(np.meshgrid(s, t), axis=-1).reshape(-1, 2)
        color = np.zeros((len(st), 4))
        twin, axes = self._twin(source.data, path), np.diag([1.0 / columns, 1.0 / rows])
        for block in blocks(len(st), _BLOCK):
            color[block] = twin.sample(st[block], np.broadcast_to(axes, (len(st[block]), 2, 2)))
        color = color.reshape(height, samples, width, samples, 4).mean(axis=(1, 3))
        return color.astype(np.float32)

    def _twin(self, data: UmbrellaData, path: str) -> CompositeTwin:
        background = TwinImage(data.background, path, self._cache)
        umbrellas = self._looking(data)
        return CompositeTwin(umbrellas, background, data.wrap, data.arrangement.grid, 1.0)

    def _looking(self, data: UmbrellaData) -> ArrangementTwin:
        """The umbrellas; those of the picture before where only their blend or the strength of shadows has changed."""
        arrangement = data.arrangement
        shadow = arrangement.shadow_offset if arrangement.shadow_strength > 0 else None
        key = arrangement.neutral.digest, shadow, data.paths, data.vector_hand
        last, umbrellas = self._umbrellas
        if umbrellas is not None and last == key:
            return umbrellas.looking(arrangement)
        images = base_images(arrangement, data.paths, self._cache)
        umbrellas = ArrangementTwin(arrangement, images, data.vector_hand)
        is_small = arrangement.first_vertex[-1] <= _MOST_KEPT
        self._umbrellas = (key, umbrellas) if is_small else (None, None)
        return umbrellas
