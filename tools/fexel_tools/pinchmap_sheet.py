"""Sheets that show what a pinchmap makes of its source, beside a plain texture of as many bytes.

Per file: original, result, plain texture, error; the places where the lines are more than the map can express are
ringed, a colour per reason. A close-up below shows a few texels of the pinchmap, where the lines are busiest.

Pictures are composited over a chequered ground where they are transparent. Colours above 1, and data, are brought to
0..1 over the range of the source's values (`pinchmap_range`), for the plain texture, too. All are (H, W, 3)
uint8, sRGB-encoded, row 0 at the top.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from fexel.images import linear_to_srgb, srgb_to_linear
from fexel_tools.contact_sheet import SheetRow, contact_sheet, write_png
from fexel_tools.pinchmap_baking import WHOLE
from fexel_tools.pinchmap_range import scaled, value_range

if TYPE_CHECKING:
    from fexel_tools.pinchmap_report import PinchmapItem
    from fexel_tools.pinchmap_solution import Pinchmap
    from fexel_tools.pinchmap_source import PinchmapSource

__all__ = ["Panels", "draw_panels", "plain_texture", "premultiplied", "seen", "write_sheet"]

_COLUMNS = ("original", "pinchmap", "plain, equal bytes", "error x 4")
_ERROR_GAIN = 4.0
_MOST_ROWS = 12
_CHEQUER_PX = 8
_CHEQUER = (0.55, 0.75)  # linear greys, on which black and white both show
_PAPER = (24, 24, 26)
_RINGS = {
    "crossing": (255, 60, 200),
    "junction": (255, 150, 30),
    "too near": (40, 220, 255),
    "too small": (120, 255, 80),
}
_OTHER_RING = (255, 255, 255)
_CHARACTER_PX = 9.0  # mean width of one, at the size of row labels

_Area = tuple[float, float, float, float]  # s0, t0, s1, t1


@dataclass(frozen=True, eq=False)
class Panels:
    """The rows of one file."""

    rows: tuple[SheetRow, ...]


def draw_panels(pinchmap: Pinchmap, item: PinchmapItem, longer_px: int, *, square: bool = False) -> Panels:
    """Draw the rows of a file: the whole, with its measures, and the close-up.

    Parameters
    ----------
    pinchmap : Pinchmap
    item : PinchmapItem
        Its measures and faults.
    longer_px : int
        Of the pictures.
    square : bool
        For a sheet of many files: the whole alone, every picture padded to a square.
    """
    height, width = pinchmap.source.side.shape
    scale = longer_px / max(width, height)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    truth = scaled(premultiplied(pinchmap.source), value_range(pinchmap.source))
    plain = plain_texture(truth, item.nbytes, pinchmap.has_alpha, pinchmap.source.is_data)
    whole = _marked(_pictures(pinchmap, plain, WHOLE, size), item, size)
    if square:
        return Panels((SheetRow(_headline(item, longer_px), [_squared(picture, longer_px) for picture in whole]),))
    rows = [SheetRow(_headline(item, longer_px), whole)]
    corners = pinchmap.detail_st
    if corners is not None:
        window = _shaped((*corners[0], *corners[2]), size, (width, height))
        rows.append(SheetRow(_faults_line(item), _pictures(pinchmap, plain, window, size)))
    return Panels(tuple(rows))


def write_sheet(panels: Sequence[Panels], path: str | Path) -> None:
    """Write the sheet of one or many files, in columns side by side where they are more than fit one below another.

    Raises
    ------
    FexelError
        The file cannot be written.
    """
    rows = [row for each in panels for row in each.rows]
    if not rows:
        return
    length = -(-len(rows) // -(-len(rows) // _MOST_ROWS))
    pages = [contact_sheet(rows[first : first + length], _COLUMNS) for first in range(0, len(rows), length)]
    height = max(len(page) for page in pages)
    sheet = np.hstack([np.pad(page, ((0, height - len(page)), (0, 0), (0, 0)), mode="edge") for page in pages])
    write_png(Path(path), sheet)


def plain_texture(picture: np.ndarray, nbytes: int, has_alpha: bool, is_data: bool = False) -> np.ndarray:
    """The picture as an 8-bit texture of so many bytes, shaped like it: area averages, straight alpha.

    Parameters
    ----------
    picture : (H, W, 4) float32
        Linear (or data), premultiplied, within 0..1: scaled by `pinchmap_range` where the source's values are not.
    nbytes : int
    has_alpha : bool
        Four channels, else three.
    is_data : bool
        Stored without sRGB encoding.

    Returns
    -------
    (h, w, 4) float32
        As a renderer reads it: linear, premultiplied.
    """
    height, width = picture.shape[:2]
    texels = nbytes / (4 if has_alpha else 3)
    columns = min(width, max(1, int(np.sqrt(texels * width / height))))
    rows = min(height, max(1, int(texels / columns)))
    small = cv2.resize(picture, (columns, rows), interpolation=cv2.INTER_AREA).reshape(rows, columns, 4)
    alpha = np.rint(small[..., 3:].clip(0, 1) * 255) / np.float32(255)
    straight = (small[..., :3] / np.maximum(small[..., 3:], 1e-6)).clip(0, 1)  # 1e-6 guards transparent texels
    stored = np.rint((straight if is_data else linear_to_srgb(straight)) * 255) / np.float32(255)
    rgb = stored if is_data else srgb_to_linear(stored)
    return np.dstack([rgb * alpha, alpha]).astype(np.float32)


def premultiplied(source: PinchmapSource) -> np.ndarray:
    """(H, W, 4) float32: the source as it is seen, linear (or data), premultiplied."""
    return np.dstack([source.color * source.opacity[..., None], source.opacity]).astype(np.float32)


def _pictures(pinchmap: Pinchmap, plain: np.ndarray, window: _Area, size: tuple[int, int]) -> list[np.ndarray]:
    """Original, result, plain texture and error of a window."""
    width, height = size
    span, is_data = value_range(pinchmap.source), pinchmap.source.is_data
    result = scaled(pinchmap.picture((height, width), window), span)
    original = scaled(seen(premultiplied(pinchmap.source), size, window), span)
    original, result, plain = (
        _displayed(picture, is_data) for picture in (original, result, seen(plain, size, window))
    )
    difference = np.abs(result.astype(np.float32) - original).max(axis=2) * _ERROR_GAIN
    heat = cv2.applyColorMap(difference.clip(0, 255).astype(np.uint8), cv2.COLORMAP_INFERNO)
    return [original, result, plain, np.ascontiguousarray(heat[..., ::-1])]


def seen(image: np.ndarray, size: tuple[int, int], window: _Area = WHOLE) -> np.ndarray:
    """Resize a window of an image: area averages where it shrinks, bilinear where it grows.

    Parameters
    ----------
    image : (H, W, 4) float32
    size : (int, int)
        Width and height.
    window : (s0, t0, s1, t1)
    """
    height, width = image.shape[:2]
    x0, y0 = window[0] * width, (1 - window[3]) * height
    step_x, step_y = (window[2] - window[0]) * width / size[0], (window[3] - window[1]) * height / size[1]
    if step_x > 1 or step_y > 1:
        columns = slice(int(x0), max(int(x0) + 1, round(x0 + step_x * size[0])))
        rows = slice(int(y0), max(int(y0) + 1, round(y0 + step_y * size[1])))
        return cv2.resize(image[rows, columns], size, interpolation=cv2.INTER_AREA)
    matrix = np.array([[step_x, 0, x0 + 0.5 * step_x - 0.5], [0, step_y, y0 + 0.5 * step_y - 0.5]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(image, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)


def _displayed(picture: np.ndarray, is_data: bool) -> np.ndarray:
    """Scaled to 0..1: over the chequered ground, sRGB-encoded; data without encoding."""
    y, x = np.indices(picture.shape[:2]) // _CHEQUER_PX
    ground = np.where((x + y) % 2, _CHEQUER[0], _CHEQUER[1])[..., None]
    linear = (picture[..., :3] + (1 - picture[..., 3:]) * ground).clip(0, 1)
    return np.rint((linear if is_data else linear_to_srgb(linear)) * 255).astype(np.uint8)


def _shaped(window: tuple[float, ...], size: tuple[int, int], source: tuple[int, int]) -> _Area:
    """The window about the same centre that has the pictures' aspect, moved inside the texture."""
    s, t = 0.5 * (window[0] + window[2]), 0.5 * (window[1] + window[3])
    pixels = max((window[2] - window[0]) * source[0] / size[0], (window[3] - window[1]) * source[1] / size[1])
    half_s, half_t = min(0.5, 0.5 * pixels * size[0] / source[0]), min(0.5, 0.5 * pixels * size[1] / source[1])
    s, t = float(np.clip(s, half_s, 1 - half_s)), float(np.clip(t, half_t, 1 - half_t))
    return s - half_s, t - half_t, s + half_s, t + half_t


def _marked(pictures: list[np.ndarray], item: PinchmapItem, size: tuple[int, int]) -> list[np.ndarray]:
    """Rings about the faults, on result and error."""
    scale = np.array(size) / item.source
    radius = max(5, max(size) // 45)
    for fault in item.faults:
        x, y = (np.array([fault.x, fault.y]) * scale).astype(int)
        for picture in (pictures[1], pictures[3]):
            cv2.circle(picture, (int(x), int(y)), radius, (0, 0, 0), 4, cv2.LINE_AA)
            cv2.circle(picture, (int(x), int(y)), radius, _RINGS.get(fault.reason, _OTHER_RING), 2, cv2.LINE_AA)
    return pictures


def _squared(picture: np.ndarray, side: int) -> np.ndarray:
    page = np.full((side, side, 3), _PAPER, np.uint8)
    top, left = (side - picture.shape[0]) // 2, (side - picture.shape[1]) // 2
    page[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return page


def _headline(item: PinchmapItem, longer_px: int) -> str:
    columns, rows = item.pinchmap
    name = Path(item.file).name.encode("ascii", "replace").decode()
    facts = f"{columns} x {rows}, {item.nbytes} bytes, {100 * item.mismatch:.3f} % wrong, IoU {item.iou:.4f}"
    facts += "" if item.psnr_db is None else f", {item.psnr_db:.1f} dB"
    facts += f", {len(item.faults)} marked" if item.faults else ""
    most = max(8, int(len(_COLUMNS) * longer_px / _CHARACTER_PX) - len(facts) - 2)
    return f"{name if len(name) <= most else name[: most - 2] + '..'}  {facts}"


def _faults_line(item: PinchmapItem) -> str:
    counts = Counter(fault.reason for fault in item.faults)
    marked = ", ".join(f"{count} {reason}" for reason, count in sorted(counts.items()))
    return "close-up" + (f"; marked above, more than the map can express: {marked}" if marked else "")
