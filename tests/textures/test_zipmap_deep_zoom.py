"""Placement: at any zoom a texel of the deepest patch is where float64 says."""

import numpy as np
import pytest

from bench.zipmap_placement import placement_error


@pytest.mark.parametrize("tilt", [0.0, 55.0])
@pytest.mark.parametrize("exponent", [0, 10, 16, 20, 24])
def test_zipmap_texels_are_placed_within_a_hundredth_at_any_zoom(gl, tmp_path, exponent, tilt):
    error = placement_error(gl, tmp_path, exponent, tilt)
    assert np.isfinite(error)
    assert error < 0.01
