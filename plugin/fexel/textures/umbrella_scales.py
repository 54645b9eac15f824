"""How many texels of its base's image an umbrella shows per cell: which mip levels footprints need."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fexel import homography
from fexel.textures.umbrella_arrangement import Arrangement

__all__ = ["texel_scales"]

_MARGIN = 0.7  # octaves by which parts of an umbrella may differ from its least-squares placement


def texel_scales(arrangement: Arrangement, sizes: Sequence[tuple[int, int]]) -> list[tuple[float, float]]:
    """Range of the log2 of texels per cell of the authored grid.

    Parameters
    ----------
    arrangement : Arrangement
    sizes : sequence of (int, int)
        Of the images of those shapes that have one, in order.

    Returns
    -------
    list of (float, float)
        By image.
    """
    with_images = [number for number, shape in enumerate(arrangement.shapes) if shape.image is not None]
    if not len(arrangement):
        return [(0.0, 0.0)] * len(with_images)
    centers = arrangement.points[arrangement.first_vertex[:-1]]
    jacobian = homography.jacobian(arrangement.matrices, centers[:, None])[:, 0] * np.array(arrangement.grid)[:, None]
    scales = []
    for number, size in zip(with_images, sizes, strict=True):
        shape, users = arrangement.shapes[number], arrangement.shape_of == number
        # The affine map from patch space to texels that is nearest to the shape's.
        points = np.column_stack([shape.points, np.ones(len(shape.points))])
        texels = np.linalg.lstsq(points, shape.tex_coords * size, rcond=None)[0][:2].T
        stretch = np.linalg.svd(texels @ np.linalg.inv(jacobian[users]), compute_uv=False)
        # 1e-12 guards an image that is seen along a line, and a base without an umbrella.
        least, most = np.log2(np.maximum([stretch.min(initial=1e12), stretch.max(initial=1e-12)], 1e-12))
        scales.append((float(least) - _MARGIN, float(most) + _MARGIN))
    return scales
