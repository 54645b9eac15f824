"""Backgrounds: pictures that tile are repeated as they are, others are made to tile, nothing is mirrored."""

import cv2
import numpy as np
import pytest

from fexel_tools.image_files import write_image
from fexel_tools.seamless import seamless, tiles
from fexel_tools.umbrella_background import choose_background, laid_out
from fexel_tools.umbrella_options import UmbrellaOptions, check_options


@pytest.fixture
def tileable(rng):
    """Blurred noise on a torus."""
    noise = np.tile(rng.random((60, 80, 3)).astype(np.float32), (3, 3, 1))
    return cv2.GaussianBlur(noise, (0, 0), 2.0)[60:120, 80:160]


@pytest.fixture
def photo(rng):
    """Blurred noise under a light that falls off: no border meets the opposite one."""
    noise = cv2.GaussianBlur(rng.random((90, 120, 3)).astype(np.float32), (0, 0), 1.5)
    return noise * np.linspace(1.0, 0.5, 120, dtype=np.float32)[None, :, None]


def test_what_tiles_is_told_from_what_does_not(tileable, photo):
    assert tiles(tileable) and not tiles(photo)
    assert not tiles(tileable[:, :-20]) and not tiles(tileable[:-15])
    assert tiles(np.full((20, 30, 3), 0.4, np.float32))


def test_a_photo_is_made_to_tile_and_keeps_its_middle(photo):
    tile = seamless(photo)
    assert not tiles(photo) and tiles(tile)
    assert tile.shape == (77, 103, 3)
    assert tile.min() >= photo.min() and tile.max() <= photo.max()
    detail = [p - cv2.GaussianBlur(p, (0, 0), 6.0) for p in (tile[25:70, 30:95], photo[25:70, 30:95])]
    assert np.abs(detail[0] - detail[1])[10:-10, 10:-10].max() < 0.02  # the same places: the light alone differs


def test_the_overlap_is_cut_not_averaged(rng):
    """Averaging two unlike textures would lose contrast."""
    photo = rng.random((140, 140, 1)).astype(np.float32)
    tile = seamless(photo)
    assert tile[:, :20].std() > 0.9 * photo.std() and tile[:20].std() > 0.9 * photo.std()


def test_a_picture_that_tiles_is_repeated_texel_by_texel(tileable):
    whole = laid_out(tileable, (10, 6), 32)  # 320 x 192: four by three of 80 x 60, or nearly
    assert whole.shape == (192, 320, 3)
    exact = laid_out(tileable, (10, 6), 40)  # 400 x 240
    assert np.array_equal(exact, np.tile(tileable, (4, 5, 1)))


@pytest.mark.parametrize("grid", [(32, 20), (64, 5), (3, 40), (1, 1)])
def test_a_ground_repeats_without_a_seam_and_is_not_mirrored(photo, grid):
    whole = laid_out(photo, grid, 16)
    assert whole.shape[1::-1] == (16 * grid[0], 16 * grid[1])
    if min(whole.shape[:2]) >= 64:
        assert tiles(whole)
        for axis in (0, 1):
            assert all(_mirrored(whole, axis, at) < 0.5 for at in range(20, whole.shape[axis] - 20))


def _mirrored(picture, axis, at):
    """Correlation of both sides of a line."""
    lines = np.moveaxis(picture, axis, 0).mean(axis=2)
    before, after = lines[at - 20 : at][::-1], lines[at : at + 20]
    return float(np.corrcoef((before - before.mean(0)).ravel(), (after - after.mean(0)).ravel())[0, 1])


def test_a_photo_keeps_its_aspect_whatever_the_grid(rng):
    """Discs stay round: a photo larger than the ground is cut, not squeezed."""
    rows, columns = np.mgrid[:400, :400]
    discs = (np.hypot(rows % 40 - 19.5, columns % 40 - 19.5) < 12).astype(np.float32)[..., None]
    whole = laid_out(discs, (40, 8), 5)[..., 0]  # 200 x 40
    assert whole.shape == (40, 200)
    dx, dy = (np.abs(np.diff(whole, axis=axis)).sum() for axis in (1, 0))
    assert 0.8 < dx / dy < 1.25


def test_bytes_follow_the_size_that_is_asked_for(photo):
    assert laid_out(photo, (64, 24)).shape == (768, 2048, 3)
    assert laid_out(photo, (64, 24), 8).shape == (192, 512, 3)
    assert max(laid_out(photo[:, :, :1], (4096, 2), 32).shape) == 4096


@pytest.mark.parametrize("size", [(1, 1), (3, 2), (1, 50), (7, 7)])
def test_tiny_pictures_are_repeated(rng, size):
    whole = laid_out(rng.random((*size, 3)).astype(np.float32), (5, 4), 8)
    assert whole.shape == (32, 40, 3) and np.isfinite(whole).all()


def test_a_picture_with_holes_keeps_its_alpha(tmp_path, photo):
    image = np.dstack([photo, np.where(photo[..., 0] > 0.3, 1, 0)])
    write_image(tmp_path / "net.png", np.rint(image * 255).astype(np.uint8))
    background = choose_background(str(tmp_path / "net.png"), [], (8, 4), cell_texels=16)
    assert background.picture is not None and background.picture.shape == (64, 128, 4)
    assert 0.2 < background.color[3] < 0.98


@pytest.mark.parametrize("size", [0.0, -1.0, float("nan"), 5000.0])
def test_sizes_out_of_range_are_named(size):
    with pytest.raises(Exception, match="--background-size"):
        check_options(UmbrellaOptions(background_size=size))
