"""Normal maps: what is filtered is renormalised, so that a bumpy surface does not turn flat and dark far away."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["unit_vectors"]

_SHORTEST = 1e-4  # vectors that cancel out have no direction: they stay what they are


def unit_vectors(texels: NDArray[np.float32], coded: bool) -> NDArray[np.float32]:
    """Vectors of length 1.

    Parameters
    ----------
    texels : (..., 4) float32
        Premultiplied; rgb is a vector v, or (v + 1) / 2 where it is `coded`.
    """
    alpha = texels[..., 3:]
    vectors = 2 * texels[..., :3] - alpha if coded else texels[..., :3]
    length = np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True))
    short = length <= _SHORTEST * alpha
    unit = vectors * np.where(short, 1, alpha / np.where(short, 1, length))
    return np.concatenate([(unit + alpha) / 2 if coded else unit, alpha], axis=-1)
