"""Images through OpenImageIO: what a file holds, one mip level or window of it, linear premultiplied float from any of
them.

Colour: `sRGB` files are decoded with the sRGB transfer function, `raw` files are taken as they are. Alpha: what comes
out is always premultiplied (associated) in linear light. PNG and other files with unassociated alpha are decoded, then
multiplied. Files whose alpha is associated and whose values are sRGB-encoded are divided by alpha first, since they
were encoded after multiplying. EXR and other float files may hold NaN, infinities and negative alpha: NaN becomes 0,
infinities the largest half float (65504), alpha is clamped to [0, 1]; so no such value reaches a filter.

Rows run down from the top, as in the file.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel.packages import local_file

__all__ = [
    "ImageInfo",
    "image_info",
    "linear_to_srgb",
    "read_linear",
    "read_mask",
    "read_pixels",
    "read_strips",
    "srgb_to_linear",
    "stores_straight_alpha",
    "to_linear",
    "write_pyramid",
]

_LARGEST_HALF = 65504.0
_UNASSOCIATED = "oiio:UnassociatedAlpha"
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


def _open(path: str) -> oiio.ImageInput:
    file = local_file(path)
    if not os.path.exists(file):
        raise FexelError(f"{path}: no such file")
    keep_unassociated = oiio.ImageSpec()
    keep_unassociated.attribute(_UNASSOCIATED, 1)
    handle = oiio.ImageInput.open(file, keep_unassociated)
    if handle is None:
        raise FexelError(f"{path}: {_reason(oiio.geterror())}")
    return handle


def _reason(message: str) -> str:
    return " ".join(message.split()) or "not an image that OpenImageIO can read"


_DTYPES = {"uint8": "uint8", "int8": "uint8", "uint16": "uint16", "int16": "uint16", "half": "float16"}


def image_info(path: str) -> ImageInfo:
    """Read a file's header.

    Raises
    ------
    FexelError
        Missing or unreadable file, or one without a pixel.
    """
    handle = _open(path)
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
    flagged = any(spec.get_int_attribute(name, 0) for name in (_UNASSOCIATED, "tiff:UnassociatedAlpha"))
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


def read_pixels(info: ImageInfo, level: int = 0, window: tuple[int, int, int, int] | None = None) -> NDArray:
    """Texels as the file stores them.

    Parameters
    ----------
    info : ImageInfo
    level : int
        One of ``info.level_sizes``.
    window : (x0, y0, x1, y1), optional
        Half-open, in texels of that level, y down from the top; default all.

    Returns
    -------
    (y1 - y0, x1 - x0, channels) of dtype ``info.dtype``

    Raises
    ------
    FexelError
        Truncated or damaged data.
    """
    width, height = info.level_sizes[level]
    handle = _open(info.path)
    try:
        return _read_window(handle, info, level, window or (0, 0, width, height))
    finally:
        handle.close()


def read_strips(info: ImageInfo, rows: int) -> Iterator[NDArray]:
    """Level 0 from top to bottom, about `rows` rows at a time, as `read_pixels` returns them. Raises as that does."""
    handle = _open(info.path)
    try:
        if info.tiled:
            tile = handle.spec().tile_height
            rows = -(-rows // tile) * tile
        for y0 in range(0, info.height, rows):
            yield _read_window(handle, info, 0, (0, y0, info.width, min(y0 + rows, info.height)))
    finally:
        handle.close()


def _read_window(handle: oiio.ImageInput, info: ImageInfo, level: int, window: tuple[int, int, int, int]) -> NDArray:
    x0, y0, x1, y1 = window
    width = info.level_sizes[level][0]
    handle.seek_subimage(0, level)
    if info.tiled:
        pixels = _read_tiles(handle, level, window, info.dtype)
    else:
        pixels = handle.read_scanlines(0, level, y0, y1, 0, 0, info.channels, _oiio_type(info.dtype))
        pixels = None if pixels is None else pixels.reshape(y1 - y0, width, info.channels)[:, x0:x1]
    if pixels is None or handle.has_error:
        raise FexelError(f"{info.path}: {_reason(handle.geterror())}")
    return pixels


def _oiio_type(dtype: str) -> str:
    return {"float16": "half", "float32": "float"}.get(dtype, dtype)


def _read_tiles(handle: oiio.ImageInput, level: int, window: tuple[int, int, int, int], dtype: str) -> NDArray | None:
    x0, y0, x1, y1 = window
    spec = handle.spec()
    left, top = x0 // spec.tile_width * spec.tile_width, y0 // spec.tile_height * spec.tile_height
    right = min(spec.width, -(-x1 // spec.tile_width) * spec.tile_width)
    bottom = min(spec.height, -(-y1 // spec.tile_height) * spec.tile_height)
    tiles = handle.read_tiles(
        0,
        level,
        spec.x + left,
        spec.x + right,
        spec.y + top,
        spec.y + bottom,
        spec.z,
        spec.z + 1,
        0,
        spec.nchannels,
        _oiio_type(dtype),
    )
    if tiles is None:
        return None
    tiles = tiles.reshape(bottom - top, right - left, spec.nchannels)
    return tiles[y0 - top : y1 - top, x0 - left : x1 - left]


def srgb_to_linear(encoded: NDArray[np.floating]) -> NDArray[np.float32]:
    """sRGB decoding (IEC 61966-2-1), continued beyond [0, 1] with odd symmetry."""
    encoded = np.asarray(encoded, np.float32)
    magnitude = np.abs(encoded)
    decoded = np.where(magnitude <= 0.04045, magnitude / 12.92, ((magnitude + 0.055) / 1.055) ** 2.4)
    return np.copysign(decoded, encoded).astype(np.float32)


def linear_to_srgb(linear: NDArray[np.floating]) -> NDArray[np.float32]:
    """sRGB encoding (IEC 61966-2-1), continued beyond [0, 1] with odd symmetry."""
    linear = np.asarray(linear, np.float32)
    magnitude = np.abs(linear)
    # 1e-12 keeps the power of an exact zero out of the branch that np.where discards.
    encoded = np.where(
        magnitude <= 0.0031308, magnitude * 12.92, 1.055 * np.maximum(magnitude, 1e-12) ** (1 / 2.4) - 0.055
    )
    return np.copysign(encoded, linear).astype(np.float32)


_SRGB8 = srgb_to_linear(np.arange(256) / np.float32(255))


def to_linear(
    pixels: NDArray, info: ImageInfo, color_space: str = "auto", mask: NDArray[np.float32] | None = None
) -> NDArray[np.float32]:
    """File values to linear, premultiplied RGBA.

    Parameters
    ----------
    pixels : (H, W, C)
        From `read_pixels`.
    info : ImageInfo
    color_space : str
        ``auto``, ``raw`` or ``sRGB``.
    mask : (H, W) float32, optional
        Alpha in [0, 1] that replaces the file's own; straight colour is kept where the file is transparent.

    Returns
    -------
    (H, W, 4) float32
        Finite; alpha in [0, 1], 1 where the file has none.
    """
    srgb = (info.color_space if color_space == "auto" else color_space) == "sRGB"
    colour_channels = [c for c in range(info.channels) if c != info.alpha_channel][:3]
    rgba = np.empty((*pixels.shape[:2], 4), np.float32)
    rgba[..., 3] = 1.0
    if info.alpha_channel >= 0:
        rgba[..., 3] = np.clip(_as_float(pixels[..., info.alpha_channel]), 0.0, 1.0)
    alpha = rgba[..., 3:]
    if len(colour_channels) < 3:
        colour_channels = (colour_channels or [0])[:1] * 3
    stored = pixels[..., colour_channels]
    associated = info.alpha_associated and info.alpha_channel >= 0
    if srgb and stored.dtype == np.uint8 and not associated:
        rgba[..., :3] = _SRGB8[stored]
    elif srgb:
        colour = _as_float(stored)
        rgba[..., :3] = srgb_to_linear(_straight(colour, alpha) if associated else colour)
    else:
        colour = _as_float(stored)
        rgba[..., :3] = _straight(colour, alpha) if associated and mask is not None else colour
    if mask is not None:
        rgba[..., 3] = mask
    if mask is not None or (info.alpha_channel >= 0 and (srgb or not associated)):
        rgba[..., :3] *= rgba[..., 3:]
    return rgba


def _straight(colour: NDArray[np.float32], alpha: NDArray[np.float32]) -> NDArray[np.float32]:
    """Associated colour divided by alpha; as it is where alpha is 0."""
    return np.where(alpha > 0, colour / np.maximum(alpha, 1e-6), colour)  # 1e-6 guards nearly transparent texels


def _as_float(values: NDArray) -> NDArray[np.float32]:
    """Integers to [0, 1]; floats cleaned of NaN and infinities."""
    if values.dtype.kind == "u":
        return values.astype(np.float32) / np.float32(np.iinfo(values.dtype).max)
    return np.nan_to_num(values.astype(np.float32), nan=0.0, posinf=_LARGEST_HALF, neginf=-_LARGEST_HALF).clip(
        -_LARGEST_HALF, _LARGEST_HALF
    )


def read_linear(path: str, color_space: str = "auto") -> NDArray[np.float32]:
    """A whole file as (H, W, 4) float32, linear, premultiplied. Raises `FexelError` as `image_info` and `read_pixels`
    do.
    """
    info = image_info(path)
    return to_linear(read_pixels(info), info, color_space)


def read_mask(path: str, size: tuple[int, int]) -> NDArray[np.float32]:
    """The first channel of a file, raw, resampled to `size`.

    Parameters
    ----------
    path : str
    size : (int, int)
        Width and height.

    Returns
    -------
    (height, width) float32
        In [0, 1].

    Raises
    ------
    FexelError
        As `image_info` and `read_pixels`.
    """
    info = image_info(path)
    mask = _as_float(read_pixels(info)[..., 0]).clip(0.0, 1.0)
    if (info.width, info.height) == size:
        return mask
    buffer = oiio.ImageBuf(np.ascontiguousarray(mask[..., None]))
    resized = oiio.ImageBufAlgo.resize(buffer, roi=oiio.ROI(0, size[0], 0, size[1]), filtername="triangle")
    return np.asarray(resized.get_pixels(oiio.FLOAT))[..., 0].clip(0.0, 1.0)


def write_pyramid(
    path: str, levels: Iterable[NDArray], dtype: str = "uint8", color_space: str = "sRGB", tile: int = 64
) -> None:
    """Write a tiled, mip-mapped TIFF or EXR that `read_pixels` loads in part; written beside, then renamed.

    Parameters
    ----------
    path : str
        ``.tif``, ``.tiff`` (any dtype, unassociated alpha) or ``.exr`` (float16, float32, linear, associated alpha).
    levels : iterable of (H, W, 3 or 4) float32
        Linear, premultiplied, from `mipmaps.pyramid`; or of type `dtype` if that is an integer type: values as the file
        shall hold them.
    dtype : str
        ``uint8``, ``uint16``, ``float16`` or ``float32``.
    color_space : str
        ``sRGB`` encodes the colour; ``raw`` stores it as it is.

    Raises
    ------
    FexelError
        The file cannot be written.
    """
    exr = path.lower().endswith(".exr")
    levels = iter(levels)  # one at a time: they need not be in memory together
    first = list(islice(levels, 2))
    several = len(first) > 1
    stem, extension = os.path.splitext(path)
    beside = f"{stem}.{os.getpid()}.part{extension}"
    writer = oiio.ImageOutput.create(beside)
    if writer is None:
        raise FexelError(f"{path}: {_reason(oiio.geterror())}")
    try:
        for level, image in enumerate(chain(first, levels)):
            height, width, channels = image.shape
            spec = oiio.ImageSpec(width, height, channels, _oiio_type(dtype))
            spec.tile_width = spec.tile_height = tile
            spec.attribute("compression", "zip")
            if several:
                # By this a TIFF's further images are known as its mip levels, and an EXR announces all of them.
                spec.attribute("textureformat", "Plain Texture")
            spec.attribute("oiio:ColorSpace", "srgb_rec709_scene" if color_space == "sRGB" else "lin_rec709_scene")
            if not exr and channels == 4:
                spec.alpha_channel = 3
                spec.attribute(_UNASSOCIATED, 1)
            append = "AppendMIPLevel" if writer.supports("mipmap") else "AppendSubimage"
            if not writer.open(beside, spec, append if level else "Create"):
                raise FexelError(f"{path}: {_reason(writer.geterror())}")
            if not writer.write_image(_encode(image, dtype, color_space, associated=exr)):
                raise FexelError(f"{path}: {_reason(writer.geterror())}")
        writer.close()
        os.replace(beside, path)
    finally:
        if os.path.exists(beside):
            os.remove(beside)


def _encode(image: NDArray, dtype: str, color_space: str, associated: bool) -> NDArray:
    """Linear premultiplied float to file values; integers of the file's type are file values already."""
    if image.dtype == dtype and image.dtype.kind == "u":
        return image
    image = np.asarray(image, np.float32).copy()
    colour = image[..., :3]
    if image.shape[-1] == 4 and not associated:
        colour /= np.maximum(image[..., 3:], 1e-6)  # transparent texels: colour is zero there
    if color_space == "sRGB":
        colour[:] = linear_to_srgb(colour)
    if dtype in ("uint8", "uint16"):
        largest = np.iinfo(dtype).max
        return (image.clip(0.0, 1.0) * largest + 0.5).astype(dtype)
    return np.ascontiguousarray(image.astype(dtype))
