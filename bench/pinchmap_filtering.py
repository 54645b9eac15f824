"""Anti-aliasing and minification of a pinchmap against a supersampled truth, beside a large mip-mapped texture.

A 32 x 32 pinchmap of a rounded star with a 64 x 64 signal, turned by 0.3 radian, from 16 pixels per texel of the
pinchmap to 4 texels per pixel. The truth is the mean of the picture with hard edges over the pixel's square. Beside it
stands the picture as a 512 x 512 texture with mip levels, trilinear, of 68 times the bytes. By the float64 twin, with
exact gradients (the shader's four fetches) and with differences between pixels (its single bilinear access).
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bench.harness import Curve, Row
from bench.pinchmap_probe import quad_gradient
from fexel import mipmaps
from fexel.textures.pinchmap_lattice import trilinear
from fexel.textures.pinchmap_twin import edge, picture_levels, sample_pinchmap
from fexel_tools.pinchmap_fit import fit

NAME = "pinchmap filtering"
_TEXELS = 32
_LARGE = 512
_PIXELS_PER_TEXEL = (16.0, 8.0, 4.0, 2.0, 1.0, 0.5, 0.25)
_OFFSETS = ((0.0, 0.0), (0.25, 0.1), (0.5, 0.35), (0.75, 0.6), (0.4, 0.85))  # pixels
_WAYS = ("pinchmap", "pinchmap, differences between pixels", "512 x 512 texture")


@dataclass(frozen=True)
class _Scene:
    """The picture as a pinchmap and as a texture; places are (M, 2) in st, colours (M, 3)."""

    pinchmap: np.ndarray
    signal: np.ndarray
    levels: list[np.ndarray]
    large: list[np.ndarray]

    def truth(self, st: np.ndarray, jacobian: np.ndarray, probes: int) -> np.ndarray:
        inside = (np.arange(probes) + 0.5) / probes - 0.5
        offsets = np.stack(np.meshgrid(inside, inside), -1).reshape(-1, 2) @ jacobian.T
        places = (st[:, None] + offsets).reshape(-1, 2)
        shown = sample_pinchmap(self.pinchmap, [self.signal], places, jacobian / probes / 4)
        return shown.reshape(len(st), -1, 4).mean(1)[:, :3]

    def colors(self, way: str, st: np.ndarray, jacobian: np.ndarray, side: int) -> np.ndarray:
        if way == _WAYS[2]:
            lod = np.full(len(st), np.log2(_LARGE * np.linalg.norm(jacobian, 2)))
            return trilinear(self.large, st, lod, ("clamp", "clamp"))[:, :3]
        gradient = quad_gradient(edge(self.pinchmap, st).reshape(side, side)) if way == _WAYS[1] else None
        return sample_pinchmap(self.pinchmap, self.levels, st, jacobian, gradient=gradient)[:, :3]


def _star(size: int) -> np.ndarray:
    """(size, size) in [0, 1]."""
    y, x = (np.mgrid[0:size, 0:size] + 0.5) / size - 0.5
    angle, radius = np.arctan2(y, x), np.hypot(x, y)
    reach = 0.31 + 0.05 * np.sin(3 * angle) + 0.03 * np.cos(5 * angle + 1)
    return np.clip((reach - radius) * size + 0.5, 0, 1).astype(np.float32)


def _scene() -> _Scene:
    fitted = fit(_star(512), (_TEXELS, _TEXELS))
    mask = fitted.mask.repeat(2, 0).repeat(2, 1)[..., None]
    y, x = np.mgrid[0 : 2 * _TEXELS, 0 : 2 * _TEXELS] / (2 * _TEXELS)
    bright = np.dstack([0.7 + 0.25 * np.sin(9 * x), 0.5 + 0.2 * np.cos(7 * y), 0.1 + 0.05 * x])
    dark = np.dstack([0.05 + 0.04 * x, 0.1 + 0.05 * y, 0.4 + 0.2 * np.sin(8 * x * y)])
    signal = np.dstack([np.where(mask, bright, dark), np.ones(mask.shape)]).astype(np.float32)
    at = (np.arange(4 * _LARGE) + 0.5) / (4 * _LARGE)
    places = np.stack(np.meshgrid(at, 1 - at), -1).reshape(-1, 2)
    texels = sample_pinchmap(fitted.pinchmap, signal, places, np.eye(2) / (4 * _LARGE))
    large = mipmaps.pyramid(texels.reshape(_LARGE, 4, _LARGE, 4, 4).mean((1, 3)))
    levels = picture_levels(fitted.pinchmap, mipmaps.pyramid(signal))
    return _Scene(fitted.pinchmap, signal, levels, large)


@functools.cache
def _figures(most: int) -> dict[float, dict[str, tuple[float, float]]]:
    """PSNR in dB and flicker of views of at most so many pixels a side, by footprint and way."""
    scene = _scene()
    result = {}
    for magnification in _PIXELS_PER_TEXEL:
        side = int(min(most, _TEXELS * magnification)) // 2 * 2
        probes = 16 if magnification >= 1 else 32
        turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
        jacobian = turn / (magnification * _TEXELS)
        start = [0.0, 0.33] if magnification > 5 else [0.0, 0.0]  # a close view looks at the boundary
        errors: dict[str, list[np.ndarray]] = {way: [] for way in _WAYS}
        for offset in _OFFSETS:
            at = np.arange(side) + 0.5 - side / 2
            pixels = np.stack(np.meshgrid(at + offset[0], at + offset[1]), -1).reshape(-1, 2)
            st = 0.5 + np.array(start) + pixels @ jacobian.T
            expected = scene.truth(st, jacobian, probes)
            for way in _WAYS:
                errors[way].append(scene.colors(way, st, jacobian, side) - expected)
        result[magnification] = {way: (_db(errors[way]), _shimmer(errors[way])) for way in _WAYS}
    return result


def _db(errors: list[np.ndarray]) -> float:
    return float(-10 * np.log10(np.mean(np.square(errors))))


def _shimmer(errors: list[np.ndarray]) -> float:
    """Standard deviation of the mean colour of the view while it moves: what a viewer sees flicker."""
    return float(np.std([error.mean(0) for error in errors], axis=0).max())


def rows(quick: bool) -> Iterator[Row]:
    """By footprint: PSNR and flicker, ours and the texture's."""
    for magnification, by_way in _figures(64 if quick else 160).items():
        setting = f"{magnification:g} pixels per texel"
        theirs = by_way[_WAYS[2]]
        for way in _WAYS[:2]:
            db, flicker = by_way[way]
            yield Row(
                measure=f"filtering against a supersampled truth, {way}",
                setting=setting,
                value=db,
                unit="dB",
                reference=f"{theirs[0]:.1f} dB, {_WAYS[2]}",
                note=f"flicker of the mean colour {flicker:.1e}, the texture's {theirs[1]:.1e}",
            )


def curves(quick: bool) -> Iterator[Curve]:
    """PSNR over the footprint."""
    figures = _figures(64 if quick else 160)
    for way in _WAYS:
        yield Curve(
            plot="pinchmap filtering",
            label=way,
            x=[1 / magnification for magnification in figures],
            y=[by_way[way][0] for by_way in figures.values()],
            x_label="texels of the pinchmap per pixel",
            y_label="PSNR, dB",
            x_log=True,
            ours=way != _WAYS[2],
        )
