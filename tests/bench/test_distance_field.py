"""Rivals of pinchmaps: outlines, grids of equal bytes, distance fields and bilinear textures are as good as claimed."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("bench.harness", reason="run from the repository's root")
pytest.importorskip("contourpy")
outline = pytest.importorskip("bench.outline")
distance_field = pytest.importorskip("bench.distance_field")
pinch_shapes = pytest.importorskip("bench.pinch_shapes")

from fexel_tools.pinchmap_measure import alpha_error  # noqa: E402

FINER = 4


def picture(inside, size):
    """Coverage (size, size) of a shape given by a predicate over x and y in pixels; 8 x 8 samples a pixel."""
    grid = (np.arange(size * 8) + 0.5) / 8
    return inside(grid[None], grid[:, None]).reshape(size, 8, size, 8).mean((1, 3)).astype(np.float32)


def shape_of(inside, size):
    fine = picture(lambda x, y: inside(x / FINER, y / FINER), size * FINER)
    (top, bottom), (left, right) = (np.flatnonzero(fine.any(axis))[[0, -1]] for axis in (1, 0))
    box = (left / FINER, top / FINER, (right + 1) / FINER, (bottom + 1) / FINER)
    polygons = [polygon / FINER for polygon in outline.outlines(fine)]
    return pinch_shapes.Shape("shape", picture(inside, size), box, polygons, fine)


def tilted_square(x, y):
    u, v = (x - 60.3) * 0.8 + (y - 58.1) * 0.6, (y - 58.1) * 0.8 - (x - 60.3) * 0.6
    return np.maximum(np.abs(u), np.abs(v)) < 35


def disc(x, y):
    return np.hypot(x - 61, y - 57.5) < 40.2


def area(polygon):
    x, y = polygon.T
    return (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def test_outline_has_the_corners_and_the_area_of_a_tilted_square():
    (polygon,) = outline.outlines(picture(tilted_square, 120))
    corners = np.array([[u * 0.8 - v * 0.6 + 60.3, u * 0.6 + v * 0.8 + 58.1] for u in (-35, 35) for v in (-35, 35)])
    nearest = np.linalg.norm(corners[:, None] - polygon, axis=-1).min(1)
    assert nearest.max() < 0.15
    assert abs(area(polygon)) == pytest.approx(70**2, rel=1e-3)


def test_smooth_outline_turns_a_little_at_every_point_and_a_hole_runs_the_other_way():
    ring = outline.outlines(
        picture(lambda x, y: (np.hypot(x - 120, y - 121) < 110) & (np.hypot(x - 99, y - 120) > 40), 240)
    )
    hole, rim = sorted((area(polygon) for polygon in ring), key=abs)
    assert (abs(hole), abs(rim)) == pytest.approx((np.pi * 40**2, np.pi * 110**2), rel=5e-3)
    assert hole * rim < 0
    for polygon in ring:
        step = np.diff(np.vstack([polygon, polygon[:2]]), axis=0)
        turn = np.abs(np.diff(np.unwrap(np.arctan2(step[:, 1], step[:, 0]))))
        assert np.degrees(turn).max() < 8  # from 8.1 degrees on msdfgen sees a corner


def test_outline_of_a_shape_at_the_border_is_closed():
    (polygon,) = outline.outlines(np.ones((20, 30), np.float32))
    assert abs(area(polygon)) == pytest.approx(600, rel=0.02)


@pytest.mark.parametrize("nbytes", [100, 1280, 5120])
@pytest.mark.parametrize("size", [1, 9 / 8, 3, 4])
def test_grid_fits_into_its_bytes_and_reaches_around_what_is_drawn(nbytes, size):
    shape = pinch_shapes.Shape("", np.zeros((100, 200), np.float32), (20, 30, 190, 80), [], np.zeros((1, 1)))
    grid = distance_field.Grid.over(shape, nbytes, size)
    assert grid.rows * grid.columns * size <= nbytes
    assert (grid.rows + 1) * (grid.columns + 1) * size > nbytes
    x, y = grid.centres().T
    assert x.min() < 20 and x.max() > 190 and y.min() < 30 and y.max() > 80


def test_least_squares_texels_give_a_bilinear_picture_back_and_beat_an_area_average(rng):
    texels = rng.random((6, 9, 3))
    drawn = distance_field.upsampled(texels, (50, 70))
    np.testing.assert_allclose(distance_field.least_squares_texels(drawn, (6, 9)), texels, atol=1e-5)
    noise = rng.random((48, 72, 1))
    best = distance_field.upsampled(distance_field.least_squares_texels(noise, (6, 9)), (48, 72))
    average = distance_field.upsampled(noise.reshape(6, 8, 9, 8, 1).mean((1, 3)), (48, 72))
    assert np.square(best - noise).mean() < np.square(average - noise).mean()


def test_distance_field_of_a_disc_is_nearly_exact_and_its_error_falls_with_the_bytes():
    shape = shape_of(disc, 120)
    errors = [
        alpha_error(distance_field.distance_field(shape, nbytes).coverage, shape.alpha) for nbytes in (100, 400, 1600)
    ]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 4e-4  # of all pixels, 1.7 % of which the line crosses: 0.02 pixels off
    bilinear = distance_field.bilinear_coverage(shape, 1600)
    assert bilinear.nbytes <= 1600 and alpha_error(bilinear.coverage, shape.alpha) > 10 * errors[2]


@pytest.mark.skipif(
    distance_field.msdfgen_module(install=False) is None, reason="msdfgen's Node binding is not installed"
)
def test_multi_channel_field_keeps_corners_that_a_distance_field_of_its_texels_rounds():
    shape = shape_of(tilted_square, 120)
    (multi,) = distance_field.multi_channel_fields(shape, [3 * 225])
    single = distance_field.distance_field(shape, 225)
    assert multi.nbytes <= 3 * 225 and multi.coverage.shape == shape.alpha.shape
    error = alpha_error(multi.coverage, shape.alpha)
    assert error < 0.5 * alpha_error(single.coverage, shape.alpha)
    assert error < 1.5e-3


def test_benchmarks_of_pinchmaps_have_no_rows_without_the_data(monkeypatch):
    monkeypatch.setattr(pinch_shapes, "shared_data", lambda: None)
    for name in ("pinchmap_shape", "pinchmap_authoring"):
        module = pytest.importorskip(f"bench.{name}")
        assert list(module.rows(True)) == []


def test_constants_whose_effect_the_authoring_benchmark_plots_are_those_of_the_fit():
    authoring = pytest.importorskip("bench.pinchmap_authoring")
    from fexel_tools import pinchmap_fit

    assert all(isinstance(getattr(pinchmap_fit, name), (int, float)) for name in authoring.EFFORT)


@pytest.mark.parametrize("program", ["missing", "crashes"])
def test_shape_without_msdfgen_has_no_such_figures_and_no_traceback(tmp_path, monkeypatch, program):
    """A node that cannot be run, and one that fails."""
    if program == "crashes":
        (tmp_path / "node").write_text("#!/bin/sh\nexit 3\n")
        (tmp_path / "node").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(distance_field, "msdfgen_module", lambda: tmp_path)
    shape = shape_of(disc, 120)
    with pytest.warns(UserWarning, match="shape: left out, msdfgen failed"):
        assert distance_field.multi_channel_fields(shape, (1000,)) == []


def test_an_installation_that_takes_too_long_is_none(tmp_path, monkeypatch):
    for name in ("node", "npm"):
        (tmp_path / name).write_text("#!/bin/sh\nexec sleep 30\n")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    monkeypatch.setenv("FEXEL_MSDFGEN", str(tmp_path / "modules"))
    monkeypatch.setattr(distance_field, "_INSTALL_S", 0.1)
    assert distance_field.msdfgen_module.__wrapped__() is None
