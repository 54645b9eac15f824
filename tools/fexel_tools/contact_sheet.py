"""Contact sheets: rows of labelled pictures of equal size on one page, to compare sequences at a glance.

Pictures are (H, W, 3) uint8, sRGB-encoded, row 0 at the top, and so is the page.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from fexel.errors import FexelError
from fexel_tools.image_files import write_image

__all__ = ["SheetRow", "caption_strip", "contact_sheet", "write_png"]

_PAPER = (24, 24, 26)
_INK, _FAINT = (225, 225, 225), (160, 160, 165)
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_TEXT_PX = 14  # cap height of the row labels; column labels are a little smaller
_HERSHEY_CAP_PX = 22.0  # cap height of the font at scale 1


@dataclass(frozen=True, eq=False)
class SheetRow:
    """One row of a sheet: its label and its pictures."""

    label: str
    pictures: Sequence[np.ndarray]


def contact_sheet(rows: Sequence[SheetRow], column_labels: Sequence[str] = (), gap: int = 6) -> np.ndarray:
    """Lay out rows of pictures with a label above each row (none where it is '') and one below each column.

    The page is as wide as its pictures, or as the longest label of a row.

    Parameters
    ----------
    rows : sequence of SheetRow
        The same number of pictures each, all of one shape (H, W, 3) uint8, sRGB-encoded.
    column_labels : sequence of str
        One per column, or none.
    gap : int
        Pixels between pictures and along the page's edge.

    Returns
    -------
    (page height, page width, 3) uint8
        sRGB-encoded.

    Raises
    ------
    FexelError
        No pictures, or pictures or labels that do not match in number or size.

    Examples
    --------
    >>> grey = np.full((20, 30, 3), 128, np.uint8)
    >>> contact_sheet([SheetRow("a", [grey, grey])], ["1x", "2x"], gap=5).shape
    (73, 75, 3)
    """
    height, width, columns = _common_shape(rows, column_labels)
    label_height = _TEXT_PX + 10
    foot = label_height if column_labels else 0
    page_height = sum((label_height if row.label else gap) + height for row in rows) + gap + foot
    page_width = max(gap + columns * (width + gap), 2 * gap + max(_width(row.label) for row in rows))
    page = np.full((page_height, page_width, 3), _PAPER, np.uint8)
    top = 0
    for row in rows:
        _write(page, row.label, gap, top + label_height - 6, _TEXT_PX)
        top += label_height if row.label else gap
        for column, picture in enumerate(row.pictures):
            left = gap + column * (width + gap)
            page[top : top + height, left : left + width] = picture
        top += height
    for column, label in enumerate(column_labels):
        _write(page, label, gap + column * (width + gap), top + label_height - 6, _TEXT_PX - 3)
    return page


def caption_strip(width: int, height: int, lines: Sequence[str]) -> np.ndarray:
    """(height, width, 3) uint8, sRGB-encoded: small words to put above or below a picture, 18 pixels per line.

    Of several lines the first is a heading.
    """
    strip = np.full((height, width, 3), _PAPER, np.uint8)
    for number, line in enumerate(lines):
        scale, ink = (0.5, _INK) if number == 0 and len(lines) > 1 else (0.4, _FAINT)
        cv2.putText(strip, line, (2, 14 + 18 * number), _FONT, scale, ink, 1, cv2.LINE_AA)
    return strip


def _common_shape(rows: Sequence[SheetRow], column_labels: Sequence[str]) -> tuple[int, int, int]:
    shapes = {picture.shape for row in rows for picture in row.pictures}
    counts = {len(row.pictures) for row in rows}
    if len(shapes) != 1 or len(counts) != 1:
        raise FexelError(
            f"contact sheet: rows of {sorted(counts)} pictures of shapes {sorted(shapes)}, expected one of each"
        )
    (shape,), (columns,) = shapes, counts
    if column_labels and len(column_labels) != columns:
        raise FexelError(f"contact sheet: {len(column_labels)} column labels, expected {columns}")
    return shape[0], shape[1], columns


def _width(label: str) -> int:
    """Pixels that the label of a row takes."""
    return cv2.getTextSize(label, _FONT, _TEXT_PX / _HERSHEY_CAP_PX, 1)[0][0] if label else 0


def _write(page: np.ndarray, text: str, left: int, baseline: int, cap_px: int) -> None:
    cv2.putText(page, text, (left, baseline), _FONT, cap_px / _HERSHEY_CAP_PX, _INK, 1, cv2.LINE_AA)


def write_png(path: Path, pixels: np.ndarray) -> None:
    """Write (H, W, 3) uint8, sRGB-encoded, beside `path` and rename; its folder is made.

    Raises
    ------
    FexelError
        The file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FexelError(f"{path.parent}: cannot be made: {error.strerror}") from error
    write_image(path, pixels)
