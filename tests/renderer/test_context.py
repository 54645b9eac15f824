"""The EGL context: laziness, re-entrance, company, absence."""

from __future__ import annotations

import ctypes
import subprocess
import sys

import pytest

from fexel.errors import FexelError
from fexel.renderer import context as context_module
from fexel.renderer.context import GLContext


def test_contexts_interleave_and_restore_each_other(gl):
    mine = gl.buffer(b"gl..")
    with GLContext() as a:
        of_a = a.buffer(b"aaaa")
        with GLContext() as b:
            assert b.buffer(b"bbbb").read() == b"bbbb"
        assert of_a.read() == b"aaaa"
    assert mine.read() == b"gl.."


def test_context_is_reentrant(gl):
    context = GLContext()
    with context as a, context as again:
        assert a is again
        buffer = a.buffer(b"abcd")
    with context:
        with context:
            pass
        assert buffer.read() == b"abcd"
    context.release()
    context.release()


def test_description_names_renderer_and_version(gl):
    assert "OpenGL" in GLContext().description


def test_missing_library_is_one_line_that_names_the_packages(monkeypatch):
    def refuse(name):
        raise OSError(name)

    monkeypatch.setattr(ctypes, "CDLL", refuse)
    with (
        pytest.raises(FexelError, match="libegl1 libgl1 libgl1-mesa-dri") as error,
        GLContext(),
    ):
        pass
    assert "\n" not in str(error.value)


def test_failing_driver_is_one_line_with_the_reason(monkeypatch):
    import moderngl

    def refuse(**_options):
        raise RuntimeError("eglInitialize failed\n(0x3001)")

    monkeypatch.setattr(moderngl, "create_standalone_context", refuse)
    with (
        pytest.raises(FexelError, match=r"eglInitialize failed \(0x3001\).*libegl1") as error,
        GLContext(),
    ):
        pass
    assert "\n" not in str(error.value)
    assert "{" not in context_module.NO_OPENGL.format(reason="x")


def test_import_of_the_package_makes_no_context():
    code = "import sys, fexel; sys.exit('moderngl' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
