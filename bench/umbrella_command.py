"""``fexel umbrella`` as a user runs it, in a process of its own on two cores, measured; and scans to run it on."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from bench.fall_leaves import COUNT, GRID
from bench.harness import shared_data

__all__ = ["CORES", "Run", "author", "passiflora_scans"]

CORES = 2
_SCANS = 9
_COMMAND = "from fexel_tools.cli import main; main()"


@dataclass(frozen=True)
class Run:
    """One run of the command: the stage that it made, seconds on the clock and of CPU, imports included."""

    stage: Path
    wall_s: float
    cpu_s: float


def author(files: list[Path], folder: Path, *options: str) -> Run:
    """``fexel umbrella`` on two cores, in the size of the paper's fall leaves.

    Raises
    ------
    RuntimeError
        The command failed; its last line.
    """
    folder.mkdir(parents=True, exist_ok=True)
    stage = folder / "ground.usda"
    command = [sys.executable, "-c", _COMMAND, "umbrella", *map(str, files), "-o", str(stage)]
    command += ["--grid", f"{GRID[0]}x{GRID[1]}", "--count", str(COUNT), "--seed", "7", *options]
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=_on_two_cores)
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError((done.stderr.strip() or "fexel umbrella failed").splitlines()[-1])
    return Run(stage, wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def passiflora_scans() -> list[Path]:
    """Nine scans of passion flower leaves, of many species; [] without the collection."""
    folder = shared_data()
    files = sorted((folder / "umbrella" / "leaves").glob("passiflora_leaf_*.png")) if folder else []
    return files[:: max(1, len(files) // _SCANS)][:_SCANS]


def _on_two_cores() -> None:
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:CORES])
