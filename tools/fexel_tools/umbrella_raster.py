"""An arrangement of umbrellas as a picture at any resolution: area-averaged, tile by tile, on all cores.

Every pixel is the mean of S x S samples. A sample shows the umbrellas that cover it front to back, as
``C = sum a_i T_i light_i c_i``, ``T_i = prod_{j<i} (1 - a_j)``, and the background behind them; its image lookups are
bilinear in the mip level whose texels are about as wide as a sample. ``light`` are the shadows of umbrellas in front
(Just-in-time texture synthesis, 2012, section 6.2; as a union, so that several do not add up). Sectors are filled as
triangles, row by row (`umbrella_raster_kernels`), so that the cost depends on samples and depth, hardly on vertices.

Pictures have row 0 at the top; s runs to the right, t up. The arrangement repeats with period 1.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel.mipmaps import halve
from fexel.textures.umbrella_arrangement import Arrangement
from fexel.textures.umbrella_geometry import turns
from fexel_tools.umbrella_raster_input import (
    Copies,
    Placed,
    Texels,
    copies_in,
    level_for,
    pack,
    place,
    premultiplied,
    texels_per_sample,
)
from fexel_tools.umbrella_raster_kernels import draw_tile

__all__ = ["UNIT_SQUARE", "rasterize", "view_of_window"]

UNIT_SQUARE = (0.0, 0.0, 1.0, 1.0)
"""All of st in [0, 1], as a window (s0, t0, s1, t1)."""

_FEWEST, _MOST = 4, 16  # samples per axis and pixel that "auto" takes
_TILE = 256  # samples a side: seen and lit of a tile stay in the cache of a core
_WRAPS = {"repeat": 0, "clamp": 1, "mirror": 2}
_NO_COLORS = np.zeros((0, 3), np.float32)


def rasterize(
    arrangement: Arrangement,
    textures: Sequence[NDArray | None],
    background: NDArray | Sequence[float] | None,
    size: tuple[int, int],
    *,
    window: tuple[float, float, float, float] = UNIT_SQUARE,
    view: NDArray | None = None,
    supersample: int | str = "auto",
    group: int | str = 1,
    background_wrap: tuple[str, str] = ("repeat", "repeat"),
    vector_scale: tuple[float, float] | None = None,
    vector_bias: tuple[float, float] = (-1.0, -1.0),
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> NDArray[np.float32]:
    """Picture of a window of the plane that an arrangement fills.

    Parameters
    ----------
    arrangement : Arrangement
        An umbrella that is not finite, singular or reaches infinity is left out.
    textures : sequence of (h, w, 3 or 4) float or None
        Image of each shape: linear (or raw data), straight alpha; None for vertex colours alone.
    background : (h, w, 3 or 4) float, or 3 or 4 floats, or None
        Image of the unit square, or its one colour, straight alpha; None is transparent.
    size : (int, int)
        Width and height in pixels.
    window : (s0, t0, s1, t1)
        What the picture shows; it may leave the unit square.
    view : (3, 2) float64, optional
        Instead of a window, any affine view: ``st = [x y 1] @ view``, x and y in pixels from the upper left corner.
    supersample : int or "auto"
        Samples per axis and pixel. auto: as many as there are texels in a pixel, 4 to 16.
    group : int or "auto"
        Samples along each axis that share a colour, where umbrellas are opaque; a divisor of `supersample`. 1: none
        do, the picture is exact. auto: as many as leave four groups, or three, along each axis of a pixel.
    background_wrap : (str, str)
        ``repeat``, ``clamp`` or ``mirror`` along s and t.
    vector_scale, vector_bias : (float, float)
        Of x and y where rgb decodes to vectors (normal maps): these turn with their umbrella. None: colours.
    jobs : int, optional
        Threads; default one per core.
    progress : callable, optional
        Called with tiles done and tiles in all.

    Returns
    -------
    (height, width, 4) float32
        Linear, premultiplied (data: before scale and bias).

    Raises
    ------
    FexelError
        A size or supersampling below 1, textures that are not one per shape, or a view that is singular.
    """
    _check(arrangement, textures, size)
    view = _usable(view_of_window(window, size) if view is None else view)
    factor = _factor(arrangement, textures, view, supersample)
    frame = view / np.array([[factor], [factor], [1.0]])
    sample_from_st = _inverse(frame)
    placed = place(arrangement, sample_from_st)
    shared = _group(group, factor)
    texels = pack(arrangement, textures, texels_per_sample(arrangement, placed, textures), placed.is_star, shared)
    picture = np.zeros((size[1], size[0], 4), np.float32)
    copies = copies_in(placed, frame, sample_from_st[:2], (size[0] * factor, size[1] * factor))
    behind = (*_background(background, frame), np.array([_WRAPS[mode] for mode in background_wrap]), frame.ravel())
    shadow = tuple(np.array(arrangement.shadow_offset, np.float64) @ sample_from_st[:2])
    constants = _constants(arrangement, placed, texels, vector_scale, vector_bias)

    def draw(box: tuple[int, int, int, int], listed: NDArray[np.int64]) -> None:
        x0, y0, x1, y1 = box
        sums = np.zeros((y1 - y0, x1 - x0, 4))
        tile = (x0 * factor, y0 * factor, (x1 - x0) * factor, (y1 - y0) * factor)
        draw_tile(
            tile,
            factor,
            listed,
            (copies.umbrella, copies.shift),
            *constants,
            shadow,
            float(arrangement.shadow_strength),
            behind,
            sums,
        )
        picture[y0:y1, x0:x1] = sums / factor**2

    side = max(1, _TILE // factor)
    total = -(-size[0] // side) * -(-size[1] // side)
    _run(draw, _tiles(size, factor, copies), total, jobs or os.cpu_count() or 1, progress)
    return picture


def view_of_window(window: tuple[float, float, float, float], size: tuple[int, int]) -> NDArray[np.float64]:
    """(3, 2) view of a window (s0, t0, s1, t1): ``st = [x y 1] @ view``, x and y in pixels, y down.

    Examples
    --------
    >>> view_of_window((0.0, 0.0, 1.0, 1.0), (4, 2)).tolist()
    [[0.25, 0.0], [0.0, -0.5], [0.0, 1.0]]
    """
    s0, t0, s1, t1 = window
    return np.array([[(s1 - s0) / size[0], 0.0], [0.0, (t0 - t1) / size[1]], [s0, t1]])


def _check(arrangement: Arrangement, textures: Sequence[NDArray | None], size: tuple[int, int]) -> None:
    if min(size) < 1:
        raise FexelError(f"picture of umbrellas: size is {size[0]} x {size[1]}, expected at least 1 x 1")
    if len(textures) != len(arrangement.shapes):
        raise FexelError(
            f"picture of umbrellas: {len(textures)} textures for {len(arrangement.shapes)} shapes, expected one each"
        )


def _usable(view: NDArray) -> NDArray[np.float64]:
    view = np.asarray(view, np.float64)
    if view.shape != (3, 2) or not np.isfinite(view).all() or np.linalg.det(view[:2]) == 0:
        raise FexelError("picture of umbrellas: the view is not finite or shows a window without area")
    return view


def _inverse(view: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 2) from st to pixels."""
    linear = np.linalg.inv(view[:2])
    return np.concatenate([linear, -view[2:] @ linear])


def _factor(
    arrangement: Arrangement,
    textures: Sequence[NDArray | None],
    view: NDArray[np.float64],
    supersample: int | str,
) -> int:
    if supersample != "auto":
        if not isinstance(supersample, int) or supersample < 1:
            raise FexelError(f"picture of umbrellas: supersample is {supersample!r}, expected auto or at least 1")
        return supersample
    ratio = texels_per_sample(arrangement, place(arrangement, _inverse(view)), textures)
    typical = float(np.median(ratio[ratio > 0])) if (ratio > 0).any() else _MOST
    return int(np.clip(np.ceil(typical), _FEWEST, _MOST))


def _group(group: int | str, factor: int) -> int:
    if group == "auto":
        return next((factor // groups for groups in (4, 3) if factor % groups == 0), 1)
    if not isinstance(group, int) or group < 1 or factor % group:
        raise FexelError(f"picture of umbrellas: group is {group!r}, expected auto or a divisor of {factor}")
    return group


def _constants(
    arrangement: Arrangement,
    placed: Placed,
    texels: Texels,
    vector_scale: tuple[float, float] | None,
    vector_bias: tuple[float, float],
) -> tuple:
    """What the kernel reads of an arrangement, whichever the tile."""
    coords = [shape.tex_coords for shape in arrangement.shapes]
    first = np.concatenate([[0], np.cumsum([len(part) for part in coords])]).astype(np.int64)
    colors = np.asarray(arrangement.colors, np.float32)
    vectors = (np.zeros((0, 2, 2)), 0.0, 0.0, 1.0)
    if vector_scale is not None and all(vector_scale):
        zero = (-vector_bias[0] / vector_scale[0], -vector_bias[1] / vector_scale[1])
        vectors = (turns(arrangement), *zero, vector_scale[0] / vector_scale[1])
    return (
        (placed.first, placed.vertices, placed.inverse_w, placed.orientation, placed.coverages, placed.is_star),
        (np.asarray(arrangement.shape_of, np.int64), first, np.concatenate([np.zeros((0, 2)), *coords])),
        colors if len(colors) == len(placed.vertices) else _NO_COLORS,
        float(arrangement.color_blend),
        (texels.texels, texels.place, texels.opaque, texels.is_shared, texels.group),
        vectors,
    )


def _background(
    background: NDArray | Sequence[float] | None, frame: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Texels (N, 4), premultiplied, of the level to look up, and its place: 0, width, height."""
    values = np.zeros(4) if background is None else np.asarray(background, np.float32)
    image = values.reshape(1, 1, -1) if values.ndim == 1 else values
    texels = premultiplied(image)
    step = np.linalg.norm(frame[:2] * np.array(texels.shape[1::-1]), axis=1).max()
    for _ in range(int(level_for(step, texels.shape))):
        texels = halve(texels)
    return np.ascontiguousarray(texels.reshape(-1, 4)), np.array([0, texels.shape[1], texels.shape[0]])


def _tiles(
    size: tuple[int, int], factor: int, copies: Copies
) -> Iterator[tuple[tuple[int, int, int, int], NDArray[np.int64]]]:
    """Boxes of pixels (x0, y0, x1, y1), and which copies may be seen in each."""
    side = max(1, _TILE // factor)
    for y0 in range(0, size[1], side):
        y1 = min(y0 + side, size[1])
        in_row = np.flatnonzero((copies.boxes[:, 1] < y1 * factor) & (copies.boxes[:, 3] > y0 * factor))
        left, right = copies.boxes[in_row, 0], copies.boxes[in_row, 2]
        for x0 in range(0, size[0], side):
            x1 = min(x0 + side, size[0])
            yield (x0, y0, x1, y1), in_row[(left < x1 * factor) & (right > x0 * factor)]


def _run(
    draw: Callable[[tuple[int, int, int, int], NDArray[np.int64]], None],
    tiles: Iterator[tuple[tuple[int, int, int, int], NDArray[np.int64]]],
    total: int,
    jobs: int,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Draw tiles on so many threads; lists of copies are made as they are needed."""
    with ThreadPoolExecutor(max(1, jobs)) as pool:
        waiting: deque = deque()
        done = 0
        for tile in tiles:
            waiting.append(pool.submit(draw, *tile))
            if len(waiting) > 4 * jobs:
                waiting.popleft().result()
                done += 1
                if progress:
                    progress(done, total)
        for future in waiting:
            future.result()
    if progress:
        progress(total, total)
