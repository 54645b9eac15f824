"""UmbrellaTexture prims as data: a few base umbrellas, many times placed and varied over a background.

Just-in-time texture synthesis (2012), sections 4 to 6. No file is touched: images are opened only when a frame sees
them. Arrays are mended where they can be (`umbrella_arrays`, `umbrella_patch`, `umbrella_merged`); what is left can be
drawn as it is. Levels of detail are derived data: each carries the digest of what it was made from, and one that no
longer goes with its arrangement is left out.
"""

from __future__ import annotations

import hashlib
import math
import os
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from pxr import Usd

from fexel.filters.minification import Minification
from fexel.schema.umbrella import UmbrellaTexture
from fexel.textures.image_source import (
    BIAS_ZERO,
    PATCH_WRAP,
    SCALE_ONE,
    ImageSource,
    decodes_vectors,
    fallback_of,
    own_minification,
    toned,
    wrap_of,
)
from fexel.textures.inputs import IDENTITY, Inputs, warn
from fexel.textures.umbrella_arrangement import Arrangement
from fexel.textures.umbrella_arrays import read_arrangement
from fexel.textures.umbrella_merged import read_level
from fexel.textures.umbrella_patch import PatchArrays, read_patch

__all__ = [
    "BASE_IMAGE_BIAS",
    "DIGEST_KEY",
    "LEVEL_IMAGE_BIAS",
    "PRIM_TYPES",
    "UmbrellaData",
    "UmbrellaLevelData",
    "extract",
    "level_digest",
]

PRIM_TYPES = ("UmbrellaTexture",)

DIGEST_KEY = "fexel:arrangement"
"""In the customData of an UmbrellaLevel: `level_digest` of the texture that it was made from."""

BASE_IMAGE_BIAS = 0.5
"""How many mip levels finer than other images those of bases are read: umbrellas are a few texels wide where they are
small, and two levels blended are softer than a pixel."""

LEVEL_IMAGE_BIAS = 1
"""How many mip levels finer than other images the image of a level is read: its texels are then half a pixel wide, and
its mip levels are fitted to that (`fexel_tools.umbrella_levels`)."""


@dataclass(frozen=True)
class UmbrellaLevelData:
    """A coarser level of detail: an arrangement or an image.

    Attributes
    ----------
    level : int
        At least 1: a cell stands for 2^level x 2^level of the full arrangement.
    path : str
        Of the attribute that names its image.
    grid : (int, int)
    arrangement : Arrangement or None
        Merged umbrellas over the same background.
    image : ImageSource or None
        Of the whole picture over [0, 1]^2, background and shadows included, before scale and bias.
    """

    level: int
    path: str
    grid: tuple[int, int] = (1, 1)
    arrangement: Arrangement | None = None
    image: ImageSource | None = None


@dataclass(frozen=True)
class UmbrellaData:
    """An umbrella texture at one time. Equal content compares and hashes equal.

    Attributes
    ----------
    background : ImageSource
        ``inputs:file``, looked up at unwrapped coordinates as an ordinary image; without scale and bias.
    arrangement : Arrangement
    levels : tuple of UmbrellaLevelData
        The finest first, one per level.
    paths : tuple of str
        Attribute that names the image of each shape.
    wrap : (str, str)
        Of the texture: tokens as of an image, ``("patch", "patch")`` for what is transparent outside of [0, 1]^2.
        ``useMetadata`` is what the background's file says, ``black`` without one.
    st_to_texture : 3 tuples of 3
        ``inputs:matrix``, for row vectors; identity for a patch.
    scale, bias : 4-tuples
        Of the finished picture, on straight colour; what lies outside of a ``black`` or ``patch`` wrap stays zero.
    turns_vectors : bool
        Texels are vectors, encoded (v + 1) / 2, or (1 - v) / 2 where a scale is negative: x and y turn with the
        umbrella.
    filter : str or None
        Minification filter of all images; None where none is authored.
    """

    background: ImageSource
    arrangement: Arrangement
    levels: tuple[UmbrellaLevelData, ...] = ()
    paths: tuple[str, ...] = ()
    wrap: tuple[str, str] = ("repeat", "repeat")
    st_to_texture: tuple[tuple[float, ...], ...] = IDENTITY
    scale: tuple[float, ...] = SCALE_ONE
    bias: tuple[float, ...] = BIAS_ZERO
    turns_vectors: bool = False
    filter: str | None = None

    @cached_property
    def _hash(self) -> int:
        parts = (self.background, self.arrangement, self.levels, self.paths, self.wrap, self.st_to_texture)
        return hash((*parts, self.scale, self.bias, self.turns_vectors, self.filter))

    def __hash__(self) -> int:
        return self._hash

    @property
    def vector_hand(self) -> int:
        """Which way texels turn with an umbrella: 1 as it, -1 where one of their axes runs backward, 0 not at all."""
        return (-1 if self.scale[0] * self.scale[1] < 0 else 1) * self.turns_vectors


def extract(prim: Usd.Prim, time: Usd.TimeCode, nested: bool = False) -> UmbrellaData:
    """Read an UmbrellaTexture at one time.

    Parameters
    ----------
    prim : Usd.Prim
    time : Usd.TimeCode
    nested : bool
        As a patch of another texture: transparent outside of [0, 1]^2. Its matrix and opacity are for that to apply.

    Warns
    -----
    FexelWarning
        Per prim and fault: lengths of arrays that disagree, umbrellas that cannot be drawn, a morph that would fold, a
        level made from another arrangement, unknown token, value that is not finite.
    """
    inputs = Inputs(prim, time)
    minification = own_minification(inputs, nested)
    texture = UmbrellaTexture(prim)
    space = inputs.color_space()
    patches = tuple(read_patch(patch.GetPrim(), time, space) for patch in texture.GetPatches())
    arrangement = read_arrangement(prim, time, patches, _look(inputs))
    scale, bias = inputs.vector("scale", SCALE_ONE), inputs.vector("bias", BIAS_ZERO)
    are_vectors = decodes_vectors(scale, bias)
    scale, bias = toned(scale, bias, minification)
    images = [patch.shape.image for patch in patches if patch.shape.image is not None]
    data = UmbrellaData(
        background=_background(inputs, nested, scale, bias, minification),
        arrangement=arrangement,
        paths=tuple(f"{patch.path}.file" for patch in patches),
        wrap=PATCH_WRAP if nested else wrap_of(inputs),
        st_to_texture=IDENTITY if nested else inputs.placement(),
        scale=scale,
        bias=bias,
        turns_vectors=are_vectors and all(image.color_space == "raw" for image in images),
        filter=minification.filter,
    )
    return replace(data, levels=_levels(texture, time, patches, data))


def level_digest(data: UmbrellaData) -> str:
    """What levels of detail are made from, in brief: an UmbrellaLevel keeps it in its customData, see `DIGEST_KEY`.

    Numbers count as the attributes' types hold them, so the digest is the same before a stage is written and after it
    is read. Of images it holds the names of the files, not where they lie.

    Parameters
    ----------
    data : UmbrellaData
        Its levels do not matter.
    """
    arrangement, background = data.arrangement, data.background
    state = hashlib.blake2b(digest_size=16)
    for shape in arrangement.shapes:
        _feed(state, shape.points, shape.morph_points)
        if shape.image is not None:
            _feed(state, shape.tex_coords, os.path.basename(shape.image.file), shape.image.color_space)
    _feed(state, arrangement.shape_of, arrangement.morphs, arrangement.colors, arrangement.coverages)
    state.update((arrangement.matrices + 0.0).tobytes())
    blend = (arrangement.color_blend, arrangement.shadow_strength, *arrangement.shadow_offset)
    _feed(state, np.array(blend), np.array(background.fallback), arrangement.grid)
    _feed(state, os.path.basename(background.file), background.color_space, data.turns_vectors)
    if data.vector_hand < 0:
        _feed(state, data.vector_hand)
    return state.hexdigest()


def _feed(state: Any, *values: Any) -> None:
    """Arrays as 32-bit numbers, zero without a sign."""
    for value in values:
        if isinstance(value, np.ndarray):
            kind = np.int32 if value.dtype.kind in "iu" else np.float32
            state.update(repr(value.shape).encode())
            state.update((value.astype(kind) + kind(0)).tobytes())
        else:
            state.update(repr(value).encode())


def _look(inputs: Inputs) -> dict[str, Any]:
    """Blend and shadow, as fields of `Arrangement`."""
    offset = inputs.vector("shadowOffset", (0.0, 0.0))
    return {
        "color_blend": _share(inputs, "colorBlend", 1.0),
        "shadow_offset": (math.fmod(offset[0], 1.0), math.fmod(offset[1], 1.0)),  # all repeats
        "shadow_strength": _share(inputs, "shadowStrength", 0.0),
    }


def _share(inputs: Inputs, name: str, default: float) -> float:
    """A number in [0, 1]."""
    value = inputs.number(name, default, 0.0)
    if value > 1.0:
        warn(inputs.prim, f"inputs:{name}", f"is {value:g}, expected 0 to 1; 1 is used")
        return 1.0
    return value


def _background(
    inputs: Inputs, nested: bool, scale: tuple[float, ...], bias: tuple[float, ...], own: Minification
) -> ImageSource:
    """The image behind all umbrellas; its fallback such that scale and bias make of it what is authored."""
    fallback = fallback_of(inputs, nested, own)
    unscaled = tuple((v - b) / s if s else 0.0 for v, s, b in zip(fallback, scale, bias, strict=True))
    wrap = ("clamp", "clamp") if nested else wrap_of(inputs)
    return ImageSource(inputs.asset("file"), inputs.asset("mask"), inputs.color_space(), wrap, fallback=unscaled)


def _levels(
    texture: UmbrellaTexture, time: Usd.TimeCode, patches: tuple[PatchArrays, ...], data: UmbrellaData
) -> tuple[UmbrellaLevelData, ...]:
    """Usable levels, the finest first."""
    levels: dict[int, UmbrellaLevelData] = {}
    now = ""
    for prim in (level.GetPrim() for level in texture.GetLevels()):
        made_from = prim.GetCustomDataByKey(DIGEST_KEY)
        now = now or (level_digest(data) if made_from else "")
        if made_from and made_from != now:
            warn(prim, DIGEST_KEY, "made from another arrangement than its texture has now; it is left out")
            continue
        level = _level(prim, time, patches, data.arrangement.color_blend)
        if level is None:
            continue
        if level.level in levels:
            other = levels[level.level].path.removesuffix(".file")
            warn(prim, "level", f"{level.level} is that of {other} as well; it is left out")
            continue
        levels[level.level] = level
    return tuple(levels[number] for number in sorted(levels))


def _level(
    prim: Usd.Prim, time: Usd.TimeCode, patches: tuple[PatchArrays, ...], color_blend: float
) -> UmbrellaLevelData | None:
    inputs = Inputs(prim, time, namespace="")
    value = inputs.value("level")
    number = 1 if value is None else int(value)
    if number < 1:
        warn(prim, "level", f"is {number}, expected at least 1; it is left out")
        return None
    path = f"{prim.GetPath()}.file"
    if file := inputs.asset("file"):
        image = ImageSource(file, color_space=inputs.color_space(), wrap=("repeat", "repeat"))
        return UmbrellaLevelData(number, path, image=image)
    arrangement = read_level(prim, time, patches, color_blend)
    return UmbrellaLevelData(number, path, arrangement.grid, arrangement) if len(arrangement) else None
