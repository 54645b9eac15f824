"""Base umbrellas: a star-shaped contour about a centre, and the texture it is filled with (the paper's section 4.1).

Patch space: the centre is (0, 0), x right, y up; one unit is `Element.scale_px` pixels of the photo, so that the
longer side of a photo's largest element is 1. Texture coordinates have their origin at the lower left.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel_tools.umbrella_elements import Element
from fexel_tools.umbrella_hints import Hints, hint_of
from fexel_tools.umbrella_outline import outline_of
from fexel_tools.umbrella_texture import Window, cut_texture, texture_window

__all__ = ["BaseOptions", "BaseUmbrella", "companion_base", "make_bases"]

_CENTRES = ("auto", "centroid", "veins")


@dataclass(frozen=True, eq=False)
class BaseUmbrella:
    """A base umbrella before it is diversified.

    Attributes
    ----------
    name : str
    texture : (h, w, 4) float32
        Linear Rec.709 or data, straight alpha, row 0 at the top; plausible also where alpha is 0.
    has_alpha : bool
        Whether alpha means something inside the contour (holes, translucency); else it is 1 throughout.
    tex_coords : (V, 2) float64
        The centre, then the contour, counter-clockwise (t up); within [0, 1].
    points : (V, 2) float64
        The same in patch space; the centre is (0, 0).
    morph_points : (V, 2) float64
        `points` until shapes are diversified.
    lost_area : float
        Share of the element's area that lies outside the contour since it is not visible from the centre, in [0, 1).
    tolerance_px : float
        Largest distance, in pixels of the photo, between the contour and the boundary it simplifies.
    window : (int, int, int, int)
        Left, top, right, bottom of the texture in pixels of the element's `color`, beyond which it may reach.
    """

    name: str
    texture: NDArray[np.float32]
    has_alpha: bool
    tex_coords: NDArray[np.float64]
    points: NDArray[np.float64]
    morph_points: NDArray[np.float64]
    lost_area: float
    tolerance_px: float
    window: Window = (0, 0, 0, 0)


@dataclass(frozen=True)
class BaseOptions:
    """How elements become base umbrellas.

    Attributes
    ----------
    vertices : int
        Most vertices, the centre included; at least 4.
    tolerance_px : float
        Pixels of the photo by which a contour may be off; half a percent of a small element's size if that is less.
    texture_size : int
        Texels on the longer side of a texture, at most; photos are never enlarged.
    centre : str
        ``auto`` and ``centroid``: near the centroid; ``veins``: where they converge; or ``x,y``: pixels of the photo
        from its upper left, or shares of its width and height where both are within [0, 1].
    hints : mapping of str to sequence of (float, float)
        Such places by name of element, of file, or its stem, see `umbrella_hints`.
    """

    vertices: int = 63
    tolerance_px: float = 1.0
    texture_size: int = 256
    centre: str = "auto"
    hints: Hints = field(default_factory=dict)


def make_bases(elements: Iterable[Element], options: BaseOptions | None = None) -> list[BaseUmbrella]:
    """Find contour and centre of each element, and cut its texture.

    Raises
    ------
    FexelError
        An option that is out of range; an element that has no area.
    """
    options = options or BaseOptions()
    _check(options)
    return [_make_base(element, options) for element in elements]


def companion_base(base: BaseUmbrella, element: Element) -> BaseUmbrella:
    """The same umbrella with the texture of a companion map.

    Parameters
    ----------
    base : BaseUmbrella
        Of the photo.
    element : Element
        The same part of its companion map, see `umbrella_companions`.
    """
    height, width = base.texture.shape[:2]
    texture, _ = cut_texture(element, base.window, (width, height), _contour_px(base, element))
    texture[..., 3] = base.texture[..., 3]
    return BaseUmbrella(
        base.name,
        texture,
        base.has_alpha,
        base.tex_coords,
        base.points,
        base.morph_points,
        base.lost_area,
        base.tolerance_px,
        base.window,
    )


def _check(options: BaseOptions) -> None:
    for name, value, least in (("vertices", options.vertices, 4), ("texture size", options.texture_size, 4)):
        if value < least:
            raise FexelError(f"base umbrellas: {name} {value}, expected at least {least}")
    if not (np.isfinite(options.tolerance_px) and options.tolerance_px > 0):
        raise FexelError(f"base umbrellas: tolerance {options.tolerance_px:g} pixels, expected more than 0")
    if options.centre not in _CENTRES and "," not in options.centre:
        raise FexelError(f"base umbrellas: centre '{options.centre}', expected one of {', '.join(_CENTRES)}, or x,y")


def _make_base(element: Element, options: BaseOptions) -> BaseUmbrella:
    hint = hint_of(element, options.centre, options.hints)
    outline = outline_of(
        element,
        most_vertices=options.vertices - 1,
        tolerance=options.tolerance_px / element.pixel,
        wanted=options.centre if hint is None else hint,
    )
    vertices = np.concatenate([outline.center[None], outline.contour])
    window, size = texture_window(outline.contour, element.opacity.shape, options.texture_size)
    texture, has_alpha = cut_texture(element, window, size, outline.contour)
    left, top, right, bottom = window
    corner = np.array([left, element.opacity.shape[0] - bottom])
    points = (vertices - outline.center) * (element.pixel / element.scale_px)
    return BaseUmbrella(
        name=element.name,
        texture=texture,
        has_alpha=has_alpha,
        tex_coords=(vertices - corner) / np.array([right - left, bottom - top]),
        points=points,
        morph_points=points.copy(),
        lost_area=outline.lost_area,
        tolerance_px=outline.tolerance * element.pixel,
        window=window,
    )


def _contour_px(base: BaseUmbrella, element: Element) -> NDArray[np.float64]:
    """Contour in pixels of the element, y up."""
    left, top, right, bottom = base.window
    return base.tex_coords[1:] * [right - left, bottom - top] + [left, element.opacity.shape[0] - bottom]
