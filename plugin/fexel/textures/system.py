"""Textures of a view on the GPU: what it needs, loaded within a budget, and bound to a material's program.

`TextureSystem.begin_view` takes all (texture, surface) requests of a view at once, so that the budget is shared;
`binding` then gives a material's slots. Only what the view sees is opened: layers by the index, mip levels and windows
by footprint.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fexel import homography
from fexel.errors import FexelWarning
from fexel.renderer.visible import VisibleSurface
from fexel.scene.model import Texture
from fexel.textures.atlas import PageAtlas
from fexel.textures.index import LocalPieces, Tree, build_tree
from fexel.textures.layer_list import LayerList, layer_list
from fexel.textures.pyramid_cache import BYTES_PER_TEXEL, PyramidCache
from fexel.textures.records import ROW, texel_matrices, write_nodes, write_records
from fexel.textures.residency import MAX_LEVELS, PairView, Windows, drop_levels, view_pairs
from fexel.textures.zipmap import ImageSource, ZipmapData

if TYPE_CHECKING:
    import moderngl

__all__ = ["TextureBinding", "TextureRequest", "TextureSystem"]

_WRAP_CODES = {"patch": 0.0, "black": 0.0, "clamp": 1.0, "repeat": 2.0, "mirror": 3.0}
_PAGE_NAMES = ("Srgb", "Half")
# Varyings that a mesh may need for itself, and that a listed layer takes.
_MESH_COMPONENTS = 32
_LAYER_COMPONENTS = 16
_MOST_LISTED_SLOTS = 8


@dataclass(frozen=True, eq=False)
class TextureRequest:
    """A texture and the surface that shows it."""

    texture: Texture
    surface: VisibleSurface


@dataclass(frozen=True, eq=False)
class _Seen:
    """One request, planned: candidate layers and what is seen of them."""

    data: ZipmapData
    number: NDArray[np.int64]
    local_to_layer: NDArray[np.float64]
    tree: Tree
    pairs: PairView
    image: NDArray[np.int64]
    size: NDArray[np.int64]
    wrap: tuple[str, str]


@dataclass(frozen=True)
class _Slot:
    """Where a request's data are in the record texture; the shader's uniforms of one slot."""

    grid: tuple[float, float, float, float]
    tree: tuple[int, int, int, int]
    wrap: tuple[float, float, float, float]
    scale: tuple[float, ...]
    bias: tuple[float, ...]
    levels: int
    probes: bool
    outside: bool
    page_classes: frozenset[int]
    layers: LayerList | None


class TextureBinding:
    """Textures of one material for one view.

    Attributes
    ----------
    defines : dict of str to int
        Of the program; part of its key.
    """

    def __init__(self, slots: Sequence[_Slot], system: TextureSystem) -> None:
        self._slots = slots
        self._system = system
        classes = frozenset().union(*(slot.page_classes for slot in slots))
        self._classes = sorted(classes)
        self._lists = _lists(slots, system.most_listed)
        by_index = [slot for slot, listed in zip(slots, self._lists, strict=True) if listed is None]
        listed = [layers for layers in self._lists if layers is not None]
        self.defines = {
            "ZIPMAP_SLOTS": len(slots),
            "ZIPMAP_TREE": int(bool(by_index)),
            "ZIPMAP_LEVELS": max((slot.levels for slot in by_index), default=1),
            "ZIPMAP_PROBES": int(any(slot.probes for slot in by_index)),
            "ZIPMAP_LAYERS": max((len(layers.flat) for layers in listed), default=0),
            "ZIPMAP_OUTSIDE": int(any(slot.outside for slot in slots)),
            "ZIPMAP_SCALED": int(any(slot.scale != (1, 1, 1, 1) or slot.bias != (0, 0, 0, 0) for slot in slots)),
        }
        if listed:
            self.defines["ZIPMAP_FLAT"] = 4 * len(slots) * self.defines["ZIPMAP_LAYERS"]
        self.defines |= {f"ZIPMAP_{name.upper()}": int(number in classes) for number, name in enumerate(_PAGE_NAMES)}
        self.defines |= {
            f"ZIPMAP_CODES{number}": layers.codes if layers else 0 for number, layers in enumerate(self._lists)
        }

    def apply(self, program: moderngl.Program, first_unit: int = 0) -> int:
        """Set uniforms and bind textures from unit `first_unit` on; returns the next free unit."""
        textures = {"zipmapRecords": self._system.records}
        textures |= {f"zipmapPages{_PAGE_NAMES[c]}": self._system.atlases[c].texture for c in self._classes}
        unit = first_unit
        for name, texture in textures.items():
            if name in program and texture is not None:
                texture.use(unit)
                program[name] = unit
                unit += 1
        half = [(0.5 / atlas.size[0], 0.5 / atlas.size[1], 0.0, 0.0) for atlas in self._system.atlases]
        values: dict[str, Any] = {name: [getattr(slot, name[6:].lower()) for slot in self._slots] for name in (
            "zipmapGrid", "zipmapTree", "zipmapWrap", "zipmapScale", "zipmapBias"
        )}  # fmt: skip
        values["zipmapHalfTexel"] = half
        values |= self._list_uniforms()
        for name, value in values.items():
            if name in program:
                _set(program[name], value)
        if "zipmapMaxProbes" in program:
            program["zipmapMaxProbes"] = float(self._system.anisotropy)
        return unit

    def _list_uniforms(self) -> dict[str, NDArray[np.float64]]:
        """Of shaders/zipmap_list.glsl; slots that go by the index leave theirs at zero."""
        most = self.defines["ZIPMAP_LAYERS"]
        if not most:
            return {}
        flat = np.zeros((len(self._lists), most, 4, 4))
        numbers = np.zeros((len(self._lists), most, 4))
        root = np.zeros((len(self._lists), 4))
        for slot, layers in enumerate(self._lists):
            if layers is not None:
                count = len(layers.flat)
                flat[slot, :count], numbers[slot, :count], root[slot] = layers.flat, layers.numbers, layers.root
        named = {"zipmapLayers": flat, "zipmapNumbers": numbers, "zipmapRoot": root}
        return {name: value.reshape(-1, 4) for name, value in named.items()}


def _lists(slots: Sequence[_Slot], most: int) -> list[LayerList | None]:
    """The list of each slot; varyings are few, so the longest lists go by the index where there are too many."""
    lists = [slot.layers for slot in slots]
    if len(lists) > _MOST_LISTED_SLOTS:
        return [None] * len(lists)
    while (longest := max(0 if layers is None else len(layers.flat) for layers in lists)) * len(lists) > most:
        lists = [None if layers is None or len(layers.flat) == longest else layers for layers in lists]
    return lists


def _set(uniform: Any, values: Sequence[tuple] | NDArray[np.float64]) -> None:
    """An array of vectors; the driver may have cut off what the program does not read."""
    kind = np.int32 if isinstance(values[0][0], int) else np.float32
    uniform.write(np.array(values[: uniform.array_length], kind).tobytes())


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
    """

    def __init__(self, gl: moderngl.Context, memory_mb: float = 512.0, anisotropy: float = 8.0) -> None:
        self._gl = gl
        self._budget = max(int(memory_mb * 2**20), 0)
        self.anisotropy = max(1.0, float(anisotropy))
        self.atlases = tuple(PageAtlas(gl, page_class) for page_class in range(len(_PAGE_NAMES)))
        self.records: moderngl.Texture | None = None
        varyings = int(gl.info["GL_MAX_VERTEX_OUTPUT_COMPONENTS"])
        self.most_listed = (varyings - _MESH_COMPONENTS) // _LAYER_COMPONENTS
        self._cache = PyramidCache()
        self._slots: dict[int, tuple[TextureRequest, _Slot]] = {}
        self._images: dict[ImageSource, int] = {}
        self._warned = False
        self._totals: dict[str, int] = {"layers_total": 0, "dropped_levels": 0}
        self._seen_layers: set[tuple[str, str]] = set()
        self._all_layers: dict[str, int] = {}

    def begin_view(self, requests: Iterable[TextureRequest]) -> None:
        """Load what a view sees of its textures; forgets the bindings of the view before."""
        requests = list({id(request): request for request in requests}.values())
        self._images = {}
        self._names: list[str] = []
        seen = [self._plan(request) for request in requests]
        windows, levels, sizes = self._windows(seen)
        page_class = np.array([self._facts(source).page_class for source in self._images], np.int64)
        texel_bytes = np.array(BYTES_PER_TEXEL)[page_class]
        largest = min(atlas.largest for atlas in self.atlases)
        finest, dropped = drop_levels(windows, sizes, texel_bytes, self._budget, largest)
        needs = self._needs(windows, page_class)
        while not self._have_room(needs):
            smaller = 0.9 * int((windows.texels() * texel_bytes[:, None]).sum())
            further, more = drop_levels(windows, sizes, texel_bytes, smaller)
            if not more:
                break
            finest, dropped = np.maximum(finest, further), dropped + more
            needs = self._needs(windows, page_class)
        self._note_dropped(dropped)
        self._load(needs)
        places = self._places(sizes, page_class)
        self._write(requests, seen, levels, finest, places, page_class)

    def binding(self, requests: Sequence[TextureRequest]) -> TextureBinding:
        """The slots of a material, in the order given; all must have been in `begin_view`."""
        return TextureBinding([self._slots[id(request)][1] for request in requests], self)

    def stats(self) -> dict[str, int]:
        """For ``--stats``: layers of all zipmaps met, seen and with texels resident; levels and bytes; levels
        dropped.
        """
        residents = [key for atlas in self.atlases for key in atlas.residents]
        return {
            "patches_total": sum(self._all_layers.values()),
            "patches_seen": len(self._seen_layers),
            "images_resident": len({source for source, _ in residents}),  # pyright: ignore[reportGeneralTypeIssues]
            "levels_resident": len(residents),
            "texture_bytes": sum(atlas.nbytes for atlas in self.atlases),
            "record_bytes": self.records.width * self.records.height * 16 if self.records else 0,
            "dropped_levels": self._totals["dropped_levels"],
        }

    def release(self) -> None:
        """Free all GL objects."""
        for atlas in self.atlases:
            atlas.release()
        if self.records:
            self.records.release()
            self.records = None
        self._slots.clear()

    def _facts(self, source: ImageSource):
        return self._cache.facts(source, self._names[self._images[source]])

    def _plan(self, request: TextureRequest) -> _Seen:
        data: ZipmapData = request.texture.data
        frame = request.surface.st_frames[request.texture.st_primvar]
        pieces = request.surface.pieces[request.texture.st_primvar]
        local = LocalPieces(
            (pieces.st_min - frame.origin) * frame.scale,
            (pieces.st_max - frame.origin) * frame.scale,
            pieces.jacobian * frame.scale,
        )
        local_to_st = frame.local_to_st @ request.texture.st_transform
        number = _in_bounds(data, pieces.st_min, pieces.st_max, request.texture.st_transform)
        local_to_layer = homography.normalize(local_to_st @ data.root_to_patch[number])
        bounds = homography.unit_square_bounds(local_to_layer)
        bounds[0] = -np.inf, -np.inf, np.inf, np.inf
        tree = build_tree(local, local_to_layer, bounds)
        used = np.unique(np.append(tree.pair_layer, 0))
        image = np.full(len(number), -1, np.int64)
        size = np.ones((len(number), 2), np.int64)
        for layer in used:
            source = data.sources[data.source_index[number[layer]]]
            if source not in self._images:
                self._images[source] = len(self._images)
                self._names.append(data.paths[number[layer]])
            image[layer] = self._images[source]
            size[layer] = self._facts(source).size
        pairs = view_pairs(tree, local_to_layer, bounds, size.astype(np.float64), self.anisotropy)
        pairs = pairs[_shows(pairs, size)]
        self._all_layers[request.texture.path] = len(data.paths)
        self._seen_layers.update((request.texture.path, data.paths[number[layer]]) for layer in np.unique(pairs.layer))
        wrap = self._facts(data.sources[data.source_index[0]]).wrap
        return _Seen(data, number, local_to_layer, tree, pairs, image, size, wrap)

    def _windows(self, seen: Sequence[_Seen]) -> tuple[Windows, list[tuple[NDArray, NDArray]], NDArray[np.int64]]:
        facts = [self._facts(source) for source in self._images]
        sizes = np.array([fact.size for fact in facts], np.int64).reshape(-1, 2)
        whole = np.array([[mode in ("repeat", "mirror") for mode in fact.wrap] for fact in facts]).reshape(-1, 2)
        windows, levels = Windows.empty(len(facts)), []
        for view in seen:
            pairs = view.pairs
            last = np.array([int(max(size)).bit_length() - 1 for size in view.size], np.int64)[pairs.layer]
            last = np.minimum(last, MAX_LEVELS - 1)
            finest = np.floor(pairs.lod_low).clip(0, last).astype(np.int64)
            coarsest = (np.floor(pairs.lod_high) + 1).clip(0, last).astype(np.int64)
            levels.append((finest, coarsest))
            windows.add(view.image[pairs.layer], levels[-1], (pairs.low, pairs.high), sizes, whole)
        return windows, levels, sizes

    def _note_dropped(self, dropped: int) -> None:
        self._totals["dropped_levels"] = max(self._totals["dropped_levels"], dropped)
        if dropped and not self._warned:
            self._warned = True
            warnings.warn(
                f"texture memory of {self._budget / 2**20:g} MiB, or a texture of at most {self.atlases[0].largest} "
                f"texels across, is too small for this view: {dropped} mip levels were left out and coarser ones are "
                "shown; raise --textureMemory",
                FexelWarning,
                stacklevel=3,
            )

    def _needs(self, windows: Windows, page_class: NDArray[np.int64]) -> list[dict]:
        """Windows by (source, level), a dict per page class."""
        sources = list(self._images)
        needed = (windows.box[..., 2:] > windows.box[..., :2]).all(axis=-1)
        return [
            {
                (sources[image], int(level)): tuple(int(v) for v in windows.box[image, level])
                for image, level in np.argwhere(needed & (page_class == atlas.page_class)[:, None])
            }
            for atlas in self.atlases
        ]

    def _have_room(self, all_needs: list[dict]) -> bool:
        """Whether the pages can hold these windows within the budget; makes them empty where that helps."""
        if sum(atlas.bytes_for(needs) for atlas, needs in zip(self.atlases, all_needs, strict=True)) <= self._budget:
            return True
        afresh = sum(atlas.bytes_for(needs, afresh=True) for atlas, needs in zip(self.atlases, all_needs, strict=True))
        if afresh > self._budget:
            return False
        for atlas in self.atlases:
            atlas.release()
        return True

    def _load(self, all_needs: list[dict]) -> None:
        for atlas, needs in zip(self.atlases, all_needs, strict=True):
            for key in atlas.begin(needs) if needs else ():
                name = self._names[self._images[key[0]]]
                atlas.write(key, self._cache.window(key[0], name, key[1], needs[key]))

    def _places(self, sizes: NDArray[np.int64], page_class: NDArray[np.int64]) -> NDArray[np.float64]:
        """(S, L, 4) scale and offset from texels of level 0 to page coordinates, of what is resident."""
        places = np.zeros((len(sizes), MAX_LEVELS, 4))
        for number, source in enumerate(self._images):
            atlas = self.atlases[page_class[number]]
            page = np.array(atlas.size, np.float64)
            for level in range(MAX_LEVELS):
                resident = atlas.residents.get((source, level))
                if resident is not None:
                    level_size = np.maximum(sizes[number] >> level, 1)
                    places[number, level, :2] = level_size / sizes[number] / page
                    places[number, level, 2:] = (np.array([resident.x, resident.y]) - resident.box[:2]) / page
        return places

    def _write(
        self,
        requests: Sequence[TextureRequest],
        seen: Sequence[_Seen],
        levels: Sequence[tuple[NDArray, NDArray]],
        image_finest: NDArray[np.int64],
        places: NDArray[np.float64],
        page_class: NDArray[np.int64],
    ) -> None:
        self._slots = {}
        texels: list[NDArray[np.float32]] = []
        base = 0
        for request, view, (finest, coarsest) in zip(requests, seen, levels, strict=True):
            finest = np.maximum(finest, image_finest[view.image[view.pairs.layer]])
            coarsest = np.maximum(coarsest, finest)
            layers = {
                "matrix": texel_matrices(view.local_to_layer, view.size.astype(np.float64)),
                "size": view.size,
                "opacity": view.data.opacity[view.number],
                "page_class": page_class[view.image],
                "image": view.image,
                "number": view.number,
            }
            records, start = write_records(view.pairs, (finest, coarsest), layers, places)
            nodes = write_nodes(view.tree, view.pairs, start + base, base + len(records))
            texels += [records, nodes]
            short = layer_list(view.tree, view.pairs, (finest, coarsest), layers, places)
            slot = _slot(view, base + len(records), coarsest > finest, page_class, short)
            self._slots[id(request)] = (request, slot)
            base += len(records) + len(nodes)
        self._upload(np.concatenate(texels) if texels else np.zeros((1, 4), np.float32))

    def _upload(self, texels: NDArray[np.float32]) -> None:
        rows = -(-len(texels) // ROW)
        if self.records is None or self.records.height < rows:
            if self.records:
                self.records.release()
            self.records = self._gl.texture((ROW, max(rows, 16)), 4, dtype="f4")
            self.records.filter = (self._gl.NEAREST, self._gl.NEAREST)
        padded = np.zeros((rows * ROW, 4), np.float32)
        padded[: len(texels)] = texels
        self.records.write(padded.tobytes(), viewport=(0, 0, ROW, rows))


def _in_bounds(data: ZipmapData, st_min: NDArray, st_max: NDArray, transform: NDArray) -> NDArray[np.int64]:
    """Layers whose bounds touch what is seen; the root, layer 0, first."""
    low, high = st_min.min(axis=0), st_max.max(axis=0)
    corners = homography.apply(transform, low + homography.UNIT_SQUARE * (high - low))
    low, high = corners.min(axis=0), corners.max(axis=0)
    touches = ((data.bounds[:, :2] <= high) & (data.bounds[:, 2:] >= low)).all(axis=1)
    touches[0] = True
    return np.flatnonzero(touches & ((data.opacity > 0) | (np.arange(len(touches)) == 0)))


def _shows(pairs: PairView, size: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Pairs whose patch is not yet all rim: a level under 3 texels wide or high is empty."""
    smallest = size.min(axis=1)
    last_shown = np.where(smallest >= 3, np.floor(np.log2(np.maximum(smallest, 3) / 3)), -1.0)
    return (pairs.layer == 0) | (pairs.lod_low < last_shown[pairs.layer] + 1)


def _root_is_seen_outside(view: _Seen, probes: bool) -> bool:
    """Whether the root's wrap mode matters; anisotropic probes may reach across its edge from within."""
    if probes and view.wrap != ("clamp", "clamp"):
        return True
    visible = view.tree.visible
    seen = np.concatenate([view.tree.low[visible], view.tree.high[visible]])
    corners = homography.UNIT_SQUARE * np.ptp(seen, axis=0) + seen.min(axis=0)
    root_st = homography.apply(view.local_to_layer[0], corners)
    # 1e-5 is far below a texel; a surface whose st end at 0 and 1 may exceed them by rounding.
    return not bool(((root_st >= -1e-5) & (root_st <= 1 + 1e-5)).all())


def _slot(
    view: _Seen,
    first_node: int,
    two_levels: NDArray[np.bool_],
    page_class: NDArray[np.int64],
    layers: LayerList | None,
) -> _Slot:
    tree = view.tree
    scale = 1.0 / tree.cell_size
    offset = -tree.origin * scale
    probes = bool((view.pairs.probes > 1).any())
    return _Slot(
        grid=(float(scale[0]), float(scale[1]), float(offset[0]), float(offset[1])),
        tree=(first_node, tree.shape[0], tree.shape[1], 0),
        wrap=(_WRAP_CODES[view.wrap[0]], _WRAP_CODES[view.wrap[1]], 0.0, 0.0),
        scale=view.data.scale,
        bias=view.data.bias,
        levels=2 if two_levels.any() else 1,
        probes=probes,
        outside=_root_is_seen_outside(view, probes),
        page_classes=frozenset(int(c) for c in page_class[view.image[np.unique(view.pairs.layer)]]),
        layers=layers,
    )
