"""Lights of a scene as the uniforms of `light_analytic.glsl` and the textures of `light_dome.glsl`.

Radiometry as UsdLux defines it: `color` is the radiance of the emitting surface; with ``normalize`` it is divided by
the light's area (sphere: 4 pi r^2; distant: pi sin^2(angle / 2), so that `color` becomes the irradiance). Distant
lights without an angle are taken as normalised, as they have no area.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fexel.errors import FexelWarning
from fexel.renderer import environment
from fexel.renderer.context import unbind_framebuffer
from fexel.scene.model import Light

if TYPE_CHECKING:
    import moderngl

    from fexel.renderer.program import ProgramCache

__all__ = ["MAX_LIGHTS", "AnalyticLights", "DomeTextures", "analytic_lights", "world_lights"]

MAX_LIGHTS = 64  # OpenGL 3.3 guarantees room for 256 vec4 uniforms; a light takes 3
_DISTANT, _SPHERE, _CAMERA = 0.0, 1.0, 2.0


@dataclass(frozen=True, eq=False)
class AnalyticLights:
    """Uniform arrays, float32: `position` and `power` (N, 4), `share` (N, 2); see light_analytic.glsl."""

    position: np.ndarray
    power: np.ndarray
    share: np.ndarray

    def __len__(self) -> int:
        return len(self.position)


def analytic_lights(lights: Sequence[Light], eye: np.ndarray, *, camera_light: bool) -> AnalyticLights:
    """Distant and sphere lights around `eye` (3,) float64 world; the headlight when `camera_light`.

    The headlight gives a white diffuse surface that faces it a radiance of 1.
    """
    rows = [_row(light, eye) for light in lights[:MAX_LIGHTS]]
    if len(lights) > MAX_LIGHTS:
        message = f"{len(lights)} lights, at most {MAX_LIGHTS} are used; {lights[MAX_LIGHTS].path} and later are not"
        warnings.warn(message, FexelWarning, stacklevel=2)
    if camera_light:
        rows.append(((0.0, 0.0, 0.0, _CAMERA), (np.pi, np.pi, np.pi, 0.0), (1.0, 1.0)))
    position, power, share = zip(*rows, strict=True) if rows else ((), (), ())
    return AnalyticLights(
        np.array(position, np.float32).reshape(-1, 4),
        np.array(power, np.float32).reshape(-1, 4),
        np.array(share, np.float32).reshape(-1, 2),
    )


def world_lights(lights: Sequence[Light]) -> tuple[list[Light], list[Light]]:
    """Analytic lights and domes; lights that emit nothing are left out."""
    shining = [light for light in lights if any(channel > 0.0 for channel in light.color)]
    domes = [light for light in shining if light.kind == "dome"]
    return [light for light in shining if light.kind != "dome"], domes


def _row(light: Light, eye: np.ndarray) -> tuple[tuple, tuple, tuple]:
    share = (light.diffuse, light.specular)
    color = np.asarray(light.color, np.float64)
    if light.kind == "sphere":
        area_factor = 0.25 if light.normalize else np.pi * light.radius**2
        centre = light.light_to_world[3, :3] - eye
        return (*centre, _SPHERE), (*(color * area_factor), light.radius), share
    towards = light.light_to_world[2, :3]  # a distant light shines along its -z
    towards = towards / max(float(np.linalg.norm(towards)), 1e-30)  # 1e-30: a light scaled to nothing
    sine = float(np.sin(np.radians(min(max(light.angle, 0.0), 180.0)) / 2.0))
    factor = 1.0 if light.normalize or sine == 0.0 else np.pi * sine**2
    return (*towards, _DISTANT), (*(color * factor), sine), share


class DomeTextures:
    """GL textures of the scene's environment, made anew only when the domes change."""

    _LEVELS = 7

    def __init__(self, gl: moderngl.Context, programs: ProgramCache) -> None:
        self._gl = gl
        self._programs = programs
        self._key: tuple | None = None
        self._images: dict[str, np.ndarray] = {}
        self.irradiance: moderngl.Texture | None = None
        self.radiance: moderngl.Texture | None = None
        self.levels = 1

    def update(self, domes: Sequence[Light]) -> None:
        """Bring the textures up to date with `domes` (not empty)."""
        key = environment.dome_key(domes)
        if key == self._key:
            return
        self.release()
        diffuse = environment.dome_radiance(domes, "diffuse", self._images)
        specular = environment.dome_radiance(domes, "specular", self._images)
        self.irradiance = self._texture(environment.dome_irradiance(diffuse))
        self.radiance = self._prefiltered(specular)
        self._key = key

    def release(self) -> None:
        """Free the textures."""
        for texture in (self.irradiance, self.radiance):
            if texture is not None:
                texture.release()
        self.irradiance = self.radiance = self._key = None

    def _texture(self, image: np.ndarray) -> moderngl.Texture:
        height, width = image.shape[:2]
        texture = self._gl.texture((width, height), 3, np.ascontiguousarray(image, np.float32).tobytes(), dtype="f4")
        return self._latlong(texture)

    def _latlong(self, texture: moderngl.Texture) -> moderngl.Texture:
        texture.repeat_x, texture.repeat_y = True, False
        texture.filter = (self._gl.LINEAR, self._gl.LINEAR)
        return texture

    def _prefiltered(self, image: np.ndarray) -> moderngl.Texture:
        self.levels = 1 if image.shape[0] == 1 else self._LEVELS
        source = self._texture(image)
        if self.levels == 1:
            return source
        source.build_mipmaps()
        source.filter = (self._gl.LINEAR_MIPMAP_LINEAR, self._gl.LINEAR)
        target = self._texture(image)
        target.build_mipmaps(0, self.levels - 1)
        for level in range(1, self.levels):
            self._filter_level(source, target, level)
        source.release()
        target.filter = (self._gl.LINEAR_MIPMAP_LINEAR, self._gl.LINEAR)
        return target

    def _filter_level(self, source: moderngl.Texture, target: moderngl.Texture, level: int) -> None:
        program = self._programs.get("fullscreen.vert", "dome_prefilter.frag")
        size = (max(target.width >> level, 1), max(target.height >> level, 1))
        drawn = self._gl.texture(size, 4, dtype="f4")
        frame = self._gl.framebuffer([drawn])
        frame.use()
        source.use(0)
        program["dome"] = 0
        program["alpha"] = (level / (self.levels - 1)) ** 2
        self._gl.disable(self._gl.DEPTH_TEST | self._gl.BLEND | self._gl.CULL_FACE)
        vertex_array = self._gl.vertex_array(program, [])
        vertex_array.render(vertices=3)
        pixels = np.frombuffer(frame.read(components=3, dtype="f4", alignment=1), np.float32)
        target.write(pixels.tobytes(), level=level, alignment=1)
        unbind_framebuffer(self._gl)
        for resource in (vertex_array, frame, drawn):
            resource.release()
