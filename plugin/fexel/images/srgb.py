"""The sRGB transfer function (IEC 61966-2-1), both ways."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["linear_to_srgb", "srgb_to_linear"]


def srgb_to_linear(encoded: NDArray[np.floating]) -> NDArray[np.float32]:
    """sRGB decoding (IEC 61966-2-1), continued beyond [0, 1] with odd symmetry."""
    encoded = np.asarray(encoded, np.float32)
    magnitude = np.abs(encoded)
    decoded = np.where(magnitude <= 0.04045, magnitude / 12.92, ((magnitude + 0.055) / 1.055) ** 2.4)
    return np.copysign(decoded, encoded).astype(np.float32)


def linear_to_srgb(linear: NDArray[np.floating]) -> NDArray[np.float32]:
    """sRGB encoding (IEC 61966-2-1), continued beyond [0, 1] with odd symmetry."""
    linear = np.asarray(linear, np.float32)
    magnitude = np.abs(linear)
    # 1e-12 keeps the power of an exact zero out of the branch that np.where discards.
    encoded = np.where(
        magnitude <= 0.0031308, magnitude * 12.92, 1.055 * np.maximum(magnitude, 1e-12) ** (1 / 2.4) - 0.055
    )
    return np.copysign(encoded, linear).astype(np.float32)
