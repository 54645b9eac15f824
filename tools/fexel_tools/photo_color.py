"""The colour space of a photo file, and the way from there to linear Rec.709.

In the order of what is believed: a known name in an ICC profile, EXIF's Adobe RGB flag, OpenImageIO's
``oiio:ColorSpace`` (which knows CICP, EXR interop ids and PNG chunks), an EXR's chromaticities. Without a statement
integers are sRGB-encoded and floats linear, as USD's ``auto`` has it.
"""

from __future__ import annotations

import warnings

import cv2
import numpy as np
import OpenImageIO as oiio

from fexel.errors import FexelError, FexelWarning
from fexel.images import srgb_to_linear

__all__ = ["SRGB_NAMES", "decode_srgb_uint8", "file_color_space", "to_linear_rec709"]

SRGB_NAMES = ("srgb_rec709_scene", "sRGB", "srgb_rec709_display")
_LINEAR = (
    "lin_rec709_scene",
    "lin_srgb",
    "scene_linear",
    "Linear",
    "linear",
    "lin_rec709",
)
_ICC_NAMES = {  # part of a profile's description, lower case -> a colour space of OpenImageIO's built-in configuration
    "srgb": "srgb_rec709_scene",
    "display p3": "srgb_p3d65_scene",
    "adobe rgb": "g22_adobergb_scene",
    "adobergb": "g22_adobergb_scene",
}
_REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
_SRGB_TABLE = srgb_to_linear(np.arange(256) / np.float32(255))


def decode_srgb_uint8(color: np.ndarray) -> np.ndarray:
    """Linear float32 of 8-bit sRGB values, any shape."""
    if not color.size:
        return np.zeros(color.shape, np.float32)
    return cv2.LUT(np.ascontiguousarray(color), _SRGB_TABLE).reshape(color.shape)  # 4 times as fast as indexing


def to_linear_rec709(color: np.ndarray, color_space: str, chromaticities: tuple[float, ...] | None) -> np.ndarray:
    """Convert straight (not premultiplied) float colours to linear Rec.709; light outside its gamut is cut off at 0.

    Parameters
    ----------
    color : (H, W, 1 or 3) float32
    color_space, chromaticities
        From `file_color_space`.

    Raises
    ------
    FexelError
        A colour space that OpenImageIO cannot convert.
    """
    if color_space in SRGB_NAMES:
        linear = srgb_to_linear(color)
    elif color_space in _LINEAR:
        linear = color
    elif chromaticities:
        linear = color if color.shape[2] == 1 else color @ _rec709_from(chromaticities).T.astype(np.float32)
    else:
        linear = _convert(color, color_space)
    return np.maximum(linear, 0.0)


def file_color_space(file: str, spec: oiio.ImageSpec, is_float: bool) -> tuple[str, tuple[float, ...] | None]:
    """Colour space that a file states, by name; for an EXR of other primaries ``chromaticities`` and their values.

    Warns
    -----
    FexelWarning
        The file has an ICC profile that is not known; it is read as sRGB.
    """
    icc = _icc_space(file, spec)
    if icc:
        return icc, None
    stated = spec.get_string_attribute("oiio:ColorSpace") or spec.get_string_attribute("colorInteropID")
    if spec.get_int_attribute("Exif:ColorSpace", 1) == 2:
        return "g22_adobergb_scene", None
    if stated in SRGB_NAMES or stated in _LINEAR:
        return ("srgb_rec709_scene" if stated in SRGB_NAMES else "lin_rec709_scene"), None
    if stated and oiio.ColorConfig().getColorSpaceIndex(stated) >= 0:
        return stated, None
    chromaticities = spec.getattribute("chromaticities")
    if chromaticities is not None and len(chromaticities) == 8 and not np.allclose(chromaticities, _REC709, atol=2e-3):
        return "chromaticities", tuple(float(c) for c in chromaticities)
    return ("lin_rec709_scene" if is_float else "srgb_rec709_scene"), None


def _icc_space(file: str, spec: oiio.ImageSpec) -> str:
    if spec.getattribute("ICCProfile") is None:
        return ""
    description = spec.get_string_attribute("ICCProfile:profile_description")
    for part, space in _ICC_NAMES.items():
        if part in description.lower():
            return space
    warnings.warn(
        f"{file}: ICC profile '{description}' is not known, read as sRGB",
        FexelWarning,
        stacklevel=4,
    )
    return "srgb_rec709_scene"


def _convert(color: np.ndarray, color_space: str) -> np.ndarray:
    rgb = np.repeat(color, 3, axis=2) if color.shape[2] == 1 else color
    source = oiio.ImageBuf(np.ascontiguousarray(rgb, np.float32))
    result = oiio.ImageBufAlgo.colorconvert(source, color_space, "lin_rec709_scene", unpremult=False)
    if result.has_error:
        raise FexelError(f"colour space '{color_space}': {' '.join(result.geterror().split())}")
    return np.asarray(result.get_pixels(oiio.FLOAT)).reshape(rgb.shape)


def _rec709_from(chromaticities: tuple[float, ...]) -> np.ndarray:
    """(3, 3) float64, column vectors: linear RGB with these primaries and white to linear Rec.709 (Bradford)."""

    def to_xyz(xy: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        points = np.asarray(xy, np.float64).reshape(4, 2)
        xyz = np.column_stack([points, 1.0 - points.sum(axis=1)]) / points[:, 1:]
        return xyz[:3].T * np.linalg.solve(xyz[:3].T, xyz[3]), xyz[3]

    source, source_white = to_xyz(chromaticities)
    target, target_white = to_xyz(_REC709)
    bradford = np.array(
        [
            [0.8951, 0.2664, -0.1614],
            [-0.7502, 1.7135, 0.0367],
            [0.0389, -0.0685, 1.0296],
        ]
    )
    gain = (bradford @ target_white) / (bradford @ source_white)
    adapt = np.linalg.solve(bradford, gain[:, None] * bradford)
    return np.linalg.solve(target, adapt @ source)
