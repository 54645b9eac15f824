"""Lines of texels moved by whole texels and halves (Bornik and Ferko 2002, eq. 1: a shear of the texture).

Every other line of a shear of 1/2 moves by a half: it is resampled midway between its texels by a windowed sinc. That
keeps what a linear interpolation would lose (half of the variance of white noise; the sinc here loses 4 %), so that
neighbouring lines stay equally sharp. All other lines move by whole texels, which loses nothing (notes, F2).

Lines are (lines, texels, channels) float32, linear and premultiplied, the moved axis second.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fexel.filters.chain_layout import ChainLayout

__all__ = ["move_line", "moved_lines"]

_REACH = 16  # texels to either side
_BETA = 4.0  # of the Kaiser window: a pass band to 0.47 cycles per texel, flat within 1.3 %


def _weights(fraction: float) -> NDArray[np.float32]:
    """(2 _REACH,) of the texels from 1 - _REACH to _REACH, of the value at `fraction`; their sum is 1."""
    at = np.arange(1 - _REACH, _REACH + 1) - fraction
    weights = np.sinc(at) * np.i0(_BETA * np.sqrt(np.maximum(1 - (at / _REACH) ** 2, 0))) / np.i0(_BETA)
    return (weights / weights.sum()).astype(np.float32)


def moved_lines(lines: NDArray[np.float32], first: int, layout: ChainLayout) -> NDArray[np.float32]:
    """Lines as they lie in a moved image at full resolution.

    Parameters
    ----------
    lines : (B, layout.line_texels, C) float32
    first : int
        Number of the first one.
    layout : ChainLayout

    Returns
    -------
    (B, layout.texels, C) float32
        Padded where the moved axis does not repeat.
    """
    shear = layout.direction.shear
    if shear == 0:
        return lines
    moved = np.empty((len(lines), layout.texels, lines.shape[2]), np.float32)
    shifts = shear * (first + np.arange(len(lines)))
    halves = np.flatnonzero(shifts % 1)
    between = dict(zip(halves.tolist(), _between(lines[halves], 0.5, layout.moved_wrap), strict=True))
    for line, shift in enumerate(shifts):
        start = layout.padding[0] + math.floor(shift)
        _place(between.get(line, lines[line]), start, layout.moved_wrap, moved[line])
    return moved


def move_line(line: NDArray[np.float32], shift: float, wrap: str) -> NDArray[np.float32]:
    """One line, (S, C), moved by any number of texels; what leaves it is lost where it does not repeat."""
    moved = np.empty_like(line)
    whole = math.floor(shift)
    if shift != whole:
        line = _between(line[None], 1 - (shift - whole), wrap)[0]
    _place(line, whole, wrap, moved)
    return moved


def _between(lines: NDArray[np.float32], fraction: float, wrap: str) -> NDArray[np.float32]:
    """Values at `fraction` on the way from each texel's left neighbour to it; of a line that ends, one more.

    Beyond the end of a line its last texel goes on. A line with nothing beyond fades out there instead: by its share of
    the texel, without the ringing of a cut.
    """
    texels = lines.shape[1]
    count = texels if wrap == "repeat" else texels + 1
    index = np.arange(-_REACH, count + _REACH - 1)
    index = index % texels if wrap == "repeat" else index.clip(0, texels - 1)
    source = lines[:, index]
    between = np.zeros((len(lines), count, lines.shape[2]), np.float32)
    term = np.empty_like(between)
    for tap, weight in enumerate(_weights(fraction)):
        between += np.multiply(source[:, tap : tap + count], weight, out=term)
    if wrap not in ("repeat", "clamp"):
        between[:, 0] *= np.float32(fraction)
        between[:, -1] *= np.float32(1 - fraction)
    return between


def _place(line: NDArray[np.float32], start: int, wrap: str, out: NDArray[np.float32]) -> None:
    """Write a line from texel `start` on, and what continues it."""
    if wrap == "repeat":
        start %= len(out)
        out[start:] = line[: len(out) - start]
        out[:start] = line[len(out) - start :]
        return
    low = min(max(start, 0), len(out))
    high = max(min(start + len(line), len(out)), low)
    out[:low], out[high:] = (line[0], line[-1]) if wrap == "clamp" else (0, 0)
    out[low:high] = line[low - start : high - start]
