"""Implicit shapes: on the surface, closed, normals outward, texture the right way round."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import UsdGeom

_SHAPES = {
    "Sphere": {"radius": 2.0},
    "Cube": {"size": 3.0},
    "Cylinder": {"radius": 1.0, "height": 4.0},
    "Cone": {"radius": 1.0, "height": 3.0},
    "Capsule": {"radius": 0.5, "height": 2.0},
    "Cylinder_1": {"radiusTop": 0.5, "radiusBottom": 1.5, "height": 2.0},
    "Capsule_1": {"radiusTop": 0.5, "radiusBottom": 1.0, "height": 2.0},
}
_VOLUMES = {
    "Sphere": 4 / 3 * np.pi * 8,
    "Cube": 27.0,
    "Cylinder": 4 * np.pi,
    "Cone": np.pi,
    "Capsule": np.pi * 0.25 * 2 + 4 / 3 * np.pi * 0.125,
    "Cylinder_1": np.pi * 2 / 3 * (0.25 + 0.75 + 2.25),
    "Capsule_1": np.pi * 2 / 3 * (0.25 + 0.5 + 1.0),  # the frustum; see below for its ends
}


def spherical_cap(radius, height):
    return np.pi * height**2 * (3 * radius - height) / 3


# Spheres that touch the frustum's cone where it ends: slope 1/4, radii times sqrt(1 + 1/16).
_SPHERE = np.hypot(1, 0.25)
_VOLUMES["Capsule_1"] += spherical_cap(_SPHERE, _SPHERE + 0.25) + spherical_cap(0.5 * _SPHERE, 0.5 * (_SPHERE - 0.25))


def define(stage, name, **attributes):
    prim = stage.DefinePrim(f"/{name}", name)
    for key, value in attributes.items():
        prim.GetAttribute(key).Set(value)
    return prim


def corners(mesh):
    return (mesh.points[mesh.triangles[:, k]] for k in range(3))


@pytest.mark.parametrize("name", _SHAPES)
@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
def test_volume_is_the_shape_s_and_faces_look_outward(stage, read, name, axis):
    """Divergence theorem: signed volume of the tetrahedra to the origin; positive when faces look outward."""
    prim = define(stage, name, **_SHAPES[name])
    if prim.HasAttribute("axis"):
        prim.GetAttribute("axis").Set(axis)
    mesh = read(stage)[0].draws[0].mesh
    a, b, c = corners(mesh)
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 == pytest.approx(_VOLUMES[name], rel=0.01)
    face_normals = np.cross(b - a, c - a)
    for k in range(3):
        assert (np.einsum("ij,ij->i", mesh.normals[mesh.triangles[:, k]], face_normals) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-6)
    assert mesh.st["st"].min() >= 0 and mesh.st["st"].max() <= 1


@pytest.mark.parametrize("name", [*_SHAPES, "Plane"])
@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
def test_extent_is_what_usd_computes(stage, read, name, axis):
    prim = define(stage, name, **_SHAPES.get(name, {"width": 2.0, "length": 6.0}))
    if prim.HasAttribute("axis"):
        prim.GetAttribute("axis").Set(axis)
    mesh = read(stage)[0].draws[0].mesh
    extent = np.array(UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(prim), 0))
    np.testing.assert_allclose([mesh.points.min(axis=0), mesh.points.max(axis=0)], extent, atol=2e-3)


def test_sphere_s_points_and_normals_are_exact(stage, read):
    define(stage, "Sphere", radius=2.0)
    mesh = read(stage)[0].draws[0].mesh
    np.testing.assert_allclose(np.linalg.norm(mesh.points, axis=1), 2.0)
    np.testing.assert_allclose(mesh.normals, mesh.points / 2, atol=1e-6)


@pytest.mark.parametrize("name", ["Sphere", "Cube", "Cylinder", "Cone", "Capsule", "Plane"])
def test_images_read_the_right_way_round_from_outside(stage, read, name):
    """d(st) has the orientation of the face: no mirrored texture anywhere on sides and fronts."""
    define(stage, name)
    mesh = read(stage)[0].draws[0].mesh
    st = mesh.st["st"][mesh.triangles]
    turn = np.linalg.det(np.diff(st, axis=1))
    assert (turn > -1e-12).all()


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
def test_plane_faces_along_its_axis(stage, read, axis):
    define(stage, "Plane", axis=axis, width=2.0, length=4.0)
    mesh = read(stage)[0].draws[0].mesh
    np.testing.assert_array_equal(np.unique(mesh.normals, axis=0), [np.eye(3)["XYZ".index(axis)]])


def test_left_handed_shape_is_inside_out(stage, read):
    define(stage, "Sphere", orientation="leftHanded")
    mesh = read(stage)[0].draws[0].mesh
    a, b, c = corners(mesh)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0).all()
    assert (np.einsum("ij,ij->i", mesh.normals.astype(float), mesh.points) < 0).all()


def test_display_colour_time_samples_and_bad_sizes(stage, read):
    prim = define(stage, "Sphere")
    UsdGeom.Sphere(prim).CreateDisplayColorAttr([(1, 0.5, 0)])
    prim.GetAttribute("radius").Set(1.0, 0.0)
    prim.GetAttribute("radius").Set(3.0, 2.0)
    define(stage, "Cube", size=float("nan"))
    define(stage, "Cone", height=-1.0)
    scene, warned = read(stage, time=1.0)
    assert scene.draws[0].mesh.points.max() == pytest.approx(2.0)
    np.testing.assert_array_equal(scene.draws[0].mesh.display_color[0], (1, 0.5, 0))
    assert len(scene.draws) == 1
    assert sorted(w.split(":")[0] for w in warned) == ["/Cone.height", "/Cube.size"]
