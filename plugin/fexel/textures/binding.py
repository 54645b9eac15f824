"""A material's textures bound to its program: what each kind brings, and what all kinds share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fexel.filters import FILTERS
from fexel.filters.minification import Minification
from fexel.textures import gpu_half, kind_number
from fexel.textures.adjustment import adjustment
from fexel.textures.kind import Part, Slot
from fexel.textures.page_format import PAGE_FORMATS

if TYPE_CHECKING:
    import moderngl

    from fexel.textures.pool import TexturePool

__all__ = ["TextureBinding"]

_CHEAPEST = "mipmap"


class TextureBinding:
    """Textures of one material for one view.

    Parameters
    ----------
    slots : sequence of Slot
        In the order of the material's textures.
    pool : TexturePool
    room : int
        Most flat varyings of 4 components.
    asked : sequence of Minification, optional
        Of the material's textures, in that order.

    Attributes
    ----------
    defines : dict of str to int or str
        Of the program; part of its key.
    includes : tuple of str
        Shader files of the kinds, nested ones first.
    """

    def __init__(self, slots: Sequence[Slot], pool: TexturePool, room: int, asked: Sequence[Minification] = ()) -> None:
        self._pool = pool
        self._main = _main_uniforms(slots) if asked else {}
        everything = list(_with_nested(slots))
        self._classes = sorted(frozenset().union(*(slot.page_classes for slot in everything)))
        nested = [slot for slot in everything if not any(slot is own for own in slots)]
        kinds = sorted({slot.kind for slot in everything}, key=kind_number)
        parts: dict[str, Part] = {}
        constants: list[NDArray[np.float64]] = []
        for kind in kinds:
            of_kind = [[slot for slot in group if slot.kind == kind] for group in (slots, nested)]
            part = gpu_half(kind).bind(of_kind[0], of_kind[1], room - sum(map(len, constants)), pool)
            parts[kind] = part
            parts[kind].defines[f"{kind.upper()}_FLAT"] = sum(map(len, constants))
            constants.append(part.constants)
        filtered = [pool.is_filtered(each.filter) for each in asked]
        renormalised = [of.vectors and is_filtered for of, is_filtered in zip(slots, filtered, strict=False)]
        parts["material"] = adjustment(asked, renormalised)
        self._parts = list(parts.values())
        self._constants = np.concatenate(constants)
        # A kind that nests others calls their functions: those come first.
        inner = {slot.kind for slot in nested}
        self.includes = tuple(f"{kind}.glsl" for kind in sorted(kinds, key=lambda kind: (kind not in inner, kind)))
        self.defines = {name: value for part in self._parts for name, value in part.defines.items()}
        self.defines |= _united([part.shared for part in self._parts])
        self.defines |= _numbers(slots)
        self.defines |= {f"PAGES_{page.name.upper()}": int(n in self._classes) for n, page in enumerate(PAGE_FORMATS)}
        self.defines["TEXTURE_RECORDS"] = int(any(part.records for part in self._parts))
        if len(self._constants):
            self.defines["TEXTURE_FLAT"] = len(self._constants)

    def apply(self, program: moderngl.Program, first_unit: int = 0) -> int:
        """Set uniforms and bind textures from unit `first_unit` on; returns the next free unit."""
        textures = {"textureRecords": self._pool.records.texture}
        textures |= {f"pages{PAGE_FORMATS[c].name}": self._pool.atlases[c].texture for c in self._classes}
        unit = first_unit
        for name, texture in textures.items():
            if name in program and texture is not None:
                texture.use(unit)
                program[name] = unit
                unit += 1
        half = np.array([(0.5 / atlas.size[0], 0.5 / atlas.size[1], 0.0, 0.0) for atlas in self._pool.atlases])
        values = {"pageHalfTexel": half, "textureConstants": self._constants, **self._main}
        for part in self._parts:
            values |= part.uniforms
        for name, value in values.items():
            if name in program and len(value):
                _set(program[name], value)
        return unit


def _with_nested(slots: Sequence[Slot]) -> Iterator[Slot]:
    for slot in slots:
        yield slot
        yield from _with_nested(slot.nested)


def _united(shared: Sequence[dict[str, int]]) -> dict[str, int | str]:
    """The greatest of each define: what all kinds that use a file need of it."""
    names = {name for defines in shared for name in defines}
    return {name: max(defines.get(name, 0) for defines in shared) for name in sorted(names)}


def _numbers(slots: Sequence[Slot]) -> dict[str, int | str]:
    """By slot, which of the textures of its kind it is."""
    kinds = [slot.kind for slot in slots]
    return {f"TEXTURE{number}_NUMBER": kinds[:number].count(kind) for number, kind in enumerate(kinds)}


def _main_uniforms(slots: Sequence[Slot]) -> dict[str, NDArray]:
    """What the AOVs of the main texture need, that of slot 0; see shaders/mesh_aovs.glsl."""
    to_texels = np.eye(3) if slots[0].local_to_texels is None else slots[0].local_to_texels
    token = _CHEAPEST if slots[0].filter == "auto" else slots[0].filter  # a lookup tells what else `auto` takes
    used = np.array([[float(FILTERS.index(token))]])
    return {"mainTexels": np.pad(to_texels.T, ((0, 0), (0, 1))), "mainFilter": used}


def _set(uniform: Any, values: NDArray) -> None:
    """A vector or array of vectors; the driver may have cut off what the program does not read."""
    kind = np.int32 if values.dtype.kind == "i" else np.float32
    uniform.write(values[: uniform.array_length].astype(kind).tobytes())
