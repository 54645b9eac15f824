"""``fexel info``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("info")(_info)


def _info(
    stage: Annotated[Path, typer.Argument(help="USD stage: .usd, .usda, .usdc or .usdz.", show_default=False)],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Show a stage's textures: patches, nesting, umbrellas, resolution gained, bytes on disk and resident.

    Gained: texels per root texel along an axis. Resident: bytes of all mip levels at full resolution, the most that a
    picture can need. Exit status 0 also when images are missing; those are marked.
    """
    from fexel_tools.inspect import inspect_stage

    textures = inspect_stage(stage)
    if as_json:
        import json

        typer.echo(json.dumps([asdict(texture) for texture in textures], indent=1))
        return
    if not textures:
        typer.echo(f"{stage}: no fexel texture")
    for texture in textures:
        _show(texture)


def _show(texture: Any) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    table = Table(title=None, box=None if not console.is_terminal else _box(), pad_edge=False)
    for name in ("patch", "size", "gained", "opacity", "disk", "resident", "file"):
        table.add_column(name, justify="left" if name in ("patch", "file") else "right", no_wrap=True)
    for patch in texture.patches:
        name = "  " * patch.depth + (patch.path.rpartition("/")[2] if patch.depth else texture.path)
        size = f"{patch.width} x {patch.height}" if patch.width else "-"
        gain = f"{patch.gain:.2f}" if patch.gain is not None else "-"
        file = Text(" ".join([patch.file or "-", *_others(patch), *map(_parts, patch.parts)]))
        if patch.problem:
            file.append(f"  ({patch.problem})", style="bold red")
        disk, resident = _bytes(patch.bytes_on_disk), _bytes(patch.bytes_resident)
        table.add_row(Text(name), size, gain, f"{patch.opacity:g}", disk, resident, file)
    if not console.is_terminal:
        console.width = 1000  # a pipe has no width: lines are not broken
    console.print(table)
    for patch in texture.patches:
        if patch.description:
            console.print(Text(f"{patch.path}: {patch.description}"))
    console.print(Text(_summary(texture)))


def _others(patch: Any) -> list[str]:
    """The patch's own files besides the first; those of its parts are summed up."""
    own = {name: size for name, size in patch.others.items() if "." not in name}
    return [f"+ {name} {size[0]} x {size[1]}" if size else f"+ {name}" for name, size in own.items()]


def _parts(parts: Any) -> str:
    """Files of parts of one type."""
    files = f"+ {parts.files} {'file' if parts.files == 1 else 'files'} of {parts.type}"
    if not parts.largest:
        return files
    sizes = [f"{width} x {height}" for width, height in dict.fromkeys((parts.smallest, parts.largest))]
    return f"{files}, {' to '.join(sizes)}, {_bytes(parts.bytes_on_disk)}"


def _summary(texture: Any) -> str:
    size = f" ({texture.fallback_size[0]} x {texture.fallback_size[1]})" if texture.fallback_size else " (missing)"
    return (
        f"{_nesting(texture)}{_bytes(texture.bytes_on_disk)} on disk, "
        f"{_bytes(texture.bytes_resident)} resident at full resolution; "
        f"fallback: {texture.fallback + size if texture.fallback else 'none'}"
    )


def _nesting(texture: Any) -> str:
    """Nothing of a texture without patches whose kind has other things to tell."""
    count = len(texture.patches) - 1
    if not count and texture.patches and texture.patches[0].description:
        return ""
    return (
        f"{count} {'patch' if count == 1 else 'patches'}, nested {texture.depth} deep, "
        f"up to {texture.largest_gain:.2f} times the root's resolution; "
    )


def _box() -> Any:
    from rich import box

    return box.SIMPLE_HEAD


def _bytes(count: int) -> str:
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return f"{count} B"
