"""The signal texture of a pinchmap: the texels that show a picture best through the pinch.

Section 7.2, step 5 of Tarini and Cignoni 2005 carries pixels back through the inverse of the pinch and averages them.
Here the texels are the least squares solution of the forward model instead: pixel -> pinched position (hard edge) ->
bilinear weights of four texels (`pinchmap_equations`). No inverse is needed, a texel that is stretched over many pixels
or squeezed under few is treated alike, and the bilinear interpolation's own blur is made up for.

- *Sides never mix.* A pixel whose own side is not the one that the fitted line gives it is left out where the texture
  is pinched, and a pixel whose neighbourhood holds both sides hardly counts: it may be a mixture of both.
- *The space of the error* is that in which pictures are looked at: colour is fitted in sRGB encoding, straight,
  weighted by its opacity, so that invisible colour does not count but stays plausible; alpha for itself; raw data
  as it is. Renderers interpolate in linear light; between texels of one side the difference is of second order.
- *Texels that no pixel reaches* continue their neighbours of the same side (a membrane, far weaker than any pixel).
- *No ringing beyond the picture*: the least squares are bounded by the least and the largest value of the source.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel.images import linear_to_srgb, srgb_to_linear
from fexel_tools.pinchmap_equations import MOMENTS, accumulate, conjugate_gradients, projected_sweeps, stencils

if TYPE_CHECKING:
    from fexel_tools.pinchmap_source import PinchmapSource

__all__ = ["cell_sides", "fill_signal", "signal_levels"]

_MEMBRANE = 1e-4  # of the mean weight of a texel
_PRIOR = 1e-9  # of the same: where even the membrane is torn off, the mean of the picture's side
_TOLERANCE = 1e-6
_STEPS = 400
_SWEEPS = 6
_TABLE = linear_to_srgb(np.linspace(0, 1, 4097) ** 2)
_NO_TABLE = np.zeros(0, np.float32)


def fill_signal(
    source: PinchmapSource,
    pinchmap: NDArray[np.floating],
    signal_shape: tuple[int, int],
    *,
    wrap: tuple[str, str] = ("clamp", "clamp"),
) -> NDArray[np.float32]:
    """Texels of the signal that reproduce a picture under a pinchmap.

    Parameters
    ----------
    source : PinchmapSource
        (H, W) pixels, any size, also smaller than the signal. Pixels with a value that is not finite are left out.
    pinchmap : (Nh, Nw, 4) float
        d_s, d_t, k, gamma as they will be rendered, pinch strength included.
    signal_shape : (int, int)
        Rows and columns, 2^K times the pinchmap's.
    wrap : (str, str)
        Along s and t: ``repeat`` joins the borders, anything else clamps.

    Returns
    -------
    (Sh, Sw, 4) float32
        Linear Rec.709 (or data) and alpha, straight; finite, within the range of the source.

    Raises
    ------
    FexelError
        The signal is not 2^K times the pinchmap, or the pinchmap has not four channels.
    """
    pinchmap = np.asarray(pinchmap, np.float64)
    signal_levels(pinchmap.shape, signal_shape, str(source.path))
    wraps = (wrap[0] == "repeat", wrap[1] == "repeat")
    moments = np.zeros((signal_shape[0] + 1, signal_shape[1] + 1, MOMENTS))
    extent = accumulate(
        np.ascontiguousarray(source.color, np.float32),
        np.ascontiguousarray(source.opacity, np.float32),
        np.ascontiguousarray(source.side, np.float32),
        _padded(pinchmap[::-1], wraps),
        signal_shape,
        wraps,
        _NO_TABLE if source.is_data else _TABLE,
        moments,
    )
    if not np.isfinite(extent).all():  # not a single pixel counts
        extent = np.zeros((2, 4))
    matrix, right = stencils(moments, *wraps)
    _add_membrane(matrix, right, pinchmap, signal_shape, wraps)
    signal = _solved(matrix, right, extent)[::-1]
    rgb = signal[..., :3] if source.is_data else srgb_to_linear(signal[..., :3])
    return np.concatenate([rgb, signal[..., 3:]], axis=-1).astype(np.float32)


def signal_levels(pinchmap_shape: tuple[int, ...], signal_shape: tuple[int, int], where: str) -> int:
    """K: how many times the signal's sides are twice the pinchmap's.

    Raises
    ------
    FexelError
        As :func:`fill_signal`; the message begins with `where`.
    """
    if len(pinchmap_shape) != 3 or pinchmap_shape[2] != 4 or 0 in pinchmap_shape:
        raise FexelError(f"{where}: pinchmap of shape {pinchmap_shape}, expected (rows, columns, 4)")
    rows, columns = pinchmap_shape[:2]
    for level in range(32):
        if tuple(signal_shape) == (rows << level, columns << level):
            return level
    raise FexelError(
        f"{where}: signal of {signal_shape[1]} x {signal_shape[0]} texels for a pinchmap of {columns} x {rows}, "
        "expected 1, 2, 4, 8 ... times as many along both axes"
    )


def cell_sides(pinchmap: NDArray[np.floating], wrap: tuple[str, str] = ("clamp", "clamp")) -> NDArray[np.bool_]:
    """Side of every cell: the inverse of `pinchmap_mask.channels`.

    In a legal map every cell has a corner that is not active, whose k is the cell's side.

    Parameters
    ----------
    pinchmap : (Nh, Nw, >= 3) float
    wrap : (str, str)

    Returns
    -------
    (Nh, Nw) bool
        True: the side of k = +1, also where no corner tells.
    """
    wraps = (wrap[0] == "repeat", wrap[1] == "repeat")
    k = _padded(np.asarray(pinchmap)[::-1, :, 2:3], wraps)[..., 0]
    return (k[:-1, :-1] + k[:-1, 1:] + k[1:, :-1] + k[1:, 1:] >= 0)[::-1]


def _padded(pinchmap: NDArray[np.float64], wraps: tuple[bool, bool]) -> NDArray[np.float64]:
    """One row and one column more at the far ends, as the wrap mode has them."""
    modes = ["wrap" if repeats else "edge" for repeats in wraps]
    pinchmap = np.pad(pinchmap, ((0, 1), (0, 0), (0, 0)), mode=modes[1])  # pyright: ignore[reportCallIssue, reportArgumentType]
    return np.pad(pinchmap, ((0, 0), (0, 1), (0, 0)), mode=modes[0])  # pyright: ignore[reportCallIssue, reportArgumentType]


def _add_membrane(matrix, right, pinchmap, signal_shape, wraps) -> None:
    """Join texels that no discontinuity separates, weakly, and draw all still more weakly to the mean of their side."""
    level = signal_shape[0] // pinchmap.shape[0]
    wrap = tuple("repeat" if repeats else "clamp" for repeats in wraps)
    sides = cell_sides(pinchmap, wrap)[::-1].repeat(level, axis=0).repeat(level, axis=1)
    strength = _cell_strength(pinchmap[::-1], wraps).repeat(level, axis=0).repeat(level, axis=1)
    for kind in range(2):
        mean = max(matrix[kind].sum() / sides.size, 1e-30)  # 1e-30: a picture without a pixel that counts
        for axis, wraps_here in ((0, wraps[1]), (1, wraps[0])):
            joined = (
                _MEMBRANE
                * mean
                * np.where(
                    sides == np.roll(sides, -1, axis), 1.0, 1.0 - np.minimum(strength, np.roll(strength, -1, axis))
                )
            )
            if not wraps_here:
                joined[(-1,) if axis == 0 else (slice(None), -1)] = 0
            step = 3 if axis == 0 else 1
            matrix[kind, ..., 4] += joined + np.roll(joined, 1, axis)
            matrix[kind, ..., 4 + step] -= joined
            matrix[kind, ..., 4 - step] -= np.roll(joined, 1, axis)
        channels = slice(0, 3) if kind == 0 else slice(3, 4)
        for side in (False, True):
            here = sides == side
            total = matrix[kind][here].sum()
            prior = right[here][:, channels].sum(axis=0) / total if total > 0 else 0.0
            right[here, channels] += _PRIOR * mean * prior
        matrix[kind, ..., 4] += _PRIOR * mean


def _cell_strength(pinchmap, wraps) -> NDArray[np.float64]:
    """Largest pinch strength at the corners of every cell; 1 where no corner is active. Rows upwards."""
    d = _padded(np.abs(pinchmap[..., :2]).max(axis=-1, keepdims=True), wraps)[..., 0]
    active = _padded((pinchmap[..., 2:3] == 0).astype(np.float64), wraps)[..., 0] > 0
    strength = np.where(active, d, 0.0)
    return np.maximum.reduce([strength[:-1, :-1], strength[:-1, 1:], strength[1:, :-1], strength[1:, 1:]])


def _solved(matrix, right, extent) -> NDArray[np.float64]:
    """(Sh, Sw, 4) texels within the bounds, in the space of the error."""
    signal = np.empty_like(right)
    for channel in range(4):
        kind = 0 if channel < 3 else 1
        low, high = extent[:, channel]
        diagonal = matrix[kind, ..., 4]
        target = np.ascontiguousarray(right[..., channel])
        texels = np.clip(target / (matrix[kind].sum(axis=-1) + 1e-9 * diagonal), low, high)
        if high > low:
            conjugate_gradients(matrix[kind], target, texels, _TOLERANCE, _STEPS)
            if texels.min() < low or texels.max() > high:
                np.clip(texels, low, high, out=texels)
                projected_sweeps(matrix[kind], target, texels, low, high, _SWEEPS)
        signal[..., channel] = texels
    return signal
