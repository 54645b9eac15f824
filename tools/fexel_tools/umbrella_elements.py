"""Elements: leaves, berries, pebbles as they are cut from photographs, each with its opacity.

Arrays have row 0 at the top. Pixel coordinates are continuous, x right, y down, (0, 0) the outer corner of the first
pixel, as everywhere in the tools.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["Element", "Elements"]


@dataclass(frozen=True, eq=False)
class Element:
    """One element, cut from its photo.

    Attributes
    ----------
    name : str
        Unique within the photo: the file's stem, then a number where the photo holds several.
    path : Path
        The photo.
    color : (H, W, 3) float32
        Linear Rec.709, straight alpha, continued past the element; stored values where `is_data`. Finite.
    opacity : (H, W) float32
        0..1; at least one pixel of 0 on every side but where the photo ends.
    is_data : bool
        Stored values (normal map, roughness), not colours.
    quality : float
        In [0, 1]: how sure one can be that this is one whole element, see `umbrella_quality`.
    box : (int, int, int, int)
        Left, top, right, bottom in pixels of the upright photo: where `color` was cut; right and bottom exclusive.
    scale_px : float
        Pixels of the photo in one unit of patch space: the longer side of the photo's largest element.
    """

    name: str
    path: Path
    color: NDArray[np.float32]
    opacity: NDArray[np.float32]
    is_data: bool
    quality: float
    box: tuple[int, int, int, int]
    scale_px: float


@dataclass(frozen=True, eq=False)
class Elements:
    """What a photo holds.

    Attributes
    ----------
    path : Path
    kind : str
        How it was read: ``cutout``, ``object`` or ``many``.
    size : (int, int)
        Width and height of the upright photo.
    elements : tuple of Element
        In reading order: rows from the top, each from the left.
    ground : (3,) float32 or None
        Mean colour of the ground, as `Element.color`; None where alpha takes its place.
    ground_patch : (H, W, 3) float32 or None
        The largest square of ground alone, where it is worth a picture.
    dropped : tuple of ((int, int, int, int), str)
        Box and reason of what was found but is no whole element.
    reason : str
        Why there are no elements; '' where there are.
    """

    path: Path
    kind: str
    size: tuple[int, int]
    elements: tuple[Element, ...]
    ground: NDArray[np.float32] | None = None
    ground_patch: NDArray[np.float32] | None = None
    dropped: tuple[tuple[tuple[int, int, int, int], str], ...] = ()
    reason: str = ""
