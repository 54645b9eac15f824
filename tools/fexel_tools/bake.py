"""Stages for every application: each fexel texture becomes one explicit texture, all else stays as it is.

The stage is flattened; every texture that lies within no other is baked as its kind does it (`baking`), over the unit
square of its ``inputs:st``, and turned into a UsdUVTexture (`bake_network`). Images that the stage names otherwise are
copied beside it, so that the result needs nothing from elsewhere.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd

from fexel.errors import FexelError, FexelWarning
from fexel.filters.minification import minification_of_prim
from fexel.stage import open_stage
from fexel.textures import extract_texture
from fexel.textures.image_source import toned
from fexel_tools.bake_files import PACKAGE, check_package, collect_files, packaged_output
from fexel_tools.bake_network import is_own, make_explicit, remove_own, texture_roots, tone_plain
from fexel_tools.baking import Storage, TextureBaker, texture_baker
from fexel_tools.fallback import write_picture
from fexel_tools.progress import Progress, silent
from fexel_tools.staged_output import StagedOutput, check_output, staged_output

__all__ = ["LARGEST", "BakedTexture", "bake_stage"]

LARGEST = 8192
"""Pixels on the longer side of a picture where no size is asked for: as fine as its texture, but no finer than this."""

_FORMATS = ("png", "exr", "tif", "jpg")
_IN_PACKAGES = ("png", "exr", "jpg")  # what the usdz specification allows
_SIZES = (1, 32768)


@dataclass(frozen=True)
class BakedTexture:
    """What became of one texture.

    Attributes
    ----------
    prim : str
        Its path, before and after.
    file : str
        Name of the picture.
    size : (int, int)
        Width and height, pixels.
    nbytes : int
        Of the file.
    """

    prim: str
    file: str
    size: tuple[int, int]
    nbytes: int


def bake_stage(
    stage_file: str | Path,
    out: str | Path,
    *,
    size: int | None = None,
    prim: str = "",
    image_format: str = "",
    time: float | None = None,
    progress: Progress | None = None,
) -> list[BakedTexture]:
    """Bake the textures of a stage.

    Parameters
    ----------
    stage_file : str or Path
    out : str or Path
        ``.usda``, ``.usdc`` or ``.usd``, with its images in the folder ``<stem>_textures`` beside it; or ``.usdz``,
        which holds all in one file.
    size : int, optional
        Pixels on the longer side of every picture. Default: as fine as each texture, at most `LARGEST`.
    prim : str
        Only textures at or below this path; others stay as they are.
    image_format : str
        ``png``, ``exr``, ``tif`` or ``jpg``; '' is PNG, and EXR for floating-point textures.
    time : float, optional
        Time code that is baked. Default: the first one, where textures vary over time.
    progress : callable(step, done, total), optional

    Returns
    -------
    list of BakedTexture
        In namespace order.

    Raises
    ------
    FexelError
        The stage cannot be opened or has no fexel texture, an option is wrong, or the output cannot be written.
        Nothing is written then.

    Warns
    -----
    FexelWarning
        A texture that varies over time, or transparency or values that the image format cannot hold.

    Examples
    --------
    >>> bake_stage("ground.usda", "ground_baked.usdz", size=8192)  # doctest: +SKIP
    """
    _check_options(out, size, image_format)
    stage = open_stage(stage_file)
    _check_output(out, stage)
    flat = _flattened(stage)
    textures = _textures(flat, stage_file, prim)
    step = progress or silent
    baked = []
    with _output(out) as staged:
        step("textures", 0, len(textures))
        for number, texture in enumerate(textures):
            name = _file_name(texture, baked)
            baked.append(_bake(texture, staged.textures / name, size, image_format, time))
            step("textures", number + 1, len(textures))
        if not prim:
            tone_plain(flat, _time(time))
            remove_own(flat)
        collect_files(flat.GetRootLayer(), staged.textures, is_package=_is_package(out))
        if not flat.GetRootLayer().Export(str(staged.stage)):
            raise FexelError(f"{out}: cannot be written")
    return baked


def _check_options(out: str | Path, size: int | None, image_format: str) -> None:
    if size is not None and not _SIZES[0] <= size <= _SIZES[1]:
        raise FexelError(f"--size: {size}, expected {_SIZES[0]} to {_SIZES[1]} pixels")
    if image_format and image_format not in _FORMATS:
        raise FexelError(f"--format: '{image_format}', expected one of {', '.join(_FORMATS)}")
    if _is_package(out) and image_format and image_format not in _IN_PACKAGES:
        raise FexelError(f"--format: {image_format} cannot go into {out}, expected one of {', '.join(_IN_PACKAGES)}")


def _check_output(out: str | Path, stage: Usd.Stage) -> None:
    files = [layer.realPath for layer in stage.GetUsedLayers() if layer.realPath]
    if _is_package(out):
        check_package(out, files)
    else:
        check_output(out, files, [PACKAGE])


def _is_package(out: str | Path) -> bool:
    return Path(out).suffix.lower() == PACKAGE


@contextmanager
def _output(out: str | Path) -> Iterator[StagedOutput]:
    with packaged_output(out) if _is_package(out) else staged_output(out) as staged:
        yield staged


def _flattened(stage: Usd.Stage) -> Usd.Stage:
    """All of a stage in one anonymous layer; paths of files are absolute."""
    layer = stage.Flatten(addSourceFileComment=False)
    flat = Usd.Stage.Open(layer)
    flat.SetEditTarget(layer)
    return flat


def _textures(flat: Usd.Stage, stage_file: str | Path, prim: str) -> list[Usd.Prim]:
    """What is to be baked."""
    if not prim:
        found = texture_roots(flat)
        if not found:
            raise FexelError(f"{stage_file}: has no fexel texture, expected at least one to bake")
        return found
    if not Sdf.Path.IsValidPathString(prim) or not Sdf.Path(prim).IsAbsolutePath():
        raise FexelError(f"--prim: '{prim}', expected the path of a prim such as /World/Materials/Ground/Texture")
    if not flat.GetPrimAtPath(prim):
        raise FexelError(f"--prim: {prim}: {stage_file} has no such prim")
    found = texture_roots(flat, Sdf.Path(prim))
    if not found:
        part = " (it is a part of one)" if is_own(flat.GetPrimAtPath(prim)) else ""
        raise FexelError(f"--prim: {prim}: is no fexel texture and has none below it{part}")
    return found


def _file_name(texture: Usd.Prim, earlier: list[BakedTexture]) -> str:
    """Stem after the prim, and the material it is in; unique without regard to case."""
    parent = texture.GetParent()
    stem = f"{parent.GetName()}_{texture.GetName()}" if parent and not parent.IsPseudoRoot() else texture.GetName()
    taken = {Path(other.file).stem.lower() for other in earlier}
    name, number = stem, 2
    while name.lower() in taken:
        name, number = f"{stem}_{number}", number + 1
    return name


def _bake(texture: Usd.Prim, stem: Path, size: int | None, image_format: str, time: float | None) -> BakedTexture:
    """Bake one texture, write its picture, and turn the prim into what reads it."""
    prim_path = str(texture.GetPath())
    if time is None:
        _warn_of_motion(texture)
    kind, data = extract_texture(texture, _time(time))
    baker = texture_baker(kind, data, prim_path)
    storage, extension = _stored(baker.storage, image_format)
    picture = baker.bake(*_size(baker, size))
    _warn_of_loss(picture, baker.storage, extension, prim_path)
    file = stem.with_name(f"{stem.name}.{extension}")
    write_picture(file, picture, storage.color_space, storage.dtype)
    asked = minification_of_prim(texture, _time(time))
    if asked.attenuates:
        warnings.warn(
            f"{prim_path}: a picture cannot fade with distance; it is baked unfaded", FexelWarning, stacklevel=3
        )
    make_explicit(texture, str(file), storage.color_space, *toned(storage.scale, storage.bias, asked))
    height, width = picture.shape[:2]
    return BakedTexture(prim_path, file.name, (width, height), os.path.getsize(file))


def _time(time: float | None) -> Usd.TimeCode:
    return Usd.TimeCode.EarliestTime() if time is None else Usd.TimeCode(time)


def _size(baker: TextureBaker, size: int | None) -> tuple[int, int]:
    width, height = baker.size(LARGEST if size is None else size)
    if size is None or max(width, height) == size:
        return width, height
    scale = size / max(width, height)
    return max(1, round(width * scale)), max(1, round(height * scale))


def _stored(storage: Storage, image_format: str) -> tuple[Storage, str]:
    """How a picture is stored in a format, and the extension of its file."""
    extension = image_format or ("exr" if storage.dtype == "half" else "png")
    if extension == "exr":
        return replace(storage, color_space="raw", dtype="half"), extension
    if extension == "jpg":
        return replace(storage, dtype="uint8"), extension
    return replace(storage, dtype="uint16" if storage.dtype == "half" else storage.dtype), extension


def _warn_of_loss(picture: np.ndarray, storage: Storage, extension: str, prim_path: str) -> None:
    if extension == "jpg" and float(picture[..., 3].min()) < 1 - 0.5 / 255:
        warnings.warn(f"{prim_path}: JPEG has no alpha, the texture becomes opaque", FexelWarning, stacklevel=3)
    low, high = float(picture[..., :3].min()), float(picture[..., :3].max())
    if storage.dtype == "half" and extension != "exr" and (low < 0.0 or high > 1.0):
        fault = f"values from {low:g} to {high:g} are cut to 0..1 in .{extension}; .exr holds them"
        warnings.warn(f"{prim_path}: {fault}", FexelWarning, stacklevel=3)


def _warn_of_motion(texture: Usd.Prim) -> None:
    """Say that only one time of a texture is baked, where it has several."""
    times = {t for prim in Usd.PrimRange(texture) for a in prim.GetAttributes() for t in a.GetTimeSamples()}
    if len(times) > 1:
        fault = f"varies over time; frame {min(times):g} is baked, --time chooses another"
        warnings.warn(f"{texture.GetPath()}: {fault}", FexelWarning, stacklevel=3)
