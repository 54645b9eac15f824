"""A pinchmapped picture minified: what is left of its discontinuities where a pixel covers many texels.

The signal's own coarse levels are those of the picture before pinching; below the resolution of the pinchmap, where
nothing is left to pinch, averages of the pinched picture take their place (`pinchmap_twin.picture_levels`). Filters
that read prefiltered images take those of the picture as a whole (`PictureImage`).
"""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import NDArray

from fexel import mipmaps
from fexel.textures.atlas import Box
from fexel.textures.image_source import ImageSource
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.page_texels import bordered, decode_page, encode_page, inner_box
from fexel.textures.pinchmap_texels import PinchmapSource, PinchmapTexels
from fexel.textures.pinchmap_twin import cell_samples, picture_image, picture_levels
from fexel.textures.pyramid_cache import ImageFacts, PyramidCache

__all__ = ["PictureImage", "PictureImages", "PictureLevels", "PictureSource"]

_MOST_TEXELS = 1 << 24  # of a picture as a whole: beyond, coarser texels of its signal do


@dataclass(frozen=True)
class PictureSource:
    """A pinchmapped picture; level 0 is as large as the pinchmap.

    Attributes
    ----------
    signal : ImageSource
    pinchmap : PinchmapSource
    line_width : float
        In texels of the pinchmap.
    line_color : 4-tuple
        Linear, straight alpha.
    """

    signal: ImageSource
    pinchmap: PinchmapSource
    line_width: float = 0.0
    line_color: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)


class PictureLevels:
    """Makes the levels of pictures when they are first seen."""

    def __init__(self, kept: KeptTexels, signals: PyramidCache, pinchmaps: PinchmapTexels) -> None:
        self._kept = kept
        self._signals = signals
        self._pinchmaps = pinchmaps

    def facts(self, source: PictureSource, path: str) -> ImageFacts:
        """See `fexel.textures.pool.TexelReader`."""
        signal = self._signals.facts(source.signal, path)
        return ImageFacts(
            self._pinchmaps.facts(source.pinchmap, path).size, signal.page_class, signal.wrap, signal.info
        )

    def window(self, source: PictureSource, path: str, level: int, box: Box) -> NDArray:
        """See `fexel.textures.pool.TexelReader`; level 0, which is the signal's, is never asked for."""
        levels = self._kept.get(source)
        if levels is None:
            levels = self._made(source, path)
            self._kept.keep(source, levels, sum(texels.nbytes for texels in levels))
        texels = levels[level - 1]
        size = (texels.shape[1], texels.shape[0])
        x0, y0, x1, y1 = inner_box(box, size)
        return bordered(texels[y0:y1, x0:x1], box, size, self.facts(source, path).wrap)

    def _made(self, source: PictureSource, path: str) -> list[NDArray]:
        """From level 1 on, as pages store them."""
        facts = self._signals.facts(source.signal, path)
        pinchmap = self._pinchmaps.texels(source.pinchmap, path)
        octaves = (facts.size[0] // pinchmap.shape[1]).bit_length() - 1
        # Of levels finer than its samples it reads nothing: leaving them out keeps a huge signal on disk.
        used = cell_samples(pinchmap, facts.wrap).bit_length() - 1
        levels = []
        for level in range(max(0, octaves - used), octaves + 1):
            width, height = (mipmaps.level_size(axis, level) for axis in facts.size)
            window = self._signals.window(source.signal, path, level, (0, 0, width, height))
            levels.append(decode_page(window[1:-1, 1:-1], facts.page_class))
        made = picture_levels(
            pinchmap, levels, line_width=source.line_width, line_color=source.line_color, wrap=facts.wrap
        )
        return [encode_page(texels, facts.page_class) for texels in made[len(levels) :]]


@dataclass(frozen=True)
class PictureImage:
    """A pinchmapped picture as a plain image, as fine as its signal, or as is held in memory at once.

    Attributes
    ----------
    picture : PictureSource
    """

    picture: PictureSource


class PictureImages:
    """Makes pictures when they are first seen; see `fexel.textures.pool.TexelReader`."""

    def __init__(self, kept: KeptTexels, signals: PyramidCache, pinchmaps: PinchmapTexels) -> None:
        self._kept = kept
        self._signals = signals
        self._pinchmaps = pinchmaps

    def facts(self, source: PictureImage, path: str) -> ImageFacts:
        """Of level 0, which is a mip level of the signal."""
        signal = self._signals.facts(source.picture.signal, path)
        width, height = (mipmaps.level_size(axis, self._level(source, path)) for axis in signal.size)
        return ImageFacts((width, height), signal.page_class, signal.wrap, signal.info)

    def window(self, source: PictureImage, path: str, level: int, box: Box) -> NDArray:
        """Texels of any mip level."""
        levels = self._kept.get(source)
        if levels is None:
            levels = self._made(source, path)
            self._kept.keep(source, levels, sum(texels.nbytes for texels in levels))
        texels = levels[level]
        size = (texels.shape[1], texels.shape[0])
        x0, y0, x1, y1 = inner_box(box, size)
        return bordered(texels[y0:y1, x0:x1], box, size, self.facts(source, path).wrap)

    def _level(self, source: PictureImage, path: str) -> int:
        """Of the signal: the finest one that is small enough, at most as coarse as the pinchmap."""
        width, height = self._signals.facts(source.picture.signal, path).size
        octaves = (width // self._pinchmaps.facts(source.picture.pinchmap, path).size[0]).bit_length() - 1
        return next((n for n in range(octaves) if (width >> n) * (height >> n) <= _MOST_TEXELS), octaves)

    def _made(self, source: PictureImage, path: str) -> list[NDArray]:
        picture = source.picture
        facts = self._signals.facts(picture.signal, path)
        level = self._level(source, path)
        width, height = (mipmaps.level_size(axis, level) for axis in facts.size)
        window = self._signals.window(picture.signal, path, level, (0, 0, width, height))
        made = picture_image(
            self._pinchmaps.texels(picture.pinchmap, path),
            decode_page(window[1:-1, 1:-1], facts.page_class),
            line_width=picture.line_width,
            line_color=picture.line_color,
            wrap=facts.wrap,
        )
        return [encode_page(texels, facts.page_class) for texels in mipmaps.pyramid(made)]
