"""Texels of all textures of a renderer on the GPU, whatever their kind: one budget, one set of pages, one cache.

Per view: `begin`, then `image` and `ask` for everything that is seen, `load`, and the records. Where the budget does
not hold what was asked for, coarser mip levels take the place of the finest ones (`finest`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelWarning
from fexel.filters import (
    DEFAULT_ACCESSES,
    DEFAULT_FILTER,
    DEFAULT_KERNEL,
    checked_accesses,
    checked_filter,
    checked_kernel,
)
from fexel.filters.chain import Chain
from fexel.textures.atlas import Box, PageAtlas
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.page_format import PAGE_FORMATS
from fexel.textures.pyramid_cache import ImageFacts, PyramidCache
from fexel.textures.record_texture import RecordTexture
from fexel.textures.residency import MAX_LEVELS, Windows, drop_levels

if TYPE_CHECKING:
    import moderngl

__all__ = ["TexelReader", "TexturePool"]


class TexelReader(Protocol):
    """Reads the texels of a kind of sources; one of each class per pool, so that it can keep what it has read."""

    def facts(self, source: Any, path: str, /) -> ImageFacts:
        """Size, page class and wrap modes; `path` is the prim to name when the file cannot be read."""
        ...

    def window(self, source: Any, path: str, level: int, box: Box, /) -> NDArray:
        """Texels of a window with a border of one texel around it, in the format of the page."""
        ...


_Reader = TypeVar("_Reader")


@dataclass(frozen=True, eq=False)
class _Image:
    source: Hashable
    path: str
    reader: TexelReader
    facts: ImageFacts


class TexturePool:
    """Pages, records and budget.

    Parameters
    ----------
    gl : moderngl.Context
    memory_mb : float
        Texture memory for the pages that hold texels, in MiB.
    anisotropy : float
        Most probes per lookup, >= 1.
    filter : str, optional
        One of `fexel.filters.FILTERS`, for all textures whatever they ask for.
    filter_kernel : str
        One of `fexel.filters.KERNELS`.
    fipmap_accesses : int
        One of `fexel.filters.FIPMAP_ACCESSES`.

    Attributes
    ----------
    filter_kernel : str
    fipmap_accesses : int
    atlases : tuple of PageAtlas
        By page class.
    records : RecordTexture
    finest : (S,) int64
        After `load`: the finest level that each image of the view may have.
    places : (S, L, 4) float64
        After `load`: scale and offset from texels of level 0 to page coordinates, of what is resident.
    page_class : (S,) int64
        After `load`.
    """

    def __init__(
        self,
        gl: moderngl.Context,
        memory_mb: float,
        anisotropy: float,
        filter: str | None = None,
        filter_kernel: str = DEFAULT_KERNEL,
        fipmap_accesses: int = DEFAULT_ACCESSES,
    ) -> None:
        self._budget = max(int(memory_mb * 2**20), 0)
        self._filter = None if filter is None else checked_filter(filter)
        self.filter_kernel = checked_kernel(filter_kernel)
        self.fipmap_accesses = checked_accesses(fipmap_accesses, filter_kernel)
        self.anisotropy = max(1.0, float(anisotropy))
        self.atlases = tuple(PageAtlas(gl, page_class) for page_class in range(len(PAGE_FORMATS)))
        self.records = RecordTexture(gl)
        self._kept = KeptTexels()
        self._readers: dict[Callable, object] = {}
        self._numbers: dict[Hashable, int] = {}
        self._images: list[_Image] = []
        self._asked: list[tuple] = []
        self._warned = False
        self.dropped_levels = 0
        self.finest = np.zeros(0, np.int64)
        self.places = np.zeros((0, MAX_LEVELS, 4))
        self.page_class = np.zeros(0, np.int64)

    def is_filtered(self, authored: str | None) -> bool:
        """Whether a texture, or the renderer for all, asks for a filter."""
        return authored is not None or self._filter is not None

    def filter(self, authored: str | None) -> str:
        """The filter that draws a texture which asks for `authored`, one of `FILTERS`; None asks for none."""
        return self._filter or authored or DEFAULT_FILTER

    def reader(self, reader_class: Callable[..., _Reader], *arguments: object) -> _Reader:
        """The pool's reader of that class; at its first use made of the `KeptTexels` of all readers and `arguments`."""
        if reader_class not in self._readers:
            self._readers[reader_class] = reader_class(self._kept, *arguments)
        return cast("_Reader", self._readers[reader_class])

    @property
    def budget(self) -> int:
        """Bytes for the pages that hold texels."""
        return self._budget

    def begin(self) -> None:
        """Forget what the view before has asked for; what is resident stays until room is needed."""
        self._numbers, self._images, self._asked = {}, [], []
        self.records.begin()

    def image(self, source: Hashable, path: str, reader: TexelReader | None = None) -> int:
        """Number of an image in this view; `path` is the prim to name when the file cannot be read.

        The reader, by default the `PyramidCache` of all images, decides what sources are.
        """
        if source not in self._numbers:
            reader = reader or cast("TexelReader", self.reader(PyramidCache))
            self._numbers[source] = len(self._images)
            self._images.append(_Image(source, path, reader, reader.facts(source, path)))
        return self._numbers[source]

    def facts(self, image: int) -> ImageFacts:
        """Of an image of this view."""
        return self._images[image].facts

    def ask(
        self,
        image: NDArray[np.int64],
        levels: tuple[NDArray[np.int64], NDArray[np.int64]],
        uv: tuple[NDArray[np.float64], NDArray[np.float64]],
    ) -> None:
        """Want windows of mip levels, finest to coarsest, both included; as `Windows.add`."""
        self._asked.append((image, levels, uv))

    def load(self) -> None:
        """Bring what was asked for to the GPU."""
        windows, sizes = self._windows()
        self.page_class = np.array([image.facts.page_class for image in self._images], np.int64)
        texel_bytes = np.array([page.bytes_per_texel for page in PAGE_FORMATS])[self.page_class]
        last = np.array([image.facts.last_level for image in self._images], np.int64)
        largest = min(atlas.largest for atlas in self.atlases)
        self.finest, dropped = drop_levels(windows, sizes, texel_bytes, self._budget, last, largest)
        needs = self._needs(windows)
        while not self._have_room(needs):
            smaller = 0.9 * int((windows.texels() * texel_bytes[:, None]).sum())
            further, more = drop_levels(windows, sizes, texel_bytes, smaller, last)
            if not more:
                break
            self.finest, dropped = np.maximum(self.finest, further), dropped + more
            needs = self._needs(windows)
        self._note_dropped(dropped)
        self._write(needs)
        self.places = self._places(sizes)

    def _windows(self) -> tuple[Windows, NDArray[np.int64]]:
        facts = [image.facts for image in self._images]
        sizes = np.array([fact.size for fact in facts], np.int64).reshape(-1, 2)
        whole = np.array([[mode in ("repeat", "mirror") for mode in fact.wrap] for fact in facts]).reshape(-1, 2)
        windows = Windows.empty(len(facts))
        for image, levels, uv in self._asked:
            windows.add(image, levels, uv, sizes, whole)
        return windows, sizes

    def _note_dropped(self, dropped: int) -> None:
        self.dropped_levels = max(self.dropped_levels, dropped)
        if dropped and not self._warned:
            self._warned = True
            warnings.warn(
                f"texture memory of {self._budget / 2**20:g} MiB, or a texture of at most {self.atlases[0].largest} "
                f"texels across, is too small for this view: {dropped} mip levels were left out and coarser ones are "
                "shown; raise --textureMemory",
                FexelWarning,
                stacklevel=4,
            )

    def _needs(self, windows: Windows) -> list[dict[Hashable, Box]]:
        """Windows by (image number, level), a dict per page class."""
        needed = (windows.box[..., 2:] > windows.box[..., :2]).all(axis=-1)
        return [
            {
                (self._images[image].source, int(level)): cast("Box", tuple(int(v) for v in windows.box[image, level]))
                for image, level in np.argwhere(needed & (self.page_class == atlas.page_class)[:, None])
            }
            for atlas in self.atlases
        ]

    def _have_room(self, all_needs: list[dict[Hashable, Box]]) -> bool:
        """Whether the pages can hold these windows within the budget; makes them empty where that helps."""
        both = list(zip(self.atlases, all_needs, strict=True))
        if sum(atlas.bytes_for(needs) for atlas, needs in both) <= self._budget:
            return True
        if sum(atlas.bytes_for(needs, afresh=True) for atlas, needs in both) > self._budget:
            return False
        for atlas in self.atlases:
            atlas.release()
        return True

    def _write(self, all_needs: list[dict[Hashable, Box]]) -> None:
        for atlas, needs in zip(self.atlases, all_needs, strict=True):
            for key in atlas.begin(needs) if needs else ():
                source, level = cast("tuple[Hashable, int]", key)
                image = self._images[self._numbers[source]]
                atlas.write(key, image.reader.window(source, image.path, level, needs[key]))

    def _places(self, sizes: NDArray[np.int64]) -> NDArray[np.float64]:
        places = np.zeros((len(sizes), MAX_LEVELS, 4))
        for number, image in enumerate(self._images):
            atlas = self.atlases[image.facts.page_class]
            page = np.array(atlas.size, np.float64)
            for level in range(MAX_LEVELS):
                resident = atlas.residents.get((image.source, level))
                if resident is not None:
                    level_size = np.maximum(sizes[number] >> level, 1)
                    places[number, level, :2] = level_size / sizes[number] / page
                    places[number, level, 2:] = (np.array([resident.x, resident.y]) - resident.box[:2]) / page
        return places

    def stats(self) -> dict[str, int]:
        """Images and levels with texels resident, chains of prefiltered images among them; bytes of pages, of the
        chains in them, of records; levels dropped.
        """
        residents = [cast("tuple[Hashable, int]", key) for atlas in self.atlases for key in atlas.residents]
        sources = {source for source, _ in residents}
        return {
            "images_resident": len(sources),
            "chains_resident": sum(isinstance(source, Chain) for source in sources),
            "levels_resident": len(residents),
            "texture_bytes": sum(atlas.nbytes for atlas in self.atlases),
            "chain_bytes": self._chain_bytes(),
            "record_bytes": self.records.nbytes,
            "dropped_levels": self.dropped_levels,
        }

    def _chain_bytes(self) -> int:
        """Of the texels of chains, borders included."""
        total = 0
        for atlas, page in zip(self.atlases, PAGE_FORMATS, strict=True):
            for key, resident in atlas.residents.items():
                source, _ = cast("tuple[Hashable, int]", key)
                if isinstance(source, Chain):
                    left, top, right, bottom = resident.box
                    total += (right - left + 2) * (bottom - top + 2) * page.bytes_per_texel
        return total

    def release(self) -> None:
        """Free all GL objects."""
        for atlas in self.atlases:
            atlas.release()
        self.records.release()
