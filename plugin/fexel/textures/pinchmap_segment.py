"""The pinch along one segment, in float64 NumPy: the formulas of shaders/pinchmap_warp.glsl (Tarini and Cignoni 2005).

Of the two alternatives for the rectified k the one nearer to the interpolated k^B is right. The direction is divided by
1 - max(|k|, |k^B|). The target on the segment is evaluated directly and held above a ramp, which makes anti-aliasing
continuous, monotone and centred for every gamma:

    m = (1 - sk) / (1 - s gamma),   T = s clamp(beta |k - gamma|, 1 - m, 1 - (1 - h) m),   s = sign(k - gamma)

m falls from 1 at the line to 0 at the end of the segment; 1 - s gamma is 1 - sk + |k - gamma|. A ramp as steep as you
like gives eq. (1). The lower bound, the unpinched signal moved to the line, leaves no step at the end of the segment
where the ramp is wider than the segment. Beta makes the transition `width` wide: 2 h / width.

Seen from far away, a pixel covers several signal texels: the wider undesired fexels of their mip level are pinched (h
grows to 0.5, a whole cell of the mask); past that the displacement fades.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["FADE_END", "FADE_START", "Segment", "fade"]

FADE_START = 1.0
"""Footprint, in pinchmap texels, up to which discontinuities are pinched in full."""
FADE_END = 2.0
"""Footprint, in pinchmap texels, from which the signal's mip levels are shown as they are."""
_ZERO = 1e-6  # where d or k is a zero with rounding errors the alternatives for k mean nothing
_ON_LINE = 1e-9  # gives a hard edge a side where k is gamma exactly, as it is along lines on the lattice
_HARD = 1e-10  # width of a hard edge, in units of k
_GUARD = 1e-6  # of divisors that vanish together with what they divide


class Segment:
    """Points on their pinch segments, all (M,): what `pinch_displace` of shaders/pinchmap_warp.glsl computes."""

    def __init__(self, texel: NDArray[np.float64], fraction: NDArray[np.float64]) -> None:
        d, k_b = texel[:, :2], texel[:, 2]
        self.edge = k_b - texel[:, 3]
        self._away = np.abs(self.edge)
        self._side = np.where(self.edge > 0, 1.0, -1.0)
        k = _rectified(d, k_b, fraction)
        self._direction = np.clip(d / np.maximum(1 - np.maximum(np.abs(k), np.abs(k_b)), _GUARD)[:, None], -1, 1)
        self._rest = 1 - self._side * k  # from here to the end of the segment
        self._scale = 1 / np.maximum(self._rest + self._away, _GUARD)  # 1 over the whole way from the line to there

    def displacement(self, h: float, width: NDArray[np.float64], footprint: NDArray[np.float64]) -> NDArray[np.float64]:
        """(M, 2), in pinchmap texels; width of the transition in units of k, footprint in texels."""
        seen = np.clip(0.5 * footprint, h, 0.5)
        ramp = 2 * seen * np.maximum(self._away, _ON_LINE) / np.maximum(width, _HARD)
        target = np.clip(ramp, self._away * self._scale, (self._away + seen * self._rest) * self._scale)
        return (fade(footprint) * self._side * (1 - self._rest - target))[:, None] * self._direction

    def line_coverage(
        self, half: NDArray[np.float64], width: NDArray[np.float64], footprint: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Share of a pixel of `width` under a line twice `half` wide, in units of k; times the strength."""
        pixel = np.maximum(width, _HARD)
        near, far = 0.5 + (half - self._away) / pixel, 0.5 - (half + self._away) / pixel
        strength = np.max(np.abs(self._direction), axis=1)
        return (np.clip(near, 0, 1) - np.clip(far, 0, 1)) * strength * fade(footprint)


def _rectified(d: NDArray[np.float64], k_b: NDArray[np.float64], fraction: NDArray[np.float64]) -> NDArray[np.float64]:
    """k, linear along the segment (5.1): of the two alternatives the nearer to the interpolated one."""
    magnitude = np.abs(k_b)
    alternatives = np.where(d * k_b[:, None] > 0, 1 - fraction, fraction)
    error = np.abs(alternatives - magnitude[:, None])
    nearer = np.where(error[:, 0] < error[:, 1], alternatives[:, 0], alternatives[:, 1])
    means_something = np.min(np.abs(d), axis=1) * magnitude > _ZERO
    return np.where(means_something, np.copysign(nearer, k_b), k_b)


def fade(footprint: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of the displacement that is left at a footprint, in pinchmap texels."""
    return np.clip((FADE_END - footprint) / (FADE_END - FADE_START), 0, 1)
