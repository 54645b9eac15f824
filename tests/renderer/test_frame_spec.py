"""FrameSpecs and placeholders."""

from __future__ import annotations

import pytest

from fexel.errors import FexelError
from fexel.renderer.frame_spec import frame_path, parse_frames

VALID = {
    "7": [7],
    "101:105": [101, 102, 103, 104, 105],
    "105:101": [105, 104, 103, 102, 101],
    "101:109x2": [101, 103, 105, 107, 109],
    "101:110x2": [101, 103, 105, 107, 109],
    "105:101x-2": [105, 103, 101],
    "1:2x0.25": [1, 1.25, 1.5, 1.75, 2],
    "-2:1": [-2, -1, 0, 1],
    "3:3": [3],
    "101:103,7, 9:10": [101, 102, 103, 7, 9, 10],
}


@pytest.mark.parametrize("spec", VALID)
def test_valid_specs(spec):
    assert list(parse_frames(spec)) == VALID[spec]


@pytest.mark.parametrize("spec", [spec for spec in VALID if "," not in spec])
def test_specs_mean_what_usd_says(spec):
    from pxr import UsdUtils

    assert [time.GetValue() for time in UsdUtils.TimeCodeRange.CreateFromFrameSpec(spec)] == list(parse_frames(spec))


def test_decimal_strides_do_not_lose_the_last_frame():
    assert len(parse_frames("0:1x0.1")) == 11 and len(parse_frames("101:104x0.3")) == 11


@pytest.mark.parametrize(
    "spec",
    [
        "",
        "a",
        "1:",
        ":3",
        "1:2x",
        "1:2x0",
        "1:5x-1",
        "5:1x1",
        "1:2:3",
        "1,,2",
        "1x2",
        "nan",
        "1:inf",
        "1e3",
        "1:999999999",
    ],
)
def test_bad_specs_are_quoted(spec):
    with pytest.raises(FexelError, match="FrameSpec") as error:
        parse_frames(spec)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("pattern", "time", "expected"),
    [
        ("a.####.exr", 7.0, "a.0007.exr"),
        ("a.#.exr", 1234.0, "a.1234.exr"),
        ("a_##.##.png", 1.5, "a_01.50.png"),
        ("dir{0}/a.###.png", 12.0, "dir{0}/a.012.png"),
        ("a.####.exr", -3.0, "a.-003.exr"),
    ],
)
def test_placeholders(pattern, time, expected):
    frames = parse_frames("1.5" if "##.##" in pattern else "1:3")
    assert frame_path(pattern, time, frames) == expected


def test_name_and_frames_must_agree():
    with pytest.raises(FexelError, match="one placeholder"):
        frame_path("a.png", 1.0, parse_frames("1:3"))
    with pytest.raises(FexelError, match="one placeholder"):
        frame_path("a.##.b.##.png", 1.0, parse_frames("1:3"))
    with pytest.raises(FexelError, match="no frames were asked for"):
        frame_path("a.##.png", None, None)
    with pytest.raises(FexelError, match=r"need 2 decimals.*write ###\.##"):
        frame_path("a.###.png", 1.0, parse_frames("1:2x0.25"))
    assert frame_path("a.png", 5.0, parse_frames("5")) == "a.png"
    assert frame_path("a.png", None, None) == "a.png"
