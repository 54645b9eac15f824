"""Time of ``fexel umbrella``: 6100 umbrellas from nine cut-outs, levels of detail and fallback included.

The whole command in a process of its own, restricted to two cores: time on the clock from its start to its end, imports
included, and CPU time of all its threads. A run before those, uncounted, writes the report with the times of its phases
and leaves compiled kernels at hand.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.fall_leaves import COUNT, GRID, cutouts
from bench.harness import Row, progress
from bench.umbrella_command import CORES, Run, author, passiflora_scans

NAME = "umbrella authoring"
_ASKED_S = 10.0


def rows(quick: bool) -> Iterator[Row]:
    """Clock and CPU, synthetic and real leaves."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        inputs = {"9 synthetic leaves of 768 x 768 pixels": cutouts(folder / "cutouts")}
        if scans := passiflora_scans():
            inputs["9 scans of passion flower leaves"] = scans
        for title, files in inputs.items():
            place = folder / title.replace(" ", "_")
            author(files, place, "--report", str(place / "report.json"))
            report = json.loads((place / "report.json").read_text(encoding="utf-8"))
            runs = [author(files, place) for _ in progress(range(1 if quick else 5), title)]
            yield from _rows(title, runs, report)


def _rows(title: str, runs: list[Run], report: dict) -> Iterator[Row]:
    setting = f"{title}, n {COUNT}, grid {GRID[0]} x {GRID[1]}, levels and fallback included, {CORES} cores"
    phases = ", ".join(f"{name} {seconds:.2f}" for name, seconds in report["phases"].items())
    clock, cpu = [run.wall_s for run in runs], [run.cpu_s for run in runs]
    own = f"the command's own count {report['seconds']:.2f} s without imports: {phases}"
    busy = f"{os.getloadavg()[0]:.1f} processes were running on the machine" if hasattr(os, "getloadavg") else ""
    target = {"target": _ASKED_S, "comparison": "<="}
    yield Row("authoring, on the clock", setting, **_summary(clock), **target, note=f"{busy}; {own}")
    yield Row("authoring, CPU time of all threads", setting, **_summary(cpu), note="without the report")


def _summary(seconds: list[float]) -> dict:
    low, high = np.percentile(seconds, [25, 75])
    return {"value": float(np.median(seconds)), "unit": "s", "spread": (high - low) / 2, "samples": len(seconds)}
