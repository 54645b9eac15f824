"""Short lists of layers, which shaders/zipmap_list.glsl unrolls: uniforms of one slot and what is compiled in.

An unrolled layer costs less than half of one that is found by the index, but is looked at everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.textures.index import Tree
from fexel.textures.residency import PairView

__all__ = ["LayerList", "layer_list"]

_MOST_LAYERS = 7
# What a layer found by the index costs, over an unrolled one.
_INDEX_COST = 2.5
# Texels whose axes differ by less than this from a rotated, scaled root texel have its mip level plus a constant.
_SIMILAR = 1e-3


@dataclass(frozen=True, eq=False)
class LayerList:
    """Layers of a slot, front to back, as the shader has them.

    Attributes
    ----------
    flat : (N, 4, 4) float64
        ``zipmapFlat``.
    numbers : (N, 4) float64
    root : (4,) float64
    codes : int
        ``ZIPMAP_CODES`` of the slot.
    """

    flat: NDArray[np.float64]
    numbers: NDArray[np.float64]
    root: NDArray[np.float64]
    codes: int


def layer_list(
    tree: Tree,
    pairs: PairView,
    levels: tuple[NDArray[np.int64], NDArray[np.int64]],
    layers: dict[str, NDArray],
    places: NDArray[np.float64],
) -> LayerList | None:
    """The layers of `pairs` as a list, or None where the index serves better.

    Parameters
    ----------
    tree : Tree
    pairs, levels, layers, places
        As for `fexel.textures.records.write_records`.
    """
    used = np.unique(pairs.layer)[::-1]
    if len(used) > _MOST_LAYERS or (pairs.probes > 1).any() or len(used) > _INDEX_COST * _mean_length(tree, pairs):
        return None
    # A patch that is too small to be seen in part of the view is not resident there.
    if np.bincount(pairs.layer)[used[:-1]].sum() < np.bincount(tree.pair_layer)[used[:-1]].sum():
        return None
    finest = np.array([levels[0][pairs.layer == layer].min() for layer in used])
    coarsest = np.array([levels[1][pairs.layer == layer].max() for layer in used])
    matrix = layers["matrix"][used]
    if (coarsest - finest).max() > 1 or (matrix[:, 2, :2] != 0).any():
        return None
    matrix = matrix / matrix[:, 2:, 2:]
    offset = _level_offsets(matrix[:, :2, :2])
    if offset is None:
        return None
    size, image = layers["size"][used], layers["image"][used]
    flat = np.zeros((len(used), 4, 4))
    flat[:, :2, :3] = matrix[:, :2] / size[:, :, None]
    flat[:, 0, 3], flat[:, 1, 3] = layers["opacity"][used], offset - finest
    for step, level in enumerate((finest, coarsest)):
        place = places[image, level]
        flat[:, 2 + step] = np.concatenate([place[:, :2] * size, place[:, 2:]], axis=1)
    zero = np.zeros(len(used))
    codes = (coarsest > finest) + 2 * layers["page_class"][used]
    return LayerList(
        flat,
        np.column_stack([layers["number"][used], finest, zero, zero]),
        matrix[-1, :2, :2].ravel(),
        len(used) + 16 * sum(int(code) << 2 * i for i, code in enumerate(codes)),
    )


def _mean_length(tree: Tree, pairs: PairView) -> float:
    """Layers per leaf, on average over the visible area in local st."""
    length = np.bincount(pairs.cell, minlength=len(tree.low))
    area = (tree.high - tree.low).prod(axis=1) * (length > 0)
    total = area.sum()
    return float((area * length).sum() / total) if total > 0 else float(length.max())


def _level_offsets(axes: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """(N,) mip level of layers less that of the last one, from (N, 2, 2) rows texel x, y; None where it varies."""
    if np.linalg.det(axes[-1]) == 0:
        return None
    stretch = np.linalg.svd(axes @ np.linalg.inv(axes[-1]), compute_uv=False)
    if (stretch[:, 0] > (1 + _SIMILAR) * stretch[:, 1]).any() or (stretch[:, 1] <= 0).any():
        return None
    return np.log2(stretch[:, 0] * stretch[:, 1]) / 2
