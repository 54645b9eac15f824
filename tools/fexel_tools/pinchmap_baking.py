"""A pinchmap as one image: the reconstructed picture, through the float64 twin of the shader (`pinchmap_twin`).

Edges are sharp at whatever size, so the picture may be as large as one likes; some pixels per texel of
the pinchmap show its curves. Its transitions are one pixel wide whatever ``inputs:antialias`` says, which is about the
pixels of a rendered image.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fexel import homography, mipmaps
from fexel.textures.image_source import BIAS_ZERO, SCALE_ONE, ImageSource
from fexel.textures.page_texels import decode_page
from fexel.textures.pinchmap import PinchmapData
from fexel.textures.pinchmap_lattice import Lattice
from fexel.textures.pinchmap_texels import CONSTANT, PinchmapTexels
from fexel.textures.pinchmap_twin import picture_levels, sample_pinchmap
from fexel.textures.pyramid_cache import PyramidCache
from fexel_tools.baking import Storage, storage_of

__all__ = ["WHOLE", "baker", "reconstruct"]

WHOLE = (0.0, 0.0, 1.0, 1.0)
"""All of st in [0, 1], as a window (s0, t0, s1, t1)."""

_PIXELS_PER_TEXEL = 12
_BLOCK = 1 << 17  # points looked up at a time
_UNPLACED = np.eye(3)
_NEAREST_W = 1e-9  # of the homogeneous coordinate: what lies nearer to infinity is not drawn
_IDENTITY = (SCALE_ONE, BIAS_ZERO)


def reconstruct(
    pinchmap: np.ndarray,
    signal: np.ndarray,
    shape: tuple[int, int],
    wrap: tuple[str, str] = ("clamp", "clamp"),
    *,
    window: tuple[float, float, float, float] = WHOLE,
    line_width: float = 0.0,
    line_color: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0),
    st_to_texture: np.ndarray = _UNPLACED,
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
        What it shows, in st.
    line_width : float
        Pinchmap texels.
    line_color : 4 floats
        Linear, straight alpha.
    st_to_texture : (3, 3) float64
        Row vectors: ``inputs:matrix``.

    Returns
    -------
    (rows, columns, 4) float32
        Linear, premultiplied.
    """
    texels = np.array(signal, np.float64)
    texels[..., :3] *= texels[..., 3:]
    return _drawn(_Drawing(pinchmap, texels, wrap, line_width, line_color, st_to_texture), shape, window)


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
    st_to_texture: np.ndarray

    @property
    def is_upright(self) -> bool:
        """Whether rows and columns of st are rows and columns of the texture."""
        off = self.st_to_texture[[0, 0, 1, 1], [1, 2, 0, 2]]
        return not off.any() and self.st_to_texture[2, 2] == 1.0

    def at(self, st: np.ndarray, jacobian: np.ndarray, levels: list[np.ndarray]) -> np.ndarray:
        """`sample` of ``inputs:st``; transparent where that lies at or behind infinity."""
        in_front = st @ self.st_to_texture[:2, 2] + self.st_to_texture[2, 2] > _NEAREST_W
        out = np.zeros((len(st), 4))
        place = homography.apply(self.st_to_texture, st[in_front])
        stretch = homography.jacobian(self.st_to_texture, st[in_front])
        out[in_front] = self.sample(place, stretch @ jacobian, levels)
        return out

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
        scale = 1.0
        if self._nested.pinchmap[..., :2].any():
            scale = max(1.0, _PIXELS_PER_TEXEL * self._nested.pinchmap.shape[1] / width)
        stretch = homography.jacobian(self._nested.st_to_texture, np.array([[0.5, 0.5]]))[0]
        across = np.linalg.norm(stretch * np.array([[width], [height]]) * scale, axis=0)
        return max(1, round(across[0])), max(1, round(across[1]))

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
        return _drawn(self._drawing(source, line), (height, width), WHOLE)

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
        found = self._pinchmaps.source(self._data.pinchmap, self._path, facts.info, (s, t))
        if found is None:
            source = replace(source, file="")
            facts, found = self._cache.facts(source, self._path), CONSTANT
        stored = self._cache.window(source, self._path, 0, (0, 0, *facts.size))[1:-1, 1:-1]
        signal = decode_page(stored, facts.page_class).astype(np.float64)
        pinchmap = self._pinchmaps.texels(found, self._path)
        if found is CONSTANT:
            pinchmap = np.broadcast_to(pinchmap[0, 0], signal.shape)
        return _Drawing(pinchmap, signal, (s, t), self._data.line_width, line_color, np.array(self._data.st_to_texture))


def _drawn(drawing: _Drawing, shape: tuple[int, int], window: tuple[float, float, float, float]) -> np.ndarray:
    """(rows, columns, 4) float32: a window at a size, anti-aliased over one pixel."""
    rows, columns = shape
    s0, t0, s1, t1 = window
    step = np.array([(s1 - s0) / columns, (t0 - t1) / rows])
    if drawing.is_upright:
        texels = np.abs(step * drawing.st_to_texture[[0, 1], [0, 1]]) * drawing.signal.shape[1::-1]
        if (texels <= 1).all():
            return _magnified(drawing, shape, window)
    out = np.empty((rows, columns, 4), np.float32)
    s = s0 + (np.arange(columns) + 0.5) * step[0]
    strip = max(1, _BLOCK // columns)
    for top in range(0, rows, strip):
        t = t1 + (np.arange(top, min(top + strip, rows)) + 0.5) * step[1]
        st = np.stack(np.meshgrid(s, t), axis=-1).reshape(-1, 2)
        out[top : top + strip] = drawing.at(st, np.diag(step), drawing.levels).reshape(-1, columns, 4)
    return out


def _magnified(drawing: _Drawing, shape: tuple[int, int], window: tuple[float, float, float, float]) -> np.ndarray:
    """`_drawn` where no pixel is larger than a texel: only where something is pinched need it be looked up.

    Elsewhere the picture is the signal, bilinearly interpolated.
    """
    s0, t0, s1, t1 = window
    matrix = drawing.st_to_texture
    s = (s0 + (np.arange(shape[1]) + 0.5) * ((s1 - s0) / shape[1])) * matrix[0, 0] + matrix[2, 0]
    t = (t1 + (np.arange(shape[0]) + 0.5) * ((t0 - t1) / shape[0])) * matrix[1, 1] + matrix[2, 1]
    out = _interpolated(drawing.signal, s, t, drawing.wrap)
    cells = Lattice(drawing.pinchmap, drawing.wrap).active_cells()
    cell_column = (_wrapped(s, drawing.wrap[0]) * cells.shape[1]).astype(int).clip(0, cells.shape[1] - 1)
    cell_row = ((1 - _wrapped(t, drawing.wrap[1])) * cells.shape[0]).astype(int).clip(0, cells.shape[0] - 1)
    row, column = np.nonzero(cells[cell_row[:, None], cell_column])
    jacobian = np.diag([(s1 - s0) / shape[1] * matrix[0, 0], (t0 - t1) / shape[0] * matrix[1, 1]])
    for start in range(0, len(row), _BLOCK):
        y, x = row[start : start + _BLOCK], column[start : start + _BLOCK]
        out[y, x] = drawing.sample(np.stack([s[x], t[y]], axis=1), jacobian, [drawing.signal])
    return out


def _wrapped(coordinate: np.ndarray, mode: str) -> np.ndarray:
    """Coordinates within [0, 1], as a wrap mode has it."""
    if mode == "repeat":
        return coordinate - np.floor(coordinate)
    if mode == "mirror":
        return np.abs(coordinate - 2 * np.floor(0.5 * coordinate + 0.5))
    return coordinate.clip(0, 1)


def _interpolated(signal: np.ndarray, s: np.ndarray, t: np.ndarray, wrap: tuple[str, str]) -> np.ndarray:
    """(rows, columns, 4) float32: the signal at a grid of texture coordinates, as its wrap modes continue it."""
    modes = ["wrap" if mode == "repeat" else "edge" for mode in wrap]  # mirrored, the border meets itself
    padded = np.pad(signal.astype(np.float32), ((1, 1), (0, 0), (0, 0)), mode=modes[1])  # pyright: ignore[reportCallIssue, reportArgumentType]
    padded = np.pad(padded, ((0, 0), (1, 1), (0, 0)), mode=modes[0])  # pyright: ignore[reportCallIssue, reportArgumentType]
    low_x, weight_x = _neighbours(_wrapped(s, wrap[0]), signal.shape[1])
    low_y, weight_y = _neighbours(1 - _wrapped(t, wrap[1]), signal.shape[0])
    wide = padded[:, low_x] + (padded[:, low_x + 1] - padded[:, low_x]) * weight_x[None, :, None]
    return wide[low_y] + (wide[low_y + 1] - wide[low_y]) * weight_y[:, None, None]


def _neighbours(coordinate: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Lower texel of coordinates in [0, 1], numbered with one texel of border, and the weight of the next one."""
    position = coordinate * size + 0.5
    low = np.floor(position).clip(0, size)
    return low.astype(int), (position - low).astype(np.float32)
