"""All filters on images in memory: what any filter must do, and how near the chained ones come to the truth."""

import math

import numpy as np
import pytest

from fexel.errors import FexelError
from fexel.filters import FILTERS
from fexel.filters.twin import FilterTwin
from fexel.images import linear_to_srgb
from fexel_tools.filter_truth import FilterTruth

REPEAT = ("repeat", "repeat")
TOKENS = ("mipmap", "anisotropic", "ripmap", "fipmap")
BORDER_FLOORS = {"mipmap": (19, 12), "anisotropic": (50, 34), "ripmap": (34, 22), "fipmap": (43, 27.5)}  # dB; black
ELEVATIONS = (90, 30, 10, 5, 2, 1, 0.2)


def turn(degrees):
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[cosine, -sine], [sine, cosine]])


def footprint(elevation, azimuth, minor=1.25, roll=0.0):
    return turn(azimuth) @ np.diag([minor / math.sin(math.radians(elevation)), minor]) @ turn(roll)


def fan(count, roll=0.0):
    views = [footprint(elevation, azimuth, roll=roll) for elevation in ELEVATIONS for azimuth in range(0, 180, 20)]
    return np.repeat(np.array(views), count, axis=0)


def stripes(size=256):
    """Tileable: patches of stripes of many directions, down to 5 texels wide, and a checkerboard."""
    y, x = np.mgrid[:size, :size] * (2 * np.pi / size)
    waves = [np.sin(a * x + b * y) for a, b in ((32, 7), (-11, 40), (25, 25), (50, 2), (3, 48), (-30, 31))]
    patch = (np.floor(4 * x / np.pi) + 2 * np.floor(4 * y / np.pi)) % len(waves)
    sharp = np.choose(patch.astype(int), waves) > 0
    checker = (np.floor(x * 32 / np.pi / 2) + np.floor(y * 32 / np.pi / 2)) % 2
    mixed = np.where(sharp, 0.75, 0.05)
    return np.dstack([mixed, 0.1 + 0.7 * checker, 0.5 * (mixed + checker * 0.7), np.ones_like(x)])


def box_truth(image, xy, jacobian, wrap=REPEAT, samples=4):
    """Means over the parallelogram of the bilinear texture, from a grid of at least so many samples a texel."""
    counts = [int(np.ceil(max(side, 2) * samples)) for side in np.sqrt(np.sum(jacobian**2, axis=0))]
    grid = np.stack(np.meshgrid(*[(np.arange(n) + 0.5) / n - 0.5 for n in counts]), -1).reshape(-1, 2) @ jacobian.T
    values = [_bilinear(image, place + grid, wrap).mean(axis=0) for place in xy]
    return np.array(values)


def _bilinear(image, at, wrap):
    size = image.shape[1], image.shape[0]
    first = np.floor(at - 0.5).astype(int)
    share = at - 0.5 - first
    value = 0.0
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.abs(1 - dx - share[:, 0]) * np.abs(1 - dy - share[:, 1])
            index = []
            for axis, step in ((0, dx), (1, dy)):
                texel, texels = first[:, axis] + step, size[axis]
                if wrap[axis] == "repeat":
                    texel = texel % texels
                elif wrap[axis] == "mirror":
                    texel = texel % (2 * texels)
                    texel = np.minimum(texel, 2 * texels - 1 - texel)
                elif wrap[axis] == "black":
                    weight = weight * ((texel >= 0) & (texel < texels))
                index.append(np.clip(texel, 0, texels - 1))
            value = value + weight[:, None] * image[index[1], index[0]]
    return value


def psnr(first, second):
    difference = linear_to_srgb(first[:, :3]).astype(float) - linear_to_srgb(second[:, :3])
    return -10 * np.log10(np.mean(difference**2))


@pytest.fixture(scope="module")
def twin():
    return FilterTwin(stripes(), REPEAT)


def mean_psnr(twin, token, elevation, xy, azimuths=(0, 15, 30, 45, 75), roll=0.0, **options):
    results = []
    for azimuth in azimuths:
        jacobian = footprint(elevation, azimuth, roll=roll)
        value, _ = twin.sample(token, xy, np.repeat(jacobian[None], len(xy), axis=0), **options)
        results.append(psnr(value, box_truth(np.asarray(twin.image, float), xy, jacobian, twin.wrap)))
    return np.mean(results)


# How near to the truth: floors are 1.5 dB below what was measured, so that only a change of the method crosses them.


@pytest.mark.parametrize(("elevation", "floor"), [(90, 42), (45, 40), (10, 34), (5, 37.5), (2, 37), (1, 37)])
def test_fipmap_of_16_texels_comes_near_the_mean_over_the_pixel(rng, twin, elevation, floor):
    xy = rng.random((40, 2)) * 256
    _, fetches = twin.sample("fipmap", xy, np.repeat(footprint(elevation, 15)[None], 40, axis=0))
    assert fetches.max() <= 16
    assert mean_psnr(twin, "fipmap", elevation, xy) > floor


@pytest.mark.parametrize("roll", [20, 45])
def test_rolled_pixels_are_as_good(rng, twin, roll):
    xy = rng.random((30, 2)) * 256
    for elevation in (10, 2):
        assert mean_psnr(twin, "fipmap", elevation, xy, roll=roll) > 34.5


def test_more_accesses_beat_16_probes_where_these_are_too_few(rng, twin):
    xy = rng.random((30, 2)) * 256
    for elevation, more in ((2, 6), (1, 8)):
        best = mean_psnr(twin, "fipmap", elevation, xy, probes=16)
        assert best > mean_psnr(twin, "anisotropic", elevation, xy) + more


@pytest.mark.parametrize(("elevation", "floor"), [(10, 31), (5, 34), (2, 37)])
def test_gaussian_fipmap_of_20_texels_comes_near_a_gaussian(rng, twin, elevation, floor):
    xy = rng.random((20, 2)) * 256
    errors = {True: [], False: []}
    for azimuth in (0, 20, 45, 70):
        jacobian = np.repeat(footprint(elevation, azimuth)[None], len(xy), axis=0)
        truth, _ = twin.sample("ewa", xy, jacobian, radius=4.0)  # cut off where nothing is left
        for gauss, found in errors.items():
            value, fetches = twin.sample("fipmap", xy, jacobian, gauss=gauss)
            found.append(psnr(value, truth))
            assert fetches.max() <= 20
    assert np.mean(errors[True]) > max(np.mean(errors[False]) + 6, floor)


def test_ripmap_of_8_texels_beats_the_mipmap_but_not_the_fipmap(rng, twin):
    xy = rng.random((30, 2)) * 256
    mipmap, ripmap, fipmap = (mean_psnr(twin, token, 5, xy) for token in ("mipmap", "ripmap", "fipmap"))
    assert mipmap + 4 < ripmap < fipmap - 4


def waves(size=128):
    """Smooth, not tileable: what is misplaced at a border shows, what is merely blurred there does not."""
    y, x = np.mgrid[:size, :size] * (2 * np.pi / size)
    value = 0.5 + 0.2 * np.sin(2.3 * x + 1.1 * y) + 0.2 * np.cos(3.7 * y - 1.7 * x)
    return np.dstack([value, value[::-1], value.T, np.ones_like(value)])


@pytest.mark.parametrize("token", TOKENS)
@pytest.mark.parametrize("wrap", [("mirror", "mirror"), ("clamp", "clamp"), ("black", "black"), ("repeat", "clamp")])
@pytest.mark.parametrize("azimuth", [0, 20, 45, 70, 135])
def test_borders_are_filtered_as_what_continues_the_image(rng, token, wrap, azimuth):
    image = waves()
    xy = rng.choice([0.0, 128.0], (24, 1)) * [1, 0] + rng.random((24, 2)) * [6, 128] - [3, 0]
    xy[12:] = xy[12:, ::-1]
    for elevation in (10, 5):
        jacobian = footprint(elevation, azimuth)
        value, _ = FilterTwin(image, wrap).sample(token, xy, np.repeat(jacobian[None], len(xy), axis=0))
        assert psnr(value, box_truth(image, xy, jacobian, wrap)) > BORDER_FLOORS[token]["black" in wrap]


@pytest.mark.parametrize(
    ("wrap", "floor"), [(("clamp", "clamp"), 34), (("clamp", "repeat"), 35), (("black", "black"), 30)]
)
@pytest.mark.parametrize("elevation", [5, 1])
def test_fipmaps_of_noise_come_as_near_the_mean_across_borders_as_within(rng, wrap, floor, elevation):
    image = np.dstack([rng.random((96, 120, 3)), np.ones((96, 120))])
    twin, truth = FilterTwin(image, wrap), FilterTruth.of(image, wrap)
    for azimuth in (0, 15, 30, 45, 60, 75):
        jacobian = footprint(elevation, azimuth)
        xy = rng.random((200, 2)) * [120, 96]
        near = rng.choice([0, 120], 100), rng.choice([0, 96], 100)
        reach = 0.5 * np.abs(jacobian).sum(axis=1)
        xy[:100, 0] = near[0] + rng.uniform(-reach[0], reach[0], 100)
        xy[100:, 1] = near[1] + rng.uniform(-reach[1], reach[1], 100)
        value, _ = twin.sample("fipmap", xy, np.repeat(jacobian[None], len(xy), axis=0))
        assert psnr(value, truth.mean("box", xy, jacobian)) > floor


def test_nothing_is_read_from_the_other_side_of_a_clamped_border():
    """Beyond a border there is its edge line alone, however long the texels of a chain are."""
    image = np.zeros((64, 256, 4)) + [0.25, 0.5, 0.75, 1.0]
    image[:, 1:] = 1.0 - image[:, 1:]
    for elevation in (10, 5, 2, 1):
        jacobian = footprint(elevation, 0)
        xy = np.stack([np.full(20, -0.5 * jacobian[0, 0] - 0.5), np.linspace(2, 62, 20)], 1)
        for token in ("ripmap", "fipmap"):
            value, _ = FilterTwin(image, ("clamp", "clamp")).sample(token, xy, np.repeat(jacobian[None], 20, axis=0))
            np.testing.assert_allclose(value, image[:20, 0], atol=1e-3)


# What any filter must do.


@pytest.mark.parametrize("token", TOKENS)
@pytest.mark.parametrize("wrap", [REPEAT, ("mirror", "mirror"), ("clamp", "clamp"), ("repeat", "mirror")])
@pytest.mark.parametrize("size", [(64, 64), (1, 13), (17, 1), (37, 23), (1, 1)])
def test_constant_image_stays_constant(rng, token, wrap, size):
    color = np.array([0.2, 0.4, 0.05, 0.5])
    twin = FilterTwin(np.broadcast_to(color, (*size, 4)), wrap)
    jacobian = np.concatenate([fan(1), fan(1, roll=30)])
    xy = (rng.random((len(jacobian), 2)) * 3 - 1) * size[::-1]
    value, fetches = twin.sample(token, xy, jacobian)
    np.testing.assert_allclose(value, np.broadcast_to(color, value.shape), rtol=2e-5)
    assert fetches.min() >= 4


@pytest.mark.parametrize("token", TOKENS)
def test_any_jacobian_gives_a_colour_of_the_image(rng, token):
    twin = FilterTwin(rng.random((19, 33, 4)), REPEAT)
    bad = [np.nan, np.inf, 0.0, 1e-30, 1e5, 1e30]
    jacobian = np.array([[[a, 0], [0, b]] for a in bad for b in bad] + [[[a, b], [b, a]] for a in bad for b in bad])
    xy = np.concatenate([rng.random((len(jacobian) - 1, 2)) * 30, [[np.nan, np.nan]]])
    value, _ = twin.sample(token, xy, jacobian)
    assert value.min() >= 0
    assert value.max() <= 1


@pytest.mark.parametrize("token", TOKENS)
def test_footprint_of_much_more_than_the_texture_is_its_mean(rng, token):
    image = rng.random((48, 80, 4))
    jacobian = np.repeat(turn(10)[None] * 4000, 20, axis=0)
    value, _ = FilterTwin(image, REPEAT).sample(token, rng.random((20, 2)) * 80, jacobian)
    np.testing.assert_allclose(value, np.broadcast_to(image.mean(axis=(0, 1)), value.shape), atol=1e-4)


@pytest.mark.parametrize("token", TOKENS)
def test_repeating_texture_is_the_same_in_every_period(rng, token):
    image = rng.random((24, 40, 4))
    twin = FilterTwin(image, REPEAT)
    jacobian = fan(1, roll=15)
    xy = rng.random((len(jacobian), 2)) * [40, 24]
    here, _ = twin.sample(token, xy, jacobian)
    there, _ = twin.sample(token, xy + np.array([40, 24]) * rng.integers(-3, 4, xy.shape), jacobian)
    np.testing.assert_allclose(here, there, atol=1e-6)


@pytest.mark.parametrize("token", TOKENS)
def test_mirroring_texture_is_the_repeating_one_of_twice_its_size(rng, token):
    image = rng.random((16, 32, 4))
    double = np.concatenate([image, image[:, ::-1]], axis=1)
    double = np.concatenate([double, double[::-1]], axis=0)
    jacobian = fan(1, roll=15)
    xy = rng.random((len(jacobian), 2)) * [64, 32]
    mirrored, _ = FilterTwin(image, ("mirror", "mirror")).sample(token, xy, jacobian)
    repeated, _ = FilterTwin(double, REPEAT).sample(token, xy, jacobian)
    # The coarsest of the mirrored image's own mip levels is one texel, of the repeating one two by two.
    fits = np.abs(mirrored - repeated).max(axis=1) < 2e-3
    assert fits.mean() > 0.85


@pytest.mark.parametrize("token", ["ripmap", "fipmap"])
def test_turning_the_texture_by_a_right_angle_turns_the_result(rng, token):
    image = rng.random((32, 32, 4))
    jacobian = fan(1)
    xy = rng.random((len(jacobian), 2)) * 32
    value, _ = FilterTwin(image, REPEAT).sample(token, xy, jacobian)
    swapped, _ = FilterTwin(image.swapaxes(0, 1), REPEAT).sample(token, xy[:, ::-1], jacobian[:, ::-1])
    # At 45 degrees either axis may be the long one.
    equal = np.abs(value - swapped).max(axis=1) < 1e-5
    assert equal.mean() > 0.85


def test_rotating_camera_sees_no_jumps_when_the_shear_changes(rng, twin):
    """From step to step the error stays small against the texture, though directions, octaves and modes change."""
    azimuths = np.arange(0, 180, 0.5)
    xy = np.tile(rng.random((1, 12, 2)) * 256, (len(azimuths), 1, 1)).reshape(-1, 2)
    for elevation in (10, 3):
        jacobian = np.repeat(np.array([footprint(elevation, azimuth) for azimuth in azimuths]), 12, axis=0)
        value, _ = twin.sample("fipmap", xy, jacobian)
        encoded = linear_to_srgb(value[:, :3]).reshape(len(azimuths), 12, 3).astype(float)
        steps = np.abs(np.diff(encoded, axis=0))
        assert np.quantile(steps, 0.99) < 0.04
        assert steps.max() < 0.18


def test_zone_plate_beyond_what_pixels_can_show_is_grey():
    """Energy that a pixel cannot show must be gone: what is left of it would be moire."""
    size = 512
    y, x = np.mgrid[:size, :size] - size / 2 + 0.5
    plate = 0.5 + 0.5 * np.cos(np.pi * (x**2 + y**2) / (2 * size))  # half a cycle per texel at the border
    twin = FilterTwin(np.repeat(plate[..., None], 4, axis=2), ("clamp", "clamp"))
    axis = np.arange(64, size - 64, 4.0)
    xy = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    radius = np.hypot(*(xy - size / 2).T)
    for azimuth in (0, 25, 45, 100):
        jacobian = footprint(9, azimuth)
        along = np.abs((xy - size / 2) @ turn(azimuth)[:, 0]) / (2 * size)  # cycles per texel along the footprint
        beyond = (along * 8 > 1.2) & (radius < size / 2 - 40)
        value, _ = twin.sample("fipmap", xy, np.repeat(jacobian[None], len(xy), axis=0))
        sinc = np.sinc(along[beyond] * 8) * 0.5
        assert value[beyond, 0].std() < np.sqrt(np.mean(sinc**2) / 2) + 0.02
        assert value[beyond, 0].mean() == pytest.approx(0.5, abs=0.02)


def test_alpha_is_filtered_with_its_colour(rng):
    """Premultiplied: what is transparent has no colour, whatever is written there."""
    alpha = (rng.random((64, 64, 1)) > 0.5).astype(float)
    image = np.concatenate([alpha * [0.8, 0.3, 0.1], alpha], axis=2)
    for token in TOKENS:
        value, _ = FilterTwin(image, REPEAT).sample(token, rng.random((63, 2)) * 64, fan(1))
        np.testing.assert_allclose(value[:, :3], value[:, 3:] * [0.8, 0.3, 0.1], atol=1e-5)


def test_unknown_filter_is_refused_by_name():
    twin = FilterTwin(np.zeros((2, 2, 4)), REPEAT)
    with pytest.raises(FexelError, match=r"trilinear.*mipmap"):
        twin.sample("trilinear", np.zeros((1, 2)), np.eye(2)[None])
    for token in FILTERS[:5]:
        assert twin.sample(token, np.zeros((1, 2)), np.eye(2)[None])[0].shape == (1, 4)
