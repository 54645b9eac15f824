"""Which pixels of a photo are elements: what kind of photo it is, a segment per element, and which segments to keep."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fexel_tools.umbrella_ground import Ground
from fexel_tools.umbrella_holes import ground_shown, with_notches
from fexel_tools.umbrella_photo import Box, Preview
from fexel_tools.umbrella_quality import Quality
from fexel_tools.umbrella_remains import returned_parts, without_shadows
from fexel_tools.umbrella_segments import (
    components,
    fill_holes,
    fill_secluded,
    largest_parts,
    numbered,
    split_touching,
    trim_contacts,
    without_specks,
)

__all__ = ["choose_segments", "find_segments"]

_SPECK = 1e-4  # of the photo's area: less is noise
_LEAST_SPECK_PX = 9
_MINOR = 0.1  # of the largest segment's area: a segment that counts when deciding whether a photo shows many
_HOLE = 0.05  # of an element's area: a larger hole stays one, unless it lies deep inside
_CROWD = 6  # parts of what hangs together, from which on they are elements of their own rather than lobes
_CUT_CROWD = 4  # the same of what reaches three sides of the photo
_FULL = 0.98  # of the photo: elements that cover more leave no ground to tell them by
_ISLAND = 0.01  # of the largest: a smaller island of alpha is a speck


def find_segments(preview: Preview, ground: Ground | None, kind: str) -> tuple[str, NDArray[np.int32]] | str:
    """What the photo turned out to be, and a label per element; or why there is none."""
    if ground is None:
        assert preview.alpha is not None
        mask = preview.alpha >= 0.5 * float(np.percentile(preview.alpha[preview.alpha > 0], 95))
    else:
        mask = ground.distance > ground.threshold
    least = max(_SPECK * mask.size, min(_LEAST_SPECK_PX, 0.1 * np.count_nonzero(mask)))
    mask = without_specks(mask, least)
    if not mask.any():
        return "nothing differs from its ground"
    if ground is not None and mask.mean() > _FULL:
        return "no plain ground was found around its elements"
    filled = mask if ground is None else fill_secluded(mask)
    labels = components(filled)
    if kind == "auto":
        kind = "cutout" if ground is None else _kind_of(labels)
    if kind == "many":
        labels = split_touching(labels)
    if ground is not None:
        labels = largest_parts(labels, with_notches(filled, ground))
    if kind == "many":
        if ground is not None:
            labels = without_shadows(returned_parts(labels, preview.lab), preview.lab, ground.distance)
        trimmed = trim_contacts(labels)
        labels = largest_parts(trimmed, trimmed > 0)
    if ground is not None:
        labels = np.where(ground_shown(mask, ground), 0, fill_holes(labels, _HOLE))
    return kind, numbered(labels)


def _kind_of(labels: NDArray[np.int32]) -> str:
    """``many`` where several segments are large, or the only one falls into a crowd."""
    areas = np.bincount(labels.ravel())[1:]
    if np.count_nonzero(areas >= _MINOR * areas.max()) > 1:
        return "many"
    largest = labels == 1 + int(np.argmax(areas))
    sides = sum(bool(side.any()) for side in (largest[0], largest[-1], largest[:, 0], largest[:, -1]))
    parts = np.bincount(split_touching(components(largest)).ravel())[1:]
    crowd = _CUT_CROWD if sides >= 3 else _CROWD
    return "many" if np.count_nonzero(parts >= _MINOR * parts.max()) >= crowd else "object"


def choose_segments(
    kind: str, qualities: list[Quality], least_quality: float
) -> tuple[list[int], list[tuple[int, str]]]:
    """Indices of segments to cut, in reading order, and of those to drop, with reasons."""
    largest = max(range(len(qualities)), key=lambda number: qualities[number].area)
    reasons = {}
    for number, quality in enumerate(qualities):
        if kind == "object" and number != largest:
            reasons[number] = "not the largest of its photo"
        elif kind == "cutout" and quality.area < _ISLAND * qualities[largest].area:
            reasons[number] = "a speck"
        elif kind == "many" and quality.value < least_quality:
            reasons[number] = quality.reason
    kept = [number for number in range(len(qualities)) if number not in reasons]
    heights = [qualities[number].box[3] - qualities[number].box[1] for number in kept]
    row = max(float(np.median(heights)) if heights else 1.0, 1.0)
    kept.sort(key=lambda number: (_middle(qualities[number].box, 1) // row, _middle(qualities[number].box, 0)))
    return kept, list(reasons.items())


def _middle(box: Box, axis: int) -> float:
    return 0.5 * (box[axis] + box[axis + 2])
