"""Texels of pinchmaps as files store them, and how fine their signals may be.

Conventions: images are (H, W, C), row 0 at the top; a pinchmap is (Nh, Nw, 4): d_s, d_t, k, gamma in [-1, 1].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["decode_texels", "encode_texels", "signal_half_texel"]


def encode_texels(pinchmap: NDArray[np.floating], bits: int = 8) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Integer texels of a pinchmap: 0 is 127 of 8 bits or 32767 of 16, and the highest value is never used.

    Parameters
    ----------
    pinchmap : (..., 4)
        In [-1, 1]; clipped to it. NaN becomes 0.
    bits : {8, 16}

    Returns
    -------
    (..., 4) uint8 or uint16
    """
    middle = (1 << (bits - 1)) - 1
    values = np.nan_to_num(np.asarray(pinchmap, np.float64), nan=0.0, posinf=1.0, neginf=-1.0)
    texels = np.rint(np.clip(values, -1, 1) * middle) + middle
    return texels.astype(np.uint8 if bits == 8 else np.uint16)


def decode_texels(texels: NDArray) -> NDArray[np.float64]:
    """Values of stored texels; the inverse of `encode_texels`.

    Parameters
    ----------
    texels : (..., 4) uint8, uint16 or float
        255 (65535) is read as 1; floats are taken as they are, but within [-1, 1] and without NaN.

    Returns
    -------
    (..., 4) float64
        In [-1, 1].
    """
    if texels.dtype == np.uint8:
        return np.minimum((texels.astype(np.float64) - 127) / 127, 1.0)
    if texels.dtype == np.uint16:
        return np.minimum((texels.astype(np.float64) - 32767) / 32767, 1.0)
    return np.clip(np.nan_to_num(np.asarray(texels, np.float64), nan=0.0, posinf=1.0, neginf=-1.0), -1, 1)


def signal_half_texel(pinchmap_size: tuple[int, int], signal_size: tuple[int, int]) -> float | None:
    """h of eq. (1), half a signal texel in pinchmap texels: 2^(-K-1) where the signal is 2^K times as fine.

    Parameters
    ----------
    pinchmap_size, signal_size : (int, int)
        Width and height in texels.

    Returns
    -------
    float or None
        None where the sizes do not go together: the ratio must be the same power of two, 1 at least, along both axes.
    """
    ratio = signal_size[0] // pinchmap_size[0] if pinchmap_size[0] else 0
    is_power = ratio > 0 and ratio & (ratio - 1) == 0
    fits = tuple(size * ratio for size in pinchmap_size) == tuple(signal_size)
    return 0.5 / ratio if is_power and fits else None
