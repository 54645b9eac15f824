"""A headless OpenGL 3.3 core context through EGL, on a GPU or on Mesa's software rasteriser.

No display, window system or Qt. The context is made on first use. `GLContext` is re-entrant and gives back whatever
context was current before, so that several renderers and other users of OpenGL in the process do not disturb each
other (the EGL backend of glcontext leaves *no* context current on exit, hence the restoring here).
"""

from __future__ import annotations

import ctypes
import ctypes.util
from typing import TYPE_CHECKING

from fexel.errors import FexelError

if TYPE_CHECKING:
    import moderngl

__all__ = ["NO_OPENGL", "GLContext", "unbind_framebuffer"]

NO_OPENGL = (
    "no usable OpenGL 3.3 through EGL: {reason}; on Debian and Ubuntu: "
    "apt install libegl1 libgl1 libgl1-mesa-dri (software rendering; a GPU needs its driver's EGL library)"
)

_MINIMUM_VERSION = 330
# EGL lists the machine's devices in no particular order; a container may expose some that cannot be opened.
_MAX_DEVICES = 8


class GLContext:
    """A lazily created EGL context; ``with context as gl:`` makes it current and yields the moderngl context.

    Not to be used by two threads at once.

    Examples
    --------
    >>> with GLContext() as gl:
    ...     gl.version_code >= 330
    True
    """

    def __init__(self) -> None:
        self._gl: moderngl.Context | None = None
        self._egl: ctypes.CDLL | None = None
        self._previous: list[tuple[int | None, ...]] = []

    def __enter__(self) -> moderngl.Context:
        egl = self._load_egl()
        previous = _current(egl)
        if self._gl is None:
            try:
                self._gl = _create()
            except FexelError:
                _restore(egl, previous)
                raise
        self._gl.__enter__()
        self._previous.append(previous)
        return self._gl

    def __exit__(self, *_exception: object) -> None:
        assert self._egl is not None
        _restore(self._egl, self._previous.pop())

    @property
    def description(self) -> str:
        """Renderer and version, for example ``llvmpipe (LLVM 15.0.6, 256 bits), OpenGL 4.5``."""
        with self as gl:
            return f"{gl.info['GL_RENDERER']}, OpenGL {gl.version_code // 100}.{gl.version_code % 100 // 10}"

    def release(self) -> None:
        """Free the context and everything made in it; harmless when there is none."""
        if self._gl is not None:
            with self as gl:
                gl.gc()
            self._gl.release()
            self._gl = None

    def _load_egl(self) -> ctypes.CDLL:
        if self._egl is None:
            self._egl = _egl_library()
        return self._egl


def _egl_library() -> ctypes.CDLL:
    for name in ("libEGL.so.1", ctypes.util.find_library("EGL")):
        if not name:
            continue
        try:
            egl = ctypes.CDLL(name)
        except OSError:
            continue
        for function in (
            egl.eglGetCurrentContext,
            egl.eglGetCurrentDisplay,
            egl.eglGetCurrentSurface,
        ):
            function.restype = ctypes.c_void_p
        egl.eglGetCurrentSurface.argtypes = [ctypes.c_int]
        egl.eglMakeCurrent.argtypes = [ctypes.c_void_p] * 4
        return egl
    raise FexelError(NO_OPENGL.format(reason="libEGL.so.1 was not found"))


def unbind_framebuffer(gl: moderngl.Context) -> None:
    """Bind a framebuffer that stays, before the one in use is released.

    moderngl binds the last framebuffer again after making another; a released one is an OpenGL error then. A headless
    context has no default framebuffer to fall back on.
    """
    if gl.extra is None:
        gl.extra = {}
    if "idle" not in gl.extra:
        gl.extra["idle"] = gl.framebuffer([gl.renderbuffer((1, 1))])
    gl.extra["idle"].use()


_EGL_DRAW, _EGL_READ = 0x3059, 0x305A


def _current(egl: ctypes.CDLL) -> tuple[int | None, ...]:
    """Display, draw surface, read surface and context that are current in this thread."""
    return (
        egl.eglGetCurrentDisplay(),
        egl.eglGetCurrentSurface(_EGL_DRAW),
        egl.eglGetCurrentSurface(_EGL_READ),
        egl.eglGetCurrentContext(),
    )


def _restore(egl: ctypes.CDLL, current: tuple[int | None, ...]) -> None:
    if current[3] is None:
        # Nothing was current before: releasing ours needs a display, the one that is current now.
        display = egl.eglGetCurrentDisplay()
        if display:
            egl.eglMakeCurrent(display, None, None, None)
    else:
        egl.eglMakeCurrent(*current)


def _create() -> moderngl.Context:
    """Open the first EGL device that offers OpenGL 3.3 core."""
    import moderngl

    libraries = {"libegl": "libEGL.so.1", "libgl": _gl_library()}
    reason = "no EGL device"
    for device in range(_MAX_DEVICES):
        try:
            return moderngl.create_standalone_context(  # noqa: TID251 - this is the place
                backend="egl",
                require=_MINIMUM_VERSION,
                device_index=device,
                **libraries,
            )
        except Exception as error:
            message = " ".join(str(error).split()) or type(error).__name__
            if device == 0:
                reason = message
            if "requested device index" in message:
                break
    raise FexelError(NO_OPENGL.format(reason=reason))


def _gl_library() -> str:
    """Library with the core entry points. EGL 1.5 can resolve them too, when neither of the usual two is there."""
    for name in ("libGL.so.1", "libOpenGL.so.0"):
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return name
    return "libEGL.so.1"
