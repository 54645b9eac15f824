"""How long the phases of a run take, as its report says and its progress bar shows."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from fexel_tools.compile_time import compile_time
from fexel_tools.progress import Progress, silent

__all__ = ["Phases"]

_COMPILE, _MEASURE = "compile", "measure"


@dataclass
class Phases:
    """Seconds on the clock by phase, without those in which kernels were compiled: these are the phase `compile`.

    Attributes
    ----------
    title : str
        What the progress bar is called.
    steps : tuple of str
        All phases, in order; several may be of one name.
    progress : callable(step, done, total)
    seconds : dict of str to float
    """

    title: str
    steps: tuple[str, ...]
    progress: Progress = silent
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def authoring(self) -> float:
        """Seconds of all phases but the compilation and what it takes to measure."""
        return sum(seconds for name, seconds in self.seconds.items() if name not in (_COMPILE, _MEASURE))

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Time what is done inside."""
        start = time.perf_counter()
        with compile_time(self.progress) as compiling:
            yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start - compiling.seconds
        if compiling.seconds:
            self.seconds[_COMPILE] = self.seconds.get(_COMPILE, 0.0) + compiling.seconds
        self.progress(self.title, self.steps.index(name) + 1, len(self.steps))
