"""The truth of minification: exact for a box, converged for a Gaussian, at every border and however degenerate."""

from __future__ import annotations

import numpy as np
import pytest

from fexel.errors import FexelError

filter_truth = pytest.importorskip("fexel_tools.filter_truth")
FilterTruth = filter_truth.FilterTruth

REPEAT = ("repeat", "repeat")
WRAPS = [REPEAT, ("clamp", "mirror"), ("black", "black"), ("mirror", "clamp"), ("repeat", "black")]


def noise(height=13, width=17):
    return np.random.default_rng(3).random((height, width, 4))


def bilinear(image, wrap, places):
    """The texture between texel centres, written down anew: by the texels' own coordinates, not by cells."""

    def index(i, size, mode):
        if mode == "repeat":
            return i % size, np.ones(i.shape)
        if mode == "mirror":
            return np.where(i % (2 * size) < size, i % (2 * size), 2 * size - 1 - i % (2 * size)), np.ones(i.shape)
        return i.clip(0, size - 1), np.ones(i.shape) if mode == "clamp" else ((i >= 0) & (i < size)).astype(float)

    x, y = places[:, 0] - 0.5, places[:, 1] - 0.5
    total = np.zeros((len(places), image.shape[2]))
    for dx in (0, 1):
        for dy in (0, 1):
            i, j = np.floor(x).astype(int) + dx, np.floor(y).astype(int) + dy
            column, seen_x = index(i, image.shape[1], wrap[0])
            row, seen_y = index(j, image.shape[0], wrap[1])
            weight = (1 - np.abs(x - i)) * (1 - np.abs(y - j)) * seen_x * seen_y
            total += weight[:, None] * image[row, column]
    return total


def brute_force(image, wrap, xy, jacobian, samples=300):
    steps = (np.arange(samples) + 0.5) / samples - 0.5
    pixel = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    return np.array(
        [bilinear(image, wrap, at + pixel @ own.T).mean(axis=0) for at, own in zip(xy, jacobian, strict=True)]
    )


@pytest.mark.parametrize("wrap", WRAPS)
def test_box_is_the_mean_of_very_many_samples(wrap):
    rng = np.random.default_rng(7)
    image, xy, jacobian = noise(), rng.uniform(-25, 45, (3, 2)), rng.normal(0, 7, (3, 2, 2))
    exact = FilterTruth.of(image, wrap).mean("box", xy, jacobian)
    assert exact == pytest.approx(brute_force(image, wrap, xy, jacobian), abs=3e-5)


@pytest.mark.parametrize("kind", filter_truth.TRUTHS)
@pytest.mark.parametrize("wrap", [REPEAT, ("clamp", "clamp"), ("mirror", "repeat")])
def test_constant_stays_constant_under_any_footprint(kind, wrap):
    rng = np.random.default_rng(9)
    image = np.broadcast_to([0.25, 0.5, 0.75, 1.0], (5, 8, 4))
    jacobian = rng.normal(0, 1, (30, 2, 2)) * 10.0 ** rng.uniform(-6, 2, (30, 1, 1))
    values = FilterTruth.of(image, wrap).mean(kind, rng.uniform(-50, 50, (30, 2)), jacobian)
    assert values == pytest.approx(np.broadcast_to([0.25, 0.5, 0.75, 1.0], (30, 4)), abs=1e-7)


@pytest.mark.parametrize("wave", [(3, 0), (0, 5), (2, 3), (-4, 1)])
@pytest.mark.parametrize("kind", filter_truth.TRUTHS)
def test_gratings_keep_what_the_transform_of_the_filter_leaves_of_them(kind, wave):
    """A cosine between texel centres is that of the texels, damped by sinc^2 of the tent, but for aliases of it."""
    size = 256
    frequency = np.array(wave) / size
    centres = np.stack(np.meshgrid(np.arange(size), np.arange(size)), -1) + 0.5
    image = np.repeat(np.cos(2 * np.pi * centres @ frequency)[..., None], 4, axis=2)
    jacobian = np.array([[9.0, 2.0], [-3.0, 5.0]])
    xy = np.random.default_rng(1).uniform(0, size, (16, 2))
    per_pixel = frequency @ jacobian
    kept = np.sinc(per_pixel).prod() if kind == "box" else np.exp(-2 * np.pi**2 * 0.25 * (per_pixel**2).sum())
    kept *= (np.sinc(frequency) ** 2).prod()
    values = FilterTruth.of(image).mean(kind, xy, jacobian)
    assert values[:, 0] == pytest.approx(kept * np.cos(2 * np.pi * xy @ frequency), abs=2e-4)


def test_gaussian_has_converged():
    """Twice as many lines, and pieces of lines, change nothing that could be seen."""
    rng = np.random.default_rng(11)
    truth = FilterTruth.of(noise(64, 48))
    for elevation in (90, 20, 5, 1):
        for azimuth in (0, 20, 45):
            turn = np.radians(azimuth)
            rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            jacobian = rotation @ np.diag([1.25 / np.sin(np.radians(elevation)), 1.25])
            xy = rng.uniform(0, 48, (8, 2))
            finer = np.empty((8, 4))
            given = np.ascontiguousarray(np.broadcast_to(jacobian, (8, 2, 2)))
            filter_truth._gauss(truth.texels, truth.wrap, xy - 0.5, given, 4, finer)
            assert truth.mean("gauss", xy, jacobian) == pytest.approx(finer, abs=1e-3)


def test_gaussian_of_a_point_is_the_texture_itself():
    image, xy = noise(), np.random.default_rng(2).uniform(-20, 40, (20, 2))
    values = FilterTruth.of(image).mean("gauss", xy, np.zeros((2, 2)))
    assert values == pytest.approx(bilinear(image, REPEAT, xy), abs=1e-9)


def test_box_without_area_is_the_mean_along_a_segment_and_at_a_point():
    image, xy = noise(), np.array([[3.3, 4.1], [-2.0, 9.5]])
    truth = FilterTruth.of(image)
    along = np.array([[6.0, 0.0], [2.5, 0.0]])
    steps = (np.arange(20000) + 0.5) / 20000 - 0.5
    wanted = [bilinear(image, REPEAT, at + np.outer(steps, along[:, 0])).mean(axis=0) for at in xy]
    assert truth.mean("box", xy, along) == pytest.approx(np.array(wanted), abs=1e-6)
    assert truth.mean("box", xy, np.zeros((2, 2))) == pytest.approx(bilinear(image, REPEAT, xy), abs=1e-9)


def test_box_of_a_thin_parallelogram_joins_the_segment():
    image, xy = noise(), np.array([[3.3, 4.1]])
    truth = FilterTruth.of(image)
    thin, flat = np.array([[6.0, 1e-5], [2.5, -1e-5]]), np.array([[6.0, 0.0], [2.5, 0.0]])
    assert truth.mean("box", xy, thin) == pytest.approx(truth.mean("box", xy, flat), abs=1e-5)


def test_box_of_the_whole_texture_is_its_mean():
    image = noise()
    jacobian = np.diag([17.0 * 3, 13.0 * 2])
    assert FilterTruth.of(image).mean("box", np.array([[1.3, 7.7]]), jacobian)[0] == pytest.approx(
        image.mean(axis=(0, 1)), abs=1e-12
    )


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (7, 1)])
@pytest.mark.parametrize("wrap", WRAPS)
def test_images_of_one_texel_along_an_axis(shape, wrap):
    rng = np.random.default_rng(5)
    image, xy, jacobian = noise(*shape), rng.uniform(-6, 12, (4, 2)), rng.normal(0, 3, (4, 2, 2))
    exact = FilterTruth.of(image, wrap).mean("box", xy, jacobian)
    assert exact == pytest.approx(brute_force(image, wrap, xy, jacobian, 300), abs=3e-5)


def test_places_that_are_no_numbers_give_none():
    truth = FilterTruth.of(noise())
    xy = np.array([[1.0, np.nan], [2.0, 2.0], [np.inf, 0.0], [1e12, 0.0]])
    values = truth.mean("box", xy, np.eye(2))
    assert np.isnan(values).all(axis=1).tolist() == [True, False, True, True]
    assert np.isnan(truth.mean("gauss", xy[1:2], np.array([[np.inf, 0], [0, 1]]))).all()


def test_unknown_words_are_named_with_what_was_expected():
    with pytest.raises(FexelError, match=r"'circle'.*box, gauss"):
        FilterTruth.of(noise()).mean("circle", np.zeros((1, 2)), np.eye(2))
    with pytest.raises(FexelError, match=r"'wrapped'.*repeat"):
        FilterTruth.of(noise(), ("wrapped", "repeat"))
