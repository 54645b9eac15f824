"""Zipmaps of a material: defines, uniforms and constants of shaders/zipmap*.glsl."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.filters.view import FilterView
from fexel.textures import kind_number
from fexel.textures.image_view import image_defines
from fexel.textures.kind import Part, Slot
from fexel.textures.layer_list import LayerList
from fexel.textures.page_format import HALF, SRGB
from fexel.textures.pool import TexturePool
from fexel.textures.zipmap_filtered import FilteredRoot

__all__ = ["ZipmapSlot", "bind"]

_CONSTANTS_PER_LAYER = 4
_CONSTANTS_PER_ROOT = 5
_MOST_CODED_SLOTS = 8


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
    most : frozenset of float
        Most probes of the filters of layers that are looked up in their mip levels.
    plain : bool
        Whether there are such layers.
    layers : LayerList or None
        Where the layers may be unrolled.
    filtered : tuple of FilterView
        Layers that are looked up by shaders/image.glsl.
    root : FilteredRoot or None
        Where one of them is all that is seen.
    """

    grid: NDArray[np.float64]
    shape: tuple[int, int]
    wrap: tuple[float, float]
    scale: tuple[float, ...]
    bias: tuple[float, ...]
    levels: int
    probes: bool
    outside: bool
    most: frozenset[float]
    plain: bool
    layers: LayerList | None
    filtered: tuple[FilterView, ...]
    root: FilteredRoot | None


def bind(slots: Sequence[ZipmapSlot], nested: Sequence[ZipmapSlot], room: int, pool: TexturePool) -> Part:
    """See `fexel.textures.kind.KindGpu`; zipmaps in zipmaps are layers, so that none are nested."""
    assert not nested, "zipmaps are never nested in other kinds"
    lists = _lists(slots, room // _CONSTANTS_PER_LAYER)
    most = max((len(layers.flat) for layers in lists if layers is not None), default=0)
    constants, uniforms = _list_constants(lists, most)
    roots = _roots(slots, (room - len(constants)) // _CONSTANTS_PER_ROOT)
    codes = [layers.codes if layers else 0 for layers in lists]
    for order, number in enumerate(roots):
        codes[number] = -1 - order
    by_index = [slot for slot, code in zip(slots, codes, strict=True) if code == 0]
    classes = frozenset().union(*(slot.page_classes for slot in slots))
    probes = {each for slot in by_index for each in slot.most}
    defines: dict[str, int | str] = {
        "ZIPMAP_SLOTS": len(slots),
        "ZIPMAP_TREE": int(bool(by_index)),
        "ZIPMAP_LEVELS": max((slot.levels for slot in by_index), default=1),
        "ZIPMAP_PROBES": int(any(slot.probes for slot in by_index)),
        "ZIPMAP_MIXED": int(len(probes) > 1),
        "ZIPMAP_PLAIN": int(any(slot.plain for slot in by_index)),
        "ZIPMAP_FILTERED": int(any(slot.filtered for slot in by_index)),
        "ZIPMAP_LAYERS": most,
        "ZIPMAP_ROOTS": len(roots),
        "ZIPMAP_ROOTS_FLAT": len(constants),
        "ZIPMAP_PROJECTIVE": int(any(root.is_projective for root in roots.values())),
        "ZIPMAP_OUTSIDE": int(any(slot.outside for slot in slots)),
        "ZIPMAP_SCALED": int(any(slot.scale != (1, 1, 1, 1) or slot.bias != (0, 0, 0, 0) for slot in slots)),
        "ZIPMAP_SRGB": int(SRGB in classes),
        "ZIPMAP_HALF": int(HALF in classes),
    }
    defines |= {f"ZIPMAP_CODES{number}": code for number, code in enumerate(codes)}
    kinds = {other.kind for slot in by_index for other in slot.nested}
    defines |= {f"ZIPMAP_KIND{kind_number(kind)}_SAMPLE": f"{kind}_nested" for kind in kinds}
    uniforms |= {
        "zipmapGrid": np.array([slot.grid for slot in slots]),
        "zipmapTree": np.array([(slot.record, *slot.shape, 0) for slot in slots]),
        "zipmapWrap": np.array([(*slot.wrap, 0.0, 0.0) for slot in slots]),
        "zipmapScale": np.array([slot.scale for slot in slots]),
        "zipmapBias": np.array([slot.bias for slot in slots]),
        "zipmapMaxProbes": np.array([[max(probes, default=1.0)]]),
        "zipmapImageProbes": np.array([[pool.anisotropy]]),
    }
    constants = np.concatenate([constants, *(root.constants for root in roots.values())])
    views = [view for slot in slots for view in slot.filtered]
    return Part(
        defines,
        uniforms,
        constants,
        records=bool(by_index) or bool(views),
        shared=image_defines(views, pool, probes=True) if views else {},
    )


def _roots(slots: Sequence[ZipmapSlot], most: int) -> dict[int, FilteredRoot]:
    """The lone roots that have varyings, by slot; the others go by the index."""
    if len(slots) > _MOST_CODED_SLOTS:
        return {}
    roots = {number: slot.root for number, slot in enumerate(slots) if slot.root is not None}
    return dict(list(roots.items())[:most])


def _lists(slots: Sequence[ZipmapSlot], most: int) -> list[LayerList | None]:
    """The list of each slot; varyings are few, so the longest lists go by the index where there are too many."""
    lists = [slot.layers for slot in slots]
    if len(lists) > _MOST_CODED_SLOTS:
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
