"""Shading and lights against radiometry: Lambert, UsdLux units, furnaces, energy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import camera, draw, light, quad, scene, settings, sphere, translation

from fexel.errors import FexelWarning
from fexel.renderer.brdf_table import ggx_albedo
from fexel.renderer.environment import dome_irradiance, dome_radiance, latlong_directions
from fexel.renderer.frame import FrameSettings
from fexel.scene.model import Mesh

# The specular workflow with specularColor 0 has no specular: pure Lambert.
LAMBERT = {"useSpecularWorkflow": 1.0, "diffuseColor": (0.6, 0.3, 0.1)}
ALBEDO = np.array([0.6, 0.3, 0.1])


def facing(renderer, *lights, size=2, mesh=None, **material):
    """Colour (3,) of the middle of a quad that faces +z and the camera."""
    shown = scene(draw(mesh or quad(0.5), **material), lights=lights, view=camera(half_height=0.001))
    return renderer.draw(shown, settings(size, size, samples=1))["color"][0, 0, :3]


def towards_z(degrees: float = 0.0) -> np.ndarray:
    """A light that shines along -z, turned about y: it stands at `degrees` from +z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.eye(4)
    matrix[:3, :3] = [[c, 0, -s], [0, 1, 0], [s, 0, c]]
    return matrix


@pytest.mark.parametrize("degrees", [0, 30, 60, 85])
def test_normalized_distant_light_gives_its_colour_as_irradiance(renderer, degrees):
    lit = facing(renderer, light("distant", (2, 1, 0.5), towards_z(degrees), angle=0.5, normalize=True), **LAMBERT)
    expected = ALBEDO / np.pi * [2, 1, 0.5] * np.cos(np.radians(degrees))
    np.testing.assert_allclose(lit, expected, rtol=1e-3)


def test_distant_light_of_an_angle_is_a_cone_of_that_radiance(renderer):
    for angle in (2.0, 30.0, 90.0):
        lit = facing(renderer, light("distant", matrix=towards_z(), angle=angle), **LAMBERT)
        np.testing.assert_allclose(lit, ALBEDO * np.sin(np.radians(angle / 2)) ** 2, rtol=1e-3)


def test_distant_light_without_angle_is_taken_as_normalized(renderer):
    lit = facing(renderer, light("distant", matrix=towards_z(), angle=0.0), **LAMBERT)
    np.testing.assert_allclose(lit, ALBEDO / np.pi, rtol=1e-3)


def cone_irradiance(cosine: float, sine: float) -> float:
    """Irradiance over pi of a cone of unit radiance, by quadrature over directions."""
    n = 600
    cos_angle = np.sqrt(1 - sine**2)
    z = 1 - (np.arange(n) + 0.5) / n * (1 - cos_angle)
    phi = (np.arange(n) + 0.5) / n * 2 * np.pi
    z, phi = np.meshgrid(z, phi)
    tilt = np.sqrt(1 - cosine**2)
    return float(np.maximum(np.sqrt(1 - z * z) * np.cos(phi) * tilt + z * cosine, 0).mean() * 2 * (1 - cos_angle))


@pytest.mark.parametrize(("degrees", "sine"), [(0, 0.3), (60, 0.3), (80, 0.3), (95, 0.3), (100, 0.7), (60, 0.95)])
def test_sphere_light_sinks_below_the_horizon_as_it_should(renderer, degrees, sine):
    distance = 3.0
    place = translation(distance * np.sin(np.radians(degrees)), 0, distance * np.cos(np.radians(degrees)))
    lit = facing(renderer, light("sphere", matrix=place, radius=sine * distance), **LAMBERT)
    np.testing.assert_allclose(lit, ALBEDO * cone_irradiance(np.cos(np.radians(degrees)), sine), rtol=5e-3, atol=1e-5)


def test_normalized_sphere_light_does_not_depend_on_its_radius(renderer):
    for radius in (0.0, 0.01, 0.5):
        lit = facing(
            renderer, light("sphere", (8, 8, 8), translation(0, 0, 2), radius=radius, normalize=True), **LAMBERT
        )
        # Radiance colour / (4 pi r^2), irradiance pi r^2 / d^2 times that.
        np.testing.assert_allclose(lit, ALBEDO / np.pi * 8 / (4 * 4), rtol=1e-3)


def test_light_multipliers_split_diffuse_and_specular(renderer):
    place = towards_z()
    glossy = {"diffuseColor": (0.5, 0.5, 0.5), "roughness": 0.4}
    both = facing(renderer, light("distant", matrix=place, normalize=True), **glossy)
    diffuse = facing(renderer, light("distant", matrix=place, normalize=True, specular=0.0), **glossy)
    specular = facing(renderer, light("distant", matrix=place, normalize=True, diffuse=0.0), **glossy)
    np.testing.assert_allclose(diffuse + specular, both, rtol=1e-5)
    assert diffuse[0] > 0 and specular[0] > 0


@pytest.mark.parametrize(
    "material",
    [
        {"diffuseColor": (1.0, 1.0, 1.0), "useSpecularWorkflow": 1.0},
        *({"diffuseColor": (1.0, 1.0, 1.0), "roughness": r} for r in (0.0, 0.3, 0.6, 1.0)),
        *({"diffuseColor": (1.0, 1.0, 1.0), "metallic": 1.0, "roughness": r} for r in (0.0, 0.3, 0.6, 1.0)),
        {"diffuseColor": (1.0, 1.0, 1.0), "clearcoat": 1.0, "clearcoatRoughness": 0.3, "roughness": 0.5},
    ],
)
def test_white_furnace_a_white_surface_vanishes_in_a_white_dome(renderer, material):
    shown = scene(
        draw(sphere(rings=64), **material), lights=[light("dome", (0.7, 0.7, 0.7))], view=camera(half_height=0.3)
    )
    images = renderer.draw(shown, settings(48, 48, "color", "alpha", samples=1))
    inside = images["alpha"][..., 0] == 1
    np.testing.assert_allclose(images["color"][inside][:, :3], 0.7, atol=3e-3)


@pytest.mark.parametrize("roughness", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("metallic", [0.0, 1.0])
@pytest.mark.parametrize("sine", [0.0, 0.9])
def test_a_white_surface_reflects_all_it_receives_from_single_directions(renderer, roughness, metallic, sine):
    """The lobe of the shader, summed over light directions for one view, is white: it fits the table of albedos."""
    view = camera(half_height=0.01, orthographic=True)
    cosine = np.sqrt(1 - sine**2)
    turn = np.eye(4)
    turn[:3, :3] = [[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]]
    view = replace(view, world_to_camera=turn @ view.world_to_camera)
    white = draw(quad(0.5), diffuseColor=(1.0, 1.0, 1.0), roughness=roughness, metallic=metallic)
    n = 64
    total = 0.0
    for theta in (np.arange(n) + 0.5) / n * np.pi / 2:
        ring = []
        for phi in (np.arange(n) + 0.5) / n * 2 * np.pi:
            matrix = np.eye(4)
            matrix[2, :3] = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
            ring.append(light("distant", np.full(3, np.sin(theta)), matrix, angle=0.0))
        total += renderer.draw(scene(white, lights=ring, view=view), settings(1, 1, samples=1))["color"][0, 0, 0]
    assert total * np.pi**2 / n**2 == pytest.approx(1.0, abs=0.03)


def test_albedo_table_is_the_integral_of_the_shaders_lobe():
    table = ggx_albedo().astype(float)
    assert np.all(table >= 0) and np.all(table.sum(-1) <= 1 + 1e-6)
    # Roughness 1 at normal incidence has a closed form: 1 - ln 2.
    assert table[-1, -1].sum() == pytest.approx(1 - np.log(2), abs=2e-3)
    assert table[0, -1, 1] == pytest.approx(0.0, abs=1e-4) and table[0, -1, 0] == pytest.approx(1.0, abs=1e-3)


def test_headlight_lights_a_facing_white_surface_to_its_albedo(renderer):
    shown = scene(draw(quad(0.5), **LAMBERT), view=camera(half_height=0.001))
    lit = renderer.draw(shown, settings(2, 2, camera_light=True, samples=1))["color"][0, 0, :3]
    np.testing.assert_allclose(lit, ALBEDO, rtol=1e-3)


def test_headlight_is_off_when_the_stage_has_lights_even_dark_ones(renderer):
    for lamp in (light("distant", (0, 0, 0)), light("dome", (0, 0, 0))):
        shown = scene(draw(quad(0.5), **LAMBERT), lights=[lamp])
        assert not renderer.draw(shown, settings(2, 2, camera_light=True))["color"][..., :3].any()


def test_lights_add_up(renderer):
    lamps = [light("distant", (i, 1, 0), towards_z(10.0 * i), normalize=True) for i in range(1, 5)]
    lamps += [light("sphere", (3, 0, 1), translation(1, 1, 2)), light("dome", (0.1, 0.2, 0.3))]
    glossy = {"diffuseColor": (0.5, 0.4, 0.3), "roughness": 0.5}
    together = facing(renderer, *lamps, **glossy)
    np.testing.assert_allclose(together, sum(facing(renderer, lamp, **glossy) for lamp in lamps), rtol=1e-4)


def test_more_lights_than_fit_warn_and_render(renderer):
    lamps = [light("distant", (0.01, 0.01, 0.01), towards_z(), normalize=True)] * 70
    with pytest.warns(FexelWarning, match="70 lights, at most 64"):
        lit = facing(renderer, *lamps, **LAMBERT)
    np.testing.assert_allclose(lit, ALBEDO / np.pi * 0.64, rtol=1e-3)


def test_occlusion_dims_the_dome_alone(renderer):
    lamp = light("distant", matrix=towards_z(), normalize=True)
    dome = light("dome")
    np.testing.assert_allclose(facing(renderer, dome, occlusion=0.25, **LAMBERT), 0.25 * ALBEDO, rtol=1e-3)
    assert np.array_equal(facing(renderer, lamp, occlusion=0.25, **LAMBERT), facing(renderer, lamp, **LAMBERT))


def test_opacity_scales_diffuse_and_emission_not_specular(renderer):
    lamp = light("distant", matrix=towards_z(), normalize=True)
    base = {"diffuseColor": (0.0, 0.0, 0.0), "roughness": 0.5}
    solid, clear = facing(renderer, lamp, **base), facing(renderer, lamp, opacity=0.2, **base)
    np.testing.assert_allclose(clear, solid, rtol=1e-5)
    np.testing.assert_allclose(facing(renderer, lamp, opacity=0.2, **LAMBERT), 0.2 * ALBEDO / np.pi, rtol=1e-3)


def test_ior_sets_the_reflectance_at_normal_incidence(renderer):
    # A perfectly facing mirror of a white dome: F0 at roughness 0.
    for ior in (1.0, 1.5, 2.0):
        lit = facing(renderer, light("dome"), diffuseColor=(0.0, 0.0, 0.0), roughness=0.0, ior=ior)
        assert lit[0] == pytest.approx(((1 - ior) / (1 + ior)) ** 2, abs=2e-3)


# --- Dome images ------------------------------------------------------------------------------------------------------


def write_latlong(path, image):
    import OpenImageIO as oiio

    spec = oiio.ImageSpec(image.shape[1], image.shape[0], 3, "float")
    writer = oiio.ImageOutput.create(str(path))
    assert (
        writer.open(str(path), spec) and writer.write_image(np.ascontiguousarray(image, np.float32)) and writer.close()
    )
    return str(path)


AXES = {"+x": (1, 0, 0), "-x": (-1, 0, 0), "+y": (0, 1, 0), "-y": (0, -1, 0), "+z": (0, 0, 1), "-z": (0, 0, -1)}


def axis_image(height=64):
    """Direction as colour, 0.5 + 0.5 d."""
    return 0.5 + 0.5 * latlong_directions(height)


def test_dome_image_is_oriented_as_openexr_says(tmp_path):
    dome = light("dome", texture_file=write_latlong(tmp_path / "axes.exr", axis_image()))
    radiance = dome_radiance([dome], "diffuse")
    np.testing.assert_allclose(radiance, axis_image(256), atol=0.02)
    # +y in the first row, +z in the middle column, +x a quarter from the left.
    assert radiance[0, 0, 1] > 0.98 and radiance[128, 256, 2] > 0.98 and radiance[128, 128, 0] > 0.98


@pytest.mark.parametrize("axis", AXES)
def test_mirror_shows_the_dome_in_the_mirror_direction(renderer, tmp_path, axis):
    """A small perfect mirror, facing the camera from each side, reflects what is behind the camera."""
    direction = np.array(AXES[axis], float)
    up = np.array([0, 0, 1.0]) if abs(direction[1]) > 0.5 else np.array([0, 1.0, 0])
    right = np.cross(up, direction)
    turn = np.eye(4)
    turn[:3, :3] = np.stack([right, up, direction])  # the quad's +z becomes `direction`
    view = camera(half_height=0.001)
    view = replace(view, world_to_camera=np.linalg.inv(turn) @ view.world_to_camera)
    dome = light("dome", texture_file=write_latlong(tmp_path / "axes.exr", axis_image()))
    mirror = draw(quad(0.5), turn, diffuseColor=(1.0, 1.0, 1.0), metallic=1.0, roughness=0.0)
    seen = renderer.draw(scene(mirror, lights=[dome], view=view), settings(1, 1, samples=1))["color"][0, 0, :3]
    np.testing.assert_allclose(seen, 0.5 + 0.5 * direction, atol=0.03)


def test_rotating_the_dome_rotates_its_light(renderer, tmp_path):
    file = write_latlong(tmp_path / "axes.exr", axis_image())
    turned = np.eye(4)
    turned[:3, :3] = [[0, 0, -1], [0, 1, 0], [1, 0, 0]]  # local +z to world +x
    radiance = dome_radiance([light("dome", texture_file=file, matrix=turned)], "diffuse")
    np.testing.assert_allclose(radiance[128, 128], [0.5, 0.5, 1.0], atol=0.02)  # world +x shows the image's +z


def test_irradiance_of_a_bright_half_space_is_analytic():
    directions = latlong_directions(256)
    half = np.repeat((directions[..., 1:2] > 0).astype(np.float32), 3, axis=-1)
    irradiance = dome_irradiance(half)
    normals = latlong_directions(32)
    # Half of a half space of unit radiance: (1 + cos) / 2.
    np.testing.assert_allclose(irradiance[..., 0], (1 + normals[..., 1]) / 2, atol=5e-3)


def test_rougher_mirrors_blur_the_dome_without_losing_light(renderer, tmp_path):
    sun = np.full((128, 256, 3), 0.1)
    sun[60:68, 124:132] = 50.0
    dome = light("dome", texture_file=write_latlong(tmp_path / "sun.exr", sun))
    mean = (sun * np.cos((0.5 - (np.arange(128) + 0.5) / 128) * np.pi)[:, None, None]).mean() / (2 / np.pi)
    peaks = []
    for roughness in (0.0, 0.2, 0.5, 1.0):
        shown = scene(
            draw(sphere(rings=64), diffuseColor=(1.0, 1.0, 1.0), metallic=1.0, roughness=roughness), lights=[dome]
        )
        image = renderer.draw(shown, settings(64, 64, samples=1))["color"]
        peaks.append(image[..., 0].max())
    assert peaks == sorted(peaks, reverse=True) and peaks[0] == pytest.approx(50, rel=0.15)
    assert mean < peaks[-1] < 20 * mean


def test_unreadable_dome_image_warns_and_is_black(renderer, tmp_path):
    broken = tmp_path / "broken.exr"
    broken.write_bytes(b"not an image")
    for file in (broken, tmp_path / "missing.exr"):
        with pytest.warns(FexelWarning, match=file.name):
            lit = facing(renderer, light("dome", texture_file=str(file)), **LAMBERT)
        assert not lit.any()


def test_dome_image_of_nan_and_odd_size_is_finite(renderer, tmp_path):
    image = np.full((7, 13, 3), 0.5)
    image[2, 3] = np.nan
    image[5, 5] = np.inf
    lit = facing(renderer, light("dome", texture_file=write_latlong(tmp_path / "odd.exr", image)), **LAMBERT)
    assert np.all(np.isfinite(lit)) and lit[0] > 0


def test_dome_is_in_the_background_only_when_asked_for(renderer, tmp_path):
    dome = light("dome", texture_file=write_latlong(tmp_path / "axes.exr", axis_image()))
    shown = scene(draw(quad(0.01)), lights=[dome], view=camera(half_height=1.0))
    hidden = renderer.draw(shown, settings(32, 32))["color"]
    visible = renderer.draw(shown, settings(32, 32, dome_visible=True))["color"]
    assert not hidden[0, 0].any() and np.all(visible[..., 3] == 1)
    corner = np.array([-31 / 32, 31 / 32, -1]) / np.linalg.norm([31 / 32, 31 / 32, 1])
    np.testing.assert_allclose(visible[0, 0, :3], 0.5 + 0.5 * corner, atol=0.03)


# --- Normals ----------------------------------------------------------------------------------------------------------


def test_sphere_normals_point_outwards(renderer):
    images = renderer.draw(scene(draw(sphere())), settings(64, 64, "normal", "position"))
    on = images["position"].any(-1)
    np.testing.assert_allclose(images["normal"][on], images["position"][on], atol=5e-3)


def test_neye_is_the_normal_in_camera_axes(renderer):
    view = camera()
    turn = np.eye(4)
    turn[:3, :3] = [[0, 0, -1], [0, 1, 0], [1, 0, 0]]
    view = replace(view, world_to_camera=turn @ view.world_to_camera)
    images = renderer.draw(scene(draw(sphere()), view=view), settings(32, 32, "normal", "Neye"))
    np.testing.assert_allclose(images["Neye"], images["normal"] @ turn[:3, :3], atol=1e-5)


def test_orthographic_view_direction_is_the_same_everywhere(renderer):
    # A flat mirror in a dome shows one colour only under an orthographic camera.
    shiny = draw(quad(9), diffuseColor=(1.0, 1.0, 1.0), metallic=1.0, roughness=0.3)
    lamp = light("distant", matrix=towards_z(20.0), normalize=True)
    flat = renderer.draw(scene(shiny, lights=[lamp], view=camera(orthographic=True)), settings(8, 8, samples=1))[
        "color"
    ]
    deep = renderer.draw(scene(shiny, lights=[lamp], view=camera()), settings(8, 8, samples=1))["color"]
    assert np.ptp(flat[..., 0]) < 1e-5 < 1e-3 < np.ptp(deep[..., 0])


def test_settings_are_plain_values():
    assert FrameSettings(4, 4) == FrameSettings(4, 4)
    assert isinstance(quad(), Mesh)
