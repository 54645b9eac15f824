"""Umbrella textures baked into one image, alone and in a zipmap: against the float64 twin, supersampled."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, Vt

import fexel
from fexel.errors import FexelWarning
from fexel.images import image_info, read_linear
from fexel.textures import extract_texture
from fexel.textures.umbrella_twin import UmbrellaTwin
from fexel_tools import fallback
from fexel_tools.baking import texture_baker
from fexel_tools.image_files import write_image
from fexel_tools.umbrella_baking import baker

GRID = (6, 4)


def leaf(rng):
    angle = np.arange(11) * 2 * np.pi / 11
    radius = rng.uniform(0.25, 0.5, 11)
    return np.concatenate([[[0.0, 0.0]], np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)])


def matrices(rng, count, size=(1.5, 2.5)):
    angle, length = rng.uniform(0, 2 * np.pi, count), rng.uniform(*size, count)
    result = np.zeros((count, 4, 4))[:, :3, :3]
    result[:, 0, :2] = (length * np.cos(angle) / GRID[0])[:, None] * [1, 0]
    result[:, 0, 1] = length * np.sin(angle) / GRID[1]
    result[:, 1, 0] = -length * np.sin(angle) / GRID[0]
    result[:, 1, 1] = length * np.cos(angle) / GRID[1]
    result[:, 2, :2], result[:, 2, 2] = rng.random((count, 2)), 1
    return result


def define(stage, folder, rng, path="/Ground", count=30, color_space="sRGB", dtype=np.uint8):
    """A texture of two bases, the second with alpha, on an image; colours, morphs and shadows."""
    texture = fexel.UmbrellaTexture.Define(stage, path)
    largest = np.iinfo(dtype).max
    for number, channels in enumerate((3, 4)):
        pixels = rng.integers(largest // 4, largest, (24, 32, channels)).astype(dtype)
        write_image(folder / f"leaf{number}.png", pixels, color_space)
        patch = fexel.UmbrellaPatch.Define(stage, f"{path}/Leaf{number}")
        patch.CreateFileAttr(Sdf.AssetPath(str(folder / f"leaf{number}.png"))).SetColorSpace(color_space)
        points = leaf(rng)
        patch.CreatePointsAttr(Vt.Vec2fArray.FromNumpy(points.astype(np.float32)))
        patch.CreateMorphPointsAttr(Vt.Vec2fArray.FromNumpy((points * 0.8).astype(np.float32)))
        patch.CreateTexCoordsAttr(Vt.Vec2fArray.FromNumpy((points + 0.5).astype(np.float32)))
    write_image(folder / "soil.png", rng.integers(0, largest // 2, (20, 30, 3)).astype(dtype), color_space)
    texture.CreateFileAttr(Sdf.AssetPath(str(folder / "soil.png")))
    texture.CreateSourceColorSpaceAttr(color_space)
    texture.CreateGridAttr(Gf.Vec2i(*GRID))
    texture.CreatePatchIndicesAttr(Vt.IntArray.FromNumpy(rng.integers(0, 2, count).astype(np.int32)))
    texture.CreateMatricesAttr(Vt.Matrix3dArray.FromNumpy(matrices(rng, count)))
    texture.CreateMorphsAttr(Vt.FloatArray.FromNumpy(rng.random(count).astype(np.float32)))
    texture.CreateColorsAttr(Vt.Vec3fArray.FromNumpy(rng.uniform(-0.2, 0.2, (count * 12, 3)).astype(np.float32)))
    texture.CreateShadowOffsetAttr(Gf.Vec2f(0.02, -0.02))
    texture.CreateShadowStrengthAttr(0.5)
    texture.CreateWrapSAttr("repeat")
    texture.CreateWrapTAttr("repeat")
    return texture


def data_of(texture):
    kind, data = extract_texture(texture.GetPrim(), Usd.TimeCode.Default())
    assert kind == "umbrella"
    return data


@pytest.fixture
def stage():
    return Usd.Stage.CreateInMemory()


@pytest.fixture
def ground(stage, tmp_path, rng):
    return define(stage, tmp_path, rng)


def supersampled(data, size, samples, window=(0.0, 0.0, 1.0, 1.0)):
    """Points of every pixel, edges hard, averaged."""
    width, height = size[0] * samples, size[1] * samples
    s = window[0] + (window[2] - window[0]) * (np.arange(width) + 0.5) / width
    t = window[3] - (window[3] - window[1]) * (np.arange(height) + 0.5) / height
    step = np.diag([(window[2] - window[0]) / width, -(window[3] - window[1]) / height])
    st = np.stack(np.meshgrid(s, t), axis=-1).reshape(-1, 2)
    points = UmbrellaTwin(data, "/Ground").sample(st, step, hard=True)
    return points.reshape(size[1], samples, size[0], samples, 4).mean(axis=(1, 3))


def test_picture_is_the_supersampled_twin(ground):
    """Samples lie elsewhere: what differs are pixels at borders."""
    data = data_of(ground)
    picture = baker(data, "/Ground").bake(120, 80)
    difference = np.abs(picture - supersampled(data, (120, 80), 6))
    assert difference.mean() < 3e-3 and difference.max() < 0.15
    assert picture[..., 3] == pytest.approx(1.0, abs=1e-3)


def test_fallback_of_the_prim_is_written_as_its_images_are(ground, tmp_path):
    path = fallback.write_fallback(ground.GetPrim(), tmp_path / "baked.png", size=72)
    info = image_info(str(path))
    assert (info.width, info.height) == (72, 48) and info.dtype == "uint8" and info.color_space == "sRGB"
    expected = supersampled(data_of(ground), (72, 48), 5)
    assert np.abs(read_linear(str(path)) - expected).mean() < 5e-3
    assert ground.GetPrim().GetChild(fallback.FALLBACK_NAME)


def test_size_is_that_of_the_detail_and_at_most_as_asked(ground):
    found = texture_baker("umbrella", data_of(ground), "/Ground")
    width, height = found.size(1 << 20)
    assert width / height == pytest.approx(GRID[0] / GRID[1], rel=0.02)
    # Bases of 28 texels, seen at 1.2 to 2.5 cells: 11 to 23 texels a cell.
    assert 11 * GRID[0] < width < 23 * GRID[0]
    assert found.size(40) == (40, 27)


def test_lookups_of_a_nested_texture_are_the_twins(ground, rng):
    data = data_of(ground)
    st, jacobian = rng.random((50, 2)), np.broadcast_to(np.diag([0.01, -0.01]), (50, 2, 2))
    found = texture_baker("umbrella", data, "/Ground").sample(st, jacobian)
    assert np.allclose(found, UmbrellaTwin(data, "/Ground").sample(st, jacobian))


def test_umbrellas_in_a_zipmap_are_part_of_its_picture(stage, tmp_path, rng):
    zipmap = fexel.ZipmapTexture.Define(stage, "/Wall")
    zipmap.CreateFallbackAttr(Gf.Vec4f(0.25, 0.25, 0.25, 1))
    patch = define(stage, tmp_path, rng, "/Wall/Ground")
    # The lawn lies in the middle, half as wide and high as the wall.
    patch.CreateMatrixAttr(Gf.Matrix3d(2, 0, 0, 0, 2, 0, -0.5, -0.5, 1))
    kind, data = extract_texture(zipmap.GetPrim(), Usd.TimeCode.Default())
    picture = texture_baker(kind, data, "/Wall").bake(128, 128)
    assert np.allclose(picture[:30, :, :3], 0.25, atol=1e-3) and np.allclose(picture[:, 100:, :3], 0.25, atol=1e-3)
    expected = supersampled(data.nested[0].data, (64, 64), 4)
    assert np.abs(picture[33:95, 33:95] - expected[1:-1, 1:-1]).mean() < 0.02


@pytest.mark.parametrize("up", [1, -1], ids=["y up", "y down"])
def test_raw_data_keep_their_scale_for_later(stage, tmp_path, rng, up):
    """Normals: stored as 16 bits of raw values, to be scaled by who reads them."""
    texture = define(stage, tmp_path, rng, color_space="raw", dtype=np.uint16)
    texture.CreateScaleAttr(Gf.Vec4f(2, 2 * up, 2, 1))
    texture.CreateBiasAttr(Gf.Vec4f(-1, -up, -1, 0))
    data = data_of(texture)
    assert data.turns_vectors
    found = texture_baker("umbrella", data, "/Ground")
    storage = found.storage
    assert (storage.color_space, storage.dtype) == ("raw", "uint16")
    assert storage.scale == (2, 2 * up, 2, 1) and storage.bias == (-1, -up, -1, 0)
    picture = found.bake(96, 64)
    scaled = (picture[..., :3] * 2 - picture[..., 3:]) * (1, up, 1)
    expected = supersampled(data, (96, 64), 4)[..., :3]
    assert np.abs(scaled - expected).mean() < 6e-3


def test_missing_base_is_said_once_and_left_out(ground, tmp_path):
    (tmp_path / "leaf0.png").unlink()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = texture_baker("umbrella", data_of(ground), "/Ground")
        picture = found.bake(48, 32)
        again = found.bake(48, 32)
    said = [str(warning.message) for warning in caught if issubclass(warning.category, FexelWarning)]
    assert len(said) == 1 and "leaf0.png" in said[0] and "/Ground/Leaf0" in said[0]
    assert np.isfinite(picture).all() and np.array_equal(picture, again)


def test_damaged_base_is_said_and_left_out(ground, tmp_path):
    (tmp_path / "leaf1.png").write_bytes((tmp_path / "leaf1.png").read_bytes()[:200])
    with pytest.warns(FexelWarning, match=r"leaf1\.png"):
        picture = texture_baker("umbrella", data_of(ground), "/Ground").bake(48, 32)
    assert np.isfinite(picture).all()


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp", "black"])
def test_matrix_and_wrap_are_those_of_the_texture(ground, wrap):
    ground.CreateMatrixAttr(Gf.Matrix3d(1.5, 0, 0, 0, 1.5, 0, -0.25, -0.25, 1))
    ground.CreateWrapSAttr(wrap)
    ground.CreateWrapTAttr(wrap)
    data = data_of(ground)
    difference = np.abs(texture_baker("umbrella", data, "/Ground").bake(96, 64) - supersampled(data, (96, 64), 4))
    assert difference.mean() < 0.012


def test_perspective_is_looked_up(ground):
    ground.CreateMatrixAttr(Gf.Matrix3d(1, 0, 0.5, 0, 1, 0.3, 0, 0, 1))
    data = data_of(ground)
    difference = np.abs(texture_baker("umbrella", data, "/Ground").bake(96, 64) - supersampled(data, (96, 64), 4))
    assert difference.mean() < 0.012


def test_ground_without_umbrellas_is_its_background(stage, tmp_path, rng):
    texture = define(stage, tmp_path, rng, count=0)
    found = texture_baker("umbrella", data_of(texture), "/Ground")
    assert found.size(4096) == (30, 20)
    soil = read_linear(str(tmp_path / "soil.png"))
    assert np.abs(found.bake(30, 20)[1:-1, 1:-1] - soil[1:-1, 1:-1]).max() < 0.2
