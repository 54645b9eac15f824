"""Framebuffers of a tile: multisampled colour, single-sample float32 colour, and the data AOVs.

Kept from tile to tile and frame to frame; a size that is no longer used is freed when another is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fexel.renderer.aov import Aov
from fexel.renderer.context import unbind_framebuffer

if TYPE_CHECKING:
    import moderngl

__all__ = ["ColorTarget", "DataTarget", "Targets"]

_KEPT = 8  # an image has at most four sizes of tiles; twice that for colour and data


class ColorTarget:
    """Colour and depth; `samples` 0 keeps float32, more are multisampled float16 and resolved by `read`."""

    def __init__(self, gl: moderngl.Context, size: tuple[int, int], samples: int) -> None:
        self._gl = gl
        self.largest_value = 65504.0 if samples else 3e38
        dtype = "f2" if samples else "f4"
        self._resources: list = [
            color := gl.renderbuffer(size, 4, samples=samples, dtype=dtype),
            depth := gl.depth_renderbuffer(size, samples=samples),
            frame := gl.framebuffer([color], depth),
        ]
        self.frame: moderngl.Framebuffer = frame
        self._resolved: moderngl.Framebuffer | None = None
        if samples:
            self._resources += [single := gl.renderbuffer(size, 4, dtype=dtype), resolved := gl.framebuffer([single])]
            self._resolved = resolved

    def read(self) -> np.ndarray:
        """Pixels (height, width, 4) float32, row 0 at the top."""
        source = self.frame
        if self._resolved is not None:
            self._gl.copy_framebuffer(self._resolved, self.frame)
            source = self._resolved
        pixels = np.frombuffer(source.read(components=4, dtype="f4", alignment=1), np.float32)
        return pixels.reshape(source.height, source.width, 4)[::-1]

    def release(self) -> None:
        """Free it."""
        for resource in reversed(self._resources):
            resource.release()


class DataTarget:
    """One float32 target per AOV, `aovs[i]` at location i."""

    largest_value = 3e38

    def __init__(self, gl: moderngl.Context, size: tuple[int, int], aovs: Sequence[Aov]) -> None:
        self._aovs = tuple(aovs)
        colors = [gl.renderbuffer(size, aov.location_components, dtype="f4") for aov in aovs]
        depth = gl.depth_renderbuffer(size)
        self.frame: moderngl.Framebuffer = gl.framebuffer(colors, depth)
        self._resources = [*colors, depth, self.frame]

    def read(self) -> dict[str, np.ndarray]:
        """Pixels (height, width, C) float32 by the AOV's name, row 0 at the top."""
        return {aov.name: self._read(location, aov) for location, aov in enumerate(self._aovs)}

    def _read(self, location: int, aov: Aov) -> np.ndarray:
        count = len(aov.channels)
        data = self.frame.read(components=count, attachment=location, dtype="f4", alignment=1)
        return np.frombuffer(data, np.float32).reshape(self.frame.height, self.frame.width, count)[::-1]

    def release(self) -> None:
        """Free it."""
        for resource in reversed(self._resources):
            resource.release()


class Targets:
    """Cache of targets of one context."""

    def __init__(self, gl: moderngl.Context) -> None:
        self._gl = gl
        self._targets: dict[tuple, ColorTarget | DataTarget] = {}

    def color(self, size: tuple[int, int], samples: int) -> ColorTarget:
        """Colour target; `samples` 0 or what the GL offers."""
        return self._get((size, samples), lambda: ColorTarget(self._gl, size, samples))

    def data(self, size: tuple[int, int], aovs: Sequence[Aov]) -> DataTarget:
        """Target for at most eight data AOVs."""
        return self._get((size, tuple(aovs)), lambda: DataTarget(self._gl, size, aovs))

    def _get(self, key: tuple, make):
        if key not in self._targets:
            unbind_framebuffer(self._gl)
            while len(self._targets) >= _KEPT:
                self._targets.pop(next(iter(self._targets))).release()
            self._targets[key] = make()
        self._targets[key] = target = self._targets.pop(key)  # most recently used last
        return target

    def release(self) -> None:
        """Free all."""
        unbind_framebuffer(self._gl)
        for target in self._targets.values():
            target.release()
        self._targets.clear()
