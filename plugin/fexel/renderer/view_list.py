"""What a tile sees of a scene: draws in view with their surfaces, sorted for drawing.

Draws are culled by their bounds in float64, all at once; a draw with textures is looked at more closely by
`visible_surface`, which tells the texture system what is needed.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fexel.renderer.surface import Surface
from fexel.renderer.viewport import Tile
from fexel.scene.model import Camera, Draw, Material, Mesh, Scene

if TYPE_CHECKING:
    from fexel.renderer.visible import RebasedMesh, VisibleSurface
    from fexel.textures.system import TextureRequest

__all__ = ["Item", "ViewList", "Viewpoint"]


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A camera and a tile, float64, row vectors.

    Attributes
    ----------
    world_to_clip : (4, 4)
        Of the tile.
    eye : (3,)
        World position of the camera.
    world_to_eye_axes : (3, 3)
        Rotation from world to camera axes, without the camera's scale.
    perspective : bool
    clipping_planes : (N, 4)
        World space.
    """

    world_to_clip: np.ndarray
    eye: np.ndarray
    world_to_eye_axes: np.ndarray
    perspective: bool
    clipping_planes: np.ndarray
    tile: Tile

    @classmethod
    def of(cls, camera: Camera, projection: np.ndarray, tile: Tile) -> Viewpoint:
        """The viewpoint of one tile of an image with the given projection (4, 4)."""
        rotation = camera.world_to_camera[:3, :3]
        scale = np.cbrt(abs(np.linalg.det(rotation)))
        return cls(
            world_to_clip=camera.world_to_camera @ projection @ tile.clip_window,
            eye=np.linalg.inv(camera.world_to_camera)[3, :3],
            world_to_eye_axes=rotation / scale,
            perspective=bool(projection[3, 3] == 0.0),
            clipping_planes=np.asarray(camera.clipping_planes, np.float64).reshape(-1, 4),
            tile=tile,
        )


@dataclass(frozen=True, eq=False)
class Item:
    """A draw in view. `visible` and `requests` are set when it has textures."""

    draw: Draw
    surface: Surface
    distance: float
    visible: VisibleSurface | None = None
    requests: tuple[TextureRequest, ...] = ()

    @property
    def double_sided(self) -> bool:
        """As authored on the prim."""
        return self.draw.double_sided

    @property
    def rebased(self) -> RebasedMesh | None:
        """Vertices that replace the mesh's in a deep zoom."""
        return self.visible.rebased if self.visible is not None else None


@dataclass(frozen=True, eq=False)
class ViewList:
    """Draws of a tile."""

    viewpoint: Viewpoint
    items: tuple[Item, ...]

    @classmethod
    def of(cls, scene: Scene, viewpoint: Viewpoint) -> ViewList:
        """What `viewpoint` sees of `scene`."""
        draws = [draw for draw in scene.draws if draw.triangle_count > 0]
        seen, distances = _in_view(draws, viewpoint)
        items = (_item(draws[i], float(distances[i]), viewpoint) for i in np.flatnonzero(seen))
        return cls(viewpoint, tuple(item for item in items if item is not None))

    @cached_property
    def opaque(self) -> tuple[Item, ...]:
        """As in the scene, where draws of one mesh and material follow one another."""
        return tuple(item for item in self.items if not item.surface.translucent)

    @cached_property
    def translucent(self) -> tuple[Item, ...]:
        """From back to front, by the middle of the bounds."""
        blended = [item for item in self.items if item.surface.translucent]
        return tuple(sorted(blended, key=lambda item: -item.distance))


# A surface per (material, mesh); both are compared by identity and neither is kept alive.
_surfaces: weakref.WeakKeyDictionary[Material, weakref.WeakKeyDictionary[Mesh, Surface]] = weakref.WeakKeyDictionary()
_bounds: weakref.WeakKeyDictionary[Mesh, np.ndarray] = weakref.WeakKeyDictionary()


def _surface(material: Material, mesh: Mesh) -> Surface:
    by_mesh = _surfaces.setdefault(material, weakref.WeakKeyDictionary())
    if mesh not in by_mesh:
        by_mesh[mesh] = Surface.of(material, mesh)
    return by_mesh[mesh]


def _corners(mesh: Mesh) -> np.ndarray:
    """Corners of the bounds, (8, 4) float64, homogeneous."""
    if mesh not in _bounds:
        low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
        choice = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
        _bounds[mesh] = np.concatenate([np.where(choice, high, low), np.ones((8, 1))], axis=1)
    return _bounds[mesh]


def _in_view(draws: Sequence[Draw], viewpoint: Viewpoint) -> tuple[np.ndarray, np.ndarray]:
    """Whether the bounds of each draw touch the view (N,) bool, and their distance from the camera (N,)."""
    if not draws:
        return np.zeros(0, bool), np.zeros(0)
    world = np.stack([_corners(draw.mesh) for draw in draws]) @ np.stack([draw.object_to_world for draw in draws])
    distance = np.linalg.norm(world[..., :3].mean(axis=1) - viewpoint.eye, axis=1)
    clip = world @ viewpoint.world_to_clip
    w = clip[..., 3:]
    beyond = np.concatenate([clip[..., :3] > w, clip[..., :3] < -w], axis=-1)  # (N, 8 corners, 6 planes)
    return ~beyond.all(axis=1).any(axis=1), distance


def _item(draw: Draw, distance: float, viewpoint: Viewpoint) -> Item | None:
    surface = _surface(draw.material, draw.mesh)
    if not surface.textures:
        return Item(draw, surface, distance)
    from fexel.renderer.visible import View, visible_surface
    from fexel.textures.system import TextureRequest

    view = View(viewpoint.world_to_clip, viewpoint.tile.width, viewpoint.tile.height)
    visible = visible_surface(draw, view, surface.st_primvars)
    if visible is None:
        return None
    return Item(draw, surface, distance, visible, tuple(TextureRequest(t, visible) for t in surface.textures))
