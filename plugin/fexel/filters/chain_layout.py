"""Which images the chains of one direction consist of, how large they are, and where they lie in a block of memory.

A *line* is a row of texels across the long axis: it moves as one. Cell (n, m) of the ripmap has the lines halved n
times and the texels of each line m times. Level l of the chain of d octaves is cell (d + l, l), so that chains share no
cell, and only those of n - m >= `octaves` are needed; where the lines, or the texels, are down to one, several levels
read the same cell (McReynolds 1998).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from numpy.typing import NDArray

from fexel import mipmaps
from fexel.filters.shears import FINE_DIRECTIONS, Direction

__all__ = ["GAUSS_BLUR", "SHORT_BLUR", "ChainLayout"]

SHORT_BLUR = 0.09
"""Share of either neighbour in `fexel.filters.sheared.blurred_lines`, of chains that show the mean over a pixel."""

GAUSS_BLUR = 0.2
"""And of those that show a Gaussian of half a pixel's standard deviation, which is wider."""

_CYCLIC = ("repeat", "mirror")


@dataclass(frozen=True)
class ChainLayout:
    """The chains of a direction of an image.

    Attributes
    ----------
    direction : Direction
    size : (int, int)
        Width and height of the image.
    image_wrap : (str, str)
        Resolved wrap modes of the image: ``repeat``, ``mirror``, ``clamp``, ``black`` or ``patch``.
    octaves : int
        Fewest octaves of a chain.
    blur : float
        Share of either neighbour of a texel along the moved axis.
    """

    direction: Direction
    size: tuple[int, int]
    image_wrap: tuple[str, str]
    octaves: int
    blur: float = SHORT_BLUR

    @classmethod
    def of(
        cls,
        direction: int,
        size: tuple[int, int],
        wrap: tuple[str, str],
        octaves: int | None = None,
        blur: float = SHORT_BLUR,
    ) -> ChainLayout:
        """By number of the direction; with chains of fewer octaves than such a direction has, if that is wanted."""
        fewest = FINE_DIRECTIONS[direction].octaves
        return cls(FINE_DIRECTIONS[direction], size, wrap, fewest if octaves is None else min(octaves, fewest), blur)

    @property
    def mirrored(self) -> tuple[bool, bool]:
        """Along x, y: whether the chains hold the image and its mirror image."""
        return self.image_wrap[0] == "mirror", self.image_wrap[1] == "mirror"

    @cached_property
    def extent(self) -> tuple[int, int]:
        """Width and height of what is moved: of the image, twice along a mirrored axis."""
        width, height = (size << mirrored for size, mirrored in zip(self.size, self.mirrored, strict=True))
        return width, height

    @cached_property
    def wrap(self) -> tuple[str, str]:
        """Wrap modes of the chains."""
        s, t = ("repeat" if mode in _CYCLIC else mode for mode in self.image_wrap)
        return s, t

    @property
    def long_wrap(self) -> str:
        """Along the long axis."""
        return self.wrap[self.direction.long_axis]

    @property
    def moved_wrap(self) -> str:
        """Along the axis that is moved."""
        return self.wrap[1 - self.direction.long_axis]

    @property
    def lines(self) -> int:
        """At full resolution."""
        return self.extent[self.direction.long_axis]

    @property
    def line_texels(self) -> int:
        """Texels of a line before it is moved."""
        return self.extent[1 - self.direction.long_axis]

    @cached_property
    def padding(self) -> tuple[int, int]:
        """`Direction.padding`."""
        return self.direction.padding(self.lines, self.moved_wrap)

    @cached_property
    def texels(self) -> int:
        """Texels of a line at full resolution, padding included."""
        return self.line_texels + self.padding[1]

    @property
    def last(self) -> tuple[int, int]:
        """The coarsest cell."""
        return max(self.lines.bit_length() - 1, self.octaves), self.texels.bit_length() - 1

    def cell(self, octaves: int, level: int) -> tuple[int, int]:
        """(n, m) of a level of a chain."""
        n, m = self.last
        return min(octaves + level, n), min(level, m)

    def line_size(self, cell: tuple[int, int]) -> tuple[int, int]:
        """How many lines a cell has, and texels per line."""
        return mipmaps.level_size(self.lines, cell[0]), mipmaps.level_size(self.texels, cell[1])

    def cell_size(self, cell: tuple[int, int]) -> tuple[int, int]:
        """Width and height."""
        lines, texels = self.line_size(cell)
        return (lines, texels) if self.direction.long_axis == 0 else (texels, lines)

    def levels(self, n: int) -> int:
        """How many cells there are of lines halved n times: m = 0, 1, ..."""
        last_n, last_m = self.last
        return last_m + 1 if n == last_n else min(max(n - self.octaves + 1, 0), last_m + 1)

    @cached_property
    def cells(self) -> tuple[tuple[int, int], ...]:
        """All cells."""
        return tuple((n, m) for n in range(self.octaves, self.last[0] + 1) for m in range(self.levels(n)))

    @cached_property
    def places(self) -> dict[tuple[int, int], tuple[int, int, int]]:
        """Of every cell: its first texel in a block of memory, and rows and columns with the border of one texel."""
        places, first = {}, 0
        for cell in self.cells:
            width, height = self.cell_size(cell)
            places[cell] = (first, height + 2, width + 2)
            first += (height + 2) * (width + 2)
        return places

    @cached_property
    def total(self) -> int:
        """Texels of all cells with their borders."""
        first, rows, columns = self.places[self.cells[-1]]
        return first + rows * columns

    def cells_in(self, block: NDArray) -> dict[tuple[int, int], NDArray]:
        """By cell: (h + 2, w + 2, 4), rows and columns of the image with a border of one texel; of (total, 4)."""
        return {
            cell: block[first : first + rows * columns].reshape(rows, columns, 4)
            for cell, (first, rows, columns) in self.places.items()
        }
