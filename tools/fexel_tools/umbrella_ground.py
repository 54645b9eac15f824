"""The plain ground that elements lie on: its colour across the photo, and how far each pixel is from it.

The ground is looked for among even pixels, those whose neighbourhood varies least, and those of the border count
more: the commonest colour of these is a seed. A surface of second order per channel of CIELAB is then fitted to the
pixels near it, in rounds (iteratively trimmed least squares), so that a sky from light to dark blue is one ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["Ground", "bare_square", "find_ground", "ground_color"]

_BIN = 6.0  # of CIELAB: of the histogram in which the commonest colour is looked for
_BORDER_WEIGHT = 4.0
_BORDER_SHARE = 0.03  # of the shorter side
_EVEN = 2.5  # of CIELAB: standard deviation in 5 x 5 pixels, below which pixels are even
_REACH = 24.0  # of CIELAB: how far from the seed, and then from the surface, pixels may be to be fitted
_ROUNDS = 6
_SAMPLES = 20000
_LEAST_DISTANCE = 5.0  # of CIELAB: what lies nearer to the ground is the ground
_MOST_DISTANCE = 30.0
_LEAST_PATTERN = 1.0  # CIELAB: standard deviation from which on a ground is worth a picture
_NOISES = 3.5  # standard deviations of the ground that count as noise


@dataclass(frozen=True, eq=False)
class Ground:
    """What lies behind elements.

    Attributes
    ----------
    distance : (h, w) float32
        CIELAB, from the ground's colour at that place.
    threshold : float
        Half way, as far as can be told, between the ground and elements.
    noise : float
        Standard deviation of the ground about its surface, CIELAB.
    share : float
        Of the photo's border that is ground, in [0, 1].
    """

    distance: NDArray[np.float32]
    threshold: float
    noise: float
    share: float


def find_ground(lab: NDArray[np.float32]) -> Ground:
    """Estimate the ground of a photo.

    Parameters
    ----------
    lab : (h, w, 3) float32
        CIELAB.
    """
    even = _deviation(lab) < _EVEN
    border = _border(lab.shape[:2])
    surface = _surface(lab, _seed(lab, even, border), even)
    distance = np.sqrt(np.square(lab - surface).sum(axis=2))
    noise = _noise(distance)
    threshold = _threshold(distance, noise)
    return Ground(distance, threshold, noise, float((distance[border] < threshold).mean()))


def _deviation(lab: NDArray[np.float32]) -> NDArray[np.float32]:
    """Standard deviation of lightness and colour in 5 x 5 pixels."""
    mean = cv2.blur(lab, (5, 5))
    variance = np.maximum(cv2.blur(lab * lab, (5, 5)) - mean * mean, 0)
    return np.sqrt(variance.sum(axis=2))


def _border(shape: tuple[int, int]) -> NDArray[np.bool_]:
    width = max(int(_BORDER_SHARE * min(shape)), 1)
    border = np.ones(shape, bool)
    border[width:-width, width:-width] = False
    return border


def _seed(lab: NDArray[np.float32], even: NDArray[np.bool_], border: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(3,) commonest colour of even pixels; of all where none is."""
    weight = np.where(border, np.float32(_BORDER_WEIGHT), np.float32(1))
    chosen = even if even.any() else np.ones_like(even)
    colors, weights = lab[chosen], weight[chosen]
    sizes = np.array([round(100 / _BIN), round(256 / _BIN), round(256 / _BIN)]) + 2
    cells = np.floor((colors - np.float32([0, -128, -128])) / _BIN).astype(np.int64).clip(0, sizes - 1)
    keys = np.ravel_multi_index(tuple(cells.T), tuple(sizes))
    histogram = np.bincount(keys, weights, int(np.prod(sizes))).reshape(sizes)
    for axis in range(3):  # a colour at the edge of two cells must not lose to one in the middle of its cell
        histogram = histogram + 0.5 * (np.roll(histogram, 1, axis) + np.roll(histogram, -1, axis))
    peak = np.array(np.unravel_index(int(np.argmax(histogram)), histogram.shape))
    near = np.abs(cells - peak).max(axis=1) <= 1
    return np.average(colors[near], axis=0, weights=weights[near]).astype(np.float32) if near.any() else colors.mean(0)


def _surface(lab: NDArray[np.float32], seed: NDArray[np.float32], even: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(h, w, 3) colour of the ground everywhere."""
    height, width = lab.shape[:2]
    stride = max(int(np.sqrt(height * width / _SAMPLES)), 1)
    sample = lab[::stride, ::stride].reshape(-1, 3)
    sample_even = even[::stride, ::stride].ravel()
    terms = _terms(height, width)
    sample_terms = terms[::stride, ::stride].reshape(-1, terms.shape[2])
    expected: NDArray = np.broadcast_to(seed, sample.shape)
    coefficients = np.zeros((terms.shape[2], 3), np.float32)
    coefficients[0] = seed
    reach = _REACH / 2
    for _ in range(_ROUNDS):
        distance = np.sqrt(np.square(sample - expected).sum(axis=1))
        near = sample_even & (distance < reach)
        if np.count_nonzero(near) < 10 * terms.shape[2]:
            break
        reach = float(np.clip(4 * np.sqrt(np.mean(np.square(distance[near]))), _LEAST_DISTANCE, _REACH))
        coefficients = _fit(sample_terms[near], sample[near])
        expected = sample_terms @ coefficients
    return np.clip(terms @ coefficients, np.float32([-10, -128, -128]), np.float32([110, 128, 128]))


def _terms(height: int, width: int) -> NDArray[np.float32]:
    """(h, w, 6) polynomial of second order; coordinates from -1 to 1."""
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=2).astype(np.float32)


def _fit(terms: NDArray[np.float32], colors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Least squares, with a little weight on coefficients, which keeps a surface seen only in a corner level."""
    normal = terms.T @ terms + np.diag([0, *([1e-3 * len(terms)] * (terms.shape[1] - 1))])
    return np.linalg.solve(normal.astype(np.float64), (terms.T @ colors).astype(np.float64)).astype(np.float32)


def _noise(distance: NDArray[np.float32]) -> float:
    """Standard deviation of what is near the surface: 1.4826 times the median distance there."""
    near = distance[distance < _LEAST_DISTANCE * 2]
    return 1.4826 * float(np.median(near)) if near.size else 0.0


def _threshold(distance: NDArray[np.float32], noise: float) -> float:
    """Otsu's (1979) between ground and the rest, on the root of the distance, within what noise and contrast allow."""
    root = np.sqrt(np.minimum(distance, 100))
    scaled = np.rint(root * 25.5).astype(np.uint8)
    otsu, _ = cv2.threshold(scaled, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    least = max(_LEAST_DISTANCE, _NOISES * noise)
    return float(np.clip((otsu / 25.5) ** 2, least, max(_MOST_DISTANCE, least)))


def ground_color(color: NDArray[np.float32], bare: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(3,) mean of the ground's pixels.

    Parameters
    ----------
    color : (h, w, 3) float32
        Linear.
    bare : (h, w) bool
        Ground.
    """
    return color[bare if bare.any() else np.ones_like(bare)].mean(axis=0, dtype=np.float64).astype(np.float32)


def bare_square(lab: NDArray[np.float32], bare: NDArray[np.bool_], least_side: int) -> tuple[int, int, int, int] | None:
    """Largest square of ground alone: left, top, right, bottom; None where it is small or of one colour.

    Parameters
    ----------
    lab : (h, w, 3) float32
        CIELAB.
    bare : (h, w) bool
        Ground.
    least_side : int
        Pixels.
    """
    reach = cv2.distanceTransform(np.pad(bare.astype(np.uint8), 1), cv2.DIST_C, 3)[1:-1, 1:-1]
    y, x = (int(v) for v in np.unravel_index(int(np.argmax(reach)), reach.shape))
    half = int(reach[y, x]) - 1
    if 2 * half + 1 < least_side:
        return None
    square = lab[y - half : y + half + 1, x - half : x + half + 1]
    varies = float(square.reshape(-1, 3).std(axis=0).max())
    return (x - half, y - half, x + half + 1, y + half + 1) if varies >= _LEAST_PATTERN else None
