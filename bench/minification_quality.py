"""Error of all minification filters over the fan of views, on four textures, against both truths.

Textures of 512 x 512 texels (`fexel_tools.filter_textures`), repeated; elevations 90 to 0.1 degrees, azimuths 0 to 75,
a footprint 1.25 texels across. The error of a view is the PSNR of sRGB-encoded values over places spread at random
over the texture; a figure is the mean of decibels over textures and azimuths. Filters are the float64 twins of the
shaders, whose equality is a test. Truths are exact for a box and converged for a Gaussian (`filter_truth`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bench.color_error import ciede2000
from bench.harness import Curve, Row, progress
from fexel.filters.twin import FilterTwin
from fexel.images.srgb import srgb_to_linear
from fexel_tools.filter_measure import memory_ratio
from fexel_tools.filter_textures import TEXTURES
from fexel_tools.filter_truth import TRUTHS, FilterTruth
from fexel_tools.filter_views import AZIMUTHS, ELEVATIONS, FilterView, fan
from fexel_tools.pinchmap_measure import psnr_db

__all__ = ["WAYS", "Found", "Way", "measure_fan"]

NAME = "minification quality"
_SIZE = 512
_WRAP = ("repeat", "repeat")


@dataclass(frozen=True)
class Way:
    """A filter with its options."""

    label: str
    token: str
    options: dict[str, Any] = field(default_factory=dict)
    ours: bool = False


WAYS = (
    Way("trilinear", "mipmap"),
    Way("2 probes", "anisotropic", {"probes": 2}),
    Way("16 probes", "anisotropic", {"probes": 16}),
    Way("ripmap", "ripmap"),
    Way("fipmap", "fipmap", {"probes": 4}, ours=True),
    Way("fipmap, 16 accesses", "fipmap", {"probes": 16}, ours=True),
    Way("fipmap, Gaussian", "fipmap", {"gauss": True}, ours=True),
    Way("EWA", "ewa"),
    Way("auto", "auto", ours=True),
)

# Of notes.md, the same measure on four textures of its own: PSNR at 30, 10, 5, 2 and 1 degrees.
_KNOWN = {
    "trilinear": (27.1, 22.7, 23.4, 25.6, 27.9),
    "2 probes": (40.1, 27.8, 26.6, 27.6, 29.4),
    "16 probes": (40.1, 46.7, 51.7, 43.7, 39.8),
    "ripmap": (31.4, 27.5, 26.5, 28.6, 31.0),
}
_KNOWN_ELEVATIONS = (30.0, 10.0, 5.0, 2.0, 1.0)
_ASKED = {10.0: 40.0, 5.0: 41.0, 2.0: 39.0, 1.0: 39.0}
_PAPERS_WAY = {10.0: "39.6", 5.0: "40.5", 2.0: "38.0", 1.0: "38.0"}  # box taps of notes.md
_AGAINST_PROBES = {10.0: -3.0, 5.0: -3.0, 2.0: 6.0, 1.0: 8.0}
_FEW, _MANY = 18.0, 75.0  # fetches
_GAUSS_FETCHES = 20.0
_MOST_MEMORY = 12.0


@dataclass(frozen=True)
class Found:
    """A way in a view of a texture."""

    texture: str
    view: FilterView
    way: str
    truth: str
    psnr_db: float
    ciede2000: float
    fetches: float


_found: list[Found] = []


def measure_fan(
    textures: dict[str, np.ndarray], views: tuple[FilterView, ...], ways: tuple[Way, ...], places: int
) -> list[Found]:
    """Every way in every view of (H, W, 3) uint8 textures, at so many places; at fewer where the Gaussian is large."""
    found = []
    for name, texels in textures.items():
        image = np.ones((*texels.shape[:2], 4), np.float32)
        image[..., :3] = srgb_to_linear(texels / np.float32(255))
        truth, twin = FilterTruth.of(image, _WRAP), FilterTwin(image, _WRAP)
        rng = np.random.default_rng(20020705)
        for view in progress(views, f"{name}, {len(views)} views"):
            count = places if view.elevation >= 1 else max(places // 4, 16)
            xy = rng.uniform(0, texels.shape[1], (count, 2))
            wanted = {kind: truth.mean(kind, xy, view.jacobian) for kind in TRUTHS}
            jacobian = np.broadcast_to(view.jacobian, (count, 2, 2))
            for way in ways:
                values, fetches = twin.sample(way.token, xy, jacobian, **way.options)
                for kind, mean in wanted.items():
                    error = psnr_db(values[None], mean[None]) or 0.0
                    difference = ciede2000(values, mean)
                    found.append(Found(name, view, way.label, kind, error, difference, float(np.mean(fetches))))
    return found


def rows(quick: bool) -> Iterator[Row]:
    """The table, and what was asked for."""
    elevations = (90.0, 30.0, 10.0, 5.0, 2.0, 1.0, 0.1) if quick else ELEVATIONS
    textures = {name: draw(_SIZE) for name, draw in TEXTURES.items()}
    _found[:] = measure_fan(textures, fan(elevations, AZIMUTHS), WAYS, 48 if quick else 200)
    yield from _known_rows()
    yield from _asked_rows()
    yield from _table_rows(elevations)


def curves(quick: bool) -> Iterator[Curve]:  # noqa: ARG001
    """Error against cost, error against memory, error over elevation."""
    for kind in TRUTHS:
        for way in WAYS:
            own = [row for row in _found if (row.way, row.truth) == (way.label, kind) and 1 <= row.view.elevation <= 10]
            error, fetches = _mean(own), float(np.mean([row.fetches for row in own]))
            axes = {"y_label": f"PSNR, dB, {kind} truth, 10 to 1 degrees", "x_log": True, "ours": way.ours}
            yield Curve(f"minification_cost_{kind}", way.label, [fetches], [error], "texels fetched per pixel", **axes)
            memory = memory_ratio(way.token, (_SIZE, _SIZE), _WRAP)
            yield Curve(f"minification_memory_{kind}", way.label, [memory], [error], "memory, x image", **axes)
        for way in WAYS:
            seen = sorted({row.view.elevation for row in _found})
            y_label, x_label = f"PSNR, dB, {kind} truth", "elevation, degrees"
            y = [_decibels(way.label, elevation, kind) for elevation in seen]
            yield Curve(f"minification_fan_{kind}", way.label, seen, y, x_label, y_label, x_log=True, ours=way.ours)


def _mean(found: list[Found]) -> float:
    return float(np.mean([row.psnr_db for row in found])) if found else float("nan")


def _select(way: str, elevation: float, kind: str) -> list[Found]:
    return [row for row in _found if (row.way, row.view.elevation, row.truth) == (way, elevation, kind)]


def _decibels(way: str, elevation: float, kind: str = "box") -> float:
    return _mean(_select(way, elevation, kind))


def _fetches(way: str, elevation: float) -> float:
    return float(np.mean([row.fetches for row in _select(way, elevation, "box")]))


def _known_rows() -> Iterator[Row]:
    """How far these textures are from those of the notes: what is compared must first be comparable."""
    for way, known in _KNOWN.items():
        for elevation, decibels in zip(_KNOWN_ELEVATIONS, known, strict=True):
            value = _decibels(way, elevation)
            yield Row(
                f"{way}: PSNR, box truth",
                f"{elevation:g} degrees",
                value,
                "dB",
                reference=f"notes, textures of their own: {decibels:g}",
                samples=len(_select(way, elevation, "box")),
            )


def _asked_rows() -> Iterator[Row]:
    memory = memory_ratio("fipmap", (_SIZE, _SIZE), _WRAP)
    yield Row("fipmap: memory", f"{_SIZE} x {_SIZE}, repeated", memory, "x image", _MOST_MEMORY, "<=")
    most = max(_fetches("fipmap", elevation) for elevation in _ASKED)
    yield Row("fipmap: fetches", "10 to 1 degrees", most, "texels", _FEW, "<=")
    for elevation, asked in _ASKED.items():
        setting, reference = f"{elevation:g} degrees", f"box taps of notes.md {_PAPERS_WAY[elevation]}"
        value = _decibels("fipmap", elevation)
        yield Row("fipmap: PSNR, box truth", setting, value, "dB", asked, ">=", reference)
    for elevation, asked in _AGAINST_PROBES.items():
        value = _decibels("fipmap, 16 accesses", elevation) - _decibels("16 probes", elevation)
        fetched = f"{_fetches('fipmap, 16 accesses', elevation):.0f} fetches, asked for at most {_MANY:g}"
        setting = f"{elevation:g} degrees"
        yield Row("best fipmap less 16 probes: PSNR, box truth", setting, value, "dB", asked, ">=", note=fetched)
    for elevation in (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1):
        if not _select("EWA", elevation, "gauss"):
            continue
        value = _decibels("fipmap, Gaussian", elevation, "gauss") - _decibels("EWA", elevation, "gauss")
        fetched = f"{_fetches('fipmap, Gaussian', elevation):.0f} fetches, asked for at most {_GAUSS_FETCHES:g}"
        setting = f"{elevation:g} degrees"
        yield Row("Gaussian fipmap less EWA: PSNR, Gaussian truth", setting, value, "dB", -1.0, ">=", note=fetched)


def _table_rows(elevations: tuple[float, ...]) -> Iterator[Row]:
    for kind in TRUTHS:
        for way in WAYS:
            for elevation in elevations:
                own = _select(way.label, elevation, kind)
                difference = float(np.mean([row.ciede2000 for row in own]))
                note = f"CIEDE2000 {difference:.2f}; {_fetches(way.label, elevation):.0f} fetches"
                value, setting = _mean(own), f"{elevation:g} degrees"
                yield Row(f"{way.label}: PSNR, {kind} truth", setting, value, "dB", samples=len(own), note=note)
