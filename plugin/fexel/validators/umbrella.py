"""Arrays of umbrellas: lengths that go together, indices that exist, shapes that can be drawn, fresh levels."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from pxr import Usd

from fexel.schema.umbrella import UmbrellaLevel, UmbrellaPatch, UmbrellaTexture
from fexel.schema.wrapper import is_a
from fexel.textures.umbrella import DIGEST_KEY, extract, level_digest
from fexel.textures.umbrella_arrays import read_arrangement
from fexel.textures.umbrella_geometry import fold_weight, is_star_shaped, signed_area
from fexel.textures.umbrella_merged import read_level
from fexel.textures.umbrella_patch import MIN_VERTICES, read_patch, turned_contour
from fexel.validators.fault import Fault
from fexel.validators.prim_validator import PrimValidator

__all__ = ["VALIDATORS", "check_umbrella_arrays"]


def check_umbrella_arrays(prim: Usd.Prim) -> Iterator[Fault]:
    """Arrays of an UmbrellaTexture, UmbrellaPatch or UmbrellaLevel, at all of their times."""
    times = _times(prim)
    said = set()
    for time in times or [Usd.TimeCode.Default()]:
        for fault in _Check(Usd.TimeCode(time)).faults(prim):
            if (fault.path, fault.message) not in said:
                said.add((fault.path, fault.message))
                when = f" at time {time:g}" if times else ""
                yield Fault(fault.path, fault.message + when, fault.is_error)


def _times(prim: Usd.Prim) -> list[float]:
    """Of the samples of a prim and of those that it is drawn with."""
    prims = [prim, *prim.GetChildren()] if is_a(prim, "UmbrellaTexture") else [prim]
    if is_a(prim, "UmbrellaLevel"):
        prims = [prim.GetParent(), *prim.GetParent().GetChildren()]
    return sorted({time for each in prims for a in each.GetAuthoredAttributes() for time in a.GetTimeSamples()})


@dataclass(frozen=True)
class _Check:
    """Checks of umbrella prims at one time."""

    time: Usd.TimeCode

    def faults(self, prim: Usd.Prim) -> Iterator[Fault]:
        """Of a prim of any of the types."""
        if is_a(prim, "UmbrellaTexture"):
            yield from self._check_texture(UmbrellaTexture(prim))
        elif is_a(prim, "UmbrellaPatch"):
            yield from self._check_patch(UmbrellaPatch(prim))
        elif is_a(prim, "UmbrellaLevel"):
            yield from self._check_level(UmbrellaLevel(prim))

    def _array(self, attribute: Usd.Attribute) -> np.ndarray:
        value = attribute.Get(self.time) if attribute else None
        return np.array(value if value is not None else [])

    def _check_texture(self, umbrella: UmbrellaTexture) -> Iterator[Fault]:
        indices = self._array(umbrella.GetPatchIndicesAttr())
        patches = umbrella.GetPatches()
        yield from self._check_length(umbrella.GetMatricesAttr(), len(indices), "patchIndices")
        yield from self._check_length(umbrella.GetMorphsAttr(), len(indices), "patchIndices", may_be_empty=True)
        yield from self._check_matrices(umbrella)
        in_range = yield from self._check_indices(umbrella.GetPatchIndicesAttr(), 0, len(patches))
        if in_range:
            vertices = np.array([len(self._array(patch.GetPointsAttr())) for patch in patches], dtype=int)
            total = int(vertices[indices].sum()) if len(indices) else 0
            yield from self._check_length(
                umbrella.GetColorsAttr(), total, "vertices of all umbrellas", may_be_empty=True
            )
            yield from self._check_morphs(umbrella, indices)
        yield from self._check_finite(umbrella.GetColorsAttr(), "colours")
        yield from self._check_grid(umbrella.GetGridAttr())

    def _check_patch(self, patch: UmbrellaPatch) -> Iterator[Fault]:
        count = len(self._array(patch.GetPointsAttr()))
        if count < MIN_VERTICES:
            message = f"{count} points, expected a centre and at least {MIN_VERTICES - 1} contour vertices"
            yield Fault(patch.GetPointsAttr().GetPath(), message)
        has_file = bool(patch.GetFileAttr().Get(self.time) and patch.GetFileAttr().Get(self.time).path)
        yield from self._check_length(patch.GetTexCoordsAttr(), count, "points", may_be_empty=not has_file)
        yield from self._check_length(patch.GetMorphPointsAttr(), count, "points", may_be_empty=True)
        finite = True
        for attribute in (patch.GetPointsAttr(), patch.GetTexCoordsAttr(), patch.GetMorphPointsAttr()):
            finite &= yield from self._check_finite(attribute, "coordinates")
        if finite and count >= MIN_VERTICES:
            yield from self._check_contour(patch)

    def _check_contour(self, patch: UmbrellaPatch) -> Iterator[Fault]:
        """What is mended or drawn in part: a warning."""
        points = self._outline(patch.GetPointsAttr())
        if signed_area(points[1:]) < 0:
            message = "contour runs clockwise, expected counter-clockwise; it is turned"
            yield Fault(patch.GetPointsAttr().GetPath(), message, is_error=False)
        if not is_star_shaped(_forward(points)):
            message = "the centre does not see the whole contour, expected a star-shaped one; it is drawn in part"
            yield Fault(patch.GetPointsAttr().GetPath(), message, is_error=False)
        weight = self._fold_weight(patch)
        if weight < 1:
            message = f"a sector folds at a morph of {weight:g}, expected none up to 1"
            yield Fault(patch.GetMorphPointsAttr().GetPath(), message, is_error=False)

    def _outline(self, attribute: Usd.Attribute) -> np.ndarray:
        return self._array(attribute).astype(float).reshape(-1, 2)

    def _fold_weight(self, patch: UmbrellaPatch) -> float:
        """Largest morph of a patch that does not fold; 1 where nothing tells."""
        points, morph_points = self._outline(patch.GetPointsAttr()), self._outline(patch.GetMorphPointsAttr())
        if len(points) != len(morph_points) or not np.isfinite([points, morph_points]).all():
            return 1.0
        turned = signed_area(points[1:]) < 0
        return fold_weight(*((turned_contour(p) if turned else p) for p in (points, morph_points)))

    def _check_morphs(self, umbrella: UmbrellaTexture, indices: np.ndarray) -> Iterator[Fault]:
        """Morphs in [0, 1] that fold no sector."""
        morphs = self._array(umbrella.GetMorphsAttr()).astype(float)
        if not len(morphs) or len(morphs) != len(indices):
            return
        path = umbrella.GetMorphsAttr().GetPath()
        outside = ~((morphs >= 0) & (morphs <= 1))
        for entry in np.flatnonzero(outside)[:1]:
            yield Fault(path, f"entry {entry} is {morphs[entry]:g}, expected 0 to 1")
        most = np.array([self._fold_weight(patch) for patch in umbrella.GetPatches()])[indices]
        for entry in np.flatnonzero(~outside & (morphs > most))[:1]:
            message = f"entry {entry} is {morphs[entry]:g}, which folds its base, expected at most {most[entry]:g}"
            yield Fault(path, message, is_error=False)

    def _check_level(self, level: UmbrellaLevel) -> Iterator[Fault]:
        count = len(self._array(level.GetPatchIndicesAttr()))
        counts = self._array(level.GetVertexCountsAttr())
        yield from self._check_length(level.GetVertexCountsAttr(), count, "patchIndices")
        yield from self._check_length(level.GetMatricesAttr(), count, "patchIndices", may_be_empty=True)
        yield from self._check_length(level.GetCoveragesAttr(), count, "patchIndices", may_be_empty=True)
        total = int(counts.sum())
        yield from self._check_length(level.GetPointsAttr(), total, "the sum of vertexCounts")
        yield from self._check_length(level.GetColorsAttr(), total, "the sum of vertexCounts", may_be_empty=True)
        for attribute, what in ((level.GetPointsAttr(), "coordinates"), (level.GetColorsAttr(), "colours")):
            yield from self._check_finite(attribute, what)
        parent = UmbrellaTexture(level.GetPrim().GetParent())
        yield from self._check_indices(level.GetPatchIndicesAttr(), -1, len(parent.GetPatches()) if parent else 0)
        yield from self._check_grid(level.GetGridAttr())
        if parent:
            yield from self._check_matrices(parent, level)
        yield from self._check_fresh(level.GetPrim(), parent)

    def _check_fresh(self, prim: Usd.Prim, parent: UmbrellaTexture) -> Iterator[Fault]:
        """Whether a level was made from what its texture is now."""
        made_from = prim.GetCustomDataByKey(DIGEST_KEY)
        if not made_from or not parent:
            return
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # faults of the texture are found at the texture
            now = level_digest(extract(parent.GetPrim(), self.time))
        if made_from != now:
            message = f"{DIGEST_KEY}: made from another arrangement than its texture has now, it is not shown"
            yield Fault(prim.GetPath(), f"{message}; make the levels again or delete the prim", is_error=False)

    def _check_length(
        self, attribute: Usd.Attribute, expected: int, of: str, may_be_empty: bool = False
    ) -> Iterator[Fault]:
        found = len(self._array(attribute))
        if found != expected and not (may_be_empty and found == 0):
            yield Fault(attribute.GetPath(), f"{found} entries, expected {expected}, as many as {of}")

    def _check_finite(self, attribute: Usd.Attribute, what: str) -> Iterator[Fault]:
        """Yields at most one fault; returns whether all values are finite."""
        finite = bool(np.isfinite(self._array(attribute).astype(float)).all())
        if not finite:
            yield Fault(attribute.GetPath(), f"holds values that are not finite, expected finite {what}")
        return finite

    def _check_indices(self, attribute: Usd.Attribute, low: int, count: int) -> Iterator[Fault]:
        """Yields at most one fault; returns whether all indices exist."""
        indices = self._array(attribute)
        wrong = np.flatnonzero((indices < low) | (indices >= count)) if len(indices) else []
        if len(wrong):
            first = int(wrong[0])
            message = f"entry {first} is {indices[first]}, expected {low} to {count - 1}"
            yield Fault(attribute.GetPath(), f"{message}: there are {count} UmbrellaPatch prims")
        return not len(wrong)

    def _check_matrices(self, texture: UmbrellaTexture, level: UmbrellaLevel | None = None) -> Iterator[Fault]:
        """What the renderer leaves out."""
        noted: list[tuple[str, str]] = []

        def note(name: str, fault: str) -> None:
            noted.append((name, fault))

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # lengths and patches have checks of their own
            patches = tuple(read_patch(patch.GetPrim(), self.time, "auto") for patch in texture.GetPatches())
            if level:
                read_level(level.GetPrim(), self.time, patches, 1.0, note)
            else:
                read_arrangement(texture.GetPrim(), self.time, patches, {}, note)
        prim = level.GetPrim() if level else texture.GetPrim()
        for name, fault in noted:
            if name == "matrices":
                yield Fault(prim.GetAttribute(name).GetPath(), fault)

    def _check_grid(self, attribute: Usd.Attribute) -> Iterator[Fault]:
        grid = attribute.Get(self.time)
        if grid is not None and min(grid) < 1:
            yield Fault(attribute.GetPath(), f"grid of {grid[0]} x {grid[1]} cells, expected at least 1 x 1")


def _forward(points: np.ndarray) -> np.ndarray:
    return turned_contour(points) if signed_area(points[1:]) < 0 else points


VALIDATORS = (
    PrimValidator(
        "fexel:UmbrellaArrays",
        "Arrays of umbrellas must have matching lengths and existing indices.",
        ("FexelUmbrellaTexture", "FexelUmbrellaPatch", "FexelUmbrellaLevel"),
        check_umbrella_arrays,
    ),
)
