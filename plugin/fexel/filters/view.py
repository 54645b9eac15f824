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
from fexel.filters import FILTERS, ewa, fipmap, ripmap
from fexel.filters.chain import Chain
from fexel.filters.chain_layout import GAUSS_BLUR, SHORT_BLUR
from fexel.filters.chain_table import FINE_STEPS, STEPS, chain_table
from fexel.filters.chain_wants import cells_wanted
from fexel.filters.lookup import Choice, usable
from fexel.filters.shears import DIRECTIONS, FINE_DIRECTIONS
from fexel.filters.tiles import Tile, spread
from fexel.filters.view_parts import Part, chain_part, own_part, page_of, resident_cells
from fexel.textures.footprint import Footprint
from fexel.textures.image_view import ImageView
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.pyramid_cache import PyramidCache

if TYPE_CHECKING:
    from fexel.textures.pool import TexelReader, TexturePool

__all__ = ["CHAINED", "FilterView"]

CHAINED = ("ripmap", "fipmap", "auto")
"""Filters that look chains up."""

_BY_LODS = ("mipmap", "anisotropic", "ewa", "auto")  # that read the image's own levels in a range of level numbers

_LOD_MARGIN = 0.2  # as of residency: a footprint may be a little smaller between the places that were looked at

_MOST_OF_BUDGET = 0.75  # that the chains of one image may take; past it their finest levels would be dropped


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
    is_spread : bool
        Some footprints are of more periods of it than are read one by one, see `fexel.filters.tiles`.
    """

    token: str
    own: ImageView
    parts: tuple[Part, ...]
    facts: NDArray[np.float64]
    is_spread: bool = False

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
        bias : float
            How many mip levels finer than by its size it is read; chains know none.
        """
        number = pool.image(source, path, reader)
        jacobian = jacobian.reshape(len(jacobian), -1, 2, 2)
        window = np.asarray(low, np.float64), np.asarray(high, np.float64)
        parts, is_spread = [], False
        if token in CHAINED:
            is_gauss = token == "fipmap" and pool.filter_kernel == "gauss"
            directions, blur = (FINE_DIRECTIONS, GAUSS_BLUR) if is_gauss else (DIRECTIONS, SHORT_BLUR)
            tile = _tile(pool, number)
            wants = cells_wanted(jacobian, _choices(token, is_gauss, tile, pool.fipmap_accesses), len(directions))
            is_spread = wants.spread
            if is_gauss:
                window = _around(window, jacobian, pool.facts(number).size, fipmap.GAUSS_REACH)
            parts.append(own_part(pool, number, jacobian, wants, window))
            for direction, octaves in sorted(set(zip(wants.direction.tolist(), wants.octaves.tolist(), strict=True))):
                if octaves:
                    chain = Chain(source, direction, octaves, reader, blur)
                    parts.append(chain_part(pool, chain, path, pool.facts(number), wants, window))
        if sum(part.nbytes(pool) for part in parts) > _MOST_OF_BUDGET * pool.budget:
            pool.reader(_Remembered).tell(path, token)
            return cls.of(pool, source, path, "anisotropic", jacobian, low, high, reader=reader, bias=bias)
        if token in _BY_LODS:
            own = ImageView.of(pool, number, *_lods(token, jacobian, pool.anisotropy), bias, FILTERS.index(token))
            levels = np.full(len(jacobian), own.finest), np.full(len(jacobian), own.coarsest)
            if token == "ewa":
                window = _around(window, jacobian, pool.facts(number).size, ewa.REACH)
            parts.append(Part(number, 0, 0, levels, window))
        else:
            finest, coarsest = parts[0].levels
            own = ImageView(number, int(finest.min()), int(coarsest.max()), bias, FILTERS.index(token))
        facts = np.zeros((0, 4))
        if token == "auto":
            facts = pool.reader(_Remembered).record(reader or pool.reader(PyramidCache), source, path)
        return cls(token, own, tuple(parts), facts, is_spread)

    def ask(self, pool: TexturePool) -> None:
        """Want all of it."""
        for part in self.parts:
            part.ask(pool)

    def record(self, pool: TexturePool) -> NDArray[np.float64]:
        """(N, 4) what shaders/image.glsl reads, after `TexturePool.load`."""
        record = self.own.record(pool)
        if self.token not in CHAINED:
            return record
        cells = resident_cells(self.parts, self.image, pool)
        steps = FINE_STEPS if pool.filter_kernel == "gauss" else STEPS
        page, extent = page_of(pool, self.image), _tile(pool, self.image).extent
        return np.concatenate([record, chain_table(cells, len(record), page, self.facts, extent, steps)])

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


def _around(
    window: tuple[NDArray[np.float64], NDArray[np.float64]],
    jacobian: NDArray[np.float64],
    size: tuple[int, int],
    pixels: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bounds of pieces as far as lookups reach, so many pixels; they have half a pixel around them."""
    extent = np.nan_to_num(np.abs(jacobian).sum(axis=3).max(axis=1), posinf=1e9)
    reach = ((pixels - 0.5) * np.minimum(extent, 1e9) + 1.0) / size  # 1e9: as many texels as a lookup bears
    return window[0] - reach, window[1] + reach


def _tile(pool: TexturePool, number: int) -> Tile:
    """How an image of the pool goes on."""
    facts = pool.facts(number)
    return Tile.of(facts.size, facts.wrap)


def _choices(token: str, is_gauss: bool, tile: Tile, accesses: int) -> list[Callable[[NDArray[np.float64]], Choice]]:
    """What pixels may choose by, of an image; `accesses` of a fipmap."""
    if token == "auto":
        from fexel.filters.losses import CANDIDATES

        chained = {candidate.probes for candidate in CANDIDATES if candidate.token == "fipmap"}
        return [_chosen(partial(fipmap.choose, probes=probes), tile, probes) for probes in sorted(chained)]
    if is_gauss:
        choose = partial(fipmap.choose, probes=fipmap.GAUSS_PROBES, gauss=True)
        return [_chosen(choose, tile, fipmap.GAUSS_PROBES, gauss=True)]
    if token == "ripmap":
        return [_chosen(ripmap.choose, tile, ripmap.PROBES)]
    return [_chosen(partial(fipmap.choose, probes=accesses), tile, accesses)]


def _chosen(choose: Callable[..., Choice], tile: Tile, probes: int, gauss: bool = False) -> Callable[..., Choice]:
    """A choice, of an image."""
    return lambda jacobian: spread(choose(jacobian), tile, probes, gauss=gauss)


def _lods(token: str, jacobian: NDArray[np.float64], anisotropy: float) -> tuple[float, float]:
    """Range of mip levels of the filters that need no chains."""
    every = usable(jacobian.reshape(-1, 2, 2))
    if token in ("mipmap", "anisotropic"):
        lods = (Footprint.of(every).level(anisotropy if token == "anisotropic" else 1.0),) * 2
    else:
        lods = import_module(f"fexel.filters.{token}").lods(every)
    return float(lods[0].min()) - _LOD_MARGIN, float(lods[1].max()) + _LOD_MARGIN
