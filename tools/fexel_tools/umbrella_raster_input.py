"""An arrangement as flat arrays that the raster's kernels read: placed vertices, texels and what each tile may show.

Everything is in *samples*: x to the right, y down, (0, 0) the outer corner of the first sample of the picture.
Textures are mip-mapped in premultiplied, linear values; each umbrella is given the level whose texels are about as wide
as a sample, and levels that are finer than any umbrella needs are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from fexel.mipmaps import halve, level_count
from fexel.textures.umbrella_arrangement import Arrangement
from fexel_tools.umbrella_raster_spans import MOST_CROSSINGS

__all__ = [
    "Copies",
    "Placed",
    "Texels",
    "copies_in",
    "level_for",
    "pack",
    "place",
    "premultiplied",
    "texels_per_sample",
]

_SHARPER = 0.7  # for groups of samples: finer levels alias, coarser ones blur (2 dB less at 1 or 0.45)
_FINEST_RATIO = 2**0.5  # texels per sample up to which a level is read by bilinear lookups


@dataclass(frozen=True, eq=False)
class Placed:
    """The umbrellas of an arrangement in the plane of samples.

    Attributes
    ----------
    first : (n + 1,) int64
        Where the vertices of each umbrella begin.
    vertices : (total, 2) float64
    inverse_w : (total,) float64
        1 / w of each vertex under the umbrella's matrix; all equal within an umbrella of which the matrix is affine.
    orientation : (n,) float64
        Sign of the contour's area here; 0 for what cannot be drawn: not finite, through infinity, or without area.
    coverages : (n,) float64
    is_star : (n,) bool
        Its sectors tile the inside of its contour, none folded, none twice, and are at most `MOST_CROSSINGS`.
    areas : (n,) float64
        Of the contours, positive.
    boxes : (n, 4) float64
        x0, y0, x1, y1 of umbrella and shadow.
    st_boxes : (n, 4) float64
        The same in st.
    """

    first: NDArray[np.int64]
    vertices: NDArray[np.float64]
    inverse_w: NDArray[np.float64]
    orientation: NDArray[np.float64]
    coverages: NDArray[np.float64]
    is_star: NDArray[np.bool_]
    areas: NDArray[np.float64]
    boxes: NDArray[np.float64]
    st_boxes: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Texels:
    """Texels of all levels that are needed, one after the other.

    Attributes
    ----------
    texels : (N, 4) float32
        Linear, premultiplied; rows from the top.
    place : (n, 3) int64
        Of each umbrella: where its level begins, its width and height; width 0 where there is no image.
    opaque : (n,) bool
        Its image has alpha 1 everywhere.
    is_shared : (n,) bool
        Groups of samples share its colour.
    group : int
        Samples of such a group, along each axis.
    """

    texels: NDArray[np.float32]
    place: NDArray[np.int64]
    opaque: NDArray[np.bool_]
    is_shared: NDArray[np.bool_]
    group: int


@dataclass(frozen=True, eq=False)
class Copies:
    """What a picture shows of the torus: umbrellas and the whole-period shifts that they come in by, front to back.

    Attributes
    ----------
    umbrella : (m,) int64
    shift : (m, 2) float64
        Samples.
    boxes : (m, 4) float64
    """

    umbrella: NDArray[np.int64]
    shift: NDArray[np.float64]
    boxes: NDArray[np.float64]


def place(arrangement: Arrangement, sample_from_st: NDArray[np.float64]) -> Placed:
    """Umbrellas in the plane of samples.

    Parameters
    ----------
    arrangement : Arrangement
    sample_from_st : (3, 2) float64
        ``[s t 1] @ sample_from_st``.
    """
    first = arrangement.first_vertex
    with np.errstate(all="ignore"):  # an umbrella through infinity is left out below
        st = arrangement.vertices
        vertices = st @ sample_from_st[:2] + sample_from_st[2]
    w = _w_of_vertices(arrangement)
    finite = np.isfinite(vertices[:, 0]) & np.isfinite(vertices[:, 1])
    usable = _all_of(finite & (w > 0), first) | _all_of(finite & (w < 0), first)
    if not finite.all():
        vertices, st = (np.where(finite[:, None], values, 0.0) for values in (vertices, st))
    shadow = np.array(arrangement.shadow_offset, np.float64)
    area, is_star = _contours(vertices, first)
    orientation = np.where(usable, np.sign(area), 0.0)
    count = len(arrangement)
    given = np.asarray(arrangement.coverages, np.float64)
    return Placed(
        first,
        vertices,
        1.0 / np.where(w == 0, 1.0, w),
        orientation,
        given if len(given) == count else np.ones(count),
        is_star,
        np.abs(area),
        _boxes(vertices, first, shadow @ sample_from_st[:2]),
        _boxes(st, first, shadow),
    )


def texels_per_sample(
    arrangement: Arrangement, placed: Placed, textures: Sequence[NDArray | None]
) -> NDArray[np.float64]:
    """(n,) texels of its image, along an axis, in a sample of each umbrella; 0 where there is no image."""
    ratio = np.zeros(len(arrangement))
    for number, (shape, texture) in enumerate(zip(arrangement.shapes, textures, strict=True)):
        if texture is None:
            continue
        users = arrangement.shape_of == number
        coords = shape.tex_coords * np.array(texture.shape[1::-1])
        whole = float(abs(_contours(coords, np.array([0, len(coords)]))[0][0]))
        # 1e-12 guards umbrellas without area, which draw nothing.
        ratio[users] = np.sqrt(whole / np.maximum(placed.areas[users], 1e-12))
    return ratio


def pack(
    arrangement: Arrangement,
    textures: Sequence[NDArray | None],
    ratio: NDArray[np.float64],
    is_star: NDArray[np.bool_],
    group: int = 1,
) -> Texels:
    """Levels of images that umbrellas need at so many texels per sample (`texels_per_sample`).

    Parameters
    ----------
    arrangement : Arrangement
    textures : sequence of (h, w, 3 or 4) float or None
        Of each shape, linear (or raw), straight alpha.
    ratio : (n,) float64
    is_star : (n,) bool
        As `Placed` has it.
    group : int
        Samples, along each axis, that share a colour, where umbrellas are opaque stars.
    """
    place = np.zeros((len(arrangement), 3), np.int64)
    opaque = np.ones(len(arrangement), np.bool_)
    parts, used = [np.zeros((1, 4), np.float32)], 1
    for number, texture in enumerate(textures):
        users = np.flatnonzero(arrangement.shape_of == number) if texture is not None else np.zeros(0, np.int64)
        if texture is None or not len(users):
            continue
        texels = premultiplied(texture)
        opaque[users] = bool((texels[..., 3] == 1).all())
        widths = np.where(opaque[users] & is_star[users], max(1.0, group * _SHARPER), 1.0)
        levels = level_for(ratio[users] * widths, texture.shape)
        for level in range(int(levels.max()) + 1):
            texels = halve(texels) if level else texels
            if (chosen := users[levels == level]).size:
                place[chosen] = used, texels.shape[1], texels.shape[0]
                parts.append(texels.reshape(-1, 4))
                used += len(parts[-1])
    return Texels(np.ascontiguousarray(np.concatenate(parts)), place, opaque, opaque & is_star & (group > 1), group)


def level_for(ratio: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Mip levels of an image (h, w, ...) to read where samples are so many texels wide."""
    wanted = np.ceil(np.log2(np.maximum(ratio / _FINEST_RATIO, 1.0))).astype(np.int64)
    return np.minimum(wanted, level_count(shape[1], shape[0]) - 1)


def copies_in(
    placed: Placed,
    frame: NDArray[np.float64],
    st_to_sample: NDArray[np.float64],
    size: tuple[int, int],
) -> Copies:
    """All copies of umbrellas that touch a picture.

    Parameters
    ----------
    placed : Placed
    frame : (3, 2) float64
        ``st = [x y 1] @ frame``, x and y in samples.
    st_to_sample : (2, 2) float64
        Linear part of its inverse: row i is a period along s or t, in samples.
    size : (int, int)
        Width and height in samples.
    """
    corners = np.array([[0, 0, 1], [size[0], 0, 1], [0, size[1], 1], [*size, 1]]) @ frame
    drawn = np.flatnonzero(placed.orientation != 0)
    box = placed.st_boxes[drawn]
    lowest = np.ceil(corners.min(axis=0) - box[:, 2:]).astype(np.int64)
    counts = np.maximum(np.floor(corners.max(axis=0) - box[:, :2]).astype(np.int64) - lowest + 1, 0)
    each = counts.prod(axis=1)
    number = np.arange(each.sum()) - np.repeat(np.cumsum(each) - each, each)
    across = np.repeat(counts[:, 0], each)
    periods = np.repeat(lowest, each, axis=0) + np.stack(
        [number % np.maximum(across, 1), number // np.maximum(across, 1)], 1
    )
    umbrella, shift = np.repeat(drawn, each), periods @ st_to_sample
    boxes = placed.boxes[umbrella] + np.tile(shift, (1, 2))
    touches = (boxes[:, 0] < size[0]) & (boxes[:, 2] > 0) & (boxes[:, 1] < size[1]) & (boxes[:, 3] > 0)
    return Copies(umbrella[touches], np.ascontiguousarray(shift[touches]), boxes[touches])


def _w_of_vertices(arrangement: Arrangement) -> NDArray[np.float64]:
    """(total,) homogeneous coordinate of every vertex."""
    if arrangement.is_affine:
        return np.ones(len(arrangement.vertices))
    column = np.repeat(arrangement.matrices[:, :, 2], arrangement.vertex_counts, axis=0)
    return (arrangement.points * column[:, :2]).sum(axis=1) + column[:, 2]


def premultiplied(texture: NDArray) -> NDArray[np.float32]:
    """(h, w, 4) of an image (h, w, 3 or 4), straight; alpha 1 where it has none."""
    texels = np.empty((*texture.shape[:2], 4), np.float32)
    texels[..., 3] = texture[..., 3] if texture.shape[2] == 4 else 1.0
    np.multiply(texture[..., :3], texels[..., 3:], out=texels[..., :3])
    return texels


def _all_of(flags: NDArray[np.bool_], first: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether all vertices of each umbrella are so."""
    total = np.concatenate([[0], np.cumsum(flags)])
    return total[first[1:]] - total[first[:-1]] == np.diff(first)


@numba.njit(cache=True, nogil=True)
def _contours(vertices, first):
    """Signed area of each contour (the vertices but the first), and whether its sectors tile it as those of a star."""
    count = len(first) - 1
    areas, is_star = np.zeros(count), np.zeros(count, np.bool_)
    for number in range(count):
        begin, end = first[number], first[number + 1]
        cx, cy = vertices[begin, 0], vertices[begin, 1]
        total, turn, left, right = 0.0, 0.0, False, False
        for k in range(begin + 1, end):
            following = k + 1 if k + 1 < end else begin + 1
            ax, ay = vertices[k, 0] - cx, vertices[k, 1] - cy
            bx, by = vertices[following, 0] - cx, vertices[following, 1] - cy
            cross, dot = ax * by - ay * bx, ax * bx + ay * by
            total += cross
            turn += np.arctan2(cross, dot)
            left, right = left or cross < 0, right or cross > 0
        areas[number] = 0.5 * total
        once = np.abs(np.abs(turn) - 2 * np.pi) < 0.1  # multiples of a turn, but for rounding
        is_star[number] = once and not (left and right) and end - begin - 1 <= MOST_CROSSINGS
    return areas, is_star


def _boxes(vertices: NDArray[np.float64], first: NDArray[np.int64], shadow: NDArray[np.float64]) -> NDArray[np.float64]:
    if not len(vertices):
        return np.zeros((0, 4))
    low = np.minimum.reduceat(vertices, first[:-1])
    high = np.maximum.reduceat(vertices, first[:-1])
    return np.concatenate([low + np.minimum(shadow, 0), high + np.maximum(shadow, 0)], axis=1)
