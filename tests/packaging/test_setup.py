"""What `make setup` stands on: the constraints file, and the script that makes the virtual environment."""

from __future__ import annotations

import os
import re
import subprocess
import tomllib
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
MAKE_VENV = REPOSITORY / ".ci" / "make_venv"
PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]


def normalized(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def pinned() -> dict[str, str]:
    lines = (REPOSITORY / "constraints.txt").read_text().splitlines()
    return {normalized(name): version for name, _, version in (line.partition("==") for line in lines)}


def test_every_dependency_is_pinned():
    extras = PROJECT["optional-dependencies"]
    requirements = [*PROJECT["dependencies"], *extras["bench"], *extras["test"], *extras["lint"]]
    names = [normalized(re.split(r"[\[<>=!~ ;]", requirement)[0]) for requirement in requirements]
    assert sorted(set(names) - pinned().keys()) == []


def test_constraints_pin_exact_versions_and_nothing_of_this_machine():
    for line in (REPOSITORY / "constraints.txt").read_text().splitlines():
        assert re.fullmatch(r"[A-Za-z0-9_.-]+==[0-9][A-Za-z0-9_.+]*", line), line
    assert "fexel" not in pinned()


def fake_python(folder: Path, version: str, has_venv: bool) -> Path:
    """A shell script that answers what .ci/make_venv asks of Python, as an old or a stripped one would."""
    new_enough = int(tuple(map(int, version.split("."))) < (3, 11))
    script = folder / "python3"
    script.write_text(f"""#!/bin/sh
case "$2" in
    *ensurepip*) exit {int(not has_venv)} ;;
    *print*) echo {version} ;;
    *exit*) exit {new_enough} ;;
    *) echo "unexpected: $*" >&2; exit 99 ;;
esac
""")
    script.chmod(0o755)
    return script


def make_venv(*arguments: object, path: str | None = None) -> subprocess.CompletedProcess[str]:
    environment = os.environ | ({"PATH": path} if path else {})
    command = [str(MAKE_VENV), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


def test_missing_python_is_one_line(tmp_path):
    result = make_venv("no-such-python", tmp_path / "venv")
    assert result.returncode == 1
    assert (
        result.stderr == "no-such-python: not found; fexel needs Python 3.11 or newer (make PYTHON=/path/to/python3)\n"
    )


def test_old_python_is_one_line(tmp_path):
    result = make_venv(fake_python(tmp_path, "3.9", True), tmp_path / "venv")
    assert result.returncode == 1
    assert result.stderr.count("\n") == 1
    assert "Python 3.9, fexel needs 3.11 or newer" in result.stderr


def test_python_without_ensurepip_names_the_package(tmp_path):
    """With an `id` that answers as an ordinary user's does, for root would install the package."""
    user = tmp_path / "id"
    user.write_text("#!/bin/sh\necho 1000\n")
    user.chmod(0o755)
    result = make_venv(fake_python(tmp_path, "3.11", False), tmp_path / "venv", path=f"{tmp_path}:{os.environ['PATH']}")
    assert result.returncode == 1
    assert result.stderr.count("\n") == 1
    assert "apt install python3.11-venv" in result.stderr


def test_working_environment_is_left_alone(tmp_path):
    python = tmp_path / "venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\nexit 0\n")  # answers `-m pip --version` as an environment with pip does
    python.chmod(0o755)
    assert make_venv("no-such-python", tmp_path / "venv").returncode == 0
    assert python.exists()


def test_environment_without_pip_is_made_anew(tmp_path):
    python = tmp_path / "venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\nexit 1\n")
    python.chmod(0o755)
    assert "no-such-python: not found" in make_venv("no-such-python", tmp_path / "venv").stderr


@pytest.mark.parametrize("target", ["setup", "test", "demo", "bench", "lint", "schema"])
def test_every_target_makes_the_environment_itself(target):
    command = ["make", "--dry-run", "--always-make", target]
    result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=REPOSITORY)
    assert result.returncode == 0, result.stderr
    assert ".ci/make_venv" in result.stdout
