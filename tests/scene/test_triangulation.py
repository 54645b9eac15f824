"""Polygons become triangles that cover exactly the polygon."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fexel.scene.triangulation import newell_normals, triangulate


def shoelace(points):
    x, y = points[:, 0], points[:, 1]
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def triangle_areas(points, corners):
    a, b, c = (points[corners[:, k]] for k in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def triangulate_one(points):
    points = np.column_stack([points, np.zeros(len(points))])
    return triangulate(points, np.array([len(points)]), np.arange(len(points)))[0]


def assert_covers(points, tolerance=1e-9):
    """Signed areas have one sign and add up to the shoelace area: no triangle outside, none twice."""
    corners = triangulate_one(points)
    assert corners.shape == (len(points) - 2, 3)
    areas = triangle_areas(points, corners) * np.sign(shoelace(points))
    assert areas.min() >= -tolerance
    assert areas.sum() == pytest.approx(abs(shoelace(points)), rel=1e-9)


def comb(teeth):
    top = [(i + 0.5 * k, 10.0 if k else 1.0) for i in range(teeth) for k in (0, 1)]
    return np.array([(0.0, 0.0), (teeth, 0.0), *top[::-1]])


def spiral(n):
    t = np.linspace(0.5, 6 * np.pi, n)
    inner, outer = (np.column_stack([r * np.cos(t), r * np.sin(t)]) for r in (t, t + 1.5))
    return np.concatenate([outer, inner[::-1]])


@pytest.mark.parametrize(
    "points",
    [
        np.array([(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)], float),
        np.array([(0, 0), (4, 0), (1, 1), (0, 4)], float),
        np.array([(1, 1), (0, 4), (0, 0), (4, 0)], float),
        np.array([(0, 0), (2, 0), (4, 0), (4, 4), (0, 4)], float),
        np.array([(0, 0), (2, 0), (4, 0)] + [(4, 2), (4, 4), (2, 4), (0, 4), (0, 2)], float),
        comb(3),
        comb(20),
        spiral(30),
        spiral(150),
    ],
    ids=[
        "arrow",
        "dart",
        "dart from its notch",
        "straight corner",
        "octagonal square",
        "comb",
        "long comb",
        "spiral",
        "long spiral",
    ],
)
@pytest.mark.parametrize("clockwise", [False, True])
def test_concave_polygons_are_covered_exactly(points, clockwise):
    assert_covers(points[::-1] if clockwise else points)


def test_convex_polygon_becomes_a_fan_of_positive_triangles():
    turn = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    assert_covers(np.column_stack([np.cos(turn), np.sin(turn)]))


def test_polygon_with_a_hole_cut_by_a_bridge():
    outer = [(0, 0), (10, 0), (10, 10), (0, 10)]
    hole = [(3, 3), (3, 6), (6, 6), (6, 3)]
    points = np.array([*outer, outer[0], hole[0], *hole[1:], hole[0]], float)
    assert shoelace(points) == 100 - 9
    assert_covers(points)


@st.composite
def simple_polygons(draw):
    """Star-shaped about the origin: radii at growing angles, never a half turn between neighbours."""
    n = draw(st.integers(4, 24))
    gaps = draw(st.lists(st.integers(3, 9), min_size=n, max_size=n))
    radii = draw(st.lists(st.integers(1, 50), min_size=n, max_size=n))
    angles = 2 * np.pi * np.cumsum(gaps) / np.sum(gaps)
    return np.array(radii)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])


@settings(max_examples=150, deadline=None)
@given(simple_polygons())
def test_random_simple_polygons_are_covered_exactly(points):
    assert_covers(points)


@st.composite
def histograms(draw):
    """Right-angled polygons on integer coordinates: straight corners, equal edges, every kind of tie."""
    heights = draw(st.lists(st.integers(1, 5), min_size=2, max_size=12))
    top = [(x, h) for i, h in enumerate(heights) for x in (i, i + 1)]
    return np.array([(0, 0), (len(heights), 0), *top[::-1]], float)


@settings(max_examples=150, deadline=None)
@given(histograms(), st.integers(0, 40))
def test_right_angled_polygons_are_covered_exactly_from_any_corner(points, start):
    assert_covers(np.roll(points, start, axis=0))


@settings(max_examples=60, deadline=None)
@given(simple_polygons(), st.integers(0, 10_000))
def test_area_does_not_depend_on_the_plane_a_polygon_lies_in(points, seed):
    rotation, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    tilted = np.column_stack([points, np.zeros(len(points))]) @ rotation + 100.0
    corners, _ = triangulate(tilted, np.array([len(points)]), np.arange(len(points)))
    a, b, c = (tilted[corners[:, k]] for k in range(3))
    normal = newell_normals(tilted[None])[0]
    areas = 0.5 * np.cross(b - a, c - a) @ (normal / np.linalg.norm(normal))
    assert areas.min() >= -1e-9
    assert areas.sum() == pytest.approx(abs(shoelace(points)), rel=1e-9)


def test_faces_of_all_sizes_keep_their_order_and_winding(rng):
    polygons = [rng.permutation(1)[:0].reshape(0, 2)]  # a face without corners
    polygons += [np.array([(0, 0), (1, 0)]), np.array([(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)])]
    polygons += [np.array([(0, 0), (4, 0), (1, 1), (0, 4)]), np.array([(0, 0), (1, 0), (0, 1)])] * 3
    counts = np.array([len(p) for p in polygons])
    points = np.concatenate(polygons).astype(float)
    corners, faces = triangulate(np.column_stack([points, 0 * points[:, 0]]), counts, np.arange(len(points)))
    assert np.array_equal(faces, np.repeat(np.arange(len(counts)), np.maximum(counts - 2, 0)))
    areas = np.bincount(faces, triangle_areas(points, corners), len(counts))
    np.testing.assert_allclose(areas, [shoelace(p.astype(float)) if len(p) > 2 else 0 for p in polygons])
    assert triangle_areas(points, corners).min() > 0


def test_faces_that_are_points_lines_or_cut_themselves_use_every_corner():
    turn = 4 * np.pi * np.arange(5) / 5
    pentagram = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    for points in (np.zeros((6, 3)), np.column_stack([np.arange(7.0)] * 3), pentagram, np.zeros((4, 3))):
        corners, _ = triangulate(points, np.array([len(points)]), np.arange(len(points)))
        assert corners.shape == (len(points) - 2, 3)
        assert set(corners.ravel()) == set(range(len(points)))


def test_far_from_the_origin_small_faces_keep_their_shape():
    arrow = np.array([(0, 0, 0), (4, 0, 0), (4, 4, 0), (2, 1, 0), (0, 4, 0)]) * 1e-3 + 1e6
    corners, _ = triangulate(arrow, np.array([5]), np.arange(5))
    areas = triangle_areas(arrow - arrow[0], corners)
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(10e-6, rel=1e-4)
