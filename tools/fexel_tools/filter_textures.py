"""Textures that minification filters are judged on: checkerboard, line chart, bricks and a page of text, of any size.

Shapes are drawn as polygons on a raster several times finer and averaged in linear light, so that a chart of any size
is sharp without being jagged. The chart is laid out after figures 18 to 20 of Bornik and Ferko 2002, where a chart for
measuring line pairs per millimetre is sheared: a black square, parallel lines along both axes and a digit, repeated at
smaller and smaller scales and turned. All of them may be repeated without a seam; pictures are (size, size, 3) uint8,
sRGB-encoded, row 0 at the top. `tones` are paper and ink, sRGB-encoded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel.images.srgb import linear_to_srgb, srgb_to_linear

__all__ = ["FULL_CONTRAST", "TEXTURES", "bricks", "checkerboard", "line_chart", "text_page"]

_FINER = 4  # raster cells along each side of a texel
_SHIFT = 8  # bits of a polygon's coordinates below one cell

_PRINT = (226, 40)  # paper and ink, sRGB-encoded: paper reflects three quarters of the light, ink a fiftieth
_EXTREMES = (255, 0)


def checkerboard(size: int = 512, squares: int = 32, tones: tuple[int, int] = _PRINT) -> NDArray[np.uint8]:
    """So many dark and light squares along each side, an even number; sharp where it divides `size`."""
    edges = np.arange(1, squares, 2) / squares
    odd = np.sum([_overlap(edge, edge + 1 / squares, size) for edge in edges], axis=0)
    return _mixed((odd[:, None] * (1 - odd) + (1 - odd[:, None]) * odd).astype(np.float32), tones)


def line_chart(size: int = 512, tones: tuple[int, int] = _PRINT) -> NDArray[np.uint8]:
    """The chart of line pairs: groups of elements, each smaller and inside the one before, and turned elements."""
    polygons = [_rectangle(0.02, 0.02, 0.98, 0.03), _rectangle(0.02, 0.97, 0.98, 0.98)]
    polygons += [_rectangle(0.02, 0.02, 0.03, 0.98), _rectangle(0.97, 0.02, 0.98, 0.98)]
    for group in range(5):
        polygons += _group(group)
    for number, degrees in enumerate((15, 30, 45, 60, 75)):
        polygons += _turned(_element(number + 1), (0.83, 0.13 + 0.148 * number), 0.115, degrees)
        polygons += _turned(_element(number + 1), (0.11 + 0.135 * number, 0.72), 0.075, -degrees)
        polygons += _turned(_element(number + 6), (0.11 + 0.135 * number, 0.83), 0.05, degrees)
        polygons += _turned(_element(number + 1), (0.09 + 0.09 * number, 0.91), 0.028, -degrees)
    polygons += _rays((0.83, 0.87), 0.08, 24)
    return _printed(size, polygons, tones)


def bricks(size: int = 512, courses: int = 16, seed: int = 5) -> NDArray[np.uint8]:
    """Running bond: an even number of courses of bricks of various reds, twice as long as high, with grain."""
    random = np.random.default_rng(seed)
    mortar = np.array([0.55, 0.52, 0.48])
    image = np.empty((size, size, 3))
    image[:] = mortar
    joint = 0.08 / courses
    for course in range(courses):
        for brick in range(courses // 2):
            left = (brick + 0.5 * (course % 2)) * 2 / courses
            color = np.array([0.33, 0.1, 0.065]) * random.uniform(0.5, 1.5) + random.uniform(0, 0.03, 3)
            bounds = left + joint, course / courses + joint, left + 2 / courses - joint, (course + 1) / courses - joint
            for shift in (0.0, -1.0):  # what leaves on the right comes in on the left
                _paint(image, (bounds[0] + shift, bounds[1], bounds[2] + shift, bounds[3]), color)
    image *= 1 + 0.25 * random.standard_normal((size, size, 1)).clip(-3, 3)
    return _stored(image.clip(0, 1))


def text_page(size: int = 512, lines: int = 28, seed: int = 7, tones: tuple[int, int] = _PRINT) -> NDArray[np.uint8]:
    """A printed page: so many lines of words, flush left, with a heading."""
    page = np.zeros((size * _FINER, size * _FINER), np.uint8)
    random = np.random.default_rng(seed)
    for number in range(lines):
        words = "The Filtering of Textures" if number == 0 else _sentence(random)
        scale = size * _FINER / lines / (34 if number == 0 else 42)
        base = int((number + 0.85) * size * _FINER / lines)
        thickness = max(1, round(scale * 1.6))
        left, right = int(0.06 * size * _FINER), int(0.94 * size * _FINER)
        while cv2.getTextSize(words, cv2.FONT_HERSHEY_COMPLEX, scale, thickness)[0][0] > right - left:
            words = words.rpartition(" ")[0]
        cv2.putText(page, words, (left, base), cv2.FONT_HERSHEY_COMPLEX, scale, 255, thickness, cv2.LINE_8)
    return _mixed(_coverage(page), tones)


TEXTURES: Mapping[str, Callable[[int], NDArray[np.uint8]]] = MappingProxyType(
    {"checkerboard": checkerboard, "line chart": line_chart, "bricks": bricks, "text page": text_page}
)
"""By name; each is drawn at a number of texels along a side."""

FULL_CONTRAST: Mapping[str, Callable[[int], NDArray[np.uint8]]] = MappingProxyType(
    {name: draw if draw is bricks else partial(draw, tones=_EXTREMES) for name, draw in TEXTURES.items()}
)
"""The same with paper 255 and ink 0; bricks, which are no print, as they are."""

_TEXT = (
    "a pixel that sees the ground from afar covers many texels and what it shows is their mean over its footprint the "
    "longer that is the more of them a filter reads unless it keeps images which were averaged along the way before"
)

# Which of a display's seven segments are lit: top, upper left and right, middle, lower left and right, bottom.
_LIT = ("1110111", "0010010", "1011101", "1011011", "0111010", "1101011", "1101111", "1010010", "1111111", "1111011")
_SEGMENTS = (
    (0.0, 0.0, 1.0, 0.2),
    (0.0, 0.0, 0.25, 1.0),
    (0.75, 0.0, 1.0, 1.0),
    (0.0, 0.9, 1.0, 1.1),
    (0.0, 1.0, 0.25, 2.0),
    (0.75, 1.0, 1.0, 2.0),
    (0.0, 1.8, 1.0, 2.0),
)


def _sentence(random: np.random.Generator) -> str:
    words = _TEXT.split()
    return " ".join(words[i] for i in random.integers(0, len(words), 16)).capitalize()


def _rectangle(left: float, top: float, right: float, bottom: float) -> NDArray[np.float64]:
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])


def _element(number: int) -> list[NDArray[np.float64]]:
    """Square, five upright and five level lines and a digit in [0, 1]^2: the fragment that the chart is made of."""
    polygons = [_rectangle(0.0, 0.0, 0.3, 0.3)]
    polygons += [_rectangle(0.4 + 0.12 * i, 0.0, 0.46 + 0.12 * i, 0.54) for i in range(5)]
    polygons += [_rectangle(0.0, 0.46 + 0.12 * i, 0.34, 0.52 + 0.12 * i) for i in range(5)]
    polygons += [_rectangle(0.4, 0.64 + 0.12 * i, 0.74, 0.7 + 0.12 * i) for i in range(3)]
    lit = _LIT[number % 10]
    for segment, on in zip(_SEGMENTS, lit, strict=True):
        if on == "1":
            polygons.append(_rectangle(*segment) * 0.17 + (0.82, 0.62))
    return polygons


def _group(group: int) -> list[NDArray[np.float64]]:
    """Elements along two sides of a square, each a tenth smaller than the one before; the next group is inside."""
    left, top, side = 0.06, 0.06, 0.6
    for _ in range(group):
        left, top, side = left + 0.36 * side, top + 0.36 * side, 0.62 * side
    polygons = []
    for number in range(3):
        extent, along = 0.31 * side * 0.9**number, number * side / 3
        polygons += [extent * polygon + (left + along, top) for polygon in _element(5 * group + number + 1)]
        if number:
            polygons += [extent * polygon + (left, top + along) for polygon in _element(5 * group + number + 3)]
    return polygons


def _turned(
    polygons: list[NDArray[np.float64]], centre: tuple[float, float], extent: float, degrees: float
) -> list[NDArray[np.float64]]:
    """An element about a centre, turned."""
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return [(polygon - 0.5) @ turn * extent + centre for polygon in polygons]


def _rays(centre: tuple[float, float], radius: float, count: int) -> Iterator[NDArray[np.float64]]:
    """A star of wedges: lines of every direction and width."""
    for i in range(count):
        ends = (2 * i + np.array([-0.5, 0.5])) * np.pi / count
        rim = np.stack([np.cos(ends), np.sin(ends)], axis=1) * radius
        yield np.concatenate([np.zeros((1, 2)), rim]) + centre


def _printed(size: int, polygons: Iterable[NDArray[np.float64]], tones: tuple[int, int]) -> NDArray[np.uint8]:
    """Polygons over [0, 1]^2, y down, as ink on paper."""
    raster = np.zeros((size * _FINER, size * _FINER), np.uint8)
    for polygon in polygons:
        cells = polygon * size * _FINER - 0.5  # cv2 counts from the centre of a cell
        cv2.fillPoly(raster, [np.rint(cells * 2**_SHIFT).astype(np.int32)], 255, cv2.LINE_8, _SHIFT)
    return _mixed(_coverage(raster), tones)


def _coverage(raster: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Mean of the cells of each texel, in [0, 1]."""
    size = len(raster) // _FINER
    return raster.reshape(size, _FINER, size, _FINER).mean((1, 3), dtype=np.float32) / np.float32(255)


def _mixed(coverage: NDArray[np.float32], tones: tuple[int, int]) -> NDArray[np.uint8]:
    light = srgb_to_linear(np.array(tones) / 255)
    return _stored(np.repeat((light[0] + (light[1] - light[0]) * coverage)[..., None], 3, axis=2))


def _paint(image: NDArray[np.float64], bounds: tuple[float, float, float, float], color: NDArray[np.float64]) -> None:
    """Fill a rectangle of [0, 1]^2 by how much of each texel it covers."""
    size = len(image)
    across, down = (_overlap(bounds[axis], bounds[axis + 2], size) for axis in (0, 1))
    share = down[:, None, None] * across[None, :, None]
    rows, columns = np.flatnonzero(down), np.flatnonzero(across)
    if len(rows) and len(columns):
        window = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        image[window] += share[window] * (color - image[window])


def _overlap(low: float, high: float, size: int) -> NDArray[np.float64]:
    texels = np.arange(size)
    return np.clip(np.minimum(high * size, texels + 1) - np.maximum(low * size, texels), 0, 1)


def _stored(linear: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.rint(linear_to_srgb(linear.astype(np.float32)) * 255).astype(np.uint8)
