"""The raster of umbrellas against every umbrella tried at every point, and laws of pictures."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from fexel.errors import FexelError
from fexel.textures.umbrella_arrangement import Arrangement, Shape
from fexel_tools.umbrella_raster import rasterize, view_of_window

SQUARE = np.array([[0, 0], [-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]], float)


def star(rng, contour=9):
    angle = np.arange(contour) * 2 * np.pi / contour
    radius = rng.uniform(0.2, 0.5, contour)
    return np.concatenate([[[0.02, -0.03]], np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)])


def placed(center, size, degrees=0.0, perspective=(0.0, 0.0)):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[size * c, size * s, perspective[0]], [-size * s, size * c, perspective[1]], [*center, 1.0]])


def arranged(shapes, matrices, **more):
    count = len(matrices)
    given = {"shape_of": np.zeros(count, np.int32), "morphs": np.zeros(count), "colors": np.zeros((0, 3), np.float32)}
    return Arrangement(tuple(shapes), matrices=np.array(matrices).reshape(-1, 3, 3), **(given | more))


def shape_of(points, tex_coords=None):
    return Shape(points, points, points + 0.5 if tex_coords is None else tex_coords)


def random_arrangement(rng, count=14, shadow=True):
    shapes = []
    for _ in range(3):
        first = star(rng)
        shapes.append(Shape(first, first * rng.uniform(0.7, 1.2, (len(first), 1)), first + 0.5))
    matrices = []
    for _ in range(count):
        angle, size = rng.uniform(0, 360), rng.uniform(0.2, 0.6)
        matrices.append(placed(rng.random(2), size, angle, rng.uniform(-0.4, 0.4, 2)))
        if rng.random() < 0.3:
            matrices[-1] = np.diag([-1.0, 1.0, 1.0]) @ matrices[-1]
        matrices[-1][2] -= rng.integers(-1, 2, 2) @ np.array([[1.0, 0, 0], [0, 1.0, 0]])
    return arranged(
        shapes,
        matrices,
        shape_of=rng.integers(0, 3, count).astype(np.int32),
        morphs=rng.random(count),
        colors=rng.uniform(-0.3, 0.3, (count * 10, 3)).astype(np.float32),
        color_blend=0.7,
        coverages=np.where(rng.random(count) < 0.3, 0.6, 1.0),
        shadow_offset=(0.04, -0.03) if shadow else (0.0, 0.0),
        shadow_strength=0.6 if shadow else 0.0,
    )


def random_textures(rng, arrangement):
    """One opaque, one with alpha, the others vertex colours alone."""
    opaque = rng.random((9, 7, 3)).astype(np.float32)
    soft = rng.random((6, 8, 4)).astype(np.float32)
    return [opaque, soft, None][: len(arrangement.shapes)]


def bilinear(image, uv):
    """Straight colour and alpha of (h, w, 4), filtered premultiplied, clamped."""
    texels = image.astype(np.float64) * np.concatenate(
        [np.repeat(image[..., 3:], 3, 2), np.ones_like(image[..., 3:])], 2
    )
    height, width = image.shape[:2]
    x = np.clip(uv[:, 0] * width - 0.5, 0, width - 1)
    y = np.clip((1 - uv[:, 1]) * height - 0.5, 0, height - 1)
    column, row = np.minimum(x.astype(int), max(width - 2, 0)), np.minimum(y.astype(int), max(height - 2, 0))
    fx, fy = (x - column)[:, None], (y - row)[:, None]
    right, below = np.minimum(column + 1, width - 1), np.minimum(row + 1, height - 1)
    mixed = (texels[row, column] * (1 - fx) + texels[row, right] * fx) * (1 - fy) + (
        texels[below, column] * (1 - fx) + texels[below, right] * fx
    ) * fy
    return mixed[:, :3] / np.maximum(mixed[:, 3:], 1e-12), mixed[:, 3]


def umbrella_at(arrangement, textures, number, points):
    """Colour (M, 3) and alpha (M,) of one umbrella, sectors in patch space; transparent where it is not."""
    shape = arrangement.shapes[arrangement.shape_of[number]]
    patch = shape.points + arrangement.morphs[number] * (shape.morph_points - shape.points)
    q = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ np.linalg.inv(arrangement.matrices[number])
    local = q[:, :2] / q[:, 2:]
    start = arrangement.first_vertex[number]
    colors = arrangement.colors[start : start + len(patch)] if len(arrangement.colors) else np.zeros((len(patch), 3))
    rgb, alpha = np.zeros((len(points), 3)), np.zeros(len(points))
    for i in range(1, len(patch)):
        corner = [0, i, i + 1 if i + 1 < len(patch) else 1]
        system = np.concatenate([patch[corner], np.ones((3, 1))], axis=1)
        if np.linalg.det(system) <= 0:
            continue
        weights = np.concatenate([local, np.ones((len(local), 1))], axis=1) @ np.linalg.inv(system)
        inside = (weights >= 0).all(axis=1) & (q[:, 2] > 0)
        base, opacity = np.zeros((len(points), 3)), np.ones(len(points))
        image = textures[arrangement.shape_of[number]]
        if image is not None:
            image = image if image.shape[2] == 4 else np.concatenate([image, np.ones_like(image[..., :1])], axis=2)
            base, opacity = bilinear(image, weights @ shape.tex_coords[corner])
        color = np.clip(base + arrangement.color_blend * (weights @ colors[corner]), 0, 1)
        rgb[inside], alpha[inside] = color[inside], opacity[inside]
    coverage = arrangement.coverages[number] if len(arrangement.coverages) else 1.0
    return rgb, alpha * coverage


def brute_force(arrangement, textures, background, points):
    """(M, 4) of every umbrella and every shift tried at every point."""
    out, through, lit = np.zeros((len(points), 4)), np.ones(len(points)), np.ones(len(points))
    shifts = np.array(list(itertools.product(range(-2, 3), repeat=2)), float)

    def light():
        return (1 - arrangement.shadow_strength * (1 - lit))[:, None]

    for number in range(len(arrangement)):
        for shift in shifts:
            rgb, alpha = umbrella_at(arrangement, textures, number, points - shift)
            out += (through * alpha)[:, None] * np.concatenate([rgb * light(), np.ones((len(points), 1))], axis=1)
            through = through * (1 - alpha)
        for shift in shifts:
            moved = points - shift - np.array(arrangement.shadow_offset)
            lit = lit * (1 - umbrella_at(arrangement, textures, number, moved)[1])
    straight = np.append(background, 1.0)[:4]
    behind = np.concatenate([straight[:3] * light(), np.ones((len(points), 1))], axis=1) * straight[3]
    return out + through[:, None] * behind


def centres(size, view):
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    return np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1) @ view


@pytest.mark.parametrize("shadow", [False, True])
def test_samples_equal_every_umbrella_tried_at_every_point(rng, shadow):
    arrangement = random_arrangement(rng, shadow=shadow)
    textures = random_textures(rng, arrangement)
    size, background = (61, 47), np.array([0.2, 0.5, 0.9, 0.5])
    view = view_of_window((-0.3, 0.1, 0.9, 1.2), size) + np.array([[0.001, 0.004], [-0.003, 0.002], [0, 0]])
    picture = rasterize(arrangement, textures, background, size, view=view, supersample=1)
    expected = brute_force(arrangement, textures, background, centres(size, view)).reshape(*size[::-1], 4)
    assert expected[..., 3].min() < 0.9 and np.unique(expected[..., 0]).size > 1000  # something is to be seen
    assert np.abs(picture - expected).max() < 2e-4


def test_a_pixel_is_the_mean_of_its_samples(rng):
    arrangement = random_arrangement(rng)
    textures = [None] * 3
    fine = rasterize(arrangement, textures, (0.1, 0.2, 0.3), (60, 48), supersample=1)
    coarse = rasterize(arrangement, textures, (0.1, 0.2, 0.3), (12, 16), supersample=1)
    assert not np.allclose(coarse, fine[::3, ::5])
    mean = fine[:48, :60].reshape(16, 3, 20, 3, 4).mean(axis=(1, 3))
    assert np.allclose(rasterize(arrangement, textures, (0.1, 0.2, 0.3), (20, 16), supersample=3), mean, atol=1e-6)


def test_sectors_neither_overlap_nor_leave_gaps(rng):
    """Half-covering umbrellas show either half of themselves or nothing, nowhere twice."""
    shape = shape_of(star(rng, 23))
    arrangement = arranged([shape], [placed((0.5, 0.5), 0.9, 17.0)], coverages=np.array([0.5]))
    alpha = rasterize(arrangement, [None], None, (701, 599), supersample=1)[..., 3]
    assert set(np.unique(alpha).tolist()) == {0.0, 0.5}
    polygon = shape.points[1:] * 0.9
    following = np.roll(polygon, -1, axis=0)
    area = 0.5 * abs((polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]).sum())
    assert (alpha > 0).mean() == pytest.approx(area, rel=1e-3)


def test_a_grey_world_stays_grey(rng):
    arrangement = replace(random_arrangement(rng, shadow=False), colors=np.zeros((0, 3), np.float32))
    textures = [np.full((9, 7, 3), 0.25, np.float32), np.full((4, 4, 4), 0.25, np.float32), np.full((2, 3, 3), 0.25)]
    picture = rasterize(arrangement, textures, (0.25, 0.25, 0.25), (83, 41))
    assert np.allclose(picture, [0.25, 0.25, 0.25, 1.0], atol=1e-5)


def test_the_arrangement_repeats(rng):
    arrangement = random_arrangement(rng)
    textures = random_textures(rng, arrangement)
    background = rng.random((8, 8, 3)).astype(np.float32)
    whole = rasterize(arrangement, textures, background, (64, 64))
    moved = rasterize(arrangement, textures, background, (64, 64), window=(2.5, -0.75, 3.5, 0.25))
    assert np.allclose(np.roll(whole, (16, -32), axis=(0, 1)), moved, atol=1e-5)


def test_windows_are_parts_of_the_whole_whatever_tiles_and_threads(rng):
    arrangement = random_arrangement(rng)
    textures = random_textures(rng, arrangement)
    whole = rasterize(arrangement, textures, (0.5, 0.5, 0.5), (300, 200), supersample=4, jobs=1)
    window = (120 / 300, 1 - 170 / 200, 270 / 300, 1 - 40 / 200)
    part = rasterize(arrangement, textures, (0.5, 0.5, 0.5), (150, 130), window=window, supersample=4, jobs=3)
    assert np.allclose(whole[40:170, 120:270], part, atol=1e-5)


def test_coarse_picture_is_the_mean_of_a_fine_one(rng):
    """Levels of images are as fine as samples, so that little is lost but what lies below a sample."""
    arrangement = random_arrangement(rng, shadow=True)
    textures = [rng.random((256, 256, 3)).astype(np.float32) for _ in range(3)]
    fine = rasterize(arrangement, textures, (0.0, 0.0, 0.0), (1024, 1024), supersample=2)
    coarse = rasterize(arrangement, textures, (0.0, 0.0, 0.0), (32, 32))
    assert np.abs(coarse - fine.reshape(32, 32, 32, 32, 4).mean(axis=(1, 3))).max() < 0.02


def two_squares(**more):
    """A small square in front of a large one."""
    matrices = [placed((0.5, 0.5), 0.2), placed((0.5, 0.5), 0.6)]
    colors = np.repeat([[0.8, 0.2, 0.2], [0.2, 0.8, 0.2]], 5, axis=0).astype(np.float32)
    return arranged([shape_of(SQUARE)], matrices, colors=colors, **more)


def test_shadow_falls_on_what_lies_behind_alone():
    arrangement = two_squares(shadow_offset=(0.1, 0.0), shadow_strength=0.5)
    picture = rasterize(arrangement, [None], (0.0, 0.0, 1.0), (100, 100), supersample=1)
    front, green, ground = [0.8, 0.2, 0.2], [0.2, 0.8, 0.2], [0.0, 0.0, 1.0]
    assert np.allclose(picture[50, 50, :3], front)  # also where its own shadow would fall
    assert np.allclose(picture[50, 57, :3], front)
    assert np.allclose(picture[50, 65, :3], 0.5 * np.array(green))
    assert np.allclose(picture[50, 75, :3], green)
    assert np.allclose(picture[50, 85, :3], 0.5 * np.array(ground))
    assert np.allclose(picture[50, 95, :3], ground)
    assert np.allclose(picture[..., 3], 1)


def test_shadows_of_several_umbrellas_do_not_add_up():
    matrices = [placed((0.3, 0.5), 0.2), placed((0.3, 0.5), 0.19), placed((0.3, 0.5), 0.18)]
    colors = np.zeros((15, 3), np.float32)
    arrangement = arranged([shape_of(SQUARE)], matrices, colors=colors, shadow_offset=(0.4, 0.0), shadow_strength=0.5)
    picture = rasterize(arrangement, [None], (1.0, 1.0, 1.0), (100, 100), supersample=1)
    assert np.allclose(picture[50, 70, :3], 0.5)


def test_shadow_of_a_translucent_umbrella_is_as_deep_as_it_is_opaque():
    arrangement = two_squares(shadow_offset=(0.2, 0.0), shadow_strength=0.5, coverages=np.array([0.4, 1.0]))
    picture = rasterize(arrangement, [None], (0.0, 0.0, 1.0), (100, 100), supersample=1)
    assert np.allclose(picture[50, 72, :3], np.array([0.2, 0.8, 0.2]) * (1 - 0.5 * 0.4), atol=1e-6)


def test_shadow_comes_in_across_the_border():
    matrices = [placed((0.95, 0.5), 0.08)]
    arrangement = arranged([shape_of(SQUARE)], matrices, shadow_offset=(0.1, 0.0), shadow_strength=1.0)
    picture = rasterize(arrangement, [None], (1.0, 1.0, 1.0), (100, 20), supersample=1)
    assert np.allclose(picture[10, 5], [0, 0, 0, 1]) and np.allclose(picture[10, 15], 1)


def test_without_umbrellas_the_background_is_seen(rng):
    background = rng.random((6, 10, 4)).astype(np.float32)
    picture = rasterize(arranged([], []), [], background, (10, 6), supersample=1)
    assert np.allclose(picture[..., 3], background[..., 3], atol=1e-6)
    assert np.allclose(picture[..., :3], background[..., :3] * background[..., 3:], atol=1e-6)
    assert not rasterize(arranged([], []), [], None, (5, 3)).any()


def test_background_wraps_as_asked():
    background = np.linspace(0, 1, 8, dtype=np.float32)[None, :, None] * np.ones((1, 1, 3), np.float32)
    window = (-1.0, 0.0, 2.0, 1.0)
    shown = {
        mode: rasterize(arranged([], []), [], background, (24, 1), window=window, background_wrap=(mode, "clamp"))
        for mode in ("repeat", "clamp", "mirror")
    }
    ramp = background[0, :, 0]
    assert np.allclose(shown["repeat"][0, 1:7, 0], ramp[1:7], atol=1e-6)
    assert np.allclose(shown["clamp"][0, :7, 0], 0) and np.allclose(shown["clamp"][0, 17:, 0], 1)
    assert np.allclose(shown["mirror"][0, 1:7, 0], ramp[::-1][1:7], atol=1e-6)


@pytest.mark.parametrize(
    "matrix",
    [np.zeros((3, 3)), np.full((3, 3), np.nan), np.diag([np.inf, 1.0, 1.0]), placed((0.5, 0.5), 0.5, 0, (4.0, 0.0))],
    ids=["singular", "not a number", "infinite", "through infinity"],
)
def test_umbrella_that_cannot_be_drawn_is_left_out(matrix):
    good = placed((0.5, 0.5), 0.4)
    colors = np.full((10, 3), 0.5, np.float32)
    both = arranged([shape_of(SQUARE)], [matrix, good], colors=colors, shadow_strength=0.5, shadow_offset=(0.1, 0.1))
    alone = replace(both, matrices=good[None], colors=colors[5:], shape_of=both.shape_of[1:], morphs=np.zeros(1))
    expected = rasterize(alone, [None], (1, 1, 1), (40, 40))
    assert np.array_equal(rasterize(both, [None], (1, 1, 1), (40, 40)), expected)


def test_sectors_without_area_draw_nothing():
    """Coincident vertices, and contour vertices at the centre."""
    points = np.array([[0, 0], [0.5, 0], [0.5, 0], [0, 0.5], [0, 0], [0, 0], [-0.4, 0.1]])
    arrangement = arranged([shape_of(points)], [placed((0.5, 0.5), 1.0)], colors=np.ones((7, 3), np.float32))
    picture = rasterize(arrangement, [None], None, (50, 50), supersample=1)
    assert np.isfinite(picture).all()
    assert picture[20, 30, 3] == 1 and picture[20, 20, 3] == 0 and picture[40, 40, 3] == 0


def test_vectors_turn_with_their_umbrella():
    """A quarter turn takes +x to +y."""
    texture = np.broadcast_to(np.array([0.9, 0.4, 0.7], np.float32), (4, 4, 3))
    arrangement = arranged([shape_of(SQUARE)], [placed((0.5, 0.5), 1.0, 90.0)])
    picture = rasterize(arrangement, [texture], None, (8, 8), vector_scale=(2.0, 2.0), vector_bias=(-1.0, -1.0))
    assert np.allclose(picture[4, 4], [0.6, 0.9, 0.7, 1.0], atol=1e-5)
    upright = rasterize(arrangement, [texture], None, (8, 8))
    assert np.allclose(upright[4, 4], [0.9, 0.4, 0.7, 1.0], atol=1e-5)


def test_offsets_of_colour_are_clamped():
    texture = np.full((4, 4, 3), 0.5, np.float32)
    colors = np.tile(np.array([[0.8, -0.8, 0.1]], np.float32), (5, 1))
    arrangement = arranged([shape_of(SQUARE)], [placed((0.5, 0.5), 1.0)], colors=colors, color_blend=0.75)
    assert np.allclose(rasterize(arrangement, [texture], None, (4, 4))[2, 2, :3], [1.0, 0.0, 0.575], atol=1e-6)


def test_many_copies_of_an_umbrella_wider_than_the_period(rng):
    arrangement = arranged([shape_of(SQUARE)], [placed((0.5, 0.5), 3.0)], colors=np.ones((5, 3), np.float32))
    assert np.allclose(rasterize(arrangement, [None], None, (9, 9)), 1.0)


def test_bad_arguments_are_named(rng):
    arrangement = two_squares()
    with pytest.raises(FexelError, match="size is 0 x 4"):
        rasterize(arrangement, [None], None, (0, 4))
    with pytest.raises(FexelError, match="2 textures for 1 shapes"):
        rasterize(arrangement, [None, None], None, (4, 4))
    with pytest.raises(FexelError, match="supersample is 'some'"):
        rasterize(arrangement, [None], None, (4, 4), supersample="some")
    with pytest.raises(FexelError, match="group is 3, expected auto or a divisor of 4"):
        rasterize(arrangement, [None], None, (4, 4), supersample=4, group=3)
    with pytest.raises(FexelError, match="without area"):
        rasterize(arrangement, [None], None, (4, 4), window=(0.2, 0.0, 0.2, 1.0))


@pytest.mark.parametrize("shadow", [False, True])
def test_groups_of_samples_share_colours_but_not_edges_and_shadows(rng, shadow):
    arrangement = random_arrangement(rng, shadow=shadow)
    arrangement = replace(arrangement, colors=np.zeros((0, 3), np.float32))
    color = rng.random(3)
    textures = [np.tile(color.astype(np.float32), (9, 7, 1)) for _ in arrangement.shapes]
    exact = rasterize(arrangement, textures, (0.1, 0.2, 0.3, 1.0), (50, 40), supersample=4)
    shared = rasterize(arrangement, textures, (0.1, 0.2, 0.3, 1.0), (50, 40), supersample=4, group=4)
    assert np.abs(shared - exact).max() < 2e-6


@pytest.mark.parametrize("group", [2, 4])
def test_shared_colours_are_those_of_the_middle(rng, group):
    """Where colour is linear in the plane, the middle of a group has its mean."""
    shape = Shape(SQUARE, SQUARE, SQUARE + 0.5)
    ramp = np.linspace(0.1, 0.9, 32, dtype=np.float32)
    texture = np.stack(np.broadcast_arrays(ramp[None, :], ramp[:, None], ramp[None, :]), axis=-1)
    vertex_colors = np.concatenate([[[0.0, 0.0, 0.0]], SQUARE[1:] @ rng.uniform(-0.05, 0.05, (2, 3))])
    arrangement = arranged([shape], [placed((0.5, 0.5), 1.6, 20.0)], colors=vertex_colors.astype(np.float32))
    window = (0.3, 0.3, 0.7, 0.7)  # away from where the image is clamped
    exact = rasterize(arrangement, [texture], None, (24, 24), window=window, supersample=4)
    shared = rasterize(arrangement, [texture], None, (24, 24), window=window, supersample=4, group=group)
    assert np.ptp(exact[..., 0]) > 0.1
    assert np.abs(shared - exact).max() < 1e-3


def test_contours_of_any_kind_cover_the_same_with_shared_colours(rng):
    """Stars are filled as a whole, folded contours and those of many edges sector by sector."""
    points = star(rng, 9)
    folded = points.copy()
    folded[3] = -0.5 * folded[3]
    comb = star(rng, 160)
    shapes = [shape_of(points), shape_of(folded), shape_of(comb)]
    matrices = [placed(rng.random(2), 0.5, angle, (0.1, 0.2)) for angle in (10, 50, 200, 300, 80, 120)]
    arrangement = arranged(
        shapes, matrices, shape_of=np.arange(6, dtype=np.int32) % 3, shadow_offset=(0.05, 0.02), shadow_strength=0.5
    )
    textures = [np.full((2, 2, 3), 0.5, np.float32)] * 3
    exact, shared = (
        rasterize(arrangement, textures, (0, 0, 0, 0), (60, 60), supersample=6, group=group) for group in (1, 3)
    )
    assert exact[..., 3].max() == 1
    assert np.abs(shared - exact).max() < 2e-6
