"""Sides for pictures whose alpha does not tell them: regions, and which boundaries between them to keep.

A pinchmap knows two sides. The picture is cut into regions whose boundaries are worth a discontinuity, the regions'
graph is given two sides so that the strongest and longest boundaries lie between different ones (`two_sides`), and the
boundary is then placed at sub-pixel accuracy (`pinchmap_soft_side`). Boundaries between regions of one side are lost,
which where three regions meet cannot be helped; they are listed.

- ``auto``: watershed basins (OpenCV) of the reduced picture, one from each place where its gradient is least, merged
  while they differ by less than `_VISIBLE` (`region_graph`).
- a number: so many colours (k-means), whose connected parts are the regions. With 2 no boundary is lost.
- labels from elsewhere: `label_sides`.

All of it is done on `region_features`, reduced to 512 pixels but for the placing of the boundary.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel_tools.pinchmap_soft_side import soft_side
from fexel_tools.region_features import RegionFeatures
from fexel_tools.region_graph import RegionGraph, absorb_regions, build_graph, merge_regions
from fexel_tools.region_seeds import basins, color_parts, connected_parts
from fexel_tools.two_sides import two_sides

__all__ = ["LostBoundary", "RegionSides", "label_sides", "region_sides"]

_VISIBLE = 10.0  # CIELAB units: a step that is worth a discontinuity
_LEAST_ACROSS = 1.25  # texels: of a region of less area than its square nothing is seen
_LEAST_WIDTH = 1.3  # texels: a region that is narrower everywhere breaks into beads
_ROUNDS = 4  # of joining narrow regions; the union of two may be narrow still
_MOST_REGIONS = 200


@dataclass(frozen=True)
class LostBoundary:
    """A boundary between regions that have come to lie on one side.

    Attributes
    ----------
    x, y : float
        Its middle, pixels of the source, y down.
    length_px : float
        Pixels of the source.
    contrast : float
        Of the step across it: CIELAB units, degrees between normals.
    """

    x: float
    y: float
    length_px: float
    contrast: float


@dataclass(frozen=True)
class RegionSides:
    """The side of each pixel, and what that could not express.

    Attributes
    ----------
    side : (H, W) float32
    regions : int
    kept : float
        Share of the boundaries that is kept, by length times contrast; 1 where there is none.
    lost : tuple of LostBoundary
        The heaviest first.
    """

    side: NDArray[np.float32]
    regions: int
    kept: float
    lost: tuple[LostBoundary, ...]


def region_sides(
    color: NDArray[np.float32],
    opacity: NDArray[np.float32],
    *,
    colors: int | None = None,
    is_data: bool = False,
    texels: int = 48,
    seed: int = 0,
) -> RegionSides:
    """Find regions and give them two sides.

    Parameters
    ----------
    color : (H, W, 3) float32
        Linear Rec.709, straight; stored values where `is_data`. Finite.
    opacity : (H, W) float32
    colors : int, optional
        How many colours to tell apart; default: boundaries are found by themselves.
    is_data : bool
        A normal map, or other data.
    texels : int
        Of the pinchmap, along its longer side: regions that are too small or too narrow for it are left out.
    seed : int

    Returns
    -------
    RegionSides
        The side that most of the picture's border is on is 0. A picture without boundaries: side 0 everywhere.
    """
    picture = RegionFeatures(color, opacity, is_data)
    features = picture.features()
    labels = basins(features) if colors is None else color_parts(features, colors, seed)
    graph = build_graph(labels, features)
    texel_px = max(labels.shape) / texels
    least_area = (_LEAST_ACROSS * texel_px) ** 2
    threshold = _VISIBLE if colors is None else 0.0
    graph, number = merge_regions(graph, threshold, least_area, _MOST_REGIONS)
    graph, labels = _without_narrow(graph, number[labels], _LEAST_WIDTH * texel_px)
    graph, number = merge_regions(graph, threshold, least_area, _MOST_REGIONS)  # what the narrow ones kept apart
    labels = number[labels]
    weight = graph.length * graph.contrast
    chosen = two_sides(len(graph.area), graph.edges, weight, seed)
    side = soft_side(_background_is_0(chosen[labels]), picture.mixtures(), picture.gather, opacity.shape)
    return RegionSides(side, len(graph.area), *_losses(graph, weight, chosen, labels, opacity.shape))


def _without_narrow(
    graph: RegionGraph, labels: NDArray[np.int32], least_width: float
) -> tuple[RegionGraph, NDArray[np.int32]]:
    """Regions that are nowhere as wide as `least_width`, pixels, joined with the neighbour they differ from least."""
    for _ in range(_ROUNDS):
        narrow = _widths(labels, len(graph.area)) < least_width
        if not narrow.any() or not len(graph.edges):
            break
        graph, number = absorb_regions(graph, narrow)
        labels = number[labels]
    return graph, labels


def _widths(labels: NDArray[np.int32], count: int) -> NDArray[np.float64]:
    """(R,) diameter of the largest disc within each region, pixels; the picture's border does not count."""
    kernel = np.ones((3, 3), np.uint8)
    values = labels.astype(np.float32)
    inside = (cv2.dilate(values, kernel) == cv2.erode(values, kernel)).astype(np.uint8)
    distance = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_5)  # 0 at the pixels beside a boundary
    radius = np.zeros(count)
    np.maximum.at(radius, labels.ravel(), distance.ravel())
    return 2 * radius + 1


def label_sides(
    labels: NDArray[np.int32],
    color: NDArray[np.float32],
    opacity: NDArray[np.float32],
    *,
    is_data: bool = False,
    seed: int = 0,
) -> RegionSides:
    """Give two sides to regions that are known.

    Parameters
    ----------
    labels : (h, w) int32
        0..L-1, each of which occurs; connected parts of one label are regions. Any size.
    color, opacity, is_data
        The picture, as of `region_sides`: which boundaries are strong.
    seed : int

    Returns
    -------
    RegionSides
        The boundary runs along the labels' pixels, however fine the picture is.
    """
    features = RegionFeatures(color, opacity, is_data).features()
    height, width = labels.shape
    features = cv2.resize(features, (width, height), interpolation=cv2.INTER_LINEAR)
    parts = connected_parts(labels)
    graph = build_graph(parts, features)
    weight = graph.length * (graph.contrast + _VISIBLE)  # a boundary that someone drew counts, seen or not
    chosen = two_sides(len(graph.area), graph.edges, weight, seed)
    coarse = _background_is_0(chosen[parts]).astype(np.float32)
    shrinks = height > opacity.shape[0]
    interpolation = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    side = cv2.resize(coarse, opacity.shape[::-1], interpolation=interpolation)
    return RegionSides(side, len(graph.area), *_losses(graph, weight, chosen, parts, opacity.shape))


def _background_is_0(side: NDArray[np.bool_]) -> NDArray[np.bool_]:
    border = np.concatenate([side[0], side[-1], side[:, 0], side[:, -1]])
    return ~side if border.mean() > 0.5 else side


def _losses(
    graph: RegionGraph,
    weight: NDArray[np.float64],
    side: NDArray[np.bool_],
    labels: NDArray[np.int32],
    shape: tuple[int, int],
) -> tuple[float, tuple[LostBoundary, ...]]:
    same = side[graph.edges[:, 0]] == side[graph.edges[:, 1]]
    scale = shape[0] / labels.shape[0]
    lost = np.flatnonzero(same)
    lost = lost[np.argsort(-weight[lost], kind="stable")]
    places = _middles(labels, graph.edges[lost], len(graph.area))
    found = tuple(
        LostBoundary(float(x) * scale, float(y) * scale, float(graph.length[edge]) * scale, float(contrast))
        for edge, (x, y), contrast in zip(lost, places, graph.contrast[lost], strict=True)
    )
    return 1.0 - float(weight[same].sum()) / max(float(weight.sum()), 1e-12), found  # 1e-12 guards a single region


def _middles(labels: NDArray[np.int32], edges: NDArray[np.int64], count: int) -> list[tuple[float, float]]:
    """(x, y) of the place on each boundary that is nearest to the mean of its places; pixels, corner (0, 0)."""
    places, keys = [], []
    for axis, middle in ((0, (0.5, 1.0)), (1, (1.0, 0.5))):  # a place lies between two pixels
        first, second = (labels[:-1], labels[1:]) if axis == 0 else (labels[:, :-1], labels[:, 1:])
        row, column = np.nonzero(first != second)
        ends = np.stack([first[row, column], second[row, column]], axis=1).astype(np.int64)
        places.append(np.stack([column + middle[0], row + middle[1]], axis=1))
        keys.append(ends.min(axis=1) * count + ends.max(axis=1))
    place, key = np.concatenate(places), np.concatenate(keys)
    found = []
    for wanted in (edges[:, 0] * count + edges[:, 1]).tolist():
        own = place[key == wanted]
        x, y = own[np.argmin(((own - own.mean(axis=0)) ** 2).sum(axis=1))]
        found.append((float(x), float(y)))
    return found
