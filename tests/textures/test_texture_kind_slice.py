"""A kind with data of its own in a page, an image and a constant; its name alone brings it everywhere that kinds are.

As umbrellas will: a table of numbers that no file holds is read by the kind's own `TexelReader` into a float page, and
multiplies an image. Rendered alone and in a zipmap; baked; described; validated; demonstrated.
"""

import importlib.machinery
import shutil
import sys
import types
from dataclasses import dataclass

import numpy as np
import pytest
from pxr import Gf, Sdf

import fexel
from bench.zipmap_stage import Patch, front_view, quad, save, zipmap_stage, zipmap_texture
from fexel import homography, textures
from fexel._resources import shaders_dir
from fexel.renderer.program import ProgramCache
from fexel.renderer.visible import visible_surface
from fexel.textures.image_source import ImageSource, image_source
from fexel.textures.inputs import Inputs
from fexel.textures.kind import Part, Slot
from fexel.textures.page_format import FLOAT
from fexel.textures.pyramid_cache import ImageFacts
from fexel.textures.system import TextureRequest, TextureSystem
from fexel_tools import demo
from fexel_tools.baking import Storage
from fexel_tools.fallback import bake
from fexel_tools.inspect import inspect_stage
from tests.textures.test_texture_kinds import picture

SHADER = """
#include "texture_data.glsl"
uniform ivec4 leafyRecord[LEAFY_SLOTS];

vec4 leafy_nested(int record, vec2 st, vec2 dstdx, vec2 dstdy, out float lod)
{
    vec3 position = vec3(st, 1.0);
    vec3 mapped = vec3(dot(record_fetch(record).xyz, position), dot(record_fetch(record + 1).xyz, position),
                       dot(record_fetch(record + 2).xyz, position));
    vec2 uv = mapped.xy / mapped.z;
    ivec2 first = ivec2(record_fetch(record + 3).xy);
    vec4 place = record_fetch(record + 4);
    lod = 0.0;
    float factor = texelFetch(pagesFloat, first + ivec2(clamp(floor(8.0 * uv), 0.0, 7.0)), 0).x;
    return vec4(factor * textureLod(pagesHalf, 32.0 * vec2(uv.x, 1.0 - uv.y) * place.xy + place.zw, 0.0).rgb, 1.0);
}

vec4 leafy_sample(int number, vec2 st, vec2 dstdx, vec2 dstdy, out float lod, out float patchIndex)
{
    patchIndex = 0.0;
    vec4 color = leafy_nested(leafyRecord[number].x, st, dstdx, dstdy, lod);
#if LEAFY_TOP
    color.rgb *= textureFlat[LEAFY_FLAT + number].x;
#endif
    return color;
}
"""

TABLE = np.zeros((8, 8, 4), np.float32)
TABLE[..., 0] = np.arange(64).reshape(8, 8) / 64  # row 0 lowest
CONSTANT = 0.75
BASE = np.array([0.5, 0.25, 1.0])


@dataclass(frozen=True)
class Leafy:
    """Data of the kind."""

    image: ImageSource


class TableReader:
    """The kind's own texels, which are in no file."""

    reads = 0

    def __init__(self, _kept):
        TableReader.reads = 0

    def facts(self, source, path):
        return ImageFacts((8, 8), FLOAT, ("clamp", "clamp"), None, has_levels=False)

    def window(self, source, path, level, box):
        TableReader.reads += 1
        x0, y0, x1, y1 = box
        return np.ascontiguousarray(np.pad(TABLE, ((1, 1), (1, 1), (0, 0)), mode="edge")[y0 : y1 + 2, x0 : x1 + 2])


class LeafyPlan:
    layers_total = 1

    def __init__(self, data, sight, pool):
        self._sight = sight
        self.layers_seen = (sight.path,)
        self._table = pool.image(("table",), sight.path, pool.reader(TableReader))
        self._image = pool.image(data.image, sight.path)
        for number in (self._table, self._image):
            pool.ask(np.array([number]), (np.array([0]), np.array([0])), (np.zeros((1, 2)), np.ones((1, 2))))

    def write(self, pool):
        matrix = homography.normalize(self._sight.local_to_st[None])[0]
        first = np.rint(pool.places[self._table, 0][2:] * np.array(pool.atlases[FLOAT].size))
        rows = np.column_stack([matrix.T, np.zeros(3)])
        record = pool.records.append(np.concatenate([rows, [[*first, 0, 0]], [pool.places[self._image, 0]]]))
        classes = frozenset({int(FLOAT), int(pool.page_class[self._image])})
        return Slot(kind="leafy", page_classes=classes, record=record)


def bind(slots, nested, room, pool):
    records = np.array([(slot.record, 0, 0, 0) for slot in slots or nested])
    defines = {"LEAFY_SLOTS": len(records), "LEAFY_TOP": len(slots)}
    constants = np.full((len(slots), 4), CONSTANT)
    return Part(defines, {"leafyRecord": records}, constants=constants, records=True)


class LeafyBaker:
    storage = Storage("raw", "half")
    texels = (8, 8)

    def size(self, largest):
        return largest, largest

    def bake(self, width, height):
        x, y = np.meshgrid((np.arange(width) + 0.5) / width, 1 - (np.arange(height) + 0.5) / height)
        return expected(np.stack([x, y], -1))

    def sample(self, st, jacobian):
        return expected(st)


def expected(st):
    cell = np.clip(np.floor(8 * st).astype(int), 0, 7)
    factor = TABLE[cell[..., 1], cell[..., 0], :1]
    return np.concatenate([factor * BASE, np.ones_like(factor)], -1).astype(np.float32)


def module(name, **contents):
    made = types.ModuleType(name)
    made.__dict__.update(contents, __spec__=importlib.machinery.ModuleSpec(name, None))
    return made


@pytest.fixture
def leafy(monkeypatch):
    """The kind's modules, by their names alone; it reads UmbrellaTexture prims."""
    parts = (
        module(
            "fexel.textures.leafy",
            PRIM_TYPES=("UmbrellaTexture",),
            extract=lambda prim, time, nested=False: Leafy(image_source(Inputs(prim, time), False)),
        ),
        module("fexel.textures.leafy_gpu", plan=LeafyPlan, bind=bind),
        module("fexel_tools.leafy_baking", baker=lambda data, path: LeafyBaker()),
        module("fexel_tools.demo_leafy", ABOUT="leaves", run=lambda options: "nothing"),
    )
    for part in parts:
        monkeypatch.setitem(sys.modules, part.__name__, part)
    monkeypatch.setattr(textures, "_KINDS", (*textures._KINDS, "leafy"))
    textures._kind_of_type.cache_clear()
    yield
    textures._kind_of_type.cache_clear()


@pytest.fixture
def stage(tmp_path, leafy):
    """One alone, one that is the lower left quarter of a zipmap."""
    base = save(tmp_path / "base.tif", np.full((32, 32, 4), [*BASE, 1], np.float32))
    stage = zipmap_stage(Patch(base, np.eye(3), color_space="raw"))
    for path, scale in (("/Alone", 1.0), ("/Zipmap/leaves", 2.0)):
        prim = stage.DefinePrim(path, "UmbrellaTexture")
        prim.GetAttribute("inputs:file").Set(Sdf.AssetPath(str(base)))
        prim.GetAttribute("inputs:sourceColorSpace").Set("raw")
        for name in ("inputs:wrapS", "inputs:wrapT"):
            prim.GetAttribute(name).Set("clamp")
        prim.GetAttribute("inputs:matrix").Set(Gf.Matrix3d(scale, 0, 0, 0, scale, 0, 0, 0, 1))
    return stage


def test_kind_with_a_page_an_image_and_a_constant_renders_alone_and_nested(gl, tmp_path, stage):
    folder = tmp_path / "shaders"
    shutil.copytree(shaders_dir(), folder)
    (folder / "leafy.glsl").write_text(SHADER)
    view = front_view((0, 0), (1, 1), 64, 64)
    surface = visible_surface(quad(), view, ["st"])
    system = TextureSystem(gl)
    programs = ProgramCache(gl, folder)
    requests = [TextureRequest(zipmap_texture(stage, path), surface) for path in ("/Zipmap", "/Alone")]
    system.begin_view(requests)
    x, y = np.meshgrid(np.arange(64) + 0.5, 63.5 - np.arange(64))
    st = np.stack([x, y], -1) / 64
    alone = picture(gl, programs, system, requests, 1, view)[..., :3]
    np.testing.assert_allclose(alone, CONSTANT * expected(st)[..., :3], atol=2e-3)
    nested = picture(gl, programs, system, requests, 0, view)[..., :3]
    inside = (st < 0.5).all(-1)
    np.testing.assert_allclose(nested[inside], expected(2 * st)[inside][:, :3], atol=2e-3)
    away = (st > 0.55).any(-1)
    np.testing.assert_allclose(nested[away], np.broadcast_to(BASE, nested[away].shape), atol=3e-3)
    system.begin_view(requests)
    assert TableReader.reads == 1, "static data is read once, and not again for the next tile"
    system.release()


def test_kind_is_baked_alone_and_as_a_patch_of_a_zipmap(stage):
    alone = bake(stage.GetPrimAtPath("/Alone"), 32)
    x, y = np.meshgrid((np.arange(32) + 0.5) / 32, 1 - (np.arange(32) + 0.5) / 32)
    st = np.stack([x, y], -1)
    np.testing.assert_allclose(alone, expected(st), atol=1e-6)
    zipmap = bake(stage.GetPrimAtPath("/Zipmap"), 32)
    rows, columns = zipmap.shape[:2]
    quarter = zipmap[rows // 2 + 2 :, : columns // 2 - 2]
    assert np.ptp(quarter[..., 0]) > 0.3
    np.testing.assert_allclose(zipmap[: rows // 2 - 2, :, 0], BASE[0], atol=3e-3)


def test_kind_is_described_and_validated(stage):
    described = {texture.path: texture for texture in inspect_stage(stage)}
    assert described["/Alone"].patches[0].width == 32
    assert [patch.path for patch in described["/Zipmap"].patches] == ["/Zipmap", "/Zipmap/leaves"]
    leaf = stage.DefinePrim("/Alone/leaf", "UmbrellaPatch")
    leaf.GetAttribute("file").Set(Sdf.AssetPath("./gone.png"))
    (alone,) = [texture for texture in inspect_stage(stage) if texture.path == "/Alone"]
    assert alone.patches[0].problem == "leaf.file ./gone.png: missing"
    missing = [finding.path for finding in fexel.validate(stage) if finding.validator == "fexel:Files"]
    assert missing == ["/Alone/leaf"]


def test_kind_takes_part_in_the_demonstration(leafy):
    assert list(demo.parts()) == ["zipmap", "pinchmap", "umbrella", "leafy", "fipmap"]
    assert textures.kinds()[textures.kind_number("leafy")] == "leafy"
