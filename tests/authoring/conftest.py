"""A detailed surface and photos cut from it, with exact homographies."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from tests.authoring.synthetic_photos import write_image

SURFACE_SIZE = (1600, 1200)


@pytest.fixture(scope="session")
def surface():
    """(1200, 1600, 3) uint8 sRGB: noise at every scale, and shapes with edges, nowhere repeated."""
    rng = np.random.default_rng(7)
    width, height = SURFACE_SIZE
    picture = np.zeros((height, width, 3), np.float32)
    for cell in (4, 8, 16, 32, 64, 160, 400):
        coarse = rng.normal(size=(height // cell + 3, width // cell + 3, 3)).astype(np.float32)
        layer = cv2.resize(coarse, None, fx=cell, fy=cell, interpolation=cv2.INTER_CUBIC)
        picture += layer[:height, :width] * np.float32(cell**0.4)
    picture = 128.0 + 30.0 * picture / picture.std()
    for _ in range(260):
        center = tuple(int(v) for v in rng.integers(0, (width, height)))
        color = [float(c) for c in rng.uniform(30, 225, 3)]
        axes = tuple(int(v) for v in rng.integers(4, 60, 2))
        cv2.ellipse(picture, center, axes, float(rng.uniform(0, 180)), 0, 360, color, -1, cv2.LINE_AA)
    return np.clip(picture, 4, 250).astype(np.uint8)


@dataclass(frozen=True)
class Shot:
    """A photo of the surface: pixels, and the homography from surface pixels to its own (continuous, columns)."""

    pixels: np.ndarray
    photo_from_surface: np.ndarray


@pytest.fixture(scope="session")
def shoot(surface):
    """Function (center, width of the field, size, angle, tilt, gain) -> Shot of the surface."""

    def take(center, field, size=(400, 300), angle=0.0, tilt=(0.0, 0.0), gain=1.0):
        scale = size[0] / field
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        to_center = np.array([[1, 0, -center[0]], [0, 1, -center[1]], [0, 0, 1.0]])
        turn = np.array([[scale * c, -scale * s, 0], [scale * s, scale * c, 0], [tilt[0], tilt[1], 1.0]])
        to_corner = np.array([[1, 0, size[0] / 2], [0, 1, size[1] / 2], [0, 0, 1.0]])
        matrix = to_corner @ turn @ to_center
        return Shot(_warp(surface, matrix, size, gain), matrix)

    return take


def _warp(surface, matrix, size, gain):
    """Supersampled in linear light."""
    reduce = 4
    linear = (surface.astype(np.float32) / 255.0) ** 2.2
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]])  # OpenCV counts from pixel centres
    grow = np.diag([reduce, reduce, 1.0])
    large = np.linalg.inv(half) @ grow @ matrix @ half
    picture = cv2.warpPerspective(
        linear, large, (size[0] * reduce, size[1] * reduce), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA) * gain
    return np.rint(np.clip(picture, 0.0, 1.0) ** (1 / 2.2) * 255.0).astype(np.uint8)


@pytest.fixture(scope="session")
def zoom_series(shoot):
    """Five photos: the whole, a detail, a detail of the detail, one beside it, one partly outside the whole."""
    return {
        "whole": shoot((800, 600), 1400),
        "door": shoot((700, 560), 600, angle=4.0, gain=0.85),
        "lock": shoot((660, 540), 220, angle=-7.0, tilt=(1e-4, -5e-5), gain=1.1),
        "window": shoot((1080, 600), 560, angle=-2.0),
        "edge": shoot((230, 250), 420, angle=3.0),
    }


@pytest.fixture
def series_files(zoom_series, tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    return {name: write_image(folder / f"{name}.png", shot.pixels) for name, shot in zoom_series.items()}
