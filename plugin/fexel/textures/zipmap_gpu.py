"""Zipmaps on the GPU: which layers, levels and windows a view sees, and the records by which the shader finds them.

Layers are found through an index over the view (`fexel.textures.index`); a few affine ones of like shape are a list
instead (`fexel.textures.layer_list`). A layer of another kind is planned by that kind, for the part of the view that it
covers, and known in the zipmap's records by its kind and the place of its own record.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel import homography
from fexel.filters import FILTERS
from fexel.filters.view import FilterView
from fexel.textures import gpu_half, kind_number
from fexel.textures.image_source import holds_vectors
from fexel.textures.image_view import write_image_records
from fexel.textures.index import LocalPieces, Tree, build_tree
from fexel.textures.kind import Plan, Sight
from fexel.textures.layer_list import layer_list
from fexel.textures.pool import TexturePool
from fexel.textures.records import texel_matrices, write_nodes, write_records
from fexel.textures.residency import PairView, pair_levels, view_pairs
from fexel.textures.zipmap import ZipmapData
from fexel.textures.zipmap_binding import ZipmapSlot, bind
from fexel.textures.zipmap_filtered import (
    FILTERED_IMAGE,
    REACH,
    FilteredRoot,
    filtered_root,
    filtered_view,
    layer_filters,
    most_probes,
)

__all__ = ["bind", "plan"]

_PROBE_REACH = 0.5  # pixels beyond its place that a lookup sees with anisotropic probes
_WRAP_CODES = {"patch": 0.0, "black": 0.0, "clamp": 1.0, "repeat": 2.0, "mirror": 3.0}


@dataclass(frozen=True, eq=False)
class _Layers:
    """Layers whose bounds touch what is seen, the root first; arrays of length N.

    `image` is the number in the pool, -1 for a texture of another kind or one that no cell lists; `size` is in texels,
    1 x 1 for another kind, so that its texel coordinates are its st. `most` is how many anisotropic probes its filter
    may take; `filtered` holds what is wanted of layers whose filter is not one of mip levels.
    """

    number: NDArray[np.int64]
    local_to_layer: NDArray[np.float64]
    image: NDArray[np.int64]
    size: NDArray[np.int64]
    most: NDArray[np.float64]
    filtered: dict[int, FilterView]

    @property
    def has_levels(self) -> NDArray[np.bool_]:
        """(N,) whether a layer is an image that is looked up in its mip levels."""
        is_filtered = np.isin(np.arange(len(self.image)), list(self.filtered))
        return (self.image >= 0) & ~is_filtered


@dataclass(frozen=True, eq=False)
class _ZipmapPlan:
    """One zipmap of one view."""

    data: ZipmapData
    layers: _Layers
    tree: Tree
    pairs: PairView
    levels: tuple[NDArray[np.int64], NDArray[np.int64]]
    wrap: tuple[str, str]
    filter: str
    others: dict[int, tuple[str, Plan]]

    @property
    def layers_total(self) -> int:
        return len(self.data.paths)

    @property
    def layers_seen(self) -> Collection[str]:
        return {self.data.paths[self.layers.number[layer]] for layer in np.unique(self.pairs.layer)}

    def write(self, pool: TexturePool) -> ZipmapSlot:
        slots = {layer: other.write(pool) for layer, (_, other) in self.others.items()}
        start, length = write_image_records(list(self.layers.filtered.values()), pool)
        places = {layer: start + length * order for order, layer in enumerate(self.layers.filtered)}
        facts = self._layer_facts(pool)
        for layer, slot in slots.items():
            facts["kind"][layer] = kind_number(slot.kind) + FILTERS.index(slot.filter) / 8
            facts["record"][layer] = slot.record
        for layer, place in places.items():
            facts["kind"][layer], facts["record"][layer] = FILTERED_IMAGE, place
        levels = self._levels_within(pool.finest)
        base = pool.records.next
        records, start = write_records(self.pairs, levels, facts, pool.places)
        pool.records.append(records)
        first_node = pool.records.append(write_nodes(self.tree, self.pairs, start + base, base + len(records)))
        by_records = slots or places
        listed = None if by_records else layer_list(self.tree, self.pairs, levels, facts, pool.places)
        has_levels = self.layers.has_levels
        shown = np.unique(self.pairs.layer)
        of_levels = shown[has_levels[shown]]
        most = self.layers.most[of_levels]
        probes = bool((self.pairs.probes[has_levels[self.pairs.layer]] > 1).any())
        scale = 1.0 / self.tree.cell_size
        classes = {int(c) for c in pool.page_class[self.layers.image[of_levels]]}
        filtered = tuple(self.layers.filtered.values())
        return ZipmapSlot(
            kind="zipmap",
            page_classes=frozenset(classes).union(*(view.page_classes(pool) for view in filtered)),
            record=first_node,
            nested=tuple(slots.values()),
            local_to_texels=self.layers.local_to_layer[0] * [*self.layers.size[0], 1],
            filter=self.layers.filtered[0].token if 0 in self.layers.filtered else self.filter,
            vectors=self._holds_vectors(pool),
            grid=np.concatenate([scale, -self.tree.origin * scale]),
            shape=self.tree.shape,
            wrap=(_WRAP_CODES[self.wrap[0]], _WRAP_CODES[self.wrap[1]]),
            scale=self.data.scale,
            bias=self.data.bias,
            levels=2 if (levels[1] > levels[0]).any() else 1,
            probes=probes,
            most=frozenset(float(each) for each in most),
            outside=self._root_is_seen_outside(probes or bool(filtered)),
            layers=listed,
            filtered=filtered,
            root=self._lone_root(places, pool),
            plain=bool(len(of_levels)),
        )

    def _holds_vectors(self, pool: TexturePool) -> bool:
        """Whether the root does."""
        source, info = self.data.sources[self.data.source_index[0]], pool.facts(int(self.layers.image[0])).info
        return holds_vectors(source, info, self.data.scale, self.data.bias)

    def _lone_root(self, places: dict[int, int], pool: TexturePool) -> FilteredRoot | None:
        """Constants of a root of which nothing covers anything, where its filter needs a record."""
        if 0 not in places or self.others or (self.pairs.layer > 0).any():
            return None
        return filtered_root(self.layers.filtered[0], places[0], self.layers.local_to_layer[0], pool)

    def _layer_facts(self, pool: TexturePool) -> dict[str, NDArray]:
        layers = self.layers
        has_levels = layers.has_levels
        return {
            "matrix": texel_matrices(layers.local_to_layer, layers.size.astype(np.float64)),
            "size": layers.size,
            "opacity": self.data.opacity[layers.number],
            "page_class": np.where(has_levels, pool.page_class[layers.image], 0),
            "image": np.where(has_levels, layers.image, -1),
            "number": layers.number,
            "kind": np.zeros(len(has_levels)),
            "record": np.zeros(len(has_levels), np.int64),
            "most": np.where(has_levels, layers.most, 1.0),
        }

    def _levels_within(self, image_finest: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Levels of the pairs that are resident."""
        has_levels = self.layers.has_levels[self.pairs.layer]
        finest = np.maximum(self.levels[0], image_finest[self.layers.image[self.pairs.layer]])
        finest = np.where(has_levels, finest, 0)
        return finest, np.where(has_levels, np.maximum(self.levels[1], finest), 0)

    def _root_is_seen_outside(self, probes: bool) -> bool:
        """Whether the root's wrap mode matters; anisotropic probes may reach across its edge from within."""
        if probes and self.wrap != ("clamp", "clamp"):
            return True
        visible = self.tree.visible
        seen = np.concatenate([self.tree.low[visible], self.tree.high[visible]])
        corners = homography.UNIT_SQUARE * np.ptp(seen, axis=0) + seen.min(axis=0)
        root_st = homography.apply(self.layers.local_to_layer[0], corners)
        # 1e-5 is far below a texel; a surface whose st end at 0 and 1 may exceed them by rounding.
        return not bool(((root_st >= -1e-5) & (root_st <= 1 + 1e-5)).all())


def plan(data: ZipmapData, sight: Sight, pool: TexturePool) -> _ZipmapPlan:
    """What a view sees of a zipmap; see `fexel.textures.kind.KindGpu`."""
    number = _in_bounds(data, sight)
    local_to_layer = homography.normalize(sight.local_to_st @ data.root_to_patch[number])
    bounds = homography.unit_square_bounds(local_to_layer)
    bounds[0] = -np.inf, -np.inf, np.inf, np.inf
    filters = layer_filters(data, number, pool)
    most = most_probes(filters, pool)
    reach = _PROBE_REACH if np.isfinite(most).all() else REACH
    tree = build_tree(sight.pieces, local_to_layer, bounds, reach)
    nested = {other.layer: other for other in data.nested}
    count = len(number)
    layers = _Layers(
        number, local_to_layer, np.full(count, -1, np.int64), np.ones((count, 2), np.int64), most, filtered={}
    )
    is_other = np.isin(number, list(nested))
    for layer in np.unique(np.append(tree.pair_layer[~is_other[tree.pair_layer]], 0)):
        source = data.sources[data.source_index[number[layer]]]
        layers.image[layer] = pool.image(source, data.paths[number[layer]])
        layers.size[layer] = pool.facts(layers.image[layer]).size
        matrix, box = local_to_layer[layer], bounds[layer]
        view = filtered_view(data, number[layer], filters[layer], sight.pieces, matrix, box, pool)
        if view is not None:
            layers.filtered[int(layer)] = view
    pairs = view_pairs(tree, local_to_layer, bounds, layers.size.astype(np.float64), most, reach)
    pairs = pairs[_shows(pairs, layers.size, is_other, np.isin(np.arange(count), list(layers.filtered)))]
    levels = pair_levels(pairs, layers.size)
    at = layers.has_levels[pairs.layer]
    pool.ask(layers.image[pairs.layer[at]], (levels[0][at], levels[1][at]), (pairs.low[at], pairs.high[at]))
    for layer in set(layers.filtered).difference(pairs.layer.tolist()):
        del layers.filtered[layer]  # too small to be seen
    for view in layers.filtered.values():
        view.ask(pool)
    others = {}
    for layer in np.unique(pairs.layer[is_other[pairs.layer]]):
        other = nested[number[layer]]
        part = _part(tree, pairs, layer, local_to_layer[layer], data.paths[number[layer]])
        others[int(layer)] = other.kind, gpu_half(other.kind).plan(other.data, part, pool)
    wrap = pool.facts(int(layers.image[0])).wrap
    return _ZipmapPlan(data, layers, tree, pairs, levels, wrap, filters[0], others)


def _in_bounds(data: ZipmapData, sight: Sight) -> NDArray[np.int64]:
    """Layers whose bounds touch what is seen; the root, layer 0, first."""
    low, high = sight.pieces.low.min(axis=0), sight.pieces.high.max(axis=0)
    corners = homography.apply(sight.local_to_st, low + homography.UNIT_SQUARE * (high - low))
    low, high = corners.min(axis=0), corners.max(axis=0)
    touches = ((data.bounds[:, :2] <= high) & (data.bounds[:, 2:] >= low)).all(axis=1)
    touches[0] = True
    return np.flatnonzero(touches & ((data.opacity > 0) | (np.arange(len(touches)) == 0)))


def _shows(
    pairs: PairView, size: NDArray[np.int64], is_other: NDArray[np.bool_], is_filtered: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Pairs whose patch is not yet all rim: a level under 3 texels wide or high is empty. One of another kind, of size
    1 x 1, and one whose rim is soft show until they are as small as half a pixel.
    """
    smallest = size.min(axis=1)
    last_shown = np.where(smallest >= 3, np.floor(np.log2(np.maximum(smallest, 3) / 3)), -1.0)
    last_shown[is_other] = 0.0
    last_shown[is_filtered] = np.floor(np.log2(smallest[is_filtered]))
    return (pairs.layer == 0) | (pairs.lod_low < last_shown[pairs.layer] + 1)


def _part(tree: Tree, pairs: PairView, layer: int, local_to_layer: NDArray, path: str) -> Sight:
    """What is seen of a nested texture: the leaves that list it."""
    cell = pairs.cell[pairs.layer == layer]
    return Sight(path, LocalPieces(tree.low[cell], tree.high[cell], tree.jacobian[cell]), local_to_layer, nested=True)
