"""Refinement of subdivision surfaces against what is known of them in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import UsdGeom

from fexel.errors import FexelError
from fexel.scene import SceneReader

_CUBE = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
_CUBE_FACES = (0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3)


def grid_faces(n):
    i = np.arange(n * n).reshape(n, n)
    return np.stack([i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]], axis=-1).reshape(-1, 4)


def mesh_at(stage, complexity, read):
    scene, warned = read(stage, complexity=complexity)
    return scene.draws[0].mesh, warned


def heights(mesh):
    """Height by (x, y), both rounded to 1/1024."""
    keys = np.round(mesh.points[:, :2] * 1024).astype(int)
    return {(x, y): z for (x, y), z in zip(keys.tolist(), mesh.points[:, 2].tolist(), strict=True)}


def test_triangle_counts_grow_by_four_per_level(stage, define_mesh, read):
    define_mesh(stage, "/M", _CUBE, (4,) * 6, _CUBE_FACES, "catmullClark")
    counts = [len(mesh_at(stage, c, read)[0].triangles) for c in ("low", "medium", "high", "veryhigh")]
    assert counts == [12, 48, 192, 768]
    with pytest.raises(FexelError, match="'ultra', expected one of low, medium, high, veryhigh"):
        SceneReader(stage, complexity="ultra")


def test_faceted_meshes_are_not_refined(stage, define_mesh, read):
    define_mesh(stage, "/M", _CUBE, (4,) * 6, _CUBE_FACES, "none")
    assert len(mesh_at(stage, "high", read)[0].triangles) == 12


def test_catmull_clark_on_a_regular_grid_is_bicubic_b_spline_refinement(stage, define_mesh, read, rng):
    """Masks of the uniform cubic B-spline: 1 6 1 over 8 at old knots, 1 1 over 2 between, in both directions."""
    n = 7
    z = rng.standard_normal((n, n))
    points = [(x, y, z[y, x]) for y in range(n) for x in range(n)]
    define_mesh(stage, "/M", points, (4,) * (n - 1) ** 2, grid_faces(n).ravel().tolist(), "catmullClark")
    refine = np.zeros((2 * n - 1, n))
    for k in range(2 * n - 1):
        if k % 2:
            refine[k, [k // 2, k // 2 + 1]] = 0.5
        elif 0 < k < 2 * n - 2:
            refine[k, [k // 2 - 1, k // 2, k // 2 + 1]] = 1 / 8, 6 / 8, 1 / 8
    expected = refine @ z.astype(np.float32) @ refine.T
    got = heights(mesh_at(stage, "medium", read)[0])
    for row in range(2, 2 * n - 3):
        for column in range(2, 2 * n - 3):
            assert got[(column * 512, row * 512)] == pytest.approx(expected[row, column], abs=1e-6)


def test_loop_on_a_regular_triangle_grid_has_the_masks_of_the_box_spline(stage, define_mesh, read):
    """One raised vertex of valence 6: 10/16 there, 6/16 halfway to its neighbours, 1/16 at them, 2/16 across edges."""
    n = 7
    quads = grid_faces(n)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    points = [(x, y, 16.0 if (x, y) == (3, 3) else 0.0) for y in range(n) for x in range(n)]
    define_mesh(stage, "/M", points, (3,) * len(triangles), triangles.ravel().tolist(), "loop")
    got = heights(mesh_at(stage, "medium", read)[0])
    at = {(x, y): z for (x, y), z in got.items() if z}
    expected = {(3, 3): 10.0}
    ring = [(1, 0), (1, 1), (0, 1), (-1, 0), (-1, -1), (0, -1)]
    for (ax, ay), (bx, by) in zip(ring, ring[1:] + ring[:1], strict=True):
        expected[(3 + ax, 3 + ay)] = 1.0
        expected[(3 + ax / 2, 3 + ay / 2)] = 6.0
        expected[(3 + (ax + bx) / 2, 3 + (ay + by) / 2)] = 2.0
    assert at == pytest.approx({(round(x * 1024), round(y * 1024)): z for (x, y), z in expected.items()})


def test_refinement_commutes_with_affine_maps(stage, define_mesh, read, rng):
    matrix, offset = rng.standard_normal((3, 3)), rng.standard_normal(3)
    cube = np.array(_CUBE, float)
    define_mesh(stage, "/A", cube.tolist(), (4,) * 6, _CUBE_FACES, "catmullClark")
    define_mesh(stage, "/B", (cube @ matrix + offset).tolist(), (4,) * 6, _CUBE_FACES, "catmullClark")
    a, b = (draw.mesh.points for draw in read(stage, complexity="high")[0].draws)
    np.testing.assert_allclose(a @ matrix + offset, b, atol=1e-5)


def test_cube_shrinks_towards_a_ball_and_its_normals_point_out(stage, define_mesh, read):
    define_mesh(stage, "/M", _CUBE, (4,) * 6, _CUBE_FACES, "catmullClark")
    mesh, _ = mesh_at(stage, "veryhigh", read)
    radius = np.linalg.norm(mesh.points, axis=1)
    assert radius.max() / radius.min() < 1.15
    assert ((mesh.points * mesh.normals).sum(axis=1) > 0.95 * radius).all()


def test_infinitely_sharp_creases_keep_the_cube(stage, define_mesh, read):
    mesh = define_mesh(stage, "/M", _CUBE, (4,) * 6, _CUBE_FACES, "catmullClark")
    faces = np.array(_CUBE_FACES).reshape(6, 4)
    mesh.CreateCreaseIndicesAttr(np.concatenate([faces, faces[:, :1]], axis=1).ravel().tolist())
    mesh.CreateCreaseLengthsAttr([5] * 6)
    mesh.CreateCreaseSharpnessesAttr([10.0] * 6)
    got, warned = mesh_at(stage, "high", read)
    assert warned == []
    np.testing.assert_allclose(np.abs(got.points).max(axis=1), 1.0, atol=1e-6)
    assert {tuple(p) for p in _CUBE} <= {tuple(p) for p in np.round(got.points, 6)}


def test_crease_sharpness_between_levels_lies_between_smooth_and_sharp(stage, define_mesh, read):
    faces = np.array(_CUBE_FACES).reshape(6, 4)
    sizes = []
    for number, sharpness in enumerate((0.0, 0.5, 1.0, 2.0, 10.0)):
        mesh = define_mesh(stage, f"/M{number}", _CUBE, (4,) * 6, _CUBE_FACES, "catmullClark")
        mesh.CreateCreaseIndicesAttr(np.concatenate([faces, faces[:, :1]], axis=1).ravel().tolist())
        mesh.CreateCreaseLengthsAttr([5] * 6)
        mesh.CreateCreaseSharpnessesAttr([sharpness] * 6)
    for draw in read(stage, complexity="veryhigh")[0].draws:
        sizes.append(np.linalg.norm(draw.mesh.points, axis=1).max())
    assert sizes == sorted(sizes) and sizes[0] < 1.1 < 1.7 < sizes[-1]


@pytest.mark.parametrize(("rule", "corners_stay"), [("edgeAndCorner", True), ("edgeOnly", False)])
def test_boundary_rules(stage, define_mesh, read, rule, corners_stay):
    mesh = define_mesh(stage, "/M", scheme="catmullClark")
    mesh.CreateInterpolateBoundaryAttr(rule)
    points = mesh_at(stage, "medium", read)[0].points
    assert ((0, 0, 0) in {tuple(p) for p in points}) is corners_stay
    assert (0.5, 0, 0) in {tuple(p) for p in points}


def test_boundary_rule_none_draws_only_faces_inside(stage, define_mesh, read):
    n = 4
    points = [(x, y, 0) for y in range(n) for x in range(n)]
    mesh = define_mesh(stage, "/M", points, (4,) * 9, grid_faces(n).ravel().tolist(), "catmullClark")
    mesh.CreateInterpolateBoundaryAttr("none")
    got = mesh_at(stage, "medium", read)[0].points
    assert got.min(axis=0)[:2] == pytest.approx((1, 1)) and got.max(axis=0)[:2] == pytest.approx((2, 2))


def test_texture_coordinates_that_follow_the_points_still_do(stage, define_mesh, read):
    """st = (x, y): smooth with the points, for vertex and indexed faceVarying st, also at the rim."""
    n = 5
    points = [(x + 0.2 * (y % 2), y, 0) for y in range(n) for x in range(n)]
    st = [(x, y) for x, y, _ in points]
    faces = grid_faces(n).ravel().tolist()
    mesh = define_mesh(stage, "/M", points, (4,) * 16, faces, "catmullClark", st=("TexCoord2fArray", "vertex", st))
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("fv", mesh_type(), "faceVarying")
    primvar.Set(st)
    primvar.SetIndices(faces)
    got, _ = mesh_at(stage, "high", read)
    np.testing.assert_allclose(got.st["st"], got.points[:, :2], atol=1e-6)
    np.testing.assert_allclose(got.st["fv"], got.points[:, :2], atol=1e-6)


def mesh_type():
    from pxr import Sdf

    return Sdf.ValueTypeNames.TexCoord2fArray


def test_seams_uniform_values_holes_and_subsets_pass_to_the_children(stage, define_mesh, read):
    mesh = define_mesh(
        stage, "/M", _CUBE, (4,) * 6, _CUBE_FACES, "catmullClark",
        st=("TexCoord2fArray", "faceVarying", [(0, 0), (1, 0), (1, 1), (0, 1)] * 6),
        displayColor=("Color3fArray", "uniform", [(k, 0, 0) for k in range(6)]),
    )  # fmt: skip
    mesh.CreateHoleIndicesAttr([5])
    UsdGeom.Subset.CreateGeomSubset(mesh, "Two", "face", [0, 1], "materialBind")
    scene, warned = read(stage, complexity="medium")
    got = scene.draws[0].mesh
    assert warned == []
    assert sorted(draw.triangle_count for draw in scene.draws) == [16, 24]
    colors = got.display_color[got.triangles][:, :, 0]
    assert (colors == colors[:, :1]).all()
    assert np.array_equal(np.bincount(colors[:, 0].astype(int)), [8] * 5)
    areas = np.abs(np.linalg.det(np.diff(got.st["st"][got.triangles], axis=1)))
    assert areas.sum() / 2 == pytest.approx(5.0)  # every face still has the whole unit square


@pytest.mark.parametrize("scheme", ["catmullClark", "loop"])
def test_what_cannot_be_refined_is_drawn_as_it_is(stage, define_mesh, read, scheme):
    counts, indices = ((4, 2), (0, 1, 2, 3, 0, 1)) if scheme == "catmullClark" else ((4,), (0, 1, 2, 3))
    define_mesh(stage, "/M", counts=counts, indices=indices, scheme=scheme)
    got, warned = mesh_at(stage, "high", read)
    assert len(got.triangles) == 2
    assert len(warned) == 1 and warned[0].startswith("/M: ")


def test_damaged_creases_warn_and_are_left_out(stage, define_mesh, read):
    mesh = define_mesh(stage, "/M", scheme="catmullClark")
    mesh.CreateCreaseIndicesAttr([0, 9])
    mesh.CreateCreaseLengthsAttr([2])
    mesh.CreateCreaseSharpnessesAttr([1.0])
    mesh.CreateCornerIndicesAttr([0])
    _, warned = mesh_at(stage, "medium", read)
    assert len(warned) == 2


def test_non_manifold_mesh_is_refined(stage, define_mesh, read):
    points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, -1, 0), (1, -1, 0), (0, 0, 1), (1, 0, 1)]
    faces = (0, 1, 2, 3, 4, 5, 1, 0, 0, 1, 7, 6)
    define_mesh(stage, "/M", points, (4, 4, 4), faces, "catmullClark")
    got, _ = mesh_at(stage, "high", read)
    assert np.isfinite(got.points).all() and len(got.triangles) == 3 * 32
