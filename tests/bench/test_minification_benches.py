"""Benchmarks of minification run through, small, and state what they claim."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("bench.harness", reason="run from the repository's root")
pytest.importorskip("colour")

from bench import (
    minification_cost,
    minification_database,
    minification_flyover,
    minification_memory,
    minification_quality,
)
from fexel.renderer.context import GLContext
from fexel_tools.filter_subject import drawn_subject
from fexel_tools.filter_textures import line_chart
from fexel_tools.filter_views import fan


def test_quality_ranks_filters_by_both_truths(monkeypatch):
    ways = [way for way in minification_quality.WAYS if way.token != "auto"]
    monkeypatch.setattr(minification_quality, "WAYS", tuple(ways))
    found = minification_quality.measure_fan({"chart": line_chart(128)}, fan((5.0, 1.0), (30.0,)), tuple(ways), 24)
    monkeypatch.setattr(minification_quality, "_found", found)
    box = {way.label: minification_quality._decibels(way.label, 5.0) for way in ways}
    gauss = {way.label: minification_quality._decibels(way.label, 5.0, "gauss") for way in ways}
    assert box["trilinear"] < box["2 probes"] < box["16 probes"]
    assert box["fipmap"] > box["ripmap (box taps)"]
    assert gauss["EWA"] > gauss["fipmap"]
    assert gauss["fipmap, Gaussian"] > gauss["fipmap"]
    curves = list(minification_quality.curves(quick=True))
    assert {curve.plot for curve in curves} >= {"minification_cost_box", "minification_memory_gauss"}
    assert all(np.isfinite(curve.y).all() for curve in curves)


def test_memory_states_the_whole_of_each_filter(monkeypatch):
    monkeypatch.setattr(minification_memory, "FILTERS", ("mipmap", "ripmap", "fipmap"))
    rows = list(minification_memory.rows(quick=True))
    whole = {row.measure.split(":")[0]: row.value for row in rows if "1024 x 1024, repeat" in row.setting}
    assert whole["mipmap"] < whole["ripmap"] < whole["fipmap"] < 12.1


def test_dearest_pixel_is_what_is_judged(monkeypatch):
    way = next(way for way in minification_quality.WAYS if way.token == "ewa")
    found = minification_quality.measure_fan({"chart": line_chart(64)}, fan((45.0, 5.0), (30.0,)), (way,), 24, ("box",))
    monkeypatch.setattr(minification_quality, "_found", found)
    by_elevation = {row.view.elevation: row.most_fetches for row in found}
    assert all(row.most_fetches >= row.fetches for row in found)
    assert minification_quality._most_fetches("EWA", (45.0, 5.0)) == max(by_elevation.values())


@pytest.mark.usefixtures("_gl_session")
def test_cost_is_over_that_of_one_lookup(monkeypatch):
    monkeypatch.setattr(minification_cost, "_PIXELS", 64)
    ratios = minification_cost.cost_ratios(5.0, ("mipmap", "fipmap"), repeats=2, size=64)
    assert set(ratios) == {"mipmap", "fipmap"}
    assert all(np.isfinite(part) and part >= 0 for pair in ratios.values() for part in pair)
    assert all(middle > 0 for middle, _ in ratios.values())


def test_database_is_made_found_and_weighed(tmp_path, monkeypatch):
    monkeypatch.setattr(minification_database, "_REPEATS", 1)
    file = minification_database._picture(tmp_path / "picture.png", 512, "uint8")  # smaller ones are not kept
    rows = [*minification_database._six_shears("small", file, True)]
    rows += minification_database._all_directions("small", file, 512)
    assert [row.unit for row in rows] == ["s", "s", "MB", "x", "MB"]
    assert all(row.value > 0 for row in rows if "peak" not in row.measure)  # small ones fit into what is there
    assert 10 < rows[3].value < 12


@pytest.mark.usefixtures("_gl_session")
def test_flyover_ranks_probes_above_one_and_counts_what_auto_fetches(tmp_path, monkeypatch):
    monkeypatch.setattr(minification_flyover, "_TURNS", (35.0,))
    subject = drawn_subject("chart", line_chart(128), tmp_path)
    with GLContext() as gl:
        figures = minification_flyover._figures(gl, subject, 40)
    assert figures["mipmap"][0] < figures["anisotropic"][0]
    assert figures["mipmap"][2] < figures["auto"][2]
    error, cost = minification_flyover._rows("chart", figures)
    assert error.value == figures["auto"][0]
    assert cost.value == figures["auto"][2] / figures["anisotropic"][2]
