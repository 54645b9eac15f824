"""Shading and AOVs where the mesh is drawn from re-based vertices: a view of a millionth of a textured quad."""

from __future__ import annotations

import numpy as np
import pytest

from stages import textured_quad, write_image

ZOOM = 2.0**20
CENTRE = np.array([0.31830988, -0.27182818])  # world position of the view's middle on the quad [-1, 1]^2


@pytest.fixture
def deep(tmp_path, rng):
    """The textured quad, tilted, and an orthographic camera that sees 2 / 2^20 of it."""
    from pxr import Gf, UsdGeom

    write_image(tmp_path / "noise.png", rng.integers(0, 256, (64, 64, 3), dtype=np.uint8))
    textures = {"emissiveColor": ("./noise.png", "rgb", {})}
    stage = textured_quad(tmp_path / "deep.usda", textures, diffuseColor=(0.8, 0.8, 0.8))
    camera = UsdGeom.Camera.Get(stage, "/World/Camera")
    camera.GetPrim().GetAttribute("xformOp:translate").Set(Gf.Vec3d(*CENTRE, 5))
    camera.GetHorizontalApertureAttr().Set(20 / ZOOM)
    camera.GetVerticalApertureAttr().Set(20 / ZOOM)
    return stage


def test_deep_view_is_drawn_from_rebased_vertices_and_right_in_every_aov(deep, tmp_path):
    import fexel

    with fexel.Renderer() as renderer:
        names = ("color", "st", "normal", "cameraDepth", "position", "depth", "primId")
        images = renderer.render(deep, width=33, height=33, aovs=names)
        assert renderer.stats()["rebasedDraws"] == 1
    expected = (CENTRE + 1) / 2
    np.testing.assert_allclose(images["st"], np.broadcast_to(expected, (33, 33, 2)), atol=1e-6)
    np.testing.assert_allclose(images["normal"], np.broadcast_to([0, 0, 1.0], (33, 33, 3)), atol=1e-6)
    np.testing.assert_allclose(images["cameraDepth"], 5.0, rtol=1e-5)
    np.testing.assert_allclose(images["position"][..., :2], np.broadcast_to(CENTRE, (33, 33, 2)), atol=1e-5)
    np.testing.assert_allclose(images["depth"], (5.0 - 1) / 9, rtol=1e-5)
    assert np.all(images["primId"] >= 0) and np.all(images["color"][..., 3] == 1)


def test_deep_view_is_lit_like_a_shallow_one(deep, renderer):
    """A facing quad under a headlight: the same shading, however close the camera."""
    from pxr import UsdGeom

    surface = deep.GetPrimAtPath("/World/Material/Surface")
    surface.GetAttribute("inputs:emissiveColor").ClearConnections()
    surface.GetAttribute("inputs:emissiveColor").Set((0.0, 0.0, 0.0))
    surface.GetAttribute("inputs:diffuseColor").SetConnections(["/World/Material/emissiveColor.outputs:rgb"])
    close = renderer.render(deep, width=16, height=16, aovs=("color",))["color"]
    texel = close[8, 8, :3]
    assert np.ptp(close[..., :3], axis=(0, 1)).max() < 5e-3, "a view within one texel is almost constant"
    camera = UsdGeom.Camera.Get(deep, "/World/Camera")
    for aperture in (camera.GetHorizontalApertureAttr(), camera.GetVerticalApertureAttr()):
        aperture.Set(20 / 2.0**9)
    shallow = renderer.render(deep, width=3, height=3)["color"][1, 1, :3]
    np.testing.assert_allclose(texel, shallow, rtol=2e-2)


@pytest.mark.parametrize("samples", [1, 4, 9])
def test_rebased_pixels_are_covered_to_the_edge_of_the_frame(deep, renderer, samples):
    alpha = renderer.render(deep, width=31, height=17, samples=samples, aovs=("alpha",))["alpha"]
    assert np.all(alpha == 1)


def test_mirrored_deep_zoom_keeps_its_front(deep, renderer):
    from pxr import UsdGeom

    mesh = UsdGeom.Mesh.Get(deep, "/World/Quad")
    UsdGeom.Xformable(mesh).AddScaleOp().Set((-1.0, 1.0, 1.0))
    images = renderer.render(deep, width=8, height=8, aovs=("normal", "alpha"), cull_back_faces=False)
    assert np.all(images["alpha"] == 1)
    np.testing.assert_allclose(images["normal"], np.broadcast_to([0, 0, 1.0], (8, 8, 3)), atol=1e-6)
