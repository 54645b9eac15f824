"""Pinchmaps made for tests and benchmarks: files, prims and what the float64 twin shows of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Gf, Sdf, Usd

import fexel
from fexel_tools.pinchmap_mask import channels, is_legal

__all__ = ["blob_mask", "define_pinchmap", "pinchmap_stage", "random_pinchmap", "save_texels", "two_sides"]


def save_texels(path: Path, texels: np.ndarray) -> str:
    """Write (H, W, C) uint8, uint16, float16 or float32 as they are, row 0 at the top; returns the path."""
    kind = {"uint8": "uint8", "uint16": "uint16", "float16": "half", "float32": "float"}[str(texels.dtype)]
    spec = oiio.ImageSpec(texels.shape[1], texels.shape[0], texels.shape[2], kind)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.attribute("oiio:ColorSpace", "raw")
    writer = oiio.ImageOutput.create(str(path))
    assert writer is not None and writer.open(str(path), spec), oiio.geterror()
    assert writer.write_image(np.ascontiguousarray(texels)), writer.geterror()
    writer.close()
    return str(path)


def blob_mask(rng: np.random.Generator, shape: tuple[int, int], wrap: tuple[str, str]) -> np.ndarray:
    """A legal mask (Nh, Nw) of two discs, anywhere and across the border along an axis that repeats."""
    height, width = shape
    repeats = np.array([mode == "repeat" for mode in wrap[::-1]])
    cells = np.stack(np.mgrid[:height, :width], -1) + 0.5
    for _ in range(2000):
        mask = np.zeros(shape, bool)
        for _ in range(2):
            center = np.where(repeats, rng.uniform(0, 1, 2), rng.uniform(0.3, 0.7, 2)) * shape
            away = cells - center
            away = np.where(repeats, away - np.round(away / shape) * shape, away)
            mask |= np.hypot(away[..., 0], away[..., 1]) < rng.uniform(0.15, 0.3) * min(shape)
        if mask.any() and is_legal(mask, wrap):
            return mask
    raise AssertionError("no legal mask found")


def random_pinchmap(
    rng: np.random.Generator, shape: tuple[int, int] = (12, 16), wrap: tuple[str, str] = ("clamp", "clamp")
) -> tuple[np.ndarray, np.ndarray]:
    """A pinchmap (Nh, Nw, 4) of random gamma and strength with its mask, quantised as 8-bit files are."""
    mask = blob_mask(rng, shape, wrap)
    pinchmap = np.concatenate([channels(mask, wrap), rng.uniform(-0.6, 0.6, (*shape, 1))], -1)
    pinchmap[..., :2] *= rng.choice([1.0, 1.0, 0.5], (*shape, 1))
    return np.round(pinchmap * 127) / 127, mask


def two_sides(rng: np.random.Generator, mask: np.ndarray, octaves: int, opaque: bool = True) -> np.ndarray:
    """A signal (H, W, 4) uint8, straight alpha: one hue range on either side of the mask."""
    fine = np.kron(mask, np.ones((2**octaves, 2**octaves), bool))
    noise = rng.integers(0, 100, (*fine.shape, 4))
    signal = np.where(fine[..., None], 155 + noise, noise)
    signal[..., 3] = 255 if opaque else np.where(fine, 255, 60)
    return signal.astype(np.uint8)


def define_pinchmap(stage: Usd.Stage, path: str, signal: str, pinchmap: str, **inputs: object) -> Usd.Prim:
    """A PinchmapTexture; `inputs` by name: wrap (both tokens), antialias, lineWidth, lineColor, matrix, ..."""
    assert fexel.__all__
    prim = stage.DefinePrim(path, "PinchmapTexture")
    names = Sdf.ValueTypeNames
    values = {"file": (names.Asset, Sdf.AssetPath(signal)), "pinchmap": (names.Asset, Sdf.AssetPath(pinchmap))}
    values["sourceColorSpace"] = (names.Token, "raw")
    kinds = {"antialias": names.Float, "lineWidth": names.Float, "opacity": names.Float, "lineColor": names.Color4f}
    kinds |= {"wrapS": names.Token, "wrapT": names.Token, "sourceColorSpace": names.Token, "matrix": names.Matrix3d}
    kinds |= {"scale": names.Float4, "bias": names.Float4, "fallback": names.Float4}
    for name, value in inputs.items():
        values[name] = (kinds[name], Gf.Matrix3d(*np.ravel(value).tolist()) if name == "matrix" else value)
    for name, (kind, value) in values.items():
        if not isinstance(value, Sdf.AssetPath) or value.path:
            prim.CreateAttribute(f"inputs:{name}", kind).Set(value)
    return prim


def pinchmap_stage(signal: str, pinchmap: str, **inputs: object) -> Usd.Stage:
    """A stage whose ``/Pinchmap`` is this texture."""
    stage = Usd.Stage.CreateInMemory()
    define_pinchmap(stage, "/Pinchmap", signal, pinchmap, **inputs)
    return stage
