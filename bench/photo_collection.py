"""A synthetic collection of large photos of one surface, with exact homographies: what `fexel zipmap` is timed on.

The surface is procedural: grain of many sizes and spots with edges in the whole, and finer grain, down to the pixels
of the closest photo, that the whole does not resolve. One photo shows the whole; the others look closer (2 to 16
times), turned and tilted a little, differently exposed, some inside others. Photos are JPEG with noise, as a camera's
are.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio

__all__ = ["Shot", "collection", "make_collection"]

_CELLS = (480, 240, 120, 56, 26, 12, 5.5, 2.8, 1.6)  # of the whole's grain, pixels
_DENSITIES = (4.0, 16.0)  # of the finer grain, its pixels per pixel of the whole


@dataclass(frozen=True)
class Shot:
    """A photo to be taken.

    Attributes
    ----------
    name : str
    root_from_photo : (3, 3) float64
        Continuous pixel coordinates, column vectors.
    gain : (3,) float64
        Linear exposure and white balance.
    """

    name: str
    root_from_photo: np.ndarray
    gain: np.ndarray


def collection(count: int, size: tuple[int, int], seed: int = 3) -> list[Shot]:
    """The whole and `count` - 1 closer photos of `size` (width, height) pixels each; every third looks into another."""
    rng = np.random.default_rng(seed)
    shots = [Shot("whole", np.eye(3), np.ones(3))]
    for k in range(1, count):
        into = shots[int(rng.integers(1, k))] if k > 4 and k % 3 == 0 else shots[0]
        zoom = rng.uniform(2.0, 6.0) if into is shots[0] else rng.uniform(1.8, 2.8)
        shots.append(Shot(f"photo_{k:02d}", into.root_from_photo @ _look(size, zoom, rng), rng.uniform(0.7, 1.25, 3)))
    return shots


def _look(size: tuple[int, int], zoom: float, rng: np.random.Generator) -> np.ndarray:
    """A closer view somewhere inside a photo: its pixels to the photo's."""
    center = np.array(size) * rng.uniform(0.5 / zoom + 0.06, 1.0 - 0.5 / zoom - 0.06, 2)
    angle, tilt = rng.normal(0.0, 0.06), rng.normal(0.0, 0.05, 2) / size[0]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) / zoom
    matrix = np.eye(3)
    matrix[:2, :2], matrix[2, :2] = turn, tilt
    matrix[:2] += np.outer(center, matrix[2])
    back = np.eye(3)
    back[:2, 2] = -np.array(size) / 2.0
    return matrix @ back


def make_collection(folder: Path, count: int = 20, size: tuple[int, int] = (4000, 3000), seed: int = 3) -> list[Path]:
    """Write the photos and ``truth.json`` (root_from_photo by file name); files that are there stay."""
    folder.mkdir(parents=True, exist_ok=True)
    shots = collection(count, size, seed)
    rng = np.random.default_rng(seed + 1)
    base, tile = _base(size, rng), _tile(2048, rng)
    paths = []
    for number, shot in enumerate(shots):
        path = folder / f"{shot.name}.jpg"
        if not path.exists():
            picture = _photograph(shot, size, base, tile, np.random.default_rng(seed + 100 + number))
            _write_jpeg(path, picture)
        paths.append(path)
    truth = {f"{s.name}.jpg": s.root_from_photo.tolist() for s in shots}
    (folder / "truth.json").write_text(json.dumps(truth, indent=1), "utf-8")
    return paths


def _write_jpeg(path: Path, picture: np.ndarray) -> None:
    spec = oiio.ImageSpec(picture.shape[1], picture.shape[0], 3, "uint8")
    spec.attribute("Compression", "jpeg:94")
    output = oiio.ImageOutput.create(str(path))
    if not (output and output.open(str(path), spec) and output.write_image(picture)):
        raise OSError(f"{path}: {oiio.geterror()}")
    output.close()


def _photograph(
    shot: Shot, size: tuple[int, int], base: np.ndarray, tile: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    width, height = size
    center = shot.root_from_photo @ np.array([width / 2.0, height / 2.0, 1.0])
    zoom = float(abs(np.linalg.det(shot.root_from_photo / center[2])) ** -0.5)
    picture = np.empty((height, width, 3), np.uint8)
    for top in range(0, height, 256):
        rows = min(256, height - top)
        x, y = _root_pixels(shot.root_from_photo, width, top, rows)
        linear = cv2.remap(base, x - 0.5, y - 0.5, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        for density in _DENSITIES:  # detail shows when its grain is larger than a pixel
            if zoom > 0.5 * density:
                u, v = (x * density) % tile.shape[1], (y * density) % tile.shape[0]
                linear *= np.exp(cv2.remap(tile, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP))[..., None]
        encoded = np.clip(linear * shot.gain.astype(np.float32), 0.0, 1.0) ** np.float32(1.0 / 2.2) * np.float32(255.0)
        encoded += np.float32(0.5) * rng.standard_normal(encoded.shape, np.float32)
        picture[top : top + rows] = np.clip(np.rint(encoded), 0, 255)
    return picture


def _root_pixels(root_from_photo: np.ndarray, width: int, top: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.arange(width) + 0.5, top + np.arange(rows) + 0.5)
    x, y, w = (row[0] * x + row[1] * y + row[2] for row in root_from_photo)
    return (x / w).astype(np.float32), (y / w).astype(np.float32)


def _base(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """(H, W, 3) float32 linear colour of the whole: grain of many sizes, and spots with edges."""
    total = np.zeros((size[1], size[0], 3), np.float32)
    for k, cell in enumerate(_CELLS):
        noise = _noise(size, cell, rng, 3)
        grain = np.float32(0.8) * noise[..., :1] + np.float32(0.2) * noise  # mostly of one colour
        if k % 2:
            grain = np.tanh(np.float32(6.0) * (grain - np.float32(0.9))) + np.float32(1.0)
        total += np.float32(0.42 * 0.97**k) * grain
    return np.exp(np.float32(0.8) * total - np.float32(1.0)) * np.array([0.42, 0.36, 0.28], np.float32)


def _tile(side: int, rng: np.random.Generator) -> np.ndarray:
    """(side, side) float32 logarithm of a brightness: grain of a few pixels, its mean taken out."""
    grain = sum(_noise((side, side), cell, rng, 1).reshape(side, side) for cell in (1.5, 2.2, 3.2))
    return np.float32(0.16) * (grain - cv2.GaussianBlur(grain, (0, 0), 4.0))


def _noise(size: tuple[int, int], cell: float, rng: np.random.Generator, channels: int) -> np.ndarray:
    lattice = rng.standard_normal((int(size[1] / cell) + 3, int(size[0] / cell) + 3, channels), np.float32)
    grown = (int(lattice.shape[1] * cell), int(lattice.shape[0] * cell))
    return np.atleast_3d(cv2.resize(lattice, grown, interpolation=cv2.INTER_CUBIC))[: size[1], : size[0]]


def main() -> None:
    """Write a collection to a folder."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--width", type=int, default=4000)
    parser.add_argument("--height", type=int, default=3000)
    options = parser.parse_args()
    start = time.perf_counter()
    paths = make_collection(options.folder, options.count, (options.width, options.height))
    sys.stderr.write(f"{len(paths)} photos in {time.perf_counter() - start:.0f} s\n")


if __name__ == "__main__":
    main()
