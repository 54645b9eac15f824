"""A kind that the renderer has never heard of: its slice and its name are enough, alone, nested and beside others."""

import shutil
import sys
import types
from dataclasses import dataclass

import numpy as np
import pytest
from pxr import Gf

from bench.zipmap_stage import Patch, front_view, quad, save, vertex_array, zipmap_stage, zipmap_texture
from fexel import homography, textures
from fexel._resources import shaders_dir
from fexel.renderer.program import ProgramCache
from fexel.renderer.visible import visible_surface
from fexel.textures import binding as binding_module
from fexel.textures.binding import TextureBinding
from fexel.textures.kind import Part, Slot
from fexel.textures.system import TextureRequest, TextureSystem

SHADER = """
#include "texture_data.glsl"
uniform ivec4 checkerRecord[CHECKER_SLOTS];

vec4 checker_nested(int record, vec2 st, vec2 dstdx, vec2 dstdy, out float lod)
{
    vec3 position = vec3(st, 1.0);
    vec3 mapped = vec3(dot(record_fetch(record).xyz, position), dot(record_fetch(record + 1).xyz, position),
                       dot(record_fetch(record + 2).xyz, position));
    vec2 uv = mapped.xy / mapped.z;
    lod = 7.0;
    float odd = mod(floor(4.0 * uv.x) + floor(4.0 * uv.y), 2.0);
    return vec4(odd, odd, odd, 1.0);
}

vec4 checker_sample(int number, vec2 st, vec2 dstdx, vec2 dstdy, out float lod, out float patchIndex)
{
    patchIndex = 0.0;
    return checker_nested(checkerRecord[number].x, st, dstdx, dstdy, lod);
}
"""


@dataclass(frozen=True)
class Checker:
    """Data of the kind."""

    nested: bool


class CheckerPlan:
    layers_total = 1

    def __init__(self, sight):
        self._sight = sight
        self.layers_seen = (sight.path,)

    def write(self, pool):
        matrix = homography.normalize(self._sight.local_to_st[None])[0]
        record = pool.records.append(np.column_stack([matrix.T, np.zeros(3)]))
        return Slot(kind="checker", page_classes=frozenset(), record=record)


def bind(slots, nested, room, pool):
    assert room >= 0
    assert pool is not None
    records = np.array([(slot.record, 0, 0, 0) for slot in slots or nested])
    return Part({"CHECKER_SLOTS": len(records)}, {"checkerRecord": records}, records=True)


@pytest.fixture
def programs(gl, tmp_path, monkeypatch):
    """Programs of a folder that has the kind's shader too; the kind is registered and reads UmbrellaTexture prims."""
    folder = tmp_path / "shaders"
    shutil.copytree(shaders_dir(), folder)
    (folder / "checker.glsl").write_text(SHADER)
    half, gpu = types.ModuleType("fexel.textures.checker"), types.ModuleType("fexel.textures.checker_gpu")
    half.__dict__.update(PRIM_TYPES=("UmbrellaTexture",), extract=lambda prim, time, nested=False: Checker(nested))
    gpu.__dict__.update(plan=lambda data, sight, pool: CheckerPlan(sight), bind=bind)
    monkeypatch.setitem(sys.modules, "fexel.textures.checker", half)
    monkeypatch.setitem(sys.modules, "fexel.textures.checker_gpu", gpu)
    monkeypatch.setattr(textures, "_KINDS", (*textures._KINDS, "checker"))
    textures._kind_of_type.cache_clear()
    yield ProgramCache(gl, folder)
    textures._kind_of_type.cache_clear()


def picture(gl, programs, system, requests, number, view):
    """(H, W, 8): one of the textures of a material and its data AOVs."""
    binding = system.binding(requests)
    kind = requests[number].texture.kind
    defines = {"TEXTURE_SAMPLE": f"{kind}_sample", "TEXTURE_NUMBER": binding.defines[f"TEXTURE{number}_NUMBER"]}
    program = programs.get(
        "texture_view.vert", "texture_view.frag", binding.defines | defines | {"TEXTURE_AOVS": 1}, binding.includes
    )
    targets = [gl.texture((view.width, view.height), 4, dtype="f4") for _ in range(2)]
    framebuffer = gl.framebuffer(targets)
    framebuffer.use()
    framebuffer.clear()
    binding.apply(program)
    vertex_array(gl, program, quad(), requests[number].surface, view).render()
    shape = (view.height, view.width, 4)
    result = [np.frombuffer(target.read(), np.float32).reshape(shape)[::-1] for target in targets]
    gl.detect_framebuffer(0).use()
    for item in (framebuffer, *targets):
        item.release()
    return np.concatenate(result, axis=-1)


def checker(st):
    return np.floor(4 * st).sum(axis=-1) % 2


def test_kind_of_its_own_renders_alone_in_a_zipmap_and_beside_others(gl, tmp_path, programs):
    base = save(tmp_path / "base.tif", np.full((32, 32, 4), [0, 0.5, 0, 1], np.float32))
    stage = zipmap_stage(Patch(base, np.eye(3), color_space="raw"))
    matrix = np.array([[2.0, 0, 0], [0, 2.0, 0], [-0.5, -0.5, 1]])
    stage.DefinePrim("/Alone", "UmbrellaTexture")
    nested = stage.DefinePrim("/Zipmap/nested", "UmbrellaTexture")
    nested.GetAttribute("inputs:matrix").Set(Gf.Matrix3d(*matrix.ravel().tolist()))
    view = front_view((0, 0), (1, 1), 64, 64)
    surface = visible_surface(quad(), view, ["st"])
    alone, zipmap = zipmap_texture(stage, "/Alone"), zipmap_texture(stage)
    assert (alone.kind, alone.data.nested) == ("checker", False)
    (entry,) = zipmap.data.nested
    assert (entry.kind, entry.data.nested) == ("checker", True)
    system = TextureSystem(gl)
    requests = [TextureRequest(texture, surface) for texture in (zipmap, alone)]
    system.begin_view(requests)
    x, y = np.meshgrid(np.arange(64) + 0.5, 63.5 - np.arange(64))
    st = np.stack([x, y], -1) / 64
    shown = picture(gl, programs, system, requests, 1, view)
    assert (shown[..., 0] == checker(st)).all()
    assert (shown[..., 4] == 7).all()
    both = picture(gl, programs, system, requests, 0, view)
    inside = ((st > 0.25) & (st < 0.75)).all(axis=-1)
    assert (both[inside][..., 0] == checker(2 * st - 0.5)[inside]).all()
    assert (both[inside][..., 5] == 1).all()
    assert np.abs(both[~inside][..., :4] - [0, 0.5, 0, 1]).max() < 3e-3
    assert system.stats()["patches_total"] == 3
    only = [TextureRequest(alone, surface)]
    system.begin_view(only)
    assert (picture(gl, programs, system, only, 0, view)[..., 0] == checker(st)).all()
    system.release()


def test_kinds_unite_what_they_need_of_a_shared_shader(monkeypatch):
    """Whichever comes last, images are looked up in all page classes and levels that any kind has."""
    shared = {
        "zipmap": {"IMAGE_LEVELS": 2, "IMAGE_SRGB": 1, "IMAGE_HALF": 0},
        "umbrella": {"IMAGE_LEVELS": 1, "IMAGE_HALF": 1},
    }
    parts = {kind: Part({f"{kind.upper()}_SLOTS": 1}, shared=defines) for kind, defines in shared.items()}
    halves = {kind: types.SimpleNamespace(bind=lambda *_, part=part: part) for kind, part in parts.items()}
    monkeypatch.setattr(binding_module, "gpu_half", halves.__getitem__)
    slots = [Slot(kind=kind, page_classes=frozenset(), record=0) for kind in shared]
    defines = TextureBinding(slots, types.SimpleNamespace(), 8).defines
    assert {"IMAGE_LEVELS": 2, "IMAGE_SRGB": 1, "IMAGE_HALF": 1, "ZIPMAP_SLOTS": 1}.items() <= defines.items()
