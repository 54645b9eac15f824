"""What a point of an umbrella shows: interpolation in its sectors, lookups in its image."""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["lookup", "lookup_wrapped", "plane", "sector_values", "straight", "turned", "wrapped"]


@numba.njit(cache=True, nogil=True)
def sector_values(values, corner, begin, coords, inverse_w, tex_coords, width, height):
    """Place in the image, in texels from its upper left corner, and 1, over w, at the corners of a sector."""
    for k in range(3):
        w = inverse_w[begin + corner[k]] / inverse_w[begin]
        values[k, 0] = tex_coords[coords + corner[k], 0] * width * w
        values[k, 1] = (1 - tex_coords[coords + corner[k], 1]) * height * w
        values[k, 5] = w


@numba.njit(cache=True, nogil=True)
def straight(texels, offset, width, height, u, v, is_opaque):
    """Straight colour and alpha of an image."""
    r, g, b, alpha = lookup(texels, offset, width, height, u, v)
    if is_opaque:
        return r, g, b, np.float32(1)
    over = np.float32(1) / max(alpha, np.float32(1e-6))  # 1e-6 guards what is nearly transparent
    return r * over, g * over, b * over, alpha


@numba.njit(cache=True, nogil=True)
def turned(r, g, number, vectors):
    """Encoded x and y of a vector that turns with its umbrella."""
    turns, zero_x, zero_y, aspect = vectors
    x, y = (r - zero_x) * aspect, g - zero_y
    return (
        (turns[number, 0, 0] * x + turns[number, 0, 1] * y) / aspect + zero_x,
        turns[number, 1, 0] * x + turns[number, 1, 1] * y + zero_y,
    )


@numba.njit(cache=True, nogil=True)
def plane(values, k, a_x, a_y, b_x, b_y):
    """Slope along x, value at the centre and slope along y of what is interpolated in a sector."""
    to_a, to_b = values[1, k] - values[0, k], values[2, k] - values[0, k]
    return to_a * a_x + to_b * b_x, values[0, k], to_a * a_y + to_b * b_y


@numba.njit(cache=True, nogil=True)
def lookup(texels, offset, width, height, u, v):
    """Bilinear, clamped; u, v in texels from the upper left corner."""
    x, y = min(max(u - 0.5, 0.0), width - 1.0), min(max(v - 0.5, 0.0), height - 1.0)
    column, row = int(x), int(y)
    right = 1 if column + 1 < width else 0
    below = width if row + 1 < height else 0
    return _mixed(texels, offset + row * width + column, right, below, np.float32(x - column), np.float32(y - row))


@numba.njit(cache=True, nogil=True)
def lookup_wrapped(texels, offset, width, height, u, v, wraps):
    """Bilinear, across the seam where the image repeats."""
    x, y = u - 0.5, v - 0.5
    if wraps[0] != 0:
        x = min(max(x, 0.0), width - 1.0)
    elif x < 0:
        x += width
    if wraps[1] != 0:
        y = min(max(y, 0.0), height - 1.0)
    elif y < 0:
        y += height
    column, row = min(int(x), width - 1), min(int(y), height - 1)
    right = 1 if column + 1 < width else (-column if wraps[0] == 0 else 0)
    below = width if row + 1 < height else (-row * width if wraps[1] == 0 else 0)
    return _mixed(texels, offset + row * width + column, right, below, np.float32(x - column), np.float32(y - row))


@numba.njit(cache=True, nogil=True)
def _mixed(texels, corner, right, below, across, down):
    """Bilinear mean of four texels."""
    upper = (np.float32(1) - across) * (np.float32(1) - down)
    upper_right = across * (np.float32(1) - down)
    lower = (np.float32(1) - across) * down
    lower_right = across * down
    p, q, r, s = corner, corner + right, corner + below, corner + right + below
    return (
        upper * texels[p, 0] + upper_right * texels[q, 0] + lower * texels[r, 0] + lower_right * texels[s, 0],
        upper * texels[p, 1] + upper_right * texels[q, 1] + lower * texels[r, 1] + lower_right * texels[s, 1],
        upper * texels[p, 2] + upper_right * texels[q, 2] + lower * texels[r, 2] + lower_right * texels[s, 2],
        upper * texels[p, 3] + upper_right * texels[q, 3] + lower * texels[r, 3] + lower_right * texels[s, 3],
    )


@numba.njit(cache=True, nogil=True)
def wrapped(coordinate, mode):
    """Within [0, 1]: 0 repeats, 1 clamps, 2 mirrors."""
    if mode == 0:
        return coordinate - np.floor(coordinate)
    if mode == 2:
        return abs(coordinate - 2 * np.floor(0.5 * coordinate + 0.5))
    return min(1.0, max(0.0, coordinate))
