"""The pinchmap example stages show what their READMEs promise: sharp edges, a crease that starts, ink, patches."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

import fexel
from fexel_tools.pinchmap_options import PinchmapOptions
from fexel_tools.pinchmap_solution import compute_pinchmap

FOLDER = Path(__file__).resolve().parents[2] / "stages"
INK = np.array([0.0116, 0.0176, 0.0513])  # inputs:lineColor of the drawing, linear


def open_stage(name: str) -> Usd.Stage:
    return Usd.Stage.Open(str(FOLDER / name / f"{name}.usda"))


@pytest.fixture(scope="module")
def renderer():
    with fexel.Renderer() as renderer:
        yield renderer


def pinchmaps(stage: Usd.Stage) -> list[fexel.PinchmapTexture]:
    return [fexel.PinchmapTexture(prim) for prim in stage.Traverse() if prim.GetTypeName() == "PinchmapTexture"]


def without_pinchmaps(stage: Usd.Stage) -> Usd.Stage:
    """The same stage with the signals as plain images, in the session layer."""
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for texture in pinchmaps(stage):
            texture.GetPinchmapAttr().Block()
            texture.GetLineWidthAttr().Block()
    return stage


def largest_step(color: np.ndarray) -> float:
    """Between neighbours, over all channels."""
    return max(float(np.abs(np.diff(color[..., :3], axis=axis)).max()) for axis in (0, 1))


@pytest.mark.parametrize("name", ["pinchmap_demo", "pinchmap_in_zipmap", "pinchmap_sign"])
def test_close_up_is_sharp_with_the_pinchmap_alone(renderer, name):
    """The signal itself is a few texels wide there, so that without its map it is a blur."""
    sharp = renderer.render(open_stage(name), camera="Detail", width=480)["color"]
    blurred = renderer.render(without_pinchmaps(open_stage(name)), camera="Detail", width=480)["color"]
    assert largest_step(sharp) > 3 * largest_step(blurred)


@pytest.mark.parametrize("zoom", [1, 16, 256])
def test_edge_of_the_sign_is_as_sharp_at_any_magnification(renderer, zoom):
    """The upper edge of the black frame: yellow above, black below, at most three pixels in between."""
    stage = open_stage("pinchmap_sign")
    edge = UsdGeom.Boundable(stage.GetPrimAtPath("/World/Sign")).ComputeWorldBound(0, "default").ComputeAlignedRange()
    top, left = edge.GetMax()[1], edge.GetMin()[0]
    side = edge.GetSize()[1]
    y, x, distance = top - 24 / 256 * side, left + 0.5 * side, 0.06 / zoom
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        camera = UsdGeom.Camera.Define(stage, "/World/Cameras/Near")
        camera.CreateHorizontalApertureAttr(24)
        camera.CreateVerticalApertureAttr(24)
        camera.CreateFocalLengthAttr(24)
        camera.CreateClippingRangeAttr(Gf.Vec2f(distance / 4, distance * 4))
        camera.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(x, y, edge.GetMax()[2] + distance))
    color = renderer.render(stage, camera="/World/Cameras/Near", width=64)["color"]
    red = color[:, 32, 0]
    between = (red > red.min() + 0.05) & (red < red.max() - 0.05)
    assert red[0] > 0.8 > 0.1 > red[-1]
    assert between.sum() <= 3


def steps_down(stage: Usd.Stage, renderer: fexel.Renderer) -> np.ndarray:
    """Largest step between vertical neighbours, per column of 256."""
    color = renderer.render(stage, camera="Overview", width=256)["color"][..., :3]
    return np.abs(np.diff(color, axis=0)).max((0, 2))


def test_crease_is_none_at_its_start_and_sharp_at_its_end(renderer):
    steps = steps_down(open_stage("pinchmap_crease"), renderer)
    assert steps[192:240].min() > 5 * steps[16:48].max()


def test_it_is_the_pinch_that_makes_the_crease_and_not_the_normals(renderer):
    pinched = steps_down(open_stage("pinchmap_crease"), renderer)
    plain = steps_down(without_pinchmaps(open_stage("pinchmap_crease")), renderer)
    assert pinched[192:240].min() > 5 * plain[192:240].max()
    np.testing.assert_allclose(pinched[:48], plain[:48], atol=2e-3)  # nothing is pinched there


def test_ink_follows_the_animated_line_width(renderer):
    stage = open_stage("pinchmap_lines")
    share = {}
    for frame in (1, 24, 48):
        color = renderer.render(stage, camera="Overview", time=frame, width=480)["color"][..., :3]
        share[frame] = float((np.abs(color - INK).max(-1) < 0.004).mean())
    assert share[48] == 0.0
    assert 0.005 < share[1] < share[24] / 2


def test_pinchmaps_are_patches_of_the_zipmap_in_draw_order():
    stage = open_stage("pinchmap_in_zipmap")
    panel = "/World/Materials/Wood/Texture"
    patches = fexel.ZipmapTexture.Get(stage, panel).GetPatches()
    assert [patch.path for patch in patches] == [
        Sdf.Path(path) for path in (panel, f"{panel}/Grain", f"{panel}/Grain/Logo", f"{panel}/Butterfly")
    ]
    matrix = np.array(fexel.PinchmapTexture.Get(stage, f"{panel}/Butterfly").GetMatrixAttr().Get())
    assert np.abs(matrix[:2, 2]).max() > 0.1, "the butterfly is placed in perspective"


def test_switching_a_pinchmap_off_leaves_the_wood(renderer):
    stage = open_stage("pinchmap_in_zipmap")
    marked = renderer.render(stage, camera="Detail", width=240)["color"]
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        stage.GetPrimAtPath("/World/Materials/Wood/Texture/Grain/Logo").SetActive(False)
    bare = renderer.render(stage, camera="Detail", width=240)["color"]
    corner = np.s_[:20, :20]  # outside of the logo
    np.testing.assert_allclose(marked[corner], bare[corner], atol=2e-3)
    assert bare[..., 0].min() > 2 * marked[..., 0].min()


def test_sweets_have_no_halo():
    """Made anew from the photo: up to their outlines they are opaque and what is around them is not there at all."""
    file = FOLDER / "pinchmap_demo" / "sources" / "sweets.png"
    made = compute_pinchmap(str(file), PinchmapOptions(size=48))
    alpha = made.signal[..., 3]
    assert ((alpha == 0) | (alpha > 0.98)).all()
    opacity = made.source.opacity
    shown = made.picture(opacity.shape)[..., 3]
    assert (shown[opacity == 0] == 0).mean() > 0.995
    assert (shown[opacity == 1] == 1).mean() > 0.98
