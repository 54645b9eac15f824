"""Pinchmaps of a material: constants, records, defines and uniforms of shaders/pinchmap*.glsl."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.filters.view import FilterView
from fexel.textures.image_view import image_defines
from fexel.textures.kind import Part, Slot
from fexel.textures.page_format import FLOAT, HALF, SNORM, SRGB
from fexel.textures.pool import TexturePool
from fexel.textures.record_texture import RecordTexture

__all__ = ["PinchmapConstants", "PinchmapSlot", "bind", "pinchmap_slot"]

_WRAP_CODES = {"clamp": 0, "repeat": 1, "mirror": 2, "black": 3}
_TWO_LEVELS, _MINIFIED, _LINE, _FLOAT_PAGE, _HALF_PAGE = 2, 4, 8, 16, 32
_PATCH = 64
_CODED_SLOTS = 8  # of a material: more than varyings have room for; those after go by records


@dataclass(frozen=True, eq=False)
class PinchmapConstants:
    """What shaders must know of a pinchmap in a view. Positions are in its texels, t up.

    Attributes
    ----------
    matrix : (3, 3) float64
        From local st to positions, row vectors.
    nearest : (2,) float64
        Local st where the most digits are needed.
    size : (2,) int
    h : float
        Half a texel of the finest level shown.
    antialias, line_width : float
    line_color : 4-tuple
        Premultiplied.
    octaves : int
        Log2 of signal texels per texel of the pinchmap.
    finest : int
        First mip level of `places`.
    places : (L, 4) float64
        Per level: scale and offset from positions to page coordinates.
    texel_zero : (2,) float64
        Page texel of the pinchmap at position (0, 0).
    page_size : (2,) float64
        Texels of that page.
    page_classes : (int, int)
        Of pinchmap and signal.
    is_pinched : bool
        False where the pinchmap is one texel that stands for all.
    nested : bool
    most : float
        Anisotropic probes of the filter.
    filtered : int
        Record of the picture as a whole, -1 where that is not looked up.
    """

    matrix: NDArray[np.float64]
    nearest: NDArray[np.float64]
    size: NDArray[np.int64]
    h: float
    antialias: float
    line_width: float
    line_color: tuple[float, ...]
    octaves: int
    finest: int
    places: NDArray[np.float64]
    texel_zero: NDArray[np.float64]
    page_size: NDArray[np.float64]
    page_classes: tuple[int, int]
    is_pinched: bool
    nested: bool
    most: float
    filtered: int


@dataclass(frozen=True, eq=False, kw_only=True)
class PinchmapSlot(Slot):
    """A pinchmap as its shader finds it.

    Attributes
    ----------
    finest : int
        Mip level.
    codes : int
        What shaders/pinchmap_fast.glsl is to know when compiled; 0 where it cannot serve.
    constants : (5, 4), coarser : (1, 4), line : (1, 4) float64
        Its varyings.
    has_line, probes, warped : bool
        Whether it is looked up by its own mip levels, with or without probes.
    most : float
        Probes of the filter.
    filtered : FilterView or None
        The picture as a whole, where that is looked up.
    """

    finest: int
    codes: int
    constants: NDArray[np.float64]
    coarser: NDArray[np.float64]
    line: NDArray[np.float64]
    has_line: bool
    probes: bool
    warped: bool
    most: float
    filtered: FilterView | None


def pinchmap_slot(
    constants: PinchmapConstants,
    records: RecordTexture,
    *,
    wrap: tuple[str, str],
    affine: bool,
    deep: bool,
    minified: bool,
    probes: bool,
    outside: bool,
    across: bool,
    filtered: FilterView | None,
    local_to_texels: NDArray[np.float64],
    filter: str,
    vectors: bool,
) -> PinchmapSlot:
    """Write the record and choose the way of the shader.

    Parameters
    ----------
    constants : PinchmapConstants
    records : RecordTexture
    wrap : (str, str)
        Resolved wrap modes of the texture.
    affine : bool
        Whether the map from local st is.
    deep : bool
        A texel is so wide that filters of hardware are too coarse.
    minified : bool
        A pixel may be wider than a texel of the signal.
    probes : bool
        Anisotropic ones are taken.
    outside, across : bool
        Whether positions outside of the texture are seen, and whether what is displaced may be.
    filtered : FilterView or None
        The picture as a whole, where that is looked up.
    local_to_texels : (3, 3) float64
    filter : str
    vectors : bool
        As of `fexel.textures.kind.Slot`.
    """
    wrap_codes = [_WRAP_CODES.get(mode, 0) for mode in wrap]
    pages = _FLOAT_PAGE * (constants.page_classes[0] == FLOAT) + _HALF_PAGE * (constants.page_classes[1] == HALF)
    levels = len(constants.places)
    fast = affine and not (
        filtered or deep or probes or constants.nested or levels > 2 or (outside and "black" in wrap)
    )
    codes = 1 + _TWO_LEVELS * (levels > 1) + _MINIFIED * minified + _LINE * (constants.line_width > 0) + pages
    codes += sum(
        (code if across and code != _WRAP_CODES["black"] else 0) << (6 + 2 * i) for i, code in enumerate(wrap_codes)
    )
    return PinchmapSlot(
        kind="pinchmap",
        page_classes=frozenset(constants.page_classes),
        record=records.append(_record(constants, pages + wrap_codes[0] + 4 * wrap_codes[1])),
        finest=constants.finest,
        codes=int(codes) if fast else 0,
        constants=_varyings(constants),
        coarser=constants.places[-1:],
        line=np.array([constants.line_color]),
        local_to_texels=local_to_texels,
        filter=filter,
        vectors=vectors,
        has_line=constants.line_width > 0,
        probes=probes,
        warped=constants.is_pinched or filtered is None,
        most=constants.most,
        filtered=filtered,
    )


def _varyings(constants: PinchmapConstants) -> NDArray[np.float64]:
    """Of shaders/pinchmap_fast.glsl, (5, 4)."""
    matrix = constants.matrix / constants.matrix[2, 2]
    step = 1.0 if constants.is_pinched else 0.0
    scale = step * np.array([1, -1]) / constants.page_size
    return np.array(
        [
            [*matrix[:, 0], constants.h],
            [*matrix[:, 1], constants.antialias],
            [*constants.size, constants.line_width, constants.octaves - constants.finest],
            # A texel lies at its lower left corner; the page has it at its centre.
            [*scale, *((constants.texel_zero + 0.5) / constants.page_size)],
            constants.places[0],
        ]
    )


def _record(constants: PinchmapConstants, codes: int) -> NDArray[np.float64]:
    """Of shaders/pinchmap_record.glsl."""
    matrix, size = constants.matrix, constants.size
    position = np.append(constants.nearest, 1.0) @ matrix
    # 1e-12 guards a place at infinity, which is never shown.
    base = np.floor(position[:2] / max(position[2], 1e-12))
    rows = matrix.T.copy()
    rows[:2] -= base[:, None] * rows[2]
    levels = constants.finest + 16 * (constants.finest + len(constants.places) - 1)
    codes += _PATCH * constants.nested
    header = np.array(
        [
            [*rows[0], constants.h],
            [*rows[1], constants.antialias],
            [*rows[2], constants.line_width],
            # Whole periods, and mirrored ones, do not count.
            [*size, *_folded(base, size, codes)],
            [*constants.texel_zero, codes, levels],
            constants.line_color,
            [constants.octaves, 1.0 if constants.is_pinched else 0.0, constants.filtered, constants.most],
        ]
    )
    return np.concatenate([header, constants.places])


def _folded(base: NDArray[np.float64], size: NDArray[np.int64], codes: int) -> NDArray[np.float64]:
    """The base within two periods, so that float32 holds it; what does not repeat is clamped anyway far outside."""
    repeats = [(codes >> shift) & 3 in (_WRAP_CODES["repeat"], _WRAP_CODES["mirror"]) for shift in (0, 2)]
    return np.where(repeats, np.mod(base, 2 * size), base)


def bind(slots: Sequence[PinchmapSlot], nested: Sequence[PinchmapSlot], room: int, pool: TexturePool) -> Part:
    """See `fexel.textures.kind.KindGpu`."""
    codes = [slot.codes for slot in slots]
    two_levels = any(code & _TWO_LEVELS for code in codes)
    lines = any(code & _LINE for code in codes)
    per_slot = 5 + two_levels + lines
    codes = [code if per_slot * (number + 1) <= room else 0 for number, code in enumerate(codes)]
    fast = [number for number, code in enumerate(codes) if code]
    constants = np.zeros((fast[-1] + 1 if fast else 0, per_slot, 4))
    for number in fast:
        slot = slots[number]
        parts = [slot.constants, *[slot.coarser] * two_levels, *[slot.line] * lines]
        constants[number] = np.concatenate(parts)
    by_record = [slot for slot, code in zip(slots, codes, strict=True) if not code] + list(nested)
    classes = frozenset().union(*(slot.page_classes for slot in (*slots, *nested)))
    views = [slot.filtered for slot in by_record if slot.filtered]
    most = {slot.most for slot in by_record}
    defines: dict[str, int | str] = {
        "PINCHMAP_SLOTS": max(len(slots), 1),
        "PINCHMAP_FAST": int(bool(fast)),
        "PINCHMAP_RECORDS": int(bool(by_record)),
        "PINCHMAP_CONSTANTS": per_slot,
        "PINCHMAP_PROBES": int(any(slot.probes for slot in by_record)),
        "PINCHMAP_MIXED": int(len(most) > 1),
        "PINCHMAP_WARPED": int(any(slot.warped for slot in by_record)),
        "PINCHMAP_FILTERED": int(bool(views)),
        "PINCHMAP_LINES": int(any(slot.has_line for slot in by_record)),
        "PINCHMAP_SNORM": int(SNORM in classes),
        "PINCHMAP_FLOAT": int(FLOAT in classes),
        "PINCHMAP_SRGB": int(SRGB in classes),
        "PINCHMAP_HALF": int(HALF in classes),
    }
    defines |= {f"PINCHMAP_CODES{number}": dict(enumerate(codes)).get(number, 0) for number in range(_CODED_SLOTS)}
    uniforms: dict[str, NDArray] = {
        "pinchmapMaxProbes": np.array([[max(most, default=1.0)]]),
        "pinchmapImageProbes": np.array([[pool.anisotropy]]),
    }
    if slots:
        uniforms["pinchmapRecord"] = np.array([(slot.record, slot.finest, 0, 0) for slot in slots])
    shared = image_defines(views, pool, probes=True) if views else {}
    return Part(defines, uniforms, constants.reshape(-1, 4), records=bool(by_record), shared=shared)
