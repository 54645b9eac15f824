"""Cloning on a rectangle against a sparse direct solve, and laws of harmonic functions."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from fexel.errors import FexelError
from fexel_tools.poisson import clone, detailed_border, good_size, harmonic, laplacian_residual, ring_of, ring_points


def direct_solve(child, border):
    """Perez 2003, eq. (7), assembled and factored in float64."""
    height, width, _ = child.shape
    number = np.arange(height * width).reshape(height, width)
    inside = np.zeros((height, width), bool)
    inside[1:-1, 1:-1] = True
    points = (ring_points(height, width) - 0.5).astype(int)
    result = np.asarray(child, np.float64).copy()
    result[points[:, 1], points[:, 0]] = border
    if not inside.any():
        return result
    count = height * width
    laplacian = scipy.sparse.lil_matrix((count, count))
    laplacian.setdiag(4.0)
    for shift in (1, -1, width, -width):
        laplacian.setdiag(-1.0, shift)
    rows = laplacian.tocsr()[number[inside]]
    unknown, known = rows[:, number[inside]], rows[:, number[~inside]]
    flat, fixed = np.asarray(child, np.float64).reshape(count, -1), result.reshape(count, -1)
    rhs = rows @ flat - known @ fixed[number[~inside]]
    fixed[number[inside]] = scipy.sparse.linalg.splu(unknown.tocsc()).solve(np.ascontiguousarray(rhs))
    return fixed.reshape(child.shape)


def random_problem(rng, shape, dtype=np.float64):
    child = rng.random((*shape, 3)).astype(dtype)
    return child, rng.random((len(ring_points(*shape)), 3))


SHAPES = [(1, 1), (1, 6), (6, 1), (2, 2), (2, 7), (7, 2), (3, 3), (3, 40), (40, 3), (24, 18), (31, 48), (20, 62)]


@pytest.mark.parametrize("shape", SHAPES)
def test_equals_a_direct_solve(rng, shape):
    child, border = random_problem(rng, shape)
    expected = direct_solve(child, border)
    assert np.abs(clone(child, border) - expected).max() < 1e-12
    single = clone(child.astype(np.float32), border)
    assert single.dtype == np.float32
    assert np.abs(single - expected).max() < 1e-6


@pytest.mark.parametrize("shape", [(601, 802), (514, 1031), (1000, 37)])
def test_residual_of_float32_is_below_1e_6(rng, shape):
    child, border = random_problem(rng, shape, np.float32)
    solved = clone(child, border)
    assert laplacian_residual(solved, child) < 1e-6
    assert np.abs(ring_of(solved) - border).max() < 1e-7
    assert np.isfinite(solved).all()


def test_float32_agrees_with_its_float64_twin_on_a_large_image(rng):
    child, border = random_problem(rng, (811, 1301), np.float32)
    assert np.abs(clone(child, border) - clone(child.astype(np.float64), border)).max() < 1e-6


def test_one_edge_alone_leaves_no_denormal_trap_and_decays(rng):
    """Columns of zeros under a border that differs at the top only."""
    child = np.zeros((900, 60, 1), np.float32)
    border = np.zeros((len(ring_points(900, 60)), 1))
    border[1:59] = 1.0
    solved = clone(child, border)[:, :, 0]
    assert solved[450:].max() < 1e-6
    assert (np.diff(solved[:150, 30]) < 0).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 24), st.integers(1, 24), st.integers(0, 2**32 - 1))
def test_correction_obeys_the_maximum_principle(height, width, seed):
    ring = np.random.default_rng(seed).normal(size=len(ring_points(height, width)))
    values = harmonic(ring, height, width, np.float64)
    assert values.shape == (height, width)
    assert ring.min() - 1e-12 <= values.min()
    assert values.max() <= ring.max() + 1e-12


@pytest.mark.parametrize("function", [lambda x, y: 0.7 + 0 * x, lambda x, y: x - 2 * y, lambda x, y: x * x - y * y])
def test_discrete_harmonic_polynomials_are_reproduced(function):
    y, x = np.indices((37, 53)) / 50
    exact = function(x, y)
    assert np.abs(harmonic(ring_of(exact), 37, 53, np.float64) - exact).max() < 1e-12


def test_child_that_meets_its_border_is_left_alone(rng):
    child = rng.random((33, 29, 3)).astype(np.float32)
    assert np.array_equal(clone(child, ring_of(child)), child)


def test_result_does_not_depend_on_orientation(rng):
    child, _ = random_problem(rng, (26, 31))
    parent = rng.random((26, 31, 3))
    solved = clone(child, ring_of(parent))
    for view in (lambda a: a[::-1], lambda a: a[:, ::-1], lambda a: np.swapaxes(a, 0, 1)):
        assert np.abs(clone(view(child), ring_of(view(parent))) - view(solved)).max() < 1e-12


def test_constant_shift_of_the_border_shifts_the_whole(rng):
    child = rng.random((40, 30, 3))
    assert np.allclose(clone(child, ring_of(child) + 0.2), child + 0.2, rtol=0, atol=1e-13)


def test_missing_border_samples_take_the_correction_of_their_neighbours(rng):
    """A shift known on a part of the ring holds everywhere: nothing else is known."""
    child = rng.random((30, 50, 3))
    border = ring_of(child) + 0.1
    border[rng.random(len(border)) < 0.6] = np.nan
    border[60:90, 1] = np.inf
    assert np.allclose(clone(child, border), child + 0.1, rtol=0, atol=1e-12)


def test_missing_corner_is_filled_from_both_sides_of_it():
    child = np.zeros((11, 11, 1))
    border = np.zeros((40, 1))
    border[:11] = 1.0  # the first row
    border[0] = np.nan  # its corner: between 1 and the first column's 0
    assert clone(child, border)[0, 0, 0] == pytest.approx(0.5)


def test_border_without_any_sample_leaves_the_child(rng):
    child = rng.random((20, 20, 3)).astype(np.float32)
    assert np.array_equal(clone(child, np.full((76, 3), np.nan)), child)


def test_nan_inside_the_child_stays_where_it_is(rng):
    child, border = random_problem(rng, (20, 25))
    expected = clone(child, border)
    child[8, 9, 1] = np.nan
    solved = clone(child, border)
    assert np.isnan(solved[8, 9, 1])
    assert np.isnan(solved).sum() == 1
    solved[8, 9, 1] = expected[8, 9, 1]
    assert np.array_equal(solved, expected)


def test_nan_on_the_ring_of_the_child_is_a_missing_sample(rng):
    child = rng.random((20, 25, 3))
    border = ring_of(child) + 0.1
    child[0, 4, 2] = np.nan
    solved = clone(child, border)
    assert np.isnan(solved).sum() == 1
    assert np.allclose(solved[1:], child[1:] + 0.1, rtol=0, atol=1e-12)


def test_saturated_child_stays_finite():
    child = np.ones((64, 64, 3), np.float32)
    solved = clone(child, np.zeros((252, 3)))
    assert np.abs(solved).max() < 1e-6


def test_ring_points_are_pixel_centres_each_once():
    points = ring_points(4, 5)
    assert len(points) == 14
    assert len({tuple(p) for p in points}) == 14
    image = np.arange(20.0).reshape(4, 5, 1)
    rows, columns = np.floor(points[:, 1]).astype(int), np.floor(points[:, 0]).astype(int)
    assert np.array_equal(ring_of(image)[:, 0], image[rows, columns, 0])
    assert set(image[1:3, 1:4].ravel()).isdisjoint(ring_of(image).ravel())


def test_good_size_is_the_nearest_below_with_small_factors():
    for length in (1, 2, 3, 17, 1024, 4000, 4001, 3000):
        size = good_size(length)
        rest = size - 1
        for factor in (2, 3, 5):
            while rest > 1 and rest % factor == 0:
                rest //= factor
        assert size <= length
        assert rest <= 1 or length < 3
    assert good_size(4001) == 4001
    assert all(good_size(n) > 0.9 * n for n in range(200, 8000, 37))


def test_shapes_are_checked(rng):
    with pytest.raises(FexelError, match=r"expected \(H, W, C\) and"):
        clone(rng.random((5, 5, 3)), np.zeros((15, 3)))
    with pytest.raises(FexelError):
        clone(np.zeros((5, 5)), np.zeros((16, 1)))


def test_detailed_border_of_a_coarse_parent_leaves_the_colour_of_the_child(rng):
    """A parent that is the child's own picture at a sixth of the size calls for no correction at all."""
    child = np.zeros((120, 180, 3), np.float32)
    child[:, :] = 0.5
    child[0::12] = 0.1  # a dark joint along the first row, too fine for the parent
    child += rng.normal(0, 0.01, child.shape).astype(np.float32)
    parent = child.reshape(20, 6, 30, 6, 3).mean(axis=(1, 3))
    x, y = np.floor(ring_points(120, 180) / 6).astype(int).T
    border = parent[y, x]
    plain = np.abs(clone(child, border) - child)[20:-20, 20:-20]
    detailed = np.abs(clone(child, detailed_border(child, border, 6)) - child)[20:-20, 20:-20]
    assert detailed.mean() < 0.2 * plain.mean()


def test_detailed_border_keeps_a_change_of_exposure_and_missing_samples(rng):
    child = rng.random((60, 90, 3)).astype(np.float32)
    means = child.reshape(20, 3, 30, 3, 3).mean(axis=(1, 3))
    border = np.repeat(np.repeat(means, 3, 0), 3, 1)
    border = ring_of(border + 0.25)
    border[5] = np.nan
    solved = clone(child, detailed_border(child, border, 3))
    assert np.abs((solved - child)[15:-15, 15:-15] - 0.25).max() < 0.02
    assert np.array_equal(detailed_border(child, border, 1.0), border, equal_nan=True)
