"""Textured surfaces of which no sample is covered: edge-on, tiny, degenerate; and files that are not where they say."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom

import fexel
from tests.renderer.stages import textured_quad, write_image


def _quad(folder, file="grey.png"):
    write_image(folder / "grey.png", np.full((8, 8, 3), 128, np.uint8))
    return textured_quad(folder / "quad.usda", {"emissiveColor": (file, "rgb", {})})


def _camera(stage, path, translate, rotate_y, projection):
    camera = UsdGeom.Camera.Define(stage, path)
    camera.AddTranslateOp().Set(Gf.Vec3d(*translate))
    camera.AddRotateYOp().Set(rotate_y)
    camera.CreateProjectionAttr(projection)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.1, 1e9))


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_textured_surface_seen_exactly_edge_on_covers_nothing(tmp_path, projection):
    stage = _quad(tmp_path)
    _camera(stage, "/Edge", (3, 0, 0), 90, projection)
    images = fexel.render(stage, camera="/Edge", width=32, aovs=("color", "lod"))
    assert np.isfinite(images["color"]).all()
    assert images["color"][..., 3].max() == 0


def test_textured_surface_far_below_a_pixel_covers_nothing(tmp_path):
    stage = _quad(tmp_path)
    _camera(stage, "/Far", (0, 0, 1e8), 0, "perspective")
    assert fexel.render(stage, camera="/Far", width=32)["color"][..., 3].max() == 0


def test_textured_mesh_without_extent_draws_nothing(tmp_path):
    stage = _quad(tmp_path)
    UsdGeom.Mesh.Get(stage, "/World/Quad").GetPointsAttr().Set([Gf.Vec3f(0)] * 4)
    with pytest.warns(fexel.FexelWarning, match="nothing to draw"):
        color = fexel.render(stage, camera="/World/Camera", width=16)["color"]
    assert color[..., 3].max() == 0


def test_file_of_the_current_directory_does_not_step_in_for_a_missing_one(tmp_path, monkeypatch):
    stage = _quad(tmp_path, "./missing.png")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    write_image(tmp_path / "elsewhere" / "missing.png", np.full((8, 8, 3), 255, np.uint8))
    monkeypatch.chdir(tmp_path / "elsewhere")
    texture = stage.GetPrimAtPath("/World/Material/emissiveColor")
    texture.CreateAttribute("inputs:fallback", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(0.25, 0.25, 0.25, 1))
    with pytest.warns(fexel.FexelWarning, match="missing.png"):
        color = fexel.render(stage, camera="/World/Camera", width=16, camera_light=False)["color"]
    assert color[8, 8, :3] == pytest.approx(0.25, abs=2e-3)
