"""The signal is the least squares solution through the pinch: what was rendered from a signal gives it back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fexel.errors import FexelError
from fexel.textures.pinchmap_twin import pinch
from fexel_tools.pinchmap_equations import pinch_point
from fexel_tools.pinchmap_mask import channels, is_legal
from fexel_tools.pinchmap_signal import cell_sides, fill_signal
from fexel_tools.pinchmap_source import PinchmapSource

CLAMP, REPEAT = ("clamp", "clamp"), ("repeat", "repeat")


def blob_mask(rng, shape=(8, 8), wrap=CLAMP):
    """A legal random mask: rectangles of at least two cells, tried until the rules hold."""
    for _ in range(200):
        mask = np.zeros(shape, bool)
        for _ in range(2):
            h, w = rng.integers(2, 5, 2)
            r, c = rng.integers(0, shape[0] - h), rng.integers(0, shape[1] - w)
            mask[r : r + h, c : c + w] = True
        if wrap == REPEAT:
            mask = np.roll(mask, rng.integers(0, 8, 2), (0, 1))
        if mask.any() and is_legal(mask, wrap):
            return mask
    raise AssertionError("no legal mask found")


def pinchmap_of(mask, rng, wrap=CLAMP, strength=1.0, reach=0.6):
    made = np.zeros((*mask.shape, 4))
    made[..., :3] = channels(mask, wrap)
    made[..., :2] *= strength
    made[..., 3] = rng.uniform(-reach, reach, mask.shape)
    return made


def pixel_st(height, width):
    s, t = np.meshgrid((np.arange(width) + 0.5) / width, 1 - (np.arange(height) + 0.5) / height)
    return np.stack([s.ravel(), t.ravel()], axis=1)


def bilinear(signal, coordinates, wrap):
    """Plain bilinear lookup of (Sh, Sw, C) at (M, 2)."""
    rows, columns = signal.shape[:2]
    x, y = coordinates[:, 0] * columns - 0.5, (1 - coordinates[:, 1]) * rows - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    f, g = (x - x0)[:, None], (y - y0)[:, None]

    def texel(r, c):
        if wrap == REPEAT:
            return signal[r % rows, c % columns]
        return signal[np.clip(r, 0, rows - 1), np.clip(c, 0, columns - 1)]

    low = texel(y0, x0) * (1 - f) + texel(y0, x0 + 1) * f
    return low * (1 - g) + (texel(y0 + 1, x0) * (1 - f) + texel(y0 + 1, x0 + 1) * f) * g


def rendered(pinchmap, signal, size, wrap=CLAMP):
    """What a hard-edged lookup shows, as a source of raw data, by the float64 twin."""
    h = 0.5 * pinchmap.shape[0] / signal.shape[0]
    seen = pinch(pinchmap, pixel_st(*size), h, wrap=wrap)
    shown = bilinear(signal, seen.st, wrap).reshape(*size, signal.shape[2])
    side = (seen.k_b > seen.gamma_b).reshape(size)
    return source(shown[..., :3], shown[..., 3], side)


def source(color, opacity=None, side=None, *, is_data=True):
    shape = color.shape[:2]
    opacity = np.ones(shape) if opacity is None else opacity
    side = np.ones(shape) if side is None else side
    arrays = (np.asarray(a, np.float32) for a in (color, opacity, side))
    return PinchmapSource(Path("picture.png"), *arrays, is_data, 8)


@pytest.mark.parametrize("level", [0, 1, 2])
@pytest.mark.parametrize("wrap", [CLAMP, REPEAT])
def test_kernel_displaces_as_the_twin_does(rng, wrap, level):
    h = 0.5**level / 2
    coordinates = rng.random((4000, 2))
    for _ in range(5):
        pinchmap = pinchmap_of(blob_mask(rng, wrap=wrap), rng, wrap, rng.choice([1.0, 0.6]), reach=0.95)
        size = np.array(pinchmap.shape[1::-1])
        truth = pinch(pinchmap, coordinates, h, wrap=wrap)
        clear = np.abs(truth.k_b - truth.gamma_b) > 1e-9  # a rounding decides the side of the others
        fraction = (coordinates * size) % 1
        texels = bilinear(pinchmap, coordinates + 0.5 / size, wrap)
        ours = np.array([pinch_point(*texel, *f, h)[:2] for texel, f in zip(texels, fraction, strict=True)])
        expected = (truth.st - coordinates) * size
        np.testing.assert_allclose(ours[clear], expected[clear], atol=1e-5)


@pytest.mark.parametrize("wrap", [CLAMP, REPEAT])
def test_sides_of_cells_are_recovered_from_k(rng, wrap):
    for _ in range(20):
        mask = blob_mask(rng, wrap=wrap)
        assert np.array_equal(cell_sides(channels(mask, wrap), wrap), mask)


@pytest.mark.parametrize("level", [0, 1, 2])
@pytest.mark.parametrize("wrap", [CLAMP, REPEAT])
def test_signal_that_was_rendered_is_recovered(rng, wrap, level):
    """Consistent equations: least squares must return the signal itself, on either side of a random discontinuity."""
    mask = blob_mask(rng, wrap=wrap)
    pinchmap = pinchmap_of(mask, rng, wrap, reach=0.4)
    signal = rng.uniform(0.3, 0.7, (8 << level, 8 << level, 4))
    signal[mask.repeat(1 << level, 0).repeat(1 << level, 1)] += 0.3
    made = fill_signal(rendered(pinchmap, signal, (384, 384), wrap), pinchmap, signal.shape[:2], wrap=wrap)
    np.testing.assert_allclose(made, signal, atol=0.02)
    assert np.abs(made - signal).mean() < 1e-3
