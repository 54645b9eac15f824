"""Arrays of UmbrellaTexture, UmbrellaPatch and UmbrellaLevel prims as shapes and arrangements, repaired where possible.

What cannot be drawn is left out, what can be mended is mended, and each fault is said once per prim: attribute, first
entry, how many more. No file is touched. The whole is vectorised over umbrellas: there may be a hundred thousand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from fexel.textures.image_source import ImageSource
from fexel.textures.inputs import Inputs, warn
from fexel.textures.umbrella_arrangement import Arrangement, Shape
from fexel.textures.umbrella_geometry import fold_weight, is_star_shaped, signed_area

__all__ = ["MIN_VERTICES", "PatchArrays", "placed_in_unit_square", "read_arrangement", "read_level", "read_patch"]

MIN_VERTICES = 4
"""A centre and a triangle around it."""

_SINGULAR = 1e-12  # area of a matrix's image of the unit square over the lengths of its sides
_MOST_PERIODS = 16  # across an umbrella: beyond it a matrix is taken for damaged, and cells would list it without end
_NO_COLORS = np.zeros((0, 3), np.float32)


@dataclass(frozen=True, eq=False)
class PatchArrays:
    """A base umbrella and how its prim says it.

    Attributes
    ----------
    path : str
    shape : Shape
        Without vertices where it cannot be drawn.
    vertices : int
        That the prim's ``points`` has: so many colours its umbrellas have.
    is_turned : bool
        Its contour runs clockwise in the prim.
    fold_weight : float
        Largest morph that does not fold.
    """

    path: str
    shape: Shape
    vertices: int
    is_turned: bool = False
    fold_weight: float = 1.0


def array_of(prim: Usd.Prim, name: str, time: Usd.TimeCode, dtype: Any, *shape: int) -> NDArray[Any]:
    """An array attribute at one time, (k, *shape); empty where there is no value."""
    attribute = prim.GetAttribute(name)
    value = attribute.Get(time) if attribute else None
    return np.array([] if value is None else value, dtype).reshape(-1, *shape)


def read_patch(prim: Usd.Prim, time: Usd.TimeCode, color_space: str) -> PatchArrays:
    """Read an UmbrellaPatch.

    Parameters
    ----------
    prim : Usd.Prim
    time : Usd.TimeCode
    color_space : str
        Of its image where the prim says nothing: ``auto``, ``raw`` or ``sRGB``.

    Warns
    -----
    FexelWarning
        Once: too few points, lengths that disagree, values that are not finite, a contour that the centre does not see.
    """
    inputs = Inputs(prim, time, namespace="")
    path, file = str(prim.GetPath()), inputs.asset("file")
    points = array_of(prim, "points", time, np.float64, 2)
    tex_coords = array_of(prim, "texCoords", time, np.float64, 2)
    fault = _patch_fault(points, tex_coords, bool(file))
    if fault:
        warn(prim, *fault)
        nothing = np.zeros((0, 2))
        return PatchArrays(path, Shape(nothing, nothing, nothing), len(points))
    if not file or not len(tex_coords):
        tex_coords = np.zeros_like(points)
    morph_points = _morph_points(prim, array_of(prim, "morphPoints", time, np.float64, 2), points)
    is_turned = signed_area(points[1:]) < 0
    if is_turned:
        points, tex_coords, morph_points = (_turned(array) for array in (points, tex_coords, morph_points))
    if not is_star_shaped(points):
        warn(prim, "points", "the centre does not see the whole contour; only the sectors that turn forward are drawn")
    space = inputs.color_space()
    source = ImageSource(file, "", color_space if space == "auto" else space, ("clamp", "clamp")) if file else None
    shape = Shape(points, morph_points, tex_coords, source)
    return PatchArrays(path, shape, len(points), is_turned, fold_weight(points, morph_points))


def _patch_fault(points: NDArray, tex_coords: NDArray, has_file: bool) -> tuple[str, str] | None:
    """Attribute and why the patch cannot be drawn."""
    left_out = "its umbrellas are left out"
    if len(points) < MIN_VERTICES:
        expected = f"a centre and at least {MIN_VERTICES - 1} contour vertices"
        return "points", f"{len(points)} points, expected {expected}; {left_out}"
    if has_file and len(tex_coords) != len(points):
        return "texCoords", f"{len(tex_coords)} entries, expected {len(points)}, as many as points; {left_out}"
    if not np.isfinite(points).all():
        return "points", f"holds values that are not finite, expected finite coordinates; {left_out}"
    if has_file and not np.isfinite(tex_coords).all():
        return "texCoords", f"holds values that are not finite, expected finite coordinates; {left_out}"
    return None


def _morph_points(prim: Usd.Prim, morph_points: NDArray, points: NDArray) -> NDArray[np.float64]:
    if len(morph_points) == len(points) and np.isfinite(morph_points).all():
        return morph_points
    if len(morph_points) == len(points):
        warn(prim, "morphPoints", "holds values that are not finite, expected finite coordinates; no morph")
    elif len(morph_points):
        found = f"{len(morph_points)} entries, expected {len(points)}, as many as points"
        warn(prim, "morphPoints", f"{found}; no morph")
    return points


def _turned(array: NDArray) -> NDArray:
    """Centre first, then the contour the other way around."""
    return np.concatenate([array[:1], array[:0:-1]])


def read_arrangement(
    prim: Usd.Prim, time: Usd.TimeCode, patches: tuple[PatchArrays, ...], look: dict[str, Any]
) -> Arrangement:
    """Read the arrays of an UmbrellaTexture.

    Parameters
    ----------
    prim : Usd.Prim
    time : Usd.TimeCode
    patches : tuple of PatchArrays
    look : dict
        Fields of `Arrangement` that are not arrays: blend and shadow.

    Returns
    -------
    Arrangement
        Without umbrellas where the lengths of arrays disagree.

    Warns
    -----
    FexelWarning
        Once per fault, naming the first entry and how many there are.
    """
    shapes = tuple(patch.shape for patch in patches)
    grid = _grid(prim, time)
    arrays = _Arrays(
        array_of(prim, "patchIndices", time, np.int32),
        array_of(prim, "matrices", time, np.float64, 3, 3),
        array_of(prim, "morphs", time, np.float64),
        array_of(prim, "colors", time, np.float32, 3),
    )
    counts = arrays.vertex_counts(patches)
    if fault := arrays.length_fault(counts):
        warn(prim, *fault)
        arrays, counts = _Arrays.nothing(), counts[:0]
    report = _Report(prim, len(arrays.indices))
    keep = report.leave_out(
        "patchIndices",
        (arrays.indices < 0) | (arrays.indices >= len(patches)),
        lambda entry: f"is {arrays.indices[entry]}, expected 0 to {len(patches) - 1}",
    )
    drawable = np.array([len(patch.shape.points) > 0 for patch in patches] or [False])
    shape_of = np.where(keep, arrays.indices, 0)
    keep &= drawable[shape_of]
    matrices = _checked_matrices(report, arrays.matrices, shapes, shape_of, keep)
    morphs = _limited(report, _clipped(report, arrays.morphs, len(keep), "morphs"), patches, shape_of, keep)
    colors = _finite_colors(report, arrays.colors)
    if len(colors):
        colors = colors[_vertex_order(counts, keep, np.array([p.is_turned for p in patches] or [False])[shape_of])]
    return Arrangement(
        shapes,
        shape_of[keep].astype(np.int32),
        matrices[keep],
        morphs[keep],
        colors,
        grid,
        coverages=np.ones(int(keep.sum())),
        **look,
    )


@dataclass(frozen=True, eq=False)
class _Arrays:
    """As authored."""

    indices: NDArray[np.int32]
    matrices: NDArray[np.float64]
    morphs: NDArray[np.float64]
    colors: NDArray[np.float32]

    @staticmethod
    def nothing() -> _Arrays:
        return _Arrays(np.zeros(0, np.int32), np.zeros((0, 3, 3)), np.zeros(0), _NO_COLORS)

    def vertex_counts(self, patches: tuple[PatchArrays, ...]) -> NDArray[np.int64]:
        """Colours of each umbrella; those of bases that do not exist share what the others leave."""
        vertices = np.array([patch.vertices for patch in patches] or [0], np.int64)
        known = (self.indices >= 0) & (self.indices < len(patches))
        counts = np.where(known, vertices[np.where(known, self.indices, 0)], 0)
        unknown = int((~known).sum())
        rest = len(self.colors) - int(counts.sum())
        if unknown and rest > 0 and rest % unknown == 0:
            counts[~known] = rest // unknown
        return counts

    def length_fault(self, counts: NDArray[np.int64]) -> tuple[str, str] | None:
        """Attribute and both lengths, where arrays do not go together."""
        total, number = int(counts.sum()), len(self.indices)
        lengths = (
            ("matrices", len(self.matrices), number, "patchIndices"),
            ("morphs", len(self.morphs) or number, number, "patchIndices"),
            ("colors", len(self.colors) or total, total, "vertices of all umbrellas"),
        )
        for name, found, expected, of in lengths:
            if found != expected:
                return name, f"{found} entries, expected {expected}, as many as {of}; no umbrella is drawn"
        return None


class _Report:
    """Faults of the umbrellas of a prim: each is said once, with the first entry and the number of all."""

    def __init__(self, prim: Usd.Prim, count: int) -> None:
        self.prim = prim
        self.keep = np.ones(count, bool)

    def say(self, name: str, wrong: NDArray[np.bool_], what: Any, instead: str) -> None:
        entries = np.flatnonzero(wrong)
        if len(entries):
            others = f" ({len(entries)} entries in all)" if len(entries) > 1 else ""
            warn(self.prim, name, f"entry {entries[0]} {what(int(entries[0]))}; {instead}{others}")

    def leave_out(self, name: str, wrong: NDArray[np.bool_], what: Any) -> NDArray[np.bool_]:
        """The umbrellas that are still drawn."""
        self.say(name, wrong & self.keep, what, "left out")
        self.keep &= ~wrong
        return self.keep


def _grid(prim: Usd.Prim, time: Usd.TimeCode) -> tuple[int, int]:
    attribute = prim.GetAttribute("grid")
    value = attribute.Get(time) if attribute else None
    grid = (1, 1) if value is None else (int(value[0]), int(value[1]))
    if min(grid) < 1:
        warn(prim, "grid", f"is {grid[0]} x {grid[1]} cells, expected at least 1 x 1; 1 x 1 is used")
        return 1, 1
    return grid


def _checked_matrices(
    report: _Report,
    matrices: NDArray[np.float64],
    shapes: tuple[Shape, ...],
    shape_of: NDArray[np.integer],
    keep: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Matrices whose umbrellas have their centre in the unit square; what cannot be placed is left out."""
    finite = np.isfinite(matrices).all(axis=(1, 2))
    report.leave_out("matrices", ~finite, lambda _: "is not finite, expected an invertible matrix")
    boxes = np.array([_box(shape) for shape in shapes] or [np.zeros((5, 2))])
    with np.errstate(all="ignore"):  # what overflows is found below
        matrices, corners = placed_in_unit_square(matrices, boxes[shape_of])
        linear = matrices[:, :2, :2] - corners[:, :1, :] * matrices[:, :2, 2:]  # derivative where w is 1: at the centre
        sides = np.linalg.norm(linear, axis=2)
        area = np.abs(linear[:, 0, 0] * linear[:, 1, 1] - linear[:, 0, 1] * linear[:, 1, 0])
        singular = ~(area > _SINGULAR * sides[:, 0] * sides[:, 1])
        behind = np.isnan(corners).any(axis=(1, 2))
        extent = corners.max(axis=1) - corners.min(axis=1)
        far = ~(extent.max(axis=1, initial=0.0) <= _MOST_PERIODS)
    report.leave_out("matrices", singular, lambda _: "is singular, expected an invertible matrix")
    report.leave_out("matrices", behind, lambda _: "maps infinity into the umbrella, expected w > 0 in all of it")
    report.leave_out("matrices", far, lambda e: _far(extent[e], _MOST_PERIODS))
    keep &= report.keep
    return matrices


def _far(extent: NDArray[np.float64], most: int) -> str:
    return f"spans {extent.max():.3g} times the unit square, expected at most {most}"


def _box(shape: Shape) -> NDArray[np.float64]:
    """The centre and the corners of all that a shape may take."""
    if not len(shape.points):
        return np.zeros((5, 2))
    both = np.concatenate([shape.points, shape.morph_points])
    (x0, y0), (x1, y1) = both.min(axis=0), both.max(axis=0)
    return np.array([shape.points[0], (x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def placed_in_unit_square(
    matrices: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Move placements by whole periods, which changes no picture, so that their first point lies in [0, 1)^2.

    Parameters
    ----------
    matrices : (n, 3, 3) float64
    points : (n, k, 2) float64
        Patch space, the centre first.

    Returns
    -------
    matrices : (n, 3, 3)
        With w = 1 at the centre.
    placed : (n, k, 2)
        The points in st; NaN where w <= 0.
    """
    centers = np.concatenate([points[:, 0], np.ones((len(points), 1))], axis=1)
    w = np.einsum("ni,ni->n", centers, matrices[:, :, 2])
    matrices = matrices / np.where(w == 1.0, 1.0, w)[:, None, None]
    homogeneous = np.einsum("nki,nij->nkj", points, matrices[:, :2]) + matrices[:, 2:]
    front = homogeneous[..., 2:] > 0
    placed = np.where(front, homogeneous[..., :2] / np.where(front, homogeneous[..., 2:], 1.0), np.nan)
    # A rounding error below 0 is as good as 0: the centre must not end at 1.
    periods = np.floor(np.nan_to_num(placed[:, 0], nan=0.0, posinf=0.0, neginf=0.0) + 1e-9)
    matrices = matrices.copy()
    matrices[:, :, :2] -= matrices[:, :, 2:] * periods[:, None, :]
    return matrices, placed - periods[:, None, :]


def _clipped(report: _Report, values: NDArray[np.float64], count: int, name: str) -> NDArray[np.float64]:
    """Within [0, 1]; 0 where there is none or it is not a number."""
    if not len(values):
        return np.zeros(count)
    wrong = ~((values >= 0) & (values <= 1))
    report.say(name, wrong, lambda entry: f"is {values[entry]:g}, expected 0 to 1", "limited to it")
    return np.clip(np.nan_to_num(values, nan=0.0), 0.0, 1.0)


def _limited(
    report: _Report,
    morphs: NDArray[np.float64],
    patches: tuple[PatchArrays, ...],
    shape_of: NDArray[np.integer],
    keep: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Morphs that do not fold."""
    most = np.array([patch.fold_weight for patch in patches] or [1.0])[shape_of]
    folds = keep & (morphs > most)
    report.say(
        "morphs",
        folds,
        lambda e: f"is {morphs[e]:g}, which folds {patches[shape_of[e]].path}; expected at most {most[e]:g}",
        "limited to it",
    )
    return np.where(folds, most, morphs)


def _finite_colors(report: _Report, colors: NDArray[np.float32]) -> NDArray[np.float32]:
    finite = np.isfinite(colors)
    if finite.all():
        return colors
    report.say("colors", ~finite.all(axis=1), lambda _: "is not finite, expected finite offsets", "0 is used")
    return np.where(finite, colors, np.float32(0))


def _vertex_order(
    counts: NDArray[np.int64], keep: NDArray[np.bool_], is_turned: NDArray[np.bool_]
) -> NDArray[np.int64] | slice:
    """Entries of a per-vertex array that belong to what is kept; contours that were turned in the new order."""
    turned = is_turned & keep
    if keep.all() and not turned.any():
        return slice(None)
    first = np.concatenate([[0], np.cumsum(counts)])[:-1][keep]
    counts, turned = counts[keep], turned[keep]
    begin = np.cumsum(counts) - counts
    local = np.arange(counts.sum()) - np.repeat(begin, counts)
    backward = np.repeat(turned, counts) & (local > 0)
    local = np.where(backward, np.repeat(counts, counts) - local, local)
    return np.repeat(first, counts) + local


def read_level(prim: Usd.Prim, time: Usd.TimeCode, patches: tuple[PatchArrays, ...], color_blend: float) -> Arrangement:
    """Read the umbrellas of an UmbrellaLevel.

    Parameters
    ----------
    prim : Usd.Prim
    time : Usd.TimeCode
    patches : tuple of PatchArrays
        Siblings of the level.
    color_blend : float
        Of the texture; it is worked into the colours of umbrellas that show a base.

    Returns
    -------
    Arrangement
        A shape of its own for every umbrella; without shadows. No umbrellas where lengths disagree.

    Warns
    -----
    FexelWarning
        As `read_arrangement`.
    """
    indices = array_of(prim, "patchIndices", time, np.int32)
    counts = array_of(prim, "vertexCounts", time, np.int64)
    points = array_of(prim, "points", time, np.float64, 2)
    matrices = array_of(prim, "matrices", time, np.float64, 3, 3)
    colors = array_of(prim, "colors", time, np.float32, 3)
    coverages = array_of(prim, "coverages", time, np.float64)
    total = int(counts.sum())
    lengths = (
        ("vertexCounts", len(counts), len(indices), "patchIndices", False),
        ("matrices", len(matrices), len(indices), "patchIndices", True),
        ("coverages", len(coverages), len(indices), "patchIndices", True),
        ("points", len(points), total, "the sum of vertexCounts", False),
        ("colors", len(colors), total, "the sum of vertexCounts", True),
    )
    for name, found, expected, of, may_be_empty in lengths:
        if found != expected and not (may_be_empty and found == 0):
            warn(prim, name, f"{found} entries, expected {expected}, as many as {of}; the level is not drawn")
            return Arrangement((), np.zeros(0, np.int32), np.zeros((0, 3, 3)), np.zeros(0), _NO_COLORS)
    report = _Report(prim, len(indices))
    bases = np.array([len(patch.shape.points) for patch in patches] + [0])
    known = (indices >= -1) & (indices < len(patches))
    report.leave_out("patchIndices", ~known, lambda e: f"is {indices[e]}, expected -1 to {len(patches) - 1}")
    base = np.where(known, indices, -1)
    report.leave_out(
        "vertexCounts",
        (counts < MIN_VERTICES) | ((base >= 0) & (counts != bases[base])),
        lambda e: f"is {counts[e]}, expected {bases[base[e]] if base[e] >= 0 else f'at least {MIN_VERTICES}'}",
    )
    first = np.concatenate([[0], np.cumsum(np.maximum(counts, 0))]).astype(np.int64)
    broken = _per_umbrella(~np.isfinite(points).all(axis=1), first)
    report.leave_out("points", broken, lambda _: "is not finite, expected finite coordinates")
    keep = report.keep.copy()
    shapes = tuple(
        _level_shape(points[first[e] : first[e + 1]], patches[base[e]].shape if base[e] >= 0 else None)
        for e in np.flatnonzero(keep)
    )
    kept_matrices = matrices[keep] if len(matrices) else np.tile(np.eye(3), (len(shapes), 1, 1))
    placed = _Report(prim, len(shapes))
    still = np.ones(len(shapes), bool)
    checked = _checked_matrices(placed, kept_matrices, shapes, np.arange(len(shapes)), still)
    colors = _finite_colors(report, colors)
    is_turned = np.zeros(len(indices), bool)
    is_turned[keep] = [signed_area(points[first[e] + 1 : first[e + 1]]) < 0 for e in np.flatnonzero(keep)]
    kept = np.flatnonzero(keep)[still]
    keep = np.isin(np.arange(len(indices)), kept)
    if len(colors):
        blend = np.repeat(np.where(base >= 0, color_blend, 1.0), np.maximum(counts, 0)).astype(np.float32)
        colors = (colors * blend[:, None])[_vertex_order(counts, keep, is_turned)]
    alpha = _clipped(report, coverages, len(indices), "coverages") if len(coverages) else np.ones(len(indices))
    shapes = tuple(shape for shape, used in zip(shapes, still, strict=True) if used)
    numbers = np.arange(len(shapes), dtype=np.int32)
    return Arrangement(
        shapes, numbers, checked[still], np.zeros(len(shapes)), colors, _grid(prim, time), coverages=alpha[keep]
    )


def _level_shape(points: NDArray[np.float64], base: Shape | None) -> Shape:
    tex_coords = np.zeros_like(points) if base is None else base.tex_coords
    if signed_area(points[1:]) < 0:
        points = _turned(points)
    return Shape(points, points, tex_coords, None if base is None else base.image)


def _per_umbrella(wrong: NDArray[np.bool_], first: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether any vertex of an umbrella is wrong."""
    summed = np.concatenate([[0], np.cumsum(wrong)])
    return np.diff(summed[first]) > 0
