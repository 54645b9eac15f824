"""Elements: leaves, berries, pebbles as they are cut from photographs, each with its opacity.

Arrays have row 0 at the top. Pixel coordinates are continuous, x right, y down, (0, 0) the outer corner of the first
pixel, as everywhere in the tools.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError
from fexel_tools.umbrella_cut import cut_out, rim_opacity
from fexel_tools.umbrella_ground import Ground, bare_square, find_ground, ground_color
from fexel_tools.umbrella_photo import Box, ElementPhoto, Preview, open_photo
from fexel_tools.umbrella_quality import Quality, segment_qualities
from fexel_tools.umbrella_segmentation import choose_segments, find_segments

__all__ = ["KINDS", "LEAST_QUALITY", "Element", "Elements", "find_elements"]

KINDS = ("auto", "cutout", "object", "many")
LEAST_QUALITY = 0.3
_PREVIEW_PIXELS = 1 << 20
_MOST_SIDE_PX = 2048  # of an element; a larger one is reduced while it is cut
_MARGIN_PX = 4
_LEAST_PATCH_PX = 64

_Cut = tuple[NDArray[np.float32], NDArray[np.float32], Box, int]


@dataclass(frozen=True, eq=False)
class Element:
    """One element, cut from its photo.

    Attributes
    ----------
    name : str
        Unique within the photo: the file's stem, then a number where the photo holds several.
    path : Path
        The photo.
    color : (H, W, 3) float32
        Linear Rec.709, straight alpha, continued past the element; stored values where `is_data`. Finite.
    opacity : (H, W) float32
        0..1; at least one pixel of 0 on every side but where the photo ends.
    is_data : bool
        Stored values (normal map, roughness), not colours.
    quality : float
        In [0, 1]: how sure one can be that this is one whole element, see `umbrella_quality`.
    box : (int, int, int, int)
        Left, top, right, bottom in pixels of the upright photo: where `color` was cut; right and bottom exclusive.
    scale_px : float
        Pixels of the photo in one unit of patch space: the longer side of the photo's largest element.
    pixel : int
        Pixels of the photo on a side of one of `color`: 1, or a power of two where the element is very large.
    photo_size : (int, int)
        Width and height of the upright photo.
    """

    name: str
    path: Path
    color: NDArray[np.float32]
    opacity: NDArray[np.float32]
    is_data: bool
    quality: float
    box: Box
    scale_px: float
    pixel: int = 1
    photo_size: tuple[int, int] = (1, 1)


@dataclass(frozen=True, eq=False)
class Elements:
    """What a photo holds.

    Attributes
    ----------
    path : Path
    kind : str
        How it was read: ``cutout``, ``object`` or ``many``.
    size : (int, int)
        Width and height of the upright photo.
    elements : tuple of Element
        In reading order: rows from the top, each from the left.
    ground : (3,) float32 or None
        Mean colour of the ground, as `Element.color`; None where alpha takes its place.
    ground_patch : (H, W, 3) float32 or None
        The largest square of ground alone, where it is worth a picture.
    dropped : tuple of ((int, int, int, int), str)
        Box and reason of what was found but is no whole element.
    reason : str
        Why there are no elements; '' where there are.
    """

    path: Path
    kind: str
    size: tuple[int, int]
    elements: tuple[Element, ...]
    ground: NDArray[np.float32] | None = None
    ground_patch: NDArray[np.float32] | None = None
    dropped: tuple[tuple[Box, str], ...] = ()
    reason: str = ""


def find_elements(
    path: str | Path, *, kind: str = "auto", is_data: bool = False, least_quality: float = LEAST_QUALITY
) -> Elements:
    """Cut the elements out of a photo.

    Parameters
    ----------
    path : str or Path
        Any format that OpenImageIO reads.
    kind : str
        ``cutout``: alpha tells what is an element, each island of it is one. ``object``: the largest one on a plain
        ground. ``many``: all of them, touching ones told apart. ``auto``: by what the photo shows.
    is_data : bool
        Values are data: taken as stored.
    least_quality : float
        Of elements of a photo of many; others are dropped.

    Returns
    -------
    Elements
        None, and why, where the photo shows no element.

    Raises
    ------
    FexelError
        The file is missing, damaged, no image, or in CMYK; an unknown kind; a cut-out without alpha.
    """
    if kind not in KINDS:
        raise FexelError(f"{path}: kind '{kind}' is unknown, expected one of {', '.join(KINDS)}")
    source = open_photo(path, is_data=is_data)
    preview = source.preview(_PREVIEW_PIXELS)
    alpha = preview.alpha if preview.alpha is not None and _tells(preview.alpha) else None
    if kind == "cutout" and preview.alpha is None:
        raise FexelError(f"{path}: has no alpha, expected a cut-out; --kind object or many finds what is on a ground")
    if preview.alpha is not None and not preview.alpha.any():
        return Elements(source.path, kind, source.size, (), reason="it is transparent throughout")
    ground = None if alpha is not None or kind == "cutout" else find_ground(preview.lab)
    segments = find_segments(preview, ground, kind)
    if isinstance(segments, str):
        return _with_ground(
            Elements(source.path, kind, source.size, (), reason=segments), source, preview, ground, None
        )
    found_kind, labels = segments
    far = np.where(labels > 0, np.float32(100), np.float32(0)) if ground is None else ground.distance
    noise = 0.0 if ground is None else ground.noise
    qualities = segment_qualities(labels, far, noise=noise, factor=preview.factor)
    kept, dropped = choose_segments(found_kind, qualities, least_quality)
    cuts = [_cut(source, preview, labels, number + 1, qualities[number], ground is not None) for number in kept]
    elements = _named(source, cuts, [qualities[number] for number in kept])
    boxes = tuple((_photo_box(qualities[number].box, preview.factor, source.size), why) for number, why in dropped)
    reason = "" if elements else "; ".join(sorted({why for _, why in dropped})) or "nothing was found"
    found = Elements(source.path, found_kind, source.size, elements, dropped=boxes, reason=reason)
    return _with_ground(found, source, preview, ground, labels)


def _tells(alpha: NDArray[np.float32]) -> bool:
    """Whether alpha tells elements from what is not: neither constant nor a stray pixel."""
    top = float(alpha.max())
    return top > 0 and np.count_nonzero(alpha < 0.5 * top) >= max(1e-3 * alpha.size, 1)


def _photo_box(box: Box, factor: int, size: tuple[int, int], margin: int = 0) -> Box:
    """A box of the preview in pixels of the photo."""
    left, top = (max(box[axis] - margin, 0) * factor for axis in (0, 1))
    right, bottom = (min((box[axis + 2] + margin) * factor, size[axis]) for axis in (0, 1))
    return left, top, right, bottom


def _cut(
    source: ElementPhoto, preview: Preview, labels: NDArray[np.int32], number: int, quality: Quality, on_ground: bool
) -> _Cut:
    """Colour, opacity, box and pixel of a segment."""
    margin = _MARGIN_PX
    box = _photo_box(quality.box, preview.factor, source.size, margin)
    pixel = 1
    while max(box[2] - box[0], box[3] - box[1]) > _MOST_SIDE_PX * pixel and pixel < preview.factor:
        pixel *= 2
    color, alpha = source.window(box, pixel)
    left, top, right, bottom = quality.box
    window = labels[max(top - margin, 0) : bottom + margin, max(left - margin, 0) : right + margin]
    own, other, factor = window == number, (window > 0) & (window != number), preview.factor // pixel
    if on_ground:
        opacity = rim_opacity(color, own, other, factor)
    else:
        assert alpha is not None
        opacity = np.where(_nearest(own, other, factor)[: alpha.shape[0], : alpha.shape[1]], alpha, np.float32(0))
    return cut_out(color, opacity), opacity, box, pixel


def _nearest(own: NDArray[np.bool_], other: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """Pixels nearer to the element than to any other."""
    if other.any():
        to_own, to_other = (
            cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for mask in (own, other)
        )
        own = to_own < to_other
    else:
        own = np.ones_like(own)
    return np.repeat(np.repeat(own, factor, axis=0), factor, axis=1)


def _named(
    source: ElementPhoto,
    cuts: list[tuple[NDArray[np.float32], NDArray[np.float32], Box, int]],
    qualities: list[Quality],
) -> tuple[Element, ...]:
    scale = max((_longer_side(opacity) * pixel for _, opacity, _, pixel in cuts), default=1.0)
    stem, digits = source.path.stem, len(str(len(cuts)))
    return tuple(
        Element(
            name=stem if len(cuts) == 1 else f"{stem}_{index + 1:0{digits}}",
            path=source.path,
            color=color,
            opacity=opacity,
            is_data=source.is_data,
            quality=quality.value,
            box=box,
            scale_px=scale,
            pixel=pixel,
            photo_size=source.size,
        )
        for index, ((color, opacity, box, pixel), quality) in enumerate(zip(cuts, qualities, strict=True))
    )


def _longer_side(opacity: NDArray[np.float32]) -> float:
    _, _, width, height = cv2.boundingRect((opacity >= 0.5 * opacity.max()).astype(np.uint8))
    return float(max(width, height, 1))


def _with_ground(
    found: Elements, source: ElementPhoto, preview: Preview, ground: Ground | None, labels: NDArray[np.int32] | None
) -> Elements:
    """What the photo shows of its ground besides."""
    if ground is None:
        return found
    bare = ground.distance < ground.threshold
    if labels is not None:
        bare &= cv2.dilate((labels > 0).astype(np.uint8), np.ones((5, 5), np.uint8)) == 0
    square = bare_square(preview.lab, bare, max(_LEAST_PATCH_PX // preview.factor, 8))
    patch = None if square is None else source.window(_photo_box(square, preview.factor, source.size))[0]
    return replace(found, ground=ground_color(preview.color, bare), ground_patch=patch)
