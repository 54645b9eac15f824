"""Texture minification: what a pixel that covers many texels shows (Bornik and Ferko 2002, section 3.2).

A filter is a module found by its token, with its shader ``filter_<token>.glsl``. `shears` and `chain` say which
prefiltered images there may be of a texture; everything else builds on these two.
"""

from __future__ import annotations

from fexel.errors import FexelError

__all__ = [
    "DEFAULT_FILTER",
    "DEFAULT_KERNEL",
    "FILTERS",
    "KERNELS",
    "PORTABLE_FILTERS",
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
