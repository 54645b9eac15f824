"""Umbrella textures for tests and benchmarks: prims from arrangements, pictures by the renderer's own lookup."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from pxr import Gf, Sdf, Usd, Vt

import fexel
from bench.zipmap_stage import front_view, quad, render_texture, zipmap_texture
from fexel.scene.model import Texture
from fexel.textures.image_source import ImageSource
from fexel.textures.system import TextureSystem
from fexel.textures.umbrella_arrangement import Arrangement

__all__ = ["Level", "define_umbrella", "picture", "umbrella_texture"]


@dataclass(frozen=True)
class Level:
    """A coarser level: an image of the whole arrangement, or merged umbrellas."""

    level: int
    file: str = ""
    arrangement: Arrangement | None = None


def umbrella_texture(arrangement: Arrangement, background: ImageSource, levels: Iterable[Level] = ()) -> Texture:
    """The texture as the renderer gets it from a stage."""
    stage = Usd.Stage.CreateInMemory()
    define_umbrella(stage, "/Umbrella", arrangement, background, levels)
    return zipmap_texture(stage, "/Umbrella")


def define_umbrella(
    stage: Usd.Stage, path: str, arrangement: Arrangement, background: ImageSource, levels: Iterable[Level] = ()
) -> Usd.Prim:
    """An UmbrellaTexture that repeats."""
    assert fexel.__all__
    prim = stage.DefinePrim(path, "UmbrellaTexture")
    names = Sdf.ValueTypeNames
    _author_arrangement(prim, arrangement)
    attributes = {
        "morphs": (names.FloatArray, Vt.FloatArray.FromNumpy(arrangement.morphs.astype(np.float32))),
        "colors": (names.Color3fArray, Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(arrangement.colors))),
        "inputs:file": (names.Asset, Sdf.AssetPath(background.file)),
        "inputs:sourceColorSpace": (names.Token, background.color_space),
        "inputs:wrapS": (names.Token, "repeat"),
        "inputs:wrapT": (names.Token, "repeat"),
        "inputs:colorBlend": (names.Float, arrangement.color_blend),
        "inputs:shadowOffset": (names.Float2, Gf.Vec2f(*arrangement.shadow_offset)),
        "inputs:shadowStrength": (names.Float, arrangement.shadow_strength),
    }
    _author(prim, attributes)
    for number, shape in enumerate(arrangement.shapes):
        patch = stage.DefinePrim(f"{path}/patch{number:02}", "UmbrellaPatch")
        arrays = {"points": shape.points, "morphPoints": shape.morph_points, "texCoords": shape.tex_coords}
        _author(patch, {name: (names.Float2Array, _vec2f(values)) for name, values in arrays.items()})
        if shape.image is not None:
            _author(patch, {"file": (names.Asset, Sdf.AssetPath(shape.image.file))})
    for level in levels:
        _define_level(stage, f"{path}/level{level.level:02}", level)
    return prim


def picture(
    gl, texture: Texture, pixel_to_st: np.ndarray, size: tuple[int, int], system: TextureSystem | None = None
) -> np.ndarray:
    """(H, W, 4) float32, linear, premultiplied: an affine view through the renderer's shader.

    `pixel_to_st` (3, 3) as `bench.umbrella_truth.turned_view` gives it.
    """
    width, height = size
    corners = np.array([[0, height], [width, height], [width, 0], [0, 0]]) @ pixel_to_st[:2, :2] + pixel_to_st[2, :2]
    draw = quad()
    draw = replace(draw, mesh=replace(draw.mesh, st={"st": corners}))
    return render_texture(gl, texture, draw, front_view((0, 0), (1, 1), width, height), system)


def _define_level(stage: Usd.Stage, path: str, level: Level) -> None:
    names = Sdf.ValueTypeNames
    prim = stage.DefinePrim(path, "UmbrellaLevel")
    _author(prim, {"level": (names.Int, level.level)})
    if level.file:
        _author(prim, {"file": (names.Asset, Sdf.AssetPath(level.file))})
    merged = level.arrangement
    if merged is None:
        return
    _author(
        prim,
        {
            "grid": (names.Int2, Gf.Vec2i(*merged.grid)),
            "patchIndices": (names.IntArray, Vt.IntArray.FromNumpy(np.full(len(merged), -1, np.int32))),
            "vertexCounts": (names.IntArray, Vt.IntArray.FromNumpy(merged.vertex_counts.astype(np.int32))),
            "points": (names.Float2Array, _vec2f(merged.vertices)),
            "colors": (names.Color3fArray, Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(merged.colors))),
            "coverages": (names.FloatArray, Vt.FloatArray.FromNumpy(merged.coverages.astype(np.float32))),
        },
    )


def _author_arrangement(prim: Usd.Prim, arrangement: Arrangement) -> None:
    names = Sdf.ValueTypeNames
    _author(
        prim,
        {
            "grid": (names.Int2, Gf.Vec2i(*arrangement.grid)),
            "patchIndices": (names.IntArray, Vt.IntArray.FromNumpy(arrangement.shape_of.astype(np.int32))),
            "matrices": (names.Matrix3dArray, Vt.Matrix3dArray.FromNumpy(np.ascontiguousarray(arrangement.matrices))),
        },
    )


def _author(prim: Usd.Prim, attributes: dict[str, tuple]) -> None:
    for name, (kind, value) in attributes.items():
        prim.CreateAttribute(name, kind).Set(value)


def _vec2f(points: np.ndarray) -> Vt.Vec2fArray:
    return Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(points, np.float32).reshape(-1, 2))
