"""Wrappers of UmbrellaTexture and of the prims below it, UmbrellaPatch and UmbrellaLevel."""

from __future__ import annotations

from typing import ClassVar

from pxr import Usd

from fexel.schema.accessors import UmbrellaLevelAccessors, UmbrellaPatchAccessors, UmbrellaTextureAccessors
from fexel.schema.texture import FexelTexture
from fexel.schema.wrapper import TypedWrapper, is_a

__all__ = ["UmbrellaLevel", "UmbrellaPatch", "UmbrellaTexture"]


class UmbrellaTexture(UmbrellaTextureAccessors, FexelTexture):
    """A large, non-repeating texture made per pixel from a few patches, many times placed and varied."""

    schema: ClassVar[str] = "UmbrellaTexture"

    def GetPatches(self) -> list[UmbrellaPatch]:
        """Base umbrellas in namespace order, the one that ``patchIndices`` counts in; active ones only."""
        return [UmbrellaPatch(child) for child in self._children(UmbrellaPatch.schema)]

    def GetLevels(self) -> list[UmbrellaLevel]:
        """Coarser levels of detail in namespace order; active ones only."""
        return [UmbrellaLevel(child) for child in self._children(UmbrellaLevel.schema)]

    def _children(self, schema: str) -> list[Usd.Prim]:
        if not self:
            return []
        children = self.GetPrim().GetFilteredChildren(Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate))
        return [child for child in children if is_a(child, schema)]


class UmbrellaPatch(UmbrellaPatchAccessors, TypedWrapper):
    """A base umbrella: one photographed element with its star-shaped contour."""

    schema: ClassVar[str] = "UmbrellaPatch"


class UmbrellaLevel(UmbrellaLevelAccessors, TypedWrapper):
    """A coarser level of detail of an UmbrellaTexture: derived data, written by the authoring tool."""

    schema: ClassVar[str] = "UmbrellaLevel"
