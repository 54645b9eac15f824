"""Eq. (1) of the zipmap paper in float64 NumPy: the oracle of shaders/zipmap.glsl.

Same filtering (trilinear, or several probes along the footprint's major axis; other filters by `FilterTwin`) but none
of its machinery: no index, no pages, no windows, no early out. Every layer is looked up at every point and blended back
to front: ``C = alpha_i C_i + (1 - alpha_i) C``, which multiplied out is ``C = sum_i w_i C_i, w_i = alpha_i prod_{j>i}
(1 - alpha_j)`` (Eisemann and Magnor 2010).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fexel import homography, mipmaps
from fexel.filters.twin import FilterTwin

__all__ = ["layer_pyramid", "sample_zipmap"]

_FLOOR = 1e-30


def layer_pyramid(image: NDArray[np.floating], is_patch: bool) -> list[NDArray[np.float64]]:
    """Mip levels of a layer, rims cleared if it is a patch.

    Parameters
    ----------
    image : (H, W, 4)
        Linear, premultiplied, row 0 at the top.
    is_patch : bool
    """
    levels = mipmaps.pyramid(image)
    return [np.asarray(mipmaps.clear_rim(level) if is_patch else level, np.float64) for level in levels]


def sample_zipmap(
    pyramids: Sequence[list[NDArray[np.float64]]],
    st_to_layer: NDArray[np.float64],
    opacity: NDArray[np.float64],
    st: NDArray[np.float64],
    jacobian: NDArray[np.float64],
    wrap: tuple[str, str] = ("clamp", "clamp"),
    anisotropy: float = 1.0,
    filters: Sequence[str] = (),
) -> NDArray[np.float64]:
    """Look up a zipmap.

    Parameters
    ----------
    pyramids : sequence of list of (H, W, 4) float64
        Of each layer, the root first, from `layer_pyramid`.
    st_to_layer : (N, 3, 3) float64
        Row vectors; w > 0 where a layer is seen.
    opacity : (N,) float64
    st : (M, 2) float64
    jacobian : (M, 2, 2) float64
        d(st)/d(pixel), column j per pixel along x, y.
    wrap : (str, str)
        Of the root.
    anisotropy : float
        Most probes per lookup.
    filters : sequence of str
        Of each layer, of `fexel.filters.FILTERS`; default ``anisotropic`` for all.

    Returns
    -------
    (M, 4) float64
        Linear, premultiplied.
    """
    color = np.zeros((len(st), 4))
    for number, levels in enumerate(pyramids):
        modes = wrap if number == 0 else ("black", "black")
        token = filters[number] if filters else "anisotropic"
        if token in ("mipmap", "anisotropic"):
            most = 1.0 if token == "mipmap" else anisotropy
            layer = _sample_layer(levels, st_to_layer[number], st, jacobian, modes, most)
        else:
            layer = _sample_filtered(FilterTwin(levels[0], modes), token, st_to_layer[number], st, jacobian)
        layer = opacity[number] * layer
        color = layer + (1.0 - layer[:, 3:]) * color
    return color


def _sample_filtered(
    twin: FilterTwin, token: str, matrix: NDArray[np.float64], st: NDArray[np.float64], jacobian: NDArray[np.float64]
) -> NDArray[np.float64]:
    """By a filter that reads prefiltered images: of a patch those of its level 0, whose rim is cleared."""
    result = np.zeros((len(st), 4))
    front = st @ matrix[:2, 2] + matrix[2, 2] > 0
    uv = homography.apply(matrix, st[front])
    size = np.array(twin.image.shape[1::-1], np.float64)
    axes = homography.jacobian(matrix, st[front]) @ jacobian[front] * (size * [1, -1])[:, None]
    result[front] = twin.sample(token, np.stack([uv[:, 0], 1 - uv[:, 1]], 1) * size, axes)[0]
    return result


def _sample_layer(
    levels: list[NDArray[np.float64]],
    matrix: NDArray[np.float64],
    st: NDArray[np.float64],
    jacobian: NDArray[np.float64],
    wrap: tuple[str, str],
    anisotropy: float,
) -> NDArray[np.float64]:
    result = np.zeros((len(st), 4))
    w = st @ matrix[:2, 2] + matrix[2, 2]
    front = w > 0
    uv = homography.apply(matrix, st[front])
    footprint = homography.jacobian(matrix, st[front]) @ jacobian[front]
    height, width = levels[0].shape[:2]
    texels = footprint * np.array([width, height])[:, None]
    u, singular, _ = np.linalg.svd(texels)
    major, minor = singular[:, 0], singular[:, 1]
    probes = np.clip(np.ceil(major / np.maximum(minor, _FLOOR) - 0.25), 1, anisotropy)
    lod = np.log2(np.maximum(np.maximum(minor, major / anisotropy), _FLOOR))
    axis = u[:, :, 0] * major[:, None] / [width, height]
    total = np.zeros((len(uv), 4))
    for probe in range(int(probes.max(initial=1))):
        taken = probe < probes
        place = uv + ((probe + 0.5) / probes - 0.5)[:, None] * axis
        total += np.where(taken[:, None], _trilinear(levels, place, lod, wrap) / probes[:, None], 0.0)
    result[front] = total
    return result


def _trilinear(
    levels: list[NDArray[np.float64]], uv: NDArray[np.float64], lod: NDArray[np.float64], wrap: tuple[str, str]
) -> NDArray[np.float64]:
    lod = np.clip(lod, 0, len(levels) - 1)
    fine = np.floor(lod).astype(int)
    result = np.zeros((len(uv), 4))
    for level, image in enumerate(levels):
        weight = np.where(fine == level, 1 - (lod - fine), np.where(fine + 1 == level, lod - fine, 0.0))
        used = weight > 0
        result[used] += weight[used, None] * _bilinear(image, uv[used], wrap)
    return result


def _bilinear(image: NDArray[np.float64], uv: NDArray[np.float64], wrap: tuple[str, str]) -> NDArray[np.float64]:
    height, width = image.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    column, row = np.floor(x), np.floor(y)
    fx, fy = x - column, y - row
    result = np.zeros((len(uv), 4))
    for dy in (0, 1):
        for dx in (0, 1):
            i, inside_x = _wrapped(column + dx, width, wrap[0])
            j, inside_y = _wrapped(row + dy, height, wrap[1])
            weight = (fx if dx else 1 - fx) * (fy if dy else 1 - fy) * inside_x * inside_y
            result += weight[:, None] * image[j, i]
    return result


def _wrapped(index: NDArray[np.float64], size: int, mode: str) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Texel numbers along an axis and whether they are within the image."""
    inside = (index >= 0) & (index < size)
    if mode == "repeat":
        return np.mod(index, size).astype(np.intp), np.ones_like(inside)
    if mode == "mirror":
        period = np.mod(index, 2 * size)
        return np.where(period < size, period, 2 * size - 1 - period).astype(np.intp), np.ones_like(inside)
    clamped = np.clip(index, 0, size - 1).astype(np.intp)
    return clamped, inside if mode == "black" else np.ones_like(inside)
