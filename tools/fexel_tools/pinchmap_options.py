"""How to author a pinchmap: the options, what they may be, and how the command line spells them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fexel.errors import FexelError
from fexel.images import srgb_to_linear
from fexel_tools.pinchmap_source import LONGEST_SIDE_PX, color_count
from fexel_tools.pinchmap_stage import DRIVEN_INPUTS

__all__ = ["AUTO", "PinchmapOptions", "check_options", "map_shape", "parse_color", "parse_size", "parse_wrap"]

AUTO = "auto"
_SIZES = (4, LONGEST_SIDE_PX // 2)  # a finer map would hold the source itself; the fit draws it 8 times as large
_SIGNAL_LARGEST = 16384
_WRAPS = ("clamp", "repeat", "mirror")
_BITS = ("8", "16", "float")
_COLOR_INPUTS = ("diffuseColor", "emissiveColor")


@dataclass(frozen=True)
class PinchmapOptions:
    """How to author; the defaults are those of the command line.

    Attributes
    ----------
    size : int or "auto"
        Pinchmap texels along the longer side of the source; ``auto`` is the smallest that meets `tolerance`.
    tolerance : float
        For ``auto``: largest share of source pixels on the wrong side.
    signal_size : int
        Signal texels along the longer side, 2^K times `size`; 0: as `size`. With ``auto`` the most that may be used.
    regions : str
        For sources without alpha: ``auto``, a number of colours, or an image of labels; '' takes the alpha.
    mask : str
        Image that says which side of the lines a pixel is on, instead of the source's alpha; '' for none.
    raw : bool
        The source holds data, not colours.
    drives : str
        Input of UsdPreviewSurface that the texture drives; '' is diffuseColor, or roughness for raw data.
    wrap : (str, str)
        ``clamp``, ``repeat`` or ``mirror`` along s and t.
    bits : str
        Of the pinchmap: ``8``, ``16`` or ``float``. The signal has the source's.
    antialias : float
        Width of the transition, pixels.
    line_width : float
        Width of the solid line, pinchmap texels; 0 draws none.
    line_color : 4 floats
        Linear, straight alpha.
    fallback_size : int
        Longer side of the picture for other applications, pixels.
    seed : int
    """

    size: int | str = 32
    tolerance: float = 0.0015
    signal_size: int = 0
    regions: str = ""
    mask: str = ""
    raw: bool = False
    drives: str = ""
    wrap: tuple[str, str] = ("clamp", "clamp")
    bits: str = "8"
    antialias: float = 1.0
    line_width: float = 0.0
    line_color: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    fallback_size: int = 512
    seed: int = 0

    @property
    def is_data(self) -> bool:
        """Whether the source's values are stored as they are."""
        return self.raw or self.drives not in ("", *_COLOR_INPUTS)

    @property
    def driven(self) -> str:
        """The input of the surface, with its default."""
        return self.drives or ("roughness" if self.raw else "diffuseColor")


def map_shape(width: int, height: int, size: int) -> tuple[int, int]:
    """Rows and columns of the pinchmap of a source.

    Parameters
    ----------
    width, height : int
        Of the source, pixels.
    size : int
        Texels along the longer side; the other is rounded to the aspect, at least 4.

    Examples
    --------
    >>> map_shape(300, 200, 32)
    (21, 32)
    """
    longer = max(width, height)
    return max(4, round(size * height / longer)), max(4, round(size * width / longer))


def check_options(options: PinchmapOptions) -> None:
    """Find wrong options before any work is done.

    Raises
    ------
    FexelError
        Naming the option, what it is and what was expected.
    """
    if options.size != AUTO and not _SIZES[0] <= int(options.size) <= _SIZES[1]:
        raise FexelError(f"--size: {options.size}, expected {_SIZES[0]} to {_SIZES[1]} texels, or {AUTO}")
    if not 0.0 < options.tolerance < 1.0:
        raise FexelError(f"--tolerance: {options.tolerance}, expected a share of pixels between 0 and 1")
    _check_signal(options)
    regions = options.regions
    if regions not in ("", AUTO) and color_count(regions) is None and not Path(regions).is_file():
        raise FexelError(f"--regions: '{options.regions}', expected {AUTO}, a number, or an image of labels")
    if options.mask and not Path(options.mask).is_file():
        raise FexelError(f"--mask: {options.mask}: no such file")
    if options.mask and options.regions:
        raise FexelError("--mask: says which side a pixel is on, and so does --regions; expected one of the two")
    if options.driven not in DRIVEN_INPUTS:
        raise FexelError(f"--drives: '{options.drives}' is unknown, expected one of {', '.join(DRIVEN_INPUTS)}")
    if options.raw and options.drives in _COLOR_INPUTS:
        raise FexelError(f"--raw: data cannot drive {options.drives}, which takes colours")
    if options.bits not in _BITS:
        raise FexelError(f"--bits: {options.bits}, expected one of {', '.join(_BITS)}")
    if any(mode not in _WRAPS for mode in options.wrap):
        raise FexelError(f"--wrap: '{','.join(options.wrap)}', expected one or two of {', '.join(_WRAPS)}")
    for name, value in (("--antialias", options.antialias), ("--lineWidth", options.line_width)):
        if not (np.isfinite(value) and value >= 0.0):
            raise FexelError(f"{name}: {value}, expected a number that is not negative")
    if options.fallback_size < 1:
        raise FexelError(f"--fallbackSize: {options.fallback_size}, expected at least 1 pixel")
    if options.seed < 0:
        raise FexelError(f"--seed: {options.seed}, expected a number that is not negative")


def parse_size(text: str) -> int | str:
    """``auto`` or a number.

    Raises
    ------
    FexelError
        Neither.
    """
    if text.strip().lower() == AUTO:
        return AUTO
    try:
        return int(text)
    except ValueError:
        raise FexelError(f"--size: '{text}', expected a number of texels, or {AUTO}") from None


def parse_wrap(text: str) -> tuple[str, str]:
    """One wrap mode for both axes, or two with a comma between them.

    Examples
    --------
    >>> parse_wrap("repeat"), parse_wrap("repeat,clamp")
    (('repeat', 'repeat'), ('repeat', 'clamp'))
    """
    modes = [mode.strip() for mode in text.split(",")]
    if len(modes) > 2 or any(mode not in _WRAPS for mode in modes):
        raise FexelError(f"--wrap: '{text}', expected one or two of {', '.join(_WRAPS)}")
    return modes[0], modes[-1]


def parse_color(text: str, option: str = "--lineColor") -> tuple[float, float, float, float]:
    """Linear red, green, blue and straight alpha: 3 or 4 numbers, or ``#rrggbb[aa]``, which is sRGB-encoded.

    `option` is named in messages.

    Raises
    ------
    FexelError
        Neither, or a value that is negative or not finite, or an alpha above 1.

    Examples
    --------
    >>> parse_color("1,0.5,0"), parse_color("#ff000080")
    ((1.0, 0.5, 0.0, 1.0), (1.0, 0.0, 0.0, 0.5019607843137255))
    """
    fault = FexelError(f"{option}: '{text}', expected r,g,b[,a] (linear) or #rrggbb[aa] (sRGB)")
    if match := re.fullmatch(r"#([0-9a-fA-F]{6})([0-9a-fA-F]{2})?", text.strip()):
        encoded = np.array(list(bytes.fromhex(match[1])), np.float32) / np.float32(255)
        red, green, blue = (float(v) for v in srgb_to_linear(encoded))
        return red, green, blue, int(match[2] or "ff", 16) / 255
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        raise fault from None
    if len(values) not in (3, 4) or not np.isfinite(values).all() or min(values) < 0 or max(values[3:], default=1) > 1:
        raise fault
    return values[0], values[1], values[2], values[3] if len(values) == 4 else 1.0


def _check_signal(options: PinchmapOptions) -> None:
    if not 0 <= options.signal_size <= _SIGNAL_LARGEST:
        raise FexelError(f"--signalSize: {options.signal_size}, expected at most {_SIGNAL_LARGEST} texels")
    if options.size == AUTO or not options.signal_size:
        return
    size = int(options.size)
    ratio = options.signal_size / size
    if ratio < 1 or not np.log2(ratio).is_integer():
        some = ", ".join(str(size << level) for level in range(4))
        raise FexelError(f"--signalSize: {options.signal_size}, expected --size times a power of two: {some} ...")
