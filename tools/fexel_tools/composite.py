"""The picture made by the patches written so far, sampled where the next patch needs it.

A new patch meets what lies below it in two places: on its one-pixel ring (the Dirichlet border of the Poisson
equation) and, much reduced, over its whole area (exposure and white balance). Both are samples of eq. (1) of the
zipmap paper over the patches already written, read back from their texture files, only the window and the mip level
that are needed: what the renderer will show there is what is sampled here, and no photo stays in memory.

Conventions: linear, premultiplied inside; `points` are continuous pixel coordinates of the new patch's photo; 3x3
float64, column vectors.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fexel.images import ImageInfo, image_info, read_pixels, to_linear
from fexel_tools.consistency import apply_homography
from fexel_tools.coverage import density

__all__ = ["Composite", "Layer"]

_RIM = 1.0  # texels around a sample that bilinear filtering reads


@dataclass(frozen=True)
class Layer:
    """A written texture and its place.

    Attributes
    ----------
    file : str
        Tiled, mip-mapped texture.
    color_space : str
        ``sRGB`` or ``raw``, how the file is decoded.
    texture_from_root : (3, 3) float64
        Pixels of the root photo to pixels of the texture's level 0.
    opacity : float
    mask : str
        File of an artist's mask that replaces the texture's alpha (red, raw); '' for none.
    """

    file: str
    color_space: str
    texture_from_root: np.ndarray
    opacity: float = 1.0
    mask: str = ""


@dataclass
class Composite:
    """Layers in draw order."""

    layers: list[Layer] = field(default_factory=list)

    def sample(self, root_from_photo: np.ndarray, points: np.ndarray, step_px: float = 1.0) -> np.ndarray:
        """Colour of the composite at points of a photo.

        Parameters
        ----------
        root_from_photo : (3, 3) float64
        points : (N, 2) float64
        step_px : float
            Distance of neighbouring samples in photo pixels; layers finer than that are read from a coarser level.

        Returns
        -------
        (N, 3) float32
            Linear Rec.709; NaN where no layer reaches.
        """
        color = np.zeros((len(points), 4), np.float32)
        for layer in self.layers:
            over = _sample_layer(layer, root_from_photo, points, step_px)
            color = over + color * (1.0 - over[:, 3:])
        alpha = color[:, 3:]
        return np.where(alpha > 0.5, color[:, :3] / np.maximum(alpha, 0.5), np.float32(np.nan)).astype(np.float32)

    def texel_px(self, root_from_photo: np.ndarray, points: np.ndarray) -> float:
        """Side of a texel of the topmost layer, in photo pixels: the median over the points, at least 1."""
        side = np.full(len(points), np.nan)
        for layer in self.layers:
            matrix = layer.texture_from_root @ root_from_photo
            matrix = matrix / (matrix[2] @ [*points.mean(axis=0), 1.0])
            texels, info = apply_homography(matrix, points), image_info(layer.file)
            with np.errstate(invalid="ignore"):
                inside = ((texels >= 0.0) & (texels <= (info.width, info.height))).all(axis=1)
            side[inside] = 1.0 / np.maximum(density(matrix, points[inside]), 1e-6)  # 1e-6 guards points at infinity
        return max(1.0, float(np.nanmedian(side))) if np.isfinite(side).any() else 1.0


def _sample_layer(layer: Layer, root_from_photo: np.ndarray, points: np.ndarray, step_px: float) -> np.ndarray:
    matrix = layer.texture_from_root @ root_from_photo
    matrix = matrix / (matrix[2] @ [*points.mean(axis=0), 1.0])
    texels = apply_homography(matrix, points)
    info = image_info(layer.file)
    with np.errstate(invalid="ignore"):
        inside = ((texels >= 0.0) & (texels <= (info.width, info.height))).all(axis=1)
    result = np.zeros((len(points), 4), np.float32)
    if not inside.any():
        return result
    spacing = float(np.median(density(matrix, points[inside]))) * step_px
    level = int(np.clip(np.floor(np.log2(max(spacing, 1.0)) + 0.5), 0, len(info.level_sizes) - 1))
    width, height = info.level_sizes[level]
    st = texels[inside] / (info.width, info.height)
    color = _bilinear(info, layer.color_space, level, st * (width, height))
    if layer.mask:
        mask_info = image_info(layer.mask)
        mask = _bilinear(mask_info, "raw", 0, st * (mask_info.width, mask_info.height))[:, :1]
        color[:, :3] = np.where(color[:, 3:] > 0.0, color[:, :3] / np.maximum(color[:, 3:], 1e-6), 0.0) * mask
        color[:, 3:] = mask
    result[inside] = color * np.float32(layer.opacity)
    return result


def _bilinear(info: ImageInfo, color_space: str, level: int, texels: np.ndarray) -> np.ndarray:
    """(N, 4) samples of one level at continuous texel coordinates inside it; only the window they span is read."""
    size = np.array(info.level_sizes[level])
    low = np.maximum(np.floor(texels.min(axis=0) - 0.5 - _RIM), 0).astype(int)
    high = np.minimum(np.ceil(texels.max(axis=0) + 0.5 + _RIM), size).astype(int)
    window = read_pixels(info, level, (*low, *high))
    position = texels - 0.5 - low
    corner = np.floor(position).astype(int)
    share = (position - corner).astype(np.float32)
    limit = high - low - 1
    total = np.zeros((len(texels), 4), np.float32)
    for dx in (0, 1):
        for dy in (0, 1):
            weight = (share[:, :1] if dx else 1.0 - share[:, :1]) * (share[:, 1:] if dy else 1.0 - share[:, 1:])
            column = np.clip(corner[:, 0] + dx, 0, limit[0])
            row = np.clip(corner[:, 1] + dy, 0, limit[1])
            total += weight * to_linear(window[row, column][:, None], info, color_space)[:, 0]
    return total
