"""Chains of prefiltered images: how long they take to make and to find again, in what memory, and what they keep."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from bench.harness import REPOSITORY, Row, progress, shared_data
from fexel.filters.chain_layout import ChainLayout
from fexel.filters.sheared import moved_lines
from fexel.filters.shears import DIRECTIONS

NAME = "minification database"
_SIX = (1, 2, 4, 5, 6, 7)  # tangents +-1/2 of either axis, +-1
_REPEATS = 3


def rows(quick: bool) -> Iterator[Row]:
    """Time, memory and size by texture, then the variance of white noise."""
    size = 1024 if quick else 4096
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        kinds = [("8-bit JPEG", "picture.jpg", "uint8"), ("8-bit PNG", "picture.png", "uint8")]
        kinds += [] if quick else [("16-bit PNG", "deep.png", "uint16")]
        for label, file, dtype in progress(kinds, "databases"):
            yield from _six_shears(f"{size}x{size}, {label}", _picture(folder / file, size, dtype), quick)
        yield from _all_directions(f"{size}x{size}, 8-bit JPEG", folder / "picture.jpg", size)
    yield from _variance(quick)


def _six_shears(setting: str, file: Path, quick: bool) -> Iterator[Row]:
    asked = {} if quick or "16-bit" in setting else {"target": 5.0, "comparison": "<="}
    found_asked = {} if quick or "16-bit" in setting else {"target": 0.3, "comparison": "<="}
    first, found = [], []
    for _ in range(_REPEATS):
        with tempfile.TemporaryDirectory() as cache:
            first.append(_run(file, _SIX, cache, "--read"))
            found.append(_run(file, _SIX, cache))
    processor = np.median([run["processor_s"] for run in first])
    read = np.median([run["read_s"] for run in first])
    note = f"{read:.2f} s of them reading the picture and its mip levels; {processor:.1f} s of processor time"
    yield _timing("six shears, the first time", setting, [run["made_s"] for run in first], note, asked)
    note = "hashing the file, checking all cells, a window of 256x256 of each level"
    yield _timing("six shears, from the cache", setting, [run["made_s"] for run in found], note, found_asked)
    yield Row(
        measure="six shears, peak memory",
        setting=setting,
        value=float(np.median([run["peak_mb"] for run in first])),
        unit="MB",
        note=f"of which {first[0]['texel_bytes'] / 1e6:.0f} MB are the mapped file",
    )


def _timing(measure: str, setting: str, seconds: list[float], note: str, asked: dict) -> Row:
    low, high = np.percentile(seconds, [25, 75])
    spread = float(high - low) / 2
    return Row(
        measure, setting, float(np.median(seconds)), "s", spread=spread, samples=len(seconds), note=note, **asked
    )


def _all_directions(setting: str, file: Path, size: int) -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as cache:
        run = _run(file, tuple(range(len(DIRECTIONS))), cache, "--read")
        on_disk = sum(path.stat().st_size for path in Path(cache).glob("*.chains"))
    note = f"{run['made_s']:.1f} s to make, all {len(DIRECTIONS)} directions; 4/3 with the mip levels make it 12"
    yield Row("all directions, memory over the texture's", setting, run["texel_bytes"] / (4 * size**2), "x", note=note)
    yield Row("all directions, on disk", setting, on_disk / 1e6, "MB")


def _variance(quick: bool) -> Iterator[Row]:
    size = 256 if quick else 1024
    noise = np.random.default_rng(2002).random((size, size, 4), np.float32)  # colours, none brighter than 1
    for shear in (0.25, 0.5, 0.75):
        number = next(n for n, d in enumerate(DIRECTIONS) if d.long_axis == 1 and d.shear == shear)
        lines = moved_lines(noise, 0, ChainLayout.of(number, (size, size), ("repeat", "repeat")))
        whole = lines.var() / noise.var()
        worst = min(lines[phase::4].var() / noise[phase::4].var() for phase in range(4))
        yield Row(
            measure="variance of white noise that a shear keeps",
            setting=f"tangent {shear:g}, lines that lose most",
            value=100 * float(worst),
            unit="%",
            target=95.0,
            comparison=">=",
            reference=f"linear interpolation: {100 * _linear(shear):.0f} %",
            note=f"all lines together {100 * float(whole):.1f} %",
        )


def _linear(shear: float) -> float:
    """What of it linear interpolation keeps where it loses most."""
    parts = (shear * np.arange(4)) % 1
    return float(min(part**2 + (1 - part) ** 2 for part in parts))


def _picture(path: Path, size: int, dtype: str) -> Path:
    """A photo where there are any, else waves and noise, as a texture of that size."""
    photos = sorted((shared_data() or Path("missing")).glob("**/*.jpg"))
    if photos:
        photo = oiio.ImageBuf(str(photos[0]))
        picture = oiio.ImageBufAlgo.resize(photo, roi=oiio.ROI(0, size, 0, size, 0, 1, 0, 3))
    else:
        y, x = np.mgrid[0:size, 0:size] / size
        waves = 0.5 + 0.2 * np.sin(40 * x * (1 + y)) + 0.2 * np.cos(90 * y)
        noise = 0.05 * np.random.default_rng(1).standard_normal((size, size))
        channels = [waves + noise, waves**2 + noise, np.sqrt(waves)]
        picture = oiio.ImageBuf(np.ascontiguousarray(np.stack(channels, -1).clip(0, 1), np.float32))
    picture.set_write_format(dtype)
    if not picture.write(str(path)):
        raise OSError(f"{path}: {picture.geterror()}")
    return path


def _run(file: Path, directions: tuple[int, ...], cache: str, *options: str) -> dict:
    numbers = ",".join(map(str, directions))
    command = [sys.executable, "-m", "bench.chain_database", str(file), numbers, *options]
    environment = {**os.environ, "FEXEL_CACHE": cache}
    done = subprocess.run(command, cwd=REPOSITORY, env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)
