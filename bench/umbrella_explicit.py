"""The rival of umbrellas: the whole texture stored explicitly, mip-mapped, looked up trilinearly.

Its resolution comes from eq. (3) of "Just-in-time texture synthesis" (2012); texels are area averages of the
arrangement, coarser levels averages of those in linear light, every level in 8 bits, sRGB-encoded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fexel import mipmaps
from fexel.images import linear_to_srgb, srgb_to_linear
from fexel.textures.pinchmap_lattice import trilinear
from fexel.textures.umbrella_arrangement import Arrangement
from fexel_tools.umbrella_raster import rasterize

__all__ = ["ExplicitTexture", "explicit_texture", "stored"]


@dataclass(frozen=True)
class ExplicitTexture:
    """Mip levels (h, w, 3) float32, linear, finest first; the texture repeats."""

    levels: list[np.ndarray]

    def picture(self, pixel_to_st: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        """(H, W, 3) linear: an affine view, one trilinear lookup per pixel, by the longer axis of the footprint."""
        x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
        st = np.stack([x.ravel(), y.ravel()], -1) @ pixel_to_st[:2, :2] + pixel_to_st[2, :2]
        texels = pixel_to_st[:2, :2] * self.levels[0].shape[1::-1]
        lod = np.full(len(st), np.log2(np.hypot(*texels.T).max()))
        return trilinear(self.levels, st, lod, ("repeat", "repeat")).reshape(*size[::-1], 3)


def explicit_texture(arrangement: Arrangement, textures, background, texels_per_cell: int) -> ExplicitTexture:
    """Draw the arrangement at a resolution and filter it.

    Parameters
    ----------
    textures, background
        As `fexel_tools.umbrella_raster.rasterize` takes them.
    """
    width, height = (texels_per_cell * cells for cells in arrangement.grid)
    picture = rasterize(arrangement, list(textures), background, (width, height))
    return ExplicitTexture([stored(level) for level in mipmaps.pyramid(picture[..., :3])])


def stored(picture: np.ndarray) -> np.ndarray:
    """Linear values as 8 bits keep them, sRGB-encoded."""
    return srgb_to_linear(np.rint(linear_to_srgb(np.clip(picture, 0, 1)) * 255).astype(np.float32) / 255)
