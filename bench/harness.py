"""Rows, curves and timing for the benchmark modules of this package, and the runner that collects them.

A module of `bench` takes part when it defines ``NAME : str`` and ``rows(quick) -> iterable of Row``, and optionally
``curves(quick) -> iterable of Curve`` (README.md shows one). The runner imports every such module, survives the
failure of any, and returns a plain dictionary that `bench.report` writes as JSON and Markdown.
"""

from __future__ import annotations

import importlib
import operator
import os
import pkgutil
import platform
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

__all__ = [
    "Curve",
    "ModuleResult",
    "Row",
    "Timing",
    "discover",
    "machine",
    "progress",
    "run_module",
    "scratch",
    "shared_data",
    "time_alternately",
]

REPOSITORY = Path(__file__).resolve().parent.parent
_COMPARISONS = {
    "<=": operator.le,
    "<": operator.lt,
    ">=": operator.ge,
    ">": operator.gt,
    "==": operator.eq,
}


@dataclass(frozen=True)
class Row:
    """One figure.

    Attributes
    ----------
    measure, setting : str
        What was measured, and on what.
    value : float
        The figure, in `unit`; NaN when it could not be measured (never counts as met).
    unit : str
    target : float or None
        What was asked for; None for a figure that is only informative.
    comparison : str or None
        ``<=``, ``<``, ``>=``, ``>`` or ``==``: the relation of value to target that counts as met.
    reference : str
        The same measure elsewhere: the paper, or what a user would otherwise pick.
    spread : float or None
        Half the interquartile range of the repeats, in `unit`.
    samples : int
        Repeats, pairs or pixels behind the figure; 0 when it does not apply.
    note : str
        What a reader must know to judge the figure.
    """

    measure: str
    setting: str
    value: float
    unit: str
    target: float | None = None
    comparison: str | None = None
    reference: str = ""
    spread: float | None = None
    samples: int = 0
    note: str = ""

    def __post_init__(self) -> None:
        if (self.target is None) != (self.comparison is None):
            raise ValueError(f"{self.measure}: target and comparison go together")
        if self.comparison is not None and self.comparison not in _COMPARISONS:
            raise ValueError(f"{self.measure}: comparison {self.comparison!r}, expected {' '.join(_COMPARISONS)}")

    @property
    def met(self) -> bool | None:
        """Whether the value holds the target; None for a row without one."""
        if self.comparison is None:
            return None
        return bool(np.isfinite(self.value) and _COMPARISONS[self.comparison](self.value, self.target))


@dataclass(frozen=True)
class Curve:
    """Points of one way of doing something, for the plot of speed against error named `plot`.

    Curves of the same `plot` share axes; their labels are taken from the first. `ours` curves are drawn heavier.
    """

    plot: str
    label: str
    x: list[float]
    y: list[float]
    x_label: str = "seconds"
    y_label: str = "error"
    x_log: bool = False
    y_log: bool = False
    ours: bool = False
    annotations: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Timing:
    """Wall-clock times of one contender, seconds."""

    times_s: np.ndarray

    @property
    def median_s(self) -> float:
        """Median, seconds."""
        return float(np.median(self.times_s))

    @property
    def spread_s(self) -> float:
        """Half the interquartile range."""
        low, high = np.percentile(self.times_s, [25, 75])
        return float(high - low) / 2


@dataclass(frozen=True)
class ModuleResult:
    """What one module delivered; `error` is '' or the last line of the exception."""

    name: str
    rows: list[Row]
    curves: list[Curve]
    seconds: float
    error: str = ""

    def as_dict(self) -> dict[str, Any]:
        """As plain data, each row with its verdict ``met``."""
        rows = [asdict(row) | {"met": row.met} for row in self.rows]
        return {
            "name": self.name,
            "seconds": round(self.seconds, 2),
            "error": self.error,
            "rows": rows,
            "curves": [asdict(curve) for curve in self.curves],
        }


def time_alternately(
    contenders: Mapping[str, Callable[[], object]], repeats: int = 7, warmup: int = 1
) -> dict[str, Timing]:
    """Time several callables in turns, so that a slow phase of the machine hits all of them alike.

    Each turn runs every contender once, in an order that reverses from turn to turn. Compare medians of the result,
    or the median of the paired ratios ``a.times_s / b.times_s``.

    Parameters
    ----------
    contenders : mapping of name to callable without arguments
    repeats : int
        Turns that count.
    warmup : int
        Turns before them that do not: compilation, caches, page faults.

    Returns
    -------
    dict of name to `Timing`
    """
    names = list(contenders)
    times: dict[str, list[float]] = {name: [] for name in names}
    for turn in range(-warmup, repeats):
        for name in names if turn % 2 == 0 else names[::-1]:
            start = time.perf_counter()
            contenders[name]()
            elapsed = time.perf_counter() - start
            if turn >= 0:
                times[name].append(elapsed)
    return {name: Timing(np.array(values)) for name, values in times.items()}


def shared_data() -> Path | None:
    """Photos that are not part of the repository: FEXEL_DATA, else a folder beside the checkout; or None."""
    folder = Path(os.environ.get("FEXEL_DATA") or REPOSITORY.parent / "shared" / "data")
    return folder if folder.is_dir() else None


def scratch() -> Path:
    """A folder for large intermediate files, emptied by the operating system."""
    return Path(tempfile.mkdtemp(prefix="fexel-bench-"))


def progress(items: Iterable[Any], description: str) -> Iterable[Any]:
    """Iterate with a bar on a terminal; silently elsewhere."""
    if not sys.stderr.isatty():
        return items
    from rich.console import Console
    from rich.progress import track

    return track(items, description=description, console=Console(stderr=True))


def discover(only: Iterable[str] = ()) -> tuple[dict[str, ModuleType], dict[str, str]]:
    """Import the benchmark modules.

    Parameters
    ----------
    only : iterable of str
        Keep modules whose file name or ``NAME`` contains one of these words; empty keeps all.

    Returns
    -------
    modules : dict of name to module
    failed : dict of name to message
        Modules that could not be imported.
    """
    words = [word.lower() for word in only]
    modules: dict[str, ModuleType] = {}
    failed: dict[str, str] = {}
    for info in pkgutil.iter_modules([str(Path(__file__).parent)]):
        try:
            module = importlib.import_module(f"bench.{info.name}")
        except Exception as error:  # one broken module must not stop the others
            failed[info.name] = _last_line(error)
            continue
        if not hasattr(module, "rows"):
            continue
        name = getattr(module, "NAME", info.name)
        modules[name] = module
    if words:
        modules = {
            name: module
            for name, module in modules.items()
            if any(word in name.lower() or word in module.__name__.lower() for word in words)
        }
        failed = {name: text for name, text in failed.items() if any(word in name.lower() for word in words)}
    return modules, failed


def run_module(name: str, module: ModuleType, quick: bool) -> ModuleResult:
    """Run one module; an exception ends it, keeps the rows yielded before, and becomes `ModuleResult.error`."""
    rows: list[Row] = []
    curves: list[Curve] = []
    error = ""
    start = time.perf_counter()
    try:
        _collect(module.rows(quick), rows)
        _collect(module.curves(quick) if hasattr(module, "curves") else (), curves)
    except Exception as exception:
        error = _last_line(exception)
        traceback.print_exc()
    return ModuleResult(name, rows, curves, time.perf_counter() - start, error)


def _collect(source: Iterable[Any], into: list[Any]) -> None:
    for item in source:
        into.append(item)  # one by one: what came before an exception must stay


def _last_line(error: BaseException) -> str:
    return traceback.format_exception_only(error)[-1].strip()


def machine() -> dict[str, Any]:
    """Date, commit, processor, renderer and library versions: what a figure depends on."""
    packages = (
        "numpy",
        "usd-core",
        "moderngl",
        "OpenImageIO",
        "opencv-python-headless",
        "scipy",
        "numba",
    )
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "commit": _commit(),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "opengl": _opengl(),
        "packages": {name: _version(name) for name in packages},
    }


def _commit() -> str:
    def git(*words: str) -> str:
        done = subprocess.run(["git", *words], cwd=REPOSITORY, capture_output=True, text=True, check=False)
        return done.stdout.strip() if done.returncode == 0 else ""

    commit = git("rev-parse", "--short", "HEAD")
    changed = git("status", "--porcelain", "--untracked-files=no")
    return f"{commit} with local changes" if changed else commit


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        for line in cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor()


def _opengl() -> str:
    """Name of the OpenGL renderer; asked in a process of its own, so that no context stays behind here."""
    code = "import moderngl; print(moderngl.create_standalone_context(backend='egl').info['GL_RENDERER'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else "none"


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "missing"
