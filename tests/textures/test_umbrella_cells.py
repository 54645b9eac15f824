"""Cells list every umbrella that any of their points needs, and leave out what opaque umbrellas hide."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from fexel.textures.umbrella_arrangement import Arrangement, Shape
from fexel.textures.umbrella_cells import (
    CASTS,
    COVERS,
    SHADES,
    VISIBLE,
    Cells,
    build_cells,
    cell_statistics,
    fine_size,
)


def leaf(rng, vertices):
    angle = np.arange(vertices - 1) / (vertices - 1) * 2 * np.pi + rng.uniform(0, 1)
    radius = rng.uniform(0.25, 0.5, vertices - 1)
    return np.concatenate([[(0, 0)], np.stack([np.cos(angle), np.sin(angle)], 1) * radius[:, None]])


def scattered(rng, count, size, grid=(1, 1), vertices=9, **look):
    """Turned leaves of about `size` in st, anywhere."""
    shapes = tuple(Shape(p, p, p + 0.5) for p in (leaf(rng, vertices) for _ in range(3)))
    angle, scale = rng.uniform(0, 7, count), size * rng.uniform(0.5, 1.5, count)
    matrices = np.tile(np.eye(3), (count, 1, 1))
    matrices[:, 0, 0], matrices[:, 0, 1] = np.cos(angle) * scale, np.sin(angle) * scale
    matrices[:, 1, 0], matrices[:, 1, 1] = -np.sin(angle) * scale, np.cos(angle) * scale
    matrices[:, 2, :2] = rng.uniform(0, 1, (count, 2))
    index = rng.integers(0, 3, count).astype(np.int32)
    return Arrangement(
        shapes, index, matrices, np.zeros(count), np.zeros((0, 3), np.float32), grid, coverages=np.ones(count), **look
    )


def cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def covers(arrangement, number, points):
    """Whether points lie in an umbrella, by its triangles."""
    first, end = arrangement.first_vertex[number : number + 2]
    center, begin = arrangement.vertices[first], arrangement.vertices[first + 1 : end]
    after, points = np.roll(begin, -1, axis=0), points[:, None]
    sides = [cross(q - p, points - p) >= 0 for p, q in ((center, begin), (begin, after), (after, center))]
    return np.logical_and.reduce(sides).any(axis=1)


def shifts(arrangement, number, reach=0.0):
    first, end = arrangement.first_vertex[number : number + 2]
    low = np.floor(arrangement.vertices[first:end].min(axis=0) - reach - 1).astype(int)
    high = np.ceil(arrangement.vertices[first:end].max(axis=0) + reach).astype(int)
    return [(s, t) for t in range(low[1], high[1] + 1) for s in range(low[0], high[0] + 1)]


def listed(cells: Cells, points, flag):
    """(points, umbrella, shift) triples that cells list with a flag."""
    cell = cells.find(points)
    found = [set() for _ in points]
    for number, place in enumerate(cell):
        for entry in range(cells.first[place], cells.first[place + 1]):
            if cells.flags[entry] & flag:
                found[number].add((int(cells.umbrella[entry]), *cells.shift[entry].tolist()))
    return found


def needed(arrangement, points, offset=(0.0, 0.0)):
    """The same of umbrellas that cover points moved against an offset."""
    found = [set() for _ in points]
    for number in range(len(arrangement)):
        several = shifts(arrangement, number, float(np.abs(offset).max()))
        places = (np.array(several)[:, None] + points - np.asarray(offset)).reshape(-1, 2)
        for place in np.flatnonzero(covers(arrangement, number, places)):
            shift, point = divmod(int(place), len(points))
            found[point].add((number, *several[shift]))
    return found


CASES = [
    ({"count": 60, "size": 0.2}, (16, 16)),
    ({"count": 60, "size": 0.2}, (7, 29)),
    ({"count": 40, "size": 0.02}, (8, 8)),
    ({"count": 10, "size": 0.5}, (1, 1)),
    ({"count": 4, "size": 3.0}, (5, 5)),  # larger than the unit square
    ({"count": 2, "size": 3.0}, (1, 1)),
    ({"count": 30, "size": 0.3, "vertices": 4}, (31, 3)),
    ({"count": 12, "size": 0.3, "vertices": 30}, (6, 6)),
]


@pytest.mark.parametrize(("spec", "size"), CASES)
def test_no_point_needs_an_umbrella_that_its_cell_does_not_list(rng, spec, size):
    offset = (0.07, -0.05)
    arrangement = scattered(rng, shadow_offset=offset, shadow_strength=0.5, **spec)
    cells = build_cells(arrangement, size, cull=False)
    points = np.concatenate([rng.uniform(0, 1, (600, 2)), rng.integers(0, 2, (20, 2)).astype(float)])
    for flag, moved in ((VISIBLE, (0, 0)), (CASTS, offset)):
        for needs, has in zip(needed(arrangement, points, moved), listed(cells, points, flag), strict=True):
            assert needs <= has


@pytest.mark.parametrize(("spec", "size"), CASES)
def test_lists_serve_points_as_far_away_as_the_margin(rng, spec, size):
    arrangement = scattered(rng, **spec)
    margin = np.array([0.03, 0.011])
    cells = build_cells(arrangement, size, tuple(margin), cull=False)
    points = rng.uniform(0.0, 1.0, (400, 2))
    near = points + margin * rng.uniform(-1, 1, (400, 2))
    for needs, has in zip(needed(arrangement, near), listed(cells, points, VISIBLE), strict=True):
        assert needs <= has


@pytest.mark.parametrize(("spec", "size"), CASES)
def test_what_is_said_to_cover_covers_every_point_of_the_cell(rng, spec, size):
    offset = (0.07, -0.05)
    arrangement = scattered(rng, shadow_offset=offset, shadow_strength=0.5, **spec)
    cells = build_cells(arrangement, size, 0.01, cull=False)
    points = rng.uniform(0, 1, (600, 2))
    for flag, moved in ((COVERS, (0, 0)), (SHADES, offset)):
        for covering, has in zip(needed(arrangement, points, moved), listed(cells, points, flag), strict=True):
            assert has <= covering


def test_something_covers_and_something_is_culled(rng):
    arrangement = scattered(rng, 300, 0.3, grid=(8, 8))
    whole, culled = (build_cells(arrangement, (32, 32), cull=cull) for cull in (False, True))
    assert (whole.flags & COVERS > 0).any()
    assert culled.counts.mean() < 0.3 * whole.counts.mean()


@pytest.mark.parametrize("strength", [0.0, 0.6])
@pytest.mark.parametrize(("spec", "size"), CASES)
def test_culling_leaves_all_that_is_seen_and_all_that_shades_it(rng, spec, size, strength):
    spec = {**spec, "count": 3 * spec["count"]}
    offset = (0.07, -0.05)
    arrangement = scattered(rng, shadow_offset=offset, shadow_strength=strength, **spec)
    arrangement = replace(arrangement, coverages=np.where(rng.uniform(size=len(arrangement)) < 0.3, 0.5, 1.0))
    opaque = np.array([True, True, False])
    hides = opaque[arrangement.shape_of] & (arrangement.coverages == 1)
    cells = build_cells(arrangement, size, opaque=opaque)
    points = rng.uniform(0, 1, (300, 2))
    visible = listed(cells, points, VISIBLE)
    casting = listed(cells, points, CASTS)
    covering, shading = needed(arrangement, points), needed(arrangement, points, offset)
    for point in range(len(points)):
        in_order = sorted(covering[point])
        last = next((entry[0] for entry in in_order if hides[entry[0]]), len(arrangement))
        assert {entry for entry in in_order if entry[0] <= last} <= visible[point] | {
            entry for entry in in_order if entry[0] == last
        }
        assert any(entry[0] == last for entry in visible[point]) or last == len(arrangement)
        if strength:
            shades = sorted(entry for entry in shading[point] if entry[0] < last)
            dark = next((entry[0] for entry in shades if hides[entry[0]]), len(arrangement))
            assert {entry for entry in shades if entry[0] < dark} <= casting[point]
            assert any(entry[0] == dark for entry in casting[point]) or dark == len(arrangement)


def test_lists_run_front_to_back(rng):
    arrangement = scattered(rng, 200, 0.3, shadow_offset=(0.1, 0.1), shadow_strength=1.0)
    for cull in (False, True):
        cells = build_cells(arrangement, (12, 9), cull=cull)
        for first, end in zip(cells.first[:-1], cells.first[1:], strict=True):
            assert (np.diff(cells.umbrella[first:end]) >= 0).all()
            entries = {
                (u, *s) for u, s in zip(cells.umbrella[first:end], map(tuple, cells.shift[first:end]), strict=True)
            }
            assert len(entries) == end - first


def test_portions_make_no_difference(rng, monkeypatch):
    arrangement = scattered(rng, 150, 0.2, shadow_offset=(0.02, 0.01), shadow_strength=0.4)
    whole = build_cells(arrangement, (20, 20))
    monkeypatch.setattr("fexel.textures.umbrella_cells._MOST_PICTURE", 50)
    monkeypatch.setattr("fexel.textures.umbrella_cells._MOST_EDGES", 20)
    parts = build_cells(arrangement, (20, 20))
    for name in ("first", "umbrella", "shift", "flags"):
        assert np.array_equal(getattr(whole, name), getattr(parts, name))


def test_no_umbrellas_leave_empty_cells(rng):
    nothing = scattered(rng, 0, 0.1)
    cells = build_cells(nothing, (4, 3))
    assert cells.counts.tolist() == [0] * 12
    assert len(cells.umbrella) == 0
    assert fine_size(nothing) == (1, 1)
    assert cell_statistics(nothing).most == 0


def test_cells_between_umbrellas_are_empty(rng):
    one = scattered(rng, 1, 0.1)
    cells = build_cells(one, (10, 10))
    assert 0 < (cells.counts > 0).sum() < 9


def test_points_on_the_upper_border_are_of_the_last_cell():
    cells = Cells(
        (3, 2), np.zeros(7, np.int64), np.zeros(0, np.int32), np.zeros((0, 2), np.int8), np.zeros(0, np.uint8)
    )
    assert cells.find(np.array([[0.0, 0.0], [1.0, 1.0], [0.34, 0.5], [1.0, 0.0]])).tolist() == [0, 5, 4, 2]


def test_odd_contour_is_listed_wherever_it_may_be_seen_and_covers_nothing(rng):
    outside = np.array([(0, -3), (-1, -1), (1, -1), (1, 1), (-1, 1)]) * 0.1
    matrix = np.eye(3)
    matrix[2, :2] = 0.5
    none = np.zeros((0, 3), np.float32)
    odd = Arrangement((Shape(outside, outside, outside),), np.zeros(1, np.int32), matrix[None], np.zeros(1), none)
    cells = build_cells(odd, (40, 40))
    assert not (cells.flags & COVERS).any()
    points = rng.uniform(0, 1, (500, 2))
    for needs, has in zip(needed(odd, points), listed(cells, points, VISIBLE), strict=True):
        assert needs <= has


def test_statistics_count_what_touches_cells_of_the_authored_grid(rng):
    arrangement = scattered(rng, 60, 0.5, grid=(6, 4), shadow_offset=(0.3, 0.3), shadow_strength=1.0)
    statistics = cell_statistics(arrangement)
    points = rng.uniform(0, 1, (4000, 2))
    cell = (points * (6, 4)).astype(int) @ (1, 6)
    found = [set() for _ in range(24)]
    for number, has in zip(cell, needed(arrangement, points), strict=True):
        found[number] |= has
    sampled = np.array([len(entries) for entries in found])
    assert 0 <= statistics.most - sampled.max() <= 3
    assert 0 <= statistics.mean - sampled.mean() < 3
    assert statistics.most_seen <= statistics.most
    assert statistics.mean_seen < statistics.mean


def test_proposed_grid_makes_short_lists(rng):
    for length in (2.5, 4.0):
        arrangement = scattered(rng, 3000, 0.06, vertices=20)
        mean = build_cells(arrangement, fine_size(arrangement, length)).counts.mean()
        assert 1.0 < mean < 1.6 * length
    few, many = (fine_size(scattered(rng, 100, size)) for size in (0.5, 0.05))
    assert many[0] > few[0]
    assert np.prod(fine_size(scattered(rng, 100, 1e-4))) <= 1 << 20


def test_a_hundred_thousand_umbrellas_take_bounded_memory(rng):
    arrangement = scattered(rng, 100_000, 0.008, vertices=6)
    tracemalloc.start()
    cells = build_cells(arrangement, fine_size(arrangement))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(cells.first) > 100_000
    assert peak < 1e9
