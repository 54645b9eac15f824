"""From linear, premultiplied colour and from data to what an image file shows.

Colour correction has usdrecord's modes: ``disabled`` keeps linear values, ``sRGB`` applies the encoding of
IEC 61966-2-1, ``openColorIO`` the default display and view of the configuration that ``$OCIO`` names. All act on
straight colour.
"""

from __future__ import annotations

import os

import numpy as np

from fexel.errors import FexelError
from fexel.images import linear_to_srgb

__all__ = ["COLOR_CORRECTION_MODES", "ColorCorrection", "data_range", "visible_data"]

COLOR_CORRECTION_MODES = ("disabled", "sRGB", "openColorIO")
_LARGEST_LOD = 15.0  # of an image of 32768 texels
_LARGEST_FETCHES = 8.0  # log2; most filters take fewer
_LARGEST_ANISOTROPY = 5.0  # log2 of the ratio of axes at about 2 degrees


class ColorCorrection:
    """A mode, ready to be applied to rows of an image.

    Raises
    ------
    FexelError
        Unknown mode; ``openColorIO`` without a usable configuration.
    """

    def __init__(self, mode: str) -> None:
        if mode not in COLOR_CORRECTION_MODES:
            valid = " ".join(COLOR_CORRECTION_MODES)
            raise FexelError(f"unknown colorCorrectionMode {mode!r}; valid are {valid}")
        self.mode = mode
        self._config = _ocio_config() if mode == "openColorIO" else None

    def __call__(self, straight: np.ndarray) -> np.ndarray:
        """Corrected (H, W, 3) float32 of straight linear Rec.709."""
        if self.mode == "disabled":
            return straight
        if self.mode == "sRGB":
            return linear_to_srgb(straight)
        return self._display(straight)

    def _display(self, straight: np.ndarray) -> np.ndarray:
        import OpenImageIO as oiio

        config = self._config
        assert config is not None
        source = "lin_rec709" if config.getColorSpaceIndex("lin_rec709") >= 0 else "scene_linear"
        image = oiio.ImageBuf(np.ascontiguousarray(straight, np.float32))
        shown = oiio.ImageBufAlgo.ociodisplay(image, "", "", source, colorconfig=os.environ["OCIO"])
        if shown.has_error:
            raise FexelError(f"{os.environ['OCIO']}: {_one_line(shown.geterror())}")
        return np.asarray(shown.get_pixels(oiio.FLOAT)).reshape(straight.shape)


def _ocio_config():
    import OpenImageIO as oiio

    file = os.environ.get("OCIO", "")
    if not file:
        raise FexelError("colorCorrectionMode openColorIO: set the environment variable OCIO to a configuration")
    config = oiio.ColorConfig(file)
    error = config.geterror()
    if error or not config.getDisplayNames():
        raise FexelError(f"{file}: not a usable OpenColorIO configuration: {_one_line(error) or 'it has no display'}")
    return config


def _one_line(text: str) -> str:
    return " ".join(text.split())


def data_range(name: str, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest value (C,) that `visible_data` maps to its ends; from the image for AOVs in world units."""
    count = image.shape[-1]
    if name in ("cameraDepth", "position"):
        drawn = image[image[..., 0] > 0.0] if name == "cameraDepth" else image.reshape(-1, count)
        if len(drawn):
            return drawn.min(axis=0).astype(np.float64), drawn.max(axis=0).astype(np.float64)
    return np.zeros(count), np.ones(count)


def visible_data(name: str, rows: np.ndarray, extent: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """A data AOV as values in [0, 1], for formats that hold no others.

    ``depth alpha``: as they are. ``cameraDepth``: nearest 1, farthest 0.1, nothing 0. ``position``: the frame's bounds
    to [0, 1]. ``normal Neye``: 0.5 + 0.5 n. ``st``: fraction, red and green. ``lod``: (lod + 1) / 16.
    ``patch primId filter``: a colour per number, nothing black. ``footprint``: hue the direction, the more colour the
    longer it is, brighter the more texels it is wide. ``fetches``: log2(1 + fetches) / 8. ``decision``: sRGB-encoded.

    Parameters
    ----------
    rows : (H, W, C) float32
    extent : tuple of (C,)
        From `data_range` of the whole image.
    """
    low, high = extent
    if name == "cameraDepth":
        near = 1.0 - 0.9 * (rows - low) / np.maximum(high - low, 1e-30)  # 1e-30: a flat surface
        return np.where(rows > 0.0, near, 0.0)
    if name == "position":
        return (rows - low) / np.maximum(high - low, 1e-30)
    if name in ("normal", "Neye"):
        return 0.5 + 0.5 * rows
    if name == "st":
        fraction = np.where((rows < 0.0) | (rows > 1.0), rows - np.floor(rows), rows)
        return np.concatenate([fraction, np.zeros_like(rows[..., :1])], axis=-1)
    if name == "lod":
        return (rows + 1.0) / (_LARGEST_LOD + 1.0)
    if name in ("patch", "primId", "filter"):
        return _number_colors(rows[..., 0])
    if name == "footprint":
        return _footprint_colors(*np.moveaxis(rows, -1, 0))
    if name == "fetches":
        return np.clip(np.log2(1.0 + np.maximum(rows, 0.0)) / _LARGEST_FETCHES, 0.0, 1.0)
    if name == "decision":
        return linear_to_srgb(np.clip(rows, 0.0, 1.0))
    return rows


def _number_colors(numbers: np.ndarray) -> np.ndarray:
    """Distinct colours (H, W, 3) of whole numbers: hues by the golden ratio; black below 0."""
    color = _hues(np.modf(np.maximum(numbers, 0.0) * 0.6180339887498949)[0])
    return np.where(numbers[..., None] >= 0.0, 0.25 + 0.75 * color, 0.0)


def _footprint_colors(major: np.ndarray, minor: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """(H, W, 3): grey where round, black where there is none; half a turn is once around the hues."""
    anisotropy = np.log2(np.maximum(major, 1e-30) / np.maximum(minor, 1e-30))  # 1e-30: nothing there
    saturation = np.clip(anisotropy / _LARGEST_ANISOTROPY, 0.0, 1.0)[..., None]
    value = np.clip((np.log2(np.maximum(minor, 1e-30)) + 6.0) / 12.0, 0.3, 1.0)[..., None]  # white at 64 texels
    color = value * (1.0 - saturation * (1.0 - _hues(angle / np.pi)))
    return np.where(major[..., None] > 0.0, color, 0.0)


def _hues(turns: np.ndarray) -> np.ndarray:
    """(..., 3) saturated colours of a hue in turns."""
    return np.clip(np.abs(np.mod(turns[..., None] * 6.0 + np.array([0.0, 4.0, 2.0]), 6.0) - 3.0) - 1.0, 0.0, 1.0)
