"""UmbrellaLevel prims with umbrellas of their own: merged ones, each a shape of its own, or bases once more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from fexel.textures.inputs import warn
from fexel.textures.umbrella_arrangement import Arrangement, Shape
from fexel.textures.umbrella_entries import (
    EntryFaults,
    Note,
    checked_matrices,
    clipped,
    finite_colors,
    read_array,
    read_grid,
    vertex_order,
)
from fexel.textures.umbrella_geometry import signed_area
from fexel.textures.umbrella_patch import MIN_VERTICES, PatchArrays, turned_contour

__all__ = ["read_level"]

_NO_UMBRELLAS = Arrangement((), np.zeros(0, np.int32), np.zeros((0, 3, 3)), np.zeros(0), np.zeros((0, 3), np.float32))


@dataclass(frozen=True, eq=False)
class _LevelArrays:
    """As authored."""

    indices: NDArray[np.int32]
    counts: NDArray[np.int64]
    points: NDArray[np.float64]
    matrices: NDArray[np.float64]
    colors: NDArray[np.float32]
    coverages: NDArray[np.float64]

    @classmethod
    def of(cls, prim: Usd.Prim, time: Usd.TimeCode) -> _LevelArrays:
        return cls(
            read_array(prim, "patchIndices", time, np.int32),
            np.maximum(read_array(prim, "vertexCounts", time, np.int64), 0),
            read_array(prim, "points", time, np.float64, 2),
            read_array(prim, "matrices", time, np.float64, 3, 3),
            read_array(prim, "colors", time, np.float32, 3),
            read_array(prim, "coverages", time, np.float64),
        )

    def length_fault(self) -> tuple[str, str] | None:
        """Attribute and both lengths, where arrays do not go together."""
        number, total = len(self.indices), int(self.counts.sum())
        lengths = (
            ("vertexCounts", len(self.counts), number, "patchIndices"),
            ("matrices", len(self.matrices) or number, number, "patchIndices"),
            ("coverages", len(self.coverages) or number, number, "patchIndices"),
            ("points", len(self.points), total, "the sum of vertexCounts"),
            ("colors", len(self.colors) or total, total, "the sum of vertexCounts"),
        )
        for name, found, expected, of in lengths:
            if found != expected:
                return name, f"{found} entries, expected {expected}, as many as {of}; the level is not drawn"
        return None

    def outlines(self) -> list[NDArray[np.float64]]:
        """Points of each umbrella."""
        return np.split(self.points, np.cumsum(self.counts)[:-1])


def read_level(
    prim: Usd.Prim,
    time: Usd.TimeCode,
    patches: tuple[PatchArrays, ...],
    color_blend: float,
    note: Note | None = None,
) -> Arrangement:
    """Read the umbrellas of an UmbrellaLevel.

    Parameters
    ----------
    prim : Usd.Prim
    time : Usd.TimeCode
    patches : tuple of PatchArrays
        Siblings of the level.
    color_blend : float
        Of the texture; it is worked into the colours of umbrellas that show a base.
    note : callable, optional
        Takes faults of entries instead of warnings.

    Returns
    -------
    Arrangement
        A shape of its own for every umbrella; without shadows. No umbrellas where lengths disagree.

    Warns
    -----
    FexelWarning
        Once per fault, naming the first entry and how many there are.
    """
    arrays = _LevelArrays.of(prim, time)
    if fault := arrays.length_fault():
        warn(prim, *fault)
    if fault or not len(arrays.indices):
        return _NO_UMBRELLAS
    faults = EntryFaults(prim, len(arrays.indices), note)
    base = _bases(faults, arrays, patches)
    outlines = arrays.outlines()
    broken = np.array([not np.isfinite(outline).all() for outline in outlines], bool)
    faults.leave_out("points", broken, lambda _: "is not finite, expected finite coordinates")
    shapes = [
        _shape(outline, patches[number].shape if number >= 0 else None) if drawn else _shape(np.zeros((1, 2)), None)
        for outline, number, drawn in zip(outlines, base, faults.keep, strict=True)
    ]
    count = len(shapes)
    matrices = arrays.matrices if len(arrays.matrices) else np.tile(np.eye(3), (count, 1, 1))
    matrices = checked_matrices(faults, matrices, tuple(shapes), np.arange(count))
    coverages = clipped(faults, arrays.coverages, count, "coverages") if len(arrays.coverages) else np.ones(count)
    keep = faults.keep
    return Arrangement(
        tuple(shape for shape, drawn in zip(shapes, keep, strict=True) if drawn),
        np.arange(int(keep.sum()), dtype=np.int32),
        matrices[keep],
        np.zeros(int(keep.sum())),
        _colors(faults, arrays, outlines, np.where(base >= 0, color_blend, 1.0)),
        read_grid(prim, time),
        coverages=coverages[keep],
    )


def _bases(faults: EntryFaults, arrays: _LevelArrays, patches: tuple[PatchArrays, ...]) -> NDArray[np.int64]:
    """(n,) the patch that each umbrella shows, -1 for a merged one."""
    known = (arrays.indices >= -1) & (arrays.indices < len(patches))
    base = np.where(known, arrays.indices, -1).astype(np.int64)
    faults.leave_out(
        "patchIndices", ~known, lambda entry: f"is {arrays.indices[entry]}, expected -1 to {len(patches) - 1}"
    )
    vertices = np.array([len(patch.shape.points) for patch in patches] + [0])[base]
    faults.leave_out(
        "vertexCounts",
        (arrays.counts < MIN_VERTICES) | ((base >= 0) & (arrays.counts != vertices)),
        lambda e: f"is {arrays.counts[e]}, expected {vertices[e] if base[e] >= 0 else f'at least {MIN_VERTICES}'}",
    )
    return base


def _shape(points: NDArray[np.float64], base: Shape | None) -> Shape:
    """Counter-clockwise."""
    if signed_area(points[1:]) < 0:
        points = turned_contour(points)
    if base is None:
        return Shape(points, points, np.zeros_like(points))
    return Shape(points, points, base.tex_coords, base.image)


def _colors(
    faults: EntryFaults, arrays: _LevelArrays, outlines: list[NDArray[np.float64]], blend: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Of the vertices of what is kept, blended."""
    colors = finite_colors(faults, arrays.colors)
    if not len(colors):
        return colors
    keep = faults.keep
    is_turned = np.array([drawn and signed_area(p[1:]) < 0 for p, drawn in zip(outlines, keep, strict=True)], bool)
    blended = colors * np.repeat(blend, arrays.counts)[:, None].astype(np.float32)
    return blended[vertex_order(arrays.counts, keep, is_turned)]
