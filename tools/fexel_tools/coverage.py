"""What each photo adds: its part inside the root where it is sharper than all that is drawn below it.

Photos are taken from coarse to fine. Each is cropped, in its own pixel grid, to the largest rectangle inside the root
and then to the part in which it has at least `MIN_GAIN` times the resolution of every patch before it, plus a margin
for blending. A photo with no such part adds nothing and is rejected.

Draw order is depth first, parents before children, siblings in order. So that no coarse patch ever hides a finer one,
a new patch hangs, as the last child, under the patch that was drawn last among those it overlaps, or under one of that
patch's ancestors: the deepest that holds the new patch whole (or nearly so).

Conventions: continuous pixel coordinates (x right, y down), 3x3 float64 for column vectors, `density`: pixels of one
photo per pixel of another, the square root of the area ratio.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fexel_tools.consistency import apply_homography
from fexel_tools.poisson import good_size

__all__ = [
    "MIN_GAIN",
    "Addition",
    "Placement",
    "clip_convex",
    "density",
    "inscribed_rectangle",
    "plan_patches",
    "polygon_area",
    "rectangle",
]

MIN_GAIN = 1.2  # below this the gain is not worth a patch: one sixth more detail along each axis
_MIN_SHARE = 0.02  # of a photo's pixels; a sliver is not worth a patch either
_MIN_PATCH_PX = 16
_MARGIN = 0.12  # of the part that is new, on each side, for the blend
_INSIDE = 0.98  # a patch this much inside another may hang under it
_LONG_PX = 1500  # beyond, a few rows are given up for a size that the Poisson solver is fast at
_GRID = 64


@dataclass(frozen=True)
class Placement:
    """A photo with its pose.

    Attributes
    ----------
    photo : int
        Photo number.
    size : (width, height)
        Pixels.
    root_from_photo : (3, 3) float64
    """

    photo: int
    size: tuple[int, int]
    root_from_photo: np.ndarray


@dataclass(frozen=True)
class Addition:
    """A photo's part that becomes a patch, or why none does.

    Attributes
    ----------
    photo : int
    window : (x0, y0, x1, y1) of int, or None
        Pixels of the photo.
    parent : int or None
        Photo number of the patch above it in the nest; the root's number for a patch right under the root.
    scale : float
        Pixels of the photo per pixel of the root, at the centre of `window`.
    reason : str
        Why it adds nothing; empty when it does.
    below : int or None
        The patch that already has its detail, where that is the reason.
    """

    photo: int
    window: tuple[int, int, int, int] | None
    parent: int | None
    scale: float
    reason: str = ""
    below: int | None = None


def density(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(N,) target pixels per source pixel at `points`: sqrt(|det J|) of the homography; 0 where w <= 0."""
    w = points @ matrix[2, :2] + matrix[2, 2]
    safe = np.where(w > 0.0, w, 1.0)
    return np.where(w > 0.0, np.sqrt(abs(np.linalg.det(matrix)) / safe**3), 0.0)


def rectangle(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    """(4, 2) corners, in order around the rectangle."""
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], np.float64)


def clip_convex(polygon: np.ndarray, clip: np.ndarray) -> np.ndarray:
    """Part of a convex polygon inside another: (N, 2), N = 0 when they do not meet (Sutherland and Hodgman 1974)."""
    clip = clip if _signed_area(clip) > 0.0 else clip[::-1]
    for a, b in zip(clip, np.roll(clip, -1, axis=0), strict=True):
        if not len(polygon):
            break
        edge = b - a
        side = edge[0] * (polygon[:, 1] - a[1]) - edge[1] * (polygon[:, 0] - a[0])
        kept = []
        for k in range(len(polygon)):
            p, q, sp, sq = polygon[k], polygon[(k + 1) % len(polygon)], side[k], side[(k + 1) % len(polygon)]
            if sp >= 0.0:
                kept.append(p)
            if (sp > 0.0 > sq) or (sp < 0.0 < sq):
                kept.append(p + (q - p) * (sp / (sp - sq)))
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def polygon_area(polygon: np.ndarray) -> float:
    """Area of a simple polygon (N, 2); 0 for fewer than three corners."""
    return abs(_signed_area(polygon)) if len(polygon) >= 3 else 0.0


def _signed_area(polygon: np.ndarray) -> float:
    """Positive when the corners turn from x to y."""
    x, y = polygon[:, 0], polygon[:, 1]
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def inscribed_rectangle(polygon: np.ndarray, samples: int = 192) -> tuple[float, float, float, float] | None:
    """Largest axis-aligned rectangle inside a convex polygon, to 1/`samples` of its width; None for an empty one.

    The upper boundary is convex and the lower one concave, so over any span the free height is decided at its two ends.
    """
    if len(polygon) < 3:
        return None
    x = np.linspace(polygon[:, 0].min(), polygon[:, 0].max(), samples)
    top, bottom = _extent(polygon, x)
    height = np.minimum(bottom[:, None], bottom[None, :]) - np.maximum(top[:, None], top[None, :])
    area = np.maximum(height, 0.0) * np.maximum(x[None, :] - x[:, None], 0.0)
    i, j = np.unravel_index(int(np.argmax(area)), area.shape)
    if area[i, j] <= 0.0:
        return None
    return float(x[i]), float(max(top[i], top[j])), float(x[j]), float(min(bottom[i], bottom[j]))


def plan_patches(root: Placement, photos: list[Placement], min_gain: float = MIN_GAIN) -> list[Addition]:
    """Decide for every photo what it adds, in draw order from coarse to fine.

    Parameters
    ----------
    root : Placement
    photos : list of Placement
        Without the root.
    min_gain : float
        Least ratio of resolutions that makes a patch worth while.

    Returns
    -------
    list of Addition
        One per photo; those that are patches come in an order in which parents precede children and nothing coarse
        follows what it would hide.
    """
    inside = [(_part_in_root(root, photo), photo) for photo in photos]
    inside.sort(key=lambda item: item[0][1])
    nest = _Nest(root)
    return [nest.add(photo, rect, scale, min_gain) for (rect, scale), photo in inside]


def _part_in_root(root: Placement, photo: Placement) -> tuple[tuple[float, float, float, float] | None, float]:
    """Rectangle of the photo inside the root and the photo's resolution over the root's there."""
    width, height = photo.size
    outline = apply_homography(photo.root_from_photo, rectangle(0, 0, width, height))
    if not np.isfinite(outline).all():
        return None, 0.0
    polygon = clip_convex(outline, rectangle(0, 0, *root.size))
    if len(polygon) < 3:
        return None, 0.0
    photo_from_root = np.linalg.inv(photo.root_from_photo)
    photo_from_root = photo_from_root / (photo_from_root[2] @ [*polygon.mean(axis=0), 1.0])
    rect = inscribed_rectangle(np.clip(apply_homography(photo_from_root, polygon), 0.0, [width, height]))
    return rect, float(density(photo_from_root, polygon.mean(axis=0)[None])[0])


class _Nest:
    """The patches placed so far, in draw order, each with its outline in the root."""

    def __init__(self, root: Placement) -> None:
        self._root = root
        self._placed = {root.photo: root}
        self._windows = {root.photo: (0, 0, *root.size)}
        self._outline = {root.photo: rectangle(0, 0, *root.size)}
        self._children: dict[int, list[int]] = {root.photo: []}
        self._parent: dict[int, int | None] = {root.photo: None}

    def add(
        self, photo: Placement, rect: tuple[float, float, float, float] | None, scale: float, min_gain: float
    ) -> Addition:
        nothing = Addition(photo.photo, None, None, scale)
        if rect is None:
            return replace(nothing, reason="lies outside the root")
        window = _whole(rect)
        if min(window[2] - window[0], window[3] - window[1]) < _MIN_PATCH_PX:
            return replace(nothing, reason="lies outside the root but for a sliver")
        gain, below = self._gain(photo, window)
        new = gain >= min_gain
        if np.count_nonzero(new) < max(1.0, _MIN_SHARE * new.size):
            best = float(np.percentile(gain, 98.0))
            return replace(nothing, reason=f"adds nothing: {best:.2f} times the resolution already there", below=below)
        window = _crop_to_new(window, new)
        if min(window[2] - window[0], window[3] - window[1]) < _MIN_PATCH_PX:
            return replace(nothing, reason="adds nothing but a sliver")
        return self._hang(photo, window)

    def _gain(self, photo: Placement, window: tuple[int, int, int, int]) -> tuple[np.ndarray, int]:
        """(grid, grid) resolution over the best below, and the photo below that has most of the detail."""
        x0, y0, x1, y1 = window
        axis = (np.arange(_GRID) + 0.5) / _GRID
        grid = np.stack(np.meshgrid(x0 + axis * (x1 - x0), y0 + axis * (y1 - y0)), axis=-1).reshape(-1, 2)
        best, owner = np.zeros(len(grid)), np.full(len(grid), self._root.photo)
        for other, placed in self._placed.items():
            matrix = np.linalg.solve(placed.root_from_photo, photo.root_from_photo)
            matrix = matrix / (matrix[2] @ [*grid.mean(axis=0), 1.0])
            target = apply_homography(matrix, grid)
            a0, b0, a1, b1 = self._windows[other]
            with np.errstate(invalid="ignore"):
                within = ((target >= (a0, b0)) & (target <= (a1, b1))).all(axis=1)
            there = np.where(within, density(matrix, grid), 0.0)
            owner = np.where(there > best, other, owner)
            best = np.maximum(best, there)
        gain = 1.0 / np.maximum(best, 1e-12)  # guards a point that falls outside the root by rounding
        values, counts = np.unique(owner, return_counts=True)
        return gain.reshape(_GRID, _GRID), int(values[np.argmax(counts)])

    def _hang(self, photo: Placement, window: tuple[int, int, int, int]) -> Addition:
        outline = apply_homography(photo.root_from_photo, rectangle(*window))
        parent = self._last_overlapping(outline)
        while self._parent[parent] is not None and self._share_inside(outline, parent) < _INSIDE:
            parent = self._parent[parent]
        number = photo.photo
        self._placed[number], self._windows[number], self._outline[number] = photo, window, outline
        self._children[number], self._parent[number] = [], parent
        self._children[parent].append(number)
        photo_from_root = np.linalg.inv(photo.root_from_photo)
        centre = outline.mean(axis=0)
        photo_from_root = photo_from_root / (photo_from_root[2] @ [*centre, 1.0])
        return Addition(number, window, parent, float(density(photo_from_root, centre[None])[0]))

    def _last_overlapping(self, outline: np.ndarray) -> int:
        last = self._root.photo
        for number in self._draw_order(self._root.photo):
            if self._share_inside(outline, number) > 0.0:
                last = number
        return last

    def _draw_order(self, number: int) -> list[int]:
        order, open_numbers = [], [number]
        while open_numbers:
            current = open_numbers.pop()
            order.append(current)
            open_numbers += reversed(self._children[current])
        return order

    def _share_inside(self, outline: np.ndarray, other: int) -> float:
        return polygon_area(clip_convex(outline, self._outline[other])) / polygon_area(outline)


def _extent(polygon: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest y of a convex polygon at each x within its span."""
    low, high = np.full(len(x), np.inf), np.full(len(x), -np.inf)
    slack = 1e-7 * (x[-1] - x[0])  # an upright edge is not quite upright after a round trip through the root
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        first, second = (a, b) if a[0] <= b[0] else (b, a)
        over = (x >= first[0] - slack) & (x <= second[0] + slack)
        span = second[0] - first[0]
        for share in (0.0, 1.0) if span == 0.0 else (None,):
            t = share if share is not None else np.clip((x - first[0]) / span, 0.0, 1.0)
            y = first[1] + t * (second[1] - first[1])
            low = np.where(over, np.minimum(low, y), low)
            high = np.where(over, np.maximum(high, y), high)
    return low, high


def _whole(rect: tuple[float, float, float, float]) -> tuple[int, int, int, int]:
    """Whole pixels inside the rectangle; the tolerance keeps a full photo full after a round trip through the root."""
    x0, y0, x1, y1 = rect
    return int(np.ceil(x0 - 1e-3)), int(np.ceil(y0 - 1e-3)), int(np.floor(x1 + 1e-3)), int(np.floor(y1 + 1e-3))


def _crop_to_new(window: tuple[int, int, int, int], new: np.ndarray) -> tuple[int, int, int, int]:
    """Bounds of the cells that are new, plus the margin, within the window, at sizes the Poisson solver likes."""
    x0, x1 = _crop_axis(window[0], window[2], new.any(axis=0))
    y0, y1 = _crop_axis(window[1], window[3], new.any(axis=1))
    return x0, y0, x1, y1


def _crop_axis(start: int, stop: int, new: np.ndarray) -> tuple[int, int]:
    cells = np.flatnonzero(new)
    pixels_per_cell = (stop - start) / len(new)
    first, last = cells[0] * pixels_per_cell, (cells[-1] + 1) * pixels_per_cell
    margin = _MARGIN * (last - first)
    low = start + int(np.floor(max(0.0, first - margin)))
    high = start + int(np.ceil(min(float(stop - start), last + margin)))
    spare = (high - low) - good_size(high - low) if high - low > _LONG_PX else 0
    return low + spare // 2, high - (spare - spare // 2)
