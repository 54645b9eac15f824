"""Cost of the minification filters over one plain mip-mapped lookup, by elevation, in turns within one run.

A UsdUVTexture that repeats lies in perspective-free views of 1024 x 1024 pixels: every pixel has the footprint of its
elevation, 1.25 texels across, at an azimuth of 20 degrees, so that the fipmap needs a shear. What is drawn is what
`fexel render --filter` draws of it; the plain lookup is GL's trilinear filter on a texture of as many texels and
of the same format, with the same st. Times are CPU times of the process: the software rasteriser's threads count, other
processes do not.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.cost_target import CostTarget, cpu_times
from bench.harness import Curve, Row
from bench.zipmap_stage import Patch, quad, save, zipmap_stage, zipmap_texture
from fexel.renderer.context import GLContext
from fexel.scene.model import Draw, Texture

NAME = "minification cost"
_PIXELS = 1024
_SIZE, _LARGE = 512, 2048
_AZIMUTH = 20.0
_MINOR = 1.25
_ELEVATIONS = (90.0, 30.0, 10.0, 5.0, 2.0, 1.0)
_FILTERS = ("mipmap", "anisotropic", "ripmap", "fipmap", "auto")
_ASKED = {"ripmap": 1.4, "fipmap": 3.5}
_KNOWN = {"ripmap": "1.4", "fipmap": "5.5 with 2 probes"}
_PROBES = 16


def noise_texture(folder: Path, size: int) -> Texture:
    """8-bit noise, sRGB, repeating."""
    texels = np.random.default_rng(1).random((size, size, 4), np.float32)
    texels[..., 3] = 1.0
    file = save(folder / "noise.tif", texels, "uint8", "sRGB", 20)
    return zipmap_texture(zipmap_stage(Patch(file, np.eye(3), color_space="sRGB"), "repeat"))


def tilted(elevation: float, size: int) -> Draw:
    """The quad that fills the picture, its st as a plane seen at an elevation in degrees; texels across the texture."""
    angle = np.radians(_AZIMUTH)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    texels = rotation @ np.diag([_MINOR / np.sin(np.radians(elevation)), _MINOR])
    draw = quad()
    st = (draw.mesh.points[:, :2] - 0.5) * _PIXELS @ texels.T / size + 0.5
    return replace(draw, mesh=replace(draw.mesh, st={"st": st}))


def cost_ratios(
    elevation: float, filters: tuple[str, ...], repeats: int, size: int = _SIZE
) -> dict[str, tuple[float, float]]:
    """By filter: CPU time over the plain lookup's, and half the spread."""
    mesh = tilted(elevation, size)
    with tempfile.TemporaryDirectory() as name, GLContext() as gl:
        target = CostTarget(gl, _PIXELS)
        texture = noise_texture(Path(name), size)
        frames = {"plain": target.plain(size, mesh)}
        for token in filters:
            frames[token] = target.textured(texture, mesh=mesh, anisotropy=_PROBES, filter=token)
        times = cpu_times(frames, repeats)
        target.release()
    ratios = {}
    for token in filters:
        low, middle, high = np.percentile(times[token] / times["plain"], [25, 50, 75])
        ratios[token] = float(middle), float(high - low) / 2
    return ratios


def rows(quick: bool) -> Iterator[Row]:
    """At 5 degrees; and of a texture that is larger than the cache, of which coarse mip levels are not."""
    repeats = 7 if quick else 25
    for size, filters in ((_SIZE, _FILTERS), (_LARGE, tuple(_ASKED))):
        for token, (ratio, spread) in cost_ratios(5.0, filters, repeats, size).items():
            target = _ASKED.get(token) if size == _SIZE else None
            yield Row(
                measure="minification cost",
                setting=f"{token}, 5 degrees, texture of {size}x{size}",
                value=ratio,
                unit="plain mip-mapped lookups",
                target=target,
                comparison="<=" if target else None,
                reference=_KNOWN.get(token, ""),
                spread=spread,
                samples=repeats,
                note=f"{_PIXELS}x{_PIXELS} pixels",
            )


def curves(quick: bool) -> Iterator[Curve]:
    """Against the elevation."""
    ratios = {elevation: cost_ratios(elevation, _FILTERS, 3 if quick else 9) for elevation in _ELEVATIONS}
    for token in _FILTERS:
        yield Curve(
            plot="minification_cost_elevation",
            label=token,
            x=list(_ELEVATIONS),
            y=[ratios[elevation][token][0] for elevation in _ELEVATIONS],
            x_label="elevation, degrees",
            y_label="plain mip-mapped lookups",
            ours=token in ("fipmap", "auto"),
        )
