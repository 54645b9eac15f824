"""Speed against error of umbrellas: CPU time of a frame and CIEDE2000 against supersampling, by footprint.

The fall leaves turned by 20 degrees, 256 x 256 pixels, through the renderer's own path: with the level of detail that
the command makes, without any, with merged umbrellas, and as an explicit mip-mapped texture.
Times are taken in turns within one run.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.color_error import ciede2000
from bench.cost_target import cpu_times
from bench.harness import Curve, Row
from bench.umbrella_setting import Ground, fall_leaves_ground, merged_leaves_ground
from bench.umbrella_texture import affine_view, picture
from bench.umbrella_truth import turned_view
from bench.zipmap_stage import Patch, compiled_view, zipmap_stage, zipmap_texture
from fexel.renderer.context import GLContext
from fexel.renderer.program import ProgramCache
from fexel.scene.model import Texture
from fexel.textures.system import TextureSystem
from fexel_tools.texture_files import write_texture

NAME = "umbrella speed against error"
_PIXELS = 256
_FOOTPRINTS = (16, 8, 4, 2)  # pixels a cell
_CENTER = (0.37, 0.58)
_EXPLICIT_TEXELS = 64  # per cell: finer ones are not read at these footprints
_OURS = "umbrellas with a level image"
_EXPLICIT = "explicit texture, mip-mapped"
_found: dict[str, dict[int, _Point]] = {}


@dataclass(frozen=True)
class _Point:
    milliseconds: float
    spread: float
    over_explicit: float
    error: float


def rows(quick: bool) -> Iterator[Row]:
    """Ours over the explicit texture, by footprint."""
    with tempfile.TemporaryDirectory() as name, GLContext() as gl:
        ground = fall_leaves_ground(Path(name))
        _found.update(_measured(gl, ground, _textures(Path(name), ground), 5 if quick else 15))
    for footprint, point in _found[_OURS].items():
        others = [
            f"{way} {points[footprint].milliseconds:.1f} ms, CIEDE2000 {points[footprint].error:.2f}"
            for way, points in _found.items()
            if way != _OURS
        ]
        yield Row(
            measure="frame of umbrellas over one of the explicit texture",
            setting=f"{_PIXELS} x {_PIXELS} pixels, {footprint} pixels a cell",
            value=point.over_explicit,
            unit="ratio of CPU times",
            reference="; ".join(others),
            spread=point.spread,
            samples=5 if quick else 15,
            note=f"{point.milliseconds:.1f} ms, CIEDE2000 {point.error:.2f}",
        )


def curves(quick: bool) -> Iterator[Curve]:  # noqa: ARG001
    """Error over the time of a frame, one point per footprint."""
    for way, points in _found.items():
        yield Curve(
            plot="umbrella_speed",
            label=way,
            x=[point.milliseconds for point in points.values()],
            y=[point.error for point in points.values()],
            x_label=f"milliseconds of CPU per frame, {_PIXELS} x {_PIXELS} pixels",
            y_label="CIEDE2000, mean, against 16 x 16 supersampling",
            x_log=True,
            y_log=True,
            ours=way == _OURS,
            annotations=[f"{footprint} px" for footprint in points],
        )


def _textures(folder: Path, ground: Ground) -> dict[str, Texture]:
    data = ground.texture.data
    explicit = ground.explicit(_EXPLICIT_TEXELS)
    write_texture(folder / "explicit.tif", explicit.levels[0])
    stage = zipmap_stage(Patch(str(folder / "explicit.tif"), np.eye(3), color_space="sRGB"), wrap="repeat")
    return {
        _OURS: ground.texture,
        "umbrellas without levels": replace(ground.texture, data=replace(data, levels=())),
        "umbrellas, fitted merged levels": merged_leaves_ground(folder / "merged", "fitted", 8).texture,
        _EXPLICIT: zipmap_texture(stage),
    }


def _measured(gl, ground: Ground, textures: dict[str, Texture], repeats: int) -> dict[str, dict[int, _Point]]:
    found: dict[str, dict[int, _Point]] = {way: {} for way in textures}
    size = (_PIXELS, _PIXELS)
    target = gl.framebuffer([gl.renderbuffer(size, 4, dtype="f2")])
    programs = ProgramCache(gl)
    systems = {way: TextureSystem(gl, anisotropy=1) for way in textures}
    for footprint in _FOOTPRINTS:
        view = turned_view(_CENTER, footprint, size, ground.grid)
        truth = ground.truth.picture(view, size)
        errors = {
            way: ciede2000(picture(gl, texture, view, size, systems[way]), truth) for way, texture in textures.items()
        }
        frames = {
            way: _frame(gl, target, compiled_view(gl, programs, *affine_view(view, size), (texture, systems[way])))
            for way, texture in textures.items()
        }
        times = cpu_times(frames, repeats)
        for way in textures:
            ratios = times[way] / times[_EXPLICIT]
            low, high = np.percentile(ratios, [25, 75])
            milliseconds = 1e3 * float(np.median(times[way]))
            found[way][footprint] = _Point(milliseconds, (high - low) / 2, float(np.median(ratios)), errors[way])
    for system in systems.values():
        system.release()
    target.release()
    return found


def _frame(gl, target, compiled) -> Callable[[], None]:
    program, binding, draw = compiled

    def frame() -> None:
        binding.apply(program)
        target.use()
        draw()
        gl.finish()

    return frame
