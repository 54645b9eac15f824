"""A chain of prefiltered images: a texture moved along a direction, 2^octaves times coarser along its long axis.

A ripmap (McReynolds) has a level for every pair of resolutions; its diagonals are chains whose levels halve both axes
at once, as mip levels do. So a chain is an image with mip levels to all that loads, drops and binds images; the one of
direction 0 or 3 and 0 octaves is the texture itself. Only chains that are coarser along the long axis are of use,
in fine directions only those much coarser (`Direction.octaves`): 4/3 of the texture's memory in each of 4
directions, half of that in 4 more, a quarter in 8 more, 12 times altogether with the texture and its mip levels.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from fexel.filters.chain_layout import SHORT_BLUR
from fexel.filters.shears import FINE_DIRECTIONS, Direction

if TYPE_CHECKING:
    from fexel.textures.pool import TexelReader

__all__ = ["Chain"]


@dataclass(frozen=True)
class Chain:
    """Source of a chain in a `fexel.textures.pool.TexturePool`.

    Attributes
    ----------
    image : hashable
        Source of the image in the pool, such as an `ImageSource`.
    direction : int
        Of `fexel.filters.shears.FINE_DIRECTIONS`.
    octaves : int
        Log2 of how much coarser the long axis is; >= 1.
    reader : TexelReader, optional
        Of the image; default that of image files.
    blur : float
        Of its `fexel.filters.chain_layout.ChainLayout`.
    """

    image: Hashable
    direction: int
    octaves: int
    reader: TexelReader | None = field(default=None, compare=False, repr=False)
    blur: float = SHORT_BLUR

    def size(self, width: int, height: int, wrap: tuple[str, str]) -> tuple[int, int]:
        """Width and height of level 0, of an image of `width` by `height` and its wrap modes along x, y.

        A mirrored axis counts as repeating and is twice as long: the image and its mirror image.
        """
        direction: Direction = FINE_DIRECTIONS[self.direction]
        size = [width, height]
        long, moved = direction.long_axis, 1 - direction.long_axis
        size[moved] += direction.padding(size[long], wrap[moved])[1]
        size[long] = max(1, size[long] >> self.octaves)
        return size[0], size[1]
