"""The table of a run, as JSON (everything), Markdown (to read) and the summary that is checked in under docs."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from bench.harness import ModuleResult, Row

__all__ = ["figure", "markdown", "summary_line", "write_json", "write_text"]

_HEADER = (
    "| measure | setting | figure | asked for | | elsewhere | note |\n| --- | --- | --- | --- | --- | --- | --- |\n"
)


def write_json(path: Path, machine: dict[str, Any], results: Iterable[ModuleResult], quick: bool) -> None:
    """Write beside and rename, so that an interrupted run leaves the former results whole."""
    document = {"quick": quick, "machine": machine, "modules": [result.as_dict() for result in results]}
    _write_whole(path, json.dumps(_finite(document), indent=1) + "\n")


def markdown(machine: dict[str, Any], results: Iterable[ModuleResult], quick: bool, plots: Iterable[str] = ()) -> str:
    """The table, one section per module, with the machine above it and links to `plots` below.

    `plots` are paths relative to the document.
    """
    sample = ", quick samples" if quick else ""
    packages = ", ".join(f"{name} {version}" for name, version in machine["packages"].items())
    head = (
        "# Benchmarks\n\n"
        f"{machine['date']}, commit {machine['commit']}{sample}. {machine['cores']} cores ({machine['processor']}), "
        f"OpenGL on {machine['opengl']}, Python {machine['python']}; {packages}.\n\n"
        "Figures are medians, ± half the interquartile range; *met* compares with what was asked for, and rows without "
        "such a figure are for information.\n"
    )
    parts = [head]
    for result in results:
        parts.append(f"\n## {result.name}\n\n")
        if result.error:
            parts.append(f"**failed**: {_cell(result.error)}\n\n")
        if result.rows:
            parts.append(_HEADER + "".join(_line(row) for row in result.rows))
    parts += [f"\n![{Path(plot).stem}]({plot})\n" for plot in plots]
    return "".join(parts)


def summary_line(results: Iterable[ModuleResult]) -> str:
    """One line: how many figures were asked for, met, missed, and which modules failed."""
    results = list(results)
    judged = [row.met for result in results for row in result.rows if row.met is not None]
    failed = [result.name for result in results if result.error]
    text = f"{sum(judged)} of {len(judged)} figures met"
    return text + (f"; failed: {', '.join(failed)}" if failed else "")


def write_text(path: Path, text: str) -> None:
    """Write a document whole or not at all."""
    _write_whole(path, text)


def figure(value: float) -> str:
    """Three significant digits, without an exponent where a reader does not want one."""
    if not math.isfinite(value):
        return "not measured"
    if value == 0:
        return "0"
    if 1e5 <= abs(value) < 1e9:
        return f"{value:,.0f}"
    if 1e-3 <= abs(value) < 1e5:
        digits = max(0, 2 - math.floor(math.log10(abs(value))))
        text = f"{value:.{digits}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.2g}"


def _line(row: Row) -> str:
    value = figure(row.value)
    if row.spread:
        value += f" ± {figure(row.spread)}"
    asked = "" if row.target is None else f"{row.comparison} {figure(row.target)} {row.unit}"
    met = {None: "", True: "met", False: "**missed**"}[row.met]
    cells = [
        row.measure,
        row.setting,
        f"{value} {row.unit}" if math.isfinite(row.value) else value,
        asked,
        met,
        row.reference,
        row.note,
    ]
    return "| " + " | ".join(_cell(cell) for cell in cells) + " |\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _finite(value: Any) -> Any:
    """JSON has no NaN: null instead."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _write_whole(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    part.write_text(text, encoding="utf-8")
    part.replace(path)
