"""Texels of any window of any mip level of an image source, in the format of its page.

Tiled files with mip levels are read in part. Of any other file the pyramid is made in strips of rows (`fexel.mipmaps`)
and kept while it is used, up to a limit; level 0 only once it is asked for. Stored texels are linear and premultiplied:
page class SRGB keeps them sRGB-encoded in 8 bits, HALF, which is for all that is not 8-bit colour, as 16-bit floats.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fexel import images, mipmaps
from fexel.errors import FexelError, FexelWarning
from fexel.textures.image_source import ImageSource
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.page_format import HALF, SRGB
from fexel.textures.page_texels import bordered, decode_page, encode_page, inner_box

__all__ = ["HALF", "SRGB", "ImageFacts", "PyramidCache"]

_STRIP_TEXELS = 2**18
_IDENTITY = ((1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 0.0))


@dataclass(frozen=True)
class ImageFacts:
    """What the texture system must know of an image before it loads a texel.

    Attributes
    ----------
    size : (int, int)
        Width and height of level 0.
    page_class : int
    wrap : (str, str)
        Resolved: ``patch``, ``black``, ``clamp``, ``repeat`` or ``mirror``.
    info : ImageInfo or None
        None where the fallback colour stands in.
    has_levels : bool
        Whether there are mip levels besides level 0.
    """

    size: tuple[int, int]
    page_class: int
    wrap: tuple[str, str]
    info: images.ImageInfo | None
    has_levels: bool = True

    @property
    def last_level(self) -> int:
        """Number of the coarsest mip level."""
        return mipmaps.level_count(*self.size) - 1 if self.has_levels else 0


class PyramidCache:
    """Reads images on demand. Warns once about each that it cannot read.

    Parameters
    ----------
    kept : KeptTexels, optional
        Where pyramids are kept; by default its own.
    """

    def __init__(self, kept: KeptTexels | None = None) -> None:
        self._facts: dict[ImageSource, ImageFacts] = {}
        self._kept = kept or KeptTexels()
        self._damaged: set[ImageSource] = set()
        self._replaced: set[ImageSource] = set()
        self._whole: set[ImageSource] = set()
        self._warned: set[str] = set()

    def facts(self, source: ImageSource, path: str) -> ImageFacts:
        """Header facts; `path`: texture prim to name when the file cannot be read, or the attribute of a part of it."""
        if source not in self._facts:
            self._facts[source] = self._read_facts(source, path)
        return self._facts[source]

    def _read_facts(self, source: ImageSource, path: str) -> ImageFacts:
        try:
            info = images.image_info(source.file) if source.file else None
        except FexelError as error:
            self._warn(path, str(error))
            info = None
        if info is None:
            return self._fallback_facts(source)
        wrap = tuple(
            of_file if mode == "useMetadata" else mode for mode, of_file in zip(source.wrap, info.wrap, strict=True)
        )
        eight_bit = info.dtype == "uint8" and (source.scale, source.bias) == _IDENTITY
        page_class = SRGB if eight_bit and source.resolved_space(info) == "sRGB" else HALF
        return ImageFacts((info.width, info.height), page_class, wrap, info)  # type: ignore[arg-type]

    def _fallback_facts(self, source: ImageSource) -> ImageFacts:
        """A constant image; 4x4, so that a patch keeps a middle when its rim is cleared."""
        size, wrap = ((4, 4), ("patch", "patch")) if source.wrap[0] == "patch" else ((1, 1), ("clamp", "clamp"))
        return ImageFacts(size, HALF, wrap, None)

    def _warn(
        self, path: str, fault: str, attribute: str = "inputs:file", instead: str = "inputs:fallback is shown"
    ) -> None:
        message = f"{attribute}: {fault}; {instead}"
        if message not in self._warned:
            self._warned.add(message)
            # An attribute of a part of a texture: there is no fallback for it.
            whole = f"{path}: {fault}; left out" if "." in path else f"{path}.{message}"
            warnings.warn(whole, FexelWarning, stacklevel=2)

    def window(self, source: ImageSource, path: str, level: int, box: tuple[int, int, int, int]) -> NDArray:
        """Texels of a window and the border of one texel around it.

        Parameters
        ----------
        source : ImageSource
        path : str
            Prim to name when the file cannot be read.
        level : int
        box : (x0, y0, x1, y1)
            Half-open, y down from the top, within the level.

        Returns
        -------
        (y1 - y0 + 2, x1 - x0 + 2, 4) uint8 or float16
            Where the border leaves the image, what the wrap mode continues it with; zero for patches and ``black``.
        """
        facts = self.facts(source, path)
        width, height = (mipmaps.level_size(size, level) for size in facts.size)
        inner = inner_box(box, (width, height))
        texels = self._read(source, facts, path, level, inner)
        if facts.wrap[0] == "patch":
            kept = 1.0 - 0.5**level if source.soft_rim else 0.0
            texels = _faded_rim(texels, inner, (width, height), kept, facts.page_class)
        return bordered(texels, box, (width, height), facts.wrap)

    def want_whole(self, source: ImageSource) -> None:
        """Level 0 will be read, though coarser ones may be first: the file need not be read twice."""
        self._whole.add(replace(source, soft_rim=False))

    def is_replaced(self, source: ImageSource) -> bool:
        """Whether the fallback has stood in for texels that could not be read, for all that was read so far."""
        return replace(source, soft_rim=False) in self._replaced

    def _read(
        self, source: ImageSource, facts: ImageFacts, path: str, level: int, box: tuple[int, int, int, int]
    ) -> NDArray:
        info = facts.info
        partial = info is not None and info.tiled and level < len(info.level_sizes) and not source.mask
        if partial and source not in self._damaged:
            try:
                pixels = images.read_pixels(info, level, box)
                return encode_page(
                    _scaled(images.to_linear(pixels, info, source.color_space), source), facts.page_class
                )
            except FexelError as error:
                self._damaged.add(source)
                self._warn(path, str(error))
        x0, y0, x1, y1 = box
        texels = self._pyramid(source, facts, path, level)[level]
        assert texels is not None
        return texels[y0:y1, x0:x1]

    def _pyramid(self, source: ImageSource, facts: ImageFacts, path: str, level: int) -> list[NDArray | None]:
        key = replace(source, soft_rim=False)
        levels = self._kept.get(key)
        if levels is None or levels[level] is None:
            levels = self._made(source, facts, path, 0 if level == 0 or key in self._whole else 1)
            self._kept.keep(key, levels, sum(0 if texels is None else texels.nbytes for texels in levels))
        return levels

    def _made(self, source: ImageSource, facts: ImageFacts, path: str, first: int) -> list[NDArray | None]:
        if facts.info is not None:
            try:
                return _encoded_levels(self._strips(source, facts.info, path), facts, first)
            except FexelError as error:
                self._warn(path, str(error))
                self._replaced.add(replace(source, soft_rim=False))
        r, g, b, a = source.fallback
        width, height = facts.size
        row = np.broadcast_to(np.array([r * a, g * a, b * a, a], np.float32), (1, width, 4))
        return _encoded_levels((row for _ in range(height)), facts, first)  # scale and bias do not apply

    def _strips(self, source: ImageSource, info: images.ImageInfo, path: str) -> Iterator[NDArray[np.float32]]:
        """Level 0 as it is shown, linear and premultiplied, from top to bottom."""
        mask = self._mask(source, (info.width, info.height), path)
        y = 0
        for pixels in images.read_strips(info, max(2, _STRIP_TEXELS // info.width)):
            rows = None if mask is None else mask[y : y + len(pixels)]
            texels = images.to_linear(pixels, info, source.color_space, rows)
            y += len(texels)
            yield _scaled(texels, source)

    def _mask(self, source: ImageSource, size: tuple[int, int], path: str) -> NDArray[np.float32] | None:
        """The mask, of any resolution, that replaces alpha."""
        try:
            return images.read_mask(source.mask, size) if source.mask else None
        except FexelError as error:
            self._warn(path, str(error), "inputs:mask", "the alpha of inputs:file is used")
            return None


def _encoded_levels(strips: Iterable[NDArray[np.float32]], facts: ImageFacts, first: int) -> list[NDArray | None]:
    """All levels as pages store them; None for those finer than `first`. Floats live for one strip only."""
    width, height = facts.size
    sizes = [(height, width)]
    for level in range(1, mipmaps.level_count(width, height)):
        sizes.append((mipmaps.level_size(height, level), mipmaps.level_size(width, level)))
    dtype = np.float16 if facts.page_class == HALF else np.uint8
    levels = [None if level < first < len(sizes) else np.empty((*size, 4), dtype) for level, size in enumerate(sizes)]
    halvers = [mipmaps.RowHalver(size[0]) for size in sizes]
    filled = [0] * len(sizes)
    for rows in strips:
        for level, texels in enumerate(levels):
            if texels is not None:
                texels[filled[level] : filled[level] + len(rows)] = encode_page(rows, facts.page_class)
            filled[level] += len(rows)
            rows = halvers[level].feed(rows)
    return levels


def _scaled(texels: NDArray[np.float32], source: ImageSource) -> NDArray[np.float32]:
    """inputs:scale and bias on straight colour, kept premultiplied."""
    if (source.scale, source.bias) == _IDENTITY:
        return texels
    scale, bias = np.array(source.scale, np.float32), np.array(source.bias, np.float32)
    alpha = np.clip(texels[..., 3:] * scale[3] + bias[3], 0, 1)
    straight = texels[..., :3] / np.maximum(texels[..., 3:], 1e-6)
    return np.concatenate([(straight * scale[:3] + bias[:3]) * alpha, alpha], axis=-1)


def _faded_rim(
    texels: NDArray, box: tuple[int, int, int, int], size: tuple[int, int], kept: float, page_class: int
) -> NDArray:
    """A window of a level of a patch, of whose rim so much is kept, in [0, 1]."""
    texels = texels.copy()
    for at in _rim(box, size):
        texels[at] = encode_page(decode_page(texels[at], page_class) * np.float32(kept), page_class) if kept else 0
    return texels


def _rim(box: tuple[int, int, int, int], size: tuple[int, int]) -> Iterator[tuple[slice, slice]]:
    """Rows and columns of a window that lie at the border of the level."""
    whole, first, last = slice(None), slice(0, 1), slice(-1, None)
    x0, y0, x1, y1 = box
    if x0 == 0:
        yield whole, first
    if y0 == 0:
        yield first, whole
    if x1 == size[0]:
        yield whole, last
    if y1 == size[1]:
        yield last, whole
