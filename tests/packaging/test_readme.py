"""What the README shows is true: its Python runs, its links lead somewhere, its commands exist."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
DOCUMENTS = ["README.md", "CONTRIBUTING.md"]


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (REPOSITORY / "README.md").read_text(), re.DOTALL)


def test_python_example_runs(gl, tmp_path):
    """In a process of its own; the logo that it adds is the one thing that is not there."""
    (code,) = blocks("python")
    code += (
        '\nassert images["color"].shape[1] == 640\nassert not [f for f in findings if "logo.png" not in f.message]\n'
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=REPOSITORY, check=False)
    assert result.returncode == 0, result.stderr
    assert "/World/Materials/Deep/Texture " in result.stdout


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_lead_to_files(document):
    text = (REPOSITORY / document).read_text()
    targets = [target for target in re.findall(r"\]\(([^)#]+)\)", text) if not target.startswith("http")]
    assert targets
    assert [target for target in targets if not (REPOSITORY / target).exists()] == []


def test_commands_exist():
    from fexel_tools.cli import app

    names = {command.name for command in app.registered_commands}
    shown = set(re.findall(r"^fexel ([a-z-]+)", "\n".join(blocks("")), re.MULTILINE))
    listed = set(re.findall(r"^\| `fexel ([a-z-]+)`", (REPOSITORY / "README.md").read_text(), re.MULTILINE))
    assert shown <= names
    assert listed == names
