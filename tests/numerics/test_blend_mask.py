"""Eqs. (2) and (3) against scikit-image's exact path cost, and the cases in which there is nothing to ask."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fexel.errors import FexelError
from fexel_tools import blend_mask as module
from fexel_tools.blend_mask import blend_mask, default_ramp, gradient_density, gradient_map


def path_cost_reference(image, valid=None):
    """Maximum over the channels of scikit-image's minimum path cost over eq. (2), float64."""
    graph = pytest.importorskip("skimage.graph")
    densest = 0.0
    for channel in np.moveaxis(image, 2, 0):
        cost = slope_reference(channel, valid)
        border = np.zeros(cost.shape, bool)
        border[[0, -1]] = border[:, [0, -1]] = True
        border |= False if valid is None else ~valid
        cost[border] = 0
        found, _ = graph.MCP(cost, fully_connected=True).find_costs(np.argwhere(border))
        densest = np.maximum(densest, found)
    return densest


def slope_reference(channel, valid=None):
    """Eq. (2) by NumPy: central differences inside, a neighbour that is not valid replaced by the pixel itself."""
    channel = np.asarray(channel, np.float64)
    valid = np.ones(channel.shape, bool) if valid is None else valid
    total = np.zeros(channel.shape)
    inner = (slice(1, -1), slice(1, -1))
    for axis in (0, 1):
        pair = []
        for shift in (1, -1):
            neighbour, known = np.roll(channel, shift, axis), np.roll(valid, shift, axis)
            pair.append(np.where(known, neighbour, channel)[inner])
        total[inner] += np.abs(pair[0] - pair[1]) / 2
    return np.where(valid, total, 0)


@pytest.mark.parametrize("shape", [(3, 3), (3, 40), (41, 3), (65, 66), (130, 67)])
@pytest.mark.parametrize("tau", [0.05, 0.7, 1e6, None])
def test_alpha_is_exact(rng, shape, tau):
    image = rng.random((*shape, 3)).astype(np.float32)
    mask = blend_mask(image, tau=tau)
    expected = np.minimum(1, path_cost_reference(image) / mask.tau)
    assert np.abs(mask.alpha - expected).max() <= 1e-6
    assert mask.alpha.dtype == np.float32


def test_stopping_at_tau_leaves_what_is_below_it(rng):
    image = rng.random((90, 110, 3)).astype(np.float32)
    whole = gradient_density(image)
    limit = float(np.median(whole))
    assert np.allclose(gradient_density(image, limit=limit), np.minimum(whole, limit), rtol=0, atol=1e-6 * limit)


def test_path_follows_a_smooth_channel_round_the_texture():
    """A bent corridor without gradient in a checkered field costs nothing to its end."""
    rows, columns = np.indices((64, 64))
    image = ((rows // 2 + columns // 2) % 2).astype(np.float32)
    image[18:25, :40] = 0.5
    image[18:45, 36:43] = 0.5
    density = gradient_density(image)
    assert density[21, 30] == 0  # in the corridor
    assert density[40, 39] == 0  # round its corner
    assert density[33, 25] > 2  # beside it


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 2**32 - 1), st.floats(0.05, 3))
def test_border_is_transparent_and_alpha_within_bounds(height, width, seed, tau):
    image = np.random.default_rng(seed).random((height, width, 3))
    for alpha in (blend_mask(image).alpha, blend_mask(image, tau=tau).alpha):
        assert alpha.shape == (height, width)
        assert alpha[[0, -1]].max() == 0
        assert alpha[:, [0, -1]].max() == 0
        assert 0 <= alpha.min() <= alpha.max() <= 1


def test_any_channel_can_make_a_pixel_opaque(rng):
    image = np.zeros((40, 40, 3), np.float32)
    image[:, :, 1] = rng.random((40, 40))
    grey = np.repeat(image[:, :, 1:2], 3, axis=2)
    assert np.array_equal(blend_mask(image, tau=1.0).alpha, blend_mask(grey, tau=1.0).alpha)


def test_automatic_tau_makes_half_of_the_pixels_at_the_ramp_depth_opaque(rng):
    image = rng.random((200, 260, 3)).astype(np.float32)
    alpha = blend_mask(image, ramp_px=20).alpha
    ring = np.concatenate([alpha[20, 20:-20], alpha[-21, 20:-20], alpha[20:-20, 20], alpha[20:-20, -21]])
    assert 0.45 < np.mean(ring >= 1 - 1e-6) < 0.55


def test_automatic_alpha_does_not_change_with_contrast_or_brightness(rng):
    image = rng.random((80, 90, 3))
    assert np.allclose(blend_mask(image).alpha, blend_mask(0.3 + 0.02 * image).alpha, atol=1e-4)


def test_integers_are_read_as_fractions_of_their_range(rng):
    image = rng.integers(0, 256, (50, 60, 3), dtype=np.uint8)
    as_float = blend_mask((image / 255).astype(np.float32), tau=0.8).alpha
    assert np.allclose(blend_mask(image, tau=0.8).alpha, as_float, atol=1e-6)
    assert np.allclose(blend_mask(image.astype(np.uint16) * 257, tau=0.8).alpha, as_float, atol=1e-6)


def test_constant_image_fades_in_with_the_distance_to_the_border():
    """Eq. (3) is 0/0: the limit of vanishing, uniform texture."""
    mask = blend_mask(np.full((48, 64, 3), 0.5), ramp_px=4)
    assert mask.tau == 0
    assert mask.alpha[24].tolist()[:6] == [0, 0.25, 0.5, 0.75, 1, 1]


def test_constant_image_is_transparent_for_a_given_tau():
    assert blend_mask(np.full((48, 64, 3), 0.5), tau=0.1).alpha.max() == 0


def test_saturated_image_with_one_mark_shows_the_mark():
    image = np.ones((64, 64, 3), np.float32)
    image[30:34, 30:34] = 0
    assert blend_mask(image).alpha[32, 32] == 1
    alpha = blend_mask(image, tau=0.5).alpha
    assert alpha[32, 32] == 1
    assert alpha[5, 5] == 0


def test_non_finite_pixels_are_transparent_and_count_as_border(rng):
    image = rng.random((60, 70, 3)).astype(np.float32)
    holes = rng.random((60, 70)) < 0.01
    broken = image.copy()
    broken[holes, 1] = np.nan
    broken[5, 5, 0] = np.inf
    holes[5, 5] = True
    alpha = blend_mask(broken, tau=0.9).alpha
    assert alpha[holes].max() == 0
    assert np.array_equal(alpha, blend_mask(np.where(holes[..., None], 0.25, image), tau=0.9, valid=~holes).alpha)
    assert np.abs(alpha - np.minimum(1, path_cost_reference(image, ~holes) / 0.9)).max() <= 1e-6


def test_gradient_map_is_eq_2(rng):
    channel = rng.random((33, 47)).astype(np.float32)
    assert np.allclose(gradient_map(channel), slope_reference(channel), atol=1e-6)


def test_many_pixels_run_one_channel_at_a_time_with_the_same_result(rng, monkeypatch):
    image = rng.random((40, 50, 3))
    expected = blend_mask(image, tau=0.5).alpha
    monkeypatch.setattr(module, "_MANY_PIXELS", 1)
    assert np.array_equal(blend_mask(image, tau=0.5).alpha, expected)


@pytest.mark.parametrize("tau", [0.0, -1.0, np.nan, np.inf])
def test_tau_must_be_positive_and_finite(tau):
    with pytest.raises(FexelError, match="expected a positive finite number"):
        blend_mask(np.zeros((8, 8, 3)), tau=tau)


def test_shapes_are_checked():
    with pytest.raises(FexelError, match="not empty"):
        blend_mask(np.zeros((0, 8, 3)))
    with pytest.raises(FexelError, match="valid has shape"):
        blend_mask(np.zeros((8, 8, 3)), valid=np.ones((8, 9), bool))


def test_default_ramp_is_a_sixteenth_of_the_shorter_side():
    assert default_ramp(1024, 1600) == 64
