"""What chains on disk are known by: the content of their files and all that is done to it."""

from __future__ import annotations

import functools
import hashlib
import os

from fexel.errors import FexelError
from fexel.filters.chain_layout import ChainLayout
from fexel.packages import local_file
from fexel.textures.image_source import ImageSource
from fexel.textures.pyramid_cache import ImageFacts

__all__ = ["FORMAT_VERSION", "chain_key"]

FORMAT_VERSION = 2
"""Raised with every change of what is in a file, or of how it is computed."""


def chain_key(source: ImageSource, facts: ImageFacts, layout: ChainLayout) -> bytes | None:
    """32 bytes that are equal where the texels are; None where a file cannot be read.

    Parameters
    ----------
    source : ImageSource
    facts : ImageFacts
    layout : ChainLayout
    """
    try:
        files = [_digest(path) if path else b"" for path in (source.file, source.mask)]
    except (OSError, FexelError):
        return None
    done = (
        FORMAT_VERSION,
        *(source.color_space, source.scale, source.bias, facts.page_class, layout.blur),
        *(layout.direction.long_axis, layout.direction.shear, layout.size, layout.image_wrap, layout.octaves),
    )
    return hashlib.sha256(b"".join(files) + repr(done).encode()).digest()


def _digest(path: str) -> bytes:
    file = local_file(path)
    status = os.stat(file)
    # A file that is written in place may keep its size, and its time where clocks are coarse or tools set it.
    return _digest_of(file, (status.st_mtime_ns, status.st_ctime_ns, status.st_ino, status.st_size))


@functools.lru_cache(maxsize=4096)
def _digest_of(path: str, _status: tuple[int, ...]) -> bytes:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").digest()
