"""At which footprints the cameras of a stage see its textures, without a GPU.

Every camera is looked through, at several times where the stage is animated; a stage without cameras is framed as
`fexel render` frames it. Of each picture a grid of pixels is looked at. What is hidden behind something else counts as
seen: it may come to light a frame later.

A triangle is hit where the pixel's homogeneous barycentric coordinates are positive (M. Olano, T. Greer 1997, Triangle
scan conversion using 2D homogeneous coordinates), which needs no clipping.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from fexel import homography
from fexel.renderer.surface import Surface
from fexel.renderer.viewport import conform_projection
from fexel.scene import SceneReader, image_height
from fexel.scene.model import Draw, Texture
from fexel_tools.progress import Progress

__all__ = ["SeenFootprints", "SeenTextures", "seen_footprints"]

_TIMES = 5  # of an animated stage
_COLUMNS = 192  # of the grid, at most
_Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SeenFootprints:
    """How a picture sees a texture.

    Attributes
    ----------
    jacobian : (K, 2, 2) float64
        d(inputs:st)/d(pixel), column j per pixel along x, y; t runs up.
    pixels : float
        How much of the picture each of them stands for.
    """

    jacobian: _Floats
    pixels: float


@dataclass(frozen=True, eq=False)
class SeenTextures:
    """How cameras see the textures of a stage.

    Attributes
    ----------
    footprints : dict of str to list of SeenFootprints
        By the path of each texture that a camera sees, one entry per picture.
    unplaced : dict of str to str
        By the path of a texture, what a prim lacks that it is to be seen on; it cannot be drawn there.
    """

    footprints: dict[str, list[SeenFootprints]]
    unplaced: dict[str, str]


def seen_footprints(stage: Usd.Stage, width: int, step: Progress) -> SeenTextures:
    """At which footprints cameras see the textures of a stage.

    Parameters
    ----------
    stage : Usd.Stage
    width : int
        Of the pictures that are meant, pixels.
    step : callable(step, done, total)
    """
    unplaced: dict[str, str] = {}
    reader = SceneReader(stage, lacking=unplaced)
    shots = [(camera, time) for camera in reader.cameras() or (None,) for time in _times(stage)]
    found: dict[str, list[SeenFootprints]] = {}
    for number, (camera, time) in enumerate(shots):
        step("views", number, len(shots))
        for path, seen in _picture(reader, camera, time, width).items():
            found.setdefault(path, []).append(seen)
    step("views", len(shots), len(shots))
    return SeenTextures(found, unplaced)


def _times(stage: Usd.Stage) -> list[float | None]:
    """Times to look at: the default one, or some of those that are authored."""
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if not stage.HasAuthoredTimeCodeRange() or not end > start:
        return [None]
    return [float(time) for time in np.linspace(start, end, _TIMES)]


def _picture(reader: SceneReader, camera: str | None, time: float | None, width: int) -> dict[str, SeenFootprints]:
    """Footprints of one picture."""
    scene = reader.at(time, camera)
    height = image_height(width, scene.camera.aspect)
    world_to_clip = scene.camera.world_to_camera @ conform_projection(scene.camera, width / height)
    spacing = max(1.0, width / _COLUMNS)
    grid = int(width / spacing), max(1, int(height / spacing))
    world_to_grid = world_to_clip @ _clip_to_grid(*grid)
    found: dict[str, list[_Floats]] = {}
    for draw in scene.draws:
        textures = Surface.of(draw.material, draw.mesh).textures if draw.triangle_count else ()
        for texture, jacobian in _seen(draw, textures, draw.object_to_world @ world_to_grid, grid):
            found.setdefault(texture.path, []).append(jacobian / spacing)
    return {path: SeenFootprints(np.concatenate(parts), spacing**2) for path, parts in found.items()}


def _clip_to_grid(columns: int, rows: int) -> _Floats:
    """(4, 4): from clip space to homogeneous places on the grid, x right, y down; row vectors, w kept."""
    return np.array([[columns / 2, 0, 0, 0], [0, -rows / 2, 0, 0], [0, 0, 1, 0], [columns / 2, rows / 2, 0, 1.0]])


def _seen(
    draw: Draw, textures: tuple[Texture, ...], object_to_grid: _Floats, grid: tuple[int, int]
) -> Iterator[tuple[Texture, _Floats]]:
    """Textures of a draw, and Jacobians (K, 2, 2) per step of the grid."""
    if not textures:
        return
    mesh = draw.mesh
    triangles = mesh.triangles[draw.first_triangle : draw.first_triangle + draw.triangle_count]
    places = (np.asarray(mesh.points, np.float64) @ object_to_grid[:3] + object_to_grid[3])[:, [0, 1, 3]]
    inverse = _inverses(places[triangles])
    number, hit = _hits(inverse, _boxes(places[triangles], grid))
    for texture in textures if len(number) else ():
        corners = np.asarray(mesh.st[texture.st_primvar], np.float64)[triangles[number]]
        st, jacobian = _interpolated(inverse[number], corners, hit)
        own = homography.jacobian(texture.st_transform, st) @ jacobian
        yield texture, own[np.isfinite(own).all((1, 2))]


def _inverses(corners: _Floats) -> _Floats:
    """(T, 3, 3) of corners (x w, y w, w); zero, which nothing hits, where a triangle has no area."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    columns = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-1)
    determinant = np.sum(a * columns[..., 0], axis=1)[:, None, None]
    return np.where(determinant != 0, columns / np.where(determinant != 0, determinant, 1.0), 0.0)


def _boxes(corners: _Floats, grid: tuple[int, int]) -> NDArray[np.int64]:
    """(T, 4): first and last column and row, exclusive; all of the grid where a triangle comes from behind the eye."""
    w = corners[..., 2:]
    before = (w > 0).all(axis=1)
    placed = corners[..., :2] / np.where(w > 0, w, 1.0)
    low = np.where(before, np.floor(placed.min(axis=1)), 0)
    high = np.where(before, np.ceil(placed.max(axis=1)), grid)
    return np.clip(np.concatenate([low, high], axis=1), 0, [*grid, *grid]).astype(np.int64)


def _hits(inverse: _Floats, boxes: NDArray[np.int64]) -> tuple[NDArray[np.int64], _Floats]:
    """Triangles that are hit, (K,), and where, (K, 2) on the grid."""
    count = int(_mark(inverse, boxes, np.empty(0, np.int64), np.empty((0, 2))))
    number, hit = np.empty(count, np.int64), np.empty((count, 2))
    _mark(inverse, boxes, number, hit)
    return number, hit


@numba.njit(cache=True)
def _mark(inverse: Any, boxes: Any, number: Any, hit: Any) -> int:
    """Count hits at the middle of each cell, and note those that there is room for."""
    count = 0
    for t in range(len(inverse)):
        m = inverse[t]
        for j in range(boxes[t, 1], boxes[t, 3]):
            for i in range(boxes[t, 0], boxes[t, 2]):
                x, y = i + 0.5, j + 0.5
                a = x * m[0, 0] + y * m[1, 0] + m[2, 0]
                b = x * m[0, 1] + y * m[1, 1] + m[2, 1]
                c = x * m[0, 2] + y * m[1, 2] + m[2, 2]
                if a >= 0 and b >= 0 and c >= 0 and a + b + c > 0:
                    if count < len(number):
                        number[count], hit[count, 0], hit[count, 1] = t, x, y
                    count += 1
    return count


def _interpolated(inverse: _Floats, corners: _Floats, hit: _Floats) -> tuple[_Floats, _Floats]:
    """Texture coordinates (K, 2) at places (K, 2), and their derivatives (K, 2, 2), column j along x, y."""
    weights = np.einsum("kr,krc->kc", np.concatenate([hit, np.ones((len(hit), 1))], axis=1), inverse)
    total = weights.sum(axis=1)
    st = np.einsum("kc,kcs->ks", weights, corners) / total[:, None]
    rate = inverse[:, :2]  # of the weights, along x and y
    change = np.einsum("kxc,kcs->ksx", rate, corners) - st[:, :, None] * rate.sum(axis=2)[:, None]
    return st, change / total[:, None, None]
