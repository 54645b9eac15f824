"""The report of a ground of umbrellas: what it costs to store, beside an explicit texture, as JSON.

::

    {"b", "v", "k", "n", "grid": [W, H], "J_words", "T_words": {"min", "avg", "max"}, "compressed_ratio", "bytes",
     "level_bytes", "seconds", "ratio": {"min", "avg", "max"}, "k_seen", "compressed_bytes": {"textures", "contours",
     "arrangement", "explicit"}, "texture_bytes", "array_bytes", "stage", "explicit": [w, h],
     "bases": [{"name", "file", "vertices", "texture": [w, h], "lost_area", "tolerance_px", "quality"}],
     "dropped": [{"file", "box": [left, top, right, bottom], "reason"}], "phases": {name: seconds}}

`b` base umbrellas of at most `v` vertices, the centre included; `n` modified ones; `k` the most that touch a cell of
the grid, `k_seen` of those that no opaque one hides. `J_words` is eq. (2), `T_words` eq. (3) of Just-in-time texture
synthesis (2012) in the readings of its table 1, four-byte words; bases count with their own vertices and textures
(`fexel_tools.umbrella_storage`). `ratio` is T over J, `compressed_ratio` the average reading's with both sides
compressed; null without umbrellas. `bytes` is what the files of the main texture take: the base textures and the
background, `texture_bytes`; the layer that holds the arrays, or the whole stage where there is none, `array_bytes`; and
the levels of detail, `level_bytes`. Companion maps and the picture for other applications are not part of it.
`seconds` is all phases from reading the photos to the stage in its place, on the clock; measuring and the compilation
of kernels, once per installation, are phases of their own, ``measure`` and ``compile``, and not part of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from fexel_tools.umbrella_storage import CompressedSizes, ExplicitWords

__all__ = ["BaseReport", "DroppedReport", "UmbrellaReport", "describe", "describe_dropped"]


@dataclass(frozen=True)
class BaseReport:
    """A base umbrella; see the module for the fields."""

    name: str
    file: str
    vertices: int
    texture: tuple[int, int]
    lost_area: float
    tolerance_px: float
    quality: float

    def as_json(self) -> dict:
        """The base's entry."""
        return {
            "name": self.name,
            "file": self.file,
            "vertices": self.vertices,
            "texture": list(self.texture),
            "lost_area": _number(self.lost_area),
            "tolerance_px": _number(self.tolerance_px),
            "quality": _number(self.quality),
        }


@dataclass(frozen=True)
class DroppedReport:
    """Something in a photo that is no whole element, or a photo without any (`box` None)."""

    file: str
    box: tuple[int, int, int, int] | None
    reason: str

    def as_json(self) -> dict:
        """The entry."""
        return {"file": self.file, "box": None if self.box is None else list(self.box), "reason": self.reason}


@dataclass(frozen=True)
class UmbrellaReport:
    """What became of the inputs; see the module for the fields."""

    stage: str
    bases: tuple[BaseReport, ...]
    k: int
    k_seen: int | None
    n: int
    grid: tuple[int, int]
    words: int
    explicit: ExplicitWords
    resolution: tuple[int, int]
    texture_bytes: int
    array_bytes: int
    level_bytes: int
    seconds: float
    compressed: CompressedSizes | None = None
    dropped: tuple[DroppedReport, ...] = ()
    phases: dict[str, float] = field(default_factory=dict)

    @property
    def nbytes(self) -> int:
        """Of the main texture's files."""
        return self.texture_bytes + self.array_bytes + self.level_bytes

    def as_json(self) -> dict:
        """The whole report."""
        readings = {"min": self.explicit.least, "avg": self.explicit.average, "max": self.explicit.most}
        sizes = self.compressed
        return {
            "b": len(self.bases),
            "v": max((base.vertices for base in self.bases), default=0),
            "k": self.k,
            "n": self.n,
            "grid": list(self.grid),
            "J_words": self.words,
            "T_words": {name: round(words) for name, words in readings.items()},
            "compressed_ratio": _number(sizes.ratio if sizes and self.n else None),
            "bytes": self.nbytes,
            "level_bytes": self.level_bytes,
            "seconds": round(self.seconds, 4),
            "ratio": {name: _number(words / self.words if self.n else None) for name, words in readings.items()},
            "k_seen": self.k_seen,
            "compressed_bytes": None
            if sizes is None
            else {
                "textures": sizes.textures,
                "contours": sizes.contours,
                "arrangement": sizes.arrangement,
                "explicit": sizes.explicit,
            },
            "texture_bytes": self.texture_bytes,
            "array_bytes": self.array_bytes,
            "stage": self.stage,
            "explicit": list(self.resolution),
            "bases": [base.as_json() for base in self.bases],
            "dropped": [dropped.as_json() for dropped in self.dropped],
            "phases": {name: round(seconds, 4) for name, seconds in self.phases.items()},
        }


def describe(report: UmbrellaReport) -> str:
    """One line about a ground: how many of what, bytes, and what an explicit texture would take."""
    width, height = report.grid
    bases = f"{len(report.bases)} base{'' if len(report.bases) == 1 else 's'}"
    umbrellas = f"{report.n} umbrella{'' if report.n == 1 else 's'}"
    sizes = f"{umbrellas} of {bases} on {width} x {height} cells, {report.nbytes} bytes"
    if not report.n:
        return f"{report.stage}: {sizes}"
    columns, rows = report.resolution
    ratio = report.explicit.average / report.words
    return f"{report.stage}: {sizes}; as sharp as {columns} x {rows} texels, {ratio:.1f} times the words"


def describe_dropped(dropped: Sequence[DroppedReport], most: int = 5) -> list[str]:
    """Lines about what was found but is not used; at most `most`."""
    lines = []
    for each in dropped[:most]:
        where = "" if each.box is None else f" at pixel ({each.box[0]}, {each.box[1]})"
        lines.append(f"{each.file}: left out{where}: {each.reason}")
    left = len(dropped) - most
    return lines + ([f"... and {left} more (in --report)"] if left > 0 else [])


def _number(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None
