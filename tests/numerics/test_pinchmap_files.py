"""Pinchmap files hold exactly the bytes that were meant, also for readers that are not OpenImageIO."""

from __future__ import annotations

import cv2
import numpy as np
import OpenImageIO as oiio
import pytest

from fexel.errors import FexelError
from fexel.textures.pinchmap_encoding import decode_texels, encode_texels
from fexel_tools.pinchmap_textures import as_stored, write_pinchmap


@pytest.fixture
def pinchmap(rng):
    texels = rng.uniform(-1, 1, (7, 5, 4))
    texels[0] = [[0, 0, 1, -1], [1, -1, 0, 0], [0, 0, -1, 1], [1, 1, 1, 1], [-1, -1, -1, -1]]
    return texels


def pixels_by_opencv(path):
    """RGBA as another library reads it: what OpenImageIO writes it may also undo."""
    return cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)[..., [2, 1, 0, 3]]


@pytest.mark.parametrize(("bits", "middle"), [("8", 127), ("16", 32767)])
def test_integer_files_are_raw_to_another_reader(tmp_path, pinchmap, bits, middle):
    """No alpha is multiplied in or divided out, no gamma applied; 0 is the middle, the highest value is never used."""
    path, nbytes = write_pinchmap(tmp_path, pinchmap, bits)
    seen = pixels_by_opencv(path)
    assert np.array_equal(seen, encode_texels(pinchmap, bits=int(bits)))
    assert nbytes == seen.nbytes
    assert seen[0, 0].tolist() == [middle, middle, 2 * middle, 0]
    assert seen.max() == 2 * middle
    np.testing.assert_allclose(decode_texels(seen), pinchmap, atol=0.5 / middle + 1e-12)


def test_float_file_keeps_float32(tmp_path, pinchmap):
    path, _ = write_pinchmap(tmp_path, pinchmap, "float")
    assert np.array_equal(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT), pinchmap.astype(np.float32))


@pytest.mark.parametrize("bits", ["8", "16", "float"])
def test_stored_texels_survive_being_stored_again(pinchmap, bits):
    once = as_stored(pinchmap, bits)
    assert np.array_equal(as_stored(once, bits), once)


@pytest.mark.parametrize("bits", [8, 16])
def test_every_stored_value_decodes_and_encodes_to_itself(bits):
    values = np.arange((1 << bits) - 1).astype(np.uint8 if bits == 8 else np.uint16)
    assert np.array_equal(encode_texels(decode_texels(values), bits=bits), values)
    highest = np.array([(1 << bits) - 1], values.dtype)
    assert decode_texels(highest).tolist() == [1.0]


def test_texels_that_are_not_finite_become_finite(tmp_path):
    texels = np.array([[[np.nan, np.inf, -np.inf, 3.0]]])
    assert as_stored(texels, "8").tolist() == [[[0.0, 1.0, -1.0, 1.0]]]
    path, _ = write_pinchmap(tmp_path, texels, "8")
    assert pixels_by_opencv(path).tolist() == [[[127, 254, 0, 254]]]


def test_folder_that_is_missing_is_one_line_and_leaves_nothing(tmp_path, pinchmap):
    with pytest.raises(FexelError, match="cannot be written") as caught:
        write_pinchmap(tmp_path / "missing", pinchmap, "8")
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())
