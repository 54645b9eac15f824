"""shaders/zipmap.glsl against its float64 twin: random projective nests, masks, opacities, views and filters."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import fexel
from bench.zipmap_stage import (
    Patch,
    front_view,
    lookup_texture,
    pixel_st,
    quad,
    save,
    tilted_view,
    zipmap_stage,
    zipmap_texture,
)
from fexel import homography, images, mipmaps
from fexel.renderer.visible import visible_surface
from fexel.textures.pyramid_cache import HALF, SRGB, PyramidCache
from fexel.textures.system import TextureRequest, TextureSystem
from fexel.textures.zipmap_twin import sample_zipmap

TOLERANCE = 1 / 255


def stored_pyramid(cache: PyramidCache, source) -> list[np.ndarray]:
    """All levels of an image as its page stores them, decoded: what the twin has to filter."""
    facts = cache.facts(source, "/Zipmap")
    levels = []
    for level in range(mipmaps.level_count(*facts.size)):
        width, height = (mipmaps.level_size(size, level) for size in facts.size)
        texels = cache.window(source, "/Zipmap", level, (0, 0, width, height))[1:-1, 1:-1]
        values = texels.astype(np.float64) / (1 if facts.page_class == HALF else 255)
        if facts.page_class == SRGB:
            values[..., :3] = images.srgb_to_linear(values[..., :3])
        levels.append(values)
    return levels


def difference(gl, texture, view, anisotropy, wrap=("clamp", "clamp"), filters=()):
    """Largest difference of shader and twin, and both frames; NaN where the quad is not."""
    data, cache = texture.data, PyramidCache()
    pyramids = [stored_pyramid(cache, data.sources[index]) for index in data.source_index]
    st_, jacobian, shown = pixel_st(view)
    system = TextureSystem(gl, anisotropy=anisotropy)
    rendered = lookup_texture(gl, texture, quad(), view, st_, jacobian, system).reshape(-1, 4)
    system.release()
    expected = np.full(rendered.shape, np.nan)
    expected[shown] = sample_zipmap(
        pyramids, data.root_to_patch, data.opacity, st_[shown], jacobian[shown], wrap, anisotropy, filters
    )
    shape = (view.height, view.width, 4)
    assert np.isfinite(rendered[shown]).all()
    return np.abs(rendered - expected)[shown].max(), rendered.reshape(shape), expected.reshape(shape)


def random_texels(rng, width, height, smooth=4):
    """Band-limited colour and a soft mask, premultiplied."""
    coarse = rng.random((max(2, height // smooth), max(2, width // smooth), 4)).astype(np.float32)
    rows = np.linspace(0, coarse.shape[0] - 1, height)
    columns = np.linspace(0, coarse.shape[1] - 1, width)
    r0, c0 = np.minimum(rows.astype(int), coarse.shape[0] - 2), np.minimum(columns.astype(int), coarse.shape[1] - 2)
    fr, fc = (rows - r0)[:, None, None], (columns - c0)[None, :, None]
    texels = (1 - fr) * ((1 - fc) * coarse[r0][:, c0] + fc * coarse[r0][:, c0 + 1]) + fr * (
        (1 - fc) * coarse[r0 + 1][:, c0] + fc * coarse[r0 + 1][:, c0 + 1]
    )
    texels[..., 3] = np.clip(2.5 * texels[..., 3] - 0.6, 0, 1)
    texels[..., :3] *= texels[..., 3:]
    return texels.astype(np.float32)


def random_matrix(rng, tilt=0.4):
    """A patch of random size, place, rotation, mirroring and perspective that touches its parent."""
    centre = rng.uniform(0.1, 0.9, 2)
    size = np.exp(rng.uniform(np.log(0.1), np.log(1.4)))
    angle = rng.uniform(0, 2 * np.pi)
    rotation = np.eye(3)
    rotation[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    mirror = homography.scale(rng.choice([-1.0, 1.0]), rng.uniform(0.5, 2.0))
    matrix = homography.translate(*-centre) @ homography.scale(1 / size, 1 / size) @ rotation @ mirror
    perspective = np.eye(3)
    perspective[:2, 2] = rng.uniform(-tilt, tilt, 2)
    return matrix @ perspective @ homography.translate(0.5, 0.5)


def random_nest(rng, folder, depth=0):
    width, height = (int(n) for n in rng.integers(3, 90, 2))
    dtype = rng.choice(["uint8", "uint16", "float16"])
    color_space = "sRGB" if dtype != "float16" and rng.random() < 0.6 else "raw"
    extension = "exr" if dtype == "float16" else "tif"
    name = folder / f"{rng.integers(1 << 40):x}.{extension}"
    levels = int(rng.choice([1, 20]))
    texels = random_texels(rng, width, height)
    if depth == 0:
        texels[..., :3] /= np.maximum(texels[..., 3:], 1e-3)
        texels[..., 3] = 1
        texels = texels.clip(0, 1)
    file = save(name, texels, str(dtype), color_space, levels)
    children = tuple(random_nest(rng, folder, depth + 1) for _ in range(int(rng.integers(0, 4 - depth))))
    opacity = 1.0 if rng.random() < 0.5 else float(rng.random())
    matrix = np.eye(3) if depth == 0 else random_matrix(rng)
    return Patch(file, matrix, opacity, children=children, color_space=str(color_space))


def random_view(rng):
    width, height = (int(n) for n in rng.integers(20, 120, 2))
    if rng.random() < 0.5:
        centre, size = rng.uniform(0.2, 0.8, 2), np.exp(rng.uniform(np.log(1e-3), np.log(2.0)))
        return front_view(centre - size / 2, centre + size / 2, width, height)
    return tilted_view(
        rng.uniform(0.3, 0.7, 2), float(rng.uniform(0.05, 1.5)), float(rng.uniform(0, 80)), width, height
    )


@settings(max_examples=40, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 2**32 - 1), anisotropy=st.sampled_from([1.0, 4.0, 16.0]))
def test_zipmap_shader_equals_float64_twin(gl, tmp_path_factory, seed, anisotropy):
    rng = np.random.default_rng(seed)
    folder = tmp_path_factory.mktemp("nest")
    texture = zipmap_texture(zipmap_stage(random_nest(rng, folder)))
    worst, _, _ = difference(gl, texture, random_view(rng), anisotropy)
    assert worst <= TOLERANCE


@pytest.mark.parametrize("wrap", ["black", "clamp", "repeat", "mirror"])
def test_zipmap_root_wraps_as_the_twin(gl, tmp_path, rng, wrap):
    file = save(tmp_path / "root.tif", random_texels(rng, 37, 22), "uint8", "raw")
    texture = zipmap_texture(zipmap_stage(Patch(file, homography.scale(3, 2.5), color_space="raw"), wrap))
    for view in (front_view((0, 0), (1, 1), 90, 70), front_view((0, 0), (1, 1), 20, 16)):
        worst, _, _ = difference(gl, texture, view, 1.0, (wrap, wrap))
        assert worst <= TOLERANCE


def similar_nest(rng, folder, count):
    """Patches turned, mirrored and scaled alike along both axes, over a root that is not square."""
    aspect = 1.6
    sizes = [(128, 80)] + [(int(32 * 2 ** rng.uniform(0, 1.5)),) * 2 for _ in range(count)]
    files = []
    for number, (width, height) in enumerate(sizes):
        texels = random_texels(rng, width, height)
        if number == 0:
            texels = np.dstack([texels[..., :3], np.ones(texels.shape[:2])]).astype(np.float32)
        dtype, space = (("uint8", "sRGB"), ("uint16", "raw"), ("uint8", "sRGB"))[number % 3]
        files.append((save(folder / f"{number}.tif", texels, dtype, space, 20), space))
    children = []
    for number in range(count):
        angle, scale = rng.uniform(0, 2 * np.pi), 1 / np.exp(rng.uniform(np.log(0.3), np.log(1.5)))
        turn = np.eye(3)
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        square = homography.translate(*-rng.uniform(0.2, 0.8, 2)) @ homography.scale(aspect, 1)
        mirror = homography.scale(scale * rng.choice([-1.0, 1.0]), scale)
        matrix = square @ turn @ mirror @ homography.translate(0.5, 0.5)
        opacity = float(rng.choice([1.0, 0.6]))
        children.append(Patch(files[number + 1][0], matrix, opacity, color_space=files[number + 1][1]))
    return Patch(files[0][0], np.eye(3), children=tuple(children), color_space=files[0][1])


def is_listed(gl, texture, view, anisotropy=1.0):
    """Whether the view's layers are unrolled instead of found by the index."""
    surface = visible_surface(quad(), view, ["st"])
    system = TextureSystem(gl, anisotropy=anisotropy)
    request = TextureRequest(texture, surface)
    system.begin_view([request])
    listed = system.binding([request]).defines["ZIPMAP_LAYERS"] > 0
    system.release()
    return listed


@settings(max_examples=12, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 4), lod=st.floats(-2.0, 3.0))
def test_zipmap_unrolled_list_and_index_equal_the_float64_twin(gl, tmp_path_factory, seed, count, lod):
    rng = np.random.default_rng(seed)
    texture = zipmap_texture(zipmap_stage(similar_nest(rng, tmp_path_factory.mktemp("list"), count)))
    size = rng.uniform(0.5, 1.0)
    low = rng.uniform(0, 1 - size, 2)
    width = int(np.clip(128 * size / 2**lod, 8, 200))
    view = front_view(low, low + size, width, max(8, int(width / 1.6)))
    worst, _, _ = difference(gl, texture, view, 1.0)
    assert worst <= TOLERANCE


@pytest.mark.parametrize("wrap", ["black", "clamp", "repeat", "mirror"])
def test_zipmap_unrolled_list_of_five_layers_equals_the_twin(gl, tmp_path, rng, wrap):
    texture = zipmap_texture(zipmap_stage(similar_nest(rng, tmp_path, 4), wrap))
    view = front_view((0.1, 0.1), (0.9, 0.9), 290, 181)  # magnified: one level of each, half and sRGB pages
    assert is_listed(gl, texture, view)
    assert difference(gl, texture, view, 1.0, (wrap, wrap))[0] <= TOLERANCE


@pytest.mark.parametrize("token", ["mipmap", "ripmap", "fipmap"])
@pytest.mark.parametrize("tilt", [20, 60, 80])
@pytest.mark.parametrize("wrap", ["clamp", "repeat", "mirror"])
def test_filtered_zipmap_equals_the_twin(gl, tmp_path, rng, token, tilt, wrap):
    """But for single pixels, whose choice of a direction or level is a matter of rounding."""
    root = save(tmp_path / "root.tif", random_texels(rng, 96, 64), "float32", levels=20)
    patch = save(tmp_path / "patch.tif", random_texels(rng, 80, 80), "float32", levels=20)
    lean = homography.translate(-0.2, -0.2) @ homography.scale(1 / 0.6, 1 / 0.5)
    lean = lean @ np.array([[1, 0.2, 0.1], [-0.1, 1, 0.05], [0, 0, 1]])
    stage = zipmap_stage(Patch(root, np.eye(3), children=(Patch(patch, lean, 0.8),)), wrap)
    fexel.TextureMinificationAPI.Apply(stage.GetPrimAtPath("/Zipmap")).CreateFilterAttr(token)
    view = tilted_view((0.5, 0.4), 1.5, tilt, 64, 48, fov=45)
    texture = zipmap_texture(stage)
    assert texture.data.filters == (token, token)
    modes = (wrap, wrap)
    _, rendered, expected = difference(gl, texture, view, 8.0, modes, texture.data.filters)
    error = np.abs(rendered - expected).max(axis=-1)
    error = error[np.isfinite(error)]
    assert np.quantile(error, 0.97) < TOLERANCE
    assert error.max() < 0.15
