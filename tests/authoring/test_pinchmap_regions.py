"""Sides from regions: which boundaries are kept, where they run, what is lost and said."""

import cv2
import numpy as np
import OpenImageIO as oiio
import pytest

from fexel.errors import FexelError
from fexel.images import srgb_to_linear
from fexel_tools.pinchmap_labels import find_labels
from fexel_tools.pinchmap_regions import label_sides, region_sides
from fexel_tools.pinchmap_source import load_source
from fexel_tools.region_graph import absorb_regions, build_graph, merge_regions


def _disc(height, width, x, y, radius):
    """(H, W) coverage, as if the rim were straight within a pixel."""
    rows, columns = np.mgrid[:height, :width] + 0.5
    return np.clip(radius + 0.5 - np.hypot(columns - x, rows - y), 0, 1).astype(np.float32)


def _picture(shape, ground, *layers):
    """Linear picture of encoded colours laid over each other, (coverage, colour) each, mixed as drawings mix them."""
    encoded = np.broadcast_to(np.float32(ground), (*shape, 3))
    for coverage, color in layers:
        encoded = encoded + (np.float32(color) - encoded) * coverage[..., None]
    return srgb_to_linear(encoded)


def _opaque(picture):
    return np.ones(picture.shape[:2], np.float32)


@pytest.mark.parametrize(("height", "width"), [(200, 260), (777, 1100)])
@pytest.mark.parametrize(
    ("ground", "color"), [((1, 1, 1), (0, 0, 0)), ((0.2, 0.5, 0.8), (0.9, 0.6, 0.1)), ((0.45,) * 3, (0.6,) * 3)]
)
def test_the_boundary_runs_where_the_coverage_is_half(height, width, ground, color):
    coverage = _disc(height, width, 0.47 * width, 0.51 * height, 0.3 * height)
    picture = _picture((height, width), ground, (coverage, color))
    found = region_sides(picture, _opaque(picture))
    assert found.regions == 2 and found.kept == 1 and not found.lost
    assert np.abs(found.side - coverage).max() < 0.02


def test_noise_and_shading_make_no_regions(rng):
    coverage = _disc(300, 400, 200, 150, 90)
    shade = np.linspace(0.75, 1, 400, dtype=np.float32)[None, :, None]
    picture = _picture((300, 400), (0.8, 0.8, 0.75), (coverage, (0.7, 0.1, 0.1))) * shade
    picture = np.clip(picture + rng.normal(0, 0.01, picture.shape), 0, 1).astype(np.float32)
    found = region_sides(picture, _opaque(picture))
    assert found.regions == 2
    assert ((found.side > 0.5) != (coverage > 0.5)).mean() < 1e-3


def test_of_three_regions_that_meet_the_weakest_boundary_is_lost_and_said():
    picture = np.zeros((400, 400, 3), np.float32)
    picture[:200] = srgb_to_linear(np.float32([1, 1, 1]))
    picture[200:, :200] = srgb_to_linear(np.float32([0.6, 0.1, 0.1]))
    picture[200:, 200:] = srgb_to_linear(np.float32([0.4, 0.2, 0.1]))
    found = region_sides(picture, _opaque(picture))
    assert found.regions == 3 and 0.8 < found.kept < 1
    (lost,) = found.lost
    assert lost.x == pytest.approx(200, abs=1.5) and lost.y == pytest.approx(300, abs=3)
    assert lost.length_px == pytest.approx(200, abs=4) and 25 < lost.contrast < 40
    assert (found.side[:198] < 0.01).all() and (found.side[202:] > 0.99).all()  # most of the border is 0


def test_colours_inside_a_cut_out_and_its_outline_are_both_told():
    """A white ring around a black disc on a transparent ground: three nested regions, two sides, nothing lost."""
    outer, inner = _disc(300, 300, 150, 150, 120), _disc(300, 300, 150, 150, 60)
    picture = _picture((300, 300), (1, 1, 1), (inner, (0, 0, 0)))
    found = region_sides(picture, outer)
    assert found.regions == 3 and not found.lost
    assert np.abs(found.side - (outer - inner)).max() < 0.02


def test_transparent_and_black_differ():
    picture = np.zeros((64, 64, 3), np.float32)
    found = region_sides(picture, _disc(64, 64, 32, 32, 20))
    assert found.regions == 2
    assert np.abs(found.side - _disc(64, 64, 32, 32, 20)).max() < 0.02


def test_two_colours_lose_no_boundary():
    layers = [(_disc(300, 400, 60 + 70 * i, 150, 30), (0.1 * i, 0.2, 0.6 - 0.1 * i)) for i in range(5)]
    picture = _picture((300, 400), (1, 1, 0.9), *layers)
    found = region_sides(picture, _opaque(picture), colors=2)
    coverage = sum(layer[0] for layer in layers)
    assert found.regions == 6 and found.kept == 1 and not found.lost
    assert ((found.side > 0.5) != (coverage > 0.5)).mean() < 1e-4


def test_a_crease_of_a_normal_map_is_a_boundary_and_a_bend_is_none():
    columns = np.linspace(-1, 1, 256, dtype=np.float32)
    tilt = np.where(columns < 0, 0.3 + 0.2 * columns, -0.3 + 0.2 * columns)  # a roof, slightly bent
    normals = np.stack([np.sin(tilt), np.zeros_like(tilt), np.cos(tilt)], axis=-1) * 0.5 + 0.5
    picture = np.repeat(normals[None].astype(np.float32), 128, axis=0)
    found = region_sides(picture, _opaque(picture), is_data=True)
    assert found.regions == 2
    assert np.array_equal(np.diff((found.side[64] > 0.5).astype(int)).nonzero()[0], [127])


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (2, 2), (3, 5), (17, 640)])
@pytest.mark.parametrize("colors", [None, 2, 7])
@pytest.mark.parametrize("is_data", [False, True])
def test_any_size_gives_finite_sides(rng, shape, colors, is_data):
    for picture in (np.full((*shape, 3), 0.5, np.float32), rng.random((*shape, 3), np.float32)):
        for opacity in (np.ones(shape, np.float32), np.zeros(shape, np.float32), rng.random(shape, np.float32)):
            side = region_sides(picture, opacity, colors=colors, is_data=is_data).side
            assert side.shape == shape and side.dtype == np.float32
            assert side.min() >= 0 and side.max() <= 1


def test_noise_gives_the_same_sides_every_time(rng):
    picture = rng.random((120, 150, 3), np.float32)
    first = region_sides(picture, _opaque(picture), seed=5)
    again = region_sides(picture, _opaque(picture), seed=5)
    assert np.array_equal(first.side, again.side) and first.lost == again.lost


def test_labels_get_two_sides_and_keep_their_pixels():
    labels = np.zeros((60, 90), np.int32)
    labels[:, 30:60], labels[:, 60:] = 1, 2
    picture = np.zeros((60, 90, 3), np.float32)
    picture[:, 30:60] = 1
    found = label_sides(labels, picture, _opaque(picture))
    assert found.regions == 3 and not found.lost
    assert np.array_equal(found.side > 0.5, labels == 1)


def test_label_images_are_told_from_soft_masks(rng):
    soft = cv2.GaussianBlur(_disc(100, 120, 60, 50, 30), (0, 0), 4)
    assert find_labels(np.repeat(np.rint(soft * 255)[..., None] / 255, 3, axis=2).astype(np.float32)) is None
    truth = np.zeros((100, 120), np.int32)
    truth[20:80, 10:60], truth[30:90, 70:110] = 1, 2
    palette = np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0]])
    rimmed = cv2.blur(palette[truth], (2, 2))  # an anti-aliased rim is no label
    labels = find_labels(rimmed)
    assert labels is not None and labels.max() == 2
    assert (labels != truth).mean() < 0.04
    grey = np.repeat(truth[..., None] / np.float32(255), 3, axis=2)  # values 0, 1, 2 of 8 bits
    assert np.array_equal(find_labels(grey), truth)


def test_merging_joins_the_least_different_first_and_keeps_totals(rng):
    labels = np.repeat(np.arange(12), 5)[None].repeat(8, axis=0).astype(np.int32)
    level = np.float32([0, 1, 2, 30, 31, 32, 60, 61, 62, 90, 91, 92])
    features = np.repeat(level[labels][..., None], 3, axis=2)
    graph = build_graph(labels, features)
    merged, number = merge_regions(graph, 10.0, 0.0, 200)
    assert number.tolist() == [0] * 3 + [1] * 3 + [2] * 3 + [3] * 3
    assert merged.area.tolist() == [120] * 4 and merged.length.tolist() == [8] * 3
    assert merged.contrast == pytest.approx([28 * 3**0.5] * 3)
    assert merged.total.sum() == pytest.approx(features.sum())
    few, number = merge_regions(graph, 10.0, 0.0, 2)
    assert len(few.area) <= 2
    whole, number = merge_regions(graph, 10.0, 1e9, 200)
    assert len(whole.area) == 1 and not len(whole.edges)


def test_what_is_too_narrow_for_the_map_is_no_region():
    """Stripes of 10 pixels between fields: told apart by a map with texels of 4 pixels, not by one of 16."""
    picture = np.full((256, 512, 3), 0.8, np.float32)
    picture[:, 256:] = 0.02
    picture[:, 120:130] = (0.02, 0.02, 0.3)
    picture[:, 380:390] = (0.8, 0.8, 0.5)
    fine = region_sides(picture, _opaque(picture), texels=128)
    coarse = region_sides(picture, _opaque(picture), texels=32)
    assert fine.regions == 6 and coarse.regions == 2
    assert np.count_nonzero(np.diff(fine.side[100] > 0.5)) == 5
    assert np.flatnonzero(np.diff(coarse.side[100] > 0.5)).tolist() == [255]


def test_marked_regions_join_the_least_different_neighbour():
    labels = np.repeat(np.arange(5), 6)[None].repeat(4, axis=0).astype(np.int32)
    level = np.float32([0, 40, 50, 100, 104])
    graph = build_graph(labels, level[labels][..., None])
    merged, number = absorb_regions(graph, np.array([False, True, False, False, True]))
    assert number.tolist() == [0, 1, 1, 2, 2] and merged.area.tolist() == [24, 48, 48]
    merged, number = absorb_regions(graph, np.ones(5, bool))
    assert number.tolist() == [0, 0, 0, 1, 1]
    alone = build_graph(np.zeros((3, 3), np.int32), np.zeros((3, 3, 1), np.float32))
    assert absorb_regions(alone, np.ones(1, bool))[1].tolist() == [0]


def test_a_picture_without_boundaries_says_what_to_pass(tmp_path):
    path = tmp_path / "plain.png"
    output = oiio.ImageOutput.create(str(path))
    output.open(str(path), oiio.ImageSpec(40, 30, 3, "uint8"))
    output.write_image(np.full((30, 40, 3), 90, np.uint8))
    output.close()
    with pytest.raises(FexelError, match=r"plain\.png: no boundary .* was found; pass a mask"):
        load_source(path, regions="auto")


def test_shared_silhouette_and_sweets(shared_data):
    horse = load_source(shared_data / "pinch" / "horse_silhouette.png", regions="auto")
    assert horse.regions.kept > 0.99
    dark = horse.color.mean(axis=2) < srgb_to_linear(np.float32([0.5]))
    assert ((horse.side > 0.5) != dark).mean() < 2e-3
    sweets = load_source(shared_data / "umbrella" / "smarties_on_white.png", regions="auto")
    saturation = sweets.color.max(axis=2) - sweets.color.min(axis=2)
    assert (sweets.side[saturation > 0.5] > 0.5).mean() > 0.9
    assert sweets.side[:30].max() < 0.5
