"""The wheel: what is in it, and that an empty environment with nothing but it works."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
INSTALL_LIMIT_S = 400
PROBE = """
import json, sys
import fexel
from fexel._resources import schemas_dir, shaders_dir
from pxr import Plug, Usd
stage = Usd.Stage.CreateInMemory()
fexel.ZipmapTexture.Define(stage, "/A/B").CreateOpacityAttr(0.5)
print(json.dumps({
    "package": fexel.__file__,
    "schemas": str(schemas_dir()),
    "plugin": Plug.Registry().GetPluginWithName("fexel").resourcePath,
    "patches": [str(patch.path) for patch in fexel.ZipmapTexture.Get(stage, "/A/B").GetPatches()],
    "shaders": sorted(path.name for path in shaders_dir().glob("*.glsl")),
    "findings": len(fexel.validate(stage)),
    "heavy": [name for name in ("cv2", "scipy", "moderngl") if name in sys.modules],
}))
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(REPOSITORY)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed_python(wheel, tmp_path_factory):
    """Python of an environment that holds the wheel and what it depends on, nothing else."""
    folder = tmp_path_factory.mktemp("empty") / "venv"
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    python = folder / "bin" / "python"
    options = ["--quiet", "--disable-pip-version-check", "--no-compile", "-c", str(REPOSITORY / "constraints.txt")]
    command = [str(python), "-m", "pip", "install", *options, str(wheel)]
    try:
        result = subprocess.run(command, capture_output=True, text=True, check=False, timeout=INSTALL_LIMIT_S)
    except subprocess.TimeoutExpired:
        pytest.skip(f"notice: the package registry did not deliver within {INSTALL_LIMIT_S} s")
    if result.returncode:
        unreachable = ("Connection", "Temporary failure", "ProxyError", "Read timed out", "Name or service not known")
        if any(sign in result.stderr for sign in unreachable):
            pytest.skip("notice: the package registry cannot be reached, the wheel was not installed")
        pytest.fail(result.stderr)
    return python


def test_wheel_holds_schemas_shaders_and_both_packages(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    for folder in ("schemas", "shaders"):
        for path in (REPOSITORY / folder).rglob("*.*"):
            assert f"fexel/{path.relative_to(REPOSITORY)}" in names
    for package in (REPOSITORY / "plugin" / "fexel", REPOSITORY / "tools" / "fexel_tools"):
        for path in package.rglob("*.*"):
            if path.is_dir() or path.parent.name == "__pycache__":
                continue
            assert str(path.relative_to(package.parent)) in names


def test_wheel_holds_nothing_else(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0] for name in names} == {"fexel", "fexel_tools", f"fexel-{_version(wheel)}.dist-info"}
    assert not [name for name in names if name.endswith((".pyc", ".orig", "~"))]


def test_wheel_carries_licence_and_command(wheel):
    archive = zipfile.ZipFile(wheel)
    info = f"fexel-{_version(wheel)}.dist-info"
    assert "Apache License" in archive.read(f"{info}/licenses/LICENSE").decode()
    assert "fexel = fexel_tools.cli:main" in archive.read(f"{info}/entry_points.txt").decode()


def _version(wheel: Path) -> str:
    return wheel.name.split("-")[1]


def test_package_and_distribution_have_one_version(wheel):
    import fexel

    assert _version(wheel) == fexel.__version__


def test_installed_wheel_finds_its_schemas_and_shaders(installed_python, tmp_path):
    import json

    result = subprocess.run([installed_python, "-c", PROBE], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert result.returncode == 0, result.stderr
    found = json.loads(result.stdout)
    environment = str(installed_python.parents[1])
    for key in ("package", "schemas", "plugin"):
        assert found[key].startswith(environment), found[key]
    assert found["schemas"].rstrip("/") == found["plugin"].rstrip("/")
    assert found["patches"] == ["/A/B"]
    assert found["shaders"] == sorted(path.name for path in (REPOSITORY / "shaders").glob("*.glsl"))
    assert found["findings"] > 0
    assert found["heavy"] == []


def test_installed_command_answers(installed_python, tmp_path):
    command = [installed_python.parent / "fexel", "plugin-path"]
    result = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert result.stdout.strip().endswith("fexel/schemas"), result.stderr


def test_installed_shaders_compile_and_render(installed_python, tmp_path, gl):
    """A cube without material, lit by the camera's light: enough to need every resource of the renderer."""
    code = """
import fexel
from pxr import Usd, UsdGeom
stage = Usd.Stage.CreateInMemory()
UsdGeom.Cube.Define(stage, "/Cube")
stage.SetDefaultPrim(stage.GetPrimAtPath("/Cube"))
print(sorted(fexel.render(stage, width=16)))
"""
    result = subprocess.run([installed_python, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert result.returncode == 0, result.stderr
    assert "color" in result.stdout
