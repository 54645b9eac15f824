"""Images in a view as their minification filter looks them up: what is wanted of each, and its record.

What shaders/image.glsl does per pixel is foreseen here for pieces of a view. Ripmap and fipmap want chains
(`fexel.filters.chain`) in place of fine mip levels.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelWarning
from fexel.filters import FILTERS, fipmap, ripmap
from fexel.filters.chain import Chain
from fexel.filters.chain_table import PLAIN, Cells, chain_table
from fexel.filters.chain_texels import ChainTexels
from fexel.filters.chain_wants import Frame, Wants, cells_wanted
from fexel.filters.lookup import Choice, usable
from fexel.textures.footprint import Footprint
from fexel.textures.image_view import ImageView
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.page_format import PAGE_FORMATS
from fexel.textures.pyramid_cache import ImageFacts, PyramidCache
from fexel.textures.residency import Windows

if TYPE_CHECKING:
    from fexel.textures.pool import TexelReader, TexturePool

__all__ = ["CHAINED", "FilterView"]

CHAINED = ("ripmap", "fipmap", "auto")
"""Filters that look chains up."""

_BY_LODS = ("mipmap", "anisotropic", "ewa", "auto")  # that read the image's own levels in a range of level numbers

_LOD_MARGIN = 0.2  # as of residency: a footprint may be a little smaller between the places that were looked at

_BOXES = 1.5  # texels by which boxes reach beyond the footprint, and over a seam to the other side
_MOST_OF_BUDGET = 0.75  # that the chains of one image may take; past it their finest levels would be dropped

_Window = tuple[NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class _Part:
    """Cells of one direction and so many octaves that a view wants; 0: of the image itself.

    Attributes
    ----------
    number : int
        In the pool.
    direction, octaves : int
    levels : (N,) and (N,) int64
        Finest and coarsest, by piece.
    window : (N, 2) and (N, 2) float64
        Bounds in [0, 1]^2, t up, by piece.
    """

    number: int
    direction: int
    octaves: int
    levels: tuple[NDArray[np.int64], NDArray[np.int64]]
    window: _Window

    def ask(self, pool: TexturePool) -> None:
        pool.ask(np.full(len(self.levels[0]), self.number), self.levels, self.window)

    def nbytes(self, pool: TexturePool) -> int:
        """Of its windows."""
        facts = pool.facts(self.number)
        windows = Windows.empty(1)
        sizes = np.array([facts.size], np.int64)
        whole = np.array([[mode in ("repeat", "mirror") for mode in facts.wrap]])
        windows.add(np.zeros(len(self.levels[0]), np.int64), self.levels, self.window, sizes, whole)
        return int(windows.texels().sum()) * PAGE_FORMATS[facts.page_class].bytes_per_texel

    def resident(self, pool: TexturePool) -> NDArray[np.int64]:
        """Levels that were asked for, or came in their place, and are there."""
        finest = max(int(self.levels[0].min()), int(pool.finest[self.number]))
        levels = np.arange(finest, max(int(self.levels[1].max()), finest) + 1)
        return levels[pool.places[self.number, levels, 0] > 0]


@dataclass(frozen=True, eq=False)
class FilterView:
    """An image in a view, and the filter that looks it up.

    Attributes
    ----------
    token : str
        One of `fexel.filters.FILTERS`.
    own : ImageView
        The image, and which of its mip levels are seen.
    parts : tuple
        What is wanted: of chains, and of the image itself.
    facts : (F, 4) float64
        What the filter knows of the image.
    """

    token: str
    own: ImageView
    parts: tuple[_Part, ...]
    facts: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        pool: TexturePool,
        source: Hashable,
        path: str,
        token: str,
        jacobian: NDArray[np.float64],
        low: NDArray[np.float64],
        high: NDArray[np.float64],
        *,
        reader: TexelReader | None = None,
        vectors: bool = False,
        bias: float = 0.0,
    ) -> FilterView:
        """What pieces of a view want of an image.

        Parameters
        ----------
        pool : TexturePool
        source : hashable
            Of the image in the pool.
        path : str
            Prim to name where it cannot be read.
        token : str
        jacobian : (K, P, 2, 2) or (K, 2, 2) float64
            Texels of level 0 (x right, y down) per pixel, column j along x, y, at P places of each of K pieces.
        low, high : (K, 2) float64
            Bounds of each piece in [0, 1]^2 of the image, t up, with half a pixel around it; may exceed it.
        reader : TexelReader, optional
            Of the source; default that of image files.
        vectors : bool
            The image holds vectors.
        bias : float
            How many mip levels finer than by its size it is read; chains know none.
        """
        number = pool.image(source, path, reader)
        jacobian = jacobian.reshape(len(jacobian), -1, 2, 2)
        window = np.asarray(low, np.float64), np.asarray(high, np.float64)
        parts = []
        if token in CHAINED:
            wants = cells_wanted(jacobian, _choices(token))
            parts.append(_own_part(pool, number, jacobian, wants, window))
            for direction, octaves in sorted(set(zip(wants.direction.tolist(), wants.octaves.tolist(), strict=True))):
                if octaves:
                    chain = Chain(source, direction, octaves, vectors, reader)
                    parts.append(_chain_part(pool, chain, path, pool.facts(number), wants, window))
        if sum(part.nbytes(pool) for part in parts) > _MOST_OF_BUDGET * pool.budget:
            pool.reader(_Remembered).tell(path, token)
            return cls.of(pool, source, path, "anisotropic", jacobian, low, high, reader=reader, bias=bias)
        if token in _BY_LODS:
            own = ImageView.of(pool, number, *_lods(token, jacobian, pool.anisotropy), bias, FILTERS.index(token))
            levels = np.full(len(jacobian), own.finest), np.full(len(jacobian), own.coarsest)
            parts.append(_Part(number, 0, 0, levels, window))
        else:
            finest, coarsest = parts[0].levels
            own = ImageView(number, int(finest.min()), int(coarsest.max()), bias, FILTERS.index(token))
        facts = np.zeros((0, 4))
        if token == "auto":
            facts = pool.reader(_Remembered).record(reader or pool.reader(PyramidCache), source, path)
        return cls(token, own, tuple(parts), facts)

    def ask(self, pool: TexturePool) -> None:
        """Want all of it."""
        for part in self.parts:
            part.ask(pool)

    def record(self, pool: TexturePool) -> NDArray[np.float64]:
        """(N, 4) what shaders/image.glsl reads, after `TexturePool.load`."""
        record = self.own.record(pool)
        if self.token not in CHAINED:
            return record
        facts = pool.facts(self.image)
        cells: dict[int, list[tuple[int, NDArray[np.int64], NDArray[np.float64]]]] = {}
        for part in self.parts:
            for direction in PLAIN if part.octaves == 0 else (part.direction,):
                frame = Frame(direction, facts.size, facts.wrap)
                levels = part.resident(pool)
                if len(levels):
                    place = _places(pool, part.number, levels, frame, own=part.octaves == 0)
                    cells.setdefault(direction, []).append((part.octaves, levels, place))
        for direction in PLAIN:  # of an image of which nothing is seen nothing is resident
            nowhere = np.append(1.0 / np.array(_page(pool, self.image)), [0, 0])[None]
            cells.setdefault(direction, [(0, np.zeros(1, np.int64), nowhere)])
        table = {
            direction: Cells(
                np.concatenate([np.full(len(levels), octaves) for octaves, levels, _ in found]),
                np.concatenate([levels for _, levels, _ in found]),
                np.concatenate([place for _, _, place in found]),
            )
            for direction, found in cells.items()
        }
        return np.concatenate([record, chain_table(table, len(record), _page(pool, self.image), self.facts)])

    def constants(self, pool: TexturePool, record: int) -> NDArray[np.float64]:
        """(2, 4) for image_flat of shaders/image.glsl, of the record that was appended at `record`."""
        texels = self.record(pool)
        head, table = texels[0], np.array([record + 2.0 + self._own_levels(pool), 0, 0, 0])  # by which it is found
        if self.token in CHAINED:
            table = texels[1 + self._own_levels(pool)] + [record, 0, 0, 0]
        return np.stack([head, table])

    def _own_levels(self, pool: TexturePool) -> int:
        return len(self.own.record(pool)) - 1

    @property
    def image(self) -> int:
        """Number in the pool."""
        return self.own.image

    @property
    def filter_code(self) -> int:
        """Number in `FILTERS`."""
        return self.own.filter_code

    @property
    def images(self) -> tuple[int, ...]:
        """Numbers in the pool, those of its chains included."""
        return tuple(sorted({part.number for part in self.parts}))

    @property
    def finest(self) -> int:
        """Finest mip level of the image itself that is seen."""
        return self.own.finest

    @property
    def coarsest(self) -> int:
        """The coarsest one."""
        return self.own.coarsest

    @property
    def bias(self) -> float:
        """Of `ImageView`."""
        return self.own.bias

    @property
    def levels(self) -> int:
        """How many mip levels of the image itself are seen."""
        return self.own.levels

    def page_classes(self, pool: TexturePool) -> frozenset[int]:
        """Of the pages that it is looked up in."""
        return frozenset(int(pool.page_class[number]) for number in self.images)


class _Remembered:
    """What `auto` knows of images, and what was warned of; the pool has one, as it has readers."""

    def __init__(self, kept: KeptTexels) -> None:
        self._kept = kept
        self._told: set[str] = set()

    def tell(self, path: str, token: str) -> None:
        """Warn, once, that chains have no room."""
        if path not in self._told:
            self._told.add(path)
            fault = f"texture memory has no room for its {token}; anisotropic is shown; raise --textureMemory"
            warnings.warn(f"{path}: {fault}", FexelWarning, stacklevel=3)

    def record(self, reader: TexelReader, source: Hashable, path: str) -> NDArray[np.float64]:
        """(F, 4) of shaders/filter_auto.glsl."""
        from fexel.filters import auto, content

        key = (_Remembered, source)
        record = self._kept.get(key)
        if record is None:
            record = auto.record(content.measure(reader, source, path))
            self._kept.keep(key, record, record.nbytes)
        return record


def _choices(token: str) -> list[Callable[[NDArray[np.float64]], Choice]]:
    """What pixels may choose by."""
    if token == "auto":
        from fexel.filters.losses import CANDIDATES

        chained = {candidate.probes for candidate in CANDIDATES if candidate.token == "fipmap"}
        return [partial(fipmap.choose, probes=probes) for probes in sorted(chained)]
    return [{"ripmap": ripmap, "fipmap": fipmap}[token].choose]


def _lods(token: str, jacobian: NDArray[np.float64], anisotropy: float) -> tuple[float, float]:
    """Range of mip levels of the filters that need no chains."""
    every = usable(jacobian.reshape(-1, 2, 2))
    if token in ("mipmap", "anisotropic"):
        lods = (Footprint.of(every).level(anisotropy if token == "anisotropic" else 1.0),) * 2
    else:
        lods = import_module(f"fexel.filters.{token}").lods(every)
    return float(lods[0].min()) - _LOD_MARGIN, float(lods[1].max()) + _LOD_MARGIN


def _own_part(pool: TexturePool, number: int, jacobian: NDArray[np.float64], wants: Wants, window: _Window) -> _Part:
    """Mip levels of the image itself; and one that all pieces have, as coarse as the longest footprint."""
    last = pool.facts(number).last_level
    at = np.flatnonzero(wants.octaves == 0)
    longest = Footprint.of(usable(jacobian.reshape(-1, 2, 2))).major.max(initial=1.0)
    spare = int(np.clip(np.ceil(np.log2(longest)), 0, last))
    spares = np.full(len(jacobian), spare)
    levels = (np.minimum(np.append(each[at], spares), last) for each in (wants.finest, wants.coarsest))
    finest, coarsest = levels
    reach = _BOXES * np.exp2(coarsest)[:, None] / pool.facts(number).size
    low, high = (np.concatenate([bound[wants.piece[at]], bound]) for bound in window)
    low, high = low - reach, high + reach
    return _Part(number, 0, 0, (finest, coarsest), (low, high))


def _chain_part(pool: TexturePool, chain: Chain, path: str, base: ImageFacts, wants: Wants, window: _Window) -> _Part:
    number = pool.image(chain, path, pool.reader(ChainTexels, pool.reader(PyramidCache)))
    at = np.flatnonzero((wants.direction == chain.direction) & (wants.octaves == chain.octaves))
    last = pool.facts(number).last_level
    frame = Frame(chain.direction, base.size, base.wrap)
    texels = np.array(base.size, np.float64)
    low, high = (bound[wants.piece[at]] * texels for bound in window)
    low[:, 1], high[:, 1] = texels[1] - high[:, 1], texels[1] - low[:, 1]
    reach = _BOXES * np.exp2(wants.coarsest[at])[:, None] * np.exp2([chain.octaves, 0])
    reach = reach[:, [frame.long_axis, 1 - frame.long_axis]]
    bounds = frame.window(low - reach, high + reach)
    levels = np.minimum(wants.finest[at], last), np.minimum(wants.coarsest[at], last)
    return _Part(number, chain.direction, chain.octaves, levels, bounds)


def _places(
    pool: TexturePool, number: int, levels: NDArray[np.int64], frame: Frame, *, own: bool
) -> NDArray[np.float64]:
    """(N, 4) of a `chain_table`."""
    place = pool.places[number, levels]
    size = place[:, :2] * pool.facts(number).size
    if own:  # of a mirrored image it is half of the period
        size = size * frame.extent / frame.size
    order = [frame.long_axis, 1 - frame.long_axis]
    return np.concatenate([size[:, order], place[:, 2:][:, order]], axis=1)


def _page(pool: TexturePool, number: int) -> tuple[int, int]:
    return pool.atlases[pool.facts(number).page_class].size
