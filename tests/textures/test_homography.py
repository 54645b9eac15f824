"""Homographies in float64."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fexel import homography


def random_homography(seed):
    rng = np.random.default_rng(seed)
    matrix = np.eye(3) + rng.uniform(-0.4, 0.4, (3, 3))
    matrix[:2, 2] *= 0.5
    return matrix


@given(seed=st.integers(0, 2**32 - 1))
def test_homography_normalized_has_w_one_at_the_patch_centre(seed):
    matrix = random_homography(seed)
    if not homography.is_usable(matrix):
        return
    normal = homography.normalize(matrix)
    centre = homography.apply(homography.invert(normal), np.array([[0.5, 0.5]]))
    if np.isfinite(centre).all():
        assert np.abs(np.append(centre, 1) @ normal - [0.5, 0.5, 1]).max() < 1e-9


@given(seed=st.integers(0, 2**32 - 1))
def test_homography_jacobian_is_the_derivative(seed):
    matrix, rng = random_homography(seed), np.random.default_rng(seed)
    point, step = rng.random((1, 2)) * 0.3, 1e-6
    jacobian = homography.jacobian(matrix, point)[0]
    for axis in range(2):
        offset = np.eye(2)[axis] * step
        difference = homography.apply(matrix, point + offset) - homography.apply(matrix, point - offset)
        if np.isfinite(difference).all() and np.abs(jacobian).max() < 1e3:
            assert np.abs(difference[0] / (2 * step) - jacobian[:, axis]).max() < 1e-4 * (
                1 + np.abs(jacobian).max() ** 2
            )


@pytest.mark.parametrize(
    "matrix",
    [np.zeros((3, 3)), np.ones((3, 3)), np.diag([1, 0, 1.0]), np.full((3, 3), np.nan), np.diag([1, 1, np.inf])],
)
def test_homography_without_an_inverse_is_not_usable(matrix):
    assert not homography.is_usable(matrix)


def test_homography_deep_zooms_and_mirrors_are_usable():
    deep = homography.translate(-0.3, -0.7) @ homography.scale(2.0**24, 2.0**24)
    assert homography.is_usable(np.stack([deep, -deep, homography.scale(-1, 1)])).all()


def test_homography_points_behind_infinity_have_no_image():
    matrix = np.array([[1.0, 0, -2], [0, 1, 0], [0, 0, 1]])
    assert np.isnan(homography.apply(matrix, [[0.6, 0.0]])).all()
    assert np.isfinite(homography.apply(matrix, [[0.4, 0.0]])).all()
