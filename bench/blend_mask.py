"""Speed and exactness of the gradient-density mask, eqs. (2) and (3), beside scikit-image's path cost."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from bench.harness import Row, shared_data, time_alternately
from fexel.images import image_info, read_pixels
from fexel_tools.blend_mask import blend_mask, gradient_density, gradient_map

NAME = "blend_mask"


def rows(quick: bool) -> Iterator[Row]:
    for label, image in _images(1200 if quick else 4000, 1000 if quick else 3000):
        yield from _speed(label, image)
        yield from _exactness(label, np.ascontiguousarray(image[:600, :800]))


def _images(width: int, height: int) -> Iterator[tuple[str, np.ndarray]]:
    noise = np.random.default_rng(2).normal(128, 2, (height, width, 3))
    yield "grey, noise of sigma 2", np.clip(np.rint(noise), 0, 255).astype(np.uint8)
    folder = shared_data()
    for name in ("stream_rocks_6mp.jpg", "dandelions_16mp.jpg", "petra_facade_6mp.jpg") if folder else ():
        photo = read_pixels(image_info(str(folder / "hires" / name)))[:height]
        tiles = -(-width // photo.shape[1]), -(-height // photo.shape[0])
        row = np.concatenate([photo[:, :: (-1) ** k] for k in range(tiles[0])], axis=1)[:, :width]
        yield name, np.ascontiguousarray(np.concatenate([row[:: (-1) ** k] for k in range(tiles[1])])[:height])


def _speed(label: str, image: np.ndarray) -> Iterator[Row]:
    megapixels = image.shape[0] * image.shape[1] / 1e6
    repeats = 3
    times = time_alternately(
        {
            "one": lambda: blend_mask(image[:, :, 1]),
            "all": lambda: blend_mask(image),
            "whole": lambda: gradient_density(image[:, :, 1]),
            "blur": lambda: cv2.GaussianBlur(image, (5, 5), 0),
        },
        repeats=repeats,
    )
    setting = f"{label}, {megapixels:.1f} MP"
    reference = "scikit-image path cost about 1.7 MP/s; stopped at tau 5 to 13"
    for measure, key, channels in (
        ("mask, automatic tau, one channel", "one", 1),
        ("mask, automatic tau, per channel of three on two threads", "all", 3),
    ):
        speed = channels * megapixels / times[key].median_s
        yield Row(measure, setting, speed, "MP/s", 4.0, ">=", reference, samples=repeats)
    whole = megapixels / times["whole"].median_s
    yield Row("density map of the whole image, one channel", setting, whole, "MP/s", samples=repeats)


def _exactness(label: str, image: np.ndarray) -> Iterator[Row]:
    from skimage.graph import MCP

    found = blend_mask(image)
    densest = np.zeros(image.shape[:2])
    border = np.ones(image.shape[:2], bool)
    border[1:-1, 1:-1] = False
    for channel in range(3):
        cost = gradient_map(image[:, :, channel]).astype(np.float64)
        cost[border] = 0
        densest = np.maximum(densest, MCP(cost, fully_connected=True).find_costs(np.argwhere(border))[0])
    error = float(np.abs(found.alpha - np.minimum(1, densest / found.tau)).max())
    setting = f"{label}, {image.shape[1]} x {image.shape[0]}"
    yield Row("mask, largest error of alpha against the exact path cost", setting, error, "", 1e-6, "<=")
