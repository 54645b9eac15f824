"""Umbrellas composited at points, front to back, in float64 NumPy: what one level of detail of a texture shows.

Points look through the lists of their cells rank by rank, all points at once; one that is opaque looks no further.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fexel.textures.umbrella_arrangement import Arrangement
from fexel.textures.umbrella_cells import CASTS, VISIBLE, Cells, build_cells, fine_size
from fexel.textures.umbrella_geometry import turns
from fexel.textures.umbrella_images import TwinImage
from fexel.textures.umbrella_sectors import Sectors

__all__ = ["ArrangementTwin"]

_LARGEST_MARGIN = 0.5  # cells of the authored grid: lists reach no further, softer edges than a cell are cut off there


@dataclass(frozen=True, eq=False)
class _Hits:
    """Where points lie in umbrellas.

    Attributes
    ----------
    umbrella, sector : (M,) int
    axes : (M, 2, 2)
        Derivative in patch space per pixel.
    weights : (M, 3)
        In the sector; the centre's is negative outside of the contour.
    alpha : (M,)
        Coverage of the contour alone.
    """

    umbrella: NDArray[np.int32]
    sector: NDArray[np.int64]
    axes: NDArray[np.float64]
    weights: NDArray[np.float64]
    alpha: NDArray[np.float64]

    def take(self, which: NDArray[np.int64]) -> _Hits:
        """Some of them."""
        arrays = (self.umbrella, self.sector, self.axes, self.weights, self.alpha)
        return _Hits(*(array[which] for array in arrays))

    @property
    def within(self) -> NDArray[np.float64]:
        """(M, 3) weights of the nearest point toward the centre that lies within the contour."""
        beyond = np.maximum(self.weights[:, 1:].sum(axis=1, keepdims=True), 1.0)
        return np.concatenate([np.maximum(self.weights[:, :1], 0.0), self.weights[:, 1:] / beyond], axis=1)


class ArrangementTwin:
    """An arrangement that can be looked up.

    Parameters
    ----------
    arrangement : Arrangement
    images : sequence of TwinImage or None
        Of each shape.
    vector_hand : int
        Whether texels are encoded vectors, which turn with the umbrellas, and which way: `UmbrellaData.vector_hand`.
    """

    def __init__(self, arrangement: Arrangement, images: Sequence[TwinImage | None], vector_hand: int = 0) -> None:
        self.arrangement = arrangement
        self._images = images
        # Where one axis of vectors runs backward, turns are mirrored: they change the sign of what they mix.
        self._turns = turns(arrangement) * [[1, vector_hand], [vector_hand, 1]] if vector_hand else None
        self._sectors = Sectors(arrangement)
        self._cells: dict[float, Cells] = {}

    def looking(self, arrangement: Arrangement) -> ArrangementTwin:
        """The same umbrellas with another blend or another strength of shadows, not none: what is known is shared."""
        other = copy(self)
        other.arrangement = arrangement
        return other

    @cached_property
    def _opaque(self) -> NDArray[np.bool_]:
        return np.array([image is None or image.is_opaque for image in self._images], bool)

    @cached_property
    def _inverses(self) -> NDArray[np.float64]:
        """(n, 3, 3) st to patch space."""
        return np.linalg.inv(self.arrangement.matrices)

    @cached_property
    def _coverages(self) -> NDArray[np.float64]:
        coverages = self.arrangement.coverages
        return coverages if len(coverages) else np.ones(len(self.arrangement))

    @cached_property
    def _tex_coords(self) -> NDArray[np.float64]:
        """(total, 2)."""
        return np.concatenate([shape.tex_coords for shape in self.arrangement.shapes])[self.arrangement.shape_vertex]

    def _cells_for(self, reach: float) -> Cells:
        """Lists that serve footprints up to `reach` cells of the authored grid, rounded up to a power of two."""
        margin = 0.0 if reach <= 0 else min(2.0 ** np.ceil(np.log2(max(reach, 1e-3))), _LARGEST_MARGIN)
        if margin not in self._cells:
            grid = self.arrangement.grid
            size = fine_size(self.arrangement)
            room = (margin / grid[0], margin / grid[1])
            self._cells[margin] = build_cells(self.arrangement, size, room, opaque=self._opaque)
        return self._cells[margin]

    def sample(
        self, st: NDArray[np.float64], axes: NDArray[np.float64], hard: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Look up points.

        Parameters
        ----------
        st : (M, 2) float64
            In [0, 1]^2.
        axes : (M, 2, 2) float64
            d(st)/d(pixel).
        hard : bool
            Edges are not softened.

        Returns
        -------
        color : (M, 4) float64
            Of the umbrellas, linear, premultiplied.
        through : (M,) float64
            How much of what lies behind is seen.
        light : (M,) float64
            That reaches it.
        """
        result, through, lit = np.zeros((len(st), 4)), np.ones(len(st)), np.ones(len(st))
        if len(self.arrangement):
            cells_per_pixel = np.abs(axes).sum(axis=2) * self.arrangement.grid
            cells = self._cells_for(0.0 if hard else 0.5 * float(cells_per_pixel.max(initial=0.0)))
            cell = cells.find(st)
            entry, end = cells.first[cell], cells.first[cell + 1]
            active = np.flatnonzero(entry < end)
            while len(active):
                self._add(cells, entry[active], active, st, axes, hard, (result, through, lit))
                entry[active] += 1
                active = active[(entry[active] < end[active]) & (through[active] > 0)]
        return result, through, self._light(lit)

    def _light(self, lit: NDArray[np.float64]) -> NDArray[np.float64]:
        """Share of light where `lit` of it is not in the shadow of another."""
        return 1.0 - self.arrangement.shadow_strength * (1.0 - lit)

    def _add(
        self,
        cells: Cells,
        entry: NDArray[np.int64],
        points: NDArray[np.int64],
        st: NDArray[np.float64],
        axes: NDArray[np.float64],
        hard: bool,
        state: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
    ) -> None:
        """One umbrella at each of some points; `state` is colour so far, what is let through, what is lit."""
        result, through, lit = state
        flags = cells.flags[entry]
        which = np.flatnonzero(flags & VISIBLE)
        at = points[which]
        hits = self._hits(cells.umbrella[entry[which]], st[at] + cells.shift[entry[which]], axes[at], hard)
        used = np.flatnonzero(hits.alpha > 0)
        at, color, alpha = at[used], *self._seen(hits.take(used))
        share = alpha * through[at]
        result[at, :3] += (share * self._light(lit[at]))[:, None] * color
        result[at, 3] += share
        through[at] *= 1.0 - alpha
        if self.arrangement.shadow_strength > 0:
            which = np.flatnonzero(flags & CASTS)
            at = points[which]
            place = st[at] + cells.shift[entry[which]] - self.arrangement.shadow_offset
            hits = self._hits(cells.umbrella[entry[which]], place, axes[at], hard)
            used = np.flatnonzero(hits.alpha > 0)
            lit[at[used]] *= 1.0 - self._opacities(hits.take(used))

    def _seen(self, hits: _Hits) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Straight colours (M, 3) and alphas (M,)."""
        weights = hits.within
        color, opacity = self._textured(hits, weights, np.ones(len(self._images), bool))
        colors = self.arrangement.colors
        if len(colors):
            vertices = self._sectors.vertices_of(hits.umbrella, hits.sector)
            mixed = sum(weights[:, k, None] * colors[vertices[k]] for k in range(3))
            color += self.arrangement.color_blend * mixed
        color = np.clip(color, 0.0, 1.0)
        if self._turns is not None:
            vectors = np.einsum("nij,nj->ni", self._turns[hits.umbrella], 2.0 * color[:, :2] - 1.0)
            color[:, :2] = 0.5 * (vectors + 1.0)
        return color, hits.alpha * opacity * self._coverages[hits.umbrella]

    def _opacities(self, hits: _Hits) -> NDArray[np.float64]:
        """(M,) alphas alone."""
        opacity = self._textured(hits, hits.within, ~self._opaque)[1]
        return hits.alpha * opacity * self._coverages[hits.umbrella]

    def _hits(
        self, umbrella: NDArray[np.int32], st: NDArray[np.float64], axes: NDArray[np.float64], hard: bool
    ) -> _Hits:
        """Where points lie in umbrellas, and how much of a pixel those cover."""
        point, axes = _mapped(self._inverses[umbrella], st, axes, self.arrangement.is_affine)
        sectors = self._sectors
        sector = sectors.find(umbrella, point)
        weights, drawn = sectors.barycentric(umbrella, sector, point)
        alpha = (weights[:, 0] >= 0).astype(np.float64)
        if not hard:
            across = sectors.spokes[sectors.following[sector]] - sectors.spokes[sector]
            slope_x, slope_y = (across[:, 0] * axes[:, 1, k] - across[:, 1] * axes[:, 0, k] for k in (0, 1))
            steepness = np.hypot(slope_x, slope_y)  # of the centre's weight times the sector's area
            steep = steepness > 0
            distance = weights[:, 0] * sectors.areas[sector] / np.where(steep, steepness, 1.0)
            # Beyond a tip, where the edge runs along the ray from the centre, it ends a pixel further along that ray.
            ray = (point - sectors.centers[umbrella]) * (1.0 - 1.0 / np.maximum(1.0 - weights[:, :1], 1.0))
            (a, b), (c, d) = np.moveaxis(axes, 0, -1)
            area = np.abs(a * d - b * c)
            reach = np.hypot(ray[:, 0] * d - ray[:, 1] * b, ray[:, 1] * a - ray[:, 0] * c)
            tip = 1.0 - reach / np.where(area > 0, area, 1.0)
            alpha = np.where(steep, np.clip(np.minimum(0.5 + distance, tip), 0.0, 1.0), alpha)
        return _Hits(umbrella, sector, axes, weights, alpha * drawn)

    def _textured(
        self, hits: _Hits, weights: NDArray[np.float64], shapes: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Straight colours and opacities of the images of some shapes; black and 1 for all others."""
        color, opacity = np.zeros((len(weights), 3)), np.ones(len(weights))
        shape_of = self.arrangement.shape_of[hits.umbrella]
        for number, image in enumerate(self._images):
            which = np.flatnonzero(shape_of == number) if image is not None and shapes[number] else ()
            if image is None or not len(which):
                continue
            some = hits.take(which)
            vertices = self._sectors.vertices_of(some.umbrella, some.sector)
            center, begin, end = (self._tex_coords[vertex] for vertex in vertices)
            uv = sum(weights[which, k, None] * corner for k, corner in enumerate((center, begin, end)))
            slopes = self._slopes(some)
            axes = (begin - center)[:, :, None] * slopes[0][:, None] + (end - center)[:, :, None] * slopes[1][:, None]
            texel = image.sample(uv, axes)
            color[which] = texel[:, :3] / np.maximum(texel[:, 3:], 1e-6)  # 1e-6 guards what is nearly transparent
            opacity[which] = texel[:, 3]
        return color, opacity

    def _slopes(self, hits: _Hits) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Derivatives (M, 2) per pixel of the weights of both contour vertices."""
        begin, end = self._sectors.spokes[hits.sector], self._sectors.spokes[self._sectors.following[hits.sector]]
        inverse = 1.0 / self._sectors.areas[hits.sector][:, None]
        of_begin = (end[:, 1, None] * hits.axes[:, 0] - end[:, 0, None] * hits.axes[:, 1]) * inverse
        of_end = (begin[:, 0, None] * hits.axes[:, 1] - begin[:, 1, None] * hits.axes[:, 0]) * inverse
        return of_begin, of_end


def _mapped(
    matrix: NDArray[np.float64], st: NDArray[np.float64], axes: NDArray[np.float64], is_affine: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Each point through its own matrix, with its Jacobian; at or behind infinity far away from all umbrellas."""
    mapped = st[:, :1] * matrix[:, 0] + st[:, 1:] * matrix[:, 1] + matrix[:, 2]
    slopes = matrix[:, 0, :, None] * axes[:, 0, None] + matrix[:, 1, :, None] * axes[:, 1, None]
    if is_affine:
        return mapped[:, :2], slopes[:, :2]
    front = mapped[:, 2:] > 0
    w = np.where(front, mapped[:, 2:], 1.0)
    point = np.where(front, mapped[:, :2] / w, 1e15)
    return point, (slopes[:, :2] - point[:, :, None] * slopes[:, 2:]) / w[:, :, None]
