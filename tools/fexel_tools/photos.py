"""Photographs: any format that OpenImageIO reads, upright, in linear Rec.709, with their alpha as a hand-made mask.

A photo is probed once (`probe_photo`: size, format, colour space; nothing decoded) and decoded whenever its pixels are
needed (`load_photo`, `load_preview`), so that a run over many photos never holds them all.

Conventions
-----------
*Upright*: the EXIF orientation is applied at once; sizes and pixel coordinates everywhere else are those of the photo
as displayed. Images are (H, W, 3) float32, linear Rec.709, row 0 at the top; grey photos are replicated. Alpha is
(H, W) float32 in 0..1, never multiplied into the colours (associated files are divided on reading).

Colour spaces: see `photo_color`.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio

from fexel.errors import FexelError, FexelWarning
from fexel.images import image_info, linear_to_srgb, png_fault, read_pixels, stores_straight_alpha
from fexel_tools.photo_color import SRGB_NAMES, decode_srgb_uint8, file_color_space, to_linear_rec709

__all__ = [
    "MIN_SIDE_PX",
    "Photo",
    "check_mask",
    "load_photo",
    "load_preview",
    "probe_photo",
    "read_stored_pixels",
    "upright",
]

MIN_SIDE_PX = 16  # below this neither features nor a patch with a rim can be had


@dataclass(frozen=True)
class Photo:
    """What is known of a photo without decoding it.

    Attributes
    ----------
    file : str
        The name as the user gave it; the photo's identity in reports and messages.
    width, height : int
        Pixels, upright.
    channel_indices : tuple of int
        Channels of the file that are red, green, blue (or one grey), then alpha if any.
    has_alpha, associated_alpha : bool
    pixel_type : str
        ``uint8``, ``uint16``, ``half`` or ``float``: what the file stores, wider integers counted as ``uint16``.
    color_space : str
        Of OpenImageIO's built-in configuration, or ``chromaticities`` (linear, primaries in `chromaticities`).
    orientation : int
        EXIF, 1 to 8, as stored; already applied to everything that this package returns.
    subimage : int
        Part of a multi-part file.
    chromaticities : tuple of 8 float or None
        CIE xy of red, green, blue and white.
    """

    file: str
    width: int
    height: int
    channel_indices: tuple[int, ...]
    has_alpha: bool
    associated_alpha: bool
    pixel_type: str
    color_space: str
    orientation: int = 1
    subimage: int = 0
    chromaticities: tuple[float, ...] | None = None

    @property
    def is_float(self) -> bool:
        """Whether values may exceed 1."""
        return self.pixel_type in ("half", "float")

    @property
    def is_srgb(self) -> bool:
        """Whether the stored values are sRGB-encoded Rec.709."""
        return self.color_space in SRGB_NAMES


def probe_photo(file: str | Path, *, min_side_px: int = MIN_SIDE_PX) -> Photo:
    """Read the header of a photo.

    Raises
    ------
    FexelError
        The file is missing, unreadable, not an image, smaller than `min_side_px`, or holds deep or volume data.
    """
    file = str(file)
    if not Path(file).is_file():
        raise FexelError(f"{file}: no such file" if not Path(file).exists() else f"{file}: not a file")
    image = _open(file)
    try:
        subimage, spec, channels = _color_part(file, image)
        _check_spec(file, spec, min_side_px)
    finally:
        image.close()
    has_alpha = len(channels) in (2, 4)
    orientation = int(spec.get_int_attribute("Orientation", 1))
    orientation = orientation if 1 <= orientation <= 8 else 1
    width, height = spec.full_width, spec.full_height
    color_space, chromaticities = file_color_space(file, spec, _pixel_type(spec) in ("half", "float"))
    return Photo(
        file=file,
        width=height if orientation >= 5 else width,
        height=width if orientation >= 5 else height,
        channel_indices=channels,
        has_alpha=has_alpha,
        associated_alpha=has_alpha and not stores_straight_alpha(image.format_name(), spec),
        pixel_type=_pixel_type(spec),
        color_space=color_space,
        orientation=orientation,
        subimage=subimage,
        chromaticities=chromaticities,
    )


def check_mask(file: str | Path) -> None:
    """Decode a hand-made mask once, so that a damaged one is told before any work.

    Raises
    ------
    FexelError
        The file is missing, unreadable or ends early.
    """
    read_pixels(image_info(str(file)))


def load_photo(photo: Photo) -> tuple[np.ndarray, np.ndarray | None]:
    """Decode a photo to linear light.

    Returns
    -------
    rgb : (H, W, 3) float32
        Linear Rec.709, upright; never NaN, infinite or negative (see `Warns`).
    alpha : (H, W) float32 or None
        The hand-made mask, 0..1; None where the file has no alpha.

    Raises
    ------
    FexelError
        The file ends early or cannot be decoded.

    Warns
    -----
    FexelWarning
        NaN or infinite pixels were found; they become black, and transparent.
    """
    pixels = read_stored_pixels(photo, oiio.UINT8 if photo.pixel_type == "uint8" else oiio.FLOAT)
    color = pixels[..., : pixels.shape[2] - photo.has_alpha]
    alpha = np.ascontiguousarray(pixels[..., -1]) if photo.has_alpha else None
    if alpha is not None and alpha.dtype == np.uint8:
        alpha = alpha.astype(np.float32) / 255.0
    if color.dtype != np.uint8:
        color, alpha = _without_nan(photo, color, alpha)
        alpha = None if alpha is None else np.clip(alpha, 0.0, 1.0)
    if color.dtype == np.uint8 and photo.is_srgb and not photo.associated_alpha:
        rgb = decode_srgb_uint8(color)
    else:
        color = color.astype(np.float32) / 255.0 if color.dtype == np.uint8 else color
        rgb = _to_linear(photo, color, alpha)
    rgb = np.repeat(rgb, 3, axis=2) if rgb.shape[2] == 1 else rgb
    return np.ascontiguousarray(upright(rgb, photo.orientation)), _upright_mask(alpha, photo.orientation)


def load_preview(photo: Photo, max_pixels: int | None = None) -> np.ndarray:
    """Decode a photo for matching: sRGB-encoded 8-bit, at most `max_pixels` (area-filtered).

    Float photos are exposed so that their 99th percentile becomes white. Masked-out pixels keep their colour.

    Returns
    -------
    (H, W, 3) uint8
        sRGB-encoded, upright. Size: `preview_size`.
    """
    if photo.pixel_type == "uint8" and not photo.associated_alpha:
        pixels = read_stored_pixels(photo, oiio.UINT8)
        pixels = pixels[..., : pixels.shape[2] - photo.has_alpha]
        image = upright(
            np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels,
            photo.orientation,
        )
        return _at_most(np.ascontiguousarray(image), max_pixels)
    linear, _ = load_photo(photo)
    linear = _at_most(linear, max_pixels)
    if photo.is_float:
        white = float(np.percentile(linear[::4, ::4], 99.0))
        linear = linear / max(white, 1e-6)  # guards an all-black photo
    return np.rint(linear_to_srgb(np.clip(linear, 0.0, 1.0)) * 255.0).astype(np.uint8)


def _open(file: str) -> oiio.ImageInput:
    if fault := png_fault(file, header=True):
        raise FexelError(f"{file}: {fault}")
    hints = oiio.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)  # give alpha as stored: no multiplication of encoded values
    image = oiio.ImageInput.open(file, hints)
    if image is None:
        raise FexelError(f"{file}: cannot be read: {_one_line(oiio.geterror())}")
    return image


def _one_line(text: str) -> str:
    return " ".join((text or "unknown error").replace('"', "'").split())


def _color_part(file: str, image: oiio.ImageInput) -> tuple[int, oiio.ImageSpec, tuple[int, ...]]:
    """The first part of the file that has colours, and which channels they are."""
    for subimage in range(64):
        if not image.seek_subimage(subimage, 0):
            break
        spec = image.spec()
        channels = _color_channels(list(spec.channelnames), spec.nchannels)
        if channels:
            return subimage, spec.copy(), channels
    raise FexelError(f"{file}: no colour channels found, expected R, G, B or one grey channel")


def _color_channels(names: list[str], count: int) -> tuple[int, ...]:
    lower = [name.lower() for name in names]
    alpha = (lower.index("a"),) if "a" in lower else ()
    if all(c in lower for c in "rgb"):
        return (*(lower.index(c) for c in "rgb"), *alpha)
    for grey in ("y", "i", "l", "z"):
        if grey in lower and grey != "z":
            return (lower.index(grey), *alpha)
    layers = [name[:-2] for name in lower if name.endswith(".r")]
    for layer in layers:
        if f"{layer}.g" in lower and f"{layer}.b" in lower:
            wanted = [f"{layer}.{c}" for c in "rgba"]
            return tuple(lower.index(c) for c in wanted if c in lower)
    if count == 1 and lower[0] not in ("z", "depth"):
        return (0,)
    return ()


def _check_spec(file: str, spec: oiio.ImageSpec, min_side_px: int) -> None:
    if spec.deep or spec.depth > 1:
        raise FexelError(f"{file}: holds {'deep' if spec.deep else 'volume'} data, expected a flat image")
    if min(spec.full_width, spec.full_height) < min_side_px:
        size = f"{spec.full_width} x {spec.full_height}"
        raise FexelError(f"{file}: {size} pixels, expected at least {min_side_px} on each side")


def _pixel_type(spec: oiio.ImageSpec) -> str:
    name = str(spec.format)
    if name in ("half", "float", "double"):
        return "half" if name == "half" else "float"
    return "uint8" if name in ("uint8", "int8") else "uint16"


def read_stored_pixels(photo: Photo, pixel_type: oiio.BASETYPE) -> np.ndarray:
    """The channels of the photo, as stored, in the display window: (H, W, C), not yet upright.

    Raises
    ------
    FexelError
        The file ends early or cannot be decoded.
    """
    image = _open(photo.file)
    try:
        if fault := png_fault(photo.file):
            raise FexelError(f"{photo.file}: {fault}")
        if photo.subimage:
            image.seek_subimage(photo.subimage, 0)
        spec = image.spec()
        pixels = image.read_image(photo.subimage, 0, 0, spec.nchannels, pixel_type)
        error = image.geterror()
    finally:
        image.close()
    if pixels is None or error:
        raise FexelError(f"{photo.file}: cannot be decoded: {_one_line(error)}")
    pixels = np.asarray(pixels).reshape(spec.height, spec.width, spec.nchannels)
    if photo.channel_indices != tuple(range(spec.nchannels)):
        pixels = pixels[..., list(photo.channel_indices)]
    return _display_window(pixels, spec)


def _display_window(pixels: np.ndarray, spec: oiio.ImageSpec) -> np.ndarray:
    x, y = spec.x - spec.full_x, spec.y - spec.full_y
    if (x, y, spec.width, spec.height) == (0, 0, spec.full_width, spec.full_height):
        return pixels
    window = np.zeros((spec.full_height, spec.full_width, pixels.shape[2]), pixels.dtype)
    x0, y0 = max(x, 0), max(y, 0)
    x1, y1 = (
        min(x + spec.width, spec.full_width),
        min(y + spec.height, spec.full_height),
    )
    if x1 > x0 and y1 > y0:
        window[y0:y1, x0:x1] = pixels[y0 - y : y1 - y, x0 - x : x1 - x]
    return window


def _without_nan(photo: Photo, color: np.ndarray, alpha: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None]:
    good = np.isfinite(color).all(axis=2)
    if alpha is not None:
        good &= np.isfinite(alpha)
    if good.all():
        return color, alpha
    count = int(good.size - np.count_nonzero(good))
    message = f"{photo.file}: {count} pixels are NaN or infinite; they become black and transparent"
    warnings.warn(message, FexelWarning, stacklevel=3)
    alpha = np.ones(good.shape, np.float32) if alpha is None else alpha
    return np.where(good[..., None], color, np.float32(0.0)), np.where(good, alpha, np.float32(0.0))


def _to_linear(photo: Photo, color: np.ndarray, alpha: np.ndarray | None) -> np.ndarray:
    if photo.associated_alpha and alpha is not None:
        color = np.where(alpha[..., None] > 0.0, color / np.maximum(alpha, 1e-6)[..., None], 0.0).astype(np.float32)
    try:
        return to_linear_rec709(color, photo.color_space, photo.chromaticities)
    except FexelError as error:
        raise FexelError(f"{photo.file}: {error}") from None


def upright(image: np.ndarray, orientation: int) -> np.ndarray:
    """Rows and columns in the order in which they are displayed, by EXIF orientation (1 to 8); a view."""
    if orientation >= 5:
        image = image.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        image = image[::-1] if orientation != 7 else image[::-1, ::-1]
    if orientation in (2, 3, 6):
        image = image[:, ::-1]
    return image


def _upright_mask(alpha: np.ndarray | None, orientation: int) -> np.ndarray | None:
    return None if alpha is None else np.ascontiguousarray(upright(alpha, orientation))


def _at_most(image: np.ndarray, max_pixels: int | None) -> np.ndarray:
    height, width = image.shape[:2]
    if max_pixels is None or width * height <= max_pixels:
        return image
    ratio = (max_pixels / (width * height)) ** 0.5
    size = (max(1, round(width * ratio)), max(1, round(height * ratio)))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)
