"""What is written is what a renderer reads, window by window and level by level."""

from __future__ import annotations

import cv2
import numpy as np
import OpenImageIO as oiio
import pytest

from fexel.errors import FexelError
from fexel.images import image_info, linear_to_srgb, read_pixels, srgb_to_linear, to_linear
from fexel_tools.image_files import write_image
from fexel_tools.texture_files import encode, write_texture


def premultiplied_mean(rgb, alpha, box):
    """Area mean of premultiplied colour and of alpha over a box of texels, float64."""
    y0, y1, x0, x1 = box
    a = alpha[y0:y1, x0:x1].astype(np.float64)[..., None]
    return np.concatenate([rgb[y0:y1, x0:x1] * a, a], axis=-1).mean(axis=(0, 1))


@pytest.fixture
def patch(rng):
    rgb = cv2.GaussianBlur(rng.random((192, 256, 3)).astype(np.float32), (0, 0), 1.0)
    alpha = np.clip(cv2.GaussianBlur(rng.random((192, 256)).astype(np.float32), (0, 0), 6.0) * 8 - 3.5, 0, 1)
    alpha[[0, -1]] = alpha[:, [0, -1]] = 0
    return rgb, alpha


@pytest.mark.parametrize(
    ("bits", "suffix", "dtype"),
    [(8, ".tif", "uint8"), (16, ".tif", "uint16"), ("half", ".exr", "float16"), ("float", ".exr", "float32")],
)
@pytest.mark.parametrize("size", [(192, 256), (97, 131), (1, 1), (1, 37), (64, 2)])
def test_levels_halve_down_to_one_texel_and_are_tiled(tmp_path, rng, bits, suffix, dtype, size):
    path = tmp_path / f"patch{suffix}"
    write_texture(path, rng.random((*size, 3)), rng.random(size), bits=bits)
    info = image_info(str(path))
    assert (info.height, info.width) == size
    assert (info.dtype, info.channels, info.alpha_channel, info.tiled) == (dtype, 4, 3, True)
    assert info.alpha_associated == (suffix == ".exr")
    assert info.level_sizes[-1] == (1, 1)
    assert len(info.level_sizes) == max(size).bit_length()
    for level in range(len(info.level_sizes)):
        texels = to_linear(read_pixels(info, level), info, "raw")
        assert np.isfinite(texels).all()
        assert texels[[0, -1], :, 3].max() == 0
        assert texels[:, [0, -1], 3].max() == 0


@pytest.mark.parametrize(("bits", "suffix"), [(8, ".tif"), (16, ".tif"), ("half", ".exr")])
def test_same_texture_makes_the_same_bytes_at_another_time(tmp_path, patch, move_clock, bits, suffix):
    path = tmp_path / f"patch{suffix}"
    written = []
    for _ in range(2):
        write_texture(path, *patch, bits=bits)
        written.append(path.read_bytes())
        move_clock()
    assert written[0] == written[1]


@pytest.mark.parametrize(
    ("name", "dtype"), [("a.png", "uint8"), ("a.jpg", "uint8"), ("a.tif", "uint16"), ("a.exr", "float16")]
)
def test_same_picture_makes_the_same_bytes_at_another_time(tmp_path, rng, move_clock, name, dtype):
    picture = rng.integers(0, 200, (20, 30, 3)).astype(dtype)
    written = []
    for _ in range(2):
        write_image(tmp_path / name, picture)
        written.append((tmp_path / name).read_bytes())
        move_clock()
    assert written[0] == written[1]


def test_level_zero_is_exact_in_8_bits(tmp_path, rng):
    """Every 8-bit photo value survives decoding to linear light and encoding again."""
    photo = rng.integers(0, 256, (70, 90, 3), dtype=np.uint8)
    photo[:16, :16] = np.arange(256, dtype=np.uint8).reshape(16, 16, 1)
    path = tmp_path / "root.tif"
    write_texture(path, srgb_to_linear(photo / np.float32(255)))
    info = image_info(str(path))
    assert (info.color_space, info.channels) == ("sRGB", 3)
    assert np.array_equal(read_pixels(info), photo)


def test_16_bit_values_are_within_half_a_step(tmp_path, rng):
    values = np.sort(rng.random((40, 50, 3)).astype(np.float32) ** 3, axis=0)
    encoded = encode(values, None, "uint16", "sRGB")
    assert np.abs(encoded - linear_to_srgb(values).astype(np.float64) * 65535).max() < 0.55


@pytest.mark.parametrize(
    ("bits", "suffix", "tolerance"), [(8, ".tif", 1.5 / 255), (16, ".tif", 1e-4), ("half", ".exr", 1e-3)]
)
def test_coarse_levels_are_premultiplied_linear_means(tmp_path, patch, bits, suffix, tolerance):
    rgb, alpha = patch
    path = tmp_path / f"patch{suffix}"
    write_texture(path, rgb, alpha, bits=bits)
    info = image_info(str(path))
    for level in (1, 2, 4):
        texels = to_linear(read_pixels(info, level), info, "sRGB" if suffix == ".tif" else "raw")
        side = 2**level
        for y, x in [(1, 1), (2, 5), (texels.shape[0] - 2, texels.shape[1] // 2)]:
            expected = premultiplied_mean(rgb, alpha, (y * side, (y + 1) * side, x * side, (x + 1) * side))
            assert np.abs(texels[y, x] - expected).max() < tolerance


def test_rim_is_cleared_from_the_clean_level_above(tmp_path):
    """An opaque patch is opaque right inside the rim at every level: clearing does not add up."""
    path = tmp_path / "opaque.tif"
    write_texture(path, np.full((128, 128, 3), 0.5), np.ones((128, 128)))
    info = image_info(str(path))
    for level in range(6):
        alpha = read_pixels(info, level)[..., 3]
        assert alpha[1:-1, 1:-1].min() == 255
        assert alpha[0].max() == alpha[:, -1].max() == 0


def test_colour_below_transparent_texels_is_the_picture(tmp_path, patch):
    """Straight alpha for others: no black fringe at any level, and none of what is transparent in what is not."""
    rgb, alpha = patch
    alpha[:, 128:] = 0
    rgb = rgb.copy()
    rgb[:, :128], rgb[:, 128:] = (0.8, 0.1, 0.1), (0.1, 0.8, 0.1)
    path = tmp_path / "patch.tif"
    write_texture(path, rgb, alpha)
    info = image_info(str(path))
    for level in (0, 1, 3):
        pixels = read_pixels(info, level)
        middle = pixels.shape[1] // 2
        red, green = (np.rint(linear_to_srgb(np.array(c)) * 255) for c in ((0.8, 0.1, 0.1), (0.1, 0.8, 0.1)))
        assert np.abs(pixels[:, : middle - 1, :3] - red).max() <= 1
        assert np.abs(pixels[:, middle + 1 :, :3] - green).max() <= 1
        assert pixels[:, middle:, 3].max() == 0


def test_raw_stores_values_as_they_are(tmp_path):
    path = tmp_path / "normals.tif"
    write_texture(path, np.full((8, 8, 3), [0.25, 0.5, 1.0]), color_space="raw")
    assert read_pixels(image_info(str(path)))[4, 4].tolist() == [64, 128, 255]


def test_integers_clip_and_floats_do_not(tmp_path):
    bright = np.full((8, 8, 3), [-0.5, 2.0, 1e6])
    write_texture(tmp_path / "a.tif", bright)
    assert read_pixels(image_info(str(tmp_path / "a.tif")))[0, 0].tolist() == [0, 255, 255]
    write_texture(tmp_path / "a.exr", bright, bits="half")
    values = read_pixels(image_info(str(tmp_path / "a.exr")))[0, 0]
    assert values[:2].tolist() == [-0.5, 2.0]
    assert np.isfinite(values).all()


def test_texels_that_are_not_finite_become_transparent(tmp_path, rng):
    rgb, alpha = rng.random((32, 32, 3)), np.ones((32, 32))
    rgb[10, 12, 1], alpha[20, 21] = np.nan, np.inf
    for name, bits in (("a.tif", 8), ("a.exr", "half")):
        write_texture(tmp_path / name, rgb, alpha, bits=bits)
        info = image_info(str(tmp_path / name))
        texels = read_pixels(info)
        assert texels[10, 12, 3] == texels[20, 21, 3] == 0
        assert np.isfinite(read_pixels(info, 1)).all()
    write_texture(tmp_path / "root.tif", rgb)
    assert read_pixels(image_info(str(tmp_path / "root.tif")))[10, 12].tolist() == [0, 0, 0]


def test_a_window_of_a_level_can_be_read_alone(tmp_path, patch):
    path = tmp_path / "patch.tif"
    write_texture(path, *patch)
    info = image_info(str(path))
    whole = read_pixels(info, 1)
    assert np.array_equal(read_pixels(info, 1, (60, 10, 100, 70)), whole[10:70, 60:100])


def test_other_readers_open_level_zero(tmp_path, patch):
    """OpenCV and plain OpenImageIO; both associate alpha on reading, which proves that it is marked as straight."""
    path = str(tmp_path / "patch.tif")
    write_texture(path, *patch)
    expected = read_pixels(image_info(path))
    with open(path, "rb") as file:
        decoded = cv2.imdecode(np.frombuffer(file.read(), np.uint8), cv2.IMREAD_UNCHANGED)
    associated = expected[..., :3] * (expected[..., 3:] / 255)
    assert np.array_equal(decoded[..., 3], expected[..., 3])
    assert np.abs(decoded[..., 2::-1] - associated).max() <= 1
    reader = oiio.ImageInput.open(path)
    read = reader.read_image("uint8").reshape(expected.shape)
    reader.close()
    assert np.abs(read[..., :3] - associated).max() <= 1


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, patch, monkeypatch):
    path = tmp_path / "patch.tif"
    write_texture(path, *patch)
    before = path.read_bytes()
    monkeypatch.setattr("fexel_tools.texture_files.halve", lambda image: (_ for _ in ()).throw(FexelError("disk full")))
    with pytest.raises(FexelError, match="disk full"):
        write_texture(path, *patch)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["patch.tif"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"path": "a.png"}, "goes to a .tif or .tiff file"),
        ({"path": "a.tif", "bits": 12}, "bits is 12, expected one of 8, 16, 'half', 'float'"),
        ({"path": "a.tif", "bits": "half"}, "goes to a .exr file"),
        ({"path": "a.tif", "color_space": "AdobeRGB"}, "expected one of sRGB, raw"),
        ({"path": "a.tif", "alpha": np.ones((3, 3))}, r"alpha of shape \(3, 3\), expected \(4, 5\)"),
        ({"path": "nowhere/a.tif"}, "nowhere/a.tif"),
    ],
)
def test_errors_name_the_file_and_what_was_expected(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FexelError, match=message) as caught:
        write_texture(**{"rgb": np.zeros((4, 5, 3)), **arguments})
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []
