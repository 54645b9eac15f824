"""The signal texture of a pinchmap: the texels that show a picture best through the pinch.

Section 7.2, step 5 of Tarini and Cignoni 2005 carries pixels back through the inverse of the pinch and averages them.
Here the texels are the least squares solution of the forward model instead: pixel -> pinched position (hard edge) ->
bilinear weights of four texels (`pinchmap_equations`). No inverse is needed, a texel that is stretched over many pixels
or squeezed under few is treated alike, and the bilinear interpolation's own blur is made up for.

- *Sides never mix.* A pixel whose own side is not the one that the fitted line gives it is left out where the texture
  is pinched, and a pixel whose neighbourhood holds both sides hardly counts: it may be a mixture of both. What lies
  half a texel or more beyond the line counts nevertheless: a feature that is not on the map is better blurred than
  lost.
- *The space of the error* is that in which pictures are looked at: colour is fitted in sRGB encoding, straight,
  weighted by its opacity, so that invisible colour does not count but stays plausible; alpha for itself; raw data
  as it is. Renderers interpolate in linear light, premultiplied: where the picture is uneven, one step of Gauss and
  Newton makes up for the difference (0.2 to 0.4 dB on pictures with colour edges within a side).
- *Texels that no pixel reaches* continue their neighbours of the same side (a membrane, far weaker than any pixel).
- *No ringing beyond the picture*: the least squares are bounded by the least and the largest value of the source.
- *Nor within it, of alpha*: where all that a texel sees of its own side is transparent, or all is opaque, to a step of
  8 bits, its alpha is exactly 0 or 1, and the others are solved around it. Otherwise mixed pixels at the line leave a
  halo of a few steps around a cut-out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel.images import linear_to_srgb, srgb_to_linear
from fexel_tools.pinchmap_equations import MOMENTS, accumulate, alpha_masses, stencils
from fexel_tools.pinchmap_solver import conjugate_gradients, projected_sweeps, squared_error

if TYPE_CHECKING:
    from fexel_tools.pinchmap_source import PinchmapSource

__all__ = ["cell_sides", "fill_signal", "signal_levels"]

_MEMBRANE = 1e-4  # of the mean weight of a texel
_PRIOR = 1e-9  # of the same: where even the membrane is torn off, the mean of the picture's side
_TOLERANCE = 1e-6
_TOLERANCE_OF_CORRECTION = 1e-3
_STEPS = 400
_SWEEPS = 6
_UNEVEN = (
    1 / 510
)  # root mean square error, encoded, below which a picture is as good as reproduced: half a step of 8 bits
_ROWS_FOR_CORRECTION = 4  # of pixels, in a texel: so many show what is lacking
_ALPHA_STEP = 1 / 255 + 1e-6  # 1e-6: alpha is float32
_STRAY = 0.005  # of a texel's weights: so many may come from elsewhere, for pixels at the line touch both sides' texels
_LEAST_ALPHA = 1e-3  # of a texel whose colour is compared: keeps premultiplied colours apart where nothing is seen
_TABLE = linear_to_srgb(np.linspace(0, 1, 4097) ** 2)
_NO_TABLE = np.zeros(0, np.float32)
_NO_TEXELS = np.zeros((0, 0, 4))


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
    view = _View(source, pinchmap, signal_shape, (wrap[0] == "repeat", wrap[1] == "repeat"))
    bounds, squares, matrix, right = view.equations()
    weight = matrix[0].sum()
    _add_membrane(matrix, right, view)
    channels = [_solved(matrix[0], right[..., c], bounds[:, c]) for c in range(3)]
    signal = np.stack([*channels, _solved_alpha(matrix[1], right[..., 3], bounds[:, 3], view)], axis=-1)
    error = sum(squares[c] + squared_error(matrix[0], _plane(right, c), _plane(signal, c)) for c in range(3))
    if not source.is_data and error > 3 * _UNEVEN**2 * weight:
        _correct(signal, bounds, view)
    signal = signal[::-1]
    rgb = signal[..., :3] if source.is_data else srgb_to_linear(signal[..., :3])
    return np.concatenate([rgb, signal[..., 3:]], axis=-1).astype(np.float32)


@dataclass(frozen=True, eq=False)
class _View:
    """A picture seen through a pinchmap; `wraps`: whether texels repeat along s and t."""

    source: PinchmapSource
    pinchmap: NDArray[np.float64]
    signal_shape: tuple[int, int]
    wraps: tuple[bool, bool]

    def settled_alpha(self) -> NDArray[np.float64]:
        """(Sh, Sw): 0 or 1 where a texel's alpha is that and nothing else, NaN elsewhere; rows upwards."""
        masses = alpha_masses(
            np.ascontiguousarray(self.source.opacity, np.float32),
            np.ascontiguousarray(self.source.side, np.float32),
            _padded(self.pinchmap[::-1], self.wraps),
            self.signal_shape,
            self.wraps,
            _ALPHA_STEP,
        )
        seen, clear, opaque = np.moveaxis(masses, -1, 0)
        least = (1.0 - _STRAY) * np.where(seen > 0.0, seen, np.inf)
        return np.where(clear >= least, 0.0, np.where(opaque >= least, 1.0, np.nan))

    def equations(self, texels: NDArray[np.float64] = _NO_TEXELS, every: int = 1):
        """Bounds (2, 4), weighted squares (4,), normal matrix (2, Sh, Sw, 9) and right side; rows upwards.

        Of the picture; given the linear, premultiplied texels of a signal, of what that lacks. From every so manieth
        row of pixels.
        """
        source = self.source
        moments = np.zeros((self.signal_shape[0] + 1, self.signal_shape[1] + 1, MOMENTS))
        summary = accumulate(
            np.ascontiguousarray(source.color, np.float32),
            np.ascontiguousarray(source.opacity, np.float32),
            np.ascontiguousarray(source.side, np.float32),
            _padded(self.pinchmap[::-1], self.wraps),
            self.signal_shape,
            self.wraps,
            _NO_TABLE if source.is_data else _TABLE,
            texels,
            every,
            moments,
        )
        bounds = summary[:2] if np.isfinite(summary[:2]).all() else np.zeros((2, 4))  # not a single pixel counts
        return bounds, summary[2], *stencils(moments, *self.wraps)


def _correct(signal, bounds, view: _View) -> None:
    """One step of Gauss and Newton for the colours, in place: they are interpolated in linear light, premultiplied."""
    alpha = np.maximum(signal[..., 3:], _LEAST_ALPHA)
    texels = np.concatenate([srgb_to_linear(signal[..., :3]) * alpha, alpha], axis=-1)
    every = min(max(view.source.side.shape[0] // view.signal_shape[0] // _ROWS_FOR_CORRECTION, 1), 4)
    _, _, matrix, lacking = view.equations(texels, every)
    _add_membrane(matrix, lacking, view)
    anything = np.array([-np.inf, np.inf])
    for c in range(3):
        step = _solved(matrix[0], lacking[..., c], anything, _TOLERANCE_OF_CORRECTION)
        signal[..., c] = np.clip(signal[..., c] + step, *bounds[:, c])


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


def _add_membrane(matrix, right, view: _View) -> None:
    """Join texels that no discontinuity separates, weakly, and draw all still more weakly to the mean of their side."""
    finer = view.signal_shape[0] // view.pinchmap.shape[0]
    wrap = tuple("repeat" if repeats else "clamp" for repeats in view.wraps)
    sides = _magnified(cell_sides(view.pinchmap, wrap)[::-1], finer)
    strength = _magnified(_cell_strength(view.pinchmap[::-1], view.wraps), finer)
    joins = [_joins(sides, strength, axis, view.wraps[1 - axis]) for axis in (0, 1)]
    for kind, channels in ((0, slice(0, 3)), (1, slice(3, 4))):
        mean = max(matrix[kind].sum() / sides.size, 1e-30)  # 1e-30: a picture without a pixel that counts
        for join, axis, step in zip(joins, (0, 1), (3, 1), strict=True):
            weight = _MEMBRANE * mean * join
            matrix[kind, ..., 4] += weight + np.roll(weight, 1, axis)
            matrix[kind, ..., 4 + step] -= weight
            matrix[kind, ..., 4 - step] -= np.roll(weight, 1, axis)
        for here in (sides, ~sides):
            total = matrix[kind][here].sum()
            if total > 0:
                right[here, channels] += _PRIOR * mean * (right[here, channels].sum(axis=0) / total)
        matrix[kind, ..., 4] += _PRIOR * mean


def _joins(sides, strength, axis: int, wraps: bool) -> NDArray[np.float64]:
    """How far each texel is joined to the next along an axis: across a discontinuity as far as that is not pinched."""
    join = np.where(sides == np.roll(sides, -1, axis), 1.0, 1.0 - np.minimum(strength, np.roll(strength, -1, axis)))
    if not wraps:
        np.moveaxis(join, axis, 0)[-1] = 0.0
    return join


def _magnified(cells: NDArray, finer: int) -> NDArray:
    return cells.repeat(finer, axis=0).repeat(finer, axis=1)


def _cell_strength(pinchmap, wraps) -> NDArray[np.float64]:
    """Largest pinch strength at the corners of every cell. Rows upwards."""
    active = pinchmap[..., 2] == 0
    strength = _padded((np.abs(pinchmap[..., :2]).max(axis=-1) * active)[..., None], wraps)[..., 0]
    return np.maximum.reduce([strength[:-1, :-1], strength[:-1, 1:], strength[1:, :-1], strength[1:, 1:]])


def _plane(planes: NDArray[np.float64], channel: int) -> NDArray[np.float64]:
    return np.ascontiguousarray(planes[..., channel])


def _solved_alpha(matrix, right, bounds, view: _View) -> NDArray[np.float64]:
    """(Sh, Sw) texels of alpha: the settled ones as they are, the others as the least squares around those."""
    if bounds[0] == bounds[1]:
        return _solved(matrix, right, bounds)
    settled = np.clip(view.settled_alpha(), *bounds)
    fixed = np.isfinite(settled)
    value = np.where(fixed, settled, 0.0)
    matrix, right = matrix.copy(), right.copy()
    for entry in range(9):
        step = (1 - entry // 3, 1 - entry % 3)  # rolls the neighbour to where the entry is
        right -= matrix[..., entry] * np.roll(value, step, (0, 1))
        if entry != 4:
            matrix[..., entry] *= ~(fixed | np.roll(fixed, step, (0, 1)))
    right[fixed] = (matrix[..., 4] * value)[fixed]
    texels = _solved(matrix, right, bounds)
    texels[fixed] = settled[fixed]
    return texels


def _solved(matrix, right, bounds, tolerance: float = _TOLERANCE) -> NDArray[np.float64]:
    """(Sh, Sw) texels of one channel within the bounds."""
    right = np.ascontiguousarray(right)
    low, high = bounds
    texels = np.clip(right / (matrix.sum(axis=-1) + 1e-9 * matrix[..., 4]), low, high)  # 1e-9: rows may sum to 0
    if low == high:
        return texels
    conjugate_gradients(matrix, right, texels, tolerance, _STEPS)
    if texels.min() < low or texels.max() > high:
        np.clip(texels, low, high, out=texels)
        projected_sweeps(matrix, right, texels, low, high, _SWEEPS)
    return texels
