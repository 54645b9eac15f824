"""Fitting mask and gamma: exact errors, legality, hard inputs, windows."""

import itertools

import numpy as np
import pytest

from fexel.errors import FexelError
from fexel_tools import pinchmap_fit, pinchmap_legal
from fexel_tools.pinchmap_fit import fit
from fexel_tools.pinchmap_gamma import cell_errors, lattice_of, wrong_pixels
from fexel_tools.pinchmap_legal import legalise
from fexel_tools.pinchmap_mask import channels, is_legal, violations
from fexel_tools.pinchmap_window import choose_window, cut, matrix_of

CLAMP, REPEAT = ("clamp", "clamp"), ("repeat", "repeat")


def bilinear(levels, x, y, repeat):
    """Levels at (x, y) in cells from the upper left corner, from the definition: texel [r, c] at (c, r + 1)."""
    nh, nw = levels.shape
    x, y = (x if repeat[0] else np.clip(x, 0, nw - 1)), (y - 1 if repeat[1] else np.clip(y - 1, 0, nh - 1))
    c, r = np.floor(x).astype(int), np.floor(y).astype(int)
    u, v = x - c, y - r

    def texel(i, j):
        i = i % nh if repeat[1] else np.clip(i, 0, nh - 1)
        j = j % nw if repeat[0] else np.clip(j, 0, nw - 1)
        return levels[i, j]

    upper = texel(r, c) * (1 - u) + texel(r, c + 1) * u
    return upper * (1 - v) + (texel(r + 1, c) * (1 - u) + texel(r + 1, c + 1) * u) * v


def shown(levels, size, repeat=(False, False), window=None):
    """Which pixels of an image of some (rows, columns) a map shows on the + side."""
    left, top, right, bottom = window or (0, 0, size[1], size[0])
    x = (np.arange(size[1]) + 0.5 - left) * levels.shape[1] / (right - left)
    y = (np.arange(size[0]) + 0.5 - top) * levels.shape[0] / (bottom - top)
    return bilinear(levels, *np.meshgrid(x, y), repeat) > 0


def disc(size, center, radius):
    """Anti-aliased disc, center and radius as shares of the image."""
    y, x = (np.arange(size) + 0.5) / size, (np.arange(size) + 0.5) / size
    distance = np.hypot(x - center[0], y[:, None] - center[1])
    return np.clip((radius - distance) * size + 0.5, 0, 1).astype(np.float32)


def mismatch_of(fitted, side, wrap=CLAMP):
    levels = fitted.pinchmap[..., 2] - fitted.pinchmap[..., 3]
    repeat = tuple(w == "repeat" for w in wrap)
    return float((shown(levels, side.shape, repeat, fitted.window) != (side > 0.5)).mean())


def assert_sound(fitted, side, wrap=CLAMP, steps=127):
    """Legal, consistent, on the grid of the file, and as wrong as it says."""
    assert is_legal(fitted.mask, wrap)
    np.testing.assert_array_equal(fitted.pinchmap[..., :3], channels(fitted.mask, wrap))
    gamma = fitted.pinchmap[..., 3] * steps
    np.testing.assert_allclose(gamma, np.rint(gamma), atol=1e-6)
    assert np.abs(fitted.pinchmap[..., 3]).max() < 1
    assert fitted.mismatch == pytest.approx(mismatch_of(fitted, side, wrap), abs=4.5 / side.size)  # ties


@pytest.mark.parametrize("repeat", [(False, False), (True, False), (True, True)])
@pytest.mark.parametrize(("size", "shape"), [((40, 40), (5, 5)), ((37, 53), (5, 7)), ((64, 24), (3, 8))])
def test_errors_by_table_are_those_of_the_definition(rng, size, shape, repeat):
    plus = (rng.random(size) < 0.5).astype(np.uint8)
    plus[: size[0] // 2, : size[1] // 2] = 1  # cells of one side take another path
    levels = rng.uniform(-1, 1, shape)
    lattice = lattice_of(plus, shape, repeat, (0, 0, size[1], size[0]))
    errors = np.zeros(shape, np.int64)
    wrong = shown(levels, size, repeat) != plus
    assert cell_errors(lattice, levels, errors) == wrong.sum() == errors.sum()
    np.testing.assert_array_equal(wrong_pixels(plus, levels, repeat, (0, 0, size[1], size[0])), wrong)


def test_errors_within_a_window_leave_the_rest_out(rng):
    plus, levels = (rng.random((50, 60)) < 0.5).astype(np.uint8), rng.uniform(-1, 1, (6, 6))
    window = (7, -9, 64, 40)
    wrong = shown(levels, plus.shape, window=window) != plus
    np.testing.assert_array_equal(wrong_pixels(plus, levels, (False, False), window), wrong)
    total = cell_errors(lattice_of(plus, (6, 6), (False, False), window), levels, np.zeros((6, 6), np.int64))
    assert total == wrong[:40, 7:].sum()


@pytest.mark.parametrize("repeat", list(itertools.product([False, True], repeat=2)))
@pytest.mark.parametrize("shape", [(1, 1), (1, 4), (2, 2), (3, 5), (9, 7)])
def test_any_mask_becomes_legal(rng, shape, repeat):
    wrap = tuple("repeat" if joined else "clamp" for joined in repeat)
    for density in (0.1, 0.5, 0.9):
        mask = rng.random(shape) < density
        cost, turning = rng.normal(0, 5, shape), rng.normal(0, 50, shape)
        assert is_legal(legalise(mask, cost, turning, repeat, unit=100.0, trials=20, restarts=2), wrap)


def test_a_legal_mask_that_the_image_agrees_with_stays(rng):
    mask = np.zeros((12, 12), bool)
    mask[3:9, 2:7] = True
    turning = np.where(channels(mask)[..., 2] == 0, rng.normal(0, 50, mask.shape), 50 * channels(mask)[..., 2])
    kept = legalise(mask, np.where(mask, -10.0, 10.0), turning, (False, False), unit=100.0)
    np.testing.assert_array_equal(kept, mask)


def test_one_wrong_cell_is_mended_by_that_cell():
    mask = np.zeros((12, 12), bool)
    mask[3:9, 2:7] = True
    spoiled = mask.copy()
    spoiled[5, 4] = False
    assert violations(spoiled).any()
    kept = legalise(spoiled, np.where(spoiled, -10.0, 10.0), np.zeros(mask.shape), (False, False), unit=100.0)
    np.testing.assert_array_equal(kept, mask)


def test_a_straight_line_of_any_slope_is_exact_to_a_pixel_in_a_thousand():
    y, x = np.mgrid[:256, :256] + 0.5
    for angle in np.radians([0, 10, 33, 45, 71, 90, 160]):
        distance = (x - 118.3) * np.cos(angle) + (y - 131.7) * np.sin(angle)
        side = np.clip(distance + 0.5, 0, 1).astype(np.float32)
        window = choose_window(side, (16, 16))
        fitted = fit(side, (16, 16), window=window)
        assert_sound(fitted, side)
        assert fitted.mismatch < 1e-3, np.degrees(angle)


def test_a_rough_edge_midway_through_cells_does_not_zigzag():
    steps = 0
    for size in (512, 1000):
        rough = np.random.default_rng(3).normal(0, 1, (2, size))
        y, x = np.abs(np.mgrid[:size, :size] + 0.5 - size / 2)
        distance = np.minimum(8.5 * size / 32 - x + rough[0][:, None], 6.5 * size / 32 - y + rough[1])
        mask = fit(np.clip(distance + 0.5, 0, 1).astype(np.float32), (32, 32)).mask[:, 10:22]
        for edge in (mask.argmax(0), mask[::-1].argmax(0)):
            steps += np.count_nonzero(np.diff(edge))
    assert steps <= 8  # of 44; with a majority of half the pixels 14


def test_error_falls_with_the_square_of_the_size_and_faster():
    side = disc(512, (0.47, 0.52), 0.31)
    coarse, fine = fit(side, (8, 8)), fit(side, (32, 32))
    assert_sound(fine, side)
    assert fine.mismatch < 2e-4
    assert fine.mismatch < coarse.mismatch / 16
    assert not fine.faults


def test_what_a_map_shows_is_found_again(rng):
    y, x = np.mgrid[:16, :16]
    levels = np.clip(np.sin(x / 2.9) + np.cos(y / 2.3) + 0.05 * rng.normal(size=x.shape), -0.99, 0.99)
    side = shown(levels, (256, 256)).astype(np.float32)
    fitted = fit(side, (16, 16), window=choose_window(side, (16, 16)))
    assert_sound(fitted, side)
    assert fitted.mismatch < 4e-3


@pytest.mark.parametrize(("bits", "steps"), [(8, 127), (16, 32767), (32, 32767)])
def test_gamma_lies_on_the_grid_of_the_file(bits, steps):
    side = disc(200, (0.4, 0.5), 0.3)
    fitted = fit(side, (11, 13), bits=bits)
    assert_sound(fitted, side, steps=steps)
    assert fitted.mismatch < 2e-3


def test_equal_seeds_give_equal_maps():
    side = (np.random.default_rng(3).random((90, 110)) < 0.5).astype(np.float32)
    first, second, other = (fit(side, (9, 11), seed=seed).pinchmap for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, second)
    assert (first != other).any()


@pytest.mark.parametrize("wrap", [CLAMP, ("repeat", "clamp"), REPEAT])
def test_noise_gives_a_legal_map(wrap):
    side = np.random.default_rng(0).random((128, 96)).astype(np.float32)
    assert_sound(fit(side, (16, 12), wrap=wrap), side, wrap)


@pytest.mark.parametrize("most", [0, 3, 100])
def test_a_mask_is_legal_however_few_places_may_be_mended(rng, monkeypatch, most):
    budgets = []
    make_legal = pinchmap_legal._make_legal

    def recorded(*arguments):
        budgets.append(arguments[-1])
        return make_legal(*arguments)

    monkeypatch.setattr(pinchmap_legal, "_MOST_TRIED_EVER", most)
    monkeypatch.setattr(pinchmap_legal, "_make_legal", recorded)
    mask = rng.random((40, 40)) < 0.5
    kept = legalise(mask, rng.normal(0, 5, mask.shape), rng.normal(0, 50, mask.shape), (False, False), unit=100.0)
    assert is_legal(kept)
    assert {id(budget) for budget in budgets} == {id(budgets[0])}  # one for all restarts
    assert budgets[0][0] == 0


def test_noise_on_a_large_map_takes_no_more_trials_and_rounds_than_allowed(monkeypatch):
    trials, rounds = [], []
    search, reweighted = pinchmap_fit.search, pinchmap_fit.reweighted_levels

    def counted_search(*arguments):
        trials.append(arguments[8])
        return search(*arguments)

    def counted_reweighting(*arguments):
        rounds.append(len(arguments[1]))
        return reweighted(*arguments)

    monkeypatch.setattr(pinchmap_fit, "search", counted_search)
    monkeypatch.setattr(pinchmap_fit, "reweighted_levels", counted_reweighting)
    monkeypatch.setattr(pinchmap_fit, "_MOST_TRIALS", 200)
    monkeypatch.setattr(pinchmap_fit, "_MOST_REWEIGHTED", 1000)
    side = np.random.default_rng(1).random((256, 256)).astype(np.float32)
    assert_sound(fit(side, (48, 48)), side)
    assert trials == [200, 200]
    assert len(rounds) <= 2  # one for each of two masks, of over 1000 cells each


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_an_image_of_one_side_has_nothing_active(value):
    side = np.full((33, 47), value, np.float32)
    fitted = fit(side, (7, 9))
    assert_sound(fitted, side)
    assert fitted.mismatch == 0
    assert (fitted.mask == bool(value)).all()
    assert not fitted.faults


def test_a_single_pixel_may_vanish_but_costs_no_more_than_itself():
    side = np.zeros((64, 64), np.float32)
    side[20, 41] = 1
    fitted = fit(side, (8, 8))
    assert_sound(fitted, side)
    assert fitted.mismatch <= 1 / side.size


def test_an_image_of_one_pixel_or_row_can_be_fitted():
    for shape in ((1, 1), (1, 9), (2, 1)):
        side = np.linspace(0, 1, shape[0] * shape[1], dtype=np.float32).reshape(shape)
        assert is_legal(fit(side, (4, 5)).mask)


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (2, 2), (5, 3)])
def test_the_smallest_maps_are_legal(shape):
    side = disc(40, (0.3, 0.6), 0.3)
    for wrap in (CLAMP, REPEAT):
        assert_sound(fit(side, shape, wrap=wrap), side, wrap)


def test_a_source_smaller_than_its_map_is_continued_smoothly():
    side = disc(24, (0.5, 0.5), 0.3)
    fitted = fit(side, (32, 32))
    assert is_legal(fitted.mask)
    fine = shown(fitted.pinchmap[..., 2] - fitted.pinchmap[..., 3], (960, 960))
    truth = disc(960, (0.5, 0.5), 0.3) > 0.5
    assert (fine & truth).sum() / (fine | truth).sum() > 0.98  # nearest neighbours of 24 x 24 reach 0.95


def test_a_source_with_hundreds_of_pixels_a_cell_is_fitted_on_a_smaller_one():
    side = disc(1600, (0.45, 0.55), 0.35)
    fitted = fit(side, (6, 6))
    assert_sound(fitted, side)
    assert fitted.mismatch < 4e-3


def test_not_a_number_counts_as_the_minus_side():
    side = disc(100, (0.5, 0.5), 0.3)
    damaged = np.where(side > 0, side, np.nan).astype(np.float32)
    np.testing.assert_array_equal(fit(damaged, (10, 10)).mask, fit(side, (10, 10)).mask)


def test_a_tile_is_fitted_across_its_seam():
    side = np.roll(disc(256, (0.5, 0.5), 0.3), (128, 128), (0, 1))  # the disc's centre lies on the corners
    fitted = fit(side, (16, 16), wrap=REPEAT)
    assert_sound(fitted, side, REPEAT)
    assert fitted.mismatch < 2e-3
    rolled = fit(np.roll(side, (16, -48), (0, 1)), (16, 16), wrap=REPEAT)
    assert rolled.mismatch < 2e-3


def test_bad_arguments_are_named():
    side = np.zeros((8, 8), np.float32)
    with pytest.raises(FexelError, match=r"shape \(8, 8, 3\), expected \(H, W\)"):
        fit(np.zeros((8, 8, 3), np.float32), (4, 4))
    with pytest.raises(FexelError, match="expected 8, 16 or 32"):
        fit(side, (4, 4), bits=12)
    with pytest.raises(FexelError, match="0x4 texels"):
        fit(side, (4, 0))


def test_a_line_in_the_last_cells_needs_a_window_that_reaches_beyond():
    side = disc(256, (0.62, 0.4), 0.38)  # touches the right and upper side
    plain = fit(side, (16, 16))
    window = choose_window(side, (16, 16))
    left, top, right, bottom = window
    assert (left, bottom) == (0, 256) and right > 256 and top < 0
    wider = fit(side, (16, 16), window=window)
    assert_sound(wider, side)
    assert wider.mismatch < 0.5 * plain.mismatch


def test_a_window_covers_the_content_alone_and_shows_nothing_around_it():
    side = np.zeros((300, 400), np.float32)
    side[90:190, 60:160] = disc(100, (0.5, 0.5), 0.5)
    window = choose_window(side, (16, 16), content=side > 0)
    assert window[0] < 60 and window[1] < 90 and window[2] > 160 and window[3] > 190
    assert (window[2] - window[0]) * (window[3] - window[1]) < 150 * 150
    fitted = fit(side, (16, 16), window=window)
    assert_sound(fitted, side)  # counts the pixels outside the window as well
    assert fitted.mismatch < 0.5 * fit(side, (16, 16)).mismatch


def test_a_window_is_the_whole_image_where_nothing_else_is_allowed():
    side = disc(128, (0.5, 0.5), 0.2)
    assert choose_window(side, (16, 16)) == (0, 0, 128, 128)
    assert choose_window(side, (16, 16), wrap=REPEAT, content=side > 0) == (0, 0, 128, 128)
    assert choose_window(np.zeros((50, 60), np.float32), (8, 8), content=np.zeros((50, 60), bool)) == (0, 0, 60, 50)


def test_window_matrix_takes_the_image_to_the_map(rng):
    window, size = (-3, -20, 150, 90), (100, 140)
    matrix = matrix_of(window, size)
    x, y = rng.uniform(0, 140, 9), rng.uniform(0, 100, 9)
    st = np.stack([x / 140, 1 - y / 100, np.ones(9)], axis=1) @ matrix
    np.testing.assert_allclose(st[:, 0], (x + 3) / 153)
    np.testing.assert_allclose(st[:, 1], 1 - (y + 20) / 110)


def test_cutting_repeats_the_border(rng):
    image = rng.random((5, 6, 3))
    part = cut(image, (-2, 1, 4, 7))
    assert part.shape == (6, 6, 3)
    np.testing.assert_array_equal(part[:4, 2:], image[1:5, :4])
    np.testing.assert_array_equal(part[4], part[3])
    np.testing.assert_array_equal(part[:, 0], part[:, 2])


def test_a_small_thing_in_a_large_image_is_fitted_at_the_cost_of_its_window():
    side = np.zeros((2000, 3000), np.float32)
    side[1200:1204, 700:703] = 1
    window = choose_window(side, (24, 24), content=side > 0)
    fitted = fit(side, (24, 24), window=window)
    assert_sound(fitted, side)
    assert fitted.mismatch == 0


@pytest.mark.parametrize("shape", [(4, 4), (5, 6), (3, 8)])
def test_the_search_of_a_small_repeating_map_counts_every_cell_once(rng, shape):
    """Its window of 7 x 7 cells is wider than the map."""
    plus = (rng.random((40, 40)) < 0.5).astype(np.uint8)
    lattice = lattice_of(plus, shape, (True, True), (0, 0, 40, 40))
    mask, locked = np.ones(shape, np.uint8), np.zeros(shape, np.uint8)
    levels, errors = rng.uniform(-0.5, 0.5, shape), np.zeros(shape, np.int64)
    before = cell_errors(lattice, levels, errors)
    left = pinchmap_fit.search(lattice, mask, mask, levels, errors, locked, 1 / 127, 8 / 127, 300, 0.0, 1)
    assert left == errors.sum() == cell_errors(lattice, levels, np.zeros(shape, np.int64)) <= before
