"""The smallest pinchmap that is good enough: ``--size auto``.

Sizes are doubled until one meets the tolerance, then the interval is halved: the size found meets it, and the next
smaller one does not. (The error falls with the size but for small bumps, so that a still smaller size might do, too.)
"""

from __future__ import annotations

from collections.abc import Callable

from fexel.errors import FexelError
from fexel_tools.pinchmap_fit import PinchmapFit

__all__ = ["largest_auto_size", "smallest_size"]

_FIRST = 8
_SMALLEST = 4
_LARGEST = 512
_PIXELS_PER_TEXEL = 2  # finer than that a map would hold the source itself


def largest_auto_size(width: int, height: int) -> int:
    """Largest size that is tried for a source of so many pixels."""
    return max(_SMALLEST, min(_LARGEST, max(width, height) // _PIXELS_PER_TEXEL))


def smallest_size(
    attempt: Callable[[int], PinchmapFit], tolerance: float, largest: int, where: str
) -> tuple[int, PinchmapFit]:
    """Find the smallest size whose mismatch is within a tolerance.

    Parameters
    ----------
    attempt : callable(size) -> PinchmapFit
    tolerance : float
        Share of the source's pixels.
    largest : int
    where : str
        What to name when no size will do.

    Raises
    ------
    FexelError
        Not even `largest` meets the tolerance.
    """
    failing, size = _SMALLEST - 1, min(_FIRST, largest)
    fitted = attempt(size)
    while fitted.mismatch > tolerance:
        if size == largest:
            raise FexelError(
                f"{where}: {100 * fitted.mismatch:.3g} % of the pixels are on the wrong side at size {largest}, the "
                f"largest that is tried; expected a --tolerance of at least {fitted.mismatch:.2g}"
            )
        failing, size = size, min(2 * size, largest)
        fitted = attempt(size)
    while size - failing > 1:
        middle = (failing + size) // 2
        candidate = attempt(middle)
        if candidate.mismatch <= tolerance:
            size, fitted = middle, candidate
        else:
            failing = middle
    return size, fitted
