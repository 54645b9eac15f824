"""All dome lights of a scene as one environment around the world's origin.

Each dome's latitude-longitude image is turned into the world's axes, multiplied by its colour and added up. From the
sum come the irradiance (integrated here, exact to the resolution) and the radiance for glossy reflection (filtered by
`dome_prefilter.frag`, one mip level per roughness). Images: row 0 at +y, the middle column at +z, as in OpenEXR.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fexel.errors import FexelError, FexelWarning
from fexel.images import srgb_to_linear
from fexel.packages import local_file
from fexel.scene.model import Light

__all__ = ["RADIANCE_HEIGHT", "dome_irradiance", "dome_key", "dome_radiance", "latlong_directions"]

RADIANCE_HEIGHT = 256
_IRRADIANCE_HEIGHT = 32
_SOURCE_HEIGHT = 64  # of the radiance that the irradiance is integrated from


def dome_key(domes: Sequence[Light]) -> tuple:
    """Equal for domes that give the same environment."""
    return tuple(
        (dome.color, dome.light_to_world.tobytes(), dome.diffuse, dome.specular, dome.texture_file) for dome in domes
    )


def latlong_directions(height: int) -> np.ndarray:
    """World directions (height, 2 height, 3) float64 of the texel centres."""
    latitude = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    longitude = (0.5 - (np.arange(2 * height) + 0.5) / (2 * height)) * 2.0 * np.pi
    lat, lon = np.meshgrid(latitude, longitude, indexing="ij")
    return np.stack([np.cos(lat) * np.sin(lon), np.sin(lat), np.cos(lat) * np.cos(lon)], axis=-1)


def dome_radiance(domes: Sequence[Light], share: str, cache: dict[str, np.ndarray] | None = None) -> np.ndarray:
    """Sum of the domes' radiance.

    Parameters
    ----------
    domes : sequence of Light
        Of kind ``dome``. An unreadable image warns and counts as black.
    share : {'diffuse', 'specular'}
        Which of the lights' multipliers to apply.
    cache : dict, optional
        Images by file, kept by the caller from frame to frame.

    Returns
    -------
    (256, 512, 3) float32
        Linear Rec.709, at least 0; (1, 2, 3) when no dome has an image.
    """
    textured = any(dome.texture_file for dome in domes)
    directions = latlong_directions(RADIANCE_HEIGHT if textured else 1)
    total = np.zeros(directions.shape, np.float64)
    for dome in domes:
        color = np.asarray(dome.color, np.float64) * getattr(dome, share)
        if dome.texture_file:
            image = _image(dome, {} if cache is None else cache)
            total += color * _look_up(image, directions @ _world_to_light(dome))
        else:
            total += color
    return np.maximum(total, 0.0).astype(np.float32)


def dome_irradiance(radiance: np.ndarray) -> np.ndarray:
    """Irradiance over pi of every direction.

    Parameters
    ----------
    radiance : (H, 2H, 3) float32

    Returns
    -------
    (32, 64, 3) float32
        Equals the radiance where that is constant; (1, 2, 3) for an input of that size.
    """
    if radiance.shape[0] == 1:
        return radiance
    step = radiance.shape[0] // _SOURCE_HEIGHT
    area = np.cos((0.5 - (np.arange(radiance.shape[0]) + 0.5) / radiance.shape[0]) * np.pi)
    weighted = _block_sums(radiance * area[:, None, None], step)
    weights = _block_sums(np.broadcast_to(area[:, None, None], (*radiance.shape[:2], 1)), step)
    towards = latlong_directions(_SOURCE_HEIGHT).reshape(-1, 3).astype(np.float32)
    facing = latlong_directions(_IRRADIANCE_HEIGHT).reshape(-1, 3).astype(np.float32)
    cosines = np.maximum(facing @ towards.T, 0.0)
    sums = cosines @ np.concatenate([weighted, weights], axis=-1).reshape(-1, 4).astype(np.float32)
    return (sums[:, :3] / sums[:, 3:]).reshape(_IRRADIANCE_HEIGHT, 2 * _IRRADIANCE_HEIGHT, 3)


def _block_sums(image: np.ndarray, step: int) -> np.ndarray:
    height, width, channels = image.shape
    return image.reshape(height // step, step, width // step, step, channels).sum(axis=(1, 3), dtype=np.float64)


def _world_to_light(dome: Light) -> np.ndarray:
    # Row vectors: a world direction times the inverse of the rotation (the transpose of a singular one is no worse).
    rotation = dome.light_to_world[:3, :3]
    return np.linalg.inv(rotation) if abs(np.linalg.det(rotation)) > 1e-12 else rotation.T


def _image(dome: Light, cache: dict[str, np.ndarray]) -> np.ndarray:
    if dome.texture_file not in cache:
        try:
            cache[dome.texture_file] = _read(dome.texture_file)
        except FexelError as error:
            warnings.warn(f"{dome.path}.inputs:texture:file: {error}", FexelWarning, stacklevel=2)
            cache[dome.texture_file] = np.zeros((1, 2, 3), np.float32)
    return cache[dome.texture_file]


def _read(file: str) -> np.ndarray:
    """Linear image (H, W, 3) float32, averaged down to about the resolution that is needed."""
    import OpenImageIO as oiio

    source = oiio.ImageInput.open(local_file(file))
    if not source:
        raise FexelError(f"{file}: {' '.join(oiio.geterror().split())}")
    spec = source.spec()
    small = spec.format.basetype == oiio.UINT8
    pixels = source.read_image(0, 0, 0, min(spec.nchannels, 3), oiio.UINT8 if small else oiio.FLOAT)
    source.close()
    if pixels is None:
        raise FexelError(f"{file}: {' '.join(source.geterror().split())}")
    pixels = pixels.reshape(spec.height, spec.width, -1)
    pixels = pixels if pixels.shape[-1] == 3 else np.repeat(pixels[..., :1], 3, axis=-1)
    space = spec.get_string_attribute("oiio:ColorSpace")
    linear_format = Path(file.rstrip("]")).suffix.lower() in (".exr", ".hdr")
    encoded = "srgb" in space.lower() or (not space and not linear_format)
    if small:
        levels = np.arange(256, dtype=np.float32) / 255.0
        return _reduced((srgb_to_linear(levels) if encoded else levels)[pixels], 2 * RADIANCE_HEIGHT)
    pixels = np.nan_to_num(pixels, nan=0.0, posinf=65504.0, neginf=0.0)
    return _reduced(srgb_to_linear(pixels) if encoded else pixels, 2 * RADIANCE_HEIGHT)


def _reduced(image: np.ndarray, height: int) -> np.ndarray:
    step = max(image.shape[0] // height, 1)
    rows, columns = image.shape[0] // step * step, image.shape[1] // step * step
    if step == 1 or not columns:
        return image
    return (_block_sums(image[:rows, :columns], step) / step**2).astype(np.float32)


def _look_up(image: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Bilinear lookup of a latitude-longitude image by (not necessarily unit) directions (..., 3)."""
    height, width = image.shape[:2]
    length = np.maximum(np.linalg.norm(direction, axis=-1), 1e-30)
    x = (0.5 - np.arctan2(direction[..., 0], direction[..., 2]) / (2.0 * np.pi)) * width - 0.5
    y = (0.5 - np.arcsin(np.clip(direction[..., 1] / length, -1.0, 1.0)) / np.pi) * height - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - x0)[..., None], (y - y0)[..., None]
    left, right = x0 % width, (x0 + 1) % width
    top, bottom = np.clip(y0, 0, height - 1), np.clip(y0 + 1, 0, height - 1)
    upper = image[top, left] * (1 - fx) + image[top, right] * fx
    lower = image[bottom, left] * (1 - fx) + image[bottom, right] * fx
    return upper * (1 - fy) + lower * fy
