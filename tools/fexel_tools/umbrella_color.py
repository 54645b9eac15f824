"""Colour diversification: signed offsets at the vertices of every modified umbrella (the paper's section 4.2).

The colours come from references of the same kind: other bases of about the same colour, or photos given for that,
whatever their colour; a base without its like varies by as much as it does within. What is transferred
(`umbrella_transfer`) is low frequency: the mean colour around points along every spoke, from the point of the reference
in the same direction and at the same share of the way to its contour, after the reference has been turned onto the
base. Each set of colours mixes two references; detail stays the base's.

An offset is what is to be added in linear light, so that the neighbourhood of a point has the wanted mean (notes U1:
``c = clamp(c_texture + f c_vertices)``). Since the offsets of a sector are interpolated linearly from its centre, they
are fitted along the spokes by least squares; shortened, all channels alike, where dark texels would take a hue that
another paint would not give them; and limited where more than about a tenth of the texels would be clipped.

Storage: umbrellas of a base share its sets, `ColorOptions.sets` at most; values are multiples of 1/256.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel_tools.umbrella_arrange import random_stream
from fexel_tools.umbrella_base import BaseUmbrella
from fexel_tools.umbrella_correspondence import Outline, best_turn
from fexel_tools.umbrella_transfer import alike, changed_means, mixtures, natural_share, target_colors, typical_color

__all__ = ["ColorOptions", "color_offsets", "color_sets"]

_SIDE = 64  # texels on the longer side of the image whose local means are taken
_LOCAL = 0.08  # of that side: standard deviation of a neighbourhood
_SHARES = np.array([0.15, 0.4, 0.65, 0.9])  # of the way from the centre to a vertex: where colours are compared
_SMOOTH = 0.06  # of the perimeter: standard deviation of the smoothing along the contour
_TENTH = 1.28  # standard deviations beyond which a tenth of a normal distribution lies
_KEPT = 0.25  # of the way to black or white that an offset may always go
_MOST_REFERENCES = 16  # per base, drawn by the seed
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
_DARK = 0.01  # linear luminance: what is darker than that counts alike
_SEEN = slice(1, None, 2)  # of `_SHARES`: where dark texels are looked at
_SOFTNESS = 8.0  # exponent of the mean along the contour, near the least
_QUANTUM = 1.0 / 256.0


@dataclass(frozen=True)
class ColorOptions:
    """How colours vary.

    Attributes
    ----------
    amount : float
        Share of the way to the references' colours, in [0, 1]. 0: colours do not vary.
    sets : int
        Different sets of colours per base.
    seed : int
    """

    amount: float = 1.0
    sets: int = 256
    seed: int = 0


def color_offsets(
    bases: Sequence[BaseUmbrella],
    shape_of: NDArray[np.int32],
    options: ColorOptions,
    references: Sequence[BaseUmbrella] = (),
) -> NDArray[np.float32]:
    """Offsets of all umbrellas of an arrangement.

    Parameters
    ----------
    bases : sequence of BaseUmbrella
    shape_of : (n,) int32
        Base of each umbrella, front to back.
    options : ColorOptions
    references : sequence of BaseUmbrella
        Elements whose colours are taken; none: the other bases of about the same colour, and the less there are of
        them, the more a base's own variation.

    Returns
    -------
    (total, 3) float32
        As `Arrangement.colors`: per umbrella and vertex, centre first; linear Rec.709, in [-1, 1]. (0, 3) where
        the amount is 0.

    Raises
    ------
    FexelError
        Options out of range.
    """
    if not 0.0 <= options.amount <= 1.0:
        raise FexelError(f"--color-amount: {options.amount:g}, expected a number in [0, 1]")
    if options.sets < 1:
        raise FexelError(f"--color-sets: {options.sets}, expected at least 1")
    if options.amount == 0.0 or not len(shape_of):
        return np.zeros((0, 3), np.float32)
    counts = np.array([len(base.points) for base in bases])[shape_of]
    first = np.concatenate([[0], np.cumsum(counts)])
    offsets = np.zeros((int(first[-1]), 3), np.float32)
    looks = _Looks()
    for number, base in enumerate(bases):
        users = np.flatnonzero(shape_of == number)
        rng = random_stream(options.seed, f"color {number}")
        others, weights = (references, None) if references else _alike_ones(base, bases, looks)
        sets = _sets(base, others, weights, min(options.sets, len(users)), options.amount, rng, looks)
        chosen = rng.permutation(np.arange(len(users)) % max(len(sets), 1))  # each set about as often
        offsets[first[users][:, None] + np.arange(len(base.points))] = sets[chosen]
    return offsets


def color_sets(
    base: BaseUmbrella, references: Sequence[BaseUmbrella], count: int, options: ColorOptions
) -> NDArray[np.float32]:
    """(count, V, 3) sets of offsets for one base, see `color_offsets`; without references its own variation."""
    return _sets(base, references, None, count, options.amount, random_stream(options.seed, "color"), _Looks())


@dataclass(frozen=True, eq=False)
class _Look:
    """Colours of an element at low frequency, of each neighbourhood, linear, (h, w, 3) float32.

    Attributes
    ----------
    mean, deviation : (h, w, 3) float32
    dark : (h, w, 3) float32
        Mean of its dark texels.
    typical : (3,) float64
        Mean colour in Oklab.
    """

    mean: NDArray[np.float32]
    deviation: NDArray[np.float32]
    dark: NDArray[np.float32]
    typical: NDArray[np.float64]


class _Looks(dict[int, _Look]):
    """Of each base, made once."""

    def of(self, base: BaseUmbrella) -> _Look:
        if id(base) not in self:
            self[id(base)] = _look(base)
        return self[id(base)]


def _look(base: BaseUmbrella) -> _Look:
    height, width = base.texture.shape[:2]
    inside = np.zeros((height, width), np.uint8)
    contour = base.tex_coords[1:] * (width, -height) + (0.0, height) - 0.5
    cv2.fillPoly(inside, [np.rint(contour * 16.0).astype(np.int32)], 255, shift=4)
    texture = np.clip(np.nan_to_num(base.texture), 0.0, 1.0)  # the sum of texture and offset is clamped too
    color, weight = texture[:, :, :3], texture[:, :, 3] * (inside > 0)
    step = max(1.0, max(height, width) / _SIDE)
    size = max(1, round(width / step)), max(1, round(height / step))
    darkness = weight / (color @ _LUMINANCE + _DARK) ** 2
    pairs = (color, weight), (color * color, weight), (color, darkness)
    planes = (np.dstack([values * shares[:, :, None], shares]) for values, shares in pairs)
    mean, square, dark = (_neighbourhood_mean(plane.astype(np.float32), size) for plane in planes)
    typical = typical_color(_sampled(mean, _spokes(base.tex_coords[:1], base.tex_coords[1:])))
    return _Look(mean, np.sqrt(np.maximum(square - mean * mean, 0.0)), dark, typical)


def _alike_ones(base: BaseUmbrella, bases: Sequence[BaseUmbrella], looks: _Looks) -> tuple[list[BaseUmbrella], list]:
    """Other bases that trade colours with one, and how much."""
    others = [other for other in bases if other is not base]
    if not others:
        return [], []
    weights = alike(looks.of(base).typical, np.array([looks.of(other).typical for other in others]))
    kept = np.flatnonzero(weights > 0.0)
    return [others[i] for i in kept], [float(weights[i]) for i in kept]


def _neighbourhood_mean(weighted: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """(h, w, 3) means of (H, W, 4) weighted values and weight; far from all weight the whole's mean."""
    small = cv2.GaussianBlur(cv2.resize(weighted, size, interpolation=cv2.INTER_AREA), (0, 0), _LOCAL * max(size))
    whole = small.reshape(-1, 4).mean(axis=0)
    small = small + 1e-3 * whole + np.float32(1e-12)  # 1e-3: little where there is any weight; 1e-12: nothing at all
    return small[:, :, :3] / small[:, :, 3:]


def _sets(
    base: BaseUmbrella,
    references: Sequence[BaseUmbrella],
    weights: Sequence[float] | None,
    count: int,
    amount: float,
    rng: np.random.Generator,
    looks: _Looks,
) -> NDArray[np.float32]:
    look, spokes = looks.of(base), _spokes(base.tex_coords[:1], base.tex_coords[1:])
    mean, deviation, dark = (_sampled(image, spokes) for image in (look.mean, look.deviation, look.dark))
    drawn = rng.permutation(len(references))[:_MOST_REFERENCES]
    seen = [_seen_from(base, references[i], looks) for i in drawn]
    targets = target_colors(mean, deviation, seen, weights and [weights[i] for i in drawn])
    wanted = changed_means(mean, deviation, mixtures(targets, count, rng, len(seen)), amount) - mean
    outline = Outline(base.points[1:] - base.points[0])
    smoothing = _smoothing(outline)
    fitted = _along_spokes(wanted, outline, smoothing)
    fitted *= _suitable_share(fitted, mean, dark, smoothing)[:, :, None]
    low, high = _limits(mean, deviation)
    return (np.rint(np.clip(fitted, low, high) / _QUANTUM) * _QUANTUM).astype(np.float32)


def _spokes(centre: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, R, 2) points on the way from the centre to each of (N, 2) ends."""
    return centre + _SHARES[:, None] * (ends - centre)[:, None, :]


def _sampled(image: NDArray[np.float32], tex_coords: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 3) bilinear, border continued."""
    height, width = image.shape[:2]
    at = (tex_coords * (width, -height) + (0.0, height) - 0.5).astype(np.float32)
    flat = at.reshape(-1, 1, 2)
    values = cv2.remap(image, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return values.reshape(*at.shape[:-1], 3).astype(np.float64)


def _seen_from(base: BaseUmbrella, other: BaseUmbrella, looks: _Looks) -> NDArray[np.float64]:
    """(V - 1, R, 3) mean colours of the other element, linear, at the points that correspond to the base's spokes."""
    own, contour = (umbrella.points[1:] - umbrella.points[0] for umbrella in (base, other))
    turn = best_turn(own, contour)
    outline = Outline(contour)
    arcs = outline.arcs_towards(np.arctan2(own[:, 1], own[:, 0]) - turn)
    spokes = _spokes(other.tex_coords[:1], outline.at(arcs, other.tex_coords[1:]))
    return _sampled(looks.of(other).mean, spokes)


def _along_spokes(wanted: NDArray[np.float64], outline: Outline, smoothing: NDArray[np.float64]) -> NDArray[np.float64]:
    """(S, V, 3) offsets of centre and contour whose interpolation is nearest to (S, V - 1, R, 3) wanted ones.

    Least squares with the area that each sample stands for, which grows with its share of the way; the centre, which
    all sectors have in common, first. Then smoothed along the contour.
    """
    weight = _SHARES / _SHARES.sum()
    to_end, to_centre = weight * _SHARES, weight * (1.0 - _SHARES)
    end_end, end_centre = to_end @ _SHARES, to_end @ (1.0 - _SHARES)
    along_end, along_centre = to_end @ wanted, to_centre @ wanted  # (S, V - 1, 3)
    arcs = _sector_arcs(outline)
    reduced = along_centre - along_end * (end_centre / end_end)
    centre = np.einsum("v,svc->sc", arcs, reduced) / (to_centre @ (1.0 - _SHARES) - end_centre**2 / end_end)
    ends = (along_end - end_centre * centre[:, None]) / end_end
    return np.concatenate([centre[:, None], smoothing @ ends], axis=1)


def _suitable_share(
    fitted: NDArray[np.float64], mean: NDArray[np.float64], dark: NDArray[np.float64], smoothing: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(S, V) share of each vertex's offset that suits the dark texels around it; smooth along the contour."""
    ends, centre = fitted[:, 1:, None], fitted[:, :1, None]
    offset = centre + _SHARES[_SEEN, None] * (ends - centre)
    share = natural_share(offset, mean[:, _SEEN], dark[:, _SEEN]).astype(np.float64)
    least = np.maximum(share.min(axis=-1), 1e-3)  # 1e-3: a power of it is finite
    soft = (least**-_SOFTNESS @ smoothing.T) ** (-1.0 / _SOFTNESS)
    inner = share[..., 0].min(axis=1)
    return np.concatenate([inner[:, None], soft], axis=1)


def _sector_arcs(outline: Outline) -> NDArray[np.float64]:
    """(V - 1,) share of the perimeter that each corner stands for."""
    steps = np.diff(outline.arcs)
    return 0.5 * (steps + np.roll(steps, 1))


def _smoothing(outline: Outline) -> NDArray[np.float64]:
    """(V - 1, V - 1) Gaussian mean along the contour; rows sum to 1."""
    apart = outline.arcs[:-1, None] - outline.arcs[None, :-1]
    apart -= np.round(apart)
    weights = np.exp(-0.5 * (apart / _SMOOTH) ** 2) * (_sector_arcs(outline) + 1e-9)  # 1e-9: corners that coincide
    return weights / weights.sum(axis=1, keepdims=True)


def _limits(mean: NDArray[np.float64], deviation: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """(V, 3) lowest and highest offset that lets most texels around each vertex keep their detail."""
    low = -np.maximum(mean - _TENTH * deviation, _KEPT * mean)
    high = np.maximum(1.0 - mean - _TENTH * deviation, _KEPT * (1.0 - mean))
    return tuple(np.concatenate([limit[:, :1].mean(axis=0), limit[:, 1:].mean(axis=1)]) for limit in (low, high))
