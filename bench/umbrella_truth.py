"""What an arrangement looks like, by brute force: hard-edged umbrellas at 16 x 16 places per pixel, averaged.

Umbrellas are drawn forward, front to back, triangle by triangle over all places of a view, with a bilinear lookup in
the full images, and so share nothing with the lookups that are measured: no cells, no sector search, no mip levels. A
place keeps how much of it is still open and how much light the umbrellas so far leave to what lies below them (section
6.2 of "Just-in-time texture synthesis", 2012; shadows of several umbrellas multiply, they do not add up).
"""

from __future__ import annotations

import numba
import numpy as np

from fexel.textures.umbrella_arrangement import Arrangement

__all__ = ["Truth", "turned_view"]


def turned_view(
    center: tuple[float, float],
    footprint_px: float,
    size: tuple[int, int],
    grid: tuple[int, int],
    degrees: float = 20.0,
) -> np.ndarray:
    """(3, 3) pixels to st, row vectors: a view in which a cell is so many pixels wide, turned about `center` (st).

    Pixels are continuous, x right, y down; `size` is width and height.
    """
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), np.sin(angle)], [np.sin(angle), -np.cos(angle)]]) / footprint_px / np.array(grid)
    matrix = np.eye(3)
    matrix[:2, :2] = turn
    matrix[2, :2] = center - np.array(size) / 2 @ turn
    return matrix


class Truth:
    """An arrangement with its texels, ready to be drawn.

    Parameters
    ----------
    arrangement : Arrangement
        Its matrices are affine.
    textures : sequence of (h, w, 3 or 4) float32
        Of the shapes; linear, straight alpha, row 0 at the top.
    soil : (h, w, 3) float32
        The background, repeating over st.
    """

    def __init__(self, arrangement: Arrangement, textures, soil: np.ndarray) -> None:
        if not np.allclose(arrangement.matrices[:, :, 2], (0, 0, 1)):
            raise ValueError("the truth draws affine umbrellas")
        self._arrangement = arrangement
        self._texels, self._where = _packed(textures)
        self._soil = np.ascontiguousarray(soil[..., :3], np.float32)
        coords = [shape.tex_coords for shape in arrangement.shapes]
        self._coords = np.concatenate(coords) if coords else np.zeros((0, 2))
        self._first_coord = np.cumsum([0] + [len(part) for part in coords])
        total = len(arrangement.vertices)
        self._colors = arrangement.colors if len(arrangement.colors) else np.zeros((total, 3), np.float32)

    def picture(self, pixel_to_st: np.ndarray, size: tuple[int, int], samples: int = 16) -> np.ndarray:
        """(H, W, 3) float32, linear: the mean of ``samples**2`` places of each pixel of a view without horizon."""
        width, height = size
        rows = max(1, _PLACES // (width * samples**2))
        strips = [
            self._strip(pixel_to_st, width, low, min(low + rows, height), samples) for low in range(0, height, rows)
        ]
        return np.concatenate(strips)

    def _strip(self, pixel_to_st: np.ndarray, width: int, low: int, high: int, samples: int) -> np.ndarray:
        place_to_st = np.array([[1 / samples, 0, 0], [0, 1 / samples, 0], [0, low, 1]]) @ pixel_to_st
        shape = ((high - low) * samples, width * samples)
        color, open_, lit = np.zeros((*shape, 3), np.float32), np.ones(shape, np.float32), np.ones(shape, np.float32)
        data = self._arrangement
        strength = float(data.shadow_strength)
        _draw(
            place_to_st,
            np.linalg.inv(place_to_st),
            data.vertices,
            data.first_vertex,
            data.shape_of,
            data.coverages if len(data.coverages) else np.ones(len(data)),
            self._colors,
            float(data.color_blend),
            self._coords,
            self._first_coord,
            self._texels,
            self._where,
            np.asarray(data.shadow_offset, np.float64),
            strength,
            color,
            open_,
            lit,
        )
        _background(place_to_st, self._soil, strength, color, open_, lit)
        return color.reshape(high - low, samples, width, samples, 3).mean((1, 3), dtype=np.float64).astype(np.float32)


_PLACES = 1 << 22  # at once: 80 MB


def _packed(textures) -> tuple[np.ndarray, np.ndarray]:
    """Premultiplied texels of all images in a row; per image where they begin, height, width, whether it has alpha."""
    parts, where, start = [np.zeros((0, 4), np.float32)], [], 0
    for texture in textures:
        alpha = texture[..., 3:] if texture.shape[2] == 4 else np.ones((*texture.shape[:2], 1), np.float32)
        parts.append(np.concatenate([texture[..., :3] * alpha, alpha], -1).reshape(-1, 4).astype(np.float32))
        where.append((start, *texture.shape[:2], texture.shape[2] == 4))
        start += len(parts[-1])
    return np.concatenate(parts), np.array(where, np.int64).reshape(-1, 4)


@numba.njit(cache=True)
def _draw(
    place_to_st,
    st_to_place,
    vertices,
    first,
    shape_of,
    coverages,
    colors,
    blend,
    coords,
    first_coord,
    texels,
    where,
    offset,
    strength,
    color,
    open_,
    lit,
):
    low, high = _seen(place_to_st, color.shape[1], color.shape[0])
    triangle, own, st, x, y = np.empty((3, 2)), np.empty((3, 3)), np.empty((3, 2)), np.empty(3), np.empty(3)
    for umbrella in range(len(shape_of)):
        begin, end = first[umbrella], first[umbrella + 1]
        image = where[shape_of[umbrella]]
        texture = first_coord[shape_of[umbrella]]
        for is_shadow in range(2 if strength > 0 else 1):
            moved = vertices[begin:end] + offset * is_shadow
            left, right = moved[:, 0].min(), moved[:, 0].max()
            bottom, top = moved[:, 1].min(), moved[:, 1].max()
            for i in range(int(np.ceil(low[0] - right)), int(np.floor(high[0] - left)) + 1):
                for j in range(int(np.ceil(low[1] - top)), int(np.floor(high[1] - bottom)) + 1):
                    corners = moved + np.array([float(i), float(j)])
                    for k in range(1, end - begin):
                        following = k + 1 if k + 1 < end - begin else 1
                        sector = (0, k, following)
                        for corner in range(3):
                            for axis in range(2):
                                triangle[corner, axis] = corners[sector[corner], axis]
                                st[corner, axis] = coords[texture + sector[corner], axis]
                            for channel in range(3):
                                own[corner, channel] = blend * colors[begin + sector[corner], channel]
                        _sector(
                            place_to_st,
                            st_to_place,
                            triangle,
                            own,
                            st,
                            x,
                            y,
                            texels,
                            image,
                            coverages[umbrella],
                            is_shadow == 1,
                            strength,
                            color,
                            open_,
                            lit,
                        )


@numba.njit(cache=True)
def _seen(place_to_st, width, height):
    """Bounds in st of what is in view."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for corner in range(4):
        x, y = width * (corner % 2), height * (corner // 2)
        w = x * place_to_st[0, 2] + y * place_to_st[1, 2] + place_to_st[2, 2]
        for axis in range(2):
            value = (x * place_to_st[0, axis] + y * place_to_st[1, axis] + place_to_st[2, axis]) / w
            low[axis], high[axis] = min(low[axis], value), max(high[axis], value)
    return low, high


@numba.njit(cache=True)
def _sector(
    place_to_st, st_to_place, triangle, own, st, x, y, texels, image, coverage, is_shadow, strength, color, open_, lit
):
    """One triangle: its colour, or its shadow, at the places whose middles it covers."""
    area = (triangle[1, 0] - triangle[0, 0]) * (triangle[2, 1] - triangle[0, 1]) - (triangle[1, 1] - triangle[0, 1]) * (
        triangle[2, 0] - triangle[0, 0]
    )
    if area == 0:
        return
    for corner in range(3):
        s, t = triangle[corner]
        w = s * st_to_place[0, 2] + t * st_to_place[1, 2] + st_to_place[2, 2]
        x[corner] = (s * st_to_place[0, 0] + t * st_to_place[1, 0] + st_to_place[2, 0]) / w
        y[corner] = (s * st_to_place[0, 1] + t * st_to_place[1, 1] + st_to_place[2, 1]) / w
    for row in range(max(0, int(np.ceil(y.min() - 0.5))), min(len(color) - 1, int(np.floor(y.max() - 0.5))) + 1):
        left, right = np.inf, -np.inf
        for corner in range(3):
            after = (corner + 1) % 3
            y0, y1 = y[corner], y[after]
            if (y0 <= row + 0.5) != (y1 <= row + 0.5):
                crossing = x[corner] + (row + 0.5 - y0) / (y1 - y0) * (x[after] - x[corner])
                left, right = min(left, crossing), max(right, crossing)
        if not left <= right:
            continue
        for column in range(max(0, int(np.ceil(left - 0.5))), min(color.shape[1], int(np.ceil(right - 0.5)))):
            if not is_shadow and open_[row, column] <= 0:
                continue
            px, py = column + 0.5, row + 0.5
            w = px * place_to_st[0, 2] + py * place_to_st[1, 2] + place_to_st[2, 2]
            s = (px * place_to_st[0, 0] + py * place_to_st[1, 0] + place_to_st[2, 0]) / w
            t = (px * place_to_st[0, 1] + py * place_to_st[1, 1] + place_to_st[2, 1]) / w
            b = (
                (s - triangle[0, 0]) * (triangle[2, 1] - triangle[0, 1])
                - (t - triangle[0, 1]) * (triangle[2, 0] - triangle[0, 0])
            ) / area
            c = (
                (triangle[1, 0] - triangle[0, 0]) * (t - triangle[0, 1])
                - (triangle[1, 1] - triangle[0, 1]) * (s - triangle[0, 0])
            ) / area
            a = 1 - b - c
            if is_shadow and image[3] == 0:
                lit[row, column] *= 1 - coverage
                continue
            u = a * st[0, 0] + b * st[1, 0] + c * st[2, 0]
            v = a * st[0, 1] + b * st[1, 1] + c * st[2, 1]
            texel = _bilinear(texels, image, u, v)
            alpha = texel[3] * coverage
            if is_shadow:
                lit[row, column] *= 1 - alpha
            elif texel[3] > 0:
                share = open_[row, column] * alpha * (1 - strength * (1 - lit[row, column]))
                for channel in range(3):
                    shift = a * own[0, channel] + b * own[1, channel] + c * own[2, channel]
                    color[row, column, channel] += share * min(1.0, max(0.0, texel[channel] / texel[3] + shift))
                open_[row, column] *= 1 - alpha


@numba.njit(cache=True)
def _bilinear(texels, image, s, t):
    """Of a clamped image; (4,) premultiplied."""
    start, height, width = image[0], image[1], image[2]
    x = min(max(s * width - 0.5, 0.0), width - 1.0)
    y = min(max((1 - t) * height - 0.5, 0.0), height - 1.0)
    x0, y0 = int(x), int(y)
    x1, y1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1)
    u, v = x - x0, y - y0
    rows = (start + y0 * width, start + y1 * width)
    w00, w10, w01, w11 = (1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v
    a, b, c, d = texels[rows[0] + x0], texels[rows[0] + x1], texels[rows[1] + x0], texels[rows[1] + x1]
    return (
        w00 * a[0] + w10 * b[0] + w01 * c[0] + w11 * d[0],
        w00 * a[1] + w10 * b[1] + w01 * c[1] + w11 * d[1],
        w00 * a[2] + w10 * b[2] + w01 * c[2] + w11 * d[2],
        w00 * a[3] + w10 * b[3] + w01 * c[3] + w11 * d[3],
    )


@numba.njit(cache=True)
def _background(place_to_st, soil, strength, color, open_, lit):
    height, width = soil.shape[:2]
    for row in range(len(color)):
        for column in range(color.shape[1]):
            if open_[row, column] <= 0:
                continue
            px, py = column + 0.5, row + 0.5
            w = px * place_to_st[0, 2] + py * place_to_st[1, 2] + place_to_st[2, 2]
            s = (px * place_to_st[0, 0] + py * place_to_st[1, 0] + place_to_st[2, 0]) / w
            t = (px * place_to_st[0, 1] + py * place_to_st[1, 1] + place_to_st[2, 1]) / w
            x, y = s * width - 0.5, (1 - t) * height - 0.5
            x0, y0 = int(np.floor(x)), int(np.floor(y))
            u, v = x - x0, y - y0
            share = open_[row, column] * (1 - strength * (1 - lit[row, column]))
            for channel in range(3):
                upper = (1 - u) * soil[y0 % height, x0 % width, channel] + u * soil[
                    y0 % height, (x0 + 1) % width, channel
                ]
                lower = (1 - u) * soil[(y0 + 1) % height, x0 % width, channel] + u * soil[
                    (y0 + 1) % height, (x0 + 1) % width, channel
                ]
                color[row, column, channel] += share * ((1 - v) * upper + v * lower)
