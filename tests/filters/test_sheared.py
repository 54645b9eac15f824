"""Lines of texels moved along a shear: nothing is lost but what must be, and stripes of its tangent stand upright."""

import numpy as np
import pytest

from fexel.filters import chain_build
from fexel.filters.chain_layout import SHORT_BLUR, ChainLayout
from fexel.filters.chain_texels import cells
from fexel.filters.sheared import moved_lines
from fexel.filters.shears import DIRECTIONS

SHEARED = [number for number, direction in enumerate(DIRECTIONS) if direction.shear]
FRACTIONAL = [number for number in SHEARED if DIRECTIONS[number].shear % 1]
WRAPS = ["repeat", "mirror", "clamp", "black", "patch"]


def moved(image, number, wrap):
    """The whole image moved, lines first."""
    layout = ChainLayout.of(number, (image.shape[1], image.shape[0]), (wrap, wrap))
    lines = image if DIRECTIONS[number].long_axis else image.swapaxes(0, 1)
    return moved_lines(np.ascontiguousarray(lines), 0, layout)


def number_of(long_axis, shear):
    return next(n for n, d in enumerate(DIRECTIONS) if (d.long_axis, d.shear) == (long_axis, shear))


@pytest.mark.parametrize("number", FRACTIONAL)
@pytest.mark.parametrize("wrap", ["repeat", "clamp"])
def test_every_line_keeps_95_percent_of_the_variance_of_white_noise(rng, number, wrap):
    noise = rng.random((256, 256, 4)).astype(np.float32)
    lines = moved(noise, number, wrap)
    before = noise.var()
    for phase in range(4):  # lines that move by the same part of a texel: worst a half, where linear keeps one half
        part = lines[phase::4]
        inner = (
            part
            if wrap == "repeat"
            else np.stack([line[start : start + 254] for line, start in zip(part, _starts(number, phase), strict=True)])
        )
        assert 0.95 * before <= inner.var() <= 1.03 * before


def _starts(number, phase):
    layout = ChainLayout.of(number, (256, 256), ("clamp", "clamp"))
    shifts = layout.padding[0] + layout.direction.shear * np.arange(phase, 256, 4)
    return np.ceil(shifts).astype(int) + 1


@pytest.mark.parametrize("number", SHEARED)
def test_waves_arrive_where_the_shear_puts_them(number):
    """Plane waves along a line up to 0.4 cycles per texel against their own formula, in float64."""
    size, shear = 80, DIRECTIONS[number].shear
    texel, line = np.arange(size) + 0.5, np.arange(size)[:, None]
    for cycles in (1, 9, 32):
        wave = np.cos(2 * np.pi * cycles / size * texel)
        image = np.broadcast_to(wave[None, :, None], (size, size, 4)).astype(np.float32)
        lines = moved(image if DIRECTIONS[number].long_axis else image.swapaxes(0, 1), number, "repeat")
        expected = np.cos(2 * np.pi * cycles / size * (texel - shear * line))
        assert np.abs(lines[..., 0] - expected).max() < 0.02


@pytest.mark.parametrize("number", [n for n in SHEARED if DIRECTIONS[n].shear % 1 == 0])
def test_whole_tangents_lose_nothing(rng, number):
    image = rng.random((37, 23, 4)).astype(np.float32)
    lines = moved(image, number, "repeat")
    for line, moved_line in enumerate(lines):
        assert np.array_equal(np.roll(moved_line, -round(DIRECTIONS[number].shear) * line, axis=0), image[line])


@pytest.mark.parametrize("tangent", [0.5, 1.0, 2.0, -0.5, -1.0, -2.0])
def test_stripes_of_a_tangent_stand_upright_in_the_chain_of_its_direction(tangent):
    """The paper's six tangents: stripes along (1, tangent) keep their contrast however coarse the long axis is."""
    size = 128
    y, x = np.mgrid[0:size, 0:size] + 0.5
    image = np.ones((size, size, 4), np.float32)
    steep = abs(tangent) >= 1  # tangents beyond 1 are those of the other axis
    across = x - y / tangent if steep else y - x * tangent
    image[..., :3] = (0.5 + 0.4 * np.cos(2 * np.pi * across / 8))[..., None]
    number = number_of(1, -1 / tangent) if steep else number_of(0, -tangent)
    layout, made = cells(image, number, ("repeat", "repeat"))
    for octaves in range(2, 8):
        texels = made[layout.cell(octaves, 0)][1:-1, 1:-1, 0]
        contrast = texels.max() - texels.min()
        assert contrast > 0.8 * 0.8 * (1 - 4 * SHORT_BLUR * np.sin(np.pi / 8) ** 2)
    opposite = number_of(1, 1 / tangent) if steep else number_of(0, tangent)
    layout, made = cells(image, opposite, ("repeat", "repeat"))
    assert np.ptp(made[layout.cell(4, 0)][1:-1, 1:-1, 0]) < 0.05  # the wrong direction greys them


@pytest.mark.parametrize("number", range(len(DIRECTIONS)))
@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (2, 3), (33, 21)])
def test_a_constant_stays_constant_under_every_shear_and_wrap(number, size):
    for s in WRAPS[:3]:
        for t in WRAPS[:3]:
            _, made = cells(np.full((*size, 4), 0.3, np.float32), number, (s, t))
            assert all(np.abs(texels - 0.3).max() < 1e-6 for texels in made.values())


@pytest.mark.parametrize("number", FRACTIONAL)
@pytest.mark.parametrize("wrap", ["repeat", "clamp", "black"])
def test_a_light_of_a_wide_range_keeps_its_energy_and_casts_no_dark_rings(number, wrap):
    image = np.full((64, 64, 4), 0.5, np.float32)
    image[32, 32] = 60000
    layout, made = cells(image, number, (wrap, wrap))
    texels = made[layout.octaves, 0][1:-1, 1:-1, 0]
    assert texels.min() >= (0.4 if wrap != "black" else -1e-6)
    background = 0.5 * layout.lines * (layout.line_texels if wrap == "black" else layout.texels)
    assert texels.sum(dtype=np.float64) * 2**layout.octaves - background == pytest.approx(60000, rel=0.01)
    lines = texels.T if DIRECTIONS[number].long_axis == 0 else texels
    assert (np.count_nonzero(lines > 2, axis=1) <= 7).all()  # two by the interpolation, two by the blur, four lines


@pytest.mark.parametrize("number", SHEARED)
@pytest.mark.parametrize("wrap", ["black", "patch"])
def test_beyond_a_patch_there_is_nothing_and_within_it_no_ringing(number, wrap):
    lines = moved(np.ones((24, 40, 4), np.float32), number, wrap)
    shear, texels = DIRECTIONS[number].shear, lines.shape[1]
    layout = ChainLayout.of(number, (40, 24), (wrap, wrap))
    for line, values in enumerate(lines[..., 3]):
        start = layout.padding[0] + shear * line
        edges = np.clip(np.arange(texels + 1), start, start + layout.line_texels)
        assert np.abs(values - np.diff(edges)).max() < 1e-6  # each texel by the share of it that the line covers


@pytest.mark.parametrize("number", SHEARED)
@pytest.mark.parametrize("size", [(16, 32), (64, 24)])
def test_moving_whole_groups_equals_moving_lines_and_halving(rng, monkeypatch, number, size):
    image = rng.random((*size, 4)).astype(np.float32)
    for s in WRAPS:
        for t in WRAPS:
            _, grouped = cells(image, number, (s, t))
            with monkeypatch.context() as patch:
                patch.setattr(chain_build, "can_group", lambda _layout: False)
                _, one_by_one = cells(image, number, (s, t))
            assert all(np.abs(grouped[cell] - one_by_one[cell]).max() < 2e-6 for cell in grouped)
