"""Frames of a stage to image files, in one process: what ``fexel render`` does.

Every image is complete when the next one starts, so that those written stay when the rest is interrupted.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from fexel.errors import FexelError
from fexel.filters import DEFAULT_ACCESSES, DEFAULT_KERNEL
from fexel.renderer.aov import checked_aovs
from fexel.renderer.api import DEFAULT_ANISOTROPY, DEFAULT_TEXTURE_MEMORY_MB, Renderer
from fexel.renderer.encoding import ColorCorrection
from fexel.renderer.frame_spec import FrameRange, frame_path, parse_frames
from fexel.renderer.output import check_output, file_names, write_images
from fexel.renderer.render_settings import RenderTarget, render_targets

if TYPE_CHECKING:
    from pxr import Usd

__all__ = ["DEFAULT_WIDTH_PX", "RecordOptions", "check_stats_file", "record", "write_stats"]

DEFAULT_WIDTH_PX = 960


@dataclass(frozen=True)
class RecordOptions:
    """How to record; the names and meanings are those of usdrecord where it has them.

    None leaves a choice to the stage's render settings, else to the default: the stage's start time, 960 pixels, the
    camera's aspect, ``color``, sRGB (linear for exr and hdr).
    """

    camera: str | None = None
    frames: str | None = None
    default_time: bool = False
    width: int | None = None
    height: int | None = None
    aovs: tuple[str, ...] | None = None
    samples: int = 4
    complexity: str = "high"
    color_correction: str | None = None
    purposes: tuple[str, ...] = ("proxy",)
    mask: tuple[str, ...] | None = None
    camera_light: bool = True
    dome_visible: bool = False
    render_settings: str | None = None
    texture_memory_mb: float = DEFAULT_TEXTURE_MEMORY_MB
    anisotropy: int = DEFAULT_ANISOTROPY
    filter: str | None = None
    filter_kernel: str = DEFAULT_KERNEL
    fipmap_accesses: int = DEFAULT_ACCESSES


@dataclass(frozen=True)
class _Image:
    """One image of one frame."""

    path: str
    time: float | None
    target: RenderTarget


def record(
    stage: Usd.Stage,
    image: str | os.PathLike,
    options: RecordOptions | None = None,
    progress: Callable[[Path, int, int], None] | None = None,
) -> dict[str, Any]:
    """Render frames of a stage to files.

    Parameters
    ----------
    stage : Usd.Stage
    image : path
        With a placeholder such as ``####`` for several frames. The products of render settings are written besides.
    options : RecordOptions, optional
    progress : callable, optional
        Called after each image with its file, the number of images written and of all images.

    Returns
    -------
    dict
        `Renderer.stats`, with ``files`` and the seconds spent writing.

    Raises
    ------
    FexelError
        Before anything is rendered: a bad FrameSpec, image name, AOV or option, an unwritable file. And all that
        `Renderer.render` raises.
    """
    options = options or RecordOptions()
    images = list(_planned(stage, os.fspath(image), options))
    ColorCorrection(options.color_correction or "disabled")
    files: list[Path] = []
    seconds_writing = 0.0
    with Renderer(
        texture_memory_mb=options.texture_memory_mb,
        anisotropy=options.anisotropy,
        filter=options.filter,
        filter_kernel=options.filter_kernel,
        fipmap_accesses=options.fipmap_accesses,
    ) as renderer:
        for number, planned in enumerate(images, start=1):
            arrays = renderer.render(stage, time=planned.time, **_render_options(planned.target, options))
            start = perf_counter()
            written = write_images(planned.path, arrays, options.color_correction)
            seconds_writing += perf_counter() - start
            files += written
            if progress:
                progress(written[0], number, len(images))
        stats = renderer.stats()
    stats.setdefault("seconds", {})["write"] = round(seconds_writing, 6)
    return stats | {"files": [str(file) for file in files]}


def _planned(stage: Usd.Stage, image: str, options: RecordOptions) -> Iterator[_Image]:
    """All images, frame by frame, checked."""
    if options.default_time and options.frames:
        raise FexelError("--defaultTime and --frames exclude each other")
    frames = parse_frames(options.frames) if options.frames else None
    times: Sequence[float | None] = frames or [None if options.default_time else stage.GetStartTimeCode()]
    targets = [_with_options(target, options) for target in render_targets(stage, options.render_settings)]
    patterns = [image, *(target.image for target in targets[1:])]
    seen: set[Path] = set()
    for time in times:
        for pattern, target in zip(patterns, targets, strict=True):
            path = _checked_path(pattern, time, frames, target)
            if path in seen:
                raise FexelError(f"{path}: would be written twice")
            seen.add(path)
            yield _Image(str(path), time, target)


def _checked_path(pattern: str, time: float | None, frames: FrameRange | None, target: RenderTarget) -> Path:
    path = Path(frame_path(pattern, time, frames))
    for file in file_names(path, target.aovs).values():
        check_output(file)
    return path


def _with_options(target: RenderTarget, options: RecordOptions) -> RenderTarget:
    """The target with what the options say instead."""
    aovs = options.aovs or target.aovs or ("color",)
    checked_aovs(aovs)
    width, height = target.width, target.height
    if options.width is not None or options.height is not None:
        width, height = options.width, options.height
    return replace(
        target,
        camera=options.camera or target.camera,
        width=DEFAULT_WIDTH_PX if width is None else width,
        height=height,
        aovs=aovs,
    )


def _render_options(target: RenderTarget, options: RecordOptions) -> dict[str, Any]:
    return {
        "camera": target.camera,
        "width": target.width,
        "height": target.height,
        "aovs": target.aovs,
        "conform_policy": target.conform_policy,
        "pixel_aspect": target.pixel_aspect if target.height is not None else 1.0,
        "samples": options.samples,
        "camera_light": options.camera_light,
        "purposes": options.purposes,
        "mask": options.mask,
        "complexity": options.complexity,
        "dome_visible": options.dome_visible,
    }


def check_stats_file(path: str | os.PathLike) -> None:
    """Find out before rendering whether `write_stats` can write there.

    Raises
    ------
    FexelError
        The folder does not exist, or the path is a folder.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise FexelError(f"{path}: the folder {path.parent} does not exist")
    if path.is_dir():
        raise FexelError(f"{path}: is a folder, expected a JSON file")


def write_stats(path: str | os.PathLike, stats: dict[str, Any]) -> None:
    """Write `stats` as JSON, beside and renamed.

    Raises
    ------
    FexelError
        The file cannot be written.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_text(json.dumps(stats, indent=2) + "\n", encoding="utf-8")
        os.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise FexelError(f"{path}: {error.strerror}") from None
