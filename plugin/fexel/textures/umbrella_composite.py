"""Umbrellas over their background in float64 NumPy, with probes along the footprint: a texture at one level."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.textures.footprint import Footprint
from fexel.textures.umbrella_images import TwinImage
from fexel.textures.umbrella_layers import ArrangementTwin

__all__ = ["CompositeTwin", "wrapped"]


@dataclass(frozen=True, eq=False)
class CompositeTwin:
    """What is seen where no scale, bias, matrix or border applies.

    Attributes
    ----------
    umbrellas : ArrangementTwin
    background : TwinImage
    wrap : (str, str)
        Modes along s and t.
    grid : (int, int)
        Cells of the full arrangement, which shape footprints.
    most_probes : float
        Along a footprint.
    """

    umbrellas: ArrangementTwin
    background: TwinImage
    wrap: tuple[str, str]
    grid: tuple[int, int]
    most_probes: float

    def sample(self, st: NDArray[np.float64], axes: NDArray[np.float64], hard: bool = False) -> NDArray[np.float64]:
        """(M, 4) linear, premultiplied, of points (M, 2) with Jacobians (M, 2, 2); `hard` edges are not softened."""
        cells = np.array(self.grid, np.float64)
        footprint = Footprint.of(axes * cells[:, None])
        probes = footprint.probes(self.most_probes)
        across = footprint.direction / np.where(footprint.major > 0, footprint.major, 1.0)[:, None]
        along = np.einsum("mi,mij->mj", across * cells, axes)
        shorter = axes - (1.0 - 1.0 / probes)[:, None, None] * (across / cells)[:, :, None] * along[:, None, :]
        result = np.zeros((len(st), 4))
        for number in range(int(probes.max(initial=1))):
            taken = np.flatnonzero(number < probes)
            share = 1.0 / probes[taken]
            place = st[taken] + ((number + 0.5) * share - 0.5)[:, None] * footprint.direction[taken] / cells
            result[taken] += share[:, None] * self._probe(place, shorter[taken], hard)
        return result

    def _probe(self, place: NDArray[np.float64], axes: NDArray[np.float64], hard: bool) -> NDArray[np.float64]:
        inside, direction = wrapped(place, self.wrap)
        color, through, light = self.umbrellas.sample(inside, axes * direction[:, :, None], hard)
        seen = np.flatnonzero(through > 0)
        behind = through[seen, None] * self.background.sample(place[seen], axes[seen])
        behind[:, :3] *= light[seen, None]
        color[seen] += behind
        return color


def wrapped(st: NDArray[np.float64], wrap: Sequence[str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points in [0, 1]^2, and which way they run along st there: 1, or -1 where mirrored."""
    place, direction = np.empty_like(st), np.ones_like(st)
    for axis, mode in enumerate(wrap):
        at = st[:, axis]
        if mode == "repeat":
            place[:, axis] = at - np.floor(at)
        elif mode == "mirror":
            period = at - 2.0 * np.floor(0.5 * at)
            place[:, axis] = np.where(period > 1.0, 2.0 - period, period)
            direction[:, axis] = np.where(period > 1.0, -1.0, 1.0)
        else:
            place[:, axis] = np.clip(at, 0.0, 1.0)
    return place, direction
