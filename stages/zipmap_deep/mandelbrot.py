"""The Mandelbrot set as a surface with detail at every scale: its colour anywhere, for textures and for ground truth.

The plane is mapped to texture coordinates of the root, ``c = ROOT_CENTER + (s - 0.5 + i (t - 0.5)) * ROOT_WIDTH``.
Colour is a smooth function of log2(n + 1), n the continuous iteration count (smooth by the potential), so that a
close-up continues what the level above shows. Float64 carries windows down to about 1e-12.
"""

from __future__ import annotations

import numpy as np

__all__ = ["ROOT_CENTER", "ROOT_WIDTH", "TARGET", "color", "render", "target_st"]

ROOT_CENTER = -0.75 + 0.0j
ROOT_WIDTH = 3.0
TARGET = -0.743643887037151 + 0.131825904205330j  # a spiral within spirals, worth looking at down to 1e-10
_ESCAPE = 64.0  # a generous radius makes the smooth count exact to 1e-3
_LIMIT = 4000


def target_st() -> tuple[float, float]:
    """Root texture coordinates of `TARGET`."""
    offset = (TARGET - ROOT_CENTER) / ROOT_WIDTH
    return 0.5 + offset.real, 0.5 + offset.imag


def escape_count(c: np.ndarray) -> np.ndarray:
    """Continuous iteration count of z -> z^2 + c; NaN inside the set (or past the limit)."""
    flat = c.ravel()
    count = np.full(flat.shape, np.nan)
    index = np.flatnonzero(~_in_cardioid_or_disc(flat))
    z = np.zeros(index.shape, complex)
    for n in range(_LIMIT):
        z = z * z + flat[index]
        out = np.abs(z) > _ESCAPE
        if out.any():
            count[index[out]] = n + 1 - np.log2(np.log(np.abs(z[out])) / np.log(_ESCAPE))
            index, z = index[~out], z[~out]
            if not index.size:
                break
    return count.reshape(c.shape)


def _in_cardioid_or_disc(c: np.ndarray) -> np.ndarray:
    """Whether a point lies in one of the two largest parts of the set, which never escape."""
    x, y2 = c.real, c.imag**2
    q = (x - 0.25) ** 2 + y2
    return (q * (q + x - 0.25) <= 0.25 * y2) | ((x + 1) ** 2 + y2 <= 1 / 16)


def color(c: np.ndarray) -> np.ndarray:
    """Linear Rec.709 colour of points of the plane, shape of `c` + (3,), 0..1."""
    count = escape_count(c)
    phase = 2 * np.pi * np.log2(np.maximum(count, 0) + 1.0)[..., None] * 0.5
    rgb = 0.5 - 0.45 * np.cos(phase + np.array([0.0, 0.7, 1.6]))
    return np.where(np.isnan(count)[..., None], 0.003, rgb**2.2)


def render(center: complex, width: complex, size: int, samples: int = 4) -> np.ndarray:
    """Average a square window over ``samples x samples`` points per pixel: (size, size, 3) linear, top row first.

    `width` is the window's lower edge as a vector of the plane: its length, and by its argument a turn of the window.
    """
    steps = (np.arange(size * samples) + 0.5) / (size * samples) - 0.5
    c = center + width * (steps[None, :] - 1j * steps[:, None])
    return color(c).reshape(size, samples, size, samples, 3).mean((1, 3))
