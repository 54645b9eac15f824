"""The files of a ground: base textures and backgrounds.

Colours are 8-bit sRGB, since a renderer clamps them to [0, 1]; data have the bits of their photos. Base textures are
PNG, without alpha where the element is opaque inside its contour. Mip levels are left to the renderer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel.images import image_info
from fexel_tools.image_files import write_image
from fexel_tools.texture_files import encode

__all__ = ["WrittenTextures", "bits_of", "write_background", "write_bases"]


@dataclass(frozen=True)
class WrittenTextures:
    """Files and what they take.

    Attributes
    ----------
    files : tuple of str
        Names.
    nbytes : int
        On disk.
    """

    files: tuple[str, ...]
    nbytes: int


def bits_of(file: Path, is_data: bool) -> int:
    """8 for colours; 8 or 16 for data, as their file has."""
    try:
        return 16 if is_data and image_info(str(file)).dtype != "uint8" else 8
    except FexelError:  # a format that only another reader knows, such as a camera's raw
        return 16 if is_data else 8


def write_bases(
    folder: Path,
    names: Sequence[str],
    textures: Sequence[NDArray[np.float32]],
    has_alpha: Sequence[bool],
    *,
    is_data: bool = False,
    bits: Sequence[int] = (),
) -> WrittenTextures:
    """Write a PNG per base.

    Parameters
    ----------
    folder : Path
    names : sequence of str
        File names without extension, unique without regard to case.
    textures : sequence of (h, w, 4) float32
        Linear Rec.709 or data, straight alpha.
    has_alpha : sequence of bool
    is_data : bool
    bits : sequence of int
        8 or 16 per base; default 8.

    Raises
    ------
    FexelError
        A file cannot be written.
    """
    color_space = "raw" if is_data else "sRGB"
    files, nbytes = [], 0
    for name, texture, alpha, depth in zip(names, textures, has_alpha, bits or [8] * len(names), strict=True):
        rgb = np.ascontiguousarray(texture[..., :3])
        opacity = np.ascontiguousarray(texture[..., 3]) if alpha else None
        path = folder / f"{name}.png"
        write_image(path, encode(rgb, opacity, f"uint{depth}", color_space), color_space, is_photo=True)
        files.append(path.name)
        nbytes += path.stat().st_size
    return WrittenTextures(tuple(files), nbytes)


def write_background(
    folder: Path, picture: NDArray[np.float32], name: str = "background", *, is_data: bool = False
) -> WrittenTextures:
    """Write a background: JPEG where it is a colour picture without alpha, else PNG.

    Parameters
    ----------
    picture : (H, W, 3 or 4) float32
        Linear or data, straight alpha.
    """
    color_space = "raw" if is_data else "sRGB"
    has_alpha = picture.shape[2] == 4
    opacity = np.ascontiguousarray(picture[..., 3]) if has_alpha else None
    path = folder / f"{name}.{'png' if has_alpha or is_data else 'jpg'}"
    write_image(path, encode(np.ascontiguousarray(picture[..., :3]), opacity, "uint8", color_space), color_space)
    return WrittenTextures((path.name,), path.stat().st_size)
