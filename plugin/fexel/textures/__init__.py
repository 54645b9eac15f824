"""Texture kinds: what a texture prim says, as data that the renderer keeps on the GPU.

A kind is one vertical slice with the same stem everywhere: ``textures/<kind>.py`` here, ``shaders/<kind>.glsl``. Its
module has ``PRIM_TYPES``, the prim types or shader ids that it reads, and ``extract(prim, time)``. To add a kind, add
its module's name to `_KINDS`; nothing else here changes.
"""

from __future__ import annotations

import importlib
from typing import Any

from pxr import Usd, UsdShade

from fexel.errors import FexelError

__all__ = ["extract_texture", "texture_kind"]

_KINDS = ("zipmap",)


def texture_kind(prim: Usd.Prim) -> str | None:
    """Name of the kind that reads this prim, or None.

    A texture prim is known by its type, a Shader by its ``info:id``.
    """
    name = prim.GetTypeName()
    if name == "Shader":
        name = UsdShade.Shader(prim).GetShaderId() or ""
    return _kind_of_type().get(str(name))


def extract_texture(prim: Usd.Prim, time: Usd.TimeCode | float) -> tuple[str, Any]:
    """Read a texture prim at one time.

    Parameters
    ----------
    prim : Usd.Prim
        A FexelTexture, or a Shader with id UsdUVTexture.
    time : Usd.TimeCode or float

    Returns
    -------
    kind : str
    data : object
        The kind's own frozen data; equal data compare and hash equal.

    Raises
    ------
    FexelError
        No kind reads this prim.
    """
    kind = texture_kind(prim)
    if kind is None:
        known = ", ".join(sorted(_kind_of_type()))
        raise FexelError(f"{prim.GetPath()}: prim of type {prim.GetTypeName() or '(none)'}, expected one of {known}")
    return kind, importlib.import_module(f"fexel.textures.{kind}").extract(prim, Usd.TimeCode(time))


def _kind_of_type() -> dict[str, str]:
    modules = {kind: importlib.import_module(f"fexel.textures.{kind}") for kind in _KINDS}
    return {name: kind for kind, module in modules.items() for name in module.PRIM_TYPES}
