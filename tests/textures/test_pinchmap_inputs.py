"""What is authored on a PinchmapTexture shows; what is damaged is said once and shows inputs:fallback."""

import warnings

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdLux, UsdShade

import fexel
from bench.pinchmap_texture import (
    define_pinchmap,
    pinchmap_stage,
    random_pinchmap,
    save_texels,
    two_sides,
)
from bench.zipmap_stage import Patch, front_view, quad, render_texture, save, vertex_array, zipmap_stage, zipmap_texture
from fexel import images, mipmaps
from fexel.errors import FexelWarning
from fexel.renderer.program import ProgramCache, load_shader
from fexel.renderer.visible import visible_surface
from fexel.textures import extract_texture, pinchmap_twin
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.page_format import SNORM
from fexel.textures.pinchmap_encoding import encode_texels
from fexel.textures.pinchmap_lattice import Lattice
from fexel.textures.pinchmap_texels import PinchmapTexels
from fexel.textures.pinchmap_twin import cell_samples, picture_levels
from fexel.textures.system import TextureRequest, TextureSystem
from fexel_tools.pinchmap_mask import channels

VIEW = front_view((0, 0), (1, 1), 96, 72)
FALLBACK = (0.25, 0.5, 0.75, 1.0)


@pytest.fixture
def files(tmp_path, rng):
    """Signal and pinchmap of 16 x 12 texels, K = 1."""
    pinchmap, mask = random_pinchmap(rng)
    signal = save_texels(tmp_path / "signal.png", two_sides(rng, mask, 1))
    return signal, save_texels(tmp_path / "pinchmap.png", encode_texels(pinchmap))


def shown(gl, stage, path="/Pinchmap", time=0.0, system=None):
    return render_texture(gl, zipmap_texture(stage, path, time), quad(), VIEW, system)


def damaged(folder, texels, name="broken.tif"):
    return save_texels(folder / name, texels)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda _: "/nowhere/gone.png", r"gone\.png: no such file"),
        (lambda f: damaged(f, np.full((12, 16, 3), 127, np.uint8)), r"3 channels, expected 4 \(d_s, d_t, k, gamma\)"),
        (lambda f: damaged(f, np.full((12, 16, 1), 127, np.uint8)), "1 channels, expected 4"),
        (lambda f: damaged(f, np.full((12, 12, 4), 127, np.uint8)), "12 x 12 texels for a signal of 32 x 24, expected"),
        (lambda f: damaged(f, np.full((24, 16, 4), 127, np.uint8)), "16 x 24 texels for a signal of 32 x 24, expected"),
        (lambda f: damaged(f, np.full((8, 11, 4), 127, np.uint8)), "11 x 8 texels for a signal of 32 x 24, expected"),
        (lambda f: damaged(f, np.full((48, 64, 4), 127, np.uint8)), "64 x 48 texels for a signal of 32 x 24, expected"),
        (lambda f: damaged(f, np.full((12, 16, 4), np.nan, np.float32)), "not finite at column 0, row 0, expected"),
        (lambda f: damaged(f, np.full((12, 16, 4), np.inf, np.float32)), "not finite at column 0, row 0, expected"),
        (lambda f: text_file(f / "text.png"), r"text\.png: .*"),
        (lambda f: truncated(f), r"short\.png: .*"),
    ],
)
def test_damaged_pinchmap_is_said_once_and_its_fallback_shown(gl, tmp_path, files, make, message):
    stage = pinchmap_stage(files[0], make(tmp_path), fallback=FALLBACK, scale=(2, 2, 2, 1), bias=(0.5, 0, 0, 0))
    system = TextureSystem(gl)
    match = rf"^/Pinchmap\.inputs:pinchmap: .*{message}.*; inputs:fallback is shown$"
    with pytest.warns(FexelWarning, match=match) as caught:
        frames = [shown(gl, stage, system=system) for _ in range(2)]
    assert len(caught) == 1
    for frame in frames:
        assert np.abs(frame - FALLBACK).max() < 1e-3
    system.release()


def text_file(path):
    path.write_text("this is not a picture")
    return str(path)


def truncated(folder):
    whole = save_texels(folder / "whole.png", np.random.default_rng(1).integers(0, 254, (12, 16, 4)).astype(np.uint8))
    data = (folder / "whole.png").read_bytes()
    assert whole
    (folder / "short.png").write_bytes(data[: len(data) // 2])
    return str(folder / "short.png")


def test_missing_signal_is_said_once_and_its_fallback_shown(gl, files):
    stage = pinchmap_stage("/nowhere/gone.png", files[1], fallback=FALLBACK)
    with pytest.warns(
        FexelWarning, match=r"/Pinchmap\.inputs:file: .*no such file.*; inputs:fallback is shown"
    ) as caught:
        frame = shown(gl, stage)
    assert len(caught) == 1
    assert np.abs(frame - FALLBACK).max() < 1e-3


def test_damaged_pinchmap_of_a_patch_leaves_its_parent_to_be_seen(gl, tmp_path, files):
    base = save(tmp_path / "base.tif", np.full((32, 32, 4), [0, 0.5, 0, 1], np.float32))
    stage = zipmap_stage(Patch(base, np.eye(3), color_space="raw"))
    define_pinchmap(stage, "/Zipmap/logo", files[0], "/nowhere/gone.png")
    with pytest.warns(FexelWarning, match=r"/Zipmap/logo\.inputs:pinchmap: .*gone\.png") as caught:
        frame = shown(gl, stage, "/Zipmap")
    assert len(caught) == 1
    assert np.abs(frame - [0, 0.5, 0, 1]).max() < 3e-3


def test_pinchmap_without_a_pinchmap_is_a_plain_image(gl, files):
    stage = pinchmap_stage(files[0], "", wrapS="clamp", wrapT="clamp")
    plain = zipmap_stage(Patch(files[0], np.eye(3), color_space="raw"))
    assert np.abs(shown(gl, stage) - shown(gl, plain, "/Zipmap")).max() < 1e-5
    small = front_view((0.2, 0.2), (0.9, 0.9), 10, 8)
    system = TextureSystem(gl, anisotropy=1)
    textures = zipmap_texture(stage, "/Pinchmap"), zipmap_texture(plain)
    both = [render_texture(gl, texture, quad(), small, system) for texture in textures]
    assert np.abs(both[0] - both[1]).max() < 1e-5
    system.release()


def test_nan_in_the_signal_shows_as_in_any_image(gl, tmp_path, files):
    signal = np.full((24, 32, 4), 0.5, np.float32)
    signal[10, 10] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        frame = shown(gl, pinchmap_stage(save_texels(tmp_path / "nan.exr", signal), files[1]))
    assert np.isfinite(frame).all()


def test_scale_and_bias_decode_the_signal_before_it_is_shown(gl, files):
    plain = shown(gl, pinchmap_stage(*files, wrapS="clamp", wrapT="clamp"))
    scaled = shown(gl, pinchmap_stage(*files, wrapS="clamp", wrapT="clamp", scale=(2, 2, 2, 1), bias=(-1, -1, -1, 0)))
    assert np.abs(scaled[..., :3] - (2 * plain[..., :3] - 1)).max() < 2e-3
    assert (scaled[..., 3] == 1).all()


def test_scale_and_bias_of_a_patch_are_its_own(gl, tmp_path, files):
    """As in a zipmap of normals: root and patch decode alike, each once."""
    # Hard edges: anti-aliased ones differ by how derivatives are taken.
    decode = {"antialias": 0.0, "scale": (2, 2, 2, 1), "bias": (-1, -1, -1, 0)}
    base = save(tmp_path / "base.tif", np.full((32, 32, 4), [0.5, 0.5, 1, 1], np.float32))
    stage = zipmap_stage(Patch(base, np.eye(3), color_space="raw"))
    for name in ("scale", "bias"):
        stage.GetPrimAtPath("/Zipmap").CreateAttribute(f"inputs:{name}", Sdf.ValueTypeNames.Float4).Set(decode[name])
    define_pinchmap(stage, "/Zipmap/dent", *files, **decode, matrix=np.diag([2.0, 2.0, 1.0]))
    alone = pinchmap_stage(*files, **decode, wrapS="clamp", wrapT="clamp")
    whole = front_view((0.02, 0.02), (0.48, 0.48), 64, 64)
    twice = front_view((0.04, 0.04), (0.96, 0.96), 64, 64)
    patch = render_texture(gl, zipmap_texture(stage), quad(), whole)
    expected = render_texture(gl, zipmap_texture(alone, "/Pinchmap"), quad(), twice)
    assert np.quantile(np.abs(patch - expected), 0.999) < 2e-3
    outside = render_texture(gl, zipmap_texture(stage), quad(), front_view((0.6, 0.6), (0.9, 0.9), 8, 8))
    assert np.abs(outside - [0, 0, 1, 1]).max() < 0.01


def test_signal_of_one_texel_with_a_pinchmap_of_one_is_its_colour(gl, tmp_path):
    signal = save_texels(tmp_path / "one.png", np.full((1, 1, 4), [255, 51, 0, 255], np.uint8))
    for value in ([127, 127, 254, 127], [127, 127, 127, 127], [254, 254, 127, 200], [255, 255, 255, 255]):
        pinchmap = save_texels(tmp_path / f"map{value[0]}{value[2]}.png", np.full((1, 1, 4), value, np.uint8))
        frame = shown(gl, pinchmap_stage(signal, pinchmap, wrapS="clamp", wrapT="clamp"))
        assert np.abs(frame - [1, 0.2, 0, 1]).max() < 1e-3


@pytest.mark.parametrize("texel", [(254, 0, 127, 254), (0, 254, 254, 0), (254, 254, 0, 127), (127, 127, 127, 254)])
def test_illegal_pinchmaps_stay_finite(gl, tmp_path, rng, texel):
    noise = rng.integers(0, 255, (12, 16, 4)).astype(np.uint8)
    signal = save_texels(tmp_path / "signal.png", rng.integers(0, 255, (24, 32, 4)).astype(np.uint8))
    for number, texels in enumerate((np.broadcast_to(np.uint8(texel), noise.shape), noise)):
        file = save_texels(tmp_path / f"{number}.png", texels)
        for view in (VIEW, front_view((0.5, 0.5), (0.5001, 0.5001), 32, 32), front_view((0, 0), (1, 1), 3, 2)):
            stage = pinchmap_stage(signal, file, lineWidth=0.2, wrapS="repeat", wrapT="mirror")
            frame = render_texture(gl, zipmap_texture(stage, "/Pinchmap"), quad(), view)
            assert np.isfinite(frame).all()
            assert frame.min() >= 0
            assert frame.max() <= 1.0001


def test_time_samples_and_connections_are_followed(files):
    stage = pinchmap_stage(files[0], "")
    prim = stage.GetPrimAtPath("/Pinchmap")
    source = UsdShade.NodeGraph.Define(stage, "/Graph").CreateInput("map", Sdf.ValueTypeNames.Asset)
    source.Set(Sdf.AssetPath(files[1]), 1.0)
    source.Set(Sdf.AssetPath(""), 2.0)
    UsdShade.Input(prim.CreateAttribute("inputs:pinchmap", Sdf.ValueTypeNames.Asset)).ConnectToSource(source)
    prim.CreateAttribute("inputs:antialias", Sdf.ValueTypeNames.Float).Set(3.0, 1.0)
    kind, data = extract_texture(prim, 1.0)
    assert (kind, data.pinchmap, data.antialias) == ("pinchmap", files[1], 3.0)
    assert extract_texture(prim, 2.0)[1].pinchmap == ""
    again = extract_texture(prim, 1.0)[1]
    assert data == again
    assert hash(data) == hash(again)


@pytest.mark.parametrize(("name", "value"), [("antialias", -1.0), ("antialias", float("nan")), ("lineWidth", -0.5)])
def test_number_that_cannot_be_is_said_and_the_default_used(files, name, value):
    stage = pinchmap_stage(*files, **{name: value})
    with pytest.warns(
        FexelWarning, match=rf"^/Pinchmap\.inputs:{name}: is .*, expected a finite value from 0"
    ) as caught:
        _, data = extract_texture(stage.GetPrimAtPath("/Pinchmap"), 0.0)
    assert len(caught) == 1
    assert (data.antialias, data.line_width) == (1.0, 0.0)


@pytest.mark.parametrize(("alpha", "used"), [(1.5, 1.0), (-0.25, 0.0)])
def test_line_color_alpha_outside_of_its_range_is_said_and_clamped(files, alpha, used):
    stage = pinchmap_stage(*files, lineColor=(2.0, -1.0, 0.5, alpha))
    with pytest.warns(
        FexelWarning, match=rf"^/Pinchmap\.inputs:lineColor: has alpha {alpha}, expected 0 to 1"
    ) as caught:
        _, data = extract_texture(stage.GetPrimAtPath("/Pinchmap"), 0.0)
    assert len(caught) == 1
    assert data.line_color == (2.0, -1.0, 0.5, used)


def test_stats_tell_what_is_loaded(gl, files):
    texture = zipmap_texture(pinchmap_stage(*files), "/Pinchmap")
    system = TextureSystem(gl)
    render_texture(gl, texture, quad(), VIEW, system)
    near = system.stats()
    assert (near["patches_total"], near["patches_seen"]) == (1, 1)
    assert (near["images_resident"], near["levels_resident"]) == (2, 2)
    render_texture(gl, texture, quad(), front_view((0, 0), (1, 1), 4, 3), system)
    far = system.stats()
    assert far["levels_resident"] > 2
    assert far["images_resident"] == 4  # the picture's coarse levels, and what displaces nothing
    assert far["texture_bytes"] >= near["texture_bytes"] > 0
    system.release()


def test_coarse_levels_of_the_picture_do_not_need_the_finest_of_the_signal(rng):
    """So that a huge signal is not decoded whole for a view from far away."""
    pinchmap, mask = random_pinchmap(rng)
    levels = mipmaps.pyramid(two_sides(rng, mask, 5) / 255)
    whole, part = (picture_levels(pinchmap, levels[first:], line_width=0.1) for first in (0, 2))
    for one, other in zip(whole[5:], part[3:], strict=True):
        assert np.abs(one - other).max() < 1e-6


def test_picture_of_many_cells_is_averaged_from_fewer_samples(rng, monkeypatch):
    pinchmap, mask = random_pinchmap(rng, (24, 24))
    levels = mipmaps.pyramid(two_sides(rng, mask, 0) / 255)
    fine = picture_levels(pinchmap, levels)[1:]
    cells = Lattice(pinchmap, ("clamp", "clamp")).active_cells().sum()
    for samples, tolerance in ((4, 0.02), (2, 0.06)):
        monkeypatch.setattr(pinchmap_twin, "_MOST_SAMPLES", samples * samples * cells)
        assert cell_samples(pinchmap, ("clamp", "clamp")) == samples
        coarse = picture_levels(pinchmap, levels)[1:]
        error = np.sqrt(((coarse[0] - fine[0])[..., :3] ** 2).mean())
        assert 0 < error < tolerance
        assert np.abs(coarse[-1] - fine[-1]).max() < tolerance


def test_pinchmap_seen_so_small_that_nothing_is_displaced_is_not_loaded(gl, tmp_path, rng):
    pinchmap, mask = random_pinchmap(rng, (256, 256))
    files = (
        save_texels(tmp_path / "signal.png", two_sides(rng, mask, 1)),
        save_texels(tmp_path / "pinchmap.png", encode_texels(pinchmap)),
    )
    texture = zipmap_texture(pinchmap_stage(*files, wrapS="clamp", wrapT="clamp", lineWidth=0.5), "/Pinchmap")
    pages = {}
    for pixels in (60, 100, 120, 150):
        system = TextureSystem(gl)
        render_texture(gl, texture, quad(), front_view((0, 0), (1, 1), pixels, pixels), system)
        pages[pixels] = system.pool.atlases[SNORM].nbytes
        system.release()
    assert pages[60] == pages[100] < 4 * 256 * 256
    assert pages[120] == pages[150] >= 4 * 256 * 256  # a little is displaced


def test_pinchmap_whose_line_width_changes_keeps_no_picture_per_frame(gl, files):
    system = TextureSystem(gl)
    system.pool._kept._most = limit = 20000
    for width in np.linspace(0.1, 1.0, 40):
        texture = zipmap_texture(pinchmap_stage(*files, lineWidth=float(width)), "/Pinchmap")
        render_texture(gl, texture, quad(), front_view((0, 0), (1, 1), 4, 3), system)
    assert system.pool._kept.nbytes <= limit
    system.release()


def test_pinchmap_file_that_is_gone_when_it_is_read_again_is_said(files):
    reader = PinchmapTexels()
    source = reader.source(files[1], "/Pinchmap", images.image_info(files[0]), ("clamp", "clamp"))
    before = reader.window(source, "/Pinchmap", 0, (0, 0, 16, 12))
    reader._kept = KeptTexels()
    assert np.array_equal(reader.window(source, "/Pinchmap", 0, (0, 0, 16, 12)), before)
    reader._kept = KeptTexels()
    save_texels(files[1], np.full((3, 4, 4), 127, np.uint8))
    with pytest.warns(FexelWarning, match="has changed since it was first read; the plain image is shown"):
        plain = reader.window(source, "/Pinchmap", 0, (0, 0, 16, 12))
    assert plain.shape == before.shape
    assert not plain[..., :2].any()


def test_pinchmap_is_never_dropped_for_want_of_memory(gl, tmp_path, rng):
    pinchmap, mask = random_pinchmap(rng)
    signal = save_texels(tmp_path / "large.png", two_sides(rng, mask, 6))
    files = signal, save_texels(tmp_path / "pinchmap.png", encode_texels(pinchmap))
    texture = zipmap_texture(pinchmap_stage(*files, wrapS="clamp", wrapT="clamp"), "/Pinchmap")
    view = front_view((0, 0), (1, 1), 1024, 768)
    whole = render_texture(gl, texture, quad(), view)
    system = TextureSystem(gl, memory_mb=0.5)
    with pytest.warns(FexelWarning, match="texture memory"):
        small = render_texture(gl, texture, quad(), view, system)
    assert np.abs(whole - small).mean() < 0.1  # noise is averaged, sides stay apart
    side = whole[..., 0] > 0.5
    assert ((small[..., 0] > 0.5) == side).mean() > 0.98
    system.release()


def lit_quad(stage, inputs):
    """A material whose inputs read these texture prims, (input, prim, output), on a quad under a slanting light."""
    surface = UsdShade.Shader.Define(stage, "/Material/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    names = Sdf.ValueTypeNames
    for name, prim, output in inputs:
        kind = names.Float if output != "rgb" else names.Normal3f if name == "normal" else names.Color3f
        of_texture = names.Float3 if output == "rgb" else names.Float
        source = UsdShade.NodeGraph(stage.GetPrimAtPath(prim)).CreateOutput(output, of_texture)
        surface.CreateInput(name, kind).ConnectToSource(source)
    material = UsdShade.Material.Define(stage, "/Material")
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    mesh = UsdGeom.Mesh.Define(stage, "/Quad")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr("none")
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", names.TexCoord2fArray, "vertex")
    st.Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    camera = UsdGeom.Camera.Define(stage, "/Camera")
    camera.CreateProjectionAttr("orthographic")
    camera.CreateHorizontalApertureAttr(10.0)
    camera.CreateVerticalApertureAttr(10.0)
    UsdGeom.XformCommonAPI(camera).SetTranslate(Gf.Vec3d(0.5, 0.5, 2))
    light = UsdLux.DistantLight.Define(stage, "/Light")
    UsdGeom.XformCommonAPI(light).SetRotate(Gf.Vec3f(0, 50, 0))
    light.CreateNormalizeAttr(True)
    light.CreateIntensityAttr(3.0)
    return stage


def picture(stage, width=64):
    return fexel.render(stage, camera="/Camera", width=width)["color"]


def test_every_input_of_a_material_can_be_a_pinchmap(tmp_path, rng):
    """Halves of a sheet that differ in one input are as two sheets of that input: the crease is where gamma puts it."""
    mask = np.zeros((8, 8), bool)
    mask[:, 4:] = True
    pinchmap = np.concatenate([channels(mask), np.zeros((8, 8, 1))], -1)
    file = save_texels(tmp_path / "pinchmap.png", encode_texels(pinchmap))
    values = {
        "diffuseColor": ("rgb", (51, 102, 204), (204, 51, 51)),
        "normal": ("rgb", (127, 127, 255), (200, 127, 230)),
        "roughness": ("r", (51, 51, 51), (230, 230, 230)),
        "opacity": ("a", (255, 255, 255), (255, 255, 255)),
        "metallic": ("g", (0, 0, 0), (255, 255, 255)),
    }
    for name, (output, left, right) in values.items():
        sides = np.concatenate([np.uint8([left, right]), np.uint8([[255], [255 if name != "opacity" else 64]])], 1)
        signals = [sides[mask.astype(int)], np.broadcast_to(sides[0], (8, 8, 4)), np.broadcast_to(sides[1], (8, 8, 4))]
        frames = []
        for number, texels in enumerate(signals):
            signal = save_texels(tmp_path / f"{name}{number}.png", texels)
            extra = {"scale": (2, 2, 2, 1), "bias": (-1, -1, -1, 0)} if name == "normal" else {}
            stage = pinchmap_stage(signal, file if number == 0 else "", wrapS="clamp", wrapT="clamp", **extra)
            frames.append(picture(lit_quad(stage, [(name, "/Pinchmap", output)])))
        assert np.abs(frames[0][:, 2:31] - frames[1][:, 2:31]).max() < 2e-3, name
        assert np.abs(frames[0][:, 33:62] - frames[2][:, 33:62]).max() < 2e-3, name
        assert np.abs(frames[1] - frames[2])[:, 2:62].max() > 0.01, name


def test_several_pinchmaps_and_a_zipmap_in_one_material_are_each_as_alone(gl, tmp_path, rng):
    """More pinchmaps than varyings have room for, so that some go by records, beside a zipmap that holds one more."""
    view = front_view((0, 0), (1, 1), 64, 64)
    surface = visible_surface(quad(), view, ["st"])
    textures = []
    for number in range(6):
        pinchmap, mask = random_pinchmap(rng, (16, 16))
        signal = save_texels(tmp_path / f"s{number}.png", two_sides(rng, mask, number % 3))
        file = save_texels(tmp_path / f"p{number}.png", encode_texels(pinchmap))
        options = {"lineWidth": 0.1, "lineColor": (1, 0, 0, 1)} if number == 1 else {}
        textures.append(
            zipmap_texture(pinchmap_stage(signal, file, wrapS="clamp", wrapT="clamp", **options), "/Pinchmap")
        )
    base = save(tmp_path / "base.tif", np.full((32, 32, 4), [0, 0.5, 0, 1], np.float32))
    stage = zipmap_stage(Patch(base, np.eye(3), color_space="raw"))
    define_pinchmap(stage, "/Zipmap/logo", signal, file, matrix=np.diag([2.0, 2.0, 1.0]))
    textures.append(zipmap_texture(stage))
    system = TextureSystem(gl)
    requests = [TextureRequest(texture, surface) for texture in textures]
    system.begin_view(requests)
    binding = system.binding(requests)
    assert binding.includes == ("pinchmap.glsl", "zipmap.glsl")
    assert binding.defines["PINCHMAP_RECORDS"] == binding.defines["PINCHMAP_FAST"] == 1
    alone = [render_texture(gl, texture, quad(), view, system) for texture in textures]
    system.begin_view(requests)
    binding = system.binding(requests)
    for number, texture in enumerate(textures):
        together = one_of_many(gl, binding, texture.kind, binding.defines[f"TEXTURE{number}_NUMBER"], view)
        error = np.abs(together - alone[number]).max(axis=-1)
        assert np.quantile(error, 0.9) < 1e-3, number  # transitions: derivatives between pixels or exact
        assert error.max() < 0.35, number
    system.release()


@pytest.mark.parametrize("pixels", [64, 6000])  # by the filters of hardware, and by records
def test_pinchmap_shaders_compile_as_glsl_es(gl, files, pixels):
    texture = zipmap_texture(pinchmap_stage(*files, lineWidth=0.1), "/Pinchmap")
    high = 64 / pixels
    view = front_view((0.5 - high / 2, 0.5 - high / 2), (0.5 + high / 2, 0.5 + high / 2), 64, 64)
    system = TextureSystem(gl)
    requests = [TextureRequest(texture, visible_surface(quad(), view, ["st"]))]
    system.begin_view(requests)
    binding = system.binding(requests)
    assert binding.defines["PINCHMAP_RECORDS"] == (pixels > 1000)
    head = "#version 300 es\nprecision highp float;\nprecision highp int;\nprecision highp sampler2D;"
    defines = binding.defines | {"TEXTURE_SAMPLE": "pinchmap_sample", "TEXTURE_AOVS": 1}
    sources = [load_shader("texture_view.vert", defines), load_shader("texture_view.frag", defines, binding.includes)]
    vertex, fragment = (source.text.replace("#version 330 core", head) for source in sources)
    assert head in fragment
    gl.program(vertex_shader=vertex, fragment_shader=fragment).release()
    system.release()


def one_of_many(gl, binding, kind, number, view):
    """The picture of one texture of a material: what `render_texture` makes of it alone."""
    target = gl.texture((view.width, view.height), 4, dtype="f4")
    framebuffer = gl.framebuffer([target])
    framebuffer.use()
    framebuffer.clear()
    defines = binding.defines | {"TEXTURE_SAMPLE": f"{kind}_sample", "TEXTURE_NUMBER": number, "TEXTURE_AOVS": 0}
    program = ProgramCache(gl).get("texture_view.vert", "texture_view.frag", defines, binding.includes)
    binding.apply(program)
    vertex_array(gl, program, quad(), visible_surface(quad(), view, ["st"]), view).render()
    result = np.frombuffer(target.read(), np.float32).reshape(view.height, view.width, 4)[::-1].copy()
    gl.detect_framebuffer(0).use()
    framebuffer.release()
    target.release()
    return result
