"""Comparison of a rendered picture with a stored one: mean FLIP, share of pixels off, hard limit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from fexel.images import linear_to_srgb

REPOSITORY = Path(__file__).resolve().parent.parent
GOLDEN = REPOSITORY / "tests" / "golden"
FAILED = REPOSITORY / "out" / "golden"
_OFF = 0.1  # FLIP beyond which a pixel counts as off: a difference seen side by side


def check_golden(
    name: str, color: np.ndarray, update: bool, *, mean: float = 0.01, off: float = 0.01, limit: float = 0.5
) -> None:
    """Fail unless the picture agrees with the stored one within the three bounds, FLIP in 0..1."""
    path = GOLDEN / f"{name}.png"
    picture = encode(color)
    if update:
        write(path, picture)
        return
    if not path.is_file():
        pytest.fail(f"{path} is missing; run pytest --update-goldens, look at it, and commit it")
    stored = read(path)
    assert stored.shape == picture.shape, f"{path}: {stored.shape}, rendered {picture.shape}"
    difference = np.maximum(flip(on_grey(stored), on_grey(picture)), np.abs(alpha(stored) - alpha(picture)))
    figures = {"mean": difference.mean(), "off": (difference > _OFF).mean(), "limit": difference.max()}
    bounds = {"mean": mean, "off": off, "limit": limit}
    exceeded = [f"{key} {figures[key]:.4f} > {bounds[key]}" for key in figures if not figures[key] <= bounds[key]]
    if exceeded:
        write(FAILED / f"{name}.render.png", picture)
        write(FAILED / f"{name}.golden.png", stored)
        write(FAILED / f"{name}.difference.png", np.round(255 * np.clip(difference, 0, 1)).astype(np.uint8)[..., None])
        pytest.fail(f"{name} differs from its golden: {', '.join(exceeded)}; see {FAILED}")


def flip(reference: np.ndarray, test: np.ndarray) -> np.ndarray:
    """FLIP per pixel (Andersson et al. 2020) of two sRGB-encoded pictures, (H, W, 3) float32 in 0..1."""
    evaluator = pytest.importorskip("flip_evaluator")
    error, _, _ = evaluator.evaluate(reference, test, "LDR", inputsRGB=True, applyMagma=False)
    return np.asarray(error)[..., 0]


def encode(color: np.ndarray) -> np.ndarray:
    """Linear premultiplied (H, W, 4) float to sRGB-encoded straight (H, W, 4) uint8."""
    opacity = np.clip(color[..., 3:], 0, 1)
    straight = np.divide(color[..., :3], opacity, out=np.zeros_like(color[..., :3]), where=opacity > 0)
    encoded = np.concatenate([np.clip(linear_to_srgb(straight), 0, 1), opacity], axis=-1)
    return np.round(encoded * 255).astype(np.uint8)


def on_grey(pixels: np.ndarray) -> np.ndarray:
    """Straight RGBA uint8 over middle grey, float32 in 0..1, encoded values mixed (for comparison alone)."""
    values = pixels.astype(np.float32) / 255
    return np.ascontiguousarray(values[..., :3] * values[..., 3:] + 0.5 * (1 - values[..., 3:]))


def alpha(pixels: np.ndarray) -> np.ndarray:
    return pixels[..., 3].astype(np.float32) / 255


def read(path: Path) -> np.ndarray:
    configuration = oiio.ImageSpec()
    configuration.attribute("oiio:UnassociatedAlpha", 1)
    image = oiio.ImageInput.open(str(path), configuration)
    pixels = image.read_image(oiio.UINT8)
    image.close()
    return pixels


def write(path: Path, pixels: np.ndarray) -> None:
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.UINT8)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.attribute("png:compressionLevel", 9)
    path.parent.mkdir(parents=True, exist_ok=True)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec) and output.write_image(np.ascontiguousarray(pixels)) and output.close()
