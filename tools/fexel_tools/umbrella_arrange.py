"""Arrangements: which base umbrella lies where, how large, how turned, how far morphed, and what lies in front.

Section 4.4 of the paper chooses all of these at random on a grid; here places may also be blue noise or given
(`umbrella_placement`, `umbrella_placement_file`). The texture repeats, so places lie on a torus: as many umbrellas come
in at one side as leave at the other. Every choice has a random stream of its own (PCG64, by the seed and the name of
the choice), so that another range of rotations moves no umbrella; no result depends on threads or the platform.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel.textures.umbrella_entries import MOST_PERIODS, Outline, periods_spanned
from fexel.textures.umbrella_geometry import signed_area
from fexel_tools.umbrella_placement import blue_noise_points, random_points
from fexel_tools.umbrella_placement_file import GivenPlacement, read_placement

__all__ = ["ORDERS", "ArrangeOptions", "PlacedUmbrellas", "arrange", "check_arrange_options", "random_stream"]

ORDERS = ("auto", "random", "size", "given")
_CHANCE = ("random", "blue-noise")  # placements; others are files
_MOST = 1_000_000  # umbrellas; more is a slip of the hand in the options


class PlacedShape(Outline, Protocol):
    """What `arrange` needs of a base: `BaseUmbrella`, or `Shape` with a name."""

    @property
    def name(self) -> str:
        """Of the base, as a CSV file of points may call it."""
        ...


@dataclass(frozen=True)
class ArrangeOptions:
    """How umbrellas are strewn.

    Attributes
    ----------
    grid : (int, int)
        Cells along s and t; cells are square on the surface.
    count : int or None
        Umbrellas. None: as many as `layers` asks for.
    layers : float
        Mean number of umbrellas over a point, where `count` is None.
    placement : str
        ``random``, ``blue-noise``, a CSV file or a prim of a stage (``stage.usd:/World/Points``).
    size : (float, float)
        Grid cells: range of the longer side of an element of patch size 1, uniform.
    rotation : (float, float)
        Degrees, counter-clockwise: range, uniform.
    morph : (float, float)
        Range of the morph weight, within [0, 1], uniform.
    weights : tuple of float
        How often each base is taken, relative to the others; empty: all as often.
    order : str
        What lies in front: ``random``, ``size`` (smaller ones), ``given`` (first rows of a file) or ``auto``: as given
        by a file, else random. Layers of a file decide before any of these.
    seed : int
    """

    grid: tuple[int, int] = (16, 16)
    count: int | None = None
    layers: float = 3.0
    placement: str = "random"
    size: tuple[float, float] = (1.2, 2.0)
    rotation: tuple[float, float] = (0.0, 360.0)
    morph: tuple[float, float] = (0.0, 1.0)
    weights: tuple[float, ...] = ()
    order: str = "auto"
    seed: int = 0


class PlacedUmbrellas(NamedTuple):
    """Modified umbrellas, front to back, as `Arrangement` holds them.

    Attributes
    ----------
    shape_of : (n,) int32
    matrices : (n, 3, 3) float64
        Patch space to st, row vectors.
    morphs : (n,) float64
    """

    shape_of: NDArray[np.int32]
    matrices: NDArray[np.float64]
    morphs: NDArray[np.float64]


def arrange(bases: Sequence[PlacedShape], options: ArrangeOptions) -> PlacedUmbrellas:
    """Strew bases over the unit square of st.

    Raises
    ------
    FexelError
        Options out of range, a file of points that cannot be read, or umbrellas larger than a stage may hold.
    """
    check_arrange_options(options, len(bases))
    given = _given(bases, options)
    count = _count(bases, options) if given is None else len(given.positions)
    shape_of = _shapes(count, len(bases), options, given)
    sizes = _drawn(count, options.size, options, "size")
    rotations = _drawn(count, options.rotation, options, "rotation")
    morphs = _drawn(count, options.morph, options, "morph")
    if given is None:
        positions = _points(count, options) / np.asarray(options.grid, np.float64)
    else:
        positions = given.positions
        sizes = np.where(np.isnan(given.sizes), sizes * np.nan_to_num(given.scales, nan=1.0), given.sizes)
        rotations = np.where(np.isnan(given.rotations), rotations, given.rotations)
    order = _order(bases, shape_of, sizes, options, given)
    matrices = _matrices(positions - np.floor(positions), sizes, np.radians(rotations), options.grid)
    _check_sizes(bases, shape_of, matrices, sizes, options)
    return PlacedUmbrellas(shape_of[order], matrices[order], morphs[order])


def random_stream(seed: int, choice: str) -> np.random.Generator:
    """Generator of one kind of choice, independent of those of other names."""
    return np.random.Generator(np.random.PCG64([seed, zlib.crc32(choice.encode())]))


def check_arrange_options(options: ArrangeOptions, bases: int) -> None:
    """Refuse what cannot be strewn.

    Raises
    ------
    FexelError
        Names the option, what was found and what was expected.
    """
    lowest, highest = options.size
    weights = options.weights
    faults = (
        (bases < 1, "no base umbrellas, expected at least one"),
        (min(options.grid) < 1, f"--grid: {options.grid[0]}x{options.grid[1]}, expected cells >= 1"),
        (options.seed < 0, f"--seed: {options.seed}, expected a number >= 0"),
        (
            options.count is not None and not 0 <= options.count <= _MOST,
            f"--count: {options.count}, expected 0 to {_MOST}",
        ),
        (not 0.0 < options.layers < math.inf, f"--layers: {options.layers:g}, expected a number > 0"),
        (not 0.0 < lowest <= highest < math.inf, f"--size: {lowest:g},{highest:g}, expected 0 < smallest <= largest"),
        (not np.isfinite(options.rotation).all(), f"--rotation: {options.rotation}, expected degrees"),
        (
            not 0.0 <= options.morph[0] <= options.morph[1] <= 1.0,
            f"--morph: {options.morph}, expected 0 <= low <= high <= 1",
        ),
        (
            bool(weights) and (len(weights) != bases or not np.isfinite(weights).all() or min(weights) < 0.0),
            f"--weights: {','.join(f'{w:g}' for w in weights)}, expected {bases} numbers >= 0, one per base",
        ),
        (bool(weights) and not sum(weights) > 0.0, "--weights: all are 0, expected at least one > 0"),
        (options.order not in ORDERS, f"--order: '{options.order}' is unknown, expected one of {', '.join(ORDERS)}"),
    )
    for faulty, message in faults:
        if faulty:
            raise FexelError(message)


def _given(bases: Sequence[PlacedShape], options: ArrangeOptions) -> GivenPlacement | None:
    if options.placement in _CHANCE:
        return None
    given = read_placement(options.placement, options.grid, [base.name for base in bases])
    found = len(given.positions)
    if options.count is not None and options.count != found:
        raise FexelError(f"--count: {options.count}, but {options.placement} has {found} points, expected no count")
    return given


def _count(bases: Sequence[PlacedShape], options: ArrangeOptions) -> int:
    """Umbrellas for the mean number of layers: mean area of a base times the mean square of the size."""
    if options.count is not None:
        return options.count
    shares = np.asarray(options.weights or np.ones(len(bases)), np.float64)
    area = float(np.average([abs(signed_area(base.points[1:])) for base in bases], weights=shares))
    low, high = options.size
    mean_square = (low * low + low * high + high * high) / 3.0
    wanted = options.layers * options.grid[0] * options.grid[1] / max(area * mean_square, 1e-300)  # 1e-300: no area
    if wanted > _MOST:
        raise FexelError(
            f"--layers: {options.layers:g} of size {low:g},{high:g} take {wanted:.0f} umbrellas, expected at most "
            f"{_MOST}: larger ones, or a --count"
        )
    return max(1, round(wanted))


def _shapes(count: int, bases: int, options: ArrangeOptions, given: GivenPlacement | None) -> NDArray[np.int32]:
    """Bases as often as their weights say, to within one, in random order."""
    shares = np.asarray(options.weights or np.ones(bases), np.float64)
    bounds = np.rint(np.cumsum(shares) / shares.sum() * count).astype(np.int64)
    shape_of = random_stream(options.seed, "base").permutation(np.searchsorted(bounds, np.arange(count), side="right"))
    if given is not None:
        shape_of = np.where(given.bases >= 0, given.bases, shape_of)
    return shape_of.astype(np.int32)


def _drawn(count: int, limits: tuple[float, float], options: ArrangeOptions, choice: str) -> NDArray[np.float64]:
    return limits[0] + (limits[1] - limits[0]) * random_stream(options.seed, choice).random(count)


def _points(count: int, options: ArrangeOptions) -> NDArray[np.float64]:
    put = random_points if options.placement == "random" else blue_noise_points
    return put(count, options.grid, random_stream(options.seed, "place"))


def _order(
    bases: Sequence[PlacedShape],
    shape_of: NDArray[np.int32],
    sizes: NDArray[np.float64],
    options: ArrangeOptions,
    given: GivenPlacement | None,
) -> NDArray[np.int64]:
    """Indices front to back."""
    count = len(shape_of)
    within = random_stream(options.seed, "order").permutation(count)
    if options.order == "size":
        areas = np.array([abs(signed_area(base.points[1:])) for base in bases])
        within = np.argsort(areas[shape_of] * sizes**2, kind="stable")
    elif options.order == "given" or (options.order == "auto" and given is not None):
        within = np.arange(count)
    if given is None or np.isnan(given.layers).all():
        return within
    layers = np.nan_to_num(given.layers, nan=0.0)
    return within[np.argsort(-layers[within], kind="stable")]


def _check_sizes(
    bases: Sequence[PlacedShape],
    shape_of: NDArray[np.int32],
    matrices: NDArray[np.float64],
    sizes: NDArray[np.float64],
    options: ArrangeOptions,
) -> None:
    """Refuse umbrellas that readers would leave out."""
    spanned = periods_spanned(matrices, bases, shape_of)
    wrong = np.flatnonzero(~(spanned <= MOST_PERIODS))
    if not len(wrong):
        return
    first = wrong[0]
    where = "--size" if options.placement in _CHANCE else f"{options.placement}: umbrella {first + 1} of {len(sizes)}"
    raise FexelError(
        f"{where}: {sizes[first]:.4g} cells span {spanned[first]:.3g} times the whole texture of "
        f"{options.grid[0]} x {options.grid[1]} cells, expected at most {MOST_PERIODS} times"
    )


def _matrices(
    positions: NDArray[np.float64], sizes: NDArray[np.float64], angles: NDArray[np.float64], grid: tuple[int, int]
) -> NDArray[np.float64]:
    """Scale in cells, turn, then cells to st: square cells keep shapes undistorted on the surface."""
    cosine, sine = sizes * np.cos(angles), sizes * np.sin(angles)
    matrices = np.zeros((len(sizes), 3, 3))
    matrices[:, 0, 0], matrices[:, 0, 1] = cosine / grid[0], sine / grid[1]
    matrices[:, 1, 0], matrices[:, 1, 1] = -sine / grid[0], cosine / grid[1]
    matrices[:, 2, :2], matrices[:, 2, 2] = positions, 1.0
    return matrices
