"""A texture of any kind as one image: what each kind offers to fallbacks, and to the kinds that nest it.

A kind has a module ``<kind>_baking`` with ``baker(data, path) -> TextureBaker``, found by the kind's name, so that
a new kind touches nothing here. Pictures are linear and premultiplied, row 0 at the top; st runs up.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any, Protocol, cast

import numpy as np

from fexel.textures.image_source import BIAS_ZERO, SCALE_ONE, ImageSource
from fexel.textures.pyramid_cache import PyramidCache

__all__ = ["NestedBaker", "Storage", "TextureBaker", "nested_baker", "storage_of", "texture_baker"]


@dataclass(frozen=True)
class Storage:
    """How a baked picture is stored.

    Attributes
    ----------
    color_space : str
        ``sRGB`` or ``raw``.
    dtype : str
        ``uint8``, ``uint16`` or ``half``.
    scale, bias : 4 floats
        What is yet to be applied to the picture.
    """

    color_space: str = "sRGB"
    dtype: str = "uint8"
    scale: tuple[float, ...] = SCALE_ONE
    bias: tuple[float, ...] = BIAS_ZERO


class TextureBaker(Protocol):
    """A texture that can be baked. A file that cannot be read warns once and shows its fallback colour."""

    @property
    def storage(self) -> Storage:
        """How the picture is to be stored."""
        ...

    def size(self, largest: int) -> tuple[int, int]:
        """Width and height of the picture, at most `largest` a side."""
        ...

    def bake(self, width: int, height: int) -> np.ndarray:
        """(height, width, 4) float32, the unit square of ``inputs:st``; scale and bias of `storage` are not applied."""
        ...


class NestedBaker(TextureBaker, Protocol):
    """Baker of a kind that another kind may nest."""

    @property
    def texels(self) -> tuple[int, int]:
        """Width and height of the picture that would show all of its detail."""
        ...

    def sample(self, st: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
        """(M, 4), scale and bias applied, at points (M, 2) of the unit square.

        The jacobian, (M, 2, 2), is d(st)/d(sample), column j per step along x, y.
        """
        ...


def texture_baker(kind: str, data: Any, path: str) -> TextureBaker:
    """Baker of what `fexel.textures.extract_texture` gives; `path` is the prim to name in messages."""
    return importlib.import_module(f"fexel_tools.{kind}_baking").baker(data, path)


def nested_baker(kind: str, data: Any, path: str) -> NestedBaker:
    """Baker of a texture that another nests."""
    return cast("NestedBaker", texture_baker(kind, data, path))


def storage_of(
    source: ImageSource,
    cache: PyramidCache,
    path: str,
    scale: tuple[float, ...] = SCALE_ONE,
    bias: tuple[float, ...] = BIAS_ZERO,
) -> Storage:
    """Storage after an image: 8-bit sRGB for sRGB, 16-bit for raw integers, half floats for floats."""
    info = cache.facts(source, path).info
    if info is None:
        return Storage(scale=scale, bias=bias)
    if info.dtype.startswith("float"):
        return Storage("raw", "half", scale, bias)
    space = info.color_space if source.color_space == "auto" else source.color_space
    return Storage(space, "uint8" if space == "sRGB" else "uint16", scale, bias)
