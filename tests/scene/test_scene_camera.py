"""Cameras: projection of known points, names, aspect, framing; lights."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdLux

from fexel.errors import FexelError
from fexel.scene import SceneReader, image_height, list_cameras


def project(camera, point):
    """World point to normalised device coordinates, float64."""
    clip = np.array([*point, 1.0]) @ camera.world_to_camera @ camera.camera_to_clip
    return clip[:3] / clip[3]


def define_camera(stage, path="/Cam", **attributes):
    camera = UsdGeom.Camera.Define(stage, path)
    for name, value in attributes.items():
        camera.GetPrim().GetAttribute(name).Set(value)
    return camera


def test_known_points_land_where_lens_and_aperture_put_them(stage):
    define_camera(stage, horizontalAperture=36, verticalAperture=24, focalLength=50, clippingRange=(1, 100))
    camera = SceneReader(stage).at().camera
    assert camera.aspect == 1.5
    np.testing.assert_allclose(project(camera, (0, 0, -1)), (0, 0, -1), atol=1e-12)
    np.testing.assert_allclose(project(camera, (0, 0, -100)), (0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(project(camera, (18, 12, -50))[:2], (1, 1), atol=1e-12)
    np.testing.assert_allclose(project(camera, (-9, 6, -50))[:2], (-0.5, 0.5), atol=1e-12)


def test_aperture_offset_moves_the_window_to_the_right_and_up(stage):
    """A point seen through the middle of the shifted window lies at the offset's angle."""
    define_camera(
        stage, horizontalAperture=20, verticalAperture=10, focalLength=50,
        horizontalApertureOffset=4, verticalApertureOffset=2,
    )  # fmt: skip
    camera = SceneReader(stage).at().camera
    np.testing.assert_allclose(project(camera, (4, 2, -50))[:2], (0, 0), atol=1e-12)
    np.testing.assert_allclose(project(camera, (14, 7, -50))[:2], (1, 1), atol=1e-12)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_matrices_agree_with_gf_camera(stage, projection, rng):
    schema = define_camera(
        stage, projection=projection, horizontalAperture=21, verticalAperture=15, focalLength=35,
        horizontalApertureOffset=1.5, verticalApertureOffset=-0.7, clippingRange=(0.5, 200),
    )  # fmt: skip
    schema.AddTranslateOp().Set((3, -2, 7))
    schema.AddRotateXYZOp().Set((20, -35, 110))
    camera = SceneReader(stage).at().camera
    frustum = schema.GetCamera(Usd.TimeCode.Default()).frustum
    expected = np.array(frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix())
    np.testing.assert_allclose(camera.world_to_camera @ camera.camera_to_clip, expected, atol=1e-6)


def test_orthographic_window_is_a_tenth_of_the_aperture(stage):
    define_camera(stage, projection="orthographic", horizontalAperture=40, verticalAperture=20)
    camera = SceneReader(stage).at().camera
    np.testing.assert_allclose(project(camera, (2, 1, -5))[:2], (1, 1), atol=1e-12)


def test_picture_s_aspect_keeps_the_horizontal_aperture(stage):
    define_camera(stage, horizontalAperture=36, verticalAperture=24, focalLength=50)
    camera = SceneReader(stage).at(aspect=3.0).camera
    assert camera.aspect == 3.0
    np.testing.assert_allclose(project(camera, (18, 6, -50))[:2], (1, 1), atol=1e-12)


def test_image_height_is_that_of_usdrecord(stage):
    define_camera(stage)
    assert image_height(960, SceneReader(stage).at().camera.aspect) == 700
    assert image_height(1024, 1.5) == 682
    assert image_height(1, 100.0) == 1


def test_camera_ten_to_the_minus_seven_from_a_wall_keeps_its_place(stage):
    """Far from the origin, float32 could not tell the camera from the wall."""
    camera = define_camera(stage, clippingRange=(1e-9, 1), horizontalAperture=50, focalLength=50)
    camera.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set((1000, 0, 1e-7))
    got = SceneReader(stage).at(aspect=1.0).camera
    np.testing.assert_allclose(project(got, (1000 + 0.25e-7, 0, 0))[0], 0.5, rtol=1e-5)


def test_clipping_planes_are_given_in_world_space(stage):
    camera = define_camera(stage, clippingPlanes=[(1, 0, 0, -2), (0, 0, -1, -3)])
    camera.AddTranslateOp().Set((10, 0, 0))
    camera.AddRotateYOp().Set(90)  # looks along -x
    planes = np.array(SceneReader(stage).at().camera.clipping_planes)
    for inside, point in ((1, (5, 0, -3)), (-1, (5, 0, 0)), (1, (6, 0, -5)), (-1, (8, 0, -5))):
        assert np.sign(min(planes @ (*point, 1.0))) == inside


def test_animated_camera(stage):
    camera = define_camera(stage)
    translate = camera.AddTranslateOp()
    translate.Set((0, 0, 0), 0.0)
    translate.Set((8, 0, 0), 8.0)
    camera.GetFocalLengthAttr().Set(50.0, 0.0)
    camera.GetFocalLengthAttr().Set(100.0, 8.0)
    reader = SceneReader(stage)
    views = [reader.at(t).camera for t in (0.0, 4.0, 8.0)]
    assert [-v.world_to_camera[3, 0] for v in views] == [0, 4, 8]
    assert views[2].camera_to_clip[0, 0] == pytest.approx(2 * views[0].camera_to_clip[0, 0])


@pytest.mark.parametrize(
    ("attributes", "words"),
    [
        ({"focalLength": 0.0}, "/Cam.focalLength: 0.0, expected a number above 0"),
        ({"horizontalAperture": float("nan")}, "/Cam.horizontalAperture"),
    ],
)
def test_camera_without_a_picture_is_an_error(stage, attributes, words):
    define_camera(stage, **attributes)
    with pytest.raises(FexelError, match=words):
        SceneReader(stage).at()


def test_singular_camera_transform_is_an_error(stage):
    define_camera(stage).AddScaleOp().Set((1, 0, 1))
    with pytest.raises(FexelError, match="/Cam: the camera's transform is singular"):
        SceneReader(stage).at()


def test_unusable_clipping_range_warns_and_becomes_the_default(stage, read):
    define_camera(stage, clippingRange=(0.0, -5.0))
    scene, warned = read(stage)
    assert (scene.camera.near, scene.camera.far) == (1.0, 1e6)
    assert len(warned) == 1 and warned[0].startswith("/Cam.clippingRange: ")


def test_cameras_are_found_by_path_name_and_end_of_path(stage):
    define_camera(stage, "/World/Cameras/Detail")
    define_camera(stage, "/World/Cameras/Wide")
    define_camera(stage, "/Other/Wide")
    reader = SceneReader(stage)
    assert list_cameras(stage) == reader.cameras() == ("/World/Cameras/Detail", "/World/Cameras/Wide", "/Other/Wide")
    assert reader.camera_at(camera="Detail").path == "/World/Cameras/Detail"
    assert reader.camera_at(camera="/Other/Wide").path == "/Other/Wide"
    assert reader.camera_at(camera="Cameras/Wide").path == "/World/Cameras/Wide"
    assert reader.camera_at().path == "/World/Cameras/Detail"
    define_camera(stage, "/Last/main_cam")
    assert SceneReader(stage).camera_at().path == "/Last/main_cam"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Close", "no camera 'Close'.*/A/Wide, /B/Wide"),
        ("/A/Absent", "no camera '/A/Absent'.*/A/Wide, /B/Wide"),
        ("Wide", "'Wide' is ambiguous: /A/Wide, /B/Wide"),
        ("/A", "/A is a Xform, not a Camera.*/A/Wide, /B/Wide"),
        ("<bad path>", "no camera '<bad path>'"),
    ],
)
def test_unknown_camera_is_an_error_that_lists_those_there_are(stage, name, words):
    UsdGeom.Xform.Define(stage, "/A")
    define_camera(stage, "/A/Wide")
    define_camera(stage, "/B/Wide")
    with pytest.raises(FexelError, match=words) as error:
        SceneReader(stage).at(camera=name)
    assert "\n" not in str(error.value)


def test_stage_without_cameras_says_so(stage):
    with pytest.raises(FexelError, match="the stage has no camera"):
        SceneReader(stage).at(camera="Any")


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("size", [(1, 1, 1), (10, 0.1, 1), (0.1, 10, 1), (0.1, 1, 10), (1e-4, 1e-4, 0)])
@pytest.mark.parametrize("aspect", [None, 0.5, 3.0])
def test_framing_camera_sees_all_of_the_default_prim(stage, define_mesh, up_axis, size, aspect):
    UsdGeom.SetStageUpAxis(stage, up_axis)
    w, h, d = size if up_axis == "Y" else (size[0], size[2], size[1])
    corners = [(5 + x * w, 6 + y * h, 7 + z * d) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    faces = (0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3)
    define_mesh(stage, "/Root/M", corners, (4,) * 6, faces)
    define_mesh(stage, "/Elsewhere").AddTranslateOp().Set((1e5, 0, 0))
    stage.SetDefaultPrim(stage.GetPrimAtPath("/Root"))
    scene = SceneReader(stage).at(aspect=aspect)
    seen = np.array([project(scene.camera, p) for p in corners])
    assert np.abs(seen).max() <= 1 + 1e-6
    assert np.abs(seen[:, :2]).max() > 0.15  # and not from afar
    up = scene.camera.world_to_camera[1 if up_axis == "Y" else 2, 1]
    assert up == pytest.approx(1.0)
    assert len(scene.draws) == 2


def test_framing_camera_stands_where_usdrecord_s_does(stage, define_mesh):
    """UsdAppUtils: half the diagonal of the front over the tangent of half the field of view, plus half the depth."""
    define_mesh(stage, "/M", [(-2, -1, 0), (2, -1, 0), (2, 1, 0), (-2, 1, 3)])
    camera = SceneReader(stage).at().camera
    lens = Gf.Camera()
    distance = np.hypot(2, 1) / np.tan(np.radians(lens.GetFieldOfView(Gf.Camera.FOVHorizontal) / 2)) + 1.5
    np.testing.assert_allclose(np.linalg.inv(camera.world_to_camera)[3, :3], (0, 0, 1.5 + distance), rtol=1e-5)


def test_stage_without_anything_still_has_a_camera(stage):
    scene = SceneReader(stage).at()
    assert scene.camera.path == "" and np.isfinite(scene.camera.camera_to_clip).all()


def test_light_colour_has_intensity_exposure_and_temperature_in_it(stage):
    light = UsdLux.DistantLight.Define(stage, "/L")
    light.CreateIntensityAttr(3.0)
    light.CreateExposureAttr(2.0)
    light.CreateColorAttr((1.0, 0.5, 0.25))
    light.CreateAngleAttr(1.5)
    light.AddRotateXOp().Set(-90)
    light.CreateDiffuseAttr(0.5)
    light.CreateNormalizeAttr(True)
    (got,) = SceneReader(stage).at().lights
    assert (got.kind, got.color, got.angle, got.diffuse, got.normalize) == ("distant", (12.0, 6.0, 3.0), 1.5, 0.5, True)
    np.testing.assert_allclose(np.array([0, 0, -1, 0]) @ got.light_to_world, (0, -1, 0, 0), atol=1e-12)
    light.CreateEnableColorTemperatureAttr(True)
    light.CreateColorTemperatureAttr(3000.0)
    warm = np.array(SceneReader(stage).at().lights[0].color) / got.color
    np.testing.assert_allclose(warm, UsdLux.BlackbodyTemperatureAsRgb(3000.0), rtol=1e-6)


def test_sphere_and_dome_lights(stage, tmp_path, read):
    sphere = UsdLux.SphereLight.Define(stage, "/S")
    sphere.CreateRadiusAttr(0.25)
    sphere.AddTranslateOp().Set((1, 2, 3))
    (tmp_path / "sky.exr").write_bytes(b"")
    UsdLux.DomeLight.Define(stage, "/D").CreateTextureFileAttr(str(tmp_path / "sky.exr"))
    UsdLux.DomeLight_1.Define(stage, "/D1").CreateTextureFileAttr(str(tmp_path / "absent.exr"))
    scene, warned = read(stage)
    lights = {light.path: light for light in scene.lights}
    assert lights["/S"].radius == 0.25 and tuple(lights["/S"].light_to_world[3, :3]) == (1, 2, 3)
    assert lights["/D"].kind == "dome" and lights["/D"].texture_file == str(tmp_path / "sky.exr")
    assert lights["/D1"].texture_file == ""
    assert len(warned) == 1 and "absent.exr" in warned[0]


def test_dome_light_1_stands_upright_on_a_z_up_stage(stage):
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdLux.DomeLight_1.Define(stage, "/Scene")
    UsdLux.DomeLight_1.Define(stage, "/Y").GetPrim().GetAttribute("poleAxis").Set("Y")
    poles = {x.path: np.array([0, 1, 0, 0]) @ x.light_to_world for x in SceneReader(stage).at().lights}
    np.testing.assert_allclose(poles["/Scene"], (0, 0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(poles["/Y"], (0, 1, 0, 0), atol=1e-12)


def test_other_lights_and_hidden_lights(stage, read):
    for name in ("RectLight", "DiskLight", "CylinderLight"):
        stage.DefinePrim(f"/{name}", name)
    UsdLux.SphereLight.Define(stage, "/Hidden").MakeInvisible()
    bad = UsdLux.SphereLight.Define(stage, "/Bad")
    bad.CreateColorAttr((float("nan"), 1, 1))
    scene, warned = read(stage)
    assert [light.color for light in scene.lights] == [(0, 0, 0)]
    assert len(warned) == 4


def test_lights_that_do_not_vary_are_the_same_object(stage):
    UsdLux.SphereLight.Define(stage, "/Still")
    dimmed = UsdLux.SphereLight.Define(stage, "/Dimmed").CreateIntensityAttr()
    moving = UsdLux.SphereLight.Define(stage, "/Moving").AddTranslateOp()
    for time in (0.0, 2.0):
        dimmed.Set(time, time)
        moving.Set((time, 0, 0), time)
    reader = SceneReader(stage)
    a, b = reader.at(0.0).lights, reader.at(1.0).lights
    assert a[0] is b[0]
    assert (a[1].color[0], b[1].color[0]) == (0.0, 1.0)
    assert (a[2].light_to_world[3, 0], b[2].light_to_world[3, 0]) == (0.0, 1.0)
