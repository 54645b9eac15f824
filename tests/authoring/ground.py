"""A small ground whose parts are known: three coloured leaves, their arrangement, their files."""

from __future__ import annotations

import numpy as np

from fexel.textures.umbrella_arrangement import Arrangement, Shape

COLORS = ((0.8, 0.1, 0.1), (0.1, 0.6, 0.1), (0.7, 0.6, 0.05))


def leaf(corners: int, squash: float = 1.0) -> Shape:
    """A star-shaped polygon about (0, 0) of longer side 1, its texture its bounding square."""
    angle = 2 * np.pi * np.arange(corners) / corners
    radius = 0.5 * (1 - 0.2 * (np.arange(corners) % 2))
    contour = np.stack([radius * np.cos(angle), squash * radius * np.sin(angle)], axis=1)
    points = np.concatenate([np.zeros((1, 2)), contour])
    return Shape(points, points * (1.0, 0.8), points + 0.5)


def arrangement(count: int = 40, grid: tuple[int, int] = (8, 4), seed: int = 3, **settings) -> Arrangement:
    """`count` leaves of three shapes, each about a cell and a half long."""
    rng = np.random.default_rng(seed)
    shapes = (leaf(6), leaf(8, 0.7), leaf(10, 0.9))
    shape_of = rng.integers(0, 3, count).astype(np.int32)
    length, turn = rng.uniform(1.2, 1.8, count), rng.uniform(0, 2 * np.pi, count)
    matrices = np.zeros((count, 3, 3))
    matrices[:, 0, 0], matrices[:, 0, 1] = length * np.cos(turn) / grid[0], length * np.sin(turn) / grid[1]
    matrices[:, 1, 0], matrices[:, 1, 1] = -length * np.sin(turn) / grid[0], length * np.cos(turn) / grid[1]
    matrices[:, 2, :2], matrices[:, 2, 2] = rng.random((count, 2)), 1.0
    total = sum(len(shapes[k].points) for k in shape_of)
    given = {"shadow_offset": (0.01, -0.02), "shadow_strength": 0.4, "coverages": np.ones(count), **settings}
    colors = rng.uniform(-0.1, 0.1, (total, 3)).astype(np.float32)
    return Arrangement(shapes, shape_of, matrices, rng.random(count), colors, grid, **given)


def textures(size: int = 32) -> tuple[np.ndarray, ...]:
    """A plain colour with a darker rib each; linear, (size, size, 4)."""
    pictures = []
    for color in COLORS:
        picture = np.ones((size, size, 4), np.float32)
        picture[..., :3] = color
        picture[size // 2 - 1 : size // 2 + 1, :, :3] *= 0.5
        pictures.append(picture)
    return tuple(pictures)
