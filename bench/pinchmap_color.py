"""What makes a pinchmap's colours good: smooth colours on both sides, where sides come from, how fine the signal is.

`pinchmap_authoring` judges the pictures as they are. Here the parts are told apart, on the same drawings and images:

* Smooth colours: every shape filled with one smooth random picture inside and another outside, so that its boundary is
  the only discontinuity; opaque, 7 bytes a texel (pinchmap 4, signal 3). This is what a pinchmap is for.
* Sides: from alpha, from the regions of the picture, and the better of the two for each picture.
* Signal: pinchmaps of 32, 20 and 11 texels with signals 1, 2 and 4 times as fine, all of about the same bytes.
* Filling: least squares through the pinch against the inverse warp of the paper (section 7.2, step 5).

PSNR is that of sRGB-encoded values over white at the source's resolution, with the anti-aliased lookup; textures are
stored in 8 bits. The bilinear rival is the least squares texture in that very space, over the part that is not empty.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from bench.distance_field import least_squares_texels, upsampled
from bench.harness import Row, progress
from bench.pinch_shapes import drawings, images
from fexel.errors import FexelWarning
from fexel.images import linear_to_srgb, srgb_to_linear
from fexel.textures.pinchmap_twin import pinch
from fexel_tools.pinchmap_baking import reconstruct
from fexel_tools.pinchmap_fit import fit
from fexel_tools.pinchmap_measure import psnr_db
from fexel_tools.pinchmap_options import map_shape
from fexel_tools.pinchmap_signal import fill_signal
from fexel_tools.pinchmap_source import PinchmapSource, load_source
from fexel_tools.pinchmap_strength import boundary_strength
from fexel_tools.pinchmap_window import choose_window, cut

NAME = "pinchmap colour"
_SIZES = (32, 64)
_SIGNALS = ((32, 1), (20, 2), (11, 4))
_GRID = 4  # random colours along a side of the smooth pictures


def rows(quick: bool) -> Iterator[Row]:
    files = [*drawings(quick), *images()]
    if not files:
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FexelWarning)
        yield from _smooth_rows(files)
        yield from _side_rows(files)
        yield from _signal_rows(files)
        yield from _time_rows(files[0])


def _smooth_rows(files: list[Path]) -> Iterator[Row]:
    for size in _SIZES:
        setting = (
            f"{size} texels, {7 * size * size / 1000:.1f} kB, {len(files)} shapes with smooth colours on both sides"
        )
        found = []
        for number, path in enumerate(progress(files, f"smooth colours, {size}")):
            source = _smooth(load_source(path), np.random.default_rng(number))
            texels, signal, seen = _made(source, size, 1, None)
            ours = _psnr(_picture(texels, signal, seen), seen)
            nbytes = 7 * texels.shape[0] * texels.shape[1]
            plain = _psnr(_picture(texels, _inverse_warp(seen, texels), seen), seen)
            found.append((ours, ours - _bilinear(seen, nbytes), ours - _bilinear(seen, 7 * nbytes), ours - plain))
        psnr, equal, seven, filling = np.array(found).T
        yield _row("colour PSNR", setting, psnr)
        before = {32: ("12.6", "8.1"), 64: ("13.7", "8.5")}[size]
        for bytes_, gain, figure in (("equal bytes", equal, before[0]), ("seven times the bytes", seven, before[1])):
            reference = f"measured beforehand on ten shapes {figure}"
            yield _row(f"colour PSNR over a bilinear texture of {bytes_}", setting, gain, reference)
        yield _row("signal by least squares over the inverse warp", setting, filling, "measured beforehand 0.3")


def _side_rows(files: list[Path]) -> Iterator[Row]:
    found = []
    for path in progress(files, "sides"):
        by_regions = load_source(path, regions="auto")
        by_alpha = load_source(path) if (by_regions.opacity < 1).any() else by_regions
        found.append([_own_psnr(source, 64, 1) for source in (by_alpha, by_regions)])
    alpha, regions = np.array(found).T
    setting = f"64 texels, {len(files)} drawings and images"
    yield _row("colour PSNR, sides from alpha where there is one", setting, alpha)
    yield _row("colour PSNR, sides from regions", setting, regions)
    yield _row("colour PSNR, the better of the two for each picture", setting, np.maximum(alpha, regions))


def _signal_rows(files: list[Path]) -> Iterator[Row]:
    for size, finer in _SIGNALS:
        kilobytes = 4 * size * size * (1 + finer * finer) / 1000
        setting = f"{size} texels, signal {size * finer}, {kilobytes:.1f} kB, {len(files)} drawings and images"
        values = [_own_psnr(load_source(path), size, finer) for path in progress(files, f"signal x {finer}")]
        yield _row("colour PSNR, by fineness of the signal", setting, np.array(values))


def _time_rows(path: Path) -> Iterator[Row]:
    for size, finer in ((32, 1), (32, 4), (128, 1)):
        source = load_source(path)
        texels, _, seen = _made(source, size, finer, None)
        shape = (texels.shape[0] * finer, texels.shape[1] * finer)
        seconds = []
        for _ in range(7):
            start = time.process_time()
            fill_signal(seen, texels, shape)
            seconds.append(time.process_time() - start)
        setting = f"{path.stem}, {source.side.shape[1]} x {source.side.shape[0]} pixels to a signal of {size * finer}"
        yield Row("filling a signal", setting, float(np.median(seconds)), "s of CPU", samples=len(seconds))


def _row(measure: str, setting: str, values: np.ndarray, reference: str = "") -> Row:
    low, high = np.percentile(values, [25, 75])
    spread = float(high - low) / 2
    return Row(
        f"{measure}, median", setting, float(np.median(values)), "dB", None, None, reference, spread, len(values)
    )


def _smooth(source: PinchmapSource, rng: np.random.Generator) -> PinchmapSource:
    """The shape of a source, smooth colours inside and outside; opaque."""
    height, width = source.side.shape

    def field() -> np.ndarray:
        grid = rng.random((_GRID, _GRID, 3)).astype(np.float32)
        return srgb_to_linear(np.clip(cv2.resize(grid, (width, height), interpolation=cv2.INTER_CUBIC), 0, 1))

    side = source.side[..., None]
    return replace(source, color=field() * side + field() * (1 - side), opacity=np.ones_like(source.side))


def _made(
    source: PinchmapSource, size: int, finer: int, content: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, PinchmapSource]:
    """Pinchmap, signal, and the part of the source that they cover."""
    height, width = source.side.shape
    shape = map_shape(width, height, size)
    window = choose_window(source.side, shape, content=content)
    seen = replace(source, **{name: cut(getattr(source, name), window) for name in ("color", "opacity", "side")})
    texels = fit(seen.side, shape).pinchmap.copy()
    signal_shape = (shape[0] * finer, shape[1] * finer)
    texels[..., :2] *= boundary_strength(seen.side, texels, signal_shape)[..., None]
    return texels, fill_signal(seen, texels, signal_shape), seen


def _own_psnr(source: PinchmapSource, size: int, finer: int) -> float:
    """Of a picture as it is, over all of it."""
    texels, signal, seen = _made(source, size, finer, source.opacity > 0)
    share = seen.side.size / source.side.size  # what is left out is empty, and exact
    return _psnr(_picture(texels, signal, seen), seen) - 10 * math.log10(share)


def _picture(texels: np.ndarray, signal: np.ndarray, seen: PinchmapSource) -> np.ndarray:
    color = srgb_to_linear(np.rint(linear_to_srgb(signal[..., :3]) * 255) / np.float32(255))
    alpha = np.rint(signal[..., 3:] * 255) / np.float32(255)
    return reconstruct(texels, np.concatenate([color, alpha], axis=-1), seen.side.shape)


def _psnr(picture: np.ndarray, seen: PinchmapSource) -> float:
    truth = np.dstack([seen.color * seen.opacity[..., None], seen.opacity])
    return psnr_db(picture, truth) or math.nan


def _bilinear(seen: PinchmapSource, nbytes: int) -> float:
    """PSNR of the best opaque bilinear texture of so many bytes."""
    encoded = linear_to_srgb(seen.color)
    columns = max(math.floor(math.sqrt(nbytes / 3 * encoded.shape[1] / encoded.shape[0])), 1)
    texels = least_squares_texels(encoded, (max(nbytes // 3 // columns, 1), columns))
    stored = np.rint(np.clip(texels, 0, 1) * 255) / np.float32(255)
    return psnr_db(upsampled(stored, encoded.shape[:2]), encoded, None, encode=False) or math.nan


def _inverse_warp(seen: PinchmapSource, texels: np.ndarray) -> np.ndarray:
    """The signal as the paper fills it: each texel the mean of the pixels of its side that are displaced into it."""
    height, width = seen.side.shape
    s, t = np.meshgrid((np.arange(width) + 0.5) / width, 1 - (np.arange(height) + 0.5) / height)
    place = pinch(texels, np.stack([s.ravel(), t.ravel()], axis=1), 0.5)
    rows_, columns = texels.shape[:2]
    column = np.clip((place.st[:, 0] * columns).astype(int), 0, columns - 1)
    row = np.clip(((1 - place.st[:, 1]) * rows_).astype(int), 0, rows_ - 1)
    cell = row * columns + column
    weight = ((place.k_b > place.gamma_b) == (seen.side.ravel() > 0.5)).astype(np.float64)
    planes = np.dstack([linear_to_srgb(seen.color), seen.opacity]).reshape(-1, 4)
    total = np.bincount(cell, weight, rows_ * columns)
    means = [np.bincount(cell, weight * plane, rows_ * columns) / np.maximum(total, 1e-9) for plane in planes.T]
    filled = np.stack(means, axis=-1).reshape(rows_, columns, 4)
    empty = (total == 0).reshape(rows_, columns)
    filled[empty] = fill_signal(seen, texels, (rows_, columns))[empty]  # no pixel is displaced there
    return np.concatenate([srgb_to_linear(filled[..., :3]), filled[..., 3:]], axis=-1)
