"""Chains on disk, one file per direction of an image, found by the content of what they are made of.

A file lies in the folder ``.fexel-cache`` beside the image or its package, where that cannot be written in the user's
cache folder, or where the environment variable FEXEL_CACHE says: a folder, or 0 for nowhere. It is written beside its
place and renamed, so that there is a whole one or none, whoever else writes it. It is mapped into memory: what is not
looked at is not read. A file that is damaged, cut off or of another version counts as missing.

Layout: magic, key (32 bytes), size of the file (uint64), CRC-32 of each cell and of all that is before it (uint32);
then, from the next multiple of 4096 bytes on, the cells of `ChainLayout.places`, little-endian. A cell is checked when
it is first looked at.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import secrets
import struct
import sys
import time
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike, NDArray

from fexel.filters.chain_layout import ChainLayout

__all__ = [
    "MAPPED_BYTES",
    "ChainDraft",
    "ChainFile",
    "DamagedChainError",
    "cache_folders",
    "draft_chains",
    "find_chains",
]

MAPPED_BYTES = 2 * 2**20
"""What a mapped file counts as in memory: its pages can be dropped at any time, but not its file descriptor."""

_MAGIC = b"FXCHAINS"
_FOLDER = ".fexel-cache"
_MOST_BYTES = 8 * 2**30  # of a folder
_LEFT_BEHIND = 86400.0  # seconds after which what is still being written is not
_PAGE = 4096

_Cell = tuple[int, int]


class DamagedChainError(Exception):
    """Texels on disk are not those that were written."""


def cache_folders(file: str) -> list[Path]:
    """Where chains of an image file, or of one in a package, may be kept: the best place first."""
    chosen = os.environ.get("FEXEL_CACHE")
    if chosen is not None:
        return [] if chosen.strip().lower() in ("", "0", "off", "false", "no") else [Path(chosen).expanduser()]
    beside = Path(file.split("[", 1)[0] if file.endswith("]") else file).parent
    return [beside / _FOLDER, _user_folder()]


def _user_folder() -> Path:
    if os.environ.get("XDG_CACHE_HOME"):
        return Path(os.environ["XDG_CACHE_HOME"]) / "fexel"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", "~/AppData/Local")).expanduser() / "fexel" / "cache"
    return Path("~/Library/Caches" if sys.platform == "darwin" else "~/.cache").expanduser() / "fexel"


def find_chains(folders: Sequence[Path], key: bytes, layout: ChainLayout, dtype: DTypeLike) -> ChainFile | None:
    """The chains of this key (32 bytes), if any of the folders has them."""
    for folder in folders:
        with contextlib.suppress(OSError, DamagedChainError, ValueError):
            path = _path(folder, key)
            with open(path, "rb") as file:
                mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            chains = ChainFile(mapped, key, layout, np.dtype(dtype))
            with contextlib.suppress(OSError):  # a folder that cannot be written to: then nothing is removed either
                os.utime(path)
            return chains
    return None


def draft_chains(folders: Sequence[Path], key: bytes, layout: ChainLayout, dtype: DTypeLike) -> ChainDraft | None:
    """A place to make chains of this key in, if any of the folders can be written to and has room."""
    for folder in folders:
        with contextlib.suppress(OSError):
            _make(folder)
            return ChainDraft(folder, key, layout, np.dtype(dtype))
    return None


class ChainFile:
    """Chains in a file, mapped.

    Parameters
    ----------
    mapped : mmap
    key : bytes
    layout : ChainLayout
    dtype : dtype

    Raises
    ------
    DamagedChainError
        It is not a whole file of this key and layout.
    """

    def __init__(self, mapped: mmap.mmap, key: bytes, layout: ChainLayout, dtype: np.dtype) -> None:
        start = _header_bytes(layout)
        head = _head(key, layout, dtype)
        sums = np.frombuffer(mapped, "<u4", len(layout.cells) + 1, len(head)) if len(mapped) >= start else np.zeros(1)
        if len(mapped) != _total_bytes(layout, dtype) or mapped[: len(head)] != head:
            raise DamagedChainError
        if zlib.crc32(mapped[: len(head) + 4 * len(layout.cells)]) != sums[-1]:
            raise DamagedChainError
        self._cells = _cells(mapped, layout, dtype)
        self._sums = dict(zip(layout.cells, sums[:-1].tolist(), strict=True))
        self._checked: set[_Cell] = set()

    def __getitem__(self, cell: _Cell) -> NDArray:
        """(h + 2, w + 2, 4), read only.

        Raises
        ------
        DamagedChainError
        """
        texels = self._cells[cell]
        if cell not in self._checked:
            if zlib.crc32(texels) != self._sums[cell]:
                raise DamagedChainError
            self._checked.add(cell)
        return texels


class ChainDraft:
    """Chains in the making, in a hidden file beside the one that they will be.

    Parameters
    ----------
    folder : Path
    key : bytes
    layout : ChainLayout
    dtype : dtype

    Attributes
    ----------
    cells : dict
        By cell: (h + 2, w + 2, 4), to be filled.

    Raises
    ------
    OSError
        The folder cannot be written to, or has no room.
    """

    def __init__(self, folder: Path, key: bytes, layout: ChainLayout, dtype: np.dtype) -> None:
        self._path = _path(folder, key)
        self._head = _head(key, layout, dtype)
        self._part = folder / f".{key.hex()[:8]}.{os.getpid()}.{secrets.token_hex(4)}.part"
        handle = os.open(self._part, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666)
        try:
            # All of it is reserved first: to write a mapped page for which there is no room ends the process.
            _reserve(handle, _total_bytes(layout, dtype))
            self._mapped = mmap.mmap(handle, 0)
        except BaseException:
            os.remove(self._part)
            raise
        finally:
            os.close(handle)
        self.cells = _cells(self._mapped, layout, dtype)

    def finish(self) -> None:
        """Put the file into its place; where that fails, the cells remain all the same."""
        sums = [zlib.crc32(texels) for texels in self.cells.values()]
        head = self._head + struct.pack(f"<{len(sums)}I", *sums)
        self._mapped[: len(head) + 4] = head + struct.pack("<I", zlib.crc32(head))
        try:
            os.replace(self._part, self._path)
            _make_room(self._path)
        except OSError:
            self.discard()

    def discard(self) -> None:
        """Leave nothing behind."""
        with contextlib.suppress(OSError):
            os.remove(self._part)


def _path(folder: Path, key: bytes) -> Path:
    return folder / f"{key.hex()}.chains"


def _head(key: bytes, layout: ChainLayout, dtype: np.dtype) -> bytes:
    return _MAGIC + key + struct.pack("<Q", _total_bytes(layout, dtype))


def _header_bytes(layout: ChainLayout) -> int:
    return -(-(len(_MAGIC) + 32 + 8 + 4 * (len(layout.cells) + 1)) // _PAGE) * _PAGE


def _total_bytes(layout: ChainLayout, dtype: np.dtype) -> int:
    return _header_bytes(layout) + layout.total * 4 * dtype.itemsize


def _cells(mapped: mmap.mmap, layout: ChainLayout, dtype: np.dtype) -> dict[_Cell, NDArray]:
    block = np.frombuffer(mapped, dtype.newbyteorder("<"), layout.total * 4, _header_bytes(layout)).reshape(-1, 4)
    return layout.cells_in(block)


def _reserve(handle: int, size: int) -> None:
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(handle, 0, size)
        return
    zeros = bytes(2**20)
    for start in range(0, size, len(zeros)):
        os.write(handle, zeros[: size - start])


def _make(folder: Path) -> None:
    """Make the folder, one that version control and backups leave alone."""
    if folder.is_dir():
        return
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ".gitignore").write_text("*\n", encoding="ascii")
    tag = "Signature: 8a477f597d28d172789f06886806bc55\n# Made by fexel; it may be removed at any time.\n"
    (folder / "CACHEDIR.TAG").write_text(tag, encoding="ascii")


def _make_room(newest: Path) -> None:
    """Remove what was used longest ago, past the size that a folder may have, and what was never finished."""
    files = []
    for path in newest.parent.iterdir():
        with contextlib.suppress(OSError):  # another process may have removed it
            status = path.stat()
            if path.suffix == ".part" and time.time() - status.st_mtime > _LEFT_BEHIND:
                path.unlink()
            elif path.suffix == ".chains" and path != newest:
                files.append((status.st_mtime, status.st_size, path))
    room = _MOST_BYTES - newest.stat().st_size
    for _, size, path in sorted(files, reverse=True):
        room -= size
        if room < 0:
            with contextlib.suppress(OSError):
                path.unlink()
