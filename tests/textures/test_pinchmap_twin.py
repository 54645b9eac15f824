"""The float64 twin: laws of the pinch, hard cases, encoding, filtering against a supersampled truth."""

import functools

import numpy as np
import pytest

from fexel import mipmaps
from fexel.errors import FexelError
from fexel.textures.pinchmap_encoding import decode_texels, encode_texels, signal_half_texel
from fexel.textures.pinchmap_lattice import trilinear
from fexel.textures.pinchmap_twin import edge, picture_levels, pinch, sample_pinchmap
from fexel_tools.pinchmap_mask import channels

CLAMP, REPEAT = ("clamp", "clamp"), ("repeat", "repeat")


def straight(gamma=0.0, cells=8):
    """A vertical boundary in the middle of a square map: + on the right."""
    mask = np.zeros((cells, cells), bool)
    mask[:, cells // 2 :] = True
    return np.dstack([channels(mask), np.full(mask.shape, float(gamma))]), mask


def square(gamma=0.0, cells=8):
    """A square of + in the middle: straights and turns of all directions."""
    mask = np.zeros((cells, cells), bool)
    mask[2:-2, 2:-2] = True
    return np.dstack([channels(mask), np.full(mask.shape, float(gamma))]), mask


def two_colors(mask, k=1):
    """Opaque red on the + side, opaque blue on the other."""
    side = mask.repeat(2**k, 0).repeat(2**k, 1)[..., None]
    return np.where(side, [1.0, 0.2, 0.1, 1.0], [0.1, 0.2, 0.9, 1.0]).astype(np.float32)


def lattice(pixels):
    """Pixel centres over [0, 1]^2, top row first, and the Jacobian."""
    at = (np.arange(pixels) + 0.5) / pixels
    return np.stack(np.meshgrid(at, 1 - at), -1).reshape(-1, 2), np.eye(2) / pixels * [1, -1]


# What is shown


@pytest.mark.parametrize("k", [0, 1, 3])
@pytest.mark.parametrize("gamma", [-0.9, -0.3, 0.0, 0.6, 0.99])
def test_hard_edges_show_either_side_and_nothing_between(gamma, k):
    pinchmap, mask = square(gamma)
    signal = two_colors(mask, k)
    st, _ = lattice(181)
    shown = sample_pinchmap(pinchmap, signal, st)
    plus = edge(pinchmap, st) > 0
    assert np.abs(shown - np.where(plus[:, None], signal[4 * 2**k, 4 * 2**k], signal[0, 0])).max() < 1e-6


def test_the_line_of_a_straight_is_where_k_equals_gamma():
    for gamma in (-0.75, 0.0, 0.4):
        pinchmap, _ = straight(gamma)
        s = (4 + gamma) / 8
        st = np.array([[s - 1e-9, 0.3], [s + 1e-9, 0.3]])
        assert (edge(pinchmap, st) > 0).tolist() == [False, True]


def test_an_inactive_map_displaces_nothing(rng):
    pinchmap = np.dstack([np.zeros((5, 7, 2)), np.ones((5, 7)), rng.uniform(-1, 1, (5, 7))])
    st = rng.uniform(-0.5, 1.5, (200, 2))
    for wrap in (CLAMP, REPEAT, ("mirror", "black")):
        assert np.array_equal(pinch(pinchmap, st, 0.25, wrap=wrap).st, st)


def test_an_active_row_across_the_whole_map_pinches_along_it():
    mask = np.zeros((6, 6), bool)
    mask[3:] = True
    for wrap in (CLAMP, ("repeat", "clamp")):
        pinchmap = np.dstack([channels(mask, wrap), np.zeros(mask.shape)])
        t = np.linspace(0.3, 0.7, 200)
        for s in (0.0, 0.5, 0.999, 1.0):
            moved = pinch(pinchmap, np.stack([np.full(200, s), t], 1), 0.5, wrap=wrap).st
            assert np.abs(moved[:, 0] - s).max() < 1e-12
            assert np.abs(moved[:, 1] * 6 - 3).min() >= 0.5 - 1e-9


def test_strength_zero_shows_the_signal_as_it_is_and_strength_between_moves_less(rng):
    pinchmap, _ = square(0.3)
    st = rng.random((500, 2))
    full = pinch(pinchmap, st, 0.5).st - st
    assert np.array_equal(pinch(pinchmap * [0, 0, 1, 1], st, 0.5).st, st)
    half = pinch(pinchmap * [0.5, 0.5, 1, 1], st, 0.5).st - st
    assert np.allclose(half, 0.5 * full, atol=1e-9)


def test_an_open_boundary_starts_smoothly():
    pinchmap, mask = straight(0.0, 8)
    pinchmap[:4, :, :2] = 0.0  # the upper half is not pinched
    signal = two_colors(mask, 0)
    t = np.linspace(0.3, 0.7, 400)
    steps = []
    for side in (-1e-7, 1e-7):
        steps.append(sample_pinchmap(pinchmap, signal, np.stack([np.full(400, 0.5 + side), t], 1))[:, 0])
    jump = np.abs(steps[1] - steps[0])
    assert jump[0] > 0.8
    assert jump[-1] < 1e-5
    assert (np.diff(jump) < 1e-6).all()
    assert np.abs(np.diff(jump)).max() < 0.03


# Laws along a segment


@pytest.mark.parametrize("antialias", [0.0, 0.5, 4.0, 60.0])
@pytest.mark.parametrize("gamma", [-0.97, -0.5, 0.0, 0.7, 0.999])
@pytest.mark.parametrize("h", [0.5, 0.125])
def test_targets_are_monotone_within_the_segment_and_meet_its_ends(gamma, h, antialias):
    pinchmap, _ = straight(gamma)
    s = np.linspace(3 / 8, 5 / 8, 4001)
    st = np.stack([s, np.full(len(s), 0.52)], 1)
    shown = pinch(pinchmap, st, h, jacobian=np.eye(2) / 200, antialias=antialias).st[:, 0] * 8
    assert (np.diff(shown) > -1e-9).all()
    assert abs(shown[0] - 3) < 1e-9
    assert abs(shown[-1] - 5) < 1e-9
    if antialias == 0:
        assert np.abs(shown - 4).min() >= h - 1e-9
    else:
        crossing = np.interp(4.0, shown, s) * 8 - 4
        assert abs(crossing - gamma) < 2e-3  # centred on the line
    if abs(gamma) < 0.9:  # elsewhere a whole side of the segment is between two places
        assert np.abs(np.diff(shown)).max() < (2.1 * h if antialias == 0 else 0.3)


def test_an_antialiased_edge_is_as_many_pixels_wide_as_asked_however_it_runs():
    rng = np.random.default_rng(5)
    pinchmap, mask = straight(0.0)
    pinchmap[..., 3] = np.linspace(-0.6, 0.6, 8)[:, None]  # a slanted line
    for _ in range(20):
        angle, pixel, width = rng.uniform(0, 2 * np.pi), rng.uniform(0.005, 0.02), rng.uniform(0.5, 4)
        jacobian = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) * pixel / 8
        slope = np.array([1.0, 1.2 / 7]) / np.hypot(1.0, 1.2 / 7)
        middle = np.array([0.5, 0.5])
        middle[0] -= edge(pinchmap, middle[None])[0] / 8  # onto the line
        along = np.linspace(-6, 6, 2401)
        st = middle + along[:, None] * slope * pixel / 8
        color = sample_pinchmap(pinchmap, two_colors(mask), st, jacobian, antialias=width)[:, 0]
        between = along[(color > 0.1 + 1e-4) & (color < 1.0 - 1e-4)]
        assert between[-1] - between[0] == pytest.approx(width, rel=0.02)
        assert between[-1] + between[0] == pytest.approx(0, abs=0.02 * width + 0.02)


def test_no_step_but_the_edge_wherever_the_map_is_smooth(rng):
    pinchmap, _ = square()
    pinchmap[..., 3] = rng.uniform(-0.5, 0.5, (8, 8))
    angle = 0.3
    along = np.linspace(0, 1, 200001)
    st = np.stack([0.02 + along * np.cos(angle), 0.33 + along * np.sin(angle)], 1)
    moved = pinch(pinchmap, st, 0.5)
    step = np.abs(np.diff(moved.st - st, axis=0)).max(1) * 8
    crossing = np.diff(edge(pinchmap, st) > 0) != 0
    assert crossing.sum() >= 2
    assert step[~crossing].max() < 0.01


# Hard cases


@pytest.mark.parametrize("gamma", [-1.0, 1.0, -0.9999999, 0.9999999])
def test_gamma_and_k_at_their_ends_stay_finite_and_bounded(gamma):
    pinchmap, _ = square(gamma)
    near = np.array([0.0, 1e-300, 1e-16, 1e-9, 1e-6, 0.5, 1 - 1e-9, 1 - 1e-16, 1.0])
    cells = np.arange(9)[:, None]
    axis = ((cells + near) / 8).ravel()
    st = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    for antialias in (0.0, 1.0):
        moved = pinch(pinchmap, st, 0.5, jacobian=np.eye(2) / 100, antialias=antialias)
        assert np.isfinite(moved.st).all()
        assert np.abs((moved.st - st) * 8).max() <= 1.5 + 1e-9


def test_places_that_are_not_finite_show_nothing():
    pinchmap, mask = square()
    st = np.array([[np.nan, 0.5], [0.5, np.inf], [0.5, 0.5]])
    shown = sample_pinchmap(pinchmap, two_colors(mask), st, np.eye(2) / 64)
    assert np.isfinite(shown).all()
    assert shown[:2].tolist() == [[0] * 4] * 2
    assert shown[2, 3] == 1
    jacobians = np.tile(np.eye(2) / 64, (3, 1, 1))
    jacobians[0, 1, 0] = np.nan
    jacobians[1, 0, 0] = np.inf
    shown = sample_pinchmap(pinchmap, two_colors(mask), np.full((3, 2), 0.5), jacobians)
    assert shown[:, 3].tolist() == [0, 0, 1]


def test_one_texel_maps_and_signals():
    pinchmap = np.array([[[0.0, 0.0, -1.0, 0.2]]])
    signal = np.full((1, 1, 4), 0.25, np.float32)
    st, jacobian = lattice(5)
    for wrap in (CLAMP, REPEAT, ("mirror", "mirror")):
        assert np.allclose(sample_pinchmap(pinchmap, signal, st, jacobian, wrap=wrap), 0.25)
    assert len(picture_levels(pinchmap, [signal])) == 1


def test_no_points_give_no_colors():
    pinchmap, mask = square()
    assert sample_pinchmap(pinchmap, two_colors(mask), np.empty((0, 2)), np.eye(2)).shape == (0, 4)
    assert edge(pinchmap, np.empty((0, 2))).shape == (0,)


@pytest.mark.parametrize(
    ("pinchmap", "signal", "h"),
    [
        ((8, 6), (8, 6), 0.5),
        ((8, 6), (32, 24), 0.125),
        ((8, 6), (24, 18), None),
        ((8, 6), (16, 6), None),
        ((8, 6), (4, 3), None),
        ((8, 6), (17, 12), None),
        ((1, 1), (1, 1), 0.5),
    ],
)
def test_sizes_that_go_together(pinchmap, signal, h):
    assert signal_half_texel(pinchmap, signal) == h


def test_a_signal_of_another_ratio_is_an_error_that_says_both_sizes():
    with pytest.raises(FexelError, match=r"24 x 24 .* 8 x 8"):
        sample_pinchmap(square()[0], np.zeros((24, 24, 4), np.float32), np.zeros((1, 2)))


# Encoding


def test_texels_keep_zero_and_survive_a_round_trip(rng):
    values = np.concatenate([[-1.0, 0.0, 1.0], rng.uniform(-1, 1, 997)]).reshape(-1, 4)
    for bits, top in ((8, 255), (16, 65535)):
        texels = encode_texels(values, bits)
        assert texels.max() < top
        assert np.array_equal(encode_texels(decode_texels(texels), bits), texels)
        assert np.abs(decode_texels(texels) - values).max() <= 0.5 / (top // 2) + 1e-12
        assert decode_texels(encode_texels(np.zeros(4), bits)).tolist() == [0] * 4
        assert decode_texels(np.array([top], texels.dtype)).tolist() == [1]


def test_broken_float_texels_become_numbers_within_range():
    assert encode_texels(np.array([np.nan, np.inf, -np.inf, 2.0])).tolist() == [127, 254, 0, 254]
    assert decode_texels(np.array([np.nan, np.inf, -7.0, 0.5], np.float32)).tolist() == [0, 1, -1, 0.5]


# Borders


def test_a_tiled_image_has_no_seam(rng):
    mask = np.roll(square()[1], (3, 4), (0, 1))  # the square lies across all borders
    pinchmap = np.dstack([channels(mask, REPEAT), rng.uniform(-0.5, 0.5, mask.shape)])
    moved = np.roll(pinchmap, (-3, 2), (0, 1))
    signal = rng.random((16, 16, 4)).astype(np.float32)
    st, jacobian = lattice(120)
    shift = np.array([2 / 8, 3 / 8])  # s right, t up
    one = sample_pinchmap(pinchmap, signal, st * 1.7 - 0.4, jacobian, wrap=REPEAT)
    other = sample_pinchmap(moved, np.roll(signal, (-6, 4), (0, 1)), st * 1.7 - 0.4 + shift, jacobian, wrap=REPEAT)
    assert np.abs(one - other).max() < 1e-9


def test_mirror_repeats_the_picture_reversed(rng):
    pinchmap, _ = square()
    pinchmap[..., 3] = rng.uniform(-0.5, 0.5, (8, 8))
    signal = rng.random((16, 16, 4)).astype(np.float32)
    st, jacobian = lattice(60)
    inside = sample_pinchmap(pinchmap, signal, st, jacobian, wrap=("mirror", "mirror"))
    for flipped in (st * [-1, 1], st * [1, -1] + [0, 2], st + [2, -2], 2 - st):
        assert (
            np.abs(sample_pinchmap(pinchmap, signal, flipped, jacobian, wrap=("mirror", "mirror")) - inside).max()
            < 1e-9
        )


def test_black_is_transparent_outside_and_clamp_goes_on():
    pinchmap, mask = square()
    signal = two_colors(mask)
    st = np.array([[-0.2, 0.5], [1.3, 0.5], [0.5, -0.4], [0.5, 0.5]])
    assert sample_pinchmap(pinchmap, signal, st, wrap=("black", "black"))[:, 3].tolist() == [0, 0, 0, 1]
    assert sample_pinchmap(pinchmap, signal, st)[:, 3].tolist() == [1, 1, 1, 1]


# Filtering


def wave(cells=16):
    """A slanted, wavy boundary through a straight row of active texels, and the smooth signal of its two sides."""
    mask = np.zeros((cells, cells), bool)
    mask[cells // 2 :] = True
    pinchmap = np.dstack([channels(mask), 0.7 * np.sin(np.arange(cells))[None].repeat(cells, 0)])
    return pinchmap, two_colors(mask, 1)


def truth(pinchmap, signal, st, jacobian, line_width=0.0, probes=24):
    """Mean over the pixel's square of the picture with hard edges, (M, 4)."""
    inside = (np.arange(probes) + 0.5) / probes - 0.5
    offsets = np.stack(np.meshgrid(inside, inside), -1).reshape(-1, 2) @ jacobian.T
    places = (st[:, None] + offsets).reshape(-1, 2)
    options = {"antialias": 1.0, "line_width": line_width}
    shown = sample_pinchmap(pinchmap, [signal], places, jacobian / probes / 8, **options)
    return shown.reshape(len(st), -1, 4).mean(1)


def error_db(color, expected):
    return -20 * np.log10(np.sqrt(np.mean((color[:, :3] - expected[:, :3]) ** 2)))


@pytest.mark.parametrize(
    ("pixels_per_texel", "least_db"), [(12.0, 44.0), (4.0, 40.0), (2.0, 35.0), (1.0, 32.0), (0.5, 26.0), (0.25, 26.0)]
)
def test_filtering_is_near_the_truth_at_any_footprint(rng, pixels_per_texel, least_db):
    pinchmap, signal = wave()
    pixel = 1 / (16 * pixels_per_texel)
    jacobian = np.array([[0.9, -0.436], [0.436, 0.9]]) * pixel
    st = 0.5 + rng.uniform(-0.35, 0.35, (800, 2)) * [1, 0.6]
    levels = picture_levels(pinchmap, mipmaps.pyramid(signal))
    assert error_db(sample_pinchmap(pinchmap, levels, st, jacobian), truth(pinchmap, signal, st, jacobian)) > least_db


@functools.cache
def plain_levels(size=256):
    """Mip levels of a texture of the wave, `size` texels a side."""
    places, pixel = lattice(size * 4)
    texels = sample_pinchmap(*wave(), places, pixel)
    return mipmaps.pyramid(texels.reshape(size, 4, size, 4, 4).mean((1, 3)))


@pytest.mark.parametrize("pixels_per_texel", [0.2, 0.5, 0.8, 1.3, 3.0])
def test_a_moving_picture_shimmers_no_more_than_a_large_mip_mapped_texture(pixels_per_texel):
    pinchmap, signal = wave()
    pixel = 1 / (16 * pixels_per_texel)
    jacobian = np.eye(2) * pixel
    levels = picture_levels(pinchmap, mipmaps.pyramid(signal))
    along = np.linspace(0, 1, 41)  # a pixel's way across the boundary, and along it, from four places
    ways = [along[:, None] * way * pixel for way in np.eye(2)]
    starts = 0.5 + np.array([[0.11, -0.02], [-0.13, 0.01], [0.02, 0.0], [-0.05, -0.01]])
    st = np.concatenate([start + way for way in ways for start in starts])
    expected = truth(pinchmap, signal, st, jacobian)
    ours = (sample_pinchmap(pinchmap, levels, st, jacobian) - expected)[:, :3].reshape(8, 41, 3)
    large = plain_levels()
    lod = np.full(len(st), np.log2(len(large[0]) * pixel))
    theirs = (trilinear(large, st, lod, CLAMP) - expected)[:, :3].reshape(8, 41, 3)
    assert np.ptp(ours, axis=1).mean() <= 1.1 * np.ptp(theirs, axis=1).mean()
    assert np.abs(np.diff(ours, axis=1)).max() < 0.03


@pytest.mark.parametrize("pixels_per_texel", [8.0, 2.0, 1.0, 0.5, 0.2])
def test_solid_lines_fade_by_coverage(rng, pixels_per_texel):
    pinchmap, signal = wave()
    pixel = 1 / (16 * pixels_per_texel)
    jacobian = np.eye(2) * pixel
    levels = picture_levels(pinchmap, mipmaps.pyramid(signal), line_width=0.25)
    # Over a stretch across the boundary of many pixels the ink is what the line's area is.
    reach = min(0.45, max(3 * pixel, 0.15))
    st = np.stack(np.meshgrid(np.linspace(0.2, 0.8, 60), np.linspace(0.5 - reach, 0.5 + reach, 240)), -1).reshape(-1, 2)
    shown = sample_pinchmap(pinchmap, levels, st, jacobian, line_width=0.25)
    bare = sample_pinchmap(pinchmap, picture_levels(pinchmap, mipmaps.pyramid(signal)), st, jacobian)
    fine = sample_pinchmap(pinchmap, levels, st, jacobian / 1e3, line_width=0.25)
    fine_bare = sample_pinchmap(pinchmap, levels, st, jacobian / 1e3)
    ink, ink_fine = (bare - shown)[:, :3].sum(), (fine_bare - fine)[:, :3].sum()
    assert ink == pytest.approx(ink_fine, rel=0.1)


def test_lines_are_not_drawn_where_strength_is_zero_and_cover_with_their_alpha():
    pinchmap, mask = straight()
    pinchmap[:4, :, :2] = 0.0
    signal = two_colors(mask)
    st = np.array([[0.5, 0.9], [0.5, 0.1]])
    green = (0.0, 1.0, 0.0, 0.5)
    shown = sample_pinchmap(pinchmap, signal, st, np.eye(2) / 500, line_width=0.4, line_color=green)
    bare = sample_pinchmap(pinchmap, signal, st, np.eye(2) / 500)
    assert np.allclose(shown[0], bare[0])
    assert np.allclose(shown[1], 0.5 * bare[1] + [0, 0.5, 0, 0.5])
    half = sample_pinchmap(
        straight()[0] * [0.5, 0.5, 1, 1], signal, st, np.eye(2) / 500, line_width=0.4, line_color=green
    )
    assert np.allclose(half[:, 1], 0.75 * bare[:, 1] + 0.25)  # a line is as strong as its discontinuity


def test_levels_finer_than_the_mask_are_the_signals_and_coarser_ones_the_pictures(rng):
    pinchmap, mask = square(0.8)
    signal = two_colors(mask, 1)
    levels = picture_levels(pinchmap, mipmaps.pyramid(signal))
    plain = mipmaps.pyramid(signal)
    assert [level.shape for level in levels] == [level.shape for level in plain]
    assert np.array_equal(levels[0], signal)
    assert np.array_equal(levels[1], plain[1])
    st, jacobian = lattice(400)
    picture = sample_pinchmap(pinchmap, signal, st, jacobian).mean(0)
    assert np.allclose(levels[-1][0, 0], picture, atol=2e-3)
    assert np.abs(plain[-1][0, 0] - picture).max() > 0.1  # gamma moved the edge, which the signal cannot know
