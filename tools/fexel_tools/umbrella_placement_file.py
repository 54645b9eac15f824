"""Where umbrellas are put when the user says so: rows of a CSV file, or the points of a prim on a USD stage.

CSV: one umbrella a row. A first row of names says what the columns hold, in any order: ``x,y`` (or ``s,t``) in texture
coordinates, origin at the lower left, or ``column,row`` in grid cells; then, all optional and empty where the umbrella
is to be left to chance, ``rotation`` in degrees counter-clockwise, ``scale`` as a factor on the range of sizes or
``size`` in cells, ``base`` as a name or a number from 0, and ``layer``: higher ones lie in front, the first row before
later ones of its layer. Without a row of names the columns are ``x,y,rotation,scale,base,layer``.

USD: ``stage.usd:/World/Points``, a Points, a PointInstancer, a Mesh or any other prim with points. They are projected
along the shortest side of their box, as seen from the end of that axis, and the box, widened by one mean spacing, is
fitted to the whole texture. `widths` become sizes, `scales` factors, `orientations` rotations, `protoIndices` bases.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, Usd, UsdGeom

from fexel.errors import FexelError

__all__ = ["GivenPlacement", "read_placement"]

_USD = (".usd", ".usda", ".usdc", ".usdz")
_COLUMNS = ("x", "y", "rotation", "scale", "base", "layer")
_SAME = {"s": "x", "t": "y"}
_PAIRS = (("x", "y"), ("column", "row"))
_KNOWN = ("x", "y", "s", "t", "column", "row", "rotation", "scale", "size", "base", "layer")


@dataclass(frozen=True, eq=False)
class GivenPlacement:
    """Umbrellas as a file places them; NaN, or -1 for a base, where it leaves the choice open.

    Attributes
    ----------
    positions : (n, 2) float64
        Texture coordinates st.
    rotations : (n,) float64
        Degrees, counter-clockwise.
    scales : (n,) float64
        Factor on a size that is drawn.
    sizes : (n,) float64
        Grid cells, in place of a drawn one.
    bases : (n,) int32
    layers : (n,) float64
        Higher ones lie in front; equal or NaN: the first before the later.
    """

    positions: NDArray[np.float64]
    rotations: NDArray[np.float64]
    scales: NDArray[np.float64]
    sizes: NDArray[np.float64]
    bases: NDArray[np.int32]
    layers: NDArray[np.float64]


def read_placement(source: str, grid: tuple[int, int], names: Sequence[str]) -> GivenPlacement:
    """Read a CSV file, or the points of a prim: ``stage.usd:/World/Points``.

    Parameters
    ----------
    source : str
    grid : (int, int)
        Cells along s and t.
    names : sequence of str
        Of the bases.

    Raises
    ------
    FexelError
        File, line or prim that cannot be read, what was found and what was expected.
    """
    file, colon, path = source.rpartition(":/")
    if colon and Path(file).suffix.lower() in _USD:
        return _read_prim(file, "/" + path, grid, len(names))
    if Path(source).suffix.lower() in _USD:
        raise FexelError(f"{source}: no prim is named, expected a stage and a path such as {source}:/World/Points")
    return _read_csv(source, grid, names)


def _read_csv(file: str, grid: tuple[int, int], names: Sequence[str]) -> GivenPlacement:
    lines = _lines(file)
    columns = list(_COLUMNS)
    if lines and not _is_number(lines[0][1][0]):
        columns = _named_columns(file, *lines.pop(0))
    if not lines:
        raise FexelError(f"{file}: no rows, expected one umbrella a row: {','.join(_COLUMNS)}")
    values = {name: np.full(len(lines), np.nan) for name in (*_KNOWN, "base")}
    for i, (line, cells) in enumerate(lines):
        where = f"{file}:{line}"
        if len(cells) > len(columns):
            raise FexelError(f"{where}: {len(cells)} columns, expected at most {len(columns)}: {','.join(columns)}")
        for name, text in zip(columns, cells, strict=False):
            if text:
                values[name][i] = _base(where, text, names) if name == "base" else _number(where, name, text)
    return _from_columns(file, columns, [line for line, _ in lines], values, grid)


def _lines(file: str) -> list[tuple[int, list[str]]]:
    """Number and stripped cells of each line that is neither empty nor a comment."""
    if not Path(file).is_file():
        raise FexelError(
            f"{file}: no such file, expected random, blue-noise, a CSV file of points or a prim such as "
            "stage.usd:/World/Points"
        )
    try:
        with open(file, newline="", encoding="utf-8-sig") as stream:
            reader = csv.reader(stream)
            rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise FexelError(f"{file}: {error}, expected a CSV file of points") from None
    return [(line, cells) for line, cells in rows if any(cells) and not cells[0].startswith("#")]


def _named_columns(file: str, line: int, cells: list[str]) -> list[str]:
    names = [cell.lower() for cell in cells]
    for name in names:
        if name not in _KNOWN:
            raise FexelError(f"{file}:{line}: column '{name}' is unknown, expected some of {', '.join(_KNOWN)}")
    names = [_SAME.get(name, name) for name in names]
    if len(set(names)) < len(names) or sum(set(pair) <= set(names) for pair in _PAIRS) != 1:
        raise FexelError(f"{file}:{line}: columns {','.join(cells)}, expected x,y or column,row, and each name once")
    return names


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _number(where: str, name: str, text: str) -> float:
    value = float(text) if _is_number(text) else math.nan
    if not math.isfinite(value) or (name in ("scale", "size") and value <= 0.0):
        expected = "a positive number" if name in ("scale", "size") else "a finite number"
        raise FexelError(f"{where}: {name} is '{text}', expected {expected}")
    return value


def _base(where: str, text: str, names: Sequence[str]) -> int:
    if text in names:
        return list(names).index(text)
    if not text.isdecimal() or int(text) >= len(names):
        raise FexelError(f"{where}: base is '{text}', expected 0 to {len(names) - 1} or one of {', '.join(names)}")
    return int(text)


def _from_columns(
    file: str, columns: list[str], lines: list[int], values: dict[str, NDArray[np.float64]], grid: tuple[int, int]
) -> GivenPlacement:
    pair = next(pair for pair in _PAIRS if set(pair) <= set(columns))
    positions = np.stack([values[name] for name in pair], axis=1)
    missing = np.flatnonzero(np.isnan(positions).any(axis=1))
    if len(missing):
        raise FexelError(f"{file}:{lines[missing[0]]}: no {' and '.join(pair)}, expected two numbers")
    if pair == ("column", "row"):
        positions = positions / np.asarray(grid, np.float64)
    bases = np.where(np.isnan(values["base"]), -1, values["base"]).astype(np.int32)
    return GivenPlacement(positions, values["rotation"], values["scale"], values["size"], bases, values["layer"])


def _read_prim(file: str, path: str, grid: tuple[int, int], bases: int) -> GivenPlacement:
    stage = _opened(file)  # held: a prim does not keep its stage
    prim = _prim(stage, file, path)
    instancer = UsdGeom.PointInstancer(prim)
    attribute = instancer.GetPositionsAttr() if instancer else UsdGeom.PointBased(prim).GetPointsAttr()
    time = Usd.TimeCode.EarliestTime()
    points = np.asarray(attribute.Get(time) or [], np.float64).reshape(-1, 3)
    where = f"{file}:{path}"
    if not len(points):
        raise FexelError(f"{where}: no {attribute.GetName()}, expected at least one")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise FexelError(
            f"{where}: {attribute.GetName()}[{bad[0]}] is {tuple(points[bad[0]].tolist())}, expected finite"
        )
    axes, signs = _projection(points)
    positions, cells_per_unit = _fitted(points[:, axes] * signs, grid)
    if instancer:
        return _instances(instancer, positions, axes, signs, bases)
    sizes = _per_point(prim.GetAttribute("widths"), len(points)) * cells_per_unit
    return _open_placement(positions, sizes=sizes)


def _opened(file: str) -> Usd.Stage:
    if not Path(file).is_file():
        raise FexelError(f"{file}: no such file")
    try:
        return Usd.Stage.Open(file)
    except Tf.ErrorException:
        raise FexelError(f"{file}: not a USD stage that can be read") from None


def _prim(stage: Usd.Stage, file: str, path: str) -> Usd.Prim:
    prim = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
    if not prim:
        raise FexelError(f"{file}: no prim {path}, expected a Points, PointInstancer or Mesh prim")
    if not (prim.IsA(UsdGeom.PointInstancer) or prim.IsA(UsdGeom.PointBased)):
        found = prim.GetTypeName() or "untyped"
        raise FexelError(f"{file}:{path}: is {found}, expected a Points, PointInstancer or Mesh prim")
    return prim


def _projection(points: NDArray[np.float64]) -> tuple[list[int], NDArray[np.float64]]:
    """Axes that become s and t and their signs: without the shortest side of the box, seen from its positive end."""
    shortest = int(np.argmin(np.ptp(points, axis=0)[::-1]))  # of equal ones z: a cloud is seen from the front
    if shortest == 0:
        return [0, 1], np.array([1.0, 1.0])
    return ([0, 2], np.array([1.0, -1.0])) if shortest == 1 else ([1, 2], np.array([1.0, 1.0]))


def _fitted(flat: NDArray[np.float64], grid: tuple[int, int]) -> tuple[NDArray[np.float64], float]:
    """Points in st, and grid cells per unit of the prim (geometric mean of both axes).

    The box is widened by the spacing h of as many points on a regular lattice, (a + h)(b + h) = n h^2, so that points
    on opposite sides do not meet where the texture repeats.
    """
    low, sides = flat.min(axis=0), np.ptp(flat, axis=0)
    count, total, product = len(flat), float(sides.sum()), float(np.prod(sides))
    spacing = 0.0
    if count > 1:
        spacing = (total + math.sqrt(total * total + 4.0 * (count - 1) * product)) / (2.0 * (count - 1))
    period = np.maximum(sides + spacing, 1e-300)  # 1e-300: a single point, or all in one place
    positions = (flat - low + 0.5 * spacing) / period if spacing > 0.0 else np.full((count, 2), 0.5)
    cells = math.sqrt(grid[0] * grid[1] / float(np.prod(period))) if spacing > 0.0 else math.nan
    return positions, cells


def _per_point(attribute: Usd.Attribute, count: int) -> NDArray[np.float64]:
    """Positive values of an attribute, one for each point or one for all; NaN where there are none."""
    values = np.asarray((attribute.Get(Usd.TimeCode.EarliestTime()) if attribute else None) or [], np.float64)
    if len(values) not in (1, count):
        return np.full(count, np.nan)
    return np.where(np.isfinite(values) & (values > 0.0), values, np.nan) * np.ones(count)


def _instances(
    instancer: UsdGeom.PointInstancer,
    positions: NDArray[np.float64],
    axes: list[int],
    signs: NDArray[np.float64],
    bases: int,
) -> GivenPlacement:
    count, time = len(positions), Usd.TimeCode.EarliestTime()
    scales = np.asarray(instancer.GetScalesAttr().Get(time) or np.ones((count, 3)), np.float64).reshape(-1, 3)
    proto = np.asarray(instancer.GetProtoIndicesAttr().Get(time) or np.full(count, -1), np.int32)
    several = len(instancer.GetPrototypesRel().GetTargets()) > 1 and len(proto) == count
    placed = _open_placement(
        positions,
        scales=np.sqrt(np.abs(np.prod(scales[:, axes], axis=1))) if len(scales) == count else None,
        rotations=_turned(instancer.GetOrientationsAttr().Get(time) or [], count, axes, signs),
        bases=np.where(proto >= 0, proto % bases, -1).astype(np.int32) if several else None,
    )
    mask = instancer.ComputeMaskAtTime(time)
    return _selected(placed, np.asarray(mask, bool)) if len(mask) == count else placed


def _turned(orientations: Sequence, count: int, axes: list[int], signs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Degrees by which each orientation turns the projected s axis."""
    if len(orientations) != count:
        return np.full(count, np.nan)
    wxyz = np.array([(q.GetReal(), *q.GetImaginary()) for q in orientations], np.float64)
    w, xyz = wxyz[:, :1], wxyz[:, 1:]
    axis = np.zeros(3)
    axis[axes[0]] = signs[0]
    across = 2.0 * np.cross(xyz, axis)
    turned = (axis + w * across + np.cross(xyz, across))[:, axes] * signs
    return np.degrees(np.arctan2(turned[:, 1], turned[:, 0]))


def _open_placement(positions: NDArray[np.float64], **given: NDArray | None) -> GivenPlacement:
    free = {name: np.full(len(positions), np.nan) for name in ("rotations", "scales", "sizes", "layers")}
    known = {name: values for name, values in given.items() if values is not None}
    return GivenPlacement(positions, **{"bases": np.full(len(positions), -1, np.int32), **free, **known})


def _selected(placement: GivenPlacement, mask: NDArray[np.bool_]) -> GivenPlacement:
    return GivenPlacement(**{name: values[mask] for name, values in vars(placement).items()})
