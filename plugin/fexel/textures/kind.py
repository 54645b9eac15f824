"""What a texture kind must offer to the texture system, and what it is given: the joint between kinds and renderer.

``textures/<kind>_gpu.py`` of every kind is a `KindGpu`. Per view, each texture is planned (what of it is seen: images,
mip levels, windows), then all that was asked for is loaded within one budget, then each plan writes its records and
becomes a `Slot`; a material's slots are bound together. A kind that nests others calls their ``plan`` for the part of
the view that each covers, and keeps their slots in its own.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fexel.filters import DEFAULT_FILTER

if TYPE_CHECKING:
    from fexel.textures.index import LocalPieces
    from fexel.textures.pool import TexturePool

__all__ = ["KindGpu", "Part", "Plan", "Sight", "Slot"]


@dataclass(frozen=True, eq=False)
class Sight:
    """What a view sees of a texture.

    Attributes
    ----------
    path : str
        Prim to name in messages.
    pieces : LocalPieces
        Bounds and footprints in local st, which is what shaders get.
    local_to_st : (3, 3) float64
        From local st to the texture's ``inputs:st``; of a nested texture, to its own [0, 1]^2. Row vectors.
    nested : bool
        A patch of another texture, transparent outside of [0, 1]^2.
    """

    path: str
    pieces: LocalPieces
    local_to_st: NDArray[np.float64]
    nested: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Slot:
    """A texture of a view as shaders find it; kinds add what they bind.

    Attributes
    ----------
    kind : str
    page_classes : frozenset of int
        Of the pages that hold its texels.
    record : int
        Where its own record starts in the record texture.
    nested : tuple of Slot
        Textures of other kinds in it, in no order.
    local_to_texels : (3, 3) float64 or None
        From local st to texels of level 0 of its base image, t up, row vectors: what the AOV ``footprint`` is told in.
        None for a texture that has no base image: footprints are told in st.
    filter : str
        Of `fexel.filters.FILTERS`, by which its base image is seen; not what is asked for where that had no room.
    vectors : bool
        Its base image holds vectors, which scale and bias decode: a normal map.
    """

    kind: str
    page_classes: frozenset[int]
    record: int
    nested: tuple[Slot, ...] = ()
    local_to_texels: NDArray[np.float64] | None = None
    filter: str = DEFAULT_FILTER
    vectors: bool = False


@dataclass(frozen=True, eq=False)
class Part:
    """What one kind brings to a material's program.

    Attributes
    ----------
    defines : dict
        All begin with the kind's name; integers or, for functions of shaders, identifiers.
    uniforms : dict of str to array
        Arrays of vectors (N, C), float64 or int32.
    constants : (N, 4) float64
        For flat varyings: ``textureConstants`` from ``<KIND>_FLAT`` on. At most the room that was given.
    records : bool
        Whether the shader reads the record texture.
    shared : dict of str to int
        Defines of shader files that several kinds use, shaders/image.glsl for one: a program gets the greatest of each.
    """

    defines: dict[str, int | str]
    uniforms: dict[str, NDArray] = field(default_factory=dict)
    constants: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4)))
    records: bool = False
    shared: dict[str, int] = field(default_factory=dict)


class Plan(Protocol):
    """One texture of one view, before and after loading."""

    @property
    def layers_total(self) -> int:
        """Images that the texture places, seen or not."""
        ...

    @property
    def layers_seen(self) -> Collection[str]:
        """Prim paths of those that the view sees."""
        ...

    def write(self, pool: TexturePool) -> Slot:
        """Write the records; called after `TexturePool.load`."""
        ...


class KindGpu(Protocol):
    """The module ``textures/<kind>_gpu.py``; its shader ``<kind>.glsl`` has ``<kind>_sample`` and ``<kind>_nested``."""

    def plan(self, data: Any, sight: Sight, pool: TexturePool) -> Plan:
        """Find out what a view sees of a texture, and ask the pool for it."""
        ...

    def bind(self, slots: Sequence[Any], nested: Sequence[Any], room: int, pool: TexturePool) -> Part:
        """Defines, uniforms and constants for the textures of this kind in a material.

        Parameters
        ----------
        slots : sequence of Slot
            In order of their numbers, by which ``<kind>_sample`` tells them apart.
        nested : sequence of Slot
            In textures of other kinds; told apart by their records.
        room : int
            Most constants, 4 components each.
        pool : TexturePool
        """
        ...
