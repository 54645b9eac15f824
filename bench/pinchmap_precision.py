"""The renderer's pinchmaps against the float64 twin, 1024 x 1024 pixels, from minification to 10^6 pixels per texel.

Hard edges: the largest difference where k^B and gamma^B differ by over 1e-4, and the share of pixels that show the
other side. Anti-aliased: the largest difference there. Where the shader takes the width of an edge from differences
between pixels, the twin is given those differences; it reads mip levels rounded to half floats, as pages hold them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.harness import Row
from bench.pinchmap_probe import quad_gradient
from bench.pinchmap_texture import pinchmap_stage, random_pinchmap, save_texels, two_sides
from bench.zipmap_stage import front_view, pixel_st, quad, render_texture, zipmap_texture
from fexel import mipmaps
from fexel.renderer.context import GLContext
from fexel.textures.pinchmap_encoding import encode_texels
from fexel.textures.pinchmap_twin import edge, picture_levels, sample_pinchmap

NAME = "pinchmap precision"
_SHAPE = (48, 64)
_MAGNIFICATIONS = (0.25, 1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6)
_STEP = 256  # the signal's values are multiples of its inverse


class _Scene:
    """A pinchmapped texture as files and as the twin needs it."""

    def __init__(self, folder: Path) -> None:
        rng = np.random.default_rng(20050904)
        self.pinchmap, mask = random_pinchmap(rng, _SHAPE)
        signal = two_sides(rng, mask, 1) / np.float32(_STEP)
        signal[..., 3] = 1.0
        self._files = [str(folder / "signal.tif"), str(folder / "pinchmap.png")]
        save_texels(Path(self._files[0]), signal.astype(np.float32))
        save_texels(Path(self._files[1]), encode_texels(self.pinchmap))
        levels = picture_levels(self.pinchmap, mipmaps.pyramid(signal))
        self._levels = [level.astype(np.float16).astype(np.float32) for level in levels]

    def compare(self, gl, magnification: float, antialias: float, pixels: int) -> tuple[np.ndarray, np.ndarray]:
        """Difference and |k^B - gamma^B| by pixel of a view about a place on the line."""
        half = 0.5 * pixels / magnification / np.array(_SHAPE[::-1])
        center = self._place_on_line() if half.max() < 0.4 else np.array([0.5, 0.5])
        view = front_view(center - half, center + half, pixels, pixels)
        st, jacobian, shown = pixel_st(view)
        stage = pinchmap_stage(*self._files, antialias=antialias, wrapS="clamp", wrapT="clamp")
        picture = render_texture(gl, zipmap_texture(stage, "/Pinchmap"), quad(), view).reshape(-1, 4)
        distance = edge(self.pinchmap, st)
        differences = quad_gradient(distance.reshape(pixels, pixels)) if 1 < magnification < 128 else None
        expected = sample_pinchmap(self.pinchmap, self._levels, st, jacobian, antialias=antialias, gradient=differences)
        return np.abs(picture - expected).max(1)[shown], np.abs(distance)[shown]

    def _place_on_line(self) -> np.ndarray:
        """By halving, from two places on either side."""
        rng = np.random.default_rng(3)
        inside, outside = (
            next(p for p in rng.uniform(0.3, 0.7, (4096, 2)) if (edge(self.pinchmap, p[None])[0] > 0) == side)
            for side in (True, False)
        )
        for _ in range(60):
            middle = 0.5 * (inside + outside)
            if edge(self.pinchmap, middle[None])[0] > 0:
                inside = middle
            else:
                outside = middle
        return inside


def rows(quick: bool) -> Iterator[Row]:
    """By magnification: hard difference, flips, anti-aliased difference."""
    pixels = 256 if quick else 1024
    with tempfile.TemporaryDirectory() as name, GLContext() as gl:
        scene = _Scene(Path(name))
        for magnification in _MAGNIFICATIONS:
            setting = f"{magnification:g} pixels per texel"
            difference, distance = scene.compare(gl, magnification, 0.0, pixels)
            yield _row("largest difference, hard edges", setting, difference[distance > 1e-4].max(initial=0), 1e-4)
            flips = 100 * float((difference[distance <= 1e-4] > 0.02).sum() / len(difference))
            yield _row("pixels on the other side", setting, flips, 0.01, "%")
            difference, distance = scene.compare(gl, magnification, 1.0, pixels)
            yield _row("largest difference, anti-aliased", setting, difference[distance > 1e-4].max(initial=0), 1e-3)


def _row(measure: str, setting: str, value: float, target: float, unit: str = "") -> Row:
    return Row(
        measure=f"pinchmap shader against float64 twin: {measure}",
        setting=setting,
        value=float(value),
        unit=unit,
        target=target,
        comparison="<=",
    )
