"""Per pixel the cheapest filter whose predicted error is below a bound.

What an image holds is measured once (`fexel.filters.content`), what filters lose of it is known beforehand
(`fexel.filters.losses`): the error of each filter, for a table of footprints, is the product of the two. The table of
an image says what each footprint takes, so that a lookup costs a pixel one more access to its record, whatever the
errors are computed from. Errors are root mean squares of sRGB-encoded values, against a box over the pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fexel.filters import FILTERS
from fexel.filters.content import Content
from fexel.filters.lookup import usable
from fexel.filters.losses import CANDIDATES, MINORS, PORTABLE, RATIOS, SECTORS, Candidate, cells, errors
from fexel.textures.footprint import Footprint

if TYPE_CHECKING:
    from fexel.filters.twin import FilterTwin

__all__ = ["BOUND_DB", "CHAINS", "Choice", "choose", "decibels", "decide", "lods", "predict", "record", "sample"]

BOUND_DB = 40.0
"""A bound that means something to a person: errors of 2.6 of 255 steps, which are hardly seen."""

CHAINS = True
"""Chains may be wanted, as of a fipmap."""

_PRICE = 1 / 8  # of a fetch, in squares of the bound: more is not spent on coming nearer to it
_REFERENCE = Candidate("anisotropic", 16)
_MARGIN_DB = 3.5  # by how much 16 probes may be better than foretold; fipmaps are hardly
_STEPS_DB = np.arange(20.0, 80.0, 0.25)  # bounds that are tried
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
        Root mean square of sRGB-encoded values in [0, 1]: anisotropic of 16 probes, fipmap of 4 accesses. An
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
        Error to stay below, as `decibels`; by default what 16 anisotropic probes have on a floor that is
        seen to the horizon. Beyond reach, or where only many more fetches would do, it is come near to.

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
    if bound_db is None:
        bound_db = _as_good_as(found[_REFERENCE] ** 2, squares, cost)
    chosen = _cheapest(squares, cost, bound_db)
    return chosen.astype(np.uint8), np.sqrt(np.take_along_axis(squares, chosen[None], axis=0)[0])


def _cheapest(squares: _Floats, cost: _Floats, bound_db: float) -> _Ints:
    bound = 10 ** (-bound_db / 10)
    return np.argmin(np.maximum(squares - bound, 0.0) + _PRICE * bound * cost, axis=0)


def _as_good_as(reference: _Floats, squares: _Floats, cost: _Floats) -> float:
    """The loosest bound, dB, with which a floor is as good as the reference."""
    floor = _floor()
    asked = np.sum(floor * reference) * 10 ** (-_MARGIN_DB / 10)
    for bound_db in _STEPS_DB.tolist():
        chosen = _cheapest(squares, cost, bound_db)
        if np.sum(floor * np.take_along_axis(squares, chosen[None], axis=0)[0]) <= asked:
            return bound_db
    return float(_STEPS_DB[-1])


def _floor() -> _Floats:
    """(RATIOS, MINORS): shares of the pixels of a floor from 20 degrees on to the horizon.

    The ratio of axes is in inverse proportion to the rows below the horizon, the minor axis in proportion to the ratio:
    1/4 texel a pixel straight below the camera.
    """
    ratio, minor = np.arange(RATIOS)[:, None], np.arange(MINORS)[None] - 2  # half octaves
    return np.where((ratio >= 3) & (minor - ratio == -4), np.exp2(-0.5 * ratio), 0.0)


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
