"""Stages to exchange, and a Python that holds Blender."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf

REPOSITORY = Path(__file__).resolve().parents[2]
BLENDER_PACKAGE = "bpy==5.0.1"  # the last release for Python 3.11
INSTALL_LIMIT_S = 300


@pytest.fixture
def hand_written_stage(tmp_path):
    """The wall of ``hand_written/`` with its textures: root red, detail blue, fallback green with a blue centre."""
    return hand_written(tmp_path) / "wall.usda"


@pytest.fixture(params=["usda", "usdc"])
def hand_written_ground(tmp_path, request):
    """The ground of ``hand_written/``, with the same textures; its arrays in a layer beside it, as text or binary."""
    folder = hand_written(tmp_path)
    ground, arrays = folder / "ground.usda", folder / "arrangement.usda"
    if request.param == "usdc":
        Sdf.Layer.FindOrOpen(str(arrays)).Export(str(arrays.with_suffix(".usdc")))
        arrays.unlink()
        text = ground.read_text(encoding="utf-8").replace(arrays.name, f"{arrays.stem}.usdc")
        ground.write_text(text, encoding="utf-8")
    return ground


def hand_written(parent: Path) -> Path:
    """A copy of ``hand_written/`` below `parent`, its textures painted."""
    image_io = pytest.importorskip("OpenImageIO")
    folder = parent / "hand_written"
    shutil.copytree(Path(__file__).parent / "hand_written", folder)
    (folder / "textures").mkdir(exist_ok=True)
    fallback = np.full((64, 64, 3), (40, 160, 60), np.uint8)
    fallback[24:40, 24:40] = (40, 40, 200)
    images = {
        "root": np.full((64, 64, 3), (200, 40, 40), np.uint8),
        "detail": np.full((64, 64, 3), (40, 40, 200), np.uint8),
        "fallback": fallback,
    }
    for name, pixels in images.items():
        buffer = image_io.ImageBuf(np.ascontiguousarray(pixels))
        assert buffer.write(str(folder / "textures" / f"{name}.png")), buffer.geterror()
    return folder


@pytest.fixture(scope="session")
def blender_python():
    """Path of a Python with `bpy`; made once beside the checkout's own environment, skipped where it cannot be had."""
    given = os.environ.get("FEXEL_BLENDER_PYTHON")
    if given == "0":
        pytest.skip("Blender tests are switched off by FEXEL_BLENDER_PYTHON=0")
    if given:
        return Path(given)
    folder = REPOSITORY / ".venv-blender"
    _wait_while_another_process_installs(folder)
    python = folder / "bin" / "python"
    if python.is_file():
        return python
    if sys.version_info[:2] != (3, 11):
        pytest.skip(f"{BLENDER_PACKAGE} needs Python 3.11 (set FEXEL_BLENDER_PYTHON to a Python that has bpy)")
    _install_blender(folder)
    return python


def _lock(folder: Path) -> Path:
    return folder.with_name(folder.name + ".lock")


def _wait_while_another_process_installs(folder: Path) -> None:
    lock = _lock(folder)
    deadline = time.monotonic() + INSTALL_LIMIT_S
    while lock.exists() and time.monotonic() < deadline:
        if time.time() - lock.stat().st_mtime > 2 * INSTALL_LIMIT_S:  # left by a process that was killed
            lock.rmdir()
            return
        time.sleep(1.0)


def _install_blender(folder: Path) -> None:
    """Make the environment under another name and rename it, so that a broken one is never found."""
    lock = _lock(folder)
    try:
        lock.mkdir()
    except FileExistsError:
        pytest.skip(f"another process is still installing {BLENDER_PACKAGE}")
    part = folder.with_name(folder.name + ".part")
    try:
        shutil.rmtree(part, ignore_errors=True)
        _run_installer([sys.executable, "-m", "venv", str(part)])
        _run_installer(
            [
                str(part / "bin" / "python"),
                "-m",
                "pip",
                "install",
                "-q",
                "--disable-pip-version-check",
            ]
            + [
                "--retries",
                "1",
                "--timeout",
                "20",
                "--only-binary",
                ":all:",
                BLENDER_PACKAGE,
            ]
        )
        part.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
        lock.rmdir()


def _run_installer(command: list[str]) -> None:
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=INSTALL_LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        pytest.skip(f"{BLENDER_PACKAGE} could not be installed within {INSTALL_LIMIT_S} s")
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        pytest.skip(f"{BLENDER_PACKAGE} cannot be had here: {last}")
