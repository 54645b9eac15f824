"""Layers of a zipmap whose filter reads prefiltered images: what a view wants of them, and a root that is seen alone.

Such a layer is looked up by shaders/image.glsl. Within an index it is known by the place of its image's record, as a
texture of another kind is; where nothing but the root is seen, its constants are flat varyings and there is no index.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fexel.filters.view import FilterView
from fexel.textures.footprint import Footprint
from fexel.textures.image_source import PATCH_WRAP
from fexel.textures.index import LocalPieces
from fexel.textures.layer_footprints import layer_footprints
from fexel.textures.pool import TexturePool
from fexel.textures.zipmap import ZipmapData

__all__ = ["FILTERED_IMAGE", "REACH", "FilteredRoot", "filtered_root", "filtered_view", "layer_filters", "most_probes"]

FILTERED_IMAGE = -1
"""In place of a kind's number, in records of shaders/zipmap_tree.glsl."""

REACH = 2.0
"""How far beyond its place a lookup in prefiltered images may see, in pixels: their texels are up to two pixels wide,
and nothing lies beyond the border of a patch."""

_BY_LEVELS = ("mipmap", "anisotropic")
_MAGNIFIED = 0.5  # texels per pixel, far below which every filter is bilinear, as far as can be seen


@dataclass(frozen=True, eq=False)
class FilteredRoot:
    """A root that is seen alone.

    Attributes
    ----------
    constants : (5, 4) float64
        Rows u, v, w from local (s, t, 1), then what `image_flat` of shaders/image.glsl takes.
    is_projective : bool
        Whether w is not 1 everywhere.
    """

    constants: NDArray[np.float64]
    is_projective: bool


def layer_filters(data: ZipmapData, number: NDArray[np.int64], pool: TexturePool) -> list[str]:
    """The filter that draws each of the layers `number`."""
    return [pool.filter(data.filters[layer] if data.filters else None) for layer in number]


def most_probes(filters: list[str], pool: TexturePool) -> NDArray[np.float64]:
    """(N,) anisotropic probes that each filter may take; without limit where images are prefiltered for that."""
    most = {"mipmap": 1.0, "anisotropic": pool.anisotropy}
    return np.array([most.get(token, np.inf) for token in filters])


def filtered_view(
    data: ZipmapData,
    number: int,
    token: str,
    pieces: LocalPieces,
    matrix: NDArray[np.float64],
    bounds: NDArray[np.float64],
    pool: TexturePool,
) -> FilterView | None:
    """What a view wants of layer `number`; None where its own mip levels do, as they do for other filters.

    Parameters
    ----------
    data : ZipmapData
    number : int
    token : str
        One of `fexel.filters.FILTERS`.
    pieces : LocalPieces
    matrix : (3, 3) float64
        From local st to the layer's own.
    bounds : (4,) float64
        Of the layer in local st.
    pool : TexturePool
    """
    if token in _BY_LEVELS:
        return None
    source, path = data.sources[data.source_index[number]], data.paths[number]
    source = replace(source, soft_rim=source.wrap == PATCH_WRAP)
    seen = layer_footprints(pieces, matrix, pool.facts(pool.image(source, path)).size, bounds, REACH)
    if not len(seen.jacobian) or Footprint.of(seen.jacobian.reshape(-1, 2, 2)).major.max() < _MAGNIFIED:
        return None
    return FilterView.of(pool, source, path, token, seen.jacobian, seen.low, seen.high)


def filtered_root(view: FilterView, record: int, matrix: NDArray[np.float64], pool: TexturePool) -> FilteredRoot:
    """Constants of a root; `record` is the place of its record, `matrix` (3, 3) leads from local st to it."""
    is_projective = bool(matrix[:2, 2].any())
    rows = (matrix if is_projective else matrix / matrix[2, 2]).T
    constants = np.concatenate([np.column_stack([rows, np.zeros(3)]), view.constants(pool, record)])
    return FilteredRoot(constants, is_projective)
