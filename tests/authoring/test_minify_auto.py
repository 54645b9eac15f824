"""`fexel minify --filter auto`: per texture the cheapest portable filter that is good enough where cameras see it."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade
from typer.testing import CliRunner

import fexel
from fexel.errors import FexelError, FexelWarning
from fexel.filters import PORTABLE_FILTERS
from fexel.textures.footprint import Footprint
from fexel_tools.cli import app
from fexel_tools.image_files import write_image
from fexel_tools.minify import MinifyOptions, minify
from fexel_tools.minify_views import seen_footprints
from fexel_tools.progress import silent

TEXTURE = "/World/Looks/Ground/Image"
AUTO = MinifyOptions(filter="auto", width=320, bound_db=30.0)


def define_ground(stage, file, path="/World/Ground", texture=TEXTURE, side=64.0, repeats=64.0):
    """A square in the plane y = 0 that repeats a texture."""
    looks = Sdf.Path(texture).GetParentPath()
    material = UsdShade.Material.Define(stage, looks)
    surface, image = UsdShade.Shader.Define(stage, looks.AppendChild("Surface")), UsdShade.Shader.Define(stage, texture)
    surface.CreateIdAttr("UsdPreviewSurface")
    image.CreateIdAttr("UsdUVTexture")
    image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(file))
    for wrap in ("wrapS", "wrapT"):
        image.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("repeat")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
        image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    )
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    mesh, half = UsdGeom.Mesh.Define(stage, path), side / 2
    mesh.CreatePointsAttr([(-half, 0, half), (half, 0, half), (half, 0, -half), (-half, 0, -half)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr("none")
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(0, 0), (repeats, 0), (repeats, repeats), (0, repeats)])
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def add_camera(stage, name, eye, target, up=(0, 1, 0)):
    camera = UsdGeom.Camera.Define(stage, f"/World/{name}")
    camera.CreateFocalLengthAttr(50)
    camera.CreateHorizontalApertureAttr(24)
    camera.CreateVerticalApertureAttr(16)
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01, 1000))
    look = Gf.Matrix4d().SetLookAt(Gf.Vec3d(*eye), Gf.Vec3d(*target), Gf.Vec3d(*up))
    camera.AddTransformOp().Set(look.GetInverse())


@pytest.fixture
def stage(tmp_path, rng):
    """A ground of noise of all frequencies but the finest; a flat one beside it. No camera yet."""
    write_image(tmp_path / "noise.png", rng.integers(0, 256, (32, 32, 3), np.uint8).repeat(4, 0).repeat(4, 1))
    write_image(tmp_path / "flat.png", np.full((64, 64, 3), 90, np.uint8))
    stage = Usd.Stage.CreateNew(str(tmp_path / "scene.usda"))
    UsdGeom.SetStageUpAxis(stage, "Y")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    define_ground(stage, "./noise.png")
    return stage


def run(stage, tmp_path, options=AUTO):
    stage.GetRootLayer().Save()
    return {t.prim: t for t in minify(tmp_path / "scene.usda", tmp_path / "out.usda", options).textures}


def from_above(stage):
    """A texel is 1/128; a pixel covers one and a half of them both ways."""
    add_camera(stage, "Above", (0.5, 8, 0.5), (0.5, 0, 0.5), (0, 0, -1))


def low_and_slanted(stage):
    """Footprints of some 50 to 1, along neither s nor t."""
    add_camera(stage, "Low", (-8, 0.3, 5), (5, 0, -3))


def test_slanted_grazing_view_takes_a_fipmap_and_the_view_from_above_does_not(stage, tmp_path):
    from_above(stage)
    above = run(stage, tmp_path)[TEXTURE]
    low_and_slanted(stage)
    both = run(stage, tmp_path)[TEXTURE]
    assert above.filter == "mipmap"
    assert both.filter == "fipmap", "the worst picture counts"
    assert both.predicted_db["fipmap"] > both.predicted_db["mipmap"] + 6
    assert set(both.predicted_db) == set(PORTABLE_FILTERS)


def test_choice_is_written_as_a_portable_token(stage, tmp_path):
    low_and_slanted(stage)
    run(stage, tmp_path)
    out = Usd.Stage.Open(str(tmp_path / "out.usda"))
    assert fexel.TextureMinificationAPI.Get(out, TEXTURE).GetFilterAttr().Get() == "fipmap"
    assert [f for f in fexel.validate(out) if f.severity == "error"] == []


def test_lower_bound_takes_a_cheaper_filter_and_what_is_chosen_meets_it(stage, tmp_path):
    low_and_slanted(stage)
    for bound in (5.0, 20.0, 25.0, 30.0):
        chosen = run(stage, tmp_path, MinifyOptions(filter="auto", width=320, bound_db=bound))[TEXTURE]
        best = max(chosen.predicted_db.values())
        assert chosen.predicted_db[chosen.filter] >= min(bound, best - 1.0)
        assert bound > 5.0 or chosen.filter == "mipmap"


def test_flat_texture_needs_no_more_than_a_mipmap(stage, tmp_path):
    UsdShade.Shader.Get(stage, TEXTURE).GetInput("file").Set(Sdf.AssetPath("./flat.png"))
    low_and_slanted(stage)
    assert run(stage, tmp_path)[TEXTURE].filter == "mipmap"


def test_texture_that_no_camera_sees_keeps_the_default(stage, tmp_path):
    define_ground(stage, "./noise.png", "/World/Behind", "/World/Looks/Behind/Image")
    UsdGeom.Xformable(stage.GetPrimAtPath("/World/Behind")).AddTranslateOp().Set((0, 5000, 0))
    low_and_slanted(stage)
    behind = run(stage, tmp_path)["/World/Looks/Behind/Image"]
    assert (behind.filter, behind.note) == ("anisotropic", "no camera sees it")
    assert behind.predicted_db == {}


def test_texture_without_a_readable_file_keeps_the_default(stage, tmp_path):
    UsdShade.Shader.Get(stage, TEXTURE).GetInput("file").Set(Sdf.AssetPath("./nowhere.png"))
    low_and_slanted(stage)
    with pytest.warns(FexelWarning, match=r"nowhere\.png"):
        missing = run(stage, tmp_path)[TEXTURE]
    assert missing.filter == "anisotropic" and "no image" in missing.note


def test_camera_that_moves_is_looked_through_at_several_times(stage, tmp_path):
    """It starts from above, where a mipmap would do, and ends low."""
    from_above(stage)
    camera = UsdGeom.Camera.Get(stage, "/World/Above")
    look = Gf.Matrix4d().SetLookAt(Gf.Vec3d(-8, 0.3, 5), Gf.Vec3d(5, 0, -3), Gf.Vec3d(0, 1, 0)).GetInverse()
    transform = camera.GetOrderedXformOps()[0]
    transform.Set(transform.Get(), 1)
    transform.Set(look, 48)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(48)
    assert run(stage, tmp_path)[TEXTURE].filter == "fipmap"


def test_texture_inside_instances_is_seen_wherever_they_are(stage, tmp_path):
    asset = Usd.Stage.CreateNew(str(tmp_path / "asset.usda"))
    asset.SetDefaultPrim(asset.DefinePrim("/World", "Xform"))
    define_ground(asset, "./noise.png")
    asset.GetRootLayer().Save()
    stage.RemovePrim("/World/Ground")
    stage.RemovePrim("/World/Looks")
    for name in "AB":
        prim = stage.DefinePrim(f"/World/{name}", "Xform")
        prim.GetReferences().AddReference("./asset.usda")
        prim.SetInstanceable(True)
    low_and_slanted(stage)
    (texture,) = run(stage, tmp_path).values()
    assert texture.filter == "fipmap" and "2 instances" in texture.note
    out = Usd.Stage.Open(str(tmp_path / "out.usda"))
    for name in "AB":
        api = fexel.TextureMinificationAPI.Get(out, f"/World/{name}/Looks/Ground/Image")
        assert api and api.GetFilterAttr().Get() == "fipmap"


def test_footprints_are_those_of_the_renderer(gl, stage):
    """Against the AOV of the same camera, all quantiles of both axes."""
    low_and_slanted(stage)
    (seen,) = seen_footprints(stage, 384, silent)[TEXTURE]
    found = Footprint.of(seen.jacobian * np.array([[128.0], [-128.0]]))
    shown = fexel.render(stage, camera="Low", width=384, aovs=("footprint",))["footprint"]
    shown = shown[shown[..., 0] > 0]
    assert len(seen.jacobian) * seen.pixels == pytest.approx(len(shown), rel=0.02)
    shares = np.linspace(0.02, 0.9, 23)
    np.testing.assert_allclose(np.quantile(found.major, shares), np.quantile(shown[:, 0], shares), rtol=0.05)
    np.testing.assert_allclose(np.quantile(found.minor, shares), np.quantile(shown[:, 1], shares), rtol=0.05)


def test_command_says_what_it_chose_and_why(stage, tmp_path):
    low_and_slanted(stage)
    stage.GetRootLayer().Save()
    arguments = [tmp_path / "scene.usda", "--filter", "auto", "-w", "320", "--bound", "5", "-o", tmp_path / "o.usda"]
    done = CliRunner().invoke(app, ["minify", *map(str, arguments), "--report", str(tmp_path / "r.json")])
    assert done.exit_code == 0, done.output
    assert done.output.splitlines()[0].startswith(f"{TEXTURE}: mipmap, predicted ")
    (entry,) = json.loads((tmp_path / "r.json").read_text("utf-8"))["textures"]
    assert entry["filter"] == "mipmap" and set(entry["predicted_db"]) == set(PORTABLE_FILTERS)


@pytest.mark.parametrize(
    ("options", "words"),
    [({"bound_db": 0.0}, "--bound: 0"), ({"bound_db": np.inf}, "--bound: inf"), ({"width": 0}, "--imageWidth: 0")],
)
def test_wrong_option_is_one_line(stage, tmp_path, options, words):
    with pytest.raises(FexelError, match=words):
        run(stage, tmp_path, MinifyOptions(filter="auto", **options))
