"""What the schema itself says of fexel's prims: which types there are, which attributes name files, which hold data.

Read from USD's registry, so that a type or an attribute that `schemas/schema.usda` gains is known here at once.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

from pxr import Plug, Sdf, Tf, Usd

from fexel._register import require_schemas
from fexel.schema.wrapper import is_a

__all__ = ["asset_attributes", "base_types", "data_attributes", "parts_of"]

_DATA = "dataAttributes"  # a type's attributes whose files hold no colours, whatever they are used for: extraPlugInfo


def base_types() -> tuple[str, ...]:
    """TfType names of fexel's prim types that derive from no other of them; all others derive from one of these."""
    own = set(_own_types())
    typed = Tf.Type.FindByName("UsdTyped")
    found = {name: Tf.Type.FindByName(name) for name in sorted(own)}
    return tuple(
        name
        for name, type_ in found.items()
        if type_.IsA(typed) and not any(b.typeName in own for b in type_.baseTypes)
    )


@functools.cache
def _own_types() -> dict[str, dict[str, Any]]:
    """What the schema's plugInfo.json says of each type."""
    require_schemas()
    plugin = Plug.Registry().GetPluginForType(Tf.Type.FindByName("FexelFexelTexture"))
    return dict(plugin.metadata["Types"])


def asset_attributes(prim: Usd.Prim) -> list[Usd.Attribute]:
    """Attributes by which the schema lets a prim name files, authored or not."""
    names = prim.GetPrimDefinition().GetPropertyNames()
    attributes = (prim.GetAttribute(name) for name in names)
    return [a for a in attributes if a and a.GetTypeName() == Sdf.ValueTypeNames.Asset]


def data_attributes(prim: Usd.Prim) -> list[Usd.Attribute]:
    """Those of `asset_attributes` that the schema marks as data, such as masks and pinchmaps."""
    marked = {
        name
        for type_, said in _own_types().items()
        if prim.IsA(Tf.Type.FindByName(type_))
        for name in said.get(_DATA, ())
    }
    return [a for a in asset_attributes(prim) if a.GetName() in marked]


def parts_of(texture: Usd.Prim) -> Iterator[Usd.Prim]:
    """Prims of fexel's types below a texture that belong to it: neither textures themselves nor within one."""
    types = [Tf.Type.FindByName(name) for name in base_types()]
    prims = iter(Usd.PrimRange(texture, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)))
    next(prims)
    for prim in prims:
        if is_a(prim, "FexelTexture"):
            prims.PruneChildren()
        elif any(prim.IsA(type_) for type_ in types):
            yield prim
