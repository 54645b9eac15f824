"""What a clamped image is continued with beyond its first and last line, as the texels of a chain hold it.

Beyond its border a clamped image is its edge line, on and on. The border texels of a cell are of that continuation,
not of the cell's own first or last line, which is a mean over lines within the image. They are moved as a line in their
middle is, since no access goes farther out than there. On its way beyond the border a footprint crosses the edge line
aslant: so each border texel is the mean of the edge line over what an access, of two texels side by side, crosses.

Source: the shear of Bornik and Ferko 2002, eq. 1, of the clamped image.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fexel.filters.chain_layout import ChainLayout
from fexel.filters.sheared import blurred_lines

__all__ = ["edge_line"]

ACCESS = 2.0
"""Texels of a cell along its long axis that a border texel stands for: an access reads two."""


def edge_line(edge: NDArray[np.float32], n: int, layout: ChainLayout, *, last: bool) -> NDArray[np.float32]:
    """The line beyond the first or the last one of cells (n, 0), blurred as theirs are.

    Parameters
    ----------
    edge : (layout.line_texels, 4) float32
        The image's first or last line.
    n : int
        Halvings of lines.
    layout : ChainLayout
        Its long axis is clamped.
    last : bool
        It lies beyond the last line.

    Returns
    -------
    (1, layout.texels, 4) float32
    """
    line = layout.lines / layout.line_size((n, 0))[0]
    middle = layout.lines + 0.5 * line if last else -0.5 * line
    shear = layout.direction.shear
    before = layout.padding[0]
    moved: NDArray[np.float32] = np.pad(edge, ((before, layout.padding[1] - before), (0, 0)))[None]
    if shear:
        at = np.arange(layout.texels) - before - shear * (middle - 0.5)
        moved = _means(edge, at, ACCESS * abs(shear) * line, layout.moved_wrap)[None]
    return blurred_lines(moved, layout.moved_wrap, layout.blur)


def _means(line: NDArray[np.float32], at: NDArray[np.float64], length: float, wrap: str) -> NDArray[np.float32]:
    """(N, 4) means over `length` about places, of which texel centres are whole, of a line, linear between these."""
    total = _integral(line, at + 0.5 * length, wrap) - _integral(line, at - 0.5 * length, wrap)
    return (total / length).astype(np.float32)


def _integral(line: NDArray[np.float32], at: NDArray[np.float64], wrap: str) -> NDArray[np.float64]:
    """(N, 4) from the first texel's centre to places."""
    count = len(line)
    turns = np.floor(at / count) if wrap == "repeat" else np.zeros(len(at))
    if wrap == "repeat":
        line = np.concatenate([line, line[:1]])
    elif wrap != "clamp":
        line = np.pad(line, ((1, 1), (0, 0)))
        at = at + 1
    at = at - count * turns
    within = at.clip(0, len(line) - 1)
    first = np.minimum(within.astype(np.int64), max(len(line) - 2, 0))
    part = (within - first)[:, None]
    following = line[np.minimum(first + 1, len(line) - 1)]
    steps = np.concatenate([np.zeros((1, 4)), np.cumsum(0.5 * (line[1:] + line[:-1]), axis=0, dtype=np.float64)])
    total = steps[first] + part * (line[first] + 0.5 * part * (following - line[first]))
    beyond = np.minimum(at, 0)[:, None] * line[0] + np.maximum(at - (len(line) - 1), 0)[:, None] * line[-1]
    return total + beyond + turns[:, None] * steps[-1]
