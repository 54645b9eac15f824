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
from fexel.textures.page_texels import decode_page, encode_page, texel_items
from fexel.textures.pyramid_cache import ImageFacts, PyramidCache

if TYPE_CHECKING:
    from fexel.textures.pool import TexelReader

__all__ = ["Cells", "ChainTexels", "cells"]

_DTYPES = {4: np.uint8, 8: np.float16, 16: np.float32}  # by the bytes of a texel

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
        base, layout = self._layout(chain, path)
        repeats = layout.wrap[0] == "repeat", layout.wrap[1] == "repeat"
        return replace(base, size=chain.size(*layout.extent, repeats), wrap=layout.wrap, has_levels=True)

    def window(self, chain: Chain, path: str, level: int, box: Box) -> NDArray:
        """Texels of a window with its border; see `ChainLayout` for what is in a level."""
        facts, layout = self._layout(chain, path)
        texels = self._made(chain, path, facts, layout)[layout.cell(chain.octaves, level)]
        return np.ascontiguousarray(texels[box[1] : box[3] + 2, box[0] : box[2] + 2])

    def _reader(self, chain: Chain) -> TexelReader:
        return chain.reader or self._base

    def _layout(self, chain: Chain, path: str) -> tuple[ImageFacts, ChainLayout]:
        """Facts of the image, and what chains there are."""
        facts = self._reader(chain).facts(chain.image, path)
        return facts, ChainLayout.of(chain.direction, facts.size, facts.wrap, chain.octaves)

    def _made(self, chain: Chain, path: str, facts: ImageFacts, layout: ChainLayout) -> Cells:
        key: Hashable = (ChainTexels, chain.image, chain.direction, chain.vectors, layout.octaves)
        made = self._kept.get(key)
        if made is None:
            made = self._build(chain, path, facts, layout)
            self._kept.keep(key, made, sum(texels.nbytes for texels in made.values()))
        return made

    def _build(self, chain: Chain, path: str, facts: ImageFacts, layout: ChainLayout) -> Cells:
        made = _empty(layout, np.float16 if facts.page_class == HALF else np.uint8)
        reader, lock = self._reader(chain), threading.Lock()

        def read(box: Box) -> NDArray:
            with lock:
                return reader.window(chain.image, path, 0, box)[1:-1, 1:-1]

        lines = _lines_of(read, layout)
        coded = _coded_vectors(chain, facts)

        def encode(texels: NDArray[np.float32]) -> NDArray:
            return encode_page(unit_vectors(texels, coded) if chain.vectors else texels, facts.page_class)

        build_chains(layout, lambda *span: decode_page(lines(*span), facts.page_class), encode, made)
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


def _lines_of(read: Callable[[Box], NDArray], layout: ChainLayout) -> Callable[[int, int], NDArray]:
    """Lines of the image, and of its mirror image where it is mirrored."""
    long_axis = layout.direction.long_axis
    moved_mirrored = layout.mirrored[1 - long_axis]
    width, height = layout.size
    count = layout.size[long_axis]

    def straight(first: int, end: int) -> NDArray:
        if long_axis == 1:
            return read((0, first, width, end))
        across = texel_items(np.ascontiguousarray(read((first, 0, end, height)))).T
        texels = np.ascontiguousarray(across)[..., None]
        return texels.view(_DTYPES[texels.itemsize])

    def lines(first: int, end: int) -> NDArray:
        parts = [straight(first, min(end, count))] if first < count else []
        if end > count:
            parts.append(straight(2 * count - end, 2 * count - max(first, count))[::-1])
        texels = np.concatenate(parts) if len(parts) > 1 else parts[0]
        return np.concatenate([texels, texels[:, ::-1]], axis=1) if moved_mirrored else texels

    return lines
