"""The fan of views and the textures that filters are judged on."""

from __future__ import annotations

import numpy as np
import pytest

from fexel.errors import FexelError
from fexel.textures.footprint import Footprint

filter_views = pytest.importorskip("fexel_tools.filter_views")
from fexel_tools.filter_textures import TEXTURES, bricks, checkerboard, line_chart  # noqa: E402


@pytest.mark.parametrize("view", filter_views.fan((90, 30, 1, 0.1), (0, 15, 45, 75)), ids=str)
def test_footprints_have_the_elevation_and_azimuth_of_the_view(view):
    footprint = Footprint.of(view.jacobian[None])
    assert footprint.minor == pytest.approx(1.25)
    assert footprint.major == pytest.approx(1.25 / np.sin(np.radians(view.elevation)))
    if view.elevation < 90:
        x, y = footprint.direction[0]
        assert np.degrees(np.arctan2(y, x)) % 180 == pytest.approx(view.azimuth)


def test_places_are_spaced_by_the_jacobian_about_the_middle():
    view = filter_views.FilterView(20.0, 30.0)
    places = view.places((300, 200), 8).reshape(8, 8, 2)
    assert places.mean(axis=(0, 1)) == pytest.approx([150, 100])
    assert places[3, 4] - places[3, 3] == pytest.approx(view.jacobian[:, 0])
    assert places[4, 3] - places[3, 3] == pytest.approx(view.jacobian[:, 1])


@pytest.mark.parametrize(
    ("elevations", "azimuths", "named"),
    [((0.0,), (0,), "elevations: 0,"), ((95,), (0,), "95"), ((float("nan"),), (0,), "nan"), ((5,), (), "azimuth")],
)
def test_angles_that_cannot_be_drawn_are_named(elevations, azimuths, named):
    with pytest.raises(FexelError, match=named):
        filter_views.check_angles(elevations, azimuths)


@pytest.mark.parametrize("name", TEXTURES)
@pytest.mark.parametrize("size", [100, 257])
def test_textures_are_drawn_at_any_size_with_the_same_mean(name, size):
    picture = TEXTURES[name](size)
    assert (picture.shape, picture.dtype) == ((size, size, 3), np.uint8)
    assert picture.std() > 10
    assert picture.mean() == pytest.approx(TEXTURES[name](512).mean(), abs=25)  # letters are thinner when small


def test_textures_are_the_same_every_time():
    assert np.array_equal(bricks(64), bricks(64))
    assert np.array_equal(line_chart(96), line_chart(96))


def test_checkerboard_repeats_sharply():
    board = checkerboard(64, squares=8)[..., 0]
    assert len(np.unique(board)) == 2
    assert np.array_equal(np.roll(board, (8, 8), (0, 1)), board)
    assert np.array_equal(np.roll(board, 8, 0) == board.min(), board == board.max())


def test_line_chart_holds_lines_along_both_axes_and_finer_ones_at_higher_resolution():
    chart = line_chart(1024)[..., 0].astype(float)
    across, down = np.abs(np.diff(chart, axis=1)).sum(), np.abs(np.diff(chart, axis=0)).sum()
    assert across == pytest.approx(down, rel=0.35)
    coarse = line_chart(256)[..., 0].astype(float)
    assert np.abs(np.diff(chart, axis=1)).sum() / 1024 > np.abs(np.diff(coarse, axis=1)).sum() / 256
