"""All chains of a direction, from the lines of an image: moved, then halved along each axis, exact in area.

Lines are taken in blocks that are halved on their own, side by side on all cores, until what is left of all of them is
small; memory does not grow with the image but for that rest. Nothing is rounded between levels: a level is encoded from
floats that the next one is made of.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fexel.filters.chain_borders import edge_line
from fexel.filters.chain_layout import ChainLayout
from fexel.filters.sheared import blurred_lines, can_group, move_line, moved_groups, moved_lines
from fexel.mipmaps import halve_axis, level_size
from fexel.textures.page_texels import texel_items

__all__ = ["build_chains"]

_BLOCK_TEXELS = 2**17
_MOST_HALVINGS = 6  # of a block on its own
_LEAST_HALVINGS = 4
_MOST_THREADS = 8  # each has a block or two of floats in memory

_Lines = NDArray[np.float32]
_Cell = tuple[int, int]


def build_chains(
    layout: ChainLayout,
    read: Callable[[int, int], _Lines],
    encode: Callable[[_Lines], NDArray],
    cells: dict[_Cell, NDArray],
) -> None:
    """Fill the cells of a direction.

    Parameters
    ----------
    layout : ChainLayout
    read : function of (first, last)
        Lines of the image, (last - first, layout.line_texels, 4) float32, linear and premultiplied; called from several
        threads.
    encode : function
        Texels as `cells` hold them.
    cells : dict
        By cell: (h + 2, w + 2, 4), rows and columns of the image with a border of one texel.
    """
    _Builder(layout, encode, cells).build(read)


class _Builder:
    def __init__(self, layout: ChainLayout, encode: Callable[[_Lines], NDArray], cells: dict[_Cell, NDArray]) -> None:
        self._layout = layout
        self._encode = encode
        along_y = layout.direction.long_axis == 1
        # Of every cell its lines first, whatever they are in the image.
        items = {cell: texel_items(texels) for cell, texels in cells.items()}
        self._cells = {cell: texels if along_y else texels.T for cell, texels in items.items()}
        self._ends: dict[tuple[_Cell, bool], _Lines] = {}

    def build(self, read: Callable[[int, int], _Lines]) -> None:
        layout = self._layout
        source: Callable[[int, int], _Lines] = partial(_sheared, read, layout)
        halved, top, behind = layout.octaves, 0, layout.octaves
        with ThreadPoolExecutor(_threads()) as pool:
            while top < layout.last[0]:
                lines = max(_BLOCK_TEXELS // layout.texels, 1)
                halvings = min(max(lines.bit_length() - 1, _LEAST_HALVINGS), _MOST_HALVINGS) - behind
                top = min(layout.last[0], halved + halvings)
                count, step = level_size(layout.lines, top), max(1, lines >> (halvings + behind))
                blocks = ((first, min(first + step, count)) for first in range(0, count, step))
                rest = np.empty((count, layout.texels, 4), np.float32)
                for first, texels in _in_parallel(pool, partial(self._block, source, halved, top), blocks):
                    rest[first : first + len(texels)] = texels
                source, halved, behind = _slices(rest), top, 0
        if layout.long_wrap == "clamp":
            self._write_edges(read)
        for cell in self._cells:
            self._close(cell)

    def _block(
        self, source: Callable[[int, int], _Lines], low: int, top: int, first: int, end: int
    ) -> tuple[int, _Lines]:
        """Lines [first, end) halved `top` times, of those halved `low` times; writes what is not written of these."""
        sizes = [level_size(self._layout.lines, n) for n in range(low, top + 1)]
        needs = _needed(first, end, sizes[:-1])
        lines = source(*needs[0])
        for n in range(low, top + 1):
            start = needs[n - low][0]
            if n > low:
                lines = halve_axis(lines, 0, sizes[n - 1 - low], start)
            if n > low or n == self._layout.octaves:
                # What lies beyond is the next block's as well.
                own = sizes[n - low] if end == sizes[-1] else end << (top - n)
                self._write(n, start, lines[: own - start])
        return first, lines

    def _write(self, n: int, first: int, lines: _Lines) -> None:
        """Cells (n, 0), (n, 1), ... of some lines."""
        for m in range(self._layout.levels(n)):
            if m:
                lines = halve_axis(lines, 1)
            self._cells[n, m][1 + first : 1 + first + len(lines), 1:-1] = self._encoded(lines)
            if first == 0:
                self._ends[(n, m), False] = lines[:1].copy()
            if first + len(lines) == level_size(self._layout.lines, n):
                self._ends[(n, m), True] = lines[-1:].copy()

    def _write_edges(self, read: Callable[[int, int], _Lines]) -> None:
        """Beyond the first and last line of all cells."""
        layout = self._layout
        for at, first in ((0, 0), (-1, layout.lines - 1)):
            edge = read(first, first + 1)[0]
            for n in range(layout.octaves, layout.last[0] + 1):
                line = edge_line(edge, n, layout, last=at == -1)
                for m in range(layout.levels(n)):
                    line = halve_axis(line, 1) if m else line
                    self._cells[n, m][at, 1:-1] = self._encoded(line)[0]

    def _encoded(self, lines: _Lines) -> NDArray:
        return texel_items(np.ascontiguousarray(self._encode(lines)))

    def _close(self, cell: _Cell) -> None:
        """The border of a cell: what its wrap modes continue it with."""
        texels, layout = self._cells[cell], self._layout
        if layout.long_wrap == "repeat":
            # Across the seam a line is moved by the whole texture's length more: there the shear goes on.
            along = layout.direction.shear * layout.lines * layout.line_size(cell)[1] / layout.texels
            for at, last, shift in ((0, True, -along), (-1, False, along)):
                line = move_line(self._ends[cell, last][0], shift, layout.moved_wrap)
                texels[at, 1:-1] = self._encoded(line[None])[0]
        elif layout.long_wrap != "clamp":
            texels[0] = texels[-1] = 0
        if layout.moved_wrap == "repeat":
            texels[:, 0], texels[:, -1] = texels[:, -2].copy(), texels[:, 1].copy()
        elif layout.moved_wrap == "clamp":
            finest = self._cells[cell[0], 0]
            texels[:, 0], texels[:, -1] = finest[:, 1], finest[:, -2]
        else:
            texels[:, 0] = texels[:, -1] = 0


def _needed(first: int, end: int, sizes: list[int]) -> list[tuple[int, int]]:
    """By level, the finest first: the lines that make [first, end) of the last one. `sizes` are those of the others."""
    needs = [(first, end)]
    for size in reversed(sizes):
        first, end = (0, 1) if size == 1 else (2 * first, 2 * end + size % 2)
        needs.append((first, end))
    return needs[::-1]


def _sheared(read: Callable[[int, int], _Lines], layout: ChainLayout, first: int, end: int) -> _Lines:
    """Lines [first, end) of the coarsest resolution that all chains are made of: moved, halved and blurred."""
    if can_group(layout):
        lines = moved_groups(read(first << layout.octaves, end << layout.octaves), first, layout)
    else:
        sizes = [level_size(layout.lines, n) for n in range(layout.octaves)]
        needs = _needed(first, end, sizes)
        lines = moved_lines(read(*needs[0]), needs[0][0], layout)
        for size, (start, _) in zip(sizes, needs[1:], strict=True):
            lines = halve_axis(lines, 0, size, start)
    return blurred_lines(lines, layout.moved_wrap, layout.blur)


def _slices(lines: _Lines) -> Callable[[int, int], _Lines]:
    return lambda first, end: lines[first:end]


def _threads() -> int:
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return min(usable or 1, _MOST_THREADS)


def _in_parallel(pool: ThreadPoolExecutor, work: Callable, tasks: Iterable[tuple]) -> Iterator:
    """Results in order; no more tasks at once than keep all threads busy."""
    running: deque[Future] = deque()
    for task in tasks:
        running.append(pool.submit(work, *task))
        if len(running) > 2 * _threads():
            yield running.popleft().result()
    while running:
        yield running.popleft().result()
