"""How far colours are from the truth as it is seen: CIEDE2000."""

from __future__ import annotations

import numpy as np

__all__ = ["ciede2000"]


def ciede2000(picture: np.ndarray, truth: np.ndarray) -> float:
    """Mean CIEDE2000 (Sharma, Wu and Dalal 2005; colour-science) of (..., >= 3), linear Rec.709, clipped to [0, 1]."""
    import colour  # takes a second to import; nothing else here needs it

    space = colour.RGB_COLOURSPACES["sRGB"]
    labs = [
        colour.XYZ_to_Lab(np.clip(rgb[..., :3], 0, 1).astype(np.float64) @ space.matrix_RGB_to_XYZ.T, space.whitepoint)
        for rgb in (picture, truth)
    ]
    return float(np.mean(colour.delta_E(*labs, method="CIE 2000")))
