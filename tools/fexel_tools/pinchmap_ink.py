"""Room for solid lines: away from the discontinuities a pinchmap must not come near to having another.

A solid line (section 6.5 of Tarini and Cignoni 2005, *Pinchmaps*) is drawn where k^B - gamma^B is nearly 0. Beside a
discontinuity a fit may take gamma of an inactive texel almost to its k, to bend a sharp corner a little further. The
colours do not show that; a line does, as a spur or a speck. Keeping gamma away from there blunts such corners.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["clear_of_lines"]

_LEAST_ROOM = 0.3  # of |gamma|: what inactive texels keep under the widest lines


def clear_of_lines(pinchmap: NDArray[np.float64], line_width: float) -> NDArray[np.float64]:
    """Hold gamma of inactive texels so far from k that a line of some width is drawn at discontinuities alone.

    Parameters
    ----------
    pinchmap : (Nh, Nw, 4) float64
        d_s, d_t, k, gamma.
    line_width : float
        Pinchmap texels; 0 changes nothing.

    Returns
    -------
    (Nh, Nw, 4) float64
        With abs(gamma) at most 1 - `line_width` (0.3 at least) in texels that are not active: half a line reaches half
        as far where k^B - gamma^B changes by 1 a texel.

    Examples
    --------
    >>> float(clear_of_lines(np.array([[[0.0, 0.0, 1.0, 0.9]]]), 0.25)[0, 0, 3])
    0.75
    """
    if line_width <= 0.0:
        return pinchmap
    limit = max(_LEAST_ROOM, 1.0 - line_width)
    result = pinchmap.copy()
    inactive = pinchmap[..., 2] != 0.0
    result[inactive, 3] = result[inactive, 3].clip(-limit, limit)
    return result
