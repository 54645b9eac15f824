"""The camera's colour and the paper's decision by it, and shaders/decision.glsl against the twin."""

from pathlib import Path

import numpy as np
import pytest

from fexel.filters import FILTERS, decision
from fexel.filters.shears import DIRECTIONS
from fexel.renderer.program import load_shader

MIPMAP, RIPMAP, FIPMAP = (FILTERS.index(token) for token in ("mipmap", "ripmap", "fipmap"))
PROBE = Path(__file__).with_name("decision_probe.frag")


def direction(elevation, azimuth):
    """Unit vector to a camera: u, v, normal are x, y, z."""
    elevation, azimuth = np.radians(elevation), np.radians(azimuth)
    flat = np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation) + 0 * azimuth], -1)


def frames(count):
    return np.broadcast_to(np.eye(3), (count, 3, 3))


def test_corners_and_middle_of_the_triangle():
    axes = np.eye(3)
    assert np.allclose(decision.color(axes, frames(3)), [[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    middle = decision.color(np.full((1, 3), 3**-0.5), frames(1))
    assert np.allclose(middle, 1 / 3)


def test_colour_is_that_of_the_first_octant_and_sums_to_the_intensity(rng):
    vectors = rng.normal(size=(200, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    colors = decision.color(vectors, frames(200), 0.3)
    assert np.allclose(colors.sum(axis=1), 0.3)
    assert (colors >= 0).all()
    assert np.allclose(colors, decision.color(np.abs(vectors), frames(200), 0.3))


def test_colour_of_a_sheared_mapping_is_pure_where_only_one_coordinate_grows():
    # u = x - y, v = y: where u alone grows one goes along x, where v alone grows along (1, 1).
    frame = np.stack([[1.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], axis=1)[None]
    assert np.allclose(decision.color(np.array([[1.0, 0.0, 0.0]]), frame), [[0, 0, 1]])
    assert np.allclose(decision.color(np.array([[0.5**0.5, 0.5**0.5, 0.0]]), frame), [[1, 0, 0]])


@pytest.mark.parametrize("frame", [np.zeros((3, 3)), np.diag([0.0, 0.0, 1.0]), np.ones((3, 3)) / 3**0.5])
def test_surface_without_texture_coordinates_has_a_colour(frame):
    color = decision.color(np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]]), np.stack([frame, frame]))
    assert np.isfinite(color).all()
    assert np.allclose(color.sum(axis=1), 1)


def test_no_direction_is_green():
    assert np.allclose(decision.color(np.zeros((1, 3)), frames(1)), [[0, 1, 0]])


@pytest.mark.parametrize(
    ("elevation", "azimuth", "expected"),
    [(90, 0, MIPMAP), (50, 40, MIPMAP), (40, 45, RIPMAP), (10, 0, RIPMAP), (10, 90, RIPMAP), (5, 8, RIPMAP)]
    + [(10, 45, FIPMAP), (5, 30, FIPMAP), (2, -20, FIPMAP), (0, 60, FIPMAP), (0, 175, RIPMAP)],
)
def test_filter_by_the_place_in_the_triangle(elevation, azimuth, expected):
    decided = decision.decide(direction(elevation, np.array([azimuth])), frames(1))
    assert decided.filter[0] == expected


def test_shear_is_the_tangent_to_the_nearer_axis_and_never_above_one():
    azimuth = np.arange(-180, 180)
    decided = decision.decide(direction(5, azimuth), frames(len(azimuth)))
    nearer = np.abs((azimuth + 45) % 90 - 45)
    assert np.allclose(np.abs(decided.shear).max(axis=1), np.tan(np.radians(nearer)))
    assert (np.abs(decided.shear).min(axis=1) == 0).all()


@pytest.mark.parametrize("azimuth", [*range(-175, 180, 10), 30, 60, 120, 150])
def test_shear_brings_the_view_onto_the_axis(azimuth):
    decided = decision.decide(direction(5, np.array([azimuth])), frames(1))
    b, c = decided.shear[0]
    x, y = np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))
    assert np.abs(np.array([x + b * y, c * x + y])).min() < 1e-12


@pytest.mark.parametrize("azimuth", range(-175, 180, 10))
def test_direction_is_the_nearest_one_of_the_papers_angles(azimuth):
    decided = decision.decide(direction(5, np.array([azimuth])), frames(1))
    nearest = DIRECTIONS[decided.direction[0]]
    along = np.array([1.0, -nearest.shear]) if nearest.long_axis == 0 else np.array([-nearest.shear, 1.0])
    angle = np.degrees(np.arctan2(-along[1], along[0]))  # texels run down
    assert abs((angle - azimuth + 90) % 180 - 90) <= 14.1
    assert (nearest.shear != 0) == (decided.filter[0] == FIPMAP)


@pytest.mark.parametrize("skew", [0.0, 0.6])
def test_shader_equals_the_twin(gl, rng, skew):
    frame = np.stack([[0.7, skew, 0.0], [0.0, 0.4, 0.0], [0.0, 0.0, 1.0]], axis=1)
    vectors = np.concatenate([np.eye(3), rng.normal(size=(253, 3))])
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    color, decided = rendered(gl, vectors, frame, 0.5)
    many = np.broadcast_to(frame, (256, 3, 3))
    assert np.abs(color[:, :3] - decision.color(vectors, many, 0.5)).max() < 1e-5
    expected = decision.decide(vectors, many)
    assert np.mean(decided[:, 2] != expected.filter) < 0.01  # a threshold may be met either way
    assert np.abs(np.sort(np.abs(decided[:, :2])) - np.sort(np.abs(expected.shear))).max() < 1e-5


def test_shader_is_compiled_only_with_the_aov():
    lines = load_shader("decision.glsl").text.splitlines()
    code = [line for line in lines if line.strip() and not line.startswith(("//", "#version", "#line"))]
    assert code[0] == "#ifdef AOV_DECISION" and code[-1] == "#endif"
    assert sum(line.startswith("#") for line in code) == 2


def rendered(gl, vectors, frame, intensity):
    """Colour and decision of each direction, (M, 4) both."""
    fragment = load_shader("decision.glsl", {"AOV_DECISION": 0}, ["common_math.glsl"]).text + PROBE.read_text()
    program = gl.program(load_shader("fullscreen.vert").text, fragment)
    size = len(vectors), 1
    directions = gl.texture(size, 4, np.pad(vectors, ((0, 0), (0, 1))).astype("f4").tobytes(), dtype="f4")
    target = gl.framebuffer([gl.renderbuffer(size, 4, dtype="f4") for _ in range(2)])
    target.use()
    directions.use(0)
    program["directions"] = 0
    program["frame"] = tuple(frame.T.ravel())
    program["intensity"] = intensity
    array = gl.vertex_array(program, [])
    array.render(gl.TRIANGLES, vertices=3)
    result = [np.frombuffer(target.read(components=4, dtype="f4", attachment=n), np.float32) for n in range(2)]
    gl.detect_framebuffer(0).use()  # moderngl would bind the released one again
    for item in (array, target, directions, program):
        item.release()
    return [values.reshape(-1, 4) for values in result]
