"""The benchmark runner: what counts as met, what survives a failure, what the table says."""

from __future__ import annotations

import json
import math
import types

import pytest

harness = pytest.importorskip("bench.harness", reason="run from the repository's root")
report = pytest.importorskip("bench.report")

MACHINE = {"date": "d", "commit": "c", "cores": 2, "processor": "p", "opengl": "g", "python": "3", "packages": {}}


def row(value=1.0, target=None, comparison=None, **more):
    return harness.Row("measure", "setting", value, "s", target=target, comparison=comparison, **more)


@pytest.mark.parametrize(
    ("value", "comparison", "met"),
    [(1, "<=", True), (1, "<", False), (2, "<=", False), (2, ">", True), (0.5, ">=", False), (math.nan, ">=", False)],
)
def test_row_is_met_only_when_finite_and_within_the_target(value, comparison, met):
    assert row(value, 1.0, comparison).met is met


def test_row_without_target_is_not_judged_and_half_a_target_is_refused():
    assert row().met is None
    with pytest.raises(ValueError, match="go together"):
        row(target=1.0)
    with pytest.raises(ValueError, match="expected <= <"):
        row(target=1.0, comparison="approximately")


def test_rows_before_a_failure_are_kept_and_the_error_is_named(capsys):
    def rows(quick):
        yield row(1.0)
        yield row(2.0)
        raise RuntimeError("no such photo | at all")

    result = harness.run_module("broken", types.SimpleNamespace(rows=rows), quick=True)
    assert [r.value for r in result.rows] == [1.0, 2.0]
    assert result.error == "RuntimeError: no such photo | at all"
    assert "no such photo" in capsys.readouterr().err
    text = report.markdown(MACHINE, [result], quick=True)
    assert r"**failed**: RuntimeError: no such photo \| at all" in text
    assert report.summary_line([result]) == "0 of 0 figures met; failed: broken"


def test_alternate_timing_runs_every_contender_equally_often_and_in_turns():
    calls = []
    contenders = {name: lambda name=name: calls.append(name) for name in "ab"}
    times = harness.time_alternately(contenders, repeats=3, warmup=1)
    assert calls == list("baabbaab")
    assert {name: timing.times_s.shape for name, timing in times.items()} == {"a": (3,), "b": (3,)}
    assert all(timing.median_s > 0 for timing in times.values())


def test_table_holds_figure_target_and_verdict_and_json_has_no_nan(tmp_path):
    rows = [row(0.123456, 0.2, "<=", spread=0.01), row(3.0, 1.0, "<=", reference="paper 2"), row(math.nan, 1.0, "<=")]
    results = [harness.ModuleResult("topic", rows, [], 1.0)]
    lines = report.markdown(MACHINE, results, quick=False).splitlines()
    assert "| measure | setting | 0.123 ± 0.01 s | <= 0.2 s | met |  |  |" in lines
    assert "| measure | setting | 3 s | <= 1 s | **missed** | paper 2 |  |" in lines
    assert "| measure | setting | not measured | <= 1 s | **missed** |  |  |" in lines
    report.write_json(tmp_path / "results.json", MACHINE, results, quick=False)
    read = json.loads((tmp_path / "results.json").read_text(), parse_constant=pytest.fail)
    assert [r["met"] for r in read["modules"][0]["rows"]] == [True, False, False]
    assert list(tmp_path.iterdir()) == [tmp_path / "results.json"]


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (1.0, "1"), (123.456, "123"), (0.00123, "0.00123"), (2.5e-7, "2.5e-07"), (150000, "150,000")],
)
def test_figures_have_three_digits(value, text):
    assert report.figure(value) == text
