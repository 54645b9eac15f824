"""Umbrella textures of a material: record, defines and uniforms of shaders/umbrella*.glsl."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.textures.image_view import WRAP_CODES, ImageView, image_defines
from fexel.textures.kind import Part, Slot
from fexel.textures.pool import TexturePool

__all__ = ["UmbrellaFeatures", "UmbrellaSlot", "bind", "umbrella_record"]

_PATCH = 16


@dataclass(frozen=True)
class UmbrellaFeatures:
    """What the shader must be compiled for.

    Attributes
    ----------
    drawn, picture : bool
        Whether the view sees umbrellas, and whether a prefiltered level.
    probes : bool
        Anisotropic ones are taken.
    stride : int
        Texels of an entry.
    projective, morphs, shadows, colors, alpha, coverages, vectors, scaled, outside : bool
    """

    drawn: bool
    picture: bool
    probes: bool
    stride: int
    projective: bool
    morphs: bool
    shadows: bool
    colors: bool
    alpha: bool
    coverages: bool
    vectors: bool
    scaled: bool
    outside: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class UmbrellaSlot(Slot):
    """An umbrella texture as its shader finds it."""

    features: UmbrellaFeatures
    images: tuple[ImageView, ...]


def umbrella_record(
    *,
    matrix: NDArray[np.float64],
    nearest: NDArray[np.float64],
    cells: tuple[int, int],
    grid: tuple[int, int],
    wrap: tuple[str, str],
    nested: bool,
    pages: NDArray[np.float64],
    look: NDArray[np.float64],
    parts: NDArray[np.float64],
    scale: Sequence[float],
    bias: Sequence[float],
) -> NDArray[np.float64]:
    """(11, 4), see shaders/umbrella.glsl.

    Parameters
    ----------
    matrix : (3, 3) float64
        From local st to the texture's st, row vectors.
    nearest : (2,) float64
        Local st where the most digits are needed.
    cells, grid : (int, int)
        Of the arrangement, and as authored.
    wrap : (str, str)
    nested : bool
    pages, parts : (2, 4) float64
        Texels 4, 5 and 7, 8 of the record.
    look : (4,) float64
        Texel 6.
    scale, bias : 4-tuples
    """
    to_cells = matrix * [*cells, 1]
    position = np.append(nearest, 1.0) @ to_cells
    # 1e-12 guards a place at infinity, which is never shown.
    base = np.floor(position[:2] / max(position[2], 1e-12))
    rows = to_cells.T.copy()
    rows[:2] -= base[:, None] * rows[2]
    # Whole periods, and mirrored ones, do not count: so that float32 holds the base.
    repeats = np.array([mode in ("repeat", "mirror") for mode in wrap])
    base = np.where(repeats, np.mod(base, 2.0 * np.array(cells)), base)
    codes = WRAP_CODES[wrap[0]] + 4 * WRAP_CODES[wrap[1]] + _PATCH * nested
    head = [[*rows[0], base[0]], [*rows[1], base[1]], [*rows[2], codes], [*cells, *(np.array(grid) / cells)]]
    return np.concatenate([head, pages, look[None], parts, [scale], [bias]])


def bind(slots: Sequence[UmbrellaSlot], nested: Sequence[UmbrellaSlot], room: int, pool: TexturePool) -> Part:
    """See `fexel.textures.kind.KindGpu`; all constants are in records."""
    assert room >= 0
    everything = [*slots, *nested]
    features = [slot.features for slot in everything]
    defines: dict[str, int | str] = {
        f"UMBRELLA_{name.upper()}": int(max(getattr(each, name) for each in features))
        for name in UmbrellaFeatures.__dataclass_fields__
    }
    defines["UMBRELLA_SLOTS"] = max(len(slots), 1)
    images = [view for slot in everything for view in slot.images]
    defines |= image_defines(images, pool, probes=any(each.probes for each in features))
    uniforms: dict[str, NDArray] = {"umbrellaMaxProbes": np.array([[pool.anisotropy]])}
    if slots:
        uniforms["umbrellaRecord"] = np.array([(slot.record, 0, 0, 0) for slot in slots])
    return Part(defines, uniforms, records=True)
