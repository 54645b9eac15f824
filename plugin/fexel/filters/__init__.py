"""Texture minification: what a pixel that covers many texels shows (Bornik and Ferko 2002, section 3.2).

A filter is a module found by its token, with its shader ``filter_<token>.glsl``. `shears` and `chain` say which
prefiltered images there may be of a texture; everything else builds on these two.
"""

from __future__ import annotations

from fexel.errors import FexelError

__all__ = [
    "DEFAULT_ACCESSES",
    "DEFAULT_FILTER",
    "DEFAULT_KERNEL",
    "FILTERS",
    "FIPMAP_ACCESSES",
    "KERNELS",
    "PORTABLE_FILTERS",
    "checked_accesses",
    "checked_filter",
    "checked_kernel",
]

PORTABLE_FILTERS = ("mipmap", "anisotropic", "ripmap", "fipmap")
"""Tokens of ``minification:filter``: what a stage may ask of any renderer."""

FILTERS = (*PORTABLE_FILTERS, "ewa", "auto")
"""And those of this renderer besides: the quality reference, and per pixel the cheapest one that is good enough."""

DEFAULT_FILTER = "anisotropic"
"""Of a texture that asks for none."""

KERNELS = ("box", "gauss")
"""What the filter ``fipmap`` weights a footprint by: evenly over a pixel, or a Gaussian of half a pixel's deviation."""

DEFAULT_KERNEL = "box"

FIPMAP_ACCESSES = (4, 6, 8, 12, 16)
"""Bilinear accesses, of 4 texels each, that a fipmap may take of a box."""

DEFAULT_ACCESSES = 4


def checked_filter(token: str, where: str = "filter") -> str:
    """One of `FILTERS`.

    Raises
    ------
    FexelError
        Another one; the message begins with `where` and lists the valid ones.
    """
    if token not in FILTERS:
        raise FexelError(f"{where}: {token!r}, expected one of {', '.join(FILTERS)}")
    return token


def checked_kernel(name: str, where: str = "filter kernel") -> str:
    """One of `KERNELS`.

    Raises
    ------
    FexelError
        Another one; the message begins with `where` and lists the valid ones.
    """
    if name not in KERNELS:
        raise FexelError(f"{where}: {name!r}, expected one of {', '.join(KERNELS)}")
    return name


def checked_accesses(count: int, kernel: str = DEFAULT_KERNEL, where: str = "fipmap accesses") -> int:
    """One of `FIPMAP_ACCESSES`.

    Raises
    ------
    FexelError
        Another one, or any but the default with another kernel than the default one, which has a number of its own; the
        message begins with `where` and says what is expected.
    """
    if count not in FIPMAP_ACCESSES:
        raise FexelError(f"{where}: {count}, expected one of {', '.join(map(str, FIPMAP_ACCESSES))}")
    if count != DEFAULT_ACCESSES and kernel != DEFAULT_KERNEL:
        raise FexelError(f"{where}: {count} with the kernel {kernel}, expected {DEFAULT_KERNEL}")
    return int(count)
