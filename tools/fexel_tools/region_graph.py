"""Regions of a picture as a graph: which touch, along how many pixels, how strong the step between them is; merging.

A boundary's contrast is the length of the *mean* step across it, so that texture, whose steps point every way,
averages out. Two regions are as different as the lesser of that step and of the difference of their mean features:
a smooth gradient has no step anywhere, textured ground no difference of means. Merging takes the least different pairs
first, in rounds of pairs that are each other's least different (Boruvka's rounds, as in Haxhimusa and Kropatsch,
Segmentation graph hierarchies, 2004).

Features are (H, W, F) float32 in units of a just visible difference (CIELAB, or degrees between normals).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["RegionGraph", "absorb_regions", "build_graph", "merge_regions"]

_REACH_PX = 3  # how far from a boundary the features are taken, at most: past the blur of the edge
_MUCH = 4.0  # times larger
_THRESHOLD_STEPS = (0.15, 0.3, 0.5, 0.75, 1.0)  # least different first, though pairs merge side by side


@dataclass(frozen=True)
class RegionGraph:
    """Regions 0..R-1 and the boundaries between them.

    Attributes
    ----------
    area : (R,) float64
        Pixels.
    total : (R, F) float64
        Sum of the features over a region.
    edges : (E, 2) int64
        Regions that touch, the lower number first, each pair once.
    length : (E,) float64
        Pixels along the boundary, counted as pairs of neighbouring pixels.
    step : (E, F) float64
        Sum over the boundary of features on the second region's side minus those on the first's.
    """

    area: NDArray[np.float64]
    total: NDArray[np.float64]
    edges: NDArray[np.int64]
    length: NDArray[np.float64]
    step: NDArray[np.float64]

    @property
    def contrast(self) -> NDArray[np.float64]:
        """(E,) length of the mean step across each boundary."""
        return np.linalg.norm(self.step, axis=1) / self.length

    @property
    def difference(self) -> NDArray[np.float64]:
        """(E,) lesser of the contrast and of the distance between the regions' mean features."""
        mean = self.total / self.area[:, None]
        apart = np.linalg.norm(mean[self.edges[:, 0]] - mean[self.edges[:, 1]], axis=1)
        return np.minimum(self.contrast, apart)


def build_graph(labels: NDArray[np.int32], features: NDArray[np.float32]) -> RegionGraph:
    """The graph of a labelled picture.

    Parameters
    ----------
    labels : (H, W) int32
        0..R-1, each of which occurs.
    features : (H, W, F) float32
        Finite.
    """
    flat, count = labels.ravel(), int(labels.max()) + 1
    area = np.bincount(flat, minlength=count).astype(np.float64)
    channels = features.reshape(-1, features.shape[2])
    total = np.stack([np.bincount(flat, channel, count) for channel in channels.T], axis=1)
    pairs, steps = zip(*(_crossings(labels, features, axis) for axis in (0, 1)), strict=True)
    return RegionGraph(area, total, *_summed(np.concatenate(pairs), None, np.concatenate(steps), count))


def _crossings(
    labels: NDArray[np.int32], features: NDArray[np.float32], axis: int
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Neighbouring pixels of different regions along an axis: their labels, and the step between them."""
    labels, features = np.moveaxis(labels, axis, 0), np.moveaxis(features, axis, 0)
    row, column = np.nonzero(labels[:-1] != labels[1:])
    first, second = labels[row, column], labels[row + 1, column]
    before = _reach(labels, row, column, -1)
    after = _reach(labels, row + 1, column, 1)
    return np.stack([first, second], axis=1).astype(np.int64), features[after, column] - features[before, column]


def _reach(labels: NDArray[np.int32], row: NDArray, column: NDArray, direction: int) -> NDArray[np.int64]:
    """The row farthest from the boundary, within reach, that is still in the same region."""
    own, found, inside = labels[row, column], row.copy(), np.ones(len(row), bool)
    for distance in range(1, _REACH_PX + 1):
        candidate = np.clip(row + direction * distance, 0, len(labels) - 1)
        inside &= labels[candidate, column] == own
        found[inside] = candidate[inside]
    return found


def _summed(
    pairs: NDArray[np.int64], length: NDArray[np.float64] | None, step: NDArray, count: int
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Entries of the same pair of regions, in either order, added up; pairs within a region dropped."""
    apart = pairs[:, 0] != pairs[:, 1]
    sign = np.where(pairs[:, 0] < pairs[:, 1], 1.0, -1.0)[apart]
    key = (pairs.min(axis=1) * count + pairs.max(axis=1))[apart]
    keys, group = np.unique(key, return_inverse=True)
    length = np.bincount(group, None if length is None else length[apart], len(keys)).astype(np.float64)
    columns = (step[apart] * sign[:, None]).T
    step = np.stack([np.bincount(group, column, len(keys)) for column in columns], axis=1)
    return np.stack(np.divmod(keys, count), axis=1), length, step


def merge_regions(
    graph: RegionGraph, threshold: float, least_area: float, most_regions: int
) -> tuple[RegionGraph, NDArray[np.int32]]:
    """Join regions that hardly differ, and those too small to matter with the neighbour they differ from least.

    Parameters
    ----------
    graph : RegionGraph
    threshold : float
        Pairs of `difference` below it are joined.
    least_area : float
        Pixels; of regions that stay apart each has at least so many.
    most_regions : int
        The threshold is raised until no more are left.

    Returns
    -------
    merged : RegionGraph
    number : (R,) int32
        The new number of each old region.
    """
    number = np.arange(len(graph.area))
    stages = [(part * threshold, 0.0) for part in _THRESHOLD_STEPS] + [(threshold, least_area)]
    while stages or (len(graph.area) > most_regions and len(graph.edges)):
        if not stages:
            threshold = max(1.2 * threshold, 1.05 * float(graph.difference.min()) + 1e-9)  # 1e-9: above a minimum of 0
            stages = [(threshold, least_area)]
        limit = stages.pop(0)
        while (wanted := _wanted(graph, *limit)).any():
            graph, renumbered = _joined(graph, _targets(graph, wanted))
            number = renumbered[number]
    return graph, number.astype(np.int32)


def absorb_regions(graph: RegionGraph, weak: NDArray[np.bool_]) -> tuple[RegionGraph, NDArray[np.int32]]:
    """Join each region that is marked with the neighbour that it differs from least.

    Parameters
    ----------
    graph : RegionGraph
    weak : (R,) bool

    Returns
    -------
    As `merge_regions`.
    """
    best = _least_different(graph, weak[graph.edges].any(axis=1))
    own = np.arange(len(best))
    mutual = (best[best] == own) & weak[best]
    target = np.where(weak & ~(mutual & (best > own)), best, own)
    graph, number = _joined(graph, _roots(target))
    return graph, number.astype(np.int32)


def _wanted(graph: RegionGraph, threshold: float, least_area: float) -> NDArray[np.bool_]:
    """Pairs that may be joined."""
    return (graph.difference < threshold) | (graph.area[graph.edges].min(axis=1, initial=np.inf) < least_area)


def _targets(graph: RegionGraph, wanted: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The region that each is joined to, itself for most.

    Of the pairs that may be joined each region has one that differs least. They are joined if that holds for both, or
    if the other is so much larger that the union is hardly different from it.
    """
    best = _least_different(graph, wanted)
    own = np.arange(len(best))
    mutual = best[best] == own
    joined = np.where(mutual, best < own, graph.area[best] >= _MUCH * graph.area)
    return _roots(np.where(joined, best, own))


def _least_different(graph: RegionGraph, wanted: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Each region's least different neighbour among the pairs wanted; itself where there is none."""
    edges, cost = graph.edges[wanted], graph.difference[wanted]
    both = np.concatenate([edges, edges[:, ::-1]])  # from, to
    rank = np.empty(len(cost), np.int64)
    rank[np.argsort(cost, kind="stable")] = np.arange(len(cost))
    order = np.argsort(-np.concatenate([rank, rank]), kind="stable")
    best = np.arange(len(graph.area))
    best[both[order, 0]] = both[order, 1]  # the last assignment stays: the least different
    return best


def _roots(target: NDArray[np.int64]) -> NDArray[np.int64]:
    while (target[target] != target).any():
        target = target[target]
    return target


def _joined(graph: RegionGraph, target: NDArray[np.int64]) -> tuple[RegionGraph, NDArray[np.int64]]:
    """The graph with every region joined to its target, and the regions' new numbers."""
    roots, renumbered = np.unique(target, return_inverse=True)
    area = np.bincount(renumbered, graph.area)
    total = np.stack([np.bincount(renumbered, column) for column in graph.total.T], axis=1)
    return RegionGraph(area, total, *_summed(renumbered[graph.edges], graph.length, graph.step, len(roots))), renumbered
