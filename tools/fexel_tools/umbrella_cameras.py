"""Cameras over a ground: a flight from the veins of one element to the horizon, the whole from above, one element.

The flight climbs by the same factor from frame to frame, so that magnification changes at a constant rate, and looks
up on the way, until the horizon shows.

Conventions: the ground is the plane y = 0 of a y-up world, one unit along t; s runs along +x, t along -z.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fexel.textures.umbrella_arrangement import Arrangement
from fexel_tools.framing import Pose
from fexel_tools.geometry import look_at

__all__ = ["ASPECT", "FRAMES", "HORIZON_CELLS", "ground_cameras", "world_point"]

FRAMES = (1, 48)
ASPECT = 16.0 / 9.0
"""Width over height of the pictures."""

HORIZON_CELLS = 1000.0
"""Half the side of the ground that is seen on the way to the horizon; the flight ends a few cells above it."""

_FOCAL_PER_APERTURE = 50.0 / 36.0  # of the cameras that texture_stage writes, horizontally
_START_PITCH, _END_PITCH = 75.0, 8.5  # degrees below the horizon; at the end that is in the upper part of the picture
_END_CELLS = 4.0  # height of the last frame
_FORWARD_CELLS = 5.0
_CLOSE_UP = 0.5  # width of the first frame, elements
_UP = np.array([0.0, 1.0, 0.0])


def world_point(st: NDArray[np.float64], grid: tuple[int, int]) -> NDArray[np.float64]:
    """(..., 3) where points (..., 2) of st lie in the world."""
    st = np.asarray(st, np.float64)
    return np.stack([(st[..., 0] - 0.5) * grid[0] / grid[1], 0.0 * st[..., 0], 0.5 - st[..., 1]], axis=-1)


def ground_cameras(arrangement: Arrangement) -> dict[str, list[Pose]]:
    """Poses of the cameras Flight, Overview and Detail.

    Parameters
    ----------
    arrangement : Arrangement
        Its cells are square on the ground. Of an empty one a cell in the middle is looked at.

    Returns
    -------
    dict of str to list of (frame, camera to world, distance)
        Frame NaN for a camera that stands still.
    """
    grid = arrangement.grid
    cell = 1.0 / grid[1]
    forward = np.array([1.0, 0.0, 0.0] if grid[0] >= grid[1] else [0.0, 0.0, -1.0])
    st, length = _shown_element(arrangement)
    target = world_point(st, grid)
    count = FRAMES[1] - FRAMES[0]
    flight = [_flight(target, _CLOSE_UP * length * cell, cell, forward, k / count) for k in range(count + 1)]
    overview = _FOCAL_PER_APERTURE * max(grid[0] / grid[1], ASPECT)
    detail = _FOCAL_PER_APERTURE * length * cell * ASPECT
    nan = float("nan")
    return {
        "Flight": [(float(FRAMES[0] + k), *pose) for k, pose in enumerate(flight)],
        "Overview": [(nan, *_from_above(world_point(np.array([0.5, 0.5]), grid), overview))],
        "Detail": [(nan, *_from_above(target, detail))],
    }


def _shown_element(arrangement: Arrangement) -> tuple[NDArray[np.float64], float]:
    """Centre in st, and longer side in cells, of an umbrella that lies on top where the flight begins."""
    grid = np.array(arrangement.grid, np.float64)
    place = np.array([0.12, 0.5] if grid[0] >= grid[1] else [0.5, 0.12])
    first = arrangement.first_vertex
    if not len(arrangement):
        return place, 1.0
    with np.errstate(all="ignore"):  # umbrellas through infinity are passed over below
        low = np.minimum.reduceat(arrangement.vertices, first[:-1])
        high = np.maximum.reduceat(arrangement.vertices, first[:-1])
    sides = ((high - low) * grid).max(axis=1)
    centres = 0.5 * (low + high)
    distance = np.linalg.norm((centres - place) * grid, axis=1)
    usable = np.isfinite(distance) & (sides > 0) & (sides < 0.5 * max(grid.max(), 4.0))
    if not usable.any():
        return place, 1.0
    # On top among those near by: a step of depth counts less than a cell of distance.
    depth = np.arange(len(arrangement)) / max(len(arrangement) - 1, 1)
    best = int(np.argmin(np.where(usable, distance + 0.25 * grid.max() * depth, np.inf)))
    return centres[best], float(sides[best])


def _flight(
    target: NDArray[np.float64], width: float, cell: float, forward: NDArray[np.float64], share: float
) -> tuple:
    """Camera to world, and distance along the view to the ground (to the horizon's at most), at a share of the way."""
    eased = share * share * (3.0 - 2.0 * share)
    pitch = np.radians(_START_PITCH + (_END_PITCH - _START_PITCH) * eased)
    start = _FOCAL_PER_APERTURE * width * np.sin(np.radians(_START_PITCH))
    height = start * (_END_CELLS * cell / start) ** share
    behind = start / np.tan(np.radians(_START_PITCH))
    eye = target + height * _UP + (_FORWARD_CELLS * cell * eased - behind) * forward
    view = np.cos(pitch) * forward - np.sin(pitch) * _UP
    return look_at(eye, eye + view, _UP), float(height / np.sin(pitch))


def _from_above(target: NDArray[np.float64], distance: float) -> tuple:
    return look_at(target + distance * _UP, target, np.array([0.0, 0.0, -1.0])), float(distance)
