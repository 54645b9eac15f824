"""Lines of texels moved by whole texels and parts of them (Bornik and Ferko 2002, eq. 1: a shear of the texture).

Where a line moves by a part of a texel it is resampled between its texels by a windowed sinc. That keeps what a linear
interpolation would lose (half of the variance of white noise at 1/2; the sinc here loses 4 %), so that neighbouring
lines are about equally sharp. All other lines move by whole texels, which loses nothing.

Lines are (lines, texels, 4) float32, linear and premultiplied, the moved axis second.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fexel.filters.chain_layout import SHORT_BLUR, ChainLayout
from fexel.textures.page_texels import texel_items

__all__ = ["blurred_lines", "can_group", "move_line", "moved_groups", "moved_lines"]

_REACH = 16  # texels to either side
_BLOCK = 16
_BETA = 4.0  # of the Kaiser window: a pass band to 0.47 cycles per texel, flat within 1.3 %


def _weights(fraction: float) -> NDArray[np.float32]:
    """(2 _REACH,) of the texels from 1 - _REACH to _REACH, of the value at `fraction`; their sum is 1."""
    at = np.arange(1 - _REACH, _REACH + 1) - fraction
    weights = np.sinc(at) * np.i0(_BETA * np.sqrt(np.maximum(1 - (at / _REACH) ** 2, 0))) / np.i0(_BETA)
    return (weights / weights.sum()).astype(np.float32)


@functools.lru_cache(maxsize=16)
def _band(fraction: float) -> NDArray[np.float32]:
    """(_BLOCK, _BLOCK + 2 _REACH - 1): the weights of neighbouring values, each one texel further."""
    band = np.zeros((_BLOCK, _BLOCK + 2 * _REACH - 1), np.float32)
    for row, weights in enumerate(band):
        weights[row : row + 2 * _REACH] = _weights(fraction)
    return band


def moved_lines(lines: NDArray[np.float32], first: int, layout: ChainLayout) -> NDArray[np.float32]:
    """Lines as they lie in a moved image at full resolution.

    Parameters
    ----------
    lines : (B, layout.line_texels, 4) float32
    first : int
        Number of the first one.
    layout : ChainLayout

    Returns
    -------
    (B, layout.texels, 4) float32
        Padded where the moved axis does not repeat.
    """
    shear = layout.direction.shear
    if shear == 0 and layout.texels == layout.line_texels:
        return lines
    moved = np.empty((len(lines), layout.texels, lines.shape[2]), np.float32)
    shifts = shear * (first + np.arange(len(lines)))
    for part in np.unique(shifts % 1):
        which = np.flatnonzero(shifts % 1 == part)
        sources = lines[which] if part == 0 else _between(lines[which], 1 - part, layout.moved_wrap)
        for line, source in zip(which, sources, strict=True):
            _place(source, layout.padding[0] + math.floor(shifts[line]), layout.moved_wrap, moved[line])
    return moved


def can_group(layout: ChainLayout) -> bool:
    """Whether 2^octaves whole lines make one of the finest that chains have, as `moved_groups` needs it."""
    return layout.lines % (1 << layout.octaves) == 0


def moved_groups(lines: NDArray[np.float32], first: int, layout: ChainLayout) -> NDArray[np.float32]:
    """Means of 2^octaves moved lines each: as `moved_lines` and `octaves` halvings, in a fraction of the time.

    A group moves by a whole number of texels. Within it, lines that repeat are summed up by the part of a texel that
    they move by, and only the sums are resampled.

    Parameters
    ----------
    lines : (B, layout.line_texels, 4) float32
        Whole groups.
    first : int
        Number of the first group.
    layout : ChainLayout
        That `can_group`.

    Returns
    -------
    (B / 2^octaves, layout.texels, 4) float32
    """
    count, wrap = 1 << layout.octaves, layout.moved_wrap
    groups = lines.reshape(-1, count, *lines.shape[1:])
    shifts = layout.direction.shear * np.arange(count)
    least = math.floor(shifts.min())
    texels = lines.shape[1] + (0 if wrap == "repeat" else math.ceil(shifts.max()) - least)
    total = np.zeros((len(groups), texels, 4), np.float32)
    for part in np.unique(shifts % 1):
        which = np.flatnonzero(shifts % 1 == part)
        same = np.zeros_like(total) if wrap == "repeat" and part else total
        for line in which:
            source = groups[:, line] if part == 0 or wrap == "repeat" else _between(groups[:, line], 1 - part, wrap)
            _add(same, source, math.floor(shifts[line]) - least, wrap)
        if same is not total:
            same *= np.float32(1 / len(which))  # as bright as its lines
            total += np.float32(len(which)) * _between(same, 1 - part, wrap)
    total *= np.float32(1 / count)
    moved = np.empty((len(groups), layout.texels, 4), np.float32)
    for group, line in enumerate(total):
        start = layout.padding[0] + least + round(layout.direction.shear * count * (first + group))
        _place(line, start, wrap, moved[group])
    return moved


def _add(total: NDArray[np.float32], lines: NDArray[np.float32], start: int, wrap: str) -> None:
    """Add lines from texel `start` on, and what continues them."""
    texels = lines.shape[1]
    if wrap == "repeat":
        start %= texels
        total[:, start:] += lines[:, : texels - start]
        total[:, :start] += lines[:, texels - start :]
        return
    total[:, start : start + texels] += lines
    if wrap == "clamp":
        total[:, :start] += lines[:, :1]
        total[:, start + texels :] += lines[:, -1:]


def blurred_lines(lines: NDArray[np.float32], wrap: str, blur: float = SHORT_BLUR) -> NDArray[np.float32]:
    """Lines, blurred a little along themselves: `blur` is the share of either neighbour.

    A chain is read where a pixel is at least a texel wide, by bilinear accesses that are narrower than that: the
    rest of the pixel's width is made up for beforehand, at no cost to the lookup.
    """
    blurred = np.empty_like(lines)
    np.add(lines[:, :-2], lines[:, 2:], out=blurred[:, 1:-1])
    ends = {"repeat": (lines[:, -1], lines[:, 0]), "clamp": (lines[:, 0], lines[:, -1])}.get(wrap, (0.0, 0.0))
    texels = lines.shape[1]
    blurred[:, 0] = ends[0] + (lines[:, 1] if texels > 1 else ends[1])
    blurred[:, -1] = ends[1] + (lines[:, -2] if texels > 1 else ends[0])
    blurred *= np.float32(blur)
    blurred += np.float32(1 - 2 * blur) * lines
    return blurred


def move_line(line: NDArray[np.float32], shift: float, wrap: str) -> NDArray[np.float32]:
    """One line, (S, 4), moved by any number of texels; what leaves it is lost where it does not repeat."""
    moved = np.empty_like(line)
    whole = math.floor(shift)
    if shift != whole:
        line = _between(line[None], 1 - (shift - whole), wrap)[0]
    _place(line, whole, wrap, moved)
    return moved


def _between(lines: NDArray[np.float32], fraction: float, wrap: str) -> NDArray[np.float32]:
    """Values at `fraction` on the way from each texel's left neighbour to it; of a line that ends, one more.

    Beyond the end of a line its last texel goes on. A line with nothing beyond fades out there instead: by its share of
    the texel, without the ringing of a cut. What is brighter than 1 is interpolated linearly by as much as it is
    brighter: the sun would ring by thousands, darker than black.
    """
    texels = lines.shape[1]
    count = texels if wrap == "repeat" else texels + 1
    blocks = -(-count // _BLOCK)
    index = np.arange(-_REACH, blocks * _BLOCK + _REACH - 1)
    index = index % texels if wrap == "repeat" else index.clip(0, texels - 1)
    # Each texel as one item, the moved axis first: a product with a banded matrix, in blocks that leave little of it 0.
    texel = texel_items(np.ascontiguousarray(lines, np.float32)).T
    source = np.empty((len(index), len(lines)), np.complex128)
    source[:_REACH], source[_REACH : _REACH + texels] = texel[index[:_REACH]], texel
    source[_REACH + texels :] = texel[index[_REACH + texels :]]
    values = source.view(np.float32)
    excess = None
    if values.max() > 1 or values.min() < -1:
        excess = values - values.clip(-1, 1)
        values = values - excess
    windows = sliding_window_view(values, _BLOCK + 2 * _REACH - 1, axis=0)[::_BLOCK].swapaxes(1, 2)
    values = np.matmul(_band(fraction), windows).reshape(blocks * _BLOCK, -1)[:count]
    if excess is not None:
        low, high = excess[_REACH - 1 :][:count], excess[_REACH:][:count]
        values += np.float32(1 - fraction) * low + np.float32(fraction) * high
    between = np.ascontiguousarray(values.view(np.complex128).T).view(np.float32).reshape(len(lines), count, 4)
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
