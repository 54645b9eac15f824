"""Photos with a veil of haze: a gain alone would lift what is dark or crush what is bright."""

from __future__ import annotations

import numpy as np

from fexel_tools.color_match import match_samples


def test_haze_is_told_from_exposure(rng):
    parent = np.exp(rng.uniform(np.log(0.02), np.log(0.8), (4000, 3)))
    gain, veil = np.array([0.75, 0.8, 0.7]), np.array([0.06, 0.05, 0.07])
    child = (parent + veil) / gain * np.exp(rng.normal(0, 0.01, parent.shape))
    child = np.where(child < 0.95, child, np.nan)
    match = match_samples(child, parent)
    np.testing.assert_allclose(match.gain, gain, rtol=0.02)
    np.testing.assert_allclose(match.offset, -veil, atol=0.004)
    usable = np.isfinite(child)
    np.testing.assert_allclose(match.apply(child[None])[0][usable], parent[usable], atol=0.03)


def test_exposure_alone_has_no_offset(rng):
    parent = np.exp(rng.uniform(np.log(0.02), np.log(0.5), (4000, 3)))
    match = match_samples(parent / 0.6, parent)
    np.testing.assert_allclose(match.gain, 0.6, rtol=1e-6)
    assert not match.offset.any()
