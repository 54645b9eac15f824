"""Sources of pinchmaps: formats and depths, alpha, orientation, what is damaged, masks and labels."""

import cv2
import numpy as np
import OpenImageIO as oiio
import pytest

from fexel.errors import FexelError, FexelWarning
from fexel.images import linear_to_srgb, srgb_to_linear
from fexel_tools import photo_pixels, pinchmap_source
from fexel_tools.color_bleed import bleed_color
from fexel_tools.pinchmap_source import load_source


def _write(path, image, pixel_type="uint8", **attributes):
    image = np.atleast_3d(image)
    height, width, channels = image.shape
    spec = oiio.ImageSpec(width, height, channels, pixel_type)
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    if channels in (2, 4):
        spec.channelnames = ("Y", "A") if channels == 2 else ("R", "G", "B", "A")
        spec.alpha_channel = channels - 1
        if path.suffix != ".exr":
            spec.attribute("oiio:UnassociatedAlpha", 1)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec)
    assert output.write_image(np.ascontiguousarray(image))
    output.close()
    return path


def _disc(height=48, width=64, radius=15.0):
    """(H, W) float32 coverage of a disc."""
    y, x = np.mgrid[:height, :width] + 0.5
    return np.clip(radius + 0.5 - np.hypot(x - width / 2, y - height / 2), 0, 1).astype(np.float32)


def _rgba(alpha, color=(0.2, 0.5, 0.8)):
    return np.dstack([np.broadcast_to(np.float32(color), (*alpha.shape, 3)), alpha]).astype(np.float32)


@pytest.mark.parametrize(
    ("name", "pixel_type", "bits", "tolerance"),
    [
        ("a.png", "uint8", 8, 3e-3),
        ("a.png", "uint16", 16, 2e-5),
        ("a.tif", "uint8", 8, 3e-3),
        ("a.tif", "uint16", 16, 2e-5),
        ("a.tif", "float", 32, 1e-6),
        ("a.exr", "half", 32, 1e-3),
        ("a.exr", "float", 32, 1e-6),
    ],
)
def test_side_is_alpha_and_colour_is_straight_and_linear(tmp_path, name, pixel_type, bits, tolerance):
    alpha = _disc()
    encoded = _rgba(alpha)
    stored = encoded.copy()
    stored[..., :3] *= alpha[..., None] if name.endswith("exr") else 1
    source = load_source(_write(tmp_path / name, stored, pixel_type))
    is_float = pixel_type in ("half", "float")
    expected = encoded[..., :3] if is_float else srgb_to_linear(encoded[..., :3])
    assert source.bits == bits and not source.is_data and source.regions is None
    assert np.abs(source.side - alpha).max() < tolerance
    assert np.array_equal(source.side, source.opacity)
    assert np.abs(source.color - expected)[alpha > 0.1].max() < 4 * tolerance
    assert all(plane.dtype == np.float32 for plane in (source.color, source.opacity, source.side))


def test_colour_goes_on_under_transparent_pixels(tmp_path):
    alpha = _disc()
    stored = _rgba(alpha)
    stored[alpha == 0, :3] = 0
    source = load_source(_write(tmp_path / "a.png", stored))
    expected = srgb_to_linear(np.float32([0.2, 0.5, 0.8]))
    assert np.abs(source.color - expected).max() < 4e-3  # 8 bits


def test_bleeding_keeps_opaque_colours_and_adds_none(rng):
    color = rng.random((37, 61, 3), np.float32)
    alpha = (rng.random((37, 61)) < 0.3).astype(np.float32)
    filled = bleed_color(color, alpha)
    opaque = alpha == 1
    assert np.array_equal(filled[opaque], color[opaque])
    assert (filled >= color[opaque].min(axis=0) - 2e-5).all()
    assert (filled <= color[opaque].max(axis=0) + 2e-5).all()


def test_bleeding_nothing_is_black_and_everything_the_same(rng):
    color = rng.random((5, 3, 3), np.float32)
    assert not bleed_color(color, np.zeros((5, 3), np.float32)).any()
    assert np.array_equal(bleed_color(color, np.ones((5, 3), np.float32)), color)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_is_applied(tmp_path, orientation):
    alpha = np.zeros((20, 30), np.float32)
    alpha[:5, :10] = 1  # at the upper left as stored
    source = load_source(_write(tmp_path / "a.tif", _rgba(alpha), Orientation=orientation))
    corner = {1: (0, 0), 2: (0, -1), 3: (-1, -1), 4: (-1, 0), 5: (0, 0), 6: (0, -1), 7: (-1, -1), 8: (-1, 0)}
    assert source.side.shape == ((20, 30) if orientation < 5 else (30, 20))
    assert source.color.shape == (*source.side.shape, 3)
    assert source.side[corner[orientation]] == 1 and source.side.sum() == 50


def test_grey_with_alpha_and_single_pixels(tmp_path):
    grey = np.dstack([np.full((9, 7), 0.5, np.float32), _disc(9, 7, 2.0)])
    source = load_source(_write(tmp_path / "grey.png", grey))
    assert source.color.shape == (9, 7, 3)
    assert np.abs(source.color - srgb_to_linear(np.float32([128 / 255]))).max() < 1e-3
    with pytest.raises(FexelError, match=r"one\.png: alpha is 1 everywhere, .* pass --regions auto, or a mask"):
        load_source(_write(tmp_path / "one.png", _rgba(np.ones((1, 1), np.float32))))


@pytest.mark.parametrize(
    ("alpha", "found"), [(0.0, "0 everywhere"), (1.0, "1 everywhere"), ("shade", "between 0 and 0.4")]
)
def test_alpha_on_one_side_says_what_to_pass(tmp_path, alpha, found):
    ramp = np.linspace(0, 0.4, 64, dtype=np.float32)[None].repeat(48, axis=0)
    plane = ramp if alpha == "shade" else np.full((48, 64), alpha, np.float32)
    with pytest.raises(FexelError, match=rf"a\.png: alpha is {found}, .* pass --regions auto, or a mask"):
        load_source(_write(tmp_path / "a.png", _rgba(plane)))


def test_no_alpha_says_what_to_pass(tmp_path):
    with pytest.raises(FexelError, match=r"a\.png: has no alpha .* pass --regions auto, or a mask"):
        load_source(_write(tmp_path / "a.png", _rgba(_disc())[..., :3]))


def test_nan_and_infinite_colours_are_taken_from_neighbours_and_counted(tmp_path):
    alpha = _disc()
    pixels = _rgba(alpha)
    pixels[..., :3] *= alpha[..., None]
    pixels[20, 30, 0], pixels[21, 30, 1], pixels[0, 0, 2] = np.nan, np.inf, -np.inf
    path = _write(tmp_path / "a.exr", pixels, "float")
    with pytest.warns(FexelWarning, match=r"a\.exr: 3 pixels are NaN or infinite"):
        source = load_source(path)
    assert np.abs(source.color - np.float32([0.2, 0.5, 0.8])).max() < 1e-4
    assert np.abs(source.side - alpha).max() < 1e-6


def test_nan_in_alpha_is_transparent(tmp_path):
    alpha = _disc()
    pixels = _rgba(alpha)
    pixels[..., :3] *= alpha[..., None]
    pixels[24, 32, 3] = np.nan
    with pytest.warns(FexelWarning, match="1 pixels"):
        source = load_source(_write(tmp_path / "a.exr", pixels, "float"))
    assert source.side[24, 32] == 0 and np.isfinite(source.color).all()


def test_truncated_and_missing_files_are_one_line_errors(tmp_path, rng):
    noise = np.dstack([rng.random((64, 64, 3)), _disc(64, 64)])
    path = _write(tmp_path / "a.png", (noise * 255).astype(np.uint8))
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(FexelError, match=r"a\.png: ") as caught:
        load_source(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(FexelError, match=r"none\.png: no such file"):
        load_source(tmp_path / "none.png")


def test_large_images_are_reduced_by_area(tmp_path, monkeypatch, rng):
    monkeypatch.setattr(pinchmap_source, "LONGEST_SIDE_PX", 40)
    monkeypatch.setattr(photo_pixels, "_STRIP_ROWS", 7)
    pixels = np.dstack([rng.random((93, 110, 3)), rng.random((93, 110))]).astype(np.float32)
    path = _write(tmp_path / "a.tif", pixels, "float")
    source = load_source(path)
    padded = cv2.copyMakeBorder(pixels, 0, 0, 0, 1, cv2.BORDER_REPLICATE).astype(np.float64)
    cells = padded.reshape(31, 3, 37, 3, 4)
    alpha = cells[..., 3].mean(axis=(1, 3))
    color = (cells[..., :3] * cells[..., 3:]).mean(axis=(1, 3)) / alpha[..., None]
    assert np.abs(source.side - alpha).max() < 1e-5
    assert np.abs(source.color - color).max() < 1e-5


def test_drawings_have_pixels_enough_for_the_map(tmp_path):
    path = tmp_path / "a.svg"
    path.write_text('<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 2"><circle cx="2" cy="1" r="0.8"/></svg>')
    assert load_source(path).side.shape == (512, 1024)
    assert load_source(path, size=(64, 32)).side.shape == (512, 1024)
    assert load_source(path, size=(96, 48)).side.shape == (768, 1536)
    assert load_source(path).side.mean() == pytest.approx(np.pi * 0.64 / 8, rel=1e-3)


def test_an_empty_drawing_is_said(tmp_path):
    path = tmp_path / "a.svg"
    path.write_text('<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 2"/>')
    with pytest.raises(FexelError, match=r"a\.svg: the drawing is empty"):
        load_source(path)


def test_a_mask_of_another_size_is_resampled(tmp_path):
    picture = _write(tmp_path / "a.png", _rgba(_disc(200, 300, 60))[..., :3])
    for scale in (0.5, 2.0):
        size = (int(200 * scale), int(300 * scale))
        mask = _write(tmp_path / "m.png", _disc(*size, 60 * scale))
        source = load_source(picture, mask=mask)
        assert source.side.shape == (200, 300) and (source.opacity == 1).all()
        assert ((source.side > 0.5) != (_disc(200, 300, 60) > 0.5)).mean() < 2e-3


def test_a_mask_may_be_alpha_or_the_labels_0_and_1(tmp_path):
    picture = _write(tmp_path / "a.png", _rgba(_disc())[..., :3])
    by_alpha = load_source(picture, mask=_write(tmp_path / "m.png", _rgba(_disc(), (1.0, 1.0, 1.0)))).side
    assert np.abs(by_alpha - _disc()).max() < 3e-3
    inside = _disc() > 0.5
    by_label = load_source(picture, regions=str(_write(tmp_path / "l.png", inside.astype(np.uint8)))).side
    assert np.array_equal(by_label > 0.5, inside)


def test_a_mask_on_one_side_and_a_mask_beside_regions_are_errors(tmp_path):
    picture = _write(tmp_path / "a.png", _rgba(_disc())[..., :3])
    grey = _write(tmp_path / "m.png", np.full((48, 64), 0.2, np.float32))
    with pytest.raises(FexelError, match=r"m\.png: the side is 0\.2 everywhere"):
        load_source(picture, mask=grey)
    with pytest.raises(FexelError, match=r"a\.png: both a mask and regions"):
        load_source(picture, mask=grey, regions="auto")
    with pytest.raises(FexelError, match=r"a\.png: 1 regions, expected auto, 2 to 64 colours"):
        load_source(picture, regions="1")
    with pytest.raises(FexelError, match=r"nowhere\.png: no such file"):
        load_source(picture, regions=str(tmp_path / "nowhere.png"))


def test_raw_values_are_as_stored(tmp_path, rng):
    values = rng.random((32, 40, 3)).astype(np.float32) * 2 - 1
    mask = _write(tmp_path / "m.png", _disc(32, 40, 9))
    source = load_source(_write(tmp_path / "n.exr", values, "float"), mask=mask, raw=True)
    assert source.is_data and np.array_equal(source.color, values)
    stored = rng.integers(0, 65535, (32, 40, 3), np.uint16)
    source = load_source(_write(tmp_path / "n.png", stored, "uint16"), mask=mask, raw=True)
    assert source.bits == 16 and np.abs(source.color * 65535 - stored).max() < 0.01


def test_shared_cut_outs_and_normal_map_load(shared_data):
    for path in sorted((shared_data / "umbrella" / "cutouts_gpl2").glob("*.png")):
        source = load_source(path)
        assert 0.3 < source.side.mean() < 0.8
        assert linear_to_srgb(source.color).std() > 0.01
    maps = shared_data / "pinch" / "normalmaps"
    source = load_source(maps / "brick_normal_1024.jpg", mask=maps / "brick_mask_1024.jpg", raw=True)
    assert source.is_data and 0.5 < (source.side > 0.5).mean() < 0.95


@pytest.mark.parametrize("translucent", [120, 90])
def test_cut_out_that_is_translucent_as_a_whole_has_its_shape_for_side(tmp_path, translucent):
    alpha = _disc() * np.float32(translucent / 255)
    source = load_source(_write(tmp_path / "glass.png", _rgba(alpha)))
    np.testing.assert_allclose(source.side, _disc(), atol=0.01)
    np.testing.assert_allclose(source.opacity, alpha, atol=0.003)


def test_noise_in_an_opaque_alpha_is_no_cut_out(tmp_path):
    alpha = np.ones((40, 40), np.float32)
    alpha[10:12, 10:12] = 250 / 255
    with pytest.raises(FexelError, match="all pixels are on one side"):
        load_source(_write(tmp_path / "noise.png", _rgba(alpha)))


def test_any_seed_is_taken_where_regions_are_drawn_at_random(tmp_path):
    flag = _write(tmp_path / "flag.png", _rgba(_disc())[..., :3] * _disc()[..., None])
    first, second = (load_source(flag, regions="2", seed=seed) for seed in (3_000_000_000, 2**70))
    assert first.side.shape == second.side.shape == (48, 64)
