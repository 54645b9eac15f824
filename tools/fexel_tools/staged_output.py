"""All or nothing: a stage and its folder of textures appear together, or nothing changes.

Everything is made in a hidden folder beside the output, under the names it will have, so that relative paths hold; at
the end the textures, then the stage, are renamed into place. A run that fails or is interrupted leaves the earlier
output as it was.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pxr import Sdf, Tf, UsdUtils

from fexel.errors import FexelError

__all__ = ["StagedOutput", "check_output", "staged_output"]

_EXTENSIONS = (".usda", ".usdc", ".usd")
_EARLIER = "earlier"  # textures of the earlier output, while the new ones take their place


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


def check_output(out: str | Path, inputs: Iterable[str | Path] = (), others: Sequence[str] = ()) -> None:
    """See to it, before any work, that the output can be written and takes nothing else away.

    Parameters
    ----------
    out : str or Path
    inputs : iterable of str or Path
        Files that the output is made from: they must neither be the output nor lie in its folder of textures.
    others : sequence of str
        Extensions that the command takes besides those of stages, for the message.

    Raises
    ------
    FexelError
        Wrong extension, missing or unwritable folder, a folder in the way, a folder of textures that holds files which
        the earlier stage does not name, or an input that would be replaced.
    """
    path = Path(out)
    if path.suffix.lower() not in _EXTENSIONS:
        hint = " (textures of a .usdz must be PNG, JPEG or EXR; package the finished stage with usdzip)"
        hint = hint if path.suffix.lower() == ".usdz" else ""
        expected = ", ".join([*_EXTENSIONS, *others])
        raise FexelError(f"{out}: output is '{path.suffix}', expected one of {expected}{hint}")
    if not path.parent.is_dir():
        raise FexelError(f"{out}: the folder {path.parent} does not exist")
    if path.is_dir():
        raise FexelError(f"{out}: is a folder, expected a file name")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise FexelError(f"{out}: the folder {path.parent} cannot be written to")
    textures = _textures_folder(path)
    if textures.exists() and not _is_ours(path, textures):
        raise FexelError(
            f"{textures}: is in the way and holds files that are not textures of {path.name}; remove it or choose "
            "another output name"
        )
    for file in inputs:
        _check_input(path, textures, file)


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
        if not (folder / _EARLIER).exists() or _textures_folder(path).exists():  # else they could not be moved back
            shutil.rmtree(folder, ignore_errors=True)


def _textures_folder(path: Path) -> Path:
    return path.with_name(f"{path.stem}_textures")


def _check_input(out: Path, textures: Path, file: str | Path) -> None:
    resolved = Path(file).resolve()
    if resolved == out.resolve():
        raise FexelError(f"{out}: is an input of this run, expected another output name")
    if resolved.is_relative_to(textures.resolve()):
        raise FexelError(f"{file}: lies in {textures}, which the output replaces; choose another output name")


def _is_ours(stage: Path, textures: Path) -> bool:
    """Whether the folder is empty, or holds only files that the earlier stage names."""
    if not textures.is_dir():
        return False
    entries = {entry.resolve() for entry in textures.iterdir()}
    return not entries or (stage.is_file() and entries <= _named_files(stage))


def _named_files(stage: Path) -> set[Path]:
    """Files that a layer's own asset paths name; none where it cannot be read."""
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()  # an unreadable stage names nothing; USD need not say so too
    try:
        _, assets, _ = UsdUtils.ExtractExternalReferences(str(stage))
    except Tf.ErrorException:
        return set()
    finally:
        diagnostics.TakeUncoalescedDiagnostics()
    return {(stage.parent / asset).resolve() for asset in assets}


def _move_into_place(staged: StagedOutput, path: Path, folder: Path) -> None:
    if not staged.stage.is_file():
        raise FexelError(f"{path}: cannot be written: no stage was made")
    textures, earlier = _textures_folder(path), folder / _EARLIER
    try:
        os.chmod(staged.textures, 0o777 & ~_umask())
        if textures.exists():
            os.replace(textures, earlier)
        os.replace(staged.textures, textures)
        os.replace(staged.stage, path)
    except BaseException as error:  # also an interruption between two renamings
        if staged.stage.exists():
            _move_back(staged, textures, earlier)
        if isinstance(error, OSError):
            raise FexelError(f"{path}: cannot be written: {error.strerror}") from error
        raise
    layer = Sdf.Layer.Find(str(path))
    if layer:  # an earlier version of the stage is open in this process
        layer.Reload(True)


def _move_back(staged: StagedOutput, textures: Path, earlier: Path) -> None:
    """Undo the renaming of textures; what is on disk tells how far it came."""
    if not staged.textures.exists():
        os.replace(textures, staged.textures)
    if earlier.exists():
        os.replace(earlier, textures)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
