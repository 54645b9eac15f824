"""Stability of umbrellas in motion: how much more the picture changes from frame to frame than the truth does.

Fall leaves seen by a slow zoom through the levels of detail, a slow pan at several footprints, and a flight low over
the ground. A step's ratio is the mean absolute change of the rendered picture over that of the supersampled truth, both
sRGB-encoded: 1 where the picture moves as it should, above it where it flickers, and far above it where a level pops.
A picture that is too soft, or stands still, stays below 1; so the change of its error is told as well.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.color_error import encoded
from bench.harness import Curve, Row, progress
from bench.umbrella_setting import Ground, fall_leaves_ground
from bench.umbrella_texture import LowView, low_view, picture, picture_low
from bench.umbrella_truth import turned_view
from fexel.renderer.context import GLContext
from fexel.textures.system import TextureSystem

NAME = "umbrella motion"
_ASKED = 1.25
_PIXELS = 96
_SAMPLES = 16
_CENTER = (0.37, 0.58)
_ZOOM_STEP = 1.02
_FLIGHT_CELLS = 0.2  # per frame
_PAN_PX = np.array([0.23, 0.19])  # per frame
_found: dict[str, _Motion] = {}


@dataclass(frozen=True)
class _Motion:
    """Mean absolute changes of the steps of a sequence of frames: picture, truth, and of the one less the other."""

    ours: np.ndarray
    truth: np.ndarray
    wrong: np.ndarray
    where: np.ndarray

    @property
    def ratios(self) -> np.ndarray:
        return self.ours / self.truth


def rows(quick: bool) -> Iterator[Row]:
    """Mean and worst ratio of each motion."""
    with tempfile.TemporaryDirectory() as name, GLContext() as gl:
        ground = fall_leaves_ground(Path(name))
        system = TextureSystem(gl)
        for title, measured in _motions(gl, system, ground, quick):
            _found[title] = measured
            yield from _rows(title, measured)
        system.release()


def curves(quick: bool) -> Iterator[Curve]:  # noqa: ARG001
    """Ratio over the footprint along the zoom."""
    for title, motion in _found.items():
        if title.startswith("zoom"):
            yield Curve(
                plot="umbrella_motion",
                label=f"{title}, {len(motion.ratios)} steps",
                x=motion.where.tolist(),
                y=motion.ratios.tolist(),
                x_label="pixels per cell",
                y_label="change of the picture over that of the truth",
                x_log=True,
                ours=True,
            )


def _rows(title: str, motion: _Motion) -> Iterator[Row]:
    ratios = motion.ratios
    low, high = np.percentile(ratios, [25, 75])
    common = {"unit": "ratio", "target": _ASKED, "comparison": "<=", "samples": len(ratios)}
    total = float(motion.ours.sum() / motion.truth.sum())
    yield Row("frame-to-frame change over the truth's own", title, total, spread=(high - low) / 2, **common)
    worst = int(np.argmax(ratios))
    note = f"at step {worst + 1} of {len(ratios)}; {motion.where[worst]:.3g} pixels per cell"
    yield Row("the same, worst step", title, float(ratios[worst]), note=note, **common)
    yield Row(
        "change of the error over the truth's own change",
        title,
        float(motion.wrong.sum() / motion.truth.sum()),
        "ratio",
        samples=len(ratios),
        note="0 where the picture moves just as the truth does, 1 where it stands still",
    )


def _motions(gl, system: TextureSystem, ground: Ground, quick: bool) -> Iterator[tuple[str, _Motion]]:
    size = (_PIXELS, _PIXELS)

    def ours(matrix: np.ndarray) -> np.ndarray:
        return picture(gl, ground.texture, matrix, size, system)

    def truth(matrix: np.ndarray) -> np.ndarray:
        return ground.truth.picture(matrix, size, _SAMPLES)

    first, last = (9.5, 3.6) if quick else (24.0, 1.4)
    count = int(np.ceil(np.log(first / last) / np.log(_ZOOM_STEP)))
    footprints = first / _ZOOM_STEP ** np.arange(count + 1)
    views = [turned_view(_CENTER, footprint, size, ground.grid) for footprint in footprints]
    yield f"zoom out, {first:g} to {last:g} pixels per cell, 2 % a frame", _measured(ours, truth, views, footprints)
    for footprint in (6.0, 3.0) if quick else (16.0, 8.0, 6.0, 4.0, 3.0, 2.0, 1.0):
        view = turned_view(_CENTER, footprint, size, ground.grid)
        views = [_moved(view, step * _PAN_PX) for step in range(5 if quick else 13)]
        title = f"pan, {footprint:g} pixels per cell, 0.3 pixels a frame"
        yield title, _measured(ours, truth, views, np.full(len(views), footprint))
    yield _flight(gl, system, ground, quick)


def _flight(gl, system: TextureSystem, ground: Ground, quick: bool) -> tuple[str, _Motion]:
    """Low over the ground, a cell 8 pixels wide at the middle of the picture and an eighth of that in depth."""
    size = (2 * _PIXELS, _PIXELS)
    places = _FLIGHT_CELLS * np.arange(6 if quick else 25)
    views = [low_view(ground.grid, forward, 83.0, 6.0, 8.0, size) for forward in places]

    def ours(view: LowView) -> np.ndarray:
        return picture_low(gl, ground.texture, view, system)

    def truth(view: LowView) -> np.ndarray:
        return ground.truth.picture(view.pixel_to_st, size, _SAMPLES)

    title = f"flight, looking 4 to 10 degrees down, {_FLIGHT_CELLS} cells a frame"
    return title, _measured(ours, truth, views, np.full(len(views), views[0].footprint_px))


def _moved(view: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    shift = np.eye(3)
    shift[2, :2] = pixels
    return shift @ view


def _measured(ours: Callable, truth: Callable, views: list, where: np.ndarray) -> _Motion:
    before, changes = None, []
    for view in progress(views, "frames"):
        now = np.stack([encoded(ours(view)), encoded(truth(view))]).astype(np.float64)
        if before is not None:
            shown, true = now - before
            changes.append([np.abs(change).mean() for change in (shown, true, shown - true)])
        before = now
    return _Motion(*np.array(changes).T, (where[1:] + where[:-1]) / 2)
