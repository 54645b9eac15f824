"""Formats of the pages that hold texels: one `PageFormat` per page class.

Software rasterisers filter plain 8-bit textures with 8-bit weights and results, which is off by more than a step after
a blend; 8-bit sRGB and signed normalised textures they filter as floats (measured on llvmpipe, Mesa 22.3).
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["FLOAT", "HALF", "PAGE_FORMATS", "SNORM", "SRGB", "PageFormat"]

SRGB, HALF, SNORM, FLOAT = range(4)


@dataclass(frozen=True)
class PageFormat:
    """How a page class keeps rgba texels.

    Attributes
    ----------
    name : str
        Of the sampler, ``pages<Name>``, and of the define, ``PAGES_<NAME>``.
    bytes_per_texel : int
    dtype : str
        moderngl's.
    internal_format : int or None
        GL's, where it does not follow from `dtype`.
    """

    name: str
    bytes_per_texel: int
    dtype: str
    internal_format: int | None = None


PAGE_FORMATS = (
    PageFormat("Srgb", 4, "f1", 0x8C43),  # GL_SRGB8_ALPHA8: uint8, decoded to linear light when read
    PageFormat("Half", 8, "f2"),
    PageFormat("Snorm", 4, "ni1", 0x8F97),  # GL_RGBA8_SNORM: int8, -127 to 127 stand for -1 to 1
    PageFormat("Float", 16, "f4"),
)
