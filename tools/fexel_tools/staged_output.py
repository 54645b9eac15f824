"""All or nothing: a stage and its folder of textures appear together, or nothing changes.

Everything is made in a hidden folder beside the output, under the names it will have, so that relative paths hold; at
the end the textures, then the stage, are renamed into place. A run that fails or is interrupted leaves the earlier
output as it was.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pxr import Sdf

from fexel.errors import FexelError

__all__ = ["StagedOutput", "check_output", "staged_output"]

_EXTENSIONS = (".usda", ".usdc", ".usd")
_TEXTURE_EXTENSIONS = (".tif", ".exr", ".png", ".jpg")


@dataclass(frozen=True)
class StagedOutput:
    """Where to write while the output is in the making.

    Attributes
    ----------
    stage : Path
        The stage to write.
    textures : Path
        An empty folder beside it.
    """

    stage: Path
    textures: Path


def check_output(out: str | Path) -> None:
    """See to it, before any work, that the output can be written.

    Raises
    ------
    FexelError
        Wrong extension, missing or unwritable folder, a folder in the way, or a folder of textures that holds other
        files.
    """
    path = Path(out)
    if path.suffix.lower() not in _EXTENSIONS:
        hint = " (textures of a .usdz must be PNG, JPEG or EXR; package the finished stage with usdzip)"
        hint = hint if path.suffix.lower() == ".usdz" else ""
        raise FexelError(f"{out}: output is '{path.suffix}', expected one of {', '.join(_EXTENSIONS)}{hint}")
    if not path.parent.is_dir():
        raise FexelError(f"{out}: the folder {path.parent} does not exist")
    if path.is_dir():
        raise FexelError(f"{out}: is a folder, expected a file name")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise FexelError(f"{out}: the folder {path.parent} cannot be written to")
    textures = _textures_folder(path)
    if textures.exists() and not _is_ours(path, textures):
        raise FexelError(
            f"{textures}: is in the way and holds more than textures; remove it or choose another output name"
        )


@contextmanager
def staged_output(out: str | Path) -> Iterator[StagedOutput]:
    """Give a place to write; on leaving without an error move everything to `out`.

    Raises
    ------
    FexelError
        As `check_output`, or when the final renaming fails.
    """
    path = Path(out)
    check_output(path)
    try:
        folder = Path(tempfile.mkdtemp(prefix=f".{path.stem}.", dir=path.parent))
    except OSError as error:
        raise FexelError(f"{out}: cannot be written: {error.strerror}") from error
    try:
        staged = StagedOutput(folder / path.name, folder / _textures_folder(path).name)
        staged.textures.mkdir()
        yield staged
        _move_into_place(staged, path, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _textures_folder(path: Path) -> Path:
    return path.with_name(f"{path.stem}_textures")


def _is_ours(stage: Path, textures: Path) -> bool:
    if not textures.is_dir():
        return False
    entries = list(textures.iterdir())
    return not entries or (
        stage.exists() and all(e.is_file() and e.suffix.lower() in _TEXTURE_EXTENSIONS for e in entries)
    )


def _move_into_place(staged: StagedOutput, path: Path, folder: Path) -> None:
    textures, earlier = _textures_folder(path), folder / "earlier"
    os.chmod(staged.textures, 0o777 & ~_umask())
    try:
        if textures.exists():
            os.replace(textures, earlier)
        os.replace(staged.textures, textures)
        os.replace(staged.stage, path)
    except OSError as error:
        if earlier.exists():
            shutil.rmtree(textures, ignore_errors=True)
            os.replace(earlier, textures)
        raise FexelError(f"{path}: cannot be written: {error.strerror}") from error
    layer = Sdf.Layer.Find(str(path))
    if layer:  # an earlier version of the stage is open in this process
        layer.Reload(True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
