"""Writing images, and exact homographies between synthetic photos."""

from __future__ import annotations

import numpy as np
import OpenImageIO as oiio

__all__ = ["corner_error", "root_from_photo", "write_image"]


def write_image(path, pixels, **attributes):
    """Write (H, W, C) pixels of any dtype; `__` in an attribute's name stands for `:`."""
    pixels = np.atleast_3d(pixels)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.TypeDesc(_oiio_type(pixels.dtype)))
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    output = oiio.ImageOutput.create(str(path))
    assert output is not None, oiio.geterror()
    assert output.open(str(path), spec), output.geterror()
    assert output.write_image(np.ascontiguousarray(pixels)), output.geterror()
    output.close()
    return str(path)


def _oiio_type(dtype):
    return {"float16": "half", "float32": "float"}.get(str(dtype), str(dtype))


def root_from_photo(series, root, name):
    """Exact homography between two shots."""
    return series[root].photo_from_surface @ np.linalg.inv(series[name].photo_from_surface)


def corner_error(estimate, truth, size):
    """Greatest distance of the corners' images, in target pixels."""
    corners = np.array([[0, 0, 1], [size[0], 0, 1], [size[0], size[1], 1], [0, size[1], 1]], float).T
    a, b = np.asarray(estimate) @ corners, truth @ corners
    return float(np.abs(a[:2] / a[2] - b[:2] / b[2]).max())
