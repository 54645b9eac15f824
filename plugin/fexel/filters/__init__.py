"""Texture minification: what a pixel that covers many texels shows (Bornik and Ferko 2002, section 3.2).

A filter is a module found by its token, with its shader ``filter_<token>.glsl``. `shears` and `chain` say which
prefiltered images there may be of a texture; everything else builds on these two.
"""

from __future__ import annotations

__all__ = ["FILTERS", "PORTABLE_FILTERS"]

PORTABLE_FILTERS = ("mipmap", "anisotropic", "ripmap", "fipmap")
"""Tokens of ``minification:filter``: what a stage may ask of any renderer."""

FILTERS = (*PORTABLE_FILTERS, "ewa", "auto")
"""And those of this renderer besides: the quality reference, and per pixel the cheapest one that is good enough."""
