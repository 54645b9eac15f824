"""Wrapper of ZipmapTexture, and the flat list of the patches that it shows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from pxr import Sdf, Usd, UsdShade

from fexel.schema.accessors import ZipmapTextureAccessors
from fexel.schema.texture import FexelTexture
from fexel.schema.wrapper import is_a

__all__ = ["Patch", "ZipmapTexture", "patches_of"]


@dataclass(frozen=True, eq=False)
class Patch:
    """One texture of a zipmap at one time, placed relative to the root.

    Attributes
    ----------
    prim : Usd.Prim
        A FexelTexture of any kind.
    path : Sdf.Path
        Its path.
    parent_index : int
        Index of the parent in the list that `ZipmapTexture.GetPatches` returns; -1 for the root.
    depth : int
        Nesting depth, 0 for the root.
    root_to_patch : (3, 3) float64
        From the coordinates `st` given to the root to the patch's own, for row vectors: ``[s t 1] @ root_to_patch``,
        then divide by w. The product of ``inputs:matrix`` of the root, of every texture in between and of the patch.
        Not finite, or singular, where an authored matrix is.
    opacity : float
        ``inputs:opacity`` of the patch itself, as authored; not multiplied by its parents'.
    """

    prim: Usd.Prim
    path: Sdf.Path
    parent_index: int
    depth: int
    root_to_patch: np.ndarray
    opacity: float


class ZipmapTexture(ZipmapTextureAccessors, FexelTexture):
    """A texture with nested detail textures where detail exists."""

    schema: ClassVar[str] = "ZipmapTexture"

    def GetPatches(self, time: Usd.TimeCode | float = Usd.TimeCode.Default()) -> list[Patch]:  # noqa: B008 - immutable
        """List the root and its patches in draw order: parents first, siblings in namespace order, depth first.

        Nested FexelTexture prims of any kind are patches, as long as they are active; what else lies below (the
        UsdUVTexture network of the fallback, say) is not. Only a ZipmapTexture has patches of its own. The root itself
        is patch 0. Empty when the prim is of another type.

        Parameters
        ----------
        time : Usd.TimeCode or float
            At which matrices and opacities are evaluated.
        """
        return patches_of(self.GetPrim(), time) if self else []


def patches_of(root: Usd.Prim, time: Usd.TimeCode | float = Usd.TimeCode.Default()) -> list[Patch]:  # noqa: B008 - immutable
    """As `ZipmapTexture.GetPatches`, of a FexelTexture of any kind: one that is no zipmap is alone in its list."""
    patches: list[Patch] = []
    with np.errstate(all="ignore"):  # an authored NaN or Inf is passed on as it is
        _append(patches, root, Usd.TimeCode(time))
    return patches


def _append(patches: list[Patch], root: Usd.Prim, time: Usd.TimeCode) -> None:
    """Walk the nest with a stack of its own, so that no depth exhausts Python's."""
    stack = [(root, -1)]
    while stack:
        prim, parent_index = stack.pop()
        parent = patches[parent_index] if parent_index >= 0 else None
        parent_to_patch = np.array(_value(prim, "inputs:matrix", time), dtype=np.float64)
        patches.append(
            Patch(
                prim=prim,
                path=prim.GetPath(),
                parent_index=parent_index,
                depth=parent.depth + 1 if parent else 0,
                root_to_patch=parent.root_to_patch @ parent_to_patch if parent else parent_to_patch,
                opacity=float(_value(prim, "inputs:opacity", time)),
            )
        )
        if is_a(prim, "ZipmapTexture"):
            index = len(patches) - 1
            stack.extend((child, index) for child in reversed(list(_nested_textures(prim))))


def _nested_textures(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    children = prim.GetFilteredChildren(Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate))
    return (child for child in children if is_a(child, "FexelTexture"))


def _value(prim: Usd.Prim, name: str, time: Usd.TimeCode) -> Any:
    """Value of an input, followed to its source where it is connected to an interface input."""
    attribute = prim.GetAttribute(name)
    if attribute.HasAuthoredConnections():
        sources = UsdShade.Utils.GetValueProducingAttributes(UsdShade.Input(attribute))
        attribute = sources[0] if sources and sources[0].Get(time) is not None else attribute
    return attribute.Get(time)
