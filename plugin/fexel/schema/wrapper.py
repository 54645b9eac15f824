"""What the wrappers have in common: construction from a prim, `Define`, `Get`, validity, and their attributes.

A wrapper is a view of one prim, cheap to make, without data of its own, as in UsdGeom. It is true when its prim is
valid and of the right type. Everything raises `FexelError` when USD does not know fexel's schema: see
`fexel._register`.
"""

from __future__ import annotations

from typing import Any, ClassVar, Self

from pxr import Sdf, Tf, Usd

from fexel._register import require_schemas

__all__ = ["TypedWrapper", "Wrapper", "is_a"]


def is_a(prim: Usd.Prim, schema: str) -> bool:
    """Whether `prim` is valid and of the fexel prim type `schema` or one derived from it."""
    return bool(prim) and prim.IsA(Tf.Type.FindByName("Fexel" + schema))


class Wrapper(Usd.SchemaBase):
    """Base of all wrappers; the generated accessors derive from it."""

    schema: ClassVar[str]
    """Name of the schema in USD."""

    def __init__(self, prim: Usd.Prim | Usd.SchemaBase | None = None) -> None:
        require_schemas()
        super().__init__(Usd.Prim() if prim is None else prim.GetPrim())

    def __repr__(self) -> str:
        return f"fexel.{type(self).__name__}({self.GetPrim()!r})"

    @classmethod
    def Get(cls, stage: Usd.Stage, path: Sdf.Path | str) -> Self:
        """Wrap the prim at `path`; the result is false when there is none, or it is of another type."""
        return cls(stage.GetPrimAtPath(path))

    def _get_attribute(self, name: str) -> Usd.Attribute:
        return self.GetPrim().GetAttribute(name)

    def _create_attribute(
        self, name: str, type_name: Sdf.ValueTypeName, default: Any, write_sparsely: bool
    ) -> Usd.Attribute:
        """Author the attribute; sparsely means not at all while `default` is what the schema gives anyway."""
        prim = self.GetPrim()
        attribute = prim.GetAttribute(name)
        if write_sparsely and attribute and not attribute.HasAuthoredValue() and default in (None, attribute.Get()):
            return attribute
        attribute = prim.CreateAttribute(name, type_name, custom=False)
        if default is not None:
            attribute.Set(default)
        return attribute


class TypedWrapper(Wrapper, Usd.Typed):
    """Base of the wrappers of prim types."""

    def __bool__(self) -> bool:
        # GetPrim raises on an invalid prim, so USD's own test comes first.
        return bool(super().__bool__()) and is_a(self.GetPrim(), self.schema)

    @classmethod
    def Define(cls, stage: Usd.Stage, path: Sdf.Path | str) -> Self:
        """Make sure that a prim of this type is defined at `path` in the current edit target, and wrap it.

        Before saving call ``stage.WriteFallbackPrimTypes()``: applications without fexel then see a NodeGraph.
        """
        require_schemas()
        return cls(stage.DefinePrim(path, cls.schema))
