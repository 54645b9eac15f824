"""Colour diversification: offsets that give a base the colours of its references."""

import colour
import numpy as np
import pytest

from fexel.errors import FexelError
from fexel_tools.umbrella_base import BaseUmbrella
from fexel_tools.umbrella_color import ColorOptions, color_offsets, color_sets
from fexel_tools.umbrella_transfer import from_oklab, to_oklab

GREEN, RED, YELLOW = np.array([[0.10, 0.30, 0.05], [0.40, 0.06, 0.04], [0.55, 0.45, 0.08]])
OLIVE, BROWN = np.array([[0.28, 0.30, 0.05], [0.22, 0.11, 0.05]])
SIDE = 64


def _disk(count=24):
    angle = np.arange(count) * (2 * np.pi / count)
    return np.concatenate([[[0.0, 0.0]], 0.45 * np.stack([np.cos(angle), np.sin(angle)], axis=1)])


def _base(rgb, points=None, name="base", alpha=None):
    """An element of the given colour: (3,), or (SIDE, SIDE, 3)."""
    points = _disk() if points is None else points
    color = np.broadcast_to(np.asarray(rgb, np.float64), (SIDE, SIDE, 3))
    opacity = np.ones((SIDE, SIDE)) if alpha is None else alpha
    texture = np.dstack([color, opacity]).astype(np.float32)
    return BaseUmbrella(name, texture, alpha is not None, points + 0.5, points, points.copy(), 0.0, 1.0)


def _detail(rng, rgb, size=0.3):
    return rgb * (1 + size * (rng.random((SIDE, SIDE, 1)) - 0.5))


def _texels():
    """s, t of texel centres, (SIDE, SIDE) each, row 0 at the top."""
    centres = (np.arange(SIDE) + 0.5) / SIDE
    return np.meshgrid(centres, centres[::-1])


def _shown(base, offsets):
    """Colours inside the contour of a disk with one set of offsets, as rendered with f = 1."""
    s, t = _texels()
    x, y = s - 0.5, t - 0.5
    count = len(offsets) - 1
    sector = (np.arctan2(y, x) % (2 * np.pi)) / (2 * np.pi) * count
    first, share = np.floor(sector).astype(int) % count, (sector % 1)[..., None]
    rim = (1 - share) * offsets[1 + first] + share * offsets[1 + (first + 1) % count]
    out = (np.hypot(x, y) / 0.45)[..., None]
    inside = out[..., 0] < 0.97
    shown = base.texture[..., :3] + (1 - out) * offsets[0] + out * rim
    return np.clip(shown[inside], 0, 1), inside


def _oklab(rgb):
    return colour.XYZ_to_Oklab(np.asarray(rgb) @ colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ.T)


def test_a_mixture_lies_between_base_and_reference(rng):
    """In Oklab, on the line between the two means, all of it."""
    base, reference = _base(_detail(rng, GREEN)), _base(_detail(rng, YELLOW))
    sets = color_sets(base, [reference], 200, ColorOptions())
    means = _oklab([_shown(base, offsets)[0].mean(axis=0) for offsets in sets])
    a, b = _oklab(GREEN), _oklab(YELLOW)
    along = (means - a) @ (b - a) / ((b - a) @ (b - a))
    assert -0.05 < along.min() < 0.05
    assert 0.9 < along.max() < 1.05
    np.testing.assert_allclose(means - a - along[:, None] * (b - a), 0, atol=0.02)


def test_detail_stays_the_bases_own(rng):
    base = _base(_detail(rng, GREEN))
    brightest = max(color_sets(base, [_base(YELLOW)], 50, ColorOptions()), key=lambda offsets: offsets.sum())
    shown, inside = _shown(base, brightest)
    own = base.texture[..., :3][inside]
    np.testing.assert_allclose(shown - shown.mean(axis=0), own - own.mean(axis=0), atol=0.02)


def test_a_pattern_comes_with_its_place(rng):
    """A reference that is red on its right half and yellow on its left."""
    s, _ = _texels()
    halves = np.where(s[..., None] > 0.5, RED, YELLOW)
    base = _base(_detail(rng, GREEN))
    offsets = color_sets(base, [_base(halves)], 100, ColorOptions())
    most = max(offsets, key=lambda values: np.abs(values).sum())
    rim = most[1:] + GREEN
    x = _disk()[1:, 0]
    right, left = rim[x > 0.3].mean(axis=0), rim[x < -0.3].mean(axis=0)
    assert right[1] < 0.5 * left[1]
    assert np.linalg.norm(right - RED) < np.linalg.norm(right - YELLOW)
    assert np.linalg.norm(left - YELLOW) < np.linalg.norm(left - RED)


def test_a_pattern_turns_with_the_reference(rng):
    """The same element photographed upside down gives the same colours."""
    oval = _disk(32) * (1.0, 0.5) * np.where(_disk(32)[:, :1] > 0, 1.0, 0.7)
    halves = np.where(_texels()[0][..., None] > 0.5, RED, YELLOW)
    upright = color_sets(_base(GREEN, oval), [_base(halves, oval)], 8, ColorOptions())
    contour = np.concatenate([oval[:1], -oval[1:]])
    turned = color_sets(_base(GREEN, oval), [_base(halves[::-1, ::-1], contour)], 8, ColorOptions())
    np.testing.assert_allclose(turned, upright, atol=0.01)


def test_offsets_clip_little(rng):
    """About a tenth of the texels of a channel at most, however far the reference is."""
    base = _base(np.clip(_detail(rng, np.array([0.5, 0.4, 0.3]), 0.8), 0, 1))
    for reference in ([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]):
        for offsets in color_sets(base, [_base(reference)], 20, ColorOptions()):
            shown, _ = _shown(base, offsets)
            assert ((shown <= 0) | (shown >= 1)).mean() < 0.15


def _creased(rgb):
    """Light with dark creases, three of 16 texels wide."""
    crease = (np.arange(SIDE) % 16 < 3)[:, None, None]
    return _base(np.broadcast_to(rgb * np.where(crease, 0.15, 1.0), (SIDE, SIDE, 3))), crease


@pytest.mark.parametrize("rgb", [GREEN, YELLOW, [0.3, 0.3, 0.3]])
@pytest.mark.parametrize("reference", [BROWN, RED, [0.2, 0.1, 0.3], [0.8, 0.8, 0.7]])
def test_dark_creases_keep_the_hue_of_what_they_crease(rgb, reference):
    """Whatever is added to them, they stay about as another paint would leave them: the light around them, dimmed."""
    base, crease = _creased(np.asarray(rgb))
    for offsets in color_sets(base, [_base(reference)], 20, ColorOptions()):
        shown, inside = _shown(base, offsets)
        dark = np.broadcast_to(crease[..., 0], inside.shape)[inside]
        natural = 0.15 * shown[~dark].mean(axis=0)
        away = np.hypot(*(_oklab(shown[dark].mean(axis=0)) - _oklab(natural))[1:])
        assert away < 0.105  # Oklab; twice that where offsets are not limited


@pytest.mark.parametrize("reference", [BROWN, RED, [0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.1, 0.1, 0.6]])
def test_no_vertex_clips_more_than_some_of_the_texels_around_it(reference):
    base, _ = _creased(GREEN)
    s, t = _texels()
    for offsets in color_sets(base, [_base(reference)], 12, ColorOptions()):
        shown, inside = _shown(base, offsets)
        clipped = np.zeros(inside.shape)
        clipped[inside] = ((shown <= 0) | (shown >= 1)).any(axis=-1)
        for x, y in base.tex_coords:
            near = inside & (np.hypot(s - x, t - y) < 0.15)
            assert clipped[near].mean() < 0.3


def test_shown_colours_lie_within_the_range_of_base_and_reference(rng):
    for _ in range(12):
        first, second = rng.uniform(0.05, 0.7, (2, 3))
        base, reference = _base(_detail(rng, first)), _base(_detail(rng, second))
        low, high = np.sort(_oklab([first, second]), axis=0)
        for offsets in color_sets(base, [reference], 20, ColorOptions()):
            mean = _oklab(_shown(base, offsets)[0].mean(axis=0))
            assert (mean > low - 0.02).all()
            assert (mean < high + 0.02).all()


def _hue_apart(first, second):
    a, b = (np.arctan2(*_oklab(rgb)[:0:-1]) for rgb in (first, second))
    return abs((a - b + np.pi) % (2 * np.pi) - np.pi)


def test_unlike_elements_do_not_trade_colours_unless_asked_to(rng):
    """A strawberry beside a lime stays red."""
    base, unlike = _base(_detail(rng, RED)), _base(_detail(rng, GREEN))

    def most(references):
        offsets = color_offsets([base, unlike], np.zeros(40, np.int32), ColorOptions(), references)
        return max(_hue_apart(_shown(base, each)[0].mean(axis=0), RED) for each in offsets.reshape(40, -1, 3))

    assert most([]) < 0.1
    assert most([unlike]) > 0.8


def test_alike_elements_trade_colours_all_the_way(rng):
    bases = [_base(_detail(rng, GREEN)), _base(_detail(rng, OLIVE))]
    offsets = color_offsets(bases, np.zeros(60, np.int32), ColorOptions()).reshape(60, -1, 3)
    means = _oklab([_shown(bases[0], each)[0].mean(axis=0) for each in offsets])
    assert np.linalg.norm(means - _oklab(OLIVE), axis=1).min() < 0.02
    assert np.linalg.norm(means - _oklab(GREEN), axis=1).min() < 0.02


def test_dark_parts_of_a_pattern_are_not_veiled(rng):
    s, t = _texels()
    eye = np.hypot(s - 0.5, t - 0.5)[..., None] < 0.15
    base = _base(np.where(eye, 0.01, RED))
    for offsets in color_sets(base, [_base([0.9, 0.9, 0.8])], 20, ColorOptions()):
        assert offsets[0].max() < 0.2  # the rim, which grows lighter, takes the centre along a little


def test_white_beside_a_colour_keeps_its_hue(rng):
    """A slice of orange with a white core may turn green, the core not cyan."""
    s, t = _texels()
    core = np.hypot(s - 0.5, t - 0.5)[..., None] < 0.1
    base = _base(np.where(core, 0.95, [0.9, 0.4, 0.03]))
    offsets = color_sets(base, [_base([0.2, 0.5, 0.03])], 20, ColorOptions())
    assert offsets[:, 1:, 0].min() < -0.4
    assert np.ptp(np.clip(0.95 + offsets[:, 0], 0, 1), axis=1).max() < 0.4


def test_colours_are_smooth_along_the_contour(rng):
    noisy = rng.random((SIDE, SIDE, 3))
    base = _base(_detail(rng, GREEN), _disk(64))
    offsets = color_sets(base, [_base(noisy)], 30, ColorOptions())[:, 1:]
    step = np.abs(np.roll(offsets, -1, axis=1) - offsets).max()
    assert step < 0.03


def test_what_is_transparent_or_outside_the_contour_does_not_count(rng):
    s, t = _texels()
    inside = np.hypot(s - 0.5, t - 0.5) < 0.45
    hole = np.hypot(s - 0.5, t - 0.5) < 0.2
    surrounded = np.where(inside[..., None], RED, [0.0, 0.0, 1.0])
    perforated = np.where(hole[..., None], [0.0, 0.0, 1.0], surrounded)
    plain, around, through = (
        color_sets(_base(GREEN), [reference], 16, ColorOptions())
        for reference in (_base(RED), _base(surrounded), _base(perforated, alpha=np.where(hole, 0.0, 1.0)))
    )
    np.testing.assert_allclose(around, plain, atol=0.02)
    np.testing.assert_allclose(through, plain, atol=0.02)


def test_a_lone_base_varies_by_as_much_as_it_does_within(rng):
    base = _base(_detail(rng, GREEN, 0.6))
    offsets = color_offsets([base], np.zeros(300, np.int32), ColorOptions()).reshape(300, -1, 3)
    means = _oklab(np.clip(offsets.mean(axis=1) + GREEN, 0, 1)) - _oklab(GREEN)
    assert 0.01 < means[:, 0].std() < 0.1
    assert abs(means.mean(axis=0)).max() < 0.02
    uniform = color_offsets([_base(GREEN)], np.zeros(9, np.int32), ColorOptions())
    np.testing.assert_allclose(uniform, 0, atol=1 / 256)


def test_offsets_come_umbrella_by_umbrella():
    """Bases of different vertex counts, one not used."""
    bases = [_base(GREEN, _disk(5)), _base(RED, _disk(9)), _base(YELLOW, _disk(7))]
    shape_of = np.array([1, 0, 1, 1], np.int32)
    offsets = color_offsets(bases, shape_of, ColorOptions(sets=1))
    assert offsets.shape == (3 * 10 + 6, 3)
    assert offsets.dtype == np.float32
    np.testing.assert_array_equal(offsets[:10], offsets[16:26])  # one set: both umbrellas of a base share it
    np.testing.assert_array_equal(offsets[16:26], offsets[26:])


def test_sets_are_shared_evenly_and_no_more_than_asked_for(rng):
    bases = [_base(_detail(rng, GREEN)), _base(OLIVE)]
    offsets = color_offsets(bases, np.zeros(300, np.int32), ColorOptions(sets=50)).reshape(300, -1)
    different, counts = np.unique(offsets, axis=0, return_counts=True)
    assert 40 <= len(different) <= 50  # mixtures of shares that differ by less than a step are the same
    assert (counts % 6 == 0).all()


def test_offsets_are_multiples_of_a_256th_within_range(rng):
    offsets = color_sets(_base(GREEN), [_base(rng.random((SIDE, SIDE, 3)))], 40, ColorOptions())
    np.testing.assert_array_equal(offsets * 256, np.rint(offsets * 256))
    assert np.abs(offsets).max() <= 1.0


def test_the_seed_decides_alone(rng):
    bases = [_base(_detail(rng, rgb)) for rgb in (GREEN, RED, YELLOW)]
    shape_of = rng.integers(0, 3, 50).astype(np.int32)
    first, again, other = (color_offsets(bases, shape_of, ColorOptions(seed=seed)) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_half_the_amount_goes_about_half_the_way(rng):
    base, reference = _base(_detail(rng, GREEN)), _base(YELLOW)
    whole, half = (color_sets(base, [reference], 20, ColorOptions(amount=amount)).mean(axis=1) for amount in (1.0, 0.5))
    far = np.abs(whole) > 0.05
    assert ((half[far] / whole[far] > 0.3) & (half[far] / whole[far] < 0.7)).all()


def test_no_amount_is_no_colours():
    bases, shape_of = [_base(GREEN), _base(RED)], np.zeros(4, np.int32)
    assert color_offsets(bases, shape_of, ColorOptions(amount=0.0)).shape == (0, 3)
    assert color_offsets(bases, shape_of[:0], ColorOptions()).shape == (0, 3)


def test_only_the_given_references_count(rng):
    bases = [_base(_detail(rng, GREEN)), _base(RED)]
    offsets = color_offsets(bases, np.zeros(60, np.int32), ColorOptions(), [_base(0.5 * GREEN)])
    assert offsets.max() < 0.05


@pytest.mark.parametrize("fault", ["infinite", "negative", "tiny", "empty", "clear"])
def test_odd_textures_give_finite_offsets(fault, rng):
    base = _base(_detail(rng, GREEN))
    texture = base.texture.copy()
    if fault == "infinite":
        texture[10:20, 10:20, :3] = np.inf
        texture[30, 30] = np.nan
    elif fault == "negative":
        texture[..., :3] -= 0.5
    elif fault == "tiny":
        texture = texture[:1, :2]
    elif fault == "empty":
        texture[..., 3] = 0.0
    odd = BaseUmbrella("odd", texture, True, base.tex_coords, base.points, base.points, 0.0, 1.0)
    if fault == "clear":
        odd = _base(GREEN, np.zeros((4, 2)))
    for bases in ([odd], [odd, base], [base, odd]):
        offsets = color_offsets(bases, np.zeros(5, np.int32), ColorOptions())
        assert np.isfinite(offsets).all()
        assert np.abs(offsets).max() <= 1.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (ColorOptions(amount=2.0), r"--color-amount: 2, expected a number in \[0, 1\]"),
        (ColorOptions(sets=0), "--color-sets: 0, expected at least 1"),
    ],
)
def test_wrong_options_are_named(options, message):
    with pytest.raises(FexelError, match=message):
        color_offsets([_base(GREEN)], np.zeros(1, np.int32), options)


def test_oklab_is_that_of_colour_science(rng):
    rgb = rng.random((50, 3))
    assert np.abs(to_oklab(rgb) - _oklab(rgb)).max() < 1e-12
    assert np.abs(from_oklab(to_oklab(rgb)) - rgb).max() < 1e-12
