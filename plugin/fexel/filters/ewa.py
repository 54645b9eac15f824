"""The elliptical weighted average, in float64 NumPy: the quality reference, and the oracle of shaders/filter_ewa.glsl.

A round Gaussian of a standard deviation of half a pixel, brought into texture space by the Jacobian (Heckbert,
"Fundamentals of Texture Mapping and Image Warping", 1989, chapter 3; Greene and Heckbert 1986): every texel within the
ellipse at `RADIUS` standard deviations counts, by its weight. There is no limit to the taps but `MOST_RATIO`: 3400 at
an elevation of 0.1 degrees. What is averaged is the texture as it is when magnified, bilinear between texel centres, of
a variance of 1/6 texel^2. A mip level has been averaged by a box already: the Gaussian is narrower by that variance.

So the level may be chosen for few taps: the coarsest of which the minor axis still spans `LEAST_MINOR` texels. Where
a texel covers more than a pixel a Gaussian is not what lies between texel centres; there the lookup is bilinear.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.textures.footprint import Footprint
from fexel.textures.pinchmap_lattice import trilinear

__all__ = ["LEAST_MINOR", "MOST_RATIO", "RADIUS", "REACH", "Ellipse", "lods", "sample"]

RADIUS = 2.0
"""Standard deviations at which the Gaussian is cut off, as is usual."""

REACH = RADIUS / 2
"""How far a lookup sees from its place, in pixels; and a texel further."""

LEAST_MINOR = 1.5
"""Texels of a level that the minor axis spans at least, beyond level 0."""

MOST_RATIO = 1024.0
"""Of major to minor axis; a longer ellipse (an elevation under 0.06 degrees) is as wide as that: it bounds the taps."""

_LARGEST = 1e9  # texels per pixel: more, or not a number, is the whole image; its fourth power is a float32 still
_BLOCK = 1 << 20  # taps at once


@dataclass(frozen=True, eq=False)
class Ellipse:
    """Gaussians in texels of a mip level.

    Attributes
    ----------
    level : (M,) int64
    xx, xy, yy : (M,) float64
        Covariance, texels^2 of that level.
    determinant : (M,) float64
        Of the covariance, from that of the Jacobian: its digits are not lost between long and short axis.
    magnified : (M,) float64
        1 where only the bilinear lookup counts, 0 where only the Gaussian does.
    """

    level: NDArray[np.int64]
    xx: NDArray[np.float64]
    xy: NDArray[np.float64]
    yy: NDArray[np.float64]
    determinant: NDArray[np.float64]
    magnified: NDArray[np.float64]

    @classmethod
    def of(cls, jacobian: NDArray[np.float64], sizes: NDArray[np.int64]) -> Ellipse:
        """Ellipses of pixels.

        Parameters
        ----------
        jacobian : (M, 2, 2) float64
            d(texel)/d(pixel) at level 0; any value, not finite ones included.
        sizes : (L, 2) int
            Width and height of the mip levels.
        """
        jacobian = _usable(jacobian)
        footprint = Footprint.of(jacobian)
        minor = np.maximum(footprint.minor, footprint.major / MOST_RATIO)
        lod = _lod(minor)
        level = np.clip(np.floor(lod), 0, len(sizes) - 1).astype(np.int64)
        # A footprint of more than the image is one of the coarsest level, which is constant but for its border.
        shrink = np.exp2(np.minimum(len(sizes) - lod, 0.0))
        scale = sizes[level] / sizes[0]  # texels of the level per texel of level 0
        axes = jacobian * (scale * shrink[:, None])[:, :, None]
        widened = ((minor**2 - footprint.minor**2) * shrink**2 / 4)[:, None] * scale**2
        extra = widened + scale**2 / 4 - 1 / 12  # bilinear in texels of level 0, less the box of the level
        xx, xy, yy = (0.25 * np.sum(axes[:, i] * axes[:, j], axis=1) for i, j in ((0, 0), (0, 1), (1, 1)))
        area = 0.25 * (axes[:, 0, 0] * axes[:, 1, 1] - axes[:, 0, 1] * axes[:, 1, 0])
        determinant = area**2 + extra[:, 1] * xx + extra[:, 0] * yy + extra[:, 0] * extra[:, 1]
        magnified = np.clip(2.0 - 2.0 * footprint.major, 0.0, 1.0)
        return cls(level, xx + extra[:, 0], xy, yy + extra[:, 1], determinant, magnified)


def lods(jacobian: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Finest and coarsest real-valued mip levels, (M,) both, that are read of (M, 2, 2), in texels per pixel."""
    footprint = Footprint.of(_usable(jacobian))
    lod = _lod(np.maximum(footprint.minor, footprint.major / MOST_RATIO))
    return lod, lod


def sample(
    levels: Sequence[NDArray[np.floating]],
    wrap: tuple[str, str],
    xy: NDArray[np.float64],
    jacobian: NDArray[np.float64],
    radius: float = RADIUS,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Look an image up.

    Parameters
    ----------
    levels : sequence of (H, W, C)
        Mip levels, linear, premultiplied, row 0 at the top.
    wrap : (str, str)
        ``repeat``, ``mirror``, ``black`` (zero outside), else clamp; along x and y.
    xy : (M, 2) float64
        Texels of level 0, y down.
    jacobian : (M, 2, 2) float64
        d(texel)/d(pixel), column j per pixel along x, y.
    radius : float
        Standard deviations at which the Gaussian is cut off: the usual 2 leave out 1/7 of its volume, 3 leave out 1/90.

    Returns
    -------
    values : (M, C) float64
    fetches : (M,) int64
        Texels looked at.
    """
    sizes = np.array([[level.shape[1], level.shape[0]] for level in levels], np.int64)
    ellipse = Ellipse.of(jacobian, sizes)
    place = np.nan_to_num(xy) / sizes[0]
    center = place * sizes[ellipse.level]
    values = np.zeros((len(xy), levels[0].shape[2]))
    weights = np.zeros(len(xy))
    fetches = np.zeros(len(xy), np.int64)
    for pixel, taps, weight in _taps(ellipse, center, radius):
        st = taps / sizes[ellipse.level[pixel]]
        texels = trilinear(levels, np.stack([st[:, 0], 1 - st[:, 1]], 1), ellipse.level[pixel].astype(float), wrap)
        np.add.at(values, pixel, weight[:, None] * texels)
        np.add.at(weights, pixel, weight)
        np.add.at(fetches, pixel, 1)
    values /= weights[:, None]
    near = np.flatnonzero(ellipse.magnified > 0)
    if len(near):
        bilinear = trilinear(levels, np.stack([place[near, 0], 1 - place[near, 1]], 1), np.zeros(len(near)), wrap)
        values[near] += ellipse.magnified[near, None] * (bilinear - values[near])
        fetches[near] += 4
    return values, fetches


def _usable(jacobian: NDArray[np.float64]) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore"):
        fits = (np.abs(jacobian) < _LARGEST).all(axis=(1, 2), keepdims=True)
    return np.where(fits, jacobian, _LARGEST * np.eye(2))


def _lod(minor: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.log2(np.maximum(minor / LEAST_MINOR, 1e-30))  # 1e-30 keeps log2 finite on a degenerate footprint


_Taps = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]


def _taps(ellipse: Ellipse, center: NDArray[np.float64], radius: float) -> Iterator[_Taps]:
    """Blocks of (pixel (T,), texel centre (T, 2), weight (T,))."""
    across, slope = np.sqrt(ellipse.yy), ellipse.xy / ellipse.yy
    spread = np.sqrt(ellipse.determinant / ellipse.yy)  # standard deviation along a row
    first = np.ceil(center[:, 1] - radius * across - 0.5)
    last = np.floor(center[:, 1] + radius * across - 0.5)
    pixel, row = _runs(np.arange(len(center)), first, last)
    down = row + 0.5 - center[pixel, 1]
    height = down / across[pixel]
    mean = center[pixel, 0] + slope[pixel] * down
    half = spread[pixel] * np.sqrt(np.maximum(radius**2 - height**2, 0.0))
    start, end = np.ceil(mean - half - 0.5), np.floor(mean + half - 0.5)
    counted = np.cumsum(np.maximum(end - start + 1, 0))
    for block in range(int(counted[-1] // _BLOCK) + 1 if len(counted) else 0):
        rows = np.flatnonzero((counted > block * _BLOCK) & (counted <= (block + 1) * _BLOCK))
        which, column = _runs(rows, start[rows], end[rows])
        along = (column + 0.5 - mean[which]) / spread[pixel[which]]
        weight = np.exp(-0.5 * (along**2 + height[which] ** 2))
        yield pixel[which], np.stack([column, row[which]], 1) + 0.5, weight


def _runs(
    owner: NDArray[np.int64], first: NDArray[np.float64], last: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Whole numbers from `first` to `last`, both included, and whose each is."""
    count = np.maximum(last - first + 1, 0).astype(np.int64)
    before = np.cumsum(count) - count
    return np.repeat(owner, count), np.arange(count.sum()) - np.repeat(before, count) + np.repeat(first, count)
