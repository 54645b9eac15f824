"""How a camera's image is fitted to its size, cut into tiles and sampled, in float64.

The window of a tile is mapped to clip space by a matrix after the projection, so that a tile sees exactly the part of
the whole image that it is. Pixels count from the upper left corner.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fexel.errors import FexelError
from fexel.scene.model import Camera

__all__ = ["CONFORM_POLICIES", "MAX_TILE_PX", "Tile", "conform_projection", "sample_offsets", "tiles"]

MAX_TILE_PX = 2048
CONFORM_POLICIES = (
    "expandAperture",
    "cropAperture",
    "adjustApertureWidth",
    "adjustApertureHeight",
    "adjustPixelAspectRatio",
)


@dataclass(frozen=True)
class Tile:
    """Pixels [x, x + width) x [y, y + height) of an image of image_width x image_height."""

    x: int
    y: int
    width: int
    height: int
    image_width: int
    image_height: int

    @property
    def clip_window(self) -> np.ndarray:
        """Matrix (4, 4), row vectors, from the image's clip space to the tile's."""
        left = 2.0 * self.x / self.image_width - 1.0
        top = 1.0 - 2.0 * self.y / self.image_height
        sx = self.image_width / self.width
        sy = self.image_height / self.height
        window = np.diag([sx, sy, 1.0, 1.0])
        window[3, 0] = -1.0 - left * sx
        window[3, 1] = 1.0 - top * sy
        return window


def tiles(width: int, height: int, largest_px: int = MAX_TILE_PX) -> Iterator[Tile]:
    """Tiles of at most `largest_px` squared, of even size but for the last, row by row."""
    for y in range(0, height, largest_px):
        for x in range(0, width, largest_px):
            yield Tile(x, y, min(largest_px, width - x), min(largest_px, height - y), width, height)


def sample_offsets(count: int) -> np.ndarray:
    """Offsets (count, 2) in pixels within (-0.5, 0.5): `count` rows and as many columns, each with one sample.

    The rows are taken in the order of the van der Corput sequence, which spreads any number of samples evenly.
    """
    index = np.arange(count)
    radical_inverse = np.zeros(count)
    digit, rest = 0.5, index.copy()
    while rest.any():
        radical_inverse += digit * (rest & 1)
        rest >>= 1
        digit /= 2
    rows = np.argsort(np.argsort(radical_inverse))
    return (np.stack([index, rows], axis=1) + 0.5) / count - 0.5


def conform_projection(camera: Camera, aspect: float, policy: str = "expandAperture") -> np.ndarray:
    """Projection (4, 4) of `camera` for an image of another aspect; policies as in UsdRenderSettings.

    Raises
    ------
    FexelError
        Unknown policy.
    """
    if policy not in CONFORM_POLICIES:
        raise FexelError(f"unknown aspectRatioConformPolicy {policy!r}; valid are {' '.join(CONFORM_POLICIES)}")
    ratio = aspect / camera.aspect
    wider = ratio > 1.0
    widen = {
        "expandAperture": wider,
        "cropAperture": not wider,
        "adjustApertureWidth": True,
        "adjustApertureHeight": False,
    }
    scale = np.ones(4)
    if policy != "adjustPixelAspectRatio":
        if widen[policy]:
            scale[0] = 1.0 / ratio
        else:
            scale[1] = ratio
    return camera.camera_to_clip * scale
