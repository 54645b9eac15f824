"""A ground as a stage: prims that every application opens, arrays that are stored once, cameras that show it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

import fexel
from fexel.textures import extract_texture
from fexel.validators import validate_file
from fexel_tools import fallback
from fexel_tools.umbrella_cameras import ground_cameras, world_point
from fexel_tools.umbrella_stage import LevelPrim, UmbrellaMap, create_stage, define_level
from fexel_tools.umbrella_textures import write_bases
from tests.authoring import ground

NAMES = ("Oak", "Ash", "Lime")
PLAIN = """
import json, sys
from pxr import Usd, UsdShade
stage = Usd.Stage.Open(sys.argv[1])
prim = stage.GetPrimAtPath("/World/Materials/Umbrella/Texture")
graph = UsdShade.NodeGraph(prim)
sources = graph.GetOutput("rgb").GetConnectedSources()[0]
print(json.dumps({
    "type": prim.GetPrimTypeInfo().GetSchemaTypeName(),
    "count": len(prim.GetAttribute("matrices").Get()),
    "source": UsdShade.Shader(sources[0].source.GetPrim()).GetShaderId(),
    "modules": [name for name in sys.modules if name.startswith("fexel")],
}))
"""


@pytest.fixture
def author(tmp_path):
    """Function (arrangement, extension, further maps) -> saved stage with textures and a baked-in fallback."""

    def make(arrangement, extension="usda", companions=()):
        folder = tmp_path / "ground_textures"
        folder.mkdir()
        files = write_bases(folder, NAMES, ground.textures(), [False] * 3).files
        maps = [UmbrellaMap("Texture", "diffuseColor", tuple(f"./{folder.name}/{file}" for file in files))]
        for name, drives in companions:
            raw = write_bases(folder, [f"{n}_{name}" for n in NAMES], ground.textures(), [False] * 3, is_data=True)
            relative = tuple(f"./{folder.name}/{file}" for file in raw.files)
            biased = drives == "normal"
            maps.append(UmbrellaMap(name, drives, relative, "raw", is_biased=biased, has_colors=False))
        stage = create_stage(tmp_path / f"ground.{extension}", folder, arrangement, NAMES, maps)
        for each in maps:
            picture = folder / f"fallback_{each.name}.png"
            fallback.write_picture(picture, np.ones((4, 8, 4), np.float32), each.color_space, "uint8")
            decoded = {"scale": (2.0, 2.0, 2.0, 1.0), "bias": (-1.0, -1.0, -1.0, 0.0)} if each.is_biased else {}
            prim = stage.GetPrimAtPath(each.path)
            fallback.author(prim, picture, color_space=each.color_space, **decoded)
        stage.GetRootLayer().Save()
        return stage

    return make


def texture(stage, name="Texture"):
    return stage.GetPrimAtPath(f"/World/Materials/Umbrella/{name}")


@pytest.mark.parametrize("extension", ["usda", "usdc", "usd"])
@pytest.mark.parametrize("count", [0, 1, 40, 900])
def test_arrangement_comes_back_as_it_was(author, extension, count):
    made = ground.arrangement(count)
    stage = author(made, extension)
    _, data = extract_texture(texture(stage), 1.0)
    read = data.arrangement
    assert len(read) == count and read.grid == made.grid
    assert np.array_equal(read.shape_of, made.shape_of)
    assert np.array_equal(read.matrices, made.matrices)
    assert np.allclose(read.morphs, made.morphs, atol=1e-7)
    assert np.array_equal(read.colors, made.colors)
    assert np.allclose(read.shadow_offset, made.shadow_offset) and read.shadow_strength == pytest.approx(0.4)
    assert all(shape.image.color_space == "sRGB" for shape in read.shapes)
    assert data.wrap == ("repeat", "repeat")


@pytest.mark.parametrize("extension", ["usda", "usdc"])
def test_validators_find_nothing(author, tmp_path, extension):
    author(ground.arrangement(900), extension, [("Normal", "normal"), ("Roughness", "roughness")])
    assert validate_file(str(tmp_path / f"ground.{extension}")) == []


def test_text_stays_small_and_arrays_lie_beside_it(author, tmp_path):
    author(ground.arrangement(2000))
    assert (tmp_path / "ground.usda").stat().st_size < 40_000
    assert (tmp_path / "ground_textures" / "arrangement.usdc").stat().st_size > 100_000


def test_few_umbrellas_are_readable_text(author, tmp_path):
    author(ground.arrangement(3))
    assert "int[] patchIndices" in (tmp_path / "ground.usda").read_text()
    assert not (tmp_path / "ground_textures" / "arrangement.usdc").exists()


def test_companion_maps_share_the_arrays(author, tmp_path):
    made = ground.arrangement(500)
    stage = author(made, "usdc", [("Normal", "normal"), ("Roughness", "roughness")])
    assert (tmp_path / "ground.usdc").stat().st_size < 40_000
    _, color = extract_texture(texture(stage), 1.0)
    for name in ("Normal", "Roughness"):
        _, data = extract_texture(texture(stage, name), 1.0)
        assert np.array_equal(data.arrangement.vertices, color.arrangement.vertices)
        assert not data.arrangement.colors.any(), "vertex colours are about colour"
        assert data.arrangement.shadow_strength == 0.0
        assert all(shape.image.color_space == "raw" for shape in data.arrangement.shapes)
    _, normal = extract_texture(texture(stage, "Normal"), 1.0)
    assert normal.turns_vectors
    surface = UsdShade.Shader(stage.GetPrimAtPath("/World/Materials/Umbrella/Surface"))
    driven = {i.GetBaseName(): i.GetConnectedSources()[0] for i in surface.GetInputs() if i.HasConnectedSource()}
    assert {name: (s[0].source.GetPath().name, s[0].sourceName) for name, s in driven.items()} == {
        "diffuseColor": ("Texture", "rgb"),
        "normal": ("Normal", "rgb"),
        "roughness": ("Roughness", "r"),
    }


@pytest.mark.parametrize("count", [3, 900])
def test_application_without_the_plugin_sees_the_fallback(author, tmp_path, count):
    author(ground.arrangement(count))
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PXR_PLUGINPATH", "PYTHONPATH"))}
    done = subprocess.run(
        [sys.executable, "-c", PLAIN, str(tmp_path / "ground.usda")],
        env=environment, capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout.splitlines()[-1])
    assert seen == {"type": "NodeGraph", "count": count, "source": "UsdUVTexture", "modules": []}


def test_cells_are_square_on_the_ground(author):
    stage = author(ground.arrangement(5, (12, 5)))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Surface"))
    points, st = np.array(mesh.GetPointsAttr().Get()), np.array(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get())
    assert np.allclose(points[st.argmax(axis=0)].max(axis=0) - points.min(axis=0), (12 / 5, 0, 1), atol=1e-6)
    assert np.allclose(points, world_point(st, (12, 5)), atol=1e-6)
    around = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Surroundings"))
    wide = np.array(UsdGeom.PrimvarsAPI(around).GetPrimvar("st").Get())
    corners = np.array(around.GetPointsAttr().Get())[np.array(around.GetFaceVertexIndicesAttr().Get())]
    assert np.allclose(corners, world_point(wide, (12, 5)), rtol=1e-5, atol=1e-5)


def test_levels_are_read_and_those_of_another_arrangement_are_not(author):
    from fexel.textures.umbrella import level_digest

    stage = author(ground.arrangement(30))
    _, data = extract_texture(texture(stage), 1.0)
    prim = fexel.UmbrellaTexture(texture(stage))
    define_level(prim, LevelPrim(1, (4, 2), level_digest(data), "./ground_textures/Oak.png"))
    _, read = extract_texture(texture(stage), 1.0)
    assert [level.level for level in read.levels] == [1]
    assert Path(read.levels[0].image.file).name == "Oak.png" and read.levels[0].image.color_space == "sRGB"
    prim.GetShadowStrengthAttr().Set(0.9)
    with pytest.warns(fexel.FexelWarning, match="Level1.*another arrangement"):
        _, stale = extract_texture(texture(stage), 1.0)
    assert stale.levels == ()


def test_merged_level_comes_back(author):
    made = ground.arrangement(30)
    merged = replace(made, colors=np.abs(made.colors), coverages=np.linspace(0.2, 1.0, 30), morphs=np.zeros(30))
    stage = author(made)
    define_level(fexel.UmbrellaTexture(texture(stage)), LevelPrim(1, (4, 2), "", arrangement=merged))
    _, read = extract_texture(texture(stage), 1.0)
    level = read.levels[0].arrangement
    assert np.allclose(level.vertices, merged.vertices, atol=1e-6)
    assert np.allclose(level.coverages, merged.coverages, atol=1e-6)
    assert np.allclose(level.colors, merged.colors)


def camera_frame(stage, name, time):
    camera = UsdGeom.Camera(stage.GetPrimAtPath(f"/World/Cameras/{name}")).GetCamera(time)
    return camera.transform, camera


def test_flight_goes_from_one_element_to_the_horizon(author):
    """It is the first camera; it looks down on an umbrella, rises from frame to frame, and ends with a horizon."""
    made = ground.arrangement(200, (32, 12))
    stage = author(made)
    cameras = [p.GetName() for p in stage.GetPrimAtPath("/World/Cameras").GetChildren()]
    assert cameras == ["Flight", "Overview", "Detail"]
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 48)
    heights, pitches = [], []
    for frame in range(1, 49):
        transform, camera = camera_frame(stage, "Flight", frame)
        view = transform.TransformDir(Gf.Vec3d(0, 0, -1))
        heights.append(transform.ExtractTranslation()[1])
        pitches.append(np.degrees(np.arcsin(-view[1])))
    assert np.allclose(np.diff(np.log(heights)), np.diff(np.log(heights))[0]), (
        "magnification changes at a constant rate"
    )
    assert (np.diff(heights) > 0).all() and (np.diff(pitches) < 0).all()
    half_height = np.degrees(np.arctan(0.5 * camera.verticalAperture / camera.focalLength))
    assert pitches[-1] < half_height < pitches[0]
    transform, _ = camera_frame(stage, "Flight", 1)
    eye, view = np.array(transform.ExtractTranslation()), np.array(transform.TransformDir(Gf.Vec3d(0, 0, -1)))
    hit = eye - view * eye[1] / view[1]
    centres = world_point(made.matrices[:, 2, :2], made.grid)
    assert np.linalg.norm(centres - hit, axis=1).min() < 0.3 / 12, "the first frame looks at an umbrella"


@pytest.mark.parametrize("count", [0, 1, 7])
@pytest.mark.parametrize("grid", [(1, 1), (1, 40), (300, 2)])
def test_cameras_of_odd_grounds_are_finite(count, grid):
    for poses in ground_cameras(ground.arrangement(count, grid)).values():
        for _, matrix, distance in poses:
            assert np.isfinite(np.array(matrix)).all() and np.isfinite(distance) and distance > 0


def test_asset_paths_are_relative(author):
    stage = author(ground.arrangement(900))
    paths = [
        value.path
        for prim in stage.Traverse()
        for attribute in prim.GetAttributes()
        if isinstance(value := attribute.Get(), Sdf.AssetPath)
    ]
    assert len(paths) == 4 and all(path.startswith("./ground_textures/") for path in paths)


def test_transparent_background_reaches_the_surface(tmp_path):
    folder = tmp_path / "t"
    folder.mkdir()
    each = UmbrellaMap("Texture", "diffuseColor", ("./a.png",) * 3, background_color=(0.0, 0.0, 0.0, 0.0))
    stage = create_stage(tmp_path / "a.usda", folder, ground.arrangement(4), NAMES, [each])
    surface = UsdShade.Shader(stage.GetPrimAtPath("/World/Materials/Umbrella/Surface"))
    assert surface.GetInput("opacity").GetConnectedSources()[0][0].sourceName == "a"
    assert Usd.Stage.Open(stage.GetRootLayer())
