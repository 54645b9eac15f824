"""AOV arrays to image files, through OpenImageIO: written beside the target, then renamed.

EXR holds all AOVs as channels of one file: ``R G B A`` (half) for the colour, ``depth.Z``, ``normal.X`` ... (float)
for the others. Other formats get one file per AOV: the colour keeps the name, for the rest the AOV's name is put in
before the extension (``name.depth.png``); a single AOV keeps the name whichever it is.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fexel.errors import FexelError
from fexel.renderer.aov import AOVS, checked_aovs
from fexel.renderer.encoding import ColorCorrection, data_range, visible_data

__all__ = ["FORMATS", "check_output", "file_names", "write_images"]

_ROWS = 256  # written at a time, so that a big image needs no second copy in memory


@dataclass(frozen=True)
class _Format:
    """`pixel_type`: of OpenImageIO; `alpha`, `grey`: whether it keeps such channels; `linear`: holds linear light."""

    pixel_type: str
    alpha: bool = False
    linear: bool = False
    grey: bool = False


FORMATS = {
    ".exr": _Format("half", alpha=True, linear=True),
    ".hdr": _Format("float", linear=True),
    ".png": _Format("uint8", alpha=True, grey=True),
    ".tif": _Format("uint16", alpha=True, grey=True),
    ".tiff": _Format("uint16", alpha=True, grey=True),
    ".jpg": _Format("uint8", grey=True),
    ".jpeg": _Format("uint8", grey=True),
    ".webp": _Format("uint8", alpha=True),
    ".tga": _Format("uint8", alpha=True),
    ".bmp": _Format("uint8"),
    ".ppm": _Format("uint8"),
}


def _format(path: Path) -> _Format:
    extension = path.suffix.lower()
    if extension not in FORMATS:
        raise FexelError(
            f"{path}: cannot write {extension or 'a file without extension'}; expected {' '.join(FORMATS)}"
        )
    return FORMATS[extension]


def check_output(path: str | os.PathLike) -> None:
    """Find out before rendering whether an image can be written there.

    Raises
    ------
    FexelError
        Unknown extension, missing or unwritable folder, a folder in the file's place.
    """
    path = Path(path)
    _format(path)
    folder = path.parent
    if not folder.is_dir():
        raise FexelError(f"{path}: the folder {folder} does not exist")
    if path.is_dir():
        raise FexelError(f"{path}: is a folder, expected an image file")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise FexelError(f"{path}: the folder {folder} is not writable")


def file_names(path: str | os.PathLike, aovs: Sequence[str]) -> dict[str, Path]:
    """File of each AOV."""
    path = Path(path)
    names = [aov.name for aov in checked_aovs(aovs)]
    if path.suffix.lower() == ".exr" or len(names) == 1:
        return dict.fromkeys(names, path)
    return {name: path if name == "color" else path.with_suffix(f".{name}{path.suffix}") for name in names}


def write_images(
    path: str | os.PathLike, images: Mapping[str, np.ndarray], color_correction: str | None = None
) -> list[Path]:
    """Write the AOVs of a frame.

    Parameters
    ----------
    path : path
        The extension chooses the format: exr, hdr (float, linear), png, jpg, webp, tga, bmp, ppm (8-bit), tif (16-bit).
    images : dict of str to (H, W, C) float32
        As `Renderer.render` returns them.
    color_correction : {'disabled', 'sRGB', 'openColorIO'}, optional
        Default: disabled for exr and hdr, sRGB for the others.

    Returns
    -------
    list of Path
        The files, which are complete when this returns; none is left half-written by an error.

    Raises
    ------
    FexelError
        Unknown extension or mode, or the file cannot be written.
    """
    path = Path(path)
    check_output(path)
    names = [aov.name for aov in checked_aovs(tuple(images))]
    mode = color_correction or ("disabled" if _format(path).linear else "sRGB")
    correction = ColorCorrection(mode)
    if path.suffix.lower() == ".exr":
        _write_exr(path, {name: images[name] for name in names}, correction)
        return [path]
    files = file_names(path, names)
    for name, file in files.items():
        _write_single(file, name, images[name], correction)
    return list(files.values())


def _write_exr(path: Path, images: Mapping[str, np.ndarray], correction: ColorCorrection) -> None:
    import OpenImageIO as oiio

    channels, types, sources = [], [], []
    for name in images:
        for index, suffix in enumerate(AOVS[name].channels):
            channels.append(
                suffix if name == "color" or (name == "alpha" and "color" not in images) else f"{name}.{suffix}"
            )
            types.append(oiio.HALF if name in ("color", "alpha") else oiio.FLOAT)
            sources.append((name, index))
    first = next(iter(images.values()))
    spec = oiio.ImageSpec(first.shape[1], first.shape[0], len(channels), oiio.FLOAT)
    spec.channelnames = tuple(channels)
    spec.channelformats = tuple(oiio.TypeDesc(kind) for kind in types)
    spec.alpha_channel = channels.index("A") if "A" in channels else -1
    spec.attribute("compression", "zip")
    if correction.mode == "disabled":
        spec.attribute("oiio:ColorSpace", "lin_rec709")

    def rows(begin: int, end: int) -> np.ndarray:
        parts = {name: image[begin:end] for name, image in images.items()}
        if "color" in parts and correction.mode != "disabled":
            parts["color"] = _corrected(parts["color"], correction, straight=False)
        return np.stack([parts[name][..., index] for name, index in sources], axis=-1)

    _write(path, spec, rows)


def _write_single(path: Path, name: str, image: np.ndarray, correction: ColorCorrection) -> None:
    import OpenImageIO as oiio

    form = _format(path)
    extent = data_range(name, image)

    def rows(begin: int, end: int) -> np.ndarray:
        part = image[begin:end]
        if name == "color":
            corrected = _corrected(part, correction, straight=form.alpha)
            return corrected if form.alpha else corrected[..., :3]
        shown = part if form.linear and name != "st" else visible_data(name, part, extent)
        return shown if shown.shape[-1] == 3 or form.grey else np.repeat(shown[..., :1], 3, -1)

    probe = rows(0, 1)
    spec = oiio.ImageSpec(image.shape[1], image.shape[0], probe.shape[-1], form.pixel_type)
    if name == "color":
        spec.attribute("oiio:UnassociatedAlpha", 1)
        spec.attribute(
            "oiio:ColorSpace", {"disabled": "lin_rec709", "sRGB": "srgb_rec709_scene"}.get(correction.mode, "")
        )
    spec.attribute("CompressionQuality", 95)
    _write(path, spec, rows)


def _corrected(color: np.ndarray, correction: ColorCorrection, *, straight: bool) -> np.ndarray:
    """Colour-corrected RGBA of premultiplied linear RGBA, straight or premultiplied again."""
    alpha = color[..., 3:]
    present = alpha > 0.0
    own = np.where(present, color[..., :3] / np.where(present, alpha, 1.0), color[..., :3])
    corrected = correction(own)
    if not straight:
        corrected = np.where(present, corrected * alpha, corrected)
    return np.concatenate([corrected, alpha], axis=-1).astype(np.float32)


def _write(path: Path, spec, rows: Callable[[int, int], np.ndarray]) -> None:
    import OpenImageIO as oiio

    spec.attribute("DateTime", "")  # none: the same picture makes the same bytes
    handle, name = _temporary(path)
    os.close(handle)
    temporary = Path(name)
    try:
        writer = oiio.ImageOutput.create(name)
        if writer is None or not writer.open(name, spec):
            raise FexelError(f"{path}: {_reason(writer.geterror() if writer else oiio.geterror())}")
        for begin in range(0, spec.height, _ROWS):
            end = min(begin + _ROWS, spec.height)
            pixels = np.ascontiguousarray(rows(begin, end), np.float32)
            if not writer.write_scanlines(begin, end, 0, pixels):
                raise FexelError(f"{path}: {_reason(writer.geterror())}")
        if not writer.close():
            raise FexelError(f"{path}: {_reason(writer.geterror())}")
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except OSError as error:
        raise FexelError(f"{path}: {error.strerror}") from None
    finally:
        temporary.unlink(missing_ok=True)


def _temporary(path: Path) -> tuple[int, str]:
    try:
        return tempfile.mkstemp(prefix=f".{path.stem}.", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise FexelError(f"{path}: {error.strerror}") from None


def _umask() -> int:
    # There is no way to read it without setting it.
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _reason(message: str) -> str:
    return " ".join(message.split()) or "cannot be written"
