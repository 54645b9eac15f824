"""The `fexel` command line: one module per command; heavy imports happen inside the command that needs them."""

from __future__ import annotations

import importlib
import sys

import typer

__all__ = ["app", "main"]

app = typer.Typer(name="fexel", no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)

# Each module has `register(app)`; it may import only typer and the standard library at module level.
_COMMANDS = ("render", "zipmap", "info", "validate", "unwrap", "plugin_path")

for _name in _COMMANDS:
    try:
        _module = importlib.import_module(f"{__name__}.{_name}")
    except ModuleNotFoundError as error:  # TODO(foundation): remove once all commands exist
        if error.name != f"{__name__}.{_name}":
            raise
        continue
    _module.register(app)


def main() -> None:
    """Run the command line; an expected failure is one line on stderr and exit status 1."""
    from fexel.errors import FexelError

    try:
        app()
    except FexelError as error:
        sys.stderr.write(f"fexel: {error}\n")
        raise SystemExit(1) from None
