"""Speed and residual of the Poisson solver of the authoring tools, beside cv2.seamlessClone and a plain transform."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import scipy.fft

from bench.harness import Row, time_alternately
from fexel_tools.poisson import clone, laplacian_residual, ring_of

NAME = "poisson"


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
