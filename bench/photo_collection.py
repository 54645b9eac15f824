"""A synthetic collection of large photos of one surface, with exact homographies: what `fexel zipmap` is timed on.

The surface is procedural and has detail at every scale, down to the pixels of the closest photo: noise over lattices
of many cell sizes, some bent into spots with edges. One photo shows the whole; the others look closer (2 to 16
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

_CELLS = (480, 240, 120, 56, 26, 12, 5.5, 2.4, 1.1, 0.5, 0.22)  # of the noise, pixels of the whole photo
_LATTICE = 1024


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
    lattices = [rng.normal(size=(_LATTICE, _LATTICE, 3)).astype(np.float32) for _ in range(3)]
    paths = []
    for number, shot in enumerate(shots):
        path = folder / f"{shot.name}.jpg"
        if not path.exists():
            picture = _photograph(shot, size, lattices, np.random.default_rng(seed + 100 + number))
            _write_jpeg(path, picture)
        paths.append(path)
    truth = {f"{s.name}.jpg": s.root_from_photo.tolist() for s in shots}
    (folder / "truth.json").write_text(json.dumps(truth, indent=1), "utf-8")
    return paths


def _write_jpeg(path: Path, picture: np.ndarray) -> None:
    spec = oiio.ImageSpec(picture.shape[1], picture.shape[0], 3, "uint8")
    spec.attribute("Compression", "jpeg:92")
    output = oiio.ImageOutput.create(str(path))
    if not (output and output.open(str(path), spec) and output.write_image(picture)):
        raise OSError(f"{path}: {oiio.geterror()}")
    output.close()


def _photograph(shot: Shot, size: tuple[int, int], lattices: list[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    width, height = size
    picture = np.empty((height, width, 3), np.uint8)
    columns = np.arange(width) + 0.5
    for top in range(0, height, 500):
        rows = np.arange(top, min(top + 500, height)) + 0.5
        points = np.stack([*np.meshgrid(columns, rows), np.ones((len(rows), width))], axis=-1) @ shot.root_from_photo.T
        x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
        linear = _surface(x, y, lattices) * shot.gain.astype(np.float32)
        encoded = np.clip(linear, 0.0, 1.0) ** (1.0 / 2.2) * 255.0 + rng.normal(0.0, 1.2, linear.shape)
        picture[top : top + len(rows)] = np.clip(np.rint(encoded), 0, 255)
    return picture


def _surface(x: np.ndarray, y: np.ndarray, lattices: list[np.ndarray]) -> np.ndarray:
    """Linear colour at root pixels; detail finer than the sampling is left out."""
    step = float(np.hypot(x[0, 1] - x[0, 0], y[0, 1] - y[0, 0]))
    total = np.zeros((*x.shape, 3), np.float32)
    for k, cell in enumerate(_CELLS):
        visible = np.clip((cell / step - 1.0) / 2.0, 0.0, 1.0)  # fades out where a cell comes near a pixel
        if visible == 0.0:
            continue
        angle = 2.4 * k
        u = ((np.cos(angle) * x - np.sin(angle) * y) / cell + 37.1 * k) % _LATTICE
        v = ((np.sin(angle) * x + np.cos(angle) * y) / cell + 91.7 * k) % _LATTICE
        noise = cv2.remap(
            lattices[k % len(lattices)],
            u.astype(np.float32),
            v.astype(np.float32),
            cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_WRAP,
        )
        grain = 0.8 * noise[..., :1] + 0.2 * noise  # mostly of one colour
        if k % 2:
            grain = np.tanh(6.0 * (grain - 0.9)) + 1.0  # sparse spots with edges
        total += np.float32(visible * 0.5 * 0.82**k) * grain
    return np.exp(0.8 * total - 1.0) * np.array([0.42, 0.36, 0.28], np.float32)


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
