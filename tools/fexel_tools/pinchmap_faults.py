"""Where a pinchmap cannot follow its source, and why.

What defies a pinchmap is named by Tarini and Cignoni 2005, section 8: lines that cross, that meet, that run too near
each other; and by the lattice itself: details smaller than a texel. Wrong pixels are gathered into places. The reason
is read from the source on a circle of 1.25 texels about the place: how often the side changes along it, and which of
its arcs are connected inside.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Fault", "find_faults"]

_RADIUS = 1.25  # of the circle, in texels
_SMALLEST = 0.06  # wrong pixels that make a place, in pixels of a cell: less is what the best fit leaves at a corner
_MOST = 1000
_ANGLES = np.linspace(0, 2 * np.pi, 96, endpoint=False)


@dataclass(frozen=True)
class Fault:
    """A place where a pinchmap cannot follow its source.

    Attributes
    ----------
    x, y : float
        In source pixels from the upper left corner.
    reason : str
        ``crossing``: two lines cross or touch; ``junction``: three strokes or more meet; ``too near``: the sides of a
        stroke or gap are nearer than the map resolves; ``too small``: a spot, tip or corner is.
    pixels : int
        Wrong there.
    """

    x: float
    y: float
    reason: str
    pixels: int


def find_faults(plus: NDArray[np.uint8], wrong: NDArray[np.uint8], cell: tuple[float, float]) -> tuple[Fault, ...]:
    """Gather wrong pixels into places and name the reason of each.

    Parameters
    ----------
    plus : (H, W) uint8
        1 on the + side of the source, else 0.
    wrong : (H, W) uint8
        1 where the pinchmap shows the other side.
    cell : (float, float)
        Width and height of a texel in pixels.

    Returns
    -------
    tuple of Fault
        Most pixels first, at most 1000.
    """
    if not wrong.any():
        return ()
    reach = tuple(2 * max(round(0.25 * size), 0) + 1 for size in cell)  # what is half a texel apart is one place
    _, labels = cv2.connectedComponents(cv2.dilate(wrong, np.ones(reach[::-1], np.uint8)), connectivity=8)
    rows, columns = np.nonzero(wrong)
    label = labels[rows, columns]
    pixels = np.bincount(label)
    x = np.bincount(label, columns + 0.5) / np.maximum(pixels, 1)
    y = np.bincount(label, rows + 0.5) / np.maximum(pixels, 1)
    order = np.argsort(-pixels, kind="stable")[:_MOST]
    least = max(_SMALLEST * cell[0] * cell[1], 2)
    return tuple(
        Fault(float(x[i]), float(y[i]), _reason(plus, float(x[i]), float(y[i]), cell), int(pixels[i]))
        for i in order
        if pixels[i] >= least
    )


def _reason(plus: NDArray[np.uint8], x: float, y: float, cell: tuple[float, float]) -> str:
    radius = (max(_RADIUS * cell[0], 1.5), max(_RADIUS * cell[1], 1.5))
    left, top = int(np.floor(x - radius[0])) - 1, int(np.floor(y - radius[1])) - 1
    right, bottom = int(np.ceil(x + radius[0])) + 2, int(np.ceil(y + radius[1])) + 2
    rows = np.clip(np.arange(top, bottom), 0, plus.shape[0] - 1)  # the outermost pixels go on outside
    columns = np.clip(np.arange(left, right), 0, plus.shape[1] - 1)
    patch = plus[rows[:, None], columns]
    dx = (np.arange(left, right) + 0.5 - x) / radius[0]
    dy = (np.arange(top, bottom) + 0.5 - y) / radius[1]
    inside = dx * dx + (dy * dy)[:, None] <= 1.0
    circle = patch[
        (y + 0.98 * radius[1] * np.sin(_ANGLES) - top).astype(int),
        (x + 0.98 * radius[0] * np.cos(_ANGLES) - left).astype(int),
    ]
    arcs = int((circle != np.roll(circle, 1)).sum()) // 2  # of either side
    if arcs < 2:
        return "too small"
    plus_parts, minus_parts = (_parts(inside & (patch == side), cell) for side in (1, 0))
    if arcs == 2:
        return "crossing" if plus_parts >= 2 and minus_parts >= 2 else "too near"
    return "junction" if min(plus_parts, minus_parts) == 1 else "too near"


def _parts(region: NDArray[np.bool_], cell: tuple[float, float]) -> int:
    """Connected parts of a region that are wider than a sixth of a texel."""
    width = max(round(min(cell) / 6), 1)
    opened = cv2.erode(region.astype(np.uint8), np.ones((width, width), np.uint8), borderValue=0)
    return cv2.connectedComponents(opened, connectivity=4)[0] - 1
