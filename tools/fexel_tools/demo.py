"""The demonstration: `make demo` and ``python -m fexel_tools.demo``, on what is bundled with the checkout.

A part per kind of texture, in the order of the registry, and one for minification: ``demo_<kind>``, where there is such
a module, has ``ABOUT``, what it shows in a clause, ``run(options) -> str``, which does it and says where the results
are, and, if it has options of its own, ``add_options(parser)``. A new kind touches nothing here.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import sys
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from fexel.errors import FexelError
from fexel.textures import kinds

__all__ = ["WIDTH", "main", "parts"]

WIDTH = 320


def parts() -> dict[str, ModuleType]:
    """The demonstration of each kind that has one, in the order of the kinds, and that of minification."""
    names = {kind: f"fexel_tools.demo_{kind}" for kind in (*kinds(), "fipmap")}
    return {kind: importlib.import_module(name) for kind, name in names.items() if importlib.util.find_spec(name)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demonstration; a line per part on stdout says where the results are."""
    shown = parts()
    about = "; ".join(part.ABOUT for part in shown.values())
    parser = argparse.ArgumentParser(prog="python -m fexel_tools.demo", description=f"{about[:1].upper()}{about[1:]}.")
    parser.add_argument("--output", type=Path, default=Path("out/demo"), help="folder (default: out/demo)")
    parser.add_argument("--width", type=int, default=WIDTH, help=f"of a picture, pixels (default: {WIDTH})")
    for part in shown.values():
        getattr(part, "add_options", _no_options)(parser)
    options = parser.parse_args(arguments)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _one_line  # restored on leaving
            for kind, part in shown.items():
                _show(kind, part, options)
    except FexelError as error:
        sys.stderr.write(f"fexel: {error}\n")
        return 1
    return 0


def _show(kind: str, part: ModuleType, options: argparse.Namespace) -> None:
    start = time.perf_counter()
    results = part.run(options)
    sys.stdout.write(f"{kind}: {results} ({time.perf_counter() - start:.0f} s)\n")
    sys.stdout.flush()


def _no_options(_parser: argparse.ArgumentParser) -> None:
    pass


def _one_line(message: Warning | str, *_place: object, **_options: object) -> None:
    sys.stderr.write(f"fexel: warning: {message}\n")


if __name__ == "__main__":
    sys.exit(main())
