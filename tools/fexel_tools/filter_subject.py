"""The image that filters are compared on: any file, or the middle of a large one, as texels and as a file of its own.

A copy is what the renderer reads, so that chains of it are kept, and thrown away, with the copy: nothing is written
beside the user's file. 8- and 16-bit files are copied value by value, all others as linear, premultiplied floats, what
is no finite number as the renderer reads it (`fexel.images`).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError, FexelWarning
from fexel.images import image_info, read_linear, read_pixels
from fexel.images.header import ImageInfo
from fexel.images.linear import to_linear
from fexel.textures.image_source import ImageSource
from fexel_tools.image_files import write_image

__all__ = ["WRAPS", "Subject", "drawn_subject", "open_subject"]

WRAPS = ("repeat", "mirror", "clamp", "black")

_PEAK = 99.9  # percentile of linear values that counts as white where an image is brighter than 1


@dataclass(frozen=True, eq=False)
class Subject:
    """An image to compare filters on.

    Attributes
    ----------
    name : str
        As the user gave it.
    file_size : (int, int)
        Width and height of the file.
    window : (int, int, int, int)
        Left, top, right, bottom of the part that is looked at, texels of the file.
    image : (H, W, 4) float32
        That part; linear, premultiplied.
    source : ImageSource
        Its copy.
    is_data : bool
        Values are no colours: compared as they are.
    vectors : bool
        Values are those of a normal map: filtered vectors are renormalised, and compared so.
    white : float
        Linear value that is shown, and compared, as 1.
    """

    name: str
    file_size: tuple[int, int]
    window: tuple[int, int, int, int]
    image: NDArray[np.float32]
    source: ImageSource
    is_data: bool = False
    vectors: bool = False
    white: float = 1.0

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of what is looked at."""
        return self.image.shape[1], self.image.shape[0]


def open_subject(
    file: str, folder: Path, *, largest: int, wrap: str, raw: bool = False, vectors: bool = False
) -> Subject:
    """Read an image, or the middle of it.

    Parameters
    ----------
    file : str
    folder : Path
        Where to put the copy.
    largest : int
        Most texels a side; only so much of a larger file is read.
    wrap : str
        Along both axes: one of `WRAPS`.
    raw : bool
        The file holds data.
    vectors : bool
        The file holds a normal map, which is data too.

    Raises
    ------
    FexelError
        Missing, damaged or unreadable file.

    Warns
    -----
    FexelWarning
        Values that are no finite numbers.
    """
    info = image_info(file)
    window = _middle(info.width, info.height, largest)
    pixels = read_pixels(info, 0, window)
    _warn_of_no_numbers(file, pixels)
    color_space = "raw" if raw or vectors else info.color_space
    copy = _copied(folder, pixels, info, color_space)
    image = read_linear(str(copy), color_space if copy.suffix == ".png" else "raw")
    source = ImageSource(str(copy), color_space=color_space if copy.suffix == ".png" else "raw", wrap=(wrap, wrap))
    is_data = raw or vectors
    white = 1.0 if is_data else max(1.0, float(np.percentile(image[..., :3], _PEAK)))
    return Subject(file, (info.width, info.height), window, image, source, is_data, vectors, white)


def drawn_subject(name: str, texels: NDArray[np.uint8], folder: Path, wrap: str = "repeat") -> Subject:
    """A picture (H, W, 3) uint8, sRGB-encoded, as a subject."""
    path = folder / f"{name.replace(' ', '_')}.png"
    write_image(path, texels)
    height, width = texels.shape[:2]
    source = ImageSource(str(path), color_space="sRGB", wrap=(wrap, wrap))
    return Subject(name, (width, height), (0, 0, width, height), read_linear(str(path), "sRGB"), source)


def _middle(width: int, height: int, largest: int) -> tuple[int, int, int, int]:
    across, down = min(width, largest), min(height, largest)
    left, top = (width - across) // 2, (height - down) // 2
    return left, top, left + across, top + down


def _warn_of_no_numbers(file: str, pixels: NDArray) -> None:
    if pixels.dtype.kind != "f":
        return
    wrong = int((~np.isfinite(pixels)).any(axis=-1).sum())
    if wrong:
        texels = pixels.shape[0] * pixels.shape[1]
        found = f"{file}: {wrong} of {texels} texels hold NaN or infinity, expected finite values"
        warnings.warn(f"{found}; NaN counts as 0, infinity as 65504, as when rendered", FexelWarning, stacklevel=3)


def _copied(folder: Path, pixels: NDArray, info: ImageInfo, color_space: str) -> Path:
    """A PNG of the same values where that is the same image, else an EXR of what they mean."""
    if not pixels.size:
        raise FexelError(f"{info.path}: has no pixels")
    plain = info.channels in (1, 3) or (info.channels == 4 and info.alpha_channel == 3)
    if pixels.dtype.kind == "u" and plain and not (info.alpha_channel >= 0 and info.alpha_associated):
        path = folder / "image.png"
        write_image(path, pixels, color_space, is_photo=True)
        return path
    path = folder / "image.exr"
    write_image(path, to_linear(pixels, info, color_space), "raw")
    return path
