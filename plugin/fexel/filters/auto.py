"""Per pixel the cheapest filter whose predicted error is below a bound.

What an image holds is measured once (`fexel.filters.content`), what filters lose of it is known beforehand
(`fexel.filters.losses`): the error of each filter, for a table of footprints, is the product of the two. The table of
an image says what each footprint takes, so that a lookup costs a pixel one more access to its record, whatever the
errors are computed from. Errors are root mean squares of sRGB-encoded values, against a box over the pixel.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fexel.filters import FILTERS
from fexel.filters.content import Content
from fexel.filters.lookup import usable
from fexel.filters.losses import CANDIDATES, MINORS, PORTABLE, RATIOS, REFERENCE, SECTORS, Candidate, cells, errors
from fexel.textures.footprint import Footprint

if TYPE_CHECKING:
    from fexel.filters.twin import FilterTwin

__all__ = ["BOUND_DB", "Choice", "choose", "decibels", "decide", "lods", "predict", "record", "sample"]

BOUND_DB = 40.0
"""A bound that means something to a person: errors of 2.6 of 255 steps, which are hardly seen."""

_PRICE = 1 / 16  # of a fetch, in squares of the bound: more is not spent on coming nearer to it
_SHARE = 0.49  # of the fetches of the reference: half, and what the table rounds
_BETTER_DB = 6.0  # by how much the reference is to be foretold worse: it may be better than that, on a checkerboard
_UNSEEN = 1 / 255**2 / 12  # squared error of rounding to eight bits
_BOUNDS_DB = (10.0, 90.0)  # whose prices are tried
_HALVINGS = 10  # of their distance
_Ints = NDArray[np.int64]
_Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Choice:
    """What pixels take.

    Attributes
    ----------
    filter : (K,) int64
        Index in `fexel.filters.FILTERS`.
    probes : (K,) int64
        Of that filter, at most.
    error : (K,) float64
        Predicted, root mean square of encoded values.
    """

    filter: _Ints
    probes: _Ints
    error: _Floats


def decibels(error: _Floats | float) -> _Floats:
    """Peak signal-to-noise ratio of root mean squares of encoded values, dB, at most 100."""
    return -20.0 * np.log10(np.maximum(error, 1e-5))


def predict(jacobian: _Floats, content: Content) -> dict[str, _Floats]:
    """Errors to expect of the portable filters.

    Parameters
    ----------
    jacobian : (K, 2, 2) float64
        d(texel)/d(pixel) at level 0, y down; any values.
    content : Content
        Of the image.

    Returns
    -------
    dict of token to (K,) float64
        Root mean square of sRGB-encoded values in [0, 1]: anisotropic of 8 probes, fipmap of 4 accesses. An
        expectation over many places; an image of few frequencies (a checkerboard) is off by up to a factor of two.
    """
    places = cells(jacobian)
    found = errors(content.energy)
    return {candidate.token: found[candidate][places] for candidate in PORTABLE}


def decide(content: Content, bound_db: float | None = None) -> tuple[NDArray[np.uint8], _Floats]:
    """What footprints take.

    Parameters
    ----------
    content : Content
    bound_db : float, optional
        Error to stay below, as `decibels`; beyond reach, or where only many more fetches would do, it is come near to.
        By default as little error as half the fetches of 16 anisotropic probes buy on a floor seen to the horizon.

    Returns
    -------
    chosen : (SECTORS, RATIOS, MINORS) uint8
        Number in `CANDIDATES`.
    error : (SECTORS, RATIOS, MINORS) float64
        Root mean square.
    """
    found = errors(content.energy)
    squares = np.stack([found[candidate] ** 2 for candidate in CANDIDATES])
    ratio = np.exp2(np.arange(RATIOS) / 2)[None, :, None]
    cost = np.stack([np.broadcast_to(candidate.fetches(ratio), squares.shape[1:]) for candidate in CANDIDATES])
    chosen = _half(found[REFERENCE] ** 2, squares, cost) if bound_db is None else _cheapest(squares, cost, bound_db)
    return chosen.astype(np.uint8), np.sqrt(_of(chosen, squares))


def _of(chosen: _Ints, values: _Floats) -> _Floats:
    return np.take_along_axis(values, chosen[None], axis=0)[0]


def _cheapest(squares: _Floats, cost: _Floats, bound_db: float) -> _Ints:
    bound = 10 ** (-bound_db / 10)
    return np.argmin(np.maximum(squares - bound, 0.0) + _price(bound_db) * cost, axis=0)


def _half(reference: _Floats, squares: _Floats, cost: _Floats) -> _Ints:
    """The least squared error of floors for `_SHARE` of the fetches of the reference.

    On a floor the minor axis is in proportion to the ratio of the axes: a camera's height is a diagonal of the table.
    All footprints of a diagonal have one price, so that a fetch is spent where it gains most. Less is spent where what
    is left can neither be seen nor be worse than the reference.
    """
    ratio = np.arange(RATIOS)[:, None]
    heights = np.arange(1 - RATIOS, MINORS)
    place = np.s_[..., ratio, np.clip(ratio + heights, 0, MINORS - 1)]
    floor = _floor()[:, None]
    most = _SHARE * np.sum(floor * REFERENCE.fetches(np.exp2(ratio / 2)))
    enough = np.minimum(_UNSEEN, _mean(reference[place], floor) * 10 ** (-_BETTER_DB / 10))
    low, high = (np.full(len(heights), bound_db) for bound_db in _BOUNDS_DB)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        chosen = np.argmin(squares[place] + _price(middle) * cost[place], axis=0)
        tighter = _mean(_of(chosen, cost[place]), floor) <= most
        tighter &= _mean(_of(chosen, squares[place]), floor) > enough
        low, high = np.where(tighter, middle, low), np.where(tighter, high, middle)
    return np.argmin(squares + _price(low)[np.arange(MINORS) - ratio + RATIOS - 1] * cost, axis=0)


def _price(bound_db: _Floats | float) -> _Floats:
    """Of a fetch, in squared errors."""
    return _PRICE * 10 ** (-np.asarray(bound_db) / 10)


def _mean(values: _Floats, floor: _Floats) -> _Floats:
    """(D,) of (SECTORS, RATIOS, D)."""
    return np.sum(floor * values.mean(axis=0), axis=0)


@functools.cache
def _floor() -> _Floats:
    """(RATIOS,): shares of the pixels of a floor.

    A camera 60 degrees wide looks along the horizon; seen is what lies below it, down to 20 degrees.
    """
    side, down = np.meshgrid(np.linspace(-1, 1, 65) * np.tan(np.pi / 6), np.linspace(0.003, np.tan(np.pi / 9), 128))
    jacobian = np.zeros((side.size, 2, 2))
    jacobian[:, 0, 0], jacobian[:, 0, 1], jacobian[:, 1, 1] = (v.ravel() for v in (1 / down, side / down**2, down**-2))
    return np.bincount(cells(jacobian)[1], minlength=RATIOS) / side.size


def choose(jacobian: _Floats, content: Content, bound_db: float | None = None) -> Choice:
    """What pixels take, (K, 2, 2) as of `predict`."""
    chosen, error = decide(content, bound_db)
    places = cells(jacobian)
    numbers = np.array([(FILTERS.index(candidate.token), candidate.probes) for candidate in CANDIDATES])
    return Choice(*numbers[chosen[places]].T, error[places])


def lods(jacobian: _Floats) -> tuple[_Floats, _Floats]:
    """Finest and coarsest real-valued mip levels, (M,) both, that any of `CANDIDATES` may read of (M, 2, 2)."""
    footprint = Footprint.of(usable(jacobian))
    return footprint.level(np.inf), footprint.level(1.0)


def record(content: Content, bound_db: float | None = None) -> NDArray[np.float64]:
    """(SECTORS * MINORS / 2, 4): the table of shaders/filter_auto.glsl, eight ratios of three bits a component."""
    chosen = decide(content, bound_db)[0].astype(np.int64).transpose(0, 2, 1)
    packed = np.sum(chosen.reshape(SECTORS, MINORS, RATIOS // 8, 8) << (3 * np.arange(8)), axis=3)
    return packed.reshape(-1, 4).astype(np.float64)


def sample(
    twin: FilterTwin, xy: _Floats, jacobian: _Floats, content: Content | None = None, bound_db: float | None = None
) -> tuple[_Floats, _Ints]:
    """Values (M, 4) and texels fetched (M,) of pixels, each with what it chooses; `content` is that of the image."""
    content = content or Content.of(twin.image)
    chosen = decide(content, bound_db)[0][cells(jacobian)]
    values, fetches = np.zeros((len(xy), 4)), np.zeros(len(xy), np.int64)
    for number in np.unique(chosen):
        candidate: Candidate = CANDIDATES[number]
        picked = chosen == number
        options = {} if candidate.token == "mipmap" else {"probes": candidate.probes}
        values[picked], fetches[picked] = twin.sample(candidate.token, xy[picked], jacobian[picked], **options)
    return values, fetches
