"""The artist's way: patches placed by hand; colours, masks and the fallback are made as for registered photos.

A layout is a YAML file::

    root: wall.jpg                      # photo of the whole, relative to the layout file
    units: pixels                       # of corners and rect: root pixels (default), or st of the root
    patches:
      - file: door.jpg
        corners: [[10, 20], [90, 22], [88, 70], [12, 68]]   # of its top left, top right, bottom right, bottom left
      - file: sign.png
        rect: [10, 20, 90, 70]          # left, top, right, bottom (pixels) or s0, t0, s1, t1 with t0 below (st)
        mask: sign_mask.png             # white shows the patch; replaces the automatic mask
        opacity: 0.8                    # 0 to 1
        colors: keep                    # keep the photo's colours; default: match
        tau: 0.5                        # threshold of the automatic mask
        name: Sign                      # prim name
        children:                       # patches drawn on this one, placed in the same coordinates of the root
          - file: lock.jpg
            matrix: [[...], [...], [...]]   # 3x3, pixels of the photo to root pixels, column vectors, as in a report

or an existing USD stage: every ZipmapTexture in it is completed by a layer over it (`place_stage`).
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fexel.errors import FexelError
from fexel_tools.authoring import PlannedPatch, ZipmapOptions, author_stage, check_options, prim_names
from fexel_tools.coverage import clip_convex, rectangle
from fexel_tools.photos import check_mask, probe_photo
from fexel_tools.progress import Progress
from fexel_tools.staged_output import check_output

__all__ = ["place_zipmap", "read_layout"]

_PLACES = ("corners", "rect", "matrix")
_KEYS = {"file", "mask", "opacity", "colors", "tau", "name", "children", *_PLACES}


def place_zipmap(
    layout: str | Path, out: str | Path, options: ZipmapOptions | None = None, *, progress: Progress | None = None
) -> None:
    """Author a zipmap stage from a layout by hand.

    Parameters
    ----------
    layout : str or Path
        ``.yaml`` or ``.yml`` as in the module's description, or a USD stage.
    out : str or Path
        Stage to write.
    options : ZipmapOptions, optional
        Root, matching and least gain do not apply: what is placed is drawn.
    progress : callable(step, done, total), optional

    Raises
    ------
    FexelError
        Missing or malformed layout, a missing or unreadable photo or mask, a placement without an inverse.
    """
    options = options or ZipmapOptions()
    if not Path(layout).is_file():
        raise FexelError(f"{layout}: no such file")
    surface = check_options(out, options, [layout])
    suffix = Path(layout).suffix.lower()
    if suffix in (".yaml", ".yml"):
        root, patches = read_layout(layout, options)
        check_output(out, [file for p in (root, *patches) for file in (p.photo.file, p.mask) if file])
        author_stage(out, root, patches, options, surface=surface, progress=progress)
    elif suffix in (".usd", ".usda", ".usdc", ".usdz"):
        from fexel_tools.placed_stage import complete_stage

        complete_stage(layout, out, options, progress=progress)
    else:
        raise FexelError(f"{layout}: expected a layout (.yaml) or a stage (.usd, .usda, .usdc, .usdz)")


def read_layout(layout: str | Path, options: ZipmapOptions) -> tuple[PlannedPatch, list[PlannedPatch]]:
    """Read a YAML layout: the root and the patches in draw order, parents before children."""
    import yaml

    try:
        data = yaml.safe_load(Path(layout).read_text("utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise FexelError(f"{layout}: is not YAML: {' '.join(str(error).split())}") from error
    except RecursionError:
        raise FexelError(f"{layout}: is nested too deeply to be read") from None
    where = f"{layout}"
    if not isinstance(data, dict) or "root" not in data:
        raise FexelError(f"{where}: expected a mapping with the keys root and patches")
    _known(where, data, {"root", "units", "patches"})
    units = data.get("units", "pixels")
    if units not in ("pixels", "st"):
        raise FexelError(f"{where}: units is '{units}', expected pixels or st")
    folder = Path(layout).parent
    photo = probe_photo(_file(where, folder, data["root"]))
    root = PlannedPatch("root", "", photo, (0, 0, photo.width, photo.height))
    entries = _flatten(where, data.get("patches") or [], None, "patches")
    names = prim_names([str(entry.get("name") or entry.get("file", "")) for entry, _, _ in entries])
    patches: list[PlannedPatch] = []
    for (entry, parent, place), name in zip(entries, names, strict=True):
        above = "" if parent is None else patches[parent].name
        patches.append(_read_patch(f"{where}: {place}", folder, entry, name, above, root, units, options))
    return root, patches


def _flatten(where: str, entries: Any, parent: int | None, place: str) -> list[tuple[dict, int | None, str]]:
    """Entries depth first, each with the number of its parent and its place in the file."""
    found: list[tuple[dict, int | None, str]] = []
    above: list[int] = []

    def visit(items: Any, parent: int | None, place: str) -> None:
        if not isinstance(items, list):
            raise FexelError(f"{where}: {place}: expected a list of patches")
        for k, entry in enumerate(items):
            here = f"{place}[{k}]"
            if not isinstance(entry, dict) or "file" not in entry:
                raise FexelError(f"{where}: {here}: expected a mapping with the key file")
            _known(f"{where}: {here}", entry, _KEYS)
            if id(entry) in above:  # an alias of YAML
                raise FexelError(f"{where}: {here}: is its own descendant, expected patches that end")
            found.append((entry, parent, here))
            above.append(id(entry))
            visit(entry.get("children") or [], len(found) - 1, f"{here}.children")
            above.pop()

    visit(entries, parent, place)
    return found


def _known(where: str, entry: dict, keys: set[str]) -> None:
    unknown = [str(k) for k in entry if k not in keys]
    if unknown:
        raise FexelError(f"{where}: unknown key '{unknown[0]}', expected {', '.join(sorted(keys))}")


def _file(where: str, folder: Path, value: Any) -> str:
    path = os.path.normpath(folder / str(value))
    if not Path(path).is_file():
        raise FexelError(f"{where}: {value}: no such file")
    return path


def _read_patch(
    where: str,
    folder: Path,
    entry: dict,
    name: str,
    parent: str,
    root: PlannedPatch,
    units: str,
    options: ZipmapOptions,
) -> PlannedPatch:
    photo = probe_photo(_file(where, folder, entry["file"]))
    matrix = _placement(where, entry, (photo.width, photo.height), root, units)
    opacity, tau, colors = entry.get("opacity", 1.0), entry.get("tau", options.tau), entry.get("colors", "match")
    if not isinstance(opacity, (int, float)) or not 0.0 <= opacity <= 1.0:
        raise FexelError(f"{where}: opacity is {opacity}, expected 0 to 1")
    if tau is not None and not (isinstance(tau, (int, float)) and tau > 0.0 and np.isfinite(tau)):
        raise FexelError(f"{where}: tau is {tau}, expected a positive number")
    if colors not in ("match", "keep"):
        raise FexelError(f"{where}: colors is '{colors}', expected match or keep")
    mask = _file(where, folder, entry["mask"]) if entry.get("mask") else ""
    if mask:
        check_mask(mask)
    patch = PlannedPatch(
        name=name,
        parent=parent,
        photo=photo,
        window=(0, 0, photo.width, photo.height),
        root_from_photo=matrix,
        mask=mask,
        opacity=float(opacity),
        tau=tau,
        match_colors=colors == "match" and options.match_colors,
    )
    return _check_place(where, patch, root)


def _placement(where: str, entry: dict, size: tuple[int, int], root: PlannedPatch, units: str) -> np.ndarray:
    given = [key for key in _PLACES if key in entry]
    if len(given) != 1:
        raise FexelError(f"{where}: expected one of corners, rect, matrix, found {' and '.join(given) or 'none'}")
    shape = {"corners": (4, 2), "rect": (4,), "matrix": (3, 3)}[given[0]]
    try:
        values = np.array(entry[given[0]], np.float64)
    except (TypeError, ValueError):
        values = np.full(0, np.nan)
    if values.shape != shape or not np.isfinite(values).all():
        raise FexelError(f"{where}: {given[0]} must be {' x '.join(map(str, shape))} finite numbers")
    if given[0] == "matrix":
        return values
    if given[0] == "rect":
        a, b, c, d = values
        values = rectangle(a, b, c, d) if units == "pixels" else rectangle(a, d, c, b)
    if units == "st":
        values = np.column_stack([values[:, 0] * root.photo.width, (1.0 - values[:, 1]) * root.photo.height])
    return _homography_to(where, size, values)


def _homography_to(where: str, size: tuple[int, int], corners: np.ndarray) -> np.ndarray:
    """(3, 3) float64 that takes a photo's corners to four points."""
    x, y = rectangle(0, 0, *size).T
    u, v = corners.T
    zero, one = np.zeros(4), np.ones(4)
    try:
        with np.errstate(all="ignore"):  # corners too far away to be placed are found in `_check_place`
            left = np.stack([x, y, one, zero, zero, zero, -u * x, -u * y], axis=1)
            right = np.stack([zero, zero, zero, x, y, one, -v * x, -v * y], axis=1)
            solution = np.linalg.solve(np.concatenate([left, right]), np.concatenate([u, v]))
    except np.linalg.LinAlgError:
        raise FexelError(f"{where}: three of the corners lie on one line, expected a quadrilateral") from None
    return np.append(solution, 1.0).reshape(3, 3)


def _check_place(where: str, patch: PlannedPatch, root: PlannedPatch) -> PlannedPatch:
    """A placement must be invertible, in front of infinity all over the patch, and touch the root."""
    matrix = patch.root_from_photo
    corners = rectangle(*patch.window)
    largest = np.abs(matrix).max()
    matrix = matrix / largest if 0.0 < largest < np.inf else np.zeros((3, 3))  # zeros: told as singular
    w = corners @ matrix[2, :2] + matrix[2, 2]
    if abs(np.linalg.det(matrix)) < 1e-14 or w.min() * w.max() <= 0.0:
        raise FexelError(f"{where}: the placement is singular or reaches infinity inside the patch")
    matrix = matrix / (matrix[2] @ [patch.photo.width / 2.0, patch.photo.height / 2.0, 1.0])
    outline = np.column_stack([corners, np.ones(4)]) @ matrix.T
    outline = outline[:, :2] / outline[:, 2:]
    x, y = outline.T
    turned = np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))
    if not cv2.isContourConvex(outline.astype(np.float32)) and abs(turned) > 0.0:
        raise FexelError(f"{where}: the corners cross, expected top left, top right, bottom right, bottom left")
    if len(clip_convex(outline, rectangle(*root.window))) < 3:
        raise FexelError(f"{where}: the patch lies outside the root")
    return replace(patch, root_from_photo=matrix)
