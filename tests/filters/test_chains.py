"""Chains hold the moved image, averaged over exactly the area that each texel covers, whatever its size and wrap."""

import itertools

import numpy as np
import OpenImageIO as oiio
import pytest

from fexel import images
from fexel.errors import FexelWarning
from fexel.filters import chain_build
from fexel.filters.chain import Chain
from fexel.filters.chain_layout import SHORT_BLUR, ChainLayout
from fexel.filters.chain_texels import ChainTexels, cells
from fexel.filters.shears import DIRECTIONS
from fexel.textures.image_source import ImageSource
from fexel.textures.page_format import HALF, SRGB
from fexel.textures.page_texels import decode_page
from fexel.textures.pool import TexturePool
from fexel.textures.pyramid_cache import ImageFacts, PyramidCache

WRAPS = ["repeat", "mirror", "clamp", "black", "patch"]
WHOLE = [number for number, direction in enumerate(DIRECTIONS) if direction.shear % 1 == 0]
ALL = range(len(DIRECTIONS))


def write(path, pixels, **attributes):
    buffer = oiio.ImageBuf(np.ascontiguousarray(pixels))
    for name, value in attributes.items():
        buffer.specmod().attribute(name.replace("__", ":"), value)
    assert buffer.write(str(path))
    return str(path)


def continued(wrap, index, size):
    """Index of the texel that stands at any index, and whether there is one."""
    if wrap == "repeat":
        return index % size, np.ones_like(index, bool)
    if wrap == "mirror":
        folded = index % (2 * size)
        return np.minimum(folded, 2 * size - 1 - folded), np.ones_like(index, bool)
    there = (index >= 0) & (index < size)
    return index.clip(0, size - 1), there | (wrap == "clamp")


def area_weights(size, halvings, start, end):
    """Shares of the texels of an axis in those from `start` to `end` after some halvings, (end - start, from `first`
    on), and `first`. A level's texel is the mean of the level above over what it covers, within the texture or beyond.
    """
    weights, first = np.eye(end - start), start
    for level in range(halvings, 0, -1):
        fine_size, coarse_size = max(1, size >> (level - 1)), max(1, size >> level)
        edges = np.arange(first, first + weights.shape[1] + 1) * fine_size / coarse_size
        first, last = int(np.floor(edges[0])), int(np.ceil(edges[-1]))
        fine = np.arange(first, last)
        low, high = np.maximum(edges[:-1, None], fine), np.minimum(edges[1:, None], fine + 1)
        weights = weights @ (np.maximum(high - low, 0) * coarse_size / fine_size)
    return weights, first


def oracle(image, number, wrap, cell):
    """A cell of a direction of whole texels with its border, summed over a plane that goes on as the wrap modes say."""
    direction = DIRECTIONS[number]
    long, shear = direction.long_axis, direction.shear
    lines = (image if long else image.swapaxes(0, 1)).astype(np.float64)
    layout = ChainLayout.of(number, (image.shape[1], image.shape[0]), wrap)
    count, texels = layout.line_size(cell)
    along, first_line = area_weights(layout.lines, cell[0], -1, count + 1)
    across, first_texel = area_weights(layout.texels, cell[1], 0, texels)
    line = np.arange(first_line, first_line + along.shape[1])[:, None]
    at = np.arange(first_texel - 1, first_texel + across.shape[1] + 1)[None]  # one more each way for the blur
    source, line_there = continued(wrap[long], line, lines.shape[0])
    # A clamped line is its edge line, which moves as that does; a cyclic one moves on and on.
    moving = line.clip(0, layout.lines - 1) if wrap[long] == "clamp" else line
    beyond = at
    if layout.moved_wrap == "clamp":
        beyond = at.clip(0, layout.texels - 1)
    texel, texel_there = continued(
        wrap[1 - long], beyond - layout.padding[0] - (shear * moving).astype(int), lines.shape[1]
    )
    plane = lines[np.broadcast_to(source, texel.shape), texel] * (line_there & texel_there)[..., None]
    if layout.moved_wrap in ("black", "patch"):
        plane[:, (at[0] < 0) | (at[0] >= layout.texels)] = 0
    blurred = (1 - 2 * SHORT_BLUR) * plane[:, 1:-1] + SHORT_BLUR * (plane[:, :-2] + plane[:, 2:])
    result = np.einsum("il,ltc,jt->ijc", along, blurred, across, optimize=True)
    return result if long else result.swapaxes(0, 1)


def edge_oracle(image, number, wrap, cell):
    """What lies beyond the first and last line of a clamped cell: where a footprint crosses the edge line."""
    direction = DIRECTIONS[number]
    lines = (image if direction.long_axis else image.swapaxes(0, 1)).astype(np.float64)
    layout = ChainLayout.of(number, (image.shape[1], image.shape[0]), wrap)
    count, texels = layout.line_size(cell)
    across, first = area_weights(layout.texels, cell[1], 0, texels)
    length = layout.lines / count
    beyond = []
    for line, middle in ((lines[0], -0.5 * length), (lines[-1], layout.lines + 0.5 * length)):
        steps = middle + 2 * length * ((np.arange(400) + 0.5) / 400 - 0.5)  # an access: two texels
        at = first + np.arange(-1, across.shape[1] + 1) - layout.padding[0]
        at = at[None] - direction.shear * (steps[:, None] - 0.5)
        whole = np.floor(at).astype(int)
        values = 0.0
        for step, share in ((0, 1 - (at - whole)), (1, at - whole)):
            source, there = continued(wrap[1 - direction.long_axis], whole + step, len(line))
            values = values + (share * there)[..., None] * line[source]
        plane = values.mean(axis=0)
        if layout.moved_wrap == "clamp":
            plane[[0, -1]] = plane[[1, -2]]
        elif layout.moved_wrap != "repeat":
            plane[[0, -1]] = 0
        blurred = (1 - 2 * SHORT_BLUR) * plane[1:-1] + SHORT_BLUR * (plane[:-2] + plane[2:])
        beyond.append(np.einsum("tc,jt->jc", blurred, across))
    return np.array(beyond)


@pytest.mark.parametrize("number", WHOLE)
@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (8, 16), (19, 12)])
def test_chains_equal_an_independent_integration_for_every_pair_of_wraps(rng, number, size):
    image = rng.random((*size, 4)).astype(np.float32)
    for wrap in itertools.product(WRAPS[:4], repeat=2):
        layout, made = cells(image, number, wrap)
        long = DIRECTIONS[number].long_axis
        for cell, texels in made.items():
            expected = oracle(image, number, wrap, cell)
            lines, expected = (texels.swapaxes(0, 1), expected.swapaxes(0, 1)) if long == 0 else (texels, expected)
            assert np.abs(lines[1:-1, 1:-1] - expected[1:-1]).max() < 2e-5, (wrap, cell)
            if layout.long_wrap == "clamp":
                beyond = edge_oracle(image, number, wrap, cell)
                assert np.abs(lines[[0, -1], 1:-1] - beyond).max() < 1e-3, (wrap, cell)
            elif layout.long_wrap == "black":
                assert not lines[0].any()
                assert not lines[-1].any()
            elif cell[1] == 0 and layout.moved_wrap == "repeat":  # else across the seam by parts of a texel: see below
                assert np.abs(lines[:, 1:-1] - expected).max() < 2e-5, (wrap, cell)
            finest = made[cell[0], 0].swapaxes(0, 1) if long == 0 else made[cell[0], 0]
            ends = {"clamp": finest[:, [1, -2]], "repeat": lines[:, [-2, 1]]}.get(layout.moved_wrap, 0)
            assert (lines[:, [0, -1]] == ends).all()


@pytest.mark.parametrize("number", ALL)
@pytest.mark.parametrize("wrap", list(itertools.product(["repeat", "mirror"], repeat=2)))
@pytest.mark.parametrize("size", [(48, 64), (61, 43)])
def test_chains_and_their_seams_are_where_a_formula_says(number, wrap, size):
    """Waves of both axes, periodic or even as the wrap modes continue them, integrated in float64 over a plane."""
    direction, long = DIRECTIONS[number], DIRECTIONS[number].long_axis

    def wave(axis, at, period):
        phase = np.pi * (2 if wrap[axis] == "repeat" else 1) * at / period
        return np.sin(2 * phase) + np.cos(phase) if wrap[axis] == "repeat" else np.cos(3 * phase) + np.cos(phase)

    def value(x, y):
        return 0.5 + 0.1 * wave(0, x, size[1]) * wave(1, y, size[0]) + 0.1 * wave(1, y, size[0])

    x, y = np.meshgrid(np.arange(size[1]) + 0.5, np.arange(size[0]) + 0.5)
    image = np.repeat(value(x, y)[..., None], 4, axis=2).astype(np.float32)
    layout, made = cells(image, number, wrap)
    for cell, texels in made.items():
        count, line_texels = layout.line_size(cell)
        if line_texels < 10:
            continue  # too few for these waves
        along, first_line = area_weights(layout.lines, cell[0], -1, count + 1)
        across, first_texel = area_weights(layout.texels, cell[1], -1, line_texels + 1)
        line = first_line + np.arange(along.shape[1])[:, None] + 0.5
        moved = first_texel + np.arange(-1, across.shape[1] + 1) + 0.5 - direction.shear * (line - 0.5)
        line = np.broadcast_to(line, moved.shape)
        plane = value(moved, line) if long else value(line, moved)
        blurred = (1 - 2 * SHORT_BLUR) * plane[:, 1:-1] + SHORT_BLUR * (plane[:, :-2] + plane[:, 2:])
        expected = along @ blurred @ across.T
        lines = texels[..., 0] if long else texels[..., 0].T
        assert np.abs(lines - expected).max() < (0.003 if size == (48, 64) else 0.008), cell


@pytest.mark.parametrize("number", ALL)
def test_a_zone_plate_keeps_the_energy_that_its_integral_has(number):
    """All frequencies and directions up to 0.43 cycles per texel: variance by level against float64 integration."""
    size, direction = 192, DIRECTIONS[number]

    def value(x, y):
        along, across = (np.abs(v % size - size / 2) for v in (x, y))  # even, so that it goes on at its borders
        fade = np.clip((0.5 - np.hypot(along, across) / size) / 0.1, 0, 1)
        return 0.5 + 0.5 * fade * np.cos(np.pi * 0.86 * (along**2 + across**2) / size)

    x, y = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    image = np.repeat(value(x, y)[..., None], 4, axis=2).astype(np.float32)
    layout, made = cells(image, number, ("repeat", "repeat"))
    line = np.arange(size)[:, None] + 0.5
    at = np.arange(-1, size + 1)[None] + 0.5 - direction.shear * (line - 0.5)
    line = np.broadcast_to(line, at.shape)
    plane = value(at, line) if direction.long_axis else value(line, at)
    moved = (1 - 2 * SHORT_BLUR) * plane[:, 1:-1] + SHORT_BLUR * (plane[:, :-2] + plane[:, 2:])
    for cell in layout.cells[:12]:
        count, texels = layout.line_size(cell)
        along, across = area_weights(size, cell[0], 0, count)[0], area_weights(size, cell[1], 0, texels)[0]
        expected = along @ moved @ across.T
        inner = made[cell][1:-1, 1:-1, 0]
        inner = inner if direction.long_axis else inner.T
        assert inner.mean() == pytest.approx(expected.mean(), abs=1e-5)
        assert inner.var() == pytest.approx(expected.var(), rel=0.02, abs=1e-7), cell
        assert np.abs(inner - expected).max() < 0.05


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (19, 33)])
@pytest.mark.parametrize("number", ALL)
def test_cells_are_of_the_size_that_a_chain_tells(size, number):
    for wrap in (("repeat", "clamp"), ("mirror", "black"), ("clamp", "repeat")):
        layout = ChainLayout.of(number, (size[1], size[0]), wrap)
        for octaves in range(layout.octaves, 12):
            width, height = Chain(ImageSource(""), number, octaves).size(*layout.extent, layout.wrap)
            for level in range(max(width, height).bit_length()):
                assert layout.cell_size(layout.cell(octaves, level)) == (
                    max(1, width >> level),
                    max(1, height >> level),
                )


def test_all_directions_take_twelve_times_the_texture_less_its_mip_levels():
    total = sum(ChainLayout.of(number, (4096, 4096), ("repeat", "repeat")).total for number in ALL)
    assert total / 4096**2 == pytest.approx(12 - 4 / 3, rel=0.02)  # 2 % for borders of one texel


@pytest.mark.parametrize("texels", [2**10, 2**13])
def test_blocks_of_any_size_give_the_same_chains(rng, monkeypatch, texels):
    image = rng.random((150, 203, 4)).astype(np.float32)
    for number in (1, 6, 11):
        _, whole = cells(image, number, ("repeat", "clamp"))
        monkeypatch.setattr(chain_build, "_BLOCK_TEXELS", texels)
        _, blocks = cells(image, number, ("repeat", "clamp"))
        monkeypatch.undo()
        assert all(np.abs(whole[cell] - blocks[cell]).max() < 2e-6 for cell in whole)


def every_level(reader, chain, path="/Texture"):
    facts = reader.facts(chain, path)
    for level in range(facts.last_level + 1):
        width, height = (max(1, size >> level) for size in facts.size)
        yield level, (width, height), reader.window(chain, path, level, (0, 0, width, height))


@pytest.mark.parametrize("size", [(1, 1), (1, 21), (21, 1), (30, 47)])
@pytest.mark.parametrize("value", [1, 128, 255])
def test_eight_bit_constants_stay_what_they_are_to_the_bit(tmp_path, size, value):
    file = write(tmp_path / "grey.png", np.full((*size, 3), value, np.uint8))
    for number in ALL:
        for wrap in (("repeat", "mirror"), ("clamp", "repeat")):
            chain = Chain(ImageSource(file, wrap=wrap), number, DIRECTIONS[number].octaves)
            for _, _, texels in every_level(ChainTexels(), chain):
                assert texels.dtype == np.uint8
                assert (texels == [value, value, value, 255]).all()


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
@pytest.mark.parametrize("wrap", [("repeat", "clamp"), ("mirror", "black"), ("patch", "patch")])
def test_a_reader_gives_what_the_chains_of_its_image_are_and_windows_of_them(tmp_path, rng, dtype, wrap):
    pixels = rng.integers(0, np.iinfo(dtype).max, (45, 31, 4), dtype, endpoint=True)
    source = ImageSource(write(tmp_path / "odd.png", pixels, oiio__UnassociatedAlpha=1), wrap=wrap)
    base = PyramidCache()
    shown = decode_page(base.window(source, "/T", 0, (0, 0, 31, 45))[1:-1, 1:-1], base.facts(source, "/T").page_class)
    reader = ChainTexels(base=base)
    for number in (0, 2, 3, 7, 12):
        layout, made = cells(shown, number, wrap)
        chain = Chain(source, number, 3)
        facts = reader.facts(chain, "/T")
        assert facts.page_class == (SRGB if dtype == "uint8" else HALF)
        assert facts.wrap == layout.wrap
        for level, (width, height), texels in every_level(reader, chain):
            expected = made[layout.cell(3, level)]
            assert texels.shape == (height + 2, width + 2, 4)
            inside = expected.clip(0, 1) if facts.page_class == SRGB else expected
            assert np.abs(decode_page(texels, facts.page_class) - inside).max() < 0.006
            box = width // 3, height // 4, width // 3 + max(1, width // 2), height
            part = reader.window(chain, "/T", level, (*box[:2], min(box[2], width), box[3]))
            assert np.array_equal(part, texels[box[1] : box[3] + 2, box[0] : min(box[2], width) + 2])


def test_colours_of_transparent_texels_do_not_bleed_into_chains(tmp_path, rng):
    pixels = rng.integers(0, 255, (64, 64, 4), np.uint8, endpoint=True)
    pixels[..., 3] = np.where(rng.random((64, 64)) < 0.5, 0, 255)
    other = pixels.copy()
    other[pixels[..., 3] == 0, :3] = rng.integers(0, 255, (int((pixels[..., 3] == 0).sum()), 3))
    readers = [ChainTexels(), ChainTexels()]
    files = [write(tmp_path / f"{n}.png", p, oiio__UnassociatedAlpha=1) for n, p in enumerate((pixels, other))]
    for number in (0, 4, 6, 9):
        chains = [Chain(ImageSource(file, wrap=("repeat", "repeat")), number, 3) for file in files]
        for (_, _, one), (_, _, two) in zip(
            *(every_level(reader, chain) for reader, chain in zip(readers, chains, strict=True)), strict=True
        ):
            assert np.array_equal(one, two)
            if DIRECTIONS[number].shear % 1 == 0:  # no resampling, so no overshoot: colour is below its alpha
                linear = decode_page(one, SRGB)
                assert (linear[..., :3] <= linear[..., 3:] + 0.005).all()


def test_a_missing_file_makes_chains_of_its_fallback_and_warns_once(tmp_path):
    source = ImageSource(str(tmp_path / "missing.png"), wrap=("repeat", "repeat"), fallback=(0.25, 0.5, 1.0, 1.0))
    reader = ChainTexels()
    with pytest.warns(FexelWarning, match=r"missing\.png") as warned:
        texels = [each for n in ALL for _, _, each in every_level(reader, Chain(source, n, 3))]
    assert len(warned) == 1
    assert all((each == np.array([0.25, 0.5, 1, 1], np.float16)).all() for each in texels)


def test_a_mask_is_the_alpha_of_chains(tmp_path, rng):
    file = write(tmp_path / "red.png", np.broadcast_to(np.array([255, 0, 0], np.uint8), (32, 32, 3)))
    mask = rng.integers(0, 255, (32, 32, 1), np.uint8)
    source = ImageSource(file, write(tmp_path / "mask.png", mask), wrap=("repeat", "repeat"))
    for number in (3, 7):
        *_, (_, _, last) = every_level(ChainTexels(), Chain(source, number, 5))
        assert last[1, 1, 3] == pytest.approx(mask.mean(), abs=1)
        assert images.srgb_to_linear(last[1, 1, 0] / np.float32(255)) == pytest.approx(mask.mean() / 255, abs=0.005)


class _Stripes:
    """A reader of something that is no image file."""

    def facts(self, _source, _path):
        return ImageFacts((16, 8), HALF, ("repeat", "repeat"), None)

    def window(self, _source, _path, _level, box):
        x = np.arange(box[0] - 1, box[2] + 1) % 2
        return np.broadcast_to(x[None, :, None], (box[3] - box[1] + 2, len(x), 4)).astype(np.float16)


def test_chains_of_what_another_reader_reads():
    chain = Chain("stripes", 0, 1, reader=_Stripes())
    for _, _, texels in every_level(ChainTexels(), chain):
        assert (texels == 0.5).all()


def test_a_budget_that_does_not_hold_a_chain_drops_its_finest_levels(gl, tmp_path, rng):
    source = ImageSource(
        write(tmp_path / "noise.png", rng.integers(0, 255, (512, 512, 3), np.uint8)), wrap=("repeat", "clamp")
    )
    pool = TexturePool(gl, 0.2, 16)
    pool.begin()
    chains = [Chain(source, number, octaves) for number in (4, 7) for octaves in (2, 3)]
    for chain in chains:
        image = pool.image(chain, "/Texture", pool.reader(ChainTexels, PyramidCache()))
        last = pool.facts(image).last_level
        pool.ask(np.array([image]), (np.array([0]), np.array([last])), (np.zeros((1, 2)), np.ones((1, 2))))
    with pytest.warns(FexelWarning, match="too small"):
        pool.load()
    assert (pool.finest > 0).any()
    assert sum(atlas.nbytes for atlas in pool.atlases) <= 0.2 * 2**20
    for number, chain in enumerate(chains):
        facts = pool.facts(number)
        for level in range(pool.finest[number], facts.last_level + 1):
            assert (chain, level) in pool.atlases[facts.page_class].residents
    pool.release()


def test_a_file_is_read_once_whatever_is_looked_at_first(tmp_path, rng, monkeypatch):
    source = ImageSource(
        write(tmp_path / "noise.png", rng.integers(0, 255, (64, 64, 3), np.uint8)), wrap=("repeat", "repeat")
    )
    reads = []
    read_strips = images.read_strips
    monkeypatch.setattr(images, "read_strips", lambda info, rows: reads.append(info.path) or read_strips(info, rows))
    base = PyramidCache()
    reader = ChainTexels(base=base)
    reader.facts(Chain(source, 4, 2), "/Texture")
    base.window(source, "/Texture", 3, (0, 0, 8, 8))
    list(every_level(reader, Chain(source, 4, 2)))
    assert len(reads) == 1
