"""What an image holds, by spatial frequency: how much of it a filter can lose.

The energy of an image's sRGB-encoded values (variance, [0, 1]^2) by ring and sector of the frequency plane, from
Fourier transforms of a few windows of each mip level. What a filter gets wrong at a frequency is the energy there times
the squared difference between its transfer function and that of the truth (`fexel.filters.transfer`), so that an error
can be foretold per footprint without looking at a texel.

Filters average linear light, what is seen is encoded: the energy of linear values counts in the ratio of the variance
of encoded values to theirs, which is the squared slope of the encoding where contrast is low.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fexel import mipmaps
from fexel.images import linear_to_srgb
from fexel.textures.page_texels import decode_page
from fexel.textures.pool import TexelReader

__all__ = ["RINGS", "SECTORS", "Content", "frequencies", "measure"]

RINGS = 25
"""Rings of half an octave each, the first one at sqrt(1/2) cycles per texel of level 0, coarser ones after it."""

SECTORS = 16
"""Sectors of half a turn, the first one about frequencies along x."""

_WINDOW = 256  # texels
_LARGEST = 4096  # of a level that is looked at: finer ones are not read for this
_LEAST = 16  # a level smaller than that has no rings of its own
_RINGS = 10  # of a window
_BLOCK = 16  # texels within which contrast is local
_EVEN = 1e-6  # of a window's variance: less in its blocks is rounding


@dataclass(frozen=True, eq=False)
class Content:
    """Energy of an image by spatial frequency.

    Attributes
    ----------
    energy : (RINGS, SECTORS) float64
        Variance of encoded values, [0, 1]^2; mean of the colour channels, and that of alpha on top.
    """

    energy: NDArray[np.float64]

    @classmethod
    def of(cls, image: NDArray[np.floating], *, encoded: bool = True) -> Content:
        """Of an image (H, W, 4), linear and premultiplied; not `encoded`: of values that are data, as they are."""
        levels = mipmaps.pyramid(image)
        first = _first_level(image.shape[1], image.shape[0])
        return cls(_energy((_windows_of(level) for level in levels[first:]), first, encoded))


def measure(reader: TexelReader, source: Any, path: str) -> Content:
    """Content of an image that a reader reads.

    Parameters
    ----------
    reader : TexelReader
    source, path
        As of the reader. A source whose ``color_space`` is ``raw`` is data.

    Returns
    -------
    Content
        Of the mip levels of at most 4096 texels; whoever asks keeps it.
    """
    facts = reader.facts(source, path)
    width, height = facts.size
    first = min(_first_level(width, height), facts.last_level)

    def windows(level: int) -> Iterator[NDArray[np.float32]]:
        size = mipmaps.level_size(width, level), mipmaps.level_size(height, level)
        for x in _starts(size[0]):
            for y in _starts(size[1]):
                box = x, y, min(x + _WINDOW, size[0]), min(y + _WINDOW, size[1])
                texels = reader.window(source, path, level, box)
                yield decode_page(texels[1:-1, 1:-1], facts.page_class)

    levels = (windows(level) for level in range(first, facts.last_level + 1))
    return Content(_energy(levels, first, getattr(source, "color_space", "") != "raw"))


def frequencies() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(RINGS,) cycles per texel of level 0, and (SECTORS,) angles from x towards y, radians: the middle of each."""
    return np.exp2(-0.5 * (np.arange(RINGS) + 1)), np.arange(SECTORS) * np.pi / SECTORS


def _first_level(width: int, height: int) -> int:
    return max(0, (max(width, height) - 1).bit_length() - (_LARGEST - 1).bit_length())


def _starts(size: int) -> list[int]:
    """Where windows begin along an axis: one in the middle, or one in each half."""
    if size < 2 * _WINDOW:
        return [max(size - _WINDOW, 0) // 2]
    return [(size // 2 - _WINDOW) // 2, size // 2 + (size - size // 2 - _WINDOW) // 2]


def _windows_of(level: NDArray[np.floating]) -> Iterator[NDArray[np.floating]]:
    for y in _starts(level.shape[0]):
        for x in _starts(level.shape[1]):
            yield level[y : y + _WINDOW, x : x + _WINDOW]


def _energy(levels: Iterable[Iterable[NDArray[np.floating]]], first: int, encoded: bool) -> NDArray[np.float64]:
    """Each level tells of rings that its box has hardly touched; the first of all finer, the last of all coarser."""
    energy = np.zeros((RINGS, SECTORS))
    for number, windows in enumerate(levels):
        rings = [
            _rings(window, number > 0 or first > 0, encoded) for window in windows if max(window.shape[:2]) >= _LEAST
        ]
        if not rings:
            break
        found = np.mean(rings, axis=0)
        low = 3 if number else 0
        start = 2 * (number + first) + low
        energy[start:] = 0.0  # what the level before has told of these
        energy[start : start + len(found) - low] = found[low : low + max(RINGS - start, 0)]
    return energy


def _rings(window: NDArray[np.floating], boxed: bool, encoded: bool) -> NDArray[np.float64]:
    """(_RINGS, SECTORS): the rings from sqrt(1/2) cycles per texel of this level on."""
    texels = np.asarray(window, np.float64)
    height, width = texels.shape[:2]
    taper = np.outer(_taper(height), _taper(width))[..., None]
    mean = np.sum(texels * taper, axis=(0, 1)) / taper.sum()
    power = np.abs(np.fft.fft2((texels - mean) * taper, axes=(0, 1))) ** 2
    power = power @ _slopes(texels, encoded) / (np.sum(taper**2) * width * height)
    fx, fy = np.fft.fftfreq(width)[None], np.fft.fftfreq(height)[:, None]
    if boxed:
        power = power / np.maximum((np.sinc(fx) * np.sinc(fy)) ** 2, 0.1)  # 0.1: no more than the box leaves anywhere
    ring = np.floor(-2 * np.log2(np.maximum(np.hypot(fx, fy), 1e-9)) - 0.5).astype(np.int64)  # 1e-9: the mean
    sector = np.floor(np.mod(np.arctan2(fy, fx) / np.pi + 0.5 / SECTORS, 1.0) * SECTORS).astype(np.int64) % SECTORS
    counts = (ring >= 0) & (ring < _RINGS)
    place = ring[counts] * SECTORS + sector[counts]
    return np.bincount(place, power[counts], _RINGS * SECTORS).reshape(_RINGS, SECTORS)


def _taper(size: int) -> NDArray[np.float64]:
    """Hann's window, of one texel, too."""
    return np.sin(np.pi * (np.arange(size) + 0.5) / size) ** 2


def _slopes(texels: NDArray[np.float64], encoded: bool) -> NDArray[np.float64]:
    """(C,) weight of each channel's variance: of encoded values over that of linear ones, within blocks of texels.

    What is dark in one place and bright in another counts by what varies there; blocks that are all even tell nothing,
    then it is the whole window that does.
    """
    channels = texels.shape[2]
    weight = np.where(np.arange(channels) < 3, 1.0 / min(channels, 3), 1.0)
    if not encoded:
        return weight
    shown = linear_to_srgb(np.clip(texels, 0.0, 1.0)).astype(np.float64)
    linear, seen = _variance(texels, max(texels.shape[:2])), _variance(shown, max(texels.shape[:2]))
    in_blocks = _variance(texels, _BLOCK)
    uneven = in_blocks > _EVEN * linear
    linear, seen = np.where(uneven, in_blocks, linear), np.where(uneven, _variance(shown, _BLOCK), seen)
    return weight * np.where((np.arange(channels) < 3) & (linear > 0), seen / np.where(linear > 0, linear, 1.0), 1.0)


def _variance(values: NDArray[np.float64], block: int) -> NDArray[np.float64]:
    """(C,) of (H, W, C): squared deviations from the means of blocks, summed."""

    def sums(texels: NDArray[np.float64]) -> NDArray[np.float64]:
        rows = np.add.reduceat(texels, np.arange(0, values.shape[0], block), axis=0)
        return np.add.reduceat(rows, np.arange(0, values.shape[1], block), axis=1)

    middle = values - values.mean(axis=(0, 1))  # so that little is lost where squares are subtracted
    counts = sums(np.ones((*values.shape[:2], 1)))
    return np.sum(np.maximum(sums(middle**2) - sums(middle) ** 2 / counts, 0.0), axis=(0, 1))
