"""Benchmarks of umbrellas: the brute-force truth is right by construction, and all modules run through, small."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

pytest.importorskip("bench.harness", reason="run from the repository's root")
pytest.importorskip("colour")
command = pytest.importorskip("bench.umbrella_command")
setting = pytest.importorskip("bench.umbrella_setting")

from bench import umbrella_authoring, umbrella_filtering, umbrella_motion, umbrella_speed, umbrella_storage  # noqa: E402
from bench.fall_leaves import cell_counts, cutouts, fall_leaves  # noqa: E402
from bench.umbrella_texture import low_view  # noqa: E402
from bench.umbrella_truth import Truth, turned_view  # noqa: E402
from fexel.textures.umbrella_arrangement import Arrangement, Shape  # noqa: E402
from fexel.textures.umbrella_cells import cell_statistics  # noqa: E402

SQUARE = np.array([[0, 0], [-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]], np.float64)
BLACK = np.zeros((1, 1, 3), np.float32)
SMALL = {"bases": 3, "vertices": 12, "count": 80, "grid": (8, 4), "texture_size": 32}


def squares(centers, sides, colors, **more) -> Arrangement:
    """Plain squares in st, the first in front."""
    count = len(centers)
    matrices = np.zeros((count, 3, 3))
    matrices[:, 0, 0] = matrices[:, 1, 1] = sides
    matrices[:, 2, :2], matrices[:, 2, 2] = centers, 1
    shape = Shape(SQUARE, SQUARE, np.full((5, 2), 0.5))
    per_vertex = np.repeat(np.float32(colors), 5, axis=0)
    return Arrangement((shape,), np.zeros(count, np.int32), matrices, np.zeros(count), per_vertex, (4, 4), **more)


def upright(pixels):
    """Pixels to st of the unit square, (3, 3)."""
    return np.array([[1 / pixels, 0, 0], [0, -1 / pixels, 0], [0, 1, 1]])


def drawn(arrangement, pixels=8, samples=16, background=BLACK):
    return Truth(arrangement, [BLACK], background).picture(upright(pixels), (pixels, pixels), samples)


def test_truth_covers_the_exact_area_of_a_square_that_cuts_pixels():
    picture = drawn(squares([(0.5, 0.5)], [0.3125], [(1, 0.5, 0.25)]))  # 2.5 of 8 pixels wide
    assert picture[3:5, 3:5] == pytest.approx(np.broadcast_to([1, 0.5, 0.25], (2, 2, 3)))
    assert picture[2, 3, 0] == pytest.approx(0.25)
    assert picture[2, 2, 0] == pytest.approx(0.0625)
    assert picture[..., 0].mean() == pytest.approx(0.3125**2)


def test_truth_shows_the_umbrella_in_front_and_both_sides_of_the_border():
    picture = drawn(squares([(0.0, 0.5), (0.5, 0.5)], [0.5, 1.0], [(1, 0, 0), (0, 1, 0)]))
    assert picture[4, :, 0].tolist() == [1, 1, 0, 0, 0, 0, 1, 1]
    assert picture[4, :, 1].tolist() == [0, 0, 1, 1, 1, 1, 0, 0]


def test_truth_darkens_what_lies_below_once_and_never_the_umbrella_itself():
    """Two umbrellas that shade the same place, and one on top of the others."""
    both = squares(
        [(0.25, 0.5), (0.25, 0.5), (0.5, 0.5)],
        [0.25, 0.25, 1.0],
        [(1, 0, 0), (0, 0, 1), (0, 1, 0)],
        shadow_offset=(0.25, 0.0),
        shadow_strength=0.5,
    )
    picture = drawn(both)
    assert picture[4, 2] == pytest.approx([1, 0, 0])
    assert picture[4, 4] == pytest.approx([0, 0.5, 0])
    assert picture[4, 6] == pytest.approx([0, 1, 0])


def test_turned_view_has_square_cells_of_the_size_asked_for():
    grid, size = (64, 24), (40, 30)
    view = turned_view((0.4, 0.6), 5.0, size, grid)
    assert np.array([20, 15, 1]) @ view == pytest.approx([0.4, 0.6, 1])
    steps = view[:2, :2] * grid * 5.0
    assert steps @ steps.T == pytest.approx(np.eye(2))
    assert np.linalg.det(steps) < 0  # y runs down, t up


def test_every_pixel_of_the_low_view_shows_the_ground():
    low = low_view((64, 24), 0.0, 83.0, 6.0, 8.0, (192, 96))
    corners = np.array([[0, 0, 1], [192, 0, 1], [192, 96, 1], [0, 96, 1]]) @ low.pixel_to_st
    assert (corners[:, 2] > 0).all()
    far, near = corners[0, 1] / corners[0, 2], corners[3, 1] / corners[3, 2]
    assert far > near + 1 and far * 24 < 400


def test_fall_leaves_are_the_papers_setting(tmp_path):
    leaves = fall_leaves(tmp_path)
    arrangement = leaves.arrangement
    counts = cell_counts(arrangement)
    assert (len(arrangement.shapes), len(arrangement), arrangement.grid) == (9, 6100, (64, 24))
    assert set(arrangement.vertex_counts) == {63} and leaves.textures[0].shape == (256, 256, 3)
    assert 18.5 < counts.mean() < 19.5
    exact = cell_statistics(arrangement)
    assert counts.max() <= exact.most <= counts.max() + 2
    assert counts.mean() == pytest.approx(exact.mean, rel=0.02)


def test_lists_are_as_long_as_asked_for(tmp_path):
    for k in (4, 13):
        leaves = fall_leaves(tmp_path, bases=3, vertices=16, grid=(8, 8), k=k, texture_size=16)
        assert abs(cell_counts(leaves.arrangement).max() - k) <= 1


def test_fall_leaves_come_out_the_same_again(tmp_path):
    first, second = (fall_leaves(tmp_path, **SMALL) for _ in range(2))
    assert first.arrangement == second.arrangement
    assert np.array_equal(first.textures[0], second.textures[0])


@pytest.fixture
def _small(monkeypatch):
    monkeypatch.setattr(setting, "fall_leaves", functools.partial(fall_leaves, **SMALL))
    for module in (umbrella_filtering, umbrella_storage):
        monkeypatch.setattr(module, "real_leaves", lambda _folder: None)


def checked(module):
    rows = list(module.rows(True))
    assert rows
    assert all(math.isfinite(row.value) for row in rows), [row for row in rows if not math.isfinite(row.value)]
    return rows


@pytest.mark.usefixtures("_small", "gl")
def test_filtering_is_measured(monkeypatch):
    monkeypatch.setattr(umbrella_filtering, "_FOOTPRINTS", (8, 2))
    monkeypatch.setattr(umbrella_filtering, "_ASKED", {2: 1.6})
    rows = checked(umbrella_filtering)
    assert {row.unit for row in rows} == {"CIEDE2000, mean", "MB"}
    assert all(row.value < 10 for row in rows)
    curves = list(umbrella_filtering.curves(True))
    assert len(curves) == 5 and all(len(curve.x) == 2 and np.isfinite(curve.y).all() for curve in curves)


@pytest.mark.usefixtures("_small", "gl")
def test_motion_is_measured(monkeypatch):
    monkeypatch.setattr(umbrella_motion, "_PIXELS", 24)
    monkeypatch.setattr(umbrella_motion, "_SAMPLES", 8)
    monkeypatch.setattr(umbrella_motion, "_ZOOM_STEP", 1.2)
    rows = checked(umbrella_motion)
    assert len(rows) >= 6 and all(0.01 < row.value < 5 for row in rows)
    assert list(umbrella_motion.curves(True))


@pytest.mark.usefixtures("_small", "gl")
def test_speed_is_measured(monkeypatch):
    monkeypatch.setattr(umbrella_speed, "_FOOTPRINTS", (8, 2))
    monkeypatch.setattr(umbrella_speed, "_PIXELS", 32)
    monkeypatch.setattr(umbrella_speed, "_EXPLICIT_TEXELS", 16)
    rows = checked(umbrella_speed)
    assert len(rows) == 2 and all(row.value > 0 for row in rows)
    assert {len(curve.x) for curve in umbrella_speed.curves(True)} == {2}


@pytest.mark.usefixtures("_small")
def test_storage_is_measured():
    rows = checked(umbrella_storage)
    words = next(row for row in rows if "Fall Leafs" in row.setting)
    assert words.value == pytest.approx(7.12, abs=0.01)  # b w h + 2 b v + n (1 + 3 v) + k W H = 1,779,142 words
    assert len(rows) == 7


def test_authoring_is_measured(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "GRID", (6, 4))
    monkeypatch.setattr(command, "COUNT", 30)
    small = lambda *given: command.author(*given, "--fallback-size", "64")  # noqa: E731
    monkeypatch.setattr(umbrella_authoring, "author", small)
    monkeypatch.setattr(umbrella_authoring, "passiflora_scans", list)
    monkeypatch.setattr(umbrella_authoring, "cutouts", lambda folder: cutouts(folder, bases=2, size=96))
    rows = checked(umbrella_authoring)
    assert [row.unit for row in rows] == ["s", "s"] and all(row.value > 0 for row in rows)
