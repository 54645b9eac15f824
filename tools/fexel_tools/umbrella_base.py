"""Base umbrellas: a star-shaped contour about a centre, and the texture it is filled with (the paper's section 4.1).

Patch space: the centre is (0, 0), x right, y up; one unit is `Element.scale_px` pixels of the photo, so that the
longer side of a photo's largest element is 1. Texture coordinates have their origin at the lower left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["BaseUmbrella"]


@dataclass(frozen=True, eq=False)
class BaseUmbrella:
    """A base umbrella before it is diversified.

    Attributes
    ----------
    name : str
    texture : (h, w, 4) float32
        Linear Rec.709 or data, straight alpha, row 0 at the top; plausible also where alpha is 0.
    has_alpha : bool
        Whether alpha means something inside the contour (holes, translucency); else it is 1 throughout.
    tex_coords : (V, 2) float64
        The centre, then the contour, counter-clockwise (t up); within [0, 1].
    points : (V, 2) float64
        The same in patch space; the centre is (0, 0).
    morph_points : (V, 2) float64
        `points` until shapes are diversified.
    lost_area : float
        Share of the element's area that lies outside the contour since it is not visible from the centre, in [0, 1).
    tolerance_px : float
        Largest distance, in pixels of the photo, between the contour and the boundary it simplifies.
    """

    name: str
    texture: NDArray[np.float32]
    has_alpha: bool
    tex_coords: NDArray[np.float64]
    points: NDArray[np.float64]
    morph_points: NDArray[np.float64]
    lost_area: float
    tolerance_px: float
