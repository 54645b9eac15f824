"""Outline of an umbrella: a contour of few vertices, and a centre that sees all of it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel_tools.umbrella_centre import (
    Clearance,
    centroid,
    clearance,
    kernel_point,
    most_visible,
    sees_all,
    visible_curve,
)
from fexel_tools.umbrella_contour import Polygon, area, is_simple, simplify, thinned, trace
from fexel_tools.umbrella_elements import Element
from fexel_tools.umbrella_veins import vein_convergence

__all__ = ["Outline", "outline_of"]

_RELATIVE_TOLERANCE = 0.005  # of the element's longer side
_LEAST_CLEARANCE = 2e-3  # of the longer side: a centre nearer to the line through a side counts as not seeing it
_NARROW_CLEARANCE = 0.05  # of the longer side: a smaller kernel may lie where a notch puts it, far from the middle
_FAR = 0.5  # of the radius of a disc of the contour's area: that is far from where the centre is wanted
_SMALL_LOSS = 5e-3  # of the area: what may be cut off to have a centre that is not far
_LEAST_DEPTH = 0.015  # of the longer side: where veins put a centre nearer to the contour, the middle is taken
_HINT_PULL, _VEINS_PULL, _MIDDLE_PULL = 0.5, 0.15, 0.05  # see `umbrella_centre.most_visible`


@dataclass(frozen=True, eq=False)
class Outline:
    """In pixels of `Element.color`, y up from its lower edge.

    Attributes
    ----------
    contour : (K, 2) float64
        Counter-clockwise; every vertex is visible from the centre.
    center : (2,) float64
    lost_area : float
        Share of the element's area that the centre does not see.
    tolerance : float
        Largest distance to the boundary it simplifies.
    """

    contour: NDArray[np.float64]
    center: NDArray[np.float64]
    lost_area: float
    tolerance: float


def outline_of(
    element: Element,
    *,
    most_vertices: int,
    tolerance: float,
    wanted: NDArray[np.float64] | str = "auto",
) -> Outline:
    """Contour and centre of an element.

    Parameters
    ----------
    element : Element
    most_vertices : int
        Of the contour.
    tolerance : float
        Pixels of `Element.color`.
    wanted : (2,) float64 or str
        Where the centre is wanted: pixels of `Element.color`, y up; ``veins``: where they converge, if that can be told
        and leaves the centre clear of the contour; else near the centroid.

    Raises
    ------
    FexelError
        Nothing of the element is opaque.
    """
    curve = trace(element.opacity)
    if len(curve) < 3 or area(curve) <= 0:
        raise FexelError(f"{element.path}: {element.name} has no area")
    size = float(np.ptp(curve, axis=0).max())
    tolerance = min(tolerance, _RELATIVE_TOLERANCE * size)
    if not isinstance(wanted, str):
        return _outline(curve, wanted, _HINT_PULL, most_vertices, tolerance)
    veins = vein_convergence(element) if wanted == "veins" else None
    if veins is not None:
        found = _outline(curve, veins, _VEINS_PULL, most_vertices, tolerance)
        if _depth(found.contour, found.center) >= _LEAST_DEPTH * size:
            return found
    return _outline(curve, None, _MIDDLE_PULL, most_vertices, tolerance)


def _outline(
    curve: NDArray[np.float64], place: NDArray[np.float64] | None, pull: float, most_vertices: int, tolerance: float
) -> Outline:
    size = float(np.ptp(curve, axis=0).max())
    contour = simplify(curve, most_vertices, tolerance)
    found = clearance(contour.vertices) if is_simple(contour.vertices) else Clearance((0.0, 0.0), 0.0)
    if found.radius <= _LEAST_CLEARANCE * size:
        return _repaired(curve, place, pull, most_vertices, tolerance)
    aim = centroid(contour.vertices) if place is None else place
    whole = Outline(contour.vertices, kernel_point(contour.vertices, aim, found), 0.0, contour.tolerance)
    far = _FAR * np.sqrt(area(contour.vertices) / np.pi)
    if found.radius < _NARROW_CLEARANCE * size and np.hypot(*(whole.center - aim)) > far:
        repaired = _repaired(curve, place, pull, most_vertices, tolerance)
        return repaired if repaired.lost_area < _SMALL_LOSS else whole
    return whole


def _depth(contour: NDArray[np.float64], center: NDArray[np.float64]) -> float:
    """Distance of a centre from the nearest side."""
    return cv2.pointPolygonTest(contour.astype(np.float32)[:, None], (float(center[0]), float(center[1])), True)


def _repaired(
    curve: NDArray[np.float64], wanted: NDArray[np.float64] | None, pull: float, most_vertices: int, tolerance: float
) -> Outline:
    """What the best centre sees."""
    whole = curve[thinned(curve)]
    center = most_visible(whole, wanted, pull)
    seen = visible_curve(whole, center)
    contour = _star(seen, center, most_vertices, tolerance)
    lost = max(1 - area(seen) / area(whole), 0.0)
    return Outline(contour.vertices, center, lost, contour.tolerance)


def _star(seen: NDArray[np.float64], center: NDArray[np.float64], most_vertices: int, tolerance: float) -> Polygon:
    """Few vertices of a curve that the centre sees, still seen by it."""
    for count in range(most_vertices, 2, -1):
        polygon = simplify(seen, count, tolerance)
        if sees_all(center, polygon.vertices):
            return polygon
    every = seen[np.linspace(0, len(seen), max(most_vertices, 3), endpoint=False).astype(int)]
    return Polygon(every, float(np.ptp(seen, axis=0).max()))
