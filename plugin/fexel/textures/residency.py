"""Which windows of which mip levels a view needs, and dropping to coarser ones past a memory budget.

For every (leaf, layer) pair of a `Tree` the exact Jacobian of the layer's projective map gives the range of mip levels,
and the mapped leaf the window in each. Levels of one image are united over all places where it is seen.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.textures.index import Tree

__all__ = ["MAX_LEVELS", "PairView", "Windows", "drop_levels", "pair_levels", "view_pairs"]

# The Jacobian is evaluated at the corners and the centre of a leaf; it may be a little smaller in between.
_LOD_MARGIN = 0.2
# Texels around a window for bilinear filtering and for st that multisampling takes from just outside a triangle.
_WINDOW_MARGIN = 3
MAX_LEVELS = 16


@dataclass(frozen=True, eq=False)
class PairView:
    """(leaf, layer) pairs, the root's included, in the order of records; arrays of length K.

    Attributes
    ----------
    cell, layer : (K,) int64
    lod_low, lod_high : (K,) float64
        Range of the real-valued mip level.
    low, high : (K, 2) float64
        Bounds of the leaf in the layer's [0, 1]^2, t up; the root's may exceed it.
    probes : (K,) float64
        Most anisotropic probes that a lookup takes there.
    """

    cell: NDArray[np.int64]
    layer: NDArray[np.int64]
    lod_low: NDArray[np.float64]
    lod_high: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    probes: NDArray[np.float64]

    def __getitem__(self, keep: NDArray) -> PairView:
        return PairView(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))


def view_pairs(
    tree: Tree,
    local_to_layer: NDArray[np.float64],
    layer_bounds: NDArray[np.float64],
    sizes: NDArray[np.float64],
    anisotropy: float | NDArray[np.float64],
    reach: float = 0.5,
) -> PairView:
    """Mip levels and windows of all pairs.

    Parameters
    ----------
    tree : Tree
    local_to_layer : (N, 3, 3) float64
    layer_bounds : (N, 4) float64
        Local st.
    sizes : (N, 2) float64
        Width and height of each layer's image in texels.
    anisotropy : float or (N,) float64
        Most probes per lookup, of all layers or of each.
    reach : float
        How far beyond a pixel's place a lookup sees, in pixels.
    """
    leaves = np.flatnonzero((tree.first_child < 0) & tree.visible)
    cell = np.concatenate([tree.pair_cell, leaves])
    layer = np.concatenate([tree.pair_layer, np.zeros(len(leaves), np.int64)])
    order = np.lexsort((-layer, cell))
    cell, layer = cell[order], layer[order]
    grown = reach * np.abs(tree.jacobian[:, 2]).sum(axis=2)[cell]
    low = np.maximum(tree.low[cell] - grown, layer_bounds[layer, :2])
    high = np.minimum(tree.high[cell] + grown, layer_bounds[layer, 2:])
    low, high = np.minimum(low, high), np.maximum(low, high)
    points = _sample_points(low, high)
    matrix = local_to_layer[layer]
    mapped = points @ matrix[:, :2] + matrix[:, 2:]
    w = mapped[..., 2]
    front = w > 0
    safe_w = np.where(front, w, 1.0)
    uv = mapped[..., :2] / safe_w[..., None]
    jacobian = np.swapaxes(matrix[:, None, :2, :2], -1, -2) - uv[..., :, None] * matrix[:, None, None, :2, 2]
    jacobian = jacobian * (sizes[layer][:, None, :] / safe_w[..., None])[..., None]
    most = np.broadcast_to(anisotropy, len(local_to_layer))[layer, None, None]
    lods, probes = _lod(jacobian[:, :, None] @ tree.jacobian[cell][:, None], most)
    lod_low = np.where(front, lods.min(axis=2), np.inf).min(axis=1) - _LOD_MARGIN
    lod_high = np.where(front, lods.max(axis=2), np.inf).max(axis=1) + _LOD_MARGIN
    whole = ~front.all(axis=1)[:, None]
    uv_low = np.where(whole, 0.0, uv.min(axis=1))
    uv_high = np.where(whole, 1.0, uv.max(axis=1))
    return PairView(cell, layer, np.minimum(lod_low, lod_high), lod_high, uv_low, uv_high, probes.max(axis=(1, 2)))


def pair_levels(pairs: PairView, size: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Finest and coarsest mip level that each pair shows, (K,) each; `size` (N, 2) is that of each layer's image."""
    last = np.array([int(max(each)).bit_length() - 1 for each in size], np.int64)[pairs.layer]
    last = np.minimum(last, MAX_LEVELS - 1)
    finest = np.floor(pairs.lod_low).clip(0, last).astype(np.int64)
    return finest, (np.floor(pairs.lod_high) + 1).clip(0, last).astype(np.int64)


def _sample_points(low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, 5, 2): corners and centre."""
    other = np.stack([np.stack([high[:, 0], low[:, 1]], 1), np.stack([low[:, 0], high[:, 1]], 1)], axis=1)
    return np.concatenate([low[:, None], high[:, None], other, (low + high)[:, None] / 2], axis=1)


def _lod(
    jacobian: NDArray[np.float64], anisotropy: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mip level and probes of footprints, texels of level 0 per pixel, as shaders/common_footprint.glsl has them."""
    dx, dy = jacobian[..., 0], jacobian[..., 1]
    a, b, c = (dx * dx).sum(-1), (dy * dy).sum(-1), (dx * dy).sum(-1)
    half_difference = (a - b) / 2
    major = np.sqrt((a + b) / 2 + np.sqrt(half_difference**2 + c * c))
    major = np.maximum(major, 1e-150)
    minor = np.abs(dx[..., 0] * dy[..., 1] - dx[..., 1] * dy[..., 0]) / major
    probes = np.clip(np.ceil(major / np.maximum(minor, 1e-150) - 0.25), 1, anisotropy)
    return np.log2(np.maximum(np.maximum(minor, major / anisotropy), 1e-30)), probes


@dataclass(frozen=True, eq=False)
class Windows:
    """Needed texels per image and level: half-open [x0, x1) x [y0, y1), y down from the top; empty where x1 <= x0.

    `box` is (S, L, 4) int64: x0, y0, x1, y1.
    """

    box: NDArray[np.int64]

    def texels(self) -> NDArray[np.int64]:
        """(S, L), with the border of one texel that every stored rectangle has."""
        extent = self.box[..., 2:] - self.box[..., :2]
        return np.where((extent > 0).all(-1), (extent + 2).prod(-1), 0)

    @classmethod
    def empty(cls, images: int) -> Windows:
        """Nothing needed yet."""
        big = np.iinfo(np.int32).max
        return cls(np.broadcast_to(np.array([big, big, -1, -1]), (images, MAX_LEVELS, 4)).copy())

    def add(
        self,
        image: NDArray[np.int64],
        levels: tuple[NDArray[np.int64], NDArray[np.int64]],
        uv: tuple[NDArray[np.float64], NDArray[np.float64]],
        sizes: NDArray[np.int64],
        whole: NDArray[np.bool_],
    ) -> None:
        """Unite with the windows of pairs.

        Parameters
        ----------
        image : (K,) int
        levels : (K,), (K,) int
            Finest and coarsest, both included.
        uv : (K, 2), (K, 2)
            Bounds in [0, 1]^2, t up.
        sizes : (S, 2) int
            Level 0.
        whole : (S, 2) bool
            Axes along which an image is always kept whole (because it repeats).
        """
        finest, coarsest = levels
        for step in range(int((coarsest - finest).max(initial=-1)) + 1):
            at = np.flatnonzero(finest + step <= coarsest)
            level, number = finest[at] + step, image[at]
            size = np.maximum(sizes[number] >> level[:, None], 1)
            low = np.stack([uv[0][at, 0], 1 - uv[1][at, 1]], axis=1) * size
            high = np.stack([uv[1][at, 0], 1 - uv[0][at, 1]], axis=1) * size
            first = np.floor(low.clip(0, size)).astype(np.int64) - _WINDOW_MARGIN
            last = np.ceil(high.clip(0, size)).astype(np.int64) + _WINDOW_MARGIN
            keep_all = whole[number] & ((low < 0) | (high > size))
            first = np.where(keep_all, 0, first).clip(0, size - 1)
            last = np.where(keep_all, size, last).clip(1, size)
            np.minimum.at(self.box, (number, level), np.concatenate([first, np.full_like(first, 2**31 - 1)], axis=1))
            np.maximum.at(self.box, (number, level), np.concatenate([np.full_like(first, -1), last], axis=1))


def drop_levels(
    windows: Windows,
    sizes: NDArray[np.int64],
    bytes_per_texel: NDArray[np.int64],
    budget: float,
    last: NDArray[np.int64] | None = None,
    largest: int = 2**31 - 1,
) -> tuple[NDArray[np.int64], int]:
    """Replace the finest levels of the costliest images by coarser ones, in place, until the rest fits.

    First every window wider or higher than a texture can be makes way for the next coarser one, whatever the budget.

    Parameters
    ----------
    windows : Windows
        Changed: a level that is left out hands its window to the next coarser one.
    sizes : (S, 2) int
        Level 0.
    bytes_per_texel : (S,) int
    budget : float
        Bytes. Where even the coarsest levels exceed it, those stay.
    last : (S,) int, optional
        Coarsest level of each image; default that of one texel.
    largest : int
        Most texels along an axis of a stored window, its border included.

    Returns
    -------
    finest : (S,) int64
        Finest level that each image may have.
    dropped : int
        How many levels were left out.
    """
    if last is None:
        last = np.array([int(max(size)).bit_length() - 1 for size in sizes], np.int64)
    last = np.minimum(last, MAX_LEVELS - 1)
    finest = np.zeros(len(last), np.int64)
    dropped = _drop_too_long(windows, sizes, last, finest, largest)
    cost = windows.texels() * bytes_per_texel[:, None]
    total = int(cost.sum())
    heap = [(-int(cost[image].max()), image) for image in range(len(cost)) if cost[image].any()]
    heapq.heapify(heap)
    while total > budget and heap:
        _, image = heapq.heappop(heap)
        level = int(np.flatnonzero(cost[image])[0])
        if level >= last[image]:
            continue
        before = int(cost[image].sum())
        _halve_window(windows.box[image], level, sizes[image])
        cost[image] = Windows(windows.box[image : image + 1]).texels()[0] * bytes_per_texel[image]
        finest[image] = level + 1
        total += int(cost[image].sum()) - before
        dropped += 1
        heapq.heappush(heap, (-int(cost[image].max()), image))
    return finest, dropped


def _drop_too_long(
    windows: Windows, sizes: NDArray[np.int64], last: NDArray[np.int64], finest: NDArray[np.int64], largest: int
) -> int:
    dropped = 0
    for level in range(MAX_LEVELS - 1):
        extent = (windows.box[:, level, 2:] - windows.box[:, level, :2]).max(axis=1) + 2
        for image in np.flatnonzero((extent > largest) & (level < last)):
            _halve_window(windows.box[image], level, sizes[image])
            finest[image] = level + 1
            dropped += 1
    return dropped


def _halve_window(boxes: NDArray[np.int64], level: int, size: NDArray[np.int64]) -> None:
    """Move the window of `level` into the next coarser one."""
    coarse_size = np.maximum(size >> (level + 1), 1)
    low = (boxes[level, :2] // 2 - 1).clip(0, coarse_size - 1)
    high = ((boxes[level, 2:] + 1) // 2 + 1).clip(1, coarse_size)
    boxes[level + 1, :2] = np.minimum(boxes[level + 1, :2], low)
    boxes[level + 1, 2:] = np.maximum(boxes[level + 1, 2:], high)
    boxes[level] = [2**31 - 1, 2**31 - 1, -1, -1]
