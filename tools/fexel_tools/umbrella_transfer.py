"""Transfer of local mean colours from element to element, in Oklab.

Mean and spread become the reference's, partly with its own pattern of colours, partly with the element's (after
Reinhard et al., Color transfer between images, 2001, who do so in l-alpha-beta); mixtures of two references go on
between, and a little beyond them. Oklab: Ottosson, A perceptual color space for image processing, 2020, by
colour-science.

What is found is reached by adding light (notes U1), which scales no contrast. So a neighbourhood changes less where
that would show: added light veils what is dark, and what turns orange into green turns white beside it into cyan.

Arrays are (V, R, 3): V spokes, R samples along each; a neighbourhood's mean and deviation are linear Rec.709.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["changed_means", "mixtures", "target_colors"]

_PATTERN = 0.7  # share of the reference's own pattern of colours; the rest is the base's, with the reference's spread
_SPREAD = (0.5, 2.0)  # factor on the base's spread at most
_BEYOND = 0.15  # how far a mixture may lie beyond its two references, as a share of their difference
_LIGHTER = 0.4  # of its Oklab lightness: by that a neighbourhood grows lighter at most
_MOTLEY = 0.2  # linear: deviation beside light and shade at which a neighbourhood takes half of a change
_OWN_SPREAD = 1.2  # standard deviations of its own colours that a lone element varies by


def target_colors(
    mean: NDArray[np.float64], deviation: NDArray[np.float64], references: Sequence[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """(T, V, R, 3) colours in Oklab that an element may take: its own, then one for each reference's means.

    Without references it varies by as much as it does within.
    """
    own = _to_oklab(mean)
    if not references:
        return np.stack([own, *_own_variation(own, _to_oklab(mean + deviation))])
    return np.stack([own, *(_transferred(own, _to_oklab(reference)) for reference in references)])


def mixtures(targets: NDArray[np.float64], count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(count, V, R, 3) mixtures of two targets each, all pairs about as often."""
    pairs = np.array([(i, j) for i in range(len(targets)) for j in range(i)])
    pairs = pairs[rng.permutation(len(pairs))][np.arange(count) % len(pairs)]
    share = (1.0 + 2.0 * _BEYOND) * rng.random(count) - _BEYOND
    first, second = targets[pairs[:, 0]], targets[pairs[:, 1]]
    return first + share[:, None, None, None] * (second - first)


def changed_means(
    mean: NDArray[np.float64], deviation: NDArray[np.float64], wanted: NDArray[np.float64], amount: float
) -> NDArray[np.float64]:
    """(S, V, R, 3) linear means, in [0, 1], after going as far as is good towards colours wanted in Oklab.

    Parameters
    ----------
    mean, deviation : (V, R, 3) float64
    wanted : (S, V, R, 3) float64
    amount : float
        Share of the way, in [0, 1].
    """
    own = _to_oklab(mean)
    return _from_oklab(own + amount * _one_hue(mean, deviation) * _unveiled(own, wanted - own))


def _transferred(own: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    own_mean, other_mean = own.mean(axis=(0, 1)), other.mean(axis=(0, 1))
    own_spread, other_spread = own.std(axis=(0, 1)), other.std(axis=(0, 1))
    factor = np.clip(other_spread / np.maximum(own_spread, 1e-6), *_SPREAD)  # 1e-6: an element of one colour
    return other_mean + _PATTERN * (other - other_mean) + (1.0 - _PATTERN) * factor * (own - own_mean)


def _own_variation(own: NDArray[np.float64], brighter: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """The element lighter, darker, redder ..., along the principal axes of its colours."""
    values = np.concatenate([own, brighter, 2.0 * own - brighter]).reshape(-1, 3)
    variances, axes = np.linalg.eigh(np.cov(values, rowvar=False))
    shifts = _OWN_SPREAD * np.sqrt(np.maximum(variances, 0.0))[:, None] * axes.T
    return [own + sign * shift for shift in shifts for sign in (1.0, -1.0)]


def _one_hue(mean: NDArray[np.float64], deviation: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 1) how much a neighbourhood is one hue in light and shade, its channels varying in proportion: 1 if so."""
    shade = (deviation / np.maximum(mean, 1e-6)).min(axis=-1, keepdims=True)  # 1e-6: a channel without light
    odd = np.linalg.norm(deviation - shade * mean, axis=-1, keepdims=True)
    return 1.0 / (1.0 + (odd / _MOTLEY) ** 2)


def _unveiled(own: NDArray[np.float64], change: NDArray[np.float64]) -> NDArray[np.float64]:
    """Changes in Oklab, shortened where they lighten too much: dark parts of a pattern stay dark."""
    most = _LIGHTER * np.maximum(own[..., :1], 0.0)
    return change * np.minimum(1.0, most / np.maximum(change[..., :1], most + 1e-9))  # 1e-9: black stays black


def _to_oklab(rgb: NDArray[np.float64]) -> NDArray[np.float64]:
    import colour  # takes a second to import; only where colours vary

    return colour.XYZ_to_Oklab(rgb @ colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ.T)


def _from_oklab(lab: NDArray[np.float64]) -> NDArray[np.float64]:
    """Linear Rec.709, clipped to [0, 1]."""
    import colour

    to_rgb = np.linalg.inv(colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ)
    return np.clip(colour.Oklab_to_XYZ(lab) @ to_rgb.T, 0.0, 1.0)
