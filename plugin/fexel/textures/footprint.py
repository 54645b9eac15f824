"""The pixel's preimage in texture space, in float64 NumPy: twin of shaders/common_footprint.glsl.

Units are those of the Jacobians given, such as texels of level 0 per pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Footprint"]

_FLOOR = 1e-30  # keeps logarithms and quotients finite where the Jacobian is 0


@dataclass(frozen=True, eq=False)
class Footprint:
    """Ellipses that Jacobians make of the unit circle.

    Attributes
    ----------
    major, minor : (M,) float64
        Length of the axes.
    direction : (M, 2) float64
        The major axis.
    """

    major: NDArray[np.float64]
    minor: NDArray[np.float64]
    direction: NDArray[np.float64]

    @classmethod
    def of(cls, jacobian: NDArray[np.float64]) -> Footprint:
        """Ellipses of (M, 2, 2), column j per pixel along x, y."""
        dx, dy = jacobian[..., 0], jacobian[..., 1]
        a, b, c = (np.sum(u * v, axis=-1) for u, v in ((dx, dx), (dy, dy), (dx, dy)))
        half = 0.5 * (a - b)
        root = np.hypot(half, c)
        major = np.sqrt(0.5 * (a + b) + root)
        wide = half >= 0
        x, y = np.where(wide, half + root, c), np.where(wide, c, root - half)  # of the pixel; both vanish for a circle
        size = np.hypot(x, y)
        safe = np.where(size > 0, size, 1.0)
        x, y = np.where(size > 0, x / safe, 1.0), y / safe
        area = np.abs(dx[..., 0] * dy[..., 1] - dx[..., 1] * dy[..., 0])
        return cls(major, area / np.maximum(major, _FLOOR), dx * x[..., None] + dy * y[..., None])

    def probes(self, most: float) -> NDArray[np.float64]:
        """(M,) isotropic probes that cover the footprint, 1 to `most`."""
        return np.clip(np.ceil(self.major / np.maximum(self.minor, _FLOOR) - 0.25), 1.0, max(most, 1.0))

    def level(self, most: float) -> NDArray[np.float64]:
        """(M,) log2 of the minor axis, or of the share of the major one that each of `most` probes covers."""
        return np.log2(np.maximum(np.maximum(self.minor, self.major / max(most, 1.0)), _FLOOR))
