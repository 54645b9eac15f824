"""From a source to the texels of its pinchmap and signal, before anything is written.

What the map covers (`pinchmap_window`), mask and gamma (`pinchmap_fit`), pinch strength (`pinchmap_strength`), and the
signal (`pinchmap_signal`), solved for with the pinchmap as its file will hold it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fexel_tools import pinchmap_stage
from fexel_tools.phases import Phases
from fexel_tools.pinchmap_auto import largest_auto_size, smallest_size
from fexel_tools.pinchmap_baking import WHOLE, reconstruct
from fexel_tools.pinchmap_fit import PinchmapFit, fit
from fexel_tools.pinchmap_ink import clear_of_lines
from fexel_tools.pinchmap_measure import mismatch, side_of_pixels
from fexel_tools.pinchmap_options import AUTO, PinchmapOptions, map_shape
from fexel_tools.pinchmap_signal import fill_signal
from fexel_tools.pinchmap_source import PinchmapSource, load_source
from fexel_tools.pinchmap_strength import boundary_strength
from fexel_tools.pinchmap_textures import as_stored
from fexel_tools.pinchmap_window import Window, choose_window, cut, matrix_of, roomy

__all__ = ["STEPS", "Pinchmap", "compute_pinchmap"]

STEPS = ("read", "fit", "signal", "textures", "stage", "fallback", "measure")
"""Phases of a pinchmap, in order; `compute_pinchmap` has the first three."""

_FIT_BITS = {"8": 8, "16": 16, "float": 32}


@dataclass(frozen=True, eq=False)
class Pinchmap:
    """A pinchmap as computed, not yet written.

    Attributes
    ----------
    source : PinchmapSource
    size : int
        Texels along the longer side.
    fit : PinchmapFit
    texels : (Nh, Nw, 4) float64
        The pinchmap as a renderer reads it from its file.
    signal : (Sh, Sw, 4) float32
        Linear (or data), straight alpha.
    wrap : (str, str)
    st_to_texture : (3, 3) float64
        From st of the source to the pinchmap's own, which covers what is to be seen of it; row vectors.
    """

    source: PinchmapSource
    size: int
    fit: PinchmapFit
    texels: np.ndarray
    signal: np.ndarray
    wrap: tuple[str, str]
    st_to_texture: np.ndarray

    @property
    def has_alpha(self) -> bool:
        """Whether anything is seen through the source."""
        return bool((self.source.opacity < 1.0).any())

    @property
    def texel_px(self) -> float:
        """Longer side of its texels in pixels of the source."""
        left, top, right, bottom = self.fit.window
        return max((right - left) / self.texels.shape[1], (bottom - top) / self.texels.shape[0])

    @property
    def detail_st(self) -> np.ndarray | None:
        """(4, 2) corners of where its lines are busiest, in st of the source; None where it has none."""
        return pinchmap_stage.busiest_window(self.fit.mask, self.st_to_texture)

    def picture(self, shape: tuple[int, int], window: tuple[float, float, float, float] = WHOLE) -> np.ndarray:
        """(rows, columns, 4) float32, linear, premultiplied: a window (s0, t0, s1, t1) of the source as it is shown."""
        return reconstruct(self.texels, self.signal, shape, self.wrap, window=window, st_to_texture=self.st_to_texture)


def compute_pinchmap(file: str, options: PinchmapOptions, phases: Phases | None = None) -> Pinchmap:
    """From a source to the texels of pinchmap and signal.

    Parameters
    ----------
    file : str
    options : PinchmapOptions
    phases : Phases, optional
        Is told how long reading, fitting and filling take.

    Raises
    ------
    FexelError
        The source cannot be used.
    """
    phases = phases or Phases("pinchmap", STEPS)
    with phases("read"):
        source = load_source(
            file,
            size=None if options.size == AUTO else (int(options.size), int(options.size)),
            regions=options.regions or None,
            mask=options.mask or None,
            raw=options.is_data,
            seed=options.seed,
        )
    with phases("fit"):
        size, fitted = _fit(source, options)
    with phases("signal"):
        finer = _signal_ratio(size, options)
        shape = (fitted.pinchmap.shape[0] * finer, fitted.pinchmap.shape[1] * finer)
        seen = _cut(source, fitted.window)
        texels = fitted.pinchmap.copy()
        texels[..., :2] *= boundary_strength(seen.side, texels, shape, wrap=options.wrap)[..., None]
        texels = as_stored(texels, options.bits)
        signal = fill_signal(seen, texels, shape, wrap=options.wrap)
    matrix = matrix_of(fitted.window, source.side.shape)
    return Pinchmap(source, size, fitted, texels, signal, options.wrap, matrix)


def _fit(source: PinchmapSource, options: PinchmapOptions) -> tuple[int, PinchmapFit]:
    height, width = source.side.shape
    # A line is as wide as the texels are, which cropping would stretch.
    content = None if options.line_width > 0.0 else source.opacity > 0.0
    # What repeats or is mirrored outside of the map must be the whole picture.
    tiled = ("clamp" if options.wrap[0] == "clamp" else "repeat", "clamp" if options.wrap[1] == "clamp" else "repeat")

    def attempt(size: int) -> PinchmapFit:
        shape = map_shape(width, height, size)
        window = choose_window(source.side, shape, wrap=tiled, content=content)
        fitted = _fit_window(source.side, shape, roomy(window, shape, source.side.shape), options)
        return _with_room_for_lines(fitted, source, options) if options.line_width > 0.0 else fitted

    if options.size == AUTO:
        return smallest_size(attempt, options.tolerance, largest_auto_size(width, height), str(source.path))
    size = int(options.size)
    return size, attempt(size)


def _fit_window(side: np.ndarray, shape: tuple[int, int], window: Window, options: PinchmapOptions) -> PinchmapFit:
    """Fit to the window and a cell around it; what lies further out is transparent and stays on its side."""
    height, width = side.shape
    margin = -(-(window[2] - window[0]) // shape[1]), -(-(window[3] - window[1]) // shape[0])
    x0, y0 = max(window[0] - margin[0], 0), max(window[1] - margin[1], 0)
    part = np.ascontiguousarray(side[y0 : min(window[3] + margin[1], height), x0 : min(window[2] + margin[0], width)])
    moved = (window[0] - x0, window[1] - y0, window[2] - x0, window[3] - y0)
    bits = _FIT_BITS[options.bits]
    fitted = fit(part, shape, wrap=options.wrap, seed=options.seed, bits=bits, window=moved)
    faults = tuple(replace(fault, x=fault.x + x0, y=fault.y + y0) for fault in fitted.faults)
    return replace(fitted, mismatch=fitted.mismatch * part.size / side.size, window=window, faults=faults)


def _with_room_for_lines(fitted: PinchmapFit, source: PinchmapSource, options: PinchmapOptions) -> PinchmapFit:
    pinchmap = clear_of_lines(fitted.pinchmap, options.line_width)
    result = side_of_pixels(pinchmap, source.side.shape, options.wrap, window=fitted.window)
    return replace(fitted, pinchmap=pinchmap, mismatch=mismatch(result, source.side))


def _cut(source: PinchmapSource, window: Window) -> PinchmapSource:
    """The part of a source that its pinchmap covers."""
    height, width = source.side.shape
    if tuple(window) == (0, 0, width, height):
        return source
    color, opacity, side = (cut(plane, window) for plane in (source.color, source.opacity, source.side))
    return replace(source, color=color, opacity=opacity, side=side)


def _signal_ratio(size: int, options: PinchmapOptions) -> int:
    """2^K; the largest that `signal_size` allows."""
    return 1 << max(0, (options.signal_size // size).bit_length() - 1)
