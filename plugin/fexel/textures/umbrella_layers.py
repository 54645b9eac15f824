"""Umbrellas composited at points, front to back, in float64 NumPy: what one level of detail of a texture shows.

Points look through the lists of their cells rank by rank, all points at once; one that is opaque looks no further.
"""

from __future__ import annotations

from collections.abc import Sequence
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
class _Hit:
    """What umbrellas show at points.

    Attributes
    ----------
    alpha : (M,)
        Coverage of the contour alone.
    weights : (M, 3)
        In the sector, within the contour.
    slopes : (M, 3, 2)
        Derivatives of the unbounded weights per pixel.
    vertices : 3 arrays (M,)
    """

    alpha: NDArray[np.float64]
    weights: NDArray[np.float64]
    slopes: NDArray[np.float64]
    vertices: tuple[NDArray[np.int64], ...]


class ArrangementTwin:
    """An arrangement that can be looked up.

    Parameters
    ----------
    arrangement : Arrangement
    images : sequence of TwinImage or None
        Of each shape.
    turns_vectors : bool
        Whether texels are encoded vectors, which turn with the umbrellas.
    """

    def __init__(
        self, arrangement: Arrangement, images: Sequence[TwinImage | None], turns_vectors: bool = False
    ) -> None:
        self.arrangement = arrangement
        self._images = images
        self._turns = turns(arrangement) if turns_vectors else None
        self._sectors = Sectors(arrangement)
        self._cells: dict[float, Cells] = {}

    @cached_property
    def _opaque(self) -> NDArray[np.bool_]:
        return np.array([image is None or image.is_opaque for image in self._images], bool)

    @cached_property
    def _inverses(self) -> NDArray[np.float64]:
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
        self, st: NDArray[np.float64], axes: NDArray[np.float64], background: NDArray[np.float64], hard: bool
    ) -> NDArray[np.float64]:
        """Look up points.

        Parameters
        ----------
        st : (M, 2) float64
            In [0, 1]^2.
        axes : (M, 2, 2) float64
            d(st)/d(pixel).
        background : (M, 4) float64
            What lies behind, linear, premultiplied.
        hard : bool
            Edges are not softened.

        Returns
        -------
        (M, 4) float64
            Linear, premultiplied.
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
        light = self._light(lit)[:, None]
        return result + through[:, None] * background * np.concatenate([light, light, light, np.ones_like(light)], 1)

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
        at, umbrella = points[which], cells.umbrella[entry[which]]
        color, alpha = self._seen(umbrella, st[at] + cells.shift[entry[which]], axes[at], hard)
        share = (alpha * through[at])[:, None]
        result[at] += share * np.concatenate([color * self._light(lit[at])[:, None], np.ones((len(at), 1))], axis=1)
        through[at] *= 1.0 - alpha
        if self.arrangement.shadow_strength > 0:
            which = np.flatnonzero(flags & CASTS)
            at = points[which]
            place = st[at] + cells.shift[entry[which]] - self.arrangement.shadow_offset
            lit[at] *= 1.0 - self._alpha(cells.umbrella[entry[which]], place, axes[at], hard)

    def _seen(
        self, umbrella: NDArray[np.int32], st: NDArray[np.float64], axes: NDArray[np.float64], hard: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Straight colours (M, 3) and alphas (M,) of umbrellas."""
        hit = self._hit(umbrella, st, axes, hard)
        color = np.zeros((len(umbrella), 3))
        alpha = hit.alpha * self._coverages[umbrella]
        used = np.flatnonzero(alpha > 0)
        color[used], opacity = self._textured(umbrella[used], hit, used, alpha_only=False)
        alpha[used] *= opacity
        offsets = self.arrangement.colors
        if len(offsets):
            mixed = sum(hit.weights[used, k, None] * offsets[hit.vertices[k][used]] for k in range(3))
            color[used] += self.arrangement.color_blend * mixed
        color[used] = np.clip(color[used], 0.0, 1.0)
        if self._turns is not None:
            vectors = np.einsum("nij,nj->ni", self._turns[umbrella[used]], 2.0 * color[used, :2] - 1.0)
            color[used, :2] = 0.5 * (vectors + 1.0)
        return color, alpha

    def _alpha(
        self, umbrella: NDArray[np.int32], st: NDArray[np.float64], axes: NDArray[np.float64], hard: bool
    ) -> NDArray[np.float64]:
        """(M,) alphas alone."""
        hit = self._hit(umbrella, st, axes, hard)
        alpha = hit.alpha * self._coverages[umbrella]
        used = np.flatnonzero(alpha > 0)
        alpha[used] *= self._textured(umbrella[used], hit, used, alpha_only=True)[1]
        return alpha

    def _hit(self, umbrella: NDArray[np.int32], st: NDArray[np.float64], axes: NDArray[np.float64], hard: bool) -> _Hit:
        point, slope = _mapped(self._inverses[umbrella], st, axes)
        sectors = self._sectors
        sector = sectors.find(umbrella, point)
        weights, drawn = sectors.barycentric(umbrella, sector, point)
        area = np.where(drawn, sectors.areas[sector], 1.0)
        begin, end = sectors.spokes[sector], sectors.spokes[sectors.following[sector]]
        per_point = np.stack([end[:, 1], -end[:, 0], -begin[:, 1], begin[:, 0]], axis=1).reshape(-1, 2, 2)
        per_pixel = per_point / area[:, None, None] @ slope  # of the weights of both contour vertices
        slopes = np.concatenate([-per_pixel.sum(axis=1, keepdims=True), per_pixel], axis=1)
        steepness = np.zeros(len(st)) if hard else np.hypot(slopes[:, 0, 0], slopes[:, 0, 1])
        soft = np.clip(0.5 + weights[:, 0] / np.where(steepness > 0, steepness, 1.0), 0.0, 1.0)
        alpha = np.where(steepness > 0, soft, weights[:, 0] >= 0) * drawn
        # Beyond the contour, within half a pixel of it, the nearest point toward the centre is shown.
        beyond = np.maximum(weights[:, 1] + weights[:, 2], 1.0)
        weights = np.stack([np.maximum(weights[:, 0], 0.0), weights[:, 1] / beyond, weights[:, 2] / beyond], axis=1)
        return _Hit(alpha, weights, slopes, sectors.vertices_of(umbrella, sector))

    def _textured(
        self, umbrella: NDArray[np.int32], hit: _Hit, used: NDArray[np.int64], *, alpha_only: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Straight colours and opacities of images at some of the hits; black and 1 without an image."""
        color, opacity = np.zeros((len(used), 3)), np.ones(len(used))
        shape_of = self.arrangement.shape_of[umbrella]
        for number, image in enumerate(self._images):
            which = np.flatnonzero(shape_of == number) if image is not None else []
            if image is None or not len(which) or (alpha_only and image.is_opaque):
                continue
            at = used[which]
            corners = np.stack([self._tex_coords[vertices[at]] for vertices in hit.vertices], axis=1)
            uv = np.einsum("mk,mki->mi", hit.weights[at], corners)
            axes = np.einsum("mki,mkj->mij", corners, hit.slopes[at])
            texel = image.sample(uv, axes)
            color[which] = texel[:, :3] / np.maximum(texel[:, 3:], 1e-6)  # 1e-6 guards what is nearly transparent
            opacity[which] = texel[:, 3]
        return color, opacity


def _mapped(
    matrix: NDArray[np.float64], st: NDArray[np.float64], axes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Each point through its own matrix, with its Jacobian; at or behind infinity far away from all umbrellas."""
    mapped = np.einsum("mi,mij->mj", st, matrix[:, :2]) + matrix[:, 2]
    front = mapped[:, 2] > 0
    w = np.where(front, mapped[:, 2], 1.0)[:, None]
    point = np.where(front[:, None], mapped[:, :2] / w, 1e15)
    linear = np.swapaxes(matrix[:, :2, :2], 1, 2) - point[:, :, None] * matrix[:, None, :2, 2]
    return point, linear @ axes / w[:, :, None]
