"""The maps of a ground: its main texture, and what else is known of the same elements, normals and roughness.

A companion map is an image of the size of the photo it goes with, and of its name, or of its name and what it is:
``leaf_normal.png``, ``leaf_roughness.png``; the latter may lie beside the photo. Each base's is cut and scaled as the
base's texture is, so that one arrangement serves all maps.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel.textures.umbrella_arrangement import Arrangement
from fexel_tools.photos import probe_photo
from fexel_tools.umbrella_background import Background
from fexel_tools.umbrella_base import companion_base
from fexel_tools.umbrella_elements import Elements
from fexel_tools.umbrella_options import UmbrellaOptions
from fexel_tools.umbrella_photo import open_photo
from fexel_tools.umbrella_solution import Ground
from fexel_tools.umbrella_textures import bits_of

__all__ = ["MapData", "check_companions", "companion_maps", "main_map", "without_maps"]

_FLAT = (0.5, 0.5, 1.0, 1.0)  # the normal of a plain ground, encoded
_BACKGROUNDS = {"normal": _FLAT, "roughness": (0.9, 0.9, 0.9, 1.0)}


@dataclass(frozen=True, eq=False)
class MapData:
    """One quantity of a ground, not yet written.

    Attributes
    ----------
    name : str
        Of its prim.
    drives : str
        Input of UsdPreviewSurface.
    textures : tuple of (h, w, 4) float32
        Of each base: linear (or data), straight alpha.
    background : Background
        Stored values, for data.
    arrangement : Arrangement
        With the colours and shadows that apply to it.
    bits : tuple of int
        Of each base's file.
    is_data : bool
    is_vectors : bool
        Encoded (v + 1) / 2.
    """

    name: str
    drives: str
    textures: tuple[NDArray[np.float32], ...]
    background: Background
    arrangement: Arrangement
    bits: tuple[int, ...]
    is_data: bool = False
    is_vectors: bool = False

    @property
    def has_colors(self) -> bool:
        """Whether vertex colours apply."""
        return not self.is_data

    @property
    def vector_scale(self) -> tuple[float, float] | None:
        """As `fexel_tools.umbrella_raster` is told of vectors, which turn with their umbrella."""
        return (2.0, 2.0) if self.is_vectors else None

    @property
    def behind(self) -> NDArray[np.float32] | tuple[float, ...]:
        """The background as `fexel_tools.umbrella_raster` takes it."""
        return self.background.color if self.background.picture is None else self.background.picture

    @property
    def fallback_color(self) -> tuple[float, float, float, float]:
        """Mean of the background as it is seen: vectors decoded."""
        red, green, blue, alpha = self.background.color
        return (2 * red - 1, 2 * green - 1, 2 * blue - 1, alpha) if self.is_vectors else self.background.color


def main_map(ground: Ground, options: UmbrellaOptions) -> MapData:
    """What the photos themselves show."""
    is_vectors = options.driven == "normal"
    background = ground.background
    if is_vectors and options.background == "auto":
        background = Background(None, _FLAT)
    return MapData(
        name="Texture",
        drives=options.driven,
        textures=ground.textures,
        background=background,
        arrangement=ground.arrangement,
        bits=tuple(bits_of(element.path, options.is_data) for element in ground.elements),
        is_data=options.is_data,
        is_vectors=is_vectors,
    )


def companion_maps(ground: Ground, options: UmbrellaOptions) -> list[MapData]:
    """Normal and roughness maps that were given.

    Raises
    ------
    FexelError
        A map cannot be read, or `check_companions` would refuse it.
    """
    arrangement = replace(ground.arrangement, colors=np.zeros((0, 3), np.float32), shadow_strength=0.0)
    maps = []
    for drives, folder in _asked(options).items():
        files = [_map_file(folder, element.path, drives) for element in ground.elements]
        maps.append(
            MapData(
                name=drives.capitalize(),
                drives=drives,
                textures=_textures(ground, files),
                background=Background(None, _BACKGROUNDS[drives]),
                arrangement=arrangement,
                bits=tuple(bits_of(file, True) for file in files),
                is_data=True,
                is_vectors=drives == "normal",
            )
        )
    return maps


def check_companions(sources: Sequence[Elements], options: UmbrellaOptions) -> None:
    """See to it, before a ground is computed, that every photo with an element has its maps.

    Raises
    ------
    FexelError
        A map is missing, is no image, or is not of its photo's size.
    """
    for drives, folder in _asked(options).items():
        for source in sources:
            if source.elements:
                file = _map_file(folder, source.path, drives)
                photo = probe_photo(file, min_side_px=1)
                _check_size(file, (photo.width, photo.height), source.path, source.size)


def _asked(options: UmbrellaOptions) -> dict[str, Path]:
    """Folders of the maps that were asked for, by what they drive."""
    folders = {"normal": options.normal_maps, "roughness": options.roughness_maps}
    return {drives: Path(folder) for drives, folder in folders.items() if folder}


def without_maps(files: Sequence[str], options: UmbrellaOptions) -> list[str]:
    """The photos among files: companion maps beside them, which a pattern such as ``*.png`` names as well, left out."""
    stems = [os.path.splitext(file)[0] for file in files]
    maps = {f"{stem}_{what}" for stem in stems for what in _asked(options)}
    return [file for file, stem in zip(files, stems, strict=True) if stem not in maps]


def _map_file(folder: Path, photo: Path, what: str) -> Path:
    """The map that goes with a photo: of its name, alone or with what it is, with whatever extension."""
    files = sorted(path for path in folder.iterdir() if path.is_file() and not path.samefile(photo))
    for name in (photo.name, f"{photo.stem}_{what}{photo.suffix}"):
        if folder / name in files:
            return folder / name
    for stem in (photo.stem, f"{photo.stem}_{what}"):
        if found := [path for path in files if path.stem == stem]:
            return found[0]
    raise FexelError(
        f"{folder}: has no {what} map for {photo}, expected {photo.name} or {photo.stem}_{what}{photo.suffix}"
    )


def _textures(ground: Ground, files: Sequence[Path]) -> tuple[NDArray[np.float32], ...]:
    """The maps' parts under each base; elements of one photo follow each other, so that its map is read once."""
    textures = []
    for file, numbers in groupby(range(len(files)), files.__getitem__):
        photo = open_photo(file, is_data=True)
        for number in numbers:
            element, base = ground.elements[number], ground.bases[number]
            _check_size(file, photo.size, element.path, element.photo_size)
            color, _ = photo.window(element.box, element.pixel)
            textures.append(companion_base(base, replace(element, color=color, is_data=True)).texture)
    return tuple(textures)


def _check_size(file: Path, found: tuple[int, int], photo: Path, wanted: tuple[int, int]) -> None:
    if found != wanted:
        raise FexelError(f"{file}: {found[0]} x {found[1]} pixels, expected {wanted[0]} x {wanted[1]} as {photo}")
