"""Pages: rectangles of texels of many images in one GL texture, without GL mip levels.

One `PageAtlas` per page class. It grows downwards as long as GL and the budget allow; rectangles are placed in shelves.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fexel.textures.pyramid_cache import BYTES_PER_TEXEL, HALF, SRGB

if TYPE_CHECKING:
    import moderngl

__all__ = ["Box", "PageAtlas", "Resident"]

Box = tuple[int, int, int, int]
_GL_SRGB8_ALPHA8 = 0x8C43
_GROW = 256


@dataclass(frozen=True)
class Resident:
    """A window of a level and where its first texel (without the border) is in the page."""

    box: Box
    x: int
    y: int

    def holds(self, box: Box) -> bool:
        """Whether a window lies within."""
        return self.box[0] <= box[0] and self.box[1] <= box[1] and self.box[2] >= box[2] and self.box[3] >= box[3]


class PageAtlas:
    """Texture and packing of one page class."""

    def __init__(self, gl: moderngl.Context, page_class: int) -> None:
        self._gl = gl
        self.page_class = page_class
        self.texture: moderngl.Texture | None = None
        self.residents: dict[Hashable, Resident] = {}
        self._largest = int(gl.info["GL_MAX_TEXTURE_SIZE"])
        self._shelves: list[list[int]] = []  # y, height, used width
        self._bottom = 0

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the page in texels."""
        return self.texture.size if self.texture else (1, 1)

    @property
    def nbytes(self) -> int:
        """Texture memory."""
        return self.size[0] * self.size[1] * BYTES_PER_TEXEL[self.page_class] if self.texture else 0

    def begin(self, needs: dict[Hashable, Box]) -> list[Hashable]:
        """Make room for windows; which of them must be written with `write`.

        What is resident and large enough stays where it is. When the page is full it is packed afresh.
        """
        missing = [key for key, box in needs.items() if key not in self.residents or not self.residents[key].holds(box)]
        if self._place(missing, needs):
            return missing
        self.residents.clear()
        self._shelves.clear()
        self._bottom = 0
        missing = list(needs)
        self._place(missing, needs, fresh=True)
        return missing

    def _place(self, keys: list[Hashable], needs: dict[Hashable, Box], fresh: bool = False) -> bool:
        """Assign places; False when the present texture has no room for all and is not `fresh`."""
        extents = {key: (needs[key][2] - needs[key][0] + 2, needs[key][3] - needs[key][1] + 2) for key in keys}
        if fresh:
            area = sum(w * h for w, h in extents.values())
            widest = max((w for w, _ in extents.values()), default=1)
            self._width = min(self._largest, _round_up(max(widest, int(np.sqrt(area * 1.1))), 64))
        elif self.texture is None and keys:
            return False
        placed: dict[Hashable, Resident] = {}
        for key in sorted(keys, key=lambda k: (-extents[k][1], -extents[k][0])):
            spot = self._shelf_spot(*extents[key])
            if spot is None:
                return False
            placed[key] = Resident(needs[key], spot[0] + 1, spot[1] + 1)
        if fresh and (self._width, self._height()) != self.size:
            self._allocate(self._width, self._height())
        elif self._bottom > self.size[1]:
            return False
        self.residents.update(placed)
        return True

    def _height(self) -> int:
        return min(self._largest, _round_up(max(self._bottom, 1), 64 if self._bottom < _GROW else _GROW))

    def _shelf_spot(self, width: int, height: int) -> tuple[int, int] | None:
        for shelf in self._shelves:
            if height <= shelf[1] and shelf[1] <= 2 * height and shelf[2] + width <= self._width:
                shelf[2] += width
                return shelf[2] - width, shelf[0]
        if width > self._width or self._bottom + height > self._largest:
            return None
        self._shelves.append([self._bottom, height, width])
        self._bottom += height
        return 0, self._shelves[-1][0]

    def _allocate(self, width: int, height: int) -> None:
        if self.texture:
            self.texture.release()
        half = self.page_class == HALF
        internal = _GL_SRGB8_ALPHA8 if self.page_class == SRGB else None
        self.texture = self._gl.texture((width, height), 4, dtype="f2" if half else "f1", internal_format=internal)
        self.texture.filter = (self._gl.LINEAR, self._gl.LINEAR)
        self.texture.repeat_x = self.texture.repeat_y = False

    def write(self, key: Hashable, texels: NDArray) -> None:
        """Upload a window with its border."""
        assert self.texture is not None
        place = self.residents[key]
        height, width = texels.shape[:2]
        self.texture.write(texels.tobytes(), viewport=(place.x - 1, place.y - 1, width, height))

    def release(self) -> None:
        """Free the texture."""
        if self.texture:
            self.texture.release()
            self.texture = None
        self.residents.clear()


def _round_up(value: int, step: int) -> int:
    return -(-value // step) * step
