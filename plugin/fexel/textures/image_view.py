"""Images as shaders/image.glsl looks them up: which levels a view wants of one, and its record once they are loaded.

A kind that finds out where to look keeps an `ImageView` per image, asks through it, and writes its record when the pool
has loaded; the shader needs nothing but the place of that record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fexel.filters import FILTERS
from fexel.filters.fipmap import GAUSS_PROBES
from fexel.textures.page_format import HALF, SRGB
from fexel.textures.pool import TexturePool
from fexel.textures.residency import MAX_LEVELS

__all__ = ["WRAP_CODES", "ImageView", "Viewed", "image_defines", "write_image_records"]

WRAP_CODES = {"clamp": 0, "repeat": 1, "mirror": 2, "black": 3, "patch": 3}
"""Of shaders/common_wrap.glsl."""

_ALIKE = {"mipmap", "anisotropic"}


@dataclass(frozen=True)
class ImageView:
    """An image in a view.

    Attributes
    ----------
    image : int
        Number in the pool.
    finest, coarsest : int
        Mip levels that are seen.
    bias : float
        How many mip levels finer than by its size it is read.
    filter_code : int
        Number in `fexel.filters.FILTERS`.
    """

    image: int
    finest: int
    coarsest: int
    bias: float = 0.0
    filter_code: int = 1

    @classmethod
    def of(
        cls, pool: TexturePool, image: int, lod_low: float, lod_high: float, bias: float = 0.0, filter_code: int = 1
    ) -> ImageView:
        """The levels that a range of real-valued mip levels needs, before the bias."""
        lod_low, lod_high = lod_low - bias, lod_high - bias
        last = min(pool.facts(image).last_level, MAX_LEVELS - 1)
        finest = int(np.floor(np.clip(lod_low, 0, last)))
        return cls(image, finest, max(finest, int(np.clip(np.floor(lod_high) + 1, 0, last))), bias, filter_code)

    def ask(self, pool: TexturePool, low: Sequence[float] = (0, 0), high: Sequence[float] = (1, 1)) -> None:
        """Want a window of these levels, by its bounds in [0, 1]^2 of the image, t up."""
        levels = np.array([self.finest]), np.array([self.coarsest])
        pool.ask(np.array([self.image]), levels, (np.array([low], np.float64), np.array([high], np.float64)))

    def record(self, pool: TexturePool) -> NDArray[np.float64]:
        """(1 + levels, 4): the levels that are resident, after `TexturePool.load`."""
        facts = pool.facts(self.image)
        size = np.array(facts.size, np.float64)
        finest = max(self.finest, int(pool.finest[self.image]))
        coarsest = max(self.coarsest, finest)
        wrap = [WRAP_CODES[mode] for mode in facts.wrap]
        codes = finest + 16 * coarsest + 256 * facts.page_class + 1024 * wrap[0] + 4096 * wrap[1]
        codes += 16384 * self.filter_code
        places = pool.places[self.image, finest : coarsest + 1]
        corner = places[:, 2:] + places[:, :2] * [0, size[1]]  # t up, where the pool has y down
        after = np.minimum(np.arange(len(corner)) + 1, len(corner) - 1)
        return np.concatenate([[[*size, codes, self.bias]], np.concatenate([corner, corner[after]], axis=1)])

    @property
    def levels(self) -> int:
        """How many levels are seen."""
        return self.coarsest - self.finest + 1

    @property
    def is_spread(self) -> bool:
        """Only chains have boxes to spread, see `fexel.filters.view.FilterView`."""
        return False


class Viewed(Protocol):
    """An `ImageView`, or a `fexel.filters.view.FilterView`."""

    @property
    def image(self) -> int:
        """Number in the pool."""
        ...

    @property
    def levels(self) -> int:
        """How many mip levels are seen."""
        ...

    @property
    def filter_code(self) -> int:
        """Number in `fexel.filters.FILTERS`."""
        ...

    @property
    def is_spread(self) -> bool:
        """Some footprints are of more periods of it than are read one by one, see `fexel.filters.tiles`."""
        ...

    def record(self, pool: TexturePool) -> NDArray[np.float64]:
        """After `TexturePool.load`."""
        ...


def write_image_records(views: Sequence[Viewed], pool: TexturePool) -> tuple[int, int]:
    """Append the records of images, one as long as the other; where they begin, and their length in texels."""
    records = [view.record(pool) for view in views]
    texels = max(map(len, records), default=0)
    padded = [np.concatenate([record, np.zeros((texels - len(record), 4))]) for record in records]
    return pool.records.append(np.concatenate([np.zeros((0, 4)), *padded])), texels


def image_defines(views: Sequence[Viewed], pool: TexturePool, *, probes: bool) -> dict[str, int]:
    """What shaders/image.glsl is compiled for: images of one kind, whose levels need not be loaded yet; kinds unite."""
    facts = [pool.facts(view.image) for view in views]
    classes = {fact.page_class for fact in facts}
    filters = {FILTERS[view.filter_code] for view in views}
    is_gauss = pool.filter_kernel == "gauss"
    if not probes and filters & _ALIKE:  # of one probe both are the same
        filters = filters - _ALIKE | {"anisotropic"}
    return {
        "IMAGE_SRGB": int(SRGB in classes),
        "IMAGE_HALF": int(HALF in classes),
        "IMAGE_LEVELS": 2 if any(view.levels > 1 for view in views) else 1,
        "IMAGE_PROBES": int(probes or "auto" in filters),
        "IMAGE_WRAPS": int(any(fact.wrap != ("clamp", "clamp") for fact in facts)),
        "IMAGE_ENDS": int(any(mode not in ("repeat", "mirror") for fact in facts for mode in fact.wrap)),
        "IMAGE_MIRROR": int(any("mirror" in fact.wrap for fact in facts)),
        "IMAGE_ACCESSES": GAUSS_PROBES if is_gauss else pool.fipmap_accesses,
        "IMAGE_GAUSS": int(is_gauss),
        "IMAGE_TILES": int(any(view.is_spread for view in views)),
        **{f"IMAGE_FILTER_{token.upper()}": int(token in filters) for token in FILTERS},
    }
