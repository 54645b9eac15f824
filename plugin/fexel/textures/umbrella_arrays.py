"""The arrays of an UmbrellaTexture prim as an arrangement; umbrellas that cannot be drawn are left out.

No file is touched.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from fexel.textures.inputs import warn
from fexel.textures.umbrella_arrangement import Arrangement
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
from fexel.textures.umbrella_patch import PatchArrays

__all__ = ["read_arrangement"]

_NO_COLORS = np.zeros((0, 3), np.float32)


def read_arrangement(
    prim: Usd.Prim,
    time: Usd.TimeCode,
    patches: tuple[PatchArrays, ...],
    look: dict[str, Any],
    note: Note | None = None,
) -> Arrangement:
    """Read the arrays of an UmbrellaTexture.

    Parameters
    ----------
    prim : Usd.Prim
    time : Usd.TimeCode
    patches : tuple of PatchArrays
    look : dict
        Fields of `Arrangement` that are not arrays: blend and shadow.
    note : callable, optional
        Takes faults of entries instead of warnings.

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
    grid = read_grid(prim, time)
    arrays = _Arrays(
        read_array(prim, "patchIndices", time, np.int32),
        read_array(prim, "matrices", time, np.float64, 3, 3),
        read_array(prim, "morphs", time, np.float64),
        read_array(prim, "colors", time, np.float32, 3),
    )
    counts = arrays.vertex_counts(patches)
    if fault := arrays.length_fault(counts):
        warn(prim, *fault)
        arrays, counts = _Arrays.nothing(), counts[:0]
    faults = EntryFaults(prim, len(arrays.indices), note)
    known = (arrays.indices >= 0) & (arrays.indices < len(patches))
    faults.leave_out("patchIndices", ~known, lambda e: f"is {arrays.indices[e]}, expected 0 to {len(patches) - 1}")
    shape_of = np.where(known, arrays.indices, 0)
    faults.keep &= np.array([len(shape.points) > 0 for shape in shapes] or [False])[shape_of]  # said of the patch
    most = np.array([patch.fold_weight for patch in patches] or [1.0])[shape_of]
    morphs = clipped(faults, arrays.morphs, len(shape_of), "morphs")
    matrices = checked_matrices(faults, arrays.matrices, shapes, shape_of, np.minimum(morphs, most))
    morphs = _limited(faults, morphs, most, patches, shape_of)
    colors = finite_colors(faults, arrays.colors)
    keep = faults.keep
    if len(colors):
        colors = colors[vertex_order(counts, keep, np.array([p.is_turned for p in patches] or [False])[shape_of])]
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


def _limited(
    faults: EntryFaults,
    morphs: NDArray[np.float64],
    most: NDArray[np.float64],
    patches: tuple[PatchArrays, ...],
    shape_of: NDArray[np.integer],
) -> NDArray[np.float64]:
    """Morphs that do not fold, `most` at most."""
    folds = faults.keep & (morphs > most)
    faults.say(
        "morphs",
        folds,
        lambda e: f"is {morphs[e]:g}, which folds {patches[shape_of[e]].path}; expected at most {most[e]:g}",
        "limited to it",
    )
    return np.where(folds, most, morphs)
