"""Typed wrappers of fexel's prim types, in the manner of UsdGeom; one module per texture kind."""

from __future__ import annotations

from fexel.schema.minification import TextureMinificationAPI
from fexel.schema.pinchmap import PinchmapTexture
from fexel.schema.texture import FexelTexture
from fexel.schema.umbrella import UmbrellaLevel, UmbrellaPatch, UmbrellaTexture
from fexel.schema.zipmap import Patch, ZipmapTexture

__all__ = [
    "FexelTexture",
    "Patch",
    "PinchmapTexture",
    "TextureMinificationAPI",
    "UmbrellaLevel",
    "UmbrellaPatch",
    "UmbrellaTexture",
    "ZipmapTexture",
]
