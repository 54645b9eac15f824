"""A first division of a picture into regions: watershed basins, or connected parts of colour clusters (OpenCV)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["basins", "color_parts", "connected_parts"]

_FLAT = 1.5  # CIELAB units a pixel: a place without an edge


def basins(features: NDArray[np.float32]) -> NDArray[np.int32]:
    """Watershed basins: a region around every flat place and every least gradient of a neighbourhood.

    Parameters
    ----------
    features : (H, W, 3 or 4) float32
        From `region_features`.

    Returns
    -------
    (H, W) int32
        0..R-1, connected.
    """
    squared = np.zeros(features.shape[:2], np.float32)
    for channel in cv2.split(cv2.GaussianBlur(features, (0, 0), 1.0)):
        for dx, dy in ((1, 0), (0, 1)):
            slope = cv2.Scharr(channel, cv2.CV_32F, dx, dy, scale=1 / 32)
            squared = cv2.accumulateSquare(slope, squared)
    least = cv2.erode(squared, np.ones((5, 5), np.uint8))
    seeds = (squared <= least) | (squared < _FLAT**2)
    return _flooded(features, cv2.connectedComponents(seeds.astype(np.uint8), connectivity=8)[1])


def color_parts(features: NDArray[np.float32], colors: int, seed: int) -> NDArray[np.int32]:
    """Connected parts of colour clusters; mixed colours at their rims go to the part they are more like.

    Parameters
    ----------
    features : (H, W, 3 or 4) float32
        From `region_features`.
    colors : int
        Clusters.
    seed : int

    Returns
    -------
    (H, W) int32
        0..R-1, connected.
    """
    pixels = features.reshape(-1, features.shape[2])
    sample = pixels[:: max(1, len(pixels) // 20000)]
    centers = _k_means(sample, colors, seed)
    squared = np.stack([((pixels - center) ** 2).sum(axis=1) for center in centers])
    cluster = np.argmin(squared, axis=0).reshape(features.shape[:2]).astype(np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    core = cv2.erode(cluster, kernel) == cv2.dilate(cluster, kernel)
    seeds = np.where(core, connected_parts(cluster.astype(np.int32)) + 1, 0).astype(np.int32)
    if not core.any():
        return connected_parts(cluster.astype(np.int32))
    flooded = _flooded(features, seeds)
    cluster_of = np.zeros(int(flooded.max()) + 1, np.int32)
    cluster_of[flooded[core]] = cluster[core]
    return connected_parts(cluster_of[flooded])


def connected_parts(labels: NDArray[np.int32]) -> NDArray[np.int32]:
    """Number the connected parts of every label.

    Parameters
    ----------
    labels : (H, W) int32
        At least 0.

    Returns
    -------
    (H, W) int32
        0..R-1; parts are connected along pixel edges.
    """
    parts = np.zeros(labels.shape, np.int32)
    count = 0
    for label in range(int(labels.max()) + 1):
        found, own = cv2.connectedComponents((labels == label).astype(np.uint8), connectivity=4)
        parts = np.where(own > 0, own + (count - 1), parts)
        count += found - 1
    return parts


def _k_means(sample: NDArray[np.float32], count: int, seed: int) -> NDArray[np.float32]:
    cv2.setRNGSeed(seed & 0x7FFFFFFF)  # it takes a signed int
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 30, 0.1)
    count = min(count, len(sample))
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
    compact = np.unique(labels[1:-1, 1:-1], return_inverse=True)[1]
    return compact.reshape(seeds.shape).astype(np.int32)


def _as_uint8(features: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Three channels for the watershed; transparency is darker than black."""
    three = features[..., :3] * np.float32([2, 1, 1]) + np.float32([55, 128, 128])
    if features.shape[2] == 4:
        three -= features[..., 3:] * np.float32([0.55, 1.28, 1.28])
    return np.clip(three, 0, 255).astype(np.uint8)
