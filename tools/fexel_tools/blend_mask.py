"""Gradient-density blend mask of a patch: eqs. (2) and (3) of Eisemann and Magnor 2010, *Zipmaps*, section 4.

A patch fades in along the image's own texture: where little happens near its border the transition is wide, an edge
ends it. For each channel

- eq. (2): ``g = |I_x| + |I_y|``, central differences (half the difference of the two neighbours; a neighbour outside
  the image or not valid is replaced by the pixel itself);
- the gradient-density map ``gdm(p)`` is the least sum of g over the pixels of a path from p to the border, p included
  and the border pixel not, over the 8 neighbours of a pixel, a diagonal step costing no more than a straight one. It is
  0 on the border itself: the outermost rows and columns, and every pixel that is not valid;
- eq. (3): ``alpha = min(1, max over channels of gdm / tau)``.

Costs are sums of integers (the unit is 2^-29 of tau), so that a path's cost has no rounding and does not depend on the
order of evaluation (`path_cost`). Where a path would cost more than tau it is not followed, which leaves alpha exact.
Channels run in parallel.

tau is in units of accumulated gradient and so depends on contrast, noise and size of the image. The automatic tau asks
for a width instead: half of the pixels at depth `ramp_px` from the border are opaque. It scales with the image's
contrast, hence alpha does not change with it.

Values are best display-encoded (sRGB, [0, 1]): equal steps then look about equally strong, in shadows as in lights.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Lock

import cv2
import numpy as np

from fexel.errors import FexelError
from fexel_tools.path_cost import LIMIT, cost_bound, gradient, integer_costs, path_costs

__all__ = ["BlendMask", "blend_mask", "default_ramp", "gradient_density", "gradient_map"]

_WORKERS = 2
_MANY_PIXELS = 24_000_000  # beyond, one channel at a time: each takes 17 bytes per pixel


@dataclass(frozen=True, eq=False)
class BlendMask:
    """A blend mask and the threshold that made it.

    Attributes
    ----------
    alpha : (H, W) float32
        In [0, 1]; 0 on the border and on pixels that are not valid.
    tau : float
        Threshold of eq. (3), in units of accumulated gradient of the given values; 0 for an image without gradient.
    """

    alpha: np.ndarray
    tau: float


def blend_mask(
    image: np.ndarray, *, tau: float | None = None, ramp_px: float | None = None, valid: np.ndarray | None = None
) -> BlendMask:
    """Blend mask of a patch by eqs. (2) and (3).

    Parameters
    ----------
    image : (H, W) or (H, W, C) uint8, uint16 or float
        Display-encoded; integers are scaled to [0, 1]. Non-finite pixels are not valid.
    tau : float, optional
        Threshold > 0, accumulated gradient of values in [0, 1]. Default: automatic, see `ramp_px`.
    ramp_px : float, optional
        Depth in pixels at which half of the pixels shall be opaque, for the automatic tau. Default `default_ramp`.
    valid : (H, W) bool, optional
        Pixels that show something; the others get alpha 0 and count as border. Default: all.

    Returns
    -------
    BlendMask
        With a given tau an image without any gradient is transparent, as eq. (3) says. With the automatic tau eq. (3)
        is 0/0 where the whole ring at `ramp_px` is reached without crossing any gradient, and its limit for vanishing
        uniform texture is taken: alpha is the distance to the border over `ramp_px`, at most 1. An image of fewer than
        three rows or columns is all border: alpha 0.

    Raises
    ------
    FexelError
        For a tau that is not positive and finite, or arrays of the wrong shape.
    """
    if tau is not None and not (np.isfinite(tau) and tau > 0):
        raise FexelError(f"blend mask: tau is {tau}, expected a positive finite number")
    channels = _channels(image)
    invalid = _invalid(channels, valid)
    height, width = channels[0].shape
    border = _border(invalid, (height, width))
    depth = max(1, round(default_ramp(height, width) if ramp_px is None else ramp_px))
    if border.all():
        return BlendMask(np.zeros((height, width), np.float32), tau or 0.0)
    if tau is None:
        depth = min(depth, (min(height, width) - 1) // 2)
        limit = _straight_cost(channels, invalid, depth)
        if limit == 0:
            return BlendMask(_distance_ramp(border, depth), 0.0)
        densest = _densest(channels, invalid, limit)
        tau = _typical(densest[_depth_ring(height, width, depth)])
        if tau == 0:
            return BlendMask(_distance_ramp(border, depth), 0.0)
    else:
        densest = _densest(channels, invalid, tau)
    densest *= np.float32(1 / tau)
    return BlendMask(np.minimum(densest, np.float32(1), out=densest), float(tau))


def default_ramp(height: int, width: int) -> float:
    """Depth in pixels of the automatic transition: a sixteenth of the shorter side."""
    return min(height, width) / 16


def gradient_map(channel: np.ndarray, valid: np.ndarray | None = None) -> np.ndarray:
    """Eq. (2) for one channel (H, W): (H, W) float32, 0 on the outermost pixels and on pixels that are not valid."""
    channels = _channels(channel)
    return gradient(_prepared(channels[0], None if valid is None else ~np.asarray(valid, bool)))


def gradient_density(
    image: np.ndarray, *, limit: float = np.inf, valid: np.ndarray | None = None, workers: int = _WORKERS
) -> np.ndarray:
    """Gradient-density map, the maximum over the channels: (H, W) float32, exact below `limit` and `limit` elsewhere.

    `image` and `valid` as for `blend_mask`; `limit` in units of accumulated gradient. The time grows with the number
    of pixels that stay below the limit.
    """
    channels = _channels(image)
    return _densest(channels, _invalid(channels, valid), limit, workers)


def _channels(image: np.ndarray) -> list[np.ndarray]:
    """Channels as (H, W) views; integers stay integers until they are needed."""
    image = np.asarray(image)
    if image.ndim not in (2, 3) or image.size == 0:
        raise FexelError(f"blend mask: image of shape {image.shape}, expected (H, W) or (H, W, C), not empty")
    return [image] if image.ndim == 2 else [image[:, :, channel] for channel in range(image.shape[2])]


def _prepared(channel: np.ndarray, invalid: np.ndarray | None) -> np.ndarray:
    """Channel as contiguous float32, integers scaled to [0, 1], NaN where not valid."""
    if np.issubdtype(channel.dtype, np.integer):
        values = channel * np.float32(1 / np.iinfo(channel.dtype).max)
    else:
        values = channel.astype(np.float32, order="C", copy=True)
    if invalid is not None:
        values[invalid] = np.nan
    return values


def _invalid(channels: list[np.ndarray], valid: np.ndarray | None) -> np.ndarray | None:
    """True on pixels that show nothing; None when all do."""
    shape = channels[0].shape
    if valid is not None and np.shape(valid) != shape:
        raise FexelError(f"blend mask: valid has shape {np.shape(valid)}, expected {shape}")
    invalid = None if valid is None else ~np.asarray(valid, bool)
    for channel in channels:
        if np.issubdtype(channel.dtype, np.floating):
            finite = np.isfinite(channel)
            if not finite.all():
                invalid = ~finite if invalid is None else invalid | ~finite
    return invalid


def _border(invalid: np.ndarray | None, shape: tuple[int, int]) -> np.ndarray:
    """True where the density map is 0 by definition."""
    border = np.zeros(shape, bool) if invalid is None else invalid.copy()
    border[[0, -1]] = True
    border[:, [0, -1]] = True
    return border


def _densest(
    channels: list[np.ndarray], invalid: np.ndarray | None, limit: float, workers: int = _WORKERS
) -> np.ndarray:
    """Maximum over the channels of the density maps, clamped at `limit` (may be infinite): (H, W) float32."""
    border = _border(invalid, channels[0].shape)
    densest = np.zeros(border.shape, np.float32)
    lock = Lock()

    def add(channel: np.ndarray) -> None:
        density = _density(channel, invalid, border, limit)
        with lock:
            np.maximum(densest, density, out=densest)

    with ThreadPoolExecutor(workers if border.size < _MANY_PIXELS else 1) as pool:
        list(pool.map(add, channels))
    return densest


def _density(channel: np.ndarray, invalid: np.ndarray | None, border: np.ndarray, limit: float) -> np.ndarray:
    slopes = gradient(_prepared(channel, invalid))
    limit = min(limit, cost_bound(slopes))  # so that the integers resolve what there is, and buckets stay small
    if limit == 0:
        return slopes
    costs = integer_costs(slopes, limit)
    del slopes
    units = path_costs(costs, border)
    return np.multiply(units, np.float32(limit / LIMIT), dtype=np.float32, casting="unsafe")


def _straight_cost(channels: list[np.ndarray], invalid: np.ndarray | None, depth: int) -> float:
    """Bound of the automatic tau: what the pixels at `depth` would typically pay on the straight way to the border."""
    none = np.zeros(channels[0].shape, bool) if invalid is None else invalid
    dearest = np.zeros(0)
    for channel in channels:
        sums = []
        for side, hole in zip(_sides(channel), _sides(none), strict=True):
            costs = gradient(_prepared(side[: depth + 2], hole[: depth + 2]))
            sums.append(costs[1 : depth + 1, depth : costs.shape[1] - depth].sum(axis=0, dtype=np.float64))
        dearest = np.maximum(dearest, np.concatenate(sums)) if dearest.size else np.concatenate(sums)
    return _typical(dearest)


def _sides(image: np.ndarray) -> tuple[np.ndarray, ...]:
    return image, image[::-1], image.T, image.T[::-1]


def _typical(costs: np.ndarray) -> float:
    """Median; the mean when more than half of the costs are 0, so that one flat side does not decide alone."""
    if costs.size == 0:
        return 0.0
    return float(np.median(costs)) or float(costs.mean())


def _depth_ring(height: int, width: int, depth: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the pixels at Chebyshev distance `depth` from the outermost rows and columns."""
    rows, columns = np.arange(depth, height - depth), np.arange(depth, width - depth)
    return (
        np.concatenate([np.full_like(columns, rows[0]), np.full_like(columns, rows[-1]), rows, rows]),
        np.concatenate([columns, columns, np.full_like(rows, columns[0]), np.full_like(rows, columns[-1])]),
    )


def _distance_ramp(border: np.ndarray, depth: int) -> np.ndarray:
    """Alpha of an image of equal gradient everywhere: the Chebyshev distance to the border over `depth`."""
    distance = cv2.distanceTransform((~border).astype(np.uint8), cv2.DIST_C, 3)
    return np.minimum(distance / np.float32(depth), np.float32(1))
