"""Transfer of local mean colours from element to element, in Oklab.

The mean becomes the reference's (after Reinhard et al., Color transfer between images, 2001, who do so in
l-alpha-beta), the pattern of colours a part of the reference's and a part of the element's; mixtures of two references
lie between them. Oklab: Ottosson, A perceptual color space for image processing, 2020; colour-science, which has it
too, takes a second to import.

What is found is reached by adding light (notes U1), which scales no contrast. So a neighbourhood changes less where
that would show: added light veils what is dark, what turns orange into green turns white beside it into cyan, and what
turns a green leaf brown leaves its dark creases nothing but red. Another paint would scale the light of dark and light
texels alike: `natural_share` is how far an offset may go until dark ones differ from that.

Arrays are (V, R, 3): V spokes, R samples along each; a neighbourhood's mean and deviation are linear Rec.709.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "alike",
    "changed_means",
    "from_oklab",
    "mixtures",
    "natural_share",
    "target_colors",
    "to_oklab",
    "typical_color",
]

# Linear Rec.709 to XYZ by IEC 61966-2-1; XYZ to cones and their cube roots to Oklab by Ottosson.
_XYZ_FROM_RGB = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
_LMS_FROM_XYZ = np.array(
    [
        [0.8189330101, 0.3618667424, -0.1288597137],
        [0.0329845436, 0.9293118715, 0.0361456387],
        [0.0482003018, 0.2643662691, 0.6338517070],
    ]
)
_LAB_FROM_ROOTS = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)
_LMS_FROM_RGB = _LMS_FROM_XYZ @ _XYZ_FROM_RGB
_RGB_FROM_LMS, _ROOTS_FROM_LAB = np.linalg.inv(_LMS_FROM_RGB), np.linalg.inv(_LAB_FROM_ROOTS)

_PATTERN = 0.4  # share of the reference's own pattern of colours; the rest is the base's
_LIGHTER = 0.35  # of its Oklab lightness: by that a neighbourhood grows lighter at most
_MOTLEY = 0.2  # linear: deviation beside light and shade at which a neighbourhood takes half of a change
_OWN_SPREAD = 1.2  # standard deviations of its own colours that a lone element varies by
_COMPANY = 2.0  # references of about its colour with which an element needs no variation of its own
_OWN_MOST = 0.06  # Oklab: by that at most
_ALIKE, _UNLIKE = 0.07, 0.16  # Oklab: differences of mean colours up to which elements trade all, from which nothing
_LIGHTNESS = 0.4  # weight of lightness in that difference, against hue and chroma
_STRANGE = 0.035  # Oklab: by that dark texels may differ in hue and chroma from a natural change
_VEIL, _SHADE = 0.5, 0.2  # weight of their lightness, where it is more, and less


def typical_color(mean: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) an element's mean colour in Oklab, of (V, R, 3) linear means."""
    return to_oklab(mean).mean(axis=(0, 1))


def alike(own: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """(T,) how much elements may trade colours, 1 to 0, by (3,) and (T, 3) typical colours in Oklab."""
    apart = np.linalg.norm((others - own) * (_LIGHTNESS, 1.0, 1.0), axis=-1)
    share = np.clip((_UNLIKE - apart) / (_UNLIKE - _ALIKE), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def target_colors(
    mean: NDArray[np.float64],
    deviation: NDArray[np.float64],
    references: Sequence[NDArray[np.float64]],
    weights: Sequence[float] | None = None,
) -> NDArray[np.float64]:
    """(T, V, R, 3) colours in Oklab that an element may take: its own, then one for each reference's means.

    Parameters
    ----------
    mean, deviation : (V, R, 3) float64
    references : sequence of (V, R, 3) float64
    weights : sequence of float, optional
        How far the element goes to each reference, in [0, 1]; the less it goes to any, the more it also varies by as
        much as it does within. Default: all the way to each.
    """
    own = to_oklab(mean)
    targets = [own]
    alone = 1.0 if not references else 0.0 if weights is None else 1.0 - sum(weights) / _COMPANY
    if alone > 0.0:
        targets += [own + alone * shift for shift in _own_variation(own, to_oklab(mean + deviation))]
    for reference, weight in zip(references, weights or [1.0] * len(references), strict=True):
        targets.append(own + weight * (_transferred(own, to_oklab(reference)) - own))
    return np.stack(targets)


def mixtures(
    targets: NDArray[np.float64], count: int, rng: np.random.Generator, references: int = 0
) -> NDArray[np.float64]:
    """(count, V, R, 3) mixtures of two targets each, nearer to one of them than even; all pairs about as often.

    Of the last so many targets, which are references, if there are any, each pair has one.
    """
    start = len(targets) - references if references else 1
    pairs = np.array([(i, j) for i in range(start, len(targets)) for j in range(i)])
    pairs = pairs[rng.permutation(len(pairs))][np.arange(count) % len(pairs)]
    first, second = targets[pairs[:, 0]], targets[pairs[:, 1]]
    share = rng.random(count)
    share *= share * (3.0 - 2.0 * share)
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
    own = to_oklab(mean)
    return from_oklab(own + amount * _one_hue(mean, deviation) * _unveiled(own, wanted - own))


def natural_share(
    offset: NDArray[np.floating], mean: NDArray[np.float64], dark: NDArray[np.float64]
) -> NDArray[np.float32]:
    """(S, V, R) share of an offset up to which dark texels keep about the hue that the neighbourhood takes.

    Parameters
    ----------
    offset : (S, V, R, 3)
        Linear, to be added to all texels.
    mean, dark : (V, R, 3) float64
        Of the neighbourhood and of its dark texels, linear.
    """
    around, deep = (np.maximum(values, 1e-4).astype(np.float32) for values in (mean, dark))  # 1e-4: black has no hue
    added = np.maximum(offset, -around).astype(np.float32)
    share = np.minimum(1.0, _STRANGE / np.maximum(_strangeness(added, around, deep), 1e-6))  # 1e-6: no difference
    less = share < 1.0  # the difference grows only about linearly
    around, deep = (np.broadcast_to(values, added.shape)[less] for values in (around, deep))
    part = added[less] * share[less][:, None]
    share[less] *= np.minimum(1.0, _STRANGE / np.maximum(_strangeness(part, around, deep), 1e-6))
    return share


def _strangeness(
    offset: NDArray[np.float32], mean: NDArray[np.float32], dark: NDArray[np.float32]
) -> NDArray[np.float32]:
    """(...) difference in Oklab, of (..., 3), between dark texels plus an offset and scaled as the mean is."""
    to_cones, to_lab = _LMS_FROM_RGB.T.astype(np.float32), _LAB_FROM_ROOTS.T.astype(np.float32)
    shown = np.cbrt(np.clip(dark + offset, 0.0, 1.0) @ to_cones)
    natural = np.cbrt(np.clip(dark * (1.0 + offset / mean), 0.0, 1.0) @ to_cones)
    away = (shown - natural) @ to_lab
    away[..., 0] *= np.where(away[..., 0] > 0.0, _VEIL, _SHADE).astype(np.float32)
    return np.linalg.norm(away, axis=-1)


def _transferred(own: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """The other's mean and patterns of both, nowhere beyond the range of lightness, a and b that the two have."""
    own_mean, other_mean = own.mean(axis=(0, 1)), other.mean(axis=(0, 1))
    mixed = other_mean + _PATTERN * (other - other_mean) + (1.0 - _PATTERN) * (own - own_mean)
    shown = np.concatenate([own, other])
    return np.clip(mixed, shown.min(axis=(0, 1)), shown.max(axis=(0, 1)))


def _own_variation(own: NDArray[np.float64], brighter: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """(3,) shifts: the element lighter, darker, redder ..., along the principal axes of its colours."""
    values = np.concatenate([own, brighter, 2.0 * own - brighter]).reshape(-1, 3)
    variances, axes = np.linalg.eigh(np.cov(values, rowvar=False))
    sizes = np.minimum(_OWN_SPREAD * np.sqrt(np.maximum(variances, 0.0)), _OWN_MOST)
    return [sign * shift for shift in sizes[:, None] * axes.T for sign in (1.0, -1.0)]


def _one_hue(mean: NDArray[np.float64], deviation: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 1) how much a neighbourhood is one hue in light and shade, its channels varying in proportion: 1 if so."""
    shade = (deviation / np.maximum(mean, 1e-6)).min(axis=-1, keepdims=True)  # 1e-6: a channel without light
    odd = np.linalg.norm(deviation - shade * mean, axis=-1, keepdims=True)
    return 1.0 / (1.0 + (odd / _MOTLEY) ** 2)


def _unveiled(own: NDArray[np.float64], change: NDArray[np.float64]) -> NDArray[np.float64]:
    """Changes in Oklab, shortened where they lighten too much: dark parts of a pattern stay dark."""
    most = _LIGHTER * np.maximum(own[..., :1], 0.0)
    return change * np.minimum(1.0, most / np.maximum(change[..., :1], most + 1e-9))  # 1e-9: black stays black


def to_oklab(rgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 3) of linear Rec.709."""
    return np.cbrt(np.asarray(rgb, np.float64) @ _LMS_FROM_RGB.T) @ _LAB_FROM_ROOTS.T


def from_oklab(lab: NDArray[np.float64]) -> NDArray[np.float64]:
    """(..., 3) linear Rec.709, clipped to [0, 1]."""
    return np.clip((lab @ _ROOTS_FROM_LAB.T) ** 3 @ _RGB_FROM_LMS.T, 0.0, 1.0)
