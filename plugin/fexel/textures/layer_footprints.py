"""Footprints of pixels in the texels of one layer: what filters decide by which prefiltered images a view wants.

Pieces of a view are small on screen, so that between the places that are looked at footprints hardly differ; the leaves
of an index, which know their extremes alone, would not do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel import homography
from fexel.textures.index import LocalPieces

__all__ = ["LayerFootprints", "layer_footprints"]

_UNBOUNDED = np.array([-np.inf, -np.inf, np.inf, np.inf])


@dataclass(frozen=True, eq=False)
class LayerFootprints:
    """What is seen of a layer.

    Attributes
    ----------
    jacobian : (K, P, 2, 2) float64
        Texels of level 0, x right, y down, per pixel; column j along x, y. P places of each of K pieces.
    low, high : (K, 2) float64
        Bounds of each piece in the layer's own coordinates, t up; not limited to [0, 1].
    """

    jacobian: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


def layer_footprints(
    pieces: LocalPieces,
    local_to_layer: NDArray[np.float64],
    size: tuple[int, int],
    bounds: NDArray[np.float64] | None = None,
    reach: float = 0.0,
) -> LayerFootprints:
    """Look at a layer at the corners and in the middle of every piece that touches it.

    Parameters
    ----------
    pieces : LocalPieces
    local_to_layer : (3, 3) float64
        Row vectors.
    size : (int, int)
        Texels of level 0.
    bounds : (4,) float64, optional
        s_min, t_min, s_max, t_max of the layer in local st; default everywhere.
    reach : float
        How far beyond a pixel's place a lookup sees, in pixels.

    Returns
    -------
    LayerFootprints
        Of no piece where none touches the layer.
    """
    bounds = _UNBOUNDED if bounds is None else bounds
    grown = reach * np.abs(pieces.jacobian).sum(axis=3).max(axis=1)
    low, high = np.maximum(pieces.low - grown, bounds[:2]), np.minimum(pieces.high + grown, bounds[2:])
    touching = np.flatnonzero((low <= high).all(axis=1))
    low, high = low[touching], high[touching]
    is_affine = not local_to_layer[:2, 2].any()
    points = _places(low, high)
    uv = homography.apply(local_to_layer, points.reshape(-1, 2)).reshape(points.shape)
    front = np.isfinite(uv).all(axis=2)
    points = np.where(front[..., None], points, points[np.arange(len(points)), front.argmax(axis=1)][:, None])
    seen = front.any(axis=1)
    points, front, uv = points[seen], front[seen], uv[seen]
    at = points[:, :1] if is_affine else points
    axes = homography.jacobian(local_to_layer, at.reshape(-1, 2)).reshape(*at.shape[:2], 1, 2, 2)
    axes = axes * (np.array([size[0], -size[1]], np.float64)[:, None])
    jacobian = (axes @ pieces.jacobian[touching][seen][:, None]).reshape(len(points), -1, 2, 2)
    whole = ~front.all(axis=1)[:, None]  # a part of the piece lies behind infinity
    return LayerFootprints(
        jacobian,
        np.where(whole, 0.0, np.where(front[..., None], uv, np.inf).min(axis=1)),
        np.where(whole, 1.0, np.where(front[..., None], uv, -np.inf).max(axis=1)),
    )


def _places(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, 5, 2): corners of boxes, and their middle."""
    corners = low[:, None] + homography.UNIT_SQUARE * (high - low)[:, None]
    return np.concatenate([corners, (low + high)[:, None] / 2], axis=1)
