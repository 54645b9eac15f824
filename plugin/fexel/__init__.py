"""Zipmap, pinchmap and umbrella textures as ordinary USD prims.

Importing fexel registers its schema with USD and nothing more: it creates no OpenGL context and loads neither NumPy
nor OpenImageIO. Import it before the first stage is opened, see `fexel._register`. Public names load on first use:

- typed wrappers in the manner of UsdGeom: `FexelTexture`, `ZipmapTexture`, `PinchmapTexture`, `UmbrellaTexture`,
  `UmbrellaPatch`, `UmbrellaLevel`, `TextureMinificationAPI`; and `Patch`, what `ZipmapTexture.GetPatches` lists;
- `render` and `Renderer`: stage to image, headless;
- `validate`: every USD validator, fexel's own among them, over a stage;
- `FexelError`, `FexelWarning`.

Examples
--------
>>> import fexel
>>> from pxr import Usd
>>> stage = Usd.Stage.CreateInMemory()
>>> wall = fexel.ZipmapTexture.Define(stage, "/Wall")
>>> poster = fexel.ZipmapTexture.Define(stage, "/Wall/Poster")
>>> [str(patch.path) for patch in wall.GetPatches()]
['/Wall', '/Wall/Poster']
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from fexel._register import register as _register
from fexel.errors import FexelError, FexelWarning

if TYPE_CHECKING:
    from fexel.renderer.api import Renderer, render
    from fexel.schema import (
        FexelTexture,
        Patch,
        PinchmapTexture,
        TextureMinificationAPI,
        UmbrellaLevel,
        UmbrellaPatch,
        UmbrellaTexture,
        ZipmapTexture,
    )
    from fexel.validators import validate

__all__ = [
    "FexelError",
    "FexelTexture",
    "FexelWarning",
    "Patch",
    "PinchmapTexture",
    "Renderer",
    "TextureMinificationAPI",
    "UmbrellaLevel",
    "UmbrellaPatch",
    "UmbrellaTexture",
    "ZipmapTexture",
    "render",
    "validate",
]

__version__ = "0.1.0"

# Public name -> module that holds it, imported on first use.
_LAZY = {
    **dict.fromkeys(
        (
            "FexelTexture",
            "Patch",
            "PinchmapTexture",
            "TextureMinificationAPI",
            "UmbrellaLevel",
            "UmbrellaPatch",
            "UmbrellaTexture",
            "ZipmapTexture",
        ),
        "fexel.schema",
    ),
    "Renderer": "fexel.renderer.api",
    "render": "fexel.renderer.api",
    "validate": "fexel.validators",
}

_register()


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'fexel' has no attribute {name!r}")
    value = getattr(importlib.import_module(_LAZY[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
