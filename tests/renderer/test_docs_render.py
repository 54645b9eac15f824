"""The documentation of rendering says what there is, and its example runs."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from stages import two_camera_stage

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def text():
    return (REPOSITORY / "docs" / "render.md").read_text(encoding="utf-8")


def test_every_option_of_the_command_is_documented_and_no_other(text):
    import typer.main

    from fexel_tools.cli import app

    command = typer.main.get_command(app).commands["render"]
    names = {name for option in command.params for name in option.opts if name.startswith("-")}
    table = text.split("## Options")[1].split("Several frames")[0]
    assert set(re.findall(r"`(--?[A-Za-z][\w-]*)`", table)) >= names
    assert set(re.findall(r"^\| `(--[\w-]+)`", table, re.M)) == {name for name in names if name.startswith("--")}


def test_every_aov_is_documented(text):
    from fexel.renderer.aov import AOVS

    table = text.split("## AOVs")[1].split("The main texture")[0]
    assert set(re.findall(r"`(\w+)`", table)) >= set(AOVS)


def test_every_format_is_documented(text):
    from fexel.renderer.output import FORMATS

    table = text.split("## Files")[1].split("In integer formats")[0]
    assert {name[1:] for name in FORMATS} - {"tiff", "jpeg"} <= set(re.findall(r"\b[a-z]{3,4}\b", table))


def test_example_renders_a_turntable(tmp_path):
    two_camera_stage(tmp_path / "shot.usda")
    example = REPOSITORY / "docs" / "examples" / "turntable.py"
    image = tmp_path / "turn.##.exr"
    command = [sys.executable, str(example), str(tmp_path / "shot.usda"), str(image), "--frames", "3", "--width", "32"]
    subprocess.run(command, check=True)
    assert sorted(path.name for path in tmp_path.glob("*.exr")) == [f"turn.0{i}.exr" for i in (1, 2, 3)]
