"""Rendered umbrella textures against the float64 twin: kinds of umbrellas, views, wrap modes, levels; hard cases."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf

from bench.zipmap_stage import (
    Patch,
    front_view,
    pixel_st,
    quad,
    render_texture,
    save,
    tilted_view,
    vertex_array,
    zipmap_stage,
    zipmap_texture,
)
from fexel import homography
from fexel.errors import FexelWarning
from fexel.renderer.program import ProgramCache
from fexel.renderer.visible import visible_surface
from fexel.scene.model import Texture
from fexel.textures.image_source import ImageSource
from fexel.textures.system import TextureRequest, TextureSystem
from fexel.textures.umbrella import UmbrellaData, UmbrellaLevelData
from fexel.textures.umbrella_arrangement import Arrangement, Shape
from fexel.textures.umbrella_geometry import fold_weight
from fexel.textures.umbrella_picture import picture_level
from fexel.textures.umbrella_twin import UmbrellaTwin

CLAMP = ("clamp", "clamp")
REPEAT = ("repeat", "repeat")
SOIL = (0.125, 0.25, 0.0625, 1.0)  # half floats hold it
GRID = (6, 4)
# Half-float pages and vertex colours, 8-bit sRGB decoding by table, float32 arithmetic.
CLOSE = 2.5e-3


def star(rng, vertices):
    """Points of a star-shaped contour of extent 1 about a centre off the origin."""
    angle = np.sort(rng.uniform(0, 2 * np.pi, vertices) * 0.3 + np.arange(vertices) * 2 * np.pi / vertices * 0.7)
    radius = rng.uniform(0.25, 0.5, vertices)
    contour = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
    return np.concatenate([[[0.0, 0.0]], contour]) + (0.03, -0.02)


def picture(rng, size, channels=3):
    """A smooth random image, linear, premultiplied, multiples of 1/256 as half floats hold them."""
    coarse = rng.random((5, 5, channels))
    at = np.linspace(0, 4, size)
    low = np.minimum(at.astype(int), 3)
    part = (at - low)[:, None, None]
    rows = coarse[low] * (1 - part) + coarse[low + 1] * part
    part = (at - low)[None, :, None]
    texels = np.round((rows[:, low] * (1 - part) + rows[:, low + 1] * part) * 256) / 256
    if channels == 4:
        texels[..., 3] = np.round(np.clip(texels[..., 3] * 3 - 1, 0, 1) * 256) / 256
        texels[..., :3] *= texels[..., 3:]
    return texels.astype(np.float32)


def lawn(rng, folder, count=40, bases=3, *, channels=3, morphs=True, colors=True, shadows=True, projective=False):
    """A varied arrangement whose images are float files."""
    shapes = []
    for number in range(bases):
        points = star(rng, 6 + 5 * number)
        file = save(Path(folder) / f"base{number}_{channels}.tif", picture(rng, 24 + 8 * number, channels), "float")
        image = ImageSource(file, "", "raw", CLAMP)
        other = points + rng.uniform(-0.05, 0.05, points.shape)
        other = points + 0.9 * fold_weight(points, other) * (other - points)
        shapes.append(Shape(points, other, points + 0.5, image))
    shape_of = rng.integers(0, bases, count).astype(np.int32)
    matrices = np.zeros((count, 3, 3))
    for number in range(count):
        angle, size = rng.uniform(0, 2 * np.pi), rng.uniform(1.2, 2.2)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        matrices[number, :2, :2] = size * turn / GRID
        matrices[number, 2] = *rng.random(2), 1
        if projective:
            matrices[number, :2, 2] = rng.uniform(-0.4, 0.4, 2)
    total = int(sum(len(shapes[s].points) for s in shape_of))
    return Arrangement(
        tuple(shapes),
        shape_of,
        matrices,
        rng.random(count) if morphs else np.zeros(count),
        (rng.uniform(-0.3, 0.3, (total, 3)) if colors else np.zeros((0, 3))).astype(np.float32),
        GRID,
        0.75,
        (0.3 / GRID[0], -0.2 / GRID[1]) if shadows else (0.0, 0.0),
        0.5 if shadows else 0.0,
        np.ones(count),
    )


def ground(arrangement, **fields):
    values = {"background": ImageSource("", wrap=CLAMP, fallback=SOIL), "wrap": REPEAT, **fields}
    return UmbrellaData(arrangement=arrangement, **values)


def texture(data):
    return Texture("/Lawn", "umbrella", data)


def expected(data, view, anisotropy=8.0, st_scale=1.0, st_offset=(0.0, 0.0)):
    """(H, W, 4) by the twin, and where the quad shows."""
    st, jacobian, shown = pixel_st(view)
    twin = UmbrellaTwin(data, "/Lawn", most_probes=anisotropy)
    color = np.zeros((len(st), 4))
    color[shown] = twin.sample(st[shown] * st_scale + st_offset, jacobian[shown] * st_scale)
    shape = view.height, view.width
    return color.reshape(*shape, 4), shown.reshape(shape)


def errors(gl, data, view, draw=None, anisotropy=8.0, **options):
    """Differences between renderer and twin where the quad shows, by pixel."""
    system = TextureSystem(gl, anisotropy=anisotropy)
    rendered = render_texture(gl, texture(data), draw or quad(), view, system)
    system.release()
    truth, shown = expected(data, view, anisotropy, **options)
    assert np.isfinite(rendered).all()
    assert shown.any()
    return np.abs(rendered - truth).max(axis=-1)[shown]


def check(found, most_off=0.004):
    """Within half precision but for a few pixels at edges, where a tip that is longer than a list reaches is cut."""
    assert np.median(found) < CLOSE
    assert (found > 1 / 255).mean() <= most_off
    assert (found > 0.1).mean() <= most_off / 4


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"morphs": False},
        {"colors": False},
        {"shadows": False},
        {"projective": True},
        {"channels": 4},
        {"channels": 4, "colors": False, "morphs": False},
        {"morphs": False, "colors": False, "shadows": False},
    ],
    ids=lambda options: ",".join(options) or "all",
)
def test_umbrellas_equal_the_twin(gl, tmp_path, rng, options):
    data = ground(lawn(rng, tmp_path, **options))
    check(errors(gl, data, front_view((0.1, 0.2), (0.6, 0.7), 128, 128)))


@pytest.mark.parametrize("pixels_per_cell", [20, 100, 1000, 10000])
def test_umbrellas_equal_the_twin_at_every_magnification(gl, tmp_path, rng, pixels_per_cell):
    data = ground(lawn(rng, tmp_path))
    half = 0.5 * 120 / pixels_per_cell / np.array(GRID)
    center = np.array([0.43, 0.57])
    check(errors(gl, data, front_view(center - half, center + half, 120, 120)), 0.01)


def contour_place(arrangement, number):
    """A point of an umbrella's contour that none in front of it covers, in st; or None."""
    first = arrangement.first_vertex[number]
    return arrangement.vertices[first + 1] * 0.5 + arrangement.vertices[first + 2] * 0.5


def test_edges_stay_within_a_pixel_at_ten_thousand_pixels_per_texel(gl, tmp_path, rng):
    arrangement = lawn(rng, tmp_path, 1, morphs=True, shadows=False)
    place = contour_place(arrangement, 0)
    place -= np.floor(place)
    # An umbrella is about two cells long and 24 texels of its image.
    half = 32 / 1e4 / 12 / np.array(GRID)
    view = front_view(place - half, place + half, 64, 64)
    data = ground(arrangement)
    rendered = render_texture(gl, texture(data), quad(), view)
    truth, _ = expected(data, view)
    shown = [np.abs(image[..., :3] - SOIL[:3]).max(axis=-1) < 0.01 for image in (rendered, truth)]
    assert 0.2 < shown[1].mean() < 0.8
    assert (shown[0] != shown[1]).mean() < 1.5 / 64  # the edge crosses 64 rows: at most a pixel off and a half


@pytest.mark.parametrize("tilt", [45, 70, 85])
def test_tilted_views_equal_the_twin(gl, tmp_path, rng, tilt):
    data = ground(lawn(rng, tmp_path))
    found = errors(gl, data, tilted_view((0.5, 0.5), 0.35, tilt, 128, 96))
    assert np.median(found) < CLOSE
    assert np.quantile(found, 0.98) < 0.03  # probes that straddle an edge


@pytest.mark.parametrize("tilt", [89.9, 89.99])
def test_grazing_views_are_finite_and_bounded(gl, tmp_path, rng, tilt):
    data = ground(lawn(rng, tmp_path))
    rendered = render_texture(gl, texture(data), quad(), tilted_view((0.5, 0.5), 0.4, tilt, 96, 96))
    assert np.isfinite(rendered).all()
    assert rendered.min() >= 0
    assert rendered.max() <= 1 + 1e-3


@pytest.mark.parametrize("exponent", range(-2, 9))
def test_footprints_from_a_hundredth_texel_to_the_whole_texture(gl, tmp_path, rng, exponent):
    arrangement = lawn(rng, tmp_path, 60)
    data = ground(arrangement)
    cells = 2.0**exponent * (0.01 / 12 if exponent == -2 else 0.01)  # per pixel
    extent = np.minimum(64 * cells / np.array(GRID), 400)
    rendered = render_texture(gl, texture(data), quad((0.3, 0.3), 0.3 + extent), front_view((0, 0), (1, 1), 64, 64))
    assert np.isfinite(rendered).all()
    assert np.abs(rendered[..., 3] - 1).max() < 5e-3
    assert rendered.min() >= 0


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp", "black"])
def test_wrap_modes_equal_the_twin(gl, tmp_path, rng, wrap):
    modes = (wrap, wrap)
    file = save(tmp_path / "soil.tif", picture(rng, 32), "float")
    background = ImageSource(file, "", "raw", modes)
    data = ground(lawn(rng, tmp_path, 25), background=background, wrap=modes)
    found = errors(
        gl,
        data,
        front_view((0, 0), (1, 1), 160, 160),
        quad((-0.8, -0.7), (1.7, 1.8)),
        st_scale=2.5,
        st_offset=(-0.8, -0.7),
    )
    check(found, 0.02)


def test_texture_tiles_without_a_seam(gl, tmp_path, rng):
    """A ground moved by any fraction shows the same umbrellas: its border is nowhere."""
    arrangement = lawn(rng, tmp_path, 50)
    moved = arrangement.matrices.copy()
    moved[:, 2, :2] += (0.37, 0.61)
    view = front_view((0, 0), (1, 1), 144, 96)
    pictures = [
        render_texture(gl, texture(ground(arrangement)), quad(), view),
        render_texture(
            gl, texture(ground(replace(arrangement, matrices=moved))), quad((0.37, 0.61), (1.37, 1.61)), view
        ),
    ]
    difference = np.abs(pictures[0] - pictures[1]).max(axis=-1)
    assert np.median(difference) < 1e-3
    assert (difference > 0.02).mean() < 0.01


def test_shadows_cross_cells_whatever_their_offset(gl, tmp_path, rng):
    arrangement = replace(lawn(rng, tmp_path, 12), shadow_offset=(0.41, -0.73))
    check(errors(gl, ground(arrangement), front_view((0, 0), (1, 1), 128, 128)), 0.02)


def test_fewer_than_full_coverages_equal_the_twin(gl, tmp_path, rng):
    arrangement = lawn(rng, tmp_path, 40)
    arrangement = replace(arrangement, coverages=rng.uniform(0.2, 1.0, 40))
    check(errors(gl, ground(arrangement), front_view((0.1, 0.1), (0.6, 0.6), 128, 128)), 0.01)


def test_umbrellas_without_an_image_show_their_colors(gl, rng):
    points = star(rng, 9)
    shape = Shape(points, points, points, None)
    matrices = np.tile(np.eye(3), (5, 1, 1))
    matrices[:, :2, :2] *= 0.3
    matrices[:, 2, :2] = rng.random((5, 2))
    colors = rng.random((50, 3)).astype(np.float32)
    arrangement = Arrangement((shape,), np.zeros(5, np.int32), matrices, np.zeros(5), colors, GRID)
    check(errors(gl, ground(arrangement), front_view((0, 0), (1, 1), 128, 128)), 0.01)


@pytest.mark.parametrize("mirrored", [False, True])
def test_vectors_turn_with_their_umbrellas(gl, tmp_path, rng, mirrored):
    arrangement = lawn(rng, tmp_path, 30, colors=False, shadows=False)
    if mirrored:
        matrices = arrangement.matrices.copy()
        matrices[::2, 0] *= -1
        arrangement = replace(arrangement, matrices=matrices)
    data = ground(arrangement, scale=(2.0, 2.0, 2.0, 1.0), bias=(-1.0, -1.0, -1.0, 0.0), turns_vectors=True)
    check(errors(gl, data, front_view((0.1, 0.1), (0.6, 0.6), 128, 128)), 0.01)


# Levels of detail


def level_image(rng, folder):
    """A made-up picture of the whole, unlike the umbrellas."""
    file = save(Path(folder) / "level.tif", picture(rng, 64), "float", levels=7)
    return ImageSource(file, "", "raw", REPEAT)


def merged(rng, arrangement, grid):
    """Umbrellas without images, each of which covers part of its area."""
    count = 10
    points = star(rng, 7)
    matrices = np.zeros((count, 3, 3))
    matrices[:, 0, 0], matrices[:, 1, 1] = 1.5 / grid[0], 1.5 / grid[1]
    matrices[:, 2, :2], matrices[:, 2, 2] = rng.random((count, 2)), 1
    return Arrangement(
        (Shape(points, points, points, None),),
        np.zeros(count, np.int32),
        matrices,
        np.zeros(count),
        rng.random((count * 8, 3)).astype(np.float32),
        grid,
        1.0,
        coverages=rng.uniform(0.5, 1, count),
    )


@pytest.mark.parametrize("pixels_per_cell", [12, 6, 5, 3.5, 1.5])
@pytest.mark.parametrize("kind", ["image", "merged", "both"])
def test_levels_blend_as_in_the_twin(gl, tmp_path, rng, kind, pixels_per_cell):
    arrangement = lawn(rng, tmp_path, 60)
    levels = []
    if kind != "image":
        levels.append(UmbrellaLevelData(1, "/Lawn/One", (3, 2), merged(rng, arrangement, (3, 2))))
    if kind != "merged":
        levels.append(UmbrellaLevelData(len(levels) + 1, "/Lawn/Two", image=level_image(rng, tmp_path)))
    data = ground(arrangement, levels=tuple(levels))
    size = tuple(round(32 * n / max(GRID)) * 4 for n in GRID)
    times = np.array(size) / pixels_per_cell / GRID
    found = errors(
        gl,
        data,
        front_view((0, 0), (1, 1), *size),
        quad((0.1, 0.1), 0.1 + times),
        1.0,
        st_scale=times,
        st_offset=(0.1, 0.1),
    )
    check(found, 0.06)


@pytest.mark.parametrize("pixels_per_cell", [3, 2, 1.5, 1, 0.8])
def test_views_of_coarse_levels_alone_take_the_right_ones(gl, tmp_path, rng, pixels_per_cell):
    """From the first merged level to beyond the third, where the renderer's own picture follows."""
    arrangement = lawn(rng, tmp_path, 60)
    levels = tuple(
        UmbrellaLevelData(number, f"/Lawn/L{number}", grid, merged(rng, arrangement, grid))
        for number, grid in ((1, (3, 2)), (2, (2, 1)), (3, (1, 1)))
    )
    size = (96, 64)
    times = np.array(size) / pixels_per_cell / GRID
    view = front_view((0, 0), (1, 1), *size)
    found = errors(gl, ground(arrangement, levels=levels), view, quad((0, 0), times), 1.0, st_scale=times)
    check(found, 0.06)


def test_slow_zoom_has_no_jump(gl, tmp_path, rng):
    """From cells of 20 pixels to cells of 2 in small steps: the mean colour and each pixel change by little."""
    arrangement = lawn(rng, tmp_path, 60)
    data = ground(arrangement)
    system = TextureSystem(gl, anisotropy=1)
    view = front_view((0, 0), (1, 1), 96, 64)
    last, jumps = None, []
    for zoom in np.geomspace(0.5, 5, 90):
        rendered = render_texture(gl, texture(data), quad((0, 0), (zoom, zoom)), view, system)
        if last is not None:
            jumps.append(np.abs(rendered - last).mean())
        last = rendered
    system.release()
    # Neighbouring frames move by the same step throughout, so that none may stand out.
    jumps = np.array(jumps)
    smooth = np.array([np.median(jumps[max(i - 4, 0) : i + 5]) for i in range(len(jumps))])
    assert (jumps < 1.4 * smooth + 2e-3).all()


def test_own_picture_stands_in_for_missing_levels(gl, tmp_path, rng):
    """A view of cells two pixels wide shows the mean of what finer views show, tile by tile."""
    arrangement = lawn(rng, tmp_path, 80)
    data = ground(arrangement)
    assert picture_level(arrangement) == 1
    fine = render_texture(gl, texture(data), quad(), front_view((0, 0), (1, 1), 48 * 6, 48 * 4))
    coarse = render_texture(gl, texture(data), quad((0, 0), (8, 8)), front_view((0, 0), (1, 1), 96, 64))
    assert np.abs(coarse[..., :3].mean(axis=(0, 1)) - fine[..., :3].mean(axis=(0, 1))).max() < 0.01
    blocks = fine.reshape(4 * 2, 24, 6 * 2, 24, 4).mean(axis=(1, 3))
    assert np.abs(coarse[:8, :12] - coarse[8:16, :12]).max() < 2e-3  # it repeats
    assert np.corrcoef(coarse[:8, :12, :3].ravel(), blocks[..., :3].ravel())[0, 1] > 0.7


# Hard cases


def test_empty_arrangement_shows_the_background(gl):
    empty = Arrangement((), np.zeros(0, np.int32), np.zeros((0, 3, 3)), np.zeros(0), np.zeros((0, 3), np.float32))
    for size in (64, 2):
        rendered = render_texture(gl, texture(ground(empty)), quad(), front_view((0, 0), (1, 1), size, size))
        assert np.abs(rendered - SOIL).max() < 1e-3


@pytest.mark.parametrize("grid", [(1, 1), (24, 24), (500, 500)])
def test_authored_grid_changes_nothing_close_up(gl, tmp_path, rng, grid):
    arrangement = replace(lawn(rng, tmp_path, 30), grid=(6, 6))
    view = front_view((0.2, 0.2), (0.3, 0.3), 96, 96)
    reference = render_texture(gl, texture(ground(arrangement)), quad(), view)
    other = render_texture(gl, texture(ground(replace(arrangement, grid=grid))), quad(), view)
    difference = np.abs(reference - other).max(axis=-1)
    assert (difference > 1 / 255).mean() < 2e-3


def test_one_umbrella_in_one_cell(gl, tmp_path, rng):
    arrangement = replace(lawn(rng, tmp_path, 1), grid=(1, 1))
    check(errors(gl, ground(arrangement), front_view((0, 0), (1, 1), 128, 128)), 0.01)


def test_center_spokes_and_vertices_are_covered(gl, tmp_path, rng):
    """Pixels whose centres are exactly the umbrella's centre, its vertices and points of its spokes show it."""
    corners = np.array([(0, 0), (-0.25, -0.25), (0.25, -0.25), (0.25, 0.25), (0, 0.25), (-0.25, 0.25), (-0.25, 0)])
    shape = Shape(corners, corners, corners, None)
    matrix = np.array([[1.0, 0, 0], [0, 1, 0], [0.5 + 1 / 128, 0.5 + 1 / 128, 1]])
    colors = np.tile(np.float32([0.5, 0.25, 0.75]), (7, 1))
    arrangement = Arrangement((shape,), np.zeros(1, np.int32), matrix[None], np.zeros(1), colors, (2, 2))
    rendered = render_texture(gl, texture(ground(arrangement)), quad(), front_view((0, 0), (1, 1), 64, 64))
    inside = rendered[17:47, 18:48]
    assert np.abs(inside[..., :3] - (0.5, 0.25, 0.75)).max() < 1e-3
    on_edge = rendered[15:48, [16, 48], :3]
    assert np.abs(on_edge[2:-2] - (np.array(SOIL[:3]) + (0.5, 0.25, 0.75)) / 2).max() < 2e-3


@pytest.mark.parametrize("fault", ["zero-area", "coincident", "center outside", "folded"])
def test_odd_shapes_equal_the_twin(gl, rng, fault):
    points = star(rng, 8)
    if fault == "zero-area":
        points[3] = points[0] + 1.5 * (points[2] - points[0])
    elif fault == "coincident":
        points[3] = points[2]
        points[5] = points[0]
    elif fault == "center outside":
        points[0] = (0.7, 0.1)
    else:
        points[[3, 4]] = points[[4, 3]]
    shape = Shape(points, points, points, None)
    matrix = np.diag([0.7, 0.7, 1.0])
    matrix[2, :2] = 0.5
    colors = np.tile(np.float32([0.9, 0.6, 0.3]), (9, 1))
    arrangement = Arrangement((shape,), np.zeros(1, np.int32), matrix[None], np.zeros(1), colors, (1, 1))
    found = errors(gl, ground(arrangement), front_view((0, 0), (1, 1), 128, 128))
    assert (found > 1 / 255).mean() < 0.05


def test_hundred_thousand_umbrellas_look_like_those_in_view_alone(gl, tmp_path, rng):
    few = lawn(rng, tmp_path, 1, colors=False)
    count, grid = 100_000, (260, 260)
    matrices = np.zeros((count, 3, 3))
    angle, size = rng.uniform(0, 2 * np.pi, count), rng.uniform(1.2, 2.2, count) / grid[0]
    matrices[:, 0, 0], matrices[:, 0, 1] = size * np.cos(angle), size * np.sin(angle)
    matrices[:, 1, 0], matrices[:, 1, 1] = -size * np.sin(angle), size * np.cos(angle)
    matrices[:, 2, :2], matrices[:, 2, 2] = rng.random((count, 2)), 1
    all_of_them = replace(
        few,
        shape_of=rng.integers(0, 3, count).astype(np.int32),
        matrices=matrices,
        morphs=rng.random(count),
        grid=grid,
        shadow_offset=(0.2 / 260, -0.1 / 260),
        coverages=np.ones(count),
    )
    near = np.flatnonzero((np.abs(matrices[:, 2, :2] - 0.51) < 0.04).all(axis=1))
    some = replace(
        all_of_them,
        **{name: getattr(all_of_them, name)[near] for name in ("shape_of", "matrices", "morphs", "coverages")},
    )
    view = front_view((0.5, 0.5), (0.52, 0.52), 96, 96)
    pictures = [render_texture(gl, texture(ground(each)), quad(), view) for each in (all_of_them, some)]
    difference = np.abs(pictures[0] - pictures[1]).max(axis=-1)
    assert len(near) < 1000
    assert pictures[0][..., :3].std() > 0.02
    assert (difference > 1 / 255).mean() < 0.01
    check(errors(gl, ground(some), view), 0.01)


def test_small_memory_shows_coarser_levels_and_never_fails(gl, tmp_path, rng):
    data = ground(lawn(rng, tmp_path))
    view = front_view((0.2, 0.2), (0.3, 0.3), 96, 96)
    full = render_texture(gl, texture(data), quad(), view)
    system = TextureSystem(gl, memory_mb=0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FexelWarning)
        small = render_texture(gl, texture(data), quad(), view, system)
    system.release()
    assert np.isfinite(small).all()
    assert np.abs(small - full).mean() < 0.2


def test_missing_image_warns_and_draws_the_rest(gl, tmp_path, rng):
    arrangement = lawn(rng, tmp_path, 20)
    shapes = list(arrangement.shapes)
    shapes[0] = replace(shapes[0], image=ImageSource(str(tmp_path / "gone.tif"), wrap=CLAMP))
    data = ground(replace(arrangement, shapes=tuple(shapes)), paths=("/Lawn/A", "/Lawn/B", "/Lawn/C"))
    with pytest.warns(FexelWarning, match=r"/Lawn/A.*gone\.tif"):
        rendered = render_texture(gl, texture(data), quad(), front_view((0, 0), (1, 1), 96, 96))
    assert np.isfinite(rendered).all()
    assert rendered[..., :3].std() > 0.02


def test_aovs_tell_umbrella_and_mip_level(gl, tmp_path, rng):
    arrangement = lawn(rng, tmp_path, 4, shadows=False)
    matrices = np.zeros((4, 3, 3))
    matrices[:, 0, 0] = matrices[:, 1, 1] = 0.4
    matrices[:, 2] = [(0.25, 0.25, 1), (0.75, 0.25, 1), (0.25, 0.75, 1), (0.75, 0.75, 1)]
    arrangement = replace(arrangement, matrices=matrices, shape_of=np.array([0, 0, 0, 0], np.int32))
    total = 4 * len(arrangement.shapes[0].points)
    arrangement = replace(arrangement, colors=rng.uniform(-0.1, 0.1, (total, 3)).astype(np.float32))
    for colors in (arrangement.colors, arrangement.colors[:0]):
        data = ground(replace(arrangement, colors=colors))
        shown = render_texture(gl, texture(data), quad(), front_view((0, 0), (1, 1), 64, 64), aovs=True)
        assert [shown[y, x, 5] for y, x in ((48, 16), (48, 48), (16, 16), (16, 48))] == [0, 1, 2, 3]
        assert shown[32, 32, 5] == -1
        assert shown[48, 16, 4] == pytest.approx(np.log2(24 / 0.4 / 64), abs=0.3)


# In materials


def shown_with(gl, data, numbers, view):
    """Pictures of several textures of one material, each in turn."""
    system = TextureSystem(gl)
    surface = visible_surface(quad(), view, ["st"])
    requests = [TextureRequest(texture(each), surface) for each in data]
    system.begin_view(requests)
    binding = system.binding(requests)
    pictures = []
    for number in numbers:
        defines = {"TEXTURE_SAMPLE": "umbrella_sample", "TEXTURE_NUMBER": number, "TEXTURE_AOVS": 0}
        program = ProgramCache(gl).get(
            "texture_view.vert", "texture_view.frag", binding.defines | defines, binding.includes
        )
        target = gl.texture((view.width, view.height), 4, dtype="f4")
        framebuffer = gl.framebuffer([target])
        framebuffer.use()
        framebuffer.clear()
        binding.apply(program)
        vertex_array(gl, program, quad(), surface, view).render()
        pictures.append(np.frombuffer(target.read(), np.float32).reshape(view.height, view.width, 4)[::-1].copy())
        gl.detect_framebuffer(0).use()
        framebuffer.release()
        target.release()
    system.release()
    return pictures


def test_textures_of_one_material_do_not_disturb_each_other(gl, tmp_path, rng):
    (tmp_path / "b").mkdir()
    data = [
        ground(lawn(rng, tmp_path, 30)),
        ground(lawn(rng, tmp_path / "b", 20, morphs=False, shadows=False, projective=True)),
        ground(lawn(rng, tmp_path, 25, channels=4, colors=False)),
        ground(replace(lawn(rng, tmp_path, 30), grid=(200, 200)), levels=()),
    ]
    view = front_view((0.1, 0.1), (0.7, 0.7), 96, 96)
    together = shown_with(gl, data, range(len(data)), view)
    for each, shown in zip(data, together, strict=True):
        alone = render_texture(gl, texture(each), quad(), view)
        assert np.abs(shown - alone).max() < 2e-3


@pytest.mark.parametrize("perspective", [0.0, 0.3])
def test_umbrellas_nested_in_a_zipmap_equal_the_twin(gl, tmp_path, rng, perspective):
    """A lawn as a turned, mirrored or projective patch over a plain ground."""
    base = save(tmp_path / "base.tif", np.full((16, 16, 4), [0.5, 0.25, 0.125, 1], np.float32), "float")
    stage = zipmap_stage(Patch(base, np.eye(3), color_space="raw"))
    lawn_prim = stage.DefinePrim("/Zipmap/Lawn", "UmbrellaTexture")
    matrix = np.array([[1.4, 0.8, perspective], [-0.7, 1.3, 0.1 * perspective], [0.1, -0.4, 1.0]])
    define(lawn_prim, matrix, count=12, rng=rng)
    data = zipmap_texture(stage).data
    (nested,) = data.nested
    assert nested.data.wrap == ("patch", "patch")
    assert len(nested.data.arrangement) == 12
    view = front_view((0, 0), (1, 1), 128, 128)
    rendered = render_texture(gl, Texture("/Zipmap", "zipmap", data), quad(), view)
    st, jacobian, shown = pixel_st(view)
    placed = homography.normalize(matrix)
    inner = homography.apply(placed, st)
    inside = np.isfinite(inner).all(axis=1) & (inner > 0).all(axis=1) & (inner < 1).all(axis=1)
    assert inside.mean() > 0.1
    axes = homography.jacobian(placed, st[inside]) @ jacobian[inside]
    color = UmbrellaTwin(nested.data, "/Lawn", most_probes=8).sample(inner[inside], axes)
    truth = np.tile([0.5, 0.25, 0.125, 1.0], (len(st), 1))
    truth[inside] = color + (1 - color[:, 3:]) * truth[inside]
    check(np.abs(rendered.reshape(-1, 4) - truth).max(axis=-1)[shown], 0.02)


def define(prim, matrix, count, rng):
    """Squares without images, authored."""
    names = Sdf.ValueTypeNames
    points = [(0, 0), (-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
    patch = prim.GetStage().DefinePrim(prim.GetPath().AppendChild("Square"), "UmbrellaPatch")
    patch.CreateAttribute("points", names.Float2Array).Set(points)
    patch.CreateAttribute("texCoords", names.Float2Array).Set([(x + 0.5, y + 0.5) for x, y in points])
    placed = [Gf.Matrix3d(0.2, 0.1, 0, -0.1, 0.2, 0, *rng.random(2), 1) for _ in range(count)]
    prim.CreateAttribute("grid", names.Int2).Set(Gf.Vec2i(4, 4))
    prim.CreateAttribute("patchIndices", names.IntArray).Set([0] * count)
    prim.CreateAttribute("matrices", names.Matrix3dArray).Set(placed)
    prim.CreateAttribute("colors", names.Color3fArray).Set([tuple(c) for c in rng.random((5 * count, 3))])
    prim.CreateAttribute("inputs:matrix", names.Matrix3d).Set(Gf.Matrix3d(*matrix.ravel().tolist()))
    prim.CreateAttribute("inputs:shadowOffset", names.Float2).Set((0.03, -0.02))
    prim.CreateAttribute("inputs:shadowStrength", names.Float).Set(0.5)
