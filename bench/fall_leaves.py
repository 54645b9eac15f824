"""The fall leaves that the umbrella paper measures with, from a fixed seed: nine leaves, 6100 umbrellas, 64 x 24 cells.

After table 1 and section 7.1 of "Just-in-time texture synthesis" (2012): b = 9 base umbrellas of v = 63 vertices with
textures of 256 x 256, n = 6100; umbrellas as long as make a cell list 19 of them on average, 27 at most. Maples, oaks
and ovate leaves with veins, patches of colour and the noise of photographs, whose amplitude falls as one over
frequency; every umbrella has an offset, a gradient and a morph of its own. Nothing here uses the authoring tools,
but to continue colours past outlines, so that figures compare over time.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.pinchmap_texture import save_texels
from fexel.images import linear_to_srgb, srgb_to_linear
from fexel.textures.image_source import ImageSource
from fexel.textures.umbrella_arrangement import Arrangement, Shape
from fexel_tools.color_bleed import bleed_color
from fexel_tools.texture_files import write_texture

__all__ = ["FallLeaves", "cell_counts", "cutouts", "fall_leaves"]

SEED = 2012
GRID = (64, 24)
COUNT = 6100
SIZES = (1.25, 1.85)  # length of a leaf, cells
SHADOW = (0.10, -0.14)  # cells
SHADOW_STRENGTH = 0.45
_HUES = ((168, 44, 20), (196, 104, 28), (206, 160, 44), (126, 70, 32), (120, 124, 40), (150, 30, 34))  # sRGB
_PAD = 0.04  # of the picture, around the contour
# A list grows with the density of umbrellas; the most in a cell is this many times the mean, where counts are guessed.
_MOST_OVER_MEAN = 1.4


@dataclass(frozen=True)
class FallLeaves:
    """The setting as data and as files.

    Attributes
    ----------
    arrangement : Arrangement
        Its images are the files.
    textures : tuple of (h, w, 3) float32
        Linear, as stored in 8 bits, one per shape, row 0 at the top.
    background : ImageSource
    soil : (h, w, 3) float32
        The background's texels, linear, as stored; it repeats.
    """

    arrangement: Arrangement
    textures: tuple[np.ndarray, ...]
    background: ImageSource
    soil: np.ndarray


def fall_leaves(
    folder: Path,
    *,
    bases: int = 9,
    vertices: int = 63,
    count: int = COUNT,
    grid: tuple[int, int] = GRID,
    k: int | None = None,
    texture_size: int = 256,
    sizes: tuple[float, float] = SIZES,
    shadow_strength: float = SHADOW_STRENGTH,
    seed: int = SEED,
) -> FallLeaves:
    """Make the setting and write its textures.

    Parameters
    ----------
    folder : Path
        Where textures are written: ``leaf0.tif`` ..., ``soil.tif``.
    vertices : int
        v, of every base, the centre included; the outlines are the same, cut more or less finely.
    k : int, optional
        Instead of `count`: as many umbrellas as make the fullest cell of `grid` list so many.
    sizes : (float, float)
        Shortest and longest leaf, cells.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    leaves = [_Leaf(number, rng) for number in range(bases)]
    pictures = [leaf.picture(texture_size, rng) for leaf in leaves]
    files = [_saved(folder / f"leaf{number}.tif", picture) for number, picture in enumerate(pictures)]
    soil = _soil(texture_size, rng)
    background = ImageSource(_saved(folder / "soil.tif", soil), "", "sRGB", ("repeat", "repeat"))
    shapes = tuple(
        leaf.shape(vertices, leaves[(number + 3) % bases], file)
        for number, (leaf, file) in enumerate(zip(leaves, files, strict=True))
    )
    arrangement = _arranged(shapes, grid, count, sizes, shadow_strength, seed)
    if k is not None:
        arrangement = _with_lists_of(k, shapes, grid, sizes, shadow_strength, seed)
    return FallLeaves(arrangement, tuple(map(_stored, pictures)), background, _stored(soil))


def cutouts(folder: Path, *, bases: int = 9, size: int = 768, seed: int = SEED) -> list[Path]:
    """The same leaves as cut-outs with alpha, as a person would photograph them: ``leaf0.png`` ... of `size` pixels."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    leaves = [_Leaf(number, rng) for number in range(bases)]
    files = []
    for number, leaf in enumerate(leaves):
        color = linear_to_srgb(leaf.picture(size, rng))
        texels = np.concatenate([color, leaf.opacity(size)[..., None]], -1)
        files.append(folder / f"leaf{number}.png")
        save_texels(files[-1], np.rint(texels * 255).astype(np.uint8))
    return files


def cell_counts(arrangement: Arrangement) -> np.ndarray:
    """(H, W) umbrellas that touch each cell of the grid, row 0 at t = 0; by dense points of each, so 1 % are missed."""
    width, height = arrangement.grid
    keys = []
    for number, shape in enumerate(arrangement.shapes):
        users = np.flatnonzero(arrangement.shape_of == number)
        rows = arrangement.first_vertex[users][:, None] + np.arange(len(shape.points))
        placed = arrangement.vertices[rows] if len(users) else np.zeros((0, len(shape.points), 2))
        contour, center = placed[:, 1:], placed[:, :1]
        dense = np.concatenate([contour + f * (np.roll(contour, -1, 1) - contour) for f in np.arange(0, 1, 0.25)], 1)
        points = np.concatenate([center + f * (dense - center) for f in (0.25, 0.5, 0.75, 1.0)], 1)
        cells = np.floor(points * (width, height)).astype(np.int64) % (width, height)
        keys.append((users[:, None] * height + cells[..., 1]) * width + cells[..., 0])
    touched = np.unique(np.concatenate([part.ravel() for part in keys]))
    return np.bincount(touched % (width * height), minlength=width * height).reshape(height, width)


class _Leaf:
    """An outline in polar coordinates about the point where the veins meet, and how it is coloured."""

    def __init__(self, number: int, rng: np.random.Generator) -> None:
        self.kind = ("maple", "oak", "ovate")[number % 3]
        self.hue = np.array(_HUES[number % len(_HUES)]) / 255 + rng.normal(0, 0.02, 3)
        self.vary = rng.uniform(0.85, 1.15, 6)
        angle = np.linspace(0, 2 * np.pi, 721)
        outline = self._reach(angle)[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
        self.scale = 1 / np.ptp(outline, axis=0).max()
        low, high = outline.min(0) * self.scale, outline.max(0) * self.scale
        self.low, self.extent = low - _PAD, float((high - low).max()) + 2 * _PAD

    def reach(self, angle: np.ndarray) -> np.ndarray:
        """Distance of the outline from the centre, patch space, by angle; the leaf points up."""
        return self.scale * self._reach(angle)

    def _reach(self, angle: np.ndarray) -> np.ndarray:
        off = np.angle(np.exp(1j * (angle - np.pi / 2)))
        a, b, c, d, e, f = self.vary
        if self.kind == "maple":
            lobes = sum(
                length * np.exp(-(((off - place) / width) ** 2))
                for place, length, width in _LOBES * (1, a, 1) * (b, 1, c)
            )
            return 0.34 + lobes + 0.035 * d * np.cos(23 * off + e) * (np.abs(off) < 2.4)
        length, width = (1.0, 0.74 * a) if self.kind == "oak" else (1.0, 0.68 * b)
        oval = 1 / np.sqrt((np.cos(off) / length) ** 2 + (np.sin(off) / width) ** 2)
        if self.kind == "oak":
            return oval * (1 + 0.17 * c * np.cos(9 * off + 0.2 * f))
        return oval * (1 + 0.25 * d * np.exp(-((off / 0.22) ** 2)) + 0.012 * np.cos(40 * off))

    def shape(self, vertices: int, other: _Leaf, file: str) -> Shape:
        angle = 2 * np.pi * np.arange(vertices - 1) / (vertices - 1)
        ray = np.stack([np.cos(angle), np.sin(angle)], -1)
        own, theirs = self.reach(angle), other.reach(angle)
        points = np.concatenate([np.zeros((1, 2)), own[:, None] * ray])
        morphed = np.concatenate([np.zeros((1, 2)), (0.7 * own + 0.3 * theirs)[:, None] * ray])
        tex_coords = (points - self.low) / self.extent
        image = ImageSource(file, "", "sRGB", ("clamp", "clamp"))
        return Shape(points, morphed, tex_coords, image)

    def picture(self, size: int, rng: np.random.Generator) -> np.ndarray:
        """(size, size, 3) linear; past the outline continued as the command continues the colours of bases."""
        x, y = self._places(size)
        radius, angle = np.hypot(x, y), np.arctan2(y, x)
        edge = np.clip(radius / self.reach(angle), 0, 1)
        patches = _noise(rng, size, 2.0)
        color = self.hue + 0.10 * patches[..., None] * (0.9, 0.7, 0.25) + 0.05 * _noise(rng, size, 1.0)[..., None]
        veins = self._veins(x, y)[..., None]
        color = color * (1 - 0.4 * edge[..., None] ** 5) + veins * (np.array([0.20, 0.17, 0.06]))
        spots = np.clip(_noise(rng, size, 1.4) - 1.6, 0, 1)[..., None]
        linear = srgb_to_linear(np.clip(color * (1 - 0.5 * spots), 0, 1).astype(np.float32))
        return bleed_color(linear, self.opacity(size), trusted_alpha=1.0)

    def opacity(self, size: int) -> np.ndarray:
        """(size, size) in [0, 1]: 1 inside the outline, a pixel wide at its edge."""
        x, y = self._places(size)
        inside = (self.reach(np.arctan2(y, x)) - np.hypot(x, y)) * size / self.extent
        return np.clip(inside + 0.5, 0, 1).astype(np.float32)

    def _places(self, size: int) -> tuple[np.ndarray, np.ndarray]:
        """Patch space of the columns (1, size) and rows (size, 1) of a picture."""
        at = (np.arange(size) + 0.5) / size
        return self.low[0] + self.extent * at[None, :], self.low[1] + self.extent * at[::-1, None]

    def _veins(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Strength in [0, 1]: main veins to the lobes, side veins off them."""
        places = _LOBES[:, 0] if self.kind == "maple" else np.array([0.0, np.pi])
        strength = np.zeros(np.broadcast_shapes(x.shape, y.shape))
        for place in places:
            along = x * -np.sin(place) + y * np.cos(place)
            across = np.abs(x * np.cos(place) + y * np.sin(place))
            main = np.exp(-((across / 0.008) ** 2)) * (along > 0)
            side = np.exp(-(((np.abs(((along - 0.7 * across) * 14) % 1 - 0.5)) / 0.09) ** 2))
            near = np.exp(-(across / (0.12 if self.kind == "maple" else 0.3))) * (along > 0.02)
            strength = np.maximum(strength, np.maximum(main, 0.55 * side * near))
        return strength


_LOBES = np.array([(0.0, 0.66, 0.30), (0.95, 0.55, 0.26), (-0.95, 0.55, 0.26), (1.85, 0.30, 0.24), (-1.85, 0.30, 0.24)])


def _noise(rng: np.random.Generator, size: int, power: float) -> np.ndarray:
    """(size, size), mean 0, deviation 1, amplitude falling as frequency to minus `power`; repeats."""
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size)))
    spectrum = np.fft.fft2(rng.normal(size=(size, size))) / np.maximum(frequency, 1 / size) ** power
    spectrum[0, 0] = 0
    noise = np.fft.ifft2(spectrum).real
    return noise / noise.std()


def _soil(size: int, rng: np.random.Generator) -> np.ndarray:
    color = np.array([0.22, 0.17, 0.12]) + 0.06 * _noise(rng, size, 1.0)[..., None] + 0.02 * rng.normal(size=3)
    return srgb_to_linear(np.clip(color, 0, 1).astype(np.float32))


def _saved(path: Path, picture: np.ndarray) -> str:
    write_texture(path, picture)
    return str(path)


def _stored(picture: np.ndarray) -> np.ndarray:
    return srgb_to_linear(np.rint(linear_to_srgb(picture) * 255).astype(np.float32) / 255)


def _arranged(shapes, grid, count, sizes, shadow_strength, seed) -> Arrangement:
    """Umbrellas one to a place of a jittered lattice, in random order, turn, size, morph and colour."""
    rng = np.random.default_rng(seed + 1)
    width, height = grid
    centers = _places(rng, count, width / height)
    length, turn = rng.uniform(*sizes, count), rng.uniform(0, 2 * np.pi, count)
    matrices = np.zeros((count, 3, 3))
    matrices[:, 0, 0], matrices[:, 0, 1] = length * np.cos(turn) / width, length * np.sin(turn) / height
    matrices[:, 1, 0], matrices[:, 1, 1] = -length * np.sin(turn) / width, length * np.cos(turn) / height
    matrices[:, 2, :2], matrices[:, 2, 2] = centers, 1
    shape_of = rng.integers(0, len(shapes), count).astype(np.int32)
    return Arrangement(
        shapes,
        shape_of,
        matrices,
        rng.random(count),
        _offsets(rng, shapes, shape_of),
        grid,
        1.0,
        (SHADOW[0] / width, SHADOW[1] / height),
        shadow_strength,
        np.ones(count),
    )


def _places(rng: np.random.Generator, count: int, aspect: float) -> np.ndarray:
    """(count, 2) in [0, 1]: one in each of so many boxes of a lattice, the surplus left out."""
    columns = int(np.ceil(np.sqrt(count * aspect))) if count else 1
    rows = -(-count // columns)
    chosen = rng.permutation(columns * rows)[:count]
    return (np.stack([chosen % columns, chosen // columns], -1) + rng.random((count, 2))) / (columns, rows)


def _offsets(rng: np.random.Generator, shapes, shape_of: np.ndarray) -> np.ndarray:
    """(total, 3) smooth signed offsets: a shift and a gradient per umbrella, a little of its own per vertex."""
    shift = rng.normal(0, 1, (len(shape_of), 1, 3)) * (0.07, 0.05, 0.02)
    gradient = rng.normal(0, 1, (len(shape_of), 2, 3)) * (0.10, 0.07, 0.03)
    parts = []
    for umbrella, number in enumerate(shape_of):
        points = shapes[number].points
        own = 0.008 * rng.normal(size=(len(points), 3))
        parts.append(np.clip(shift[umbrella] + points @ gradient[umbrella] + own, -0.5, 0.5))
    return np.concatenate(parts).astype(np.float32) if parts else np.zeros((0, 3), np.float32)


def _with_lists_of(k: int, shapes, grid, sizes, shadow_strength, seed) -> Arrangement:
    """The arrangement whose fullest cell lists `k`, or as near as some number of umbrellas brings it."""
    tried: dict[int, tuple[int, Arrangement]] = {}
    cells = grid[0] * grid[1]
    count = max(1, round(cells * k / (4.8 * _MOST_OVER_MEAN)))
    for _ in range(8):
        arrangement = _arranged(shapes, grid, count, sizes, shadow_strength, seed)
        most = int(cell_counts(arrangement).max())
        tried[count] = (abs(most - k), arrangement)
        if most == k:
            break
        count = max(1, round(count * (1 + 0.7 * (k / most - 1))))
    return min(tried.values(), key=lambda item: item[0])[1]
