"""Many small occurrences of one mesh share what is seen of their texture."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

import fexel
from fexel.renderer import view_list
from fexel.scene.model import Draw
from stages import preview_material, write_image


@pytest.fixture
def flock(tmp_path, rng):
    """250 small textured quads at many distances and angles, and one large one, through a point instancer."""
    write_image(tmp_path / "noise.png", rng.integers(0, 256, (256, 256, 3), dtype=np.uint8))
    stage = Usd.Stage.CreateNew(str(tmp_path / "flock.usda"))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/Flock")
    mesh = UsdGeom.Mesh.Define(stage, "/World/Flock/Quad")
    mesh.CreatePointsAttr([Gf.Vec3f(-1, -1, 0), Gf.Vec3f(1, -1, 0), Gf.Vec3f(1, 1, 0), Gf.Vec3f(-1, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr("none")
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([Gf.Vec2f(0, 0), Gf.Vec2f(1, 0), Gf.Vec2f(1, 1), Gf.Vec2f(0, 1)])
    textures = {"emissiveColor": ("./noise.png", "rgb", {})}
    material = preview_material(stage, "/World/Material", textures, diffuseColor=(0.0, 0.0, 0.0), useSpecularWorkflow=1)
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    instancer.CreatePrototypesRel().SetTargets([mesh.GetPath()])
    places = [
        (float(x), float(y), float(-z)) for x in range(-15, 15, 4) for y in range(-15, 15, 4) for z in (25, 40, 70, 120)
    ]
    places.append((0.0, 0.0, -4.0))
    turns = [Gf.Rotation(Gf.Vec3d(*axis), angle).GetQuat() for axis, angle in zip(
        rng.normal(size=(len(places), 3)), rng.uniform(0, 85, len(places)), strict=True
    )]  # fmt: skip
    instancer.CreatePositionsAttr([Gf.Vec3f(*place) for place in places])
    instancer.CreateOrientationsAttr([Gf.Quath(turn) for turn in turns])
    instancer.CreateProtoIndicesAttr([0] * len(places))
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateHorizontalApertureAttr(24.0)
    camera.CreateVerticalApertureAttr(24.0)
    camera.CreateFocalLengthAttr(24.0)
    camera.CreateClippingRangeAttr(Gf.Vec2f(1, 1000))
    stage.Save()
    return stage


def test_sharing_leaves_the_picture_and_looks_at_few_draws(flock, monkeypatch):
    exact = view_list.visible_surface
    looked_at: list[Draw] = []

    def counted(draw, *arguments):
        looked_at.append(draw)
        return exact(draw, *arguments)

    monkeypatch.setattr(view_list, "visible_surface", counted)
    images = []
    for small_px in (view_list.SMALL_PX, 0.0):
        monkeypatch.setattr(view_list, "SMALL_PX", small_px)
        looked_at.clear()
        with fexel.Renderer() as renderer:
            images.append(renderer.render(flock, width=512, samples=1, aovs=("color", "lod", "primId")))
        assert len(looked_at) <= 1 if small_px else len(looked_at) > 100
    shared, alone = images
    assert np.array_equal(shared["primId"], alone["primId"])
    # A draw by itself goes without anisotropic probes where the view hardly needs any, which moves its level a little.
    np.testing.assert_allclose(shared["lod"], alone["lod"], atol=0.5)
    difference = np.abs(shared["color"] - alone["color"])
    assert difference.mean() < 5e-3 and difference.max() < 0.15, (difference.mean(), difference.max())
