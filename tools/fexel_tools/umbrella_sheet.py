"""A sheet that shows what a ground is made of: base umbrellas, how they are varied, and how they are arranged.

Figure 1 of Just-in-time texture synthesis (2012): a column per base with its contour and centre, then the same in
another colour, in another shape, in both. Below, the arrangement with its grid, and how many umbrellas touch each cell.

Pictures are (H, W, 3) uint8, sRGB-encoded, row 0 at the top.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel.images import linear_to_srgb
from fexel.textures.umbrella_arrangement import Arrangement
from fexel.textures.umbrella_cells import build_cells
from fexel_tools.contact_sheet import SheetRow, contact_sheet, write_png
from fexel_tools.umbrella_raster import rasterize

__all__ = ["SheetInput", "write_sheet"]

_MOST_BASES = 10
_SAMPLES = 4  # per axis and pixel
_PANEL_PX = 168
_ARRANGEMENT_PX = 900
_MARGIN = 0.08  # of a panel
_PAPER_LINEAR = (0.35, 0.35, 0.35, 1.0)
_PAPER = (24, 24, 26)
_LINE, _CENTRE = (255, 70, 200), (60, 240, 255)
_SPOKE = 0.3  # opacity of spokes, white
_GRID_LINE = 0.55  # how much of the picture's light a line of the grid leaves
_GAP = 6
_ROWS = ("bases: contour, spokes and centre", "other colours", "other shapes", "both")


@dataclass(frozen=True, eq=False)
class SheetInput:
    """What is drawn.

    Attributes
    ----------
    arrangement : Arrangement
    textures : tuple of (h, w, 4) float32
        Of each base, linear (or data), straight alpha.
    names : tuple of str
    background : (H, W, 3 or 4) float32 or colour
    is_data : bool
        Values are shown without sRGB encoding.
    """

    arrangement: Arrangement
    textures: tuple[NDArray[np.float32], ...]
    names: tuple[str, ...]
    background: NDArray[np.float32] | tuple[float, ...]
    is_data: bool = False


def write_sheet(shown: SheetInput, path: str | Path) -> None:
    """Draw and write the sheet.

    Raises
    ------
    FexelError
        The file cannot be written.
    """
    parts = [_bases(shown), _arranged(shown)]
    width = max(part.shape[1] for part in parts)
    padded = [_padded(part, part.shape[0], width) for part in parts]
    write_png(Path(path), np.concatenate(padded))


def _bases(shown: SheetInput) -> NDArray[np.uint8]:
    numbers = range(min(len(shown.names), _MOST_BASES))
    rows = [SheetRow(label, [_panel(shown, number, row) for number in numbers]) for row, label in enumerate(_ROWS)]
    most = int(_PANEL_PX / 8)
    labels = [_short(shown.names[number], most) for number in numbers]
    left = len(shown.names) - _MOST_BASES
    if left > 0:
        rows[0] = SheetRow(f"{rows[0].label}; {left} more are not shown", rows[0].pictures)
    return contact_sheet(rows, labels, _GAP)


def _panel(shown: SheetInput, number: int, row: int) -> NDArray[np.uint8]:
    """One base: as it is with its outline drawn, or varied as its most different umbrella is."""
    arrangement, shape = shown.arrangement, shown.arrangement.shapes[number]
    vertices = len(shape.points)
    example = _example(arrangement, number)
    colors, morph = np.zeros((0, 3), np.float32), 0.0
    if example is not None and row in (1, 3) and len(arrangement.colors):
        first = int(arrangement.first_vertex[example])
        colors = arrangement.colors[first : first + vertices]
    if example is not None and row in (2, 3) and len(arrangement.morphs):
        morph = float(arrangement.morphs[example])
    both = np.concatenate([shape.points, shape.morph_points])
    low, high = both.min(axis=0), both.max(axis=0)
    scale = (1.0 - 2.0 * _MARGIN) / max(float((high - low).max()), 1e-9)  # 1e-9 guards a base without extent
    matrix = np.array([[scale, 0, 0], [0, scale, 0], [*(0.5 - scale * 0.5 * (low + high)), 1.0]])
    one = replace(
        arrangement,
        shape_of=np.array([number], np.int32),
        matrices=matrix[None],
        morphs=np.array([morph]),
        colors=colors,
        coverages=np.ones(1),
        shadow_strength=0.0,
        grid=(1, 1),
    )
    picture = rasterize(one, shown.textures, _PAPER_LINEAR, (_PANEL_PX, _PANEL_PX), supersample=_SAMPLES)
    panel = _displayed(picture, shown.is_data)
    if row == 0:
        _draw_outline(panel, one.vertices)
    return panel


def _example(arrangement: Arrangement, number: int) -> int | None:
    """The umbrella of a base that differs most from it in shape and colour."""
    users = np.flatnonzero(arrangement.shape_of == number)
    if not len(users):
        return None
    difference = arrangement.morphs[users] if len(arrangement.morphs) else np.zeros(len(users))
    if len(arrangement.colors):
        rows = arrangement.first_vertex[users][:, None] + np.arange(len(arrangement.shapes[number].points))
        shift = np.abs(arrangement.colors[rows]).mean(axis=(1, 2))
        difference = difference + shift / max(float(shift.max()), 1e-9)  # 1e-9 guards offsets of 0
    return int(users[np.argmax(difference)])


def _draw_outline(panel: NDArray[np.uint8], vertices: NDArray[np.float64]) -> None:
    pixels = np.rint(vertices * (1, -1) * _PANEL_PX + (0, _PANEL_PX)).astype(np.int32)
    spokes = np.zeros(panel.shape[:2], np.uint8)
    for vertex in pixels[1:]:
        cv2.line(spokes, pixels[0].tolist(), vertex.tolist(), 255, 1, cv2.LINE_AA)
    share = (spokes * np.float32(_SPOKE / 255))[..., None]
    panel[:] = np.rint(panel * (1 - share) + 255 * share).astype(np.uint8)
    cv2.polylines(panel, [pixels[1:]], True, _LINE, 1, cv2.LINE_AA)
    for vertex in pixels[1:]:
        cv2.circle(panel, vertex.tolist(), 1, _LINE, -1, cv2.LINE_AA)
    cv2.circle(panel, pixels[0].tolist(), 3, _CENTRE, -1, cv2.LINE_AA)


def _arranged(shown: SheetInput) -> NDArray[np.uint8]:
    """The ground with its grid beside the number of umbrellas per cell."""
    columns, rows = shown.arrangement.grid
    scale = _ARRANGEMENT_PX / max(columns, rows)
    size = (max(1, round(columns * scale)), max(1, round(rows * scale)))
    drawn = rasterize(shown.arrangement, shown.textures, shown.background, size, supersample=_SAMPLES)
    picture = _displayed(drawn, shown.is_data)
    unshaded = replace(shown.arrangement, shadow_strength=0.0)  # what only casts a shadow into a cell does not count
    counts = build_cells(unshaded, (columns, rows), cull=False).counts.reshape(rows, columns)
    heat = cv2.resize(counts[::-1].astype(np.float32), size, interpolation=cv2.INTER_NEAREST)
    heat = np.rint(255 * heat / max(int(counts.max()), 1)).astype(np.uint8)
    heat = np.ascontiguousarray(cv2.applyColorMap(heat, cv2.COLORMAP_INFERNO)[..., ::-1])
    if scale >= 8:
        for line in (np.arange(1, columns) * scale).astype(int):
            picture[:, line] = (picture[:, line] * _GRID_LINE).astype(np.uint8)
        for line in (np.arange(1, rows) * scale).astype(int):
            picture[line] = (picture[line] * _GRID_LINE).astype(np.uint8)
    label = (
        f"{len(shown.arrangement)} umbrellas on {columns} x {rows} cells; at the right, how many a cell lists, "
        f"{int(counts.min())} to {int(counts.max())}, {counts.mean():.1f} on average"
    )
    return contact_sheet([SheetRow(label, [picture, heat])], (), _GAP)


def _displayed(picture: NDArray[np.float32], is_data: bool) -> NDArray[np.uint8]:
    """Over grey, sRGB-encoded; data as they are."""
    seen = picture[..., :3] + (1.0 - picture[..., 3:]) * np.float32(_PAPER_LINEAR[0])
    encoded = seen if is_data else linear_to_srgb(seen.clip(0, 1).astype(np.float32))
    return np.rint(encoded.clip(0, 1) * 255).astype(np.uint8)


def _padded(part: NDArray[np.uint8], height: int, width: int) -> NDArray[np.uint8]:
    page = np.full((height, width, 3), _PAPER, np.uint8)
    page[: part.shape[0], : part.shape[1]] = part
    return page


def _short(name: str, most: int) -> str:
    ascii_name = name.encode("ascii", "replace").decode()
    return ascii_name if len(ascii_name) <= most else f"{ascii_name[: most - 2]}.."
