"""Directional albedo of the GGX lobe, integrated once per process.

Split sum of Karis, "Real Shading in Unreal Engine 4" (2013), with visible normals sampled as in Heitz, "Sampling the
GGX Distribution of Visible Normals" (JCGT 2018) and height-correlated masking and shadowing.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

__all__ = ["ggx_albedo"]

_RESOLUTION = 32
_SAMPLES = 512
_SMALLEST_ALPHA = 1e-3  # keeps the lobe wide enough to sample in float64 without special cases
_SMALLEST_COSINE = 1e-3


@lru_cache(maxsize=1)
def ggx_albedo() -> np.ndarray:
    """Table of directional albedos.

    Returns
    -------
    (32, 32, 2) float32
        Rows: roughness 0 to 1; columns: cosine of the view angle 0 to 1. Channel 0 is the albedo for a reflectance of
        f0 = 1 and f90 = 0 in Schlick's formula, channel 1 that for f0 = 0 and f90 = 1; their sum is at most 1.
    """
    axis = np.linspace(0.0, 1.0, _RESOLUTION)
    table = np.empty((_RESOLUTION, _RESOLUTION, 2), np.float32)
    samples = _samples(_SAMPLES)
    for row, roughness in enumerate(axis):
        alpha = max(roughness * roughness, _SMALLEST_ALPHA)
        for column, cosine in enumerate(axis):
            table[row, column] = _albedo(alpha, max(cosine, _SMALLEST_COSINE), samples)
    return table


def _samples(count: int) -> np.ndarray:
    # A golden-ratio lattice, (count, 2) in [0, 1).
    index = np.arange(count)
    return np.stack([(index + 0.5) / count, np.modf(index * 0.6180339887498949)[0]], axis=1)


def _albedo(alpha: float, cosine: float, samples: np.ndarray) -> tuple[float, float]:
    view = np.array([np.sqrt(1.0 - cosine * cosine), 0.0, cosine])
    normals = _visible_normals(view, alpha, samples)
    voh = np.clip(normals @ view, 0.0, 1.0)
    light_cosine = 2.0 * voh * normals[:, 2] - cosine
    up = light_cosine > 0.0
    lambda_view = _lambda(cosine, alpha)
    lambda_light = _lambda(np.where(up, light_cosine, 1.0), alpha)
    weight = np.where(up, (1.0 + lambda_view) / (1.0 + lambda_view + lambda_light), 0.0)
    grazing = (1.0 - voh) ** 5
    return float(np.mean(weight * (1.0 - grazing))), float(np.mean(weight * grazing))


def _lambda(cosine: np.ndarray | float, alpha: float) -> np.ndarray | float:
    # Heitz, "Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs", JCGT 2014, eq. (72).
    return 0.5 * (np.sqrt(1.0 + alpha * alpha * (1.0 / np.square(cosine) - 1.0)) - 1.0)


def _visible_normals(view: np.ndarray, alpha: float, samples: np.ndarray) -> np.ndarray:
    stretched = view * [alpha, alpha, 1.0]
    stretched /= np.linalg.norm(stretched)
    side = np.array([0.0, 1.0, 0.0])  # perpendicular to `view`, which lies in the xz plane
    ahead = np.cross(stretched, side)
    radius = np.sqrt(samples[:, 0])
    angle = 2.0 * np.pi * samples[:, 1]
    t1, t2 = radius * np.cos(angle), radius * np.sin(angle)
    blend = 0.5 * (1.0 + stretched[2])
    t2 = (1.0 - blend) * np.sqrt(np.maximum(1.0 - t1 * t1, 0.0)) + blend * t2
    t3 = np.sqrt(np.maximum(1.0 - t1 * t1 - t2 * t2, 0.0))
    normals = t1[:, None] * side + t2[:, None] * ahead + t3[:, None] * stretched
    normals *= [alpha, alpha, 1.0]
    normals[:, 2] = np.maximum(normals[:, 2], 1e-9)  # rounding may bring one below the surface
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)
