"""What every filter loses of every frequency, for a table of footprints; for all images, kept in a file of the package.

Cells of the table are footprints: sector of the major axis, ratio of the axes, minor axis. A cell's losses are
integrals of `fexel.filters.transfer` over the rings and sectors of `fexel.filters.content`, along the footprint's own
axes: what a long footprint keeps is a strip of the frequency plane much narrower than a sector.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel.filters import content, fipmap, loss_table, ripmap, transfer
from fexel.filters.lookup import Choice, Taps, usable
from fexel.textures.footprint import Footprint

__all__ = [
    "CANDIDATES",
    "MINORS",
    "PORTABLE",
    "RATIOS",
    "REFERENCE",
    "SECTORS",
    "STORED",
    "Candidate",
    "cells",
    "computed",
    "errors",
    "footprints",
]

SECTORS = 16
"""Of the major axis, half a turn from -45 degrees on: tangents to the nearer axis in steps of 1/4."""

RATIOS = 16
"""Major to minor axis, in half octaves from 1 on."""

MINORS = 14
"""Minor axis, in half octaves from half a texel on."""


@dataclass(frozen=True)
class Candidate:
    """A filter as `auto` may take it.

    Attributes
    ----------
    token : str
    probes : int
        At most so many probes, or accesses.
    """

    token: str
    probes: int

    def fetches(self, ratio: NDArray[np.float64]) -> NDArray[np.float64]:
        """Texels fetched for footprints of that ratio of axes."""
        if self.token in ("ripmap", "fipmap"):
            return np.full(np.shape(ratio), 4.0 * self.probes)
        return 8.0 * np.clip(np.ceil(ratio - 0.25), 1, self.probes)


CANDIDATES = (
    Candidate("mipmap", 1),
    Candidate("anisotropic", 2),
    Candidate("anisotropic", 4),
    Candidate("fipmap", 4),
    Candidate("fipmap", 6),
    Candidate("fipmap", 8),
    Candidate("fipmap", 12),
    Candidate("fipmap", 16),
)
"""What `auto` chooses from; eight, which shaders/filter_auto.glsl knows by number."""

PORTABLE = (
    Candidate("mipmap", 1),
    Candidate("anisotropic", 8),
    Candidate("ripmap", ripmap.PROBES),
    Candidate("fipmap", fipmap.PROBES),
)
"""The filters of stages as they are drawn unless asked otherwise."""

REFERENCE = Candidate("anisotropic", 16)
"""What `auto` is to be as good as."""

STORED = (
    *CANDIDATES,
    Candidate("anisotropic", 8),
    Candidate("anisotropic", 16),
    Candidate("ripmap", ripmap.PROBES),
)
"""All of these, in the order of the file (`fexel.filters.loss_table`)."""

_QUARTERS = 5  # of the tangent, from 0 to 1
_EXACT = 6  # minor axes whose level may be 0; of greater ones only the two of an octave
_FINER = MINORS - _EXACT - 2  # rings beyond the finest, for these
_STEPS = (0, 1, 2, 3, 4, 6, 8, 10, 12, 14)  # of RATIOS that are computed; what lies between is their mean
_ALONG = np.array([0, 0.25, 0.5, 0.75, 1, 1.5, 2.25, 3.5, 6])  # waves per major axis: bounds of the nodes
_ACROSS = np.exp2(np.arange(-14, 3) / 2)  # waves per minor axis
_TILTED = np.array([1, 1, 1, 1, -1]) / 12**0.5  # of a quarter: how far tangents in a sector are from its middle
_FALL = 3.0  # energy per area of the frequency plane falls with this power of the frequency: edges
_Floats = NDArray[np.float64]


def cells(jacobian: _Floats) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Sector, ratio and minor axis of (K, 2, 2), texels per pixel, y down: places in tables, each (K,)."""
    footprint = Footprint.of(usable(jacobian))
    major, minor = np.maximum(footprint.major, 1e-30), np.maximum(footprint.minor, 1e-30)  # 1e-30: finite logarithms
    ratio = np.clip(np.floor(2 * np.log2(major / minor) + 0.5), 0, RATIOS - 1).astype(np.int64)
    size = np.clip(np.floor(2 * np.log2(minor) + 2.5), 0, MINORS - 1).astype(np.int64)
    x, y = footprint.direction.T
    flat = np.abs(x) >= np.abs(y)
    tangent = np.where(flat, y, x) / np.where(flat, np.where(x == 0, 1.0, x), y)
    quarter = np.floor(4 * tangent + 0.5).astype(np.int64)
    return np.where(flat, 4 + quarter, 12 - quarter) % SECTORS, ratio, size


def errors(energy: _Floats) -> dict[Candidate, _Floats]:
    """Root mean square to expect of `CANDIDATES`, `PORTABLE` ones and the `REFERENCE` for an image's energy.

    Parameters
    ----------
    energy : (content.RINGS, content.SECTORS) float64
        Of a `fexel.filters.content.Content`.

    Returns
    -------
    dict of Candidate to (SECTORS, RATIOS, MINORS) float64
    """
    return {candidate: _errors(losses, energy) for candidate, losses in _losses().items()}


def _errors(losses: _Floats, energy: _Floats) -> _Floats:
    squares = np.zeros((SECTORS, RATIOS, MINORS))
    padded = np.concatenate([np.zeros((_FINER, content.SECTORS)), energy, np.zeros((_FINER, content.SECTORS))])
    rings = len(energy) + _FINER
    for quarter, of_quarter in enumerate(losses):
        for sector, order in _alike(quarter):
            turned = np.zeros_like(padded)
            turned[:, order] = padded
            for size in range(MINORS):
                # Of a footprint that is coarser by whole octaves the losses are those of rings as much coarser.
                finer = max(size - _EXACT, 0) // 2 * 2
                wanted = turned[finer : finer + rings]
                squares[sector, _STEPS, size] = np.tensordot(of_quarter[:, size - finer], wanted, 2)
    for ratio in set(range(RATIOS)) - set(_STEPS):
        below = max(step for step in _STEPS if step < ratio)
        above = min((step for step in _STEPS if step > ratio), default=below)
        squares[:, ratio] = 0.5 * (squares[:, below] + squares[:, above])
    return np.sqrt(squares)


def _alike(quarter: int) -> list[tuple[int, NDArray[np.int64]]]:
    """Sectors of the major axis that are mirror images of one, and what sectors of frequencies are there."""
    angle = np.arange(content.SECTORS)
    half = content.SECTORS // 2
    # As it is, mirrored, x and y exchanged, turned.
    places = [(4 + quarter, angle), (4 - quarter, -angle), (12 - quarter, half - angle), (12 + quarter, angle - half)]
    return [(sector % SECTORS, order % content.SECTORS) for sector, order in places]


def computed(candidate: Candidate, footprints: Sequence[transfer.Axes]) -> NDArray[np.float32]:
    """(F, rings, sectors): what a candidate loses of F footprints, anew; rings from finer ones than an image's on."""
    return np.array([_integrals(_as_good_as(candidate, axes), axes) for axes in footprints], np.float32)


def footprints() -> list[transfer.Axes]:
    """Those of the table: by quarter, step of the ratio, minor axis."""
    quarters, sizes = np.arctan((np.arange(_QUARTERS) + _TILTED) / 4), np.exp2(np.arange(_EXACT + 2) / 2 - 1)
    return [
        transfer.Axes(2.0 ** (step / 2) * minor, minor, angle)
        for angle in quarters.tolist()
        for step in _STEPS
        for minor in sizes.tolist()
    ]


@functools.cache
def _losses() -> dict[Candidate, NDArray[np.float32]]:
    """(quarters, steps, sizes, rings, sectors) of each candidate: what all images have in common."""
    shape = _QUARTERS, len(_STEPS), _EXACT + 2, _FINER + content.RINGS, content.SECTORS
    return dict(zip(STORED, loss_table.read((len(STORED), *shape)), strict=True))


def _as_good_as(candidate: Candidate, axes: transfer.Axes) -> Candidate:
    """Another candidate that takes the same for a footprint which needs no more."""
    enough = candidate.token in ("mipmap", "anisotropic") and axes.major <= candidate.probes * axes.minor
    return REFERENCE if enough else candidate


def _integrals(candidate: Candidate, axes: transfer.Axes) -> _Floats:
    """(_FINER + RINGS, SECTORS): mean loss over each ring and sector."""
    along, along_width = _nodes(np.concatenate([-_ALONG[:0:-1], _ALONG]) / axes.major)
    across, across_width = _nodes(_ACROSS / axes.minor)
    u, v = np.meshgrid(along, across)
    x, y = axes.unit
    fx, fy = (x * u - y * v).ravel(), (y * u + x * v).ravel()
    radius = np.hypot(fx, fy)
    loss = _loss(candidate, axes, fx, fy) * np.outer(across_width, along_width).ravel() * radius**-_FALL
    ring = np.floor(-2 * np.log2(radius) - 0.5).astype(np.int64) + _FINER
    turn = np.mod(np.arctan2(fy, fx) / np.pi + 0.5 / content.SECTORS, 1.0)
    sector = np.floor(turn * content.SECTORS).astype(np.int64) % content.SECTORS
    rings = _FINER + content.RINGS
    counts = (ring >= 0) & (ring < rings)
    place = ring[counts] * content.SECTORS + sector[counts]
    total = np.bincount(place, loss[counts], rings * content.SECTORS).reshape(rings, content.SECTORS)
    outer = np.exp2(-0.5 * (np.arange(rings) - _FINER + 0.5))
    whole = (np.pi / content.SECTORS) * ((outer * 0.5**0.5) ** (2 - _FALL) - outer ** (2 - _FALL)) / (_FALL - 2)
    return total / whole[:, None]


def _nodes(bounds: _Floats) -> tuple[_Floats, _Floats]:
    return (bounds[1:] + bounds[:-1]) / 2, np.diff(bounds)


def _loss(candidate: Candidate, axes: transfer.Axes, fx: _Floats, fy: _Floats) -> _Floats:
    if candidate.token in ("mipmap", "anisotropic"):
        return transfer.probe_loss(axes, candidate.probes, fx, fy)
    jacobian = np.repeat(axes.jacobian, transfer.PHASES, axis=0)

    def taps(choice: Choice, places: _Floats) -> Taps:
        if candidate.token == "ripmap":
            return ripmap.taps(choice, places, transfer.EXTENT)
        return fipmap.taps(choice, places, jacobian, transfer.EXTENT, candidate.probes)

    chosen = ripmap.choose(jacobian) if candidate.token == "ripmap" else fipmap.choose(jacobian, candidate.probes)
    return transfer.chosen_loss(axes, chosen, taps, fx, fy)
