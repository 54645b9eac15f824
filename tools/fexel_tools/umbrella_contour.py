"""Contours of elements: traced to a fraction of a pixel, and simplified to few vertices.

Vertices are chosen among points of the traced curve so that the squared distance between curve and chords, integrated
along the curve, is least for their number: dynamic programming over all chords (Perez and Vidal, Optimum polygonal
approximation of digitized curves, 1994), each chord's error from prefix sums. They are then moved off the curve by
least squares, since a polygon inscribed in a round outline is too small.

Coordinates here have y upwards; contours run counter-clockwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from fexel_tools.pinchmap_contours import boundary_segments

__all__ = ["Polygon", "area", "is_simple", "simplify", "thinned", "trace"]

_MOST_CANDIDATES = 384
_THINNING_PX = 0.2
_LEAST_VERTICES = 3


@dataclass(frozen=True, eq=False)
class Polygon:
    """A simplified curve.

    Attributes
    ----------
    vertices : (K, 2) float64
    tolerance : float
        Largest distance from the curve to the polygon, in the curve's units.
    """

    vertices: NDArray[np.float64]
    tolerance: float


def trace(opacity: NDArray[np.float32]) -> NDArray[np.float64]:
    """Outline of the largest region where opacity is above a half of its maximum.

    Parameters
    ----------
    opacity : (H, W) float32
        0..1; what lies beyond counts as 0.

    Returns
    -------
    (N, 2) float64
        Pixels, x right, y UP from the lower edge; counter-clockwise, not closed. (0, 2) where nothing is opaque.
    """
    top = float(opacity.max()) if opacity.size else 0.0
    if top <= 0:
        return np.zeros((0, 2))
    field = np.pad(opacity, 1).astype(np.float32) - np.float32(0.5 * top)
    field[field == 0] = -1e-6 * top  # a crossing at a pixel's centre would belong to four squares
    ends = boundary_segments(field).ends
    outlines = _chained(ends)
    outline = max(outlines, key=lambda points: abs(area(points))) - 0.5
    outline[:, 1] = opacity.shape[0] - outline[:, 1]
    return np.ascontiguousarray(outline[::-1] if area(outline) < 0 else outline)


def area(polygon: NDArray[np.float64]) -> float:
    """Signed area, positive where counter-clockwise.

    Examples
    --------
    >>> area(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0]]))
    1.0
    """
    x, y = (polygon - polygon[:1]).T
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def _chained(ends: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Closed curves of pieces that share ends: each end is the crossing of one side of a square."""
    points = ends.reshape(-1, 2)
    whole = np.floor(points)
    keys = np.stack([whole[:, 0], whole[:, 1], (points == whole)[:, 1]], axis=1).astype(np.int64)
    _, first, node = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    cycles = _cycles(node.reshape(-1, 2), len(first))
    starts = np.flatnonzero(cycles[:, 1])
    return [points[first[part]] for part in np.split(cycles[:, 0], starts[1:])]


@numba.njit(cache=True, nogil=True)
def _cycles(pieces, count):
    """Nodes along the cycles that pieces form, each node being an end of two; 1 beside the first of a cycle."""
    links = np.full((count, 2), -1, np.int64)
    for piece in range(len(pieces)):
        for side in range(2):
            node, other = pieces[piece, side], pieces[piece, 1 - side]
            links[node, 0 if links[node, 0] < 0 else 1] = other
    seen = np.zeros(count, np.bool_)
    order = np.zeros((count, 2), np.int64)
    done = 0
    for start in range(count):
        if seen[start]:
            continue
        node, begins = start, 1
        while node >= 0 and not seen[node]:
            seen[node] = True
            order[done, 0], order[done, 1] = node, begins
            done, begins = done + 1, 0
            node = links[node, 0] if links[node, 0] >= 0 and not seen[links[node, 0]] else links[node, 1]
    return order[:done]


def thinned(curve: NDArray[np.float64], most: int = _MOST_CANDIDATES) -> NDArray[np.int64]:
    """Indices of at most so many points that keep the shape of a closed curve (Douglas and Peucker, 1973)."""
    distance = _THINNING_PX
    while True:
        kept = cv2.approxPolyDP(curve.astype(np.float32)[:, None], distance, True)[:, 0]
        if len(kept) <= most:
            break
        distance *= 1.5
    index = {point: number for number, point in enumerate(map(tuple, curve.astype(np.float32).tolist()))}
    return np.unique([index[tuple(point)] for point in kept.tolist()])


def simplify(curve: NDArray[np.float64], most_vertices: int, tolerance: float) -> Polygon:
    """Fewest vertices within a tolerance of a closed curve, or the best of so many.

    Parameters
    ----------
    curve : (N, 2) float64
        Closed, not self-intersecting, N >= 3.
    most_vertices : int
        At least 3.
    tolerance : float
        In units of the curve.
    """
    chosen = thinned(curve)
    far = int(np.argmax(np.square(curve[chosen] - curve.mean(axis=0)).sum(axis=1)))  # a tip is a vertex at any number
    curve = np.roll(curve, -int(chosen[far]), axis=0)
    chosen = np.sort((chosen - chosen[far]) % len(curve))
    most = min(most_vertices, len(chosen))
    if most < _LEAST_VERTICES:
        return Polygon(curve[:: max(len(curve) // 3, 1)][:3], tolerance)
    back = _best_chords(curve, np.append(chosen, len(curve)), most)
    low, high = _LEAST_VERTICES, most
    best = _fitted(curve, chosen, back, high)
    while low < high and best.tolerance <= tolerance:
        middle = (low + high) // 2
        fitted = _fitted(curve, chosen, back, middle)
        if fitted.tolerance <= tolerance:
            best, high = fitted, middle
        else:
            low = middle + 1
    return best


def _fitted(curve: NDArray[np.float64], chosen: NDArray[np.int64], back: NDArray[np.int32], count: int) -> Polygon:
    """The best polygon of so many vertices."""
    path, node = [], len(chosen)
    for step in range(count, 0, -1):
        node = int(back[step, node])
        path.append(node)
    starts = chosen[np.array(path[::-1])]
    on_curve = curve[starts]
    moved = _least_squares(curve, starts)
    polygons = [Polygon(v, _largest_distance(curve, starts, v)) for v in (moved, on_curve) if is_simple(v)]
    return min(polygons or [Polygon(on_curve, _largest_distance(curve, starts, on_curve))], key=lambda p: p.tolerance)


def _least_squares(curve: NDArray[np.float64], starts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Vertices of the polygon that is nearest to the curve, its points shared out between chords by length."""
    count = len(starts)
    steps = np.hypot(*np.diff(curve, axis=0, append=curve[:1]).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    segment = np.searchsorted(starts, np.arange(len(curve)), side="right") - 1
    length = np.diff(np.append(along[starts], along[-1]))
    part = (along[:-1] - along[starts][segment]) / np.maximum(length[segment], 1e-12)  # 1e-12 guards coincident points
    weight = 0.5 * (steps + np.roll(steps, 1))
    normal, right = np.zeros((count, count)), np.zeros((count, 2))
    ends = ((segment, 1 - part), ((segment + 1) % count, part))
    for row, row_part in ends:
        np.add.at(right, row, (weight * row_part)[:, None] * curve)
        for column, column_part in ends:
            np.add.at(normal, (row, column), weight * row_part * column_part)
    normal[np.diag_indices(count)] += 1e-9 * float(weight.sum())  # guards a chord without points
    right += 1e-9 * float(weight.sum()) * curve[starts]
    return np.linalg.solve(normal, right)


@numba.njit(cache=True, nogil=True)
def _best_chords(curve, nodes, most):
    """(most + 1, n + 1) predecessor of each node on the best way from node 0 with so many chords."""
    sums = _moments(curve)
    count = len(nodes) - 1
    cost = np.zeros((count + 1, count + 1))
    for i in range(count + 1):
        for j in range(i + 1, count + 1):
            cost[j, i] = _chord_error(curve, sums, nodes[i], nodes[j])
    back = np.zeros((most + 1, count + 1), np.int32)
    before = np.full(count + 1, np.inf)
    before[0] = 0.0
    for step in range(1, most + 1):
        after = np.full(count + 1, np.inf)
        for j in range(step, count + 1):
            for i in range(step - 1, j):
                error = before[i] + cost[j, i]
                if error < after[j]:
                    after[j] = error
                    back[step, j] = i
        before = after
    return back


@numba.njit(cache=True, nogil=True)
def _moments(curve):
    """(N + 1, 6) prefix sums of w, wx, wy, wxx, wxy, wyy; w is the length of curve that a point stands for."""
    count = len(curve)
    sums = np.zeros((count + 1, 6))
    for i in range(count):
        x, y = curve[i, 0] - curve[0, 0], curve[i, 1] - curve[0, 1]
        before, after = curve[i - 1], curve[(i + 1) % count]
        w = 0.5 * (
            np.hypot(curve[i, 0] - before[0], curve[i, 1] - before[1])
            + np.hypot(curve[i, 0] - after[0], curve[i, 1] - after[1])
        )
        sums[i + 1] = sums[i] + np.array([w, w * x, w * y, w * x * x, w * x * y, w * y * y])
    return sums


@numba.njit(cache=True, nogil=True)
def _chord_error(curve, sums, start, end):
    """Squared distance from the curve to the line through two of its points, integrated; to the point if they meet."""
    count = len(curve)
    ax, ay = curve[start, 0] - curve[0, 0], curve[start, 1] - curve[0, 1]
    bx, by = curve[end % count, 0] - curve[0, 0], curve[end % count, 1] - curve[0, 1]
    w, x, y, xx, xy, yy = sums[end] - sums[start]
    xx, xy, yy = xx - 2 * ax * x + ax * ax * w, xy - ax * y - ay * x + ax * ay * w, yy - 2 * ay * y + ay * ay * w
    dx, dy = bx - ax, by - ay
    squared = dx * dx + dy * dy
    if squared < 1e-18:
        return xx + yy
    return max((dy * dy * xx - 2 * dx * dy * xy + dx * dx * yy) / squared, 0.0)


@numba.njit(cache=True, nogil=True)
def _largest_distance(curve, starts, vertices):
    """From points of the curve to their chords, and from vertices to the curve's points."""
    largest, chord = 0.0, 0
    count = len(starts)
    for i in range(len(curve)):
        while chord + 1 < count and i >= starts[chord + 1]:
            chord += 1
        a, b = vertices[chord], vertices[(chord + 1) % count]
        largest = max(largest, _segment_distance(curve[i], a, b))
    for k in range(count):
        nearest = np.inf
        first, last = starts[k - 1] if k else starts[count - 1] - len(curve), starts[k] + 1
        last = starts[k + 1] if k + 1 < count else len(curve)
        for i in range(first, last):
            nearest = min(nearest, _segment_distance(vertices[k], curve[i], curve[(i + 1) % len(curve)]))
        largest = max(largest, nearest)
    return largest


@numba.njit(cache=True, nogil=True)
def _segment_distance(point, a, b):
    dx, dy = b[0] - a[0], b[1] - a[1]
    squared = dx * dx + dy * dy
    t = 0.0
    if squared > 0:
        t = min(max(((point[0] - a[0]) * dx + (point[1] - a[1]) * dy) / squared, 0.0), 1.0)
    return np.hypot(point[0] - a[0] - t * dx, point[1] - a[1] - t * dy)


@numba.njit(cache=True, nogil=True)
def is_simple(vertices):
    """Whether no two sides of a polygon (K, 2) cross or touch, but neighbours where they meet."""
    count = len(vertices)
    for i in range(count):
        a, b = vertices[i], vertices[(i + 1) % count]
        for j in range(i + 2, count - (i == 0)):
            c, d = vertices[j], vertices[(j + 1) % count]
            if _side(a, b, c) * _side(a, b, d) <= 0 and _side(c, d, a) * _side(c, d, b) <= 0:
                return False
    return True


@numba.njit(cache=True, nogil=True)
def _side(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
