"""How far pictures are from the truth as it is seen: CIEDE2000, peak signal-to-noise ratio of encoded values."""

from __future__ import annotations

import math

import numpy as np

from fexel.images import linear_to_srgb
from fexel_tools.pinchmap_measure import psnr_db

__all__ = ["ciede2000", "encoded", "encoded_psnr_db"]


def ciede2000(picture: np.ndarray, truth: np.ndarray) -> float:
    """Mean CIEDE2000 (Sharma, Wu and Dalal 2005; colour-science) of (H, W, >= 3), linear Rec.709, clipped to [0, 1]."""
    import colour  # takes a second to import; nothing else here needs it

    space = colour.RGB_COLOURSPACES["sRGB"]
    labs = [
        colour.XYZ_to_Lab(np.clip(rgb[..., :3], 0, 1).astype(np.float64) @ space.matrix_RGB_to_XYZ.T, space.whitepoint)
        for rgb in (picture, truth)
    ]
    return float(np.mean(colour.delta_E(*labs, method="CIE 2000")))


def encoded(picture: np.ndarray) -> np.ndarray:
    """(H, W, 3) sRGB-encoded, in [0, 1]."""
    return linear_to_srgb(np.clip(picture[..., :3], 0, 1).astype(np.float32))


def encoded_psnr_db(picture: np.ndarray, truth: np.ndarray) -> float:
    """Of sRGB-encoded values against a peak of 1; at most 100."""
    return psnr_db(encoded(picture), encoded(truth), None, encode=False) or math.nan
