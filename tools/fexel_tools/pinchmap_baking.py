"""A pinchmap as one image: the reconstructed picture, through the float64 twin of the shader (`pinchmap_twin`).

Edges are sharp at whatever size, so the picture may be as large as one likes; some pixels per texel of
the pinchmap show its curves. Its transitions are one pixel wide whatever ``inputs:antialias`` says, which is about the
pixels of a rendered image.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fexel import mipmaps
from fexel.textures.image_source import BIAS_ZERO, SCALE_ONE, ImageSource
from fexel.textures.pinchmap import PinchmapData
from fexel.textures.pinchmap_lattice import Lattice
from fexel.textures.pinchmap_texels import CONSTANT, PinchmapTexels
from fexel.textures.pinchmap_twin import picture_levels, sample_pinchmap
from fexel.textures.pyramid_cache import PyramidCache
from fexel_tools.baking import Storage, linear_texels, storage_of

__all__ = ["baker", "reconstruct"]

_PIXELS_PER_TEXEL = 16
_BLOCK = 1 << 17  # points looked up at a time
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
    return _drawn(_Drawing(pinchmap, texels, wrap, line_width, line_color), shape, window)


def baker(data: PinchmapData, path: str) -> _PinchmapBaker:
    """Baker of a pinchmap, `fexel_tools.baking.NestedBaker`; `path` is the prim to name in messages."""
    return _PinchmapBaker(data, path)


@dataclass(frozen=True, eq=False)
class _Drawing:
    """What is drawn: pinchmap, signal (h, w, 4) float64, linear, premultiplied, and how."""

    pinchmap: np.ndarray
    signal: np.ndarray
    wrap: tuple[str, str]
    line_width: float
    line_color: tuple[float, ...]

    def sample(self, st: np.ndarray, jacobian: np.ndarray, levels: list[np.ndarray]) -> np.ndarray:
        """(M, 4) float64 from mip levels of the signal, or of the picture."""
        return sample_pinchmap(
            self.pinchmap,
            levels,
            st,
            jacobian,
            wrap=self.wrap,
            line_width=self.line_width,
            line_color=self.line_color,
        )

    @cached_property
    def levels(self) -> list[np.ndarray]:
        """Mip levels to look the picture up in at any size."""
        return picture_levels(
            self.pinchmap,
            mipmaps.pyramid(self.signal),
            line_width=self.line_width,
            line_color=self.line_color,
            wrap=self.wrap,
        )


class _PinchmapBaker:
    """A pinchmap's files, read when they are first needed.

    The picture keeps the signal's stored values wherever the scale can be undone for the fallback colour and the line,
    to which it does not apply; else it is applied to the texels.
    """

    def __init__(self, data: PinchmapData, path: str) -> None:
        self._data = data
        self._path = path
        self._cache = PyramidCache()
        self._pinchmaps = PinchmapTexels()
        shared = (data.signal.scale, data.signal.bias)
        self._shared = shared if shared != _IDENTITY and all(data.signal.scale) else _IDENTITY

    @property
    def storage(self) -> Storage:
        """How the picture is to be stored: in as many bits as the signal."""
        storage = storage_of(self._data.signal, self._cache, self._path, *self._shared)
        info = self._cache.facts(self._data.signal, self._path).info
        return replace(storage, dtype="uint8") if info is not None and info.dtype == "uint8" else storage

    @property
    def texels(self) -> tuple[int, int]:
        """Width and height of the picture that shows the curves of the pinchmap and all of the signal."""
        height, width = self._nested.signal.shape[:2]
        if not self._nested.pinchmap[..., :2].any():
            return width, height
        scale = max(1.0, _PIXELS_PER_TEXEL * self._nested.pinchmap.shape[1] / width)
        return round(width * scale), round(height * scale)

    def size(self, largest: int) -> tuple[int, int]:
        """Width and height of the picture, at most `largest` a side."""
        width, height = self.texels
        scale = min(1.0, largest / max(width, height))
        return max(1, round(width * scale)), max(1, round(height * scale))

    def bake(self, width: int, height: int) -> np.ndarray:
        """(height, width, 4) float32, linear, premultiplied; scale and bias of `storage` are not applied."""
        scale, bias = self._shared
        source, line = self._data.signal, self._data.line_color
        if self._shared != _IDENTITY:
            fallback, line = (
                tuple((v - b) / s for v, s, b in zip(color, scale, bias, strict=True))
                for color in (source.fallback, line)
            )
            source = replace(source, scale=SCALE_ONE, bias=BIAS_ZERO, fallback=fallback)
        return _drawn(self._drawing(source, line), (height, width), _WHOLE)

    def sample(self, st: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
        """(M, 4) float64, linear, premultiplied, scale and bias applied, at points (M, 2) of the unit square."""
        return self._nested.sample(st, jacobian, self._nested.levels)

    @cached_property
    def _nested(self) -> _Drawing:
        return self._drawing(self._data.signal, self._data.line_color)

    def _drawing(self, source: ImageSource, line_color: tuple[float, ...]) -> _Drawing:
        """The files as they are drawn; a pinchmap that cannot be used shows the fallback colour instead."""
        facts = self._cache.facts(source, self._path)
        s, t = (mode if mode in ("repeat", "mirror") else "clamp" for mode in facts.wrap)
        found = self._pinchmaps.source(self._data.pinchmap, self._path, facts.info, (s == "repeat", t == "repeat"))
        if found is None:
            source = replace(source, file="")
            facts, found = self._cache.facts(source, self._path), CONSTANT
        stored = self._cache.window(source, self._path, 0, (0, 0, *facts.size))[1:-1, 1:-1]
        signal = linear_texels(stored, facts.page_class).astype(np.float64)
        pinchmap = self._pinchmaps.texels(found)
        if found is CONSTANT:
            pinchmap = np.broadcast_to(pinchmap[0, 0], signal.shape)
        return _Drawing(pinchmap, signal, (s, t), self._data.line_width, line_color)


def _drawn(drawing: _Drawing, shape: tuple[int, int], window: tuple[float, float, float, float]) -> np.ndarray:
    """(rows, columns, 4) float32: a window at a size, anti-aliased over one pixel."""
    if window == _WHOLE and shape[0] >= drawing.signal.shape[0] and shape[1] >= drawing.signal.shape[1]:
        return _magnified(drawing, shape)
    rows, columns = shape
    s0, t0, s1, t1 = window
    step = np.array([(s1 - s0) / columns, (t0 - t1) / rows])
    out = np.empty((rows, columns, 4), np.float32)
    s = s0 + (np.arange(columns) + 0.5) * step[0]
    strip = max(1, _BLOCK // columns)
    for top in range(0, rows, strip):
        t = t1 + (np.arange(top, min(top + strip, rows)) + 0.5) * step[1]
        st = np.stack(np.meshgrid(s, t), axis=-1).reshape(-1, 2)
        out[top : top + strip] = drawing.sample(st, np.diag(step), drawing.levels).reshape(-1, columns, 4)
    return out


def _magnified(drawing: _Drawing, shape: tuple[int, int]) -> np.ndarray:
    """`_drawn` of the whole at no less than the signal's size: only where something is pinched need it be looked up.

    Elsewhere the picture is the signal, bilinearly interpolated.
    """
    rows, columns = shape
    s, t = (np.arange(columns) + 0.5) / columns, 1 - (np.arange(rows) + 0.5) / rows
    out = _interpolated(drawing.signal, shape, drawing.wrap)
    cells = Lattice(drawing.pinchmap, drawing.wrap).active_cells()
    cell_row = ((1 - t) * cells.shape[0]).astype(int)
    cell_column = (s * cells.shape[1]).astype(int)
    row, column = np.nonzero(cells[cell_row[:, None], cell_column])
    jacobian = np.diag([1 / columns, -1 / rows])
    for start in range(0, len(row), _BLOCK):
        y, x = row[start : start + _BLOCK], column[start : start + _BLOCK]
        out[y, x] = drawing.sample(np.stack([s[x], t[y]], axis=1), jacobian, [drawing.signal])
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
