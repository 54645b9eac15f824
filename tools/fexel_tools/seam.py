"""How visible a patch's border is: the CIEDE2000 step across it, less the step that the true picture has there.

Along the outline of a patch two points are taken on either side of the border. The colour difference between them in
the composite, CIEDE2000 (Sharma, Wu and Dalal 2005; colour-science), minus the same difference in the supersampled
truth is what the border adds; an edge of the motif that crosses there counts for nothing. 1 is about the smallest
difference that can be seen. It is negative where the truth has detail that the composite lacks on both sides.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates

__all__ = ["outline_points", "seam_steps"]


def seam_steps(composite: np.ndarray, truth: np.ndarray, outline: np.ndarray, distance_px: float = 1.0) -> np.ndarray:
    """CIEDE2000 step across a closed outline in the composite minus that in the truth.

    Parameters
    ----------
    composite, truth : (H, W, 3) float
        Linear Rec.709 of the same view, same size.
    outline : (K, 2) float
        Corners of the patch in the picture's continuous pixel coordinates, either orientation.
    distance_px : float
        Distance of either point from the border, in pixels of the picture.

    Returns
    -------
    (N,) float64
        One value per pixel of outline length whose two points lie in the picture; empty if there are none.
    """
    inner, outer = outline_points(outline, distance_px)
    size = np.array([composite.shape[1], composite.shape[0]])
    seen = ((inner >= 0) & (inner <= size) & (outer >= 0) & (outer <= size)).all(axis=1)
    inner, outer = inner[seen], outer[seen]
    if not len(inner):
        return np.zeros(0)
    return _step(composite, inner, outer) - _step(truth, inner, outer)


def outline_points(outline: np.ndarray, distance_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 2) at a distance inside and outside of a polygon's edges, about one per pixel, corners left out."""
    outline = np.asarray(outline, np.float64)
    following = np.roll(outline, -1, axis=0)
    area = np.sum(outline[:, 0] * following[:, 1] - outline[:, 1] * following[:, 0])
    inside, outside = [], []
    for start, end in zip(outline, following, strict=True):
        length = np.linalg.norm(end - start)
        count = int(length - 4 * distance_px)
        if count < 1:
            continue
        along = start + (end - start) * ((np.arange(count) + 0.5 + 2 * distance_px) / length)[:, None]
        normal = np.array([start[1] - end[1], end[0] - start[0]]) / length * np.sign(area)
        inside.append(along + normal * distance_px)
        outside.append(along - normal * distance_px)
    empty = np.zeros((0, 2))
    return np.concatenate([empty, *inside]), np.concatenate([empty, *outside])


def _step(image: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return _delta_e(_sampled(image, a), _sampled(image, b))


def _sampled(image: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Bilinear, border texels continued."""
    rows_columns = points.T[::-1] - 0.5
    channels = [map_coordinates(image[:, :, c], rows_columns, order=1, mode="nearest") for c in range(3)]
    return np.stack(channels, axis=-1).astype(np.float64)


def _delta_e(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    import colour  # takes a second to import; nothing else here needs it

    space = colour.RGB_COLOURSPACES["sRGB"]
    labs = []
    for rgb in (a, b):
        xyz = np.clip(rgb, 0, 1) @ space.matrix_RGB_to_XYZ.T
        labs.append(colour.XYZ_to_Lab(xyz, space.whitepoint))
    return colour.delta_E(*labs, method="CIE 2000")
