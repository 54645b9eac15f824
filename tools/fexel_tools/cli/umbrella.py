"""``fexel umbrella``."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("umbrella")(_umbrella)


def _umbrella(
    files: Annotated[
        list[str],
        typer.Argument(help="Cut-outs, objects on a plain ground, or photos of many elements.", show_default=False),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Stage to write: .usda, .usdc or .usd.", show_default=False)
    ] = Path("umbrella.usda"),
    grid: Annotated[
        str, typer.Option("--grid", metavar="WxH", help="Cells along s and t: how large the ground is.")
    ] = "64x36",
    count: Annotated[
        int | None,
        typer.Option("--count", help="Umbrellas; default: as many as --layers asks for.", show_default=False),
    ] = None,
    layers: Annotated[
        float, typer.Option("--layers", help="Mean number of umbrellas over a point, where there is no --count.")
    ] = 3.0,
    background: Annotated[
        str,
        typer.Option(
            "--background",
            metavar="FILE|#rrggbb|none",
            help="Image, colour (sRGB), or none: transparent; default: the ground in a photo of many, else the "
            "elements' mean colour in the shade.",
            show_default=False,
        ),
    ] = "auto",
    background_size: Annotated[
        float,
        typer.Option(
            "--background-size",
            "--backgroundSize",
            help="Texels of the background's picture on a side of a cell; it repeats at its own resolution.",
        ),
    ] = 32.0,
    seed: Annotated[int, typer.Option("--seed", help="The same seed gives the same bytes.")] = 0,
    kind: Annotated[
        str, typer.Option("--kind", help="What the files are: auto, cutout (alpha), object (plain ground) or many.")
    ] = "auto",
    vertices: Annotated[int, typer.Option("--vertices", help="Most vertices of an element, its centre included.")] = 63,
    tolerance: Annotated[
        float, typer.Option("--tolerance", help="How far a contour may be off, pixels of the photo.")
    ] = 1.0,
    centre: Annotated[
        str,
        typer.Option(
            "--centre",
            "--center",
            help="Where an element's vertices are seen from: auto, centroid, veins (where they converge), or x,y in "
            "pixels of the photo.",
        ),
    ] = "auto",
    hints: Annotated[
        str,
        typer.Option(
            "--hints",
            help="CSV (file,x,y) or JSON ({file: [x, y]}) with the centre of each element, pixels of its photo.",
        ),
    ] = "",
    diversify: Annotated[
        str, typer.Option("--diversify", help="What varies: color,shape, one of them, or none.")
    ] = "color,shape",
    references: Annotated[
        list[str] | None,
        typer.Option(
            "--references",
            help="Image of elements whose colours are taken, or a folder of such; repeat it for several; default: each "
            "other's, of those alike.",
            show_default=False,
        ),
    ] = None,
    color_blend: Annotated[
        float, typer.Option("--color-blend", "--colorBlend", help="How much colours vary, factor 0 to 1.")
    ] = 1.0,
    morph: Annotated[
        float, typer.Option("--morph", help="How far shapes go towards another element's at most, weight 0 to 1.")
    ] = 0.6,
    arrangement: Annotated[
        str,
        typer.Option(
            "--arrangement",
            metavar="random|blue-noise|FILE.csv|STAGE:/PRIM",
            help="Where umbrellas lie: random, blue-noise (evenly spread), a table, or points of a prim.",
        ),
    ] = "random",
    order: Annotated[
        str,
        typer.Option(
            "--order",
            help="In front: random, size (small ones), given (first rows); auto is given for a file, else random.",
        ),
    ] = "auto",
    size: Annotated[
        str, typer.Option("--size", metavar="LO:HI", help="Longer side of the largest element, cells of the grid.")
    ] = "1.2:2",
    rotation: Annotated[str, typer.Option("--rotation", metavar="LO:HI", help="Degrees, counter-clockwise.")] = "0:360",
    levels: Annotated[
        str,
        typer.Option("--levels", help="Of detail: image (prefiltered), merged (umbrellas, as in the paper) or none."),
    ] = "image",
    shadow: Annotated[
        str, typer.Option("--shadow", metavar="DX,DY", help="Where shadows fall, cells of the grid along s and t.")
    ] = "0.06,-0.08",
    shadow_strength: Annotated[
        float, typer.Option("--shadow-strength", "--shadowStrength", help="Share of light they take, 0 to 1.")
    ] = 0.4,
    texture_size: Annotated[
        int,
        typer.Option("--texture-size", "--textureSize", help="Longer side of an element's texture, texels at most."),
    ] = 256,
    raw: Annotated[
        bool,
        typer.Option("--raw", help="The files hold data, stored as it is; drives roughness unless --drives says more."),
    ] = False,
    drives: Annotated[
        str,
        typer.Option(
            "--drives",
            help="Input of the surface: diffuseColor, emissiveColor, normal, roughness, metallic, occlusion or "
            "opacity; default: diffuseColor.",
        ),
    ] = "",
    normal_maps: Annotated[
        str,
        typer.Option(
            "--normal-maps", help="Folder with a normal map for each file, of its size: FILE.png or FILE_normal.png."
        ),
    ] = "",
    roughness_maps: Annotated[
        str,
        typer.Option(
            "--roughness-maps",
            help="Folder with a roughness map for each file, of its size: FILE.png or FILE_roughness.png.",
        ),
    ] = "",
    fallback_size: Annotated[
        int,
        typer.Option(
            "--fallback-size", "--fallbackSize", help="Longer side of the picture for other applications, pixels."
        ),
    ] = 2048,
    report: Annotated[
        Path | None, typer.Option("--report", help="Write sizes, eqs. (2) and (3), and times as JSON.")
    ] = None,
    sheet: Annotated[
        Path | None, typer.Option("--sheet", help="Write a PNG: elements, how they vary, and the arrangement.")
    ] = None,
    jobs: Annotated[
        int | None, typer.Option("--jobs", "-j", help="Threads; default: one per core.", show_default=False)
    ] = None,
) -> None:
    """Make a large ground that never repeats from a few photographed elements: leaves, berries, pebbles.

    Prints what the ground holds, and what of the photos was left out. Exit status 1, and nothing written, when no file
    has a usable element.
    """
    from fexel_tools import umbrella_spelling as spelled
    from fexel_tools.progress import progress_bars
    from fexel_tools.umbrella import make_umbrella
    from fexel_tools.umbrella_companions import without_maps
    from fexel_tools.umbrella_options import UmbrellaOptions
    from fexel_tools.umbrella_report import describe, describe_dropped

    options = UmbrellaOptions(
        grid=spelled.parse_grid(grid),
        count=count,
        layers=layers,
        background=spelled.parse_background(background),
        background_size=background_size,
        seed=seed,
        kind=kind,
        vertices=vertices,
        tolerance=tolerance,
        centre=spelled.parse_centre(centre),
        hints=hints,
        diversify=spelled.parse_diversify(diversify),
        references=spelled.parse_files(references or []),
        color_blend=color_blend,
        morph=morph,
        arrangement=arrangement,
        order=order,
        size=spelled.parse_range(size, "--size"),
        rotation=spelled.parse_range(rotation, "--rotation"),
        levels=levels,
        shadow=spelled.parse_vector(shadow, "--shadow"),
        shadow_strength=shadow_strength,
        texture_size=texture_size,
        raw=raw,
        drives=drives,
        normal_maps=normal_maps,
        roughness_maps=roughness_maps,
        fallback_size=fallback_size,
        jobs=(os.cpu_count() or 1) if jobs is None else jobs,
    )
    with progress_bars() as progress:
        made = make_umbrella(
            without_maps(files, options), output, options, report=report, sheet=sheet, progress=progress
        )
    for line in describe_dropped(made.dropped, 3):
        sys.stderr.write(f"fexel: warning: {line}\n")
    typer.echo(describe(made))
