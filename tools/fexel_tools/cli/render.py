"""``fexel render``: usdrecord's options, and AOVs, samples, statistics."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("render")(_render)


def _option(*names: str, **settings: Any) -> Any:
    return typer.Option(*names, show_default=False, **settings)


def _render(
    stage: Annotated[Path, typer.Argument(help="USD stage: .usd, .usda, .usdc or .usdz.", show_default=False)],
    image: Annotated[
        str | None,
        typer.Argument(help="Image; for several frames with a placeholder: name.####.exr, name.###.##.png."),
    ] = None,
    camera: Annotated[
        str | None,
        _option("--camera", "-cam", help="Path or name [main_cam, else the first, else one that frames the stage]."),
    ] = None,
    frames: Annotated[
        str | None,
        _option(
            "--frames", "-f", metavar="FRAMESPEC[,...]", help="Time codes: 7, 101:105, 101:109x2 [the start time]."
        ),
    ] = None,
    default_time: Annotated[
        bool, _option("--defaultTime", "-d", help="Render the default time code instead of the start time.")
    ] = False,
    width: Annotated[
        int | None, _option("--imageWidth", "-w", help="Pixels; the height follows from the camera [960].")
    ] = None,
    height: Annotated[int | None, _option("--imageHeight", help="Pixels [from the camera's aspect].")] = None,
    complexity: Annotated[
        str, _option("--complexity", "-c", help="Refinement: low, medium, high or veryhigh [high].")
    ] = "high",
    color: Annotated[
        str | None,
        _option(
            "--colorCorrectionMode",
            "-color",
            help="disabled, sRGB or openColorIO [sRGB; disabled for exr and hdr, which hold linear light].",
        ),
    ] = None,
    purposes: Annotated[
        str, _option("--purposes", metavar="PURPOSE[,...]", help="Besides default: render, proxy, guide [proxy].")
    ] = "proxy",
    mask: Annotated[
        str | None, _option("--mask", metavar="PRIMPATH[,...]", help="Render only these prims and those below them.")
    ] = None,
    session_layer: Annotated[Path | None, _option("--sessionLayer", help="Layer over the stage; never saved.")] = None,
    disable_camera_light: Annotated[
        bool, _option("--disableCameraLight", help="Leave a stage without lights dark (but for emission).")
    ] = False,
    dome_visible: Annotated[
        bool, _option("--enableDomeLightVisibility", help="Show dome lights in the background.")
    ] = False,
    render_settings: Annotated[
        str | None,
        _option("--renderSettingsPrimPath", "-rs", help="RenderSettings prim [the stage's renderSettingsPrimPath]."),
    ] = None,
    aov: Annotated[
        list[str] | None,
        _option(
            "--aov",
            metavar="AOV[,...]",
            help="color, alpha, depth, cameraDepth, normal, Neye, position, st, lod, patch, footprint, fetches, "
            "filter, decision, primId [color].",
        ),
    ] = None,
    samples: Annotated[int, _option("--samples", help="Samples per pixel [4].")] = 4,
    texture_memory: Annotated[
        float, _option("--textureMemory", metavar="MB", help="Budget for textures, of 2^20 bytes [512].")
    ] = 512.0,
    texture_filter: Annotated[
        str | None,
        _option(
            "--filter",
            metavar="FILTER",
            help="Of all textures: mipmap, anisotropic, ripmap, fipmap, ewa or auto [what each prim asks for].",
        ),
    ] = None,
    filter_kernel: Annotated[
        str,
        _option("--filterKernel", metavar="KERNEL", help="What fipmap weights a pixel by: box or gauss [box]."),
    ] = "box",
    fipmap_accesses: Annotated[
        int,
        _option("--fipmapAccesses", metavar="N", help="Bilinear accesses of a fipmap: 4, 6, 8, 12 or 16 [4]."),
    ] = 4,
    anisotropy: Annotated[
        int, _option("--anisotropy", metavar="PROBES", help="Most probes of a lookup, 1 to 16 [8].")
    ] = 8,
    stats: Annotated[
        Path | None, _option("--stats", help="JSON file: what was loaded, bytes, programs, seconds per phase.")
    ] = None,
    list_cameras: Annotated[bool, _option("--list-cameras", help="Print the stage's cameras and stop.")] = False,
) -> None:
    """Render a stage to images, headless.

    EXR files hold all AOVs as channels in linear light; other formats get one file per AOV: name.depth.png.
    """
    from fexel.stage import open_stage

    opened = open_stage(stage, session_layer)
    if list_cameras:
        _print_cameras(opened)
        return
    if image is None:
        raise typer.BadParameter("missing; expected an image file such as name.png", param_hint="IMAGE")
    from fexel.renderer.record import RecordOptions, check_stats_file, record, write_stats

    if stats is not None:
        check_stats_file(stats)

    options = RecordOptions(
        camera=camera,
        frames=frames,
        default_time=default_time,
        width=width,
        height=height,
        aovs=_names(",".join(aov)) if aov else None,
        samples=samples,
        complexity=complexity,
        color_correction=color,
        purposes=_names(purposes),
        mask=_names(mask) if mask is not None else None,
        camera_light=not disable_camera_light,
        dome_visible=dome_visible,
        render_settings=render_settings,
        texture_memory_mb=texture_memory,
        anisotropy=anisotropy,
        filter=texture_filter,
        filter_kernel=filter_kernel,
        fipmap_accesses=fipmap_accesses,
    )
    with _progress() as progress:
        done = record(opened, image, options, progress)
    if stats is not None:
        write_stats(stats, done)


def _names(text: str) -> tuple[str, ...]:
    """Names separated by commas or spaces, as usdrecord takes them."""
    return tuple(text.replace(",", " ").split())


def _print_cameras(stage: Any) -> None:
    from fexel.scene import list_cameras

    for path in list_cameras(stage):
        typer.echo(path)


@contextmanager
def _progress() -> Iterator[Callable[[Path, int, int], None] | None]:
    """A bar on a terminal; nothing on a pipe."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("rendering", total=None)

        def show(file: Path, done: int, total: int) -> None:
            bar.update(task, completed=done, total=total, description=file.name)

        yield show
