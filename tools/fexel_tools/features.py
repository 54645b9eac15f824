"""Features of one photo, analysed once and matched against many.

A photo is reduced to a bounded working image in a perceptual encoding, from which come a pyramid of area averages
(for photometric alignment) and RootSIFT descriptors with a low contrast threshold (for finding where to start).

Sources: Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 2004; Arandjelovic and Zisserman,
"Three things everyone should know to improve object retrieval", CVPR 2012 (RootSIFT).

Conventions: continuous pixel coordinates, x right, y down, (0, 0) the outer corner of the first pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from fexel.errors import FexelError

__all__ = ["Features", "detect_features", "perceptual_rgb", "pyramid_only"]

MAX_SIDE = 2048  # of the working image, pixels
_DETECTION_SIDE = 1536  # of the image in which features are sought; SIFT doubles it once more
_CONTRAST = 0.006  # Lowe has 0.03; faint texture carries registration across large zoom
_PER_OCTAVE = 3000  # strongest features kept per octave of size
_SMALLEST_LEVEL = 8  # pixels, shorter side of the last pyramid level
_EXPOSURE_PERCENTILE = 99.0
_NO_FEATURES = (np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0), np.zeros((0, 128), np.float32))


@dataclass(frozen=True, eq=False)
class Features:
    """What registration needs of a photo.

    Attributes
    ----------
    width, height : int
        Of the photo, pixels.
    pyramid : tuple of (h, w, 3) uint16
        Perceptually encoded RGB, 65535 is the working white; each level averages 2 x 2 of the one before.
    points : (N, 2) float64
        Positions in the photo, continuous pixel coordinates.
    sizes : (N,) float64
        Diameters, pixels of the photo.
    angles : (N,) float64
        Orientations, radians from x towards y.
    responses : (N,) float64
        Contrast of the extremum, to choose the strongest.
    descriptors : (N, 128) float32
        RootSIFT, unit length.
    """

    width: int
    height: int
    pyramid: tuple[np.ndarray, ...]
    points: np.ndarray
    sizes: np.ndarray
    angles: np.ndarray
    responses: np.ndarray
    descriptors: np.ndarray

    @property
    def reduction(self) -> np.ndarray:
        """Photo pixels per working pixel, (2,) float64 in x and y."""
        height, width = self.pyramid[0].shape[:2]
        return np.array([self.width / width, self.height / height])


def perceptual_rgb(image: np.ndarray, *, max_side: int = MAX_SIDE) -> np.ndarray:
    """Reduce an image to a working size and encode it so that equal steps look about equal.

    Parameters
    ----------
    image : (H, W), (H, W, 1), (H, W, 2), (H, W, 3) or (H, W, 4) array
        8- and 16-bit integers are taken as sRGB-encoded, floats as linear and of any exposure. A last channel of two
        or four is alpha and ignored. Negative and non-finite floats count as black.
    max_side : int
        Longest side of the result, pixels.

    Returns
    -------
    (h, w, 3) uint16

    Raises
    ------
    FexelError
        Not an image: wrong number of axes or channels, no pixels, or another dtype.
    """
    image = _checked(image)
    reduced = _reduce(image, max_side)
    if image.dtype.kind == "f":
        reduced = _encode_linear(reduced)
    elif image.dtype == np.uint8:
        reduced = reduced * np.float32(257)
    rgb = np.repeat(reduced, 3, axis=2) if reduced.shape[2] == 1 else reduced
    return np.clip(np.rint(rgb), 0, 65535).astype(np.uint16)


def detect_features(image: np.ndarray, *, max_side: int = MAX_SIDE) -> Features:
    """Analyse a photo for `register_features`.

    Parameters
    ----------
    image : array
        See `perceptual_rgb`.
    max_side : int
        Longest side of the working image, pixels; bounds time and memory whatever the photo's size.

    Returns
    -------
    Features
        Without points where the photo shows nothing.

    Raises
    ------
    FexelError
        Not an image.
    """
    working = perceptual_rgb(image, max_side=max_side)
    height, width = np.shape(image)[:2]
    points, sizes, angles, responses, descriptors = _sift(working)
    per_pixel = np.array([width / working.shape[1], height / working.shape[0]])
    return Features(
        width=width,
        height=height,
        pyramid=_pyramid(working),
        points=points * per_pixel,
        sizes=sizes * np.sqrt(per_pixel.prod()),
        angles=angles,
        responses=responses,
        descriptors=descriptors,
    )


def pyramid_only(image: np.ndarray, *, max_side: int = MAX_SIDE) -> Features:
    """Analyse a photo for `refine`: as `detect_features`, without the features."""
    working = perceptual_rgb(image, max_side=max_side)
    height, width = np.shape(image)[:2]
    return Features(width, height, _pyramid(working), *_NO_FEATURES)


def _checked(image):
    image = np.asarray(image)
    if image.ndim == 2:
        image = image[:, :, None]
    if image.ndim != 3 or image.shape[2] not in (1, 2, 3, 4) or image.size == 0:
        raise FexelError(f"an image of shape {image.shape}, expected (height, width) with 1 to 4 channels")
    if image.dtype not in (np.uint8, np.uint16) and image.dtype.kind != "f":
        raise FexelError(f"an image of {image.dtype}, expected uint8, uint16 or float")
    return image[:, :, :-1] if image.shape[2] in (2, 4) else image


def _reduce(image, max_side):
    """Area average to the working size, float32; linear floats are cleaned first."""
    if image.dtype.kind == "f":
        image = np.where(np.isfinite(image), np.clip(image, 0, np.finfo(np.float32).max), 0).astype(np.float32)
    height, width = image.shape[:2]
    factor = min(1.0, max_side / max(height, width))
    if factor < 1:
        size = (max(1, round(width * factor)), max(1, round(height * factor)))
        image = cv2.resize(np.ascontiguousarray(image), size, interpolation=cv2.INTER_AREA)
    return np.atleast_3d(image).astype(np.float32)


def _encode_linear(linear):
    """Expose by a high percentile, then a square root with a short linear toe; highlights roll off."""
    white = float(np.percentile(linear, _EXPOSURE_PERCENTILE))
    exposed = linear / np.float32(max(white, 1e-12))  # 1e-12: a black image stays black
    compressed = np.where(exposed <= 1, exposed, 1 + np.log(np.maximum(exposed, 1)))
    return np.sqrt(compressed).astype(np.float32) * np.float32(52000)


def _pyramid(working):
    levels = [working]
    while min(levels[-1].shape[:2]) >= 2 * _SMALLEST_LEVEL:
        height, width = levels[-1].shape[:2]
        # Odd sizes round up: the level then covers the same extent with slightly anisotropic pixels.
        size = ((width + 1) // 2, (height + 1) // 2)
        levels.append(cv2.resize(levels[-1], size, interpolation=cv2.INTER_AREA))
    return tuple(levels)


def _sift(working):
    """RootSIFT features in working pixels: points, sizes, angles, responses, descriptors."""
    height, width = working.shape[:2]
    factor = min(1.0, _DETECTION_SIDE / max(height, width))
    grey = cv2.cvtColor(working, cv2.COLOR_RGB2GRAY)
    if factor < 1:
        size = (max(1, round(width * factor)), max(1, round(height * factor)))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    grey = _stretched(grey)
    if grey is None or min(grey.shape) < 16:  # SIFT leaves a rim of 5 pixels, so smaller images have no features
        return _NO_FEATURES
    sift = cv2.SIFT_create(0, 3, _CONTRAST, 20, 1.6, cv2.CV_32F, True)
    keypoints = _strongest_per_octave(sift.detect(grey, None))
    if not keypoints:
        return _NO_FEATURES
    keypoints, descriptors = sift.compute(grey, keypoints)
    per_pixel = np.array([width / grey.shape[1], height / grey.shape[0]])
    points = (np.array([k.pt for k in keypoints], np.float64) + 0.5) * per_pixel
    sizes = np.array([k.size for k in keypoints], np.float64) * np.sqrt(per_pixel.prod())
    angles = np.radians(np.array([k.angle for k in keypoints], np.float64))
    total = np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-6)  # 1e-6: an all-zero descriptor
    responses = np.array([k.response for k in keypoints], np.float64)
    return points, sizes, angles, responses, np.sqrt(descriptors / total).astype(np.float32)


def _stretched(grey):
    """8 bits from the 0.1st to the 99.9th percentile, so that hazy photos have features; None for a flat image."""
    low, high = np.percentile(grey[::2, ::2], [0.1, 99.9])
    if high - low < 65535 * 0.01:
        return None
    return np.clip((grey.astype(np.float32) - low) * (255 / (high - low)), 0, 255).astype(np.uint8)


def _strongest_per_octave(keypoints):
    keypoints = list(keypoints)
    if not keypoints:
        return []
    size = np.array([k.size for k in keypoints])
    response = np.array([k.response for k in keypoints])
    octave = np.floor(np.log2(np.maximum(size, 1e-3))).astype(int)
    order = np.lexsort((-response, octave))
    _, first, counts = np.unique(octave[order], return_index=True, return_counts=True)
    rank = np.arange(len(order)) - np.repeat(first, counts)
    return [keypoints[k] for k in order[rank < _PER_OCTAVE]]
