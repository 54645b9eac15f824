"""A pinchmap as one image: the reconstructed picture, through the float64 twin of the shader (`pinchmap_twin`).

Edges are sharp at whatever size, so the picture may be as large as one likes; some pixels per texel of
the pinchmap show its curves. Its transitions are one pixel wide whatever ``inputs:antialias`` says, which is about the
pixels of a rendered image.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np

from fexel import mipmaps
from fexel.errors import FexelError, FexelWarning
from fexel.images import image_info, read_pixels
from fexel.textures.image_source import BIAS_ZERO, SCALE_ONE, ImageSource
from fexel.textures.pinchmap import PinchmapData
from fexel.textures.pinchmap_lattice import trilinear
from fexel.textures.pinchmap_twin import decode_texels, sample_pinchmap, signal_half_texel
from fexel.textures.pyramid_cache import PyramidCache
from fexel_tools.baking import Storage, linear_texels, storage_of

__all__ = ["baker", "reconstruct"]

_PIXELS_PER_TEXEL = 16
_CHANNELS = 4
_BLOCK = 1 << 17  # points looked up at a time
_WHOLE = (0.0, 0.0, 1.0, 1.0)
_IDENTITY = (SCALE_ONE, BIAS_ZERO)

_Sample = Callable[[np.ndarray, np.ndarray], np.ndarray]  # st (M, 2), jacobian: rgba (M, 4)


def reconstruct(
    pinchmap: np.ndarray,
    signal: np.ndarray,
    shape: tuple[int, int],
    wrap: tuple[str, str] = ("clamp", "clamp"),
    *,
    window: tuple[float, float, float, float] = _WHOLE,
    line_width: float = 0.0,
    line_color: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0),
) -> np.ndarray:
    """The picture that a pinchmap and its signal make, anti-aliased over one pixel.

    Parameters
    ----------
    pinchmap : (Nh, Nw, 4) float
    signal : (2^K Nh, 2^K Nw, 4) float
        Linear (or data), straight alpha.
    shape : (int, int)
        Rows and columns of the picture.
    wrap : (str, str)
    window : (s0, t0, s1, t1)
        What it shows of texture space.
    line_width : float
        Pinchmap texels.
    line_color : 4 floats
        Linear, straight alpha.

    Returns
    -------
    (rows, columns, 4) float32
        Linear, premultiplied.
    """
    texels = np.array(signal, np.float64)
    texels[..., :3] *= texels[..., 3:]
    levels = _pyramid(texels)

    def sample(st: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
        return sample_pinchmap(pinchmap, levels, st, jacobian, wrap=wrap, line_width=line_width, line_color=line_color)

    if window == _WHOLE and shape[0] >= levels[0].shape[0] and shape[1] >= levels[0].shape[1]:
        return _magnified(sample, pinchmap, levels[0], shape, wrap)
    return _raster(sample, shape, window)


def baker(data: PinchmapData, path: str) -> _PinchmapBaker:
    """Baker of a pinchmap, `fexel_tools.baking.NestedBaker`; `path` is the prim to name in messages."""
    return _PinchmapBaker(data, path)


class _PinchmapBaker:
    """A pinchmap's files, read when they are first needed.

    The picture keeps the signal's stored values wherever the scale can be undone for the fallback colour and the line,
    to which it does not apply; else it is applied to the texels.
    """

    def __init__(self, data: PinchmapData, path: str) -> None:
        self._data = data
        self._path = path
        self._cache = PyramidCache()
        shared = (data.signal.scale, data.signal.bias)
        self._shared = shared if shared != _IDENTITY and all(data.signal.scale) else _IDENTITY

    @property
    def storage(self) -> Storage:
        """How the picture is to be stored."""
        return storage_of(self._data.signal, self._cache, self._path, *self._shared)

    @property
    def texels(self) -> tuple[int, int]:
        """Width and height of the picture that shows the curves of the pinchmap and all of the signal."""
        height, width = self._levels(self._data.signal)[0].shape[:2]
        if self._pinchmap is None:
            return width, height
        scale = max(1.0, _PIXELS_PER_TEXEL * self._pinchmap.shape[1] / width)
        return round(width * scale), round(height * scale)

    def size(self, largest: int) -> tuple[int, int]:
        """Width and height of the picture, at most `largest` a side."""
        width, height = self.texels
        scale = min(1.0, largest / max(width, height))
        return max(1, round(width * scale)), max(1, round(height * scale))

    def bake(self, width: int, height: int) -> np.ndarray:
        """(height, width, 4) float32, linear, premultiplied; scale and bias of `storage` are not applied."""
        scale, bias = self._shared
        source = self._data.signal
        if self._shared != _IDENTITY:
            fallback = tuple((v - b) / s for v, s, b in zip(source.fallback, scale, bias, strict=True))
            source = replace(source, scale=SCALE_ONE, bias=BIAS_ZERO, fallback=fallback)
        line = tuple((v - b) / s for v, s, b in zip(self._data.line_color, scale, bias, strict=True))
        levels = self._levels(source)
        rows, columns = levels[0].shape[:2]

        def sample(st: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
            return self._look_up(source, line, st, jacobian)

        if self._pinchmap is not None and height >= rows and width >= columns:
            return _magnified(sample, self._pinchmap, levels[0], (height, width), self._wrap(source))
        return _raster(sample, (height, width), _WHOLE)

    def sample(self, st: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
        """(M, 4) float64, linear, premultiplied, scale and bias applied, at points (M, 2) of the unit square."""
        return self._look_up(self._data.signal, self._data.line_color, st, jacobian)

    def _look_up(
        self, source: ImageSource, line_color: tuple[float, ...], st: np.ndarray, jacobian: np.ndarray
    ) -> np.ndarray:
        levels, wrap = self._levels(source), self._wrap(source)
        if self._is_broken:
            alpha = source.fallback[3]
            return np.tile([*np.multiply(source.fallback[:3], alpha), alpha], (len(st), 1))
        if self._pinchmap is None:
            return _plain(levels, st, jacobian, wrap)
        return sample_pinchmap(
            self._pinchmap,
            levels,
            st,
            jacobian,
            wrap=wrap,
            line_width=self._data.line_width,
            line_color=line_color,
        )

    def _levels(self, source: ImageSource) -> list[np.ndarray]:
        """Mip levels of the signal, (h, w, 4) float64, linear, premultiplied."""
        if source not in self._known_levels:
            facts = self._cache.facts(source, self._path)
            stored = self._cache.window(source, self._path, 0, (0, 0, *facts.size))[1:-1, 1:-1]
            texels = linear_texels(stored, facts.page_class)
            self._known_levels[source] = _pyramid(texels)
        return self._known_levels[source]

    def _wrap(self, source: ImageSource) -> tuple[str, str]:
        """What is black outside, or a patch, keeps its border texels whole up to the border of the picture."""
        modes = self._cache.facts(source, self._path).wrap
        s, t = (mode if mode in ("repeat", "mirror") else "clamp" for mode in modes)
        return s, t

    @cached_property
    def _known_levels(self) -> dict[ImageSource, list[np.ndarray]]:
        return {}

    @cached_property
    def _pinchmap(self) -> np.ndarray | None:
        """(Nh, Nw, 4) float64, or None where there is none that can be used."""
        file = self._data.pinchmap
        if not file:
            return None
        try:
            info = image_info(file)
            if info.channels != _CHANNELS:
                raise FexelError(f"{file}: {info.channels} channels, expected {_CHANNELS} (d_s, d_t, k, gamma)")
            signal = self._levels(self._data.signal)[0].shape
            if signal_half_texel((info.width, info.height), (signal[1], signal[0])) is None:
                raise FexelError(
                    f"{file}: {info.width} x {info.height} texels with a signal of {signal[1]} x {signal[0]}, expected "
                    "the signal's size divided by 1, 2, 4 or another power of two"
                )
            return decode_texels(read_pixels(info))
        except FexelError as error:
            message = f"{self._path}.inputs:pinchmap: {error}; inputs:fallback is shown"
            warnings.warn(message, FexelWarning, stacklevel=2)
            return None

    @property
    def _is_broken(self) -> bool:
        return bool(self._data.pinchmap) and self._pinchmap is None


def _pyramid(texels: np.ndarray) -> list[np.ndarray]:
    return [np.asarray(level, np.float64) for level in mipmaps.pyramid(texels)]


def _plain(levels: list[np.ndarray], st: np.ndarray, jacobian: np.ndarray, wrap: tuple[str, str]) -> np.ndarray:
    height, width = levels[0].shape[:2]
    footprint = np.linalg.norm(jacobian * np.array([width, height])[:, None], axis=-2).max(axis=-1)
    lod = np.log2(np.maximum(footprint, 1e-30))  # 1e-30 keeps the logarithm of a point finite
    return trilinear(levels, st, np.broadcast_to(lod, len(st)), wrap)


def _magnified(
    sample: _Sample, pinchmap: np.ndarray, signal: np.ndarray, shape: tuple[int, int], wrap: tuple[str, str]
) -> np.ndarray:
    """`_raster` of the whole at no less than the signal's size: only where something is pinched is `sample` needed.

    Elsewhere the picture is the signal, bilinearly interpolated.
    """
    rows, columns = shape
    s, t = (np.arange(columns) + 0.5) / columns, 1 - (np.arange(rows) + 0.5) / rows
    out = _interpolated(signal, shape, wrap)
    cells = _pinched_cells(pinchmap, wrap)
    cell_row = ((1 - t) * cells.shape[0]).astype(int)
    cell_column = (s * cells.shape[1]).astype(int)
    row, column = np.nonzero(cells[cell_row[:, None], cell_column])
    jacobian = np.diag([1 / columns, -1 / rows])
    for start in range(0, len(row), _BLOCK):
        y, x = row[start : start + _BLOCK], column[start : start + _BLOCK]
        out[y, x] = sample(np.stack([s[x], t[y]], axis=1), jacobian)
    return out


def _interpolated(signal: np.ndarray, shape: tuple[int, int], wrap: tuple[str, str]) -> np.ndarray:
    """(rows, columns, 4) float32: the signal at the pixels' centres, as its wrap modes continue it."""
    modes = ["wrap" if mode == "repeat" else "edge" for mode in wrap]  # mirrored, the border meets itself
    padded = np.pad(signal.astype(np.float32), ((1, 1), (0, 0), (0, 0)), mode=modes[1])  # pyright: ignore[reportCallIssue, reportArgumentType]
    padded = np.pad(padded, ((0, 0), (1, 1), (0, 0)), mode=modes[0])  # pyright: ignore[reportCallIssue, reportArgumentType]
    (low_y, high_y, weight_y), (low_x, high_x, weight_x) = (
        _neighbours(count, size) for count, size in zip(shape, signal.shape, strict=False)
    )
    wide = padded[:, low_x] + (padded[:, high_x] - padded[:, low_x]) * weight_x[None, :, None]
    return wide[low_y] + (wide[high_y] - wide[low_y]) * weight_y[:, None, None]


def _neighbours(count: int, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower and upper texel of `count` pixels, numbered with one texel of border, and the upper one's weight."""
    position = (np.arange(count) + 0.5) * (size / count) + 0.5
    low = np.floor(position)
    return low.astype(int), low.astype(int) + 1, (position - low).astype(np.float32)


def _pinched_cells(pinchmap: np.ndarray, wrap: tuple[str, str]) -> np.ndarray:
    """(Nh, Nw) bool: whether any corner of a cell has a direction, row 0 at the top."""
    modes = ["wrap" if mode == "repeat" else "edge" for mode in wrap]
    moved = (pinchmap[..., :2] != 0).any(axis=2)
    moved = np.pad(moved, ((1, 0), (0, 0)), mode=modes[1])  # pyright: ignore[reportCallIssue, reportArgumentType]
    moved = np.pad(moved, ((0, 0), (0, 1)), mode=modes[0])  # pyright: ignore[reportCallIssue, reportArgumentType]
    return moved[:-1, :-1] | moved[:-1, 1:] | moved[1:, :-1] | moved[1:, 1:]


def _raster(sample: _Sample, shape: tuple[int, int], window: tuple[float, float, float, float]) -> np.ndarray:
    """(rows, columns, 4) float32: what `sample` gives at the centres of the pixels of a window."""
    rows, columns = shape
    s0, t0, s1, t1 = window
    step = np.array([(s1 - s0) / columns, (t0 - t1) / rows])
    out = np.empty((rows, columns, 4), np.float32)
    s = s0 + (np.arange(columns) + 0.5) * step[0]
    strip = max(1, _BLOCK // columns)
    for top in range(0, rows, strip):
        t = t1 + (np.arange(top, min(top + strip, rows)) + 0.5) * step[1]
        st = np.stack(np.meshgrid(s, t), axis=-1).reshape(-1, 2)
        out[top : top + strip] = sample(st, np.diag(step)).reshape(-1, columns, 4)
    return out
