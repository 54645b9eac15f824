"""A pinchmap as one image: the reconstructed picture, through the float64 twin of the shader (`pinchmap_twin`).

Edges are sharp at whatever size, so the picture may be as large as one likes; some pixels per texel of
the pinchmap show its curves. Its transitions are one pixel wide whatever ``inputs:antialias`` says, which is about the
pixels of a rendered image.
"""

from __future__ import annotations

import warnings
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
_BLOCK_ROWS = 256
_WHOLE = (0.0, 0.0, 1.0, 1.0)
_IDENTITY = (SCALE_ONE, BIAS_ZERO)


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
    levels = [np.asarray(level, np.float64) for level in mipmaps.pyramid(texels)]

    def sample(st: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
        return sample_pinchmap(pinchmap, levels, st, jacobian, wrap=wrap, line_width=line_width, line_color=line_color)

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
        return _raster(lambda st, jacobian: self._look_up(source, line, st, jacobian), (height, width), _WHOLE)

    def sample(self, st: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
        """(M, 4) float64, linear, premultiplied, scale and bias applied, at points (M, 2) of the unit square."""
        return self._look_up(self._data.signal, self._data.line_color, st, jacobian)

    def _look_up(
        self, source: ImageSource, line_color: tuple[float, ...], st: np.ndarray, jacobian: np.ndarray
    ) -> np.ndarray:
        levels, wrap = self._levels(source), _inner_wrap(self._cache.facts(source, self._path).wrap)
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
            self._known_levels[source] = [np.asarray(level, np.float64) for level in mipmaps.pyramid(texels)]
        return self._known_levels[source]

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


def _inner_wrap(wrap: tuple[str, str]) -> tuple[str, str]:
    """What is black outside, or a patch, keeps its border texels whole up to the border of the picture."""
    modes = [mode if mode in ("repeat", "mirror") else "clamp" for mode in wrap]
    return modes[0], modes[1]


def _plain(levels: list[np.ndarray], st: np.ndarray, jacobian: np.ndarray, wrap: tuple[str, str]) -> np.ndarray:
    height, width = levels[0].shape[:2]
    footprint = np.linalg.norm(jacobian * np.array([width, height])[:, None], axis=-2).max(axis=-1)
    lod = np.log2(np.maximum(footprint, 1e-30))  # 1e-30 keeps the logarithm of a point finite
    return trilinear(levels, st, np.broadcast_to(lod, len(st)), wrap)


def _raster(sample, shape: tuple[int, int], window: tuple[float, float, float, float]) -> np.ndarray:
    """(rows, columns, 4) float32: what `sample` gives at the centres of the pixels of a window."""
    rows, columns = shape
    s0, t0, s1, t1 = window
    step = np.array([(s1 - s0) / columns, (t0 - t1) / rows])
    out = np.empty((rows, columns, 4), np.float32)
    s = s0 + (np.arange(columns) + 0.5) * step[0]
    for top in range(0, rows, _BLOCK_ROWS):
        t = t1 + (np.arange(top, min(top + _BLOCK_ROWS, rows)) + 0.5) * step[1]
        st = np.stack(np.meshgrid(s, t), axis=-1).reshape(-1, 2)
        out[top : top + _BLOCK_ROWS] = sample(st, np.diag(step)).reshape(-1, columns, 4)
    return out
