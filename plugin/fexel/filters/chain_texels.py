"""Texels of chains for the texture pool: made when a view first wants one of a direction, then kept."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from fexel.filters.chain import Chain
from fexel.filters.chain_build import build_chains
from fexel.filters.chain_cache import (
    MAPPED_BYTES,
    ChainFile,
    DamagedChainError,
    cache_folders,
    draft_chains,
    find_chains,
)
from fexel.filters.chain_key import chain_key
from fexel.filters.chain_layout import SHORT_BLUR, ChainLayout
from fexel.textures.atlas import Box
from fexel.textures.image_source import ImageSource
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.page_format import HALF
from fexel.textures.page_texels import decode_page, encode_page, texel_items
from fexel.textures.pyramid_cache import ImageFacts, PyramidCache

if TYPE_CHECKING:
    from fexel.textures.pool import TexelReader

__all__ = ["Cells", "ChainTexels", "cells"]

_LEAST_BYTES = 2**20  # of a file: less is made again as fast as it is found
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
        self._foresee(chain, base, layout)
        return replace(base, size=chain.size(*layout.extent, layout.wrap), wrap=layout.wrap, has_levels=True)

    def window(self, chain: Chain, path: str, level: int, box: Box) -> NDArray:
        """Texels of a window with its border; see `ChainLayout` for what is in a level."""
        facts, layout = self._layout(chain, path)
        cell = layout.cell(chain.octaves, level)
        try:
            texels = self._made(chain, path, facts, layout)[cell]
        except DamagedChainError:
            self._keep(chain, layout, *self._build(chain, path, facts, layout))
            texels = self._made(chain, path, facts, layout)[cell]
        return texels[box[1] : box[3] + 2, box[0] : box[2] + 2].copy()

    def _reader(self, chain: Chain) -> TexelReader:
        return chain.reader or self._base

    def _layout(self, chain: Chain, path: str) -> tuple[ImageFacts, ChainLayout]:
        """Facts of the image, and what chains there are."""
        facts = self._reader(chain).facts(chain.image, path)
        return facts, ChainLayout.of(chain.direction, facts.size, facts.wrap, chain.octaves, chain.blur)

    def _foresee(self, chain: Chain, facts: ImageFacts, layout: ChainLayout) -> None:
        """What is on disk is found now; for what is not, the image will be read."""
        reader = self._reader(chain)
        if self._found(chain, facts, layout) is None and isinstance(reader, PyramidCache):
            reader.want_whole(cast("ImageSource", chain.image))

    def _found(self, chain: Chain, facts: ImageFacts, layout: ChainLayout) -> Cells | ChainFile | None:
        """In memory or on disk."""
        made = self._kept.get(_name(chain, layout))
        if made is not None:
            return made
        folders, key = self._on_disk(chain, facts, layout)
        found = find_chains(folders, key, layout, _dtype(facts)) if key else None
        return found and self._keep(chain, layout, found, MAPPED_BYTES)

    def _made(self, chain: Chain, path: str, facts: ImageFacts, layout: ChainLayout) -> Cells | ChainFile:
        found = self._found(chain, facts, layout)
        if found is not None:
            return found
        return self._keep(chain, layout, *self._build(chain, path, facts, layout))

    def _keep(self, chain: Chain, layout: ChainLayout, made: Cells | ChainFile, nbytes: int) -> Cells | ChainFile:
        self._kept.keep(_name(chain, layout), made, nbytes)
        return made

    def _on_disk(self, chain: Chain, facts: ImageFacts, layout: ChainLayout) -> tuple[list[Path], bytes | None]:
        """Folders and key; of small images, and of those that are not files, none."""
        source = chain.image
        if not isinstance(source, ImageSource) or not isinstance(self._reader(chain), PyramidCache):
            return [], None
        if facts.info is None or layout.total * 4 * _dtype(facts).itemsize < _LEAST_BYTES:
            return [], None
        folders = cache_folders(source.file)
        return folders, chain_key(source, facts, layout) if folders else None

    def _build(self, chain: Chain, path: str, facts: ImageFacts, layout: ChainLayout) -> tuple[Cells, int]:
        """Cells, and how much memory they take."""
        folders, key = self._on_disk(chain, facts, layout)
        draft = draft_chains(folders, key, layout, _dtype(facts)) if key else None
        if draft is None:
            made = layout.cells_in(np.empty((layout.total, 4), _dtype(facts)))
            self._fill(chain, path, facts, layout, made)
            return made, layout.total * 4 * _dtype(facts).itemsize
        try:
            self._fill(chain, path, facts, layout, draft.cells)
        except BaseException:
            draft.discard()
            raise
        reader = self._reader(chain)
        if isinstance(reader, PyramidCache) and reader.is_replaced(cast("ImageSource", chain.image)):
            draft.discard()  # of a file that could not be read
        else:
            draft.finish()
        return draft.cells, MAPPED_BYTES

    def _fill(self, chain: Chain, path: str, facts: ImageFacts, layout: ChainLayout, made: Cells) -> None:
        reader, lock = self._reader(chain), threading.Lock()

        def read(box: Box) -> NDArray:
            with lock:
                return reader.window(chain.image, path, 0, box)[1:-1, 1:-1]

        def encode(texels: NDArray[np.float32]) -> NDArray:
            return encode_page(texels, facts.page_class)

        lines = _lines_of(read, layout)
        build_chains(layout, lambda first, end: decode_page(lines(first, end), facts.page_class), encode, made)


def cells(
    image: NDArray[np.float32],
    direction: int,
    wrap: tuple[str, str],
    blur: float = SHORT_BLUR,
) -> tuple[ChainLayout, Cells]:
    """Chains of an image in memory, as floats.

    Parameters
    ----------
    image : (H, W, 4) float32
        Linear, premultiplied.
    direction : int
    wrap : (str, str)
        Resolved wrap modes.
    blur : float
        Of their `ChainLayout`.
    """
    layout = ChainLayout.of(direction, (image.shape[1], image.shape[0]), wrap, blur=blur)
    made = layout.cells_in(np.empty((layout.total, 4), np.float32))

    def read(box: Box) -> NDArray[np.float32]:
        return image[box[1] : box[3], box[0] : box[2]].astype(np.float32)

    build_chains(layout, _lines_of(read, layout), lambda texels: texels, made)
    return layout, made


def _name(chain: Chain, layout: ChainLayout) -> Hashable:
    return ChainTexels, chain.image, chain.direction, layout.octaves, layout.blur


def _dtype(facts: ImageFacts) -> np.dtype:
    return np.dtype(np.float16 if facts.page_class == HALF else np.uint8)


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
