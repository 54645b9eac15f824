"""Which point of one contour corresponds to which of another: by direction and distance from the centre, and by shape.

Contours are star-shaped polygons about (0, 0), counter-clockwise. One is turned onto the other where their radii agree
best over all directions (circular correlation); both then run together by dynamic programming over samples of equal
arc length: the monotone, closed path of least difference in place and in tangent (cyclic dynamic time warping, as for
planar shapes in Sebastian, Klein and Kimia, On aligning curves, 2003).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from fexel.textures.umbrella_geometry import cross, signed_area

__all__ = ["Correspondence", "Outline", "best_turn", "best_turns", "corresponding_arcs", "radii", "shape_distances"]

_DIRECTIONS = 256  # of the radial profiles
_SAMPLES = 128  # per contour in the dynamic programme
_TANGENT = 0.3  # weight of a turned tangent against a distance of one unit of size
_BAND = _SAMPLES // 4  # how far the path may leave the diagonal
_STEPS = np.array([[1, 1], [1, 2], [2, 1], [1, 3], [3, 1]], np.int64)  # keep stretch along the contour within 1/3..3


class Outline:
    """A closed polygon, parametrised by its arc length.

    Attributes
    ----------
    corners : (N, 2) float64
    arcs : (N + 1,) float64
        Share of the perimeter at which each corner lies, and 1.
    """

    def __init__(self, corners: NDArray[np.float64]) -> None:
        self.corners = np.asarray(corners, np.float64)
        lengths = np.linalg.norm(np.roll(self.corners, -1, axis=0) - self.corners, axis=1)
        total = float(lengths.sum())
        even = np.arange(1, len(lengths) + 1) / len(lengths)
        self.arcs = np.concatenate([[0.0], np.cumsum(lengths) / total if total > 0.0 else even])
        self.arcs[-1] = 1.0

    def at(self, arcs: NDArray[np.float64], values: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """(M, C) points at arcs, taken modulo 1; or `values` (N, C) of the corners, interpolated there."""
        values = self.corners if values is None else values
        closed = np.concatenate([values, values[:1]])
        wrapped = np.asarray(arcs, np.float64) % 1.0
        return np.stack([np.interp(wrapped, self.arcs, closed[:, c]) for c in range(closed.shape[1])], axis=-1)

    def arcs_towards(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """(M,) where rays from the centre at angles (radians) leave the outline."""
        own = np.arctan2(self.corners[:, 1], self.corners[:, 0])
        steps = np.diff(own, append=own[:1])
        steps = (steps + np.pi) % (2.0 * np.pi) - np.pi
        opened = own[0] + np.concatenate([[0.0], np.maximum.accumulate(np.cumsum(steps))])
        angles = own[0] + (np.asarray(angles, np.float64) - own[0]) % (2.0 * np.pi)
        edge = np.clip(np.searchsorted(opened, angles, side="right") - 1, 0, len(own) - 1)
        start, end = self.corners[edge], self.corners[(edge + 1) % len(own)]
        towards = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        below = cross(towards, end - start)
        share = np.divide(-cross(towards, start), below, out=np.zeros(len(edge)), where=np.abs(below) > 1e-300)
        return self.arcs[edge] + np.clip(share, 0.0, 1.0) * (self.arcs[edge + 1] - self.arcs[edge])


@dataclass(frozen=True, eq=False)
class Correspondence:
    """Arcs of two outlines that run together, from one corresponding pair once around to the same pair.

    Attributes
    ----------
    own, other : (P,) float64
        Increasing; the last is the first plus 1.
    cost : float
        Mean difference per sample; 0 for equal shapes.
    """

    own: NDArray[np.float64]
    other: NDArray[np.float64]
    cost: float = 0.0

    def to_other(self, arcs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Arcs of the other outline for arcs of this one; increasing with them, not reduced to [0, 1)."""
        return _carried(arcs, self.own, self.other)

    def to_own(self, arcs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Arcs of this outline for arcs of the other one."""
        return _carried(arcs, self.other, self.own)


def radii(corners: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """(M,) distance from the centre to the contour at angles (radians)."""
    outline = Outline(corners)
    return np.linalg.norm(outline.at(outline.arcs_towards(angles)), axis=-1)


def best_turn(own: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Angle (radians, counter-clockwise) by which the other contour is turned to lie on this one; circles by none."""
    return best_turns(own, other, 1)[0]


def best_turns(own: NDArray[np.float64], other: NDArray[np.float64], tries: int) -> list[float]:
    """Up to so many angles (radians) by which the other contour may be turned to lie on this one, best first.

    Local maxima of the circular correlation of logarithmic radii, refined by a parabola.
    """
    score = _correlation(_profile(own), _profile(other))
    if np.ptp(score) < 1e-9 * _DIRECTIONS:  # round contours: rounding errors would choose the turn
        return [0.0]
    before, after = np.roll(score, 1), np.roll(score, -1)
    peaks = np.flatnonzero((score >= before) & (score > after))
    peaks = peaks[np.argsort(-score[peaks], kind="stable")][:tries]
    bend = before[peaks] - 2.0 * score[peaks] + after[peaks]
    shift = 0.5 * (before[peaks] - after[peaks]) / np.minimum(bend, -1e-300)  # 1e-300: a flat peak is not shifted
    turns = (peaks + shift) * (2.0 * np.pi / _DIRECTIONS)
    return [float(turn) for turn in (turns + np.pi) % (2.0 * np.pi) - np.pi]


def shape_distances(contours: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """(N, N) root mean square differences of logarithmic radii, each pair turned onto each other, whatever the size."""
    profiles = np.array([_profile(contour) for contour in contours])
    energy = (profiles**2).sum(axis=1)
    closest = np.array([[_correlation(a, b).max() for b in profiles] for a in profiles])
    squared = energy[:, None] + energy[None, :] - 2.0 * closest
    return np.sqrt(np.maximum(0.5 * (squared + squared.T), 0.0) / _DIRECTIONS)


def corresponding_arcs(own: NDArray[np.float64], other: NDArray[np.float64], radial: float = 0.0) -> Correspondence:
    """Let two contours, already turned onto each other, run together.

    Parameters
    ----------
    own, other : (N, 2), (M, 2) float64
        Their sizes do not matter.
    radial : float
        How much it costs that corresponding points lie in different directions from the centre; infinity: they never
        do, and no morph between the two folds.
    """
    a, b = Outline(own), Outline(other)
    start = float(b.arcs_towards(np.arctan2(own[:1, 1], own[:1, 0]))[0])
    if math.isinf(radial):
        return _by_direction(a, b, start)
    arcs = np.arange(_SAMPLES) / _SAMPLES
    costs = _costs(_described(a, arcs), _described(b, start + arcs), radial)
    path, cost = _cheapest_path(costs, _SAMPLES // 6, _BAND, _STEPS)
    return Correspondence(path[:, 0] / _SAMPLES, start + path[:, 1] / _SAMPLES, cost)


def _by_direction(a: Outline, b: Outline, start: float) -> Correspondence:
    towards_b = np.arctan2(b.corners[:, 1], b.corners[:, 0])
    own = np.unique(np.concatenate([a.arcs[:-1], a.arcs_towards(towards_b)]))
    points = a.at(own)
    other = b.arcs_towards(np.arctan2(points[:, 1], points[:, 0]))
    steps = np.maximum((np.diff(other) + 0.5) % 1.0 - 0.5, 0.0)
    other = start + np.concatenate([[0.0], np.cumsum(steps)])
    return Correspondence(np.append(own, 1.0), np.append(np.minimum(other, start + 1.0), start + 1.0))


def _described(outline: Outline, arcs: NDArray[np.float64]) -> NDArray[np.float64]:
    """(S, 6) place over size, unit tangent, unit direction from the centre at each sample."""
    size = math.sqrt(max(abs(signed_area(outline.corners)), 1e-300))  # 1e-300: an empty contour
    place = outline.at(arcs) / size
    tangent = outline.at(arcs + 0.75 / _SAMPLES) - outline.at(arcs - 0.75 / _SAMPLES)
    return np.hstack([place, _unit(tangent), _unit(place)])


def _costs(a: NDArray[np.float64], b: NDArray[np.float64], radial: float) -> NDArray[np.float64]:
    """(S, S) how much samples differ."""
    apart = ((a[:, None, :2] - b[None, :, :2]) ** 2).sum(axis=-1)
    return apart + _TANGENT * (1.0 - a[:, 2:4] @ b[:, 2:4].T) + radial * (1.0 - a[:, 4:6] @ b[:, 4:6].T)


@numba.njit(cache=True, nogil=True)
def _cheapest_path(costs, shift, band, steps):
    """Closed monotone path through the torus of costs, among those that begin within `shift` of the diagonal."""
    size = costs.shape[0]
    least, best, best_path = np.inf, 0, np.zeros((0, 2), np.int64)
    for attempt in range(2 * shift + 1):
        first = (attempt + 1) // 2 * (1 if attempt % 2 else -1)  # 0, 1, -1, 2, -2 ...: likely ones bound the others
        total = np.full((size + 1, 2 * band + 1), np.inf)
        came = np.zeros((size + 1, 2 * band + 1), np.int64)
        total[0, band] = 0.0
        for i in range(1, size + 1):
            if i > 3 and min(total[i - 1].min(), total[i - 2].min(), total[i - 3].min()) >= least:
                break  # steps reach three rows back: another beginning is better whatever follows
            for column in range(2 * band + 1):
                j = i + column - band  # samples of the other contour since its first
                for s in range(len(steps)):
                    i0, j0 = i - steps[s, 0], j - steps[s, 1]
                    c0 = j0 - i0 + band
                    if i0 < 0 or j0 < 0 or c0 < 0 or c0 > 2 * band:
                        continue
                    weight = 0.5 * (steps[s, 0] + steps[s, 1])
                    found = total[i0, c0] + weight * costs[i % size, (j + first) % size]
                    if found < total[i, column]:
                        total[i, column], came[i, column] = found, s
        if total[size, band] < least:
            least, best = total[size, band], first
            best_path = _walked_back(came, size, band, steps)
    best_path[:, 1] += best
    return best_path, least / size


@numba.njit(cache=True, nogil=True)
def _walked_back(came, size, band, steps):
    path = np.zeros((size + 1, 2), np.int64)
    count, i, j = 0, size, size
    while True:
        path[count, 0], path[count, 1] = i, j
        count += 1
        if i <= 0:
            return path[:count][::-1].copy()
        s = came[i, j - i + band]
        i, j = i - steps[s, 0], j - steps[s, 1]


def _profile(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    angles = np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
    values = np.log(np.maximum(radii(corners, angles), 1e-6))  # 1e-6: the centre on the contour
    return values - values.mean()


def _correlation(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of profile a with profile b turned by each of the directions."""
    return np.fft.irfft(np.fft.rfft(a) * np.conj(np.fft.rfft(b)), _DIRECTIONS)


def _carried(arcs: NDArray[np.float64], source: NDArray[np.float64], target: NDArray[np.float64]):
    turns = np.floor(np.asarray(arcs, np.float64) - source[0])
    return np.interp(arcs - turns, source, target) + turns


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)  # 1e-300: no direction
