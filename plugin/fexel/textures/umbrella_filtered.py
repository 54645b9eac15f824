"""Images of an umbrella texture as its minification filter looks them up.

The background and the picture of the whole lie in the texture's own coordinates. Bases are turned and stretched with
each umbrella, and probes along a long footprint have already been taken where umbrellas are composed: what is left of
its length is what more probes than there may be would have covered, and nearly nothing elsewhere.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel import homography
from fexel.filters.view import FilterView
from fexel.textures.footprint import Footprint
from fexel.textures.image_view import ImageView
from fexel.textures.kind import Sight
from fexel.textures.layer_footprints import layer_footprints
from fexel.textures.pool import TexelReader, TexturePool

__all__ = ["BY_LEVELS", "UmbrellaFilter"]

BY_LEVELS = ("mipmap", "anisotropic")
"""Filters that read an image's own mip levels, as far as probes make its footprints short."""

_LEFT = 1.3  # ratio of axes up to which a footprint counts as round: that of one more probe is 1.25
_MOST_LEFT = 64.0
_ANGLES, _STEP = 32, 0.5  # of the footprints that bases may be seen with: over half a turn, and in octaves


@dataclass(frozen=True)
class UmbrellaFilter:
    """The filter of an umbrella texture in a view.

    Attributes
    ----------
    token : str
    most : float
        Anisotropic probes that are taken of the arrangement.
    sight : Sight
        Its ``local_to_st`` leads to the texture's own coordinates.
    mirrored : bool
        Whether the texture is seen as its mirror image as well.
    """

    token: str
    most: float
    sight: Sight
    mirrored: bool

    @property
    def of_levels(self) -> bool:
        """Whether images are looked up in their own mip levels alone."""
        return self.token in BY_LEVELS

    def left(self, grid: tuple[int, int]) -> float:
        """Longest ratio of axes that probes leave of a footprint in cells of the grid; 1 where they suffice."""
        jacobian = self._footprints(grid).reshape(-1, 2, 2)
        if not len(jacobian):
            return 1.0
        footprint = Footprint.of(jacobian)
        ratio = footprint.major / np.maximum(footprint.minor, 1e-30)  # 1e-30 guards a pixel without width
        left = float(ratio.max()) / self.most
        return min(left, _MOST_LEFT) if left > _LEFT else 1.0

    def whole(
        self, pool: TexturePool, source: Hashable, path: str, reader: TexelReader | None = None
    ) -> FilterView | None:
        """An image of the unit square, all of which is kept; None where nothing is seen."""
        jacobian = self._footprints(pool.facts(pool.image(source, path, reader)).size)
        if not len(jacobian):
            return None
        if self.mirrored:
            turns = np.array([[1, 1], [-1, 1]])[:, :, None]  # both axes at once change nothing
            jacobian = (jacobian[:, :, None] * turns).reshape(len(jacobian), -1, 2, 2)
        return self._view(pool, source, path, jacobian, reader)

    def base(self, pool: TexturePool, source: Hashable, path: str, lods: tuple[float, float], left: float) -> ImageView:
        """The image of a base, which may lie in any direction.

        Parameters
        ----------
        pool : TexturePool
        source, path
            Of the pool.
        lods : (float, float)
            Range of the log2 of the narrower axis of footprints in its texels.
        left : float
            Ratio of axes up to which footprints are.
        """
        angle = np.arange(_ANGLES) * (np.pi / _ANGLES)
        width = 2.0 ** np.arange(lods[0], lods[1] + _STEP, _STEP)
        ratio = 2.0 ** np.arange(0.0, np.log2(left) + _STEP, _STEP)
        angle, width, ratio = (axis.ravel() for axis in np.meshgrid(angle, width, ratio))
        along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        across = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
        jacobian = np.stack([along * (ratio * width)[:, None], across * width[:, None]], axis=2)
        return self._view(pool, source, path, jacobian[None], None)

    def _footprints(self, size: tuple[int, int]) -> NDArray[np.float64]:
        bounds = None
        if self.sight.nested:
            bounds = homography.unit_square_bounds(self._matrix[None])[0]
        return layer_footprints(self.sight.pieces, self._matrix, size, bounds).jacobian

    @property
    def _matrix(self) -> NDArray[np.float64]:
        return homography.normalize(self.sight.local_to_st[None])[0]

    def _view(
        self, pool: TexturePool, source: Hashable, path: str, jacobian: NDArray[np.float64], reader: TexelReader | None
    ) -> FilterView:
        low, high = np.zeros((len(jacobian), 2)), np.ones((len(jacobian), 2))
        return FilterView.of(pool, source, path, self.token, jacobian, low, high, reader=reader)
