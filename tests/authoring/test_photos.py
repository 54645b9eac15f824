"""Photos of every kind come out upright, linear and finite; what cannot be read is refused with the reason."""

from __future__ import annotations

import numpy as np
import pytest

from fexel.errors import FexelError, FexelWarning
from fexel.images import srgb_to_linear
from fexel_tools.photos import load_photo, load_preview, probe_photo
from tests.authoring.synthetic_photos import write_image

TINY = 1.0 / 65535.0


@pytest.fixture
def picture(rng):
    return rng.integers(0, 256, (30, 41, 3), dtype=np.uint8)


def linear(picture):
    return srgb_to_linear(picture.astype(np.float32) / 255.0)


@pytest.mark.parametrize(
    ("name", "convert", "tolerance"),
    [
        ("p.png", lambda p: p, 0.0),
        ("p.tif", lambda p: p, 0.0),
        ("p16.png", lambda p: p.astype(np.uint16) * 257, 1e-6),
        ("p16.tif", lambda p: p.astype(np.uint16) * 257, 1e-6),
        ("half.exr", lambda p: linear(p).astype(np.float16), 1e-3),
        ("float.exr", linear, 1e-6),
        ("float.tif", linear, 1e-6),
    ],
)
def test_every_pixel_format_gives_the_same_linear_light(tmp_path, picture, name, convert, tolerance):
    photo = probe_photo(write_image(tmp_path / name, convert(picture)))
    assert (photo.width, photo.height) == (41, 30)
    rgb, alpha = load_photo(photo)
    assert rgb.dtype == np.float32
    assert alpha is None
    np.testing.assert_allclose(rgb, linear(picture), atol=tolerance)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation_is_applied(tmp_path, orientation):
    """A picture whose four corners differ, stored so that each orientation shows it upright."""
    shown = np.zeros((32, 48, 3), np.uint8)
    shown[:16, :24], shown[:16, 24:], shown[16:, :24] = (200, 0, 0), (0, 200, 0), (0, 0, 200)
    stored = {  # how each EXIF orientation stores what is shown (EXIF 2.3, tag 274)
        1: shown,
        2: shown[:, ::-1],
        3: shown[::-1, ::-1],
        4: shown[::-1],
        5: shown.transpose(1, 0, 2),
        6: np.rot90(shown),
        7: shown[::-1, ::-1].transpose(1, 0, 2),
        8: np.rot90(shown, -1),
    }[orientation]
    file = write_image(tmp_path / "p.jpg", np.ascontiguousarray(stored), Orientation=orientation, CompressionQuality=98)
    photo = probe_photo(file)
    assert (photo.width, photo.height) == (48, 32)
    preview = load_preview(photo)
    np.testing.assert_allclose(preview[8:32:16, 12:48:24], shown[8:32:16, 12:48:24], atol=12)
    rgb, _ = load_photo(photo)
    np.testing.assert_allclose(rgb[8, 12], linear(shown)[8, 12], atol=0.06)


def test_alpha_is_kept_straight_and_colours_are_not_multiplied(tmp_path, picture):
    alpha = np.linspace(40, 255, 41).astype(np.uint8)[None, :, None].repeat(30, axis=0)
    pixels = np.concatenate([picture, alpha], axis=2)
    file = write_image(tmp_path / "p.png", pixels, oiio__UnassociatedAlpha=1)
    rgb, mask = load_photo(probe_photo(file))
    np.testing.assert_allclose(rgb, linear(picture), atol=1e-6)
    np.testing.assert_allclose(mask, alpha[..., 0] / 255.0, atol=1e-6)


def test_associated_alpha_of_exr_is_divided_out(tmp_path, picture):
    alpha = np.full((30, 41, 1), 0.5, np.float32)
    pixels = np.concatenate([linear(picture) * alpha, alpha], axis=2)
    rgb, mask = load_photo(probe_photo(write_image(tmp_path / "p.exr", pixels)))
    np.testing.assert_allclose(rgb, linear(picture), atol=1e-5)
    np.testing.assert_allclose(mask, 0.5)


def test_nan_and_infinity_become_black_and_transparent_with_a_warning(tmp_path, picture):
    pixels = linear(picture).copy()
    pixels[3, 5, 1], pixels[7, 9, 0] = np.nan, np.inf
    photo = probe_photo(write_image(tmp_path / "p.exr", pixels))
    with pytest.warns(FexelWarning, match=r"p\.exr: 2 pixels"):
        rgb, mask = load_photo(photo)
    assert np.isfinite(rgb).all()
    assert mask[3, 5] == mask[7, 9] == 0.0
    assert mask.sum() == mask.size - 2


def test_grey_photo_is_three_equal_channels(tmp_path, picture):
    rgb, _ = load_photo(probe_photo(write_image(tmp_path / "p.png", picture[..., :1])))
    assert rgb.shape == (30, 41, 3)
    np.testing.assert_array_equal(rgb[..., 0], rgb[..., 2])


@pytest.mark.parametrize(
    ("space", "white", "red"),
    [("srgb_p3d65_scene", 1.0, (1.2249, 0.0, 0.0)), ("lin_rec709_scene", 1.0, (1.0, 0.0, 0.0))],
)
def test_stated_colour_space_is_converted(tmp_path, space, white, red):
    """Display P3 red is 1.2249 Rec.709 red and out of gamut elsewhere, where negative light is cut off."""
    pixels = np.zeros((16, 16, 3), np.uint16)
    pixels[:8], pixels[8:, :, 0] = 65535, 65535
    file = write_image(tmp_path / "p.png", pixels, oiio__ColorSpace=space)
    rgb, _ = load_photo(probe_photo(file))
    np.testing.assert_allclose(rgb[0, 0], white, atol=2e-3)
    np.testing.assert_allclose(rgb[15, 0], red, atol=2e-3)


def test_exr_chromaticities_are_converted(tmp_path):
    """White stays white whatever the primaries; ACES AP0 green is outside Rec.709."""
    pixels = np.ones((16, 16, 3), np.float32)
    pixels[8:] = (0.0, 1.0, 0.0)
    ap0 = np.array([0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767], np.float32)
    import OpenImageIO as oiio

    spec = oiio.ImageSpec(16, 16, 3, "float")
    spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), tuple(float(v) for v in ap0))
    output = oiio.ImageOutput.create(str(tmp_path / "p.exr"))
    assert output.open(str(tmp_path / "p.exr"), spec)
    output.write_image(pixels)
    output.close()
    rgb, _ = load_photo(probe_photo(tmp_path / "p.exr"))
    np.testing.assert_allclose(rgb[0, 0], 1.0, atol=2e-3)
    assert rgb[15, 0, 1] > 1.2


def test_preview_is_area_filtered_to_the_limit(tmp_path):
    board = ((np.indices((200, 300)).sum(axis=0) % 2) * 255).astype(np.uint8)
    preview = load_preview(probe_photo(write_image(tmp_path / "p.png", board)), max_pixels=15000)
    assert preview.shape == (100, 150, 3)
    assert np.ptp(preview) <= 1


def test_float_preview_is_exposed_to_white(tmp_path, picture):
    dim = load_preview(probe_photo(write_image(tmp_path / "dim.exr", linear(picture) * 0.01)))
    bright = load_preview(probe_photo(write_image(tmp_path / "bright.exr", linear(picture) * 100.0)))
    assert np.abs(dim.astype(int) - bright.astype(int)).max() <= 1
    assert dim.max() == 255


@pytest.mark.parametrize("cut", [0.3, 0.9, 0.999])
@pytest.mark.parametrize("name", ["p.jpg", "p.png", "p.tif", "p.exr"])
def test_truncated_file_is_refused(tmp_path, rng, capfd, name, cut):
    pixels = rng.integers(0, 256, (200, 300, 3), dtype=np.uint8)
    pixels = linear(pixels) if name == "p.exr" else pixels
    file = write_image(tmp_path / name, pixels)
    data = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(data[: int(len(data) * cut)])
    with pytest.raises(FexelError, match=name):
        load_photo(probe_photo(file))
    assert capfd.readouterr() == ("", ""), "libraries say nothing besides"


def test_what_is_no_photo_is_refused_in_one_line(tmp_path):
    cases = {"missing.jpg": None, "empty.jpg": b"", "text.jpg": b"not a picture", "text.xyz": b"not a picture"}
    for name, data in cases.items():
        if data is not None:
            (tmp_path / name).write_bytes(data)
        with pytest.raises(FexelError, match=name) as error:
            probe_photo(tmp_path / name)
        assert "\n" not in str(error.value)
    with pytest.raises(FexelError, match="not a file"):
        probe_photo(tmp_path)
    with pytest.raises(FexelError, match="at least 16"):
        probe_photo(write_image(tmp_path / "tiny.png", np.zeros((15, 40, 3), np.uint8)))


def test_file_names_with_spaces_quotes_and_unicode(tmp_path, picture):
    for name in ("a b.png", "it's.png", "Tür 7 \u65e5.png", "#1.png", "%04d.png"):
        rgb, _ = load_photo(probe_photo(write_image(tmp_path / name, picture)))
        np.testing.assert_allclose(rgb, linear(picture), atol=1e-6)
