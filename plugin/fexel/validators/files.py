"""Whether the images that a stage names are there and can be read to the last row."""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator

from pxr import Sdf, Usd, UsdShade

from fexel.errors import FexelError
from fexel.images import ImageInfo, image_info, read_pixels
from fexel.packages import local_file
from fexel.schema.definition import asset_attributes
from fexel.validators.fault import Fault, authored_values
from fexel.validators.prim_validator import ANY, PrimValidator

__all__ = ["VALIDATORS", "check_files", "file_version", "image_header", "resolved_files"]


def check_files(prim: Usd.Prim) -> Iterator[Fault]:
    """Missing, unreadable and truncated images."""
    for attribute in asset_attributes(prim):
        for when, asset in authored_values(attribute):
            if not asset.path:
                continue
            if UsdShade.UdimUtils.IsUdimIdentifier(asset.path):
                message = f"{asset.path}: <UDIM> tiles are not drawn, expected one image{when}"
                yield Fault(attribute.GetPath(), message, is_error=False)
            try:
                _check_asset(attribute, asset)
            except FexelError as error:
                yield Fault(attribute.GetPath(), f"{error}{when}")


def _check_asset(attribute: Usd.Attribute, asset: Sdf.AssetPath) -> None:
    files = resolved_files(attribute, asset)
    if not files:
        raise FexelError(f"{asset.path}: no such file")
    for file in files:
        _read_last_row(file, *file_version(file))


def resolved_files(attribute: Usd.Attribute, asset: Sdf.AssetPath) -> list[str]:
    """Files on disk that an asset value stands for: one, the tiles of a ``<UDIM>`` pattern, or none.

    A file inside a usdz package resolves to ``package.usdz[file]``.
    """
    if UsdShade.UdimUtils.IsUdimIdentifier(asset.path):
        layer = next((spec.layer for spec in attribute.GetPropertyStack() if spec.layer), None)
        return [path for path, _ in UsdShade.UdimUtils.ResolveUdimTilePaths(asset.path, layer)] if layer else []
    return [asset.resolvedPath] if asset.resolvedPath else []


def image_header(path: str) -> ImageInfo:
    """`fexel.images.image_info`, remembered as long as the file does not change."""
    return _header(path, *file_version(path))


def file_version(path: str) -> tuple[int, int]:
    """Time of the last change, ns, and size in bytes: what is known of a file holds as long as these stay."""
    try:
        status = os.stat(local_file(path))
    except OSError as error:
        raise FexelError(f"{path}: {error.strerror}") from None
    return status.st_mtime_ns, status.st_size


@functools.lru_cache(maxsize=65536)
def _header(path: str, _mtime_ns: int, _size: int) -> ImageInfo:
    return image_info(path)


@functools.lru_cache(maxsize=65536)
def _read_last_row(path: str, _mtime_ns: int, _size: int) -> None:
    """Whoever can read the last row has the whole file, for formats store rows or tiles in order."""
    info = image_header(path)
    read_pixels(info, 0, (0, info.height - 1, info.width, info.height))


VALIDATORS = (
    PrimValidator(
        "fexel:Files", "Images that a texture names must exist and be readable to the last row.", ANY, check_files
    ),
)
