"""Shared fixtures: a GL context that is checked around every test, fixed seeds, NumPy errors that raise."""

from __future__ import annotations

import importlib.util
import os
import time
from pathlib import Path

import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(autouse=True)
def _numpy_errors_raise():
    with np.errstate(divide="raise", invalid="raise"):
        yield


@pytest.fixture(autouse=True)
def _no_cache_on_disk(monkeypatch):
    """Nothing beside the stages and photos that tests draw."""
    monkeypatch.setenv("FEXEL_CACHE", "0")


@pytest.fixture
def rng():
    return np.random.default_rng(20100504)


@pytest.fixture
def move_clock(monkeypatch):
    """Function that moves the local time, as files note it, by a day less an hour."""
    if not hasattr(time, "tzset"):
        pytest.skip("the time zone of a process cannot be changed here")

    def move():
        monkeypatch.setenv("TZ", "FAR-23" if os.environ.get("TZ") != "FAR-23" else "UTC0")
        time.tzset()

    yield move
    monkeypatch.undo()
    time.tzset()


@pytest.fixture
def shared_data():
    """Real photos and meshes that are not part of the repository: FEXEL_DATA, else beside the checkout; or skip."""
    folder = Path(os.environ.get("FEXEL_DATA") or REPOSITORY.parent / "shared" / "data")
    if not folder.is_dir():
        pytest.skip("no shared photo collection: set FEXEL_DATA to its folder")
    return folder


@pytest.fixture(scope="session")
def _gl_session():
    from fexel.errors import FexelError
    from fexel.renderer.context import GLContext

    context = GLContext()
    try:
        with context:
            pass
    except FexelError as error:
        if os.environ.get("CI"):
            raise
        pytest.skip(str(error))
    yield context
    context.release()


@pytest.fixture
def gl(_gl_session):
    """A current EGL context of the tests' own; fails the test that left a GL error behind.

    Every fexel `Renderer` has a context of its own and gives back the one that was current before it; a test that uses
    both touches this one's objects only outside the renderer's calls.
    """
    with _gl_session as context:
        assert context.error == "GL_NO_ERROR"
        yield context
        assert context.error == "GL_NO_ERROR"


def pytest_addoption(parser):
    parser.addoption("--update-goldens", action="store_true", help="write tests/golden anew; look at every picture")


@pytest.fixture
def golden(request, _gl_session):
    """Compare a picture with ``tests/golden/<name>.png``: ``golden(name, color, mean=..., off=..., limit=...)``.

    `color` is (H, W, 4) float, linear, premultiplied, as `fexel.render` returns it. `mean` bounds the mean FLIP, `off`
    the share of pixels whose FLIP exceeds 0.1, `limit` what no pixel may exceed; say at the call why they are as they
    are. Only the software rasteriser is compared. A failure leaves render, golden and difference in ``out/golden``.
    """
    check_golden = _golden_image().check_golden
    if "llvmpipe" not in _gl_session.description:
        pytest.skip(f"goldens are pictures of llvmpipe, this is {_gl_session.description}")
    return lambda name, color, **bounds: check_golden(
        name, color, request.config.getoption("--update-goldens"), **bounds
    )


def _golden_image():
    """`golden_image.py` beside this file; tests are imported without their folders on the path."""
    place = Path(__file__).with_name("golden_image.py")
    spec = importlib.util.spec_from_file_location("golden_image", place)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
