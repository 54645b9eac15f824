"""What a view wants of the pool for an image that is looked up in chains, and what of it is there once it is loaded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fexel.filters.chain import Chain
from fexel.filters.chain_table import PLAIN, Cells
from fexel.filters.chain_texels import ChainTexels
from fexel.filters.chain_wants import Frame, Wants
from fexel.filters.lookup import usable
from fexel.textures.footprint import Footprint
from fexel.textures.page_format import PAGE_FORMATS
from fexel.textures.pyramid_cache import ImageFacts, PyramidCache
from fexel.textures.residency import Windows

if TYPE_CHECKING:
    from fexel.textures.pool import TexturePool

__all__ = ["Part", "Window", "chain_part", "own_part", "page_of", "resident_cells"]

Window = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Lower and upper bounds, (N, 2) each."""

_BOXES = 1.5  # texels by which boxes reach beyond the footprint, and over a seam to the other side


@dataclass(frozen=True, eq=False)
class Part:
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
    window: Window

    def ask(self, pool: TexturePool) -> None:
        """Want it."""
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
        """Levels that were asked for, or came in their place, and are there; those of an earlier view do not count."""
        dropped = int(pool.finest[self.number])
        levels = np.arange(pool.places.shape[1])
        asked = ((self.levels[0] <= levels[:, None]) & (levels[:, None] <= self.levels[1])).any(axis=1)
        asked = np.where(levels < dropped, False, asked | ((levels == dropped) & (dropped > 0)))
        return levels[asked & (pool.places[self.number, :, 0] > 0)]


def own_part(pool: TexturePool, number: int, jacobian: NDArray[np.float64], wants: Wants, window: Window) -> Part:
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
    return Part(number, 0, 0, (finest, coarsest), (low, high))


def chain_part(pool: TexturePool, chain: Chain, path: str, base: ImageFacts, wants: Wants, window: Window) -> Part:
    """Windows of a chain that pieces want; `base` are the facts of its image."""
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
    return Part(number, chain.direction, chain.octaves, levels, bounds)


def resident_cells(parts: Sequence[Part], image: int, pool: TexturePool) -> dict[int, Cells]:
    """By direction what is there of `parts`, after `TexturePool.load`; `image` is the number of the image itself."""
    facts = pool.facts(image)
    coarsest = max(pool.facts(part.number).last_level for part in parts)
    cells: dict[int, list[tuple[int, NDArray[np.int64], NDArray[np.float64]]]] = {}
    for part in parts:
        for direction in PLAIN if part.octaves == 0 else (part.direction,):
            frame = Frame(direction, facts.size, facts.wrap)
            levels = part.resident(pool)
            if len(levels):
                place = _places(pool, part.number, levels, frame, own=part.octaves == 0)
                if levels[-1] == pool.facts(part.number).last_level:  # it stands for all coarser ones of these octaves
                    further = np.arange(levels[-1] + 1, coarsest + 1)
                    levels, place = np.append(levels, further), np.append(place, place[[-1] * len(further)], axis=0)
                cells.setdefault(direction, []).append((part.octaves, levels, place))
    for direction in PLAIN:  # of an image of which nothing is seen nothing is resident
        nowhere = np.append(1.0 / np.array(page_of(pool, image)), [0, 0])[None]
        cells.setdefault(direction, [(0, np.zeros(1, np.int64), nowhere)])
    return {
        direction: Cells(
            np.concatenate([np.full(len(levels), octaves) for octaves, levels, _ in found]),
            np.concatenate([levels for _, levels, _ in found]),
            np.concatenate([place for _, _, place in found]),
        )
        for direction, found in cells.items()
    }


def _places(
    pool: TexturePool, number: int, levels: NDArray[np.int64], frame: Frame, *, own: bool
) -> NDArray[np.float64]:
    """(N, 4) of a `chain_table`."""
    place = pool.places[number, levels]
    size = place[:, :2] * pool.facts(number).size
    if own:  # of a mirrored image it is half of the period
        size = size * frame.extent / frame.size
    order = [frame.long_axis, 1 - frame.long_axis]
    size, begin = size[:, order], place[:, 2:][:, order]
    if frame.margin and not own:
        texel = size[:, 1] / (frame.extent[order[1]] + 2 * frame.margin)
        begin[:, 1] += frame.margin * texel
        size[:, 1] = 2 * frame.margin * texel - size[:, 1]
    return np.concatenate([size, begin], axis=1)


def page_of(pool: TexturePool, number: int) -> tuple[int, int]:
    """Width and height of the page that an image is in."""
    return pool.atlases[pool.facts(number).page_class].size
