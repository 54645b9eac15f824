"""Trilinear mipmap: one isotropic probe, as wide as the footprint is long (Williams 1983)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fexel.filters import anisotropic

__all__ = ["lods", "sample"]

_Floats = NDArray[np.float64]


def lods(jacobian: _Floats) -> _Floats:
    """(K,) real-valued mip levels of (K, 2, 2), texels of level 0 per pixel."""
    return anisotropic.lods(jacobian, 1)


def sample(
    levels: Sequence[NDArray[np.floating]], wrap: tuple[str, str], xy: _Floats, jacobian: _Floats
) -> tuple[_Floats, NDArray[np.int64]]:
    """Values (K, C) and texels fetched (K,) of pixels; see `fexel.filters.anisotropic.sample`."""
    return anisotropic.sample(levels, wrap, xy, jacobian, probes=1)
