"""How far pictures are from the truth as it is seen: CIEDE2000, peak signal-to-noise ratio of encoded values."""

from __future__ import annotations

import math

import numpy as np

from fexel.images import linear_to_srgb
from fexel_tools.color_error import ciede2000
from fexel_tools.pinchmap_measure import psnr_db

__all__ = ["ciede2000", "encoded", "encoded_psnr_db"]


def encoded(picture: np.ndarray) -> np.ndarray:
    """(H, W, 3) sRGB-encoded, in [0, 1]."""
    return linear_to_srgb(np.clip(picture[..., :3], 0, 1).astype(np.float32))


def encoded_psnr_db(picture: np.ndarray, truth: np.ndarray) -> float:
    """Of sRGB-encoded values against a peak of 1; at most 100."""
    return psnr_db(encoded(picture), encoded(truth), None, encode=False) or math.nan
