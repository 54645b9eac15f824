"""What else draws a crisp shape from few bytes: bilinear textures and distance fields, as well made as we can.

* A bilinear texture of the coverage, filtered by least squares: no other texture of its size comes nearer.
* A signed distance field (Green 2007): 8 bits, exact distances, of several ranges the one that serves the shape best.
* A multi-channel one (Chlumsky 2015), by msdfgen itself with its edge colouring and error correction, through the
  Node package @circuitly/msdfgen; the ranges likewise. It is looked for in ``FEXEL_MSDFGEN`` (a folder that holds
  node_modules) or out/bench/node, and installed there by npm where there is one; without it there is no MSDF.

Fields are made from outlines of a picture four times as fine as the judged one (`bench.outline`), corners restored.
All are compared by the share of every pixel that they cover, from samples in it: edges as sharp as each way allows.
Texels are square, rows from the top; a texture covers what is drawn and, around it, a little more than half a texel.
"""

from __future__ import annotations

import base64
import json
import math
import os
import shutil
import subprocess
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numba
import numpy as np

from bench.harness import REPOSITORY
from bench.pinch_shapes import Shape
from fexel_tools.pinchmap_measure import alpha_error

__all__ = [
    "Grid",
    "ShapeTexture",
    "bilinear_coverage",
    "distance_field",
    "least_squares_texels",
    "msdfgen_module",
    "multi_channel_fields",
    "upsampled",
]

_MSDFGEN = "@circuitly/msdfgen@1.1.0"
_RANGES_TEXELS = (1.5, 2.0, 3.0, 4.0)  # least to greatest distance that 8 bits hold; 1 and 6 are hardly ever better
_INSTALL_S, _PROBE_S, _FIELDS_S = 180, 60, 600  # of other programs; what takes longer has failed
_RIM = 0.6  # texels around what is drawn: half a one, so that the outermost centres lie outside
SAMPLES = 8  # along either axis of a pixel


@dataclass(frozen=True)
class ShapeTexture:
    """A shape in few bytes.

    Attributes
    ----------
    nbytes : int
        Of the texels as bound, one level.
    coverage : (H, W) float32
        Share of every source pixel that the texture draws.
    """

    nbytes: int
    coverage: np.ndarray


@dataclass(frozen=True)
class Grid:
    """Square texels over a part of a picture: rows, columns, the size of a texel and the upper left corner, pixels."""

    rows: int
    columns: int
    texel: float
    left: float
    top: float

    @classmethod
    def over(cls, shape: Shape, nbytes: int, bytes_per_texel: float) -> Grid:
        """The largest that fits into `nbytes` and has what is drawn within its texel centres, with a tenth to spare."""
        left, top, right, bottom = shape.box
        width, height = right - left, bottom - top
        most = int(nbytes / bytes_per_texel)
        best = cls(2, 2, math.inf, 0.0, 0.0)
        for columns in range(2, most // 2 + 1):
            rows = most // columns
            texel = max(width / (columns - 2 * _RIM), height / (rows - 2 * _RIM))
            if texel < best.texel:
                middle_x, middle_y = (left + right) / 2, (top + bottom) / 2
                best = cls(rows, columns, texel, middle_x - columns * texel / 2, middle_y - rows * texel / 2)
        return best

    def weights(self, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Matrices (H, rows) and (W, columns) of bilinear interpolation at the pixel centres, clamped."""
        y = (np.arange(shape[0]) + 0.5 - self.top) / self.texel
        x = (np.arange(shape[1]) + 0.5 - self.left) / self.texel
        return _weights(y, self.rows), _weights(x, self.columns)

    def centres(self) -> np.ndarray:
        """(rows * columns, 2) float64: of the texels, x and y."""
        x, y = (np.arange(n) + 0.5 for n in (self.columns, self.rows))
        return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2) * self.texel + [self.left, self.top]


def bilinear_coverage(shape: Shape, nbytes: int) -> ShapeTexture:
    """An 8-bit texture of the coverage, drawn as alpha."""
    grid = Grid.over(shape, nbytes, 1)
    down, across = grid.weights(shape.alpha.shape)
    texels = np.linalg.pinv(down) @ shape.alpha.astype(np.float64) @ np.linalg.pinv(across).T
    stored = np.rint(np.clip(texels, 0, 1) * 255) / 255
    return ShapeTexture(stored.size, (down @ stored @ across.T).astype(np.float32))


def least_squares_texels(picture: np.ndarray, grid: tuple[int, int]) -> np.ndarray:
    """Texels whose bilinear interpolation is nearest to a picture in the least-squares sense.

    Parameters
    ----------
    picture : (H, W, C)
    grid : (int, int)
        Rows and columns of texels.

    Returns
    -------
    (rows, columns, C) float64
        Not clipped: least squares ring a little around edges.
    """
    down, across = (np.linalg.pinv(_spread(n, count)) for n, count in zip(picture.shape[:2], grid, strict=True))
    return np.einsum("rh,hwc,qw->rqc", down, picture.astype(np.float64), across, optimize=True)


def upsampled(texels: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Bilinear interpolation of (h, w, C) texels at the pixel centres of a picture of `shape`: (H, W, C) float32."""
    down, across = (_spread(length, count) for length, count in zip(shape, texels.shape[:2], strict=True))
    return np.einsum("hr,rqc,wq->hwc", down, texels, across, optimize=True).astype(np.float32)


def distance_field(shape: Shape, nbytes: int) -> ShapeTexture:
    """A single-channel field of exact distances, of the range that serves best."""
    grid = Grid.over(shape, nbytes, 1)
    points = grid.centres()
    distance = _distances(points, *_edges(shape.polygons)) * np.where(shape.inside(points), 1, -1) / grid.texel
    textures = []
    for width in _RANGES_TEXELS:
        stored = np.rint(np.clip(0.5 + distance / width, 0, 1) * 255) / 255
        textures.append(_thresholded(stored.reshape(grid.rows, grid.columns, 1), grid, shape))
    return _best_of(textures, shape.alpha)


def multi_channel_fields(shape: Shape, budgets: Sequence[int]) -> list[ShapeTexture]:
    """Multi-channel fields by msdfgen, 3 bytes per texel, each of the range that serves best.

    One for every budget in bytes; [] without msdfgen or outlines, and, with a warning, where msdfgen fails.
    """
    module = msdfgen_module()
    if module is None or not shape.polygons:
        return []
    grids = [Grid.over(shape, nbytes, 3) for nbytes in budgets for _ in _RANGES_TEXELS]
    widths = [width for _ in budgets for width in _RANGES_TEXELS]
    try:
        texels = _run_msdfgen(module, shape, grids, widths)
    except (subprocess.SubprocessError, OSError) as error:
        warnings.warn(f"{shape.name}: left out, msdfgen failed: {error}", stacklevel=2)
        return []
    textures = [
        _thresholded((texel + 0.5) / 256, grid, shape)  # msdfgen rounds down
        for grid, texel in zip(grids, texels, strict=True)
    ]
    step = len(_RANGES_TEXELS)
    return [_best_of(textures[first : first + step], shape.alpha) for first in range(0, len(textures), step)]


def _run_msdfgen(module: Path, shape: Shape, grids: list[Grid], widths: list[float]) -> list[np.ndarray]:
    """Fields (rows, columns, 3) uint8; msdfgen's own y runs upward, and it orients outlines by their nesting."""
    fields = [
        {
            "width": grid.columns,
            "height": grid.rows,
            "scale": 1 / grid.texel,
            "range": width * grid.texel,
            "translate": {"x": -grid.left, "y": grid.top + grid.rows * grid.texel},
        }
        for grid, width in zip(grids, widths, strict=True)
    ]
    polygons = [(polygon * [1, -1]).reshape(-1).tolist() for polygon in shape.polygons]
    request = {"module": str(module), "polygons": polygons, "fields": fields}
    command = ["node", str(Path(__file__).with_name("msdfgen.mjs"))]
    text = json.dumps(request)
    done = subprocess.run(command, input=text, capture_output=True, text=True, check=True, timeout=_FIELDS_S)
    return [
        np.frombuffer(base64.b64decode(encoded), np.uint8).reshape(grid.rows, grid.columns, 4)[::-1, :, :3]
        for grid, encoded in zip(grids, json.loads(done.stdout)["fields"], strict=True)
    ]


def _best_of(textures: Sequence[ShapeTexture], alpha: np.ndarray) -> ShapeTexture:
    return min(textures, key=lambda texture: alpha_error(texture.coverage, alpha))


@cache
def msdfgen_module(install: bool = True) -> Path | None:
    """Folder of the Node package, installed if it is missing and npm can do that; None where there is none."""
    if shutil.which("node") is None:
        return None
    home = Path(os.environ.get("FEXEL_MSDFGEN") or REPOSITORY / "out" / "bench" / "node")
    module = home / "node_modules" / "@circuitly" / "msdfgen"
    if not module.is_dir() and install and shutil.which("npm"):
        home.mkdir(parents=True, exist_ok=True)
        command = ["npm", "install", "--prefix", str(home), "--ignore-scripts", "--no-audit", "--no-fund", _MSDFGEN]
        _succeeds(command, _INSTALL_S)
    if not module.is_dir():
        return None
    return module if _succeeds(["node", "-e", f"require({json.dumps(str(module))})"], _PROBE_S) else None


def _succeeds(command: list[str], seconds: float) -> bool:
    """Whether a program can be run, ends in time, and has nothing to complain of."""
    try:
        return subprocess.run(command, capture_output=True, check=False, timeout=seconds).returncode == 0
    except (subprocess.SubprocessError, OSError):
        return False


def _weights(position: np.ndarray, count: int) -> np.ndarray:
    """Matrix (N, count) of clamped bilinear interpolation at positions in texels, 0 at the outer side of the first."""
    position = np.clip(position - 0.5, 0, count - 1)
    low = np.minimum(np.floor(position).astype(int), max(count - 2, 0))
    matrix = np.zeros((len(position), count))
    each = np.arange(len(position))
    np.add.at(matrix, (each, low), 1 - (position - low))
    np.add.at(matrix, (each, np.minimum(low + 1, count - 1)), position - low)
    return matrix


@cache
def _spread(length: int, count: int) -> np.ndarray:
    """`_weights` of `count` texels over `length` pixels."""
    return _weights((np.arange(length) + 0.5) * (count / length), count)


def _edges(polygons: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    start = np.vstack([*polygons, np.zeros((0, 2))])
    end = np.vstack([*(np.roll(polygon, -1, axis=0) for polygon in polygons), np.zeros((0, 2))])
    return np.ascontiguousarray(start), np.ascontiguousarray(end)


@numba.njit(cache=True)
def _distances(points, start, end):
    result = np.empty(points.shape[0])
    for n in range(points.shape[0]):
        best = np.inf
        x, y = points[n, 0], points[n, 1]
        for e in range(start.shape[0]):
            ax, ay = x - start[e, 0], y - start[e, 1]
            bx, by = end[e, 0] - start[e, 0], end[e, 1] - start[e, 1]
            square = bx * bx + by * by
            along = min(max((ax * bx + ay * by) / square, 0.0), 1.0) if square > 0 else 0.0
            dx, dy = ax - along * bx, ay - along * by
            best = min(best, dx * dx + dy * dy)
        result[n] = math.sqrt(best)
    return result


def _thresholded(texels: np.ndarray, grid: Grid, shape: Shape) -> ShapeTexture:
    """Share of the samples of every pixel where the median of the channels (rows, columns, 1 or 3) exceeds 1/2."""
    result = np.empty(shape.alpha.shape, np.float32)
    place = (grid.top, grid.left, 1 / grid.texel)
    _sample_median(np.ascontiguousarray(texels, np.float64), place, SAMPLES, result)
    return ShapeTexture(texels.size, result)


@numba.njit(cache=True)
def _sample_median(texels, place, samples, result):
    """Count samples only in pixels whose corners do not agree."""
    value = np.empty(3)
    corners = np.empty((result.shape[0] + 1, result.shape[1] + 1), np.uint8)
    for y in range(corners.shape[0]):
        for x in range(corners.shape[1]):
            corners[y, x] = _median(texels, place, y, x, value) > 0.5
    for y in range(result.shape[0]):
        for x in range(result.shape[1]):
            count = corners[y, x] + corners[y, x + 1] + corners[y + 1, x] + corners[y + 1, x + 1]
            if count % 4 == 0:
                result[y, x] = count // 4
                continue
            count = 0
            for n in range(samples * samples):
                v, u = y + (n // samples + 0.5) / samples, x + (n % samples + 0.5) / samples
                count += _median(texels, place, v, u, value) > 0.5
            result[y, x] = count / (samples * samples)


@numba.njit(cache=True)
def _median(texels, place, y, x, value):
    top, left, per_pixel = place
    height, width, channels = texels.shape
    v = min(max((y - top) * per_pixel - 0.5, 0.0), height - 1.0)
    u = min(max((x - left) * per_pixel - 0.5, 0.0), width - 1.0)
    j, i = int(v), int(u)
    k, m = min(j + 1, height - 1), min(i + 1, width - 1)
    v, u = v - j, u - i
    for c in range(channels):
        first = texels[j, i, c] * (1 - u) + texels[j, m, c] * u
        second = texels[k, i, c] * (1 - u) + texels[k, m, c] * u
        value[c] = first * (1 - v) + second * v
    if channels == 1:
        return value[0]
    least, most = min(value[0], value[1]), max(value[0], value[1])
    return max(least, min(most, value[2]))
