"""Elements in photos: cut-outs, objects on a ground, many in one photo; formats, and what is damaged or empty."""

import cv2
import numpy as np
import OpenImageIO as oiio
import pytest

from fexel.errors import FexelError, FexelWarning
from fexel.images import linear_to_srgb
from fexel_tools import umbrella_elements
from fexel_tools.umbrella_elements import find_elements

WHITE = (1.0, 1.0, 1.0)
SKY = (0.1, 0.35, 0.8)
_PLACES = ((70, 70), (220, 75), (75, 215), (215, 225))


def _write(path, image, pixel_type="uint8", **attributes):
    """Linear colours to a file, encoded but for floats; alpha is straight."""
    image = np.asarray(image, np.float32)
    channels = image.shape[2]
    if path.suffix != ".exr":
        image = np.concatenate([linear_to_srgb(np.clip(image[..., :3], 0, 1)), image[..., 3:]], axis=2)
    spec = oiio.ImageSpec(image.shape[1], image.shape[0], channels, pixel_type)
    for name, value in attributes.items():
        spec.attribute(name, value)
    if channels == 4 and path.suffix != ".exr":
        spec.attribute("oiio:UnassociatedAlpha", 1)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec)
    assert output.write_image(np.ascontiguousarray(image))
    output.close()
    return path


def _disc(height, width, x, y, radius):
    """(H, W) share of each pixel that a disc covers."""
    rows, columns = np.mgrid[: height * 4, : width * 4] / 4 + 0.125
    inside = (np.hypot(columns - x, rows - y) <= radius).astype(np.float32)
    return inside.reshape(height, 4, width, 4).mean(axis=(1, 3))


def _over(ground, *layers):
    """Layers (coverage, colour) over a ground, in linear light."""
    image = np.array(ground, np.float32)
    for coverage, color in layers:
        image = image * (1 - coverage[..., None]) + np.float32(color) * coverage[..., None]
    return image


def _plain(height, width, color):
    return np.broadcast_to(np.float32(color), (height, width, 3))


def _iou(first, second):
    return float(np.minimum(first, second).sum() / np.maximum(first, second).sum())


def _on_photo(element, size):
    """Opacity of an element where it was in its photo."""
    whole = np.zeros(size[::-1], np.float32)
    left, top, right, bottom = element.box
    whole[top:bottom, left:right] = element.opacity
    return whole


@pytest.mark.parametrize("ground", [WHITE, (0.0, 0.0, 0.0), SKY, (0.3, 0.3, 0.3)])
def test_an_object_on_a_plain_ground_is_cut_to_a_fraction_of_a_pixel(tmp_path, ground):
    coverage = _disc(120, 150, 71.3, 58.6, 37.2)
    path = _write(tmp_path / "a.png", _over(_plain(120, 150, ground), (coverage, (0.5, 0.1, 0.05))))
    found = find_elements(path)
    assert found.kind == "object" and not found.reason and not found.dropped
    (element,) = found.elements
    opacity = _on_photo(element, found.size)
    assert abs(opacity.sum() - coverage.sum()) < 0.01 * coverage.sum()
    assert np.abs(opacity - coverage).max() < 0.15  # 8-bit colours, and the shape of edges across a pixel
    assert np.allclose(found.ground, ground, atol=0.02)
    assert element.name == "a" and element.quality > 0.9
    assert element.scale_px == pytest.approx(74.4, abs=1.5)


def test_colours_past_the_rim_are_the_elements_own(tmp_path):
    coverage = _disc(90, 90, 45.2, 44.7, 30.4)
    color = (0.02, 0.2, 0.04)
    (element,) = find_elements(_write(tmp_path / "a.png", _over(_plain(90, 90, WHITE), (coverage, color)))).elements
    assert np.abs(element.color - np.float32(color)).max() < 0.02  # a white fringe would be off by up to 1


def test_a_sky_from_light_to_dark_is_one_ground(tmp_path, rng):
    height, width = 160, 220
    fall = np.linspace(0.3, 1.0, height)[:, None, None] * np.linspace(0.8, 1.0, width)[None, :, None]
    ground = np.float32(fall * np.array([0.25, 0.5, 0.95]))
    ground *= 1 + rng.normal(0, 0.01, ground.shape).astype(np.float32)
    coverage = _disc(height, width, 120, 85, 45)
    found = find_elements(_write(tmp_path / "a.png", _over(ground, (coverage, (0.8, 0.6, 0.02)))))
    assert len(found.elements) == 1
    assert _iou(_on_photo(found.elements[0], found.size), coverage) > 0.97


def test_a_crowd_of_touching_discs_is_told_apart_and_clipped_ones_are_dropped(tmp_path, rng):
    layers, centers = [], []
    for row in range(3):
        for column in range(4):
            x, y = 60 + 79 * column, 60 + 79 * row  # radius 40: neighbours overlap by a pixel
            centers.append((x, y))
            layers.append((_disc(270, 340, x, y, 40), rng.uniform(0.02, 0.5, 3) * [1, 1, 0.3]))
    layers.append((_disc(270, 340, 338, 20, 18), (0.3, 0.02, 0.02)))
    path = _write(tmp_path / "many.png", _over(_plain(270, 340, WHITE), *layers))
    found = find_elements(path)
    assert found.kind == "many" and len(found.elements) == 12
    for element, (coverage, _), (x, y) in zip(found.elements, layers, centers, strict=False):
        left, top, right, bottom = element.box
        assert left < x < right and top < y < bottom  # in reading order
        assert _iou(_on_photo(element, found.size), coverage) > 0.95
    assert [element.name for element in found.elements][::11] == ["many_01", "many_12"]
    assert len({element.scale_px for element in found.elements}) == 1
    assert [reason for _, reason in found.dropped] == ["clipped by the edge of the photo"]


def test_a_ring_stays_one_element_and_its_hole_stays_a_hole(tmp_path):
    rings = [_disc(140, 300, x, 70, 50) - _disc(140, 300, x, 70, 25) for x in (70, 171, 260)]
    path = _write(tmp_path / "a.png", _over(_plain(140, 300, WHITE), *((ring, (0.5, 0.2, 0.02)) for ring in rings[:2])))
    found = find_elements(path, kind="many")
    assert len(found.elements) == 2
    for element, ring in zip(found.elements, rings, strict=False):
        assert _iou(_on_photo(element, found.size), ring) > 0.93


@pytest.mark.parametrize("spread", [3.0, 5.0])
def test_a_glint_as_white_as_the_ground_is_no_hole(tmp_path, spread):
    """Its middle is as white as the ground, its edge is soft."""
    disc = _disc(100, 100, 50, 50, 40)
    rows, columns = np.mgrid[:100, :100] + 0.5
    fall = np.exp(-(np.square(columns - 40) + np.square(rows - 40)) / (2 * spread**2))
    glint = np.clip(1.6 * fall, 0, 1).astype(np.float32)
    path = _write(tmp_path / "a.png", _over(_plain(100, 100, WHITE), (disc, (0.5, 0, 0)), (glint, WHITE)))
    (element,) = find_elements(path).elements
    assert _iou(_on_photo(element, (100, 100)), disc) > 0.98


def test_a_glint_that_is_nearly_the_grounds_colour_is_no_hole(tmp_path):
    disc, glint = _disc(100, 100, 50, 50, 40), _disc(100, 100, 40, 40, 5)
    layers = (disc, (0.5, 0, 0)), (glint, (0.8, 0.7, 0.7))
    (element,) = find_elements(_write(tmp_path / "a.png", _over(_plain(100, 100, WHITE), *layers))).elements
    assert _iou(_on_photo(element, (100, 100)), disc) > 0.98


def test_white_paper_is_seen_through_a_small_hole_deep_inside(tmp_path):
    shape = _disc(100, 100, 50, 50, 40) - _disc(100, 100, 47, 52, 4)
    path = _write(tmp_path / "a.png", _over(_plain(100, 100, WHITE), (shape, (0.5, 0.1, 0))))
    (element,) = find_elements(path).elements
    assert _iou(_on_photo(element, (100, 100)), shape) > 0.98
    assert _on_photo(element, (100, 100))[52, 47] < 0.1


def test_a_narrow_notch_is_ground_to_its_end(tmp_path):
    """Blur mixes a notch of four pixels with the leaf on both sides."""
    disc = _disc(120, 120, 60, 60, 45)
    disc[60:, 58:62] = 0
    image = cv2.GaussianBlur(_over(_plain(120, 120, WHITE), (disc, (0.1, 0.3, 0.04))), (0, 0), 1.2)
    (element,) = find_elements(_write(tmp_path / "a.png", image)).elements
    opacity = _on_photo(element, (120, 120))
    assert opacity[64:100, 59:61].max() < 0.5 and opacity[40:55, 59:61].min() > 0.95


def test_a_coloured_shadow_is_no_part_of_what_throws_it(tmp_path):
    shadows = [(_disc(300, 300, x + 14, y + 14, 27), (0.55, 0.45, 0.6)) for x, y in _PLACES]
    discs = [(_disc(300, 300, x, y, 30), (0.6, 0.01, 0.01)) for x, y in _PLACES]
    path = _write(tmp_path / "a.png", _over(_plain(300, 300, WHITE), *shadows, *discs))
    found = find_elements(path)
    assert len(found.elements) == len(discs)
    for element, (coverage, _) in zip(found.elements, discs, strict=True):
        assert _iou(_on_photo(element, found.size), coverage) > 0.95


def test_petals_paler_than_their_middle_are_no_shadows(tmp_path):
    layers, wholes = [], []
    for x, y in _PLACES:
        petals = [_disc(300, 300, x + 22 * np.cos(a), y + 22 * np.sin(a), 11) for a in np.arange(6) * np.pi / 3]
        middle = _disc(300, 300, x, y, 16)
        layers += [(np.clip(sum(petals), 0, 1), (0.8, 0.6, 0.75)), (middle, (0.5, 0.2, 0.0))]
        wholes.append(np.clip(sum(petals) + middle, 0, 1))
    found = find_elements(_write(tmp_path / "a.png", _over(_plain(300, 300, WHITE), *layers)), kind="many")
    assert len(found.elements) == len(wholes)
    for element, whole in zip(found.elements, wholes, strict=True):
        assert _iou(_on_photo(element, found.size), whole) > 0.93


def test_the_dark_one_of_two_that_touch_is_not_bitten(tmp_path):
    """The grey between them is nearer to the dark one's colour than to the red one's."""
    first, second = _disc(160, 260, 80, 80, 45), _disc(160, 260, 170, 76, 45)
    shadow = _disc(160, 260, 108, 76, 34)
    layers = (shadow, (0.12, 0.1, 0.11)), (second, (0.02, 0.006, 0.01)), (first, (0.6, 0.01, 0.01))
    path = _write(tmp_path / "a.png", _over(_plain(160, 260, WHITE), *layers))
    found = find_elements(path, kind="many")
    assert len(found.elements) == 2
    assert _iou(_on_photo(found.elements[1], found.size), second) > 0.93


def test_what_shows_a_coloured_ground_is_a_hole_however_small(tmp_path):
    shape = _disc(100, 100, 50, 50, 40) - _disc(100, 100, 40, 40, 4)
    (element,) = find_elements(
        _write(tmp_path / "a.png", _over(_plain(100, 100, SKY), (shape, (0.5, 0.3, 0))))
    ).elements
    assert _iou(_on_photo(element, (100, 100)), shape) > 0.985
    assert _on_photo(element, (100, 100))[40, 40] < 0.1


def test_a_lobed_object_is_not_split(tmp_path):
    lobes = [_disc(160, 200, x, y, 32) for x, y in ((60, 60), (100, 100), (140, 60))]
    shape = np.clip(sum(lobes), 0, 1)
    found = find_elements(_write(tmp_path / "a.png", _over(_plain(160, 200, WHITE), (shape, (0.1, 0.3, 0.05)))))
    assert found.kind == "object" and len(found.elements) == 1
    assert _iou(_on_photo(found.elements[0], found.size), shape) > 0.97


def test_islands_of_alpha_are_elements_and_specks_are_told(tmp_path):
    discs = [_disc(100, 240, 50, 50, 35), _disc(100, 240, 150, 50, 30), _disc(100, 240, 220, 20, 2)]
    image = np.dstack([_plain(100, 240, (0.4, 0.3, 0.1)), sum(discs)])
    found = find_elements(_write(tmp_path / "a.png", image))
    assert found.kind == "cutout" and found.ground is None and len(found.elements) == 2
    for element, disc in zip(found.elements, discs, strict=False):
        assert np.abs(_on_photo(element, found.size) - disc).max() < 0.01
    assert [reason for _, reason in found.dropped] == ["a speck"]


def test_an_opaque_alpha_channel_is_no_cut_out(tmp_path):
    coverage = _disc(80, 80, 40, 40, 25)
    image = np.dstack([_over(_plain(80, 80, WHITE), (coverage, (0.4, 0, 0))), np.ones((80, 80))])
    assert find_elements(_write(tmp_path / "a.png", image)).kind == "object"


@pytest.mark.parametrize(
    ("name", "pixel_type"), [("a.tif", "uint16"), ("a.exr", "half"), ("a.exr", "float"), ("a.jpg", "uint8")]
)
def test_formats_give_the_same_cut(tmp_path, name, pixel_type):
    coverage = _disc(96, 110, 50, 47, 33)
    image = _over(_plain(96, 110, WHITE), (coverage, (0.05, 0.25, 0.5)))
    (element,) = find_elements(_write(tmp_path / name, image, pixel_type)).elements
    assert _iou(_on_photo(element, (110, 96)), coverage) > 0.97
    middle = element.color[element.color.shape[0] // 2, element.color.shape[1] // 2]
    assert np.allclose(middle, (0.05, 0.25, 0.5), atol=0.02)


def test_pixels_that_are_no_numbers_are_told_once(tmp_path, monkeypatch):
    """Though the photo is decoded reduced, and again window by window."""
    coverage = _disc(96, 110, 50, 47, 33)
    image = np.array(_over(_plain(96, 110, WHITE), (coverage, (0.05, 0.25, 0.5))))
    image[40:42, 50, 1], image[3, 4, 0] = np.nan, np.inf
    path = _write(tmp_path / "a.exr", image, "float")
    monkeypatch.setattr(umbrella_elements, "_PREVIEW_PIXELS", 3000)
    with pytest.warns(FexelWarning) as caught:
        (element,) = find_elements(path).elements
    assert [str(w.message).split(": ", 1)[1][:30] for w in caught] == ["3 pixels are NaN or infinite; "]
    assert np.isfinite(element.color).all()


def test_the_orientation_of_the_camera_is_applied(tmp_path):
    coverage = _disc(60, 100, 25, 30, 15)
    image = _over(_plain(60, 100, WHITE), (coverage, (0.4, 0.1, 0.02)))
    found = find_elements(_write(tmp_path / "a.jpg", image, Orientation=6, CompressionQuality=98))
    assert found.size == (60, 100)
    left, top, right, bottom = found.elements[0].box
    assert (left + right) / 2 == pytest.approx(30, abs=1) and (top + bottom) / 2 == pytest.approx(25, abs=1)


def test_a_large_photo_is_searched_reduced_and_cut_in_full(tmp_path, monkeypatch):
    coverage = _disc(300, 400, 190, 150, 100.3)
    path = _write(tmp_path / "a.png", _over(_plain(300, 400, WHITE), (coverage, (0.4, 0.1, 0.02))))
    monkeypatch.setattr(umbrella_elements, "_PREVIEW_PIXELS", 9000)
    (element,) = find_elements(path).elements
    assert element.pixel == 1
    assert np.abs(_on_photo(element, (400, 300)) - coverage).mean() < 2e-3
    monkeypatch.setattr(umbrella_elements, "_MOST_SIDE_PX", 128)
    (reduced,) = find_elements(path).elements
    assert reduced.pixel == 2 and reduced.scale_px == pytest.approx(element.scale_px, abs=2)
    assert max(reduced.opacity.shape) <= 128
    assert reduced.opacity.sum() * 4 == pytest.approx(coverage.sum(), rel=0.01)


def test_data_are_cut_with_their_stored_values(tmp_path):
    alpha = _disc(64, 64, 32, 32, 25)
    normals = np.dstack([np.full((64, 64), 0.5), np.full((64, 64), 0.25), np.ones((64, 64))]).astype(np.float32)
    image = np.dstack([normals, alpha])
    spec = oiio.ImageSpec(64, 64, 4, "uint16")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    output = oiio.ImageOutput.create(str(tmp_path / "n.png"))
    output.open(str(tmp_path / "n.png"), spec)
    output.write_image(np.ascontiguousarray(image))
    output.close()
    (element,) = find_elements(tmp_path / "n.png", is_data=True).elements
    assert element.is_data and np.abs(element.color - [0.5, 0.25, 1]).max() < 1e-4


@pytest.mark.parametrize("kind", ["auto", "object", "many"])
def test_a_blank_photo_has_no_elements_and_says_so(tmp_path, kind, rng):
    noise = 0.5 + rng.normal(0, 0.004, (90, 120, 3))
    found = find_elements(_write(tmp_path / "a.png", noise), kind=kind)
    assert found.elements == () and found.reason == "nothing differs from its ground"


def test_one_pixel_and_nothing_opaque_are_reasons_not_crashes(tmp_path):
    assert find_elements(_write(tmp_path / "a.png", np.ones((1, 1, 3)))).reason
    transparent = np.zeros((40, 40, 4))
    assert find_elements(_write(tmp_path / "b.png", transparent)).reason == "it is transparent throughout"


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (3, 2), (17, 5)])
def test_tiny_cut_outs_keep_all_their_pixels(tmp_path, size):
    (element,) = find_elements(_write(tmp_path / "a.png", np.ones((*size, 4))), kind="cutout").elements
    assert element.opacity.shape == size and element.opacity.min() == 1


def test_a_cut_out_without_alpha_an_unknown_kind_and_cmyk_are_errors_in_one_line(tmp_path):
    path = _write(tmp_path / "a.png", np.ones((30, 30, 3)))
    with pytest.raises(FexelError, match=r"a\.png: has no alpha, expected a cut-out"):
        find_elements(path, kind="cutout")
    with pytest.raises(FexelError, match="kind 'heap' is unknown, expected one of auto, cutout, object, many"):
        find_elements(path, kind="heap")
    spec = oiio.ImageSpec(30, 30, 4, "uint8")
    spec.channelnames = ("C", "M", "Y", "K")
    spec.attribute("tiff:ColorSpace", "CMYK")
    output = oiio.ImageOutput.create(str(tmp_path / "c.tif"))
    output.open(str(tmp_path / "c.tif"), spec)
    output.write_image(np.full((30, 30, 4), 40, np.uint8))
    output.close()
    with pytest.raises(FexelError, match=r"c\.tif: its colours are CMYK, expected RGB or grey"):
        find_elements(tmp_path / "c.tif")
    (tmp_path / "d.png").write_bytes(path.read_bytes()[:60])
    with pytest.raises(FexelError, match=r"d\.png"):
        find_elements(tmp_path / "d.png")


def test_a_photo_filled_by_its_texture_yields_low_quality_or_nothing(tmp_path, rng):
    noise = cv2.GaussianBlur(rng.uniform(0, 1, (200, 200, 3)), (0, 0), 3)
    noise = np.clip((noise - noise.mean()) * 6 + 0.4, 0, 1)
    found = find_elements(_write(tmp_path / "a.png", noise))
    assert all(element.quality < 0.9 for element in found.elements)


def test_a_patterned_ground_is_offered_as_a_patch_and_a_plain_one_is_not(tmp_path, rng):
    coverage = _disc(200, 260, 60, 100, 40)
    plain = _plain(200, 260, (0.8, 0.8, 0.8))
    assert find_elements(_write(tmp_path / "a.png", _over(plain, (coverage, (0.4, 0, 0))))).ground_patch is None
    grain = plain * (1 + 0.04 * rng.normal(0, 1, (200, 260, 1)).clip(-2, 2))
    found = find_elements(_write(tmp_path / "b.png", _over(grain, (coverage, (0.4, 0, 0)))))
    assert min(found.ground_patch.shape[:2]) >= 64
    assert found.ground_patch.min() > 0.5  # nothing of the element is in it


def test_real_photos(shared_data):
    folder = shared_data / "umbrella"
    for leaf in sorted((folder / "leaves").glob("*.png"))[::6]:
        found = find_elements(leaf)
        assert found.kind == "object" and found.elements[0].quality > 0.8
    citrus = find_elements(folder / "citrus_slices_on_white.jpg")
    assert citrus.kind == "many" and len(citrus.elements) == 9 and len(citrus.dropped) >= 10
    sweets = find_elements(folder / "smarties_on_white.png")
    assert sweets.kind == "many" and len(sweets.elements) == 11
    pebbles = find_elements(folder / "backgrounds" / "pebbles_01.jpg")
    assert np.mean([element.quality for element in pebbles.elements]) < 0.7 < citrus.elements[1].quality
