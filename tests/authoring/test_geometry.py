"""Surfaces show the texture undistorted, and cameras frame what they promise."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from fexel.errors import FexelError
from fexel_tools.framing import camera_poses
from fexel_tools.geometry import PRIMITIVES, load_surface, locate, primitive

FOCAL, APERTURE = 50.0, 36.0


@pytest.mark.parametrize("name", PRIMITIVES)
def test_primitive_faces_outward_and_covers_the_unit_square(name):
    surface = primitive(name, 1.5)
    corners = surface.points[surface.triangles]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(facing, axis=1)
    outward = surface.normals[surface.triangles].mean(axis=1)
    assert (np.einsum("td,td->t", facing, outward)[area > 1e-9] > 0).all()
    st = surface.st
    edge, other = st[:, 1] - st[:, 0], st[:, 2] - st[:, 0]
    signed = 0.5 * (edge[:, 0] * other[:, 1] - edge[:, 1] * other[:, 0])
    assert (signed > 0).all()
    assert signed.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["quad", "cylinder"])
def test_texture_is_undistorted(name):
    place = locate(primitive(name, 1.5), (0.45, 0.55), (0.4, 0.6))
    assert place.height == pytest.approx(0.2)
    assert place.width == pytest.approx(0.15, rel=1e-3)


@pytest.mark.parametrize("name", PRIMITIVES)
def test_middle_of_the_texture_faces_the_viewer(name):
    place = locate(primitive(name, 1.5), (0.499, 0.501), (0.499, 0.501))
    np.testing.assert_allclose(place.normal, (0, 0, 1), atol=0.03)
    np.testing.assert_allclose(place.up, (0, 1, 0), atol=0.03)


def project(pose, points, aspect):
    """Points on the picture, -1 to 1 in both directions, of the cameras that stages get."""
    view = np.array(pose[1].GetInverse())
    seen = np.column_stack([points, np.ones(len(points))]) @ view
    assert (seen[:, 2] < 0).all()
    x = seen[:, 0] / -seen[:, 2] * (2 * FOCAL / APERTURE)
    y = seen[:, 1] / -seen[:, 2] * (2 * FOCAL / (APERTURE / aspect))
    return np.column_stack([x, y])


def test_overview_shows_the_quad_to_its_edges_and_detail_is_filled_by_the_patch():
    surface = primitive("quad", 1.6)
    st = np.array([[0.30, 0.70], [0.34, 0.70], [0.34, 0.66], [0.30, 0.66]])
    cameras = camera_poses(surface, st, 1.6, (1, 48))
    np.testing.assert_allclose(np.abs(project(cameras["Overview"][0], surface.points, 1.6)), 1.0, atol=1e-9)
    patch = np.column_stack([(st[:, 0] - 0.5) * 1.6, st[:, 1] - 0.5, np.zeros(4)])
    seen = np.abs(project(cameras["Detail"][0], patch, 1.6))
    assert seen.min() == pytest.approx(1.0)


def test_zoom_goes_from_overview_to_detail_by_a_constant_factor_with_the_target_in_view():
    surface = primitive("quad", 1.6)
    st = np.array([[0.30, 0.70], [0.301, 0.70], [0.301, 0.699], [0.30, 0.699]])
    cameras = camera_poses(surface, st, 1.6, (1, 48))
    zoom = cameras["Zoom"]
    assert [pose[0] for pose in zoom] == list(range(1, 49))
    for end, name in ((zoom[0], "Overview"), (zoom[-1], "Detail")):
        np.testing.assert_allclose(np.array(end[1]), np.array(cameras[name][0][1]), atol=1e-12)
    distances = np.array([pose[2] for pose in zoom])
    np.testing.assert_allclose(distances[1:] / distances[:-1], distances[1] / distances[0], rtol=1e-9)
    target = np.array([[(0.3005 - 0.5) * 1.6, 0.6995 - 0.5, 0.0]])
    places = np.array([project(pose, target, 1.6)[0] for pose in zoom])
    assert (np.abs(places) < 1.0).all()
    assert (np.diff(np.linalg.norm(places, axis=1)) < 1e-9).all()


def test_solo_root_has_a_detail_too():
    cameras = camera_poses(primitive("sphere", 1.0), None, 1.0, (1, 48))
    assert cameras["Detail"][0][2] < cameras["Overview"][0][2]


def test_usd_mesh_is_read_with_its_transform_and_vertex_st(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "m.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    root = UsdGeom.Xform.Define(stage, "/M")
    root.AddTranslateOp().Set(Gf.Vec3d(0, 0, 5))
    stage.SetDefaultPrim(root.GetPrim())
    mesh = UsdGeom.Mesh.Define(stage, "/M/Quad")
    mesh.CreatePointsAttr([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    primvar.Set(Vt.Vec2fArray([(0, 0), (1, 0), (1, 1), (0, 1)]))
    stage.Save()
    surface = load_surface(tmp_path / "m.usda")
    assert (surface.up_axis, surface.meters_per_unit) == ("Z", 0.01)
    place = locate(surface, (0.0, 0.5), (0.5, 1.0))
    np.testing.assert_allclose(place.center, (0.5, 0.75, 5.0), atol=1e-6)
    assert (place.width, place.height) == (pytest.approx(1.0), pytest.approx(0.5))
    primvar.GetAttr().Block()
    stage.Save()
    with pytest.raises(FexelError, match="fexel unwrap"):
        load_surface(tmp_path / "m.usda")


def test_mesh_files_without_texture_coordinates_or_triangles_are_refused(tmp_path):
    (tmp_path / "bare.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(FexelError, match="fexel unwrap"):
        load_surface(tmp_path / "bare.obj")
    (tmp_path / "broken.glb").write_bytes(b"glTF nonsense")
    with pytest.raises(FexelError, match=r"broken\.glb"):
        load_surface(tmp_path / "broken.glb")
    with pytest.raises(FexelError, match="no such file"):
        load_surface(tmp_path / "gone.obj")
    (tmp_path / "uv.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
    assert load_surface(tmp_path / "uv.obj").st.shape == (1, 3, 2)


def test_unknown_primitive_lists_the_valid_ones():
    with pytest.raises(FexelError, match="'teacup' is unknown, expected one of quad, sphere, cylinder"):
        primitive("teacup", 1.0)
