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
from fexel.images import linear_to_srgb
from fexel.scene import SceneReader
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
    assert missing.filter == "anisotropic" and "cannot be judged: it has no image" in missing.note


def test_texture_whose_coordinates_a_mesh_lacks_keeps_the_default_and_others_are_judged(stage, tmp_path):
    """As Blender exports a UV Map node that names a layer which one of the meshes has not."""
    unplaced = "/World/Looks/Other/Image"
    define_ground(stage, "./noise.png", "/World/Other", unplaced)
    reader = UsdShade.Shader.Define(stage, "/World/Looks/Other/UVMap")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("UVMap")
    UsdShade.Shader.Get(stage, unplaced).CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
        reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    )
    low_and_slanted(stage)
    found = run(stage, tmp_path)
    assert found[TEXTURE].filter == "fipmap"
    assert found[unplaced].filter == "anisotropic" and found[unplaced].predicted_db == {}
    assert found[unplaced].note == "cannot be judged: /World/Other lacks primvar 'UVMap'"
    out = Usd.Stage.Open(str(tmp_path / "out.usda"))
    assert fexel.TextureMinificationAPI.Get(out, unplaced).GetFilterAttr().Get() == "anisotropic"
    with pytest.raises(FexelError, match="UVMap"):
        SceneReader(stage).at()


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
    (seen,) = seen_footprints(stage, 384, silent).footprints[TEXTURE]
    found = Footprint.of(seen.jacobian * np.array([[128.0], [-128.0]]))
    shown = fexel.render(stage, camera="Low", width=384, aovs=("footprint",))["footprint"]
    shown = shown[shown[..., 0] > 0]
    assert len(seen.jacobian) * seen.pixels == pytest.approx(len(shown), rel=0.02)
    shares = np.linspace(0.02, 0.9, 23)
    np.testing.assert_allclose(np.quantile(found.major, shares), np.quantile(shown[:, 0], shares), rtol=0.05)
    np.testing.assert_allclose(np.quantile(found.minor, shares), np.quantile(shown[:, 1], shares), rtol=0.05)


def line_pairs():
    """Black and white lines of 1 to 16 texels, upright ones above lying ones."""
    widths = [1, 1, 2, 2, 3, 3, 4, 4, 6, 6, 8, 8, 12, 12, 16, 16, 8, 8, 4, 4]
    line = np.uint8(255 * np.repeat(np.arange(len(widths)) % 2, widths))
    upright = np.repeat(line[None], len(line), axis=0)
    return np.repeat(np.concatenate([upright, upright.T])[..., None], 3, axis=2)


def noise(tones):
    return np.random.default_rng(7).choice(np.uint8(tones), (64, 64, 1)).repeat(3, 2).repeat(4, 0).repeat(4, 1)


@pytest.mark.parametrize(
    "texture", [line_pairs(), noise((0, 255)), noise((110, 150))], ids=["line pairs", "noise", "soft noise"]
)
def test_what_is_foretold_is_what_the_renderer_draws_by_default(gl, stage, tmp_path, texture):
    """With 8 probes, beside an average of 36 samples a pixel: hardly better than what is drawn, nor much worse."""
    write_image(tmp_path / "noise.png", texture)
    surface = UsdShade.Shader.Get(stage, "/World/Looks/Ground/Surface")
    surface.GetInput("diffuseColor").ClearSources()
    surface.GetInput("diffuseColor").Set(Gf.Vec3f(0))
    surface.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
        UsdShade.Shader.Get(stage, TEXTURE).GetOutput("rgb")
    )
    add_camera(stage, "Eye", (-8, 1.2, 5), (5, 0, -3))
    foretold = run(stage, tmp_path, MinifyOptions(filter="auto", width=192))[TEXTURE].predicted_db
    samples = fexel.render(stage, width=6 * 192, filter="anisotropic", anisotropy=16)["color"][..., :3]
    truth = samples.reshape(len(samples) // 6, 6, 192, 6, 3).mean(axis=(1, 3))
    for token in PORTABLE_FILTERS:
        shown = fexel.render(stage, width=192, filter=token, aovs=("color", "fetches"))
        seen = shown["fetches"][..., 0] > 0
        difference = linear_to_srgb(shown["color"][..., :3])[seen] - linear_to_srgb(truth)[seen]
        drawn = -10 * np.log10(np.mean(difference.astype(np.float64) ** 2))
        assert drawn - 10.0 <= foretold[token] <= drawn + 2.5, token


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
