"""Isotropic probes along the major axis of the footprint, as graphics hardware has them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fexel.filters.lookup import usable
from fexel.textures.footprint import Footprint
from fexel.textures.pinchmap_lattice import trilinear

__all__ = ["PROBES", "lods", "sample"]

PROBES = 16
"""At most, by default."""

_Floats = NDArray[np.float64]


def lods(jacobian: _Floats, probes: float = PROBES) -> _Floats:
    """(K,) real-valued mip levels of (K, 2, 2), texels of level 0 per pixel, of at most so many probes."""
    return Footprint.of(usable(jacobian)).level(probes)


def sample(
    levels: Sequence[NDArray[np.floating]],
    wrap: tuple[str, str],
    xy: _Floats,
    jacobian: _Floats,
    probes: float = PROBES,
) -> tuple[_Floats, NDArray[np.int64]]:
    """Look an image up.

    Parameters
    ----------
    levels : sequence of (H, W, C)
        Mip levels, linear, premultiplied, row 0 at the top.
    wrap : (str, str)
        ``repeat``, ``mirror``, ``black`` (zero outside), else clamp; along x and y.
    xy : (K, 2) float64
        Texels of level 0, y down.
    jacobian : (K, 2, 2) float64
        d(texel)/d(pixel), column j per pixel along x, y; any values.
    probes : float
        At most.

    Returns
    -------
    values : (K, C) float64
    fetches : (K,) int64
        Texels: 8 per probe.
    """
    size = np.array([levels[0].shape[1], levels[0].shape[0]], np.float64)
    footprint = Footprint.of(usable(jacobian))
    count = footprint.probes(probes).astype(np.int64)
    lod = footprint.level(probes)
    values = np.zeros((len(xy), levels[0].shape[2]))
    for number in range(int(count.max(initial=0))):
        used = np.flatnonzero(number < count)
        along = (number + 0.5) / count[used] - 0.5
        place = (np.nan_to_num(xy[used]) + along[:, None] * footprint.direction[used]) / size
        texels = trilinear(levels, np.stack([place[:, 0], 1 - place[:, 1]], 1), lod[used], wrap)
        values[used] += texels / count[used, None]
    return values, 8 * count
