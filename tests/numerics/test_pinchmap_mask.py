"""Legal masks: exactly the undesired fexels are pinched away, whatever gamma is; every rule is needed."""

import numpy as np
import pytest

from fexel.textures.pinchmap_twin import pinch
from fexel_tools.pinchmap_mask import ADJACENT, BORDER, CROSS, DIAGONAL, SURROUNDED, channels, is_legal, violations

CLAMP, REPEAT = ("clamp", "clamp"), ("repeat", "repeat")
MARGIN = 2  # cells of the surroundings in which a pinch can reach


def all_masks(height, width):
    numbers = np.arange(2 ** (height * width))
    return (numbers[:, None] >> np.arange(height * width) & 1).astype(bool).reshape(-1, height, width)


def sheet_of(tiles):
    """Masks (N, rows, columns) side by side in one, the last rows filled up with the first mask."""
    across = int(np.ceil(np.sqrt(len(tiles))))
    rows, columns = tiles.shape[1:]
    tiles = np.concatenate([tiles, np.tile(tiles[:1], (across * across - len(tiles), 1, 1))])
    return tiles.reshape(across, across, rows, columns).swapaxes(1, 2).reshape(across * rows, across * columns)


def surrounded(masks, outside):
    margins = ((0, 0), (MARGIN, MARGIN), (MARGIN, MARGIN))
    return np.pad(masks, margins, mode="wrap") if outside is None else np.pad(masks, margins, constant_values=outside)


def legal_ones(masks, outside):
    """Those (N, rows, columns) that are legal with cells of one side around them; None: with themselves around them."""
    tiles = surrounded(masks, outside)
    rows, columns = tiles.shape[1:]
    broken = violations(sheet_of(tiles), CLAMP)
    across = len(broken) // rows
    broken = broken.reshape(across, rows, across, columns).swapaxes(1, 2).reshape(-1, rows, columns)
    rim = 0 if outside is not None else 1  # tiles of different periods do not fit together
    inner = broken[: len(masks), rim : rows - rim, rim : columns - rim]
    return masks[~inner.any(axis=(1, 2))]


def faults(mask, wrap, h, rng, per_cell=12, reach=0.5):
    """Share of places that show an undesired fexel, and number of parts of other fexels that no place shows.

    Signal fexels are the squares between signal texels, undesired around an active pinchmap texel. A part is a
    quarter of a cell of the mask, less what an undesired fexel has of it.
    """
    size = np.array(mask.shape[::-1])
    pinchmap = np.dstack([channels(mask, wrap), rng.uniform(-reach, reach, mask.shape)])
    places = (np.stack(np.meshgrid(*(np.arange(n * per_cell) for n in size)), -1).reshape(-1, 2) + 0.5) / per_cell
    shown = pinch(pinchmap, places / size, h, wrap=wrap).st * size
    active = corner_is_active(pinchmap, wrap)
    corner = np.rint(shown).astype(int)
    corner = np.mod(corner, size) if wrap == REPEAT else np.clip(corner, 0, size)
    inside = np.abs(shown - np.rint(shown)).max(1) < h - 1e-9
    wrong = inside & active[corner[:, 1], corner[:, 0]]
    quarter = np.floor(shown * 2 + 1e-12).astype(int)
    quarter = np.mod(quarter, 2 * size) if wrap == REPEAT else np.clip(quarter, 0, 2 * size - 1)
    seen = np.zeros(2 * size[::-1], bool)
    seen[quarter[:, 1], quarter[:, 0]] = True
    undesired = np.repeat(np.repeat(active, 2, 0), 2, 1)[1:-1, 1:-1] if h == 0.5 else np.zeros_like(seen)
    return wrong.mean(), int((~seen & ~undesired).sum())


def corner_is_active(pinchmap, wrap):
    """(Nh + 1, Nw + 1), row 0 at the bottom: those at s = 1 and t = 1 are the sampler's."""
    active = (pinchmap[..., 2] == 0)[::-1]
    return np.pad(active, ((0, 1), (0, 1)), mode="wrap" if wrap == REPEAT else "edge")


def is_exact(mask, wrap, h, rng):
    """Whether lines anywhere show no undesired fexel, and lines not too near the ends show all others."""
    return faults(mask, wrap, h, rng, reach=0.99)[0] == 0 and faults(mask, wrap, h, rng) == (0, 0)


@pytest.mark.parametrize(("outside", "h"), [(False, 0.5), (True, 0.125)])
@pytest.mark.parametrize(("height", "width", "count"), [(2, 2, 2), (2, 3, 4), (3, 2, 4), (3, 3, 14), (4, 4, 168)])
def test_every_legal_mask_is_pinched_exactly(rng, height, width, count, outside, h):
    masks = legal_ones(all_masks(height, width), outside)
    assert len(masks) == count
    sheet = sheet_of(surrounded(masks, outside))
    assert is_legal(sheet, CLAMP)
    assert is_exact(sheet, CLAMP, h, rng)


@pytest.mark.parametrize(("height", "width", "count"), [(2, 2, 2), (2, 4, 6), (3, 4, 6), (4, 4, 42)])
def test_every_legal_repeating_mask_is_pinched_exactly(rng, height, width, count):
    masks = legal_ones(all_masks(height, width), None)
    assert len(masks) == count
    for mask in masks:
        assert is_legal(mask, REPEAT)
        assert is_exact(mask, REPEAT, 0.5, rng), mask
        assert is_exact(mask, REPEAT, 0.25, rng), mask


@pytest.mark.parametrize("size", [(2, 2), (3, 3), (3, 4)])
def test_every_legal_mask_that_ends_at_a_clamped_border_is_pinched_exactly(rng, size):
    legal = [mask for mask in all_masks(*size) if is_legal(mask, CLAMP)]
    assert len(legal) >= 2
    for mask in legal:
        assert is_exact(mask, CLAMP, 0.5, rng), mask


def test_every_illegal_mask_shows_a_fault(rng):
    seen = 0
    for mask in surrounded(all_masks(3, 3), False):
        broken = np.bitwise_or.reduce(violations(mask), axis=None)
        seen |= broken
        if broken:
            assert faults(mask, CLAMP, 0.5, rng, per_cell=10) != (0, 0), mask
    assert seen == SURROUNDED | DIAGONAL | ADJACENT | CROSS


def test_a_boundary_in_the_last_column_or_top_row_needs_repeat():
    mask = np.zeros((6, 6), bool)
    mask[:, 5] = True
    assert (violations(mask, CLAMP)[:, 5] & BORDER).all()
    assert not violations(mask[:, ::-1], CLAMP).any(where=np.arange(6) > 2)
    assert (violations(mask.T[::-1], CLAMP)[0] & BORDER).all()
    wide = np.zeros((6, 6), bool)
    wide[:, 4:] = True
    assert is_legal(wide, CLAMP)
    assert is_legal(wide, REPEAT)


def test_direction_points_to_minus_and_turns_have_both_components():
    mask = np.zeros((6, 6), bool)
    mask[2:4, 2:4] = True
    d_s, d_t, k = np.moveaxis(channels(mask), -1, 0)
    # texel [r, c] is the lower left corner of cell [r, c]
    assert (d_s[1, 2], d_t[1, 2]) == (-1, 1)  # upper left corner of the square
    assert (d_s[3, 4], d_t[3, 4]) == (1, -1)  # its lower right corner
    assert (d_s[2, 2], d_t[2, 2]) == (-1, 0)  # its left side
    assert (d_s[3, 3], d_t[3, 3]) == (0, -1)  # its lower side
    assert (k == 0).sum() == 8
    assert k[2, 3] == 1
    assert k[0, 0] == -1
    assert channels(np.ones((1, 1), bool)).tolist() == [[[0, 0, 1]]]


@pytest.mark.parametrize("wrap", [CLAMP, REPEAT, ("repeat", "clamp"), ("mirror", "black")])
def test_swapping_the_sides_negates_the_channels_and_keeps_the_rules(rng, wrap):
    mask = rng.random((9, 7)) > 0.5
    assert np.array_equal(channels(~mask, wrap), -channels(mask, wrap))
    assert np.array_equal(violations(~mask, wrap), violations(mask, wrap))


def test_repeating_rules_do_not_depend_on_where_a_period_begins(rng):
    mask = rng.random((8, 11)) > 0.7
    for shift in ((1, 0), (0, 1), (3, 5)):
        moved = violations(np.roll(mask, shift, (0, 1)), REPEAT)
        assert np.array_equal(moved, np.roll(violations(mask, REPEAT), shift, (0, 1)))
