"""Mip pyramids: area-exact for any size, premultiplied, rims cleared from the clean level above."""

import numpy as np
import pytest

from fexel import mipmaps


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (2, 3), (5, 5), (17, 64), (33, 31)])
def test_mipmaps_keep_the_mean_at_every_level(rng, size):
    image = rng.random((*size, 4)).astype(np.float32)
    for level in mipmaps.pyramid(image):
        assert np.abs(level.mean(axis=(0, 1)) - image.mean(axis=(0, 1))).max() < 1e-5


def test_mipmaps_of_odd_sizes_do_not_shift(rng):
    """A ramp stays the same ramp up to its steps: every texel is the mean over the area that it covers."""
    image = np.broadcast_to(((np.arange(15) + 0.5) / 15)[None, :, None], (3, 15, 1))
    level = mipmaps.halve(image)
    assert np.abs(level[0, :, 0] - (np.arange(7) + 0.5) / 7).max() < 0.1 / 15
    assert np.abs(level + level[:, ::-1] - 1).max() < 1e-6


def test_mipmaps_rim_is_cleared_after_the_next_level_is_made():
    levels = mipmaps.pyramid(np.ones((16, 16, 4)))
    assert all((level == 1).all() for level in levels)
    cleared = mipmaps.clear_rim(levels[1])
    assert cleared[0].max() == cleared[-1].max() == cleared[:, 0].max() == cleared[:, -1].max() == 0
    assert (cleared[1:-1, 1:-1] == 1).all()


@pytest.mark.parametrize(("size", "count"), [((1, 1), 1), ((1, 9), 4), ((8, 8), 4), ((9, 2), 4)])
def test_mipmaps_go_down_to_one_texel(size, count):
    levels = mipmaps.pyramid(np.zeros((size[1], size[0], 3)))
    assert len(levels) == mipmaps.level_count(*size) == count
    assert levels[-1].shape == (1, 1, 3)
