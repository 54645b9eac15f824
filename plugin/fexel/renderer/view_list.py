"""What a tile sees of a scene: draws in view with their surfaces, sorted for drawing.

Draws are culled by their bounds in float64, all at once; a draw with textures is looked at more closely by
`visible_surface`, which tells the texture system what is needed; many small occurrences of one mesh at once.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fexel.renderer.instances import SMALL_PX, pixels_per_unit, shared_surface
from fexel.renderer.surface import Surface
from fexel.renderer.viewport import Tile
from fexel.renderer.visible import View, visible_surface
from fexel.scene.model import Camera, Draw, Material, Mesh, Scene
from fexel.textures.system import TextureRequest

if TYPE_CHECKING:
    from fexel.renderer.visible import RebasedMesh, VisibleSurface

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

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the tile."""
        return self.tile.width, self.tile.height

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
class _Bounded:
    """A draw whose bounds are in view; `clip` (8, 4): their corners."""

    draw: Draw
    surface: Surface
    distance: float
    clip: np.ndarray
    size_px: tuple[int, int]

    @cached_property
    def is_small(self) -> bool:
        """In front of the camera and at most `SMALL_PX` wide and high."""
        w = self.clip[:, 3:]
        if (w <= 0.0).any() or (self.clip[:, 2:3] < -w).any():
            return False
        return bool((np.ptp(self.clip[:, :2] / w, axis=0) * self.size_px / 2 <= SMALL_PX).all())


@dataclass(frozen=True, eq=False)
class _Seen:
    """What is seen of a textured draw, and the requests for its textures."""

    visible: VisibleSurface
    requests: tuple[TextureRequest, ...]

    @classmethod
    def of(cls, surface: Surface, visible: VisibleSurface) -> _Seen:
        return cls(visible, tuple(TextureRequest(texture, visible) for texture in surface.textures))


@dataclass(frozen=True, eq=False)
class ViewList:
    """Draws of a tile."""

    viewpoint: Viewpoint
    items: tuple[Item, ...]

    @classmethod
    def of(cls, scene: Scene, viewpoint: Viewpoint) -> ViewList:
        """What `viewpoint` sees of `scene`."""
        draws = [draw for draw in scene.draws if draw.triangle_count > 0]
        bounds = list(_in_view(draws, viewpoint))
        shared = _shared_requests(bounds, viewpoint)
        items = (_item(bounded, viewpoint, shared.get(_occurrence_key(bounded))) for bounded in bounds)
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


def _in_view(draws: Sequence[Draw], viewpoint: Viewpoint) -> Iterator[_Bounded]:
    """The draws whose bounds touch the view."""
    if not draws:
        return
    world = np.stack([_corners(draw.mesh) for draw in draws]) @ np.stack([draw.object_to_world for draw in draws])
    distance = np.linalg.norm(world[..., :3].mean(axis=1) - viewpoint.eye, axis=1)
    clip = world @ viewpoint.world_to_clip
    w = clip[..., 3:]
    beyond = np.concatenate([clip[..., :3] > w, clip[..., :3] < -w], axis=-1)  # (N, 8 corners, 6 planes)
    seen = ~beyond.all(axis=1).any(axis=1)
    for i, draw in enumerate(draws):
        if seen[i]:
            yield _Bounded(draw, _surface(draw.material, draw.mesh), float(distance[i]), clip[i], viewpoint.size_px)


def _occurrence_key(bounded: _Bounded) -> tuple:
    draw = bounded.draw
    return (id(draw.mesh), id(draw.material), draw.first_triangle, draw.triangle_count, bounded.is_small)


def _shared_requests(bounds: Sequence[_Bounded], viewpoint: Viewpoint) -> dict[tuple, _Seen]:
    """One surface for the small textured occurrences of each mesh and material, where there are several."""
    groups: dict[tuple, list[_Bounded]] = {}
    for bounded in bounds:
        if bounded.is_small and bounded.surface.textures:
            groups.setdefault(_occurrence_key(bounded), []).append(bounded)
    together = {key: _seen_together(group, viewpoint) for key, group in groups.items() if len(group) > 1}
    return {key: seen for key, seen in together.items() if seen is not None}


def _seen_together(group: Sequence[_Bounded], viewpoint: Viewpoint) -> _Seen | None:
    scales = [pixels_per_unit(one.clip, one.draw, viewpoint.world_to_clip, viewpoint.size_px) for one in group]
    surface = group[0].surface
    visible = shared_surface([one.draw for one in group], scales, surface.st_primvars)
    return None if visible is None else _Seen.of(surface, visible)


def _item(bounded: _Bounded, viewpoint: Viewpoint, shared: _Seen | None) -> Item | None:
    draw, surface = bounded.draw, bounded.surface
    if not surface.textures:
        return Item(draw, surface, bounded.distance)
    if shared is None:
        view = View(viewpoint.world_to_clip, *viewpoint.size_px)
        visible = visible_surface(draw, view, surface.st_primvars)
        if visible is None:
            return None
        shared = _Seen.of(surface, visible)
    return Item(draw, surface, bounded.distance, shared.visible, shared.requests)
