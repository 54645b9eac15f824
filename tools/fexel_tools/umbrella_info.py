"""What `fexel info` tells of an umbrella texture besides its files."""

from __future__ import annotations

from pxr import Usd

import fexel

__all__ = ["describe", "facts"]


def facts(prim: Usd.Prim) -> dict[str, object]:
    """Numbers of an UmbrellaTexture.

    Parameters
    ----------
    prim : Usd.Prim

    Returns
    -------
    dict
        ``umbrellas``, ``bases``: how many; ``vertices``: most of a base, its centre included; ``grid``: cells along s
        and t; ``levels``: of each coarser level ``level``, ``grid``, and ``umbrellas``, None where it is an image.
    """
    texture = fexel.UmbrellaTexture(prim)
    patches = texture.GetPatches()
    levels = sorted(texture.GetLevels(), key=lambda level: _number(level.GetLevelAttr().Get()))
    return {
        "umbrellas": _length(texture.GetPatchIndicesAttr()),
        "bases": len(patches),
        "vertices": max((_length(patch.GetPointsAttr()) for patch in patches), default=0),
        "grid": _cells(texture.GetGridAttr()),
        "levels": [
            {
                "level": _number(level.GetLevelAttr().Get()),
                "grid": _cells(level.GetGridAttr()),
                "umbrellas": None if _names_file(level) else _length(level.GetPatchIndicesAttr()),
            }
            for level in levels
        ],
    }


def describe(found: dict) -> str:
    """A line for people.

    Examples
    --------
    >>> describe({"umbrellas": 6100, "bases": 9, "vertices": 63, "grid": [64, 24], "levels": []})
    '6100 umbrellas of 9 bases with up to 63 vertices, grid 64 x 24, no coarser level'
    """
    grid = f"grid {found['grid'][0]} x {found['grid'][1]}"
    bases = f"{_counted(found['bases'], 'base')} with up to {found['vertices']} vertices"
    levels = [_level(level) for level in found["levels"]]
    detail = f"coarser levels: {', '.join(levels)}" if levels else "no coarser level"
    return f"{_counted(found['umbrellas'], 'umbrella')} of {bases}, {grid}, {detail}"


def _level(level: dict) -> str:
    what = "image" if level["umbrellas"] is None else _counted(level["umbrellas"], "umbrella")
    return f"{level['level']} ({what}, grid {level['grid'][0]} x {level['grid'][1]})"


def _counted(count: int, name: str) -> str:
    return f"{count} {name}" if count == 1 else f"{count} {name}s"


def _length(attribute: Usd.Attribute) -> int:
    value = attribute.Get() if attribute else None
    return 0 if value is None else len(value)


def _cells(attribute: Usd.Attribute) -> list[int]:
    value = attribute.Get() if attribute else None
    return [1, 1] if value is None else [int(value[0]), int(value[1])]


def _number(value: int | None) -> int:
    return 0 if value is None else int(value)


def _names_file(level: fexel.UmbrellaLevel) -> bool:
    value = level.GetFileAttr().Get()
    return bool(value and value.path)
