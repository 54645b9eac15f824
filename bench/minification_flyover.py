"""Frames of a camera that turns over a floor: what `auto` makes of its fetches, against other filters.

The camera looks along the horizon, 208 texels above the floor, 960 x 540 pixels at 60 degrees: from the lower border,
at 20 degrees, to the horizon. Four frames, turned by 10, 35, 60 and 80 degrees; of each every fifth pixel along both
axes, looked up by the renderer's shader, against the exact mean over the pixel. The paper's decision takes filters by
the camera's direction alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.harness import Curve, Row, progress
from fexel.filters import FILTERS, decision
from fexel.renderer.context import GLContext
from fexel_tools.filter_lookup import look_up
from fexel_tools.filter_measure import error_of
from fexel_tools.filter_subject import Subject, drawn_subject
from fexel_tools.filter_textures import TEXTURES
from fexel_tools.filter_truth import FilterTruth

NAME = "minification flyover"
_SIZE = (960, 540)
_FIELD = 60.0  # degrees, across
_HEIGHT = 208.0  # texels: 1/4 texel a pixel straight below
_HORIZON = 0.42  # of the height, from above
_TURNS = (10.0, 35.0, 60.0, 80.0)
_TEXELS = 512
_PROBES = 16
_PAPER = "the paper's decision"
_found: dict[str, dict[str, tuple[float, float, float]]] = {}


@dataclass(frozen=True, eq=False)
class Frame:
    """Pixels of the floor.

    Attributes
    ----------
    xy : (M, 2) float64
        Texels, y down.
    jacobian : (M, 2, 2) float64
        d(texel)/d(pixel).
    to_camera : (M, 3) float64
        Unit vectors along u, v, and the normal.
    """

    xy: np.ndarray
    jacobian: np.ndarray
    to_camera: np.ndarray


def frame(turn: float, every: int) -> Frame:
    """The floor from a camera turned by so many degrees, every so many pixels along both axes."""
    focal = 0.5 * _SIZE[0] / np.tan(np.radians(_FIELD / 2))
    horizon = _HORIZON * _SIZE[1]
    x, y = np.meshgrid(np.arange(0.5, _SIZE[0], every), np.arange(np.ceil(horizon) + 2.5, _SIZE[1], every))
    x, y = x.ravel() - _SIZE[0] / 2, y.ravel() - horizon
    far = _HEIGHT * focal / y
    cosine, sine = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    turned = np.array([[cosine, -sine], [sine, cosine]])
    place = np.stack([far * x / focal, far], axis=1) @ turned.T
    own = np.zeros((len(x), 2, 2))
    own[:, 0, 0], own[:, 0, 1], own[:, 1, 1] = far / focal, -far * x / focal / y, -far / y
    seen = np.stack([-place[:, 0], place[:, 1], np.full(len(x), _HEIGHT)], axis=1)
    return Frame(place, turned @ own, seen / np.linalg.norm(seen, axis=1, keepdims=True))


def rows(quick: bool) -> Iterator[Row]:
    """Errors and fetches of `auto` by texture."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        gl = stack.enter_context(GLContext())
        for name in progress(tuple(TEXTURES), "textures"):
            subject = drawn_subject(name, TEXTURES[name](_TEXELS), folder)
            _found[name] = _figures(gl, subject, 10 if quick else 5)
            yield from _rows(name, _found[name])


def curves(quick: bool) -> Iterator[Curve]:  # noqa: ARG001
    """Error over fetches: a point per filter."""
    for name, figures in _found.items():
        ways = sorted(figures, key=lambda way: figures[way][2])
        yield Curve(
            plot="minification_flyover",
            label=name,
            x=[figures[way][2] for way in ways],
            y=[figures[way][0] for way in ways],
            x_label="texels fetched per pixel",
            y_label="PSNR, dB, of a fly-over",
            x_log=True,
            annotations=ways,
        )


def _figures(gl, subject: Subject, every: int) -> dict[str, tuple[float, float, float]]:
    """PSNR, CIEDE2000 and fetches by way, over all frames."""
    truth = FilterTruth.of(subject.image)
    shown: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    true = []
    for turn in _TURNS:
        view = frame(turn, every)
        true.append(truth.mean("box", view.xy, view.jacobian))
        drawn = {way: _drawn(gl, subject, way, view) for way in FILTERS if way != "ewa"}
        decided = decision.decide(view.to_camera, np.broadcast_to(np.eye(3), (len(view.xy), 3, 3)))
        drawn[_PAPER] = _chosen(drawn, decided.filter)
        for way, result in drawn.items():
            shown.setdefault(way, []).append(result)
    figures = {}
    for way, results in shown.items():
        colors, fetches = (np.concatenate(part) for part in zip(*results, strict=True))
        psnr, difference = error_of(subject, colors, np.concatenate(true))
        figures[way] = psnr, difference or 0.0, float(fetches.mean())
    return figures


def _drawn(gl, subject: Subject, way: str, view: Frame) -> tuple[np.ndarray, np.ndarray]:
    looked = look_up(gl, subject.source, way, view.xy, view.jacobian, anisotropy=_PROBES)
    return looked.color, looked.fetches


def _chosen(drawn: dict[str, tuple[np.ndarray, np.ndarray]], numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels each of the filter of that number."""
    colors, fetches = (np.zeros_like(part) for part in drawn["mipmap"])
    for number in np.unique(numbers):
        picked = numbers == number
        colors[picked], fetches[picked] = (part[picked] for part in drawn[FILTERS[number]])
    return colors, fetches


def _rows(name: str, figures: dict[str, tuple[float, float, float]]) -> Iterator[Row]:
    psnr, difference, fetches = figures["auto"]
    probes = figures["anisotropic"]
    setting = f"fly-over of a floor: {name}"
    others = ", ".join(f"{way} {e[0]:.1f} dB at {e[2]:.0f}" for way, e in figures.items() if way != "auto")
    yield Row(
        measure="auto, error",
        setting=setting,
        value=psnr,
        unit="dB PSNR",
        target=probes[0],
        comparison=">=",
        reference=others,
        note=f"{difference:.2f} CIEDE2000, {_PROBES} probes {probes[1]:.2f}",
    )
    yield Row(
        measure="auto, texels fetched, ratio to 16 probes",
        setting=setting,
        value=fetches / probes[2],
        unit="",
        target=0.5,
        comparison="<=",
        note=f"{fetches:.1f} against {probes[2]:.1f} texels a pixel",
    )
