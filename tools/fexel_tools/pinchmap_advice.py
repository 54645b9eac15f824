"""What would serve a source better: a size at which the places where the map falls short are resolved.

A stroke or gap is told from its surroundings where it is `_TEXELS_ACROSS` texels wide (two lines nearer to each other
leave no cell of their own between them). Its width is read from the distance transform of the source: twice the
largest distance to the other side within the neighbourhood of the fault. Crossings and junctions are never resolved,
but what is wrong there shrinks with the square of the texel.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from fexel_tools.pinchmap_auto import largest_auto_size
from fexel_tools.pinchmap_faults import Fault

__all__ = ["suggested_size"]

_TEXELS_ACROSS = 1.5
_NEIGHBOURHOOD = 1.0  # texels
_RESOLVED = 0.8  # share of the wrong pixels whose faults the size shall resolve
_MOST = 4.0  # times the size: what needs a still finer map is a speck
_LEAST_GAIN = 1.25  # a size nearer to the one at hand helps little
_TOPOLOGICAL = ("crossing", "junction")
_STEP = 4


def suggested_size(side: np.ndarray, faults: Sequence[Fault], size: int, texel_px: float) -> int | None:
    """Size along the longer side that would resolve most of what is wrong.

    Parameters
    ----------
    side : (H, W) float
        Of the source, in [0, 1].
    faults : sequence of Fault
    size : int
        Of the map that has the faults, texels along the longer side.
    texel_px : float
        Width of its texels, source pixels.

    Returns
    -------
    int or None
        A multiple of 4, larger than `size`, at most four times that; None without faults, or where the source has no
        pixels for a finer map.
    """
    height, width = side.shape
    largest = largest_auto_size(width, height)
    if not faults or largest < size * _LEAST_GAIN:
        return None
    factors, pixels = _factors(side > 0.5, faults, texel_px), np.array([fault.pixels for fault in faults])
    order = np.argsort(factors, kind="stable")
    resolved = np.cumsum(pixels[order]) >= _RESOLVED * pixels.sum()
    wanted = size * float(np.clip(factors[order][np.argmax(resolved)], _LEAST_GAIN, _MOST))
    return int(min(-(-wanted // _STEP) * _STEP, largest))


def _factors(plus: np.ndarray, faults: Sequence[Fault], texel_px: float) -> np.ndarray:
    """By how much smaller texels would have to be at each fault."""
    inside, outside = (
        cv2.distanceTransform(part.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for part in (plus, ~plus)
    )
    reach = max(1, round(_NEIGHBOURHOOD * texel_px))
    factors = np.full(len(faults), 2.0)  # of crossings and junctions: a quarter of the area stays wrong
    for number, fault in enumerate(faults):
        if fault.reason in _TOPOLOGICAL:
            continue
        y, x = int(fault.y), int(fault.x)
        near = (slice(max(y - reach, 0), y + reach + 1), slice(max(x - reach, 0), x + reach + 1))
        thickness = 2.0 * max(min(float(inside[near].max()), float(outside[near].max())), 0.5)
        factors[number] = _TEXELS_ACROSS * texel_px / thickness
    return factors
