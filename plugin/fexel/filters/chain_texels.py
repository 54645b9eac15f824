"""Texels of chains for the texture pool: made when a view first wants one of a direction, then kept."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fexel.filters.chain import Chain
from fexel.filters.chain_build import build_chains
from fexel.filters.chain_layout import ChainLayout
from fexel.filters.unit_vectors import unit_vectors
from fexel.textures.atlas import Box
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.page_format import HALF
from fexel.textures.page_texels import decode_page, encode_page
from fexel.textures.pyramid_cache import ImageFacts, PyramidCache

if TYPE_CHECKING:
    from fexel.textures.pool import TexelReader

__all__ = ["Cells", "ChainTexels", "cells"]

Cells = dict[tuple[int, int], NDArray]
"""By cell: (h + 2, w + 2, 4), rows and columns of the image with a border of one texel."""


class ChainTexels:
    """Reads `Chain`; see `fexel.textures.pool.TexelReader`.

    Parameters
    ----------
    kept : KeptTexels, optional
        Where chains are kept; by default its own.
    base : TexelReader, optional
        Reads the images that chains are made of, where a chain does not say by what; default a `PyramidCache`.
    """

    def __init__(self, kept: KeptTexels | None = None, base: TexelReader | None = None) -> None:
        self._kept = kept or KeptTexels()
        self._base: TexelReader = base or PyramidCache(self._kept)

    def facts(self, chain: Chain, path: str) -> ImageFacts:
        """Of level 0 of a chain."""
        base = self._reader(chain).facts(chain.image, path)
        layout = ChainLayout.of(chain.direction, base.size, base.wrap)
        repeats = layout.wrap[0] == "repeat", layout.wrap[1] == "repeat"
        return replace(base, size=chain.size(*layout.extent, repeats), wrap=layout.wrap, has_levels=True)

    def window(self, chain: Chain, path: str, level: int, box: Box) -> NDArray:
        """Texels of a window with its border; see `ChainLayout` for what is in a level."""
        facts = self._reader(chain).facts(chain.image, path)
        layout = ChainLayout.of(chain.direction, facts.size, facts.wrap)
        texels = self._made(chain, path, facts, layout)[layout.cell(chain.octaves, level)]
        return np.ascontiguousarray(texels[box[1] : box[3] + 2, box[0] : box[2] + 2])

    def _reader(self, chain: Chain) -> TexelReader:
        return chain.reader or self._base

    def _made(self, chain: Chain, path: str, facts: ImageFacts, layout: ChainLayout) -> Cells:
        key: Hashable = (ChainTexels, chain.image, chain.direction, chain.vectors)
        made = self._kept.get(key)
        if made is None:
            made = self._build(chain, path, facts, layout)
            self._kept.keep(key, made, sum(texels.nbytes for texels in made.values()))
        return made

    def _build(self, chain: Chain, path: str, facts: ImageFacts, layout: ChainLayout) -> Cells:
        made = _empty(layout, np.float16 if facts.page_class == HALF else np.uint8)
        reader, lock = self._reader(chain), threading.Lock()

        def read(box: Box) -> NDArray[np.float32]:
            with lock:
                texels = reader.window(chain.image, path, 0, box)
            return decode_page(texels[1:-1, 1:-1], facts.page_class)

        coded = _coded_vectors(chain, facts)

        def encode(texels: NDArray[np.float32]) -> NDArray:
            return encode_page(unit_vectors(texels, coded) if chain.vectors else texels, facts.page_class)

        build_chains(layout, _lines_of(read, layout), encode, made)
        return made


def cells(
    image: NDArray[np.float32], direction: int, wrap: tuple[str, str], vectors: bool = False
) -> tuple[ChainLayout, Cells]:
    """Chains of an image in memory, as floats.

    Parameters
    ----------
    image : (H, W, 4) float32
        Linear, premultiplied.
    direction : int
    wrap : (str, str)
        Resolved wrap modes.
    vectors : bool
        rgb holds (v + 1) / 2 of unit vectors v.
    """
    layout = ChainLayout.of(direction, (image.shape[1], image.shape[0]), wrap)
    made = _empty(layout, np.float32)

    def read(box: Box) -> NDArray[np.float32]:
        return image[box[1] : box[3], box[0] : box[2]].astype(np.float32)

    build_chains(layout, _lines_of(read, layout), (lambda x: unit_vectors(x, True)) if vectors else (lambda x: x), made)
    return layout, made


def _coded_vectors(chain: Chain, facts: ImageFacts) -> bool:
    """Whether colours hold (v + 1) / 2: of a file of integers whose values are used as they are."""
    source: Any = chain.image
    changed = getattr(source, "scale", None), getattr(source, "bias", None)
    as_they_are = changed in ((None, None), ((1.0,) * 4, (0.0,) * 4))
    return as_they_are and (facts.info is None or facts.info.dtype.startswith("uint"))


def _empty(layout: ChainLayout, dtype: Any) -> Cells:
    block = np.empty((layout.total, 4), dtype)
    return {
        cell: block[first : first + rows * columns].reshape(rows, columns, 4)
        for cell, (first, rows, columns) in layout.places.items()
    }


def _lines_of(
    read: Callable[[Box], NDArray[np.float32]], layout: ChainLayout
) -> Callable[[int, int], NDArray[np.float32]]:
    """Lines of the image, and of its mirror image where it is mirrored."""
    long_axis = layout.direction.long_axis
    moved_mirrored = layout.mirrored[1 - long_axis]
    width, height = layout.size
    count = layout.size[long_axis]

    def straight(first: int, end: int) -> NDArray[np.float32]:
        if end <= first:
            return np.empty((0, layout.size[1 - long_axis], 4), np.float32)
        if long_axis == 0:
            return np.ascontiguousarray(read((first, 0, end, height)).swapaxes(0, 1))
        return read((0, first, width, end))

    def lines(first: int, end: int) -> NDArray[np.float32]:
        texels = straight(first, min(end, count))
        if end > count:
            mirrored = straight(2 * count - end, 2 * count - max(first, count))[::-1]
            texels = np.concatenate([texels, mirrored])
        return np.concatenate([texels, texels[:, ::-1]], axis=1) if moved_mirrored else texels

    return lines
