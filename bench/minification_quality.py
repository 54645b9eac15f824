"""Error of all minification filters over the fan of views, on four textures, against both truths.

Textures of 512 x 512 texels (`fexel_tools.filter_textures`), repeated; elevations 90 to 0.1 degrees, azimuths 0 to 75,
a footprint 1.25 texels across. The error of a view is the PSNR of sRGB-encoded values over places spread at random
over the texture; a figure is the mean of decibels over textures and azimuths. Truths are exact for a box and converged
for a Gaussian (`filter_truth`). Textures are printed with paper 226 and ink 40 of 255; what was asked for is measured
with 255 and 0 as well (bricks are no print and stay as they are).

Filters are the float64 twins of the shaders. Shaders are tested against them as the renderer has them: `ripmap`,
`fipmap` of 4 accesses, `ewa` and `auto`; `fipmap, Gaussian` as ``--filterKernel gauss`` and `fipmap, 16 accesses` as
``--fipmapAccesses 16`` of ``fexel render`` draw them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bench.color_error import ciede2000
from bench.harness import Curve, Row, progress
from fexel.filters.twin import FilterTwin
from fexel.images.srgb import srgb_to_linear
from fexel_tools.filter_measure import GAUSS_FIPMAP, memory_ratio
from fexel_tools.filter_textures import FULL_CONTRAST, TEXTURES
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
    Way("ripmap (box taps)", "ripmap"),
    Way("fipmap", "fipmap", {"probes": 4}, ours=True),
    Way("fipmap, 16 accesses", "fipmap", {"probes": 16}, ours=True),
    Way("fipmap, Gaussian", "fipmap", {"gauss": True}, ours=True),
    Way("EWA", "ewa"),
    Way("auto", "auto", ours=True),
)

# Of an earlier measurement, the same on four textures of its own: PSNR at 30, 10, 5, 2 and 1 degrees; its ripmap is
# the plain one, a trilinear lookup of the cell.
_KNOWN = {
    "trilinear": (27.1, 22.7, 23.4, 25.6, 27.9),
    "2 probes": (40.1, 27.8, 26.6, 27.6, 29.4),
    "16 probes": (40.1, 46.7, 51.7, 43.7, 39.8),
    "ripmap (box taps)": (31.4, 27.5, 26.5, 28.6, 31.0),
}
_KNOWN_ELEVATIONS = (30.0, 10.0, 5.0, 2.0, 1.0)
_ASKED = {10.0: 40.0, 5.0: 41.0, 2.0: 39.0, 1.0: 39.0}
_EARLIER = {10.0: "39.6", 5.0: "40.5", 2.0: "38.0", 1.0: "38.0"}  # of that measurement
_AGAINST_PROBES = {10.0: -3.0, 5.0: -3.0, 2.0: 6.0, 1.0: 8.0}
_JUDGED = ("16 probes", "fipmap", "fipmap, 16 accesses")
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
    most_fetches: float


_found: list[Found] = []
_stark: list[Found] = []  # at full contrast


def measure_fan(
    textures: dict[str, np.ndarray],
    views: tuple[FilterView, ...],
    ways: tuple[Way, ...],
    places: int,
    truths: tuple[str, ...] = TRUTHS,
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
            wanted = {kind: truth.mean(kind, xy, view.jacobian) for kind in truths}
            jacobian = np.broadcast_to(view.jacobian, (count, 2, 2))
            for way in ways:
                values, fetches = twin.sample(way.token, xy, jacobian, **way.options)
                cost = float(np.mean(fetches)), float(np.max(fetches))
                for kind, mean in wanted.items():
                    error = psnr_db(values[None], mean[None]) or 0.0
                    difference = ciede2000(values, mean)
                    found.append(Found(name, view, way.label, kind, error, difference, *cost))
    return found


def rows(quick: bool) -> Iterator[Row]:
    """The table, and what was asked for."""
    elevations = (90.0, 30.0, 10.0, 5.0, 2.0, 1.0, 0.1) if quick else ELEVATIONS
    textures = {name: draw(_SIZE) for name, draw in TEXTURES.items()}
    _found[:] = measure_fan(textures, fan(elevations, AZIMUTHS), WAYS, 48 if quick else 200)
    judged = tuple(way for way in WAYS if way.label in _JUDGED)
    stark = {name: draw(_SIZE) for name, draw in FULL_CONTRAST.items()}
    _stark[:] = measure_fan(stark, fan(tuple(_ASKED), AZIMUTHS), judged, 48 if quick else 200, ("box",))
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
            token = GAUSS_FIPMAP if way.options.get("gauss") else way.token
            memory = memory_ratio(token, (_SIZE, _SIZE), _WRAP)
            yield Curve(f"minification_memory_{kind}", way.label, [memory], [error], "memory, x image", **axes)
        for way in WAYS:
            seen = sorted({row.view.elevation for row in _found})
            y_label, x_label = f"PSNR, dB, {kind} truth", "elevation, degrees"
            y = [_decibels(way.label, elevation, kind) for elevation in seen]
            yield Curve(f"minification_fan_{kind}", way.label, seen, y, x_label, y_label, x_log=True, ours=way.ours)


def _mean(found: list[Found]) -> float:
    return float(np.mean([row.psnr_db for row in found])) if found else float("nan")


def _select(way: str, elevation: float, kind: str, found: list[Found] | None = None) -> list[Found]:
    rows = _found if found is None else found
    return [row for row in rows if (row.way, row.view.elevation, row.truth) == (way, elevation, kind)]


def _decibels(way: str, elevation: float, kind: str = "box", found: list[Found] | None = None) -> float:
    return _mean(_select(way, elevation, kind, found))


def _fetches(way: str, elevation: float) -> float:
    return float(np.mean([row.fetches for row in _select(way, elevation, "box")]))


def _most_fetches(way: str, elevations: Iterable[float]) -> float:
    """Of any pixel of any texture and view at these elevations."""
    return max(row.most_fetches for elevation in elevations for row in _select(way, elevation, "box"))


def _known_rows() -> Iterator[Row]:
    """How far these textures are from those of the earlier measurement: what is compared must be comparable."""
    for way, known in _KNOWN.items():
        for elevation, decibels in zip(_KNOWN_ELEVATIONS, known, strict=True):
            value = _decibels(way, elevation)
            yield Row(
                f"{way}: PSNR, box truth",
                f"{elevation:g} degrees",
                value,
                "dB",
                reference=f"an earlier measurement, other textures: {decibels:g}",
                samples=len(_select(way, elevation, "box")),
            )


def _asked_rows() -> Iterator[Row]:
    memory = memory_ratio("fipmap", (_SIZE, _SIZE), _WRAP)
    yield Row("fipmap: memory", f"{_SIZE} x {_SIZE}, repeated", memory, "x image", _MOST_MEMORY, "<=")
    most = _most_fetches("fipmap", _ASKED)
    yield Row("fipmap: fetches of any pixel", "10 to 1 degrees", most, "texels", _FEW, "<=")
    for contrast, found in (("", _found), (", full contrast", _stark)):
        yield from _judged_rows(contrast, found)
    yield from _gauss_rows()


def _judged_rows(contrast: str, found: list[Found]) -> Iterator[Row]:
    for elevation, asked in _ASKED.items():
        setting = f"{elevation:g} degrees{contrast}"
        reference = "" if contrast else f"an earlier measurement, box taps: {_EARLIER[elevation]}"
        value = _decibels("fipmap", elevation, found=found)
        yield Row("fipmap: PSNR, box truth", setting, value, "dB", asked, ">=", reference)
    for elevation, asked in _AGAINST_PROBES.items():
        best = _decibels("fipmap, 16 accesses", elevation, found=found)
        value = best - _decibels("16 probes", elevation, found=found)
        fetched = f"{_most_fetches('fipmap, 16 accesses', [elevation]):.0f} fetches, asked for at most {_MANY:g}"
        setting = f"{elevation:g} degrees{contrast}"
        yield Row("best fipmap less 16 probes: PSNR, box truth", setting, value, "dB", asked, ">=", note=fetched)


def _gauss_rows() -> Iterator[Row]:
    memory = memory_ratio(GAUSS_FIPMAP, (_SIZE, _SIZE), _WRAP)
    yield Row("Gaussian fipmap: memory", f"{_SIZE} x {_SIZE}, repeated", memory, "x image", _MOST_MEMORY, "<=")
    for elevation in (10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1):
        if not _select("EWA", elevation, "gauss"):
            continue
        value = _decibels("fipmap, Gaussian", elevation, "gauss") - _decibels("EWA", elevation, "gauss")
        most = _most_fetches("fipmap, Gaussian", [elevation])
        fetched = f"{most:.0f} fetches, asked for at most {_GAUSS_FETCHES:g}"
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
