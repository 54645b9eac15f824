"""What else draws a crisp shape from few bytes: bilinear textures and distance fields, as well made as we can.

* A bilinear texture of the coverage, filtered by least squares: no other texture of its size comes nearer.
* A signed distance field (Green 2007): 8 bits, exact distances, of several ranges the one that serves the shape best.
* A multi-channel one (Chlumsky 2015), by msdfgen itself with its edge colouring and error correction, through the
  Node package @circuitly/msdfgen; the ranges likewise. It is looked for in ``FEXEL_MSDFGEN`` (a folder that holds
  node_modules) or out/bench/node, and installed there by npm where there is one; without it there is no MSDF.

Fields are made from outlines of a picture four times as fine as the judged one (`bench.outline`), corners restored.
All are compared by the share of every pixel that they cover, from samples in it: edges as sharp as each way allows.
Textures here have their texel centres at ((i + 1/2) / w, (j + 1/2) / h), rows from the top, and clamp.
"""

from __future__ import annotations

import base64
import json
import math
import os
import shutil
import subprocess
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
    "ShapeTexture",
    "bilinear_coverage",
    "distance_field",
    "grid_of_bytes",
    "least_squares_texels",
    "msdfgen_module",
    "multi_channel_fields",
    "upsampled",
]

_MSDFGEN = "@circuitly/msdfgen@1.1.0"
_RANGES_TEXELS = (1.5, 2.0, 3.0, 4.0)  # least to greatest distance that 8 bits hold; 1 and 6 are hardly ever better
_INSTALL_S = 180
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


def grid_of_bytes(shape: tuple[int, int], nbytes: int, bytes_per_texel: float) -> tuple[int, int]:
    """Rows and columns, in the aspect of `shape`, of the largest grid that fits into `nbytes`."""
    texels = nbytes / bytes_per_texel
    aspect = shape[1] / shape[0]
    rows = math.sqrt(texels / aspect)
    candidates = ((r, int(texels // r)) for r in (math.floor(rows), math.ceil(rows)) if r)
    grids = [(r, min(c, math.ceil(r * aspect))) for r, c in candidates]
    return max(grids, key=lambda grid: grid[0] * grid[1])


def bilinear_coverage(alpha: np.ndarray, nbytes: int) -> ShapeTexture:
    """An 8-bit texture of the coverage, drawn as alpha."""
    texels = least_squares_texels(alpha[..., None], grid_of_bytes(alpha.shape, nbytes, 1))
    stored = np.rint(np.clip(texels, 0, 1) * 255) / 255
    return ShapeTexture(texels.shape[0] * texels.shape[1], upsampled(stored, alpha.shape)[..., 0])


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
    down, across = (_pseudo_inverse(length, count) for length, count in zip(picture.shape[:2], grid, strict=True))
    return np.einsum("rh,hwc,qw->rqc", down, picture.astype(np.float64), across, optimize=True)


def upsampled(texels: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Bilinear interpolation of (h, w, C) texels at the pixel centres of a picture of `shape`: (H, W, C) float32."""
    down, across = (_weights(length, count) for length, count in zip(shape, texels.shape[:2], strict=True))
    return np.einsum("hr,rqc,wq->hwc", down, texels, across, optimize=True).astype(np.float32)


def distance_field(shape: Shape, nbytes: int) -> ShapeTexture:
    """A single-channel field of exact distances, of the range that serves best."""
    size = shape.alpha.shape
    grid = grid_of_bytes(size, nbytes, 1)
    y, x = ((np.arange(count) + 0.5) * (length / count) for count, length in zip(grid, size, strict=True))
    points = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    distance = _distances(points, *_edges(shape.polygons)) * np.where(shape.inside(points), 1, -1)
    texel = size[0] / grid[0]
    textures = []
    for width in _RANGES_TEXELS:
        stored = np.rint(np.clip(0.5 + distance / (width * texel), 0, 1) * 255) / 255
        textures.append(ShapeTexture(grid[0] * grid[1], _covered_share(stored.reshape(*grid, 1), size)))
    return _best_of(textures, shape.alpha)


def multi_channel_fields(shape: Shape, budgets: Sequence[int]) -> list[ShapeTexture]:
    """Multi-channel fields by msdfgen, 3 bytes per texel, each of the range that serves best.

    One for every budget in bytes; [] without msdfgen or outlines. Texels are square, as msdfgen makes them: a field may
    reach a little beyond the picture's right or upper border.
    """
    module = msdfgen_module()
    if module is None or not shape.polygons:
        return []
    size = shape.alpha.shape
    upward = [polygon * [1, -1] + [0, size[0]] for polygon in shape.polygons]  # msdfgen orients them by their nesting
    fields = []
    for nbytes in budgets:
        grid = grid_of_bytes(size, nbytes, 3)
        scale = min(grid[0] / size[0], grid[1] / size[1])
        fields += [{"width": grid[1], "height": grid[0], "scale": scale, "range": w / scale} for w in _RANGES_TEXELS]
    request = {"module": str(module), "polygons": [p.reshape(-1).tolist() for p in upward], "fields": fields}
    texels = _run_msdfgen(request)
    textures = [_multi_channel(field, texel, size) for field, texel in zip(fields, texels, strict=True)]
    step = len(_RANGES_TEXELS)
    return [_best_of(textures[first : first + step], shape.alpha) for first in range(0, len(textures), step)]


def _run_msdfgen(request: dict) -> list[np.ndarray]:
    """Fields (rows, columns, 3) uint8, row 0 at the top."""
    command = ["node", str(Path(__file__).with_name("msdfgen.mjs"))]
    done = subprocess.run(command, input=json.dumps(request), capture_output=True, text=True, check=True)
    fields = zip(request["fields"], json.loads(done.stdout)["fields"], strict=True)
    return [
        np.frombuffer(base64.b64decode(encoded), np.uint8).reshape(field["height"], field["width"], 4)[::-1, :, :3]
        for field, encoded in fields
    ]


def _multi_channel(field: dict, texels: np.ndarray, size: tuple[int, int]) -> ShapeTexture:
    extent = (field["height"] / field["scale"], field["width"] / field["scale"])  # source pixels, from the bottom up
    stored = (texels + 0.5) / 256  # msdfgen rounds down
    return ShapeTexture(texels.size, _covered_share(stored, size, extent, size[0] - extent[0]))


def _best_of(textures: Sequence[ShapeTexture], alpha: np.ndarray) -> ShapeTexture:
    return min(textures, key=lambda texture: alpha_error(texture.coverage, alpha))


@cache
def msdfgen_module() -> Path | None:
    """Folder of the Node package, installed when it is missing and npm can; None where that fails."""
    if shutil.which("node") is None:
        return None
    home = Path(os.environ.get("FEXEL_MSDFGEN") or REPOSITORY / "out" / "bench" / "node")
    module = home / "node_modules" / "@circuitly" / "msdfgen"
    if not module.is_dir() and shutil.which("npm"):
        home.mkdir(parents=True, exist_ok=True)
        command = ["npm", "install", "--prefix", str(home), "--ignore-scripts", "--no-audit", "--no-fund", _MSDFGEN]
        subprocess.run(command, capture_output=True, check=False, timeout=_INSTALL_S)
    if not module.is_dir():
        return None
    probe = subprocess.run(["node", "-e", f"require({json.dumps(str(module))})"], capture_output=True, check=False)
    return module if probe.returncode == 0 else None


@cache
def _weights(length: int, count: int) -> np.ndarray:
    """Matrix (length, count) of bilinear interpolation along one axis, clamped."""
    position = np.clip((np.arange(length) + 0.5) * (count / length) - 0.5, 0, count - 1)
    low = np.minimum(np.floor(position).astype(int), max(count - 2, 0))
    high = np.minimum(low + 1, count - 1)
    matrix = np.zeros((length, count))
    np.add.at(matrix, (np.arange(length), low), 1 - (position - low))
    np.add.at(matrix, (np.arange(length), high), position - low)
    return matrix


@cache
def _pseudo_inverse(length: int, count: int) -> np.ndarray:
    return np.linalg.pinv(_weights(length, count))


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


def _covered_share(
    texels: np.ndarray,
    shape: tuple[int, int],
    extent: tuple[float, float] | None = None,
    first_row: float = 0.0,
) -> np.ndarray:
    """Share of the samples of every pixel where the median of the channels exceeds 1/2.

    The texture covers `extent` source pixels (rows, columns; all of `shape` by default) from row `first_row`, column 0.
    """
    result = np.empty(shape, np.float32)
    rows, columns = extent or shape
    place = (first_row, texels.shape[0] / rows, texels.shape[1] / columns)
    _sample_median(np.ascontiguousarray(texels, np.float64), place, SAMPLES, result)
    return result


@numba.njit(cache=True)
def _sample_median(texels, place, samples, result):
    """Count samples only in pixels whose corners and centre do not agree."""
    value = np.empty(3)
    for y in range(result.shape[0]):
        for x in range(result.shape[1]):
            count = _median(texels, place, y + 0.5, x + 0.5, value) > 0.5
            for n in range(4):
                count += _median(texels, place, y + n // 2, x + n % 2, value) > 0.5
            if count % 5 == 0:
                result[y, x] = count // 5
                continue
            count = 0
            for n in range(samples * samples):
                v, u = y + (n // samples + 0.5) / samples, x + (n % samples + 0.5) / samples
                count += _median(texels, place, v, u, value) > 0.5
            result[y, x] = count / (samples * samples)


@numba.njit(cache=True)
def _median(texels, place, y, x, value):
    first_row, per_row, per_column = place
    height, width, channels = texels.shape
    v = min(max((y - first_row) * per_row - 0.5, 0.0), height - 1.0)
    u = min(max(x * per_column - 0.5, 0.0), width - 1.0)
    j, i = int(v), int(u)
    k, m = min(j + 1, height - 1), min(i + 1, width - 1)
    v, u = v - j, u - i
    for c in range(channels):
        top = texels[j, i, c] * (1 - u) + texels[j, m, c] * u
        bottom = texels[k, i, c] * (1 - u) + texels[k, m, c] * u
        value[c] = top * (1 - v) + bottom * v
    if channels == 1:
        return value[0]
    least, most = min(value[0], value[1]), max(value[0], value[1])
    return max(least, min(most, value[2]))
