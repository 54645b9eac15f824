"""Level images fitted to their lookup, and merged umbrellas: laws, and errors against supersampled pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fexel import mipmaps
from fexel.errors import FexelError
from fexel.images import image_info
from fexel.textures.image_source import ImageSource
from fexel.textures.pinchmap_lattice import trilinear
from fexel.textures.pyramid_cache import PyramidCache
from fexel.textures.umbrella import LEVEL_IMAGE_BIAS, UmbrellaData, UmbrellaLevelData
from fexel.textures.umbrella_arrangement import Arrangement, Shape
from fexel.textures.umbrella_twin import UmbrellaTwin
from fexel_tools.umbrella_levels import fitted_levels, image_level, write_level_image
from fexel_tools.umbrella_merge import merged_levels
from fexel_tools.umbrella_merge_shapes import group, hull, signed_area_of, simplify
from fexel_tools.umbrella_raster import rasterize

GRID = (16, 8)
SOIL = (0.1, 0.07, 0.05)


def leaves(rng, grid=GRID, per_cell=4.0, size=(1.2, 1.9), shadow=True):
    """Plain stars, each of a colour of its own, with another colour in the middle."""
    contour = 12
    angle = np.arange(contour) * 2 * np.pi / contour
    radius = np.where(np.arange(contour) % 2, 0.5, 0.33)
    points = np.concatenate([[[0.0, 0.0]], np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)])
    count = round(per_cell * grid[0] * grid[1])
    turn, length = rng.uniform(0, 2 * np.pi, count), rng.uniform(*size, count)
    matrices = np.tile(np.eye(3), (count, 1, 1))
    matrices[:, 0, 0], matrices[:, 0, 1] = length * np.cos(turn) / grid[0], length * np.sin(turn) / grid[1]
    matrices[:, 1, 0], matrices[:, 1, 1] = -length * np.sin(turn) / grid[0], length * np.cos(turn) / grid[1]
    matrices[:, 2, :2] = rng.random((count, 2))
    colors = rng.uniform(0.02, 0.7, (count, 1, 3)) * rng.uniform(0.6, 1.0, (count, contour + 1, 1))
    return Arrangement(
        (Shape(points, points, points + 0.5),),
        np.zeros(count, np.int32),
        matrices,
        np.zeros(count),
        colors.reshape(-1, 3).astype(np.float32),
        grid,
        1.0,
        (0.1 / grid[0], -0.1 / grid[1]),
        0.4 if shadow else 0.0,
    )


def turned(pixels_per_cell, size, grid=GRID, degrees=20.0):
    """A view of the ground, st per pixel."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    linear = np.array([[c, s], [s, -c]]) / pixels_per_cell / np.array(grid)
    return np.concatenate([linear, [np.array([0.4, 0.6]) - np.array(size) / 2 @ linear]])


def looked_up(levels, view, size, bias):
    """(H, W, 4): one trilinear lookup per pixel of levels that repeat."""
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    st = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1) @ view
    lod = np.log2(np.hypot(*(view[0] * levels[0].shape[1::-1]))) - bias
    return trilinear(levels, st, np.full(len(st), lod), ("repeat", "repeat")).reshape(*size[::-1], -1)


def encoded_rms(picture, truth):
    """In encoded values, about as eyes weigh them."""
    a, b = (np.sqrt(np.clip(p[..., :3], 0, 1)) for p in (picture, truth))
    return float(np.sqrt(np.mean((a - b) ** 2)))


def test_fitted_levels_are_far_nearer_to_the_truth_than_averaged_ones(rng):
    arrangement = leaves(rng)
    image = image_level(arrangement, [None], SOIL)
    averages = mipmaps.pyramid(rasterize(arrangement, [None], SOIL, (GRID[0] * 8, GRID[1] * 8), supersample=8))
    for pixels, share in ((4, 0.35), (3, 0.45), (2, 0.35), (1, 0.35)):
        view = turned(pixels, (64, 64))
        truth = rasterize(arrangement, [None], SOIL, (64, 64), view=view, supersample=16)
        fitted = encoded_rms(looked_up(image.levels, view, (64, 64), LEVEL_IMAGE_BIAS), truth)
        usual = encoded_rms(looked_up(averages, view, (64, 64), 0), truth)
        assert fitted < share * usual, pixels


def test_twin_reads_a_level_image_as_it_is_fitted(rng, tmp_path):
    arrangement = leaves(rng)
    image = image_level(arrangement, [None], SOIL)
    write_level_image(tmp_path / "level.tif", image)
    source = ImageSource(str(tmp_path / "level.tif"), color_space="sRGB", wrap=("repeat", "repeat"))
    level = UmbrellaLevelData(image.level, "/Ground/Level", image=source)
    ground = UmbrellaData(ImageSource("", fallback=(*SOIL, 1.0)), arrangement, (level,))
    twin = UmbrellaTwin(ground, "/Ground")
    for pixels in (4, 2, 1):
        view = turned(pixels, (48, 48))
        x, y = np.meshgrid(np.arange(48) + 0.5, np.arange(48) + 0.5)
        st = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1) @ view
        seen = twin.sample(st, view[:2].T).reshape(48, 48, 4)
        expected = looked_up(image.levels, view, (48, 48), LEVEL_IMAGE_BIAS)
        assert np.abs(seen - expected).max() < 0.01  # 8 bits
        truth = rasterize(arrangement, [None], SOIL, (48, 48), view=view, supersample=16)
        assert encoded_rms(seen, truth) < 0.03


def test_a_wave_keeps_the_strength_that_pixels_leave_of_it():
    """What interpolation adds are harmonics, which no texels can avoid."""
    width, cycles = 64, 8
    x = (np.arange(2 * width) + 0.5) / (2 * width)
    own = np.sinc(cycles / (2 * width))  # texels of the picture are averages
    wave = (0.5 + 0.3 * own * np.cos(2 * np.pi * cycles * x))[None, :, None] * np.ones((4, 1, 4))
    level = fitted_levels(wave, False)[0][0, :, 0]
    at = np.linspace(0, 1, 6400, endpoint=False)
    place = at * width - 0.5
    low = np.floor(place).astype(int)
    found = level[low % width] * (1 - (place - low)) + level[(low + 1) % width] * (place - low)
    turns = [(k + 0.5) * np.pi / 16 for k in range(8)]
    box = np.mean([np.sinc(2 * cycles / width * np.cos(a)) * np.sinc(2 * cycles / width * np.sin(a)) for a in turns])
    strength = 2 * np.mean(found * np.cos(2 * np.pi * cycles * at))
    assert box < 0.93 and strength == pytest.approx(0.3 * box, rel=2e-3)


def test_levels_of_a_constant_are_constant():
    for levels in (fitted_levels(np.full((6, 14, 4), 0.25)), fitted_levels(np.full((10, 2, 4), 0.25), False)):
        assert all(np.allclose(level[..., :3], 0.25, atol=1e-6) for level in levels)


@pytest.mark.parametrize("shape", [(2, 2), (2, 6), (10, 14), (48, 22)])
def test_levels_keep_the_mean_and_the_range(rng, shape):
    picture = rng.uniform(0.3, 0.4, (*shape, 4)).astype(np.float32)
    levels = fitted_levels(picture)
    assert [level.shape[:2] for level in levels] == [
        (mipmaps.level_size(shape[0] // 2, number), mipmaps.level_size(shape[1] // 2, number))
        for number in range(mipmaps.level_count(shape[1] // 2, shape[0] // 2))
    ]
    for level in levels:
        assert level.min() >= picture.min() and level.max() <= picture.max()
        assert np.abs(level.mean(axis=(0, 1)) - picture.mean(axis=(0, 1))).max() < 0.01
    assert np.allclose(levels[-1][0, 0], picture.mean(axis=(0, 1)), atol=1e-5)


@pytest.mark.parametrize("grid", [(1, 1), (3, 2), (5, 7)])
def test_any_grid_has_a_level(rng, grid):
    image = image_level(leaves(rng, grid, size=(0.5, 0.9)), [None], None)
    assert image.levels[0].shape == (8 * grid[1], 8 * grid[0], 4) and image.levels[-1].shape == (1, 1, 4)
    assert image.has_alpha and image.levels[0][..., 3].min() >= 0 and image.levels[0][..., 3].max() <= 1


@pytest.mark.parametrize(("texels", "level"), [(16, 1), (8, 1), (4, 2), (1, 4)])
def test_level_begins_where_texels_are_half_a_pixel(rng, texels, level):
    """At 8 / 2^level pixels a cell."""
    assert image_level(leaves(rng, (4, 2)), [None], SOIL, texels).level == level


def test_level_of_the_papers_grid_takes_half_a_megabyte(rng):
    image = image_level(leaves(rng, (64, 24), per_cell=0.01), [None], SOIL)
    assert image.bytes <= 0.55e6 and not image.has_alpha


@pytest.mark.parametrize("grid", [(64, 24), (400, 300), (1000, 1000)])
def test_samples_of_a_cell_do_not_grow_with_the_grid_nor_with_the_texels_of_images(monkeypatch, grid):
    taken = []

    def drawn(_arrangement, _textures, _background, size, *, supersample, **_options):
        taken.append(size[0] * size[1] * supersample**2 / (grid[0] * grid[1]))
        return np.ones((4, 4, 4), np.float32)

    monkeypatch.setattr("fexel_tools.umbrella_levels.rasterize", drawn)
    ground = replace(leaves(np.random.default_rng(1), (2, 2)), grid=grid)
    image_level(ground, [np.ones((2048, 2048, 4), np.float32)], SOIL)
    assert 32**2 <= taken[0] <= 64**2


def test_level_of_a_large_grid_is_near_to_many_samples(rng):
    """With a texel a cell, as beyond 1000 x 1000 cells."""
    ground = leaves(rng)
    texture = rng.uniform(0.6, 1.0, (64, 64, 4)).astype(np.float32)
    texture[..., 3] = 1.0
    level = image_level(ground, [texture], (*SOIL, 1.0), texels_per_cell=1)
    truth = fitted_levels(rasterize(ground, [texture], (*SOIL, 1.0), (2 * GRID[0], 2 * GRID[1]), supersample=32))
    assert np.sqrt(np.mean((level.levels[0] - truth[0]) ** 2)) < 0.004


def test_file_has_the_fitted_levels(rng, tmp_path):
    image = image_level(leaves(rng, shadow=False), [None], None)
    write_level_image(tmp_path / "level.tif", image)
    info = image_info(str(tmp_path / "level.tif"))
    assert (info.width, info.height) == (128, 64) and info.channels == 4 and len(info.level_sizes) == 8
    source = ImageSource(str(tmp_path / "level.tif"), wrap=("repeat", "repeat"))
    texels = PyramidCache().window(source, "/Level", 1, (0, 0, 64, 32))[1:-1, 1:-1]
    assert np.abs(texels[..., 3] / 255 - image.levels[1][..., 3]).max() <= 1 / 255


def test_level_is_written_whole_or_not_at_all(rng, tmp_path):
    image = image_level(leaves(rng, (4, 2)), [None], SOIL)
    with pytest.raises(FexelError, match=r"level\.tif"):
        write_level_image(tmp_path / "none" / "level.tif", image)
    write_level_image(tmp_path / "level.exr", image, bits="half")
    assert [path.name for path in tmp_path.iterdir()] == ["level.exr"]


def test_hull_is_convex_and_of_few_vertices(rng):
    points = rng.normal(size=(200, 2)) + 100
    contour = hull(points, 7)
    edges = np.roll(contour, -1, axis=0) - contour
    following = np.roll(edges, -1, axis=0)
    assert len(contour) == 7 and signed_area_of(contour) > 0
    assert (edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0] > 0).all()
    assert signed_area_of(contour) < signed_area_of(hull(points, 1000))
    assert len(hull(np.array([[0.0, 0], [1, 1], [2, 2]]), 5)) == 0 and len(hull(points[:2], 5)) == 0


def test_vertices_nearest_to_180_degrees_go_first():
    contour = np.array([[0, 0], [1, -0.01], [2, 0], [2, 2], [1.9, 2.05], [0, 2]])
    assert simplify(contour, 5).tolist() == contour[[0, 2, 3, 4, 5]].tolist()
    assert simplify(contour, 4).tolist() == contour[[0, 2, 3, 5]].tolist()


def test_groups_are_those_that_lie_apart(rng):
    centers = np.array([[0.0, 0], [5, 0], [0, 5]])
    which = rng.integers(0, 3, 60)
    groups = group(centers[which] + rng.normal(0, 0.2, (60, 2)), np.ones(60), 3)
    assert all(len(np.unique(groups[which == n])) == 1 for n in range(3)) and len(np.unique(groups)) == 3
    assert set(group(rng.random((20, 2)), np.ones(20), 1)) == {0}
    assert group(rng.random((4, 2)), np.ones(4), 9).tolist() == [0, 1, 2, 3]
    assert len(np.unique(group(np.zeros((8, 2)), np.ones(8), 3))) == 1  # all in one place


@pytest.mark.parametrize("method", ["fitted", "paper"])
@pytest.mark.parametrize("grid", [(8, 4), (5, 3), (1, 6)])
def test_levels_go_down_to_one_cell(rng, method, grid):
    levels = merged_levels(leaves(rng, grid), [None], SOIL, method=method, k=3)
    assert [level.grid for level in levels] == [
        (-(-grid[0] // 2**n), -(-grid[1] // 2**n)) for n in range(1, len(levels) + 1)
    ]
    assert levels[-1].grid == (1, 1)
    for level in levels:
        assert 0 < len(level) <= 3 * level.grid[0] * level.grid[1]
        assert level.vertex_counts.max() <= 9 and level.shadow_strength == 0
        assert (level.coverages > 0).all() and (level.coverages <= 1).all()
        assert np.isfinite(level.vertices).all() and level.colors.min() >= 0 and level.colors.max() <= 1
        for number in range(len(level)):
            center, *contour = level.vertices[level.first_vertex[number] : level.first_vertex[number + 1]]
            a, b = np.array(contour) - center, np.roll(contour, -1, axis=0) - center
            assert (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0).all()  # counter-clockwise, seen from the centre


def test_merged_umbrellas_of_one_colour_are_of_that_colour(rng):
    arrangement = leaves(rng, shadow=False)
    same = replace(arrangement, colors=np.full_like(arrangement.colors, 0.3))
    for level in merged_levels(same, [None], (0.3, 0.3, 0.3), k=3):
        picture = rasterize(level, [None] * len(level.shapes), (0.3, 0.3, 0.3), (32, 16))
        assert np.allclose(picture[..., :3], 0.3, atol=0.01)


def test_fitted_levels_are_nearer_to_the_truth_than_the_papers(rng):
    arrangement = leaves(rng)
    ours, papers = (merged_levels(arrangement, [None], SOIL, method=method) for method in ("fitted", "paper"))
    for level, pixels in ((0, 4), (1, 2), (2, 1)):
        view = turned(pixels, (64, 64))
        truth = rasterize(arrangement, [None], SOIL, (64, 64), view=view, supersample=16)
        errors = []
        for levels in (ours, papers):
            textures = [None] * len(levels[level].shapes)
            picture = rasterize(levels[level], textures, SOIL, (64, 64), view=view, supersample=8)
            errors.append(encoded_rms(picture, truth))
        assert errors[0] < 0.9 * errors[1]


def test_merging_lets_umbrellas_grow_in_the_papers_way_alone(rng):
    arrangement = leaves(rng, per_cell=0.7, size=(0.6, 1.0), shadow=False)
    covered = rasterize(arrangement, [None], None, (128, 64))[..., 3].mean()
    shares = {}
    for method in ("fitted", "paper"):
        level = merged_levels(arrangement, [None], None, method=method, k=1)[1]
        shares[method] = rasterize(level, [None] * len(level.shapes), None, (128, 64))[..., 3].mean()
    assert shares["paper"] > 1.5 * covered
    assert shares["fitted"] == pytest.approx(covered, rel=0.05)


def test_empty_cells_stay_empty(rng):
    arrangement = leaves(rng, per_cell=4, shadow=False)
    kept = np.flatnonzero((arrangement.matrices[:, 2, 0] > 0.1) & (arrangement.matrices[:, 2, 0] < 0.4))
    colors = arrangement.colors.reshape(len(arrangement), -1, 3)[kept].reshape(-1, 3)
    few = replace(
        arrangement,
        shape_of=arrangement.shape_of[kept],
        matrices=arrangement.matrices[kept],
        morphs=np.zeros(len(kept)),
        colors=colors,
    )
    for method in ("fitted", "paper"):
        level = merged_levels(few, [None], SOIL, method=method, k=2)[0]
        picture = rasterize(level, [None] * len(level.shapes), SOIL, (64, 32))
        assert np.allclose(picture[:, 40:60, :3], SOIL, atol=1e-3)


def test_umbrellas_across_the_border_merge_there(rng):
    """And not to one that spans the texture."""
    one = leaves(rng, (8, 8), per_cell=1 / 32, shadow=False)
    matrices = one.matrices.copy()
    matrices[:, 2, :2] = [[0.99, 0.5], [0.01, 0.52]]
    for method in ("fitted", "paper"):
        level = merged_levels(replace(one, matrices=matrices), [None], None, method=method)[0]
        alpha = rasterize(level, [None] * len(level.shapes), None, (64, 64))[..., 3]
        assert alpha[28:36].max() > 0.3 and not alpha[:, 20:44].any()


def test_nothing_to_merge(rng):
    arrangement = leaves(rng, (1, 1))
    assert merged_levels(arrangement, [None], SOIL) == []
    none = replace(leaves(rng, (4, 4)), shape_of=np.zeros(0, np.int32), matrices=np.zeros((0, 3, 3)))
    none = replace(none, morphs=np.zeros(0), colors=np.zeros((0, 3), np.float32))
    assert merged_levels(none, [None], SOIL) == [] and merged_levels(none, [None], SOIL, method="paper") == []


def test_bad_choices_are_named(rng):
    arrangement = leaves(rng, (2, 2))
    with pytest.raises(FexelError, match="method is 'best', expected one of fitted, paper"):
        merged_levels(arrangement, [None], SOIL, method="best")
    with pytest.raises(FexelError, match="k is 0"):
        merged_levels(arrangement, [None], SOIL, k=0)
    with pytest.raises(FexelError, match="vertices 3"):
        merged_levels(arrangement, [None], SOIL, vertices=3)
