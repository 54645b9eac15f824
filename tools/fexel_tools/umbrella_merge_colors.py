"""Colours of merged umbrellas: as the paper has it, a mean about each vertex; and fitted to the picture.

`cosine_colors` is section 5 of "Just-in-time texture synthesis" (2012): a raised cosine about each vertex, half as wide
as the vertex is far from the centre. `fitted_colors` are those of least error: what an arrangement of given contours
and coverages shows is linear in its vertex colours, so they are bounded linear least squares against the true picture,
in which hidden umbrellas play no part (notes U9).
"""

from __future__ import annotations

import numba
import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from fexel.textures.umbrella_arrangement import Arrangement
from fexel_tools.umbrella_raster_input import Copies, Placed, copies_in, place
from fexel_tools.umbrella_raster_spans import triangle_spans

__all__ = ["cosine_colors", "fitted_colors"]

_ROUNDS = 300
_SETTLED = 1e-4  # change of any colour in a round: far below an 8-bit step
_PRIOR = 1e-2  # of a sample: pulls colours that are hardly seen towards those they started from


def cosine_colors(arrangement: Arrangement, picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """(total, 3) means of a picture about each vertex, within its umbrella.

    Parameters
    ----------
    arrangement : Arrangement
        In st.
    picture : (H, W, 3) float32
        Linear, of the unit square; repeats.
    """
    size = np.array(picture.shape[1::-1], np.float64)
    vertices = arrangement.vertices * (size * (1, -1)) + (0.0, size[1])
    first = arrangement.first_vertex
    colors = np.zeros((len(vertices), 3), np.float32)
    _means_about(vertices, first, np.ascontiguousarray(picture, np.float32), colors)
    return colors


def fitted_colors(
    arrangement: Arrangement, start: NDArray[np.float32], picture: NDArray[np.float32], behind: NDArray[np.float32]
) -> NDArray[np.float32]:
    """(total, 3) in [0, 1]: with them the arrangement looks most like a picture.

    Parameters
    ----------
    arrangement : Arrangement
        Image-less, in st; its coverages count, its colours do not.
    start : (total, 3) float32
        In [0, 1]; what stays where a vertex is not seen.
    picture : (H, W, 3) float32
        Linear, premultiplied, of the unit square; repeats.
    behind : (H, W, 3) float32
        Background, likewise.
    """
    height, width = picture.shape[:2]
    weights, through = _weights(arrangement, (width, height))
    wanted = (picture - through[..., None] * behind).reshape(-1, 3).astype(np.float64)
    normal = (weights.T @ weights).tocsr() + _PRIOR * scipy.sparse.identity(len(start), format="csr")
    right = weights.T @ wanted + _PRIOR * start
    return _bounded(normal, right, start.astype(np.float64)).astype(np.float32)


def _bounded(normal: scipy.sparse.csr_matrix, right: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray:
    """Minimum of ``x.N.x / 2 - r.x`` in [0, 1]: accelerated projected gradients (Beck and Teboulle 2009)."""
    if not x.size:
        return x
    step = 1.0 / float(np.abs(normal).sum(axis=1).max())  # Gershgorin bounds the largest eigenvalue
    ahead, speed = x, 1.0
    for _ in range(_ROUNDS):
        following = np.clip(ahead - step * (normal @ ahead - right), 0.0, 1.0)
        faster = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * speed * speed))
        ahead = following + (speed - 1.0) / faster * (following - x)
        change = float(np.abs(following - x).max())
        x, speed = following, faster
        if change < _SETTLED:
            break
    return x


def _weights(arrangement: Arrangement, size: tuple[int, int]) -> tuple[scipy.sparse.csr_matrix, NDArray[np.float32]]:
    """(pixels, vertices) shares of every vertex in every pixel's centre, and (H, W) what is seen of the background."""
    sample_from_st = np.array([[size[0], 0.0], [0.0, -size[1]], [0.0, size[1]]], np.float64)
    frame = np.array([[1 / size[0], 0.0], [0.0, -1 / size[1]], [0.0, 1.0]])
    placed = place(arrangement, sample_from_st)
    copies = copies_in(placed, frame, sample_from_st[:2], size)
    seen = np.ones((size[1], size[0]), np.float32)
    room = int(_compose(*_kernel_input(placed, copies), seen, *_no_room()))
    pixel, vertex, share = np.empty(room, np.int32), np.empty((room, 3), np.int32), np.empty((room, 3), np.float32)
    seen[:] = 1
    _compose(*_kernel_input(placed, copies), seen, pixel, vertex, share)
    shape = (size[0] * size[1], len(placed.vertices))
    matrix = scipy.sparse.coo_matrix((share.ravel(), (np.repeat(pixel, 3), vertex.ravel())), shape=shape)
    return matrix.tocsr().astype(np.float64), seen


def _kernel_input(placed: Placed, copies: Copies) -> tuple:
    return placed.first, placed.vertices, placed.orientation, placed.coverages, copies.umbrella, copies.shift


def _no_room() -> tuple:
    return np.empty(0, np.int32), np.empty((0, 3), np.int32), np.empty((0, 3), np.float32)


@numba.njit(cache=True, nogil=True)
def _compose(first, vertices, orientation, coverages, umbrella, shift, seen, pixel, vertex, share):
    """Front to back: pixel, its three vertices and their shares, for every umbrella seen there; returns how many."""
    rows, columns = seen.shape
    spans = np.empty((rows, 2), np.int64)
    count = 0
    for entry in range(len(umbrella)):
        number = umbrella[entry]
        begin, size = first[number], first[number + 1] - first[number]
        dx, dy = shift[entry]
        cx, cy = vertices[begin, 0] + dx, vertices[begin, 1] + dy
        for sector in range(1, size):
            following = sector + 1 if sector + 1 < size else 1
            ax, ay = vertices[begin + sector, 0] + dx, vertices[begin + sector, 1] + dy
            bx, by = vertices[begin + following, 0] + dx, vertices[begin + following, 1] + dy
            area = (ax - cx) * (by - cy) - (ay - cy) * (bx - cx)
            if area * orientation[number] <= 0:
                continue
            top, bottom = triangle_spans(cx, cy, ax, ay, bx, by, columns, rows, spans)
            for y in range(top, bottom):
                for x in range(spans[y, 0], spans[y, 1]):
                    weight = seen[y, x] * coverages[number]
                    if weight <= 0:
                        continue
                    seen[y, x] *= 1 - coverages[number]
                    if count < len(pixel):
                        px, py = x + 0.5 - cx, y + 0.5 - cy
                        of_a = (px * (by - cy) - py * (bx - cx)) / area
                        of_b = ((ax - cx) * py - (ay - cy) * px) / area
                        pixel[count] = y * columns + x
                        vertex[count, 0], vertex[count, 1], vertex[count, 2] = begin, begin + sector, begin + following
                        share[count, 0] = weight * (1 - of_a - of_b)
                        share[count, 1], share[count, 2] = weight * of_a, weight * of_b
                    count += 1
    return count


@numba.njit(cache=True, nogil=True)
def _means_about(vertices, first, picture, colors):
    """A raised cosine about every vertex, inside the contour; the nearest pixel where none is near."""
    rows, columns = picture.shape[:2]
    for number in range(len(first) - 1):
        begin, end = first[number], first[number + 1]
        cx, cy = vertices[begin]
        mean = 0.0
        for corner in range(begin + 1, end):
            mean += np.hypot(vertices[corner, 0] - cx, vertices[corner, 1] - cy) / (end - begin - 1)
        for corner in range(begin, end):
            vx, vy = vertices[corner]
            reach = 0.5 * (mean if corner == begin else np.hypot(vx - cx, vy - cy))
            total = 0.0
            for y in range(int(np.floor(vy - reach)), int(np.ceil(vy + reach)) + 1):
                for x in range(int(np.floor(vx - reach)), int(np.ceil(vx + reach)) + 1):
                    px, py = x + 0.5, y + 0.5
                    away = np.hypot(px - vx, py - vy)
                    if away < reach and _inside(px, py, vertices, begin + 1, end):
                        weight = 0.5 + 0.5 * np.cos(np.pi * away / reach)
                        total += weight
                        for c in range(3):
                            colors[corner, c] += weight * picture[y % rows, x % columns, c]
            for c in range(3):
                if total > 0:
                    colors[corner, c] /= total
                else:
                    colors[corner, c] = picture[int(np.floor(vy)) % rows, int(np.floor(vx)) % columns, c]


@numba.njit(cache=True, nogil=True)
def _inside(x, y, vertices, begin, end):
    """Whether a point lies in a polygon: an odd number of crossings to its right."""
    odd = False
    previous = end - 1
    for corner in range(begin, end):
        ax, ay = vertices[corner]
        bx, by = vertices[previous]
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            odd = not odd
        previous = corner
    return odd
