"""The range of a source's values, and pictures brought from it to 0..1.

Colours above 1 and data such as signed normal maps or heights must be compared and shown over all of their range: what
is clipped to 0..1 would count as equal.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fexel_tools.pinchmap_source import PinchmapSource

__all__ = ["Range", "scaled", "value_range"]

Range = tuple[float, float]
"""Least and largest value."""


def value_range(source: PinchmapSource) -> Range:
    """What the source's values span where it can be seen.

    Returns
    -------
    (float, float)
        Data: least and largest. Colours: 0, and the largest, premultiplied, but at least 1. The second is the larger.
    """
    if not source.is_data:
        return 0.0, max(1.0, float((source.color * source.opacity[..., None]).max(initial=0.0)))
    values = source.color[source.opacity > 0]
    if not values.size:
        return 0.0, 1.0
    least, largest = float(values.min()), float(values.max())
    return least, largest if largest > least else least + 1.0


def scaled(picture: NDArray[np.floating], span: Range) -> NDArray[np.float32]:
    """Bring a picture from a range to 0..1.

    Parameters
    ----------
    picture : (H, W, 4) float
        Premultiplied.
    span : (float, float)
        From `value_range`.

    Returns
    -------
    (H, W, 4) float32
        Premultiplied; values outside of the range are outside of 0..1.
    """
    low, high = span
    result = np.array(picture, np.float32)
    if span != (0.0, 1.0):
        result[..., :3] = (result[..., :3] - np.float32(low) * result[..., 3:]) / np.float32(high - low)
    return result
