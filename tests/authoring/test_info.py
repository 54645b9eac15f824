"""`fexel info` against sizes that are known."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdShade
from typer.testing import CliRunner

import fexel
from fexel.errors import FexelError
from fexel_tools.cli import app
from fexel_tools.inspect import inspect_stage
from tests.authoring.synthetic_photos import write_image


@pytest.fixture
def stage_file(tmp_path):
    write_image(tmp_path / "root.png", np.zeros((64, 128, 3), np.uint8))
    write_image(tmp_path / "fine.png", np.zeros((100, 100, 3), np.uint16))
    stage = Usd.Stage.CreateNew(str(tmp_path / "s.usda"))
    for path, file, scale in (
        ("/Wall", "root.png", None),
        ("/Wall/A", "fine.png", (4.0, 8.0)),
        ("/Wall/A/Deep", "fine.png", (2.0, 2.0)),
        ("/Wall/B", "gone.png", (2.0, 2.0)),
        ("/Wall/C", "root.png", (0.0, 0.0)),
    ):
        texture = fexel.ZipmapTexture.Define(stage, path)
        texture.CreateFileAttr(Sdf.AssetPath(f"./{file}"))
        if scale:
            texture.CreateMatrixAttr(Gf.Matrix3d(scale[0], 0, 0, 0, scale[1], 0, -0.5, -0.25, 1))
    stage.Save()
    return tmp_path / "s.usda"


def mip_texels(width, height):
    total = width * height
    while (width, height) != (1, 1):
        width, height = max(1, width // 2), max(1, height // 2)
        total += width * height
    return total


def test_sizes_nesting_and_gain(stage_file):
    (texture,) = inspect_stage(stage_file)
    entries = {p.path: p for p in texture.patches}
    assert [p.depth for p in texture.patches] == [0, 1, 2, 1, 1]
    a = entries["/Wall/A"]
    assert (a.width, a.height) == (100, 100)
    # 100 texels over a quarter of 128, and over an eighth of 64: 3.125 and 12.5 times as fine.
    assert a.gain == pytest.approx(np.sqrt(3.125 * 12.5))
    assert entries["/Wall/A/Deep"].gain == pytest.approx(2 * a.gain)
    assert texture.largest_gain == pytest.approx(2 * a.gain)
    assert a.bytes_resident == 8 * mip_texels(100, 100)
    assert entries["/Wall"].bytes_resident == 4 * mip_texels(128, 64)


def test_bytes_count_each_file_once(stage_file):
    (texture,) = inspect_stage(stage_file)
    folder = stage_file.parent
    assert texture.bytes_on_disk == sum((folder / f).stat().st_size for f in ("root.png", "fine.png"))
    assert texture.bytes_resident == 8 * mip_texels(100, 100) + 4 * mip_texels(128, 64)


def test_missing_file_and_singular_matrix_are_marked(stage_file):
    (texture,) = inspect_stage(stage_file)
    entries = {p.path: p for p in texture.patches}
    assert entries["/Wall/B"].problem == "missing"
    assert entries["/Wall/B"].width is None
    assert entries["/Wall/C"].gain is None
    assert texture.fallback == ""


def test_command_prints_plain_lines_on_a_pipe(stage_file):
    result = CliRunner().invoke(app, ["info", str(stage_file)])
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert "\x1b" not in result.output
    assert any("100 x 100" in line and "./fine.png" in line for line in lines)
    assert any("./gone.png  (missing)" in line for line in lines)
    assert lines[-1].startswith("4 patches, nested 2 deep")


def test_command_prints_json(stage_file):
    result = CliRunner().invoke(app, ["info", "--json", str(stage_file)])
    (texture,) = json.loads(result.output)
    assert [p["file"] for p in texture["patches"]][:2] == ["./root.png", "./fine.png"]


def test_pinchmap_is_shown_with_its_map_alone_or_as_a_patch(stage_file):
    folder = stage_file.parent
    write_image(folder / "map.png", np.full((8, 16, 4), 127, np.uint8))
    stage = Usd.Stage.Open(str(stage_file))
    for path in ("/Wall/Logo", "/Sign"):
        pinchmap = fexel.PinchmapTexture.Define(stage, path)
        pinchmap.CreateFileAttr("./root.png")
        pinchmap.CreatePinchmapAttr("./map.png")
    stage.Save()
    wall, sign = inspect_stage(stage_file)
    assert [patch.path for patch in sign.patches] == ["/Sign"]
    assert wall.patches[-1].others == sign.patches[0].others == {"pinchmap": (16, 8)}
    assert sign.bytes_on_disk == sum((folder / f).stat().st_size for f in ("root.png", "map.png"))
    output = CliRunner().invoke(app, ["info", str(stage_file)]).output
    assert output.count("./root.png + pinchmap 16 x 8") == 2


def test_files_of_children_that_are_no_textures_count_and_missing_ones_are_named(tmp_path):
    """Umbrellas name their files by their bases and levels; the network of the fallback is not theirs."""
    write_image(tmp_path / "leaf.png", np.zeros((8, 16, 4), np.uint8))
    stage = Usd.Stage.CreateNew(str(tmp_path / "tree.usda"))
    stage.DefinePrim("/Tree", "UmbrellaTexture")
    for path, kind, name in (
        ("/Tree/leaf", "UmbrellaPatch", "./leaf.png"),
        ("/Tree/coarse", "UmbrellaLevel", "./gone.png"),
    ):
        stage.DefinePrim(path, kind).GetAttribute("file").Set(name)
    reader = UsdShade.Shader.Define(stage, "/Tree/Fallback")
    reader.CreateInput("file", Sdf.ValueTypeNames.Asset).Set("./other.png")
    nested = fexel.PinchmapTexture.Define(stage, "/Tree/nested")
    nested.CreateFileAttr("./nested.png")
    stage.Save()
    (tree,) = inspect_stage(stage)
    assert tree.patches[0].others == {"leaf.file": (16, 8), "coarse.file": None}
    assert tree.patches[0].problem == "coarse.file ./gone.png: missing"
    assert tree.bytes_on_disk == (tmp_path / "leaf.png").stat().st_size
    assert tree.bytes_resident == 4 * mip_texels(16, 8)


def test_stage_without_texture_says_so_and_a_missing_one_is_an_error(tmp_path):
    Usd.Stage.CreateNew(str(tmp_path / "bare.usda")).Save()
    assert "no fexel texture" in CliRunner().invoke(app, ["info", str(tmp_path / "bare.usda")]).output
    with pytest.raises(FexelError, match="no such file"):
        inspect_stage(tmp_path / "gone.usda")


@pytest.fixture
def umbrella_file(tmp_path):
    for name, size in (("a", (16, 20)), ("b", (30, 12)), ("far", (8, 8))):
        write_image(tmp_path / f"{name}.png", np.zeros((size[1], size[0], 3), np.uint8))
    stage = Usd.Stage.CreateNew(str(tmp_path / "u.usda"))
    texture = fexel.UmbrellaTexture.Define(stage, "/Lawn")
    texture.CreateGridAttr(Gf.Vec2i(6, 4))
    texture.CreatePatchIndicesAttr([0, 1, 2, 1, 0])
    for name, file, count in (("A", "a", 5), ("B", "b", 7), ("C", "a", 4)):
        patch = fexel.UmbrellaPatch.Define(stage, f"/Lawn/{name}")
        patch.CreateFileAttr(Sdf.AssetPath(f"./{file}.png"))
        patch.CreatePointsAttr([Gf.Vec2f(k, k * k) for k in range(count)])
    for number, file, indices in ((2, "far.png", []), (1, "", [-1, -1, -1])):
        level = fexel.UmbrellaLevel.Define(stage, f"/Lawn/Level{number}")
        level.CreateLevelAttr(number)
        level.CreateGridAttr(Gf.Vec2i(6 >> number, 4 >> number))
        level.CreatePatchIndicesAttr(indices)
        if file:
            level.CreateFileAttr(Sdf.AssetPath(f"./{file}"))
    stage.Save()
    return tmp_path / "u.usda"


def test_umbrellas_are_counted_and_files_of_their_parts_summed_up(umbrella_file):
    (texture,) = inspect_stage(umbrella_file)
    (lawn,) = texture.patches
    assert lawn.facts == {
        "umbrellas": 5,
        "bases": 3,
        "vertices": 7,
        "grid": [6, 4],
        "levels": [
            {"level": 1, "grid": [3, 2], "umbrellas": 3},
            {"level": 2, "grid": [1, 1], "umbrellas": None},
        ],
    }
    parts = {part.type: part for part in lawn.parts}
    bases = parts["UmbrellaPatch"]
    assert (bases.files, bases.smallest, bases.largest) == (2, (16, 20), (30, 12))
    assert bases.bytes_resident == 4 * (mip_texels(16, 20) + mip_texels(30, 12))
    assert parts["UmbrellaLevel"].largest == (8, 8)
    assert lawn.bytes_on_disk >= texture.bytes_on_disk == sum(part.bytes_on_disk for part in lawn.parts)


def test_lines_about_umbrellas_are_short(umbrella_file):
    result = CliRunner().invoke(app, ["info", str(umbrella_file)])
    assert result.exit_code == 0, result.output
    _, row, facts, summary = result.output.splitlines()
    assert "2 files of UmbrellaPatch, 16 x 20 to 30 x 12" in row and len(row) < 200
    assert "5 umbrellas of 3 bases with up to 7 vertices, grid 6 x 4" in facts
    assert "1 (3 umbrellas, grid 3 x 2), 2 (image, grid 1 x 1)" in facts
    assert "patches" not in summary and "on disk" in summary
    (described,) = json.loads(CliRunner().invoke(app, ["info", "--json", str(umbrella_file)]).output)
    assert described["patches"][0]["facts"]["umbrellas"] == 5


def test_umbrellas_with_nothing_authored_are_told_without_a_crash(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "e.usda"))
    fexel.UmbrellaTexture.Define(stage, "/Empty")
    fexel.UmbrellaLevel.Define(stage, "/Empty/Level1")
    (texture,) = inspect_stage(stage)
    assert "0 umbrellas of 0 bases" in texture.patches[0].description
