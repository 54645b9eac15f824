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
