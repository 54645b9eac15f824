"""What filters make of a wave, against what they should: squared error by spatial frequency, for one footprint.

A lookup at a random place turns a wave of frequency f into itself, by a factor that is the filter's transfer function,
and into aliases of the texels that it reads. The squared error is |H - G|^2 plus the squares of the aliases, where G is
the truth's factor: a box over the footprint of the bilinearly interpolated image. A bilinear access is a tent, a texel
of a mip level the mean of as many of level 0: products of sines over their arguments, all of them.

Frequencies are cycles per texel of level 0; footprints are ellipses given by both axes in texels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.filters.lookup import Choice, Taps
from fexel.filters.shears import DIRECTIONS

__all__ = ["EXTENT", "PHASES", "Axes", "chosen_loss", "probe_loss"]

PHASES = 2
"""Places within a texel that stand for all."""

EXTENT = (1 << 40, 1 << 40)
"""Of an image whose levels are all whole."""

_NEIGHBORS = ((1, 0), (-1, 0), (0, 1), (0, -1))  # aliases along one axis; those along both are the square of small
_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Axes:
    """A footprint.

    Attributes
    ----------
    major, minor : float
        Lengths in texels, major >= minor > 0.
    angle : float
        Of the major axis, from x towards y, radians.
    """

    major: float
    minor: float
    angle: float

    @property
    def unit(self) -> _Floats:
        """(2,), along the major axis."""
        return np.array([math.cos(self.angle), math.sin(self.angle)])

    @property
    def jacobian(self) -> _Floats:
        """(1, 2, 2), of a pixel whose axes are those of the footprint."""
        x, y = self.unit
        return np.array([[[x * self.major, -y * self.minor], [y * self.major, x * self.minor]]])

    def truth(self, fx: _Floats, fy: _Floats) -> _Floats:
        """Transfer function of the box over the footprint of what lies between texel centres."""
        x, y = self.unit
        box = np.sinc(self.major * (x * fx + y * fy)) * np.sinc(self.minor * (x * fy - y * fx))
        return box * (np.sinc(fx) * np.sinc(fy)) ** 2


def probe_loss(axes: Axes, most: float, fx: _Floats, fy: _Floats) -> _Floats:
    """Squared error of at most so many trilinear probes along the major axis; 1: of a mipmap.

    Returns
    -------
    as fx, fy
        Per unit of energy.
    """
    count = int(np.clip(math.ceil(axes.major / axes.minor - 0.25), 1, most))
    lod = max(math.log2(max(axes.minor, axes.major / most)), 0.0)
    level, share = math.floor(lod), lod - math.floor(lod)
    x, y = axes.major * axes.unit

    def row(gx: _Floats, gy: _Floats) -> _Floats:
        return _equidistant((x * gx + y * gy) / count, count)

    fine, fine_aliases = _accesses(axes, row, (level, 1 - share), fx, fy)
    coarse, coarse_aliases = _accesses(axes, row, (level + 1, share), fx, fy)
    return np.abs(fine + coarse - axes.truth(fx, fy)) ** 2 + fine_aliases + coarse_aliases


def chosen_loss(
    axes: Axes, choice: Choice, taps: Callable[[Choice, _Floats], Taps], fx: _Floats, fy: _Floats
) -> _Floats:
    """Squared error of what a ripmap or a fipmap chooses.

    Parameters
    ----------
    axes : Axes
    choice : Choice
        Of that footprint, `PHASES` times.
    taps : callable
        The accesses at (PHASES, 2) places of an image of `EXTENT`.
    fx, fy : float64
    """
    level, octaves, direction = int(choice.level[0]), int(choice.octaves[0]), DIRECTIONS[choice.direction[0]]
    texel = 2.0 ** (level + octaves)
    places = 4096 * texel + np.outer((np.arange(PHASES) + 0.5) / PHASES * texel, [1.0, 1.0])
    found = taps(choice, places)
    if octaves == 0:
        used = 1 if choice.compact[0] else PHASES  # compact ones are the same everywhere
        phases = zip((found.at - places[:, None])[:used], found.weight[:used], strict=True)
        return np.mean([_points_loss(axes, at, weight, level, fx, fy) for at, weight in phases], axis=0)
    axis = direction.long_axis
    across = fy if axis == 0 else fx
    waves = (fx if axis == 0 else fy) - direction.shear * across, across
    short, truth = 2.0**level, axes.truth(fx, fy)
    own = _equidistant(waves[0], texel) * _equidistant(across, short)
    tent = np.sinc(across * short) ** 2
    leaked = np.maximum((2 + np.cos(2 * np.pi * across * short)) / 3 - tent**2, 0.0)  # aliases of the tent
    squares = np.zeros_like(fx)
    for place, at, weight in zip(places[:, axis], found.at[..., axis], found.weight, strict=True):
        factor = _row(at, weight, place, (texel, float(choice.tilt[0])), waves) * own
        squares += np.abs(factor * tent - truth) ** 2 + np.abs(factor) ** 2 * leaked
    return squares / PHASES


def _points_loss(axes: Axes, at: _Floats, weight: _Floats, level: int, fx: _Floats, fy: _Floats) -> _Floats:
    """Of bilinear accesses of a mip level at (T, 2) texels from the footprint's centre."""
    waves = _wave(np.multiply.outer(at[:, 0], fx) + np.multiply.outer(at[:, 1], fy))

    def points(gx: _Floats, gy: _Floats) -> NDArray:
        # A whole shift of all frequencies turns each place's waves alike.
        turned = weight * _wave(at[:, 0] * (gx[0] - fx[0]) + at[:, 1] * (gy[0] - fy[0]))
        return _sum(turned, waves)

    straight, aliases = _accesses(axes, points, (level, 1.0), fx, fy)
    return np.abs(straight - axes.truth(fx, fy)) ** 2 + aliases


def _row(
    at: _Floats, weight: _Floats, place: float, cell: tuple[float, float], waves: tuple[_Floats, _Floats]
) -> NDArray[np.complex64]:
    """What accesses along the long axis make of waves about a place, in the moved image.

    at, weight: (T,); cell: length of a texel, tilt; waves: along the long axis and across.
    """
    texel, tilt = cell
    at, weight = at[weight > 0], weight[weight > 0]
    column = np.floor(at / texel - 0.5)
    share = at / texel - 0.5 - column
    left = (column + 0.5) * texel - place
    starts = _wave(np.multiply.outer(left, waves[0]) + np.multiply.outer(tilt * (at - place), waves[1]))
    return _sum(weight * (1 - share), starts) + _sum(weight * share, starts) * _wave(waves[0] * texel)


def _sum(weight: NDArray, waves: NDArray[np.complex64]) -> NDArray[np.complex64]:
    """Of weighted waves; not by a matrix product, whose threads cost more than such small ones."""
    return np.einsum("t,tf->f", weight.astype(np.complex64), waves)


def _wave(cycles: _Floats) -> NDArray[np.complex64]:
    turned = ((cycles - np.rint(cycles)) * (2 * np.pi)).astype(np.float32)
    return np.cos(turned) + 1j * np.sin(turned)


def _equidistant(wave: _Floats, count: float) -> _Floats:
    """Mean of so many samples in a row, about their middle (Dirichlet's kernel); wave: cycles from one to the next."""
    if count == 1:
        return np.ones_like(wave)
    sine = np.sin(np.pi * wave)
    alike = np.abs(sine) < 1e-6  # both sines vanish: samples are whole cycles apart, alike but for the sign
    sign = np.where(np.round(wave) % 2 * (count - 1) % 2 == 0, 1.0, -1.0)
    return np.where(alike, sign, np.sin(np.pi * count * wave) / (count * np.where(alike, 1.0, sine)))


def _accesses(
    axes: Axes,
    mean: Callable[[_Floats, _Floats], NDArray],
    part: tuple[int, float],
    fx: _Floats,
    fy: _Floats,
) -> tuple[NDArray, _Floats]:
    """Transfer function of bilinear accesses of a mip level, and squared error of all its aliases together.

    mean: a wave averaged over the places of the accesses; part: the level, and its share of what is looked up. What
    lies between texels of level 0 has aliases in truth, too.
    """
    level, share = part
    size = 2.0**level
    box = share * _equidistant(fx, size) * _equidistant(fy, size)
    own = np.sinc(fx * size), np.sinc(fy * size)
    aliases = np.zeros_like(fx)
    for i, j in _NEIGHBORS:
        gx, gy = fx + i / size, fy + j / size
        truth = axes.truth(gx, gy) if level == 0 else 0.0
        tent = np.sinc(gx * size) * own[1] if i else own[0] * np.sinc(gy * size)
        aliases += np.abs(mean(gx, gy) * box * tent**2 - truth) ** 2
    return mean(fx, fy) * box * (own[0] * own[1]) ** 2, aliases
