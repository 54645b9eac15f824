"""What an image file says about itself: size, channels, type, alpha, colour space, mip levels, wrap modes."""

from __future__ import annotations

import os
from dataclasses import dataclass

import OpenImageIO as oiio

from fexel.errors import FexelError
from fexel.images.png_chunks import png_fault
from fexel.packages import local_file

__all__ = ["UNASSOCIATED", "ImageInfo", "image_info", "open_image", "reason", "stores_straight_alpha"]

UNASSOCIATED = "oiio:UnassociatedAlpha"
# PNG, GIF, BMP, WebP and their like store straight colour by definition, whether OpenImageIO says so or not.
_ASSOCIATED_UNLESS_FLAGGED = ("openexr", "tiff", "targa", "rla", "iff")


@dataclass(frozen=True)
class ImageInfo:
    """What a file says about itself.

    Attributes
    ----------
    path : str
    width, height : int
        Texels of level 0.
    channels : int
        Channels in the file; 1 and 2 are grey, grey and alpha.
    alpha_channel : int
        Index, or -1.
    alpha_associated : bool
        Colour is already multiplied by alpha in the file.
    dtype : str
        ``uint8``, ``uint16``, ``float16`` or ``float32`` (other formats are converted to the nearest of these).
    color_space : str
        ``sRGB`` or ``raw``: what UsdUVTexture's `auto` resolves to.
    level_sizes : tuple of (int, int)
        Width and height of each mip level stored in the file; at least level 0.
    tiled : bool
        Windows can be read without reading whole rows.
    wrap : (str, str)
        UsdUVTexture's tokens for the file's ``wrapmodes`` along s and t (TIFF, EXR); ``black`` where it has none.
    """

    path: str
    width: int
    height: int
    channels: int
    alpha_channel: int
    alpha_associated: bool
    dtype: str
    color_space: str
    level_sizes: tuple[tuple[int, int], ...]
    tiled: bool
    wrap: tuple[str, str] = ("black", "black")


def open_image(path: str) -> oiio.ImageInput:
    """A reader that leaves straight colour unmultiplied. Raises `FexelError`: missing or unreadable file."""
    file = local_file(path)
    if not os.path.exists(file):
        raise FexelError(f"{path}: no such file")
    if fault := png_fault(file, header=True):
        raise FexelError(f"{path}: {fault}")
    keep_unassociated = oiio.ImageSpec()
    keep_unassociated.attribute(UNASSOCIATED, 1)
    handle = oiio.ImageInput.open(file, keep_unassociated)
    if handle is None:
        raise FexelError(f"{path}: {reason(oiio.geterror())}")
    return handle


def reason(message: str) -> str:
    """OpenImageIO's message in one line."""
    return " ".join(message.split()) or "not an image that OpenImageIO can read"


_DTYPES = {"uint8": "uint8", "int8": "uint8", "uint16": "uint16", "int16": "uint16", "half": "float16"}


def image_info(path: str) -> ImageInfo:
    """Read a file's header.

    Raises
    ------
    FexelError
        Missing or unreadable file, or one without a pixel.
    """
    handle = open_image(path)
    try:
        spec = handle.spec()
        sizes = []
        while handle.seek_subimage(0, len(sizes)):
            level = handle.spec()
            sizes.append((level.width, level.height))
        if spec.width < 1 or spec.height < 1 or spec.nchannels < 1:
            raise FexelError(f"{path}: {spec.width} x {spec.height} pixels of {spec.nchannels} channels")
        dtype = _DTYPES.get(str(spec.format), "float32")
        return ImageInfo(
            path=path,
            width=spec.width,
            height=spec.height,
            channels=spec.nchannels,
            alpha_channel=_alpha_channel(spec),
            alpha_associated=not stores_straight_alpha(handle.format_name(), spec),
            dtype=dtype,
            color_space=_auto_color_space(spec, dtype),
            level_sizes=_regular_levels(sizes),
            tiled=spec.tile_width > 0,
            wrap=_wrap_modes(spec.get_string_attribute("wrapmodes")),
        )
    finally:
        handle.close()


def stores_straight_alpha(format_name: str, spec: oiio.ImageSpec) -> bool:
    """Whether a file's colour is not multiplied by its alpha.

    Parameters
    ----------
    format_name : str
        Of OpenImageIO's reader.
    spec : OpenImageIO.ImageSpec
        Opened with the hint ``oiio:UnassociatedAlpha`` = 1, so that the reader has not multiplied.
    """
    flagged = any(spec.get_int_attribute(name, 0) for name in (UNASSOCIATED, "tiff:UnassociatedAlpha"))
    return flagged or format_name not in _ASSOCIATED_UNLESS_FLAGGED


def _alpha_channel(spec: oiio.ImageSpec) -> int:
    if 0 <= spec.alpha_channel < spec.nchannels:  # of a GIF with alpha OpenImageIO 3.2 says 4, of 4 channels
        return spec.alpha_channel
    return spec.nchannels - 1 if spec.nchannels in (2, 4) else -1


def _auto_color_space(spec: oiio.ImageSpec, dtype: str) -> str:
    """As UsdUVTexture's `auto`: what the file says; sRGB for 8-bit images of 3 or 4 channels; else raw."""
    if dtype == "uint8":
        declared = spec.get_string_attribute("oiio:ColorSpace").lower()
        linear = declared in ("linear", "raw", "data") or declared.startswith(("lin_", "lin ", "scene_linear"))
        return "sRGB" if spec.nchannels >= 3 and not linear else "raw"
    return "raw"


def _wrap_modes(text: str) -> tuple[str, str]:
    """OpenImageIO's ``wrapmodes``: one word, or two for s and t."""
    known = {"periodic": "repeat", "periodic_pow2": "repeat", "clamp": "clamp", "mirror": "mirror"}
    modes = [known.get(word.strip().lower(), "black") for word in text.split(",")]
    return modes[0], modes[-1]


def _regular_levels(sizes: list[tuple[int, int]]) -> tuple[tuple[int, int], ...]:
    """The leading levels whose sizes halve as `mipmaps.level_size` says; others cannot be addressed."""
    width, height = sizes[0]
    regular = [size for level, size in enumerate(sizes) if size == (max(1, width >> level), max(1, height >> level))]
    return tuple(regular[: next((i for i, size in enumerate(sizes) if size not in regular), len(regular))])
