"""Wrapper of FexelTexture, the abstract base of every texture kind."""

from __future__ import annotations

from typing import ClassVar, Self

from pxr import Sdf, Usd, UsdShade

from fexel.errors import FexelError
from fexel.schema.accessors import FexelTextureAccessors
from fexel.schema.wrapper import TypedWrapper

__all__ = ["FexelTexture"]


class FexelTexture(FexelTextureAccessors, TypedWrapper, UsdShade.NodeGraph):
    """Any fexel texture. Being a `UsdShade.NodeGraph` it has `CreateInput`, `CreateOutput`, `ConnectableAPI` and so on.

    Examples
    --------
    >>> import fexel
    >>> from pxr import Sdf, Usd, UsdShade
    >>> stage = Usd.Stage.CreateInMemory()
    >>> surface = UsdShade.Shader.Define(stage, "/Material/Surface")
    >>> wall = fexel.ZipmapTexture.Define(stage, "/Material/Wall")
    >>> color = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    >>> color.ConnectToSource(wall.ConnectableAPI(), "rgb")
    True
    """

    schema: ClassVar[str] = "FexelTexture"

    @classmethod
    def Define(cls, stage: Usd.Stage, path: Sdf.Path | str) -> Self:
        """Define a prim of this type, see `TypedWrapper.Define`; FexelTexture itself is abstract."""
        if cls is FexelTexture:
            raise FexelError(f"{path}: FexelTexture is abstract, expected one of its kinds such as ZipmapTexture")
        return super().Define(stage, path)
