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
  (at a morph of 0, the way to one of 1), whose first `_AFTER` vertices follow again after the last, and tex coords (of
  a vertex and of the next) for each sector.

The half-float page has the vertex colours, umbrella by umbrella.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fexel.textures.atlas import Box
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.page_format import FLOAT, HALF
from fexel.textures.pyramid_cache import ImageFacts
from fexel.textures.umbrella_arrangement import Arrangement, Shape
from fexel.textures.umbrella_cells import Cells, build_cells
from fexel.textures.umbrella_geometry import FULL_TURN, pseudo_angle, turns

__all__ = ["ArrangementSource", "ArrangementTexels", "ColorSource", "Layout"]

_ROW_BITS = 10
_MOST_ROWS = 4096  # rows get longer where this many do not hold all
_LOW = 2048  # whole numbers that half floats hold
_AFTER = 19  # vertices that follow again after the last: so far UMBRELLA_TRIES rounds of two sectors reach
_MOST_BINS = 1024
_SLICES = 8  # tables of a shape that morphs


@dataclass(frozen=True)
class ArrangementSource:
    """An arrangement over a grid of cells.

    Attributes
    ----------
    arrangement : Arrangement
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


@dataclass(frozen=True)
class ColorSource:
    """Vertex colours of an arrangement."""

    arrangement: Arrangement


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
        Cells along s and t.
    """

    stride: int
    bins: int
    slices: int
    morphs: bool
    size: tuple[int, int]


class ArrangementTexels:
    """Reads `ArrangementSource` and `ColorSource`; see `fexel.textures.pool.TexelReader`."""

    def __init__(self, kept: KeptTexels | None = None) -> None:
        self._kept = kept or KeptTexels()
        self._layouts: dict[ArrangementSource, Layout] = {}
        self._sizes: dict[ArrangementSource | ColorSource, tuple[int, int]] = {}

    def layout(self, source: ArrangementSource) -> Layout:
        """Where things lie."""
        self._texels(source)
        return self._layouts[source]

    def row_bits(self, source: ArrangementSource | ColorSource) -> int:
        """Log2 of the texels in a row."""
        self._texels(source)
        return self._sizes[source][0].bit_length() - 1

    def facts(self, source: ArrangementSource | ColorSource, _path: str) -> ImageFacts:
        """Size and page class; there is level 0 alone."""
        self._texels(source)
        page_class = FLOAT if isinstance(source, ArrangementSource) else HALF
        return ImageFacts(self._sizes[source], page_class, ("clamp", "clamp"), None, has_levels=False)

    def window(self, source: ArrangementSource | ColorSource, _path: str, _level: int, box: Box) -> NDArray:
        """Texels of a window with its border."""
        texels = np.pad(self._texels(source), ((1, 1), (1, 1), (0, 0)))
        return np.ascontiguousarray(texels[box[1] : box[3] + 2, box[0] : box[2] + 2])

    def _texels(self, source: ArrangementSource | ColorSource) -> NDArray:
        texels = self._kept.get(source)
        if texels is None:
            if isinstance(source, ArrangementSource):
                flat, self._layouts[source] = _written(source)
            else:
                flat = _color_texels(source.arrangement)
            texels = _in_rows(flat)
            self._sizes[source] = texels.shape[1], texels.shape[0]
            self._kept.keep(source, texels, texels.nbytes)
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
        colors[:, :3] = arrangement.colors
        number = np.arange(len(arrangement))
        colors[:, 3] = np.repeat(number // _LOW, arrangement.vertex_counts)
        colors[arrangement.first_vertex[:-1], 3] = number % _LOW
    return colors


def _written(source: ArrangementSource) -> tuple[NDArray[np.float32], Layout]:
    arrangement = source.arrangement
    # Shadows are looked for in the cell that they fall from.
    cells = build_cells(arrangement, source.size, source.margin, opaque=np.array(source.opaque, bool), shadows=False)
    morphs = bool((arrangement.morphs != 0).any()) and any(
        (shape.points != shape.morph_points).any() for shape in arrangement.shapes
    )
    stride = 3 if arrangement.is_affine else 4
    blocks, bins, slices = _shape_blocks(arrangement.shapes, morphs)
    first = len(cells.counts)
    lengths = [first, stride * len(cells.umbrella), *(len(block) for block in blocks)]
    address = np.cumsum(lengths)[1:-1] if blocks else np.zeros(0, np.int64)
    rows = _entry_rows(cells, arrangement, address, source.colored)
    rows = rows if stride == 4 else rows[:, [0, 1, 3]]
    heads = np.zeros((first, 4), np.float32)
    heads[:, 0], heads[:, 1] = first + stride * cells.first[:-1], cells.counts
    layout = Layout(stride, bins, slices, morphs, cells.size)
    tables = [block.astype(np.float32) for block in blocks]
    return np.concatenate([heads, rows.reshape(-1, 4), *tables]), layout


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


def _shape_blocks(shapes: tuple[Shape, ...], morphs: bool) -> tuple[list[NDArray[np.float64]], int, int]:
    """Texels of each shape; bins and slices of their tables."""
    most = max((len(shape.points) for shape in shapes), default=1)
    bins = min(_MOST_BINS, 2 ** math.ceil(math.log2(4 * most)))
    slices = _SLICES if morphs else 1
    images = np.cumsum([shape.image is not None for shape in shapes]) - 1
    blocks = []
    for number, shape in enumerate(shapes):
        own = _Contour(shape)
        head = [*shape.tex_coords[0], images[number] if shape.image else -1, own.sectors]
        blocks.append(np.concatenate([[head], own.tables(bins, slices), own.vertices, own.tex_coords]))
    return blocks, bins, slices


@dataclass(frozen=True, eq=False)
class _Contour:
    """A shape about its centre."""

    shape: Shape

    @property
    def sectors(self) -> int:
        return len(self.shape.points) - 1

    @cached_property
    def spokes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """At a morph of 0, and on the way to one of 1."""
        start, end = (points[1:] - points[0] for points in (self.shape.points, self.shape.morph_points))
        return start, end - start

    @property
    def vertices(self) -> NDArray[np.float64]:
        start, way = self.spokes
        index = np.arange(self.sectors + _AFTER) % self.sectors
        return np.concatenate([start, way], axis=1)[index]

    @property
    def tex_coords(self) -> NDArray[np.float64]:
        contour = self.shape.tex_coords[1:]
        return np.concatenate([contour, np.roll(contour, -1, axis=0)], axis=1)

    def tables(self, bins: int, slices: int) -> NDArray[np.float64]:
        """(slices * bins, 4): for each bin, and each part of the range of the morph, the first sector that it may need.

        Seen from the centre a vertex that morphs turns one way only, so the sectors at both ends of a part tell.
        """
        angle = np.arange(bins) * (FULL_TURN / bins)
        at = [self._sectors_at(angle, morph) for morph in np.linspace(0, 1, slices + 1)]
        if slices == 1:
            at[1] = at[0]
        tables = np.zeros((slices * bins, 4))
        for number, (begin, end) in enumerate(itertools.pairwise(at)):
            ahead = np.mod(end - begin, self.sectors)
            first = np.where(ahead <= self.sectors // 2, begin, end)
            tables[number * bins : (number + 1) * bins, 0] = first
        return tables

    def _sectors_at(self, angle: NDArray[np.float64], morph: float) -> NDArray[np.int64]:
        start, way = self.spokes
        spoke = pseudo_angle(start + morph * way)
        order = np.argsort(spoke, kind="stable")
        return order[np.searchsorted(spoke[order], angle, "right") - 1]
