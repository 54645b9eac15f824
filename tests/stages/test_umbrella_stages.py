"""The umbrella example stages show what their READMEs promise: grounds that never repeat, sharp close up, calm afar."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdShade

import fexel

FOLDER = Path(__file__).resolve().parents[2] / "stages"
NAMES = ("umbrella_citrus", "umbrella_flowers", "umbrella_leaves", "umbrella_sweets")


def open_stage(name: str) -> Usd.Stage:
    return Usd.Stage.Open(str(FOLDER / name / f"{name}.usda"))


def umbrella(stage: Usd.Stage) -> fexel.UmbrellaTexture:
    (prim,) = [prim for prim in stage.Traverse() if prim.GetTypeName() == "UmbrellaTexture"]
    return fexel.UmbrellaTexture(prim)


@pytest.fixture(scope="module")
def renderer():
    with fexel.Renderer() as renderer:
        yield renderer


def render(renderer: fexel.Renderer, stage: Usd.Stage, camera: str, width: int) -> np.ndarray:
    """(H, W, 3) float32, linear."""
    return renderer.render(stage, camera=camera, width=width)["color"][..., :3]


def with_fallback_alone(name: str) -> Usd.Stage:
    """The stage as other applications see it: its texture is the fallback's image."""
    stage = open_stage(name)
    texture = umbrella(stage)
    file = UsdShade.Shader(texture.GetPrim().GetChild("Fallback")).GetInput("file").Get().resolvedPath
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        texture.GetPatchIndicesAttr().Set([])
        texture.GetMatricesAttr().Set([])
        texture.GetMorphsAttr().Set([])
        texture.GetColorsAttr().Set([])
        texture.GetFileAttr().Set(Sdf.AssetPath(file))
    leave_levels_out(stage)
    return stage


def leave_levels_out(stage: Usd.Stage) -> None:
    """Umbrellas alone, at every footprint."""
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for level in umbrella(stage).GetLevels():
            level.GetPrim().SetActive(False)


def sharpness(color: np.ndarray) -> float:
    """Mean absolute step between neighbours."""
    return float(np.abs(np.diff(color, axis=0)).mean() + np.abs(np.diff(color, axis=1)).mean())


@pytest.mark.parametrize("name", NAMES)
def test_no_two_umbrellas_are_alike(name):
    """Each has its own place, turn, size, shape and colours; the README counts them."""
    stage = open_stage(name)
    texture = umbrella(stage)
    matrices = np.array(texture.GetMatricesAttr().Get()).reshape(-1, 9)
    count = len(texture.GetPatchIndicesAttr().Get())
    assert len(matrices) == count
    assert len(np.unique(matrices[:, :6].round(9), axis=0)) == count, "some have the same turn and size"
    text = (FOLDER / name / "README.md").read_text(encoding="utf-8")
    assert re.search(rf"\b{count:,}\b", text), f"the README does not say {count:,}"
    assert re.search(rf"\b{len(texture.GetPatches())}\b", text)


@pytest.mark.parametrize("name", NAMES)
def test_horizon_looks_as_before(golden, renderer, name):
    """The last frame of the flight: all levels at once, at grazing view."""
    color = renderer.render(open_stage(name), camera="Flight", time=48, width=160)["color"]
    golden(f"{name}.Flight", color, mean=0.005, off=0.005, limit=0.4)


@pytest.mark.parametrize("name", NAMES)
def test_close_up_is_sharper_than_the_fallback(renderer, name):
    sharp = render(renderer, open_stage(name), "Detail", 320)
    plain = render(renderer, with_fallback_alone(name), "Detail", 320)
    assert sharpness(sharp) > 1.3 * sharpness(plain)


@pytest.mark.parametrize("name", NAMES)
def test_fallback_is_the_same_picture_from_afar(renderer, name):
    """To the right place: a shift by two pixels doubles the difference."""
    made = render(renderer, open_stage(name), "Overview", 240)
    plain = render(renderer, with_fallback_alone(name), "Overview", 240)
    error = np.abs(made - plain).mean()
    assert error < 0.03
    assert error < 0.5 * np.abs(np.roll(made, 2, axis=1) - plain)[:, 2:].mean()


@pytest.mark.parametrize("name", NAMES)
def test_texture_repeats_without_a_seam(renderer, name):
    """Moved by half a period, so that its borders run through the middle: no step there is out of the ordinary."""
    stage = open_stage(name)
    texture = umbrella(stage)
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        texture.GetMatrixAttr().Set(Gf.Matrix3d(1, 0, 0, 0, 1, 0, 0.5, 0.5, 1))
    color = render(renderer, stage, "Overview", 480)
    height, width = color.shape[:2]
    down, across = (np.abs(np.diff(color, axis=axis)).mean((1 - axis, 2)) for axis in (0, 1))
    for steps, middle in ((down, height // 2), (across, width // 2)):
        inner = steps[len(steps) // 8 : -len(steps) // 8]
        assert steps[middle - 2 : middle + 1].max() < inner.mean() + 5 * inner.std()


@pytest.mark.parametrize("name", NAMES)
def test_colour_is_the_same_at_every_footprint(renderer, name):
    """From umbrellas alone to the coarsest level: what is averaged keeps its mean, so nothing brightens on the way."""
    means = [render(renderer, open_stage(name), "Overview", width).mean((0, 1)) for width in (1024, 256, 64, 16)]
    np.testing.assert_allclose(means[1:], np.broadcast_to(means[0], (3, 3)), rtol=0.03, atol=0.004)


@pytest.mark.parametrize("name", NAMES)
def test_shadows_only_darken(renderer, name):
    stage = open_stage(name)
    leave_levels_out(stage)
    shaded = render(renderer, stage, "Detail", 160)
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        umbrella(stage).GetShadowStrengthAttr().Set(0.0)
    bright = render(renderer, stage, "Detail", 160)
    assert (bright - shaded).min() > -0.004
    assert (bright - shaded).mean() > 0.002


def test_leaves_get_the_colours_of_autumn_from_their_references(renderer):
    """Green as they were photographed; with the offsets of their vertices red and yellow prevail."""
    stage = open_stage("umbrella_leaves")
    autumn = render(renderer, stage, "Overview", 160)
    leave_levels_out(stage)
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        umbrella(stage).GetColorBlendAttr().Set(0.0)
    summer = render(renderer, stage, "Overview", 160)
    assert summer[..., 1].mean() > summer[..., 0].mean()
    assert autumn[..., 0].mean() > 1.3 * autumn[..., 1].mean()


def test_heap_is_a_patch_of_the_table():
    stage = open_stage("umbrella_in_zipmap")
    table = "/World/Materials/Table/Texture"
    patches = fexel.ZipmapTexture.Get(stage, table).GetPatches()
    assert [patch.path for patch in patches] == [Sdf.Path(table), Sdf.Path(f"{table}/Heap")]
    rows = (FOLDER / "umbrella_in_zipmap" / "heap.csv").read_text(encoding="utf-8").splitlines()
    assert len(umbrella(stage).GetPatchIndicesAttr().Get()) == len(rows) - 1 == 320


def test_table_is_seen_around_the_heap_and_not_through_it(renderer):
    stage = open_stage("umbrella_in_zipmap")
    heaped = render(renderer, stage, "Overview", 200)
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        stage.GetPrimAtPath("/World/Materials/Table/Texture/Heap").SetActive(False)
    bare = render(renderer, stage, "Overview", 200)
    around = np.ones(heaped.shape[:2], bool)
    around[40:160, 40:170] = False
    np.testing.assert_allclose(heaped[around], bare[around], atol=2e-3)
    assert (np.abs(heaped - bare)[80:130, 85:130].max(-1) > 0.004).mean() > 0.9  # the rest are gaps
