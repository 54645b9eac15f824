"""Filtering quality: a zipmap rendered against brute-force supersampled compositing, in dB, trilinear and anisotropic.

Truth is eq. (1) at 8 x 8 places per pixel, each a bilinear lookup in the full images, averaged in linear light. Images
are noise whose amplitude falls as one over frequency, rougher than most photographs, so figures are on the low side.
Magnification is that of the whole view over one in which the root fills it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from bench.harness import Curve, Row, time_alternately
from bench.zipmap_stage import (
    Patch,
    compiled_view,
    front_view,
    lookup_texture,
    pixel_st,
    quad,
    save,
    tilted_view,
    zipmap_stage,
    zipmap_texture,
)
from fexel import homography
from fexel.renderer.context import GLContext
from fexel.renderer.program import ProgramCache
from fexel.renderer.visible import View
from fexel.textures.system import TextureSystem
from fexel.textures.zipmap_twin import layer_pyramid, sample_zipmap

NAME = "zipmap filtering quality"
_TARGETS = {1: 32.0, 8: 36.0, 32: 40.0, 256: 69.0}
_SAMPLES = 8
_PIXELS = 128
_TEXELS = 512
_CURVE_PIXELS = 160
_PROBES = (1, 2, 4, 8, 16)


def photo_like(rng: np.random.Generator, size: int) -> np.ndarray:
    """(size, size, 3) in [0, 1]: noise whose amplitude falls as one over frequency."""
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size)))
    spectrum = np.fft.fft2(rng.normal(size=(size, size, 3)), axes=(0, 1)) / np.maximum(frequency, 1 / size)[..., None]
    image = np.fft.ifft2(spectrum, axes=(0, 1)).real
    return np.clip(0.5 + 0.18 * image / image.std(), 0, 1).astype(np.float32)


def quality_db(gl, folder: Path, view: View, anisotropy: float) -> float:
    """PSNR of a root and one soft-rimmed patch of a quarter of its width, over the pixels that show them."""
    rng = np.random.default_rng(20100504)
    images = [photo_like(rng, _TEXELS) for _ in range(2)]
    place = np.minimum(np.arange(_TEXELS) + 0.5, _TEXELS - np.arange(_TEXELS) - 0.5) / _TEXELS
    mask = np.clip(8 * np.minimum(place[:, None], place[None, :]), 0, 1).astype(np.float32)[..., None]
    layers = [np.concatenate([images[0], np.ones_like(mask)], -1), np.concatenate([images[1] * mask, mask], -1)]
    matrix = homography.translate(-0.4, -0.4) @ homography.scale(4, 4)
    files = [save(folder / f"{n}.exr", layer, "float32", "raw", 20) for n, layer in enumerate(layers)]
    patch = Patch(files[1], matrix, color_space="raw")
    texture = zipmap_texture(zipmap_stage(Patch(files[0], np.eye(3), children=(patch,), color_space="raw")))
    system = TextureSystem(gl, anisotropy=anisotropy)
    st, jacobian, shown = pixel_st(view)
    rendered = lookup_texture(gl, texture, quad(), view, st, jacobian, system).reshape(-1, 4)[shown]
    system.release()
    truth = _supersampled([layer_pyramid(layer, n > 0)[:1] for n, layer in enumerate(layers)], texture, view)[shown]
    error = np.mean((rendered[:, :3] - truth[:, :3]) ** 2)
    return float(-10 * np.log10(max(error, 1e-20)))


def _supersampled(pyramids: list, texture, view: View) -> np.ndarray:
    fine = View(view.world_to_clip, view.width * _SAMPLES, view.height * _SAMPLES)
    st = np.nan_to_num(pixel_st(fine)[0])
    data = texture.data
    color = sample_zipmap(pyramids, data.root_to_patch, data.opacity, st, np.zeros((len(st), 2, 2)))
    blocks = color.reshape(view.height, _SAMPLES, view.width, _SAMPLES, 4)
    return blocks.mean(axis=(1, 3)).reshape(-1, 4)


def rows(quick: bool) -> Iterator[Row]:
    """Front views at each magnification, then tilted ones with and without anisotropic probes."""
    with GLContext() as gl, tempfile.TemporaryDirectory() as name:
        for magnification in list(_TARGETS)[:: 3 if quick else 1]:
            low = np.array([0.47, 0.47]) * (1 - 1 / magnification)
            view = front_view(low, low + 1 / magnification, _PIXELS, _PIXELS)
            value = quality_db(gl, Path(name), view, 1.0)
            yield _row(f"front, magnified {magnification}", value, _TARGETS[magnification], "trilinear")
        for tilt in (60.0, 80.0):
            view = tilted_view((0.5, 0.5), 0.8, tilt, _PIXELS, _PIXELS)
            plain, probed = (quality_db(gl, Path(name), view, anisotropy) for anisotropy in (1.0, 8.0))
            yield _row(f"tilted {tilt:g} degrees, 8 probes", probed, plain, "the target is our own trilinear filter")


def _row(setting: str, value: float, target: float, note: str) -> Row:
    return Row(
        measure="zipmap against supersampled compositing",
        setting=setting,
        value=value,
        unit="dB",
        target=target,
        comparison=">=",
        reference="trilinear 32 to 36 (magnified 1 to 8), 40 (32), 69 (256)",
        samples=_PIXELS**2,
        note=note,
    )


def curves(quick: bool) -> Iterator[Curve]:
    """Time of a frame against PSNR by number of anisotropic probes, and of the root texture alone.

    The patch holds the detail of the middle quarter of the root, seen from so close that the root alone is blurred.
    """
    with GLContext() as gl, tempfile.TemporaryDirectory() as name:
        layers = _detail_layers()
        files = [save(Path(name) / f"{n}.exr", layer, "float16", "raw", 20) for n, layer in enumerate(layers)]
        patch = Patch(files[1], _middle_quarter(), color_space="raw")
        whole = zipmap_texture(zipmap_stage(Patch(files[0], np.eye(3), children=(patch,), color_space="raw")))
        root = zipmap_texture(zipmap_stage(Patch(files[0], np.eye(3), color_space="raw")))
        for tilt in (60.0,) if quick else (60.0, 80.0):
            view = tilted_view((0.5, 0.5), 0.15, tilt, _CURVE_PIXELS, _CURVE_PIXELS)
            truth = _supersampled([layer_pyramid(layer, n > 0)[:1] for n, layer in enumerate(layers)], whole, view)
            zipmap = _cost_and_quality(gl, whole, view, truth, _PROBES, 3 if quick else 9)
            yield _curve(f"zipmap, tilted {tilt:g} degrees, by probes", zipmap, True)
            alone = _cost_and_quality(gl, root, view, truth, (1, 16), 3 if quick else 9)
            yield _curve(f"root texture alone, tilted {tilt:g} degrees, by probes", alone, False)


def _middle_quarter() -> np.ndarray:
    return homography.translate(-0.375, -0.375) @ homography.scale(4, 4)


def _detail_layers() -> list[np.ndarray]:
    """Root, and the patch of its middle quarter: one image, reduced and cut out, premultiplied, rim of a sixteenth."""
    fine = photo_like(np.random.default_rng(20100504), 4 * _TEXELS)
    root = cv2.resize(fine, (_TEXELS, _TEXELS), interpolation=cv2.INTER_AREA)
    low = 3 * _TEXELS // 2
    place = np.minimum(np.arange(_TEXELS) + 0.5, _TEXELS - np.arange(_TEXELS) - 0.5) / _TEXELS
    mask = np.clip(16 * np.minimum(place[:, None], place[None, :]), 0, 1).astype(np.float32)[..., None]
    patch = fine[low : low + _TEXELS, low : low + _TEXELS] * mask
    return [np.concatenate([root, np.ones_like(mask)], -1), np.concatenate([patch, mask], -1)]


def _cost_and_quality(gl, texture, view: View, truth: np.ndarray, probes, repeats: int) -> dict[int, tuple]:
    """Milliseconds of a frame and PSNR over the pixels that show the patch, by number of probes."""
    systems = {n: TextureSystem(gl, anisotropy=float(n)) for n in probes}
    programs = ProgramCache(gl)
    target = gl.framebuffer([gl.renderbuffer((view.width, view.height), 4, dtype="f2")])
    st, jacobian, _ = pixel_st(view)
    shown = (np.abs(np.nan_to_num(st, nan=9) - 0.5) < 0.125).all(axis=1)
    quality, frames = {}, {}
    for n, system in systems.items():
        rendered = lookup_texture(gl, texture, quad(), view, st, jacobian, system).reshape(-1, 4)[shown, :3]
        quality[n] = float(-10 * np.log10(np.mean((rendered - truth[shown, :3]) ** 2)))
        frames[n] = _frame(gl, target, compiled_view(gl, programs, quad(), view, (texture, system)))
    times = time_alternately(frames, repeats=repeats)
    for system in systems.values():
        system.release()
    target.release()
    return {n: (1e3 * times[n].median_s, quality[n]) for n in probes}


def _frame(gl, target, compiled):
    program, binding, draw = compiled

    def frame() -> None:
        binding.apply(program)
        target.use()
        draw()
        gl.finish()

    return frame


def _curve(label: str, points: dict[int, tuple], ours: bool) -> Curve:
    return Curve(
        plot="zipmap_quality",
        label=label,
        x=[milliseconds for milliseconds, _ in points.values()],
        y=[decibels for _, decibels in points.values()],
        x_label=f"milliseconds per frame, {_CURVE_PIXELS} x {_CURVE_PIXELS} pixels",
        y_label="PSNR against supersampled compositing, dB",
        ours=ours,
        annotations=[str(n) for n in points],
    )
