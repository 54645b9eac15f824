"""All filters on an image in memory, in float64 NumPy: the oracle of shaders/image.glsl, and lookups without any GL."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fexel import mipmaps
from fexel.errors import FexelError
from fexel.filters import FILTERS, anisotropic, auto, ewa, fipmap, mipmap, ripmap
from fexel.filters.chain_layout import GAUSS_BLUR, SHORT_BLUR, ChainLayout
from fexel.filters.chain_texels import Cells, cells
from fexel.filters.lookup import SEAM, Choice, Taps
from fexel.filters.tiles import Tile, spread
from fexel.textures.pinchmap_lattice import trilinear

__all__ = ["FilterTwin"]

_Floats = NDArray[np.float64]
_Result = tuple[_Floats, NDArray[np.int64]]


class FilterTwin:
    """An image to look up.

    Parameters
    ----------
    image : (H, W, 4) float
        Linear, premultiplied, row 0 at the top.
    wrap : (str, str)
        Along x and y: ``repeat``, ``mirror``, ``clamp``, ``black`` or ``patch``.
    """

    def __init__(self, image: NDArray[np.floating], wrap: tuple[str, str]) -> None:
        self.image = np.asarray(image, np.float32)
        self.wrap = wrap
        self._chains: dict[tuple[int, float], tuple[ChainLayout, Cells]] = {}

    @cached_property
    def levels(self) -> list[NDArray[np.float32]]:
        """The image's own mip levels, rims of a patch cleared."""
        levels = mipmaps.pyramid(self.image)
        return [mipmaps.clear_rim(level) for level in levels] if "patch" in self.wrap else levels

    @property
    def own_wrap(self) -> tuple[str, str]:
        """Of the image's own mip levels; a patch is black outside."""
        s, t = ("black" if mode == "patch" else mode for mode in self.wrap)
        return s, t

    @property
    def _shape(self) -> dict[str, tuple]:
        """What places of accesses depend on."""
        x, y = (mode == "mirror" for mode in self.wrap)
        return {"size": (self.image.shape[1], self.image.shape[0]), "mirrored": (x, y)}

    @property
    def _tile(self) -> Tile:
        return Tile.of((self.image.shape[1], self.image.shape[0]), self.wrap)

    def sample(self, token: str, xy: _Floats, jacobian: _Floats, **options: Any) -> _Result:
        """Look pixels up.

        Parameters
        ----------
        token : str
            One of `fexel.filters.FILTERS`.
        xy : (M, 2) float64
            Texels of level 0, x right, y down, not wrapped; not a number is 0.
        jacobian : (M, 2, 2) float64
            d(texel)/d(pixel), column j per pixel along x, y; any values.
        **options
            ``probes`` of anisotropic (at most, default 16) and fipmap (along the long axis, default 4); ``gauss`` of
            fipmap (see `fexel.filters.fipmap.taps`; default 5 probes); of ewa and auto those of their ``sample``.

        Returns
        -------
        values : (M, 4) float64
            Linear, premultiplied.
        fetches : (M,) int64
            Texels: 4 per bilinear access.

        Raises
        ------
        FexelError
            There is no such filter.
        """
        if token not in FILTERS:
            raise FexelError(f"filter {token!r}: expected one of {', '.join(FILTERS)}")
        xy = np.nan_to_num(np.asarray(xy, np.float64))
        jacobian = np.asarray(jacobian, np.float64)
        if token in ("ripmap", "fipmap"):
            return (self._ripmap if token == "ripmap" else self._fipmap)(xy, jacobian, **options)
        if token == "auto":
            return auto.sample(self, xy, jacobian, **options)
        own = {"mipmap": mipmap.sample, "anisotropic": anisotropic.sample, "ewa": ewa.sample}[token]
        return own(self.levels, self.own_wrap, xy, jacobian, **options)

    def _ripmap(self, xy: _Floats, jacobian: _Floats) -> _Result:
        choice = spread(ripmap.choose(jacobian), self._tile, ripmap.PROBES)
        return self.look_up(choice, ripmap.taps(choice, xy, **self._shape))

    def _fipmap(self, xy: _Floats, jacobian: _Floats, probes: int | None = None, gauss: bool = False) -> _Result:
        probes = probes or (fipmap.GAUSS_PROBES if gauss else fipmap.PROBES)
        choice = spread(fipmap.choose(jacobian, probes, gauss=gauss), self._tile, probes, gauss=gauss)
        taps = fipmap.taps(choice, xy, jacobian, probes=probes, gauss=gauss, **self._shape)
        return self.look_up(choice, taps, GAUSS_BLUR if gauss else SHORT_BLUR)

    def look_up(self, choice: Choice, taps: Taps, blur: float = SHORT_BLUR) -> _Result:
        """The accesses of pixels, weighted, (M, 4), and texels fetched, (M,), those of no weight included.

        `blur` is that of the chains, see `ChainLayout`.
        """
        values = np.zeros((len(taps.at), 4))
        keys = np.stack([np.where(choice.octaves > 0, choice.direction, -1), choice.octaves, choice.level], 1)
        for key in np.unique(keys, axis=0):
            pixels = np.flatnonzero((keys == key).all(axis=1))
            for tap in range(taps.weight.shape[1]):
                used = pixels[taps.weight[pixels, tap] > 0]
                if len(used):
                    values[used] += taps.weight[used, tap, None] * self._access(*key, blur, taps.at[used, tap])
        return values, np.full(len(values), 4 * taps.weight.shape[1])

    def _access(self, direction: int, octaves: int, level: int, blur: float, at: _Floats) -> _Floats:
        if octaves == 0:
            st = np.stack([at[:, 0] / self.image.shape[1], 1 - at[:, 1] / self.image.shape[0]], 1)
            return trilinear(self.levels, st, np.full(len(at), float(level)), self.own_wrap)
        if (direction, blur) not in self._chains:
            self._chains[direction, blur] = cells(self.image, direction, self.wrap, blur)
        layout, chains = self._chains[direction, blur]
        cell = layout.cell(octaves, level)
        return _bordered(chains[cell], _place(layout, cell, at))


def _place(layout: ChainLayout, cell: tuple[int, int], at: _Floats) -> _Floats:
    """Texels of a cell, x right and y down, of places in the image."""
    axis, shear = layout.direction.long_axis, layout.direction.shear
    lines, texels = layout.line_size(cell)
    along, across = at[:, axis], at[:, 1 - axis]
    if layout.long_wrap == "repeat":
        along = along - layout.lines * np.floor(along / layout.lines + SEAM)
    else:  # no farther than the border
        along = np.clip(along * lines / layout.lines, -0.5, lines + 0.5) * (layout.lines / lines)
    across = across + shear * (along - 0.5) + layout.padding[0]
    if layout.moved_wrap == "repeat":
        across = across - layout.texels * np.floor(across / layout.texels)
    place = [along * lines / layout.lines, across * texels / layout.texels]
    return np.stack(place if axis == 0 else place[::-1], 1)


def _bordered(texels: NDArray[np.floating], place: _Floats) -> _Floats:
    """Bilinear, within an image (h + 2, w + 2, C) that has a border; (M, 2) texels without it."""
    height, width = texels.shape[:2]
    x, y = (np.clip(place[:, i] + 0.5, 0, size - 1) for i, size in ((0, width), (1, height)))
    column, row = (np.minimum(v.astype(np.int64), size - 2) for v, size in ((x, width), (y, height)))
    x, y = (x - column)[:, None], (y - row)[:, None]
    upper = texels[row, column] * (1 - x) + texels[row, column + 1] * x
    lower = texels[row + 1, column] * (1 - x) + texels[row + 1, column + 1] * x
    return upper * (1 - y) + lower * y
