"""Placement error of a zipmap's deepest visible patch against depth, in texels of that patch.

Twelve nested patches, each four times finer than its parent, off centre and slightly turned. Texels hold their own
numbers, so that an interpolated colour says where the lookup was; float64 says where it should have been.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.harness import Curve, Row
from bench.zipmap_stage import (
    Patch,
    front_view,
    pixel_st,
    quad,
    render_texture,
    save,
    tilted_view,
    zipmap_stage,
    zipmap_texture,
)
from fexel import homography
from fexel.renderer.context import GLContext
from fexel.textures.system import TextureSystem

NAME = "zipmap placement"
DEPTHS = (10, 16, 20, 24)
_NESTS = 12
_TILTS = (0.0, 55.0)
_TEXELS = 128
_REFERENCE = {
    10: "matrix per vertex 0.013, per fragment 0.15",
    16: "matrix per vertex 0.8, per fragment 5.6",
    20: "matrix per vertex 21, per fragment 98",
    24: "matrix per vertex 500, per fragment 1000",
}


def nest_matrix() -> np.ndarray:
    """Parent to child: the child is a quarter of its parent, off centre and turned by 3 degrees."""
    angle = np.radians(3.0)
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return homography.translate(-0.57, -0.46) @ turn @ homography.scale(4.0, 4.0) @ homography.translate(0.5, 0.5)


def placement_error(gl, folder: Path, exponent: int, tilt: float, pixels: int = 160) -> float:
    """Largest misplacement at magnification ``2 ** exponent``, in texels of the deepest patch there.

    Parameters
    ----------
    gl : moderngl.Context
    folder : Path
        For the textures.
    exponent : int
        0 to 24.
    tilt : float
        Degrees between the view and the surface's normal.
    pixels : int
        Width and height of the view.
    """
    depth = exponent // 2
    column, row = np.meshgrid(np.arange(_TEXELS), np.arange(_TEXELS))
    numbers = np.stack([column, row, np.zeros_like(row), np.ones_like(row)], axis=-1).astype(np.float32)
    file = save(folder / "numbers.exr", numbers, "float16", "raw")
    patch = None
    for _ in range(depth):
        patch = Patch(file, nest_matrix(), children=() if patch is None else (patch,), color_space="raw")
    root = Patch(file, np.eye(3), children=() if patch is None else (patch,), color_space="raw")
    texture = zipmap_texture(zipmap_stage(root))
    st_to_deepest = texture.data.root_to_patch[-1]
    view, draw = _view(st_to_deepest, tilt, pixels), quad()
    system = TextureSystem(gl, anisotropy=1.0)
    frame = render_texture(gl, texture, draw, view, system, aovs=True).reshape(-1, 8)
    system.release()
    uv = homography.apply(st_to_deepest, pixel_st(view)[0])
    texel = np.stack([uv[:, 0] * _TEXELS, (1 - uv[:, 1]) * _TEXELS], axis=1) - 0.5
    # Magnified, and 2 texels clear of the rim, where alpha fades: there a colour is a place.
    inside = (np.nan_to_num(texel, nan=-1) > 2).all(axis=1) & (np.nan_to_num(texel, nan=1e9) < _TEXELS - 3).all(axis=1)
    inside &= (frame[:, 4] <= 0) & (frame[:, 5] == depth)
    if inside.sum() < 100:
        return float("nan")
    return float(np.abs(frame[inside, :2] - texel[inside]).max())


def _view(st_to_deepest: np.ndarray, tilt: float, pixels: int):
    """About 100 texels of the deepest patch fill the view; its centre is not the patch's."""
    deepest_to_st = homography.invert(st_to_deepest)
    target = homography.apply(deepest_to_st, np.array([[0.47, 0.53]]))[0]
    size = np.sqrt(abs(np.linalg.det(homography.jacobian(deepest_to_st, np.array([[0.47, 0.53]]))[0]))) * 0.7
    if tilt == 0:
        return front_view(target - size / 2, target + size / 2, pixels, pixels)
    return tilted_view(target, size / 2 / np.tan(np.radians(20.0)), tilt, pixels, pixels)


def rows(quick: bool) -> Iterator[Row]:
    """One row per magnification: the worse of a front view and one tilted by 55 degrees."""
    with GLContext() as gl, tempfile.TemporaryDirectory() as folder:
        for exponent in DEPTHS[-1:] if quick else DEPTHS:
            error = max(placement_error(gl, Path(folder), exponent, tilt) for tilt in _TILTS)
            yield Row(
                measure="zipmap placement error",
                setting=f"magnification 2^{exponent}, front and 55 degrees",
                value=error,
                unit="child texels",
                target=0.01,
                comparison="<",
                reference=_REFERENCE[exponent],
            )


def float32_error(exponent: int, tilt: float, per_vertex: bool, pixels: int = 160) -> float:
    """Largest misplacement, in texels of the deepest patch, of plain float32 coordinates: a shader without re-basing.

    Interpolation and matrix are emulated in NumPy float32, the matrix composed in float64 and rounded once: applied at
    the corners of the quad and interpolated (`per_vertex`), or applied to the interpolated st.
    """
    st_to_deepest = np.linalg.matrix_power(nest_matrix(), exponent // 2)
    st = pixel_st(_view(st_to_deepest, tilt, pixels))[0]
    uv = homography.apply(st_to_deepest, st)
    st, uv = (values[((uv > 0) & (uv < 1)).all(axis=1)] for values in (st, uv))
    s, t = st.T
    below = s > t  # the first triangle of the quad, corners (0, 0), (1, 0), (1, 1); the second has (0, 1)
    weights = np.stack([1 - np.maximum(s, t), np.where(below, s - t, 0), np.minimum(s, t), np.where(below, 0, t - s)])
    weights = weights.T.astype(np.float32)
    corners = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], np.float32)
    matrix = st_to_deepest.astype(np.float32)
    found = weights @ (corners @ matrix) if per_vertex else (weights @ corners) @ matrix
    found = found[:, :2] / found[:, 2:]
    return float(np.abs(found.astype(np.float64) - uv).max() * _TEXELS)


def curves(quick: bool) -> Iterator[Curve]:
    """Error against magnification 2^0 to 2^24, the worse of two views: rendered, and what plain float32 gives."""
    exponents = range(0, 2 * _NESTS + 1, 8 if quick else 2)
    with GLContext() as gl, tempfile.TemporaryDirectory() as folder:
        ours = [max(placement_error(gl, Path(folder), n, tilt) for tilt in _TILTS) for n in exponents]
    plain = {
        f"float32, matrix per {place}": [
            max(float32_error(n, tilt, place == "vertex") for tilt in _TILTS) for n in exponents
        ]
        for place in ("vertex", "fragment")
    }
    for label, errors in {"fexel, re-based, as rendered": ours, **plain}.items():
        yield Curve(
            plot="zipmap_placement",
            label=label,
            x=[2.0**n for n in exponents],
            y=errors,
            x_label="magnification, 2^0 to 2^24",
            y_label="largest error, texels of the deepest patch",
            x_log=True,
            y_log=True,
            ours=errors is ours,
        )
