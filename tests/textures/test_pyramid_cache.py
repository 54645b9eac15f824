"""Pyramids of files that are not tiled: built in strips, the same as from the whole image."""

import numpy as np
import OpenImageIO as oiio
import pytest

from fexel import images, mipmaps
from fexel.errors import FexelWarning
from fexel.textures import pyramid_cache
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.pyramid_cache import HALF, PyramidCache
from fexel.textures.zipmap import ImageSource


def write(path, pixels, **attributes):
    buffer = oiio.ImageBuf(np.ascontiguousarray(pixels))
    for name, value in attributes.items():
        buffer.specmod().attribute(name.replace("__", ":"), value)
    assert buffer.write(str(path))
    return str(path)


def stored(cache, source, level):
    facts = cache.facts(source, "/Zipmap")
    width, height = (mipmaps.level_size(size, level) for size in facts.size)
    return cache.window(source, "/Zipmap", level, (0, 0, width, height))[1:-1, 1:-1]


@pytest.mark.parametrize("rows", [1, 2, 3, 7, 1000])
@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (37, 22), (22, 37), (101, 203), (64, 64)])
def test_mipmaps_strips_of_any_height_give_the_same_level(rng, size, rows):
    image = rng.random((*size, 4)).astype(np.float32)
    halver = mipmaps.RowHalver(size[0])
    strips = [halver.feed(image[y : y + rows]) for y in range(0, size[0], rows)]
    assert np.array_equal(np.concatenate(strips), mipmaps.halve(image))


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
@pytest.mark.parametrize("first", [0, 2])
def test_pyramid_in_strips_equals_that_of_the_whole_image(tmp_path, rng, monkeypatch, dtype, masked, first):
    monkeypatch.setattr(pyramid_cache, "_STRIP_TEXELS", 800)
    pixels = rng.integers(0, np.iinfo(dtype).max, (203, 101, 4), dtype, endpoint=True)
    file = write(tmp_path / "odd.png", pixels, oiio__UnassociatedAlpha=1)
    mask = write(tmp_path / "mask.png", rng.integers(0, 255, (20, 30, 1), np.uint8)) if masked else ""
    source = ImageSource(file, mask, wrap=("clamp", "clamp"))
    texels = images.read_linear(file)
    if masked:
        alpha = images.read_mask(mask, (101, 203))
        straight = pixels[..., :3] / np.float32(np.iinfo(dtype).max)
        straight = images.srgb_to_linear(straight) if dtype == "uint8" else straight
        texels = np.concatenate([straight * alpha[..., None], alpha[..., None]], -1)
    cache = PyramidCache()
    half = cache.facts(source, "/Zipmap").page_class == HALF
    expected = mipmaps.pyramid(texels)
    for level in sorted(range(len(expected)), key=lambda n: (n - first) % len(expected)):
        values = stored(cache, source, level).astype(np.float32)
        wanted = expected[level].copy()
        if not half:
            wanted[..., :3] = images.linear_to_srgb(wanted[..., :3])
            wanted, tolerance = wanted * 255, 0.53  # half a step, and the table's 2^-16 at black
        else:
            tolerance = 2e-3
        assert np.abs(values - wanted).max() <= tolerance


@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.exr"])
def test_mask_replaces_alpha_where_the_file_is_transparent(tmp_path, name):
    """Straight files keep their colour under alpha 0; associated ones that of their own alpha."""
    associated = name == "a.exr"
    straight = np.float32([1.0, 0.0, 1.0])
    pixels = np.zeros((4, 8, 4), np.float32)
    pixels[..., 3] = 0.5 if associated else 0.0
    pixels[..., :3] = straight * (0.5 if associated else 1.0)
    if not associated:
        pixels = (pixels * 255).astype(np.uint8)
    attributes = {} if associated else {"oiio__UnassociatedAlpha": 1}
    file = write(tmp_path / name, pixels, **attributes)
    mask = write(tmp_path / "mask.png", np.full((4, 8, 1), 255, np.uint8))
    texels = stored(PyramidCache(), ImageSource(file, mask, wrap=("clamp", "clamp")), 0)
    opaque = 1.0 if texels.dtype == np.float16 else 255
    assert np.array_equal(texels, np.broadcast_to(np.float32([1, 0, 1, 1]) * opaque, texels.shape))


def test_mask_that_cannot_be_read_is_named_and_the_alpha_of_the_file_used(tmp_path):
    file = write(tmp_path / "a.png", np.full((4, 4, 4), 128, np.uint8), oiio__UnassociatedAlpha=1)
    source = ImageSource(file, str(tmp_path / "none.png"), wrap=("clamp", "clamp"))
    cache = PyramidCache()
    with pytest.warns(FexelWarning) as caught:
        texels, _ = (stored(cache, source, level) for level in (0, 1))
    assert (texels[..., 3] == 128).all()
    (message,) = (str(warning.message) for warning in caught)
    assert message.startswith("/Zipmap.inputs:mask: ")
    assert message.endswith("none.png: no such file; the alpha of inputs:file is used")


def test_pyramid_keeps_level_zero_only_once_it_is_asked_for(tmp_path, rng):
    file = write(tmp_path / "a.png", rng.integers(0, 255, (64, 64, 3), np.uint8))
    cache, source = PyramidCache(), ImageSource(file, wrap=("clamp", "clamp"))
    stored(cache, source, 2)
    assert cache._kept.get(source)[0] is None
    stored(cache, source, 0)
    assert cache._kept.get(source)[0].shape == (64, 64, 4)


def test_kept_texels_stay_within_the_limit_whoever_keeps_them(tmp_path, rng):
    kept = KeptTexels(3 * 64 * 64 * 4)
    cache = PyramidCache(kept)
    sources = [
        ImageSource(write(tmp_path / f"{n}.png", rng.integers(0, 255, (64, 64, 3), np.uint8)), wrap=("clamp", "clamp"))
        for n in range(4)
    ]
    first = stored(cache, sources[0], 0)
    for source in sources[1:]:
        stored(cache, source, 0)
        assert source in kept
        assert kept.nbytes <= 3 * 64 * 64 * 4
    assert sources[0] not in kept
    assert np.array_equal(stored(cache, sources[0], 0), first)
    kept.keep("large", np.zeros(1), 10**9)
    assert "large" in kept
    assert kept.nbytes == 10**9


def test_kept_texels_that_are_used_stay():
    kept = KeptTexels(3)
    for key in "abc":
        kept.keep(key, key, 1)
    assert kept.get("a") == "a"
    kept.keep("d", "d", 1)
    assert [key in kept for key in "abcd"] == [True, False, True, True]
    kept.keep("a", "A", 3)
    assert (kept.get("a"), kept.get("d"), kept.nbytes) == ("A", None, 3)


@pytest.mark.parametrize(
    ("modes", "expected"),
    [
        ("periodic", ("repeat", "repeat")),
        ("clamp,mirror", ("clamp", "mirror")),
        ("black,periodic", ("black", "repeat")),
        ("default", ("black", "black")),
        (None, ("black", "black")),
    ],
)
@pytest.mark.parametrize("name", ["a.tif", "a.exr"])
def test_wrap_use_metadata_is_what_the_file_says(tmp_path, name, modes, expected):
    attributes = {} if modes is None else {"wrapmodes": modes}
    file = write(tmp_path / name, np.zeros((4, 4, 3), np.float32), **attributes)
    facts = PyramidCache().facts(ImageSource(file, wrap=("useMetadata", "useMetadata")), "/Zipmap")
    assert facts.wrap == expected
    authored = PyramidCache().facts(ImageSource(file, wrap=("mirror", "useMetadata")), "/Zipmap")
    assert authored.wrap == ("mirror", expected[1])
