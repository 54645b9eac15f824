"""Benchmarks of minification run through, small, and state what they claim."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("bench.harness", reason="run from the repository's root")
pytest.importorskip("colour")

from bench import minification_memory, minification_quality
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
    assert box["fipmap"] > box["ripmap"]
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
