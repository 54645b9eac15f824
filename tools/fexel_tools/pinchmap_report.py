"""The report of pinchmaps: what each file became, how well it fits, and where it does not, as JSON.

::

    {"items": [{"file", "size", "bytes", "iou", "mismatch", "mean_px", "max_px", "psnr_db", "seconds",
                "plain_psnr_db", "stage", "pinchmap": [w, h], "signal": [w, h], "source": [w, h], "suggested_size",
                "faults": [{"x", "y", "reason", "pixels"}], "phases": {name: seconds}}],
     "failed": [{"file", "error"}]}

`size` is pinchmap texels along the longer side, `bytes` what pinchmap and signal hold, uncompressed and without mip
levels. `mismatch` is the share of source pixels on the wrong side of the lines, `iou` the intersection over union of
the side that the source's mask calls inside; `mean_px` and `max_px` are distances between the boundaries of source and
result, in source pixels; null where just one of them has any. `psnr_db` compares the result, over white, with the
source, sRGB-encoded (data: as they are), against a peak of 1, of the source's largest colour where that is above 1, or
of the range of its data; `plain_psnr_db` is that of a plain texture of as many bytes. `seconds` is all phases from
reading the source to the stage in its place, on the clock; what it takes to measure is the phase ``measure``, and to
compile kernels, once per installation, the phase ``compile``: they are not part of it. A fault is a place where the
lines are more than the map can express; x and y are pixels of the source, from its upper left corner.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from fexel_tools.pinchmap_fit import Fault
from fexel_tools.pinchmap_measure import BEST_PSNR_DB

__all__ = ["PinchmapItem", "PinchmapReport", "describe", "describe_blur", "describe_faults"]

_LITTLE_GAIN_DB = 2.0
_LINES_FIT = 0.005  # share of pixels on the wrong side


@dataclass(frozen=True)
class PinchmapItem:
    """What became of one file; see the module for the fields."""

    file: str
    size: int
    nbytes: int
    iou: float | None
    mismatch: float
    mean_px: float | None
    max_px: float | None
    psnr_db: float | None
    seconds: float
    stage: str
    pinchmap: tuple[int, int]
    signal: tuple[int, int]
    source: tuple[int, int]
    suggested_size: int | None = None
    plain_psnr_db: float | None = None
    faults: tuple[Fault, ...] = ()
    phases: dict[str, float] = field(default_factory=dict)
    has_lines: bool = True

    def as_json(self) -> dict:
        """The file's entry."""
        return {
            "file": self.file,
            "size": self.size,
            "bytes": self.nbytes,
            "iou": _number(self.iou),
            "mismatch": _number(self.mismatch),
            "mean_px": _number(self.mean_px),
            "max_px": _number(self.max_px),
            "psnr_db": _number(self.psnr_db),
            "seconds": round(self.seconds, 4),
            "plain_psnr_db": _number(self.plain_psnr_db),
            "stage": self.stage,
            "pinchmap": list(self.pinchmap),
            "signal": list(self.signal),
            "source": list(self.source),
            "suggested_size": self.suggested_size,
            "faults": [
                {"x": round(f.x, 2), "y": round(f.y, 2), "reason": f.reason, "pixels": f.pixels} for f in self.faults
            ],
            "phases": {name: round(seconds, 4) for name, seconds in self.phases.items()},
        }


@dataclass(frozen=True)
class PinchmapReport:
    """What became of all files, in the order in which they were given.

    Attributes
    ----------
    items : tuple of PinchmapItem
    failed : tuple of (file, message)
    """

    items: tuple[PinchmapItem, ...]
    failed: tuple[tuple[str, str], ...] = ()

    def as_json(self) -> dict:
        """The whole report."""
        return {
            "items": [item.as_json() for item in self.items],
            "failed": [{"file": file, "error": message} for file, message in self.failed],
        }


def describe(item: PinchmapItem) -> str:
    """One line about a file: sizes, bytes, measures."""
    width, height = item.pinchmap
    distance = "" if item.max_px is None else f", boundary off by {item.mean_px:.2f} px, at most {item.max_px:.1f} px"
    psnr = "" if item.psnr_db is None else f", {item.psnr_db:.1f} dB"
    iou = "" if item.iou is None else f", IoU {item.iou:.4f}"
    wrong = f"{100 * item.mismatch:.3f} % of pixels on the wrong side"
    return f"{item.file}: {width} x {height}, {item.nbytes} bytes, {wrong}{iou}{distance}{psnr}"


def describe_faults(file: str, faults: Sequence[Fault], suggested_size: int | None, most: int = 5) -> list[str]:
    """Lines that say where the map falls short, the worst places first, and which size would help; none without.

    At most `most` places are listed.
    """
    if not faults:
        return []
    ordered = sorted(faults, key=lambda fault: -fault.pixels)
    places = f"{len(faults)} place{'s' if len(faults) > 1 else ''}"
    hint = f"; --size {suggested_size} would help" if suggested_size else ""
    lines = [f"{file}: {places} where the lines are more than the map can express{hint}"]
    lines += [
        f"  {fault.reason} at pixel ({fault.x:.0f}, {fault.y:.0f}), {fault.pixels} pixels wrong"
        for fault in ordered[:most]
    ]
    left = len(faults) - most
    return lines + ([f"  ... and {left} more (in --report)"] if left > 0 else [])


def describe_blur(item: PinchmapItem) -> str:
    """A line for a picture of which a plain texture shows nearly as much, because its edges lie inside; else ''."""
    if not item.has_lines:
        return f"{item.file}: nothing is sharp, since its alpha has no line to follow; --regions auto may find edges"
    if item.psnr_db is None or item.plain_psnr_db is None or item.psnr_db > item.plain_psnr_db + _LITTLE_GAIN_DB:
        return ""
    if item.mismatch > _LINES_FIT or item.psnr_db >= BEST_PSNR_DB:  # the lines themselves fall short, or nothing does
        return ""
    return (
        f"{item.file}: colours inside the edges are as soft as in a plain texture of equal bytes "
        f"({item.plain_psnr_db:.1f} dB); --regions auto may draw edges between them, a larger --signalSize shows more"
    )


def _number(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None
