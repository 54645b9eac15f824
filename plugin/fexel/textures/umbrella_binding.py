"""Umbrella textures of a material: record, defines and uniforms of shaders/umbrella*.glsl."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel import homography
from fexel.textures.image_view import WRAP_CODES, ImageView, image_defines
from fexel.textures.kind import Part, Sight, Slot
from fexel.textures.pool import TexturePool
from fexel.textures.umbrella import UmbrellaData
from fexel.textures.umbrella_arrangement import Arrangement
from fexel.textures.umbrella_texels import Layout

__all__ = ["ArrangementPlaces", "ImagePlaces", "UmbrellaFeatures", "UmbrellaSlot", "bind", "umbrella_record"]

CONSTANTS = 7  # texels of the record that every pixel reads


@dataclass(frozen=True)
class UmbrellaFeatures:
    """What the shader must be compiled for.

    Attributes
    ----------
    drawn, picture : bool
        Whether the view sees umbrellas, and whether the prefiltered picture.
    merged : int
        Arrangements seen besides the finest.
    probes : bool
        Anisotropic ones are taken.
    filtered : bool
        Images of bases are looked up by a filter of their own.
    projective : bool
        Whether entries have a row for w.
    morphs, shadows, colors, alpha, coverages, vectors, scaled, outside, perspective : bool
    """

    drawn: bool
    merged: int
    picture: bool
    probes: bool
    filtered: bool
    projective: bool
    morphs: bool
    shadows: bool
    colors: bool
    alpha: bool
    coverages: bool
    vectors: bool
    scaled: bool
    outside: bool
    perspective: bool


@dataclass(frozen=True, eq=False, kw_only=True)
class UmbrellaSlot(Slot):
    """An umbrella texture as its shader finds it.

    Attributes
    ----------
    features : UmbrellaFeatures
    images : tuple of ImageView
    constants : (N, 4) float64
        The part of the record that every pixel reads.
    most : float
        Anisotropic probes.
    """

    features: UmbrellaFeatures
    images: tuple[ImageView, ...]
    constants: NDArray[np.float64]
    most: float


@dataclass(frozen=True, eq=False)
class ArrangementPlaces:
    """An arrangement and where its static data lie.

    Attributes
    ----------
    arrangement : Arrangement
    origins : (4,) float64
        Page texels of the first texel in the float page and in the half-float page.
    row_bits : (int, int)
        Log2 of their rows.
    layout : Layout
    """

    arrangement: Arrangement
    origins: NDArray[np.float64]
    row_bits: tuple[int, int]
    layout: Layout


@dataclass(frozen=True)
class ImagePlaces:
    """Where the records of images lie: of the first base, the background and the picture, each of `texels`."""

    bases: int
    background: int
    picture: int
    texels: int


def umbrella_record(
    data: UmbrellaData,
    sight: Sight,
    places: ArrangementPlaces | None,
    *,
    images: ImagePlaces,
    wrap: tuple[str, str],
    detail: tuple[int, int, int, int],
    most: float,
    filtered: bool,
) -> NDArray[np.float64]:
    """(11, 4), see shaders/umbrella.glsl.

    Parameters
    ----------
    data : UmbrellaData
    sight : Sight
        Its ``local_to_st`` leads to the texture's own coordinates.
    places : ArrangementPlaces or None
        None where no umbrella is drawn.
    images : ImagePlaces
    wrap : (str, str)
        Resolved.
    detail : (int, int, int, int)
        Coarser arrangements that follow, level of this one, level of the picture, 1 if there is one.
    most : float
        Anisotropic probes.
    filtered : bool
        Images of bases are looked up by a filter of their own.
    """
    arrangement = places.arrangement if places else data.arrangement
    layout = places.layout if places else Layout(0, 1, 1, False, arrangement.grid)
    origins, bits = (places.origins, places.row_bits) if places else (np.zeros(4), (0, 0))
    cells = np.array(layout.size)
    rows, base = _rows(sight, cells, wrap)
    vectors = data.vector_hand % 3  # 0, 1, and 2 where one of their axes runs backward
    codes = (
        WRAP_CODES[wrap[0]]
        + 4 * WRAP_CODES[wrap[1]]
        + 16 * bits[0]
        + 512 * bits[1]
        + 16384 * vectors
        + 65536 * filtered
    )
    return np.array(
        [
            [*rows[0], base[0]],
            [*rows[1], base[1]],
            [*cells, *(np.array(data.arrangement.grid) / cells)],
            origins,
            [layout.bins, layout.slices, arrangement.color_blend if bits[1] else 0.0, codes],
            [*(np.array(arrangement.shadow_offset) * cells), arrangement.shadow_strength, images.bases],
            [images.background, images.picture, images.texels, layout.stride],
            [*rows[2], most],
            detail,
            data.scale,
            data.bias,
        ]
    )


def _rows(
    sight: Sight, cells: NDArray[np.int64], wrap: tuple[str, str]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rows x, y, w from local (s, t, 1) to cells relative to a base near what is seen closest, and that base."""
    to_cells = homography.normalize(sight.local_to_st[None])[0] * [*cells, 1]
    if (to_cells[:2, 2] == 0).all():
        to_cells = to_cells / to_cells[2, 2]
    position = np.append(_nearest(sight), 1.0) @ to_cells
    # 1e-12 guards a place at infinity, which is never shown.
    base = np.floor(position[:2] / max(position[2], 1e-12))
    rows = to_cells.T.copy()
    rows[:2] -= base[:, None] * rows[2]
    # Whole periods, and mirrored ones, do not count: so float32 holds the base.
    repeats = np.array([mode in ("repeat", "mirror") for mode in wrap])
    return rows, np.where(repeats, np.mod(base, 2.0 * cells), base)


def _nearest(sight: Sight) -> NDArray[np.float64]:
    """Local st where the footprint is smallest: there float32 needs its digits."""
    pieces = sight.pieces
    nearest = np.linalg.norm(pieces.jacobian, axis=(2, 3)).max(axis=1).argmin()
    return (pieces.low[nearest] + pieces.high[nearest]) / 2


def bind(slots: Sequence[UmbrellaSlot], nested: Sequence[UmbrellaSlot], room: int, pool: TexturePool) -> Part:
    """See `fexel.textures.kind.KindGpu`."""
    everything = [*slots, *nested]
    features = [slot.features for slot in everything]
    flats = min(len(slots), room // CONSTANTS)
    defines: dict[str, int | str] = {
        f"UMBRELLA_{name.upper()}": int(max(getattr(each, name) for each in features))
        for name in UmbrellaFeatures.__dataclass_fields__
    }
    most = {slot.most for slot in everything}
    defines["UMBRELLA_MIXED"] = int(len(most) > 1)
    defines |= {"UMBRELLA_SLOTS": max(len(slots), 1), "UMBRELLA_FLATS": flats, "UMBRELLA_CONSTANTS": CONSTANTS}
    images = [view for slot in everything for view in slot.images]
    shared = image_defines(images, pool, probes=any(each.probes for each in features))
    uniforms: dict[str, NDArray] = {
        "umbrellaMaxProbes": np.array([[max(most)]]),
        "umbrellaImageProbes": np.array([[pool.anisotropy]]),
    }
    if slots:
        uniforms["umbrellaRecord"] = np.array([(slot.record, 0, 0, 0) for slot in slots])
    constants = np.concatenate([np.zeros((0, 4)), *(slot.constants[:CONSTANTS] for slot in slots[:flats])])
    return Part(defines, uniforms, constants, records=True, shared=shared)
