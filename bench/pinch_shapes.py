"""The shapes that pinchmaps are measured on: drawings and images beside the checkout, and outlines of the drawings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.harness import shared_data
from bench.outline import outlines
from fexel_tools.vector_image import rasterize

__all__ = ["LONGER_SIDE_PX", "Shape", "drawings", "images", "load_shape"]

LONGER_SIDE_PX = 1024
_FINER = 4
_QUICK = 4  # every fourth
_IMAGES = ("photo_alpha/owl_rgba.png", "horse_silhouette.png")


@dataclass(frozen=True, eq=False)
class Shape:
    """A drawing's silhouette.

    Attributes
    ----------
    name : str
    alpha : (H, W) float32
        Coverage, the mean of 4 x 4 anti-aliased pixels; the longer side has 1024 pixels.
    box : (float, float, float, float)
        Left, top, right and bottom of what is covered, pixels.
    polygons : list of (N, 2) float64
        Outlines in pixels.
    """

    name: str
    alpha: np.ndarray
    box: tuple[float, float, float, float]
    polygons: list[np.ndarray]
    _fine: np.ndarray

    def inside(self, points: np.ndarray) -> np.ndarray:
        """Whether points (M, 2), in pixels of `alpha`, are covered: (M,) bool."""
        column, row = (points * _FINER).astype(int).T
        return self._fine[np.clip(row, 0, len(self._fine) - 1), np.clip(column, 0, self._fine.shape[1] - 1)] > 0.5


def drawings(quick: bool) -> list[Path]:
    """All SVGs; every fourth of them for a quick run; [] without the data."""
    folder = shared_data()
    files = sorted((folder / "pinch").rglob("*.svg")) if folder else []
    return files[:: _QUICK if quick else 1]


def images() -> list[Path]:
    """Pictures that are measured at their own size; [] without the data."""
    folder = shared_data()
    return [path for name in _IMAGES if folder and (path := folder / "pinch" / name).is_file()]


def load_shape(path: Path) -> Shape:
    """Draw an SVG four times as fine as it is judged, and trace its outlines there."""
    fine = rasterize(path, LONGER_SIDE_PX * _FINER)[..., 3].astype(np.float32) / 255
    rows, columns = (length // _FINER for length in fine.shape)
    fine = np.ascontiguousarray(fine[: rows * _FINER, : columns * _FINER])
    alpha = fine.reshape(rows, _FINER, columns, _FINER).mean((1, 3), dtype=np.float64).astype(np.float32)
    polygons = [polygon / _FINER for polygon in outlines(fine)]
    (top, bottom), (left, right) = (np.flatnonzero(fine.any(axis))[[0, -1]] for axis in (1, 0))
    box = (left / _FINER, top / _FINER, (right + 1) / _FINER, (bottom + 1) / _FINER)
    return Shape(f"{path.parent.name}/{path.stem}", alpha, box, polygons, fine)
