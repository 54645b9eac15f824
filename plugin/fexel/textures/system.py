"""Textures of a view on the GPU: what it needs, loaded within a budget, and bound to a material's program.

`TextureSystem.begin_view` takes all (texture, surface) requests of a view at once, so that the budget is shared;
`binding` then gives a material's slots. What is seen and how it is looked up is for each kind's own half
(`fexel.textures.kind`); here is only what they have in common.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fexel.filters import DEFAULT_ACCESSES, DEFAULT_KERNEL, FILTERS
from fexel.renderer.visible import VisibleSurface
from fexel.scene.model import Texture
from fexel.textures import gpu_half
from fexel.textures.binding import TextureBinding
from fexel.textures.index import LocalPieces
from fexel.textures.kind import Sight, Slot
from fexel.textures.pool import TexturePool

if TYPE_CHECKING:
    import moderngl

__all__ = ["TextureBinding", "TextureRequest", "TextureSystem"]

# Varyings that a mesh may need for itself.
_MESH_COMPONENTS = 32


@dataclass(frozen=True, eq=False)
class TextureRequest:
    """A texture and the surface that shows it."""

    texture: Texture
    surface: VisibleSurface


class TextureSystem:
    """Residency of all textures of a renderer.

    Parameters
    ----------
    gl : moderngl.Context
        Current whenever a method is called.
    memory_mb : float
        Texture memory for the pages that hold texels, in MiB; the smallest page is of 64 x 64 texels. Past it
        coarser mip levels are shown; this warns once and never fails.
    anisotropy : float
        Most probes per lookup, >= 1; 1 is plain trilinear filtering.
    filter : str, optional
        One of `fexel.filters.FILTERS`, for all textures whatever they ask for.
    filter_kernel : str
        One of `fexel.filters.KERNELS`.
    fipmap_accesses : int
        One of `fexel.filters.FIPMAP_ACCESSES`.
    """

    def __init__(
        self,
        gl: moderngl.Context,
        memory_mb: float = 512.0,
        anisotropy: float = 8.0,
        filter: str | None = None,
        filter_kernel: str = DEFAULT_KERNEL,
        fipmap_accesses: int = DEFAULT_ACCESSES,
    ) -> None:
        self.pool = TexturePool(gl, memory_mb, anisotropy, filter, filter_kernel, fipmap_accesses)
        self._room = (int(gl.info["GL_MAX_VERTEX_OUTPUT_COMPONENTS"]) - _MESH_COMPONENTS) // 4
        self._slots: dict[int, tuple[TextureRequest, Slot]] = {}
        self._seen_layers: set[tuple[str, str]] = set()
        self._all_layers: dict[str, int] = {}
        self._filters: dict[str, str] = {}

    def begin_view(self, requests: Iterable[TextureRequest]) -> None:
        """Load what a view sees of its textures; forgets the bindings of the view before."""
        requests = list({id(request): request for request in requests}.values())
        self._slots = {}
        self.pool.begin()
        plans = [gpu_half(r.texture.kind).plan(r.texture.data, _sight(r), self.pool) for r in requests]
        self.pool.load()
        for request, plan in zip(requests, plans, strict=True):
            slot = plan.write(self.pool)
            self._slots[id(request)] = request, slot
            path = request.texture.path
            self._all_layers[path] = plan.layers_total
            self._filters[path] = slot.filter
            self._seen_layers.update((path, layer) for layer in plan.layers_seen)
        self.pool.records.upload()

    def binding(self, requests: Sequence[TextureRequest]) -> TextureBinding:
        """The slots of a material, in the order given; all must have been in `begin_view`."""
        slots = [self._slots[id(request)][1] for request in requests]
        asked = [request.texture.minification for request in requests]
        return TextureBinding(slots, self.pool, self._room, asked)

    def stats(self) -> dict[str, Any]:
        """For ``--stats``: layers of all textures met, seen and with texels resident; levels, chains and bytes; levels
        dropped; ``filters``: by token, textures whose base image is seen by it.
        """
        layers = {"patches_total": sum(self._all_layers.values()), "patches_seen": len(self._seen_layers)}
        filters = Counter(self._filters.values())
        return layers | self.pool.stats() | {"filters": {name: filters[name] for name in FILTERS if filters[name]}}

    def release(self) -> None:
        """Free all GL objects."""
        self.pool.release()
        self._slots.clear()


def _sight(request: TextureRequest) -> Sight:
    texture = request.texture
    frame = request.surface.st_frames[texture.st_primvar]
    pieces = request.surface.pieces[texture.st_primvar]
    local = LocalPieces(
        (pieces.st_min - frame.origin) * frame.scale,
        (pieces.st_max - frame.origin) * frame.scale,
        pieces.jacobian * frame.scale,
    )
    return Sight(texture.path, local, frame.local_to_st @ texture.st_transform)
