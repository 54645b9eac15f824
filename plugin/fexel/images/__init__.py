"""Images through OpenImageIO: what a file holds, one mip level or window of it, linear premultiplied float from any of
them.

Colour: `sRGB` files are decoded with the sRGB transfer function, `raw` files are taken as they are. Alpha: what comes
out is always premultiplied (associated) in linear light. PNG and other files with unassociated alpha are decoded, then
multiplied. Files whose alpha is associated and whose values are sRGB-encoded are divided by alpha first, since they
were encoded after multiplying. EXR and other float files may hold NaN, infinities and negative alpha: NaN becomes 0,
infinities the largest half float (65504), alpha is clamped to [0, 1]; so no such value reaches a filter.

Rows run down from the top, as in the file.
"""

from __future__ import annotations

from fexel.images.header import ImageInfo, image_info, stores_straight_alpha
from fexel.images.linear import read_linear, read_mask, to_linear
from fexel.images.pixels import read_pixels, read_strips
from fexel.images.png_chunks import png_fault
from fexel.images.pyramid_file import write_pyramid
from fexel.images.srgb import linear_to_srgb, srgb_to_linear

__all__ = [
    "ImageInfo",
    "image_info",
    "linear_to_srgb",
    "png_fault",
    "read_linear",
    "read_mask",
    "read_pixels",
    "read_strips",
    "srgb_to_linear",
    "stores_straight_alpha",
    "to_linear",
    "write_pyramid",
]
