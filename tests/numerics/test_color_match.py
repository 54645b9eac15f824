"""Known exposures and white balances are found back, whatever is clipped, dark, moved or blurred."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fexel.errors import FexelError
from fexel_tools.color_match import ColorMatch, corresponding_colors, match_color, match_samples


@pytest.fixture
def scene(rng):
    """Linear, smooth on several scales, all of it between 0.02 and 0.9."""
    image = sum(cv2.GaussianBlur(rng.normal(size=(480, 640, 3)), (0, 0), s) * s for s in (1.5, 4, 12, 40))
    low, high = image.min(), image.max()
    return (0.02 + 0.88 * ((image - low) / (high - low)) ** 2).astype(np.float32)


def cut(scene, reduction=3):
    """Child at full resolution, parent reduced, and the map between them."""
    parent = cv2.resize(scene, None, fx=1 / reduction, fy=1 / reduction, interpolation=cv2.INTER_AREA)
    sx, sy = parent.shape[1] / scene.shape[1], parent.shape[0] / scene.shape[0]
    x, y = 160, 90
    return scene[y : y + 300, x : x + 360], parent, np.array([[sx, 0, sx * x], [0, sy, sy * y], [0, 0, 1.0]])


@pytest.mark.parametrize("gain", [(1, 1, 1), (1.8, 1.2, 0.7), (0.5, 0.45, 0.6), (8, 8, 8)])
def test_gains_are_found(scene, rng, gain):
    child, parent, parent_from_child = cut(scene)
    child = child / np.array(gain) + rng.normal(0, 0.001, child.shape)
    match = match_color(child, parent, parent_from_child)
    assert match.reason == ""
    assert np.abs(match.gain / gain - 1).max() < 0.01
    assert np.abs(match.apply(child) / np.maximum(scene[90:390, 160:520], 0.05) - 1).mean() < 0.05


def test_clipped_highlights_do_not_bias_the_gain(scene):
    """Half of the child is blown out: its mean says nothing, its unclipped pixels everything."""
    child, parent, parent_from_child = cut(scene)
    overexposed = np.minimum(child * 4, 1)
    assert (overexposed >= 1).mean() > 0.2
    match = match_color(overexposed, parent, parent_from_child)
    assert np.abs(match.gain * 4 - 1).max() < 0.05


def test_a_person_walking_through_does_not_bias_the_gain(scene):
    child, parent, parent_from_child = cut(scene)
    changed = child * 0.5
    changed[50:200, 100:180] = 0.9
    assert np.abs(match_color(changed, parent, parent_from_child).gain / 2 - 1).max() < 0.02


def test_misregistration_by_a_parent_pixel_costs_less_than_two_percent(scene):
    child, parent, parent_from_child = cut(scene)
    parent_from_child = parent_from_child + np.array([[0, 0, 1.0], [0, 0, -0.5], [0, 0, 0]])
    assert np.abs(match_color(child / 1.5, parent, parent_from_child).gain / 1.5 - 1).max() < 0.02


def test_gamma_is_fitted_on_request(scene):
    child, parent, parent_from_child = cut(scene)
    match = match_color((child / 0.8) ** (1 / 1.25), parent, parent_from_child, fit_gamma=True)
    assert match.gamma == pytest.approx(1.25, abs=0.04)
    assert match.gain == pytest.approx([0.8] * 3, rel=0.05)


def test_tilted_child_corresponds_to_the_same_places(scene):
    """The parent's own picture, through a projective map: both columns must be alike."""
    matrix = np.array([[0.5, 0.05, 60], [-0.04, 0.52, 50], [1e-4, 5e-5, 1.0]])
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])
    child = cv2.warpPerspective(
        scene, np.linalg.inv(half) @ matrix @ half, (400, 300), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    )
    a, b = corresponding_colors(child, scene, matrix)
    good = np.isfinite(a) & np.isfinite(b)
    assert good.mean() > 0.9
    assert np.abs(a - b)[good].mean() < 0.004


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(0.5, 2), min_size=3, max_size=3), st.integers(0, 2**32 - 1))
def test_samples_with_outliers(gain, seed):
    rng = np.random.default_rng(seed)
    child = rng.uniform(0.05, 0.9, (400, 3))
    parent = child * gain * np.exp(rng.normal(0, 0.01, child.shape))
    parent[:60] = rng.uniform(0.05, 0.9, (60, 3))
    inside = ((parent > 0.004) & (parent < 0.98)).sum(axis=0).min()
    match = match_samples(child, parent)
    if inside >= 100:
        assert np.abs(match.gain / gain - 1).max() < 0.05
    assert np.isfinite(match.gain).all()


@pytest.mark.parametrize("value", [0.0, 1.0, np.nan])
def test_nothing_to_go_by_is_the_identity_with_a_reason(value):
    child, parent = np.full((50, 60, 3), value), np.full((50, 60, 3), 0.5)
    match = match_color(child, parent, np.eye(3))
    assert "0 pixels that correspond" in match.reason
    assert np.array_equal(match.gain, np.ones(3))
    assert np.array_equal(match.apply(parent), parent.astype(np.float32))


def test_photo_beside_the_parent_is_the_identity(scene):
    child, parent, _ = cut(scene)
    beside = np.array([[0.3, 0, 5000], [0, 0.3, 0], [0, 0, 1.0]])
    assert match_color(child, parent, beside).reason


def test_absurd_gains_are_refused():
    match = match_samples(np.full((50, 3), 0.005), np.full((50, 3), 0.9))
    assert match.reason.startswith("gains 180")
    assert np.array_equal(match.gain, np.ones(3))


@pytest.mark.parametrize("shape", [(1, 1), (1, 30), (2, 2)])
def test_tiny_children(scene, shape):
    match = match_color(np.full((*shape, 3), 0.5), scene, np.diag([1.0, 1.0, 1.0]))
    assert np.isfinite(match.gain).all()


def test_gamma_keeps_the_sign():
    assert ColorMatch(gamma=2.0).apply(np.array([[[-0.5, 0.5, 0]]]))[0, 0].tolist() == [-0.25, 0.25, 0]


def test_sample_counts_are_checked():
    with pytest.raises(FexelError, match="expected as many"):
        match_samples(np.zeros((3, 3)), np.zeros((4, 3)))
