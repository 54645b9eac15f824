"""Morph targets: another contour as second positions, without folds."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fexel.errors import FexelError
from fexel.textures.umbrella_geometry import fold_weight, is_star_shaped, signed_area
from fexel_tools.umbrella_base import BaseUmbrella, make_bases
from fexel_tools.umbrella_correspondence import Outline, best_turn, corresponding_arcs, shape_distances
from fexel_tools.umbrella_elements import find_elements
from fexel_tools.umbrella_morph import MorphOptions, safe_share, with_morphs

WEIGHTS = np.linspace(0.0, 1.0, 1001)


def _base(contour, name="base"):
    points = np.concatenate([[[0.0, 0.0]], contour])
    tex_coords = 0.5 + points / (2.1 * np.abs(points).max())
    return BaseUmbrella(name, np.ones((4, 4, 4), np.float32), False, tex_coords, points, points.copy(), 0.0, 1.0)


def _star(rng, count=24, lobes=None):
    """A random star-shaped contour."""
    angle = (np.arange(count) + 0.4 * rng.random(count)) * (2 * np.pi / count)
    lobes = int(rng.integers(1, 8)) if lobes is None else lobes
    radius = 0.5 + 0.35 * rng.random() * np.cos(lobes * angle - 6 * rng.random()) + 0.1 * rng.random(count)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _areas(points):
    """(..., V - 1) twice the area of each sector."""
    spokes = points[..., 1:, :] - points[..., :1, :]
    following = np.roll(spokes, -1, axis=-2)
    return spokes[..., 0] * following[..., 1] - spokes[..., 1] * following[..., 0]


def _turned(contour, angle):
    return contour @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def _distance(a, b):
    """Largest distance from points on the outline a to the outline b, over the square root of its area."""
    far = Outline(a).at(np.linspace(0, 1, 400))
    near = Outline(b).at(np.linspace(0, 1, 4000))
    return np.linalg.norm(far[:, None] - near[None], axis=-1).min(axis=1).max() / np.sqrt(signed_area(b))


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(3, 70), st.integers(3, 70))
def test_no_weight_folds_a_sector(seed, own_count, other_count):
    rng = np.random.default_rng(seed)
    bases = [_base(_star(rng, own_count)), _base(_star(rng, other_count))]
    for morphed in with_morphs(bases, MorphOptions()):
        frames = morphed.points + WEIGHTS[:, None, None] * (morphed.morph_points - morphed.points)
        assert np.isfinite(frames).all()
        assert _areas(frames).min() >= -1e-9
        stored = (values.astype(np.float32).astype(np.float64) for values in (morphed.points, morphed.morph_points))
        assert fold_weight(*stored) == 1.0
        assert all(is_star_shaped(frame) for frame in frames[::200])


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_nothing_changes_at_a_morph_of_0(seed):
    """Old vertices stay in order and place; new ones lie on edges, at the same share in texture and shape."""
    rng = np.random.default_rng(seed)
    bases = [_base(_star(rng, int(rng.integers(3, 40)))) for _ in range(3)]
    for base, morphed in zip(bases, with_morphs(bases, MorphOptions()), strict=True):
        assert len(morphed.points) == len(morphed.tex_coords) == len(morphed.morph_points) >= len(base.points)
        rows = [int(np.flatnonzero((morphed.points == point).all(axis=1))[0]) for point in base.points]
        assert rows == sorted(rows)
        assert rows[:2] == [0, 1]
        np.testing.assert_array_equal(morphed.tex_coords[rows], base.tex_coords)
        ends = np.array([*rows[1:], len(morphed.points)])
        for i, (first, last) in enumerate(itertools.pairwise(ends)):
            for values, corners in ((morphed.points, base.points), (morphed.tex_coords, base.tex_coords)):
                start, end = corners[1 + i], corners[1 + (i + 1) % (len(corners) - 1)]
                share = np.linalg.norm(morphed.points[first:last] - base.points[1 + i], axis=1)
                share /= np.linalg.norm(base.points[1 + (i + 1) % (len(corners) - 1)] - base.points[1 + i])
                assert (np.diff(share) > 0).all()
                np.testing.assert_allclose(values[first:last], start + share[:, None] * (end - start), atol=1e-12)


def test_the_other_shape_is_reached_at_a_morph_of_1(rng):
    flower, leaf = _star(rng, 60, lobes=5), _star(rng, 60, lobes=2)
    morphed = with_morphs([_base(flower), _base(leaf)], MorphOptions(max_vertices=200))[0]
    reached = morphed.morph_points[1:]
    turned = _turned(leaf * np.sqrt(signed_area(reached) / signed_area(leaf)), best_turn(reached, leaf))
    assert _distance(turned, reached) < 0.05
    assert _distance(flower, reached) > 0.15
    ratio = np.sqrt(signed_area(reached) / signed_area(flower))
    assert 0.7 < ratio < 1.4


def test_equal_shapes_correspond_point_by_point(rng):
    star = _star(rng, 40)
    together = corresponding_arcs(star, star)
    np.testing.assert_allclose(together.own, together.other, atol=1e-12)
    assert together.cost < 1e-12


def test_a_turned_shape_is_turned_back(rng):
    star = _star(rng, 80, lobes=3) * (1.0, 0.6)
    for angle in (-2.0, 0.0, 0.7):
        assert best_turn(_turned(star, angle), star) == pytest.approx(angle, abs=0.01)
    circle = 0.5 * np.stack([np.cos(np.arange(64) * np.pi / 32), np.sin(np.arange(64) * np.pi / 32)], axis=1)
    assert abs(_distance(_turned(circle, best_turn(circle, circle)), circle)) < 0.01


def test_corners_that_are_missing_are_split_in():
    """A triangle becomes a star of three points: its notches are new vertices on the edges."""
    angles = np.pi / 2 + np.arange(3) * 2 * np.pi / 3
    corners = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    notches = -0.15 * np.roll(corners, 1, axis=0)
    star = np.stack([corners, notches], axis=1).reshape(-1, 2)
    morphed = with_morphs([_base(corners), _base(star)], MorphOptions())[0]
    assert len(morphed.points) == 7
    np.testing.assert_array_equal(morphed.points[1::2], corners)
    size = np.linalg.norm(morphed.morph_points[1])
    np.testing.assert_allclose(morphed.morph_points[1:], size * star, atol=1e-6)


def test_points_by_direction_lie_in_the_same_direction(rng):
    own, other = _star(rng, 30), _star(rng, 50)
    together = corresponding_arcs(own, other, np.inf)
    a, b = Outline(own).at(together.own), Outline(other).at(together.other)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    np.testing.assert_allclose(cross / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1), 0, atol=1e-9)
    assert (np.diff(together.own) >= 0).all()
    assert (np.diff(together.other) >= 0).all()


def test_no_more_vertices_than_asked_for(rng):
    bases = [_base(_star(rng, 30)), _base(_star(rng, 60))]
    assert [len(base.points) for base in with_morphs(bases, MorphOptions(max_vertices=40))] == [40, 61]


def test_half_the_amount_goes_half_the_way(rng):
    bases = [_base(_star(rng, 30, lobes=3)), _base(_star(rng, 30, lobes=4))]
    whole, half = (with_morphs(bases, MorphOptions(amount=amount))[0] for amount in (1.0, 0.5))
    np.testing.assert_allclose(half.morph_points, 0.5 * (whole.points + whole.morph_points), atol=1e-12)
    none = with_morphs(bases, MorphOptions(amount=0.0))[0]
    np.testing.assert_array_equal(none.morph_points, bases[0].points)


def test_a_lone_base_becomes_its_mirror_image(rng):
    base = _base(_star(rng, 40, lobes=2) + (0.1, 0.0))
    morphed = with_morphs([base], MorphOptions(max_vertices=200))[0]
    mirrored = (base.points[1:] * (-1, 1))[::-1]
    turned = _turned(mirrored, best_turn(morphed.morph_points[1:], mirrored))
    assert _distance(turned, morphed.morph_points[1:]) < 0.05
    assert fold_weight(morphed.points, morphed.morph_points) == 1.0


def test_a_similar_shape_is_preferred(rng):
    shapes = [_star(rng, 60, lobes) for lobes in (3, 3, 7)]
    distances = shape_distances(shapes)
    np.testing.assert_allclose(distances, distances.T)
    np.testing.assert_allclose(np.diag(distances), 0, atol=1e-6)
    np.testing.assert_allclose(shape_distances([2 * _turned(shape, 1) for shape in shapes]), distances, atol=0.05)


def test_the_seed_chooses_and_decides_alone(rng):
    bases = [_base(_star(rng, 20)) for _ in range(6)]
    first, again, other = (with_morphs(bases, MorphOptions(seed=seed)) for seed in (1, 1, 2))
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.morph_points, b.morph_points)
    assert any(
        a.morph_points.shape != b.morph_points.shape or (a.morph_points != b.morph_points).any()
        for a, b in zip(first, other, strict=True)
    )


def test_a_target_that_folds_is_left_in_time():
    """A vertex carried across its neighbour's spoke."""
    points = np.array([[0, 0], [1, 0], [0.6, 0.6], [0, 1], [-1, 0], [0, -1]], np.float64)
    target = points.copy()
    target[2] = [-0.5, 1.0]
    share = safe_share(points, target)
    assert 0.0 < share < 1.0
    limited = points + share * (target - points)
    assert fold_weight(points, limited) == 1.0
    assert fold_weight(points, target) < 1.0
    assert safe_share(points, points) == 1.0


def test_real_leaves_take_each_others_shapes(shared_data):
    files = sorted((shared_data / "umbrella" / "leaves").glob("*.png"))[:3]
    if len(files) < 3:
        pytest.skip("no leaves among the shared photos")
    bases = make_bases([find_elements(file).elements[0] for file in files])
    for base, morphed in zip(bases, with_morphs(bases, MorphOptions()), strict=True):
        assert fold_weight(morphed.points, morphed.morph_points) == 1.0
        assert signed_area(morphed.points[1:]) == pytest.approx(signed_area(base.points[1:]), rel=1e-12)
        assert _distance(morphed.points[1:], morphed.morph_points[1:]) > 0.05


@pytest.mark.parametrize(
    "contour",
    [
        [[1, 0], [1, 0], [0, 1], [-1, 0], [0, -1]],  # coincident vertices
        [[1, 0], [0.5, 0], [0, 1], [-1, 0], [0, -1]],  # a sector without area
        [[1, 0], [0, 1], [-1, -1]],
        [[0, 0], [0, 0], [0, 0]],
    ],
)
def test_damaged_contours_stay_finite(contour, rng):
    bases = [_base(np.array(contour, np.float64) + 0.0), _base(_star(rng, 12))] if np.any(contour) else None
    if bases is None:
        zero = np.zeros((4, 2))
        flat = BaseUmbrella("flat", np.ones((4, 4, 4), np.float32), False, zero, zero, zero, 0.0, 1.0)
        bases = [flat, _base(_star(rng, 12))]
    for morphed in with_morphs(bases, MorphOptions()):
        assert np.isfinite(morphed.points).all()
        assert np.isfinite(morphed.morph_points).all()
        assert fold_weight(morphed.points, morphed.morph_points) == 1.0


def test_a_wrong_amount_is_named():
    with pytest.raises(FexelError, match=r"--morph-amount: 1\.5, expected a number in \[0, 1\]"):
        with_morphs([], MorphOptions(amount=1.5))
