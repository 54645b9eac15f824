"""The float64 twin: against a painter that knows nothing of its machinery, laws of light, edges, levels, hard cases."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from bench.fall_leaves import fall_leaves
from bench.zipmap_stage import save
from fexel import images
from fexel.errors import FexelWarning
from fexel.textures.image_source import ImageSource
from fexel.textures.umbrella import UmbrellaData, UmbrellaLevelData
from fexel.textures.umbrella_arrangement import Arrangement, Shape
from fexel.textures.umbrella_twin import UmbrellaTwin

SQUARE = np.array([(0, 0), (-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
NO_COLORS = np.zeros((0, 3), np.float32)
SOIL = (0.125, 0.25, 0.0625, 1.0)  # half floats hold it
CLAMP = ("clamp", "clamp")


def placement(x, y, size=0.1, degrees=0.0, aspect=1.0):
    cos, sin = np.cos(np.radians(degrees)) * size, np.sin(np.radians(degrees)) * size
    return np.array([[cos, sin * aspect, 0], [-sin, cos * aspect, 0], [x, y, 1]])


def umbrellas(*matrices, points=SQUARE, image=None, tex_coords=None, **fields):
    """Umbrellas of one shape, the first in front."""
    shape = Shape(points, points, points + 0.5 if tex_coords is None else tex_coords, image)
    count = len(matrices)
    values = {"colors": NO_COLORS, "coverages": np.ones(count), "morphs": np.zeros(count), **fields}
    placed = np.array(matrices, float).reshape(-1, 3, 3)
    return Arrangement((shape,), np.zeros(count, np.int32), placed, **values)


def ground(arrangement, background=SOIL, **fields):
    return UmbrellaData(ImageSource("", wrap=CLAMP, fallback=background), arrangement, **fields)


def look(data, st, jacobian=None, **options):
    hard = options.pop("hard", False)
    return UmbrellaTwin(data, "/Lawn", **options).sample(np.asarray(st, float), jacobian, hard=hard)


def colored(count, color, vertices=5):
    """Vertex colours, all the same."""
    return np.tile(np.asarray(color, np.float32), (count * vertices, 1))


def lattice(pixels, low=(0.0, 0.0), high=(1.0, 1.0)):
    at = (np.arange(pixels) + 0.5) / pixels
    span = np.subtract(high, low)
    return np.stack(np.meshgrid(at, at), -1).reshape(-1, 2) * span + low, np.diag(span / pixels)


# A painter


def cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def painted(arrangement, ramps, st, background=SOIL):
    """Point samples by triangles in st, umbrella by umbrella; images are ramps (opacity, at 0, along u, along v)."""
    st = st - np.floor(st)
    color, through, lit = np.zeros((len(st), 4)), np.ones(len(st)), np.ones(len(st))
    for number in range(len(arrangement)):
        first, end = arrangement.first_vertex[number : number + 2]
        vertices = arrangement.vertices[first:end]
        reach = int(np.ceil(np.abs(vertices).max() + np.abs(arrangement.shadow_offset).max() + 1))
        for s in range(-reach, reach + 1):
            for t in range(-reach, reach + 1):
                place = st + (s, t)
                straight, alpha = shown(arrangement, ramps, number, place)
                light = 1 - arrangement.shadow_strength * (1 - lit)
                color[:, :3] += (through * alpha * light)[:, None] * straight
                color[:, 3] += through * alpha
                shade = shown(arrangement, ramps, number, place - arrangement.shadow_offset)[1]
                through, lit = through * (1 - alpha), lit * (1 - shade)
    light = 1 - arrangement.shadow_strength * (1 - lit)
    color[:, :3] += (through * light)[:, None] * np.array(background[:3]) * background[3]
    color[:, 3] += through * background[3]
    return color


def shown(arrangement, ramps, number, place):
    first, end = arrangement.first_vertex[number : number + 2]
    vertices = arrangement.vertices[first:end]
    shape = arrangement.shapes[arrangement.shape_of[number]]
    color, alpha = np.zeros((len(place), 3)), np.zeros(len(place))
    for i in range(1, len(vertices)):
        corners = [0, i, i % (len(vertices) - 1) + 1]
        p, q, r = vertices[corners]
        area = cross(q - p, r - p)
        weights = np.stack([cross(r - q, place - q), cross(p - r, place - r), cross(q - p, place - p)], 1) / area
        inside = (weights >= 0).all(axis=1)
        uv = weights @ shape.tex_coords[corners]
        opacity, base, along_u, along_v = ramps[arrangement.shape_of[number]]
        value = np.array(base) + uv[:, :1] * along_u + uv[:, 1:] * along_v
        if len(arrangement.colors):
            value = value + arrangement.color_blend * (weights @ arrangement.colors[first + np.array(corners)])
        color[inside] = np.clip(value[inside], 0, 1)
        alpha[inside] = opacity * arrangement.coverages[number]
    return color, alpha


def ramp_image(path, opacity, base, along_u, along_v, size=32):
    at = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(at, at[::-1])
    color = np.array(base) + u[..., None] * along_u + v[..., None] * along_v
    texels = np.concatenate([color * opacity, np.full((size, size, 1), opacity)], -1)
    file = save(path, texels if opacity < 1 else texels[..., :3], "float32")
    return ImageSource(file, color_space="raw", wrap=CLAMP)


RAMPS = [
    (1.0, (0.1, 0.2, 0.3), (0.5, 0.0, 0.2), (0.0, 0.6, 0.1)),
    (0.6, (0.8, 0.1, 0.2), (-0.5, 0.2, 0.0), (0.1, 0.3, 0.5)),
    (1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),  # of the shape without an image
]


@pytest.fixture
def forest(tmp_path, rng):
    """Stars of three shapes, with and without an image: turned, mirrored, tilted, morphed, over the borders."""

    def make(count=25, size=0.35, perspective=0.0, **fields):
        images = [ramp_image(tmp_path / f"{i}.exr", *ramp) for i, ramp in enumerate(RAMPS[:2])]
        shapes = []
        for number, vertices in enumerate((6, 9, 14)):
            angle = np.arange(vertices - 1) / (vertices - 1) * 2 * np.pi
            rays = np.stack([np.cos(angle), np.sin(angle)], 1)
            points, other = (
                np.concatenate([[(0, 0)], rays * rng.uniform(0.3, 0.5, (vertices - 1, 1))]) for _ in range(2)
            )
            uv = 0.5 + 0.6 * points
            shapes.append(Shape(points, other, uv, images[number] if number < 2 else None))
        index = rng.integers(0, 3, count).astype(np.int32)
        matrices = np.array(
            [placement(*rng.uniform(0, 1, 2), size * rng.uniform(0.6, 1.4), rng.uniform(0, 360)) for _ in range(count)]
        )
        matrices[: count // 3, 0] *= -1
        matrices[:, :2, 2] = rng.uniform(-perspective, perspective, (count, 2))
        total = sum(len(shapes[i].points) for i in index)
        values = {
            "morphs": rng.uniform(0, 1, count),
            "colors": rng.uniform(-0.4, 0.4, (total, 3)).astype(np.float32),
            "coverages": np.where(rng.uniform(size=count) < 0.3, 0.7, 1.0),
            "color_blend": 0.8,
            **fields,
        }
        return Arrangement(tuple(shapes), index, matrices, **values)

    return make


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"shadow_strength": 0.7, "shadow_offset": (0.03, -0.05)},
        {"shadow_strength": 1.0, "shadow_offset": (0.4, 0.3)},
        {"shadow_strength": 0.5, "shadow_offset": (0.0, 0.0)},
        {"size": 1.6, "count": 5, "shadow_strength": 0.5, "shadow_offset": (0.1, 0.1)},
        {"size": 0.05, "count": 60},
    ],
)
def test_twin_shows_what_a_painter_paints(forest, rng, fields):
    arrangement = forest(**fields)
    st = rng.uniform(-1.5, 2.5, (800, 2))
    result = look(ground(arrangement), st, hard=True)
    assert np.abs(result - painted(arrangement, RAMPS, st)).max() < 2e-3  # half floats hold the ramps


def test_perspective_places_edges_and_texture_exactly(forest, rng):
    arrangement = forest(count=12, perspective=0.9)
    st = rng.uniform(0, 1, (1500, 2))
    flat = replace(arrangement, colors=NO_COLORS)
    ramps = [(1.0 if i != 1 else 0.6, (0.3, 0.4, 0.5), (0, 0, 0), (0, 0, 0)) for i in range(3)]
    constant = tuple(replace(shape, image=None) for shape in flat.shapes)
    painted_edges = painted(replace(flat, shapes=constant), [(1.0, *ramps[0][1:])] * 3, st)[:, :3] == SOIL[:3]
    seen_edges = look(ground(replace(flat, shapes=constant)), st, hard=True)[:, :3] == SOIL[:3]
    assert (painted_edges == seen_edges).all()
    assert 0.05 < seen_edges.mean() < 0.95
    # In patch space the texture is a ramp: what is seen is its value at the point mapped back.
    one = umbrellas(
        arrangement.matrices[0], image=arrangement.shapes[0].image, tex_coords=0.5 + 0.6 * SQUARE, coverages=np.ones(1)
    )
    back = np.concatenate([st, np.ones((len(st), 1))], 1) @ np.linalg.inv(arrangement.matrices[0])
    uv = 0.5 + 0.6 * back[:, :2] / back[:, 2:]
    inside = (np.abs(uv - 0.5) < 0.29).all(axis=1) & (back[:, 2] > 0)
    _, base, along_u, along_v = RAMPS[0]
    truth = np.array(base) + uv[:, :1] * along_u + uv[:, 1:] * along_v
    assert inside.sum() > 20
    assert np.abs(look(ground(one), st, hard=True)[inside, :3] - truth[inside]).max() < 2e-3


def test_moving_all_umbrellas_moves_the_picture_over_the_borders(forest, rng):
    arrangement = forest(shadow_strength=0.6, shadow_offset=(0.05, 0.02))
    move = np.array([0.37, 0.81])
    matrices = arrangement.matrices.copy()
    matrices[:, 2, :2] = np.mod(matrices[:, 2, :2] + move, 1.0)
    st, axes = rng.uniform(0, 1, (2000, 2)), np.array([[0.004, 0.001], [-0.002, 0.003]])
    before = look(ground(arrangement), st, axes)
    after = look(ground(replace(arrangement, matrices=matrices)), st + move, axes)
    assert np.abs(before - after).max() < 1e-9


@pytest.mark.parametrize("size", [(1, 1), (3, 50), (200, 200)])
def test_cells_do_not_change_the_picture(forest, rng, monkeypatch, size):
    arrangement = forest(shadow_strength=0.6, shadow_offset=(0.05, 0.02))
    st, axes = rng.uniform(0, 1, (1000, 2)), np.array([[0.02, 0.001], [-0.002, 0.03]])
    usual = look(ground(arrangement), st, axes)
    monkeypatch.setattr("fexel.textures.umbrella_layers.fine_size", lambda _: size)
    assert np.abs(look(ground(arrangement), st, axes) - usual).max() < 1e-12


# Colours and order


def test_vertices_centre_and_spokes_show_their_colours():
    colors = np.array([(0.1, 0, 0), (0.2, 0, 0), (0.3, 0.5, 0), (0.4, 0, 0.5), (0.9, 0, 0)], np.float32)
    arrangement = umbrellas(placement(0.5, 0.5, 0.8), colors=colors)
    corners = 0.5 + 0.8 * SQUARE[1:]
    inner = 0.5 + 0.8 * SQUARE[1:] * (1 - 1e-12)
    spokes = 0.5 + 0.8 * 0.25 * SQUARE[1:]
    data = ground(arrangement)
    assert look(data, [[0.5, 0.5]])[0] == pytest.approx([0.1, 0, 0, 1], abs=1e-6)
    assert np.allclose(look(data, inner)[:, :3], colors[1:], atol=1e-6)
    assert np.allclose(look(data, spokes)[:, :3], 0.75 * colors[0] + 0.25 * colors[1:], atol=1e-6)
    assert np.isfinite(look(data, corners)).all()


def test_the_first_umbrella_lies_on_top():
    red_over_green = np.repeat(np.array([(1, 0, 0), (0, 1, 0)], np.float32), 5, axis=0)
    arrangement = umbrellas(placement(0.4, 0.5, 0.4), placement(0.6, 0.5, 0.4), colors=red_over_green)
    assert look(ground(arrangement), [[0.5, 0.5], [0.7, 0.5]])[:, :3].tolist() == [[1, 0, 0], [0, 1, 0]]


def test_coverage_lets_what_lies_below_be_seen():
    colors = np.repeat(np.array([(1, 0, 0), (0, 1, 0)], np.float32), 5, axis=0)
    arrangement = umbrellas(
        placement(0.5, 0.5, 0.5), placement(0.5, 0.5, 0.5), colors=colors, coverages=np.array([0.25, 0.5])
    )
    shown = look(ground(arrangement, (0, 0, 1, 1)), [[0.5, 0.5]])
    assert shown[0] == pytest.approx([0.25, 0.375, 0.375, 1])


def test_colours_are_clamped_after_the_offsets():
    arrangement = umbrellas(placement(0.5, 0.5, 0.5), colors=colored(1, (3, -2, 0.5)), color_blend=0.5)
    assert look(ground(arrangement), [[0.5, 0.5]])[0] == pytest.approx([1, 0, 0.25, 1])


def test_transparent_background_stays_transparent():
    arrangement = umbrellas(placement(0.5, 0.5, 0.5), colors=colored(1, (1, 1, 1)))
    shown = look(ground(arrangement, (1, 1, 1, 0.25)), [[0.5, 0.5], [0.1, 0.1]])
    assert shown.tolist() == [[1, 1, 1, 1], [0.25, 0.25, 0.25, 0.25]]


def test_scale_and_bias_apply_to_the_finished_picture():
    arrangement = umbrellas(placement(0.5, 0.5, 0.5), colors=colored(1, (0.5, 1, 0)))
    data = ground(arrangement, (0.25, 0.25, 0.25, 0.5), scale=(2, 2, 2, 1), bias=(-1, -1, -1, 0))
    assert look(data, [[0.5, 0.5], [0.1, 0.1]]).tolist() == [[0, 1, -1, 1], [-0.25, -0.25, -0.25, 0.5]]


def test_vectors_turn_with_their_umbrella():
    tilted = colored(1, (1.0, 0.5, 0.5))  # x = 1
    data = [
        ground(
            umbrellas(placement(0.5, 0.5, 0.3, degrees, 2.0), colors=tilted),
            (0.5, 0.5, 1, 1),
            scale=(2, 2, 2, 1),
            bias=(-1, -1, -1, 0),
            turns_vectors=True,
        )
        for degrees in (0, 90, 30)
    ]
    shown = [look(one, [[0.5, 0.5], [0.1, 0.1]]) for one in data]
    assert np.allclose([s[0, :3] for s in shown], [(1, 0, 0), (0, 1, 0), (0.75**0.5, 0.5, 0)], atol=1e-7)
    assert np.allclose([s[1, :3] for s in shown], (0, 0, 1))
    mirrored = umbrellas(placement(0.5, 0.5, 0.3) * [[-1], [1], [1]], colors=tilted)
    assert np.allclose(look(replace(data[0], arrangement=mirrored), [[0.5, 0.5]])[0, :3], (-1, 0, 0), atol=1e-7)


# Shadows


def test_shadow_falls_on_what_lies_below_and_not_on_itself():
    arrangement = umbrellas(
        placement(0.5, 0.5, 0.2), colors=colored(1, (1, 1, 1)), shadow_offset=(0.15, 0.0), shadow_strength=0.75
    )
    points = [[0.5, 0.5], [0.59, 0.5], [0.65, 0.5], [0.74, 0.5], [0.76, 0.5], [0.3, 0.5]]
    shown = look(ground(arrangement, (0.75, 0.75, 0.75, 1)), points, hard=True)
    assert np.allclose(shown[:, 0], [1, 1, 0.1875, 0.1875, 0.75, 0.75])
    assert (shown[:, 3] == 1).all()


def test_several_shadows_do_not_add_up():
    arrangement = umbrellas(
        *[placement(0.3, 0.3, 0.3)] * 5, colors=colored(5, (1, 1, 1)), shadow_offset=(0.4, 0.0), shadow_strength=0.5
    )
    assert look(ground(arrangement, (0.75, 0.75, 0.75, 1)), [[0.7, 0.3]], hard=True)[0, 0] == pytest.approx(0.375)


def test_umbrellas_behind_do_not_shade_what_is_in_front():
    white = colored(2, (1, 1, 1))
    below = umbrellas(
        placement(0.6, 0.5, 0.2),
        placement(0.4, 0.5, 0.2),
        colors=white,
        shadow_offset=(0.2, 0.0),
        shadow_strength=1.0,
    )
    above = replace(below, matrices=below.matrices[::-1].copy())
    assert look(ground(below), [[0.6, 0.5]], hard=True)[0, 0] == 1
    assert look(ground(above), [[0.6, 0.5]], hard=True)[0, 0] == 0


def test_shadow_of_what_is_half_there_is_half_as_dark():
    arrangement = umbrellas(
        placement(0.3, 0.3, 0.2),
        colors=colored(1, (1, 1, 1)),
        coverages=np.array([0.5]),
        shadow_offset=(0.4, 0.0),
        shadow_strength=0.8,
    )
    assert look(ground(arrangement, (1, 1, 1, 1)), [[0.7, 0.3]], hard=True)[0, 0] == pytest.approx(0.6)


def test_shadows_come_in_over_the_border():
    arrangement = umbrellas(
        placement(0.9, 0.5, 0.1), colors=colored(1, (1, 1, 1)), shadow_offset=(0.2, 0.0), shadow_strength=1.0
    )
    assert look(ground(arrangement, (1, 1, 1, 1)), [[0.1, 0.5], [0.3, 0.5]], hard=True)[:, 0].tolist() == [0, 1]


# Edges


@pytest.mark.parametrize("degrees", [0, 33, 45, 120])
@pytest.mark.parametrize("perspective", [False, True])
def test_edges_are_ramps_of_one_pixel_across_them(degrees, perspective):
    matrix = placement(0.5, 0.5, 0.5, degrees)
    if perspective:
        matrix[:2, 2] = 0.2, -0.1
    pixel = 0.01
    arrangement = umbrellas(matrix, colors=colored(1, (1, 1, 1)))
    corners = np.concatenate([SQUARE[1:3], np.ones((2, 1))[:, :0]], 1)
    a, b = (np.array([*corner, 1]) @ matrix for corner in corners)
    a, b = a[:2] / a[2], b[:2] / b[2]
    inward = np.array([-(b - a)[1], (b - a)[0]]) / np.linalg.norm(b - a)
    distance = np.linspace(-0.7, 0.7, 15)
    st = (a + b) / 2 + distance[:, None] * pixel * inward
    turned = np.array([[0.6, -0.8], [0.8, 0.6]]) * pixel  # a pixel that lies askew is as wide
    for axes in (np.eye(2) * pixel, turned):
        shown = look(ground(arrangement, (0, 0, 0, 1)), st, axes)[:, 0]
        assert np.allclose(shown, np.clip(0.5 + distance, 0, 1), atol=1e-9 if not perspective else 5e-3)


def test_hard_edges_are_what_soft_ones_are_the_average_of(forest):
    arrangement = forest(shadow_strength=0.6, shadow_offset=(0.04, 0.03), coverages=np.ones(25))
    pixels, samples = 64, 8
    st, axes = lattice(pixels)
    soft = look(ground(arrangement), st, axes)
    fine, _ = lattice(pixels * samples)
    hard = look(ground(arrangement), fine, axes / samples, hard=True)
    truth = hard.reshape(pixels, samples, pixels, samples, 4).mean(axis=(1, 3)).reshape(-1, 4)
    assert np.abs(soft - truth).mean() < 0.012
    assert np.abs((soft - truth).mean(axis=0)).max() < 0.002


# Wrap


def test_wrap_modes_continue_the_texture_as_they_say(forest, rng):
    arrangement = forest()
    st = rng.uniform(0.05, 0.95, (300, 2))
    axes = np.array([[0.01, 0.002], [0.001, 0.012]])

    def shown(wrap, place, jacobian=axes):
        return look(ground(arrangement, wrap=(wrap, wrap)), place, jacobian, most_probes=1)

    inside = shown("repeat", st)
    assert np.allclose(shown("repeat", st + (3, -2)), inside, atol=1e-9)
    assert np.allclose(shown("mirror", st), inside, atol=1e-9)
    assert np.allclose(shown("mirror", 2 - st, -axes), inside, atol=1e-9)
    assert np.allclose(shown("mirror", -st, -axes), inside, atol=1e-9)
    assert np.allclose(shown("clamp", st), inside, atol=1e-9)
    assert np.allclose(shown("clamp", st * (1, 0) + (0, 7)), shown("clamp", st * (1, 0) + (0, 1)), atol=1e-9)
    assert not shown("black", st + (1, 0)).any()
    assert not shown("patch", st - (0, 1)).any()
    assert np.allclose(shown("patch", st), inside, atol=1e-9)


def test_wrap_of_the_file_is_black_without_one(forest):
    arrangement = forest()
    data = ground(arrangement, wrap=("useMetadata", "repeat"))
    assert UmbrellaTwin(data, "/Lawn").wrap == ("black", "repeat")


def test_background_image_wraps_as_the_texture_does(tmp_path, rng):
    file = save(tmp_path / "soil.tif", rng.uniform(size=(8, 8, 3)).astype(np.float32))
    source = ImageSource(file, color_space="raw", wrap=("mirror", "repeat"))
    data = UmbrellaData(source, umbrellas(), wrap=("mirror", "repeat"))
    st = rng.uniform(0, 1, (100, 2))
    assert np.allclose(look(data, st + (2, 1)), look(data, st))
    assert np.allclose(look(data, st * (-1, 1)), look(data, st))


def test_matrix_places_the_texture(forest, rng):
    arrangement = forest()
    matrix = np.array([[2.0, 0.3, 0.1], [-0.2, 1.5, 0.2], [0.1, 0.4, 1.0]])
    st = rng.uniform(0, 1, (500, 2))
    homogeneous = np.concatenate([st, np.ones((500, 1))], 1) @ matrix
    place = homogeneous[:, :2] / homogeneous[:, 2:]
    placed = look(ground(arrangement, st_to_texture=tuple(map(tuple, matrix))), st, hard=True)
    assert np.abs(placed - look(ground(arrangement), place, hard=True)).max() < 1e-9


# Footprints


def test_one_colour_stays_it_at_every_footprint(tmp_path, rng):
    color = np.array([0.25, 0.5, 0.125])
    file = save(tmp_path / "flat.exr", np.tile(np.float32(color), (16, 16, 1)), "float32")
    source = ImageSource(file, color_space="raw", wrap=CLAMP)
    matrices = [placement(*rng.uniform(0, 1, 2), 0.2, rng.uniform(0, 360)) for _ in range(60)]
    arrangement = umbrellas(*matrices, image=source)
    data = ground(arrangement, (*color, 1.0))
    st = rng.uniform(-1, 2, (80, 2))
    for width in (1e-9, 0.2 / 16 / 100, 1e-3, 0.05, 0.3, 1.0, 10.0):
        for shape in (np.eye(2), np.array([[1, 40], [0.01, 0.3]]), np.array([[1, 0], [0, 1e-9]]), np.zeros((2, 2))):
            shown = look(data, st, width * shape)
            assert np.abs(shown - (*color, 1.0)).max() < 1e-6


def test_minified_picture_keeps_its_mean(forest):
    arrangement = forest(count=120, size=0.12, grid=(8, 8), coverages=np.ones(120))
    fine, _ = lattice(512)
    mean = look(ground(arrangement), fine, hard=True).mean(axis=0)
    for pixels in (64, 32):
        st, axes = lattice(pixels)
        assert np.abs(look(ground(arrangement), st, axes).mean(axis=0) - mean).max() < 0.01


def test_small_leaves_are_as_bright_as_the_average_of_points(tmp_path):
    """Ten pixels long, dark rims and shadows: what mip levels mix in past the outline must not tell."""
    leaves = fall_leaves(tmp_path, count=1500, grid=(16, 24), texture_size=128)
    data = UmbrellaData(leaves.background, leaves.arrangement)
    low, high = (0.2, 0.3), (0.7, 0.6333)
    points = lattice(64 * 6, low, high)[0]
    hard = look(data, points, hard=True).reshape(64, 6, 64, 6, 4).mean(axis=(1, 3))[..., :3]
    st, jacobian = lattice(64, low, high)
    soft = look(data, st, jacobian).reshape(64, 64, 4)[..., :3]
    assert soft.mean() == pytest.approx(hard.mean(), rel=0.015)
    assert np.sqrt(np.mean((soft - hard) ** 2)) < 0.085 * hard.std()


def test_long_footprints_average_along_their_axis(forest):
    arrangement = forest(count=60, size=0.2, grid=(8, 8))
    axes = np.array([[0.12, 0.0], [0.0, 0.01]])
    st = np.random.default_rng(4).uniform(0, 1, (200, 2))
    result = look(ground(arrangement), st, axes)
    along, across = np.meshgrid((np.arange(96) + 0.5) / 96 - 0.5, (np.arange(8) + 0.5) / 8 - 0.5)
    places = st[:, None] + np.stack([along, across], -1).reshape(-1, 2) * (0.12, 0.01)
    truth = look(ground(arrangement), places.reshape(-1, 2), hard=True).reshape(200, -1, 4).mean(axis=1)
    assert np.abs(result - truth).mean() < 0.03
    blurred = look(ground(arrangement), st, axes, most_probes=1)
    assert np.abs(result - truth).mean() < 0.6 * np.abs(blurred - truth).mean()


def test_nothing_that_is_not_finite_comes_out(forest):
    arrangement = forest()
    nan, inf = float("nan"), float("inf")
    st = [[nan, 0], [0, inf], [0.5, 0.5], [1e300, 0.5], [0.5, 0.5]]
    axes = np.tile(np.eye(2) * 0.01, (5, 1, 1))
    axes[2] = nan
    shown = look(ground(arrangement), st, axes)
    assert np.isfinite(shown).all()
    assert not shown[:3].any()
    assert shown[4, 3] == 1
    behind = ((1, 0, 1), (0, 1, 0), (0, 0, 1))
    assert not look(ground(arrangement, st_to_texture=behind), [[-5.0, 0.0]]).any()


def test_grazing_views_stay_finite_and_within_range(forest):
    arrangement = forest(grid=(4, 4))
    shrink = 1 / np.sin(np.radians(0.1))
    st = np.random.default_rng(5).uniform(-20, 20, (500, 2))
    for width in (1e-4, 1e-2, 1.0):
        shown = look(ground(arrangement), st, np.array([[width, 0], [0, width * shrink]]))
        assert np.isfinite(shown).all()
        assert shown.min() >= 0
        assert shown.max() <= 1 + 1e-9


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((5, 2)),
        np.array([(0, 0), (1, 0), (2, 0), (3, 0)], float),
        np.array([(0, 0), (1, 0)], float),
        np.array([(0, -3), (-1, -1), (1, -1), (1, 1), (-1, 1)], float),
        np.concatenate([SQUARE, SQUARE[1:]]),
    ],
)
def test_odd_contours_draw_without_harm(points):
    count = len(points)
    arrangement = umbrellas(
        placement(0.5, 0.5, 0.2),
        points=points,
        colors=colored(1, (1, 1, 1), count),
        shadow_offset=(0.1, 0.1),
        shadow_strength=0.5,
    )
    st, axes = lattice(40)
    shown = look(ground(arrangement), st, axes)
    assert np.isfinite(shown).all()
    assert shown.min() >= 0
    if np.ptp(points[:, 1]) == 0:
        assert np.allclose(shown, SOIL)


def test_no_umbrellas_show_the_background():
    st, axes = lattice(8)
    assert np.allclose(look(ground(umbrellas()), st, axes), SOIL)


# Levels of detail


def image_of(tmp_path, color, name="level.tif", size=8):
    file = save(tmp_path / name, np.tile(np.float32(color), (size, size, 1)), "float32", levels=4)
    return ImageSource(file, color_space="raw", wrap=("repeat", "repeat"))


@pytest.mark.parametrize("grid", [(1, 1), (4, 4)])
def test_image_level_takes_over_from_its_footprint_on(tmp_path, grid):
    levels = (UmbrellaLevelData(2, "/Lawn/Level", image=image_of(tmp_path, (1, 0, 0, 1))),)
    data = ground(umbrellas(grid=grid), (0, 1, 0, 1), levels=levels)
    for octave, share in ((-5, 0), (0, 0), (0.5, 0.25), (1, 0.5), (2, 1), (3, 1), (9, 1)):
        width = 0.125 * 2.0**octave / grid[0]
        shown = look(data, [[0.3, 0.6]], np.eye(2) * width)[0]
        assert shown == pytest.approx([share, 1 - share, 0, 1], abs=1e-9)


def test_level_follows_the_minor_axis_within_the_probes(tmp_path):
    levels = (UmbrellaLevelData(1, "/Lawn/Level", image=image_of(tmp_path, (1, 0, 0, 1))),)
    data = ground(umbrellas(), (0, 1, 0, 1), levels=levels)
    axes = np.array([[0.125 * 16, 0], [0, 0.125]])
    assert look(data, [[0.3, 0.6]], axes, most_probes=16)[0, 0] == pytest.approx(0, abs=1e-9)
    assert look(data, [[0.3, 0.6]], axes, most_probes=8)[0, 0] == pytest.approx(1)


def test_image_of_a_level_is_read_one_mip_level_finer(tmp_path):
    ladder = [np.tile(np.float32([number / 8, 0, 0]), (2 ** (4 - number), 2 ** (4 - number), 1)) for number in range(5)]
    file = str(tmp_path / "ladder.tif")
    images.write_pyramid(file, ladder, "float32", "raw")
    source = ImageSource(file, color_space="raw", wrap=("repeat", "repeat"))
    data = ground(umbrellas(), levels=(UmbrellaLevelData(1, "/Lawn/Level.file", image=source),))
    for number in (2, 3, 4):  # texels per pixel: an ordinary image would show this level of the ladder
        width = 2.0**number / 16
        assert look(data, [[0.3, 0.6]], np.eye(2) * width)[0, 0] == pytest.approx((number - 1) / 8)


def test_merged_levels_blend_one_after_the_other():
    whole = placement(0.5, 0.5, 1.0)

    def level(number, color, coverage):
        merged = umbrellas(whole, colors=colored(1, color), coverages=np.array([coverage]))
        return UmbrellaLevelData(number, f"/Lawn/{number}", arrangement=merged)

    levels = (level(1, (1, 0, 0), 0.5), level(3, (0, 0, 1), 1.0))
    data = ground(umbrellas(), (0, 1, 0, 1), levels=levels)
    first, second = (0.5, 0.5, 0, 1), (0, 0, 1, 1)
    for octave, wanted in ((0, (0, 1, 0, 1)), (1, first), (2, np.add(first, second) / 2), (3, second)):
        shown = look(data, [[0.3, 0.6]], np.eye(2) * 0.125 * 2.0**octave, hard=True)[0]
        assert shown == pytest.approx(wanted, abs=1e-9)


def test_picture_of_the_whole_follows_the_coarsest_merged_umbrellas():
    full = umbrellas(placement(0.25, 0.5, 0.5), colors=colored(1, (1, 0, 0)))
    merged = umbrellas(placement(0.5, 0.5, 6.0), colors=colored(1, (0, 0, 1)))
    levels = (UmbrellaLevelData(3, "/Lawn/Level", arrangement=merged),)
    data = ground(full, (0, 1, 0, 1), levels=levels)
    for octave, wanted in (
        (3, (0, 0, 1, 1)),
        (3.5, (0.125, 0.375, 0.5, 1)),
        (4, (0.25, 0.75, 0, 1)),
        (9, (0.25, 0.75, 0, 1)),
    ):
        shown = look(data, [[0.3, 0.6]], np.eye(2) * 0.125 * 2.0**octave)[0]
        assert shown == pytest.approx(wanted, abs=0.02)


def test_level_that_cannot_be_read_is_left_out_and_said():
    levels = (UmbrellaLevelData(1, "/Lawn/Level.file", image=ImageSource("/nowhere/level.tif")),)
    with pytest.warns(FexelWarning, match=r"^/Lawn/Level\.file: .*no such file; left out$") as caught:
        twin = UmbrellaTwin(ground(umbrellas(), levels=levels), "/Lawn")
    assert len(caught) == 1
    assert np.allclose(twin.sample(np.array([[0.5, 0.5]]), np.eye(2)), SOIL)


def test_base_that_cannot_be_read_is_not_there_and_said():
    arrangement = umbrellas(placement(0.5, 0.5, 0.5), image=ImageSource("/nowhere/leaf.png", wrap=CLAMP))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        shown = look(ground(arrangement, paths=("/Lawn/Leaf.file",)), [[0.5, 0.5]])
    assert len(caught) == 1
    assert str(caught[0].message) == "/Lawn/Leaf.file: /nowhere/leaf.png: no such file; left out"
    assert np.allclose(shown, SOIL)
