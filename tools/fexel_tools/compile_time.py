"""How long Numba compiles: once per installation, since what it compiles is kept on disk.

The first run must not count that as work on its files.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from numba.core import event

from fexel_tools.progress import Progress, silent

__all__ = ["CompilationTime", "compile_time"]

_STEP = "compiling, once per installation"


class CompilationTime(event.Listener):
    """Adds up the time of compilations; those within others count once. What is loaded from disk counts nothing."""

    def __init__(self, progress: Progress = silent) -> None:
        self.seconds = 0.0
        self._progress = progress
        self._depth = 0
        self._start = 0.0

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002
        """A compilation begins."""
        if self._depth == 0:
            self._start = time.perf_counter()
            self._progress(_STEP, 0, 1)
        self._depth += 1

    def on_end(self, event: event.Event) -> None:  # noqa: ARG002
        """A compilation has ended."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._start
            self._progress(_STEP, 1, 1)


@contextmanager
def compile_time(progress: Progress = silent) -> Iterator[CompilationTime]:
    """Watch what is compiled inside; a bar is drawn if it is anything.

    Examples
    --------
    >>> with compile_time() as compiling:
    ...     pass
    >>> compiling.seconds
    0.0
    """
    listener = CompilationTime(progress)
    with event.install_listener("numba:compile", listener):
        yield listener
