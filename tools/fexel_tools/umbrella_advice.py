"""What a user asked for and does not get, though a ground is made: one warning each, with the first case and how many.

`UmbrellaReport` tells what was found; here is what was given and is of no use: centres that lie nowhere, references
that cannot be read, contours that take more vertices than allowed.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

from fexel.errors import FexelWarning
from fexel_tools.umbrella_base import BaseUmbrella
from fexel_tools.umbrella_elements import Element, Elements
from fexel_tools.umbrella_hints import Hints, given_point, is_hinted, names_of, takes
from fexel_tools.umbrella_options import UmbrellaOptions

__all__ = ["warn_of_centre", "warn_of_hints", "warn_of_references", "warn_of_tolerance"]

_COARSE = 0.02  # of the largest element's longer side: a contour that is off by less is not worth a word


def warn_of_hints(file: str, hints: Hints, elements: Sequence[Element]) -> None:
    """Of hints that no element takes: no photo is called so, or they lie beside its elements."""
    names = {name for element in elements for name in names_of(element)}
    unused = []
    for name, points in hints.items():
        named = [element for element in elements if name in names_of(element)]
        for x, y in points:
            if not any(takes(element, (x, y)) for element in named):
                reason = "lies in no element of it" if name in names else "no element is of a file of that name"
                unused.append(f"{name} at {x:g},{y:g}: {reason}")
    _warn(f"{file}: ", unused, "not used", "hints")


def warn_of_centre(centre: str, hints: Hints, elements: Sequence[Element]) -> None:
    """Of a point that elements without a hint are asked to have as their centre, and which lies beside them."""
    point = given_point(centre)
    if point is None:
        return
    free = [element for element in elements if not is_hinted(element, hints)]
    beside = [
        f"{centre} lies outside of {element.name} in {element.path} ({element.photo_size[0]} x {element.photo_size[1]} "
        "pixels)"
        for element in free
        if not takes(element, point)
    ]
    _warn("--centre: ", beside, "the nearest possible centre is taken", "elements")


def warn_of_references(sources: Sequence[Elements]) -> None:
    """Of references without an element whose colours could be taken."""
    empty = [f"{source.path}: {source.reason or 'no element found'}" for source in sources if not source.elements]
    _warn("--references: ", empty, "left out", "files")


def warn_of_tolerance(elements: Sequence[Element], bases: Sequence[BaseUmbrella], options: UmbrellaOptions) -> None:
    """Of contours that are off by far more than was asked for, as their vertices are limited."""
    coarse = [
        (base.tolerance_px, base.name)
        for element, base in zip(elements, bases, strict=True)
        if base.tolerance_px > max(options.tolerance, _COARSE * element.scale_px)
    ]
    coarse.sort(reverse=True)
    found = [
        f"the contour of {name} is off by {off:.3g} pixels, --tolerance is {options.tolerance:g}"
        for off, name in coarse
    ]
    _warn(f"--vertices {options.vertices}: ", found, "drawn as it is", "elements")


def _warn(where: str, found: Sequence[str], instead: str, what: str) -> None:
    if found:
        others = f" ({len(found)} {what} in all)" if len(found) > 1 else ""
        warnings.warn(f"{where}{found[0]}; {instead}{others}", FexelWarning, stacklevel=3)
