"""Which levels of detail of an umbrella texture a view sees: arrangements, and the picture that follows the coarsest.

Between two levels both are seen (Just-in-time texture synthesis, 2012, section 6.3). The picture is the image of an
UmbrellaLevel; where there is none, one made here (`umbrella_picture`) takes its place, so that umbrellas are never
drawn much smaller than pixels.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace

from fexel.textures.umbrella import LEVEL_IMAGE_BIAS, UmbrellaData
from fexel.textures.umbrella_arrangement import Arrangement
from fexel.textures.umbrella_picture import picture_level, picture_source, picture_wrap

__all__ = ["FULL_DETAIL", "Detail", "LevelView", "PictureView", "detail_of"]

FULL_DETAIL = -3.0
"""Log2 of the cells per pixel up to which umbrellas are seen alone."""


@dataclass(frozen=True, eq=False)
class LevelView:
    """An arrangement that is seen.

    Attributes
    ----------
    level : int
        0 is the full one; where no levels are authored, one less than the picture's.
    arrangement : Arrangement
    until : float
        Log2 of the cells of the full arrangement per pixel up to which it is drawn.
    """

    level: int
    arrangement: Arrangement
    until: float


@dataclass(frozen=True, eq=False)
class PictureView:
    """The picture of the whole texture.

    Attributes
    ----------
    level : int
        From which on it is seen alone.
    source : object
        Of the pool: an ImageSource, or what `fexel.textures.umbrella_picture` makes.
    bias : int
        How many mip levels finer than by its size it is read.
    path : str
        Prim to name, '' for the texture's own.
    """

    level: int
    source: Hashable
    bias: int
    path: str


@dataclass(frozen=True, eq=False)
class Detail:
    """What a view sees: `levels`, the finest first, then maybe `picture`."""

    levels: tuple[LevelView, ...]
    picture: PictureView | None


def detail_of(data: UmbrellaData, low: float, high: float, usable: set[str], wrap: tuple[str, str]) -> Detail:
    """Choose levels.

    Parameters
    ----------
    data : UmbrellaData
    low, high : float
        Range of the footprint: log2 of cells per pixel.
    usable : set of str
        Prim paths of the levels whose images can be read.
    wrap : (str, str)
        Of the texture, ``useMetadata`` resolved.
    """
    numbered = [LevelView(0, data.arrangement, high)]
    picture = None
    for level in data.levels:
        if level.image is not None and level.path in usable:
            image = replace(level.image, wrap=picture_wrap(wrap))
            picture = PictureView(level.level, image, LEVEL_IMAGE_BIAS, level.path)
            break
        if level.arrangement is not None:
            numbered.append(LevelView(level.level, level.arrangement, high))
    if picture is None:
        own = picture_level(data.arrangement)
        if len(numbered) > 1:
            own = max(own, numbered[-1].level + 1)
        else:
            numbered[0] = replace(numbered[0], level=own - 1)
        picture = PictureView(own, picture_source(data, wrap), 0, "")
    ends = [view.level for view in numbered[1:]] + [picture.level]
    starts = [float("-inf")] + [view.level for view in numbered[:-1]]
    least, most = low - FULL_DETAIL, high - FULL_DETAIL
    seen = tuple(
        replace(view, until=min(high, end + FULL_DETAIL))
        for view, start, end in zip(numbered, starts, ends, strict=True)
        if most > start and least < end
    )
    return Detail(seen, picture if most > numbered[-1].level else None)
