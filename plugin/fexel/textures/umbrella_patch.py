"""UmbrellaPatch prims: base umbrellas, mended where possible."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from fexel.textures.image_source import ImageSource
from fexel.textures.inputs import Inputs, warn
from fexel.textures.umbrella_arrangement import Shape
from fexel.textures.umbrella_entries import read_array
from fexel.textures.umbrella_geometry import fold_weight, is_star_shaped, signed_area

__all__ = ["MIN_VERTICES", "PatchArrays", "read_patch", "turned_contour"]

MIN_VERTICES = 4
"""A centre and a triangle around it."""


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
    points = read_array(prim, "points", time, np.float64, 2)
    tex_coords = read_array(prim, "texCoords", time, np.float64, 2)
    fault = _patch_fault(points, tex_coords, bool(file))
    if fault:
        warn(prim, *fault)
        nothing = np.zeros((0, 2))
        return PatchArrays(path, Shape(nothing, nothing, nothing), len(points))
    if not file or not len(tex_coords):
        tex_coords = np.zeros_like(points)
    morph_points = _morph_points(prim, read_array(prim, "morphPoints", time, np.float64, 2), points)
    is_turned = signed_area(points[1:]) < 0
    if is_turned:
        points, tex_coords, morph_points = (turned_contour(array) for array in (points, tex_coords, morph_points))
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


def turned_contour(array: NDArray) -> NDArray:
    """Centre first, then the contour the other way around."""
    return np.concatenate([array[:1], array[:0:-1]])
