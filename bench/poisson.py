"""Speed and residual of the Poisson solver of the authoring tools, beside cv2.seamlessClone and a plain transform."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import scipy.fft
import scipy.sparse
import scipy.sparse.linalg

from bench.harness import Curve, Row, time_alternately
from fexel_tools.poisson import clone, laplacian_residual, ring_of

NAME = "poisson"
_TOLERANCES = (1e-1, 1e-2, 1e-4)  # of the conjugate gradients, relative


def rows(quick: bool) -> Iterator[Row]:
    height, width = (1001, 1201) if quick else (3001, 4001)
    rng = np.random.default_rng(1)
    child = cv2.GaussianBlur(rng.random((height, width, 3), np.float32), (0, 0), 1.5)
    child = (child - child.min()) / np.ptp(child)
    parent = 0.8 * child + 0.1 * np.linspace(0, 1, width, dtype=np.float32)[:, None]
    border = ring_of(parent)
    small, mask = np.ascontiguousarray(child[:1001, :1201]), np.full((1001, 1201), 255, np.uint8)
    mask[[0, -1]] = mask[:, [0, -1]] = 0
    child_8bit, parent_8bit = (np.rint(a[:1001, :1201] * 255).astype(np.uint8) for a in (child, parent))
    planes = [np.ascontiguousarray(child[:, :, c]) for c in range(3)]
    prime = np.ascontiguousarray(child[: height - 8, : width - 14])
    repeats = 5
    times = time_alternately(
        {
            "clone": lambda: clone(child, border),
            "any size": lambda: clone(prime, ring_of(prime) + 0.1),
            "dctn": lambda: [scipy.fft.dctn(plane, workers=2) for plane in planes],
            "cv2": lambda: cv2.seamlessClone(child_8bit, parent_8bit, mask, (600, 500), cv2.NORMAL_CLONE),
        },
        repeats=repeats,
    )
    megapixels = height * width / 1e6
    solved = clone(child, border)
    setting = f"{megapixels:.1f} MP x 3 channels, float32, 2 threads"
    seconds = times["clone"].median_s
    reference = f"cv2.seamlessClone (8-bit) {1.2 / times['cv2'].median_s:.2f} MP/s here on 1.2 MP"
    yield Row(
        "Poisson solve, throughput", setting, megapixels / seconds, "MP/s", 12.0, ">=", reference, samples=repeats
    )
    yield Row("Poisson solve, residual of the Laplacian", setting, laplacian_residual(solved, child), "", 1e-6, "<")
    ratio = seconds / times["dctn"].median_s
    yield Row("Poisson solve over scipy.fft.dctn of the same planes, same run", setting, ratio, "x", samples=repeats)
    slow = times["any size"].median_s
    sides = f"{prime.shape[1]} x {prime.shape[0]}, sides less one with large factors"
    yield Row("Poisson solve, throughput", sides, prime.shape[0] * prime.shape[1] / 1e6 / slow, "MP/s", samples=repeats)
    twin = clone(small.astype(np.float64), ring_of(small.astype(np.float64)) * 0.9)
    error = np.abs(clone(small, ring_of(small.astype(np.float64)) * 0.9) - twin).max()
    yield Row("Poisson solve, float32 against its float64 twin", "1.2 MP", float(error), "of full range", 1e-6, "<")


def curves(quick: bool) -> Iterator[Curve]:
    """Throughput against residual of the Laplacian, set-up of matrices not counted, factorisation counted."""
    height, width = (201, 301) if quick else (401, 601)
    child, parent = _pair(height, width)
    mask = np.full((height, width), 255, np.uint8)
    mask[[0, -1]] = mask[:, [0, -1]] = 0
    child_8bit, parent_8bit = (np.rint(np.clip(a, 0, 1) * 255).astype(np.uint8) for a in (child, parent))
    border, centre = ring_of(parent), (width // 2, height // 2)
    matrix, right = _sparse_system(child, parent)
    ways = {
        "fexel, sine transform, float32": lambda: clone(child, border),
        "fexel, sine transform, float64": lambda: clone(child.astype(np.float64), border),
        "cv2.seamlessClone, 8 bits": lambda: (
            cv2.seamlessClone(child_8bit, parent_8bit, mask, centre, cv2.NORMAL_CLONE) / 255.0
        ),
        "scipy splu, sparse direct": lambda: _inserted(child, parent, scipy.sparse.linalg.splu(matrix).solve(right)),
    }
    iterative = {tolerance: _gradients_way(child, parent, matrix, right, tolerance) for tolerance in _TOLERANCES}
    times = time_alternately(ways | iterative, repeats=3)
    points = {
        key: (laplacian_residual(way(), child), height * width / 1e6 / times[key].median_s)
        for key, way in (ways | iterative).items()
    }
    for label in ways:
        yield _curve(label, [points[label]])
    annotations = [f"{tolerance:g}" for tolerance in _TOLERANCES]
    yield _curve(
        "conjugate gradients on scipy.sparse, by tolerance",
        [points[tolerance] for tolerance in _TOLERANCES],
        annotations,
    )


def _pair(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Child and parent, float32 in [0, 1], that differ by contrast and a slope."""
    child = cv2.GaussianBlur(np.random.default_rng(1).random((height, width, 3), np.float32), (0, 0), 1.5)
    child = (child - child.min()) / np.ptp(child)
    return child, 0.8 * child + 0.1 * np.linspace(0, 1, width, dtype=np.float32)[:, None]


def _sparse_system(child: np.ndarray, parent: np.ndarray) -> tuple[scipy.sparse.csc_matrix, np.ndarray]:
    """Matrix of the five-point Laplacian inside, and right sides (N, 3): of the correction, parent minus child."""
    height, width = child.shape[0] - 2, child.shape[1] - 2
    rows_, columns = (scipy.sparse.diags([-1.0, 2.0, -1.0], [-1, 0, 1], (n, n)) for n in (height, width))
    ring = parent.astype(np.float64) - child
    right = np.zeros((height, width, 3))
    right[0], right[-1] = ring[0, 1:-1], ring[-1, 1:-1]
    right[:, 0] += ring[1:-1, 0]
    right[:, -1] += ring[1:-1, -1]
    return scipy.sparse.csc_matrix(scipy.sparse.kronsum(columns, rows_)), right.reshape(-1, 3)


def _inserted(child: np.ndarray, parent: np.ndarray, correction: np.ndarray) -> np.ndarray:
    out = parent.astype(np.float64)
    out[1:-1, 1:-1] = child[1:-1, 1:-1] + correction.reshape(child.shape[0] - 2, child.shape[1] - 2, 3)
    return out


def _gradients_way(child, parent, matrix, right, tolerance):
    """What solves the three channels by conjugate gradients to a relative tolerance."""
    by_row = matrix.tocsr()

    def solve() -> np.ndarray:
        planes = [_conjugate_gradients(by_row, np.ascontiguousarray(right[:, c]), tolerance) for c in range(3)]
        return _inserted(child, parent, np.stack(planes, axis=1))

    return solve


def _conjugate_gradients(matrix: scipy.sparse.csr_matrix, right: np.ndarray, tolerance: float) -> np.ndarray:
    """Like `scipy.sparse.linalg.cg`, with sums that use no BLAS threads, which cost it far more than they gain here."""
    solution, residual, direction = np.zeros_like(right), right.copy(), right.copy()
    square = (residual * residual).sum()
    least = tolerance**2 * square
    while square > least:
        image = matrix @ direction
        step = square / (direction * image).sum()
        solution += step * direction
        residual -= step * image
        square, former = (residual * residual).sum(), square
        direction = residual + (square / former) * direction
    return solution


def _curve(label: str, points: list[tuple[float, float]], annotations: list[str] | None = None) -> Curve:
    return Curve(
        plot="poisson",
        label=label,
        x=[residual for residual, _ in points],
        y=[speed for _, speed in points],
        x_label="largest residual of the Laplacian, of full range",
        y_label="throughput, MP/s, 3 channels each",
        x_log=True,
        y_log=True,
        ours=label.startswith("fexel"),
        annotations=annotations or [],
    )
