"""Shape diversification: the contour of another base as a second position of every vertex (the paper's section 4.3).

Another contour, rather a similar one, is scaled to the size of the base's, turned onto it and put into correspondence
(`umbrella_correspondence`). Vertices of the base go to corresponding points, a corner to a corner where one is near;
corners of the other contour that are left over become new, collinear vertices of the base. No weight in [0, 1] folds a
sector: its cross product is a quadratic in the weight (notes U2), so its least value is exact. Where a correspondence
by shape would fold, one that turns less about the centre takes its place, then a target nearer to the base.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel.textures.umbrella_geometry import cross, signed_area
from fexel_tools.umbrella_arrange import random_stream
from fexel_tools.umbrella_base import BaseUmbrella
from fexel_tools.umbrella_correspondence import Correspondence, Outline, best_turns, corresponding_arcs, shape_distances

__all__ = ["MorphOptions", "safe_share", "with_morphs"]

_RADIAL = (0.0, 0.5, 2.0, 8.0, math.inf)  # tried in turn: the last moves vertices along their spokes and never folds
_TURNS = 3  # candidates for the turn, compared by how well the contours then run together
_UPRIGHT = 0.02  # cost of half a turn: photos mostly show elements the same way up
_NEAR = 1.0 / 64.0  # of the perimeter: a vertex goes to a corner that its corresponding point is nearer to than this
_STRETCH = 3.0  # between two such corners at most
_MARGIN = 0.15  # of a sector's area, interpolated linearly, that must be left at every weight
_NO_AREA = 1e-9  # of a sector, relative to the contour's: what rounding leaves of a flat one
_SLIGHT = 1e-4  # of the contour's area: what the target may lose with a vertex, about a pixel of a 256 pixel texture
_STEPS = 20  # shares of the way to the target that are tried


@dataclass(frozen=True)
class MorphOptions:
    """How shapes vary.

    Attributes
    ----------
    amount : float
        Share of the way to the other contour at a morph of 1, in [0, 1]. 0: shapes do not vary.
    max_vertices : int
        No vertices are split in beyond that many, centre included.
    seed : int
        Chooses which base takes the shape of which.
    """

    amount: float = 1.0
    max_vertices: int = 96
    seed: int = 0


def with_morphs(bases: Sequence[BaseUmbrella], options: MorphOptions) -> list[BaseUmbrella]:
    """Give every base the contour of another as its `morph_points`, rather of a similar one.

    A single base takes its own mirror image. Vertices keep their order; new ones lie on edges in `points` and
    `tex_coords`, so that nothing changes at a morph of 0.

    Raises
    ------
    FexelError
        Options out of range.
    """
    if not 0.0 <= options.amount <= 1.0:
        raise FexelError(f"--morph-amount: {options.amount:g}, expected a number in [0, 1]")
    if options.amount == 0.0:
        return [dataclasses.replace(base, morph_points=base.points.copy()) for base in bases]
    target_of = _targets(bases, random_stream(options.seed, "morph target"))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(lambda base, target: _morphed(base, bases[target], options), bases, target_of))


def safe_share(points: NDArray[np.float64], morph_points: NDArray[np.float64]) -> float:
    """Share of the way to `morph_points` up to which a target leaves every sector a margin of area at any weight.

    Parameters
    ----------
    points, morph_points : (V, 2) float64
        The centre, then the contour, counter-clockwise.

    Returns
    -------
    float
        In [0, 1], to a twentieth. Sectors that are folded in `points` are left aside.
    """
    start, end = points[1:] - points[0], morph_points[1:] - morph_points[0]
    for step in range(_STEPS, 0, -1):
        if _is_safe(start, start + (step / _STEPS) * (end - start)):
            return step / _STEPS
    return 0.0


def _is_safe(start: NDArray[np.float64], end: NDArray[np.float64]) -> bool:
    """Least value over w in [0, 1] of each sector's cross product less the margin, which is linear in w."""
    following, way = np.roll(start, -1, axis=0), end - start
    following_way = np.roll(way, -1, axis=0)
    before, after = cross(start, following), cross(end, np.roll(end, -1, axis=0))
    bend = cross(way, following_way)
    slope = cross(start, following_way) + cross(way, following) - _MARGIN * (after - before)
    floor = -_NO_AREA * max(abs(signed_area(start)), abs(signed_area(end)))
    at = np.clip(np.divide(-0.5 * slope, bend, out=np.zeros_like(bend), where=bend > 1e-300), 0.0, 1.0)
    base = (1.0 - _MARGIN) * before
    least = np.minimum(np.minimum(base, base + slope + bend), base + (slope + bend * at) * at)
    return bool(np.all((least >= floor) | (before < floor)))


def _morphed(base: BaseUmbrella, other: BaseUmbrella, options: MorphOptions) -> BaseUmbrella:
    own = base.points[1:] - base.points[0]
    target = _fitted(own, _mirrored(own) if other is base else other.points[1:] - other.points[0])
    best, best_share = base, -1.0
    for radial in _RADIAL:
        split = _split(base, own, target, corresponding_arcs(own, target, radial), options)
        morph = split.points + options.amount * (split.morph_points - split.points)
        share = safe_share(split.points, morph)
        if share > best_share:
            morph = split.points + share * (morph - split.points)
            best, best_share = dataclasses.replace(split, morph_points=morph), share
        if share == 1.0:
            break
    return best


def _targets(bases: Sequence[BaseUmbrella], rng: np.random.Generator) -> NDArray[np.int64]:
    """Another base for each, by chance but rather a similar one; itself where there is no other."""
    distances = shape_distances([base.points[1:] - base.points[0] for base in bases])
    distances *= 0.5 + rng.random(distances.shape)
    np.fill_diagonal(distances, np.inf)
    return np.argmin(distances, axis=1)


def _mirrored(contour: NDArray[np.float64]) -> NDArray[np.float64]:
    """Left and right exchanged, counter-clockwise again."""
    return (contour * (-1.0, 1.0))[::-1]


def _fitted(own: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """The other contour at the size of this one and turned to run with it at least cost."""
    scaled = other * (_size(own) / max(_size(other), 1e-300))  # 1e-300: a contour without area
    candidates = [(turn, _turned(scaled, turn)) for turn in (0.0, *best_turns(own, scaled, _TURNS))]
    costs = [
        corresponding_arcs(own, turned).cost + _UPRIGHT * 0.5 * (1.0 - math.cos(turn)) for turn, turned in candidates
    ]
    return candidates[int(np.argmin(costs))][1]


def _size(contour: NDArray[np.float64]) -> float:
    """Geometric mean of what area and reach say: thin shapes neither outgrow round ones nor vanish beside them."""
    reach = float(np.linalg.norm(contour, axis=1).max())
    return math.sqrt(math.sqrt(abs(signed_area(contour))) * reach)


def _turned(contour: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    cosine, sine = math.cos(angle), math.sin(angle)
    return contour @ np.array([[cosine, sine], [-sine, cosine]])


def _split(
    base: BaseUmbrella,
    own: NDArray[np.float64],
    target: NDArray[np.float64],
    together: Correspondence,
    options: MorphOptions,
) -> BaseUmbrella:
    """The base with corners of the target split in, and where all vertices go."""
    outline, other = Outline(own), Outline(target)
    sharpened, taken = _corner_to_corner(outline, other, together)
    goes_to = sharpened.to_other(together.to_other(outline.arcs[:-1]))
    free = other.arcs[:-1][~taken]
    added = together.to_own(sharpened.to_own(free)) % 1.0
    rows = _merged(outline, added, other.at(goes_to), other.at(free), options.max_vertices - 1)
    arcs = np.concatenate([outline.arcs[:-1], added])[rows]
    is_new = rows >= len(own)
    contour, tex_coords = own[np.minimum(rows, len(own) - 1)], base.tex_coords[1:][np.minimum(rows, len(own) - 1)]
    contour[is_new] = outline.at(arcs[is_new])
    tex_coords[is_new] = outline.at(arcs[is_new], base.tex_coords[1:])
    morph = np.concatenate([other.at(goes_to), other.at(free)])[rows]
    centre = base.points[:1]
    return dataclasses.replace(
        base,
        points=np.concatenate([centre, centre + contour]),
        tex_coords=np.concatenate([base.tex_coords[:1], tex_coords]),
        morph_points=np.concatenate([centre, centre + morph]),
    )


def _corner_to_corner(
    outline: Outline, other: Outline, together: Correspondence
) -> tuple[Correspondence, NDArray[np.bool_]]:
    """Correction of the other's arcs that lets corners meet, and which of its corners have found one.

    Nearest pairs first; a pair that would stretch what lies between it and another one too much is left.
    """
    reached, corners = together.to_other(outline.arcs[:-1]), other.arcs[:-1]
    apart = _wrapped(corners[None, :] - reached[:, None])
    near = np.argwhere(np.abs(apart) < _NEAR)
    near = near[np.argsort(np.abs(apart[tuple(near.T)]), kind="stable")]
    pairs: list[tuple[float, float]] = []
    used, taken = np.zeros(len(reached), bool), np.zeros(len(corners), bool)
    for i, j in near:
        arc, corner = reached[i], reached[i] + apart[i, j]
        if used[i] or taken[j] or not all(_in_order(arc - a, corner - c) for a, c in pairs):
            continue
        used[i] = taken[j] = True
        pairs.append((arc, corner))
    if not pairs:
        return Correspondence(np.array([0.0, 1.0]), np.array([0.0, 1.0])), taken
    knots = np.array(sorted(pairs))
    knots = np.concatenate([knots, knots[:1] + 1.0])
    return Correspondence(knots[:, 0], knots[:, 1]), taken


def _in_order(step: float, corner_step: float) -> bool:
    step, corner_step = (value - round(value) for value in (step, corner_step))
    if abs(step) > 0.25:
        return True
    return step * corner_step > 0.0 and abs(step) < _STRETCH * abs(corner_step) < _STRETCH**2 * abs(step)


def _merged(
    outline: Outline,
    added: NDArray[np.float64],
    goes_to: NDArray[np.float64],
    corners: NDArray[np.float64],
    most: int,
) -> NDArray[np.int64]:
    """Order of own vertices and added ones around the outline; added ones that matter least to the target go.

    What a vertex matters is the area that the target loses without it (Visvalingam and Whyatt, 1993).
    """
    own_count = len(goes_to)
    arcs, ends = np.concatenate([outline.arcs[:-1], added]), np.concatenate([goes_to, corners])
    rows = np.argsort(arcs, kind="stable")
    slight = _SLIGHT * abs(signed_area(outline.corners))
    while np.any(rows >= own_count):
        place = ends[rows]
        area = 0.5 * np.abs(cross(place - np.roll(place, 1, axis=0), np.roll(place, -1, axis=0) - place))
        area[rows < own_count] = np.inf
        least = int(np.argmin(area))
        if len(rows) <= most and area[least] > slight:
            break
        rows = np.delete(rows, least)
    return rows


def _wrapped(arcs: NDArray[np.float64]) -> NDArray[np.float64]:
    return (arcs + 0.5) % 1.0 - 0.5
