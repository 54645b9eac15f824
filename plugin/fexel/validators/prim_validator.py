"""What a module of validators declares: ``VALIDATORS``, a tuple of these, which `registration` finds by that name."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from pxr import Usd

from fexel.validators.fault import Fault

__all__ = ["ANY", "TEXTURES", "PrimValidator"]

TEXTURES = ("FexelFexelTexture",)
"""Textures of every kind."""
ANY = ()
"""Prims of every type of fexel's schema."""


@dataclass(frozen=True)
class PrimValidator:
    """A check of the prims of some types.

    Attributes
    ----------
    name : str
        As ``fexel:Matrix``.
    doc : str
        What should be, one sentence.
    types : tuple of str
        TfType names, as `pxr.UsdValidation` wants them; derived types are checked as well. `ANY`: all of fexel's.
    check : callable
        Yields the faults of a prim.
    """

    name: str
    doc: str
    types: tuple[str, ...]
    check: Callable[[Usd.Prim], Iterable[Fault]]
