"""Level-of-detail error of umbrellas: pictures of a turned ground at six footprints against 16 x 16 supersampling.

Ours is what the renderer's shader shows of the stage: umbrellas with analytic edges and mip-mapped bases at 32, 16 and
8 pixels a cell, the prefiltered level from there on. Beside it the float64 twin of the shader; the explicit texture of
about eq. (3)'s resolution, mip-mapped, trilinear; the paper's way, umbrellas merged by its section 5, and the same with
visible hulls and fitted colours, both through the twin. Errors are mean CIEDE2000 and the PSNR of sRGB-encoded values,
over all views.
"""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from bench.color_error import ciede2000, encoded_psnr_db
from bench.harness import Curve, Row, progress
from bench.umbrella_setting import Ground, fall_leaves_ground, merged_leaves_ground, real_leaves
from bench.umbrella_texture import picture
from bench.umbrella_truth import turned_view
from fexel.renderer.context import GLContext
from fexel.textures.system import TextureSystem
from fexel.textures.umbrella_twin import UmbrellaTwin

NAME = "umbrella filtering"
_FOOTPRINTS = (32, 16, 8, 4, 2, 1)  # pixels a cell
_ASKED = {4: 1.2, 2: 1.6, 1: 2.0}
_MEGABYTES = 0.55
_PAPER = {8: "1.9", 4: "9.2", 2: "9.1", 1: "7.7"}
_BEFORE = {32: "1.2", 16: "1.6", 8: "2.1", 4: "2.6", 2: "3.5", 1: "4.0"}
_CENTERS = ((0.37, 0.58), (0.81, 0.13), (0.12, 0.93))
_OURS, _TWIN, _EXPLICIT = "renderer", "twin", "explicit texture, mip-mapped"
_PAPERS, _FITTED = "the paper's way", "merged umbrellas, fitted"
_PAPERS_K = 8  # umbrellas of a merged cell, as in its fig. 7
_found: dict[str, dict[str, dict[int, tuple[float, float]]]] = {}

Picture = Callable[[np.ndarray, tuple[int, int]], np.ndarray]


def rows(quick: bool) -> Iterator[Row]:
    """Errors by ground, footprint and way."""
    with tempfile.TemporaryDirectory() as name, GLContext() as gl:
        for ground, merged in _grounds(Path(name)):
            system = TextureSystem(gl)
            ways = _ways(gl, system, ground, quick) | {way: _twin(other) for way, other in merged.items()}
            errors = {way: _errors(draw, ground, quick) for way, draw in ways.items()}
            _found[ground.name] = errors
            yield from _error_rows(ground, errors)
            yield _bytes_row(ground, merged)
            system.release()


def curves(quick: bool) -> Iterator[Curve]:  # noqa: ARG001
    """CIEDE2000 over the footprint."""
    for ground, ways in _found.items():
        for way, by_footprint in ways.items():
            yield Curve(
                plot="umbrella_filtering",
                label=f"{ground.partition(':')[0]}, {way}",
                x=[float(footprint) for footprint in by_footprint],
                y=[error for error, _ in by_footprint.values()],
                x_label="pixels per cell",
                y_label="CIEDE2000, mean, against 16 x 16 supersampling",
                x_log=True,
                y_log=True,
                ours=way == _OURS,
            )


def _grounds(folder: Path) -> Iterator[tuple[Ground, dict[str, Ground]]]:
    """Each with the same umbrellas merged in other ways, where those are measured."""
    merged = {
        _PAPERS: merged_leaves_ground(folder / "paper", "paper", _PAPERS_K),
        _FITTED: merged_leaves_ground(folder / "fitted", "fitted", _PAPERS_K),
    }
    yield fall_leaves_ground(folder / "leaves"), merged
    if (real := real_leaves(folder / "real")) is not None:
        yield real, {}


def _ways(gl, system: TextureSystem, ground: Ground, quick: bool) -> dict[str, Picture]:
    def rendered(view: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        return picture(gl, ground.texture, view, size, system)

    return {_OURS: rendered, _TWIN: _twin(ground), _EXPLICIT: ground.explicit(64 if quick else 128).picture}


def _twin(ground: Ground) -> Picture:
    twin = UmbrellaTwin(ground.texture.data, ground.texture.path)

    def draw(view: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
        st = np.stack([x.ravel(), y.ravel()], -1) @ view[:2, :2] + view[2, :2]
        jacobian = np.broadcast_to(view[:2, :2].T, (len(st), 2, 2))
        return twin.sample(st, jacobian).reshape(*size[::-1], 4)

    return draw


def _errors(draw: Picture, ground: Ground, quick: bool) -> dict[int, tuple[float, float]]:
    """Mean CIEDE2000 and PSNR by footprint."""
    result = {}
    for footprint in progress(_FOOTPRINTS, "footprints"):
        pairs = [(draw(view, size), truth) for view, size, truth in _views(ground, footprint, quick)]
        shown, truth = (np.concatenate([pair[n][..., :3] for pair in pairs]) for n in (0, 1))
        result[footprint] = ciede2000(shown, truth), encoded_psnr_db(shown, truth)
    return result


@functools.lru_cache(maxsize=16)
def _views(ground: Ground, footprint: int, quick: bool) -> list[tuple[np.ndarray, tuple[int, int], np.ndarray]]:
    """Pixels to st, size, and what is to be seen; 128 pixels wide, less where pixels are large."""
    side = max(24, min(128, 64 * footprint)) if not quick else max(24, min(96, 32 * footprint))
    size = (side, side)
    views = [turned_view(center, footprint, size, ground.grid) for center in _CENTERS[: 1 if quick else None]]
    return [(view, size, ground.truth.picture(view, size)) for view in views]


def _error_rows(ground: Ground, errors: dict) -> Iterator[Row]:
    for footprint in _FOOTPRINTS:
        limit = errors[_EXPLICIT][footprint][0]
        others = [
            f"{way} {e[footprint][0]:.2f} ({e[footprint][1]:.1f} dB)" for way, e in errors.items() if way != _OURS
        ]
        before = f"beforehand: explicit {_BEFORE[footprint]}, the paper's way {_PAPER.get(footprint, '-')}"
        error, psnr = errors[_OURS][footprint]
        yield Row(
            measure="level-of-detail error",
            setting=f"{ground.name}, {footprint} pixels a cell",
            value=error,
            unit="CIEDE2000, mean",
            target=min(_ASKED.get(footprint, limit), limit),
            comparison="<=",
            reference=", ".join(others),
            note=f"{psnr:.1f} dB; {before}",
        )


def _bytes_row(ground: Ground, merged: dict[str, Ground]) -> Row:
    levels = ", ".join(str(level.level) for level in ground.texture.data.levels)
    return Row(
        measure="data of the levels of detail",
        setting=ground.name,
        value=ground.level_bytes / 1e6,
        unit="MB",
        target=_MEGABYTES,
        comparison="<=",
        reference=", ".join(f"{way} {other.level_bytes / 1e6:.2f} MB" for way, other in merged.items()),
        note=f"{ground.level_file_bytes / 1e6:.2f} MB on disk; from level {levels} on",
    )
