"""Small repeating images and narrow ones: footprints of many periods, in the twin and in the shader."""

import numpy as np
import pytest

from bench.zipmap_stage import save
from fexel.filters import fipmap, ripmap
from fexel.filters.shears import DIRECTIONS
from fexel.filters.tiles import Tile, spread
from fexel.filters.twin import FilterTwin
from fexel.textures.image_source import ImageSource
from fexel_tools.filter_lookup import look_up
from fexel_tools.filter_measure import memory_ratio
from fexel_tools.filter_truth import FilterTruth

SIZES = [(97, 1), (1, 97), (2, 97), (64, 4), (5, 5), (16, 16)]
AZIMUTHS = (0, 10, 20, 30, 45, 60, 75, 100, 120, 135, 150)


def footprints(elevations, minor=1.25):
    """(K, 2, 2) of all azimuths."""
    angle = np.radians(np.repeat(AZIMUTHS, len(elevations)))
    length = minor / np.sin(np.radians(np.tile(elevations, len(AZIMUTHS))))
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack(
        [np.stack([cosine * length, -sine * minor], 1), np.stack([sine * length, cosine * minor], 1)], axis=1
    )


def noise(width, height, seed=1):
    image = np.ones((height, width, 4), np.float32)
    image[..., :3] = np.random.default_rng(seed).random((height, width, 3)).astype(np.float16)
    return image


def decibels(first, second):
    return -10 * np.log10(np.mean((first - second)[:, :3] ** 2))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("wrap", ["repeat", "mirror"])
@pytest.mark.parametrize("elevation", [5, 2, 1, 0.2, 0.1])
def test_footprints_of_many_periods_are_no_worse_than_probes(rng, size, wrap, elevation):
    image = noise(*size)
    jacobian = np.repeat(footprints([elevation]), 12, axis=0)
    xy = rng.random((len(jacobian), 2)) * size
    truth = FilterTruth.of(image, (wrap, wrap)).mean("box", xy, jacobian)
    twin = FilterTwin(image, (wrap, wrap))
    found = {token: decibels(twin.sample(token, xy, jacobian)[0], truth) for token in ("mipmap", "ripmap", "fipmap")}
    assert found["fipmap"] > found["mipmap"] + 1
    assert found["ripmap"] > found["mipmap"] - 1


@pytest.mark.parametrize("size", SIZES)
def test_far_away_a_repeating_image_is_its_mean(rng, size):
    """Along the axes only the mean over the short side remains a signal, and that is left out here."""
    image = noise(*size)
    jacobian = footprints([0.02])[1::2]
    jacobian = jacobian[np.min(np.abs(jacobian[:, :, 0]), axis=1) > 100]
    xy = rng.random((len(jacobian), 2)) * size
    twin, truth = FilterTwin(image, ("repeat", "repeat")), FilterTruth.of(image, ("repeat", "repeat"))
    for token in ("ripmap", "fipmap"):
        assert decibels(twin.sample(token, xy, jacobian)[0], truth.mean("box", xy, jacobian)) > 33


def test_images_of_which_fewer_periods_are_seen_are_chosen_of_as_ever():
    jacobian = footprints([90, 45, 20, 10, 5, 2, 1])
    for module in (ripmap, fipmap):
        choice = module.choose(jacobian)
        known = spread(choice, Tile.of((512, 512), ("repeat", "repeat")), module.PROBES)
        assert not known.stride.any()
        for name in ("direction", "octaves", "level", "length", "width", "tilt"):
            np.testing.assert_array_equal(getattr(known, name), getattr(choice, name))


def test_a_single_line_has_neither_octaves_nor_shears():
    choice = spread(fipmap.choose(footprints([20, 5, 1])), Tile.of((1, 64), ("clamp", "repeat")), fipmap.PROBES)
    along = np.array([direction.long_axis for direction in DIRECTIONS])[choice.direction] == 0
    assert along.any() and not choice.octaves[along].any()
    assert set(choice.direction[along]) == {0}


@pytest.mark.parametrize("size", [(97, 1), (1, 97), (1, 2), (64, 4)])
def test_narrow_repeating_images_take_no_more_memory_than_others(size):
    assert memory_ratio("fipmap", size, ("repeat", "repeat")) < 12
    assert memory_ratio("ripmap", size, ("repeat", "repeat")) < 4


def test_a_single_texel_has_no_chains():
    assert memory_ratio("fipmap", (1, 1), ("repeat", "clamp")) == 1


def test_a_mirrored_image_repeats_after_twice_its_length():
    assert Tile.of((7, 5), ("mirror", "repeat")) == Tile((14, 5), (True, True))
    assert Tile.of((7, 1), ("black", "clamp")) == Tile((7, 1), (False, True))


@pytest.mark.parametrize("size", [(97, 1), (1, 19), (4, 64), (3, 37)])
@pytest.mark.parametrize(("token", "kernel"), [("ripmap", "box"), ("fipmap", "box"), ("fipmap", "gauss")])
@pytest.mark.parametrize("wrap", [("repeat", "repeat"), ("mirror", "clamp")])
def test_the_shader_spreads_boxes_as_the_twin_does(gl, tmp_path, rng, size, token, kernel, wrap):
    image = noise(*size)
    jacobian = np.repeat(footprints([20, 5, 2, 1, 0.5, 0.1]), 6, axis=0)
    jacobian = jacobian * np.exp2(rng.uniform(-1, 2, len(jacobian)))[:, None, None]
    xy = rng.uniform(-0.5, 1.5, (len(jacobian), 2)) * size
    file = save(tmp_path / "noise.exr", image, "float", "raw")
    looked = look_up(gl, ImageSource(file, wrap=wrap), token, xy, jacobian, kernel=kernel)
    options = {"gauss": True} if kernel == "gauss" else {}
    values, _ = FilterTwin(image, wrap).sample(token, xy, jacobian, **options)
    error = np.abs(looked.color - values).max(axis=1)
    assert np.quantile(error, 0.93) < 2e-3
    assert error.max() < 0.2
