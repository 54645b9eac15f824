"""Shape alone: error of the coverage against bytes, pinchmaps beside distance fields and a bilinear texture.

A shape without colours needs no signal, and d and k of a pinchmap follow from its mask, so that three counts of its
bytes are given, each with the map that fits into them:

* as bound: RGBA8_SNORM, 4 bytes per texel;
* as it could be stored: a byte of gamma and a bit of mask per texel; d and k are made again when it is loaded;
* as it could be bound where only the side is wanted: the level k - gamma, clipped to [-1, 1], in one 8-bit
  channel, 1 byte per texel. The side is the sign of its bilinear interpolation, a single filtered access.

All ways cover what is drawn and a rim, and are judged over the whole picture.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from bench.distance_field import (
    SAMPLES,
    Grid,
    ShapeTexture,
    bilinear_coverage,
    distance_field,
    multi_channel_fields,
)
from bench.harness import Curve, Row, progress
from bench.pinch_shapes import Shape, drawings, load_shape
from fexel_tools.pinchmap_fit import fit
from fexel_tools.pinchmap_measure import alpha_error, covered_share
from fexel_tools.pinchmap_window import Window, choose_window

NAME = "pinchmap shape"
_BUDGETS = (1280, 2560, 5120, 10240)
_ASKED = 5120  # bytes
_LABELS = {
    "bound": "pinchmap as bound, RGBA, 4 B per texel",
    "stored": "pinchmap stored as gamma and mask, 9/8 B",
    "level": "pinchmap's level in one channel, 1 B",
    "msdf": "multi-channel distance field (msdfgen), 3 B",
    "sdf": "distance field, 1 B",
    "bilinear": "bilinear alpha, 1 B",
}


@dataclass
class _Figures:
    """Alpha error by way and budget, a value per shape, and the shapes' names; ways that lack a shape are left out."""

    names: list[str] = field(default_factory=list)
    errors: dict[tuple[str, int], list[float]] = field(default_factory=dict)

    def median(self, way: str, nbytes: int) -> float:
        return statistics.median(self.errors.get((way, nbytes), [float("nan")]))

    def share_below(self, way: str, rival: str, nbytes: int) -> str:
        pairs = list(zip(self.errors[way, nbytes], self.errors.get((rival, nbytes), []), strict=False))
        return f"{sum(a <= b for a, b in pairs)} of {len(pairs)} shapes"


_measured = _Figures()


def rows(quick: bool) -> Iterator[Row]:
    global _measured
    _measured = figures = _Figures()
    budgets = (_ASKED,) if quick else _BUDGETS
    for path in progress(drawings(quick), "shapes"):
        shape = load_shape(path)
        figures.names.append(shape.name)
        for (way, nbytes), texture in _textures(shape, budgets).items():
            figures.errors.setdefault((way, nbytes), []).append(alpha_error(texture.coverage, shape.alpha))
    figures.errors = {key: values for key, values in figures.errors.items() if len(values) == len(figures.names)}
    if figures.names:
        yield from _rows_of(figures)


def curves(quick: bool) -> Iterator[Curve]:  # noqa: ARG001
    for way, label in _LABELS.items():
        points = [(nbytes, _measured.median(way, nbytes)) for nbytes in _BUDGETS if (way, nbytes) in _measured.errors]
        if points:
            yield Curve(
                plot="pinchmap_shape",
                label=label,
                x=[nbytes for nbytes, _ in points],
                y=[error for _, error in points],
                x_label="bytes",
                y_label=f"mean alpha error, median of {len(_measured.names)} shapes",
                x_log=True,
                y_log=True,
                ours=way in ("bound", "stored", "level"),
            )


def _textures(shape: Shape, budgets: tuple[int, ...]) -> dict[tuple[str, int], ShapeTexture]:
    ways: dict[str, Callable[[Shape, int], ShapeTexture]] = {
        "bound": lambda shape, nbytes: _pinchmap(shape, nbytes, 4.0),
        "stored": lambda shape, nbytes: _pinchmap(shape, nbytes, 9 / 8),
        "level": _level,
        "sdf": distance_field,
        "bilinear": bilinear_coverage,
    }
    textures = {(way, nbytes): make(shape, nbytes) for way, make in ways.items() for nbytes in budgets}
    for nbytes, texture in zip(budgets, multi_channel_fields(shape, budgets), strict=False):
        textures["msdf", nbytes] = texture
    return textures


def _pinchmap(shape: Shape, nbytes: int, bytes_per_texel: float) -> ShapeTexture:
    levels, window = _levels(shape, nbytes, bytes_per_texel)
    return _drawn(shape, levels, window, bytes_per_texel)


def _level(shape: Shape, nbytes: int) -> ShapeTexture:
    """The level as R8_SNORM; where it lies beyond 1, the line is hardly ever near."""
    levels, window = _levels(shape, nbytes, 1)
    return _drawn(shape, np.rint(np.clip(levels, -1, 1) * 127), window, 1)


def _levels(shape: Shape, nbytes: int, bytes_per_texel: float) -> tuple[np.ndarray, Window]:
    """k - gamma, and the window that the map covers."""
    grid = Grid.over(shape, nbytes, bytes_per_texel)
    size = (grid.rows, grid.columns)
    window = choose_window(shape.alpha, size, content=shape.alpha > 0)
    pinchmap = fit(shape.alpha, size, window=window).pinchmap
    return pinchmap[..., 2] - pinchmap[..., 3], window


def _drawn(shape: Shape, levels: np.ndarray, window: Window, bytes_per_texel: float) -> ShapeTexture:
    covered = covered_share(levels, shape.alpha.shape, samples=SAMPLES, window=window)
    return ShapeTexture(round(levels.size * bytes_per_texel), covered)


def _rows_of(figures: _Figures) -> Iterator[Row]:
    setting = f"{_ASKED} bytes, SVGs at 1024 pixels"
    rivals = {"msdf": "MSDF", "sdf": "SDF", "bilinear": "bilinear"}
    elsewhere = ", ".join(
        f"{name} {1e3 * figures.median(way, _ASKED):.{1 if way == 'bilinear' else 2}f}"
        for way, name in rivals.items()
        if (way, _ASKED) in figures.errors
    )
    has_msdf = ("msdf", _ASKED) in figures.errors
    asked = (1e3 * figures.median("msdf", _ASKED), "<=") if has_msdf else (None, None)
    for way in ("bound", "stored", "level"):
        yield Row(
            "alpha error, median",
            f"{_LABELS[way]}; {setting}",
            1e3 * figures.median(way, _ASKED),
            "/1000",
            *asked,
            elsewhere,
            samples=len(figures.names),
            note=f"not above MSDF on {figures.share_below(way, 'msdf', _ASKED)}, SDF on "
            f"{figures.share_below(way, 'sdf', _ASKED)}; asked for: MSDF's",
        )
    worst = int(np.argmax(figures.errors["stored", _ASKED]))
    yield Row(
        "alpha error, worst",
        f"{figures.names[worst]}, {_LABELS['stored']}; {setting}",
        1e3 * figures.errors["stored", _ASKED][worst],
        "/1000",
        reference=", ".join(
            f"{name} {1e3 * figures.errors[way, _ASKED][worst]:.1f}"
            for way, name in (("msdf", "MSDF"), ("sdf", "SDF"))
            if (way, _ASKED) in figures.errors
        ),
    )
