"""Shared fixtures: a GL context that is checked around every test, fixed seeds, NumPy errors that raise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(autouse=True)
def _numpy_errors_raise():
    with np.errstate(divide="raise", invalid="raise"):
        yield


@pytest.fixture
def rng():
    return np.random.default_rng(20100504)


@pytest.fixture
def shared_data():
    """Real photos and meshes beside the checkout, where there are any; a test that needs them skips without."""
    folder = REPOSITORY.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the shared photo collection is not beside this checkout")
    return folder


@pytest.fixture(scope="session")
def _gl_session():
    moderngl = pytest.importorskip("moderngl")
    context = moderngl.create_standalone_context(backend="egl")
    yield context
    context.release()


@pytest.fixture
def gl(_gl_session):
    """An EGL context; fails the test that left a GL error behind."""
    assert _gl_session.error == "GL_NO_ERROR"
    yield _gl_session
    assert _gl_session.error == "GL_NO_ERROR"
