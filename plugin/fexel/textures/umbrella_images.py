"""Images of umbrella textures in float64 NumPy: mip levels as they are stored, trilinear probes along a footprint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from fexel import mipmaps
from fexel.textures.footprint import Footprint
from fexel.textures.page_texels import decode_page
from fexel.textures.pinchmap_lattice import trilinear
from fexel.textures.pool import TexelReader
from fexel.textures.pyramid_cache import PyramidCache
from fexel.textures.umbrella import BASE_IMAGE_BIAS
from fexel.textures.umbrella_arrangement import Arrangement

__all__ = ["TwinImage", "base_images"]


class _Levels(Sequence[NDArray[np.float32]]):
    """Mip levels, each read when it is first looked at."""

    def __init__(self, source: Any, path: str, reader: TexelReader) -> None:
        self._source, self._path, self._reader = source, path, reader
        self._facts = reader.facts(source, path)
        self._levels: dict[int, NDArray[np.float32]] = {}

    def __len__(self) -> int:
        return self._facts.last_level + 1

    @overload
    def __getitem__(self, index: int) -> NDArray[np.float32]: ...
    @overload
    def __getitem__(self, index: slice) -> list[NDArray[np.float32]]: ...
    def __getitem__(self, index: int | slice) -> NDArray[np.float32] | list[NDArray[np.float32]]:
        if isinstance(index, slice):
            return [self[number] for number in range(*index.indices(len(self)))]
        number = range(len(self))[index]
        if number not in self._levels:
            width, height = (mipmaps.level_size(size, number) for size in self._facts.size)
            texels = self._reader.window(self._source, self._path, number, (0, 0, width, height))
            self._levels[number] = decode_page(texels[1:-1, 1:-1], self._facts.page_class)
        return self._levels[number]


class TwinImage:
    """An image to look up.

    Parameters
    ----------
    source : object
        Of the reader.
    path : str
        Prim to name when the file cannot be read: its fallback then stands in.
    reader : TexelReader
    finer : float
        By how many mip levels it is read finer than its texels call for.
    """

    def __init__(self, source: Any, path: str, reader: TexelReader, finer: float = 0.0) -> None:
        facts = reader.facts(source, path)
        self._levels = _Levels(source, path, reader)
        self.wrap = facts.wrap
        self._size = np.array(facts.size) / 2.0**finer
        self.info = facts.info
        self.is_opaque = facts.info is not None and facts.info.alpha_channel < 0 and not source.mask
        """Whether no texel has an alpha below 1."""

    def sample(
        self, uv: NDArray[np.float64], jacobian: NDArray[np.float64], most_probes: float = 1.0
    ) -> NDArray[np.float64]:
        """Look up points with their footprints.

        Parameters
        ----------
        uv : (M, 2) float64
            t up, wrapped here.
        jacobian : (M, 2, 2) float64
            d(uv)/d(pixel), column j per pixel along x, y.
        most_probes : float
            1 filters alike in all directions.

        Returns
        -------
        (M, 4) float64
            Linear, premultiplied.
        """
        footprint = Footprint.of(jacobian * self._size[:, None])
        lod = footprint.level(most_probes)
        probes = footprint.probes(most_probes)
        axis = footprint.direction / self._size
        result = np.zeros((len(uv), 4))
        for number in range(int(probes.max(initial=1))):
            taken = np.flatnonzero(number < probes) if number else np.arange(len(uv))
            share = 1.0 / probes[taken]
            place = uv[taken] + ((number + 0.5) * share - 0.5)[:, None] * axis[taken]
            result[taken] += share[:, None] * trilinear(self._levels, place, lod[taken], self.wrap)
        return result


def base_images(arrangement: Arrangement, paths: Sequence[str], cache: PyramidCache) -> list[TwinImage | None]:
    """Of each shape; `paths` are the prims to name, if known."""
    known = {}
    for shape, path in zip(arrangement.shapes, paths or [""] * len(arrangement.shapes), strict=True):
        if shape.image is not None and shape.image not in known:
            known[shape.image] = TwinImage(shape.image, path, cache, finer=BASE_IMAGE_BIAS)
    return [None if shape.image is None else known[shape.image] for shape in arrangement.shapes]
