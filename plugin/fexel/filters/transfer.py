"""What filters make of a wave, against what they should: squared error by spatial frequency, for one footprint.

A lookup at a random place turns a wave of frequency f into itself, by a factor that is the filter's transfer function,
and into aliases of the texels that it reads. The squared error is |H - G|^2 plus the squares of the aliases, where G is
the truth's factor: a box over the footprint of the bilinearly interpolated image. A bilinear access is a tent, a texel of
a mip level the mean of as many of level 0: products of sines over their arguments, all of them.

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

PHASES = 3
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

    def row(gx: _Floats, gy: _Floats) -> tuple[_Floats, float]:
        return _equidistant((x * gx + y * gy) / count, count), 0.0

    fine, fine_aliases = _accesses(row, level, fx, fy)
    coarse, coarse_aliases = _accesses(row, level + 1, fx, fy)
    wrong = (1 - share) * fine + share * coarse - axes.truth(fx, fy)
    return wrong**2 + (1 - share) ** 2 * fine_aliases + share**2 * coarse_aliases


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
    truth = axes.truth(fx, fy)
    if choice.compact[0]:
        found = taps(choice, np.zeros((PHASES, 2)))
        weight, (x, y) = found.weight[0], found.at[0].T

        def points(gx: _Floats, gy: _Floats) -> tuple[_Floats, _Floats]:
            waves = 2 * np.pi * (np.multiply.outer(x, gx) + np.multiply.outer(y, gy))
            return np.tensordot(weight, np.cos(waves), 1), np.tensordot(weight, np.sin(waves), 1)

        straight, aliases = _accesses(points, level, fx, fy)
        return (straight - truth) ** 2 + aliases
    long, short = 2.0 ** (level + octaves), 2.0**level
    axis = direction.long_axis
    places = np.zeros((PHASES, 2))
    places[:, axis] = 4096 * long + (np.arange(PHASES) + 0.5) / PHASES * long
    found = taps(choice, places)
    along, across = (fx, fy) if axis == 0 else (fy, fx)
    waves = along - direction.shear * across, across
    own = _equidistant(waves[0], long) * _equidistant(across, short)
    tent = np.sinc(across * short) ** 2
    leaked = np.maximum((2 + np.cos(2 * np.pi * across * short)) / 3 - tent**2, 0.0)  # aliases of the tent
    squares = np.zeros_like(fx)
    for place, at, weight in zip(places[:, axis], found.at[..., axis], found.weight, strict=True):
        factor = _row(at, weight, place, (long, float(choice.tilt[0])), waves) * own
        squares += np.abs(factor * tent - truth) ** 2 + np.abs(factor) ** 2 * leaked
    return squares / PHASES


def _row(
    at: _Floats, weight: _Floats, place: float, cell: tuple[float, float], waves: tuple[_Floats, _Floats]
) -> NDArray[np.complex128]:
    """What accesses along the long axis make of waves about a place, in the moved image.

    at, weight: (T,); cell: length of a texel, tilt; waves: along the long axis and across.
    """
    texel, tilt = cell
    column = np.floor(at / texel - 0.5)
    share = at / texel - 0.5 - column
    total = np.zeros(waves[0].shape, np.complex128)
    for pick in np.flatnonzero(weight):
        left = (column[pick] + 0.5) * texel - place
        drift = waves[1] * (tilt * (at[pick] - place))
        step = np.exp(2j * np.pi * waves[0] * texel)
        total += weight[pick] * np.exp(2j * np.pi * (waves[0] * left + drift)) * (1 - share[pick] + share[pick] * step)
    return total


def _equidistant(wave: _Floats, count: float) -> _Floats:
    """Mean of so many samples in a row, about their middle (Dirichlet's kernel); wave: cycles from one to the next."""
    if count == 1:
        return np.ones_like(wave)
    sine = np.sin(np.pi * wave)
    alike = (
        np.abs(sine) < 1e-6
    )  # both sines vanish; of an even count, samples an odd number of cycles apart are opposite
    sign = np.where(np.round(wave) % 2 * (count - 1) % 2 == 0, 1.0, -1.0)
    return np.where(alike, sign, np.sin(np.pi * count * wave) / (count * np.where(alike, 1.0, sine)))


def _accesses(
    mean: Callable[[_Floats, _Floats], tuple[_Floats, _Floats | float]], level: int, fx: _Floats, fy: _Floats
) -> tuple[_Floats, _Floats]:
    """Transfer function of bilinear accesses of a mip level, and the squares of its aliases together.

    mean: cosine and sine of a wave, averaged over the places of the accesses, which are symmetric.
    """
    size = 2.0**level
    tent = np.sinc(fx * size), np.sinc(fy * size)
    box = _equidistant(fx, size) * _equidistant(fy, size)
    aliases = np.zeros_like(fx)
    for i, j in _NEIGHBORS:
        even, odd = mean(fx + i / size, fy + j / size)
        # sinc(x + 1) is sinc(x) but for its sign and x / (x + 1)
        wave, sign = (fx, i) if i else (fy, j)
        shifted = wave * size + sign
        tents = box * (tent[0] * tent[1] * wave * size / np.where(shifted == 0, 1.0, shifted)) ** 2
        aliases += (even**2 + odd**2) * np.where(shifted == 0, 0.0, tents) ** 2
    return mean(fx, fy)[0] * box * (tent[0] * tent[1]) ** 2, aliases
