"""How the command line spells the options of umbrellas."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fexel.errors import FexelError
from fexel.images import srgb_to_linear
from fexel_tools.umbrella_background import AUTO, NONE
from fexel_tools.umbrella_options import CENTRES, DIVERSIFIED, MOST_CELLS, Color

__all__ = [
    "parse_background",
    "parse_centre",
    "parse_diversify",
    "parse_files",
    "parse_grid",
    "parse_range",
    "parse_vector",
]


def parse_grid(text: str) -> tuple[int, int]:
    """``64x24``: cells along s and t.

    Raises
    ------
    FexelError
        Anything else, or less than one cell.
    """
    match = re.fullmatch(r"\s*(\d+)\s*[xX]\s*(\d+)\s*", text)
    if not match or not (1 <= int(match[1]) <= MOST_CELLS and 1 <= int(match[2]) <= MOST_CELLS):
        raise FexelError(f"--grid: '{text}', expected cells along s and t, 1 to {MOST_CELLS} each, such as 64x24")
    return int(match[1]), int(match[2])


def parse_range(text: str, option: str) -> tuple[float, float]:
    """``lo:hi``, or one number for both.

    Examples
    --------
    >>> parse_range("1.2:2", "--size"), parse_range("0", "--rotation")
    ((1.2, 2.0), (0.0, 0.0))
    """
    parts = _numbers(text.split(":"))
    if len(parts) not in (1, 2) or parts[0] > parts[-1]:
        raise FexelError(f"{option}: '{text}', expected lowest:highest, or one number")
    return parts[0], parts[-1]


def parse_vector(text: str, option: str) -> tuple[float, float]:
    """``dx,dy``.

    Examples
    --------
    >>> parse_vector("0.1,-0.1", "--shadow")
    (0.1, -0.1)
    """
    parts = _numbers(text.split(","))
    if len(parts) != 2:
        raise FexelError(f"{option}: '{text}', expected two numbers with a comma between them")
    return parts[0], parts[1]


def parse_background(text: str) -> str | Color:
    """``auto``, ``none``, ``#rrggbb`` (sRGB-encoded), or a file as it is."""
    if match := re.fullmatch(r"#([0-9a-fA-F]{6})", text.strip()):
        encoded = np.array(list(bytes.fromhex(match[1])), np.float32) / np.float32(255)
        red, green, blue = (float(v) for v in srgb_to_linear(encoded))
        return red, green, blue, 1.0
    if text.strip().startswith("#") and not Path(text).exists():
        raise FexelError(f"--background: '{text}', expected #rrggbb, an image, {AUTO} or {NONE}")
    return text.strip().lower() if text.strip().lower() in (AUTO, NONE) else text


def parse_centre(text: str) -> str:
    """``auto``, ``centroid``, ``veins``, or ``x,y``.

    Raises
    ------
    FexelError
        Anything else.
    """
    if text in CENTRES:
        return text
    if len(_numbers(text.split(","))) != 2:
        raise FexelError(f"--centre: '{text}', expected {', '.join(CENTRES)}, or x,y in pixels of the photo")
    return text


def parse_diversify(text: str) -> tuple[str, ...]:
    """``color,shape``, one of them, or ``none``.

    Examples
    --------
    >>> parse_diversify("shape,color"), parse_diversify("none")
    (('color', 'shape'), ())
    """
    chosen = {part.strip() for part in text.split(",")}
    if chosen == {NONE}:
        return ()
    if not chosen <= set(DIVERSIFIED):
        raise FexelError(f"--diversify: '{text}', expected {','.join(DIVERSIFIED)}, one of them, or {NONE}")
    return tuple(name for name in DIVERSIFIED if name in chosen)


def parse_files(given: Sequence[str]) -> tuple[str, ...]:
    """Files as they are; the files of folders, sorted; those of a list with commas.

    Raises
    ------
    FexelError
        A folder without a file.
    """
    files: list[str] = []
    for entry in given:
        for name in [entry] if Path(entry).exists() else entry.split(","):
            if Path(name).is_dir():
                inside = sorted(str(path) for path in Path(name).iterdir() if path.is_file())
                if not inside:
                    raise FexelError(f"{name}: the folder has no file, expected images")
                files += inside
            else:
                files.append(name.strip())
    return tuple(files)


def _numbers(parts: list[str]) -> list[float]:
    """Finite numbers; none at all where one of them is not."""
    try:
        values = [float(part) for part in parts]
    except ValueError:
        return []
    return values if np.isfinite(values).all() else []
