"""Make the deep zoom: twelve patches, each inside the one before, four times finer and turned by 20 degrees.

usage: python stages/zipmap_deep/make.py        (rewrites zipmap_deep.usda and textures/ beside this script)
"""

from __future__ import annotations

import sys
from pathlib import Path

import mandelbrot
import numpy as np
from pxr import Gf, Sdf, Usd

import fexel
from fexel_tools import fallback

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent))
import stage_parts  # noqa: E402 - beside the folders of the stages

LEVELS = 12
ZOOM = 4.0  # a patch is a quarter as wide as its parent
TURN_DEG = 20.0
SIZE_PX = 128
FADE_PX = 8  # width of the blend from a patch to its parent
SIDE = 2.0  # of the wall, metres


def patch_matrix(level: int) -> np.ndarray:
    """Parent's st to the patch's, row vectors: about the place of the target, turned, four times larger.

    The target lies at the centre of every patch, but not of the root.
    """
    s, t = mandelbrot.target_st() if level == 1 else (0.5, 0.5)
    angle = np.radians(TURN_DEG)
    cos, sin = ZOOM * np.cos(angle), ZOOM * np.sin(angle)
    linear = np.array([[cos, -sin], [sin, cos]])
    offset = np.array([0.5, 0.5]) - np.array([s, t]) @ linear
    return np.vstack([np.column_stack([linear, [0, 0]]), [*offset, 1]])


def texture(level: int) -> np.ndarray:
    """Pixels of a level, (size, size, 4) uint8, sRGB-encoded, straight alpha, 0 at the border; the root has none."""
    center = mandelbrot.ROOT_CENTER if level == 0 else mandelbrot.TARGET
    turn = np.exp(1j * np.radians(TURN_DEG) * level)
    rgb = mandelbrot.render(center, mandelbrot.ROOT_WIDTH / ZOOM**level * turn, SIZE_PX)
    encoded = np.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * rgb ** (1 / 2.4) - 0.055)
    ramp = np.minimum(np.arange(SIZE_PX), np.arange(SIZE_PX)[::-1]) / FADE_PX
    alpha = np.minimum(1.0, np.minimum.outer(ramp, ramp))
    return np.round((np.dstack([encoded, alpha]) if level else encoded) * 255).astype(np.uint8)


def write_texture(level: int) -> str:
    """Write a level's texture; returns its path relative to the stage."""
    name = f"textures/level_{level:02d}.png"
    stage_parts.write_png(FOLDER / name, texture(level))
    return name


def add_levels(stage: Usd.Stage, root: fexel.ZipmapTexture) -> None:
    """Nest the levels below the root's prim."""
    texture_prim = root
    for level in range(LEVELS + 1):
        if level:
            texture_prim = fexel.ZipmapTexture.Define(stage, texture_prim.GetPath().AppendChild(f"Level{level:02d}"))
            texture_prim.CreateMatrixAttr(Gf.Matrix3d(*patch_matrix(level).ravel()))
        texture_prim.CreateFileAttr(Sdf.AssetPath(f"./{write_texture(level)}"))
        texture_prim.CreateWrapSAttr("clamp" if level == 0 else "black")
        texture_prim.CreateWrapTAttr("clamp" if level == 0 else "black")


def main() -> None:
    """Write the textures, the stage and its fallback."""
    path = FOLDER / "zipmap_deep.usda"
    stage = stage_parts.new_stage(path, "A texture of 128 pixels in which one can zoom in 16 million times.")
    stage_parts.add_scopes(stage)
    material, zipmap = stage_parts.add_zipmap_material(stage, "/World/Materials/Deep")
    add_levels(stage, zipmap)
    stage_parts.add_wall(stage, SIDE, SIDE, material)
    stage_parts.add_even_light(stage)
    s, t = mandelbrot.target_st()
    target = ((s - 0.5) * SIDE, (t - 0.5) * SIDE)
    stage_parts.add_zoom_camera(stage, "/World/Cameras/Zoom", target, (SIDE, SIDE / ZOOM**LEVELS))
    stage_parts.add_zoom_camera(stage, "/World/Cameras/Overview", (0.0, 0.0), (SIDE, SIDE))
    stage_parts.add_zoom_camera(stage, "/World/Cameras/Detail", target, (SIDE / ZOOM**LEVELS,) * 2)
    stage_parts.save(stage, path)
    opened = Usd.Stage.Open(str(path))
    fallback.write_fallback(opened.GetPrimAtPath(zipmap.GetPath()), FOLDER / "textures" / "fallback.png", size=512)
    opened.Save()


if __name__ == "__main__":
    main()
