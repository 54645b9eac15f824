"""The texture of a base umbrella: the box of its contour with a margin, colours continued past the contour.

Inside the contour a texture is opaque but for what is meant to be seen through: holes, and translucent parts. Pixels
at the rim are neither, since the contour itself ends the umbrella and is anti-aliased when it is drawn; alpha there is
continued from inside, as the colours are.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel_tools.color_bleed import bleed_color
from fexel_tools.umbrella_elements import Element

__all__ = ["Window", "cut_texture", "texture_window"]

Window = tuple[int, int, int, int]

_MARGIN = 1 / 64  # of the longer side
_LEAST_MARGIN_PX = 2
_RIM_PX = 2.0
_OPAQUE = 0.9  # from here on a pixel counts as opaque
_OWN_OPACITY = 0.98  # from here on the colour of a pixel is the element's own
_LEAST_OPACITY = 1 / 16  # of a translucent pixel whose colour can be told
_LEAST_HOLE = 2e-3  # of the contour's area: less of it being see-through is noise


def texture_window(contour: NDArray[np.float64], shape: tuple[int, int], most: int) -> tuple[Window, tuple[int, int]]:
    """The part of an element that its texture shows, and how many texels wide and high that is.

    Parameters
    ----------
    contour : (K, 2) float64
        Pixels, y up.
    shape : (int, int)
        Rows and columns of the element.
    most : int
        Texels on the longer side.
    """
    low, high = contour.min(axis=0), contour.max(axis=0)
    margin = max(_LEAST_MARGIN_PX, _MARGIN * float((high - low).max()))
    left, right = int(np.floor(low[0] - margin)), int(np.ceil(high[0] + margin))
    top, bottom = (int(v) for v in (np.floor(shape[0] - high[1] - margin), np.ceil(shape[0] - low[1] + margin)))
    width, height = right - left, bottom - top
    scale = min(1.0, most / max(width, height))
    return (left, top, right, bottom), (max(round(width * scale), 1), max(round(height * scale), 1))


def cut_texture(
    element: Element, window: Window, size: tuple[int, int], contour: NDArray[np.float64]
) -> tuple[NDArray[np.float32], bool]:
    """Texels of a base.

    Parameters
    ----------
    element : Element
    window : (int, int, int, int)
        Left, top, right, bottom in pixels of the element, beyond which it may reach.
    size : (int, int)
        Texels, width and height.
    contour : (K, 2) float64
        Pixels of the element, y up.

    Returns
    -------
    texture : (h, w, 4) float32
        Straight alpha, 1 throughout where the second is False.
    has_alpha : bool
    """
    color, opacity = _window_of(element, window)
    depth = _depth(contour, window, element.opacity.shape[0])
    inside = depth > min(_RIM_PX, 0.5 * float(depth.max()))
    see_through = inside & (opacity < _OPAQUE)
    see_through = cv2.morphologyEx(see_through.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    has_alpha = np.count_nonzero(see_through) > max(_LEAST_HOLE * np.count_nonzero(depth > 0), 4)
    trusted = inside & (opacity > (_LEAST_OPACITY if has_alpha else _OWN_OPACITY))
    color = bleed_color(color, trusted.astype(np.float32)) if trusted.any() else color
    alpha = opacity
    if has_alpha:
        solid = np.where(opacity > _OWN_OPACITY, np.float32(1), opacity)
        alpha = bleed_color(np.repeat(solid[..., None], 3, axis=2), inside.astype(np.float32))[..., 0]
    alpha = _reduced(alpha, size) if has_alpha else np.ones(size[::-1], np.float32)
    return np.dstack([_reduced(color, size), alpha]), bool(has_alpha)


def _window_of(element: Element, window: Window) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Colour and opacity; beyond the element, colours of its edge and no opacity."""
    left, top, right, bottom = window
    height, width = element.opacity.shape
    rows = np.clip(np.arange(top, bottom), 0, height - 1)
    columns = np.clip(np.arange(left, right), 0, width - 1)
    opacity = element.opacity[np.ix_(rows, columns)].copy()
    opacity[(np.arange(top, bottom) != rows)] = 0
    opacity[:, np.arange(left, right) != columns] = 0
    return element.color[np.ix_(rows, columns)], opacity


def _depth(contour: NDArray[np.float64], window: Window, rows: int) -> NDArray[np.float32]:
    """(H, W) pixels inside the contour to its nearest side, 0 outside."""
    left, top, right, bottom = window
    mask = np.zeros((bottom - top, right - left), np.uint8)
    corners = np.stack([contour[:, 0] - left, rows - contour[:, 1] - top], axis=1) - 0.5
    cv2.fillPoly(mask, [np.rint(corners * 16).astype(np.int32)], 1, shift=4)
    return cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)


def _reduced(plane: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    if plane.shape[1::-1] == size:
        return plane
    return cv2.resize(plane, size, interpolation=cv2.INTER_AREA)
