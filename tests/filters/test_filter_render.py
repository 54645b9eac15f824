"""shaders/image.glsl with every filter against the float64 twins, and what no lookup may do."""

from __future__ import annotations

import numpy as np
import pytest

from bench.zipmap_stage import save
from fexel.errors import FexelWarning
from fexel.filters import FILTERS, FIPMAP_ACCESSES, KERNELS
from fexel.filters.twin import FilterTwin
from fexel.textures.image_source import ImageSource
from fexel_tools.filter_lookup import look_up

ELEVATIONS = (90, 60, 45, 30, 20, 10, 5, 2, 1, 0.5, 0.2, 0.1)
HALF_STEP = 1e-3  # texels and chains are stored as 16-bit floats


def rotations(angles):
    """(M, 2, 2)."""
    cosine, sine = np.cos(angles), np.sin(angles)
    return np.moveaxis(np.array([[cosine, -sine], [sine, cosine]]), -1, 0)


def fan(count, seed=1, elevations=ELEVATIONS):
    """Jacobians (M, 2, 2) of all elevations, azimuths, rolls, and widths from 0.6 to 5 texels."""
    rng = np.random.default_rng(seed)
    axes = np.zeros((count, 2, 2))
    axes[:, 0, 0] = 1.25 / np.sin(np.radians(rng.choice(elevations, count)))
    axes[:, 1, 1] = 1.25
    turned = rotations(rng.uniform(0, np.pi, count)) @ axes @ rotations(rng.uniform(0, 2 * np.pi, count))
    return turned * np.exp2(rng.uniform(-1, 2, count))[:, None, None]


def noise(tmp_path, width, height, seed=2):
    """A half-float image: path and what is in it."""
    texels = np.ones((height, width, 4), np.float32)
    texels[..., :3] = np.random.default_rng(seed).random((height, width, 3)).astype(np.float16)
    return save(tmp_path / f"noise{width}x{height}.exr", texels, "float", "raw"), texels


def constant(tmp_path, width=64, height=48):
    """An image of one colour."""
    texels = np.full((height, width, 4), 0.5, np.float32)
    texels[..., 3] = 1.0
    return save(tmp_path / f"constant{width}x{height}.exr", texels, "float", "raw")


@pytest.mark.parametrize("token", ["mipmap", "anisotropic", "ripmap", "fipmap", "ewa", "auto"])
@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp", "black"])
def test_lookups_are_those_of_the_twin(gl, tmp_path, token, wrap):
    elevations = ELEVATIONS if token != "ewa" else ELEVATIONS[:-4]
    jacobian = fan(300 if token == "ewa" else 1200, elevations=elevations)
    file, image = noise(tmp_path, 64, 48)
    xy = np.random.default_rng(3).uniform(-0.5, 1.5, (len(jacobian), 2)) * [64, 48]
    looked = look_up(gl, ImageSource(file, wrap=(wrap, wrap)), token, xy, jacobian)
    options = {"probes": 8} if token == "anisotropic" else {}
    values, fetches = FilterTwin(image, (wrap, wrap)).sample(token, xy, jacobian, **options)
    error = np.abs(looked.color - values).max(axis=1)
    # Float32 may choose otherwise where float64 is at a bound between two choices.
    assert np.quantile(error, 0.99) < HALF_STEP
    assert np.quantile(np.abs(looked.fetches - fetches), 0.99) == 0


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp", "black"])
def test_gaussian_lookups_are_those_of_the_twin(gl, tmp_path, wrap):
    file, image = noise(tmp_path, 64, 48)
    jacobian = fan(1200, seed=14)
    xy = np.random.default_rng(15).uniform(-0.5, 1.5, (len(jacobian), 2)) * [64, 48]
    looked = look_up(gl, ImageSource(file, wrap=(wrap, wrap)), "fipmap", xy, jacobian, kernel="gauss")
    values, fetches = FilterTwin(image, (wrap, wrap)).sample("fipmap", xy, jacobian, gauss=True)
    error = np.abs(looked.color - values).max(axis=1)
    assert np.quantile(error, 0.99) < HALF_STEP
    assert np.all(looked.fetches == fetches) and fetches.max() == 20


@pytest.mark.parametrize("accesses", FIPMAP_ACCESSES)
@pytest.mark.parametrize("wrap", ["repeat", "clamp"])
def test_fipmaps_of_more_accesses_are_those_of_the_twin(gl, tmp_path, wrap, accesses):
    file, image = noise(tmp_path, 64, 48)
    jacobian = fan(600, seed=20)
    xy = np.random.default_rng(21).uniform(-0.5, 1.5, (len(jacobian), 2)) * [64, 48]
    looked = look_up(gl, ImageSource(file, wrap=(wrap, wrap)), "fipmap", xy, jacobian, accesses=accesses)
    values, fetches = FilterTwin(image, (wrap, wrap)).sample("fipmap", xy, jacobian, probes=accesses)
    assert np.quantile(np.abs(looked.color - values).max(axis=1), 0.985) < HALF_STEP
    assert np.all(looked.fetches == fetches) and np.all(fetches == 4 * accesses)


@pytest.mark.parametrize("token", [token for token in FILTERS if token != "fipmap"])
def test_the_kernel_is_that_of_fipmaps_alone(gl, tmp_path, token):
    file, _ = noise(tmp_path, 64, 48)
    jacobian = fan(200, seed=16, elevations=ELEVATIONS[:-4])
    xy = np.random.default_rng(17).uniform(0, 48, (len(jacobian), 2))
    source = ImageSource(file, wrap=("repeat", "repeat"))
    box, gauss = (look_up(gl, source, token, xy, jacobian, kernel=kernel) for kernel in KERNELS)
    np.testing.assert_array_equal(box.color, gauss.color)


@pytest.mark.parametrize("size", [(37, 91), (1, 19), (23, 1), (1, 1)])
@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize(
    "wrap", [("clamp", "clamp"), ("repeat", "clamp"), ("black", "mirror"), ("mirror", "black"), ("repeat", "mirror")]
)
def test_images_of_any_size_are_those_of_the_twin(gl, tmp_path, size, wrap, kernel):
    file, image = noise(tmp_path, *size)
    jacobian = fan(600, seed=4)
    xy = np.random.default_rng(5).uniform(-0.5, 1.5, (600, 2)) * size
    looked = look_up(gl, ImageSource(file, wrap=wrap), "fipmap", xy, jacobian, kernel=kernel)
    values, _ = FilterTwin(image, wrap).sample("fipmap", xy, jacobian, gauss=kernel == "gauss")
    error = np.abs(looked.color - values).max(axis=1)
    # Float32 may choose otherwise where float64 is at a bound between two choices.
    assert np.quantile(error, 0.98) < HALF_STEP
    assert np.quantile(error, 0.995) < 0.05


@pytest.mark.parametrize("token", FILTERS)
@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
def test_a_constant_image_stays_constant(gl, tmp_path, token, wrap):
    jacobian = fan(300, elevations=ELEVATIONS[:-4] if token == "ewa" else ELEVATIONS)
    xy = np.random.default_rng(6).uniform(-3, 3, (len(jacobian), 2)) * [64, 48]
    looked = look_up(gl, ImageSource(constant(tmp_path), wrap=(wrap, wrap)), token, xy, jacobian)
    np.testing.assert_allclose(looked.color, [[0.5, 0.5, 0.5, 1.0]] * len(xy), atol=HALF_STEP)


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
def test_a_single_texel_is_all_there_is(gl, tmp_path, wrap):
    jacobian = fan(300, seed=12)
    xy = np.random.default_rng(13).uniform(-3, 3, (300, 2))
    for token in ("ripmap", "fipmap", "auto"):
        looked = look_up(gl, ImageSource(constant(tmp_path, 1, 1), wrap=(wrap, wrap)), token, xy, jacobian)
        np.testing.assert_allclose(looked.color, [[0.5, 0.5, 0.5, 1.0]] * 300, atol=HALF_STEP)


@pytest.mark.parametrize(("token", "kernel"), [*((token, "box") for token in FILTERS), ("fipmap", "gauss")])
def test_footprints_of_any_kind_show_the_image_and_never_garbage(gl, tmp_path, token, kernel):
    whole = np.diag([640.0, 480.0])
    flat = [np.zeros((2, 2)), np.diag([5.0, 0.0]), np.diag([0.0, 1e-20]), np.array([[3.0, 3.0], [2.0, 2.0]])]
    wild = [np.full((2, 2), np.nan), np.array([[np.nan, 1.0], [1.0, 1.0]]), np.diag([np.inf, 1.0])]
    jacobian = np.array([*flat, whole, 1e5 * whole, 1e-12 * whole, *wild])
    xy = np.random.default_rng(7).uniform(0, 1, (len(jacobian), 2)) * [64, 48]
    source = ImageSource(constant(tmp_path), wrap=("repeat", "repeat"))
    looked = look_up(gl, source, token, xy, jacobian, kernel=kernel)
    count = len(jacobian) - (len(wild) if token == "anisotropic" else 0)  # whose probes are as they always were
    np.testing.assert_allclose(looked.color[:count], [[0.5, 0.5, 0.5, 1.0]] * count, atol=HALF_STEP)


@pytest.mark.parametrize(("token", "kernel"), [("ripmap", "box"), ("fipmap", "box"), ("fipmap", "gauss")])
def test_what_was_not_foreseen_shows_the_nearest_that_is_there(gl, tmp_path, token, kernel):
    """Only footprints seen from the front are foreseen; those looked up are of all kinds."""
    jacobian = fan(400, seed=8)
    xy = np.random.default_rng(9).uniform(0.4, 0.6, (400, 2)) * [64, 48]
    everything = np.zeros((1, 2)), np.ones((1, 2))
    seen = (1.5 * np.eye(2)[None, None], *everything)
    source = ImageSource(constant(tmp_path), wrap=("repeat", "repeat"))
    looked = look_up(gl, source, token, xy, jacobian, seen=seen, kernel=kernel)
    np.testing.assert_allclose(looked.color, [[0.5, 0.5, 0.5, 1.0]] * 400, atol=HALF_STEP)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("pixels", [64, 200])
def test_pieces_have_all_that_pixels_between_their_places_choose(gl, tmp_path, pixels, kernel):
    """A plane in perspective, foreseen at the corners of squares of 8 pixels, looked up at every pixel."""
    size = np.array([256.0, 256.0])

    def place(x, y):
        depth = 1.0 / (y / pixels + 0.02)
        return np.stack([(x / pixels - 0.5) * depth * 90, depth * 100], axis=-1)

    def jacobian(x, y):
        steps = [place(x + dx, y + dy) - place(x - dx, y - dy) for dx, dy in ((0.5, 0), (0, 0.5))]
        return np.stack(steps, axis=-1)

    angle = rotations(np.array([0.4]))[0]
    corners = np.arange(0, pixels, 8.0)
    x, y = (each.ravel() for each in np.meshgrid(corners, corners))
    at = [(x + dx, y + dy) for dx in (0, 4, 8) for dy in (0, 4, 8)]
    places = np.stack([place(*each) @ angle.T for each in at], axis=1) / size
    footprints = np.stack([angle @ jacobian(*each) for each in at], axis=1)
    reach = 0.5 * np.abs(footprints).sum(axis=3).max(axis=1) / size
    low, high = places.min(axis=1) - reach, places.max(axis=1) + reach
    low[:, 1], high[:, 1] = 1 - high[:, 1], 1 - low[:, 1]
    x, y = (each.ravel() + 0.5 for each in np.meshgrid(np.arange(pixels), np.arange(pixels)))
    source = ImageSource(constant(tmp_path, 256, 256), wrap=("clamp", "clamp"))
    at, seen = place(x, y) @ angle.T, (footprints, low, high)
    looked = look_up(gl, source, "fipmap", at, angle @ jacobian(x, y), seen=seen, kernel=kernel)
    np.testing.assert_allclose(looked.color, [[0.5, 0.5, 0.5, 1.0]] * len(x), atol=HALF_STEP)


def test_without_room_for_chains_probes_are_shown(gl, tmp_path):
    file, image = noise(tmp_path, 256, 256)
    jacobian = fan(200, elevations=(10, 5))
    xy = np.random.default_rng(10).uniform(0, 256, (200, 2))
    source = ImageSource(file, wrap=("repeat", "repeat"))
    with pytest.warns(FexelWarning, match="no room for its fipmap"):
        looked = look_up(gl, source, "fipmap", xy, jacobian, memory_mb=2.0)
    values, _ = FilterTwin(image, ("repeat", "repeat")).sample("anisotropic", xy, jacobian, probes=8)
    np.testing.assert_allclose(looked.color, values, atol=HALF_STEP)


def test_circles_take_the_same_places_whatever_rounding_makes_of_them(gl, tmp_path):
    """A square facing the camera: pixels of the same place must not differ."""
    file, _ = noise(tmp_path, 64, 64)
    jacobian = 2.0 * np.eye(2) + np.random.default_rng(11).normal(0, 1e-5, (300, 2, 2))
    xy = np.full((300, 2), 20.3)
    looked = look_up(gl, ImageSource(file, wrap=("repeat", "repeat")), "fipmap", xy, jacobian)
    assert np.ptp(looked.color, axis=0).max() < HALF_STEP


def test_lookups_count_their_texels(gl, tmp_path):
    source = ImageSource(constant(tmp_path), wrap=("repeat", "repeat"))
    jacobian = np.array([np.diag([20.0, 2.0])])
    fetches = {token: look_up(gl, source, token, np.zeros((1, 2)), jacobian).fetches[0] for token in FILTERS[:4]}
    assert fetches == {"mipmap": 8, "anisotropic": 64, "ripmap": 8, "fipmap": 16}
