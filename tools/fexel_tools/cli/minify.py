"""``fexel minify``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("minify")(_minify)


def _minify(
    stage: Annotated[Path, typer.Argument(help="USD stage: .usd, .usda, .usdc or .usdz.", show_default=False)],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Layer to write: .usda, .usdc or .usd.", show_default=False)
    ],
    token: Annotated[
        str,
        typer.Option(
            "--filter",
            help="mipmap, anisotropic, ripmap or fipmap; auto: for each texture the cheapest of these whose predicted "
            "error is below --bound wherever the stage's cameras see it; default: what the textures have.",
            show_default=False,
        ),
    ] = "",
    bound: Annotated[
        float | None,
        typer.Option(
            "--bound",
            help="Of --filter auto: peak signal-to-noise ratio that is good enough, dB; default: 40.",
            show_default=False,
        ),
    ] = None,
    width: Annotated[
        int, typer.Option("--imageWidth", "-w", help="Of --filter auto: width of the pictures that are meant, pixels.")
    ] = 960,
    contrast: Annotated[
        float | None,
        typer.Option("--contrast", help="Factor on linear values, s in s c + o; 1 is unchanged.", show_default=False),
    ] = None,
    brightness: Annotated[
        float | None,
        typer.Option("--brightness", help="Added to linear values, o in s c + o; 0 is unchanged.", show_default=False),
    ] = None,
    distance: Annotated[
        float | None,
        typer.Option(
            "--attenuationDistance",
            help="Where 1/e of the texture is left, scene units from the camera; inf: no attenuation.",
            show_default=False,
        ),
    ] = None,
    color: Annotated[
        str,
        typer.Option(
            "--attenuationColor",
            help="What it fades to: r,g,b (linear) or #rrggbb (sRGB); default: white.",
            show_default=False,
        ),
    ] = "",
    prim: Annotated[
        list[str] | None, typer.Option("--prim", help="Only textures at or below this prim; repeatable; default: all.")
    ] = None,
    report: Annotated[Path | None, typer.Option("--report", help="Write what became of each texture as JSON.")] = None,
) -> None:
    """Choose how the textures of a stage are filtered where a pixel covers many texels.

    Writes a layer over the stage that applies TextureMinificationAPI to its fexel textures and UsdUVTexture shaders;
    the stage stays as it is. Prints one line per texture.
    """
    from fexel_tools.minify import MinifyOptions, minify
    from fexel_tools.progress import progress_bars

    options = MinifyOptions(
        filter=token or None,
        contrast=contrast,
        brightness=brightness,
        attenuation_distance=distance,
        attenuation_color=_color(color) if color else None,
        prims=tuple(prim or ()),
        width=width,
    )
    options = options if bound is None else replace(options, bound_db=bound)
    with progress_bars() as progress:
        result = minify(stage, output, options, report=report, progress=progress)
    for texture in result.textures:
        about = [texture.filter or "filter as it is", texture.variant and f"variant {texture.variant}", texture.note]
        typer.echo(f"{texture.prim}: {', '.join(filter(None, about))}")
    typer.echo(f"{output}")


def _color(text: str) -> tuple[float, float, float]:
    from fexel.errors import FexelError
    from fexel_tools.pinchmap_options import parse_color

    red, green, blue, alpha = parse_color(text, "--attenuationColor")
    if alpha != 1.0:
        raise FexelError(f"--attenuationColor: '{text}', expected a colour without alpha")
    return red, green, blue
