"""`fexel validate`, `fexel plugin-path` and the frame of the command line."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest

import fexel.validators
from fexel.validators.registration import prim_validators

LINE = re.compile(r"^(error|warning|info): \S+: .+ \([\w:]+\)$")


def fexel_command(*arguments: object, **options) -> subprocess.CompletedProcess[str]:
    code = "from fexel_tools.cli import main; main()"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


def test_clean_stage_is_silent_and_exits_0(sample):
    sample.stage.Save()
    result = fexel_command("validate", sample.folder / "sample.usda")
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


def test_warnings_alone_exit_0(sample):
    sample.patch.GetMatrixAttr().Clear()
    sample.root.GetOutput("rgb").ClearSources()
    for channel in "rgba":
        sample.root.GetOutput(channel).ClearSources()
    sample.stage.Save()
    result = fexel_command("validate", sample.folder / "sample.usda")
    assert result.returncode == 0
    assert re.fullmatch(r"warning: /World/Wall/Photo: .+ \(fexel:Fallback\)\n", result.stdout)


def test_errors_exit_1_one_line_each_errors_first(sample):
    sample.patch.GetFileAttr().Set("./gone.png")
    sample.root.GetOutput("rgb").ClearSources()
    sample.stage.ClearMetadata("fallbackPrimTypes")
    sample.stage.Save()
    result = fexel_command("validate", sample.folder / "sample.usda")
    lines = result.stdout.splitlines()
    assert result.returncode == 1
    assert result.stderr == ""
    assert all(LINE.match(line) for line in lines), lines
    assert [line.split(":")[0] for line in lines] == sorted(line.split(":")[0] for line in lines)
    assert "error: /World/Wall/Photo/Detail: inputs:file: ./gone.png: no such file (fexel:Files)" in lines


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("gone.usda", None, "no such file"),
        ("text.txt", b"hello", "expected .usd"),
        ("broken.usda", b"#usda 1.0\ndef Mesh {", "parse error"),
        ("broken.usdc", b"PXR-USDC" + bytes(80), "obsolete"),
        ("empty.usd", b"", ""),
    ],
)
def test_stage_that_cannot_be_opened_is_one_line_and_exit_1(tmp_path, name, content, message):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    result = fexel_command("validate", path)
    assert result.returncode == 1
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith(f"fexel: {path}: ")
    assert message in result.stderr


def test_missing_reference_is_a_finding_and_no_noise(tmp_path):
    stage = tmp_path / "a.usda"
    stage.write_text(
        '#usda 1.0\n(upAxis="Y"\nmetersPerUnit=1\ndefaultPrim="a")\ndef "a" (references = @./b.usda@) {}\n'
    )
    result = fexel_command("validate", stage)
    assert result.returncode == 1
    assert result.stderr == ""
    assert all(LINE.match(line) for line in result.stdout.splitlines())


def test_plugin_path_holds_the_plugin(tmp_path):
    folder = fexel_command("plugin-path", cwd=tmp_path).stdout.strip()
    assert sorted({"generatedSchema.usda", "plugInfo.json", "schema.usda"} - set(os.listdir(folder))) == []


def test_help_imports_nothing_heavy():
    code = (
        "import sys; from fexel_tools.cli import app\n"
        "try: app(['--help'])\n"
        "except SystemExit: pass\n"
        "heavy = ['numpy', 'OpenImageIO', 'moderngl', 'cv2', 'scipy', 'numba', 'pxr', 'rich']\n"
        "print([name for name in heavy if name in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.stdout.splitlines()[-1] == "[]"
    assert "validate" in result.stdout


FAILURES = {
    "raise FexelError('photo.jpg: no such file')": (1, "fexel: photo.jpg: no such file\n"),
    "raise FileNotFoundError(2, 'No such file or directory', 'a.png')": (
        1,
        "fexel: a.png: No such file or directory\n",
    ),
    "raise KeyboardInterrupt": (130, "fexel: interrupted\n"),
    "import signal; signal.raise_signal(signal.SIGTERM)": (143, "fexel: terminated\n"),
    "import signal; signal.raise_signal(signal.SIGHUP)": (129, "fexel: terminated\n"),
    "raise BrokenPipeError(32, 'Broken pipe')": (1, ""),
    "import warnings; warnings.warn('/A: damaged', FexelWarning)": (0, "fexel: warning: /A: damaged\n"),
}


@pytest.mark.parametrize("failure", FAILURES)
def test_failures_are_one_line_with_their_exit_status(failure):
    code = f"""
from fexel.errors import FexelError, FexelWarning
from fexel_tools import cli
import sys

@cli.app.command("fail")
def fail():
    {failure}

sys.argv = ["fexel", "fail"]
cli.main()
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stderr) == FAILURES[failure]


@pytest.mark.parametrize("signal", ["SIGTERM", "SIGHUP", "SIGINT"])
def test_end_by_a_signal_leaves_no_hidden_folder(tmp_path, signal):
    code = f"""
import signal, sys
from fexel_tools import cli
from fexel_tools.staged_output import staged_output

@cli.app.command("write")
def write():
    with staged_output("out.usda") as staged:
        staged.stage.write_text("#usda 1.0")
        signal.raise_signal(signal.{signal})

sys.argv = ["fexel", "write"]
cli.main()
"""
    result = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode > 128 and result.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("signal", ["SIGTERM", "SIGHUP"])
def test_signals_that_the_caller_has_ignored_stay_so(signal):
    """As ``nohup`` does."""
    code = f"""
import signal, sys
from fexel_tools import cli
signal.signal(signal.{signal}, signal.SIG_IGN)

@cli.app.command("go")
def go():
    signal.raise_signal(signal.{signal})
    print("done")

sys.argv = ["fexel", "go"]
cli.main()
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout) == (0, "done\n")


def test_validators_are_those_that_the_modules_of_the_package_declare(tmp_path, monkeypatch):
    """A module that was not there before is enough, as for a kind that is added."""
    before = [validator.name for validator in prim_validators()]
    assert len(set(before)) == len(before) > 8
    assert {"fexel:Files", "fexel:Pinchmap", "fexel:UmbrellaArrays"} <= set(before)
    (tmp_path / "checkerboard.py").write_text(
        "from fexel.validators.prim_validator import ANY, PrimValidator\n"
        'VALIDATORS = (PrimValidator("fexel:Checkerboard", "Squares alternate.", ANY, lambda prim: ()),)\n'
    )
    monkeypatch.setattr(fexel.validators, "__path__", [*fexel.validators.__path__, str(tmp_path)])
    assert sorted(validator.name for validator in prim_validators()) == sorted([*before, "fexel:Checkerboard"])
