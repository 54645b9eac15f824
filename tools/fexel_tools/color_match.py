"""Exposure and white balance of a child photo, brought to its parent's before the Poisson equation is solved.

Model, per channel c in linear light: ``parent = gain_c * child ** gamma``. Exposure and white balance are the gains;
gamma (one for all channels, 1 unless asked for) stands for a different tone curve. The parameters come from pixels that
show the same area: the child is reduced to the parent's resolution by area averaging, both are smoothed a little (the
parent is the blurrier one, and registration is not perfect), and log ratios are combined by a robust M-estimate (Huber
1964, iteratively reweighted least squares). Pixels near clipping or near black, in either image, say nothing about a
gain and are left out; clipping is looked for before averaging, since a mean hides it.

Haze adds light to a distant, narrow view: then no gain brings dark and bright parts together, and the model becomes
``parent = gain_c * child + offset_c``. The gain alone matters to the Poisson equation, which finds offsets by itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from fexel.errors import FexelError

__all__ = ["ColorMatch", "corresponding_colors", "match_color", "match_samples"]

_DARKEST = 0.004  # linear; below, 8-bit steps and noise are more than 10 % of the value
_BRIGHTEST = 0.98  # linear; at and above, a channel may be clipped
_FEWEST = 16  # pixels; fewer do not outvote a wrong one
_LARGEST_GAIN = 64.0  # six stops either way: beyond, the two do not show the same thing
_GAMMA_RANGE = (0.5, 2.0)
_VEILED = 0.25  # residual of the gains, natural logarithm, past which an offset is fitted too
_SMOOTHING = 1.5  # parent pixels, standard deviation


@dataclass(frozen=True, eq=False)
class ColorMatch:
    """What makes a child's colours its parent's.

    Attributes
    ----------
    gain : (3,) float64
        Linear light, parent over child; all 1 when there was not enough to go by.
    offset : (3,) float64
        Linear light, added after the gain; 0 unless there is a veil of haze.
    gamma : float
        Exponent on the child's linear value; 1 unless it was fitted.
    residual : float
        Robust standard deviation of what remains, natural logarithm (0.01 is about 1 %); NaN when nothing was fitted.
    samples : int
        Pixels used in the channel with the fewest.
    reason : str
        Why the match is the identity, or ''.
    """

    gain: np.ndarray = field(default_factory=lambda: np.ones(3))
    gamma: float = 1.0
    residual: float = float("nan")
    samples: int = 0
    reason: str = ""
    offset: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def apply(self, child: np.ndarray) -> np.ndarray:
        """Matched copy (H, W, 3) float32 of a linear image; not clipped. Negative values keep their sign."""
        child = np.asarray(child, np.float32)
        if self.gamma != 1.0:
            child = np.copysign(np.abs(child) ** np.float32(self.gamma), child)
        return child * np.asarray(self.gain, np.float32) + np.asarray(self.offset, np.float32)


def match_color(
    child: np.ndarray, parent: np.ndarray, parent_from_child: np.ndarray, *, fit_gamma: bool = False
) -> ColorMatch:
    """Gains that bring a child photo to its parent.

    Parameters
    ----------
    child, parent : (H, W, 3) float
        Linear Rec.709.
    parent_from_child : (3, 3) float
        Continuous pixel coordinates, column vectors.
    fit_gamma : bool
        Also fit one exponent; only where the child's values span a factor of 2.

    Returns
    -------
    ColorMatch
        The identity with a reason when too few pixels correspond.
    """
    return match_samples(*corresponding_colors(child, parent, parent_from_child), fit_gamma=fit_gamma)


def match_samples(child: np.ndarray, parent: np.ndarray, *, fit_gamma: bool = False) -> ColorMatch:
    """Gains from corresponding colours.

    Parameters
    ----------
    child, parent : (N, 3) float
        Linear; NaN or values outside (0.004, 0.98) are left out, channel by channel.
    fit_gamma : bool
        As for `match_color`.
    """
    child, parent = np.asarray(child, np.float64).reshape(-1, 3), np.asarray(parent, np.float64).reshape(-1, 3)
    if len(child) != len(parent):
        raise FexelError(f"colour match: {len(child)} child and {len(parent)} parent samples, expected as many")
    x, y, channel = [], [], []
    for c in range(3):
        use = _usable(child[:, c]) & _usable(parent[:, c])
        x.append(np.log(child[use, c]))
        y.append(np.log(parent[use, c]))
        channel.append(np.full(int(use.sum()), c))
    fewest = min(len(values) for values in x)
    if fewest < _FEWEST:
        return ColorMatch(samples=fewest, reason=f"{fewest} pixels that correspond, expected at least {_FEWEST}")
    x, y, channel = np.concatenate(x), np.concatenate(y), np.concatenate(channel)
    spread = np.subtract(*np.percentile(x, [95, 5]))
    log_gain, gamma, residual = _fit(x, y, channel, fit_gamma and spread > np.log(2))
    gain = np.exp(log_gain)
    if gain.max() > _LARGEST_GAIN or gain.min() < 1 / _LARGEST_GAIN:
        found = ", ".join(f"{value:.3g}" for value in gain)
        return ColorMatch(samples=fewest, reason=f"gains {found}, expected 1/{_LARGEST_GAIN:g} to {_LARGEST_GAIN:g}")
    if residual > _VEILED and gamma == 1.0:
        return _through_haze(np.exp(x), np.exp(y), channel, fewest) or ColorMatch(gain, gamma, residual, fewest)
    return ColorMatch(gain, gamma, residual, fewest)


def corresponding_colors(
    child: np.ndarray, parent: np.ndarray, parent_from_child: np.ndarray, largest: int = 256
) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed colours of both photos at the same places.

    Parameters
    ----------
    child, parent : (H, W, 3) float
        Linear.
    parent_from_child : (3, 3) float
        Continuous pixel coordinates, column vectors.
    largest : int
        Samples on the longer side of a regular grid over the child.

    Returns
    -------
    child_colors, parent_colors : (N, 3) float32
        NaN where a clipped or non-finite pixel went into a sample, or the parent does not reach.
    """
    height, width = child.shape[:2]
    step = max(1.0, max(height, width) / largest, _texels_of_child_per_parent(parent_from_child, height, width))
    columns, rows = max(1, round(width / step)), max(1, round(height / step))
    small = _reduced(child, columns, rows)
    child_from_grid = np.diag([width / columns, height / rows, 1.0])
    parent_on_grid = _warped(parent, parent_from_child @ child_from_grid, columns, rows)
    good = np.isfinite(small) & np.isfinite(parent_on_grid)  # the same pixels go into both means
    return _smoothed(small, good).reshape(-1, 3), _smoothed(parent_on_grid, good).reshape(-1, 3)


def _usable(values: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return (values > _DARKEST) & (values < _BRIGHTEST)


def _fit(x: np.ndarray, y: np.ndarray, channel: np.ndarray, with_slope: bool) -> tuple[np.ndarray, float, float]:
    """Intercept per channel and common slope of y over x, Huber's M-estimate; slope 1 unless asked for."""
    slope = 1.0
    intercept = np.array([np.median((y - x)[channel == c]) for c in range(3)])
    for _ in range(20):
        rest = y - slope * x - intercept[channel]
        scale = 1.4826 * float(np.median(np.abs(rest))) + 1e-9  # 1e-9: a perfect fit has no spread
        weight = np.minimum(1.0, 1.345 * scale / np.maximum(np.abs(rest), 1e-12))  # 1e-12: weight 1 at rest 0
        total = np.bincount(channel, weight, 3)
        mean_x, mean_y = np.bincount(channel, weight * x, 3) / total, np.bincount(channel, weight * y, 3) / total
        if with_slope:
            dx = x - mean_x[channel]
            slope = float((weight * dx * (y - mean_y[channel])).sum() / max((weight * dx * dx).sum(), 1e-12))
            slope = min(max(slope, _GAMMA_RANGE[0]), _GAMMA_RANGE[1])
        moved = mean_y - slope * mean_x - intercept
        intercept = intercept + moved
        if np.abs(moved).max() < 1e-6:
            break
    return intercept, slope, 1.4826 * float(np.median(np.abs(y - slope * x - intercept[channel])))


def _through_haze(x: np.ndarray, y: np.ndarray, channel: np.ndarray, samples: int) -> ColorMatch | None:
    """Gain and offset per channel, Huber's M-estimate in linear light; None unless gains lie within a factor of 4."""
    gain, offset, rest = np.ones(3), np.zeros(3), np.zeros(len(x))
    for c in range(3):
        mine = channel == c
        weight = np.ones(int(mine.sum()))
        for _ in range(20):
            gain[c], offset[c] = np.polyfit(x[mine], y[mine], 1, w=np.sqrt(weight))
            rest[mine] = y[mine] - gain[c] * x[mine] - offset[c]
            scale = 1.4826 * float(np.median(np.abs(rest[mine]))) + 1e-9  # 1e-9: a perfect fit has no spread
            weight = np.minimum(1.0, 1.345 * scale / np.maximum(np.abs(rest[mine]), 1e-12))
    if not (gain > 0.25).all() or not (gain < 4.0).all():
        return None
    residual = 1.4826 * float(np.median(np.abs(rest) / y))
    return ColorMatch(gain, 1.0, residual, samples, "", offset)


def _texels_of_child_per_parent(parent_from_child: np.ndarray, height: int, width: int) -> float:
    """Side of a parent pixel at the child's centre, in child pixels."""
    centre = np.array([width / 2, height / 2, 1.0])
    mapped = parent_from_child @ centre
    w = mapped[2]
    jacobian = (parent_from_child[:2, :2] - np.outer(mapped[:2] / w, parent_from_child[2, :2])) / w
    return 1.0 / max(np.sqrt(abs(np.linalg.det(jacobian))), 1e-6)  # 1e-6 guards a singular map


def _reduced(child: np.ndarray, columns: int, rows: int) -> np.ndarray:
    """Area averages (rows, columns, 3); NaN where any pixel is clipped or not finite. By channel, to spare memory."""
    small = np.empty((rows, columns, 3), np.float32)
    for c in range(3):
        channel = np.asarray(child[:, :, c], np.float32)
        good = channel < _BRIGHTEST  # false for NaN
        mean = cv2.resize(np.where(good, channel, np.float32(0)), (columns, rows), interpolation=cv2.INTER_AREA)
        share = cv2.resize(good.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
        small[:, :, c] = np.where(share > 0.999, mean, np.float32(np.nan))
    return small


def _warped(parent: np.ndarray, parent_from_grid: np.ndarray, columns: int, rows: int) -> np.ndarray:
    """Parent (rows, columns, 3) at the grid's sample centres; NaN outside and where a pixel is clipped."""
    parent = np.asarray(parent, np.float32)
    parent = np.where(parent < _BRIGHTEST, parent, np.float32(np.nan))  # also keeps NaN
    shift = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])  # OpenCV's first pixel centre is 0, ours 0.5
    index_map = np.linalg.inv(shift) @ parent_from_grid @ shift
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpPerspective(
        parent, index_map, (columns, rows), flags=flags, borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan,) * 3
    )


def _smoothed(colors: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Gaussian mean of the good values around each good one; NaN elsewhere."""
    clean, share = np.where(good, colors, np.float32(0)), good.astype(np.float32)
    total, weight = (cv2.GaussianBlur(a, (0, 0), _SMOOTHING, borderType=cv2.BORDER_REFLECT_101) for a in (clean, share))
    return np.where(good, total / np.maximum(weight, 1e-6), np.float32(np.nan))  # 1e-6: only where nothing is good
