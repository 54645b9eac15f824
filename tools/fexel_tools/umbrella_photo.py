"""A photo of elements, held as it is stored: reduced to look for elements, decoded window by window to cut them.

A photo of 40 megapixels takes 120 MB so, and would take 480 MB in linear float.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel.images import linear_to_srgb
from fexel_tools.photo_pixels import decode_pixels, decode_reduced, warn_of_non_finite
from fexel_tools.photos import Photo, probe_photo, read_stored_pixels, upright

__all__ = ["Box", "ElementPhoto", "Preview", "open_photo"]

_STORED = {"uint8": oiio.UINT8, "uint16": oiio.UINT16, "half": oiio.HALF, "float": oiio.FLOAT}
_SPACES = ("tiff:ColorSpace", "jpeg:ColorSpace", "psd:ColorMode")  # attributes in which OpenImageIO tells CMYK
_WHITE_PERCENTILE = 99.0  # of a photo in floats: shown as white
_MOST_PIXELS = 1 << 28  # 16384 x 16384

Box = tuple[int, int, int, int]


@dataclass(frozen=True, eq=False)
class Preview:
    """A photo reduced for segmentation.

    Attributes
    ----------
    color : (h, w, 3) float32
        Linear, straight alpha, or data.
    lab : (h, w, 3) float32
        CIELAB, L from 0 to 100; of data: the stored values as if they were sRGB-encoded.
    alpha : (h, w) float32 or None
        None where the photo has none.
    factor : int
        Pixels of the photo on a side of one of these, a power of two; the last of a row or column may hold fewer.
    """

    color: NDArray[np.float32]
    lab: NDArray[np.float32]
    alpha: NDArray[np.float32] | None
    factor: int


@dataclass(frozen=True, eq=False)
class ElementPhoto:
    """An open photo.

    Attributes
    ----------
    path : Path
    photo : Photo
    stored : (H, W, C)
        Upright, as stored.
    is_data : bool
        Values are taken as stored.
    """

    path: Path
    photo: Photo
    stored: NDArray
    is_data: bool

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.photo.width, self.photo.height

    def window(self, box: Box, factor: int = 1) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Colour, straight and linear (or data), and alpha of a box within the photo, reduced by `factor`."""
        left, top, right, bottom = box
        stored = self.stored[top:bottom, left:right]
        if factor == 1:
            return decode_pixels(self.photo, stored, self.is_data)
        return decode_reduced(self.photo, stored, self.is_data, factor)

    def preview(self, most_pixels: int) -> Preview:
        """The photo with at most so many pixels, averaged in linear light."""
        width, height = self.size
        factor = 1 << max(math.ceil(math.log2(width * height / most_pixels) / 2), 0)
        color, alpha = self.window((0, 0, width, height), factor)
        lab = lab_of(color, is_data=self.is_data, is_float=self.photo.is_float)
        return Preview(color, lab, alpha, factor)


def lab_of(color: NDArray[np.float32], *, is_data: bool = False, is_float: bool = False) -> NDArray[np.float32]:
    """CIELAB of linear colours; of data as if they were encoded. Floats are exposed so that few are beyond white."""
    if is_float and not is_data:
        color = color / max(float(np.percentile(color, _WHITE_PERCENTILE)), 1e-6)  # 1e-6 guards a black photo
    clipped = np.clip(color, 0, 1)
    return cv2.cvtColor(clipped if is_data else linear_to_srgb(clipped), cv2.COLOR_RGB2Lab)


def open_photo(path: str | Path, *, is_data: bool = False) -> ElementPhoto:
    """Read a photo of any format that OpenImageIO knows.

    Raises
    ------
    FexelError
        The file is missing, damaged, no image, in CMYK or larger than 2^28 pixels.

    Warns
    -----
    FexelWarning
        Values that are NaN or infinite: colours there are taken from neighbours.
    """
    photo = probe_photo(path, min_side_px=1)
    _refuse_cmyk(str(path))
    if photo.width * photo.height > _MOST_PIXELS:
        raise FexelError(f"{path}: {photo.width} x {photo.height} pixels, expected at most {_MOST_PIXELS} in all")
    stored = upright(read_stored_pixels(photo, _STORED[photo.pixel_type]), photo.orientation)
    warn_of_non_finite(photo, stored)
    return ElementPhoto(Path(path), photo, stored, is_data)


def _refuse_cmyk(file: str) -> None:
    """OpenImageIO would convert it without its profile, to colours that nobody meant."""
    image = oiio.ImageInput.open(file)
    if image is None:
        return
    space = next((text for name in _SPACES if (text := image.spec().get_string_attribute(name))), "")
    image.close()
    if space.upper() in ("CMYK", "YCCK"):
        raise FexelError(f"{file}: its colours are {space}, expected RGB or grey")
