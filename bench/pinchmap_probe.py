"""The pinch alone on a GPU, with two samplers of its own: random pinchmaps, views of them, pictures by the shader.

Serves tests and benchmarks of shaders/pinchmap_warp.glsl; the renderer's own path is in `fexel.textures`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bench.pinchmap_texture import blob_mask
from fexel.renderer.program import ProgramCache
from fexel.textures.pinchmap_encoding import decode_texels, encode_texels, signal_half_texel
from fexel.textures.pinchmap_twin import edge
from fexel_tools.pinchmap_mask import channels

if TYPE_CHECKING:
    import moderngl

__all__ = ["Probe", "View", "quad_gradient", "random_pinchmap", "view_of"]

_RGBA8_SNORM = 0x8F97


def random_pinchmap(
    rng: np.random.Generator, width: int, height: int, k: int, reach: float = 0.9
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """A legal pinchmap of 8 bits with blobs and random lines, and a signal of two smooth colours, 2^k times as fine."""
    mask = blob_mask(rng, (height, width), ("clamp", "clamp"))
    gamma = rng.uniform(-reach, reach, mask.shape)
    pinchmap = decode_texels(encode_texels(np.dstack([channels(mask), gamma])))
    ratio = 2**k
    side = mask.repeat(ratio, 0).repeat(ratio, 1)
    y, x = np.mgrid[0 : side.shape[0], 0 : side.shape[1]] / max(side.shape)
    bright = np.dstack([0.7 + 0.2 * np.sin(9 * x), 0.5 + 0.2 * np.cos(7 * y), 0.1 + 0.05 * x])
    dark = np.dstack([0.05 + 0.04 * x, 0.1 + 0.05 * y, 0.4 + 0.2 * np.sin(8 * x * y)])
    signal = np.dstack([np.where(side[..., None], bright, dark), np.where(side, 1.0, 0.5)])
    signal[..., :3] *= signal[..., 3:]
    return pinchmap, signal.astype(np.float32)


@dataclass(frozen=True)
class View:
    """Where a square picture looks: position in pinchmap texels is cell + origin + axes @ uv, uv in [0, 1]^2 upward."""

    cell: NDArray[np.float64]
    origin: NDArray[np.float64]
    axes: NDArray[np.float64]

    def places(self, pinchmap: NDArray, pixels: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Centres of the pixels, (pixels^2, 2) in st, the lowest row first, and d(st)/d(pixel), (2, 2)."""
        uv = (np.arange(pixels) + 0.5) / pixels
        places = np.stack(np.meshgrid(uv, uv), -1).reshape(-1, 2) @ self.axes.T
        size = np.array([pinchmap.shape[1], pinchmap.shape[0]])
        return (self.cell + self.origin + places) / size, self.axes / pixels / size[:, None]


def view_of(rng: np.random.Generator, pinchmap: NDArray, magnification: float, pixels: int) -> View:
    """A turned view of so many pixels per texel about a place on a line, within the map where it is small enough."""
    size = np.array([pinchmap.shape[1], pinchmap.shape[0]])
    places = rng.uniform(0.15, 0.85, (4096, 2))
    centre = places[np.argmin(np.abs(edge(pinchmap, places)))] * size
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    axes = np.float32(turn * pixels / magnification).astype(np.float64)
    cell = np.floor(centre)
    origin = np.float32(centre - cell - axes.sum(1) / 2).astype(np.float64)
    return View(cell, origin, axes)


def quad_gradient(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """What dFdx and dFdy make of values by pixel, (H, W) even: differences within blocks of 2 x 2; (H W, 2)."""
    across = np.repeat(values[:, 1::2] - values[:, ::2], 2, 1)
    up = np.repeat(values[1::2] - values[::2], 2, 0)
    return np.stack([across, up], -1).reshape(-1, 2)


class Probe:
    """Draws views of one pinchmapped texture into a square float target."""

    def __init__(
        self,
        gl: moderngl.Context,
        pinchmap: NDArray[np.floating],
        levels: list[NDArray[np.floating]],
        pixels: int,
        texel_type: str = "snorm",
    ) -> None:
        self._gl, self._pinchmap, self._pixels = gl, pinchmap, pixels
        self._programs = ProgramCache(gl)
        self._target = gl.framebuffer([gl.renderbuffer((pixels, pixels), 4, dtype="f4")])
        self._textures = [_pinchmap_texture(gl, pinchmap, texel_type), _signal_texture(gl, levels)]
        h = signal_half_texel(pinchmap.shape[1::-1], levels[0].shape[1::-1])
        assert h is not None
        self._h = h

    def render(self, view: View, *, exact: bool, antialias: float, line_width: float = 0.0) -> NDArray[np.float32]:
        """The picture, (pixels, pixels, 4), the lowest row first."""
        self.draw(view, exact=exact, antialias=antialias, line_width=line_width)
        data = self._target.read(components=4, dtype="f4")
        return np.frombuffer(data, np.float32).reshape(self._pixels, self._pixels, 4)

    def draw(self, view: View, *, exact: bool, antialias: float, line_width: float = 0.0) -> None:
        """Draw only."""
        defines = {"PINCHMAP_EXACT": exact, "PINCHMAP_LINES": line_width > 0, "PINCHMAP_MAGNIFIED": False}
        program = self._programs.get("fullscreen.vert", "pinchmap_plain.frag", defines)
        values = {
            "pinchmap": 0,
            "signal": 1,
            "pinchmapSize": self._pinchmap.shape[1::-1],
            "origin": tuple(view.origin),
            "axes": tuple(view.axes.T.ravel()),
            "cell": tuple(view.cell),
            "halfTexel": self._h,
            "antialias": antialias,
            "lineWidth": line_width,
            "lineColor": (0.2, 0.1, 0.4, 0.8),
        }
        for name, value in values.items():
            if name in program:
                program[name] = value
        for unit, texture in enumerate(self._textures):
            texture.use(unit)
        self._target.use()
        array = self._gl.vertex_array(program, [])
        array.render(vertices=3)
        array.release()

    def release(self) -> None:
        """Free what is on the GPU."""
        self._gl.detect_framebuffer(0).use()  # moderngl would bind the released one again
        for thing in (*self._textures, self._target, self._programs):
            thing.release()


def _pinchmap_texture(gl: moderngl.Context, pinchmap: NDArray[np.floating], texel_type: str) -> moderngl.Texture:
    """With the row and column at s = 1 and t = 1, clamped."""
    texels = np.pad(pinchmap[::-1], ((0, 1), (0, 1), (0, 0)), mode="edge")
    size = texels.shape[1::-1]
    if texel_type == "snorm":
        data = np.rint(texels * 127).astype(np.int8)
        texture = gl.texture(size, 4, data.tobytes(), dtype="ni1", internal_format=_RGBA8_SNORM)
    else:
        texture = gl.texture(size, 4, texels.astype(np.float32).tobytes(), dtype="f4")
    texture.filter = (gl.LINEAR, gl.LINEAR)
    texture.repeat_x = texture.repeat_y = False
    return texture


def _signal_texture(gl: moderngl.Context, levels: list[NDArray[np.floating]]) -> moderngl.Texture:
    texture = gl.texture(levels[0].shape[1::-1], 4, dtype="f4")
    texture.build_mipmaps(0, len(levels) - 1)
    for number, level in enumerate(levels):
        texture.write(np.ascontiguousarray(level[::-1], np.float32).tobytes(), level=number)
    texture.filter = (gl.LINEAR_MIPMAP_LINEAR, gl.LINEAR)
    texture.repeat_x = texture.repeat_y = False
    return texture
