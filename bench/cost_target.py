"""Lookups compared by CPU time: a target that textures of a stage and GL's own lookup are drawn into, in turns.

Times are CPU times of the process: the software rasteriser's threads count, other processes do not.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from bench.zipmap_stage import compiled_view, front_view, quad
from fexel.renderer.program import ProgramCache
from fexel.scene.model import Draw, Texture
from fexel.textures.system import TextureSystem

_SRGB8_ALPHA8 = 0x8C43


def cpu_times(contenders: dict[str, Callable[[], object]], repeats: int) -> dict[str, np.ndarray]:
    """CPU seconds of each contender by turn, in alternating order; the first turn is left out."""
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for turn in range(-1, repeats):
        for name in list(contenders) if turn % 2 == 0 else list(contenders)[::-1]:
            start = time.process_time()
            contenders[name]()
            if turn >= 0:
                times[name].append(time.process_time() - start)
    return {name: np.array(values) for name, values in times.items()}


class CostTarget:
    """Draws into one square target; each method gives a closure that draws a frame and waits for it.

    Parameters
    ----------
    gl : moderngl.Context
    pixels : int
        Width and height.
    """

    def __init__(self, gl, pixels: int) -> None:
        self._gl = gl
        self._target = gl.framebuffer([gl.renderbuffer((pixels, pixels), 4, dtype="f2")])
        self._programs = ProgramCache(gl)
        self._systems: list[TextureSystem] = []
        self._view = front_view((0, 0), (1, 1), pixels, pixels)

    def plain(self, size: int, mesh: Draw | None = None) -> Callable[[], None]:
        """GL's own trilinear lookup of a square texture that fills the picture, or lies on `mesh` as its st say."""
        texels = (np.random.default_rng(1).random((size, size, 4)) * 255).astype(np.uint8)
        texture = self._gl.texture((size, size), 4, texels.tobytes(), internal_format=_SRGB8_ALPHA8)
        texture.build_mipmaps()
        texture.filter = (self._gl.LINEAR_MIPMAP_LINEAR, self._gl.LINEAR)
        program = self._programs.get("texture_view.vert", "texture_plain.frag")
        draw = compiled_view(self._gl, program, mesh or quad(), self._view)

        def frame() -> None:
            texture.use(0)
            program["plain"] = 0
            self._draw(draw)

        return frame

    def textured(
        self,
        texture: Texture,
        times: float = 1.0,
        *,
        mesh: Draw | None = None,
        anisotropy: float = 1.0,
        filter: str | None = None,
    ) -> Callable[[], None]:
        """A texture of a stage, repeated so many times across the picture or as the st of `mesh` say, with a filter."""
        system = TextureSystem(self._gl, anisotropy=anisotropy, filter=filter)
        self._systems.append(system)
        mesh = mesh or quad((0, 0), (times, times))
        program, binding, draw = compiled_view(self._gl, self._programs, mesh, self._view, (texture, system))

        def frame() -> None:
            binding.apply(program)
            self._draw(draw)

        return frame

    def _draw(self, draw: Callable[[], None]) -> None:
        self._target.use()
        draw()
        self._gl.finish()

    def release(self) -> None:
        """Free the textures."""
        for system in self._systems:
            system.release()
