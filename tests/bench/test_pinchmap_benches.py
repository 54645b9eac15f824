"""Benchmarks of pinchmaps run through on one small drawing: every row has a finite value, every curve its points."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("bench.harness", reason="run from the repository's root")
pytest.importorskip("contourpy")
authoring = pytest.importorskip("bench.pinchmap_authoring")
color = pytest.importorskip("bench.pinchmap_color")
shape = pytest.importorskip("bench.pinchmap_shape")

LEAF = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 64 48">'
    '<path d="M6 24C16 4 46 4 58 24C46 42 16 42 6 24Z" fill="#2a7f3c"/><circle cx="30" cy="22" r="7" fill="#e0d040"/>'
    "</svg>"
)


@pytest.fixture(autouse=True)
def _one_drawing(tmp_path, monkeypatch):
    (tmp_path / "leaf.svg").write_text(LEAF)
    monkeypatch.setattr("fexel_tools.pinchmap_source._DRAWING_SIDE_PX", 256)
    monkeypatch.setattr("fexel_tools.pinchmap_source._PIXELS_PER_TEXEL", 4)
    monkeypatch.setattr("bench.pinch_shapes.LONGER_SIDE_PX", 256)
    for module in (authoring, color, shape):
        monkeypatch.setattr(module, "drawings", lambda _quick: [tmp_path / "leaf.svg"])
        monkeypatch.setattr(module, "images", list, raising=False)
    monkeypatch.setattr(shape, "multi_channel_fields", lambda *_: [])


def checked(module):
    rows = list(module.rows(True))
    assert rows
    assert all(math.isfinite(row.value) for row in rows), [row for row in rows if not math.isfinite(row.value)]
    return rows


def test_authoring_is_measured(monkeypatch):
    monkeypatch.setattr(authoring, "_EFFORTS", (0.0, 1.0))
    rows = checked(authoring)
    assert {"s of CPU", "dB"} <= {row.unit for row in rows}
    curves = list(authoring.curves(True))
    assert {curve.plot for curve in curves} == {"pinchmap_color", "pinchmap_effort"}
    assert all(len(curve.x) == len(curve.y) > 0 and np.isfinite(curve.y).all() for curve in curves)


def test_colour_is_measured(monkeypatch):
    monkeypatch.setattr(color, "_SIZES", (32,))
    monkeypatch.setattr(color, "_SIGNALS", ((20, 2),))
    assert any(row.measure.startswith("colour PSNR, by fineness") and row.value > 15 for row in checked(color))


def test_shape_is_measured_without_figures_of_msdfgen():
    rows = checked(shape)
    assert rows[0].target is None and "MSDF" not in rows[0].reference and "SDF" in rows[0].reference
    curves = {curve.label for curve in shape.curves(True)}
    assert any("pinchmap" in label for label in curves) and not any("msdfgen" in label for label in curves)


def test_figures_that_one_shape_lacks_are_left_out(tmp_path, monkeypatch):
    """msdfgen that fails on the second of two shapes."""
    found = iter([[shape.distance_field], []])
    monkeypatch.setattr(shape, "drawings", lambda _quick: [tmp_path / "leaf.svg"] * 2)
    monkeypatch.setattr(
        shape, "multi_channel_fields", lambda shape_, budgets: [make(shape_, budgets[0]) for make in next(found)]
    )
    assert all("MSDF" not in row.reference.replace("MSDF on", "") for row in checked(shape))
