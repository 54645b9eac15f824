"""Figures of a pinchmap against its source: analytic shapes, brute force, the float64 twin, pictures without edges."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from fexel.images import linear_to_srgb
from fexel.textures import pinchmap_twin
from fexel_tools import pinchmap_contours, pinchmap_measure
from fexel_tools.pinchmap_measure import Boundary, boundary_distance


def disc(shape, centre, radius):
    """Signed distance to a circle, positive inside, at pixel centres; coordinates x right, y down."""
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    return (radius - np.hypot(x - centre[0], y - centre[1])).astype(np.float32)


def soft(distance):
    return np.clip(distance + 0.5, 0, 1).astype(np.float32)


def random_pinchmap(rng, shape):
    pinchmap = np.zeros((*shape, 4))
    pinchmap[..., 2] = rng.integers(-1, 2, shape)
    pinchmap[..., 3] = rng.integers(-127, 128, shape) / 127
    return pinchmap


@pytest.mark.parametrize("wrap", [("clamp", "clamp"), ("repeat", "repeat"), ("repeat", "mirror")])
@pytest.mark.parametrize("shape", [(64, 64), (37, 101), (5, 3)])
def test_side_of_pixels_is_that_of_the_float64_twin(rng, wrap, shape):
    pinchmap = random_pinchmap(rng, (7, 5))
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    st = np.stack([x / shape[1], 1 - y / shape[0]], -1).reshape(-1, 2)
    twin = pinchmap_twin.edge(pinchmap, st, wrap).reshape(shape)
    field = pinchmap_measure.boundary_field(pinchmap, shape, wrap)
    np.testing.assert_allclose(field, twin, atol=1e-6)
    clear = np.abs(twin) > 1e-12
    side = pinchmap_measure.side_of_pixels(pinchmap, shape, wrap)
    np.testing.assert_array_equal(side[clear], (twin > 0)[clear])
    assert clear.mean() > 0.9


def test_texel_lies_at_the_lower_left_corner_of_its_cell():
    pinchmap = np.zeros((4, 4, 4))
    pinchmap[2, 1, 2] = 1.0
    field = pinchmap_measure.boundary_field(pinchmap, (40, 40))
    row, column = np.unravel_index(np.argmax(field), field.shape)
    # The four pixels around column 10, row 30 are equally near to the texel.
    assert {row, column} <= {9, 10, 29, 30}
    np.testing.assert_allclose(field[29:31, 9:11], 0.95**2)


@pytest.mark.parametrize("wrap", ["clamp", "repeat"])
def test_map_of_a_window_is_the_map_of_the_picture_cut_out_and_goes_on_as_it_wraps(rng, wrap):
    pinchmap = random_pinchmap(rng, (6, 5))
    window = (7, -4, 37, 32)
    whole = pinchmap_measure.boundary_field(pinchmap, (36, 30), (wrap, wrap))
    field = pinchmap_measure.boundary_field(pinchmap, (40, 50), (wrap, wrap), window=window)
    np.testing.assert_allclose(field[:32, 7:37], whole[4:], atol=1e-6)
    y, x = np.mgrid[:40, :50] + 0.5
    st = np.stack([(x - 7) / 30, 1 - (y + 4) / 36], -1).reshape(-1, 2)
    np.testing.assert_allclose(field, pinchmap_twin.edge(pinchmap, st, (wrap, wrap)).reshape(40, 50), atol=1e-6)
    covered = pinchmap_measure.coverage(pinchmap, (40, 50), (wrap, wrap), samples=1, window=window)
    assert np.mean(covered != (field > 0)) < 0.02


def test_coverage_is_the_share_of_samples_on_the_plus_side(rng):
    pinchmap = random_pinchmap(rng, (6, 9))
    fine = pinchmap_measure.side_of_pixels(pinchmap, (80 * 4, 120 * 4))
    counted = fine.reshape(80, 4, 120, 4).mean((1, 3))
    covered = pinchmap_measure.coverage(pinchmap, (80, 120), samples=4)
    # Pixels that a line only nicks, between two corners of a pixel, count as whole.
    assert np.mean(np.abs(covered - counted) > 1e-6) < 2e-3
    assert np.abs(covered - counted).max() < 0.2


def test_coverage_of_a_half_plane_is_exact():
    pinchmap = np.zeros((4, 4, 4))
    pinchmap[..., 3] = np.array([-0.75, -0.25, 0.25, 0.75])  # gamma, linear in s: zero at s = 1.5 / 4
    covered = pinchmap_measure.coverage(pinchmap, (20, 20), samples=8)
    np.testing.assert_allclose(covered[:, 7], 0.5)
    assert (covered[:, :7] == 1).all() and (covered[:, 8:] == 0).all()


def test_mismatch_and_iou_of_shifted_half_planes():
    source = np.zeros((10, 20), np.float32)
    source[:, :10] = 1
    result = np.zeros((10, 20), bool)
    result[:, :12] = True
    assert pinchmap_measure.mismatch(result, source) == pytest.approx(0.1)
    assert pinchmap_measure.iou(result, source) == pytest.approx(10 / 12)


@pytest.mark.parametrize("change", [-3.25, 0.5, 8.0])
def test_distance_of_concentric_circles_is_the_difference_of_their_radii(change):
    shape = (200, 220)
    there, here = disc(shape, (100, 97.3), 70 + change), soft(disc(shape, (100, 97.3), 70)) - 0.5
    boundary = boundary_distance(there, here)
    assert boundary.mean_px == pytest.approx(abs(change), abs=0.03)
    # Coverage that is clipped at 0 and 1 places a crossing to 0.09 px only.
    assert boundary.max_px == pytest.approx(abs(change), abs=0.1)


def test_largest_distance_reaches_a_feature_that_only_one_picture_has():
    shape = (150, 300)
    big, small = disc(shape, (75, 75), 40), disc(shape, (250, 75), 6)
    both = np.maximum(big, small)
    assert boundary_distance(big, big) == Boundary(0.0, 0.0)
    expected = 250 + 6 - (75 + 40)
    for pair in ((both, big), (big, both)):
        assert boundary_distance(*pair).max_px == pytest.approx(expected, abs=0.1)


def distances_by_force(source, target):
    points = source.ends.reshape(-1, 2, 2)
    start, along = target.ends[:, :2], target.ends[:, 2:] - target.ends[:, :2]
    share = ((points[:, :, None] - start) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-30)
    nearest = start + np.clip(share, 0, 1)[..., None] * along
    return np.linalg.norm(points[:, :, None] - nearest, axis=-1).min(-1)


@pytest.mark.parametrize("seed", range(5))
def test_distances_are_those_of_every_piece_tried(seed):
    rng = np.random.default_rng(seed)
    pictures = [pinchmap_measure.boundary_field(random_pinchmap(rng, (3 + seed, 4)), (41, 67)) for _ in range(2)]
    pictures[1][:, 25 + 4 * seed :] = 1  # and a wide part without any line
    ours, theirs = (pinchmap_contours.boundary_segments(picture) for picture in pictures)
    for source, target in ((ours, theirs), (theirs, ours)):
        expected = distances_by_force(source, target)
        length = np.linalg.norm(source.ends[:, 2:] - source.ends[:, :2], axis=1)
        found = pinchmap_contours.directed_distances(source, target)
        assert found.largest == pytest.approx(expected.max(), abs=1e-9)
        assert found.mean == pytest.approx(np.average(expected.mean(1), weights=length), rel=1e-6)


def test_traced_line_is_closed_and_has_the_length_of_its_circle():
    segments = pinchmap_contours.boundary_segments(disc((90, 90), (44.2, 45.7), 30))
    ends = np.round(segments.ends.reshape(-1, 2), 9)
    _, counts = np.unique(ends, axis=0, return_counts=True)
    assert (counts == 2).all()
    length = np.linalg.norm(segments.ends[:, 2:] - segments.ends[:, :2], axis=1).sum()
    assert length == pytest.approx(2 * math.pi * 30, rel=2e-3)


@pytest.mark.parametrize("value", [0.0, 1.0, np.nan])
def test_source_without_edges_gives_numbers_or_null_but_never_nan(value):
    side = np.full((24, 31), value, np.float32)
    plus = np.dstack([np.zeros((4, 4, 2)), np.ones((4, 4)), np.zeros((4, 4))])
    for pinchmap in (plus, plus * [1, 1, -1, 1], random_pinchmap(np.random.default_rng(0), (4, 4))):
        figures = pinchmap_measure.measure_shape(pinchmap, side).as_dict()
        json.dumps(figures, allow_nan=False)
        agrees = np.array_equal(pinchmap_measure.side_of_pixels(pinchmap, side.shape), side > 0.5)
        assert (figures["mismatch"] == 0) is agrees
        if agrees:
            assert figures == {"mismatch": 0.0, "iou": 1.0, "mean_px": 0.0, "max_px": 0.0}


def test_boundary_in_only_one_of_two_pictures_has_no_distance():
    flat = np.ones((20, 20), np.float32)
    assert boundary_distance(flat, disc((20, 20), (10, 10), 5)) == Boundary(None, None)
    assert boundary_distance(flat, -flat) == Boundary(0.0, 0.0)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (7, 1)])
def test_pictures_of_one_row_or_column_are_measured(shape):
    side = np.ones(shape, np.float32)
    figures = pinchmap_measure.measure_shape(random_pinchmap(np.random.default_rng(1), (4, 4)), side)
    assert 0 <= figures.mismatch <= 1 and figures.max_px == 0.0


def test_alpha_error_is_the_mean_difference_and_takes_nan_for_nothing():
    result, alpha = np.array([[0.5, 1.0], [np.nan, 0.0]]), np.array([[0.25, 1.0], [0.0, 1.0]], np.float32)
    assert pinchmap_measure.alpha_error(result, alpha) == pytest.approx((0.25 + 1) / 4)


def test_psnr_is_that_of_the_composited_encoded_pictures(rng):
    alpha = rng.random((2, 30, 40, 1))
    pictures = np.concatenate([rng.random((2, 30, 40, 3)) * alpha, alpha], -1).astype(np.float32)
    ground = np.array([0.3, 0.6, 0.1])
    seen = [linear_to_srgb(p[..., :3] + (1 - p[..., 3:]) * ground).astype(float) for p in pictures]
    expected = -10 * np.log10(np.mean((seen[0] - seen[1]) ** 2))
    assert pinchmap_measure.psnr_db(*pictures, ground) == pytest.approx(expected, abs=1e-3)
    raw = -10 * np.log10(np.mean((pictures[0].astype(float) - pictures[1]) ** 2))
    assert pinchmap_measure.psnr_db(*pictures, None, encode=False) == pytest.approx(raw, abs=1e-3)


def test_psnr_is_finite_for_equal_empty_and_broken_pictures():
    picture = np.full((4, 4, 4), 0.5, np.float32)
    assert pinchmap_measure.psnr_db(picture, picture) == 100.0
    assert pinchmap_measure.psnr_db(picture[:0], picture[:0]) is None
    broken = picture.copy()
    broken[0, 0] = np.nan
    assert math.isfinite(pinchmap_measure.psnr_db(broken, picture))
    with pytest.raises(ValueError, match="expected the same shape"):
        pinchmap_measure.psnr_db(picture, picture[:2])
