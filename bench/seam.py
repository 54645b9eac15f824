"""Visibility of patch borders: CIEDE2000 step across them minus the step in the supersampled truth.

A child is cut from a photo at full resolution, given another exposure, white balance, vignetting and noise, and stored
in 8 bits; its parent is the photo reduced 4 or 8 times. The child goes through colour match, Poisson equation and blend
mask as `fexel zipmap` does it, and the zipmap is composited at one, two and `scale` pixels per texel of the parent. The
truth is the photo, area-averaged to the same pixels.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from bench.harness import Row, scratch, shared_data
from fexel import homography
from fexel.images import linear_to_srgb, read_linear, srgb_to_linear
from fexel.textures.zipmap import ImageSource, ZipmapData
from fexel_tools.blend_mask import blend_mask
from fexel_tools.color_match import match_color
from fexel_tools.poisson import clone, detailed_border, ring_points
from fexel_tools.seam import seam_steps
from fexel_tools.texture_files import encode, write_texture
from fexel_tools.zipmap_baking import bake_zipmap

NAME = "seam"
_BOX = (0.35, 0.30, 0.70, 0.65)  # the child's part of the photo
_CASES = {4: (1.6, 1.4, 1.2), 8: (0.7, 0.8, 0.9)}  # scale: gain per channel that the child has lost


def rows(quick: bool) -> Iterator[Row]:
    folder = shared_data()
    if folder is None:
        return
    for name in ("petra_facade_6mp.jpg",) if quick else ("petra_facade_6mp.jpg", "stream_rocks_6mp.jpg"):
        for scale, gain in _CASES.items():
            scene = _Scene(folder / "hires" / name, scale, gain)
            for magnification in (1, 2, scale):
                yield from _measured(scene, magnification)


class _Scene:
    """A photo, its reduced parent and the child's textures: as the tools make it, and pasted as it is."""

    def __init__(self, photo: Path, scale: int, gain: tuple[float, float, float]) -> None:
        self.name, self.scale = photo.stem, scale
        image = read_linear(str(photo), "sRGB")[..., :3]
        self.height, self.width = (size // scale * scale for size in image.shape[:2])
        self.photo = image[: self.height, : self.width]
        sizes = (self.width, self.height, self.width, self.height)
        self.box = tuple(int(share * size) for share, size in zip(_BOX, sizes, strict=True))
        parent = _stored(self.truth(1))
        child = self._degraded(np.array(gain, np.float32))
        self.files = {name: str(scratch() / f"seam_{name}.tif") for name in ("root", "ours", "pasted")}
        write_texture(self.files["root"], parent)
        write_texture(self.files["pasted"], child, np.ones(child.shape[:2]))
        solved = self._authored(child, parent)
        write_texture(self.files["ours"], solved, blend_mask(encode(solved, None, "uint8", "sRGB")).alpha)

    def truth(self, magnification: int) -> np.ndarray:
        """The photo at so many pixels per texel of the parent."""
        size = (self.width * magnification // self.scale, self.height * magnification // self.scale)
        return cv2.resize(self.photo, size, interpolation=cv2.INTER_AREA)

    def picture(self, patch: str | None, magnification: int) -> np.ndarray:
        """The zipmap with one of the textures as its patch, or the root alone."""
        x0, y0, x1, y1 = self.box
        w, h = x1 - x0, y1 - y0
        to_patch = np.array([[self.width / w, 0, 0], [0, self.height / h, 0], [-x0 / w, 1 - (self.height - y0) / h, 1]])
        sources = [ImageSource(self.files["root"], color_space="sRGB", wrap=("clamp", "clamp"))]
        matrices = [np.eye(3)]
        if patch:
            sources.append(ImageSource(self.files[patch], color_space="sRGB"))
            matrices.append(homography.normalize(to_patch))
        count = len(sources)
        data = ZipmapData(
            tuple(f"/{k}" for k in range(count)), tuple(sources), np.arange(count), np.array(matrices), np.ones(count)
        )
        height, width = self.truth(magnification).shape[:2]
        return bake_zipmap(data, width, height)[..., :3]

    def _degraded(self, gain: np.ndarray) -> np.ndarray:
        x0, y0, x1, y1 = self.box
        y, x = np.indices((y1 - y0, x1 - x0))
        vignette = 1 - 0.15 * ((y / (y1 - y0) - 0.5) ** 2 + (x / (x1 - x0) - 0.5) ** 2)
        noise = np.random.default_rng(5).normal(0, 0.002, (*x.shape, 3))
        return _stored(self.photo[y0:y1, x0:x1] / gain * vignette[..., None] + noise)

    def _authored(self, child: np.ndarray, parent: np.ndarray) -> np.ndarray:
        x0, y0 = self.box[:2]
        parent_from_child = np.array([[1, 0, x0], [0, 1, y0], [0, 0, self.scale]]) / self.scale
        matched = match_color(child, parent, parent_from_child).apply(child)
        texels = (ring_points(*child.shape[:2]) + (x0, y0)) / self.scale - 0.5
        border = np.stack([map_coordinates(parent[..., c], texels.T[::-1], order=1, mode="nearest") for c in range(3)])
        return np.maximum(clone(matched, detailed_border(matched, border.T, self.scale)), 0)


def _stored(linear: np.ndarray) -> np.ndarray:
    """Linear values after a passage through an 8-bit sRGB file."""
    return srgb_to_linear(encode(linear.astype(np.float32), None, "uint8", "sRGB") / np.float32(255))


def _measured(scene: _Scene, magnification: int) -> Iterator[Row]:
    truth = scene.truth(magnification)
    x0, y0, x1, y1 = np.array(scene.box) * (magnification / scene.scale)
    outline = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    pictures = {name: scene.picture(name, magnification) for name in ("ours", "pasted", None)}
    steps = {name: seam_steps(picture, truth, outline) for name, picture in pictures.items()}
    setting = f"{scene.name}, scale {scene.scale}, {magnification} px per parent texel"
    samples = len(steps["ours"])
    note = "against the photo; a root without any patch differs from it as much, by its own texels"
    for measure, of, target in (("mean", np.mean, 0.5), ("99th percentile", lambda v: np.percentile(v, 99), 2.0)):
        pasted, alone = float(of(steps["pasted"])), float(of(steps[None]))
        reference = f"child pasted as it is {pasted:.2f}; root alone, no patch at all {alone:.2f}"
        value = float(of(steps["ours"]))
        yield Row(f"seam, {measure}", setting, value, "dE00", target, "<=", reference, samples=samples, note=note)
        added, pasted = (float(of(steps[name] - steps[None])) for name in ("ours", "pasted"))
        reference = f"child pasted as it is {pasted:.2f}"
        measure = f"seam, {measure} of what the patch adds to the root's own step"
        yield Row(measure, setting, added, "dE00", target, "<=", reference, samples=samples)
    inside = tuple(slice(int(a + 0.15 * (b - a)), int(b - 0.15 * (b - a))) for a, b in ((y0, y1), (x0, x1)))
    error = {
        k: np.sqrt(np.mean((linear_to_srgb(v)[inside] - linear_to_srgb(truth)[inside]) ** 2))
        for k, v in pictures.items()
    }
    reference = f"child pasted as it is {255 * error['pasted']:.1f}; root alone {255 * error[None]:.1f}"
    yield Row("colour error inside the patch, sRGB", setting, 255 * float(error["ours"]), "/255", reference=reference)
