"""The fan of views that filters are compared in: a texture seen from every elevation, turned by every azimuth.

Views are orthographic, so that all pixels of one have the same footprint: `MINOR` texels across and, at an elevation e,
``MINOR / sin(e)`` texels along; an azimuth turns that in the texture. Coordinates are texels of level 0, x right,
y down.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError

__all__ = ["AZIMUTHS", "ELEVATIONS", "MINOR", "FilterView", "check_angles", "fan"]

ELEVATIONS = (90.0, 60.0, 45.0, 30.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)
"""Degrees above the surface: from straight down to along it."""

AZIMUTHS = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0)
"""Degrees by which the long side of a footprint is turned from +x towards +y."""

MINOR = 1.25
"""Texels across a footprint."""

_LOWEST = 0.05  # degrees: a footprint of 1400 texels


@dataclass(frozen=True)
class FilterView:
    """A direction from which a texture is seen, degrees."""

    elevation: float
    azimuth: float

    @property
    def jacobian(self) -> NDArray[np.float64]:
        """(2, 2) texels per pixel: a pixel to the right is `MINOR` texels, one down the long way."""
        turn, length = math.radians(self.azimuth), MINOR / math.sin(math.radians(self.elevation))
        along, across = np.array([math.cos(turn), math.sin(turn)]), np.array([math.sin(turn), -math.cos(turn)])
        return np.stack([MINOR * across, length * along], axis=1)

    def places(self, size: tuple[int, int], pixels: int) -> NDArray[np.float64]:
        """(pixels^2, 2) where the pixels of a square picture fall, row by row, about the middle of an image."""
        steps = np.arange(pixels) + 0.5 - pixels / 2
        grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        return grid @ self.jacobian.T + np.array(size) / 2

    @property
    def label(self) -> str:
        """For people."""
        return f"elevation {self.elevation:g}, azimuth {self.azimuth:g} degrees"


def fan(elevations: Sequence[float] = ELEVATIONS, azimuths: Sequence[float] = AZIMUTHS) -> tuple[FilterView, ...]:
    """All views, elevation by elevation."""
    return tuple(FilterView(float(elevation), float(azimuth)) for elevation in elevations for azimuth in azimuths)


def check_angles(elevations: Sequence[float], azimuths: Sequence[float]) -> None:
    """See to it that a fan can be drawn.

    Raises
    ------
    FexelError
        None given, an elevation outside [0.05, 90] degrees, an azimuth that is no finite number.
    """
    if not elevations or not azimuths:
        raise FexelError("views: no elevation or no azimuth, expected at least one of each, degrees")
    for elevation in elevations:
        if not _LOWEST <= elevation <= 90.0:
            raise FexelError(f"--elevations: {elevation:g}, expected {_LOWEST:g} to 90 degrees")
    for azimuth in azimuths:
        if not math.isfinite(azimuth):
            raise FexelError(f"--azimuths: {azimuth:g}, expected degrees")
