"""Discontinuities fade where the source's own boundary does, and only there."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from fexel_tools.pinchmap_mask import channels
from fexel_tools.pinchmap_strength import HARD_WIDTH_PX, boundary_strength, strength_of_width


def disc(size=256, radius=80.0, width=1.0):
    """A disc whose edge is a ramp of `width` pixels."""
    x, y = np.meshgrid(np.arange(size) + 0.5 - size / 2, np.arange(size) + 0.5 - size / 2)
    return np.clip((radius - np.hypot(x, y)) / width + 0.5, 0, 1).astype(np.float32)


def pinchmap_of(side, cells):
    mask = cv2.resize(side, (cells, cells), interpolation=cv2.INTER_AREA) > 0.5
    made = np.zeros((cells, cells, 4))
    made[..., :3] = channels(mask)
    return made, made[..., 2] == 0


@pytest.mark.parametrize("width", [0.01, 1.0, 2.0])
@pytest.mark.parametrize("cells", [8, 16, 32, 64])
def test_hard_edges_have_strength_one_exactly(width, cells):
    """Aliased, anti-aliased and resampled drawings."""
    side = disc(width=width)
    pinchmap, _ = pinchmap_of(side, cells)
    assert (boundary_strength(side, pinchmap, (cells, cells)) == 1).all()


def test_noise_is_nearly_hard(rng):
    """It crosses the middle in one pixel mostly, though by chance with a small step."""
    side = rng.random((128, 128)).astype(np.float32)
    assert boundary_strength(side, np.zeros((8, 8, 4)), (8, 8)).min() > 0.85


def test_strength_falls_with_the_width_of_the_transition_to_none():
    """Until, at the width of a signal texel, the texture need not be pinched at all."""
    means = []
    for width in (1, 6, 12, 18, 24, 40, 80):
        side = disc(width=width)
        pinchmap, active = pinchmap_of(side, 8)
        means.append(boundary_strength(side, pinchmap, (8, 8))[active].mean())
    assert means[0] == 1
    assert (np.diff(means) < 0)[:-1].all()
    assert means[-1] == 0


def test_finer_signals_need_less_strength():
    """The transition of a fexel that is not pinched is as wide as a signal texel."""
    side = disc(width=12)
    pinchmap, active = pinchmap_of(side, 8)
    means = [boundary_strength(side, pinchmap, (8 << level, 8 << level))[active].mean() for level in range(3)]
    assert means[0] > means[1] > means[2] == 0


def test_the_edge_of_a_half_transparent_shape_is_hard():
    """A step from 0.3 to 0.8 is as sharp as one from 0 to 1: the slope counts against the range thereabouts."""
    side = 0.3 + 0.5 * disc(width=1.5)
    pinchmap, _ = pinchmap_of(side, 16)
    assert (boundary_strength(side, pinchmap, (16, 16)) == 1).all()


def test_strength_changes_smoothly_along_a_line_that_fades():
    """Sharp at the left, 40 px wide at the right: strength falls from 1 to 0 without a jump, and stays 1 elsewhere."""
    x, y = np.meshgrid(np.arange(512) + 0.5, np.arange(512) + 0.5)
    side = np.clip((256 - y) / (1 + 39 * x / 512) + 0.5, 0, 1)
    pinchmap, active = pinchmap_of(side, 16)
    strength = boundary_strength(side, pinchmap, (16, 16))
    along = strength[active]
    assert along[0] > 0.99
    assert along[-1] < 0.05
    assert (np.diff(along) <= 1e-12).all()
    assert np.abs(np.diff(along)).max() < 0.25
    assert (strength[~active] == 1).all()


def test_seam_of_a_repeating_texture_is_seen_across_the_border():
    """An edge that lies on the border: soft as seen through the seam, and shifting the picture shifts the strength."""
    x = np.arange(256) + 0.5
    side = np.clip((64 - np.abs(x - 128)) / 12 + 0.5, 0, 1)[None].repeat(256, 0).astype(np.float32)
    wrap = ("repeat", "repeat")
    mask = np.zeros((8, 8), bool)
    mask[:, 2:6] = True
    results = []
    for shift in (0, 2):
        pinchmap = np.concatenate([channels(np.roll(mask, shift, 1), wrap), np.zeros((8, 8, 1))], axis=-1)
        results.append(boundary_strength(np.roll(side, 32 * shift, 1), pinchmap, (8, 8), wrap=wrap))
    assert 0.2 < results[1][pinchmap[..., 2] == 0].max() < 0.9
    np.testing.assert_allclose(np.roll(results[0], 2, 1), results[1], atol=1e-9)


def test_values_that_are_not_finite_have_no_crossing(rng):
    side = disc(width=20)
    pinchmap, _ = pinchmap_of(side, 8)
    side[rng.random(side.shape) < 0.2] = np.nan
    strength = boundary_strength(side, pinchmap, (8, 8))
    assert np.isfinite(strength).all()
    assert strength.min() >= 0
    assert strength.max() <= 1


@pytest.mark.parametrize(("height", "width"), [(1, 1), (3, 7), (20, 300)])
def test_sources_of_any_size(rng, height, width):
    side = rng.random((height, width))
    strength = boundary_strength(side, np.zeros((6, 5, 4)), (12, 10))
    assert strength.shape == (6, 5)
    assert ((strength >= 0) & (strength <= 1)).all()


def test_relation_meets_the_least_squares_of_the_pinch_profile():
    """Eq. (4) in one dimension: the strength of least squared error to a ramp, by trying all, is the formula's."""
    k = np.linspace(-1.5, 1.5, 6001)
    target = np.where(np.abs(k) < 1, np.sign(k) * (0.5 + 0.5 * np.abs(k)), k)
    strengths = np.linspace(0, 1, 201)[:, None]
    profiles = np.clip(k + strengths * (target - k) + 0.5, 0, 1)
    for share in (0.02, 0.1, 0.3, 0.5, 0.8, 1.0, 1.5):
        ramp = np.clip(k / share + 0.5, 0, 1)
        best = strengths[((profiles - ramp) ** 2).mean(axis=1).argmin(), 0]
        assert strength_of_width(HARD_WIDTH_PX + share * 100, 100) == pytest.approx(best, abs=0.015)
