"""Sides for pictures whose alpha does not tell them: regions, and which boundaries between them to keep.

A pinchmap knows two sides. The picture is cut into regions whose boundaries are worth a discontinuity, the regions'
graph is given two sides so that the strongest and longest boundaries lie between different ones (`two_sides`), and the
boundary is then placed at sub-pixel accuracy (`pinchmap_soft_side`). Boundaries between regions of one side are lost,
which where three regions meet cannot be helped; they are listed.

- ``auto``: watershed basins (OpenCV) of the reduced picture, one from each place where its gradient is least, merged
  while they differ by less than `_VISIBLE` (`region_graph`).
- a number: so many colours (k-means), whose connected parts are the regions. With 2 no boundary is lost.
- an image of labels: `label_sides`.

Features are CIELAB, multiplied by alpha, and transparency as a fourth of the same range; of normal maps the normals in
degrees of angle; of other data the values in per cent of their range.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel.images import linear_to_srgb
from fexel_tools.pinchmap_soft_side import soft_side
from fexel_tools.region_graph import RegionGraph, build_graph, merge_regions
from fexel_tools.two_sides import two_sides

__all__ = ["LostBoundary", "RegionSides", "region_sides"]

_COARSE_PX = 512  # longer side of what is segmented
_VISIBLE = 10.0  # CIELAB units: a step that is worth a discontinuity
_FLAT = 1.5  # CIELAB units a pixel: a place without an edge
_LEAST_AREA = 1 / 40  # of the longer side, squared: smaller than a texel of the usual maps
_MOST_REGIONS = 200
_DEGREES = 180 / np.pi


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
    seed : int

    Returns
    -------
    RegionSides
        The side that most of the picture's border is on is 0. A picture without boundaries: side 0 everywhere.
    """
    picture = _Picture(color, opacity, is_data)
    features = picture.features()
    seeds = _basins(features) if colors is None else _clusters(features, colors, seed)
    labels = _flooded(features, seeds)
    graph = build_graph(labels, features)
    least_area = (max(labels.shape) * _LEAST_AREA) ** 2
    graph, number = merge_regions(graph, _VISIBLE if colors is None else 0.0, least_area, _MOST_REGIONS)
    labels = number[labels]
    chosen = two_sides(len(graph.area), graph.edges, graph.length * graph.contrast, seed)
    coarse = _background_is_0(chosen[labels])
    side = soft_side(coarse, picture.mixtures(), picture.gather, opacity.shape)
    return RegionSides(side, len(graph.area), *_losses(graph, chosen, labels, opacity.shape))


class _Picture:
    """A picture, full and reduced, as features."""

    def __init__(self, color: NDArray[np.float32], opacity: NDArray[np.float32], is_data: bool) -> None:
        self.color, self.opacity, self.is_data = color, opacity, is_data
        self.is_opaque = bool(opacity.min() >= 1)
        height, width = opacity.shape
        scale = min(1.0, _COARSE_PX / max(height, width))
        size = (max(1, round(scale * width)), max(1, round(scale * height)))
        self.coarse_opacity = np.ones(size[::-1], np.float32) if self.is_opaque else _resized(opacity, size)
        self.coarse = _resized(color if self.is_opaque else color * opacity[..., None], size)
        if not self.is_opaque:
            self.coarse /= np.maximum(self.coarse_opacity, 1e-6)[..., None]  # 1e-6 guards transparent pixels

    def features(self) -> NDArray[np.float32]:
        """(h, w, 3 or 4) in units of `_VISIBLE`."""
        values = _data_features(self.coarse) if self.is_data else _lab(self.coarse)
        return _with_opacity(values, self.coarse_opacity, 100.0, self.is_opaque)

    def mixtures(self) -> NDArray[np.float32]:
        """(h, w, 3 or 4): what pixels at edges are mixtures of."""
        return self._mixtures(self.coarse, self.coarse_opacity)

    def gather(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.float32]:
        """`mixtures` of pixels of the full picture."""
        return self._mixtures(self.color[rows, columns], self.opacity[rows, columns])

    def _mixtures(self, color: NDArray[np.float32], opacity: NDArray[np.float32]) -> NDArray[np.float32]:
        # Anti-aliasing of drawings mixes encoded values, and half-way between those is where an edge is seen to be.
        return _with_opacity(color if self.is_data else linear_to_srgb(color), opacity, 1.0, self.is_opaque)


def _resized(plane: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    return cv2.resize(plane, size, interpolation=cv2.INTER_AREA)


def _with_opacity(
    values: NDArray[np.float32], opacity: NDArray[np.float32], full: float, is_opaque: bool
) -> NDArray[np.float32]:
    if is_opaque:
        return values
    return np.concatenate([values * opacity[..., None], np.float32(full) * (1 - opacity[..., None])], axis=-1)


def _lab(color: NDArray[np.float32]) -> NDArray[np.float32]:
    return cv2.cvtColor(np.clip(color, 0, 1), cv2.COLOR_LRGB2Lab)


def _data_features(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Normals as unit vectors times 180/pi, so that small distances are angles in degrees; else per cent of range."""
    normals = values if values.min() < 0 else 2 * values - 1
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    if np.median(np.abs(length - 1)) < 0.1:
        return (normals * (_DEGREES / np.maximum(length, 1e-6))).astype(np.float32)  # 1e-6 guards zero vectors
    span = float(values.max() - values.min())
    return (values - values.min()) * np.float32(100 / max(span, 1e-6))  # 1e-6 guards constant data


def _basins(features: NDArray[np.float32]) -> NDArray[np.int32]:
    """Seeds, numbered from 1: flat places, and the least gradient of every neighbourhood."""
    squared = np.zeros(features.shape[:2], np.float32)
    for channel in cv2.split(cv2.GaussianBlur(features, (0, 0), 1.0)):
        for dx, dy in ((1, 0), (0, 1)):
            slope = cv2.Scharr(channel, cv2.CV_32F, dx, dy, scale=1 / 32)
            squared = cv2.accumulateSquare(slope, squared)
    least = cv2.erode(squared, np.ones((5, 5), np.uint8))
    seeds = (squared <= least) | (squared < _FLAT**2)
    return cv2.connectedComponents(seeds.astype(np.uint8), connectivity=8)[1]


def _clusters(features: NDArray[np.float32], colors: int, seed: int) -> NDArray[np.int32]:
    """Seeds, numbered from 1: connected parts of one colour cluster, without the pixels at their rims."""
    pixels = features.reshape(-1, features.shape[2])
    sample = pixels[:: max(1, len(pixels) // 20000)]
    centers = _k_means(sample, colors, seed)
    squared = np.stack([((pixels - center) ** 2).sum(axis=1) for center in centers])
    cluster = np.argmin(squared, axis=0).reshape(features.shape[:2]).astype(np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    core = cv2.erode(cluster, kernel) == cv2.dilate(cluster, kernel)
    seeds = np.zeros(cluster.shape, np.int32)
    for index in range(len(centers)):
        parts = cv2.connectedComponents((core & (cluster == index)).astype(np.uint8), connectivity=4)[1]
        seeds = np.where(parts > 0, parts + seeds.max(), seeds)
    return seeds


def _k_means(sample: NDArray[np.float32], count: int, seed: int) -> NDArray[np.float32]:
    cv2.setRNGSeed(seed)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 30, 0.1)
    return cv2.kmeans(np.ascontiguousarray(sample), count, None, criteria, 3, cv2.KMEANS_PP_CENTERS)[2]


def _flooded(features: NDArray[np.float32], seeds: NDArray[np.int32]) -> NDArray[np.int32]:
    """Watershed from the seeds: every pixel gets a region, numbered 0..R-1."""
    if not seeds.any():
        return np.zeros(seeds.shape, np.int32)
    picture = cv2.copyMakeBorder(_as_uint8(features), 1, 1, 1, 1, cv2.BORDER_REPLICATE)  # it labels no border pixel
    labels = cv2.copyMakeBorder(seeds, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    cv2.watershed(picture, labels)
    labels = np.maximum(labels, 0).astype(np.float32)  # -1 where basins meet
    while labels.min() == 0:
        labels = np.where(labels > 0, labels, cv2.dilate(labels, np.ones((3, 3), np.uint8)))
    present, compact = np.unique(labels[1:-1, 1:-1], return_inverse=True)
    return compact.reshape(seeds.shape).astype(np.int32)


def _as_uint8(features: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Three channels for the watershed; transparency is darker than black."""
    three = features[..., :3] * np.float32([2, 1, 1]) + np.float32([55, 128, 128])
    if features.shape[2] == 4:
        three -= features[..., 3:] * np.float32([0.55, 1.28, 1.28])
    return np.clip(three, 0, 255).astype(np.uint8)


def _background_is_0(side: NDArray[np.bool_]) -> NDArray[np.bool_]:
    border = np.concatenate([side[0], side[-1], side[:, 0], side[:, -1]])
    return ~side if border.mean() > 0.5 else side


def _losses(
    graph: RegionGraph, side: NDArray[np.bool_], labels: NDArray[np.int32], shape: tuple[int, int]
) -> tuple[float, tuple[LostBoundary, ...]]:
    weight = graph.length * graph.contrast
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
