"""Arrays with an entry per umbrella, checked and mended; a fault is said once, with its first entry and the number.

All is vectorised over umbrellas: there may be a hundred thousand.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from fexel.textures.inputs import warn
from fexel.textures.umbrella_arrangement import Shape

__all__ = [
    "MOST_PERIODS",
    "EntryFaults",
    "Note",
    "Outline",
    "checked_matrices",
    "clipped",
    "finite_colors",
    "periods_spanned",
    "placed_in_unit_square",
    "read_array",
    "read_grid",
    "vertex_order",
]

_SINGULAR = 1e-12  # area of a matrix's image of the unit square over the lengths of its sides
_PORTION = 1 << 18  # vertices at a time
MOST_PERIODS = 16
"""Unit squares along s or t that an umbrella may span: beyond it a matrix is taken for damaged, and cells would list it
without end."""


class Outline(Protocol):
    """A shape, as far as it takes room."""

    @property
    def points(self) -> NDArray[np.float64]:
        """(V, 2) patch space, the centre first."""
        ...

    @property
    def morph_points(self) -> NDArray[np.float64]:
        """(V, 2) where the points are at a morph weight of 1."""
        ...


def read_array(prim: Usd.Prim, name: str, time: Usd.TimeCode, dtype: Any, *shape: int) -> NDArray[Any]:
    """An array attribute at one time, (k, *shape); empty where there is no value."""
    attribute = prim.GetAttribute(name)
    value = attribute.Get(time) if attribute else None
    return np.array([] if value is None else value, dtype).reshape(-1, *shape)


def read_grid(prim: Usd.Prim, time: Usd.TimeCode) -> tuple[int, int]:
    """Cells along s and t; 1 x 1, and said, where there are none."""
    attribute = prim.GetAttribute("grid")
    value = attribute.Get(time) if attribute else None
    grid = (1, 1) if value is None else (int(value[0]), int(value[1]))
    if min(grid) < 1:
        warn(prim, "grid", f"is {grid[0]} x {grid[1]} cells, expected at least 1 x 1; 1 x 1 is used")
        return 1, 1
    return grid


Note = Callable[[str, str], None]
"""Takes the name of an attribute and what is wrong with it."""


class EntryFaults:
    """Faults of the umbrellas of a prim: each is said once, with the first entry and the number of all.

    Parameters
    ----------
    prim : Usd.Prim
    count : int
        Umbrellas.
    note : callable, optional
        Takes attribute and fault instead of a warning.

    Attributes
    ----------
    keep : (count,) bool
        Those that are still drawn.
    """

    def __init__(self, prim: Usd.Prim, count: int, note: Note | None = None) -> None:
        self._note = note or partial(warn, prim)
        self.keep = np.ones(count, bool)

    def say(self, name: str, wrong: NDArray[np.bool_], what: Callable[[int], str], instead: str) -> None:
        """Warn of entries of an attribute: what is found and expected at one, and what is done about it."""
        entries = np.flatnonzero(wrong)
        if len(entries):
            others = f" ({len(entries)} entries in all)" if len(entries) > 1 else ""
            self._note(name, f"entry {entries[0]} {what(int(entries[0]))}; {instead}{others}")

    def leave_out(self, name: str, wrong: NDArray[np.bool_], what: Callable[[int], str]) -> None:
        """Draw no umbrellas that are wrong; said of those that were to be drawn."""
        self.say(name, wrong & self.keep, what, "left out")
        self.keep &= ~wrong


def checked_matrices(
    faults: EntryFaults,
    matrices: NDArray[np.float64],
    shapes: tuple[Shape, ...],
    shape_of: NDArray[np.integer],
    morphs: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Matrices (n, 3, 3) as `placed_in_unit_square` moves them; umbrellas that cannot be placed are left out."""
    finite = np.isfinite(matrices).all(axis=(1, 2))
    faults.leave_out("matrices", ~finite, lambda _: "is not finite, expected an invertible matrix")
    with np.errstate(all="ignore"):  # what overflows is found below
        matrices, corners = placed_in_unit_square(matrices, _boxes(shapes)[shape_of])
        linear = matrices[:, :2, :2] - corners[:, :1, :] * matrices[:, :2, 2:]  # derivative where w is 1: at the centre
        sides = np.linalg.norm(linear, axis=2)
        area = np.abs(linear[:, 0, 0] * linear[:, 1, 1] - linear[:, 0, 1] * linear[:, 1, 0])
        singular = ~(area > _SINGULAR * sides[:, 0] * sides[:, 1])
        morphs = np.zeros(len(matrices)) if morphs is None else morphs
        behind, extent = _reach(corners, matrices, shapes, shape_of, morphs)
        far = ~(extent <= MOST_PERIODS)
    faults.leave_out("matrices", singular, lambda _: "is singular, expected an invertible matrix")
    faults.leave_out("matrices", behind, lambda _: "maps infinity into the umbrella, expected w > 0 in all of it")
    expected = f"times the unit square, expected at most {MOST_PERIODS}"
    faults.leave_out("matrices", far, lambda entry: f"spans {extent[entry]:.3g} {expected}")
    return matrices


def _reach(
    corners: NDArray[np.float64],
    matrices: NDArray[np.float64],
    shapes: tuple[Shape, ...],
    shape_of: NDArray[np.integer],
    morphs: NDArray[np.float64],
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """(n,) whether an umbrella reaches infinity, and how many times the unit square it spans.

    The corners (n, 5, 2) of what a shape may take are enough where a matrix is affine; perspective may carry corners
    away to where no vertex is.
    """
    behind = np.isnan(corners).any(axis=(1, 2))
    extent = _longest_side(corners)
    projective = np.flatnonzero((matrices[:, :2, 2] != 0).any(axis=1))
    projective = projective[np.argsort(shape_of[projective], kind="stable")]
    ends = np.flatnonzero(np.diff(shape_of[projective])) + 1
    for group in np.split(projective, ends) if len(projective) else ():
        shape = shapes[shape_of[group[0]]]
        if not len(shape.points):
            continue
        for some in np.array_split(group, -(-len(group) * len(shape.points) // _PORTION)):
            points = shape.points + morphs[some, None, None] * (shape.morph_points - shape.points)
            placed = placed_in_unit_square(matrices[some], points)[1]
            behind[some] = np.isnan(placed).any(axis=(1, 2))
            extent[some] = _longest_side(placed)
    return behind, extent


def periods_spanned(
    matrices: NDArray[np.float64], shapes: Sequence[Outline], shape_of: NDArray[np.integer]
) -> NDArray[np.float64]:
    """How many unit squares each umbrella of affine matrices (n, 3, 3) spans along s or t, whatever its morph.

    Infinite or NaN where a matrix is not finite.
    """
    with np.errstate(all="ignore"):
        return _longest_side(placed_in_unit_square(matrices, _boxes(shapes)[shape_of])[1])


def _longest_side(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the boxes around points (n, k, 2)."""
    return (points.max(axis=1) - points.min(axis=1)).max(axis=1, initial=0.0)


def _boxes(shapes: Sequence[Outline]) -> NDArray[np.float64]:
    """(shapes, 5, 2) points of `_box`; there is always one."""
    return np.array([_box(shape) for shape in shapes] or [np.zeros((5, 2))])


def _box(shape: Outline) -> NDArray[np.float64]:
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


def clipped(faults: EntryFaults, values: NDArray[np.float64], count: int, name: str) -> NDArray[np.float64]:
    """Within [0, 1]; 0 where there is none or it is not a number."""
    if not len(values):
        return np.zeros(count)
    wrong = ~((values >= 0) & (values <= 1))
    faults.say(name, wrong, lambda entry: f"is {values[entry]:g}, expected 0 to 1", "limited to it")
    return np.clip(np.nan_to_num(values, nan=0.0), 0.0, 1.0)


def finite_colors(faults: EntryFaults, colors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Colours, 0 where one is not finite."""
    finite = np.isfinite(colors)
    if finite.all():
        return colors
    faults.say("colors", ~finite.all(axis=1), lambda _: "is not finite, expected finite offsets", "0 is used")
    return np.where(finite, colors, np.float32(0))


def vertex_order(
    counts: NDArray[np.int64], keep: NDArray[np.bool_], is_turned: NDArray[np.bool_]
) -> NDArray[np.int64] | slice:
    """Where the vertices of what is kept lie in an array of all; of contours that were turned, in the new order.

    Parameters
    ----------
    counts : (n,) int
        Vertices of each umbrella.
    keep, is_turned : (n,) bool
    """
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
