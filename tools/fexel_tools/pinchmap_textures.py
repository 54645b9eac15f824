"""The files of a pinchmap: the pinchmap itself, always raw, and the signal in the bit depth of its source.

8- and 16-bit ones are PNG, with straight alpha; floating-point ones EXR, with associated alpha. Mip levels are left to
the renderer: the files are a few kilobytes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fexel.textures.pinchmap_encoding import decode_texels, encode_texels
from fexel_tools.image_files import write_image
from fexel_tools.texture_files import encode

__all__ = ["SignalFile", "as_stored", "write_pinchmap", "write_signal"]

_DTYPES = {8: "uint8", 16: "uint16"}
_LARGEST_HALF = 65504.0


@dataclass(frozen=True)
class SignalFile:
    """A signal as it was written.

    Attributes
    ----------
    path : Path
    color_space : str
        ``sRGB`` or ``raw``.
    nbytes : int
        Of its texels, uncompressed, without mip levels.
    """

    path: Path
    color_space: str
    nbytes: int


def as_stored(pinchmap: np.ndarray, bits: str) -> np.ndarray:
    """(Nh, Nw, 4) float64 texels as a renderer reads them from a file of so many bits (``8``, ``16``, ``float``)."""
    if bits == "float":
        return pinchmap.astype(np.float32).astype(np.float64)
    return decode_texels(encode_texels(pinchmap, bits=int(bits)))


def write_pinchmap(folder: Path, pinchmap: np.ndarray, bits: str) -> tuple[Path, int]:
    """Write ``pinchmap.png`` or ``.exr``; returns the file and the bytes of its texels.

    Raises
    ------
    FexelError
        The file cannot be written.
    """
    is_float = bits == "float"
    texels = pinchmap.astype(np.float32) if is_float else encode_texels(pinchmap, bits=int(bits))
    path = folder / ("pinchmap.exr" if is_float else "pinchmap.png")
    write_image(path, texels, "raw")
    return path, texels.nbytes


def write_signal(folder: Path, signal: np.ndarray, bits: int, *, is_data: bool, has_alpha: bool) -> SignalFile:
    """Write ``signal.png`` or ``.exr``.

    Parameters
    ----------
    folder : Path
    signal : (Sh, Sw, 4) float32
        Linear Rec.709 or data, straight alpha.
    bits : int
        Of the source: 8, 16 or 32; the last becomes half float.
    is_data : bool
        Stored without a colour space's encoding.
    has_alpha : bool
        False leaves the alpha out.

    Raises
    ------
    FexelError
        The file cannot be written.
    """
    rgb, alpha = signal[..., :3], signal[..., 3] if has_alpha else None
    if bits in _DTYPES:
        color_space = "raw" if is_data else "sRGB"
        texels = encode(rgb, alpha, _DTYPES[bits], color_space)
        path = folder / "signal.png"
    else:
        color_space = "raw"
        texels = rgb if alpha is None else np.dstack([rgb * alpha[..., None], alpha])
        texels = texels.clip(-_LARGEST_HALF, _LARGEST_HALF).astype(np.float16)
        path = folder / "signal.exr"
    write_image(path, texels, color_space)
    return SignalFile(path, color_space, texels.nbytes)
