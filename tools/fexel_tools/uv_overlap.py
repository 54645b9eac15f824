"""Triangles of one chart that cover each other in texture space, exactly, through a grid of cells.

xatlas now and then lets a chart fold over its own rim. Pairs whose bounding boxes share a cell are tested by the
separating axis theorem: two triangles overlap unless an edge of one has the other wholly on its far side.
"""

from __future__ import annotations

import numpy as np

__all__ = ["covering_faces", "overlapping_pairs"]

_TOUCH = 1e-6  # st; rims that share an edge meet within float32 rounding, about 1e-7


def overlapping_pairs(st: np.ndarray, chart: np.ndarray) -> np.ndarray:
    """Pairs of triangles of the same chart whose interiors overlap.

    Parameters
    ----------
    st : (T, 3, 2) float64
        Of triangles, in [0, 1].
    chart : (T,) int

    Returns
    -------
    (K, 2) int64
        Each pair once, the lower index first.
    """
    pairs = _candidates(st, chart)
    a, b = st[pairs[:, 0]], st[pairs[:, 1]]
    apart = _far_side(a, b) | _far_side(b, a)
    return pairs[~apart]


def covering_faces(pairs: np.ndarray) -> set[int]:
    """Faces that, taken away, leave no pair: greedily, the one in most pairs first."""
    left = {(int(a), int(b)) for a, b in pairs if a != b}
    chosen: set[int] = set()
    while left:
        faces, counts = np.unique(np.array(list(left)), return_counts=True)
        face = int(faces[np.argmax(counts)])
        chosen.add(face)
        left = {pair for pair in left if face not in pair}
    return chosen


def _far_side(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(K,) bool: some edge of a[k] has all of b[k] on its outer side, up to `_TOUCH`."""
    edges = np.roll(a, -1, axis=1) - a
    turn = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]
    length = np.linalg.norm(edges, axis=-1)
    offset = b[:, None] - a[:, :, None]
    inward = edges[:, :, None, 0] * offset[..., 1] - edges[:, :, None, 1] * offset[..., 0]
    inward *= np.sign(turn)[:, None, None]
    outside = (inward <= _TOUCH * length[:, :, None]).all(axis=2)
    return outside.any(axis=1) | (turn == 0)  # a triangle without extent covers nothing


def _candidates(st: np.ndarray, chart: np.ndarray) -> np.ndarray:
    """Pairs (K, 2) of triangles of the same chart whose bounding boxes overlap, found in the cells that both touch."""
    cells = max(1, int(np.sqrt(len(st))))
    low = np.clip((st.min(axis=1) * cells).astype(np.int64), 0, cells - 1)
    high = np.clip((st.max(axis=1) * cells).astype(np.int64), 0, cells - 1)
    span = high - low + 1
    count = span.prod(axis=1)
    triangle = np.repeat(np.arange(len(st)), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    row, column = within // span[triangle, 0], within % span[triangle, 0]
    cell = (low[triangle, 1] + row) * cells + low[triangle, 0] + column
    order = np.argsort(cell, kind="stable")
    cell, triangle = cell[order], triangle[order]
    box_low, box_high = st.min(axis=1), st.max(axis=1)
    found = [np.zeros((0, 2), np.int64)]
    for step in range(1, int(np.bincount(cell).max())):  # entries `step` apart in the sorted list, in the same cell
        same = np.flatnonzero(cell[step:] == cell[:-step])
        if not len(same):
            break
        a, b = triangle[same], triangle[same + step]
        near = (box_low[a] < box_high[b]).all(axis=1) & (box_low[b] < box_high[a]).all(axis=1)
        near &= chart[a] == chart[b]
        found.append(np.sort(np.column_stack([a[near], b[near]]), axis=1))
    return np.unique(np.concatenate(found), axis=0)
