"""Stages open in stock usd-core: without our plugin every texture of fexel is a NodeGraph with a colour."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from pxr import Usd

import fexel
from fexel_tools.minify import MinifyOptions, minify

REPOSITORY = Path(__file__).resolve().parents[2]
STAGES = sorted(p for p in (REPOSITORY / "stages").glob("*/*.usd*") if p.stem == p.parent.name)
IDS = [path.stem for path in STAGES]


def probe_without_plugin(stage: Path) -> dict:
    """Report of `plain_usd_probe` from a process that has neither fexel nor its schema."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PXR_PLUGINPATH", "PYTHONPATH"))}
    script = Path(__file__).with_name("plain_usd_probe.py")
    done = subprocess.run(
        [sys.executable, str(script), str(stage)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def check_interchange(report: dict, *, has_textures: bool = True) -> None:
    assert report["modules"] == [], "the probe must run without fexel"
    assert bool(report["textures"]) is has_textures
    for path, texture in report["textures"].items():
        assert texture == {"schema": "NodeGraph", "is_node_graph": True}, path
    sources = [(path, name, source) for path, m in report["materials"].items() for name, source in m["inputs"].items()]
    assert sources, "no material has a textured input"
    for path, part in report["parts"].items():
        assert all(Path(file).is_file() for file in part["files"]), path
    for path, name, source in sources:
        where = f"{path}.{name}"
        assert source["id"] == "UsdUVTexture", where
        assert source["st_reader"] == "UsdPrimvarReader_float2", where
        assert not os.path.isabs(source["authored"]), where
        assert Path(source["resolved"]).is_file(), where
    assert report["validation"] == []


def test_hand_written_stage_opens_as_node_graph_with_a_resolvable_colour(
    hand_written_stage,
):
    report = probe_without_plugin(hand_written_stage)
    check_interchange(report)
    source = report["materials"]["/World/Looks/Photo"]["inputs"]["diffuseColor"]
    assert Path(source["resolved"]) == hand_written_stage.parent / "textures" / "fallback.png"


def test_umbrellas_open_as_node_graph_and_their_arrays_are_read(hand_written_ground):
    """Patches and levels are prims of types that nobody knows; what they hold is there all the same."""
    report = probe_without_plugin(hand_written_ground)
    check_interchange(report)
    texture = "/World/Looks/Leaves/Umbrellas"
    arrays = {path.removeprefix(f"{texture}/"): part["arrays"] for path, part in report["parts"].items()}
    assert arrays[texture] == {"patchIndices": 3, "matrices": 3, "morphs": 3, "colors": 14}
    assert arrays["Square"] == {"points": 5, "morphPoints": 5, "texCoords": 5}
    assert arrays["Triangle"] == {"points": 4, "texCoords": 4}
    assert arrays["Merged"]["points"] == 4
    assert arrays["Image"] == {}


@pytest.mark.parametrize("stage", STAGES, ids=IDS)
def test_minified_stage_opens_as_before(stage, tmp_path):
    """A schema that nobody knows is applied to its textures: nothing is said of it, and all else is as it was."""
    minify(stage, tmp_path / "out.usda", MinifyOptions("fipmap", 0.9, 0.05, 50.0, (0.5, 0.6, 0.7)))
    report, before = probe_without_plugin(tmp_path / "out.usda"), probe_without_plugin(stage)
    check_interchange(report, has_textures=has_textures(stage))
    assert report["materials"] == before["materials"]
    assert report["textures"] == before["textures"]


def test_umbrellas_read_the_same_with_the_plugin(hand_written_ground):
    """The other reading: as typed prims, without a finding of any validator."""
    stage = Usd.Stage.Open(str(hand_written_ground))
    umbrella = fexel.UmbrellaTexture.Get(stage, "/World/Looks/Leaves/Umbrellas")
    assert [patch.GetPrim().GetName() for patch in umbrella.GetPatches()] == ["Square", "Triangle"]
    assert [level.GetLevelAttr().Get() for level in umbrella.GetLevels()] == [1, 2]
    assert [str(finding) for finding in fexel.validate(stage)] == []


@pytest.mark.parametrize("stage", STAGES, ids=IDS)
def test_example_stage_opens_as_node_graph_with_a_resolvable_colour(stage):
    check_interchange(probe_without_plugin(stage), has_textures=has_textures(stage))


def has_textures(stage: Path) -> bool:
    """Whether a stage has textures of fexel, not plain ones with a filter."""
    return not stage.stem.startswith("fipmap_")


def test_stage_moves_to_another_folder_with_its_textures(hand_written_stage, tmp_path):
    moved = tmp_path / "elsewhere" / "moved"
    moved.parent.mkdir()
    hand_written_stage.parent.rename(moved)
    check_interchange(probe_without_plugin(moved / hand_written_stage.name))


def test_without_fallback_types_the_colour_does_not_resolve(hand_written_stage):
    """The counterpart: it is ``fallbackPrimTypes`` that makes the texture a NodeGraph, not luck."""
    text = hand_written_stage.read_text(encoding="utf-8")
    assert 'token[] ZipmapTexture = ["NodeGraph"]' in text
    hand_written_stage.write_text(text.replace('token[] ZipmapTexture = ["NodeGraph"]', ""), encoding="utf-8")
    report = probe_without_plugin(hand_written_stage)
    assert report["textures"]["/World/Looks/Photo/Zipmap"] == {"schema": "", "is_node_graph": False}
    assert report["materials"]["/World/Looks/Photo"]["inputs"]["diffuseColor"]["id"] != "UsdUVTexture"
