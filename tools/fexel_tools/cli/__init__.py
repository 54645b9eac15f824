"""The `fexel` command line: one module per command; heavy imports happen inside the command that needs them.

Each module of `_COMMANDS` has ``register(app)`` and imports only typer and the standard library at module level, so
that ``fexel --help`` answers at once.
"""

from __future__ import annotations

import importlib
import signal
import sys
import warnings
from typing import Any, NoReturn

import typer

__all__ = ["app", "main"]

_COMMANDS = (
    "render",
    "zipmap",
    "pinchmap",
    "umbrella",
    "minify",
    "filters",
    "bake",
    "info",
    "validate",
    "unwrap",
    "plugin_path",
)
# 128 + number of the signal, as a shell reports it.
_INTERRUPTED = 130  # SIGINT
_TERMINATED = {143: "SIGTERM", 129: "SIGHUP"}

app = typer.Typer(
    name="fexel",
    help="Zipmap, pinchmap, umbrella and fipmap textures as ordinary USD prims.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

for _name in _COMMANDS:
    importlib.import_module(f"{__name__}.{_name}").register(app)


def main() -> None:
    """Run the command line.

    An expected failure is one line on stderr and exit status 1; so is a file that cannot be read or written. An
    interruption is one line and status 130, a termination one and 143, and nothing half-written stays. A reader that
    goes away (``fexel info ... | head``) is not reported.
    """
    from fexel.errors import FexelError

    _show_warnings_in_one_line()
    _unwind_on_termination()
    try:
        app()
    except FexelError as error:
        _end(str(error), 1)
    except OSError as error:
        _end(f"{error.filename}: {error.strerror}" if error.filename else str(error), 1)
    except SystemExit as status:
        if status.code == _INTERRUPTED:  # typer turns KeyboardInterrupt into this
            _end("interrupted", _INTERRUPTED)
        if isinstance(status.code, int) and status.code in _TERMINATED:
            _end("terminated", status.code)
        raise


def _end(message: str, status: int) -> NoReturn:
    sys.stderr.write(f"fexel: {message}\n")
    raise SystemExit(status) from None


def _unwind_on_termination() -> None:
    """Leave by an exception where a signal would end the process at once, so that hidden folders are removed."""

    def leave(number: int, _frame: Any) -> None:
        signal.signal(number, signal.SIG_IGN)  # a second one must not cut the removal short
        raise SystemExit(128 + number)

    for name in _TERMINATED.values():
        number = getattr(signal, name, None)  # some systems have fewer
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, leave)


def _show_warnings_in_one_line() -> None:
    from fexel.errors import FexelWarning

    formatwarning = warnings.formatwarning

    def one_line(message: Any, category: type[Warning], *place: Any, **options: Any) -> str:
        if issubclass(category, FexelWarning):
            return f"fexel: warning: {message}\n"
        return formatwarning(message, category, *place, **options)

    warnings.formatwarning = one_line
