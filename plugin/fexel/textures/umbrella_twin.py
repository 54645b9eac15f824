"""Umbrella textures in float64 NumPy: the oracle of shaders/umbrella.glsl, and lookups without a GPU.

Sections 4 and 6 of Just-in-time texture synthesis (2012) with the open points settled as the notes do: colours ``c =
clamp(c_t + f c_c)`` (eq. 1, U1) with c_c interpolated in the sector (U6), composited front to back; a place is shaded
by the umbrellas in front of what it shows that cover the place moved against the shadow offset (6.2); edges as soft as
a pixel is wide, across each edge; between levels of detail a linear blend (6.3, U4). Along long footprints several
probes are taken. Beyond the coarsest level, if that is merged umbrellas, a picture of the whole follows as in the
renderer (`umbrella_picture`); without levels umbrellas alone are seen at every footprint.

Conventions: st runs right and up; M is a number of points; colours are linear and premultiplied.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fexel import homography
from fexel.textures.footprint import Footprint
from fexel.textures.image_source import BIAS_ZERO, SCALE_ONE
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.pinchmap_lattice import blocks
from fexel.textures.pyramid_cache import PyramidCache
from fexel.textures.umbrella import LEVEL_IMAGE_BIAS, UmbrellaData, UmbrellaLevelData
from fexel.textures.umbrella_composite import CompositeTwin, wrapped
from fexel.textures.umbrella_images import TwinImage, base_images
from fexel.textures.umbrella_layers import ArrangementTwin
from fexel.textures.umbrella_picture import PictureTexels, picture_level, picture_source, picture_wrap

__all__ = ["FULL_DETAIL", "UmbrellaTwin"]

FULL_DETAIL = 0.125
"""Cells per pixel up to which umbrellas alone are seen (section 6.3)."""

_BLOCK = 1 << 15


@dataclass(frozen=True, eq=False)
class _Level:
    """Something to show from a footprint on: umbrellas over the background, or an image of all."""

    level: int
    umbrellas: ArrangementTwin | None
    image: TwinImage | None


class UmbrellaTwin:
    """Looks an umbrella texture up.

    Parameters
    ----------
    data : UmbrellaData
    path : str
        Prim to name where a file cannot be read.
    most_probes : float
        Along a footprint, as the renderer's anisotropy.
    cache : PyramidCache, optional
    """

    def __init__(
        self, data: UmbrellaData, path: str, *, most_probes: float = 16.0, cache: PyramidCache | None = None
    ) -> None:
        self._data = data
        self._probes = max(1.0, float(most_probes))
        self._cache = cache or PyramidCache()
        self._background = TwinImage(data.background, path, self._cache)
        images = base_images(data.arrangement, data.paths, self._cache)
        self._levels = [_Level(0, ArrangementTwin(data.arrangement, images, data.vector_hand), None)]
        for level in data.levels:
            usable = self._level(level)
            if usable is not None:
                self._levels.append(usable)
            if usable is not None and usable.image is not None:
                break  # its mip levels serve all coarser footprints
        last = self._levels[-1]
        if last.level and last.image is None:
            self._levels.append(self._own_picture(last.level + 1, path))

    def _level(self, level: UmbrellaLevelData) -> _Level | None:
        if level.arrangement is not None:
            paths = (level.path,) * len(level.arrangement.shapes)
            images = base_images(level.arrangement, paths, self._cache)
            return _Level(level.level, ArrangementTwin(level.arrangement, images, self._data.vector_hand), None)
        assert level.image is not None
        source = replace(level.image, wrap=picture_wrap(self.wrap))
        image = TwinImage(source, level.path, self._cache, finer=LEVEL_IMAGE_BIAS)
        return None if image.info is None else _Level(level.level, None, image)

    def _own_picture(self, least: int, path: str) -> _Level:
        """What follows the coarsest merged umbrellas, at `least`; made when it is first looked at."""
        reader = PictureTexels(KeptTexels(), self._cache)
        level = max(picture_level(self._data.arrangement), least)
        return _Level(level, None, TwinImage(picture_source(self._data, self.wrap), path, reader))

    @cached_property
    def wrap(self) -> tuple[str, str]:
        """Wrap modes along s and t, those of the background's file where they are not authored."""
        info = self._background.info
        of_file = ("black", "black") if info is None else info.wrap
        s, t = (own if mode == "useMetadata" else mode for mode, own in zip(self._data.wrap, of_file, strict=True))
        return s, t

    def sample(
        self, st: NDArray[np.floating], jacobian: NDArray[np.floating] | None = None, *, hard: bool = False
    ) -> NDArray[np.float64]:
        """Look up points.

        Parameters
        ----------
        st : (M, 2)
            Of ``inputs:st``; of a patch, its own.
        jacobian : (2, 2) or (M, 2, 2), optional
            d(st)/d(pixel), column j per pixel along x, y. Default: a pixel is a point.
        hard : bool
            Edges are not softened: for averages over many points of a pixel.

        Returns
        -------
        (M, 4) float64
            Linear, premultiplied, after scale and bias. Zero outside of a wrap that is ``black`` or ``patch``, at or
            behind infinity, and where `st` or `jacobian` is not finite.
        """
        st = np.asarray(st, np.float64)
        axes = np.zeros((2, 2)) if jacobian is None else np.asarray(jacobian, np.float64)
        axes = np.broadcast_to(axes, (len(st), 2, 2))
        result = np.zeros((len(st), 4))
        for block in blocks(len(st), _BLOCK):
            place, footprint, shown = self._placed(st[block], axes[block], hard)
            used = np.flatnonzero(shown > 0)
            color = self._scaled(self._blended(place[used], footprint[used], hard))
            result[block.start + used] = color * shown[used, None]
        return result

    def _placed(
        self, st: NDArray[np.float64], axes: NDArray[np.float64], hard: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Own coordinates, their Jacobians, and how much is shown of each point, in [0, 1]."""
        finite = np.isfinite(st).all(axis=1) & np.isfinite(axes).all(axis=(1, 2))
        st, axes = np.where(finite[:, None], st, 0.0), np.where(finite[:, None, None], axes, 0.0)
        matrix = np.array(self._data.st_to_texture)
        if (matrix != np.eye(3)).any():
            place = homography.apply(homography.normalize(matrix), st)
            axes = homography.jacobian(homography.normalize(matrix), st) @ axes
            front = np.isfinite(place).all(axis=1)
            st, axes = np.where(front[:, None], place, 0.0), np.where(front[:, None, None], axes, 0.0)
            finite &= front
        return st, axes, self._within(st, axes, hard) * finite

    def _within(self, st: NDArray[np.float64], axes: NDArray[np.float64], hard: bool) -> NDArray[np.float64]:
        """1 inside of [0, 1] along axes that show nothing outside, falling to 0 over the pixel at the rim."""
        shown = np.ones(len(st))
        for axis, mode in enumerate(self.wrap):
            if mode in ("black", "patch"):
                inside = 0.5 - np.abs(st[:, axis] - 0.5)
                pixel = np.zeros(len(st)) if hard else np.hypot(axes[:, axis, 0], axes[:, axis, 1])
                soft = np.clip(inside / np.where(pixel > 0, pixel, 1.0), 0.0, 1.0)
                shown *= np.where(pixel > 0, soft, inside >= 0)
        return shown

    def _blended(self, st: NDArray[np.float64], axes: NDArray[np.float64], hard: bool) -> NDArray[np.float64]:
        """The blend of levels of detail, before scale and bias."""
        cells = np.array(self._data.arrangement.grid, np.float64)
        footprint = Footprint.of(axes * cells[:, None])
        detail = footprint.level(self._probes) - np.log2(FULL_DETAIL)
        result = np.zeros((len(st), 4))
        for level, weight in zip(self._levels, _weights([level.level for level in self._levels], detail), strict=True):
            used = np.flatnonzero(weight > 0)
            if len(used):
                result[used] += weight[used, None] * self._shown(level, st[used], axes[used], hard)
        return result

    def _shown(
        self, level: _Level, st: NDArray[np.float64], axes: NDArray[np.float64], hard: bool
    ) -> NDArray[np.float64]:
        if level.image is not None:
            place, direction = wrapped(st, self.wrap)
            return level.image.sample(place, axes * direction[:, :, None], self._probes)
        assert level.umbrellas is not None
        twin = CompositeTwin(level.umbrellas, self._background, self.wrap, self._data.arrangement.grid, self._probes)
        return twin.sample(st, axes, hard)

    def _scaled(self, color: NDArray[np.float64]) -> NDArray[np.float64]:
        """``inputs:scale`` and ``inputs:bias`` on straight colour."""
        scale, bias = self._data.scale, self._data.bias
        if (scale, bias) == (SCALE_ONE, BIAS_ZERO):
            return color
        alpha = color[:, 3:]
        straight = color[:, :3] / np.maximum(alpha, 1e-6)  # 1e-6 guards what is nearly transparent
        alpha = np.clip(alpha * scale[3] + bias[3], 0.0, 1.0)
        return np.concatenate([(straight * scale[:3] + bias[:3]) * alpha, alpha], axis=1)


def _weights(levels: list[int], detail: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Of each level, at a real-valued level of detail; they sum to 1."""
    weights = []
    for number, level in enumerate(levels):
        weight = np.ones(len(detail))
        if number:
            before = levels[number - 1]
            weight = np.clip((detail - before) / (level - before), 0.0, 1.0)
        if number + 1 < len(levels):
            after = levels[number + 1]
            weight = weight * (1.0 - np.clip((detail - level) / (after - level), 0.0, 1.0))
        weights.append(weight)
    return weights
