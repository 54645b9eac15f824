"""Pictures without mip levels (fallbacks, signals, pinchmaps, sheets), written beside and renamed."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from fexel.errors import FexelError

__all__ = ["write_image"]

_TYPES = {"uint8": "uint8", "uint16": "uint16", "float16": "half", "float32": "float"}
# Deflate level of PNG. Measured on a 512 x 512 RGBA picture of a drawing: 26 ms and 154 kB; the library's 6 takes 52 ms
# and 127 kB, 1 takes 23 ms and 172 kB.
_PNG_LEVEL = 3
# Photographs gain nothing from a search for repeats: of 2048 x 768 pixels of leaves, Paeth's filter and runs take
# 0.07 s and 3.00 MB; all filters tried and repeats searched for take 0.33 s and 3.08 MB.
_PHOTO_FILTER, _PHOTO_STRATEGY = 64, "rle"
_COLOR_SPACES = {"sRGB": "srgb_rec709_scene", "raw": "lin_rec709_scene"}


def write_image(path: str | Path, pixels: np.ndarray, color_space: str = "sRGB", *, is_photo: bool = False) -> None:
    """Write an image as it is.

    Parameters
    ----------
    path : str or Path
        Its extension chooses the format.
    pixels : (H, W, C) uint8, uint16, float16 or float32
        Values as the file stores them, row 0 at the top. A fourth channel is straight alpha (or data) in integer
        formats, associated alpha in EXR.
    color_space : str
        ``sRGB`` or ``raw``: what the values are, noted in the file where the format can.
    is_photo : bool
        Its detail is like that of a photograph, not of a drawing: a PNG is written in a fifth of the time.

    Raises
    ------
    FexelError
        The file cannot be written.
    """
    path = Path(path)
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, _TYPES[pixels.dtype.name])
    spec.attribute("oiio:ColorSpace", _COLOR_SPACES[color_space])
    if channels == 4 and pixels.dtype.kind == "u":
        spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.attribute("DateTime", "")  # none: the same picture makes the same bytes
    spec.attribute("CompressionQuality", 95)  # of JPEG
    spec.attribute("png:compressionLevel", _PNG_LEVEL)
    if is_photo and path.suffix.lower() == ".png":
        spec.attribute("compression", _PHOTO_STRATEGY)
        spec.attribute("png:filter", _PHOTO_FILTER)
    beside = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        writer = oiio.ImageOutput.create(str(beside))
        ok = writer is not None and writer.open(str(beside), spec) and writer.write_image(pixels) and writer.close()
        if not ok:
            fault = " ".join((writer.geterror() if writer else oiio.geterror()).split())
            raise FexelError(f"{path}: cannot be written: {fault or 'no reason given'}")
        beside.replace(path)
    except OSError as error:
        raise FexelError(f"{path}: cannot be written: {error.strerror}") from error
    finally:
        beside.unlink(missing_ok=True)
