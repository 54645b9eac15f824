"""Speed and exactness of the gradient-density mask, eqs. (2) and (3), beside scikit-image's path cost."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numba
import numpy as np

from bench.harness import Curve, Row, shared_data, time_alternately
from fexel.images import image_info, read_pixels
from fexel_tools.blend_mask import blend_mask, gradient_density, gradient_map

NAME = "blend_mask"
_SWEEPS = (1, 2, 4)


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


def curves(quick: bool) -> Iterator[Curve]:
    """Speed against error of alpha, one channel, tau given: exact path costs and raster sweeps that stop early."""
    from skimage.graph import MCP

    *_, (label, image) = _images(*((600, 450) if quick else (1600, 1200)))
    channel = np.ascontiguousarray(image[:, :, 1])
    tau = blend_mask(channel).tau
    cost = gradient_map(channel).astype(np.float64)
    seeds = np.argwhere(_border(cost.shape))
    cost[tuple(seeds.T)] = 0
    ways = {
        "fexel": lambda: blend_mask(channel, tau=tau).alpha,
        "scikit-image MCP, exact": lambda: _alpha(MCP(cost, fully_connected=True).find_costs(seeds)[0], tau),
        **{n: lambda n=n: _alpha(_swept(cost.astype(np.float32), n), tau) for n in _SWEEPS},
    }
    times = time_alternately(ways, repeats=1 if quick else 3)
    exact = ways["scikit-image MCP, exact"]()
    megapixels = channel.size / 1e6
    # The exact way has no error; the step of 8 bits, 1/255, divided by a thousand stands for none on the log axis.
    points = {
        key: (max(float(np.abs(way() - exact).max()), 1e-3 / 255), megapixels / times[key].median_s)
        for key, way in ways.items()
    }
    for key in ("fexel", "scikit-image MCP, exact"):
        yield _curve(key, label, [points[key]])
    yield _curve("raster sweeps, compiled", label, [points[n] for n in _SWEEPS], [str(n) for n in _SWEEPS])


def _border(shape: tuple[int, int]) -> np.ndarray:
    border = np.ones(shape, bool)
    border[1:-1, 1:-1] = False
    return border


def _alpha(density: np.ndarray, tau: float) -> np.ndarray:
    return np.minimum(1, density / tau)


@numba.njit(cache=True)
def _swept(cost, sweeps):
    """Path costs after passes forward and backward over the pixels in raster order, each looking at 4 neighbours."""
    height, width = cost.shape
    found = np.full((height, width), np.float32(1e30))
    found[0], found[-1], found[:, 0], found[:, -1] = 0, 0, 0, 0
    for number in range(2 * sweeps):
        step = 1 if number % 2 == 0 else -1
        for j in range(1, height - 1):
            y = j if step > 0 else height - 1 - j
            for i in range(1, width - 1):
                x = i if step > 0 else width - 1 - i
                least = min(found[y - step, x - 1], found[y - step, x], found[y - step, x + 1], found[y, x - step])
                found[y, x] = min(found[y, x], least + cost[y, x])
    return found


def _curve(label: str, image: str, points: list[tuple[float, float]], annotations: list[str] | None = None) -> Curve:
    return Curve(
        plot="blend_mask",
        label=label,
        x=[error for error, _ in points],
        y=[speed for _, speed in points],
        x_label=f"largest error of alpha ({image}); exact is drawn at 4e-6",
        y_label="MP/s, one channel",
        x_log=True,
        y_log=True,
        ours=label == "fexel",
        annotations=annotations or [],
    )
