"""Pages: rectangles of texels of many images in one GL texture, without GL mip levels.

One `PageAtlas` per page class. It grows downwards as long as GL and the budget allow; rectangles are placed in shelves.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fexel.textures.page_format import PAGE_FORMATS

if TYPE_CHECKING:
    import moderngl

__all__ = ["Box", "PageAtlas", "Resident"]

Box = tuple[int, int, int, int]
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


class _Shelves:
    """Rectangles side by side on shelves, shelves one below the other."""

    def __init__(self, width: int, largest: int) -> None:
        self.width = width
        self.bottom = 0
        self._largest = largest
        self._rows: list[list[int]] = []  # y, height, used width

    def place(self, keys: list[Hashable], needs: dict[Hashable, Box]) -> dict[Hashable, Resident] | None:
        """Places of windows with their borders; None, and these shelves spoilt, when there is no room for all."""
        extents = {key: (needs[key][2] - needs[key][0] + 2, needs[key][3] - needs[key][1] + 2) for key in keys}
        placed = {}
        for key in sorted(keys, key=lambda k: (-extents[k][1], -extents[k][0])):
            spot = self._spot(*extents[key])
            if spot is None:
                return None
            placed[key] = Resident(needs[key], spot[0] + 1, spot[1] + 1)
        return placed

    def _spot(self, width: int, height: int) -> tuple[int, int] | None:
        for row in self._rows:
            if height <= row[1] <= 2 * height and row[2] + width <= self.width:
                row[2] += width
                return row[2] - width, row[0]
        if width > self.width or self.bottom + height > self._largest:
            return None
        self._rows.append([self.bottom, height, width])
        self.bottom += height
        return 0, self._rows[-1][0]


class PageAtlas:
    """Texture and packing of one page class.

    Parameters
    ----------
    gl : moderngl.Context
    page_class : int
    largest : int, optional
        Most texels along an axis of the page; default what GL allows.
    """

    def __init__(self, gl: moderngl.Context, page_class: int, largest: int | None = None) -> None:
        self._gl = gl
        self.page_class = page_class
        self._format = PAGE_FORMATS[page_class]
        self.largest = largest or int(gl.info["GL_MAX_TEXTURE_SIZE"])
        self.texture: moderngl.Texture | None = None
        self.residents: dict[Hashable, Resident] = {}
        self._shelves = _Shelves(0, self.largest)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the page in texels."""
        return self.texture.size if self.texture else (1, 1)

    @property
    def nbytes(self) -> int:
        """Texture memory."""
        return self.size[0] * self.size[1] * self._format.bytes_per_texel if self.texture else 0

    def bytes_for(self, needs: dict[Hashable, Box], afresh: bool = False) -> float:
        """Most bytes of the page once it holds these windows; infinite where they have no room in one page.

        What is resident stays, so that the page never shrinks, unless it is released and packed `afresh`.
        """
        if not afresh and not self._missing(needs):
            return self.nbytes
        packed = self._packed(needs) if needs else None
        if packed is None:
            return np.inf if needs else 0
        nbytes = packed[0].width * self._height(packed[0]) * self._format.bytes_per_texel
        return nbytes if afresh else max(nbytes, self.nbytes)

    def _missing(self, needs: dict[Hashable, Box]) -> list[Hashable]:
        return [key for key, box in needs.items() if key not in self.residents or not self.residents[key].holds(box)]

    def begin(self, needs: dict[Hashable, Box]) -> list[Hashable]:
        """Make room for windows that fit; which of them must be written with `write`.

        What is resident and large enough stays where it is. When the page is full it is packed afresh.
        """
        missing = self._missing(needs)
        placed = self._shelves.place(missing, needs) if self.texture or not missing else None
        if placed is not None and self._shelves.bottom <= self.size[1]:
            self.residents.update(placed)
            return missing
        packed = self._packed(needs)
        assert packed is not None, "the caller has asked `bytes_for`"
        self._shelves, self.residents = packed
        size = self._shelves.width, self._height(self._shelves)
        if size != self.size:
            self._allocate(*size)
        return list(needs)

    def _packed(self, needs: dict[Hashable, Box]) -> tuple[_Shelves, dict[Hashable, Resident]] | None:
        area = sum((x1 - x0 + 2) * (y1 - y0 + 2) for x0, y0, x1, y1 in needs.values())
        widest = max((x1 - x0 + 2 for x0, _, x1, _ in needs.values()), default=1)
        square = min(self.largest, _round_up(max(widest, int(np.sqrt(area * 1.1))), 64))
        for width in (square, self.largest):
            shelves = _Shelves(width, self.largest)
            placed = shelves.place(list(needs), needs)
            if placed is not None:
                return shelves, placed
        return None

    def _height(self, shelves: _Shelves) -> int:
        bottom = shelves.bottom
        return min(self.largest, _round_up(max(bottom, 1), 64 if bottom < _GROW else _GROW))

    def _allocate(self, width: int, height: int) -> None:
        if self.texture:
            self.texture.release()
        page = self._format
        self.texture = self._gl.texture((width, height), 4, dtype=page.dtype, internal_format=page.internal_format)
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
        self.residents = {}


def _round_up(value: int, step: int) -> int:
    return -(-value // step) * step
