"""Umbrella textures for tests and benchmarks: stages from arrangements, pictures by the renderer's own lookup."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pxr import Usd

import fexel
from bench.zipmap_stage import front_view, quad, render_texture, tilted_view, zipmap_texture
from fexel.renderer.visible import View
from fexel.scene.model import Draw, Texture
from fexel.textures.image_source import ImageSource
from fexel.textures.system import TextureSystem
from fexel.textures.umbrella_arrangement import Arrangement
from fexel_tools.umbrella_stage import LevelPrim, UmbrellaMap, create_stage, define_level

__all__ = ["LowView", "affine_view", "low_view", "picture", "picture_low", "umbrella_stage", "umbrella_texture"]

_SPAN_CELLS = 400.0  # of the ground that flights look at


def umbrella_stage(
    path: Path, arrangement: Arrangement, background: ImageSource, levels: Iterable[LevelPrim] = ()
) -> tuple[Usd.Stage, str]:
    """A stage with the texture on a ground, as the command writes it, saved; and the path of the texture prim."""
    folder = path.with_name(path.stem + "_textures")
    folder.mkdir(parents=True, exist_ok=True)
    files = tuple(shape.image.file if shape.image else "" for shape in arrangement.shapes)
    names = [f"Base{number}" for number in range(len(files))]
    map_ = UmbrellaMap("Texture", "diffuseColor", files, "sRGB", background.file)
    stage = create_stage(path, folder, arrangement, names, [map_])
    for level in levels:
        define_level(fexel.UmbrellaTexture.Get(stage, map_.path), level)
    stage.Save()
    return stage, map_.path


def umbrella_texture(
    path: Path, arrangement: Arrangement, background: ImageSource, levels: Iterable[LevelPrim] = ()
) -> Texture:
    """The texture of such a stage as the renderer gets it."""
    return zipmap_texture(*umbrella_stage(path, arrangement, background, levels))


def picture(
    gl, texture: Texture, pixel_to_st: np.ndarray, size: tuple[int, int], system: TextureSystem | None = None
) -> np.ndarray:
    """(H, W, 4) float32, linear, premultiplied: an affine view through the renderer's shader.

    `pixel_to_st` (3, 3) as `bench.umbrella_truth.turned_view` gives it.
    """
    return render_texture(gl, texture, *affine_view(pixel_to_st, size), system)


def affine_view(pixel_to_st: np.ndarray, size: tuple[int, int]) -> tuple[Draw, View]:
    """A quad that fills such a view."""
    width, height = size
    corners = np.array([[0, height], [width, height], [width, 0], [0, 0]]) @ pixel_to_st[:2, :2] + pixel_to_st[2, :2]
    draw = quad()
    return replace(draw, mesh=replace(draw.mesh, st={"st": corners})), front_view((0, 0), (1, 1), width, height)


@dataclass(frozen=True)
class LowView:
    """A view low over a ground of square cells.

    Attributes
    ----------
    pixel_to_st : (3, 3) float64
        Row vectors; every pixel shows the ground.
    footprint_px : float
        Width of a cell at the middle of the picture, pixels.
    """

    draw: Draw
    view: View
    pixel_to_st: np.ndarray
    footprint_px: float


def low_view(
    grid: tuple[int, int], forward: float, tilt: float, fov: float, footprint_px: float, size: tuple[int, int]
) -> LowView:
    """Looks down at 90 - `tilt` degrees with a vertical field of `fov`, moved `forward` by so many cells."""
    low = np.array([0.137, 0.211])
    span = _SPAN_CELLS / np.array(grid)
    distance = size[1] / (2 * np.tan(np.radians(fov) / 2)) / footprint_px / _SPAN_CELLS
    view = tilted_view((0.5, 0.35 + forward / _SPAN_CELLS), distance, tilt, *size, fov)
    plane_to_clip = view.world_to_clip[[0, 1, 3]][:, [0, 1, 3]]
    to_clip = np.array([[2 / size[0], 0, 0], [0, -2 / size[1], 0], [-1, 1, 1]])
    matrix = to_clip @ np.linalg.inv(plane_to_clip) @ np.array([[span[0], 0, 0], [0, span[1], 0], [*low, 1]])
    matrix *= np.sign((np.array([*size, 2]) / 2 @ matrix)[2])
    return LowView(quad(low, low + span), view, matrix, footprint_px)


def picture_low(gl, texture: Texture, low: LowView, system: TextureSystem | None = None) -> np.ndarray:
    """(H, W, 4) float32, linear, premultiplied."""
    return render_texture(gl, texture, low.draw, low.view, system)
