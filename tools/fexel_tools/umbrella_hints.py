"""Where centres of elements are wanted, file by file: a table beside the photos.

CSV with the columns ``file,x,y``, or JSON ``{file: [x, y]}`` (``[[x, y], ...]`` for a photo of several elements). x and
y are pixels of the upright photo from its upper left corner, x right, y down, or shares of its width and height where
both are within [0, 1]. A file is named as it was given, by its name alone or by its stem; an element of a photo of many
by its own name, such as ``photo_3``, or by a row of the photo that lies within it.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel_tools.umbrella_elements import Element

__all__ = ["Hints", "given_point", "hint_of", "is_hinted", "names_of", "read_hints", "takes"]

Hints = Mapping[str, Sequence[tuple[float, float]]]
"""Places by name of element, file, or its stem."""

_WORDS = ("auto", "centroid", "veins")


def read_hints(file: str | Path) -> dict[str, list[tuple[float, float]]]:
    """Read a table of hints.

    Raises
    ------
    FexelError
        The file cannot be read, or an entry has no place.
    """
    try:
        text = Path(file).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no UTF-8 text"
        raise FexelError(f"{file}: cannot be read: {reason}") from error
    rows = _json_rows(file, text) if text.lstrip().startswith("{") else _csv_rows(text)
    hints: dict[str, list[tuple[float, float]]] = {}
    for name, place in rows:
        hints.setdefault(name, []).append(_point(file, name, place))
    return hints


def hint_of(element: Element, centre: str, hints: Hints) -> NDArray[np.float64] | None:
    """Where the centre of an element is wanted.

    Parameters
    ----------
    element : Element
    centre : str
        ``x,y`` for elements without a hint; a word stands for none.
    hints : mapping of str to sequence of (float, float)

    Returns
    -------
    (2,) float64 or None
        Pixels of `Element.color`, y up.
    """
    inside = [point for name in names_of(element) for point in hints.get(name, ()) if takes(element, point)]
    point = inside[0] if inside else given_point(centre)
    return None if point is None else _in_element(element, _in_photo(element, point))


def is_hinted(element: Element, hints: Hints) -> bool:
    """Whether a hint lies within an element."""
    return any(takes(element, point) for name in names_of(element) for point in hints.get(name, ()))


def names_of(element: Element) -> tuple[str, ...]:
    """What a table may call an element, the most particular first."""
    return element.name, str(element.path), element.path.name, element.path.stem


def takes(element: Element, point: tuple[float, float]) -> bool:
    """Whether a place, as it is given, lies within the box of an element."""
    x, y = _in_photo(element, point)
    left, top, right, bottom = element.box
    return left <= x <= right and top <= y <= bottom


def given_point(centre: str) -> tuple[float, float] | None:
    """Of ``x,y``; None of a word.

    Raises
    ------
    FexelError
        Neither of them.
    """
    return None if centre in _WORDS else _point("--centre", "x,y", centre.split(","))


def _json_rows(file: str | Path, text: str) -> list[tuple[str, Sequence]]:
    try:
        entries = json.loads(text)
    except json.JSONDecodeError as error:
        raise FexelError(f"{file}: line {error.lineno}: {error.msg}, expected JSON") from None
    rows: list[tuple[str, Sequence]] = []
    for name, value in entries.items():
        several = isinstance(value, list) and bool(value) and isinstance(value[0], list)
        rows += [(name, place) for place in value] if several else [(name, value)]
    return rows


def _csv_rows(text: str) -> list[tuple[str, Sequence]]:
    rows = [row for row in csv.reader(text.splitlines()) if any(cell.strip() for cell in row)]
    if rows and [cell.strip().lower() for cell in rows[0][:3]] == ["file", "x", "y"]:
        rows = rows[1:]
    return [(row[0].strip(), [cell for cell in row[1:] if cell.strip()]) for row in rows]


def _point(file: str | Path, name: str, place: Sequence) -> tuple[float, float]:
    try:
        x, y = (float(part) for part in place)
    except (TypeError, ValueError):
        x = y = np.nan
    if not (np.isfinite(x) and np.isfinite(y)):
        found = ",".join(str(part) for part in place) if isinstance(place, (list, tuple)) else place
        raise FexelError(f"{file}: {name}: '{found}', expected x,y in pixels of the photo")
    return x, y


def _in_photo(element: Element, point: tuple[float, float]) -> tuple[float, float]:
    """Pixels of the photo, where shares of its sides were given."""
    if max(point) <= 1.0 and min(point) >= 0.0:
        return point[0] * element.photo_size[0], point[1] * element.photo_size[1]
    return point


def _in_element(element: Element, place: tuple[float, float]) -> NDArray[np.float64]:
    left, top = element.box[:2]
    x, y = (place[0] - left) / element.pixel, (place[1] - top) / element.pixel
    return np.array([x, element.opacity.shape[0] - y])
