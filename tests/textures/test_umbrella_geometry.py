"""Sectors of star-shaped polygons: found for every point, exact in their coordinates, and how far they may morph."""

import numpy as np
import pytest

from fexel import homography
from fexel.textures.umbrella_arrangement import Arrangement, Shape
from fexel.textures.umbrella_geometry import (
    FULL_TURN,
    fold_weight,
    is_star_shaped,
    pseudo_angle,
    signed_area,
    turns,
)
from fexel.textures.umbrella_sectors import Sectors

SQUARE = np.array([(0, 0), (-1, -1), (1, -1), (1, 1), (-1, 1)], float)


def star(rng, vertices, center=(0.3, -0.2)):
    """A star-shaped polygon of uneven sectors, none wider than half a turn."""
    gaps = rng.uniform(0.7, 1.0, vertices - 1)
    angle = np.cumsum(gaps / gaps.sum() * 2 * np.pi) + rng.uniform(0, 7)
    radius = rng.uniform(0.3, 1.0, vertices - 1)
    return np.concatenate([[(0, 0)], np.stack([np.cos(angle), np.sin(angle)], 1) * radius[:, None]]) + center


def arrangement(*points, morph_points=None, morphs=None):
    """One umbrella of each shape, in its own coordinates."""
    morph_points = points if morph_points is None else morph_points
    shapes = tuple(Shape(p, m, np.zeros_like(p)) for p, m in zip(points, morph_points, strict=True))
    number = len(shapes)
    return Arrangement(
        shapes,
        np.arange(number, dtype=np.int32),
        np.tile(np.eye(3), (number, 1, 1)),
        np.zeros(number) if morphs is None else np.array(morphs, float),
        np.zeros((0, 3), np.float32),
    )


def look(sectors, umbrella, points):
    umbrella = np.full(len(points), umbrella)
    sector = sectors.find(umbrella, points)
    weights, drawn = sectors.barycentric(umbrella, sector, points)
    corners = np.stack([sectors.arrangement.points[v] for v in sectors.vertices_of(umbrella, sector)], axis=1)
    return weights, drawn, np.einsum("mk,mki->mi", weights, corners)


def cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def in_triangles(polygon, points):
    """Whether points lie in a triangle of the centre and two neighbouring vertices, by brute force."""
    center, contour = polygon[0], polygon[1:]
    inside = np.zeros(len(points), bool)
    for a, b in zip(contour, np.roll(contour, -1, axis=0), strict=True):
        sides = [cross(q - p, points - p) for p, q in ((center, a), (a, b), (b, center))]
        if cross(a - center, b - center) > 0:
            inside |= np.all(np.array(sides) >= 0, axis=0)
    return inside


# Angles


def test_pseudo_angle_grows_with_the_angle_and_adds_two_for_half_a_turn(rng):
    angle = np.sort(rng.uniform(0, 2 * np.pi, 1000))
    vectors = np.stack([np.cos(angle), np.sin(angle)], 1) * rng.uniform(1e-6, 1e6, (1000, 1))
    found = pseudo_angle(vectors)
    assert (np.diff(found) > 0).all()
    assert np.allclose(np.mod(pseudo_angle(-vectors) - found, FULL_TURN), 2.0)
    assert pseudo_angle(np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [0, 0]], float)).tolist() == [0, 1, 2, 3, 0]


def test_pseudo_angle_stays_below_a_full_turn():
    assert pseudo_angle(np.array([[1.0, -1e-20]]))[0] < FULL_TURN


# Sectors


@pytest.mark.parametrize("vertices", [4, 5, 17, 200])
def test_points_inside_are_exactly_those_of_the_triangles(rng, vertices):
    shapes = [star(rng, vertices) for _ in range(5)]
    sectors = Sectors(arrangement(*shapes))
    assert sectors.is_star.all()
    for number, shape in enumerate(shapes):
        points = rng.uniform(-1.2, 1.5, (4000, 2))
        weights, drawn, _ = look(sectors, number, points)
        assert drawn.all()
        assert (weights[:, 0] >= 0).tolist() == in_triangles(shape, points).tolist()


def test_coordinates_give_back_the_point_wherever_it_lies(rng):
    shape = star(rng, 40)
    sectors = Sectors(arrangement(star(rng, 9), shape))
    spokes = shape[1:] - shape[0]
    middles = 0.5 * (shape[1:] + np.roll(shape[1:], -1, axis=0))
    tricky = [shape[:1], shape[1:], shape[0] + 0.37 * spokes, shape[0] + 1e-9 * spokes, middles, shape[0] + 3 * spokes]
    points = np.concatenate([*tricky, rng.uniform(-1, 1, (500, 2))])
    weights, drawn, back = look(sectors, 1, points)
    assert drawn.all()
    assert np.abs(back - points).max() < 1e-12
    assert np.abs(weights.sum(axis=1) - 1).max() < 1e-12
    assert weights[0] == pytest.approx([1, 0, 0])


def test_vertices_show_themselves_alone(rng):
    shape = star(rng, 12)
    weights, _, _ = look(Sectors(arrangement(shape)), 0, shape[1:])
    assert np.abs(weights[:, 0]).max() < 1e-12
    assert np.allclose(weights[:, 1:].max(axis=1), 1.0)


def test_coincident_vertices_and_vertices_at_the_centre_do_not_change_what_is_covered(rng):
    shape = star(rng, 12)
    doubled = np.concatenate([shape[:4], shape[3:4], shape[3:4], shape[4:], shape[-1:], shape[1:2]])
    centered = np.concatenate([shape[:6], shape[:1], shape[:1], shape[6:]])
    first_at_center = np.concatenate([shape[:1], shape[:1], shape[1:]])
    points = rng.uniform(-1, 1.3, (5000, 2))
    sectors = Sectors(arrangement(doubled, centered, first_at_center))
    for number, polygon in enumerate((doubled, centered, first_at_center)):
        weights, drawn, _ = look(sectors, number, points)
        assert (drawn & (weights[:, 0] >= 0)).tolist() == in_triangles(polygon, points).tolist()


def test_sectors_without_area_draw_nothing():
    flat = np.array([(0, 0), (1, 0), (2, 0), (3, 0)], float)
    same = np.zeros((6, 2))
    half = np.array([(0, 0), (1, 0), (0, 1), (-1, 0)], float)  # the centre lies on an edge
    sectors = Sectors(arrangement(flat, same, half))
    points = np.random.default_rng(1).uniform(-2, 4, (500, 2))
    assert not look(sectors, 0, points)[1].any()
    assert not look(sectors, 1, points)[1].any()
    weights, drawn, _ = look(sectors, 2, points)
    assert (drawn & (weights[:, 0] >= 0)).tolist() == in_triangles(half, points).tolist()


def test_two_vertices_draw_nothing():
    sectors = Sectors(arrangement(np.array([(0, 0), (1, 0)], float)))
    weights, drawn, _ = look(sectors, 0, np.random.default_rng(1).uniform(-1, 1, (100, 2)))
    assert not drawn.any()
    assert not weights.any()


def test_centre_outside_draws_only_what_turns_forward():
    outside = SQUARE.copy()
    outside[0] = (0, -3)
    assert not is_star_shaped(outside)
    sectors = Sectors(arrangement(outside, SQUARE))
    assert sectors.is_star.tolist() == [False, True]
    points = np.random.default_rng(2).uniform(-4, 4, (4000, 2))
    weights, drawn, _ = look(sectors, 0, points)
    assert np.isfinite(weights).all()
    shown = drawn & (weights[:, 0] >= 0)
    assert shown.any()
    assert not (shown & ~in_triangles(outside, points)).any()


def test_morphed_sectors_are_those_of_the_shape_between(rng):
    start, end = star(rng, 20), star(rng, 20)
    end = start + 0.1 * (end - start)
    sectors = Sectors(arrangement(start, morph_points=[end], morphs=[0.25]))
    points = rng.uniform(-1, 1.3, (2000, 2))
    weights, _, _ = look(sectors, 0, points)
    assert (weights[:, 0] >= 0).tolist() == in_triangles(start + 0.25 * (end - start), points).tolist()


# Orientation and star shape


def test_signed_area_is_negative_clockwise():
    assert signed_area(SQUARE[1:]) == pytest.approx(4.0)
    assert signed_area(SQUARE[:0:-1]) == pytest.approx(-4.0)
    assert signed_area(SQUARE[1:] + 1e6) == pytest.approx(4.0)


def test_star_shape_is_known(rng):
    assert is_star_shaped(star(rng, 30))
    hidden = np.array([(0, 0), (-1, -1), (1, -1), (1, 1), (0.1, 0.9), (0.2, 0.2), (-1, 1)], float)
    assert not is_star_shaped(hidden)
    assert is_star_shaped(np.concatenate([SQUARE, SQUARE[-1:], SQUARE[1:2]]))
    assert not is_star_shaped(np.concatenate([SQUARE, SQUARE[1:]]))  # around twice


# Morphs


def test_fold_weight_is_where_a_vertex_crosses_the_spoke():
    moved = SQUARE.copy()
    moved[2] = (-1.5, -1)  # from (1, -1): on the spoke to (-1, -1) at 2 / 2.5
    assert fold_weight(SQUARE, moved) == pytest.approx(0.8, abs=1e-12)


def test_fold_weight_solves_the_quadratic():
    moved = SQUARE.copy()
    moved[2:4] = (1, 1.0), (1, -1.0)  # both change places: the sector between them has 2 - 4 m
    assert fold_weight(SQUARE, moved) == pytest.approx(0.5, abs=1e-12)
    moved[:] = -SQUARE  # through the centre at one half
    assert fold_weight(SQUARE, moved) == 1.0  # areas are (1 - 2 m)^2: they touch zero and do not fold


def test_morph_that_does_not_fold_may_go_all_the_way(rng):
    start = star(rng, 30)
    assert fold_weight(start, start) == 1.0
    assert fold_weight(start, start[0] + 3.0 * (start - start[0])) == 1.0
    assert fold_weight(np.zeros((5, 2)), np.zeros((5, 2))) == 1.0


def test_fold_weight_is_the_first_of_all_weights_that_fold(rng):
    weights = np.linspace(0, 1, 2001)
    limited = 0
    for _ in range(40):
        start, end = star(rng, 12), star(rng, 12)
        spokes = (start + weights[:, None, None] * (end - start))[:, 1:] - (
            start + weights[:, None, None] * (end - start)
        )[:, :1]
        areas = cross(spokes, np.roll(spokes, -1, axis=1)).min(axis=1)
        folded = np.flatnonzero(areas < 0)
        truth = weights[folded[0]] if len(folded) else 1.0
        limited += len(folded) > 0
        found = fold_weight(start, end)
        assert found <= truth
        assert truth - found <= weights[1] + 1e-9
    assert limited > 10


def test_what_32_bits_leave_of_a_flat_sector_is_no_fold(rng):
    start = star(rng, 30).astype(np.float32).astype(float)
    doubled = np.concatenate([start[:5], start[4:5], start[5:]])
    end = doubled + rng.uniform(-1e-8, 1e-8, doubled.shape)
    assert fold_weight(doubled, end) == 1.0


# How umbrellas lie


def test_turn_is_the_angle_however_st_is_stretched(rng):
    angle = rng.uniform(-3, 3, 20)
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]).transpose(2, 0, 1)
    shape = star(rng, 6)
    placed = arrangement(*[shape] * 20)
    placed.matrices[:, :2, :2] = rotation * [0.2 / 64, 0.2 / 24]
    assert np.allclose(turns(placed), rotation.transpose(0, 2, 1))
    placed.matrices[:, 0] *= -1
    mirrored = turns(placed)
    assert np.allclose(np.linalg.det(mirrored), -1)
    assert np.allclose(mirrored, rotation.transpose(0, 2, 1) * [[[-1, 1]]])


def test_vertices_are_points_under_their_matrices(rng):
    shapes = [star(rng, vertices) for vertices in (5, 9, 4)]
    placed = arrangement(*shapes)
    placed.matrices[:] += rng.uniform(-0.2, 0.2, (3, 3, 3))
    assert not placed.is_affine
    for number, shape in enumerate(shapes):
        first, end = placed.first_vertex[number : number + 2]
        assert np.allclose(placed.vertices[first:end], homography.apply(placed.matrices[number], shape))
