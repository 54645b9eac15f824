"""Grounds that umbrellas are measured on: the texture as the renderer gets it, its texels, its truth and its rival."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from pxr import Usd

from bench.fall_leaves import SIZES, fall_leaves
from bench.umbrella_command import author, passiflora_scans
from bench.umbrella_explicit import ExplicitTexture, explicit_texture
from bench.umbrella_texture import umbrella_stage
from bench.umbrella_truth import Truth
from bench.zipmap_stage import zipmap_texture
from fexel.images import image_info, read_linear
from fexel.mipmaps import level_count, level_size
from fexel.scene.model import Texture
from fexel.textures.image_source import ImageSource
from fexel.textures.umbrella import UmbrellaLevelData
from fexel.textures.umbrella_arrangement import Arrangement
from fexel.textures.umbrella_cells import cell_statistics
from fexel_tools.umbrella_levels import image_level, write_level_image
from fexel_tools.umbrella_merge import merged_levels
from fexel_tools.umbrella_stage import LevelPrim

__all__ = ["Ground", "fall_leaves_ground", "ground_of_stage", "merged_leaves_ground", "real_leaves"]

_WORD = 4  # bytes
_VERTICES = 48  # of a base; matching contours with each other's adds some


@dataclass(frozen=True, eq=False)
class Ground:
    """An umbrella texture and what it is judged by.

    Attributes
    ----------
    name : str
        As the rows' setting calls it.
    texture : Texture
    textures : tuple of (h, w, 3 or 4) float32
        Of the bases: linear, straight alpha.
    background : (h, w, 3) float32
        Linear; repeats over st.
    """

    name: str
    texture: Texture
    textures: tuple[np.ndarray, ...]
    background: np.ndarray

    @property
    def arrangement(self) -> Arrangement:
        """Of the full ground."""
        return self.texture.data.arrangement

    @property
    def grid(self) -> tuple[int, int]:
        """Cells along s and t."""
        return self.arrangement.grid

    @property
    def texture_sizes(self) -> list[tuple[int, int]]:
        """Width and height of each base."""
        return [(texels.shape[1], texels.shape[0]) for texels in self.textures]

    @cached_property
    def truth(self) -> Truth:
        """By brute force."""
        return Truth(self.arrangement, self.textures, self.background)

    def explicit(self, texels_per_cell: int) -> ExplicitTexture:
        """The whole picture as texels."""
        return explicit_texture(self.arrangement, self.textures, self.background, texels_per_cell)

    @property
    def level_bytes(self) -> int:
        """Of the levels of detail as they are used: 8-bit texels with their mip levels; merged umbrellas by eq. (2)."""
        return sum(_level_bytes(level) for level in self.texture.data.levels)

    @property
    def level_file_bytes(self) -> int:
        """Of the files that levels are read from."""
        return sum(Path(level.image.file).stat().st_size for level in self.texture.data.levels if level.image)


def fall_leaves_ground(folder: Path) -> Ground:
    """The synthetic leaves, with the level image that the command makes."""
    folder.mkdir(parents=True, exist_ok=True)
    leaves = fall_leaves(folder / "leaves")
    image = image_level(leaves.arrangement, leaves.textures, leaves.soil)
    file = folder / "level.tif"
    write_level_image(file, image)
    level = LevelPrim(image.level, leaves.arrangement.grid, "", str(file))
    stage = umbrella_stage(folder / "ground.usdc", leaves.arrangement, leaves.background, [level])
    return ground_of_stage(*stage, "fall leaves")


def merged_leaves_ground(folder: Path, method: str, k: int | None = None) -> Ground:
    """The synthetic leaves with merged umbrellas for levels: ``paper`` as its section 5 has it, or ``fitted``.

    `k` umbrellas a cell of a level; default: as `merged_levels` chooses.
    """
    folder.mkdir(parents=True, exist_ok=True)
    leaves = fall_leaves(folder / "leaves")
    merged = merged_levels(leaves.arrangement, leaves.textures, leaves.soil, method=method, k=k)
    prims = [LevelPrim(number, level.grid, "", "", level) for number, level in enumerate(merged, 1)]
    stage = umbrella_stage(folder / "ground.usdc", leaves.arrangement, leaves.background, prims)
    return ground_of_stage(*stage, "fall leaves, merged")


def ground_of_stage(stage: Usd.Stage, prim: str, name: str) -> Ground:
    """An UmbrellaTexture of a stage whose background is opaque."""
    texture = zipmap_texture(stage, prim)
    data = texture.data
    textures = tuple(_straight(shape.image) for shape in data.arrangement.shapes)
    background = _straight(data.background) if data.background.file else np.float32([[data.background.fallback[:3]]])
    return Ground(f"{name}: {_size_of(data.arrangement)}", texture, textures, background[..., :3])


def real_leaves(folder: Path) -> Ground | None:
    """Nine scans of leaves made into a ground by the command, n, v and sizes about the paper's; None without."""
    scans = passiflora_scans()
    if not scans:
        return None
    size = f"{SIZES[0]}:{SIZES[1]}"
    stage = Usd.Stage.Open(str(author(scans, folder, "--size", size, "--vertices", str(_VERTICES)).stage))
    prim = next(prim for prim in stage.Traverse() if prim.GetTypeName() == "UmbrellaTexture")
    return ground_of_stage(stage, str(prim.GetPath()), "passion flower leaves")


def _size_of(arrangement: Arrangement) -> str:
    width, height = arrangement.grid
    vertices = float(np.mean([len(shape.points) for shape in arrangement.shapes]))
    return f"b {len(arrangement.shapes)}, v {vertices:.0f}, n {len(arrangement)}, grid {width} x {height}"


def _straight(image: ImageSource | None) -> np.ndarray:
    """(h, w, 3 or 4) float32, linear, straight alpha where there is one."""
    if image is None:
        return np.zeros((1, 1, 3), np.float32)
    texels = read_linear(image.file, image.color_space)
    if (texels[..., 3] == 1).all():
        return texels[..., :3]
    alpha = texels[..., 3:]
    return np.concatenate([texels[..., :3] / np.maximum(alpha, 1e-6), alpha], -1)  # 1e-6 guards transparent texels


def _level_bytes(level: UmbrellaLevelData) -> int:
    if level.image is not None:
        info = image_info(level.image.file)
        levels = range(level_count(info.width, info.height))
        return sum(level_size(info.width, n) * level_size(info.height, n) for n in levels) * info.channels
    merged = level.arrangement
    if merged is None:
        return 0
    words = len(merged) + 3 * len(merged.vertices) + cell_statistics(merged).most * merged.grid[0] * merged.grid[1]
    return _WORD * words
