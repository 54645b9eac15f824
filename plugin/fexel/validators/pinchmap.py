"""Pinchmaps: four channels in [-1, 1] without NaN, and a size that goes with that of the signal."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np
from pxr import Sdf, Usd

from fexel.errors import FexelError
from fexel.images import read_pixels
from fexel.textures.pinchmap_encoding import signal_half_texel
from fexel.textures.pinchmap_texels import LARGEST_PINCHMAP
from fexel.validators.fault import Fault
from fexel.validators.files import file_version, image_header, resolved_files
from fexel.validators.prim_validator import PrimValidator

__all__ = ["VALIDATORS", "check_pinchmap"]

_CHANNELS = 4
_UNUSED = {"uint8": 255, "uint16": 65535}  # would be a little over 1, and is read as 1
_NAMES = ("d_s", "d_t", "k", "gamma")


def check_pinchmap(prim: Usd.Prim) -> Iterator[Fault]:
    """What keeps a PinchmapTexture from showing its discontinuities; unreadable files are for `check_files` to say."""
    pinchmap, signal = (prim.GetAttribute(f"inputs:{name}") for name in ("pinchmap", "file"))
    if not pinchmap or not pinchmap.HasAuthoredValue():
        return
    times = sorted({*pinchmap.GetTimeSamples(), *(signal.GetTimeSamples() if signal else ())})
    said = set()
    for time in times or [Usd.TimeCode.Default()]:
        for message, is_error in _faults(pinchmap, signal, Usd.TimeCode(time)):
            if message not in said:
                said.add(message)
                when = f" at time {time:g}" if times else ""
                yield Fault(pinchmap.GetPath(), message + when, is_error)


def _faults(pinchmap: Usd.Attribute, signal: Usd.Attribute, time: Usd.TimeCode) -> Iterator[tuple[str, bool]]:
    """Message and whether it is an error."""
    asset = pinchmap.Get(time)
    file = _file(pinchmap, asset)
    if not file:
        return
    try:
        header = image_header(file)
        if header.channels != _CHANNELS:
            yield f"{asset.path}: {header.channels} channels, expected 4 (d_s, d_t, k, gamma)", True
            return
        if max(header.width, header.height) > LARGEST_PINCHMAP:
            size = f"{header.width} x {header.height} texels"
            yield f"{asset.path}: {size}, expected at most {LARGEST_PINCHMAP} along an axis", True
            return
        yield from _value_faults(asset.path, file)
    except FexelError:
        return
    yield from _size_faults(asset.path, (header.width, header.height), signal, time)


def _file(attribute: Usd.Attribute, asset: Sdf.AssetPath | None) -> str:
    files = resolved_files(attribute, asset) if asset is not None and asset.path else []
    return files[0] if files else ""


def _size_faults(
    name: str, size: tuple[int, int], signal: Usd.Attribute, time: Usd.TimeCode
) -> Iterator[tuple[str, bool]]:
    asset = signal.Get(time) if signal else None
    if asset is None or not asset.path:
        yield f"{name}: a pinchmap without inputs:file, expected a signal texture", True
        return
    file = _file(signal, asset)
    try:
        header = image_header(file) if file else None
    except FexelError:
        return
    if header is not None and signal_half_texel(size, (header.width, header.height)) is None:
        sizes = f"{size[0]} x {size[1]} texels for a signal of {header.width} x {header.height} ({asset.path})"
        yield f"{name}: {sizes}, expected the signal's size divided by the same power of two along both axes", True


def _value_faults(name: str, file: str) -> Iterator[tuple[str, bool]]:
    for problem, place in _first_bad_values(file, *file_version(file)):
        channel, column, row, value = place
        where = f"{_NAMES[channel]} is {value:g} at column {column}, row {row}"
        if problem == "unused":
            yield f"{name}: {where}, read as 1, expected at most {value - 1:g}", False
        elif problem == "outside":
            yield f"{name}: {where}, clamped, expected values in [-1, 1]", False
        else:
            yield f"{name}: {where}, expected finite values in [-1, 1]", True


@functools.lru_cache(maxsize=4096)
def _first_bad_values(file: str, _mtime_ns: int, _size: int) -> tuple[tuple[str, tuple[int, int, int, float]], ...]:
    """First value of each kind that should not be: what it is; channel, column, row, value."""
    texels = read_pixels(image_header(file))
    if texels.dtype.kind == "u":
        bad = {"unused": texels == _UNUSED[str(texels.dtype)]}
    else:
        finite = np.isfinite(texels)
        bad = {"not finite": ~finite, "outside": finite & (np.abs(np.where(finite, texels, 0)) > 1)}
    found = []
    for problem, places in bad.items():
        if places.any():
            row, column, channel = (int(i) for i in np.argwhere(places)[0])
            found.append((problem, (channel, column, row, float(texels[row, column, channel]))))
    return tuple(found)


VALIDATORS = (
    PrimValidator(
        "fexel:Pinchmap",
        "A pinchmap must have four finite channels in [-1, 1] and go with the size of its signal.",
        ("FexelPinchmapTexture",),
        check_pinchmap,
    ),
)
