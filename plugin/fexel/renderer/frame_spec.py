"""Time codes and image names of a frame range, as usdrecord reads them.

A FrameSpec is ``start``, ``start:end`` or ``start:end x stride``; several are joined by commas: ``101:109x2,120``. The
image name has one placeholder of hashes, ``###`` or, with decimals, ``###.##``, replaced by the time code, padded with
zeros to the placeholder's length.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from fexel.errors import FexelError

__all__ = ["FrameRange", "frame_path", "parse_frames"]

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)"
_SPEC = re.compile(rf"({_NUMBER})(?::({_NUMBER})(?:x({_NUMBER}))?)?\Z")
_PLACEHOLDER = re.compile(r"#+(?:\.#+)?")
_MAX_FRAMES = 1_000_000  # guards a mistyped range
_EXAMPLE = "expected for example 7, 101:105 or 101:109x2"


class FrameRange(Sequence[float]):
    """Time codes, and `precision`, the number of decimals that tells them apart."""

    def __init__(self, times: Sequence[float], precision: int) -> None:
        self._times = tuple(times)
        self.precision = precision

    def __len__(self) -> int:
        return len(self._times)

    def __getitem__(self, index):
        return self._times[index]


def parse_frames(specs: str) -> FrameRange:
    """Time codes of FrameSpecs, in the order given.

    Raises
    ------
    FexelError
        Malformed spec, a stride of 0 or against the direction, more than a million frames.

    Examples
    --------
    >>> list(parse_frames("101:109x2,5"))
    [101.0, 103.0, 105.0, 107.0, 109.0, 5.0]
    >>> list(parse_frames("3:1"))
    [3.0, 2.0, 1.0]
    """
    times: list[float] = []
    precision = 0
    for spec in specs.split(","):
        match = _SPEC.match(spec.strip())
        if not match:
            raise FexelError(f"FrameSpec {spec!r} in {specs!r}: {_EXAMPLE}")
        times += _times(spec.strip(), *match.groups())
        precision = max(precision, *(_decimals(part) for part in match.groups() if part))
        if len(times) > _MAX_FRAMES:
            raise FexelError(f"FrameSpec {specs!r}: more than {_MAX_FRAMES} frames")
    return FrameRange(times, precision)


def _times(spec: str, start: str, end: str | None, stride: str | None) -> list[float]:
    first = float(start)
    if end is None:
        return [first]
    last = float(end)
    step = float(stride) if stride else math.copysign(1.0, last - first)
    if step == 0.0 or (last - first) * step < 0.0:
        raise FexelError(f"FrameSpec {spec!r}: a stride of {stride} does not lead from {start} to {end}")
    # 1e-6 of a step: decimal strides such as 0.1 are not exact in binary.
    count = math.floor((last - first) / step + 1e-6) + 1
    if count > _MAX_FRAMES:
        raise FexelError(f"FrameSpec {spec!r}: more than {_MAX_FRAMES} frames")
    return [first + i * step for i in range(count)]


def _decimals(number: str) -> int:
    return len(number.partition(".")[2].rstrip("0"))


def frame_path(pattern: str, time: float | None, frames: FrameRange | None) -> str:
    """Image path of one frame.

    Parameters
    ----------
    pattern : str
        With one placeholder, unless there is at most one frame.
    time : float or None
        None is the default time.
    frames : FrameRange or None
        All frames; None when no range was asked for.

    Raises
    ------
    FexelError
        Several frames and not exactly one placeholder; a placeholder without a range; too few decimals in it.
    """
    found = _PLACEHOLDER.findall(pattern)
    if frames is None:
        if found:
            raise FexelError(f"{pattern}: has the placeholder {found[0]}, but no frames were asked for (--frames)")
        return pattern
    if not found and len(frames) == 1:
        return pattern
    if len(found) != 1:
        raise FexelError(f"{pattern}: expected one placeholder such as #### for {len(frames)} frames")
    placeholder = found[0]
    decimals = len(placeholder.partition(".")[2])
    if decimals < frames.precision:
        raise FexelError(
            f"{pattern}: the frames need {frames.precision} decimals, the placeholder {placeholder} has {decimals}; "
            f"write {placeholder.partition('.')[0]}.{'#' * frames.precision}"
        )
    assert time is not None
    return pattern.replace(placeholder, f"{time:0{len(placeholder)}.{decimals}f}")
