"""What is bound for a draw: programs, uniforms, lights, textures, buffers.

A frame sets lights and camera, a view makes its textures resident, a pass fixes the outputs; `draw` then sets what
differs between draws. Uniforms that a program does not use are skipped.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from fexel.renderer.brdf_table import ggx_albedo
from fexel.renderer.lighting import AnalyticLights, DomeTextures, analytic_lights, world_lights
from fexel.renderer.mesh_buffers import MeshBuffers, MeshCache, rebased_buffers
from fexel.renderer.program import Define, ProgramCache
from fexel.renderer.surface import Surface
from fexel.renderer.view_list import Item, ViewList, Viewpoint

if TYPE_CHECKING:
    import moderngl

    from fexel.scene.model import Scene
    from fexel.textures.system import TextureBinding, TextureSystem

__all__ = ["DrawState", "Pass"]

_GL_CLIP_DISTANCE0 = 0x3000
_MAX_CLIPPING_PLANES = 8
_ALBEDO_UNIT, _IRRADIANCE_UNIT, _RADIANCE_UNIT, _FIRST_TEXTURE_UNIT = 0, 1, 2, 3


@dataclass
class Pass:
    """Defines and uniforms shared by the draws of a pass.

    `prepared` holds the programs that have the pass's uniforms already, `surfaces` whose uniforms each has, `programs`
    those of surfaces met before.
    """

    defines: dict[str, Define]
    largest_value: float
    clip_offset: tuple[float, float]
    prepared: set[int] = field(default_factory=set)
    programs: dict[tuple, moderngl.Program] = field(default_factory=dict)
    surfaces: dict[int, Surface] = field(default_factory=dict)


class DrawState:
    """State of one context from draw to draw; `texture_options` are keywords of `TextureSystem`."""

    def __init__(self, gl: moderngl.Context, texture_options: Mapping[str, Any]) -> None:
        self._gl = gl
        self._texture_options = texture_options
        self.programs = ProgramCache(gl)
        self.meshes = MeshCache(gl)
        self._domes = DomeTextures(gl, self.programs)
        self._textures: TextureSystem | None = None
        self._albedo: moderngl.Texture | None = None
        self._lights: AnalyticLights = analytic_lights((), np.zeros(3), camera_light=False)
        self._has_dome = False
        self._viewpoint: Viewpoint | None = None
        self._rebased: dict[int, MeshBuffers] = {}
        self._bindings: dict[int, TextureBinding] = {}

    @property
    def lit(self) -> bool:
        """Whether the frame has any light."""
        return self._has_dome or len(self._lights) > 0

    def texture_stats(self) -> dict:
        """What the texture system tells; empty when no texture was ever drawn."""
        return self._textures.stats() if self._textures is not None else {}

    def begin_frame(self, scene: Scene, camera_light: bool) -> None:
        """Lights of the scene; the headlight when it has none and `camera_light`."""
        self.meshes.collect()
        others, domes = world_lights(scene.lights)
        eye = np.linalg.inv(scene.camera.world_to_camera)[3, :3]
        self._lights = analytic_lights(others, eye, camera_light=camera_light and not scene.lights)
        self._has_dome = bool(domes)
        if domes:
            self._domes.update(domes)
        if self.lit and self._albedo is None:
            table = ggx_albedo()
            self._albedo = self._gl.texture(table.shape[1::-1], 2, table.tobytes(), dtype="f4")
            self._albedo.filter = (self._gl.LINEAR, self._gl.LINEAR)
            self._albedo.repeat_x = self._albedo.repeat_y = False

    def begin_view(self, view_list: ViewList) -> None:
        """Camera of a tile; its textures become resident."""
        self._viewpoint = view_list.viewpoint
        distinct = {id(item.requests): item.requests for item in view_list.items if item.requests}
        if not distinct:
            return
        if self._textures is None:
            from fexel.textures.system import TextureSystem

            self._textures = TextureSystem(self._gl, **self._texture_options)
        self._textures.begin_view([request for requests in distinct.values() for request in requests])
        self._bindings = {key: self._textures.binding(requests) for key, requests in distinct.items()}

    def end_view(self) -> None:
        """Free what belongs to the tile alone."""
        for buffers in self._rebased.values():
            buffers.release()
        self._rebased.clear()
        self._bindings.clear()

    def begin_pass(
        self,
        defines: dict[str, Define],
        largest_value: float,
        offset_px: tuple[float, float],
        size_px: tuple[int, int],
    ) -> Pass:
        """A pass with these outputs; `offset_px` (right, down) moves the sample within the pixel."""
        offset = (-2.0 * offset_px[0] / size_px[0], 2.0 * offset_px[1] / size_px[1])
        return Pass(dict(defines), largest_value, offset)

    def draw(self, item: Item, passed: Pass, cull: str = "") -> None:
        """Draw one item; `cull`: '', 'front' or 'back' faces are left out."""
        binding = self._bindings.get(id(item.requests)) if item.requests else None
        program = self._program(item, passed, binding)
        if program.glo not in passed.prepared:
            self._set_pass_uniforms(program, passed)
            passed.prepared.add(program.glo)
        if passed.surfaces.get(program.glo) is not item.surface:
            passed.surfaces[program.glo] = item.surface
            for name, value in item.surface.uniforms.items():
                _set(program, name, value)
        self._set_draw_uniforms(program, item)
        if binding is not None:
            binding.apply(program, _FIRST_TEXTURE_UNIT)
        self._set_faces(item, cull)
        if item.rebased is not None:
            self._draw_rebased(program, item)
        else:
            self._draw_mesh(program, item)

    def _program(self, item: Item, passed: Pass, binding: TextureBinding | None) -> moderngl.Program:
        key = (id(item.surface), id(binding), item.rebased is not None)
        if key not in passed.programs:
            passed.programs[key] = self._compiled(item, passed, binding)
        return passed.programs[key]

    def _compiled(self, item: Item, passed: Pass, binding: TextureBinding | None) -> moderngl.Program:
        assert self._viewpoint is not None
        defines = item.surface.defines | passed.defines
        defines["CLIPPING_PLANE_COUNT"] = min(len(self._viewpoint.clipping_planes), _MAX_CLIPPING_PLANES)
        if item.rebased is not None:
            defines["REBASED"] = 1
        if "DATA_AOVS" not in passed.defines:
            defines["LIGHT_COUNT"] = len(self._lights)
            if self.lit:
                defines["LIT"] = 1
            if self._has_dome:
                defines["DOME"] = 1
        else:
            defines["LIGHT_COUNT"] = 0
        includes: tuple[str, ...] = ()
        if binding is not None:
            defines |= binding.defines
            includes = binding.includes
        return self.programs.get("mesh.vert", "mesh.frag", defines, includes)

    def _set_pass_uniforms(self, program: moderngl.Program, passed: Pass) -> None:
        viewpoint = self._viewpoint
        assert viewpoint is not None
        _set(program, "largestValue", passed.largest_value)
        _set(program, "clipOffset", passed.clip_offset)
        axis = viewpoint.world_to_eye_axes[:, 2]
        _set(program, "viewDirection", (0.0, 0.0, 0.0, 1.0) if viewpoint.perspective else (*axis, 0.0))
        _write(program, "cameraFromWorld", viewpoint.world_to_eye_axes)
        self._set_clipping_planes(program, viewpoint)
        for name, array in vars(self._lights).items():
            _write(program, f"light{name.capitalize()}", array)
        self._set_sampler(program, "brdfAlbedo", self._albedo, _ALBEDO_UNIT)
        if self._has_dome:
            self._set_sampler(program, "domeIrradiance", self._domes.irradiance, _IRRADIANCE_UNIT)
            self._set_sampler(program, "domeRadiance", self._domes.radiance, _RADIANCE_UNIT)
            _set(program, "domeLevels", float(self._domes.levels))

    def _set_clipping_planes(self, program: moderngl.Program, viewpoint: Viewpoint) -> None:
        planes = viewpoint.clipping_planes[:_MAX_CLIPPING_PLANES].copy()
        planes[:, 3] += planes[:, :3] @ viewpoint.eye
        _write(program, "clippingPlanes", planes)
        for i in range(_MAX_CLIPPING_PLANES):
            switch = self._gl.enable_direct if i < len(planes) else self._gl.disable_direct
            switch(_GL_CLIP_DISTANCE0 + i)

    def _set_sampler(self, program: moderngl.Program, name: str, texture: moderngl.Texture | None, unit: int) -> None:
        if texture is not None and name in program:
            texture.use(unit)
            program[name] = unit

    def _set_draw_uniforms(self, program: moderngl.Program, item: Item) -> None:
        _set(program, "primId", float(item.draw.prim_id))
        frame = (0.0, 0.0, 1.0)
        if item.visible is not None:
            st_frame = item.visible.st_frames[item.surface.st_primvars[0]]
            frame = (*st_frame.origin, 1.0 / st_frame.scale)
        _set(program, "stFrame", frame)

    def _set_faces(self, item: Item, cull: str) -> None:
        gl = self._gl
        mirrored = np.linalg.det(item.draw.object_to_world[:3, :3]) < 0.0
        gl.front_face = "cw" if mirrored else "ccw"
        if cull:
            gl.cull_face = cull
            gl.enable(gl.CULL_FACE)
        else:
            gl.disable(gl.CULL_FACE)

    def _draw_mesh(self, program: moderngl.Program, item: Item) -> None:
        viewpoint = self._viewpoint
        assert viewpoint is not None
        buffers = self.meshes.get(item.draw.mesh)
        to_world = item.draw.object_to_world.copy()
        to_world[3] = np.append(buffers.origin, 1.0) @ to_world
        around_eye = to_world.copy()
        around_eye[3, :3] -= viewpoint.eye
        _write(program, "clipFromObject", to_world @ viewpoint.world_to_clip)
        _write(program, "eyeFromObject", around_eye)
        _write(program, "worldFromNormal", _normal_matrix(to_world[:3, :3]))
        array = buffers.vertex_array(program, _attributes(item, "position", "inPosition"))
        array.render(vertices=3 * item.draw.triangle_count, first=3 * item.draw.first_triangle)

    def _draw_rebased(self, program: moderngl.Program, item: Item) -> None:
        viewpoint = self._viewpoint
        assert viewpoint is not None and item.rebased is not None
        if id(item) not in self._rebased:
            self._rebased[id(item)] = rebased_buffers(self._gl, item.rebased)
        buffers = self._rebased[id(item)]
        around_eye_to_world = np.eye(4)
        around_eye_to_world[3, :3] = viewpoint.eye
        _write(program, "eyeFromClip", np.linalg.inv(around_eye_to_world @ viewpoint.world_to_clip))
        _write(program, "worldFromNormal", np.eye(3))
        array = buffers.vertex_array(program, _attributes(item, "clipPosition", "inClipPosition"))
        if buffers.triangle_count:
            array.render(vertices=3 * buffers.triangle_count)

    def draw_dome(self, viewpoint: Viewpoint, passed: Pass) -> None:
        """The environment as an opaque background."""
        if not self._has_dome:
            return
        gl = self._gl
        program = self.programs.get("dome_background.vert", "dome_background.frag")
        around_eye_to_world = np.eye(4)
        around_eye_to_world[3, :3] = viewpoint.eye
        _write(program, "eyeFromClip", np.linalg.inv(around_eye_to_world @ viewpoint.world_to_clip))
        _set(program, "largestValue", passed.largest_value)
        _set(program, "clipOffset", passed.clip_offset)
        self._set_sampler(program, "domeRadiance", self._domes.radiance, _RADIANCE_UNIT)
        gl.disable(gl.DEPTH_TEST | gl.CULL_FACE)
        array = gl.vertex_array(program, [])
        array.render(vertices=3)
        array.release()
        gl.enable(gl.DEPTH_TEST)

    def release(self) -> None:
        """Free everything."""
        self.end_view()
        self._domes.release()
        self.meshes.release()
        if self._albedo is not None:
            self._albedo.release()
        if self._textures is not None and hasattr(self._textures, "release"):
            self._textures.release()
        self.programs.release()


def _attributes(item: Item, position: str, attribute: str) -> dict[str, str]:
    names = {attribute: position, "inNormal": "normal"}
    names |= {"inDisplayColor": "displayColor", "inDisplayOpacity": "displayOpacity"}
    return names | {f"inSt{i}": f"st:{name}" for i, name in enumerate(item.surface.st_primvars)}


def _normal_matrix(to_world: np.ndarray) -> np.ndarray:
    """Inverse transpose up to a positive factor, (3, 3); defined for singular matrices too: the signed cofactors."""
    cofactors = np.cross(to_world[[1, 2, 0]], to_world[[2, 0, 1]])
    if np.linalg.det(to_world) < 0.0:
        cofactors = -cofactors
    # The factor keeps extreme scales within float32; 1e-300 guards a matrix of zeros.
    return cofactors / max(float(np.abs(cofactors).max()), 1e-300)


def _set(program: moderngl.Program, name: str, value: float | tuple[float, ...]) -> None:
    if program.get(name, None) is not None:
        program[name] = value


def _write(program: moderngl.Program, name: str, array: np.ndarray) -> None:
    """Row vectors' matrices and arrays of vectors, as the same bytes."""
    import moderngl

    uniform = program.get(name, None)
    if uniform is not None and array.size:
        assert isinstance(uniform, moderngl.Uniform)
        uniform.write(np.ascontiguousarray(array, np.float32).tobytes())
