"""Synthetic ground truth for registration: windows of real photos at a known zoom, tilt and exposure.

The parent is the whole photo, reduced by area averaging. The child is a window of it, seen by a camera that is rotated,
tilted, closer by `scale`, differently exposed and white-balanced, blurred, noisy and JPEG-compressed, warped in linear
light from the photo's full resolution with supersampling. Matrices map continuous pixel coordinates ((0,0) is the outer
corner of the first pixel) of the child to the parent's.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from fexel.images import image_info, read_pixels

__all__ = ["PHOTOS", "Case", "corner_error", "load_photo", "make_case", "make_chain"]

# Real photos that are large or sharp enough, relative to the shared data folder.
PHOTOS = (
    "hires/petra_facade_6mp.jpg",
    "hires/stream_rocks_6mp.jpg",
    "hires/dandelions_16mp.jpg",
    "hires/wood_4mp.jpg",
    "zoom/berlin_facade/01.jpg",
    "hires/bruegel_harvesters_1165x859.jpg",
    "hires/holbein_ambassadors_1039x1024.png",
)
MAX_TILT_DEGREES = 20.0
NOISE = 1.5 / 255  # typical noise of the parent, encoded; a window must show twice as much detail


@dataclass(frozen=True)
class Case:
    """A pair with its true homography.

    Attributes
    ----------
    parent, child : (H, W, 3) uint8
        sRGB-like encoded RGB.
    matrix : (3, 3) float64
        Child to parent, continuous pixel coordinates, column vectors.
    scale : float
        Child texels per parent texel at the child's centre.
    """

    name: str
    parent: np.ndarray
    child: np.ndarray
    matrix: np.ndarray
    scale: float


def load_photo(path: Path) -> np.ndarray:
    """Read a photo as linear RGB, (H, W, 3) float32 in [0, 1]."""
    info = image_info(str(path))
    pixels = read_pixels(info)
    rgb = np.repeat(pixels, 3, axis=2) if pixels.shape[2] < 3 else pixels[:, :, :3]
    return (rgb.astype(np.float32) / np.iinfo(pixels.dtype).max) ** 2.2


def corner_error(estimate: np.ndarray, truth: np.ndarray, width: int, height: int) -> float:
    """Largest distance of the four mapped corners, in parent texels."""
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float64)
    return float(np.linalg.norm(_apply(estimate, corners) - _apply(truth, corners), axis=1).max())


def make_case(
    name: str,
    photo: np.ndarray,
    scale: float,
    rng: np.random.Generator,
    width: int = 1024,
    max_tilt: float = MAX_TILT_DEGREES,
) -> Case | None:
    """Cut a random, textured window; None when the photo has none of that scale."""
    parent_linear = _reduced(photo, width)
    parent = _photograph(
        parent_linear, rng, gain=np.ones(3), gamma=2.2, blur=0.0, noise=rng.uniform(0.5, 2), quality=93
    )
    height = round(width * 3 / 4)
    grey = (parent_linear ** (1 / 2.2)).mean(axis=2)
    detail = (grey - cv2.GaussianBlur(grey, (0, 0), 2.5)) ** 2
    for _ in range(300):
        matrix = _random_placement(scale, rng, (width, height), parent.shape, max_tilt)
        if matrix is not None and _detail_inside(detail, matrix, width, height) > 2 * NOISE:
            child = _child(photo, parent_linear.shape, matrix, (width, height), rng)
            return Case(name, parent, child, matrix, scale)
    return None


def make_chain(
    name: str, photo: np.ndarray, scales: tuple[float, ...], rng: np.random.Generator, width: int = 1024
) -> list[Case]:
    """Ever closer photos about one point; case k pairs photo k+1 with photo k, `scales` are relative to the first."""
    last = None
    for _ in range(20):
        last = make_case(name, photo, scales[-1], rng, width)
        if last is not None:
            break
    if last is None:
        return []
    height = round(width * 3 / 4)
    target = _apply(last.matrix, np.array([[width / 2, height / 2]]))[0]
    photos, matrices = [last.parent], [np.eye(3)]
    for scale in scales[:-1]:
        matrix = None
        for _ in range(1000):
            matrix = _random_placement(scale, rng, (width, height), last.parent.shape, MAX_TILT_DEGREES, target)
            if matrix is not None and _inside(last.matrix, matrix, width, height):
                break
            matrix = None
        if matrix is None:
            return []
        photos.append(_child(photo, last.parent.shape, matrix, (width, height), rng))
        matrices.append(matrix)
    photos.append(last.child)
    matrices.append(last.matrix)
    ratios = np.array(scales) / np.array((1.0, *scales[:-1]))
    return [
        Case(name, photos[k], photos[k + 1], np.linalg.inv(matrices[k]) @ matrices[k + 1], float(ratios[k]))
        for k in range(len(scales))
    ]


def _apply(matrix, points):
    homogeneous = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    return homogeneous[:, :2] / homogeneous[:, 2:]


def _reduced(photo, width):
    height = round(photo.shape[0] * width / photo.shape[1])
    return cv2.resize(photo, (width, height), interpolation=cv2.INTER_AREA)


def _random_placement(scale, rng, size, parent_shape, max_tilt, target=None):
    """A child-to-parent homography whose window lies inside the parent, or None for an unlucky draw."""
    width, height = size
    focal = 1.2 * width
    tilt, azimuth, roll = np.radians([rng.uniform(0, max_tilt), rng.uniform(0, 360), rng.uniform(-180, 180)])
    axis = np.array([np.cos(azimuth), np.sin(azimuth), 0.0]) * tilt
    ray_from_pixel = np.diag([1 / focal, 1 / focal, 1.0]) @ _translation(-width / 2, -height / 2)
    plane_from_pixel = cv2.Rodrigues(axis)[0] @ ray_from_pixel
    centre = _apply(plane_from_pixel, np.array([[width / 2, height / 2]]))[0]
    cos, sin = np.cos(roll) * focal / scale, np.sin(roll) * focal / scale
    centred = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) @ _translation(*-centre) @ plane_from_pixel
    if target is None:
        place = rng.uniform([0, 0], [parent_shape[1], parent_shape[0]])
    else:
        place = target + rng.uniform(-0.25, 0.25, 2) * width / scale
    matrix = _translation(*place) @ centred
    matrix /= matrix[2, 2]
    corners = _apply(matrix, np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float64))
    if corners.min() < 1 or (corners > np.array([parent_shape[1], parent_shape[0]]) - 1).any():
        return None
    return matrix


def _inside(inner, outer, width, height):
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float64)
    mapped = _apply(np.linalg.inv(outer) @ inner, corners)
    return mapped.min() > 1 and (mapped < np.array([width, height]) - 1).all()


def _translation(x, y):
    return np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])


def _detail_inside(detail, matrix, width, height):
    corners = _apply(matrix, np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float64))
    mask = np.zeros(detail.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.round(corners).astype(np.int32), 1)
    return float(np.sqrt(detail[mask > 0].mean()))


def _child(photo, parent_shape, matrix, size, rng):
    """Warp the child from the full resolution, supersampled, then photograph it."""
    width, height = size
    to_photo = np.diag([photo.shape[1] / parent_shape[1], photo.shape[0] / parent_shape[0], 1.0]) @ matrix
    step = np.sqrt(abs(np.linalg.det(to_photo[:2, :2])))
    factor = int(np.clip(np.ceil(step * 1.5), 1, 4))
    fine = to_photo @ np.diag([1 / factor, 1 / factor, 1.0])
    centres = _translation(-0.5, -0.5) @ fine @ _translation(0.5, 0.5)
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    linear = cv2.warpPerspective(
        photo, centres, (width * factor, height * factor), flags=flags, borderMode=cv2.BORDER_REPLICATE
    )
    linear = cv2.resize(np.clip(linear, 0, 1), size, interpolation=cv2.INTER_AREA)
    gain = 2 ** rng.uniform(-0.7, 0.7) * rng.uniform(0.88, 1.14, 3)
    quality = int(rng.integers(70, 96))
    return _photograph(linear, rng, gain, rng.uniform(1.8, 2.6), rng.uniform(0, 1.5), rng.uniform(0.5, 3), quality)


def _photograph(linear, rng, gain, gamma, blur, noise, quality):
    """Expose, encode, blur, add noise (in 1/255), compress."""
    encoded = np.clip(linear * gain.astype(np.float32), 0, 1) ** (1 / gamma)
    if blur > 0.2:
        encoded = cv2.GaussianBlur(encoded, (0, 0), blur)
    noisy = encoded * 255 + rng.normal(0, noise, encoded.shape)
    bgr = cv2.cvtColor(np.clip(np.round(noisy), 0, 255).astype(np.uint8), cv2.COLOR_RGB2BGR)
    return cv2.cvtColor(
        cv2.imdecode(cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR),
        cv2.COLOR_BGR2RGB,
    )
