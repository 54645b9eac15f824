"""The signal is the least squares solution through the pinch: what was rendered from a signal gives it back."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fexel.errors import FexelError
from fexel.images import linear_to_srgb, srgb_to_linear
from fexel.textures.pinchmap_twin import pinch
from fexel_tools.pinchmap_equations import pinch_point
from fexel_tools.pinchmap_mask import channels, is_legal
from fexel_tools.pinchmap_signal import cell_sides, fill_signal
from fexel_tools.pinchmap_source import PinchmapSource

CLAMP, REPEAT = ("clamp", "clamp"), ("repeat", "repeat")


def blob_mask(rng, shape=(8, 8), wrap=CLAMP):
    """A legal random mask: rectangles of at least two cells, tried until the rules hold."""
    for _ in range(200):
        mask = np.zeros(shape, bool)
        for _ in range(2):
            h, w = rng.integers(2, 5, 2)
            r, c = rng.integers(0, shape[0] - h), rng.integers(0, shape[1] - w)
            mask[r : r + h, c : c + w] = True
        if wrap == REPEAT:
            mask = np.roll(mask, rng.integers(0, 8, 2), (0, 1))
        if mask.any() and is_legal(mask, wrap):
            return mask
    raise AssertionError("no legal mask found")


def pinchmap_of(mask, rng, wrap=CLAMP, strength=1.0, reach=0.6):
    made = np.zeros((*mask.shape, 4))
    made[..., :3] = channels(mask, wrap)
    made[..., :2] *= strength
    made[..., 3] = rng.uniform(-reach, reach, mask.shape)
    return made


def pixel_st(height, width):
    s, t = np.meshgrid((np.arange(width) + 0.5) / width, 1 - (np.arange(height) + 0.5) / height)
    return np.stack([s.ravel(), t.ravel()], axis=1)


def bilinear(signal, coordinates, wrap):
    """Plain bilinear lookup of (Sh, Sw, C) at (M, 2)."""
    rows, columns = signal.shape[:2]
    x, y = coordinates[:, 0] * columns - 0.5, (1 - coordinates[:, 1]) * rows - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    f, g = (x - x0)[:, None], (y - y0)[:, None]

    def texel(r, c):
        if wrap == REPEAT:
            return signal[r % rows, c % columns]
        return signal[np.clip(r, 0, rows - 1), np.clip(c, 0, columns - 1)]

    low = texel(y0, x0) * (1 - f) + texel(y0, x0 + 1) * f
    return low * (1 - g) + (texel(y0 + 1, x0) * (1 - f) + texel(y0 + 1, x0 + 1) * f) * g


def rendered(pinchmap, signal, size, wrap=CLAMP):
    """What a hard-edged lookup shows, as a source of raw data, by the float64 twin."""
    h = 0.5 * pinchmap.shape[0] / signal.shape[0]
    seen = pinch(pinchmap, pixel_st(*size), h, wrap=wrap)
    shown = bilinear(signal, seen.st, wrap).reshape(*size, signal.shape[2])
    side = (seen.k_b > seen.gamma_b).reshape(size)
    return source(shown[..., :3], shown[..., 3], side)


def source(color, opacity=None, side=None, *, is_data=True):
    shape = color.shape[:2]
    opacity = np.ones(shape) if opacity is None else opacity
    side = np.ones(shape) if side is None else side
    arrays = (np.asarray(a, np.float32) for a in (color, opacity, side))
    return PinchmapSource(Path("picture.png"), *arrays, is_data, 8)


@pytest.mark.parametrize("level", [0, 1, 2])
@pytest.mark.parametrize("wrap", [CLAMP, REPEAT])
def test_kernel_displaces_as_the_twin_does(rng, wrap, level):
    h = 0.5**level / 2
    coordinates = rng.random((4000, 2))
    for _ in range(5):
        pinchmap = pinchmap_of(blob_mask(rng, wrap=wrap), rng, wrap, rng.choice([1.0, 0.6]), reach=0.95)
        size = np.array(pinchmap.shape[1::-1])
        truth = pinch(pinchmap, coordinates, h, wrap=wrap)
        clear = np.abs(truth.k_b - truth.gamma_b) > 1e-9  # a rounding decides the side of the others
        fraction = (coordinates * size) % 1
        texels = bilinear(pinchmap, coordinates + 0.5 / size, wrap)
        ours = np.array([pinch_point(*texel, *f, h)[:2] for texel, f in zip(texels, fraction, strict=True)])
        expected = (truth.st - coordinates) * size
        np.testing.assert_allclose(ours[clear], expected[clear], atol=1e-5)


@pytest.mark.parametrize("wrap", [CLAMP, REPEAT])
def test_sides_of_cells_are_recovered_from_k(rng, wrap):
    for _ in range(20):
        mask = blob_mask(rng, wrap=wrap)
        assert np.array_equal(cell_sides(channels(mask, wrap), wrap), mask)


@pytest.mark.parametrize("level", [0, 1, 2])
@pytest.mark.parametrize("wrap", [CLAMP, REPEAT])
def test_signal_that_was_rendered_is_recovered(rng, wrap, level):
    """Consistent equations: least squares must return the signal itself, on either side of a random discontinuity."""
    mask = blob_mask(rng, wrap=wrap)
    pinchmap = pinchmap_of(mask, rng, wrap, reach=0.4)
    signal = rng.uniform(0.3, 0.7, (8 << level, 8 << level, 4))
    signal[mask.repeat(1 << level, 0).repeat(1 << level, 1)] += 0.3
    made = fill_signal(rendered(pinchmap, signal, (384, 384), wrap), pinchmap, signal.shape[:2], wrap=wrap)
    np.testing.assert_allclose(made, signal, atol=0.02)
    assert np.abs(made - signal).mean() < 1e-3


def test_error_is_that_of_dense_least_squares_within_a_thousandth(rng):
    """A picture that no signal reproduces: the residual is as small as NumPy's own solver gets it."""
    pinchmap = np.zeros((6, 5, 4))
    pinchmap[..., 2] = 1
    picture = rng.random((60, 50, 3))
    made = fill_signal(source(picture), pinchmap, (6, 5))[..., :3]
    coordinates = pixel_st(60, 50)
    matrix = bilinear(np.eye(30).reshape(6, 5, 30), coordinates, CLAMP)
    best = np.linalg.lstsq(matrix, picture.reshape(-1, 3), rcond=None)[0]
    assert best.min() > 0  # else the bound would count
    assert best.max() < 1
    np.testing.assert_allclose(made, best.reshape(6, 5, 3), atol=2e-3)


def test_sides_never_mix(rng):
    """Whatever the fitted line misses, a texel shows only colours of its own side: red here, blue there."""
    mask = blob_mask(rng)
    pinchmap = pinchmap_of(mask, rng, reach=0.2)
    truth = rendered(pinchmap_of(mask, rng, reach=0.2), np.ones((8, 8, 4)), (256, 256)).side  # another line
    color = np.where(truth[..., None] > 0.5, [1.0, 0.0, 0.1], [0.0, 0.2, 1.0])
    still = pinched_pixels(pinchmap, (256, 256)) == 0
    fitted = rendered(pinchmap, np.ones((8, 8, 4)), (256, 256)).side
    assert (fitted != truth).mean() > 0.02  # there is something to go wrong
    assert not (still & (fitted != truth)).any()
    made = fill_signal(source(color, side=truth), pinchmap, (8, 8))
    np.testing.assert_allclose(made[mask][:, :3], [[1.0, 0.0, 0.1]] * mask.sum(), atol=1e-3)
    np.testing.assert_allclose(made[~mask][:, :3], [[0.0, 0.2, 1.0]] * (~mask).sum(), atol=1e-3)


def pinched_pixels(pinchmap, size):
    """How far pixels are displaced, in st; 0 where nothing is pinched."""
    coordinates = pixel_st(*size)
    return np.abs(pinch(pinchmap, coordinates, 0.5).st - coordinates).max(1).reshape(size)


def test_feature_that_is_not_on_the_map_is_blurred_not_lost(rng):
    """A bar far from the fitted line, on the other side: the texels there take some of its colour."""
    mask = np.zeros((8, 8), bool)
    mask[:, 4:] = True
    pinchmap = pinchmap_of(mask, rng, reach=0.1)
    side = rendered(pinchmap, np.ones((8, 8, 4)), (256, 256)).side.copy()
    side[:, 16:22] = 1
    color = side[..., None] * np.ones(3)
    made = fill_signal(source(color, side=side), pinchmap, (8, 8))
    assert 0.1 < made[4, :2, 0].max() < 0.5
    np.testing.assert_allclose(made[:, 3, :3], 0, atol=1e-3)


def test_texels_no_pixel_reaches_continue_their_own_side(rng):
    """A source that is empty (not finite) over a third of the picture: its texels are smooth and of their own side."""
    mask = np.zeros((8, 8), bool)
    mask[3:6, 2:6] = True
    pinchmap = pinchmap_of(mask, rng, reach=0.2)
    ramp = np.linspace(0.2, 0.4, 128)[None, :, None] * np.ones((128, 1, 3))
    side = rendered(pinchmap, np.ones((8, 8, 4)), (128, 128)).side
    color = ramp + 0.5 * side[..., None]
    color[:44] = np.nan
    made = fill_signal(source(color, side=side), pinchmap, (8, 8))
    assert np.isfinite(made).all()
    assert made[~mask][:, :3].max() < 0.45
    assert made[mask][:, :3].min() > 0.65
    assert np.abs(made[0] - made[2]).max() < 0.05


def test_nothing_exceeds_the_range_of_the_source():
    """Unbounded least squares overshoots beside a step; the signal does not."""
    pinchmap = np.zeros((8, 8, 4))
    pinchmap[..., 2] = 1
    step = np.zeros((96, 96, 3)) + 0.25
    step[:, 48:] = 0.75
    made = fill_signal(source(step, opacity=step[..., 0]), pinchmap, (8, 8))
    assert made.min() >= 0.25 - 1e-6
    assert made.max() <= 0.75 + 1e-6
    matrix = bilinear(np.eye(64).reshape(8, 8, 64), pixel_st(96, 96), CLAMP)
    assert np.linalg.lstsq(matrix, step.reshape(-1, 3), rcond=None)[0].max() > 0.78


def test_colours_are_fitted_as_they_will_be_interpolated(rng):
    """Renderers mix texels in linear light; judged in sRGB encoding, that beats the least squares of encoded mixing."""
    pinchmap = np.zeros((8, 8, 4))
    pinchmap[..., 2] = 1
    encoded = np.where(rng.random((3, 3, 1)) < 0.5, 0.1, 0.9).repeat(32, 0).repeat(32, 1) * [1.0, 0.7, 0.4]
    linear = srgb_to_linear(encoded)

    def error(texels):
        shown = bilinear(texels[..., :3], pixel_st(96, 96), CLAMP).reshape(96, 96, 3)
        return np.mean((linear_to_srgb(shown) - encoded) ** 2)

    naive = srgb_to_linear(fill_signal(source(encoded), pinchmap, (8, 8))[..., :3])
    averaged = fill_signal(source(linear), pinchmap, (8, 8))
    made = fill_signal(source(linear, is_data=False), pinchmap, (8, 8))
    assert error(made) < 0.97 * min(error(naive), error(averaged))


def test_invisible_colour_does_not_count_but_stays_plausible():
    pinchmap = np.zeros((4, 4, 4))
    pinchmap[..., 2] = 1
    color = np.zeros((64, 64, 3)) + [0.0, 1.0, 0.0]
    color[:, :24] = [1.0, 0.0, 0.0]
    opacity = np.zeros((64, 64))
    opacity[:, :24] = 1
    made = fill_signal(source(color, opacity), pinchmap, (4, 4))
    np.testing.assert_allclose(made[:, 0, :3], [[1, 0, 0]] * 4, atol=0.01)
    np.testing.assert_allclose(made[:, 3, :3], [[0, 1, 0]] * 4, atol=0.01)


@pytest.mark.parametrize("size", [(1, 1), (3, 2), (5, 12), (9, 7)])
def test_source_smaller_than_the_signal(rng, size):
    """Fewer pixels than texels: a smooth picture, each pixel still met."""
    pinchmap = np.zeros((8, 8, 4))
    pinchmap[..., 2] = 1
    picture = rng.uniform(0.2, 0.8, (*size, 3)) * np.ones((1, 1, 3))
    made = fill_signal(source(picture), pinchmap, (32, 32))
    assert np.isfinite(made).all()
    shown = bilinear(made, pixel_st(*size), CLAMP)[:, :3].reshape(*size, 3)
    np.testing.assert_allclose(shown, picture, atol=2e-3)


def test_constant_picture_stays_constant_in_every_mode(rng):
    for wrap in (CLAMP, REPEAT, ("repeat", "clamp"), ("mirror", "repeat")):
        for level in (0, 2):
            pinchmap = pinchmap_of(blob_mask(rng), rng, reach=0.9)
            flat = np.zeros((50, 37, 3)) + [0.25, 0.5, 0.75]
            made = fill_signal(source(flat, is_data=False), pinchmap, (8 << level, 8 << level), wrap=wrap)
            np.testing.assert_allclose(made, np.broadcast_to([0.25, 0.5, 0.75, 1.0], made.shape), atol=1e-5)


def test_texture_that_repeats_is_shifted_with_its_source(rng):
    """Rolling the picture by whole cells rolls the signal: there is no seam."""
    mask = blob_mask(rng, wrap=REPEAT)
    gamma = rng.uniform(-0.4, 0.4, mask.shape)
    picture = rng.random((64, 64, 3))
    side = mask.repeat(8, 0).repeat(8, 1)
    results = []
    for shift in (0, 3):
        moved = np.roll(mask, shift, 1)
        pinchmap = np.concatenate([channels(moved, REPEAT), np.roll(gamma, shift, 1)[..., None]], axis=-1)
        moved_source = source(np.roll(picture, shift * 8, 1), side=np.roll(side, shift * 8, 1))
        results.append(fill_signal(moved_source, pinchmap, (16, 16), wrap=REPEAT))
    np.testing.assert_allclose(np.roll(results[0], 6, 1), results[1], atol=1e-3)


def test_pinchmap_of_strength_zero_gives_the_plain_bilinear_texture(rng):
    """Pixels of either side then share texels, as in a picture without discontinuities."""
    pinchmap = pinchmap_of(blob_mask(rng), rng, strength=0.0)
    plain = np.zeros_like(pinchmap)
    plain[..., 2] = 1
    picture = source(rng.random((64, 64, 3)), side=rng.random((64, 64)))
    np.testing.assert_allclose(fill_signal(picture, pinchmap, (8, 8)), fill_signal(picture, plain, (8, 8)), atol=1e-4)


@pytest.mark.parametrize(
    ("pinchmap_shape", "signal_shape", "words"),
    [
        ((8, 8, 3), (8, 8), "pinchmap of shape"),
        ((8, 8), (8, 8), "pinchmap of shape"),
        ((8, 8, 4), (24, 24), "24 x 24 texels for a pinchmap of 8 x 8"),
        ((8, 8, 4), (8, 16), "16 x 8"),
        ((8, 8, 4), (4, 4), "1, 2, 4, 8"),
    ],
)
def test_sizes_that_do_not_go_together_are_one_line(pinchmap_shape, signal_shape, words):
    with pytest.raises(FexelError, match=words) as caught:
        fill_signal(source(np.zeros((4, 4, 3))), np.zeros(pinchmap_shape), signal_shape)
    assert str(caught.value).startswith("picture.png: ")
    assert "\n" not in str(caught.value)


@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_any_finite_input_gives_a_finite_signal_in_range(data):
    """Any pinchmap at all, legal or not, any source: no NaN, nothing beyond the source's range."""
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    rows, columns, level = (data.draw(st.integers(1, 6)), data.draw(st.integers(1, 6)), data.draw(st.integers(0, 2)))
    size = (data.draw(st.integers(1, 40)), data.draw(st.integers(1, 40)))
    pinchmap = rng.uniform(-1, 1, (rows, columns, 4))
    pinchmap[rng.random((rows, columns)) < 0.3] = np.sign(rng.normal(size=4))
    made = fill_signal(
        source(rng.random((*size, 3)), rng.random(size), rng.random(size), is_data=data.draw(st.booleans())),
        pinchmap,
        (rows << level, columns << level),
        wrap=data.draw(st.sampled_from([CLAMP, REPEAT])),
    )
    assert np.isfinite(made).all()
    assert made.min() >= -1e-6
    assert made.max() <= 1 + 1e-6


def cut_out(rng, size=(320, 320), blur=0.7):
    """A blob with an antialiased rim, pale where it is half transparent, and the pinchmap of its outline."""
    mask = blob_mask(rng)
    pinchmap = pinchmap_of(mask, rng, reach=0.4)
    inside = rendered(pinchmap, np.ones((8, 8, 4)), size).side
    opacity = np.clip(np.round(255 * cv2.GaussianBlur(inside, (0, 0), blur)) / 255, 0, 1)
    color = np.where(opacity[..., None] > 0.99, [0.8, 0.1, 0.05], [1.0, 1.0, 1.0])
    color[opacity < 0.001] = [0.2, 0.3, 0.4]
    return pinchmap, mask, source(color, opacity, opacity, is_data=False), inside


@pytest.mark.parametrize("level", [0, 1, 2])
def test_alpha_of_a_cut_out_is_0_or_1_and_nothing_between(rng, level):
    """Mixed pixels of the rim leave no halo: every texel is exactly one or the other, and so is what is shown."""
    for _ in range(4):
        pinchmap, mask, picture, inside = cut_out(rng)
        made = fill_signal(picture, pinchmap, (8 << level, 8 << level))
        expected = mask.repeat(1 << level, 0).repeat(1 << level, 1)
        assert np.array_equal(made[..., 3], expected.astype(np.float32))
        shown = rendered(pinchmap, made, picture.side.shape).opacity
        away = cv2.erode((inside == (picture.opacity > 0.5)).astype(np.uint8), np.ones((3, 3))) > 0
        rim = cv2.morphologyEx(inside, cv2.MORPH_GRADIENT, np.ones((5, 5))) > 0
        np.testing.assert_allclose(shown[away & ~rim], inside[away & ~rim], atol=1e-5)


def test_colour_beyond_the_rim_of_a_cut_out_is_not_that_of_the_rim(rng):
    """The straight colour of transparent texels continues what lies around, with no pale petals at the outline."""
    pinchmap, mask, picture, _ = cut_out(rng)
    made = fill_signal(picture, pinchmap, (8, 8))
    np.testing.assert_allclose(
        linear_to_srgb(made[~mask][:, :3]), [linear_to_srgb([0.2, 0.3, 0.4])] * (~mask).sum(), atol=0.03
    )


def test_alpha_that_is_really_between_is_kept_beside_a_cut_out(rng):
    """Glass of alpha 0.5, and a ramp: least squares as ever, no texel of them is rounded to 0 or 1."""
    mask = np.zeros((8, 8), bool)
    mask[:, 4:] = True
    pinchmap = pinchmap_of(mask, rng, reach=0.1)
    side = rendered(pinchmap, np.ones((8, 8, 4)), (256, 256)).side
    ramp = np.linspace(0.3, 0.9, 256)[:, None] * np.ones((1, 256))
    for opacity in (np.where(side > 0.5, 0.5, 0.0), np.where(side > 0.5, ramp, 0.0), np.where(side > 0.5, 1.0, 0.02)):
        made = fill_signal(source(np.ones((256, 256, 3)), opacity, side), pinchmap, (8, 8))[..., 3]
        shown = rendered(pinchmap, np.dstack([np.zeros((8, 8, 3)), made]), (256, 256)).opacity
        np.testing.assert_allclose(shown, opacity, atol=0.03)
        if opacity.min() > 0:
            np.testing.assert_allclose(made[~mask], 0.02, atol=2e-3)
