"""Images: linear, premultiplied, finite, whatever the file holds; partial reads; nothing half-written."""

import numpy as np
import OpenImageIO as oiio
import pytest

from fexel import images, mipmaps
from fexel.errors import FexelError


def write(path, pixels, **attributes):
    buffer = oiio.ImageBuf(np.ascontiguousarray(pixels))
    for name, value in attributes.items():
        buffer.specmod().attribute(name.replace("__", ":"), value)
    assert buffer.write(str(path))
    return str(path)


def test_images_srgb_round_trip(rng):
    encoded = rng.random(1000).astype(np.float32)
    assert np.abs(images.linear_to_srgb(images.srgb_to_linear(encoded)) - encoded).max() < 1e-5


def test_images_png_alpha_is_multiplied_in_linear_light(tmp_path):
    pixels = np.full((4, 4, 4), (188, 188, 188, 128), np.uint8)
    texels = images.read_linear(write(tmp_path / "a.png", pixels, oiio__UnassociatedAlpha=1))
    expected = images.srgb_to_linear(np.float32([188 / 255]))[0] * 128 / 255
    assert np.abs(texels[..., :3] - expected).max() < 1e-5
    assert np.abs(texels[..., 3] - 128 / 255).max() < 1e-6


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_png_that_ends_early_is_one_error_and_not_a_word_besides(tmp_path, rng, capfd, share):
    file = write(tmp_path / "a.png", rng.integers(0, 256, (200, 300, 3), dtype=np.uint8))
    whole = (tmp_path / "a.png").read_bytes()
    (tmp_path / "a.png").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(FexelError, match=rf"^.*a\.png: ends early, after {int(share * len(whole))} bytes$"):
        images.read_pixels(images.image_info(file))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("length", [8, 12, 20, 33, 40])
def test_png_that_ends_before_its_pixels_is_one_error_and_not_a_word_besides(tmp_path, rng, capfd, length):
    file = write(tmp_path / "a.png", rng.integers(0, 256, (20, 30, 3), dtype=np.uint8))
    (tmp_path / "a.png").write_bytes((tmp_path / "a.png").read_bytes()[:length])
    with pytest.raises(FexelError, match=rf"^.*a\.png: ends early, after {length} bytes$"):
        images.image_info(file)
    assert capfd.readouterr() == ("", "")


def test_png_with_a_changed_byte_is_one_error_and_not_a_word_besides(tmp_path, rng, capfd):
    file = write(tmp_path / "a.png", rng.integers(0, 256, (200, 300, 3), dtype=np.uint8))
    damaged = bytearray((tmp_path / "a.png").read_bytes())
    damaged[len(damaged) // 2] ^= 1
    (tmp_path / "a.png").write_bytes(damaged)
    with pytest.raises(FexelError, match=r"^.*a\.png: is damaged: the checksum of IDAT at byte \d+ is wrong$"):
        images.read_pixels(images.image_info(file))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("damage", ["without its end", "comment"])
def test_png_whose_pixels_are_whole_is_read(tmp_path, rng, damage):
    """Without the last chunk, or with a wrong checksum of a comment."""
    pixels = rng.integers(0, 256, (20, 30, 3), dtype=np.uint8)
    file = write(tmp_path / "a.png", pixels, ImageDescription="a comment")
    data = bytearray((tmp_path / "a.png").read_bytes())
    if damage == "comment":
        data[data.index(b"a comment")] ^= 1
    else:
        data = data[:-12]
    (tmp_path / "a.png").write_bytes(data)
    assert np.array_equal(images.read_pixels(images.image_info(file)), pixels)


@pytest.mark.parametrize("name", ["a.png", "a.bmp", "a.tga", "a.gif", "a.webp", "a.tif"])
def test_images_of_straight_alpha_are_multiplied_by_it(tmp_path, name):
    pixels = np.full((8, 8, 4), (255, 255, 255, 128), np.uint8)
    texels = images.read_linear(write(tmp_path / name, pixels, oiio__UnassociatedAlpha=1))
    alpha = 1.0 if name == "a.gif" else 128 / 255  # GIF knows only opaque and transparent
    assert np.abs(texels - alpha).max() < 1e-6


def test_images_exr_alpha_is_associated(tmp_path):
    pixels = np.full((4, 4, 4), 0.5, np.float32)
    assert np.array_equal(images.read_linear(write(tmp_path / "a.exr", pixels)), pixels)


@pytest.mark.parametrize(
    ("channels", "dtype", "space"), [(3, "uint8", "sRGB"), (1, "uint8", "raw"), (3, "uint16", "raw")]
)
def test_images_auto_color_space_is_that_of_usd(tmp_path, channels, dtype, space):
    pixels = np.zeros((4, 4, channels), dtype)
    assert images.image_info(write(tmp_path / "a.png", pixels)).color_space == space


def test_images_exr_is_cleaned_of_nan_and_infinity(tmp_path):
    pixels = np.float32([[[np.nan, np.inf, -np.inf, 2.0], [0.5, 0.25, 0, 0.5]]])
    texels = images.read_linear(write(tmp_path / "a.exr", pixels))
    assert np.isfinite(texels).all()
    assert texels[0, 0].tolist() == [0, 65504, -65504, 1]
    assert np.abs(texels[0, 1] - [0.5, 0.25, 0, 0.5]).max() == 0


@pytest.mark.parametrize(("name", "dtype"), [("a.tif", "uint8"), ("a.tif", "uint16"), ("a.exr", "float16")])
def test_images_windows_of_levels_are_read_alone(tmp_path, rng, name, dtype):
    texels = np.concatenate([rng.random((90, 150, 3)), np.ones((90, 150, 1))], -1).astype(np.float32)
    path = str(tmp_path / name)
    levels = mipmaps.pyramid(texels)
    images.write_pyramid(path, levels, dtype, "raw")
    info = images.image_info(path)
    assert info.tiled
    assert info.level_sizes == tuple((level.shape[1], level.shape[0]) for level in levels)
    for level, box in ((0, (67, 3, 150, 90)), (1, (10, 20, 31, 40)), (3, (0, 0, 18, 11))):
        window = images.to_linear(images.read_pixels(info, level, box), info, "raw")
        expected = levels[level][box[1] : box[3], box[0] : box[2]]
        assert np.abs(window - expected).max() < 1 / 255


@pytest.mark.parametrize("content", [None, b"", b"no image at all"])
def test_images_that_cannot_be_read_are_named_in_one_line(tmp_path, content):
    path = tmp_path / "broken.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(FexelError, match=r"broken\.png") as error:
        images.image_info(str(path))
    assert "\n" not in str(error.value)


def test_images_nothing_is_left_half_written(tmp_path):
    with pytest.raises(FexelError):
        images.write_pyramid(str(tmp_path / "none" / "a.tif"), [np.zeros((4, 4, 3))])
    assert not list(tmp_path.iterdir())
