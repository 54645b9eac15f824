"""Cost of an umbrella lookup over one plain mip-mapped lookup, against k and v, in turns within one run (fig. 12).

The umbrella paper's setting: fall leaves on 32 x 32 cells, bases of 256 x 256 texels, a picture of 512 x 512 pixels
that shows the whole texture, with and without shadows, through the renderer's own path. The plain lookup is GL's
trilinear filter on a texture of the bases' format, between levels 0 and 1 so that it blends two. Times are CPU times of
the process: the software rasteriser's threads count, other processes do not.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.cost_target import CostTarget, cpu_times
from bench.fall_leaves import FallLeaves, fall_leaves
from bench.harness import Curve, Row
from fexel.renderer.context import GLContext
from fexel.scene.model import Texture
from fexel.textures.umbrella import UmbrellaData

NAME = "umbrella lookup cost"
_PIXELS = 512
_GRID = (32, 32)
_V, _K = 77, 13
_VERTICES = (16, 32, 64, 77, 128)
_LISTS = (4, 8, 13, 20, 28, 37)
_LOD = 0.5


def umbrellas(leaves: FallLeaves, *, shadows: bool) -> Texture:
    """The setting, as the renderer gets it."""
    arrangement = leaves.arrangement if shadows else replace(leaves.arrangement, shadow_strength=0.0)
    return Texture("/Umbrella", "umbrella", UmbrellaData(leaves.background, arrangement))


def cost_ratios(folder: Path, settings: list[tuple[int, int, bool]], repeats: int) -> list[tuple[float, float]]:
    """CPU time over the plain lookup's, and half its spread, for each (k, v, shadows)."""
    with GLContext() as gl:
        target = CostTarget(gl, _PIXELS)
        frames: dict[str, Callable[[], object]] = {"plain": target.plain(int(_PIXELS * 2**_LOD))}
        for k, v, shadows in settings:
            leaves = fall_leaves(folder / f"k{k}v{v}", vertices=v, grid=_GRID, k=k)
            frames[str((k, v, shadows))] = target.textured(umbrellas(leaves, shadows=shadows))
        times = cpu_times(frames, repeats)
        target.release()
    results = []
    for setting in settings:
        pairs = times[str(setting)] / times["plain"]
        low, high = np.percentile(pairs, [25, 75])
        results.append((float(np.median(pairs)), float(high - low) / 2))
    return results


def rows(quick: bool) -> Iterator[Row]:
    """Ratios to one plain lookup, and how they grow with k and v."""
    repeats = 5 if quick else 15
    settings = [(_K, _V, True), (_K, _V, False), (_K, 16, True), (_K, 128, True), (4, _V, True), (37, _V, True)]
    with tempfile.TemporaryDirectory() as name:
        ratios = cost_ratios(Path(name), settings, repeats)
    for (k, v, shadows), (ratio, spread) in zip(settings, ratios, strict=True):
        asked = (k, v, shadows) == (_K, _V, True)
        yield Row(
            measure="umbrella lookup cost",
            setting=f"512x512, k {k}, v {v}, {'with' if shadows else 'without'} shadows",
            value=ratio,
            unit="plain mip-mapped lookups",
            target=20.0 if asked else None,
            comparison="<=" if asked else None,
            reference="118 plain, 25 with the known tricks" if asked else "",
            spread=spread,
            samples=repeats,
            note="",
        )
    values = [ratio for ratio, _ in ratios]
    for name, growth, most in (
        ("v 16 to 128", values[3] / values[2], 1.25),
        ("k 4 to 37", values[5] / values[4], 2.0),
    ):
        yield Row(
            measure="umbrella lookup cost, growth",
            setting=name,
            value=growth,
            unit="times",
            target=most,
            comparison="<=",
            reference="",
            spread=0.0,
            samples=repeats,
            note="512x512, with shadows",
        )


def curves(quick: bool) -> Iterator[Curve]:
    """Fig. 12: cost against k at v 77, and against v at k 13."""
    repeats = 3 if quick else 9
    for label, values, setting in (
        ("k", _LISTS, lambda k, shadows: (k, _V, shadows)),
        ("v", _VERTICES, lambda v, shadows: (_K, v, shadows)),
    ):
        for shadows in (True, False):
            with tempfile.TemporaryDirectory() as name:
                ratios = cost_ratios(Path(name), [setting(value, shadows) for value in values], repeats)
            yield Curve(
                plot=f"umbrella lookup cost against {label}",
                label=f"{'with' if shadows else 'without'} shadows",
                x=[float(value) for value in values],
                y=[ratio for ratio, _ in ratios],
                x_label=label,
                y_label="plain mip-mapped lookups",
                ours=True,
            )
