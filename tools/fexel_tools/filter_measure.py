"""Filters measured: what each shows of an image in a fan of views, against the truth, and what it costs.

Pictures are drawn by the renderer's own shaders; where there is no OpenGL, by their twin in NumPy. The error is the
peak signal-to-noise ratio of sRGB-encoded values over a white ground, and the mean CIEDE2000; of data, of the values as
they are. The cost is texels fetched per pixel; memory is that of everything that the filter may ever read, in multiples
of the image: nothing that a view does not need is loaded.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel import mipmaps
from fexel.errors import FexelError, FexelWarning
from fexel.filters import FILTERS
from fexel.filters.chain_layout import ChainLayout
from fexel.filters.shears import DIRECTIONS, FINE_DIRECTIONS
from fexel.filters.tiles import Tile
from fexel.filters.twin import FilterTwin
from fexel.renderer.context import GLContext
from fexel_tools.color_error import ciede2000
from fexel_tools.filter_lookup import look_up
from fexel_tools.filter_subject import Subject
from fexel_tools.filter_truth import FilterTruth
from fexel_tools.filter_views import FilterView
from fexel_tools.pinchmap_measure import psnr_db
from fexel_tools.progress import Progress, silent

__all__ = [
    "COMPARED",
    "GAUSS_FIPMAP",
    "GAUSS_PIXELS",
    "Measured",
    "ViewPictures",
    "error_of",
    "measure",
    "memory_ratio",
]

GAUSS_FIPMAP = "fipmap-gauss"
"""The fipmap whose kernel is a Gaussian: what the renderer draws with ``--filterKernel gauss``."""

COMPARED = (*FILTERS, GAUSS_FIPMAP)

GAUSS_PIXELS = 256
"""Pixels of a view that are compared with the Gaussian truth: it costs the area of a footprint, not its outline."""

_MEMORY_MB = 2048.0


@dataclass(frozen=True)
class Measured:
    """A filter in a view; see `fexel_tools.filter_report` for the fields."""

    image: str
    view: FilterView
    filter: str
    truth: str
    psnr_db: float
    ciede2000: float | None
    fetches: float
    memory: float


@dataclass(frozen=True, eq=False)
class ViewPictures:
    """What a view looks like: the truth (box) and each filter, (pixels, pixels, 4) float32 linear, premultiplied."""

    view: FilterView
    truth: NDArray[np.float32]
    shown: dict[str, NDArray[np.float32]]


def memory_ratio(token: str, size: tuple[int, int], wrap: tuple[str, str]) -> float:
    """Texels of everything that a filter may read of an image, over those of the image alone.

    Along an axis of a single texel there are no chains, see `fexel.filters.tiles`.
    """
    width, height = size
    extent = Tile.of(size, wrap).extent
    texels = sum(
        mipmaps.level_size(width, level) * mipmaps.level_size(height, level)
        for level in range(mipmaps.level_count(width, height))
    )
    if token in ("ripmap", "fipmap", "auto", GAUSS_FIPMAP):
        for number, direction in enumerate(FINE_DIRECTIONS if token == GAUSS_FIPMAP else DIRECTIONS):
            if extent[direction.long_axis] > 1 and (token != "ripmap" or direction.shear == 0):
                layout = ChainLayout.of(number, size, wrap)
                texels += sum(int(np.prod(layout.cell_size(cell))) for cell in layout.cells)
    return texels / (width * height)


def measure(
    subject: Subject,
    views: Sequence[FilterView],
    filters: Sequence[str],
    *,
    pixels: int,
    anisotropy: float = 16.0,
    keep: Sequence[FilterView] = (),
    progress: Progress = silent,
) -> tuple[list[Measured], list[ViewPictures]]:
    """Compare filters on one image.

    Parameters
    ----------
    subject : Subject
    views : sequence of FilterView
    filters : sequence of str
        Of `COMPARED`.
    pixels : int
        Side of the pictures.
    anisotropy : float
        Most probes of ``anisotropic``.
    keep : sequence of FilterView
        Views whose pictures are returned.
    progress : Progress

    Returns
    -------
    figures : list of Measured
        View by view, filter by filter, box before gauss.
    pictures : list of ViewPictures
    """
    truth = FilterTruth.of(subject.image, subject.source.wrap)
    figures, pictures = [], []
    with ExitStack() as stack:
        drawer = _Drawer(subject, anisotropy, stack)
        for number, view in enumerate(views):
            progress(subject.name, number, len(views))
            xy = view.places(subject.size, pixels)
            box = truth.mean("box", xy, view.jacobian)
            some = _some(len(xy))
            gauss = truth.mean("gauss", xy[some], view.jacobian)
            shown = {}
            for token in filters:
                values, fetches = drawer.draw(token, xy, view.jacobian)
                memory = memory_ratio(token, subject.size, subject.source.wrap)
                for kind, own, wanted in (("box", values, box), ("gauss", values[some], gauss)):
                    psnr, difference = error_of(subject, own, wanted)
                    figures.append(Measured(subject.name, view, token, kind, psnr, difference, fetches, memory))
                shown[token] = values.reshape(pixels, pixels, 4)
            if view in keep:
                pictures.append(ViewPictures(view, box.reshape(pixels, pixels, 4).astype(np.float32), shown))
        progress(subject.name, len(views), len(views))
    return figures, pictures


def error_of(subject: Subject, values: NDArray, truth: NDArray) -> tuple[float, float | None]:
    """PSNR, dB, and mean CIEDE2000 (None of data) of (M, 4), linear, premultiplied."""
    values, truth = (_comparable(subject, part)[None] for part in (values, truth))
    if subject.is_data:
        return psnr_db(values, truth, None, encode=False) or 0.0, None
    seen = [part[..., :3] + (1.0 - part[..., 3:]) for part in (values, truth)]
    return psnr_db(values, truth) or 0.0, ciede2000(*seen)


def _comparable(subject: Subject, values: NDArray) -> NDArray[np.float32]:
    values = np.array(values, np.float32)
    if subject.vectors:
        vectors = 2.0 * values[..., :3] - values[..., 3:]
        length = np.linalg.norm(vectors, axis=-1, keepdims=True)
        vectors /= np.maximum(length, 1e-6)  # guards vectors that cancel
        values[..., :3] = 0.5 * (vectors + values[..., 3:])
    values[..., :3] /= subject.white
    return values


def _some(count: int) -> NDArray[np.int64]:
    """Pixels spread over a picture."""
    return np.unique(np.linspace(0, count - 1, min(count, GAUSS_PIXELS)).astype(np.int64))


def _bounds(xy: NDArray, jacobian: NDArray, size: tuple[int, int]) -> tuple[NDArray, NDArray]:
    """(1, 2) lowest and highest uv of a view, t up, footprints included."""
    reach = 0.5 * np.abs(jacobian).sum(axis=1)
    low, high = (xy.min(axis=0) - reach) / size, (xy.max(axis=0) + reach) / size
    return np.array([[low[0], 1 - high[1]]]), np.array([[high[0], 1 - low[1]]])


class _Drawer:
    """Looks an image up on the GPU, else in NumPy."""

    def __init__(self, subject: Subject, anisotropy: float, stack: ExitStack) -> None:
        self._subject, self._anisotropy = subject, anisotropy
        self._twin: FilterTwin | None = None
        try:
            self._gl = stack.enter_context(GLContext())
        except FexelError as error:
            warnings.warn(f"{error}; filters are computed in NumPy, which is slower", FexelWarning, stacklevel=2)
            self._gl = None

    def draw(self, token: str, xy: NDArray, jacobian: NDArray) -> tuple[NDArray[np.float32], float]:
        """(M, 4), and texels fetched per pixel."""
        jacobians = np.broadcast_to(jacobian, (len(xy), 2, 2))
        if self._gl is None:
            return self._computed(token, xy, jacobians)
        source = self._subject.source
        token, kernel = ("fipmap", "gauss") if token == GAUSS_FIPMAP else (token, "box")
        xy = xy % (2 * np.array(self._subject.size)) if source.wrap[0] in ("repeat", "mirror") else xy  # float32 there
        looked = look_up(
            self._gl,
            source,
            token,
            xy,
            jacobians,
            memory_mb=_MEMORY_MB,
            anisotropy=self._anisotropy,
            kernel=kernel,
            seen=(jacobian[None, None], *_bounds(xy, jacobian, self._subject.size)),
        )
        return looked.color, float(looked.fetches.mean())

    def _computed(self, token: str, xy: NDArray, jacobians: NDArray) -> tuple[NDArray[np.float32], float]:
        if self._twin is None:
            self._twin = FilterTwin(self._subject.image, self._subject.source.wrap)
        options = {"probes": int(self._anisotropy)} if token == "anisotropic" else {}
        if token == GAUSS_FIPMAP:
            token, options = "fipmap", {"gauss": True}
        values, fetches = self._twin.sample(token, xy, jacobians, **options)
        return values.astype(np.float32), float(np.mean(fetches))
