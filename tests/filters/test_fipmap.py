"""What pixels choose of a fipmap and a ripmap, and where they look: from Jacobians alone."""

import math

import numpy as np
import pytest

from fexel.filters import fipmap, ripmap
from fexel.filters.shears import DIRECTIONS, FINE_DIRECTIONS

ELEVATIONS = (90, 60, 45, 30, 20, 10, 5, 2, 1, 0.5, 0.2, 0.1)
AZIMUTHS = tuple(range(0, 180, 15))
AXES = np.array([direction.long_axis for direction in FINE_DIRECTIONS])
SHEARS = np.array([direction.shear for direction in FINE_DIRECTIONS])


def turn(degrees):
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[cosine, -sine], [sine, cosine]])


def fan(roll=0.0, minor=1.25):
    """Jacobians of all views, (K, 2, 2)."""
    return np.array(
        [
            turn(azimuth) @ np.diag([minor / math.sin(math.radians(elevation)), minor]) @ turn(roll)
            for elevation in ELEVATIONS
            for azimuth in AZIMUTHS
        ]
    )


def looked_up(jacobian, rng, extent=(4096, 4096), **options):
    choice = fipmap.choose(jacobian, options.get("probes", fipmap.PROBES), gauss=options.get("gauss", False))
    xy = rng.random((len(jacobian), 2)) * 1000
    return choice, xy, fipmap.taps(choice, xy, jacobian, extent, **options)


@pytest.mark.parametrize(("directions", "memory"), [(DIRECTIONS, 12), (FINE_DIRECTIONS, 17 + 1 / 3)])
def test_memory_of_all_chains_that_may_be_chosen(directions, memory):
    chains = sum(2.0**-octaves for each in directions for octaves in range(each.octaves, 60))
    assert 4 / 3 * (1 + chains) == pytest.approx(memory)
    assert len(set(directions)) == len(directions)


def test_only_a_gaussian_takes_the_fine_directions():
    assert fipmap.choose(fan()).direction.max() < len(DIRECTIONS)
    choice = fipmap.choose(fan(), fipmap.GAUSS_PROBES, gauss=True)
    assert choice.direction.max() >= len(DIRECTIONS)
    least = np.array([direction.octaves for direction in FINE_DIRECTIONS])[choice.direction]
    assert np.all((choice.octaves == 0) | (choice.octaves >= least))


@pytest.mark.parametrize("roll", [0, 20, 45])
@pytest.mark.parametrize("probes", [1, 2, 4, 8, 16])
def test_no_direction_is_finer_than_its_octaves_allow(roll, probes):
    choice = fipmap.choose(fan(roll), probes)
    least = np.array([direction.octaves for direction in DIRECTIONS])[choice.direction]
    own = choice.octaves == 0
    assert np.all(own | (choice.octaves >= least))
    assert np.all(SHEARS[choice.direction[own]] == 0)


@pytest.mark.parametrize("roll", [0, 45])
def test_tilt_that_a_shear_leaves_is_half_a_step_of_the_directions_at_most(roll):
    choice = fipmap.choose(fan(roll))
    for octaves, most in ((2, 0.25), (3, 0.125), (5, 0.125), (7, 0.125)):
        taken = ~choice.compact & (choice.octaves == octaves)
        # 1 of x is 1 of y: from there the same slant is another tangent.
        whole = np.abs(SHEARS[choice.direction]) == 1
        assert taken.any()
        assert np.all(np.abs(choice.tilt[taken & ~whole]) <= most + 1e-9)
        assert np.all(np.abs(choice.tilt[taken & whole]) <= most / (1 - most) + 1e-9)


@pytest.mark.parametrize("tangent", [0.5, 1.0, 2.0, -0.5, -1.0, -2.0, 0.25, -0.75])
def test_footprints_along_a_shear_are_brought_onto_an_axis(tangent):
    along = np.array([1.0, tangent]) / math.hypot(1, tangent)
    jacobian = np.stack([90 * along, 1.25 * np.array([-along[1], along[0]])], axis=1)[None]
    choice = fipmap.choose(jacobian)
    assert choice.octaves[0] >= 3
    assert choice.tilt[0] == pytest.approx(0, abs=1e-3)
    direction = DIRECTIONS[choice.direction[0]]
    moved = along[::-1] if direction.long_axis == 1 else along
    assert moved[1] + direction.shear * moved[0] == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("options", [{}, {"probes": 2}, {"probes": 16}, {"gauss": True, "probes": 5}])
def test_weights_are_not_negative_and_sum_to_one(rng, options):
    _, _, taps = looked_up(np.concatenate([fan(), fan(30)]), rng, **options)
    assert taps.weight.min() >= 0
    np.testing.assert_allclose(taps.weight.sum(axis=1), 1, atol=1e-12)


@pytest.mark.parametrize("options", [{}, {"probes": 16}, {"gauss": True, "probes": 5}])
def test_accesses_lie_about_the_pixel(rng, options):
    jacobian = np.concatenate([fan(), fan(30)])
    choice, xy, taps = looked_up(jacobian, rng, **options)
    mean = np.sum(taps.weight[..., None] * taps.at, axis=1) - xy
    texel = np.exp2(choice.octaves + choice.level)
    assert np.all(np.abs(mean).max(axis=1) <= 0.25 * texel)


@pytest.mark.parametrize("roll", [0, 20, 45])
def test_spread_along_the_footprint_is_that_of_a_pixel(rng, roll):
    """Variance along the long axis: that of the pixel's box, of rolled pixels of the two boxes of its sides."""
    jacobian = np.repeat(fan(roll), 20, axis=0)
    choice, xy, taps = looked_up(jacobian, rng, probes=16)
    rows = np.sum(jacobian**2, axis=2)
    axis = np.where(choice.compact, rows[:, 1] > rows[:, 0], AXES[choice.direction]).astype(int)
    pixels = np.arange(len(axis))
    along = taps.at[pixels[:, None], np.arange(taps.at.shape[1]), axis[:, None]] - xy[pixels, axis][:, None]
    texel = np.where(choice.compact, 0, np.exp2(choice.octaves + choice.level))
    measured = np.sum(taps.weight * along**2, axis=1) + texel**2 / 12
    wanted = rows[pixels, axis] / 12
    ratio = (measured / wanted).reshape(-1, 20).mean(axis=1)
    np.testing.assert_allclose(ratio, 1, atol=0.06)


def test_footprint_of_any_size_is_read_with_as_many_accesses():
    sizes = np.exp2(np.arange(-8, 40, 0.37))
    for probes in (1, 2, 4, 16):
        for ratio in (1, 3, 30, 1e6):
            jacobian = sizes[:, None, None] * (turn(33) @ np.diag([1, 1 / ratio]))
            choice = fipmap.choose(jacobian, probes)
            boxes = (choice.length @ [1, 0.5]) / np.exp2(choice.octaves + choice.level)
            assert np.all(choice.compact | (boxes <= 2 * probes + 0.25 + 1e-6))


@pytest.mark.parametrize("choose", [fipmap.choose, ripmap.choose])
@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf, 1e300, 1e-300])
def test_any_jacobian_gives_a_cell_and_places(choose, bad):
    jacobians = np.array([[[bad, bad], [bad, bad]], [[bad, 0], [0, 1]], [[1, 2], [bad, bad]], [[20, bad], [0, 0]]])
    choice = choose(jacobians)
    for name in ("direction", "octaves", "level"):
        assert getattr(choice, name).min() >= 0
    assert choice.direction.max() < len(DIRECTIONS)
    taps = (
        fipmap.taps(choice, np.zeros((4, 2)), jacobians, (7, 5))
        if choose is fipmap.choose
        else ripmap.taps(choice, np.zeros((4, 2)), (7, 5))
    )
    assert np.isfinite(taps.at).all() and np.isfinite(taps.weight).all()


def test_footprint_without_a_width_takes_the_finest_level():
    jacobian = np.array([[[20.0, 0.0], [7.0, 0.0]], [[0.0, 300.0], [0.0, 5.0]]])
    choice = fipmap.choose(jacobian)
    assert np.all(choice.level == 0)
    assert np.all(choice.octaves >= 1)


def test_float32_jacobians_choose_as_float64_ones():
    """At an elevation of 0.02 degrees a minor axis from the quadratic form is 21 % off in float32; rows are not."""
    jacobian = np.concatenate([fan(roll) @ np.diag([5.0, 1.0]) for roll in (0, 10)])
    double, single = fipmap.choose(jacobian), fipmap.choose(jacobian.astype(np.float32).astype(np.float64))
    assert np.mean(double.octaves != single.octaves) < 0.02
    np.testing.assert_allclose(single.width, double.width, rtol=2e-3)


def test_ripmap_moves_nothing_and_is_as_wide_as_the_rectangle_about_the_footprint():
    choice = ripmap.choose(fan())
    assert set(choice.direction) <= {0, 3}
    rows = np.sqrt(np.sum(fan() ** 2, axis=2))
    np.testing.assert_allclose(choice.width, rows.min(axis=1))
