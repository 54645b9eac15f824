"""Levels of detail as merged umbrellas: "Just-in-time texture synthesis" (2012), section 5, and a better way.

Level by level, the umbrellas of 2 x 2 cells become at most k. A merged umbrella has no texture; it is the convex hull
of its members, of few vertices, each with a colour.

``paper``: members are grouped by k-means of their centres, a hull is that of all of them, hidden or not, and opaque;
colours are means about each vertex.

``fitted``: only what is seen counts (notes U5, U9). Members are grouped by where they are seen and by colour, hulls are
those of their visible parts, and their coverage, the alpha, is the share of the hull in which they are seen. Last in
every cell lies a rectangle of the cell, the bed, so that no background shows between. Colours are then fitted to the
true picture, all of a level together.

Either way each level is made from the one before, down to a grid of one cell.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel.textures.umbrella_arrangement import Arrangement, Shape
from fexel_tools.umbrella_merge_colors import cosine_colors, fitted_colors
from fexel_tools.umbrella_merge_members import Members, all_members, visible_members
from fexel_tools.umbrella_merge_shapes import group, hull, signed_area_of
from fexel_tools.umbrella_raster import rasterize

__all__ = ["METHODS", "merged_levels"]

METHODS = ("fitted", "paper")

_PIXELS = 8  # of the picture that colours come from, along a cell of the level
_SAMPLES = 8  # along each of them
_COLOR_WEIGHT = 2.0  # cells that a difference of 1 in encoded colour is worth when members are grouped


@dataclass(frozen=True, eq=False)
class _Merged:
    """A merged umbrella: contour in st, centre, alpha, colour to begin with, and where it lies in the order."""

    contour: NDArray[np.float64]
    center: NDArray[np.float64]
    coverage: float
    color: NDArray[np.float64]
    order: float


def merged_levels(
    arrangement: Arrangement,
    textures: Sequence[NDArray | None],
    background: NDArray | Sequence[float] | None,
    *,
    method: str = "fitted",
    k: int | None = None,
    vertices: int = 9,
    background_wrap: tuple[str, str] = ("repeat", "repeat"),
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Arrangement]:
    """Merge an arrangement level by level.

    Parameters
    ----------
    arrangement : Arrangement
    textures, background, background_wrap, jobs
        As `fexel_tools.umbrella_raster.rasterize` takes them.
    method : str
        ``fitted`` or ``paper``.
    k : int, optional
        Most umbrellas that a cell of a level keeps, the bed included, at least 1. Default: as many as there are on
        average in a cell of the arrangement, at least 4, so that a level has at most a quarter of the one before.
    vertices : int
        Most vertices of a merged umbrella, the centre included, at least 4.
    progress : callable, optional
        Called with levels done and levels in all.

    Returns
    -------
    list of Arrangement
        Levels 1, 2, ... to the first of 1 x 1 cells; each has its own grid, shapes without images in st, coverages, and
        no shadows: they are in the colours. Empty for a grid of one cell, or where nothing is to be seen.

    Raises
    ------
    FexelError
        Unknown method, k below 1, fewer than four vertices.
    """
    if method not in METHODS:
        raise FexelError(f"levels of umbrellas: method is {method!r}, expected one of {', '.join(METHODS)}")
    cells = arrangement.grid[0] * arrangement.grid[1]
    k = max(4, round(len(arrangement) / cells)) if k is None else k
    if k < 1 or vertices < 4:
        raise FexelError(f"levels of umbrellas: k is {k} and vertices {vertices}, expected at least 1 and 4")
    source = _Source(arrangement, list(textures), background, background_wrap, jobs)
    count = (max(arrangement.grid) - 1).bit_length()
    levels: list[Arrangement] = []
    for level in range(1, count + 1):
        made = _level(source, levels[-1] if levels else arrangement, level, k, vertices, method)
        if made is None:
            break
        levels.append(made)
        if progress:
            progress(level, count)
    return levels


@dataclass(frozen=True, eq=False)
class _Source:
    """The full arrangement with all that it is drawn from."""

    arrangement: Arrangement
    textures: list[NDArray | None]
    background: NDArray | Sequence[float] | None
    background_wrap: tuple[str, str]
    jobs: int | None

    def picture(self, grid: tuple[int, int], *, with_umbrellas: bool = True) -> NDArray[np.float32]:
        """(H, W, 3) linear, premultiplied: as fine as the colours of a level of so many cells can tell."""
        none = np.zeros(0)
        nothing = Arrangement((), none.astype(np.int32), np.zeros((0, 3, 3)), none, np.zeros((0, 3), np.float32))
        return rasterize(
            self.arrangement if with_umbrellas else nothing,
            self.textures if with_umbrellas else [],
            self.background,
            (grid[0] * _PIXELS, grid[1] * _PIXELS),
            supersample=_SAMPLES,
            background_wrap=self.background_wrap,
            jobs=self.jobs,
        )[..., :3]


def _level(source: _Source, before: Arrangement, level: int, k: int, vertices: int, method: str) -> Arrangement | None:
    """A level from the one before; None where nothing is to be seen."""
    grid = _grid(source.arrangement.grid, level)
    truth = source.picture(grid)
    if method == "fitted":
        textures = source.textures if before is source.arrangement else [None] * len(before.shapes)
        members = visible_members(before, textures, truth, source.jobs)
    else:
        members = all_members(before)
    merged = _merge(members, source.arrangement.grid, level, k, vertices, method)
    if not merged:
        return None
    made = _arranged(merged, grid)
    if method == "paper":
        return replace(made, colors=cosine_colors(made, truth).clip(0, 1))
    start = np.repeat([each.color for each in merged], made.vertex_counts, axis=0).astype(np.float32).clip(0, 1)
    return replace(made, colors=fitted_colors(made, start, truth, source.picture(grid, with_umbrellas=False)))


def _grid(grid: tuple[int, int], level: int) -> tuple[int, int]:
    """Cells of a level: 2^level x 2^level of the full grid each, fewer at the far borders."""
    columns, rows = (-(-count // 2**level) for count in grid)
    return columns, rows


def _merge(members: Members, grid: tuple[int, int], level: int, k: int, vertices: int, method: str) -> list[_Merged]:
    """Merged umbrellas of all cells of a level, front to back."""
    index = np.minimum((members.place * grid).astype(np.int64), np.array(grid) - 1) >> level
    cell = index[:, 1] * _grid(grid, level)[0] + index[:, 0]
    order = np.argsort(cell, kind="stable")
    borders = np.flatnonzero(np.diff(cell[order])) + 1
    merged: list[_Merged] = []
    for chosen in np.split(order, borders) if len(order) else []:
        if method == "fitted":
            merged += _fitted_cell(members, chosen, grid, level, k, vertices)
        else:
            features = members.place[chosen] * grid
            groups = group(features, members.weight[chosen], k)
            for number in range(int(groups.max()) + 1):
                made = _paper_umbrella(members, chosen[groups == number], grid, vertices)
                merged += [made] if made else []
    return sorted(merged, key=lambda each: each.order)


def _paper_umbrella(
    members: Members, chosen: NDArray[np.int64], grid: tuple[int, int], vertices: int
) -> _Merged | None:
    contour = hull(members.points_of(chosen) * grid, vertices - 1) / grid
    if not len(contour):
        return None
    center = members.place[chosen].mean(axis=0)
    center = center if _sees(center, contour) else _centroid(contour)
    return _Merged(contour, center, 1.0, np.zeros(3), float(members.rank[chosen].mean()))


def _fitted_cell(
    members: Members, chosen: NDArray[np.int64], grid: tuple[int, int], level: int, k: int, vertices: int
) -> list[_Merged]:
    """Hulls of groups, the smallest on top, and the bed below all."""
    merged = [_bed(members, chosen, grid, level, vertices)]
    if k == 1:
        return merged
    encoded = np.sqrt(members.color[chosen].clip(0, None))
    features = np.concatenate([members.place[chosen] * grid / 2**level, _COLOR_WEIGHT * encoded], axis=1)
    groups = group(features, members.weight[chosen], k - 1)
    for number in range(int(groups.max()) + 1):
        of_group = chosen[groups == number]
        contour = hull(members.points_of(of_group) * grid, vertices - 1) / grid
        if not len(contour):
            continue
        weight = members.weight[of_group]
        area = signed_area_of(contour)
        coverage = min(1.0, float(weight.sum()) / area)
        color = np.average(members.color[of_group], axis=0, weights=weight)
        merged.append(_Merged(contour, _centroid(contour), coverage, color, area))
    return merged


def _bed(members: Members, chosen: NDArray[np.int64], grid: tuple[int, int], level: int, vertices: int) -> _Merged:
    """The rectangle of a cell, as opaque as umbrellas cover it; its sides are halved where vertices suffice."""
    index = np.minimum((members.place[chosen[0]] * grid).astype(np.int64), np.array(grid) - 1) >> level
    low = index * 2**level / np.array(grid)
    high = np.minimum((index + 1) * 2**level / np.array(grid), 1.0)
    unit = np.array([[0, 0], [0.5, 0], [1, 0], [1, 0.5], [1, 1], [0.5, 1], [0, 1], [0, 0.5]])
    contour = low + (unit if vertices >= 9 else unit[::2]) * (high - low)
    weight = members.weight[chosen]
    coverage = min(1.0, float(weight.sum() / (high - low).prod()))
    return _Merged(
        contour, (low + high) / 2, coverage, np.average(members.color[chosen], axis=0, weights=weight), np.inf
    )


def _centroid(contour: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centre of area of a convex polygon."""
    origin = contour.mean(axis=0)
    a, b = contour - origin, np.roll(contour, -1, axis=0) - origin
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return origin + (cross[:, None] * (a + b)).sum(axis=0) / (3 * cross.sum())


def _sees(center: NDArray[np.float64], contour: NDArray[np.float64]) -> bool:
    """Whether a point lies inside of a convex contour."""
    a, b = contour - center, np.roll(contour, -1, axis=0) - center
    return bool((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0).all())


def _arranged(merged: Sequence[_Merged], grid: tuple[int, int]) -> Arrangement:
    shapes = []
    for each in merged:
        points = np.concatenate([each.center[None], each.contour])
        shapes.append(Shape(points, points, np.zeros_like(points)))
    count = len(merged)
    return Arrangement(
        tuple(shapes),
        np.arange(count, dtype=np.int32),
        np.broadcast_to(np.eye(3), (count, 3, 3)).copy(),
        np.zeros(count),
        np.zeros((0, 3), np.float32),
        grid,
        coverages=np.array([each.coverage for each in merged]),
    )
