"""``fexel zipmap``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

__all__ = ["register"]


_NOT_PLACED = ("root", "report", "max_error", "min_gain")  # options that are about unordered photos
_NOT_OVER_A_STAGE = ("primitive", "mesh")  # a stage with placed patches has its own surfaces


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("zipmap")(_zipmap)


def _zipmap(
    context: typer.Context,
    photos: Annotated[
        list[str] | None, typer.Argument(help="Photos of one surface, in any order, of any format.", show_default=False)
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Stage to write: .usda, .usdc or .usd.", show_default=False)
    ] = Path("zipmap.usda"),
    root: Annotated[str, typer.Option("--root", help="Photo that shows the whole; default: chosen.")] = "",
    report: Annotated[Path | None, typer.Option("--report", help="Write what became of each photo as JSON.")] = None,
    max_error: Annotated[
        float,
        typer.Option("--max-error", help="Reject photos with a larger residual, pixels of the coarser photo."),
    ] = 8.0,
    tau: Annotated[
        float | None,
        typer.Option("--tau", help="Threshold of the blend mask, accumulated gradient; default: automatic."),
    ] = None,
    fallback_size: Annotated[
        int, typer.Option("--fallbackSize", help="Longer side of the picture for other applications, pixels.")
    ] = 2048,
    primitive: Annotated[
        str, typer.Option("--primitive", help="Surface to put it on: quad, sphere or cylinder.")
    ] = "quad",
    mesh: Annotated[
        str, typer.Option("--mesh", help="Mesh with texture coordinates to put it on instead: USD, OBJ, GLB, PLY.")
    ] = "",
    place: Annotated[
        str, typer.Option("--place", help="Hand-made layout instead of photos: YAML, or a stage with placed patches.")
    ] = "",
    bits: Annotated[int, typer.Option("--bits", help="Bits of the textures, 8 or 16; default: as the photo.")] = 0,
    min_gain: Annotated[
        float, typer.Option("--min-gain", help="Least gain in resolution that makes a photo a patch, ratio.")
    ] = 1.2,
    keep_colors: Annotated[bool, typer.Option("--keep-colors", help="Leave colours as photographed.")] = False,
    jobs: Annotated[int, typer.Option("--jobs", "-j", help="Threads.")] = 2,
) -> None:
    """Make a zipmap stage from photos of one surface taken at different zoom.

    Prints one line per photo: its parent and scale, or why it was rejected. Exit status 0 as long as one photo is
    usable; 1, and nothing written, when a file is missing, an option is wrong or no photo is usable.
    """
    from fexel.errors import FexelError
    from fexel_tools.progress import progress_bars

    if bool(photos) == bool(place):
        raise FexelError("expected photos or --place LAYOUT" + (", not both" if photos else ""))
    if place:
        _refuse_unused(context, place)
    options = _options(root, max_error, tau, fallback_size, primitive, mesh, bits, jobs, min_gain, not keep_colors)
    with progress_bars() as progress:
        if place:
            from fexel_tools.layout import place_zipmap

            place_zipmap(place, output, options, progress=progress)
            return
        from fexel_tools.zipmap import make_zipmap

        result = make_zipmap(photos or [], output, options, report=report, progress=progress)
    for photo in result.photos:
        _tell(photo)


def _refuse_unused(context: typer.Context, place: str) -> None:
    """An option that was given but would change nothing is an error."""
    from fexel.errors import FexelError

    of_yaml = Path(place).suffix.lower() in (".yaml", ".yml")
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if source is None or source.name != "COMMANDLINE":
            continue
        if parameter.name in _NOT_PLACED:
            raise FexelError(f"{parameter.opts[0]}: does not apply to --place, which takes every patch as it is placed")
        if parameter.name in _NOT_OVER_A_STAGE and not of_yaml:
            raise FexelError(f"{parameter.opts[0]}: does not apply to --place {place}, which has its own surfaces")


def _options(root, max_error, tau, fallback_size, primitive, mesh, bits, jobs, min_gain, match_colors):
    from fexel_tools.authoring import ZipmapOptions

    return ZipmapOptions(
        root=root,
        max_error_px=max_error,
        tau=tau,
        fallback_size=fallback_size,
        primitive=primitive,
        mesh=mesh,
        bits=bits,
        jobs=jobs,
        min_gain=min_gain,
        match_colors=match_colors,
    )


def _tell(photo) -> None:
    if photo.status == "rejected":
        sys.stderr.write(f"fexel: warning: {photo.file}: rejected: {photo.reason}\n")
    elif photo.status == "root":
        typer.echo(f"{photo.file}: root")
    else:
        typer.echo(f"{photo.file}: patch of {photo.parent}, scale {photo.scale:.2f}, residual {photo.rms_px:.2f} px")
