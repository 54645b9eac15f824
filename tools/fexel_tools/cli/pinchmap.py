"""``fexel pinchmap``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("pinchmap")(_pinchmap)


def _pinchmap(
    files: Annotated[list[str], typer.Argument(help="SVGs or images of any format and size.", show_default=False)],
    output: Annotated[
        str,
        typer.Option(
            "--output",
            "-o",
            help="Stage to write: .usda, .usdc or .usd. A folder for several files: a stage each, and a contact sheet.",
            show_default=False,
        ),
    ] = "pinchmap.usda",
    size: Annotated[
        str,
        typer.Option(
            "--size", help="Pinchmap texels along the longer side, or auto: the smallest that meets --tolerance."
        ),
    ] = "32",
    tolerance: Annotated[
        float,
        typer.Option("--tolerance", help="For --size auto: largest share of source pixels on the wrong side."),
    ] = 0.0015,
    signal_size: Annotated[
        int,
        typer.Option(
            "--signalSize",
            help="Signal texels along the longer side: --size times a power of two; 0: as --size. "
            "With --size auto, the most.",
        ),
    ] = 0,
    regions: Annotated[
        str,
        typer.Option(
            "--regions",
            help="For images without alpha, and for colours inside a cut-out: auto, a number of colours, or an image "
            "of labels; default: the alpha.",
        ),
    ] = "",
    mask: Annotated[
        str,
        typer.Option(
            "--mask", help="Image that says where the lines are instead of alpha: white is one side, black the other."
        ),
    ] = "",
    normal: Annotated[
        bool, typer.Option("--normal", help="The image is a normal map: stored raw, drives the surface's normal.")
    ] = False,
    raw: Annotated[
        bool,
        typer.Option(
            "--raw", help="The image holds data, stored as it is; drives roughness unless --drives says more."
        ),
    ] = False,
    drives: Annotated[
        str,
        typer.Option(
            "--drives",
            help="Input of the surface that the texture drives: diffuseColor, emissiveColor, normal, roughness, "
            "metallic, occlusion or opacity; default: diffuseColor.",
        ),
    ] = "",
    wrap: Annotated[
        str, typer.Option("--wrap", help="clamp, repeat (an image that tiles) or mirror; s,t for two different ones.")
    ] = "clamp",
    bits: Annotated[
        str, typer.Option("--bits", help="Of the pinchmap: 8, 16 or float. The signal has the image's.")
    ] = "8",
    antialias: Annotated[
        float, typer.Option("--antialias", help="Width of the edges' transition, pixels; 0 is hard.")
    ] = 1.0,
    line_width: Annotated[
        float, typer.Option("--lineWidth", help="Width of a solid line along the edges, pinchmap texels; 0 draws none.")
    ] = 0.0,
    line_color: Annotated[
        str, typer.Option("--lineColor", help="Of that line: r,g,b[,a] (linear) or #rrggbb[aa] (sRGB).")
    ] = "0,0,0,1",
    fallback_size: Annotated[
        int, typer.Option("--fallbackSize", help="Longer side of the picture for other applications, pixels.")
    ] = 512,
    report: Annotated[Path | None, typer.Option("--report", help="Write how well each file fits as JSON.")] = None,
    sheet: Annotated[
        Path | None,
        typer.Option(
            "--sheet", help="Write a PNG: original, result, plain texture of equal bytes, error, faults marked."
        ),
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", "-j", help="Files worked on at a time, processes.")] = 2,
    seed: Annotated[int, typer.Option("--seed", help="Of the search; the same seed gives the same bytes.")] = 0,
) -> None:
    """Make textures with razor-sharp edges from images or SVGs.

    Prints one line per file, and the places where its lines are more than the map can express. Exit status 1 when a
    file cannot be used; of several files the others are made nevertheless.
    """
    from fexel.errors import FexelError
    from fexel_tools.progress import progress_bars

    if normal:
        if drives not in ("", "normal"):
            raise FexelError(f"--normal: drives the normal, but --drives says {drives}")
        drives = "normal"
    options = _options(
        size, tolerance, signal_size, regions, mask, raw, drives, wrap, bits, antialias, line_width, line_color,
        fallback_size, seed,
    )  # fmt: skip
    if len(files) > 1 or output.endswith(("/", "\\")) or Path(output).is_dir():
        _many(files, output, options, report, sheet, jobs)
        return
    if jobs < 1:
        raise FexelError(f"--jobs: {jobs}, expected at least 1")
    from fexel_tools.pinchmap import make_pinchmap

    with progress_bars() as progress:
        item = make_pinchmap(files[0], output, options, report=report, sheet=sheet, progress=progress)
    _tell(item, options, 5)


def _many(files, output, options, report, sheet, jobs) -> None:
    from fexel.errors import FexelError
    from fexel_tools.pinchmap_folder import make_pinchmaps
    from fexel_tools.progress import progress_bars

    if Path(output).suffix.lower() in (".usda", ".usdc", ".usd", ".usdz") and not Path(output).is_dir():
        raise FexelError(
            f"{output}: {len(files)} files make as many stages, expected a folder such as {Path(output).stem}/"
        )
    with progress_bars() as progress:
        result = make_pinchmaps(files, output, options, report=report, sheet=sheet, jobs=jobs, progress=progress)
    for item in result.items:
        _tell(item, options, 3)
    for _, message in result.failed:
        sys.stderr.write(f"fexel: {message}\n")
    if result.failed:
        names = ", ".join(file for file, _ in result.failed)
        raise FexelError(f"{len(result.failed)} of {len(files)} files could not be made: {names}")


def _options(
    size, tolerance, signal_size, regions, mask, raw, drives, wrap, bits, antialias, line_width, line_color,
    fallback_size, seed,
):  # fmt: skip
    from fexel_tools.pinchmap_options import PinchmapOptions, parse_color, parse_size, parse_wrap

    return PinchmapOptions(
        size=parse_size(size),
        tolerance=tolerance,
        signal_size=signal_size,
        regions=regions,
        mask=mask,
        raw=raw,
        drives=drives,
        wrap=parse_wrap(wrap),
        bits=bits,
        antialias=antialias,
        line_width=line_width,
        line_color=parse_color(line_color),
        fallback_size=fallback_size,
        seed=seed,
    )


def _tell(item, options, most_faults) -> None:
    from fexel_tools.pinchmap_report import describe, describe_blur, describe_faults

    typer.echo(describe(item))
    blur = "" if options.regions or options.mask or options.is_data else describe_blur(item)
    if blur:
        typer.echo(blur)
    for line in describe_faults(item.file, item.faults, item.suggested_size, most_faults):
        typer.echo(line)
