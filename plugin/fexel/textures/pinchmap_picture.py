"""Coarse mip levels of a pinchmapped picture: what is left of its discontinuities where a pixel covers many texels.

The signal's own coarse levels are those of the picture before pinching; below the resolution of the pinchmap, where
nothing is left to pinch, averages of the pinched picture take their place (`pinchmap_twin.picture_levels`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel import mipmaps
from fexel.textures.atlas import Box
from fexel.textures.image_source import ImageSource
from fexel.textures.page_texels import bordered, decode_page, encode_page, inner_box
from fexel.textures.pinchmap_texels import PinchmapSource, PinchmapTexels
from fexel.textures.pinchmap_twin import picture_levels
from fexel.textures.pyramid_cache import ImageFacts, PyramidCache

__all__ = ["PictureLevels", "PictureSource"]

# `picture_levels` samples a cell 8 times along an axis: of finer levels than that of 8 texels a cell it reads nothing,
# and pinches as wide; leaving them out keeps a huge signal on disk.
_USED_OCTAVES = 3


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

    def __init__(self, signals: PyramidCache, pinchmaps: PinchmapTexels) -> None:
        self._signals = signals
        self._pinchmaps = pinchmaps
        self._levels: dict[PictureSource, list[NDArray[np.float32]]] = {}

    def facts(self, source: PictureSource, path: str) -> ImageFacts:
        """See `fexel.textures.pool.TexelReader`."""
        signal = self._signals.facts(source.signal, path)
        return ImageFacts(
            self._pinchmaps.facts(source.pinchmap, path).size, signal.page_class, signal.wrap, signal.info
        )

    def window(self, source: PictureSource, path: str, level: int, box: Box) -> NDArray:
        """See `fexel.textures.pool.TexelReader`."""
        if source not in self._levels:
            self._levels[source] = self._made(source, path)
        facts = self.facts(source, path)
        texels = self._levels[source][level]
        size = (texels.shape[1], texels.shape[0])
        x0, y0, x1, y1 = inner_box(box, size)
        return bordered(encode_page(texels[y0:y1, x0:x1], facts.page_class), box, size, facts.wrap)

    def _made(self, source: PictureSource, path: str) -> list[NDArray[np.float32]]:
        facts = self._signals.facts(source.signal, path)
        size = self._pinchmaps.facts(source.pinchmap, path).size
        octaves = (facts.size[0] // size[0]).bit_length() - 1
        levels = []
        for level in range(max(0, octaves - _USED_OCTAVES), octaves + 1):
            width, height = (mipmaps.level_size(axis, level) for axis in facts.size)
            window = self._signals.window(source.signal, path, level, (0, 0, width, height))
            levels.append(decode_page(window[1:-1, 1:-1], facts.page_class))
        made = picture_levels(
            self._pinchmaps.texels(source.pinchmap),
            levels,
            line_width=source.line_width,
            line_color=source.line_color,
            wrap=facts.wrap,
        )
        return made[len(levels) - 1 :]
