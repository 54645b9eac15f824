"""What a user waits for: a large stage to its first frame, a frame of a zoom, the command on a folder of photos."""

from __future__ import annotations

import json
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bench import many_patches
from bench.harness import REPOSITORY, Row, scratch

NAME = "end to end"
PHOTOS = REPOSITORY / "stages" / "zipmap_demo" / "photos"
_WIDTH = 1024
_COMMAND = "from fexel_tools.cli import main; main()"


def rows(quick: bool) -> Iterator[Row]:
    """Measures that no single technique owns."""
    folder = scratch()
    try:
        yield from first_frame_rows(folder, quick)
        yield from zoom_rows(quick)
        yield from command_rows(folder, quick)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def first_frame_rows(folder: Path, quick: bool) -> Iterator[Row]:
    """Stage of 10,000 patches, five in view, fresh processes."""
    stage = many_patches.write_stage(folder)
    reports = [_first_frame(stage) for _ in range(3 if quick else 7)]
    setting = f"{many_patches.IN_VIEW} of 10,000 patches in view, {_WIDTH} x {_WIDTH}, fresh process"
    seconds = [report["open_s"] + report["render_s"] for report in reports]
    imports = statistics.median(report["import_s"] for report in reports)
    yield _row(
        "stage open to first frame", setting, seconds, "s", 2.0, note=f"imports before it: {imports:.2f} s, not counted"
    )
    before = statistics.median(report["imported_mb"] for report in reports)
    yield _row(
        "resident memory at the first frame",
        setting,
        [report["peak_mb"] for report in reports],
        "MB",
        300.0,
        note=f"{before:.0f} MB of it after the imports alone",
    )


def _first_frame(stage: Path) -> dict[str, Any]:
    command = [sys.executable, "-m", "bench.first_frame", str(stage), many_patches.CAMERA, str(_WIDTH)]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "no first frame")
    return json.loads(done.stdout.splitlines()[-1])


def zoom_rows(quick: bool) -> Iterator[Row]:
    """Frames of the example stages' zooms, in one process, files not written."""
    from pxr import Usd

    import fexel

    for name in ("zipmap_demo", "zipmap_deep"):
        stage = Usd.Stage.Open(str(REPOSITORY / "stages" / name / f"{name}.usda"))
        frames = np.linspace(1, 48, 8 if quick else 24).round()
        times = []
        with fexel.Renderer() as renderer:
            for frame in frames:
                start = time.perf_counter()
                renderer.render(stage, camera="/World/Cameras/Zoom", width=_WIDTH, time=float(frame))
                times.append(time.perf_counter() - start)
        note = f"first frame {times[0]:.2f} s, with all that is loaded and compiled for it"
        yield _row("frame of a zoom", f"{name}, {_WIDTH} pixels wide, one process", times[1:], "s", None, note=note)


def command_rows(folder: Path, quick: bool) -> Iterator[Row]:
    """`fexel zipmap` on the bundled photos, start of the process included."""
    photos = sorted(str(path) for path in PHOTOS.glob("*.jpg"))
    times = []
    for turn in range(1 if quick else 3):
        target = folder / f"command_{turn}" / "shore.usda"
        target.parent.mkdir()
        start = time.perf_counter()
        command = [sys.executable, "-c", _COMMAND, "zipmap", *photos, "-o", str(target)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"fexel zipmap: {(done.stderr.strip() or 'failed').splitlines()[-1]}")
        times.append(time.perf_counter() - start)
    yield _row("fexel zipmap, whole command", "3 bundled photos of 1.1 MP", times, "s", None)


def _row(measure: str, setting: str, values: list[float], unit: str, target: float | None, note: str = "") -> Row:
    low, high = np.percentile(values, [25, 75])
    return Row(
        measure,
        setting,
        statistics.median(values),
        unit,
        target=target,
        comparison=None if target is None else "<=",
        spread=float(high - low) / 2,
        samples=len(values),
        note=note,
    )
