"""The elliptical weighted average against brute force, and what any filter must do."""

import numpy as np
import pytest

from fexel import mipmaps
from fexel.filters import ewa
from fexel.images import linear_to_srgb, srgb_to_linear
from fexel.textures.image_source import ImageSource
from fexel_tools.filter_lookup import look_up
from fexel_tools.image_files import write_image

REPEAT = ("repeat", "repeat")
WRAPS = [REPEAT, ("mirror", "mirror"), ("clamp", "clamp"), ("repeat", "clamp")]
ELEVATIONS = (90, 60, 45, 30, 20, 10, 5, 2, 1, 0.5, 0.2, 0.1)
AZIMUTHS = (0, 15, 30, 45, 60, 75)


def turn(degrees):
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[cosine, -sine], [sine, cosine]])


def footprint(elevation, azimuth, minor=1.25, roll=20.0):
    return turn(azimuth) @ np.diag([minor / np.sin(np.radians(elevation)), minor]) @ turn(roll)


def checkerboard(width, height, cell=8):
    y, x = np.mgrid[:height, :width]
    value = 0.1 + 0.7 * ((x // cell + y // cell) % 2)
    return np.dstack([value, 0.5 * value, 1 - value, np.ones_like(value)])


def levels_of(image):
    return [np.asarray(level, np.float64) for level in mipmaps.pyramid(image)]


def gaussian_truth(image, xy, jacobian, samples=4, reach=2.0):
    """Means over the bilinear, repeating texture, by a grid of at least so many samples a texel, to 4 deviations."""
    axes, lengths, _ = np.linalg.svd(jacobian)
    counts = [int(np.ceil(2 * reach * max(length, 1) * samples)) | 1 for length in lengths]
    grid = np.stack(np.meshgrid(*[(np.arange(n) + 0.5) / n * 2 * reach - reach for n in counts]), -1).reshape(-1, 2)
    weight = np.exp(-2 * np.sum(grid**2, axis=1))
    height, width = image.shape[:2]
    values = []
    for place in xy:
        x, y = (place + grid * lengths @ axes.T - 0.5).T
        i, j = np.floor(x).astype(int), np.floor(y).astype(int)
        fx, fy = (x - i)[:, None], (y - j)[:, None]
        texels = [[image[(j + b) % height, (i + a) % width] for a in (0, 1)] for b in (0, 1)]
        rows = [row[0] * (1 - fx) + row[1] * fx for row in texels]
        values.append(weight @ (rows[0] * (1 - fy) + rows[1] * fy) / weight.sum())
    return np.array(values)


def psnr(first, second):
    difference = linear_to_srgb(first[:, :3]).astype(float) - linear_to_srgb(second[:, :3])
    return -10 * np.log10(np.mean(difference**2))


@pytest.mark.parametrize("minor", [1.25, 3.1])
@pytest.mark.parametrize("elevation", [60, 20, 5, 2])
def test_wide_gaussian_is_the_truth_to_what_its_cut_leaves_out(rng, elevation, minor):
    image = checkerboard(96, 64, cell=16)
    xy = rng.uniform(0, 64, (24, 2))
    jacobian = footprint(elevation, 25, minor)
    truth = gaussian_truth(image, xy, jacobian)
    many = np.broadcast_to(jacobian, (len(xy), 2, 2))
    narrow, wide = (psnr(ewa.sample(levels_of(image), REPEAT, xy, many, radius)[0], truth) for radius in (2.0, 3.5))
    assert narrow > 30
    assert wide > 40
    assert wide > narrow + 3


def test_minified_noise_is_the_truth(rng):
    image = np.dstack([rng.uniform(0, 1, (64, 64, 3)), np.ones((64, 64))])
    xy = rng.uniform(0, 64, (24, 2))
    for elevation in (30, 3):
        jacobian = footprint(elevation, 65)
        values = ewa.sample(levels_of(image), REPEAT, xy, np.broadcast_to(jacobian, (24, 2, 2)), 3.5)[0]
        assert np.abs(values - gaussian_truth(image, xy, jacobian)).max() < 2e-3


@pytest.mark.parametrize("wrap", WRAPS)
def test_constant_image_stays_constant_from_every_view(rng, wrap):
    color = np.array([0.2, 0.5, 0.9, 1.0])
    levels = levels_of(np.broadcast_to(color, (37, 21, 4)))
    views = [footprint(elevation, azimuth) for elevation in ELEVATIONS for azimuth in AZIMUTHS]
    values, _ = ewa.sample(levels, wrap, rng.uniform(-50, 90, (len(views), 2)), np.array(views))
    assert np.abs(values - color).max() < 1e-6


@pytest.mark.parametrize("azimuth", AZIMUTHS)
def test_taps_are_not_capped_at_a_tenth_of_a_degree(azimuth):
    levels = levels_of(np.ones((64, 64, 4)))
    _, fetches = ewa.sample(levels, REPEAT, np.full((1, 2), 20.3), footprint(0.1, azimuth)[None])
    assert 3000 < fetches[0] < 3800


@pytest.mark.parametrize("elevation", [90, 30, 5, 1])
@pytest.mark.parametrize("minor", [1.25, 2.9, 3.1, 11.0, 40.0])
def test_taps_follow_the_ratio_of_the_axes_and_never_more(elevation, minor):
    levels = levels_of(np.ones((512, 512, 4)))
    _, fetches = ewa.sample(levels, REPEAT, np.full((1, 2), 20.3), footprint(elevation, 25, minor)[None])
    assert fetches[0] <= 60 / np.sin(np.radians(elevation))


@pytest.mark.parametrize(
    "jacobian",
    [
        np.full((2, 2), np.nan),
        np.array([[np.inf, 0.0], [0.0, 1.0]]),
        np.array([[-np.inf, np.nan], [1.0, 1.0]]),
        np.full((2, 2), 1e300),
        np.diag([1e8, 1e8]),
        np.diag([1e8, 1e-8]),
        np.zeros((2, 2)),
        np.array([[50.0, 0.0], [0.0, 0.0]]),
        np.array([[3.0, 3.0], [3.0, 3.0]]),
        np.diag([1e-300, 1e-200]),
    ],
)
@pytest.mark.parametrize("wrap", [*WRAPS, ("black", "black")])
def test_degenerate_footprints_are_finite_and_bounded(rng, jacobian, wrap):
    image = np.dstack([rng.uniform(0, 1, (24, 40, 3)), np.ones((24, 40))])
    values, fetches = ewa.sample(levels_of(image), wrap, np.array([[7.7, 13.1]]), jacobian[None])
    assert np.isfinite(values).all()
    assert values.min() >= 0
    assert values.max() <= 1
    assert fetches[0] < 100_000


def test_place_that_is_not_a_number_is_finite():
    values, _ = ewa.sample(levels_of(np.ones((8, 8, 4))), REPEAT, np.full((1, 2), np.nan), np.eye(2)[None])
    assert np.isfinite(values).all()


def test_footprint_of_many_textures_shows_their_mean(rng):
    image = np.dstack([rng.uniform(0, 1, (48, 80, 3)), np.ones((48, 80))])
    for jacobian in (np.diag([900.0, 700.0]), np.full((2, 2), np.nan), footprint(3, 30, 300.0)):
        values, _ = ewa.sample(levels_of(image), REPEAT, np.array([[11.0, 5.0]]), jacobian[None])
        assert np.abs(values[0] - image.mean((0, 1))).max() < 2e-3


def test_magnified_texture_is_bilinear_and_the_way_there_continuous(rng):
    image = np.dstack([rng.uniform(0, 1, (16, 16, 3)), np.ones((16, 16))])
    levels = levels_of(image)
    center = np.array([[5.5, 9.5]])
    between = ewa.sample(levels, REPEAT, np.array([[6.0, 9.5]]), 0.3 * np.eye(2)[None])[0][0]
    assert np.abs(ewa.sample(levels, REPEAT, center, 0.3 * np.eye(2)[None])[0][0] - image[9, 5]).max() < 1e-6
    assert np.abs(between - (image[9, 5] + image[9, 6]) / 2).max() < 1e-6
    sizes = np.linspace(0.4, 1.1, 200)
    place = np.broadcast_to([5.8, 9.6], (200, 2))
    values, _ = ewa.sample(levels, REPEAT, place, sizes[:, None, None] * np.eye(2))
    assert (
        np.abs(np.diff(values, axis=0)).max() < 0.04
    )  # taps enter at the cut, each with an eighth of the greatest weight


@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 64), (64, 1), (3, 5), (31, 17), (1, 7)])
def test_images_of_any_size_keep_their_mean(rng, width, height):
    image = np.dstack([rng.uniform(0, 1, (height, width, 3)), np.ones((height, width))])
    x, y = np.meshgrid(np.linspace(0, width, 16, endpoint=False), np.linspace(0, height, 16, endpoint=False))
    xy = np.stack([x.ravel(), y.ravel()], 1)
    for elevation in (90, 10, 0.5):
        jacobian = np.broadcast_to(footprint(elevation, 35), (len(xy), 2, 2))
        values, _ = ewa.sample(levels_of(image), REPEAT, xy, jacobian)
        assert np.isfinite(values).all()
        assert np.abs(values.mean(0) - image.mean((0, 1))).max() < 0.12  # of 256 places, of texels up to 1


def test_borders_repeat_mirror_clamp_and_fade(rng):
    image = np.dstack([rng.uniform(0, 1, (32, 24, 3)), np.ones((32, 24))])
    levels, xy = levels_of(image), rng.uniform(0, 24, (20, 2))
    jacobian = np.broadcast_to(footprint(8, 50), (20, 2, 2))
    own = ewa.sample(levels, REPEAT, xy, jacobian)[0]
    assert np.abs(own - ewa.sample(levels, REPEAT, xy + [48, -96], jacobian)[0]).max() < 1e-9
    mirrored = ewa.sample(levels, ("mirror", "mirror"), xy, jacobian)[0]
    reflected = jacobian * np.array([-1.0, 1.0])[:, None]
    assert np.abs(mirrored - ewa.sample(levels, ("mirror", "mirror"), xy * [-1, 1], reflected)[0]).max() < 1e-9
    far = np.broadcast_to([-500.0, 10.5], (20, 2))
    clamped = ewa.sample(levels, ("clamp", "clamp"), far, np.broadcast_to(np.diag([60.0, 1.5]), (20, 2, 2)))[0]
    assert np.ptp(clamped[:, :3] - clamped[0, :3]) < 1e-9
    black = ewa.sample(levels, ("black", "black"), np.array([[0.0, 16.0]]), np.diag([6.0, 1.5])[None])[0]
    assert 0.4 < black[0, 3] < 0.6
    assert ewa.sample(levels, ("black", "black"), far[:1], np.diag([60.0, 1.5])[None])[0].max() == 0


def test_turning_image_and_view_together_changes_nothing(rng):
    image = np.dstack([rng.uniform(0, 1, (32, 32, 3)), np.ones((32, 32))])
    turned = np.rot90(image, axes=(1, 0))  # x right, y down: (x, y) goes to (32 - y, x)
    xy = rng.uniform(0, 32, (30, 2))
    jacobian = np.array([footprint(elevation, 15) for elevation in np.geomspace(0.5, 90, 30)])
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    here = ewa.sample(levels_of(image), REPEAT, xy, jacobian)[0]
    there = ewa.sample(levels_of(turned), REPEAT, xy @ quarter.T + [32, 0], quarter @ jacobian)[0]
    assert np.abs(here - there).max() < 1e-6


def test_shader_takes_all_taps_of_a_grazing_view(gl, tmp_path, rng):
    texels = np.rint(255 * linear_to_srgb(checkerboard(64, 64)[..., :3])).astype(np.uint8)
    write_image(tmp_path / "image.png", texels)
    stored = np.dstack([srgb_to_linear(texels / np.float32(255)), np.ones((64, 64))])
    xy = rng.uniform(0, 64, (36, 2))
    jacobian = np.array([footprint(0.1, azimuth) for azimuth in np.linspace(0, 175, 36)])
    source = ImageSource(str(tmp_path / "image.png"), color_space="sRGB", wrap=REPEAT)
    looked = look_up(gl, source, "ewa", xy, jacobian)
    values, fetches = ewa.sample(levels_of(stored), REPEAT, xy, jacobian)
    assert np.abs(looked.color - values).max() < 5e-3
    assert np.abs(looked.fetches / fetches - 1).max() < 0.01


def test_view_has_all_that_ellipses_reach(gl, tmp_path, rng):
    """Of an image that is seen in part, beyond the half pixel that other filters see."""
    texels = rng.integers(0, 255, (256, 256, 3), np.uint8)
    write_image(tmp_path / "image.png", texels)
    stored = np.dstack([srgb_to_linear(texels / np.float32(255)), np.ones((256, 256))])
    xy, jacobian = rng.uniform(120, 136, (100, 2)), np.broadcast_to(np.diag([60.0, 1.5]), (100, 2, 2)).copy()
    source = ImageSource(str(tmp_path / "image.png"), color_space="sRGB", wrap=("clamp", "clamp"))
    looked = look_up(gl, source, "ewa", xy, jacobian)
    assert np.abs(looked.color - ewa.sample(levels_of(stored), ("clamp", "clamp"), xy, jacobian)[0]).max() < 5e-3
