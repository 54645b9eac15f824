"""Wrapper of TextureMinificationAPI, a single-apply schema for fexel textures and UsdUVTexture shaders."""

from __future__ import annotations

from typing import ClassVar, Self

from pxr import Usd, UsdShade

from fexel._register import require_schemas
from fexel.errors import FexelError
from fexel.schema.accessors import TextureMinificationAPIAccessors
from fexel.schema.wrapper import is_a

__all__ = ["TextureMinificationAPI"]


class TextureMinificationAPI(TextureMinificationAPIAccessors):
    """How a texture is filtered where a pixel covers many texels. True when the schema is applied to its prim."""

    schema: ClassVar[str] = "TextureMinificationAPI"

    def __bool__(self) -> bool:
        # GetPrim raises on an invalid prim, so USD's own test comes first.
        return bool(super().__bool__()) and self.GetPrim().HasAPI(self.schema)

    @classmethod
    def CanApply(cls, prim: Usd.Prim) -> bool:
        """Whether `prim` is a FexelTexture of any kind or a Shader whose id is UsdUVTexture."""
        require_schemas()
        if not prim or not prim.CanApplyAPI(cls.schema):
            return False
        return is_a(prim, "FexelTexture") or UsdShade.Shader(prim).GetShaderId() == "UsdUVTexture"

    @classmethod
    def Apply(cls, prim: Usd.Prim) -> Self:
        """Add the schema to the ``apiSchemas`` of `prim` in the current edit target, and wrap the prim.

        Raises
        ------
        FexelError
            The schema cannot be applied to `prim`, see `CanApply`.
        """
        if not cls.CanApply(prim):
            where = prim.GetPath() if prim else "invalid prim"
            found = prim.GetTypeName() or "untyped" if prim else "nothing"
            raise FexelError(f"{where}: {found}, expected a fexel texture or a UsdUVTexture for {cls.schema}")
        prim.ApplyAPI(cls.schema)
        return cls(prim)
