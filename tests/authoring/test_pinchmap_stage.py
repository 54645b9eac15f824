"""The stage of a pinchmap: what is connected to what, and that every application can read it."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

import fexel
from fexel.errors import FexelError
from fexel.validators import validate
from fexel_tools import fallback
from fexel_tools.image_files import write_image
from fexel_tools.pinchmap_stage import DRIVEN_INPUTS, TEXTURE_PATH, PinchmapPrim, busiest_window, create_stage
from fexel_tools.pinchmap_textures import as_stored, write_pinchmap, write_signal

SURFACE = "/World/Materials/Pinchmap/Surface"


@pytest.fixture
def author(tmp_path):
    """Function (**of PinchmapPrim) -> stage with files and fallback, saved."""

    def make(aspect=1.5, **settings):
        is_data = settings.get("drives", "diffuseColor") not in ("diffuseColor", "emissiveColor")
        has_alpha = settings.setdefault("has_alpha", not is_data)
        texels = np.zeros((4, 6, 4))
        texels[..., 2] = 1.0
        write_pinchmap(tmp_path, texels, "8")
        signal = np.full((4, 6, 4), 0.5, np.float32)
        written = write_signal(tmp_path, signal, 8, is_data=is_data, has_alpha=has_alpha)
        prim = PinchmapPrim("./signal.png", "./pinchmap.png", written.color_space, **settings)
        stage = create_stage(tmp_path / "stage.usda", prim, aspect)
        fallback.write_fallback(stage.GetPrimAtPath(TEXTURE_PATH), tmp_path / "fallback.png", 64)
        stage.GetRootLayer().Save()
        return stage

    return make


def source_of(stage, name):
    """Prim path and output that drive an input of the surface."""
    sources, invalid = UsdShade.Shader(stage.GetPrimAtPath(SURFACE)).GetInput(name).GetConnectedSources()
    assert not invalid and len(sources) == 1
    return str(sources[0].source.GetPath()), sources[0].sourceName


@pytest.mark.parametrize("drives", sorted(DRIVEN_INPUTS))
def test_stage_has_no_fault(author, drives):
    """fexel's validators and all of USD's."""
    assert validate(author(drives=drives, is_biased=drives == "normal")) == []


@pytest.mark.parametrize(
    ("drives", "output"),
    [("diffuseColor", "rgb"), ("emissiveColor", "rgb"), ("normal", "rgb"), ("roughness", "r"), ("opacity", "r")],
)
def test_texture_drives_what_it_is_asked_to(author, drives, output):
    stage = author(drives=drives)
    assert source_of(stage, drives) == (TEXTURE_PATH, output)


def test_alpha_blends_and_is_not_cut_off(author):
    """The anti-aliased edge is a partial alpha: a threshold would turn it into stairs."""
    stage = author()
    assert source_of(stage, "opacity") == (TEXTURE_PATH, "a")
    surface = UsdShade.Shader(stage.GetPrimAtPath(SURFACE))
    assert not surface.GetInput("opacityThreshold")
    assert surface.GetInput("ior").Get() == 1.0, "what is transparent must not reflect"


def test_opaque_texture_leaves_opacity_alone(author):
    stage = author(has_alpha=False)
    assert not UsdShade.Shader(stage.GetPrimAtPath(SURFACE)).GetInput("opacity")


def test_pinchmap_is_raw_and_what_is_not_asked_for_is_not_authored(author):
    stage = author(wrap=("repeat", "clamp"))
    texture = fexel.PinchmapTexture(stage.GetPrimAtPath(TEXTURE_PATH))
    assert texture.GetPinchmapAttr().GetColorSpace() == "raw"
    assert (texture.GetWrapSAttr().Get(), texture.GetWrapTAttr().Get()) == ("repeat", "clamp")
    assert texture.GetSourceColorSpaceAttr().Get() == "sRGB"
    assert not texture.GetLineWidthAttr().HasAuthoredValue()
    assert not texture.GetScaleAttr().HasAuthoredValue()


def test_line_is_authored(author):
    stage = author(line_width=0.3, line_color=(1.0, 0.5, 0.0, 0.5), antialias=2.0)
    texture = fexel.PinchmapTexture(stage.GetPrimAtPath(TEXTURE_PATH))
    assert texture.GetLineWidthAttr().Get() == pytest.approx(0.3)
    assert texture.GetLineColorAttr().Get() == Gf.Vec4f(1.0, 0.5, 0.0, 0.5)
    assert texture.GetAntialiasAttr().Get() == 2.0


def test_stored_normals_are_decoded_in_both_networks(author):
    stage = author(drives="normal", is_biased=True)
    for path in (TEXTURE_PATH, f"{TEXTURE_PATH}/Fallback"):
        prim = stage.GetPrimAtPath(path)
        assert prim.GetAttribute("inputs:scale").Get() == Gf.Vec4f(2, 2, 2, 1)
        assert prim.GetAttribute("inputs:bias").Get() == Gf.Vec4f(-1, -1, -1, 0)
        assert prim.GetAttribute("inputs:sourceColorSpace").Get() == "raw"


def test_fallback_is_self_contained(author):
    """Nothing inside is connected to the prim's own inputs, which importers do not follow."""
    stage = author()
    for prim in Usd.PrimRange(stage.GetPrimAtPath(TEXTURE_PATH)):
        for attribute in prim.GetAttributes():
            for target in attribute.GetConnections():
                assert str(target).startswith(
                    (f"{TEXTURE_PATH}/Fallback.outputs", f"{TEXTURE_PATH}/FallbackSt.outputs")
                )


def test_without_the_plugin_the_prim_is_a_node_graph(author):
    types = author().GetMetadata("fallbackPrimTypes")
    assert list(types["PinchmapTexture"]) == ["NodeGraph"]


def test_quad_has_the_aspect_and_the_first_camera_sees_it_whole(author):
    stage = author(aspect=1.5)
    points = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/World/Surface")).GetPointsAttr().Get())
    assert np.ptp(points, axis=0)[:2].tolist() == [1.5, 1.0]
    cameras = [p for p in stage.Traverse() if p.IsA(UsdGeom.Camera)]
    assert [c.GetName() for c in cameras] == ["Overview", "Detail"]
    frustum = UsdGeom.Camera(cameras[0]).GetCamera(Usd.TimeCode.Default()).frustum
    assert all(frustum.Intersects(Gf.Vec3d(*(0.999 * point).tolist())) for point in points)
    assert not any(frustum.Intersects(Gf.Vec3d(*(1.01 * point).tolist())) for point in points), "and fills the picture"


def test_close_up_is_where_the_lines_are():
    mask = np.zeros((20, 40), bool)
    assert busiest_window(mask) is None
    mask[3:5, 30:33] = True
    corners = busiest_window(mask)
    low, high = corners.min(axis=0), corners.max(axis=0)
    assert (high - low == [5 / 40, 5 / 20]).all()
    assert low[0] <= 30 / 40 and high[0] >= 33 / 40 and low[1] <= 1 - 5 / 20 and high[1] >= 1 - 3 / 20


def test_close_up_of_a_tiny_map_stays_inside():
    mask = np.zeros((4, 4), bool)
    mask[:, 2:] = True
    corners = busiest_window(mask)
    assert corners.min() == 0.0 and corners.max() == 1.0


@pytest.mark.parametrize(("bits", "tolerance"), [("8", 0.5 / 127), ("16", 0.5 / 32767), ("float", 1e-7)])
def test_pinchmap_file_holds_the_texels(tmp_path, rng, bits, tolerance):
    from fexel.images import image_info, read_pixels
    from fexel.textures.pinchmap_encoding import decode_texels

    texels = rng.uniform(-1, 1, (5, 7, 4))
    path, nbytes = write_pinchmap(tmp_path, texels, bits)
    read = decode_texels(read_pixels(image_info(str(path))))
    assert np.abs(read - texels).max() <= tolerance
    assert np.array_equal(read, as_stored(texels, bits)), "the signal is fitted to what will be read"
    assert nbytes == texels.size * {"8": 1, "16": 2, "float": 4}[bits]


@pytest.mark.parametrize(("bits", "tolerance"), [(8, 0.01), (16, 1e-4), (32, 1e-3)])
@pytest.mark.parametrize("has_alpha", [True, False])
def test_signal_file_holds_the_colours(tmp_path, rng, bits, tolerance, has_alpha):
    from fexel.images import image_info, read_linear

    signal = rng.random((4, 6, 4)).astype(np.float32)
    written = write_signal(tmp_path, signal, bits, is_data=False, has_alpha=has_alpha)
    assert written.color_space == ("raw" if bits == 32 else "sRGB")
    alpha = signal[..., 3:] if has_alpha else np.ones_like(signal[..., 3:])
    read = read_linear(str(written.path), written.color_space)
    assert np.abs(read - np.concatenate([signal[..., :3] * alpha, alpha], axis=-1)).max() < tolerance
    assert written.nbytes == 24 * (4 if has_alpha else 3) * {8: 1, 16: 2, 32: 2}[bits]
    assert image_info(str(written.path)).channels == (4 if has_alpha else 3)


def test_picture_is_written_beside_and_a_fault_leaves_nothing(tmp_path):
    with pytest.raises(FexelError, match=r"^[^\n]*nowhere[^\n]*$"):
        write_image(tmp_path / "nowhere" / "a.png", np.zeros((2, 2, 3), np.uint8))
    with pytest.raises(FexelError, match=r"^[^\n]*a\.nonsense[^\n]*$"):
        write_image(tmp_path / "a.nonsense", np.zeros((2, 2, 3), np.uint8))
    assert not list(tmp_path.iterdir())


def test_asset_paths_are_relative(author):
    stage = author()
    files = [
        value.path
        for prim in stage.Traverse()
        for attribute in prim.GetAttributes()
        if isinstance(value := attribute.Get(), Sdf.AssetPath)
    ]
    assert sorted(files) == ["./fallback.png", "./pinchmap.png", "./signal.png"]
