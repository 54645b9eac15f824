"""The files of a baked stage: its images copied beside it, or everything in one usdz package."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from pxr import Sdf, Tf, UsdShade, UsdUtils

from fexel.errors import FexelError, FexelWarning
from fexel.packages import is_packaged, local_file
from fexel_tools.report import check_report
from fexel_tools.staged_output import StagedOutput

__all__ = ["PACKAGE", "check_package", "collect_files", "packaged_output"]

PACKAGE = ".usdz"
_PACKAGED_IMAGES = (".png", ".jpg", ".jpeg", ".exr", ".avif")  # what the usdz specification allows


def check_package(out: str | Path, inputs: Iterable[str | Path] = ()) -> None:
    """See to it, before any work, that a package can be written and replaces no input.

    Raises
    ------
    FexelError
        As `fexel_tools.report.check_report`.
    """
    check_report(out, (), "package")
    if any(Path(out).resolve() == Path(file).resolve() for file in inputs):
        raise FexelError(f"{out}: is an input of this run, expected another output name")


@contextmanager
def packaged_output(out: str | Path) -> Iterator[StagedOutput]:
    """Give a place to write a stage and its textures; on leaving without an error pack them into `out`.

    Raises
    ------
    FexelError
        The package cannot be written.
    """
    path = Path(out)
    try:
        folder = Path(tempfile.mkdtemp(prefix=f".{path.stem}.", dir=path.parent))
    except OSError as error:
        raise FexelError(f"{out}: cannot be written: {error.strerror}") from error
    try:
        staged = StagedOutput(folder / f"{path.stem}.usdc", folder / "textures")
        staged.textures.mkdir()
        yield staged
        package = folder / path.name
        _undate(folder)
        _pack(staged.stage, package, out)
        os.replace(package, path)
    except OSError as error:
        raise FexelError(f"{out}: cannot be written: {error.strerror}") from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    layer = Sdf.Layer.Find(str(path))
    if layer:  # an earlier version is open in this process
        layer.Reload(True)


def collect_files(layer: Sdf.Layer, folder: Path, *, is_package: bool) -> None:
    """Copy every file that a flattened layer names into a folder, and name the copies, relative to the folder's parent.

    Parameters
    ----------
    layer : Sdf.Layer
        Its paths are absolute.
    folder : Path
        Beside where the layer will lie; files in it stay as they are.
    is_package : bool
        Warn of images that a usdz package may not hold.

    Warns
    -----
    FexelWarning
        A file that is missing: its path stays as it was.
    """
    copies: dict[str, str] = {}

    def relocated(path: str) -> str:
        if path and path not in copies:
            copies[path] = _collect(path, folder, is_package)
        return copies.get(path, path)

    UsdUtils.ModifyAssetPaths(layer, relocated)


def _collect(path: str, folder: Path, is_package: bool) -> str:
    """The path to author for a file."""
    if UsdShade.UdimUtils.IsUdimIdentifier(path):
        tiles = [tile for tile, _ in UsdShade.UdimUtils.ResolveUdimTilePaths(path, Sdf.Layer())]
        for tile in tiles:
            _copy(tile, folder / Path(tile).name)
        return f"./{folder.name}/{Path(path).name}" if tiles else _missing(path)
    inner = path.rsplit("[", 1)[1].rstrip("]") if is_packaged(path) else path
    if is_package and Path(inner).suffix.lower() not in _PACKAGED_IMAGES:
        warnings.warn(f"{path}: a .usdz should hold PNG, JPEG or EXR images only", FexelWarning, stacklevel=4)
    if Path(path).parent == folder:
        return f"./{folder.name}/{Path(path).name}"
    try:
        source = local_file(path)
    except FexelError:
        return _missing(path)
    if not Path(source).is_file():
        return _missing(path)
    return f"./{folder.name}/{_copy(source, _free(folder / Path(inner).name)).name}"


def _missing(path: str) -> str:
    warnings.warn(f"{path}: no such file; the baked stage names it all the same", FexelWarning, stacklevel=5)
    return path


def _copy(source: str, target: Path) -> Path:
    try:
        shutil.copyfile(source, target)
    except OSError as error:
        raise FexelError(f"{source}: cannot be copied: {error.strerror}") from error
    return target


def _free(path: Path) -> Path:
    """A name that no file has yet."""
    candidate, number = path, 2
    while candidate.exists():
        candidate, number = path.with_stem(f"{path.stem}_{number}"), number + 1
    return candidate


def _undate(folder: Path) -> None:
    """Give all files the first time that a zip archive can note, so that the same stage makes the same bytes."""
    earliest = time.mktime((1980, 1, 1, 0, 0, 0, 0, 1, -1))  # local, as archives note it
    for file in folder.rglob("*"):
        os.utime(file, (earliest, earliest))


def _pack(stage: Path, package: Path, out: str | Path) -> None:
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        done = UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(stage)), str(package))
    except Tf.ErrorException as error:
        reasons = [" ".join(part.commentary.split()) for part in error.args if hasattr(part, "commentary")]
        raise FexelError(f"{out}: cannot be packed: {'; '.join(reasons)}") from None
    finally:
        diagnostics.TakeUncoalescedDiagnostics()
    if not done:
        raise FexelError(f"{out}: cannot be packed")
