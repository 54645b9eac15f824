"""What shaders/zipmap_tree.glsl reads of the record texture: nodes of the index, a record per (leaf, layer) pair.

Layouts are described in the shader. Everything is computed in float64 and stored as float32: matrices lead from local
st, which is of the size of the view, to texels, so that nothing cancels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fexel.textures.index import Tree
from fexel.textures.residency import PairView

__all__ = ["HEADER", "texel_matrices", "write_nodes", "write_records"]

HEADER = 4


def texel_matrices(local_to_layer: NDArray[np.float64], sizes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3, 3) rows x, y, w for columns (s, t, 1): texels of level 0, x right, y down.

    Parameters
    ----------
    local_to_layer : (N, 3, 3) float64
        Row vectors, to [0, 1]^2 with t up.
    sizes : (N, 2) float64
    """
    u, v, w = (local_to_layer[..., column] for column in range(3))
    return np.stack([u * sizes[:, :1], (w - v) * sizes[:, 1:], w], axis=1)


def write_records(
    pairs: PairView,
    levels: tuple[NDArray[np.int64], NDArray[np.int64]],
    layers: dict[str, NDArray],
    places: NDArray[np.float64],
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Records of pairs, one after the other.

    Parameters
    ----------
    pairs : PairView
        K pairs.
    levels : (K,) and (K,) int64
        Finest and coarsest mip level of each.
    layers : dict
        Per layer: ``matrix`` (N, 3, 3) of `texel_matrices`, ``size`` (N, 2), ``opacity`` (N,), ``page_class`` (N,),
        ``image`` (N,), ``number`` (N,), ``kind`` and ``record`` (N,), ``most`` probes (N,). An image that is looked
        up in its mip levels has ``kind`` and ``record`` 0, all else has ``image`` -1.
    places : (S, L, 4) float64
        Per image and level: scale and offset from texels of level 0 to page coordinates.

    Returns
    -------
    records : (R, 4) float32
    start : (K,) int64
        First texel of each record.
    """
    finest, coarsest = levels
    length = HEADER + coarsest - finest + 1
    start = np.cumsum(length) - length
    records = np.zeros((int(length.sum()), 4))
    layer = pairs.layer
    packed = finest + 16 * coarsest + 256 * layers["page_class"][layer] + layers["opacity"][layer] / 2
    ends = np.concatenate([layers["size"][layer], packed[:, None]], axis=1)
    for row in range(3):
        records[start + row, :3] = layers["matrix"][layer, row]
        records[start + row, 3] = ends[:, row]
    records[start + 3] = np.column_stack([layers[name][layer] for name in ("number", "kind", "record", "most")])
    for step in range(int((coarsest - finest).max(initial=-1)) + 1):
        at = np.flatnonzero(finest + step <= coarsest)
        image = layers["image"][layer[at]]
        records[start[at] + HEADER + step] = np.where((image >= 0)[:, None], places[image, finest[at] + step], 0.0)
    return records.astype(np.float32), start


def write_nodes(tree: Tree, pairs: PairView, start: NDArray[np.int64], base: int) -> NDArray[np.float32]:
    """(C, 4) float32 nodes of a tree whose first node will be at texel `base`; `start` counts from texel 0."""
    count = np.bincount(pairs.cell, minlength=len(tree.first_child))
    first = np.zeros(len(tree.first_child), np.int64)
    heads = np.flatnonzero(np.r_[True, pairs.cell[1:] != pairs.cell[:-1]])
    first[pairs.cell[heads]] = start[heads]
    # What lies outside of the view shows some root, should a sample stray there.
    empty = count == 0
    first[empty], count[empty] = start[-1], 1
    inner = tree.first_child >= 0
    nodes = np.zeros((len(first), 4), np.float32)
    nodes[:, 0] = np.where(inner, tree.first_child + base, first)
    nodes[:, 1] = np.where(inner, -tree.children, count)
    return nodes
