"""Stored pixels of a photo to straight linear colour or data: a window, or all of it reduced strip by strip.

What `fexel_tools.photos.read_stored_pixels` gives takes a byte or two a channel; decoded to float it takes four. So
what needs little of a large photo, or all of it reduced, decodes no more than that at a time.
"""

from __future__ import annotations

import warnings

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError, FexelWarning
from fexel_tools.color_bleed import bleed_color
from fexel_tools.photo_color import decode_srgb_uint8, to_linear_rec709
from fexel_tools.photos import Photo

__all__ = ["decode_pixels", "decode_reduced", "warn_of_non_finite"]

_STRIP_ROWS = 512  # of a large photo, reduced at a time


def decode_pixels(
    photo: Photo, pixels: NDArray, raw: bool = False
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Stored values to straight linear colour, or data, of three channels; not yet upright.

    Parameters
    ----------
    photo : Photo
    pixels : (H, W, C)
        As `fexel_tools.photos.read_stored_pixels` gives them; integers of 8 or 16 bits count from 0 to 1.
    raw : bool
        Data: values as stored.

    Returns
    -------
    color : (H, W, 3) float32
        Finite.
    alpha : (H, W) float32 or None
        0..1; None where the photo has none.

    Raises
    ------
    FexelError
        A colour space that is not known.

    Notes
    -----
    Where values are NaN or infinite the colour is taken from neighbours, and such alpha is 0; `warn_of_non_finite` says
    so, once for a photo that is decoded in parts.
    """
    color = pixels[..., : pixels.shape[2] - photo.has_alpha]
    alpha = _as_float(pixels[..., -1]) if photo.has_alpha else None
    if color.dtype == np.uint8 and photo.is_srgb and not photo.associated_alpha and not raw:
        color = decode_srgb_uint8(color)
    else:
        color = _as_float(color)
        color, alpha = _finite(color, alpha)
        if photo.associated_alpha and alpha is not None:
            color = color / np.maximum(alpha, 1e-6)[..., None]  # 1e-6 guards transparent pixels, whose colour is 0
        if not raw:
            color = _linear(photo, color)
    color = np.repeat(color, 3, axis=2) if color.shape[2] == 1 else np.ascontiguousarray(color)
    return color.astype(np.float32, copy=False), alpha


def _as_float(values: NDArray) -> NDArray[np.float32]:
    if values.dtype in (np.uint8, np.uint16):
        return values / np.float32(np.iinfo(values.dtype).max)
    return np.ascontiguousarray(values, np.float32)


def _linear(photo: Photo, color: NDArray[np.float32]) -> NDArray[np.float32]:
    try:
        return to_linear_rec709(color, photo.color_space, photo.chromaticities)
    except FexelError as error:
        raise FexelError(f"{photo.file}: {error}") from None


def _finite(
    color: NDArray[np.float32], alpha: NDArray[np.float32] | None
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Colour without NaN and infinities, filled from neighbours; alpha within 0..1, 0 where it was none."""
    good = np.isfinite(color).all(axis=2)
    good_alpha = np.ones_like(good) if alpha is None else np.isfinite(alpha)
    if not (good.all() and good_alpha.all()):
        color = np.where(good[..., None], color, np.float32(0))
        color = _filled(color, good.astype(np.float32))
    if alpha is not None:
        alpha = np.clip(np.where(good_alpha, alpha, np.float32(0)), 0, 1)
    return color, alpha


def _filled(color: NDArray[np.float32], known: NDArray[np.float32]) -> NDArray[np.float32]:
    if color.shape[2] == 1:
        return bleed_color(np.repeat(color, 3, axis=2), known)[..., :1]
    return bleed_color(color, known)


def warn_of_non_finite(photo: Photo, pixels: NDArray) -> None:
    """Say how many pixels of a whole photo, (H, W, C) as it is stored, are NaN or infinite."""
    if pixels.dtype.kind != "f":
        return
    strips = (pixels[top : top + _STRIP_ROWS] for top in range(0, len(pixels), _STRIP_ROWS))
    count = sum(int(np.count_nonzero(~np.isfinite(strip).all(axis=2))) for strip in strips)
    if count:
        message = f"{photo.file}: {count} pixels are NaN or infinite; their colour is taken from neighbours"
        warnings.warn(message, FexelWarning, stacklevel=3)


def decode_reduced(
    photo: Photo, pixels: NDArray, raw: bool, factor: int
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """`decode_pixels`, strip by strip, every `factor` x `factor` pixels averaged; the last may be fewer."""
    rows = max(_STRIP_ROWS // factor, 1) * factor
    strips = [
        _reduced(*decode_pixels(photo, pixels[top : top + rows], raw), factor)
        for top in range(0, pixels.shape[0], rows)
    ]
    color = np.concatenate([color for color, _ in strips])
    alphas = [alpha for _, alpha in strips if alpha is not None]
    return color, np.concatenate(alphas) if alphas else None


def _reduced(
    color: NDArray[np.float32], alpha: NDArray[np.float32] | None, factor: int
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    if alpha is None:
        return _area_mean(color, factor), None
    opacity = _area_mean(alpha, factor)
    premultiplied = _area_mean(color * alpha[..., None], factor)
    return premultiplied / np.maximum(opacity, np.float32(1e-6))[..., None], opacity  # 1e-6 guards transparent pixels


def _area_mean(plane: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    height, width = plane.shape[:2]
    whole = cv2.copyMakeBorder(plane, 0, -height % factor, 0, -width % factor, cv2.BORDER_REPLICATE)
    size = (whole.shape[1] // factor, whole.shape[0] // factor)
    return cv2.resize(whole, size, interpolation=cv2.INTER_AREA)
