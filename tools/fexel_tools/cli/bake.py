"""``fexel bake``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("bake")(_bake)


def _bake(
    stage: Annotated[Path, typer.Argument(help="USD stage: .usd, .usda, .usdc or .usdz.", show_default=False)],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Stage to write: .usda, .usdc or .usd with a folder of images beside it, or .usdz.",
            show_default=False,
        ),
    ],
    size: Annotated[
        int | None,
        typer.Option(
            "--size",
            help="Longer side of each baked picture, pixels; default: as fine as the texture, at most 8192.",
            show_default=False,
        ),
    ] = None,
    prim: Annotated[
        str, typer.Option("--prim", help="Bake only textures at or below this prim; default: all.", show_default=False)
    ] = "",
    image_format: Annotated[
        str,
        typer.Option(
            "--format",
            help="Of the pictures: png, exr, tif or jpg; default: png, and exr for floating-point textures.",
            show_default=False,
        ),
    ] = "",
    time: Annotated[
        float | None,
        typer.Option(
            "--time", help="Time code to bake, frames; default: the first of a texture that varies.", show_default=False
        ),
    ] = None,
) -> None:
    """Turn every fexel texture of a stage into an explicit one that any application reads.

    Standard prims only; cameras, meshes, lights and all else stay. Prints one line per texture.
    """
    from fexel_tools.bake import bake_stage
    from fexel_tools.progress import progress_bars

    with progress_bars() as progress:
        baked = bake_stage(stage, output, size=size, prim=prim, image_format=image_format, time=time, progress=progress)
    for texture in baked:
        width, height = texture.size
        typer.echo(f"{texture.prim}: {texture.file}, {width} x {height} pixels, {texture.nbytes} bytes")
