"""The report of an authoring run: what became of every photo, as JSON.

::

    {"root": file, "photos": [{"file", "status": "root" | "patch" | "rejected", "reason", "parent", "scale",
                               "root_from_photo": 3x3, "inliers", "rms_px"}]}

`root_from_photo` maps continuous pixel coordinates (x right, y down, (0, 0) at the outer corner of the first pixel,
column vectors) of the upright photo, EXIF orientation applied, to the root's; it is null for a photo that was not
placed. `scale` is pixels of the photo per pixel of its parent. `inliers` and `rms_px` are of one registration of the
photo, with its parent if there is one: feature matches that agree, and the root mean square misplacement left over the
textured parts with the final placement, in pixels of the coarser of the two photos. Files are named as they were
given. Numbers that are not finite are null.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fexel.errors import FexelError

__all__ = ["PhotoReport", "ZipmapReport", "check_report", "write_report"]


@dataclass(frozen=True, eq=False)
class PhotoReport:
    """What became of one photo; see the module for the fields."""

    file: str
    status: str
    reason: str = ""
    parent: str | None = None
    scale: float | None = None
    root_from_photo: np.ndarray | None = None
    inliers: int | None = None
    rms_px: float | None = None

    def as_json(self) -> dict:
        """The photo's entry, in the order of the fields."""
        matrix = self.root_from_photo
        return {
            "file": self.file,
            "status": self.status,
            "reason": self.reason,
            "parent": self.parent,
            "scale": _number(self.scale),
            "root_from_photo": None if matrix is None else [[_number(v) for v in row] for row in matrix],
            "inliers": self.inliers,
            "rms_px": _number(self.rms_px),
        }


@dataclass(frozen=True, eq=False)
class ZipmapReport:
    """What became of all photos, in the order in which they were given."""

    root: str
    photos: tuple[PhotoReport, ...]

    def as_json(self) -> dict:
        """The whole report."""
        return {"root": self.root, "photos": [photo.as_json() for photo in self.photos]}


def check_report(file: str | Path, others: Iterable[str | Path] = (), what: str = "report") -> None:
    """See to it, before any work, that a report, or what else is written beside the output, can be written.

    Parameters
    ----------
    file : str or Path
    others : iterable of str or Path
        The run's inputs and its other outputs, which it must not replace.
    what : str
        What the file is, for messages.

    Raises
    ------
    FexelError
        Missing or unwritable folder, a folder or an unwritable file in the way, or one of the others.
    """
    path = Path(file)
    if not path.parent.is_dir():
        raise FexelError(f"{file}: the folder {path.parent} does not exist")
    if path.is_dir():
        raise FexelError(f"{file}: is a folder, expected a file name for the {what}")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise FexelError(f"{file}: the folder {path.parent} cannot be written to")
    if any(path.resolve() == Path(other).resolve() for other in others):
        raise FexelError(f"{file}: is an input or another output of this run, expected another file for the {what}")


def write_report(report: ZipmapReport, file: str | Path) -> None:
    """Write the report as JSON, beside and renamed.

    Raises
    ------
    FexelError
        The file cannot be written.
    """
    path = Path(file)
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        beside.write_text(json.dumps(report.as_json(), indent=1, allow_nan=False, ensure_ascii=False) + "\n", "utf-8")
        os.replace(beside, path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise FexelError(f"{file}: report cannot be written: {error.strerror}") from error


def _number(value: float | None) -> float | None:
    return float(value) if value is not None and np.isfinite(value) else None
