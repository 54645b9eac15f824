"""The sheet of a pinchmap: fair to the plain texture, legible, and marked where the map falls short."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fexel.images import image_info, read_pixels
from fexel_tools.image_files import write_image
from fexel_tools.pinchmap import Pinchmap, make_pinchmap
from fexel_tools.pinchmap_baking import reconstruct
from fexel_tools.pinchmap_fit import Fault
from fexel_tools.pinchmap_mask import channels
from fexel_tools.pinchmap_options import PinchmapOptions
from fexel_tools.pinchmap_range import scaled, value_range
from fexel_tools.pinchmap_report import PinchmapItem, describe_blur, describe_faults
from fexel_tools.pinchmap_sheet import draw_panels, plain_texture, write_sheet
from fexel_tools.pinchmap_source import PinchmapSource


@pytest.mark.parametrize("has_alpha", [True, False])
@pytest.mark.parametrize("shape", [(64, 64), (40, 100), (3, 200), (1, 1)])
def test_plain_texture_has_at_most_the_bytes_and_nearly_all(rng, shape, has_alpha):
    picture = np.ones((*shape, 4), np.float32)
    picture[..., :3] = rng.random((*shape, 3))
    nbytes = 1200
    plain = plain_texture(picture, nbytes, has_alpha)
    used = plain.shape[0] * plain.shape[1] * (4 if has_alpha else 3)
    assert used <= nbytes
    assert used > 0.85 * nbytes or plain.shape[:2] == shape or shape[0] <= 3


def test_plain_texture_of_a_constant_picture_is_constant():
    picture = np.tile(np.float32([0.2, 0.1, 0.05, 0.5]), (33, 47, 1))
    assert np.abs(plain_texture(picture, 400, True) - picture[0, 0]).max() < 0.005


@pytest.fixture
def pinchmap():
    """A white square on black, opaque, whose lines lie on the mask's: the result is exact."""
    mask = np.zeros((8, 12), bool)
    mask[2:6, 3:9] = True
    texels = np.zeros((8, 12, 4))
    texels[..., :3] = channels(mask)
    signal = np.ones((8, 12, 4), np.float32)
    signal[..., :3] = mask[..., None]
    picture = reconstruct(texels, signal, (160, 240))
    source = SimpleNamespace(color=picture[..., :3], opacity=picture[..., 3], side=picture[..., 0], is_data=False)
    fit = SimpleNamespace(mask=mask, window=(0, 0, 240, 160))
    return Pinchmap(source, 12, fit, texels, signal, ("clamp", "clamp"), np.eye(3))


def item(*faults):
    sizes = {"pinchmap": (12, 8), "signal": (12, 8), "source": (240, 160)}
    return PinchmapItem("a/emblem.svg", 12, 672, 1.0, 0.0, 0.0, 0.0, 60.0, 0.1, "emblem.usda", **sizes, faults=faults)


def test_exact_result_shows_no_error_and_beats_the_plain_texture(pinchmap):
    whole = draw_panels(pinchmap, item(), 240).rows[0].pictures
    original, result, plain, error = (np.asarray(picture, float) for picture in whole)
    assert original.shape == (160, 240, 3)
    assert np.abs(result - original).max() <= 1
    assert np.abs(plain - original).max() > 50
    assert error.sum(axis=2).max() < 20


def test_close_up_shows_the_busiest_texels_at_magnification(pinchmap):
    rows = draw_panels(pinchmap, item(), 240).rows
    assert len(rows) == 2 and rows[1].label.startswith("close-up")
    result = rows[1].pictures[1]
    grey = ((result > 10) & (result < 245)).all(axis=2)
    assert (result > 245).any() and (result < 10).any()
    assert grey.mean() < 0.02, "the edge is one pixel wide, however near"


def test_faults_are_ringed_and_named(pinchmap):
    faults = [Fault(60.0, 40.0, "crossing", 30), Fault(200.0, 100.0, "too near", 5)]
    clean, marked = (draw_panels(pinchmap, item(*each), 240).rows for each in ((), faults))
    assert np.array_equal(clean[0].pictures[0], marked[0].pictures[0]), "the original is left alone"
    for number in (1, 3):
        changed = (clean[0].pictures[number] != marked[0].pictures[number]).any(axis=2)
        y, x = np.nonzero(changed)
        assert np.minimum(np.hypot(x - 60, y - 40), np.hypot(x - 200, y - 100)).max() < 12
        assert changed[:, :120].any() and changed[:, 120:].any()
    assert "2 marked" in marked[0].label
    assert "1 crossing, 1 too near" in marked[1].label


def test_faults_are_listed_worst_first_with_a_size_that_helps():
    faults = [Fault(1.2, 2.7, "too near", 5), Fault(60.0, 40.0, "crossing", 30)]
    lines = describe_faults("a.svg", faults, 48)
    assert lines[0] == "a.svg: 2 places where the lines are more than the map can express; --size 48 would help"
    assert lines[1].strip() == "crossing at pixel (60, 40), 30 pixels wrong"
    assert describe_faults("a.svg", [], None) == []
    many = describe_faults("a.svg", faults * 30, None)
    assert [line.split(", ")[-1] for line in many[1:-1]] == ["30 pixels wrong"] * 5
    assert many[-1] == "  ... and 55 more (in --report)"


def test_sheets_of_many_files_are_pages_of_squares(pinchmap, tmp_path):
    panels = draw_panels(pinchmap, item(), 96, square=True)
    assert [picture.shape for picture in panels.rows[0].pictures] == [(96, 96, 3)] * 4
    write_sheet([panels] * 3, tmp_path / "sheet.png")
    page = read_pixels(image_info(str(tmp_path / "sheet.png")))
    assert page.shape[0] > 3 * 96 and page.shape[1] > 4 * 96


@pytest.mark.parametrize("shape", [(400, 3), (3, 400), (1, 1), (37, 53)])
def test_any_aspect_can_be_drawn(shape):
    mask = np.zeros((4, 4), bool)
    mask[:, :2] = True
    texels = np.zeros((4, 4, 4))
    texels[..., :3] = channels(mask)
    signal = np.full((4, 4, 4), 0.5, np.float32)
    source = SimpleNamespace(
        color=np.full((*shape, 3), 0.5, np.float32),
        opacity=np.full(shape, 0.5, np.float32),
        is_data=False,
        side=np.zeros(shape, np.float32),
    )
    made = Pinchmap(source, 4, SimpleNamespace(mask=mask), texels, signal, ("clamp", "clamp"), np.eye(3))
    entry = PinchmapItem("x.png", 4, 128, 1.0, 0.0, None, None, None, 0.1, "x.usda", (4, 4), (4, 4), shape[::-1])
    for row in (*draw_panels(made, entry, 100).rows, *draw_panels(made, entry, 100, square=True).rows):
        assert len({picture.shape for picture in row.pictures}) == 1


def _measured_item(tmp_path, picture, is_data):
    """Report of a wide picture, its right half on the + side; values are stored as floats."""
    write_image(tmp_path / "wide.exr", picture.astype(np.float32), "raw")
    side = np.zeros((*picture.shape[:2], 1), np.uint8)
    side[:, picture.shape[1] // 2 :] = 255
    write_image(tmp_path / "side.png", side, "raw")
    options = PinchmapOptions(size=8, mask=str(tmp_path / "side.png"), drives="normal" if is_data else "")
    files = {name: tmp_path / f"out.{name}" for name in ("usda", "png")}
    item = make_pinchmap(str(tmp_path / "wide.exr"), files["usda"], options, sheet=files["png"])
    return item, read_pixels(image_info(str(files["png"])))


@pytest.mark.parametrize("is_data", [False, True])
def test_values_outside_of_0_to_1_are_compared_and_shown(tmp_path, rng, is_data):
    """A noise that no map of 8 texels shows lies above 1 or below 0: clipped, all pictures would be equal."""
    noise = rng.random((64, 96, 3)) * 8
    picture = -1 - noise if is_data else 1 + noise
    item, sheet = _measured_item(tmp_path, picture, is_data)
    assert 5 < item.psnr_db < 25 and 5 < item.plain_psnr_db < 25
    assert sheet[40:200, :480].std() > 10, "the original is not one colour"


def test_signed_normals_count_over_their_whole_range(tmp_path):
    """x is a ramp from -1 to 1 on either side: errors below 0 count as those above."""
    x = np.linspace(-1, 1, 96)[None].repeat(64, axis=0)
    normals = np.dstack([x, 0 * x, np.sqrt(1 - x * x)])
    item, _ = _measured_item(tmp_path, normals, True)
    mirrored, _ = _measured_item(tmp_path, normals * [-1, 1, 1], True)
    assert mirrored.psnr_db == pytest.approx(item.psnr_db, abs=1.0)
    assert 25 < item.psnr_db < 99


def test_the_range_brings_values_to_0_to_1_and_keeps_what_is_transparent():
    opacity = np.float32([[1, 0.5], [0, 1]])
    color = np.float32([[[-3] * 3, [1] * 3], [[99] * 3, [5] * 3]])
    source = PinchmapSource(Path("x"), color, opacity, opacity, True, 32)
    assert value_range(source) == (-3, 5)
    picture = scaled(np.dstack([color * opacity[..., None], opacity]), value_range(source))
    np.testing.assert_allclose(picture[..., 0], [[0, 0.25], [0, 1]], atol=1e-6)
    assert value_range(replace(source, is_data=False)) == (0, 5)
    assert value_range(replace(source, color=color * 0)) == (0, 1)


def test_nothing_is_advised_where_the_pinchmap_is_exact():
    item = PinchmapItem("f", 8, 9, 1.0, 0.0, 0.0, 0.0, 100.0, 0.0, "s", (8, 8), (8, 8), (8, 8), plain_psnr_db=100.0)
    assert describe_blur(item) == ""
    assert "--regions auto" in describe_blur(replace(item, psnr_db=30.0, plain_psnr_db=29.0))


def test_a_map_without_any_line_is_said_even_when_nothing_was_measured():
    item = PinchmapItem("f", 8, 9, None, 0.0, None, None, None, 0.0, "s", (8, 8), (8, 8), (8, 8))
    assert describe_blur(item) == ""
    assert "nothing is sharp" in describe_blur(replace(item, has_lines=False))
