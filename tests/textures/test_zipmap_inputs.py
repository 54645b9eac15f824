"""What is authored on patches shows: inputs over time, scale and bias of each patch, zipmaps of normals and scalars."""

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdLux, UsdShade

import fexel
from bench.zipmap_stage import Patch, front_view, quad, render_texture, save, zipmap_stage, zipmap_texture
from fexel import homography, textures
from fexel.errors import FexelWarning
from fexel.textures import extract_texture
from fexel.textures.system import TextureSystem

VIEW = front_view((0, 0), (1, 1), 48, 48)
INSIDE = (slice(20, 28), slice(20, 28))


def plain(path, color, size=(32, 32), dtype="uint8"):
    return save(path, np.broadcast_to(np.float32(color), (*size, len(color))).copy(), dtype)


def placed(low, high):
    """Matrix of an axis-aligned patch over low..high of its parent."""
    low, high = np.array(low, float), np.array(high, float)
    return homography.translate(*-low) @ homography.scale(*(1 / (high - low)))


@pytest.fixture
def animated(tmp_path):
    """A black root, a red patch over its middle, and that patch's prim."""
    root = plain(tmp_path / "root.tif", (0, 0, 0))
    red = plain(tmp_path / "red.tif", (1, 0, 0))
    patch = Patch(red, placed((0.1, 0.1), (0.9, 0.9)), color_space="raw")
    stage = zipmap_stage(Patch(root, np.eye(3), children=(patch,)))
    return stage, stage.GetPrimAtPath("/Zipmap/patch0")


def middle(gl, stage, time):
    return render_texture(gl, zipmap_texture(stage, time=time), quad(), VIEW)[INSIDE][..., :3].mean((0, 1))


def test_patch_file_over_time_is_that_of_the_frame(gl, tmp_path, animated):
    stage, patch = animated
    green = plain(tmp_path / "green.tif", (0, 1, 0))
    file = patch.GetAttribute("inputs:file")
    file.Set(file.Get(), 1)
    file.Set(Sdf.AssetPath(green), 2)
    assert np.abs(middle(gl, stage, 1) - [1, 0, 0]).max() < 1e-3
    assert np.abs(middle(gl, stage, 2) - [0, 1, 0]).max() < 1e-3


def test_patch_mask_over_time_is_that_of_the_frame(gl, tmp_path, animated):
    stage, patch = animated
    mask = patch.CreateAttribute("inputs:mask", Sdf.ValueTypeNames.Asset)
    for time, value in ((1, 0.25), (2, 0.75)):
        mask.Set(Sdf.AssetPath(plain(tmp_path / f"mask{time}.tif", (value,) * 3, dtype="uint16")), time)
    assert abs(middle(gl, stage, 1)[0] - 0.25) < 2e-3
    assert abs(middle(gl, stage, 2)[0] - 0.75) < 2e-3


def test_patch_opacity_over_time_is_interpolated(gl, animated):
    stage, patch = animated
    opacity = patch.GetAttribute("inputs:opacity")
    opacity.Set(0.0, 1)
    opacity.Set(1.0, 3)
    for time, expected in ((1, 0.0), (1.5, 0.25), (2, 0.5), (3, 1.0)):
        assert abs(middle(gl, stage, time)[0] - expected) < 2e-3


def test_patch_matrix_over_time_moves_it(gl, animated):
    stage, patch = animated
    matrix = patch.GetAttribute("inputs:matrix")
    for time, low in ((1, 0.0), (2, 0.5)):
        matrix.Set(Gf.Matrix3d(*placed((low, low), (low + 0.5, low + 0.5)).ravel().tolist()), time)
    for time, (column, row) in ((1, (12, 36)), (2, (36, 12))):
        frame = render_texture(gl, zipmap_texture(stage, time=time), quad(), VIEW)
        assert frame[row, column, 0] > 0.99
        assert frame[48 - row, 48 - column, 0] < 0.01


def test_stats_do_not_grow_with_the_frames_of_an_animation(gl, animated):
    stage, patch = animated
    patch.GetAttribute("inputs:opacity").Set(0.0, 1)
    patch.GetAttribute("inputs:opacity").Set(1.0, 5)
    system = TextureSystem(gl)
    for time in (2, 3, 4):
        render_texture(gl, zipmap_texture(stage, time=time), quad(), VIEW, system)
    stats = system.stats()
    system.release()
    assert (stats["patches_total"], stats["patches_seen"]) == (2, 2)


def test_equal_data_at_two_times_compare_equal(animated):
    stage, patch = animated
    patch.GetAttribute("inputs:opacity").Set(0.0, 1)
    patch.GetAttribute("inputs:opacity").Set(1.0, 3)
    one, same, other = (extract_texture(stage.GetPrimAtPath("/Zipmap"), time)[1] for time in (3, 4, 2))
    assert one == same
    assert one != other


def set_scale_bias(prim, scale, bias):
    prim.CreateAttribute("inputs:scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*scale))
    prim.CreateAttribute("inputs:bias", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*bias))


@pytest.mark.parametrize("shared", [False, True])
def test_patch_scale_and_bias_are_its_own(gl, animated, shared):
    stage, patch = animated
    set_scale_bias(patch, (0.5, 1, 1, 1), (0.25, 0.5, 0, 0))
    if shared:
        set_scale_bias(stage.GetPrimAtPath("/Zipmap"), (0.5, 1, 1, 1), (0.25, 0.5, 0, 0))
    frame = render_texture(gl, zipmap_texture(stage), quad(), VIEW)
    assert np.abs(frame[INSIDE][..., :3] - [0.75, 0.5, 0]).max() < 2e-3
    assert np.abs(frame[1, 1, :3] - ([0.25, 0.5, 0] if shared else [0, 0, 0])).max() < 2e-3


@pytest.mark.parametrize(
    ("scale", "bias"),
    [
        ((2, 2, 2, 1), (-1, -1, -1, 0)),
        ((0.5, 0, 1, 1), (0, 0.25, 0, 0)),
        ((1, 1, 1, 0.5), (0, 0, 0, 0.25)),
        ((900, 1, 1, 1), (-450, 0, 0, 0)),
    ],
)
@pytest.mark.parametrize("missing", ["root", "patch"])
@pytest.mark.parametrize("alone", [False, True])
@pytest.mark.filterwarnings("ignore::fexel.errors.FexelWarning")
def test_fallback_has_neither_scale_nor_bias(gl, tmp_path, animated, missing, scale, bias, alone):
    stage, patch = animated
    root = stage.GetPrimAtPath("/Zipmap")
    prim = root if missing == "root" else patch
    prim.GetAttribute("inputs:file").Set(Sdf.AssetPath(str(tmp_path / "missing.png")))
    prim.CreateAttribute("inputs:fallback", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(0.5, 0.25, 0.75, 1))
    set_scale_bias(prim, scale, bias)
    if not alone:
        set_scale_bias(patch if missing == "root" else root, scale, bias)
    elif missing == "root":
        patch.SetActive(False)
    frame = render_texture(gl, zipmap_texture(stage), quad(), VIEW)
    place = (slice(1, 3), slice(20, 28)) if missing == "root" else INSIDE
    assert np.abs(frame[place] - [0.5, 0.25, 0.75, 1]).max() < 2e-3


@pytest.fixture
def without_umbrellas(monkeypatch):
    """The renderer as it is without one of its kinds."""
    monkeypatch.setattr(textures, "_KINDS", tuple(kind for kind in textures.kinds() if kind != "umbrella"))
    textures._kind_of_type.cache_clear()
    yield
    textures._kind_of_type.cache_clear()


@pytest.mark.usefixtures("without_umbrellas")
def test_nested_kind_that_is_not_drawn_yet_is_said_once(gl, animated):
    stage, patch = animated
    patch.SetTypeName("UmbrellaTexture")
    with pytest.warns(FexelWarning) as caught:
        shown = middle(gl, stage, 1)
    (message,) = (str(warning.message) for warning in caught)
    assert message == (
        "/Zipmap/patch0: a UmbrellaTexture in a ZipmapTexture is not drawn yet; inputs:file is shown as a plain image"
    )
    assert np.abs(shown - [1, 0, 0]).max() < 1e-3


@pytest.mark.usefixtures("without_umbrellas")
def test_root_kind_that_is_not_drawn_yet_is_said_and_its_fallback_shown(tmp_path, animated):
    stage, _ = animated
    lit_stage(stage, "emissiveColor", Sdf.ValueTypeNames.Color3f, "rgb").GetPrimAtPath("/Zipmap").SetTypeName(
        "UmbrellaTexture"
    )
    with pytest.warns(FexelWarning, match="/Zipmap: .*UmbrellaTexture.*; inputs:fallback is shown") as caught:
        fexel.render(stage, camera="Camera", width=16)
    assert len(caught) == 1


def lit_stage(texture_stage, name, kind, output):
    """The zipmap on an input of a material, on a quad under a slanting light."""
    stage = texture_stage
    UsdGeom.SetStageUpAxis(stage, "Y")
    material = UsdShade.Material.Define(stage, "/Material")
    surface = UsdShade.Shader.Define(stage, "/Material/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    texture = UsdShade.ConnectableAPI(stage.GetPrimAtPath("/Zipmap"))
    surface.CreateInput(name, kind).ConnectToSource(texture, output)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    mesh = UsdGeom.Mesh.Define(stage, "/Quad")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr("none")
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    st.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    light = UsdLux.DistantLight.Define(stage, "/Light")
    UsdGeom.XformCommonAPI(light).SetRotate((0, 40, 0))
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    camera.CreateProjectionAttr("orthographic")
    for aperture in (camera.CreateHorizontalApertureAttr, camera.CreateVerticalApertureAttr):
        aperture(10.0)  # tenths of a unit
    UsdGeom.XformCommonAPI(camera).SetTranslate((0.5, 0.5, 2))
    return stage


def test_zipmap_of_normals_turns_those_of_its_patch(gl, tmp_path):
    """raw, scale 2 and bias -1: a flat root, and a patch whose normals lean by 30 degrees along s."""
    lean = np.array([0.5, 0.0, np.sqrt(0.75)])
    root = Patch(
        plain(tmp_path / "flat.tif", (0.5, 0.5, 1), dtype="uint16"),
        np.eye(3),
        color_space="raw",
        children=(
            Patch(
                plain(tmp_path / "lean.tif", (lean + 1) / 2, dtype="uint16"),
                placed((0.1, 0.1), (0.9, 0.9)),
                color_space="raw",
            ),
        ),
    )
    stage = zipmap_stage(root)
    for path in ("/Zipmap", "/Zipmap/patch0"):
        set_scale_bias(stage.GetPrimAtPath(path), (2, 2, 2, 1), (-1, -1, -1, 0))
    lit_stage(stage, "normal", Sdf.ValueTypeNames.Normal3f, "rgb")
    normal = fexel.render(stage, camera="Camera", width=48, aovs=["normal"])["normal"]
    assert np.abs(normal[INSIDE] - lean).max() < 5e-3
    assert np.abs(normal[1, 24] - [0, 0, 1]).max() < 5e-3


@pytest.mark.parametrize(("name", "output"), [("roughness", "g"), ("opacity", "r")])
def test_zipmap_of_a_scalar_equals_the_constant_that_it_holds(gl, tmp_path, name, output):
    values = {"root": 0.8, "patch": 0.3}
    files = {which: plain(tmp_path / f"{which}.tif", (value,) * 3, dtype="uint16") for which, value in values.items()}
    patch = Patch(files["patch"], placed((0.1, 0.1), (0.9, 0.9)), color_space="raw")
    stage = zipmap_stage(Patch(files["root"], np.eye(3), color_space="raw", children=(patch,)))
    lit_stage(stage, name, Sdf.ValueTypeNames.Float, output)
    frame = fexel.render(stage, camera="Camera", width=48)["color"]
    surface = UsdShade.Shader(stage.GetPrimAtPath("/Material/Surface"))
    surface.GetInput(name).ClearSources()
    for which, place in (("patch", INSIDE), ("root", (slice(1, 3), slice(20, 28)))):
        surface.GetInput(name).Set(values[which])
        constant = fexel.render(stage, camera="Camera", width=48)["color"]
        assert np.abs(frame[place] - constant[place]).max() < 2e-3
        assert constant[place][..., :3].max() > 0.0
