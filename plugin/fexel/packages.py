"""Files inside packages (``wall.usdz[textures/wall.png]``), made readable for libraries that know only the file system.

USD resolves such a path and hands out the bytes; OpenImageIO wants a file. The first use of a path unpacks it into a
folder of this process, which is removed at exit.
"""

from __future__ import annotations

import atexit
import functools
import os
import shutil
import tempfile
from pathlib import Path

from fexel.errors import FexelError

__all__ = ["is_packaged", "local_file"]


def is_packaged(path: str) -> bool:
    """Whether the path names a file inside a package."""
    return path.endswith("]") and "[" in path


def local_file(path: str) -> str:
    """A path that the file system knows: `path` itself, or the unpacked copy of a packaged file.

    Raises
    ------
    FexelError
        The package is missing, or has no such file.
    """
    if not is_packaged(path):
        return path
    package = path.split("[", 1)[0]
    try:
        version = os.stat(package).st_mtime_ns
    except OSError:
        raise FexelError(f"{path}: no such file") from None
    return _unpacked(path, version)


@functools.cache
def _unpacked(path: str, _version: int) -> str:
    from pxr import Ar

    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(path))
    if not asset:
        raise FexelError(f"{path}: no such file")
    inner = path.rsplit("[", 1)[1].rstrip("]")
    handle, copy = tempfile.mkstemp(prefix="", suffix=f"-{Path(inner).name}", dir=_folder())
    with os.fdopen(handle, "wb") as file:
        file.write(asset.GetBuffer())
    return copy


@functools.cache
def _folder() -> str:
    folder = tempfile.mkdtemp(prefix="fexel-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
