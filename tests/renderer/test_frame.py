"""Geometry, AOVs, tiles and samples against what float64 projection says."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scenes import camera, draw, quad, scene, settings, sphere, translation

from fexel.errors import FexelError, FexelWarning
from fexel.renderer import Renderer, viewport
from fexel.renderer.frame import FrameSettings
from fexel.scene.model import Mesh

WHITE = {"emissiveColor": (1.0, 1.0, 1.0)}


def pixel_centres(width, height):
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.stack([x, y], -1)


def project(view, points, width, height):
    """Pixel positions (..., 2), origin at the upper left, in float64."""
    clip = np.concatenate([points, np.ones((*points.shape[:-1], 1))], -1) @ view.world_to_camera @ view.camera_to_clip
    ndc = clip[..., :2] / clip[..., 3:]
    return np.stack([(ndc[..., 0] + 1) / 2 * width, (1 - ndc[..., 1]) / 2 * height], -1)


@pytest.mark.parametrize("orthographic", [False, True])
def test_position_projects_back_to_the_centre_of_its_pixel(renderer, orthographic):
    view = camera((0.3, -0.2, 5), half_height=1.2 if orthographic else 0.4, aspect=1.5, orthographic=orthographic)
    pixels = renderer.draw(scene(draw(sphere()), view=view), settings(150, 100, "position", "alpha"))
    primary = pixels["position"].any(-1)
    assert primary.sum() > 2000
    error = project(view, pixels["position"].astype(float), 150, 100) - pixel_centres(150, 100)
    assert np.abs(error[primary]).max() < 1e-3


def test_depths_of_a_tilted_plane_are_the_analytic_ones(renderer):
    view = camera((0, 0, 4), half_height=0.5, near=0.5, far=20.0)
    images = renderer.draw(scene(draw(quad(10.0, slope=0.3)), view=view), settings(64, 64, "depth", "cameraDepth"))
    x = ((pixel_centres(64, 64)[..., 0] / 32) - 1) * 0.5  # ray (x, y, -1)
    distance = 4 / (1 + 0.3 * x)  # where 4 - t = 0.3 x t
    np.testing.assert_allclose(images["cameraDepth"][..., 0], distance, rtol=2e-6)
    window = (20.0 / 19.5) * (1 - 0.5 / distance)
    np.testing.assert_allclose(images["depth"][..., 0], window, atol=3e-6)


def test_st_of_a_facing_quad_is_a_ramp_of_known_slope(renderer):
    view = camera((0, 0, 2), half_height=0.25)  # sees [-0.5, 0.5]^2 of the quad: st in [0.25, 0.75]
    st = renderer.draw(scene(draw(quad()), view=view), settings(50, 50, "st"))["st"]
    columns = 0.25 + 0.5 * (np.arange(50) + 0.5) / 50
    np.testing.assert_allclose(st[..., 0], np.broadcast_to(columns, (50, 50)), atol=1e-6)
    assert np.all(np.diff(st[:, 0, 1]) < 0), "t runs up, rows run down"


def test_prim_ids_and_backgrounds(renderer):
    draws = [draw(quad(0.3), translation(-0.5, 0, 0), 7), draw(quad(0.3), translation(0.5, 0, 0), 9)]
    names = ("primId", "depth", "cameraDepth", "normal", "lod", "patch", "st", "alpha")
    images = renderer.draw(scene(*draws), settings(64, 64, *names, samples=1))
    assert set(np.unique(images["primId"])) == {-1.0, 7.0, 9.0}
    assert images["primId"][32, 24, 0] == 7.0 and images["primId"][32, 40, 0] == 9.0
    nothing = images["primId"][..., 0] < 0
    assert np.array_equal(nothing, images["alpha"][..., 0] == 0)
    background = {"depth": 1.0, "cameraDepth": 0.0, "normal": 0.0, "lod": -1.0, "patch": -1.0, "st": 0.0}
    for name, value in background.items():
        assert np.all(images[name][nothing] == value), name


def test_data_are_never_averaged_across_an_edge(renderer):
    draws = [draw(quad(5), translation(0, 0, -1), 0), draw(quad(0.333), prim_id=3)]
    images = renderer.draw(scene(*draws), settings(33, 33, "primId", "cameraDepth", "Neye"))
    assert set(np.unique(images["primId"])) <= {0.0, 3.0}
    assert set(np.unique(np.round(images["cameraDepth"], 3))) == {4.0, 5.0}
    np.testing.assert_allclose(np.linalg.norm(images["Neye"], axis=-1), 1.0, atol=1e-6)


def test_seven_and_more_data_aovs_at_once_equal_one_at_a_time(renderer):
    names = ("depth", "cameraDepth", "normal", "Neye", "position", "st", "lod", "patch", "primId")
    shown = scene(draw(sphere()))
    together = renderer.draw(shown, settings(24, 24, *names))
    for name in names:
        alone = renderer.draw(shown, settings(24, 24, name))
        assert list(alone) == [name] and np.array_equal(alone[name], together[name]), name


@pytest.mark.parametrize("samples", [1, 4, 9])
def test_image_in_tiles_equals_the_image_in_one(renderer, monkeypatch, samples):
    shown = scene(draw(sphere(), **WHITE), draw(quad(0.4), translation(1, 0.7, 0.5), 1), view=camera(aspect=97 / 61))
    whole = renderer.draw(shown, settings(97, 61, "color", "position", "primId", samples=samples))
    monkeypatch.setattr(viewport, "MAX_TILE_PX", 34)
    monkeypatch.setattr(viewport.tiles, "__defaults__", (34,))
    assert len(list(viewport.tiles(97, 61))) == 6
    parts = renderer.draw(shown, settings(97, 61, "color", "position", "primId", samples=samples))
    assert np.mean(parts["primId"] != whole["primId"]) < 2e-3  # centres exactly on an edge
    same = (parts["primId"] == whole["primId"])[..., 0]
    np.testing.assert_allclose(parts["position"][same], whole["position"][same], atol=1e-4)
    assert np.mean(np.abs(parts["color"] - whole["color"]) > 1e-3) < 2e-3


def test_many_samples_converge_to_the_analytic_coverage_of_a_sloping_edge(renderer):
    # The half plane y < x / 3 + 0.02, of which every pixel shows the part given by the edge's height.
    points = np.array([[-9, -3 + 0.02, 0], [9, 3 + 0.02, 0], [0, -30, 0]], float)
    mesh = Mesh("/Half", points, np.tile([0, 0, 1.0], (3, 1)).astype("f4"), np.array([[0, 1, 2]], np.int32))
    view = camera(half_height=1.0, orthographic=True)
    shown = scene(draw(mesh, **WHITE), view=view)
    fine = np.linspace(0, 1, 2000, endpoint=False) + 0.5 / 2000
    x = (np.arange(16)[:, None] + fine) / 8 - 1
    edge_px = (1 - (x / 3 + 0.02)) * 8  # row of the edge, from the top
    coverage = np.stack([np.clip(row + 1 - edge_px, 0, 1).mean(1) for row in range(16)])
    errors = {}
    for samples in (1, 4, 64, 256):
        alpha = renderer.draw(shown, settings(16, 16, "alpha", samples=samples))["alpha"][..., 0]
        errors[samples] = np.abs(alpha - coverage).max()
    assert errors[256] < 0.02 and errors[64] < 0.04, errors
    assert errors[4] < 0.3 < errors[1], errors


def test_sample_offsets_fill_the_pixel_evenly():
    for count in (1, 2, 16, 37, 256):
        offsets = viewport.sample_offsets(count)
        assert offsets.shape == (count, 2) and np.abs(offsets).max() < 0.5 + 1e-12
        for axis in range(2):
            np.testing.assert_allclose(np.sort(offsets[:, axis]), (np.arange(count) + 0.5) / count - 0.5, atol=1e-9)


def test_emission_passes_unmodified_without_lights(renderer):
    color = (0.1, 0.25, 3.7)
    images = renderer.draw(scene(draw(quad(9), emissiveColor=color)), settings(8, 8, samples=1))
    expected = np.array([*color, 1.0], np.float32)
    assert np.array_equal(images["color"], np.broadcast_to(expected, (8, 8, 4)))
    headlight = renderer.draw(scene(draw(quad(9), emissiveColor=color)), settings(8, 8, camera_light=True))
    assert np.all(headlight["color"][..., :3] > images["color"][..., :3])


def test_blazing_emission_is_clamped_not_infinite(renderer):
    shown = scene(draw(quad(9), emissiveColor=(1e30, 1.0, 0.0)))
    for samples in (1, 4):
        assert np.all(np.isfinite(renderer.draw(shown, settings(4, 4, samples=samples))["color"]))


def test_non_finite_material_values_fall_back(renderer):
    shown = scene(draw(quad(9), emissiveColor=(float("nan"), 0.0, 0.0), roughness=float("inf")))
    assert np.all(np.isfinite(renderer.draw(shown, settings(4, 4, camera_light=True))["color"]))


def test_empty_scene_is_transparent_and_warns(renderer):
    with pytest.warns(FexelWarning, match="nothing to draw"):
        images = renderer.draw(scene(), settings(5, 3, "color", "depth"))
    assert images["color"].shape == (3, 5, 4) and not images["color"].any() and np.all(images["depth"] == 1)


def test_degenerate_triangles_draw_nothing(renderer):
    points = np.array([[0, 0, 0], [0, 0, 0], [1, 1, 0], [-1, -1, 0], [0.5, 0.5, 0]], float)
    triangles = np.array([[0, 1, 2], [2, 3, 4], [0, 0, 0]], np.int32)
    mesh = Mesh("/Thin", points, np.zeros((5, 3), "f4"), triangles)
    images = renderer.draw(scene(draw(mesh, **WHITE)), settings(16, 16, "color", "normal", camera_light=True))
    assert not images["color"].any() and np.all(np.isfinite(images["normal"]))


def test_zero_normals_fall_back_to_the_facet(renderer):
    flat = quad(9)
    mesh = Mesh("/Bare", flat.points, np.zeros((4, 3), "f4"), flat.triangles)
    normal = renderer.draw(scene(draw(mesh)), settings(4, 4, "normal"))["normal"]
    np.testing.assert_allclose(normal, np.broadcast_to([0, 0, 1.0], normal.shape), atol=1e-6)


def test_camera_inside_a_surface_sees_its_inside(renderer):
    images = renderer.draw(scene(draw(sphere(3.0), **WHITE), view=camera((0, 0, 0))), settings(16, 16, "color", "Neye"))
    assert np.all(images["color"][..., 3] == 1)
    assert np.all(images["Neye"][..., 2] > 0.5), "normals face the camera"


def test_culling_of_back_faces_follows_double_sided_and_mirroring(renderer):
    inside = camera((0, 0, 0))
    mirrored = np.diag([-1.0, 1, 1, 1])

    def seen(cull, **options):
        shown = scene(draw(sphere(3.0), **options, **WHITE), view=inside)
        return bool(renderer.draw(shown, settings(4, 4, "alpha", cull_back_faces=cull))["alpha"].any())

    assert seen(False, double_sided=False)
    assert seen(True, double_sided=True)
    assert not seen(True, double_sided=False)
    assert not seen(True, double_sided=False, matrix=mirrored)
    outside = scene(draw(sphere(), double_sided=False, matrix=mirrored, **WHITE))
    images = renderer.draw(outside, settings(32, 32, "alpha", "Neye", cull_back_faces=True))
    assert images["alpha"][16, 16] == 1 and images["Neye"][16, 16, 2] > 0.9


def test_clipping_planes_cut_what_lies_behind_them(renderer):
    planes = ((1.0, 0.0, 0.0, -0.25), (0.0, 1.0, 0.0, 0.0))  # keeps x > 0.25 and y > 0
    view = camera((0.0, 0.0, 4.0), half_height=1.0, orthographic=True, clipping_planes=planes)
    alpha = renderer.draw(scene(draw(quad(9), **WHITE), view=view), settings(16, 16, "alpha", samples=1))["alpha"][
        ..., 0
    ]
    expected = np.zeros((16, 16))
    expected[:8, 10:] = 1
    assert np.array_equal(alpha, expected)
    again = renderer.draw(scene(draw(quad(9), **WHITE)), settings(8, 8, "alpha"))["alpha"]
    assert np.all(again == 1), "the planes do not stay on for the next frame"


def test_near_and_far_cut(renderer):
    shown = [draw(quad(9), translation(0, 0, z), i, **WHITE) for i, z in enumerate((3.5, -20.0))]
    view = camera(near=1.0, far=10.0)
    assert not renderer.draw(scene(*shown, view=view), settings(8, 8, "alpha"))["alpha"].any()


def test_moving_scene_and_camera_far_away_leaves_the_image(renderer):
    near = renderer.draw(scene(draw(sphere(), **WHITE)), settings(64, 64, "color", "normal", "cameraDepth"))
    away = np.array([3e7, -1e7, 2e7])
    moved = scene(draw(sphere(), translation(*away), **WHITE), view=camera(away + [0, 0, 4]))
    far = renderer.draw(moved, settings(64, 64, "color", "normal", "cameraDepth"))
    for name, image in near.items():
        np.testing.assert_allclose(far[name], image, atol=1e-4, err_msg=name)
    own = sphere()
    offset = Mesh("/Far", own.points + away, own.normals, own.triangles)
    again = renderer.draw(scene(draw(offset, **WHITE), view=camera(away + [0, 0, 4])), settings(64, 64, "normal"))
    np.testing.assert_allclose(again["normal"], near["normal"], atol=1e-4)


def test_scaling_scene_and_camera_leaves_the_image(renderer):
    base = renderer.draw(scene(draw(sphere())), settings(32, 32, camera_light=True))["color"]
    for factor in (1e-6, 1e6):
        view = camera((0, 0, 4 * factor), near=0.1 * factor, far=100 * factor)
        shown = scene(draw(sphere(), np.diag([factor, factor, factor, 1.0])), view=view)
        np.testing.assert_allclose(renderer.draw(shown, settings(32, 32, camera_light=True))["color"], base, atol=2e-3)


def test_non_uniform_scale_keeps_normals_perpendicular(renderer):
    shown = scene(draw(quad(9, slope=0.5), np.diag([1.0, 1.0, 3.0, 1.0])))
    normal = renderer.draw(shown, settings(4, 4, "normal"))["normal"]
    np.testing.assert_allclose(
        normal, np.broadcast_to(np.array([-1.5, 0, 1]) / np.hypot(1.5, 1), normal.shape), atol=1e-5
    )


def test_singular_transform_draws_without_nan(renderer):
    shown = scene(
        draw(sphere(), np.diag([1.0, 1.0, 0.0, 1.0])), draw(sphere(), np.zeros((4, 4)) + np.diag([0, 0, 0, 1.0]))
    )
    images = renderer.draw(shown, settings(16, 16, "color", "normal", camera_light=True))
    assert all(np.all(np.isfinite(image)) for image in images.values()) and images["color"].any()


def test_display_color_replaces_diffuse_and_keeps_interpolation(renderer):
    colors = np.array([[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0]], np.float32)
    mesh = quad(2.0, display_color=colors)
    specular_free = {"useSpecularWorkflow": 1.0}
    image = renderer.draw(scene(draw(mesh, **specular_free)), settings(16, 16, camera_light=True, samples=1))["color"]
    assert image[0, 8, 1] > image[15, 8, 1] and image[0, 8, 0] < image[15, 8, 0]
    assert np.all(image[..., 2] < 1e-6)


def test_translucent_surfaces_blend_from_back_to_front_whatever_their_order(renderer):
    red = draw(quad(9), translation(0, 0, 1), opacity=0.5, emissiveColor=(1.0, 0.0, 0.0))
    green = draw(quad(9), translation(0, 0, 0), 1, opacity=0.25, emissiveColor=(0.0, 1.0, 0.0))
    for order in ((red, green), (green, red)):
        pixel = renderer.draw(scene(*order), settings(2, 2))["color"][0, 0]
        np.testing.assert_allclose(pixel, [0.5, 0.5 * 0.25, 0.0, 1 - 0.5 * 0.75], atol=1e-3)


def test_translucent_in_front_of_and_behind_opaque(renderer):
    wall = draw(quad(9), emissiveColor=(0.0, 0.0, 1.0))
    front = draw(quad(9), translation(0, 0, 1), 1, opacity=0.5, emissiveColor=(1.0, 0.0, 0.0))
    behind = draw(quad(9), translation(0, 0, -1), 2, opacity=0.5, emissiveColor=(0.0, 1.0, 0.0))
    images = renderer.draw(scene(front, behind, wall), settings(2, 2, "color", "primId"))
    np.testing.assert_allclose(images["color"][0, 0], [0.5, 0.0, 0.5, 1.0], atol=1e-3)
    assert np.all(images["primId"] == 1), "the nearest surface, though one sees through it"


def test_opacity_threshold_cuts_out(renderer):
    opacity = np.array([0, 1, 1, 0], np.float32)  # a ramp along x
    mesh = quad(2.0, display_opacity=opacity)
    shown = scene(draw(mesh, opacityThreshold=0.5, **WHITE), view=camera(half_height=0.5))
    alpha = renderer.draw(shown, settings(16, 16, "alpha", samples=1))["alpha"][..., 0]
    expected = np.zeros((16, 16))
    expected[:, 8:] = 1
    assert np.array_equal(alpha, expected), "either there or not; what is there is opaque"


def test_fully_transparent_surface_is_in_no_aov(renderer):
    images = renderer.draw(scene(draw(quad(9), opacity=0.0)), settings(4, 4, "color", "primId"))
    assert not images["color"].any() and np.all(images["primId"] == -1)


@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 7), (3, 1), (2049, 2)])
def test_odd_sizes(renderer, width, height):
    view = camera(aspect=width / height)
    images = renderer.draw(scene(draw(quad(99999), **WHITE), view=view), settings(width, height, "color", "primId"))
    assert images["color"].shape == (height, width, 4)
    assert np.all(images["color"] == 1) and np.all(images["primId"] == 0)


def test_frame_of_8192_squared(renderer):
    view = camera(half_height=1.0, orthographic=True)
    alpha = renderer.draw(scene(draw(quad(0.5), **WHITE), view=view), settings(8192, 8192, "alpha", samples=1))["alpha"]
    assert alpha.shape == (8192, 8192, 1) and alpha.dtype == np.float32
    assert int(alpha.sum(dtype=np.float64)) == 4096 * 4096
    assert np.all(alpha[2048:6144, 2048:6144] == 1)


@pytest.mark.parametrize("bad", [{"width": 0}, {"height": -1}, {"width": 10**6}, {"samples": 0}, {"samples": 10**5}])
def test_impossible_settings_are_refused(bad):
    with pytest.raises(FexelError, match=str(*bad.values())):
        FrameSettings(**({"width": 4, "height": 4} | bad))


def test_conforming_to_another_aspect_keeps_what_the_policy_says():
    view = camera(half_height=0.5, aspect=2.0)
    base = view.camera_to_clip

    def scales(policy, aspect):
        conformed = viewport.conform_projection(view, aspect, policy)
        return conformed[0, 0] / base[0, 0], conformed[1, 1] / base[1, 1]

    assert scales("expandAperture", 4.0) == (0.5, 1.0) and scales("expandAperture", 1.0) == (1.0, 0.5)
    assert scales("cropAperture", 4.0) == (1.0, 2.0) and scales("cropAperture", 1.0) == (2.0, 1.0)
    assert scales("adjustApertureWidth", 1.0) == (2.0, 1.0) and scales("adjustApertureHeight", 4.0) == (1.0, 2.0)
    assert scales("adjustPixelAspectRatio", 4.0) == (1.0, 1.0)
    with pytest.raises(FexelError, match="expandAperture"):
        scales("stretch", 1.0)


def test_frames_repeat_exactly_and_renderers_do_not_disturb_each_other(gl, renderer):
    mine = gl.buffer(b"mine")
    shown = scene(draw(sphere()))
    first = renderer.draw(shown, settings(32, 32, camera_light=True))["color"]
    with Renderer() as other:
        second = other.draw(shown, settings(32, 32, camera_light=True))["color"]
        third = renderer.draw(shown, settings(32, 32, camera_light=True))["color"]
        assert other.stats()["frames"] == 1
    assert np.array_equal(first, second) and np.array_equal(first, third)
    assert mine.read() == b"mine"


def test_closed_renderer_can_be_used_again():
    renderer = Renderer()
    shown = scene(draw(quad(9), **WHITE))
    for _ in range(2):
        assert np.all(renderer.draw(shown, settings(2, 2))["color"] == 1)
        renderer.close()
    renderer.close()


def test_buffers_of_dead_meshes_are_freed():
    with Renderer() as renderer:
        sizes = []
        for _ in range(5):
            renderer.draw(scene(draw(sphere())), settings(4, 4))
            sizes.append(renderer.stats()["meshBytes"])
        assert len(set(sizes)) == 1 and sizes[0] > 0


def test_a_program_is_compiled_only_for_the_features_used():
    with Renderer() as renderer:
        many = [draw(quad(0.1), translation(i / 10, 0, 0), i, roughness=i / 10, metallic=0.5) for i in range(10)]
        renderer.draw(scene(*many), settings(8, 8, camera_light=True))
        assert renderer.stats()["programs"] == 1, "constant inputs are uniforms"
        renderer.draw(scene(draw(quad(), clearcoat=1.0)), settings(8, 8, camera_light=True))
        assert renderer.stats()["programs"] == 2


def test_draws_outside_the_view_are_culled(renderer):
    with Renderer() as own, warnings.catch_warnings():
        warnings.simplefilter("error")
        far_off = [draw(quad(), translation(x, 0, 0), 0) for x in (-50, 50)]
        own.draw(scene(draw(quad()), *far_off, draw(quad(), translation(0, 0, 30))), settings(8, 8))
        assert own.stats()["draws"] == 1
