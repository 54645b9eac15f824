"""The fipmap that shows a Gaussian, against the Gaussian truth."""

from __future__ import annotations

import numpy as np
import pytest

from fexel.filters.twin import FilterTwin
from fexel.images.srgb import srgb_to_linear

filter_truth = pytest.importorskip("fexel_tools.filter_truth")
filter_views = pytest.importorskip("fexel_tools.filter_views")
textures = pytest.importorskip("fexel_tools.filter_textures")
psnr_db = pytest.importorskip("fexel_tools.pinchmap_measure").psnr_db


@pytest.mark.parametrize("elevation", [10, 5, 2, 1, 0.5])
def test_gaussian_fipmap_of_20_texels_is_within_a_decibel_of_an_average_of_all_texels(rng, elevation):
    gain = []
    for draw in (textures.bricks, textures.line_chart):
        image = np.ones((256, 256, 4), np.float32)
        image[..., :3] = srgb_to_linear(draw(256) / np.float32(255))
        truth, twin = filter_truth.FilterTruth.of(image, ("repeat", "repeat")), FilterTwin(image, ("repeat", "repeat"))
        xy = rng.random((24, 2)) * 256
        for view in filter_views.fan((elevation,), (0, 15, 30, 45)):
            jacobian = np.repeat(view.jacobian[None], len(xy), axis=0)
            wanted = truth.mean("gauss", xy, view.jacobian)
            average, _ = twin.sample("ewa", xy, jacobian)
            value, fetches = twin.sample("fipmap", xy, jacobian, gauss=True)
            gain.append(psnr_db(value[None], wanted[None]) - psnr_db(average[None], wanted[None]))
            assert fetches.max() <= 20
    assert np.mean(gain) > -1
