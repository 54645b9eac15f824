"""Texture kinds: what a texture prim says, as data that the renderer keeps on the GPU.

A kind is one vertical slice with the same stem everywhere: ``textures/<kind>.py`` and ``textures/<kind>_gpu.py`` here,
``shaders/<kind>.glsl``. The first has ``PRIM_TYPES``, the prim types or shader ids that it reads, and ``extract(prim,
time, nested)``; the second is what `fexel.textures.kind.KindGpu` says. To add a kind, append its name to `_KINDS`;
nothing else here changes.
"""

from __future__ import annotations

import functools
import importlib
from typing import TYPE_CHECKING, Any, cast

from pxr import Usd, UsdShade

from fexel.errors import FexelError

if TYPE_CHECKING:
    from fexel.textures.kind import KindGpu

__all__ = ["extract_texture", "gpu_half", "kind_number", "kinds", "texture_kind"]

_KINDS = ("zipmap", "pinchmap", "umbrella")


def kinds() -> tuple[str, ...]:
    """Names of all kinds; a kind's number is its place."""
    return _KINDS


def texture_kind(prim: Usd.Prim) -> str | None:
    """Name of the kind that reads this prim, or None.

    A texture prim is known by its type, a Shader by its ``info:id``.
    """
    name = prim.GetTypeName()
    if name == "Shader":
        name = UsdShade.Shader(prim).GetShaderId() or ""
    return _kind_of_type().get(str(name))


def extract_texture(prim: Usd.Prim, time: Usd.TimeCode | float, nested: bool = False) -> tuple[str, Any]:
    """Read a texture prim at one time.

    Parameters
    ----------
    prim : Usd.Prim
        A FexelTexture, or a Shader with id UsdUVTexture.
    time : Usd.TimeCode or float
    nested : bool
        As a patch of another texture: transparent outside of [0, 1]^2. Its matrix and opacity are for that to apply.

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
    return kind, importlib.import_module(f"fexel.textures.{kind}").extract(prim, Usd.TimeCode(time), nested)


def gpu_half(kind: str) -> KindGpu:
    """What brings a kind's data to the GPU."""
    return cast("KindGpu", importlib.import_module(f"fexel.textures.{kind}_gpu"))


def kind_number(kind: str) -> int:
    """Number by which records and shaders know a kind."""
    return _KINDS.index(kind)


@functools.cache
def _kind_of_type() -> dict[str, str]:
    modules = {kind: importlib.import_module(f"fexel.textures.{kind}") for kind in _KINDS}
    return {name: kind for kind, module in modules.items() for name in module.PRIM_TYPES}
