"""Texture coordinates made by xatlas: in the unit square, one per polygon corner, no triangle over another."""

from __future__ import annotations

import numpy as np
import pytest

from fexel.errors import FexelError
from fexel.scene.triangulation import triangulate
from fexel_tools.mesh_files import read_mesh_file
from fexel_tools.uv_atlas import make_atlas
from fexel_tools.uv_overlap import covering_faces, overlapping_pairs

_CUBE_POINTS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
_CUBE_FACES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def st_triangles(points, counts, indices, atlas):
    corners, _ = triangulate(np.asarray(points, float), counts, indices)
    return atlas.st[atlas.corner_indices[corners]].astype(np.float64)


def texels_covered_twice(st, size=1024):
    """Texel centres strictly inside two triangles: independent of the test under trial, by rasterising."""
    hits = np.zeros((size, size), int)
    for t in st * size:
        low = np.clip(np.floor(t.min(axis=0)).astype(int), 0, size - 1)
        high = np.clip(np.ceil(t.max(axis=0)).astype(int), low, size)
        x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
        sides = [
            (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
            for a, b in ((t[0], t[1]), (t[1], t[2]), (t[2], t[0]))
        ]
        near = 1e-3  # texels: a centre on a shared edge is in neither
        inside = np.all([side > near for side in sides], axis=0) | np.all([side < -near for side in sides], axis=0)
        hits[low[1] : high[1], low[0] : high[0]] += inside
    return int((hits > 1).sum()), float((hits > 0).mean())


def assert_good_atlas(points, counts, indices, atlas):
    st = st_triangles(points, counts, indices, atlas)
    assert atlas.corner_indices.shape == (len(indices),)
    assert atlas.st.min() >= 0 and atlas.st.max() <= 1
    twice, covered = texels_covered_twice(st)
    assert twice == 0
    assert covered == pytest.approx(atlas.utilization, abs=0.01)
    u, v = st[:, 1] - st[:, 0], st[:, 2] - st[:, 0]
    assert (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).min() > -1e-9  # no chart is mirrored


def test_cube_of_quads_has_one_square_per_face():
    counts, indices = np.full(6, 4), _CUBE_FACES.ravel()
    atlas = make_atlas(_CUBE_POINTS, counts, indices)
    assert_good_atlas(_CUBE_POINTS, counts, indices, atlas)
    st = atlas.st[atlas.corner_indices].reshape(6, 4, 2).astype(np.float64)
    edges = np.linalg.norm(np.roll(st, -1, axis=1) - st, axis=2)
    np.testing.assert_allclose(edges, edges[0, 0], rtol=1e-3)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_result_does_not_depend_on_the_size_of_the_mesh(scale):
    counts, indices = np.full(6, 4), _CUBE_FACES.ravel()
    atlas = make_atlas(_CUBE_POINTS * scale, counts, indices)
    assert atlas.chart_count == make_atlas(_CUBE_POINTS, counts, indices).chart_count
    assert_good_atlas(_CUBE_POINTS, counts, indices, atlas)


def test_bent_polygons_keep_one_coordinate_per_corner(rng):
    """Quads so uneven that their halves fall into different charts."""
    n = 12
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0))
    points = np.stack([x, y, 3 * rng.standard_normal(x.shape)], axis=-1).reshape(-1, 3)
    grid = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    indices = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=-1).ravel()
    counts = np.full(n * n, 4)
    assert_good_atlas(points, counts, indices, make_atlas(points, counts, indices))


def test_non_manifold_mesh_with_degenerate_faces_is_unwrapped():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [2, 0, 0]], float)
    counts = np.array([3, 3, 3, 3, 3])
    indices = np.array([0, 1, 2, 1, 0, 3, 0, 1, 4, 0, 0, 1, 0, 1, 5])  # three faces at one edge, two without area
    atlas = make_atlas(points, counts, indices)
    assert np.isfinite(atlas.st).all()
    assert_good_atlas(points, counts[:3], indices[:9], make_atlas(points, counts[:3], indices[:9]))


@pytest.mark.parametrize("name", ["teapot.obj", "suzanne.obj", "bunny.ply", "spot/spot_control_mesh.obj"])
def test_scanned_and_modelled_meshes_unwrap_without_overlap(shared_data, name):
    for mesh in read_mesh_file(shared_data / "meshes" / name):
        atlas = make_atlas(mesh.points, mesh.counts, mesh.indices)
        assert_good_atlas(mesh.points, mesh.counts, mesh.indices, atlas)


@pytest.mark.parametrize(
    ("points", "counts", "indices", "words"),
    [
        (np.zeros((0, 3)), [], [], "empty"),
        (np.zeros((3, 3)), [3], [0, 1, 2], "area"),
        (np.full((3, 3), np.nan), [3], [0, 1, 2], "NaN"),
        (np.eye(3), [3], [0, 1, 7], "index 7"),
        (np.eye(3), [4], [0, 1, 2], "sum"),
    ],
)
def test_unusable_mesh_is_an_error_that_says_what_was_found(points, counts, indices, words):
    with pytest.raises(FexelError, match=words):
        make_atlas(points, np.array(counts, int), np.array(indices, int))


def test_overlap_test_agrees_with_clipping_polygons(rng):
    """Random triangle pairs: the area of the intersection, by clipping, is zero exactly where no pair is reported."""
    st = rng.random((60, 3, 2))
    turn = (st[:, 1] - st[:, 0])[:, 0] * (st[:, 2] - st[:, 0])[:, 1] - (st[:, 1] - st[:, 0])[:, 1] * (
        st[:, 2] - st[:, 0]
    )[:, 0]
    st[turn < 0] = st[turn < 0][:, ::-1]
    found = {tuple(pair) for pair in overlapping_pairs(st, np.zeros(60, int)).tolist()}
    expected = {(i, j) for i in range(60) for j in range(i + 1, 60) if _common_area(st[i], st[j]) > 1e-9}
    assert found == expected
    assert 0 < len(found) < 60 * 59 / 2


def _common_area(subject, clip):
    """Sutherland and Hodgman 1974."""
    polygon = list(subject)
    for a, b in zip(clip, np.roll(clip, -1, axis=0), strict=True):
        side = [(b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) for p in polygon]
        clipped = []
        for k, p in enumerate(polygon):
            q, sp, sq = polygon[k - 1], side[k], side[k - 1]
            if (sp > 0) != (sq > 0):
                clipped.append(q + (p - q) * (sq / (sq - sp)))
            if sp > 0:
                clipped.append(p)
        polygon = clipped
        if len(polygon) < 3:
            return 0.0
    x, y = np.array(polygon).T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def test_triangles_of_different_charts_do_not_count_as_overlap():
    st = np.array([[[0, 0], [1, 0], [0, 1]], [[0, 0], [1, 0], [0, 1]]], float)
    assert len(overlapping_pairs(st, np.array([0, 1]))) == 0
    assert len(overlapping_pairs(st, np.array([0, 0]))) == 1


def test_covering_faces_leave_no_pair():
    assert covering_faces(np.array([[0, 1], [1, 2], [1, 3], [4, 5]])) in ({1, 4}, {1, 5})
    assert covering_faces(np.zeros((0, 2), int)) == set()
