"""A sheet to compare filters by eye: views as rows, the truth and filters as columns, each picture over its error.

The heading of a column names the filter, what it fetches and keeps; under a picture stand its errors against the box
truth, of the Gaussian fipmap those against the Gaussian one. Error maps show the largest difference of a channel from
the box truth, sRGB-encoded, by the colours of the key in the first heading: from black, none, to yellow, `ERROR_FULL`
and more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel.images import linear_to_srgb
from fexel_tools.contact_sheet import SheetRow, caption_strip, contact_sheet, write_png
from fexel_tools.filter_measure import GAUSS_FIPMAP, Measured, ViewPictures
from fexel_tools.filter_subject import Subject

__all__ = ["ERROR_FULL", "SheetPart", "write_sheet"]

ERROR_FULL = 0.1
"""Difference of encoded values that is drawn brightest."""

_LEAST_PX = 128  # side of a panel: its caption must fit
_CAPTION_PX, _HEADING_PX = 18, 58
_KEY = (41, 53, 48, 92)  # top, bottom, left, right of the key in the heading
_PAPER = (24, 24, 26)


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
    write_png(Path(path), _stacked([_page(part) for part in parts]))


def _page(part: SheetPart) -> NDArray[np.uint8]:
    filters = list(part.pictures[0].shown)
    heading = contact_sheet([SheetRow(_title(part.subject), _headings(part, filters))])
    rows = [SheetRow(view.view.label, _panels(part, view, filters)) for view in part.pictures]
    return _stacked([heading, contact_sheet(rows)])


def _stacked(pages: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """One below the other, all as wide as the widest."""
    width = max(page.shape[1] for page in pages)
    return np.concatenate([_widened(page, width) for page in pages])


def _title(subject: Subject) -> str:
    left, top, right, bottom = subject.window
    width, height = subject.file_size
    size = f"{width} x {height}"
    if (right - left, bottom - top) != (width, height):
        size = f"middle {right - left} x {bottom - top} of {size}"
    return f"{Path(subject.name).name}, {size} texels, {subject.source.wrap[0]}"


def _headings(part: SheetPart, filters: Sequence[str]) -> list[NDArray[np.uint8]]:
    width = max(part.pictures[0].truth.shape[1], _LEAST_PX)
    panels = [_key(width)]
    for token in filters:
        own = [figure for figure in part.figures if figure.filter == token and figure.truth == "box"]
        fetches, memory = [figure.fetches for figure in own], own[0].memory
        low, high = min(fetches), max(fetches)
        cost = f"{low:.0f}" if high - low < 0.5 else f"{low:.0f} to {high:.0f}"
        lines = (token, f"{cost} fetches", f"{memory:.2f} x memory")
        panels.append(caption_strip(width, _HEADING_PX, lines))
    return panels


def _key(width: int) -> NDArray[np.uint8]:
    """The heading of the first column, with the colours of error maps."""
    panel = caption_strip(width, _HEADING_PX, ("truth", "mean over the pixel", "error 0"))
    top, bottom, left, right = _KEY
    panel[top:bottom, left:right] = _map_colors(np.linspace(0, 1, right - left))[None]
    panel[36:, right + 1 :] = caption_strip(width - right - 1, _HEADING_PX - 36, (f"{ERROR_FULL:g}",))
    return panel


def _map_colors(shares: NDArray[np.floating]) -> NDArray[np.uint8]:
    """(..., 3), sRGB-encoded, of errors as shares of `ERROR_FULL`."""
    levels = _eight_bit(shares)
    return cv2.applyColorMap(levels.reshape(-1, 1), cv2.COLORMAP_INFERNO)[:, 0, ::-1].reshape(*levels.shape, 3)


def _panels(part: SheetPart, view: ViewPictures, filters: Sequence[str]) -> list[NDArray[np.uint8]]:
    truth = _displayed(part.subject, view.truth)
    blank = np.full((*truth.shape[:2], 3), _PAPER, np.uint8)
    panels = [_panel(_eight_bit(truth), blank, "")]
    for token in filters:
        shown = _displayed(part.subject, view.shown[token])
        error = np.abs(shown - truth).max(axis=-1)
        panels.append(_panel(_eight_bit(shown), _map_colors(error / ERROR_FULL), _caption(part, view, token)))
    return panels


def _caption(part: SheetPart, view: ViewPictures, token: str) -> str:
    truth = "gauss" if token == GAUSS_FIPMAP else "box"
    for figure in part.figures:
        if (figure.view, figure.filter, figure.truth) == (view.view, token, truth):
            difference = "" if figure.ciede2000 is None else f"  dE {figure.ciede2000:.2f}"
            return f"{figure.psnr_db:.1f} dB{difference}"
    return ""


def _panel(picture: NDArray[np.uint8], error: NDArray[np.uint8], caption: str) -> NDArray[np.uint8]:
    both = _widened(np.concatenate([picture, error]), _LEAST_PX)
    return np.concatenate([both, caption_strip(both.shape[1], _CAPTION_PX, (caption,))])


def _widened(picture: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """At its own size, on paper that is at least so wide, flush left as captions are."""
    missing = max(width - picture.shape[1], 0)
    return cv2.copyMakeBorder(picture, 0, 0, 0, missing, cv2.BORDER_CONSTANT, value=_PAPER) if missing else picture


def _displayed(subject: Subject, picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """(H, W, 3) in [0, 1], as it is seen over white."""
    colour = picture[..., :3] / subject.white
    if subject.is_data:
        return np.clip(colour, 0, 1)
    return linear_to_srgb(np.clip(colour + 1.0 - picture[..., 3:], 0, 1))


def _eight_bit(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)
