"""``fexel unwrap``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("unwrap")(_unwrap)


def _unwrap(
    source: Annotated[
        Path, typer.Argument(metavar="INPUT", help="USD stage, or OBJ, GLB, glTF, PLY, STL, OFF.", show_default=False)
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Layer to write: .usda, .usdc or .usd.", show_default=False)
    ],
    primvar: Annotated[str, typer.Option("--primvar", help="Name of the primvar.")] = "st",
    redo: Annotated[bool, typer.Option("--all", help="Also meshes that have texture coordinates.")] = False,
    mesh: Annotated[
        list[str] | None, typer.Option("--mesh", help="Only this mesh, or meshes below this prim; repeatable.")
    ] = None,
    resolution: Annotated[
        int, typer.Option("--resolution", help="Side of the texture that is meant, texels; scales --padding.")
    ] = 1024,
    padding: Annotated[int, typer.Option("--padding", help="Distance between charts, texels.")] = 2,
) -> None:
    """Make texture coordinates for meshes that have none.

    Over a USD stage a layer is written that adds the primvar; of a mesh file a new stage is made. Prints one line per
    mesh. Exit status 1, and nothing written, when the input is missing, damaged, or without a mesh.
    """
    from fexel_tools.progress import progress_bars
    from fexel_tools.unwrap import unwrap

    with progress_bars() as progress:
        results = unwrap(
            source,
            output,
            primvar=primvar,
            redo=redo,
            meshes=mesh or (),
            resolution=resolution,
            padding=padding,
            progress=progress,
        )
    for result in results:
        made = f"{result.chart_count} charts, {result.utilization:.0%} of the texture used"
        typer.echo(f"{result.path}: {result.face_count} faces, {result.note or made}")
    typer.echo(f"{output}")
