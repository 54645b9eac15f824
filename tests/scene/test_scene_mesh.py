"""Meshes: topology, primvars of every interpolation, normals, damage."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, Vt

# Two quads side by side in the plane z = 0: points 0 1 2 below, 3 4 5 above.
_POINTS = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)]
_COUNTS, _INDICES = (4, 4), (0, 1, 4, 3, 1, 2, 5, 4)


def corner_values(mesh, values):
    """Values at the corners of all triangles, with where they are: what a picture would show."""
    return mesh.points[mesh.triangles].reshape(-1, 3), values[mesh.triangles].reshape(-1, *values.shape[1:])


def area(mesh):
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


def test_mesh_is_triangulated_in_double_precision(stage, define_mesh, read):
    define_mesh(stage, "/M", [(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0), (0, 0.1, 0)])
    scene, _ = read(stage)
    (draw,) = scene.draws
    assert draw.mesh.points.dtype == np.float64
    assert draw.mesh.normals.dtype == np.float32
    assert draw.mesh.triangles.dtype == np.int32
    assert draw.mesh.points.max() == np.float64(np.float32(0.1))
    assert (draw.first_triangle, draw.triangle_count, draw.path) == (0, 2, "/M")
    assert scene.prim_paths[draw.prim_id] == "/M"
    np.testing.assert_array_equal(draw.mesh.normals, [(0, 0, 1)] * len(draw.mesh.points))


@pytest.mark.parametrize("orientation", ["rightHanded", "leftHanded"])
def test_triangles_are_counter_clockwise_from_outside(stage, define_mesh, read, orientation):
    mesh = define_mesh(stage, "/M")
    mesh.CreateOrientationAttr(orientation)
    scene, _ = read(stage)
    got = scene.draws[0].mesh
    a, b, c = (got.points[got.triangles[:, k]] for k in range(3))
    expected = (0, 0, 1 if orientation == "rightHanded" else -1)
    assert np.all(np.sign(np.cross(b - a, c - a)) == expected)
    np.testing.assert_array_equal(got.normals, [expected] * len(got.points))


@pytest.mark.parametrize(
    ("interpolation", "values", "expected"),
    [
        ("constant", [(7, 7)], lambda p, face: (7, 7)),
        ("uniform", [(0, 0), (1, 1)], lambda p, face: (face, face)),
        ("vertex", [(x, y + 5) for x, y, _ in _POINTS], lambda p, face: (p[0], p[1] + 5)),
        ("varying", [(x, y + 5) for x, y, _ in _POINTS], lambda p, face: (p[0], p[1] + 5)),
        (
            "faceVarying",
            [(_POINTS[i][0] + 10 * (k // 4), _POINTS[i][1]) for k, i in enumerate(_INDICES)],
            lambda p, face: (p[0] + 10 * face, p[1]),
        ),
    ],
)
@pytest.mark.parametrize("indexed", [False, True])
def test_primvar_of_every_interpolation_reaches_every_corner(
    stage, define_mesh, read, interpolation, values, expected, indexed
):
    mesh = define_mesh(stage, "/M", _POINTS, _COUNTS, _INDICES)
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, interpolation)
    if indexed:
        primvar.Set(Vt.Vec2fArray([(-9, -9), *values[::-1]]))
        primvar.SetIndices(list(range(len(values), 0, -1)))
    else:
        primvar.Set(Vt.Vec2fArray(values))
    got = read(stage)[0].draws[0].mesh
    centres = got.points[got.triangles].mean(axis=1)
    for corners, st, centre in zip(got.points[got.triangles], got.st["st"][got.triangles], centres, strict=True):
        for p, value in zip(corners, st, strict=True):
            assert tuple(value) == expected(p, int(centre[0] > 1))


def test_points_are_shared_where_primvars_agree_and_split_at_seams(stage, define_mesh, read):
    smooth = [(_POINTS[i][0], _POINTS[i][1]) for i in _INDICES]
    define_mesh(
        stage, "/Smooth", _POINTS, _COUNTS, _INDICES, "catmullClark", st=("TexCoord2fArray", "faceVarying", smooth)
    )
    seam = [(s + 10 * (k // 4), t) for k, (s, t) in enumerate(smooth)]
    define_mesh(stage, "/Seam", _POINTS, _COUNTS, _INDICES, "catmullClark", st=("TexCoord2fArray", "faceVarying", seam))
    meshes = {draw.path: draw.mesh for draw in read(stage)[0].draws}
    assert len(meshes["/Smooth"].points) == 6
    assert len(meshes["/Seam"].points) == 8


@pytest.mark.parametrize("type_name", ["TexCoord2fArray", "TexCoord2dArray", "TexCoord2hArray", "Float2Array"])
def test_several_texture_coordinate_sets_of_any_type(stage, define_mesh, read, type_name):
    values = [(0, 0), (1, 0), (1, 1), (0, 0.5)]
    define_mesh(stage, "/M", st=(type_name, "vertex", values), map2=(type_name, "vertex", values[::-1]))
    got = read(stage)[0].draws[0].mesh
    assert set(got.st) == {"st", "map2"}
    assert got.st["st"].dtype == np.float64
    assert {tuple(v) for v in got.st["st"]} == set(values)


def test_display_color_and_opacity(stage, define_mesh, read):
    define_mesh(
        stage,
        "/M",
        displayColor=("Color3fArray", "vertex", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]),
        displayOpacity=("FloatArray", "constant", [0.25]),
    )
    got = read(stage)[0].draws[0].mesh
    points, colors = corner_values(got, got.display_color)
    assert {(*p[:2], *c) for p, c in zip(points, colors, strict=True)} == {
        (0, 0, 1, 0, 0),
        (1, 0, 0, 1, 0),
        (1, 1, 0, 0, 1),
        (0, 1, 1, 1, 1),
    }
    assert np.all(got.display_opacity == 0.25)


def test_normals_are_smooth_for_subdivision_surfaces_and_faceted_otherwise(stage, define_mesh, read):
    roof = [(0, 0, 0), (1, 0, 1), (2, 0, 0), (0, 1, 0), (1, 1, 1), (2, 1, 0)]
    define_mesh(stage, "/Smooth", roof, _COUNTS, _INDICES, "catmullClark")
    define_mesh(stage, "/Facet", roof, _COUNTS, _INDICES, "none")
    define_mesh(stage, "/Bilinear", roof, _COUNTS, _INDICES, "bilinear")
    meshes = {draw.path: draw.mesh for draw in read(stage)[0].draws}
    points, normals = corner_values(meshes["/Smooth"], meshes["/Smooth"].normals)
    np.testing.assert_allclose(normals[points[:, 0] == 1], [(0, 0, 1)] * sum(points[:, 0] == 1), atol=1e-6)
    for name in ("/Facet", "/Bilinear"):
        assert {tuple(n) for n in np.round(meshes[name].normals, 4)} == {
            (np.float32(-0.7071), 0, np.float32(0.7071)),
            (np.float32(0.7071), 0, np.float32(0.7071)),
        }


@pytest.mark.parametrize(
    ("interpolation", "values"),
    [
        ("vertex", [(1, 0, 0)] * 4),
        ("faceVarying", [(2, 0, 0)] * 4),
        ("uniform", [(3, 0, 0)]),
        ("constant", [(1, 0, 0)]),
    ],
)
@pytest.mark.parametrize("as_primvar", [False, True])
def test_authored_normals_win_and_get_unit_length(stage, define_mesh, read, interpolation, values, as_primvar):
    mesh = define_mesh(stage, "/M", scheme="catmullClark")
    if as_primvar:
        primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("normals", Sdf.ValueTypeNames.Normal3fArray, interpolation)
        primvar.Set(Vt.Vec3fArray(values))
        mesh.CreateNormalsAttr([(0, 1, 0)] * 4)
    else:
        mesh.CreateNormalsAttr(values)
        mesh.SetNormalsInterpolation(interpolation)
    got = read(stage)[0].draws[0].mesh
    np.testing.assert_array_equal(got.normals, [(1, 0, 0)] * len(got.points))


def test_zero_normals_are_replaced_by_the_face_s(stage, define_mesh, read):
    mesh = define_mesh(stage, "/M")
    mesh.CreateNormalsAttr([(0, 0, 0)] * 4)
    mesh.SetNormalsInterpolation("vertex")
    got = read(stage)[0].draws[0].mesh
    np.testing.assert_array_equal(got.normals, [(0, 0, 1)] * len(got.points))


def test_holes_and_faces_without_area_are_not_drawn(stage, define_mesh, read):
    mesh = define_mesh(stage, "/M", _POINTS, (4, 4, 3, 2, 3), (*_INDICES, 0, 0, 1, 0, 1, 0, 1, 2))
    mesh.CreateHoleIndicesAttr([1])
    got = read(stage)[0].draws[0].mesh
    assert area(got) == 1.0
    assert len(got.triangles) == 2
    assert got.points[:, 0].max() == 1  # points that nothing uses are gone


def test_concave_face_covers_its_own_area_only(stage, define_mesh, read):
    define_mesh(stage, "/M", [(0, 0, 0), (4, 0, 0), (4, 4, 0), (2, 1, 0), (0, 4, 0)], (5,), range(5))
    assert area(read(stage)[0].draws[0].mesh) == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"indices": (0, 1, 2, 9)}, "9, expected 0 to 3"),
        ({"indices": (0, 1, 2, -1)}, "-1, expected 0 to 3"),
        ({"indices": (0, 1, 2)}, "3 entries, expected 4"),
        ({"counts": (-4, 8)}, "-4"),
        ({"points": [(0, 0, 0), (1, 0, 0), (1, float("nan"), 0), (0, 1, 0)]}, "point 2 of 4 is NaN"),
    ],
)
def test_damaged_mesh_is_skipped_with_one_warning_that_names_it(stage, define_mesh, read, change, words):
    define_mesh(stage, "/Bad", **change)
    define_mesh(stage, "/Good")
    scene, warned = read(stage)
    assert [draw.path for draw in scene.draws] == ["/Good"]
    assert len(warned) == 1
    assert warned[0].startswith("/Bad: ") and words in warned[0]


def test_empty_meshes_are_skipped_without_a_word(stage, define_mesh, read):
    define_mesh(stage, "/NoFaces", counts=(), indices=())
    UsdGeom.Mesh.Define(stage, "/Nothing")
    define_mesh(stage, "/Flat", [(0, 0, 0)] * 4)
    assert read(stage)[0].draws == () and read(stage)[1] == []


@pytest.mark.parametrize(
    ("primvars", "words"),
    [
        ({"st": ("TexCoord2fArray", "vertex", [(0, 0)] * 3)}, "st: 3 values, expected 4 for vertex"),
        ({"st": ("TexCoord2fArray", "faceVarying", [(0, 0)] * 6)}, "st: 6 values, expected 4 for faceVarying"),
        ({"st": ("TexCoord2fArray", "uniform", [])}, "st: 0 values, expected 1 for uniform"),
        ({"displayColor": ("Color3fArray", "vertex", [(1, 1, 1)] * 2)}, "displayColor: 2 values, expected 4"),
        ({"normals": ("Normal3fArray", "vertex", [(1, 1, 1)] * 2)}, "normals: 2 values, expected 4"),
    ],
)
def test_primvar_of_wrong_length_is_dropped_with_both_lengths_named(stage, define_mesh, read, primvars, words):
    define_mesh(stage, "/M", **primvars)
    scene, warned = read(stage)
    mesh = scene.draws[0].mesh
    assert len(warned) == 1 and "/M.primvars:" in warned[0] and words in warned[0]
    assert "st" not in mesh.st and mesh.display_color is None
    assert np.isfinite(mesh.normals).all()


def test_primvar_index_out_of_range_and_nan_values(stage, define_mesh, read):
    mesh = define_mesh(stage, "/M", uv=("TexCoord2fArray", "vertex", [(0, 0), (float("nan"), 1), (0, 0), (2, 2)]))
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    primvar.Set(Vt.Vec2fArray([(0, 0)]))
    primvar.SetIndices([0, 0, 0, 1])
    scene, warned = read(stage)
    assert set(scene.draws[0].mesh.st) == {"uv"}
    assert np.isfinite(scene.draws[0].mesh.st["uv"]).all()
    assert len(warned) == 2 and any("index 1, expected 0 to 0" in w for w in warned)


def test_million_face_mesh_uses_no_loop_over_faces(stage, read):
    """300 x 300 quads, of which each stands for many; a Python loop over 90,000 faces would show in the call count."""
    import sys

    n = 300
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0))
    grid = np.arange((n + 1) ** 2, dtype=np.int32).reshape(n + 1, n + 1)
    indices = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=-1).ravel()
    mesh = UsdGeom.Mesh.Define(stage, "/Grid")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3).astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(n * n, 4, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(indices))
    calls = 0

    def count(_frame, event, _argument):
        nonlocal calls
        calls += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        scene, _ = read(stage)
    finally:
        sys.setprofile(None)
    assert scene.draws[0].triangle_count == 2 * n * n
    assert calls < 5000


def test_time_samples_of_points_make_a_new_mesh_per_time_and_nothing_else_does(stage, define_mesh):
    from fexel.scene import SceneReader

    moving = define_mesh(stage, "/Moving")
    moving.GetPointsAttr().Clear()
    for time in (1.0, 3.0):
        moving.GetPointsAttr().Set(Vt.Vec3fArray([(0, 0, 0), (time, 0, 0), (time, 1, 0), (0, 1, 0)]), time)
    define_mesh(stage, "/Still")
    reader = SceneReader(stage)
    one, two, again = (reader.at(time) for time in (1.0, 2.0, 1.0))
    meshes = [{draw.path: draw.mesh for draw in scene.draws} for scene in (one, two, again)]
    assert [m["/Moving"].points.max() for m in meshes] == [1.0, 2.0, 1.0]
    assert meshes[0]["/Still"] is meshes[1]["/Still"] is meshes[2]["/Still"]
    assert meshes[0]["/Moving"] is not meshes[1]["/Moving"]


def test_a_lone_time_sample_counts_for_times_but_not_for_the_default(stage, define_mesh):
    from fexel.scene import SceneReader

    mesh = define_mesh(stage, "/M")
    mesh.GetPointsAttr().Clear()
    mesh.GetPointsAttr().Set(Vt.Vec3fArray([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]), 5.0)
    reader = SceneReader(stage)
    assert [len(reader.at(time).draws) for time in (None, 1.0, 9.0)] == [0, 1, 1]


def test_primvar_time_samples(stage, define_mesh):
    from fexel.scene import SceneReader

    mesh = define_mesh(stage, "/M", st=("TexCoord2fArray", "vertex", [(0, 0)] * 4))
    attribute = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").GetAttr()
    for time in (0.0, 10.0):
        attribute.Set(Vt.Vec2fArray([(time, 0)] * 4), Usd.TimeCode(time))
    reader = SceneReader(stage)
    assert [reader.at(t).draws[0].mesh.st["st"][0, 0] for t in (0.0, 5.0, 10.0)] == [0.0, 5.0, 10.0]
