"""The picture that a pinchmap is made of: colour, opacity, and on which side of the discontinuities each pixel is.

Section 7.1 of Tarini and Cignoni, Pinchmaps (2005), takes a picture whose alpha says where the discontinuities are:
where it steps from 0 to 1 there is a boundary. So does this module for drawings (SVG) and for images with alpha; the
side of opaque images, and of data such as normal maps, comes from a mask or from regions found in them
(`pinchmap_regions`).

Conventions
-----------
Row 0 at the top, upright (EXIF applied). Colour is linear Rec.709, straight, and continued under transparent pixels;
with `raw` it is the stored values, integers scaled to 0..1. `side` is 0..1 and crosses 0.5 where the boundary runs, at
sub-pixel accuracy as far as the source is anti-aliased.

Sources larger than `LONGEST_SIDE_PX` are reduced while they are read, by area, colours weighted by alpha.
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
from fexel_tools.color_bleed import bleed_color
from fexel_tools.photo_color import decode_srgb_uint8
from fexel_tools.photo_pixels import decode_pixels, decode_reduced, warn_of_non_finite
from fexel_tools.photos import probe_photo, read_stored_pixels, upright
from fexel_tools.pinchmap_labels import find_labels, stretched_side
from fexel_tools.pinchmap_regions import RegionSides, label_sides, region_sides
from fexel_tools.vector_image import is_vector_image, rasterize

__all__ = ["LONGEST_SIDE_PX", "PinchmapSource", "color_count", "load_source"]

LONGEST_SIDE_PX = 4096
_DRAWING_SIDE_PX = 1024  # of an SVG, at least
_PIXELS_PER_TEXEL = 16  # of an SVG: with anti-aliasing a boundary is known to 1/200 texel, what 8 bits of gamma resolve
_MOST_COLORS = 64
_TEXELS = (48, 48)  # of a map whose size is not known
_LEAST_ALPHA_STEP = 0.125  # of a translucent cut-out; less is the noise of an image without one


@dataclass(frozen=True)
class PinchmapSource:
    """A picture and the side that each of its pixels is on.

    Attributes
    ----------
    path : Path
    color : (H, W, 3) float32
        Linear Rec.709, straight alpha; stored values where `is_data`. Finite.
    opacity : (H, W) float32
        0..1; all 1 for an opaque image.
    side : (H, W) float32
        0..1; above 0.5 is the side k = +1.
    is_data : bool
        Stored values, not colours.
    bits : int
        Of the source: 8, 16 or 32 (half and float).
    regions : RegionSides or None
        How the sides were found, and which boundaries were lost; None where alpha or a mask told them.
    """

    path: Path
    color: NDArray[np.float32]
    opacity: NDArray[np.float32]
    side: NDArray[np.float32]
    is_data: bool
    bits: int
    regions: RegionSides | None = None


def load_source(
    path: str | Path,
    *,
    size: tuple[int, int] | None = None,
    regions: str | None = None,
    mask: str | Path | None = None,
    raw: bool = False,
    seed: int = 0,
) -> PinchmapSource:
    """Read a drawing or image and find the side of each pixel.

    Parameters
    ----------
    path : str or Path
        SVG, or any format that OpenImageIO reads.
    size : (int, int), optional
        Texels of the pinchmap to be made; only the larger matters. An SVG is drawn with 16 pixels a texel, at least
        1024 and at most `LONGEST_SIDE_PX` on its longer side; regions too small or too narrow for it are left out.
    regions : str, optional
        ``auto``, or a number of colours: sides from regions of the picture, see `pinchmap_regions`; or an image, as
        `mask`. Without either, the side is the alpha, stretched
        to 0..1 where its two values are on one half.
    mask : str or Path, optional
        An image of any size that tells the side by its alpha or its first channel, or holds labels of regions, see
        `pinchmap_labels`.
    raw : bool
        The picture is data (a normal map): values as stored.
    seed : int
        Of what is drawn at random in finding regions.

    Raises
    ------
    FexelError
        A file is missing, damaged or no image; `mask` and `regions` are both given; or there is nothing on one of the
        two sides.

    Warns
    -----
    FexelWarning
        Values that are NaN or infinite: the colour is taken from neighbours, such alpha is 0.
    """
    path = Path(path)
    if mask is not None and regions is not None:
        raise FexelError(f"{path}: both a mask and regions say which side a pixel is on, expected one of the two")
    color, alpha, bits = _load_drawing(path, size, raw) if is_vector_image(path) else _load_image(path, raw)
    opacity = np.ones(color.shape[:2], np.float32) if alpha is None else alpha
    if mask is None and regions is None:
        side = _side_of_alpha(path, alpha)
        return PinchmapSource(path, bleed_color(color, opacity), opacity, side, raw, bits)
    color = bleed_color(color, opacity)
    found = _find_sides(path, color, opacity, str(regions or mask), raw, max(size or _TEXELS), seed)
    side = found.side if isinstance(found, RegionSides) else found
    return PinchmapSource(path, color, opacity, side, raw, bits, found if isinstance(found, RegionSides) else None)


def color_count(regions: str) -> int | None:
    """The number of colours that `regions` asks for; None where it is no number.

    Examples
    --------
    >>> color_count("3"), color_count("auto"), color_count("\u00b2")
    (3, None, None)
    """
    return int(regions) if regions.isascii() and regions.isdecimal() and len(regions) < 10 else None


def _find_sides(
    path: Path,
    color: NDArray[np.float32],
    opacity: NDArray[np.float32],
    regions: str,
    raw: bool,
    texels: int,
    seed: int,
) -> RegionSides | NDArray[np.float32]:
    """From regions of the picture, or from a file."""
    colors = color_count(regions)
    if regions == "auto" or colors is not None:
        if colors is not None and not 2 <= colors <= _MOST_COLORS:
            raise FexelError(f"{path}: {regions} regions, expected auto, 2 to {_MOST_COLORS} colours, or an image")
        found = region_sides(color, opacity, colors=colors, is_data=raw, texels=texels, seed=seed)
        if not (found.side > 0.5).any():
            raise FexelError(f"{path}: no boundary that is worth a discontinuity was found; pass a mask")
        return found
    values, alpha, _ = _load_image(Path(regions), raw=True)
    labels = find_labels(values)
    if labels is not None:
        return label_sides(labels, color, opacity, is_data=raw, seed=seed)
    by_alpha = alpha is not None and alpha.min() <= 0.5 < alpha.max()
    side = stretched_side(np.clip(alpha if by_alpha else values[..., 0], 0, 1))
    _check_sides(Path(regions), side)
    return _resampled(side, opacity.shape)


def _resampled(side: NDArray[np.float32], shape: tuple[int, int]) -> NDArray[np.float32]:
    if side.shape == shape:
        return np.ascontiguousarray(side)
    interpolation = cv2.INTER_AREA if side.shape[0] > shape[0] else cv2.INTER_LINEAR
    return cv2.resize(side, shape[::-1], interpolation=interpolation)


def _side_of_alpha(path: Path, alpha: NDArray[np.float32] | None) -> NDArray[np.float32]:
    """The alpha; stretched where it is that of a cut-out which is translucent as a whole."""
    remedy = "pass --regions auto, or a mask"
    if alpha is None:
        raise FexelError(f"{path}: has no alpha to tell the sides by; {remedy}")
    side = stretched_side(alpha) if alpha.max() - alpha.min() >= _LEAST_ALPHA_STEP else alpha
    if not side.min() <= 0.5 < side.max():
        span = _span(float(alpha.min()), float(alpha.max()))
        raise FexelError(f"{path}: alpha is {span}, so that all pixels are on one side; {remedy}")
    return side


def _check_sides(path: Path, side: NDArray[np.float32]) -> None:
    least, most = float(side.min()), float(side.max())
    if not least <= 0.5 < most:
        raise FexelError(f"{path}: the side is {_span(least, most)}, expected values on both sides of 0.5")


def _span(least: float, most: float) -> str:
    return f"{least:.3g} everywhere" if least == most else f"between {least:.3g} and {most:.3g}"


def _load_drawing(
    path: Path, size: tuple[int, int] | None, raw: bool
) -> tuple[NDArray[np.float32], NDArray[np.float32], int]:
    longer_side = _DRAWING_SIDE_PX if size is None else max(_DRAWING_SIDE_PX, _PIXELS_PER_TEXEL * max(size))
    pixels = rasterize(path, min(longer_side, LONGEST_SIDE_PX))
    if not pixels[..., 3].any():
        raise FexelError(f"{path}: the drawing is empty, expected something drawn within its viewport")
    stored = cv2.cvtColor(pixels, cv2.COLOR_RGBA2RGB)
    color = stored / np.float32(255) if raw else decode_srgb_uint8(stored)
    return color, pixels[..., 3] / np.float32(255), 8


def _load_image(path: Path, raw: bool) -> tuple[NDArray[np.float32], NDArray[np.float32] | None, int]:
    photo = probe_photo(path, min_side_px=1)
    pixels = read_stored_pixels(photo, oiio.UINT8 if photo.pixel_type == "uint8" else oiio.FLOAT)
    warn_of_non_finite(photo, pixels)
    factor = math.ceil(max(photo.width, photo.height) / LONGEST_SIDE_PX)
    color, alpha = decode_pixels(photo, pixels, raw) if factor == 1 else decode_reduced(photo, pixels, raw, factor)
    alpha = None if alpha is None else np.ascontiguousarray(upright(alpha, photo.orientation))
    bits = {"uint8": 8, "uint16": 16}.get(photo.pixel_type, 32)
    return np.ascontiguousarray(upright(color, photo.orientation)), alpha, bits
