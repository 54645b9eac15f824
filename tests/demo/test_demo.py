"""`make demo`: photos to a stage, a zoom with and without patches, a contact sheet; pinchmaps, umbrellas; filters."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import fexel
from fexel.filters import PORTABLE_FILTERS
from fexel.images import srgb_to_linear
from fexel_tools import demo, demo_fipmap, demo_pinchmap, demo_umbrella, demo_zipmap

oiio = pytest.importorskip("OpenImageIO")


@pytest.fixture(scope="module")
def finished(tmp_path_factory, _gl_session):
    """One run on the bundled photos: two small frames, the first and the last of the zoom."""
    output = tmp_path_factory.mktemp("demo") / "out"
    with warnings.catch_warnings():  # the direct match across 10x is moved content and is left out, with a warning
        warnings.simplefilter("ignore", fexel.FexelWarning)
        return demo_zipmap.make_zipmap_demo(demo_zipmap.bundled_photos(), output, frames=2, width=160)


def pixels(path):
    return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)


def sharpness(image):
    return np.abs(np.diff(image, axis=0)).mean() + np.abs(np.diff(image, axis=1)).mean()


def test_demo_places_all_three_photos_in_one_nest(finished):
    stage = Usd.Stage.Open(str(finished.stage))
    patches = fexel.ZipmapTexture.Get(stage, demo_zipmap.TEXTURE_PATH).GetPatches()
    assert [patch.depth for patch in patches] == [0, 1, 2]
    assert not [finding for finding in fexel.validate(stage) if finding.severity == "error"]


def test_patches_show_where_the_zoom_ends_and_hardly_where_it_begins(finished):
    zipmap, root = ([pixels(path) for path in finished.frames[name]] for name in ("zipmap", "root"))
    assert np.abs(zipmap[0] - root[0]).mean() < 0.02
    assert sharpness(zipmap[1]) > 2 * sharpness(root[1])


def test_root_alone_is_an_override_that_leaves_the_stage_as_it_is(finished):
    before = finished.stage.read_bytes()
    stage = Usd.Stage.Open(str(finished.stage))
    demo_zipmap.root_texture_alone(stage)
    assert len(fexel.ZipmapTexture.Get(stage, demo_zipmap.TEXTURE_PATH).GetPatches()) == 1
    assert not stage.GetRootLayer().dirty
    assert finished.stage.read_bytes() == before


def test_contact_sheet_holds_every_frame(finished):
    sheet = pixels(finished.sheet)
    height, width, _ = pixels(finished.frames["zipmap"][0]).shape
    assert sheet.shape[0] > 2 * height and sheet.shape[1] > 2 * width


def test_camera_of_the_demo_goes_from_the_overview_past_the_detail(finished):
    stage = Usd.Stage.Open(str(finished.stage))
    magnifications = demo_zipmap.add_camera(stage, 12)
    steps = np.diff(np.log(magnifications))
    np.testing.assert_allclose(steps, steps[0])
    camera = UsdGeom.Camera.Get(stage, demo_zipmap.CAMERA)
    zoom = UsdGeom.Camera.Get(stage, "/World/Cameras/Zoom")
    eyes = np.array([camera.ComputeLocalToWorldTransform(frame).ExtractTranslation() for frame in range(1, 13)])
    start, end = (zoom.ComputeLocalToWorldTransform(frame).ExtractTranslation() for frame in (1, 48))
    np.testing.assert_allclose(eyes[0], start)
    np.testing.assert_allclose(eyes[:, 2], eyes[0, 2] / np.array(magnifications), rtol=2e-3)  # the wall is at z = 0
    assert eyes[-1, 2] < 0.5 * end[2]
    assert not stage.GetRootLayer().dirty


def test_missing_photo_is_one_line_and_leaves_no_stage(tmp_path, capsys):
    status = demo.main(["--photos", str(tmp_path / "none.jpg"), "--output", str(tmp_path / "out")])
    captured = capsys.readouterr()
    assert status == 1 and captured.out == ""
    assert captured.err.startswith("fexel: ") and "none.jpg" in captured.err and captured.err.count("\n") == 1
    assert not list((tmp_path / "out").glob("*.usda"))


@pytest.fixture(scope="module")
def pinched(tmp_path_factory, _gl_session):
    """The drawing alone, small pictures."""
    output = tmp_path_factory.mktemp("pinchmap") / "out"
    output.mkdir()
    source = demo_pinchmap.bundled_sources()[0]
    with fexel.Renderer() as renderer:
        return output, demo_pinchmap.comparison(renderer, source, output / "fish.usda", 160)


def test_pinchmap_is_sharp_close_up_where_a_plain_texture_of_as_many_bytes_is_not(pinched):
    _, row = pinched
    pinchmap, plain = (np.diff(picture.astype(float), axis=1) for picture in row.pictures[2:])
    assert np.abs(pinchmap).max() > 100 > 2 * np.abs(plain).max()


def test_pinchmap_and_plain_texture_show_the_same_from_afar(pinched):
    """Averages of light over 8 x 8 pixels, two texels of the plain texture."""
    _, row = pinched
    linear = (srgb_to_linear(picture / np.float32(255)) for picture in row.pictures[:2])
    pinchmap, plain = (picture.reshape(20, 8, 20, 8, 3).mean((1, 3)) for picture in linear)
    assert np.abs(pinchmap - plain).mean() < 0.02
    assert np.ptp(pinchmap) > 0.7


def test_plain_texture_has_no_more_bytes_than_the_pinchmap(pinched):
    output, row = pinched
    columns = [
        oiio.ImageInput.open(str(output / name)).spec() for name in ("fish_plain.png", "fish_textures/signal.png")
    ]
    plain, signal = (spec.width * spec.height * spec.nchannels for spec in columns)
    assert 0.97 * 2 * signal < plain <= 2 * signal  # the map is as large as the signal
    assert f"{plain} bytes" in row.label


def test_stages_of_the_demo_stay_as_the_command_wrote_them(pinched):
    """The plain texture is an override of the session layer."""
    output, _ = pinched
    stage = Usd.Stage.Open(str(output / "fish.usda"))
    assert "plain" not in stage.GetRootLayer().ExportToString()
    assert not [finding for finding in fexel.validate(stage) if finding.severity == "error"]


@pytest.fixture(scope="module")
def strewn(tmp_path_factory, _gl_session):
    """Two of the leaves on a small ground, small pictures."""
    output = tmp_path_factory.mktemp("umbrella") / "out"
    leaves, settings = demo_umbrella.bundled_sources()
    settings = replace(settings, grid=(12, 6), count=200, texture_size=128, fallback_size=64)
    return demo_umbrella.make_umbrella_demo(leaves[-2:], settings, output, 160)


def test_ground_is_sharp_close_up_where_a_plain_texture_of_as_many_bytes_is_not(strewn):
    """The last pictures of the two rows; the horizon is the same in both."""
    sheet = pixels(strewn.sheet)[..., :3]
    close = [sharpness(srgb_to_linear(part)) for part in pictures_of(sheet, -1)]
    assert close[0] > 1.5 * close[1]
    far, plain = (srgb_to_linear(part) for part in pictures_of(sheet, 0))
    assert np.abs(far - plain).mean() < 0.03


def pictures_of(sheet, column):
    """Both pictures of a column of the umbrellas' sheet: five across, rows below labels of 24 pixels, gaps of 6."""
    left = 6 + (column % 5) * 166
    return [sheet[top : top + 90, left : left + 160] for top in (24, 138)]


def test_plain_texture_has_no_more_texels_than_umbrellas_have_words(strewn):
    stage = Usd.Stage.Open(str(strewn.stage))
    texture = fexel.UmbrellaTexture.Get(stage, "/World/Materials/Umbrella/Texture")
    sizes = [oiio.ImageInput.open(patch.GetFileAttr().Get().resolvedPath).spec() for patch in texture.GetPatches()]
    words = sum(spec.width * spec.height for spec in sizes) + 3 * len(texture.GetColorsAttr().Get())
    width, height = strewn.plain
    assert words < width * height < 1.3 * words


def test_stage_of_the_ground_stays_as_the_command_wrote_it(strewn):
    stage = Usd.Stage.Open(str(strewn.stage))
    assert "plain" not in stage.GetRootLayer().ExportToString()
    assert not [finding for finding in fexel.validate(stage) if finding.severity == "error"]


@pytest.fixture(scope="module")
def minified(tmp_path_factory, _gl_session):
    """Both bundled stages with every filter that a stage may name, and the reference; small pictures."""
    tokens, output = (*PORTABLE_FILTERS, "ewa"), tmp_path_factory.mktemp("fipmap") / "out"
    return demo_fipmap.make_fipmap_demo(demo_fipmap.bundled_views(), output, 240, tokens)


def test_minification_is_a_part_of_the_demo_after_the_kinds():
    assert list(demo.parts()) == ["zipmap", "pinchmap", "umbrella", "fipmap"]


def test_fipmap_is_better_than_mipmap_and_ripmap_at_both_views(minified):
    for view in {name for name, _ in minified.figures}:
        quality = {token: minified.figures[view, token].psnr_db for token in PORTABLE_FILTERS}
        assert quality["fipmap"] > quality["ripmap"] + 5 > quality["mipmap"] + 8


def test_fipmap_fetches_no_more_than_sixteen_texels_and_the_default_many_more_at_grazing_view(minified):
    for (_, token), figures in minified.figures.items():
        assert token != "fipmap" or figures.fetches <= 16
        assert token != "anisotropic" or figures.fetches > 40


def test_layers_of_the_demo_are_what_the_command_writes(minified):
    assert len(minified.layers) == 2 * len(PORTABLE_FILTERS)
    for layer in minified.layers:
        stage = Usd.Stage.Open(str(layer))
        found = [fexel.TextureMinificationAPI(prim) for prim in stage.Traverse()]
        assert [api.GetFilterAttr().Get() for api in found if api] == [layer.stem.rpartition("_")[2]]


def test_sheet_shows_all_filters_and_what_would_be_right(minified):
    sheet = pixels(minified.sheet)
    assert sheet.shape[1] == 6 + (len(PORTABLE_FILTERS) + 2) * (240 + 6)
    assert sheet.shape[0] > 2 * 240
