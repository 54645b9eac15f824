"""An umbrella texture as one image, area-averaged (`umbrella_raster`); where it is nested, its twin looks it up.

The picture is the unit square of ``inputs:st``. Where ``inputs:matrix`` is affine and the texture repeats there, or the
square shows no more of it than once, the raster draws it; else the twin of the shader looks up some points of every
pixel. Levels of detail play no part in the raster: it averages the umbrellas themselves.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fexel import homography
from fexel.mipmaps import level_count, level_size
from fexel.textures.image_source import BIAS_ZERO, SCALE_ONE, ImageSource
from fexel.textures.page_texels import decode_page
from fexel.textures.pyramid_cache import PyramidCache
from fexel.textures.umbrella import UmbrellaData
from fexel.textures.umbrella_twin import UmbrellaTwin
from fexel_tools.baking import Storage, storage_of
from fexel_tools.umbrella_raster import rasterize, view_of_window
from fexel_tools.umbrella_raster_input import place, texels_per_sample

__all__ = ["baker", "straight_texels"]

_ROWS = 64  # that the twin looks up at a time
_POINTS = 2  # per axis and pixel that it looks up: its own edges are right for an edge alone, not where several meet


def baker(data: UmbrellaData, path: str) -> _UmbrellaBaker:
    """Baker of an umbrella texture, `fexel_tools.baking.NestedBaker`; `path` is the prim to name in messages."""
    return _UmbrellaBaker(data, path)


class _UmbrellaBaker:
    """An umbrella texture's files, read when they are first needed, no finer than they are needed."""

    def __init__(self, data: UmbrellaData, path: str) -> None:
        self._data = data
        self._path = path
        self._cache = PyramidCache()

    @property
    def storage(self) -> Storage:
        """How the picture is to be stored: as its first image is, that of a base before that of the background."""
        shapes = self._data.arrangement.shapes
        images = [shape.image for shape in shapes if shape.image is not None] + [self._data.background]
        found = [image for image in images if self._facts(image).info is not None]
        source = found[0] if found else self._data.background
        return storage_of(source, self._cache, self._path, self._data.scale, self._data.bias)

    @property
    def texels(self) -> tuple[int, int]:
        """Width and height of the picture that shows the texture of an average umbrella as fine as it is."""
        cells = np.array(self._data.arrangement.grid, np.float64)
        per_cell = self._texels_per_cell()
        drawn = per_cell[per_cell > 0]
        whole = cells * np.median(drawn) if len(drawn) else np.array(self._facts(self._data.background).size, float)
        stretch = homography.jacobian(homography.normalize(self._matrix), np.array([[0.5, 0.5]]))[0]
        across = np.linalg.norm(stretch * whole[:, None], axis=0)
        return max(1, round(across[0])), max(1, round(across[1]))

    def size(self, largest: int) -> tuple[int, int]:
        """Width and height of the picture, at most `largest` a side."""
        width, height = self.texels
        scale = min(1.0, largest / max(width, height))
        return max(1, round(width * scale)), max(1, round(height * scale))

    def bake(self, width: int, height: int) -> NDArray[np.float32]:
        """(height, width, 4) float32, linear, premultiplied; scale and bias of `storage` are not applied."""
        view = self._view((width, height))
        if view is None:
            return self._looked_up(width, height)
        background, wrap = self._background(view)
        return rasterize(
            self._data.arrangement,
            self._textures(view),
            background,
            (width, height),
            view=view,
            group="auto",
            background_wrap=wrap,
            vector_scale=self._data.scale[:2] if self._data.turns_vectors else None,
            vector_bias=self._data.bias[:2],
        )

    def sample(self, st: NDArray[np.float64], jacobian: NDArray[np.float64]) -> NDArray[np.float64]:
        """(M, 4) float64, linear, premultiplied, scale and bias applied, at points (M, 2) of the unit square."""
        return self._twin.sample(st, jacobian)

    @cached_property
    def _twin(self) -> UmbrellaTwin:
        return UmbrellaTwin(self._data, self._path, cache=self._cache)

    @property
    def _matrix(self) -> NDArray[np.float64]:
        return np.array(self._data.st_to_texture, np.float64)

    def _view(self, size: tuple[int, int]) -> NDArray[np.float64] | None:
        """(3, 2) from pixels to the texture's own coordinates; None where the raster cannot draw what is there."""
        matrix = self._matrix
        if matrix[:2, 2].any():
            return None
        view = np.append(view_of_window((0.0, 0.0, 1.0, 1.0), size), [[0.0], [0.0], [1.0]], axis=1) @ matrix
        view = view[:, :2] / matrix[2, 2]
        corners = np.array([[0, 0, 1], [size[0], 0, 1], [0, size[1], 1], [*size, 1]]) @ view
        # 1e-9 guards a border that rounding moves past that of the square.
        within = ((corners > -1e-9) & (corners < 1 + 1e-9)).all(axis=0)
        repeats = np.array([mode == "repeat" for mode in self._twin.wrap])
        return view if (within | repeats).all() else None

    def _looked_up(self, width: int, height: int) -> NDArray[np.float32]:
        """The picture by the twin, some points per pixel."""
        out = np.empty((height, width, 4), np.float32)
        n = _POINTS
        view = view_of_window((0.0, 0.0, 1.0, 1.0), (width * n, height * n))
        twin = UmbrellaTwin(self._unscaled, self._path, cache=self._cache)
        for top in range(0, height, _ROWS):
            rows = np.arange(top * n, min(top + _ROWS, height) * n)
            x, y = np.meshgrid(np.arange(width * n) + 0.5, rows + 0.5)
            st = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1) @ view
            points = twin.sample(st, view[:2].T).reshape(-1, n, width, n, 4)
            out[top : top + _ROWS] = points.mean(axis=(1, 3))
        return out

    @property
    def _unscaled(self) -> UmbrellaData:
        return replace(self._data, scale=SCALE_ONE, bias=BIAS_ZERO)

    def _facts(self, source: ImageSource):
        return self._cache.facts(source, self._named(source))

    def _named(self, source: ImageSource) -> str:
        """Path of the prim that an image belongs to."""
        for shape, path in zip(self._data.arrangement.shapes, self._data.paths, strict=False):
            if shape.image == source:
                return path
        return self._path

    def _texels_per_cell(self) -> NDArray[np.float64]:
        """(n,) of each umbrella, along an axis."""
        cells = np.array(self._data.arrangement.grid, np.float64)
        return self._ratio(np.array([[cells[0], 0.0], [0.0, cells[1]], [0.0, 0.0]]))

    def _ratio(self, unit_from_st: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) texels of its image in a unit of length of each umbrella."""
        arrangement = self._data.arrangement
        sizes = [None if shape.image is None else self._facts(shape.image).size for shape in arrangement.shapes]
        texel = np.zeros(1, np.float32)
        stand_ins = [None if size is None else np.broadcast_to(texel, (size[1], size[0], 3)) for size in sizes]
        return texels_per_sample(arrangement, place(arrangement, unit_from_st), stand_ins)

    def _textures(self, view: NDArray[np.float64]) -> list[NDArray[np.float32] | None]:
        """Images of the bases, none finer than the picture needs."""
        arrangement = self._data.arrangement
        linear = np.linalg.inv(view[:2])
        ratio = self._ratio(np.concatenate([linear, np.zeros((1, 2))]))
        textures: list[NDArray[np.float32] | None] = []
        for number, shape in enumerate(arrangement.shapes):
            users = ratio[(arrangement.shape_of == number) & (ratio > 0)]
            finest = float(users.min()) if len(users) else np.inf
            textures.append(None if shape.image is None else self._texels(shape.image, finest))
        return textures

    def _background(self, view: NDArray[np.float64]) -> tuple[NDArray[np.float32], tuple[str, str]]:
        facts = self._facts(self._data.background)
        step = np.linalg.norm(view[:2] * facts.size, axis=1).min()
        s, t = (mode if mode in ("repeat", "mirror") else "clamp" for mode in facts.wrap)
        return self._texels(self._data.background, float(step)), (s, t)

    def _texels(self, source: ImageSource, per_pixel: float) -> NDArray[np.float32]:
        """The mip level that still has two texels in a pixel, where level 0 has so many."""
        facts = self._facts(source)
        last = level_count(*facts.size) - 1 if facts.has_levels else 0
        level = int(np.clip(np.floor(np.log2(max(per_pixel, 1.0))) - 1, 0, last)) if np.isfinite(per_pixel) else last
        return straight_texels(source, self._named(source), self._cache, level)


def straight_texels(source: ImageSource, path: str, cache: PyramidCache, level: int = 0) -> NDArray[np.float32]:
    """A mip level of an image as `rasterize` takes it.

    Parameters
    ----------
    source : ImageSource
    path : str
        Prim to name where the file cannot be read: it warns once, and is the fallback's colour.
    cache : PyramidCache
    level : int

    Returns
    -------
    (h, w, 4) float32
        Linear (or raw), straight alpha.
    """
    facts = cache.facts(source, path)
    width, height = (level_size(size, level) for size in facts.size)
    stored = cache.window(source, path, level, (0, 0, width, height))[1:-1, 1:-1]
    texels = decode_page(stored, facts.page_class).astype(np.float32)
    texels[..., :3] /= np.maximum(texels[..., 3:], 1e-6)  # 1e-6 guards transparent texels, whose colour is 0
    return texels
