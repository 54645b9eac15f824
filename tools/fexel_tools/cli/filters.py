"""``fexel filters``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("filters")(_filters)


def _filters(
    files: Annotated[list[str], typer.Argument(help="Images of any format.", show_default=False)],
    sheet: Annotated[
        Path | None, typer.Option("--sheet", help="Write a PNG: the truth, each filter, and error maps.")
    ] = None,
    report: Annotated[Path | None, typer.Option("--report", help="Write all figures as JSON.")] = None,
    elevations: Annotated[
        str, typer.Option("--elevations", help="Degrees above the surface, 0.05 to 90.")
    ] = "90,45,20,10,5,2,1",
    azimuths: Annotated[
        str, typer.Option("--azimuths", help="Degrees by which the view is turned in the image.")
    ] = "0,30,60",
    filters: Annotated[
        str, typer.Option("--filters", help="Which to compare.")
    ] = "mipmap,anisotropic,ripmap,fipmap,ewa,auto,fipmap-gauss",
    size: Annotated[int, typer.Option("--size", help="Side of a picture, pixels, 16 to 512.")] = 128,
    texels: Annotated[
        int, typer.Option("--texels", help="Of larger images the middle is taken: most texels a side, 16 to 8192.")
    ] = 1024,
    wrap: Annotated[
        str, typer.Option("--wrap", help="Beyond the border of an image: repeat, mirror, clamp or black.")
    ] = "repeat",
    anisotropy: Annotated[float, typer.Option("--anisotropy", help="Most probes of anisotropic, 1 to 64.")] = 16.0,
    raw: Annotated[bool, typer.Option("--raw", help="The images hold data: compared as they are stored.")] = False,
    normal_map: Annotated[
        bool, typer.Option("--normal-map", "--normalMap", help="The images are normal maps: raw, renormalised.")
    ] = False,
) -> None:
    """Compare minification filters on images: a fan of views, error against the truth, cost and memory.

    Prints the mean error of each filter by elevation, dB, against the mean over each pixel's footprint.
    """
    from fexel_tools.filter_report import FilterOptions, compare_filters, summary
    from fexel_tools.progress import progress_bars

    options = FilterOptions(
        elevations=_numbers(elevations, "--elevations"),
        azimuths=_numbers(azimuths, "--azimuths"),
        filters=tuple(dict.fromkeys(token.strip() for token in filters.split(",") if token.strip())),
        pixels=size,
        texels=texels,
        wrap=wrap,
        anisotropy=anisotropy,
        raw=raw,
        normal_map=normal_map,
    )
    with progress_bars() as progress:
        result = compare_filters(files, options, sheet=sheet, report=report, progress=progress)
    for line in summary(result):
        typer.echo(line)


def _numbers(text: str, option: str) -> tuple[float, ...]:
    from fexel.errors import FexelError

    try:
        return tuple(dict.fromkeys(float(part) for part in text.split(",") if part.strip()))
    except ValueError:
        raise FexelError(f"{option}: '{text}', expected numbers with commas between, degrees") from None
