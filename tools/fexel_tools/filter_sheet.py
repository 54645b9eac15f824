"""A sheet to compare filters by eye: views as rows, the truth and filters as columns, each picture over its error.

The heading of a column names the filter, what it fetches and keeps; under a picture stand its errors against the box
truth. Error maps show the largest difference of a channel, sRGB-encoded, from black to yellow at `ERROR_FULL`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel.images import linear_to_srgb
from fexel_tools.contact_sheet import SheetRow, contact_sheet, write_png
from fexel_tools.filter_measure import Measured, ViewPictures
from fexel_tools.filter_subject import Subject

__all__ = ["ERROR_FULL", "SheetPart", "write_sheet"]

ERROR_FULL = 0.1
"""Difference of encoded values that is drawn brightest."""

_LEAST_PX = 128  # side of a panel: its caption must fit
_CAPTION_PX, _HEADING_PX = 18, 58
_PAPER, _INK, _FAINT = (24, 24, 26), (225, 225, 225), (160, 160, 165)
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_TITLES = {
    "mipmap": "mipmap",
    "anisotropic": "anisotropic",
    "ripmap": "ripmap",
    "fipmap": "fipmap",
    "ewa": "EWA",
    "auto": "auto",
}


@dataclass(frozen=True, eq=False)
class SheetPart:
    """What is shown of one image."""

    subject: Subject
    figures: Sequence[Measured]
    pictures: Sequence[ViewPictures]


def write_sheet(parts: Sequence[SheetPart], path: str | Path) -> None:
    """Draw and write the sheet of all images, one below the other.

    Raises
    ------
    FexelError
        The file cannot be written.
    """
    write_png(Path(path), np.concatenate([_page(part) for part in parts]))


def _page(part: SheetPart) -> NDArray[np.uint8]:
    filters = list(part.pictures[0].shown)
    heading = contact_sheet([SheetRow(_title(part.subject), _headings(part, filters))])
    rows = [SheetRow(view.view.label, _panels(part, view, filters)) for view in part.pictures]
    return np.concatenate([heading, contact_sheet(rows)])


def _title(subject: Subject) -> str:
    left, top, right, bottom = subject.window
    width, height = subject.file_size
    size = f"{width} x {height}"
    if (right - left, bottom - top) != (width, height):
        size = f"middle {right - left} x {bottom - top} of {size}"
    return f"{Path(subject.name).name}, {size} texels, {subject.source.wrap[0]}"


def _headings(part: SheetPart, filters: Sequence[str]) -> list[NDArray[np.uint8]]:
    width = max(part.pictures[0].truth.shape[1], _LEAST_PX)
    panels = [_words(width, _HEADING_PX, ("truth", "mean over the pixel", f"error: 0 to {ERROR_FULL:g}"))]
    for token in filters:
        own = [figure for figure in part.figures if figure.filter == token and figure.truth == "box"]
        fetches, memory = [figure.fetches for figure in own], own[0].memory
        low, high = min(fetches), max(fetches)
        cost = f"{low:.0f}" if high - low < 0.5 else f"{low:.0f} to {high:.0f}"
        lines = (_TITLES[token], f"{cost} fetches", f"{memory:.2f} x memory")
        panels.append(_words(width, _HEADING_PX, lines))
    return panels


def _panels(part: SheetPart, view: ViewPictures, filters: Sequence[str]) -> list[NDArray[np.uint8]]:
    truth = _displayed(part.subject, view.truth)
    blank = np.full((*truth.shape[:2], 3), _PAPER, np.uint8)
    panels = [_panel(_eight_bit(truth), blank, "")]
    for token in filters:
        shown = _displayed(part.subject, view.shown[token])
        error = np.abs(shown - truth).max(axis=-1)
        map_ = cv2.applyColorMap(_eight_bit(error / ERROR_FULL), cv2.COLORMAP_INFERNO)[..., ::-1]
        panels.append(_panel(_eight_bit(shown), map_, _caption(part, view, token)))
    return panels


def _caption(part: SheetPart, view: ViewPictures, token: str) -> str:
    for figure in part.figures:
        if (figure.view, figure.filter, figure.truth) == (view.view, token, "box"):
            difference = "" if figure.ciede2000 is None else f"  dE {figure.ciede2000:.2f}"
            return f"{figure.psnr_db:.1f} dB{difference}"
    return ""


def _panel(picture: NDArray[np.uint8], error: NDArray[np.uint8], caption: str) -> NDArray[np.uint8]:
    both = np.concatenate([_centred(picture), _centred(error)])
    return np.concatenate([both, _words(both.shape[1], _CAPTION_PX, (caption,))])


def _centred(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """At its own size, whatever the panel's, so that pixels stay pixels."""
    missing = max(_LEAST_PX - picture.shape[1], 0)
    if missing == 0:
        return picture
    return cv2.copyMakeBorder(picture, 0, 0, missing // 2, missing - missing // 2, cv2.BORDER_CONSTANT, value=_PAPER)


def _words(width: int, height: int, lines: Sequence[str]) -> NDArray[np.uint8]:
    panel = np.full((height, width, 3), _PAPER, np.uint8)
    for number, line in enumerate(lines):
        scale, ink = (0.5, _INK) if number == 0 and len(lines) > 1 else (0.4, _FAINT)
        cv2.putText(panel, line, (2, 14 + 18 * number), _FONT, scale, ink, 1, cv2.LINE_AA)
    return panel


def _displayed(subject: Subject, picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """(H, W, 3) in [0, 1], as it is seen over white."""
    colour = picture[..., :3] / subject.white
    if subject.is_data:
        return np.clip(colour, 0, 1)
    return linear_to_srgb(np.clip(colour + 1.0 - picture[..., 3:], 0, 1))


def _eight_bit(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)
