"""The demonstration: `make demo` and ``python -m fexel_tools.demo``, on what is bundled with the checkout.

First photos to a zipmap and a zoom into it (`demo_zipmap`), then a drawing and a photo to pinchmaps, beside plain
textures of as many bytes (`demo_pinchmap`).
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Sequence
from pathlib import Path

from fexel.errors import FexelError
from fexel_tools import demo_pinchmap, demo_zipmap

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demonstration; a line per part on stdout says where the results are."""
    parser = argparse.ArgumentParser(
        prog="python -m fexel_tools.demo",
        description="Photos to a zipmap to a zoom; a drawing and a photo to pinchmaps.",
    )
    parser.add_argument("--output", type=Path, default=Path("out/demo"), help="folder (default: out/demo)")
    parser.add_argument("--photos", type=Path, nargs="+", metavar="PHOTO", help="default: the bundled ones")
    frames, width = demo_zipmap.FRAME_COUNT, demo_zipmap.WIDTH
    parser.add_argument("--frames", type=int, default=frames, help=f"pictures of the zoom (default: {frames})")
    parser.add_argument("--width", type=int, default=width, help=f"of a picture, pixels (default: {width})")
    options = parser.parse_args(arguments)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _one_line  # restored on leaving
            _zipmap(options)
            _pinchmap(options)
    except FexelError as error:
        sys.stderr.write(f"fexel: {error}\n")
        return 1
    return 0


def _zipmap(options: argparse.Namespace) -> None:
    start = time.perf_counter()
    photos = options.photos or demo_zipmap.bundled_photos()
    result = demo_zipmap.make_zipmap_demo(photos, options.output, options.frames, options.width)
    _report("zipmap", f"stage {result.stage}, contact sheet {result.sheet}", start)


def _pinchmap(options: argparse.Namespace) -> None:
    start = time.perf_counter()
    result = demo_pinchmap.make_pinchmap_demo(demo_pinchmap.bundled_sources(), options.output, options.width)
    stages = ", ".join(str(stage) for stage in result.stages)
    _report("pinchmaps", f"stages {stages}, beside plain textures of as many bytes in {result.sheet}", start)


def _report(part: str, results: str, start: float) -> None:
    sys.stdout.write(f"{part}: {results} ({time.perf_counter() - start:.0f} s)\n")
    sys.stdout.flush()


def _one_line(message: Warning | str, *_place: object, **_options: object) -> None:
    sys.stderr.write(f"fexel: warning: {message}\n")


if __name__ == "__main__":
    sys.exit(main())
