"""Legal masks: exactly the undesired fexels are pinched away, whatever gamma is; every rule is needed."""

import numpy as np
import pytest

from fexel.textures.pinchmap_twin import pinch
from fexel_tools.pinchmap_mask import channels, is_legal

CLAMP, REPEAT = ("clamp", "clamp"), ("repeat", "repeat")
PER_TEXEL = 24  # samples along a cell, so that the narrowest strip, 0.05 of a cell, is met


def all_masks(height, width):
    numbers = np.arange(2 ** (height * width))
    return (numbers[:, None] >> np.arange(height * width) & 1).astype(bool).reshape(-1, height, width)


def pinchmap_of(mask, wrap, rng, reach=0.95):
    """A pinchmap of strength 1 with random lines."""
    return np.dstack([channels(mask, wrap), rng.uniform(-reach, reach, mask.shape)])


def sheet_of(masks, margin, outside):
    """Masks side by side in one, each with a margin of cells of side `outside`."""
    count, height, width = masks.shape
    across = int(np.ceil(np.sqrt(count)))
    tiles = np.full((across * across, height + 2 * margin, width + 2 * margin), outside)
    tiles[:count, margin : margin + height, margin : margin + width] = masks
    rows, columns = tiles.shape[1:]
    return tiles.reshape(across, across, rows, columns).swapaxes(1, 2).reshape(across * rows, across * columns)


def sample_places(shape, per_texel=PER_TEXEL):
    """Places in every cell of a map, (M, 2) in st: a lattice that misses the cells' borders."""
    height, width = shape
    s = (np.arange(width * per_texel) + 0.5) / (width * per_texel)
    t = (np.arange(height * per_texel) + 0.5) / (height * per_texel)
    return np.stack(np.meshgrid(s, t), -1).reshape(-1, 2)


def shown_faults(mask, wrap, h, rng, reach=0.95):
    """Share of places that show an undesired fexel, and visible quarters of fexels near a line that none shows.

    Signal fexels are the squares between signal texels; those around an active pinchmap texel are undesired.
    """
    size = np.array(mask.shape[::-1])
    pinchmap = pinchmap_of(mask, wrap, rng, reach)
    st = sample_places(mask.shape)
    shown = pinch(pinchmap, st, h, wrap=wrap).st * size
    corner = np.rint(shown)
    column, row = corner[:, 0].astype(int), mask.shape[0] - 1 - corner[:, 1].astype(int)
    inside = np.max(np.abs(shown - corner), 1) < h - 1e-9
    if wrap == REPEAT:
        column, row = column % size[0], row % size[1]
    exists = (column >= 0) & (column < size[0]) & (row >= 0) & (row < size[1])
    active = pinchmap[..., 2] == 0
    seen_wrong = inside & exists & active[np.clip(row, 0, size[1] - 1), np.clip(column, 0, size[0] - 1)]
    return seen_wrong.mean(), unseen_quarters(shown, st * size, pinchmap, h, wrap)


def unseen_quarters(shown, places, pinchmap, h, wrap):
    """Quarters of cells, less the undesired fexels, that no place shows although the mask has them visible."""
    size = np.array(pinchmap.shape[1::-1])
    quarter = np.floor(shown * 2 + 1e-12).astype(int)
    if wrap == REPEAT:
        quarter %= 2 * size
    else:
        quarter = np.clip(quarter, 0, 2 * size - 1)
    seen = np.zeros(2 * size[::-1], bool)
    if h < 0.5:
        # of a cell whose corner is active something is left: the L between undesired fexel and cell centre
        seen[quarter[:, 1], quarter[:, 0]] = True
        return int((~seen).sum())
    active = np.zeros((size[1] + 1, size[0] + 1), bool)
    active[:-1, :-1] = (pinchmap[..., 2] == 0)[::-1]
    if wrap == REPEAT:
        active[-1], active[:, -1] = active[0], active[:, 0]
    else:
        active[-1], active[:, -1] = active[-2], active[:, -2]
    seen[quarter[:, 1], quarter[:, 0]] = True
    corners = np.repeat(np.repeat(active, 2, 0), 2, 1)[1:-1, 1:-1]
    return int((~seen & ~corners).sum())


@pytest.mark.parametrize("h", [0.5, 0.25, 0.125])
@pytest.mark.parametrize("outside", [False, True])
@pytest.mark.parametrize(("height", "width"), [(2, 2), (2, 3), (3, 2), (3, 3)])
def test_every_legal_interior_mask_is_pinched_exactly(rng, height, width, outside, h):
    masks = np.array([m for m in all_masks(height, width) if is_legal(np.pad(m, 2, constant_values=outside))])
    assert len(masks)
    sheet = sheet_of(masks, 2, outside)
    assert is_legal(sheet, CLAMP)
    wrong, unseen = shown_faults(sheet, CLAMP, h, rng)
    assert wrong == 0
    assert unseen == 0
