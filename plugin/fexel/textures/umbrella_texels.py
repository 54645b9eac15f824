"""An arrangement as texels of a float page and of a half-float page: what shaders/umbrella*.glsl read, static.

Built once per arrangement and grid of cells, then resident as long as it is seen. Every cell lists its umbrellas front
to back, each with the matrix from the cell to its patch space, about its centre: float32 relative to the cell keeps
positions exact however large the texture is. A table by pseudo-angle gives the sector of a direction at once
(Just-in-time texture synthesis, 2012, section 6.1), for every shape and for parts of the range of its morph.

Texels of the float page, in this order; addresses count from the first texel, cells row by row:

- cells: (first entry, entries, 0, 0)
- entries of `stride` texels: (x from s, t, 1; first colour of the umbrella, or its number where there are none),
  (y ...; address of the shape), where any matrix is projective (w ...; morph), and (coverage, negative where mirrored;
  cosine, sine of its turn from patch space to st; morph)
- shapes: (tex coords of the centre, number of the image or -1, sectors), `slices` tables of `bins` sectors, the contour
  (at a morph of 0, the way to one of 1), whose first vertices follow again after the last, and tex coords (of a vertex
  and of the next) for each sector (`umbrella_shape_texels`).

The half-float page has the vertex colours, umbrella by umbrella.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelWarning
from fexel.textures.atlas import Box
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.page_format import FLOAT, HALF
from fexel.textures.pyramid_cache import ImageFacts
from fexel.textures.umbrella_arrangement import Arrangement
from fexel.textures.umbrella_cells import Cells, build_cells
from fexel.textures.umbrella_geometry import turns
from fexel.textures.umbrella_shape_texels import shape_blocks

__all__ = ["ArrangementSource", "ArrangementTexels", "ColorSource", "Layout"]

_ROW_BITS = 10
_MOST_ROWS = 4096  # rows get longer where this many do not hold all
_LARGEST_HALF = np.finfo(np.float16).max
_LOW = 2048  # whole numbers that half floats hold
_MOST_TEXELS = _MOST_COLORS = 1 << 24  # whole numbers that floats hold: addresses of either
_MOST_FACTS = 256


@dataclass(frozen=True)
class ArrangementSource:
    """An arrangement over a grid of cells.

    Attributes
    ----------
    arrangement : Arrangement
        As `Arrangement.neutral`: whatever its blend and shadows, its texels are the same.
    size : (int, int)
        Cells along s and t.
    margin : (float, float)
        In st, along s and t: how far beyond a cell its list serves.
    opaque : tuple of bool
        By shape: whether its image has no alpha.
    colored : bool
        Whether umbrellas are known by their first colour rather than by their number.
    """

    arrangement: Arrangement
    size: tuple[int, int]
    margin: tuple[float, float]
    opaque: tuple[bool, ...]
    colored: bool

    @property
    def key(self) -> Hashable:
        """Equal where sources are; it keeps no arrangement alive."""
        return self.arrangement.digest, self.size, self.margin, self.opaque, self.colored


@dataclass(frozen=True)
class ColorSource:
    """Vertex colours of an arrangement, which is as `Arrangement.neutral`."""

    arrangement: Arrangement

    @property
    def key(self) -> Hashable:
        """Equal where sources are; it keeps no arrangement alive."""
        return self.arrangement.digest


@dataclass(frozen=True)
class Layout:
    """Where things lie in the float page of a source.

    Attributes
    ----------
    stride : int
        Texels of an entry: 3, or 4 where any matrix is projective.
    bins, slices : int
        Of the tables.
    morphs : bool
        Whether any umbrella has another shape than its base.
    size : (int, int)
        Cells along s and t: those of the source, or fewer.
    colored : bool
        Whether umbrellas are known by their first colour.
    """

    stride: int
    bins: int
    slices: int
    morphs: bool
    size: tuple[int, int]
    colored: bool = False


class ArrangementTexels:
    """Reads `ArrangementSource` and `ColorSource`; see `fexel.textures.pool.TexelReader`."""

    def __init__(self, kept: KeptTexels | None = None) -> None:
        self._kept = kept or KeptTexels()
        # Texels may be gone while they are resident on the GPU: how they are laid out outlives them.
        self._facts = KeptTexels(_MOST_FACTS)

    def layout(self, source: ArrangementSource, path: str = "") -> Layout:
        """Where things lie."""
        return self._made(source, path)[1]

    def row_bits(self, source: ArrangementSource | ColorSource, path: str = "") -> int:
        """Log2 of the texels in a row."""
        return self._made(source, path)[0][0].bit_length() - 1

    def facts(self, source: ArrangementSource | ColorSource, path: str) -> ImageFacts:
        """Size and page class; there is level 0 alone."""
        page_class = FLOAT if isinstance(source, ArrangementSource) else HALF
        return ImageFacts(self._made(source, path)[0], page_class, ("clamp", "clamp"), None, has_levels=False)

    def window(self, source: ArrangementSource | ColorSource, path: str, _level: int, box: Box) -> NDArray:
        """Texels of a window with its border."""
        texels = np.pad(self._texels(source, path), ((1, 1), (1, 1), (0, 0)))
        return np.ascontiguousarray(texels[box[1] : box[3] + 2, box[0] : box[2] + 2])

    def _made(self, source: ArrangementSource | ColorSource, path: str) -> tuple[tuple[int, int], Layout]:
        """Width and height in texels, and what lies where in them; of colours, the latter says nothing."""
        if source.key not in self._facts:
            self._texels(source, path)
        return self._facts.get(source.key)

    def _texels(self, source: ArrangementSource | ColorSource, path: str) -> NDArray:
        texels = self._kept.get(source.key)
        if texels is None or source.key not in self._facts:
            layout = None
            if isinstance(source, ArrangementSource):
                flat, layout = _written(source, path)
            else:
                flat = _color_texels(source.arrangement)
            texels = _in_rows(flat)
            self._facts.keep(source.key, ((texels.shape[1], texels.shape[0]), layout), 1)
            self._kept.keep(source.key, texels, texels.nbytes)
        return texels


def _in_rows(flat: NDArray) -> NDArray:
    """(H, W, 4), W a power of two."""
    bits = max(_ROW_BITS, math.ceil(math.log2(max(len(flat), 1) / _MOST_ROWS)))
    rows = max(1, -(-len(flat) // 2**bits))
    padded = np.zeros((rows << bits, 4), flat.dtype)
    padded[: len(flat)] = flat
    return padded.reshape(rows, 2**bits, 4)


def _color_texels(arrangement: Arrangement) -> NDArray[np.float16]:
    """Signed offsets by vertex. Their fourth components tell the umbrella: low part at its centre, high part around."""
    colors = np.zeros((max(len(arrangement.colors), 1), 4), np.float16)
    if len(arrangement.colors):
        colors[:, :3] = np.clip(arrangement.colors, -_LARGEST_HALF, _LARGEST_HALF)
        number = np.arange(len(arrangement))
        colors[:, 3] = np.repeat(number // _LOW, arrangement.vertex_counts)
        colors[arrangement.first_vertex[:-1], 3] = number % _LOW
    return colors


def _written(source: ArrangementSource, path: str) -> tuple[NDArray[np.float32], Layout]:
    arrangement = source.arrangement
    morphs = bool((arrangement.morphs != 0).any()) and any(
        (shape.points != shape.morph_points).any() for shape in arrangement.shapes
    )
    stride = 3 if arrangement.is_affine else 4
    blocks, bins, slices = shape_blocks(arrangement.shapes, morphs)
    cells = _cells(source, stride, _MOST_TEXELS - sum(map(len, blocks)), path)
    colored = source.colored and _has_room_for_colors(arrangement, path)
    first = len(cells.counts)
    lengths = [first, stride * len(cells.umbrella), *(len(block) for block in blocks)]
    address = np.cumsum(lengths)[1:-1] if blocks else np.zeros(0, np.int64)
    rows = _entry_rows(cells, arrangement, address, colored)
    rows = rows if stride == 4 else rows[:, [0, 1, 3]]
    heads = np.zeros((first, 4), np.float32)
    heads[:, 0], heads[:, 1] = first + stride * cells.first[:-1], cells.counts
    layout = Layout(stride, bins, slices, morphs, cells.size, colored)
    tables = [block.astype(np.float32) for block in blocks]
    return np.concatenate([heads, rows.reshape(-1, 4), *tables]), layout


def _cells(source: ArrangementSource, stride: int, most: int, path: str) -> Cells:
    """Lists; of coarser cells where they would be more than `most` texels, which also lengthens them."""
    size = source.size
    opaque = np.array(source.opaque, bool)
    while True:
        # Shadows are looked for in the cell that they fall from.
        cells = build_cells(source.arrangement, size, source.margin, opaque=opaque, shadows=False)
        texels = len(cells.counts) + stride * len(cells.umbrella)
        if texels <= most:
            return cells
        if size == (1, 1):
            return _front(cells, (most - 1) // stride, path)
        shrink = min(0.5, 0.9 * math.sqrt(most / texels))
        size = max(1, int(size[0] * shrink)), max(1, int(size[1] * shrink))


def _front(cells: Cells, count: int, path: str) -> Cells:
    """The first entries of a single cell."""
    _say(path, f"{len(cells.umbrella)} umbrellas, expected at most {count}; those in front are drawn")
    return Cells(cells.size, np.array([0, count]), cells.umbrella[:count], cells.shift[:count], cells.flags[:count])


def _has_room_for_colors(arrangement: Arrangement, path: str) -> bool:
    count = len(arrangement.colors)
    if count <= _MOST_COLORS:
        return True
    _say(path, f"{count} vertices of umbrellas, expected at most {_MOST_COLORS}; their colours are left out")
    return False


def _say(path: str, fault: str) -> None:
    warnings.warn(f"{path}: {fault}", FexelWarning, stacklevel=2)


def _entry_rows(
    cells: Cells, arrangement: Arrangement, address: NDArray[np.int64], colored: bool
) -> NDArray[np.float32]:
    """(entries, 4, 4): from the place in the cell, in [0, 1]^2, to patch space about the centre; the rest."""
    number = cells.umbrella
    to_patch = _to_patch(arrangement)
    cell = np.repeat(np.arange(len(cells.counts)), cells.counts)
    corner_s = cell % cells.size[0] / cells.size[0] + cells.shift[:, 0]
    corner_t = cell // cells.size[0] / cells.size[1] + cells.shift[:, 1]
    rows = np.empty((len(number), 4, 4), np.float32)
    for row in range(3):
        along_s, along_t, offset = to_patch[:, row].T
        rows[:, row, 0] = (along_s / cells.size[0])[number]
        rows[:, row, 1] = (along_t / cells.size[1])[number]
        rows[:, row, 2] = along_s[number] * corner_s + along_t[number] * corner_t + offset[number]
    rows[:, 0, 3] = (arrangement.first_vertex[:-1] if colored else np.arange(len(arrangement)))[number]
    rows[:, 1, 3] = address[arrangement.shape_of][number]
    rows[:, 2, 3] = rows[:, 3, 3] = arrangement.morphs[number]
    rows[:, 3, :3] = _looks(arrangement)[number]
    return rows


def _to_patch(arrangement: Arrangement) -> NDArray[np.float64]:
    """(n, 3, 3) rows x, y, w for columns (s, t, 1), about the centre."""
    matrix = arrangement.matrices
    rows = np.swapaxes(np.linalg.inv(matrix), 1, 2)
    center = arrangement.points[arrangement.first_vertex[:-1]]
    rows[:, :2] -= center[:, :, None] * rows[:, 2:]
    # 1 at the centre, so that w is positive before infinity; everywhere where it is affine.
    return rows * np.einsum("nj,nj->n", np.column_stack([center, np.ones(len(center))]), matrix[:, :, 2])[:, None, None]


def _looks(arrangement: Arrangement) -> NDArray[np.float64]:
    """(n, 3): coverage, negative where mirrored; cosine and sine of the turn."""
    turn = turns(arrangement)
    coverage = arrangement.coverages if len(arrangement.coverages) else np.ones(len(arrangement))
    return np.column_stack([coverage * np.sign(np.linalg.det(turn)), turn[:, 0, 0], turn[:, 1, 0]])
