"""Zipmaps of a material: defines, uniforms and constants of shaders/zipmap*.glsl."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.textures import kind_number
from fexel.textures.kind import Part, Slot
from fexel.textures.layer_list import LayerList
from fexel.textures.page_format import HALF, SRGB
from fexel.textures.pool import TexturePool

__all__ = ["ZipmapSlot", "bind"]

_CONSTANTS_PER_LAYER = 4
_MOST_LISTED_SLOTS = 8


@dataclass(frozen=True, eq=False, kw_only=True)
class ZipmapSlot(Slot):
    """A zipmap as its shader finds it.

    Attributes
    ----------
    grid : (4,) float64
        Scale and offset from local st to cells of the outermost grid of the index, whose first node is `record`.
    shape : (int, int)
        Its cells along s and t.
    wrap : (float, float)
        Codes of the root's wrap modes.
    scale, bias : 4-tuples
    levels : int
        Most mip levels of an image, 1 or 2 and more.
    probes, outside : bool
        Whether there are anisotropic probes, and whether the root is seen outside of [0, 1]^2.
    layers : LayerList or None
        Where the layers may be unrolled.
    """

    grid: NDArray[np.float64]
    shape: tuple[int, int]
    wrap: tuple[float, float]
    scale: tuple[float, ...]
    bias: tuple[float, ...]
    levels: int
    probes: bool
    outside: bool
    layers: LayerList | None


def bind(slots: Sequence[ZipmapSlot], nested: Sequence[ZipmapSlot], room: int, pool: TexturePool) -> Part:
    """See `fexel.textures.kind.KindGpu`; zipmaps in zipmaps are layers, so that none are nested."""
    assert not nested, "zipmaps are never nested in other kinds"
    lists = _lists(slots, room // _CONSTANTS_PER_LAYER)
    by_index = [slot for slot, listed in zip(slots, lists, strict=True) if listed is None]
    most = max((len(layers.flat) for layers in lists if layers is not None), default=0)
    classes = frozenset().union(*(slot.page_classes for slot in slots))
    defines: dict[str, int | str] = {
        "ZIPMAP_SLOTS": len(slots),
        "ZIPMAP_TREE": int(bool(by_index)),
        "ZIPMAP_LEVELS": max((slot.levels for slot in by_index), default=1),
        "ZIPMAP_PROBES": int(any(slot.probes for slot in by_index)),
        "ZIPMAP_LAYERS": most,
        "ZIPMAP_OUTSIDE": int(any(slot.outside for slot in slots)),
        "ZIPMAP_SCALED": int(any(slot.scale != (1, 1, 1, 1) or slot.bias != (0, 0, 0, 0) for slot in slots)),
        "ZIPMAP_SRGB": int(SRGB in classes),
        "ZIPMAP_HALF": int(HALF in classes),
    }
    defines |= {f"ZIPMAP_CODES{number}": layers.codes if layers else 0 for number, layers in enumerate(lists)}
    kinds = {other.kind for slot in by_index for other in slot.nested}
    defines |= {f"ZIPMAP_KIND{kind_number(kind)}_SAMPLE": f"{kind}_nested" for kind in kinds}
    uniforms = {
        "zipmapGrid": np.array([slot.grid for slot in slots]),
        "zipmapTree": np.array([(slot.record, *slot.shape, 0) for slot in slots]),
        "zipmapWrap": np.array([(*slot.wrap, 0.0, 0.0) for slot in slots]),
        "zipmapScale": np.array([slot.scale for slot in slots]),
        "zipmapBias": np.array([slot.bias for slot in slots]),
        "zipmapMaxProbes": np.array([[pool.anisotropy]]),
    }
    constants, of_lists = _list_constants(lists, most)
    return Part(defines, uniforms | of_lists, constants, records=bool(by_index))


def _lists(slots: Sequence[ZipmapSlot], most: int) -> list[LayerList | None]:
    """The list of each slot; varyings are few, so the longest lists go by the index where there are too many."""
    lists = [slot.layers for slot in slots]
    if len(lists) > _MOST_LISTED_SLOTS:
        return [None] * len(lists)
    while (longest := max(0 if layers is None else len(layers.flat) for layers in lists)) * len(lists) > most:
        lists = [None if layers is None or len(layers.flat) == longest else layers for layers in lists]
    return lists


def _list_constants(
    lists: Sequence[LayerList | None], most: int
) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
    """Constants and uniforms of shaders/zipmap_list.glsl; slots that go by the index leave theirs at zero."""
    if not most:
        return np.zeros((0, 4)), {}
    flat = np.zeros((len(lists), most, _CONSTANTS_PER_LAYER, 4))
    numbers = np.zeros((len(lists), most, 4))
    root = np.zeros((len(lists), 4))
    for slot, layers in enumerate(lists):
        if layers is not None:
            count = len(layers.flat)
            flat[slot, :count], numbers[slot, :count], root[slot] = layers.flat, layers.numbers, layers.root
    return flat.reshape(-1, 4), {"zipmapNumbers": numbers.reshape(-1, 4), "zipmapRoot": root}
