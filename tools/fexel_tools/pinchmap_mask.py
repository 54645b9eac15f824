"""What a mask of sides means to a pinchmap, and which masks one can express.

A pinchmap of (Nh, Nw) texels divides texture space into as many cells and gives each cell a side. Texel [r, c] lies at
the lower left corner of cell [r, c], where the cells [r, c], [r, c - 1], [r + 1, c] and [r + 1, c - 1] meet. It is
*active* when these are not all on one side: the discontinuity passes there (Tarini and Cignoni 2005, sections 5.1 and
7.2 step 3). The mask says everything about d and k; gamma is left to the fit.

Legal masks are those of section 4.4 with two rules more, found and checked by enumeration: where two lines run one cell
apart, two adjacent active texels may have no boundary between them, d flips through zero, and the undesired fexel shows
(:data:`ADJACENT`); and where the texture does not repeat, the row and column of texels at s = 1 and t = 1 do not exist
(:data:`BORDER`). In a legal map exactly the undesired fexels are pinched away.

Conventions: arrays are (rows, columns), row 0 at the top; s runs right, t runs up. True is the side of k = +1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["ADJACENT", "BORDER", "CROSS", "DIAGONAL", "SURROUNDED", "channels", "is_legal", "violations"]

SURROUNDED = 1
"""Section 4.4, first rule, of a cell: all four corners are active, so that no part of it would be visible."""
DIAGONAL = 2
"""Section 4.4, second rule, of a cell: two opposite corners are active and two are not."""
ADJACENT = 4
"""Of a texel and its right or upper neighbour: both are active, yet the edge between them separates no sides."""
BORDER = 8
"""Of a texel in the last column or top row where wrap is not ``repeat``: the sides differ across that column or row."""
CROSS = 16
"""Of a texel: its four cells are a checkerboard, two lines cross."""


def channels(mask: NDArray[np.bool_], wrap: tuple[str, str] = ("clamp", "clamp")) -> NDArray[np.float64]:
    """Channels d_s, d_t and k that a mask gives, at strength 1.

    Parameters
    ----------
    mask : (Nh, Nw) bool
        Side of every cell.
    wrap : (str, str)
        Along s and t; ``repeat`` joins the borders, at any other the outermost cells go on outside.

    Returns
    -------
    (Nh, Nw, 3) float64
        d_s and d_t in {-1, 0, 1}, pointing to the side of k = -1: both in a turn, one in a straight, none in an
        inactive texel or an (illegal) cross. k is 0 in active texels, elsewhere the side, -1 or 1.

    Examples
    --------
    >>> channels(np.array([[False, True], [False, True]]))[..., 0]
    array([[ 0., -1.],
           [ 0., -1.]])
    """
    upper_left, upper_right, lower_left, lower_right = (side.astype(np.int8) for side in _cells_around(mask, wrap))
    right_minus_left = upper_right + lower_right - upper_left - lower_left
    up_minus_down = upper_left + upper_right - lower_left - lower_right
    result = np.empty((*upper_left.shape, 3))
    result[..., 0] = -np.sign(right_minus_left)
    result[..., 1] = -np.sign(up_minus_down)
    # The sum of four sides in {0, 1} is 0 or 4 in an inactive texel.
    result[..., 2] = (upper_left + upper_right + lower_left + lower_right - 2) // 2 * 1.0
    result[_active(upper_left, upper_right, lower_left, lower_right), 2] = 0.0
    return result


def violations(mask: NDArray[np.bool_], wrap: tuple[str, str] = ("clamp", "clamp")) -> NDArray[np.uint8]:
    """Which rules a mask breaks, and where.

    Parameters
    ----------
    mask : (Nh, Nw) bool
        Side of every cell.
    wrap : (str, str)
        Along s and t; only ``repeat`` joins the borders.

    Returns
    -------
    (Nh, Nw) uint8
        Bits :data:`SURROUNDED` and :data:`DIAGONAL` of cell [r, c]; :data:`ADJACENT`, :data:`BORDER` and
        :data:`CROSS` of texel [r, c], its lower left corner. All zero: the mask is legal.
    """
    upper_left, upper_right, lower_left, lower_right = _cells_around(mask, wrap)
    active = _active(upper_left, upper_right, lower_left, lower_right)
    # Corners of cell [r, c]: texels [r, c], [r, c + 1] below, [r - 1, c], [r - 1, c + 1] above; where they do not
    # exist, the sampler repeats the last.
    corners = _extended(active, wrap, top=1, right=1)
    right, above, across = corners[1:, 1:], corners[:-1, :-1], corners[:-1, 1:]
    result = (active & right & above & across) * np.uint8(SURROUNDED)
    result |= ((active == across) & (right == above) & (active != right)) * np.uint8(DIAGONAL)
    # The edge to the right neighbour runs between the cells right of this texel, the one upward between those above.
    broken = (active & right & (upper_right == lower_right)) | (active & above & (upper_left == upper_right))
    result |= broken * np.uint8(ADJACENT)
    result |= ((upper_left == lower_right) & (upper_right == lower_left) & active) * np.uint8(CROSS)
    if wrap[0] != "repeat":
        broken = (upper_left != upper_right) | (lower_left != lower_right)
        result[:, -1] |= broken[:, -1] * np.uint8(BORDER)
    if wrap[1] != "repeat":
        broken = (upper_left != lower_left) | (upper_right != lower_right)
        result[0] |= broken[0] * np.uint8(BORDER)
    return result


def is_legal(mask: NDArray[np.bool_], wrap: tuple[str, str] = ("clamp", "clamp")) -> bool:
    """Whether a pinchmap can express this mask without showing an undesired fexel."""
    return not violations(mask, wrap).any()


def _cells_around(mask: NDArray[np.bool_], wrap: tuple[str, str]) -> tuple[NDArray[np.bool_], ...]:
    """Sides of the cells above left, above right, below left and below right of every texel."""
    cells = _extended(np.asarray(mask, bool), wrap, bottom=1, left=1)
    return cells[:-1, :-1], cells[:-1, 1:], cells[1:, :-1], cells[1:, 1:]


def _active(upper_left: NDArray, upper_right: NDArray, lower_left: NDArray, lower_right: NDArray) -> NDArray[np.bool_]:
    return (upper_left != upper_right) | (lower_left != lower_right) | (upper_left != lower_left)


def _extended(
    values: NDArray[np.bool_], wrap: tuple[str, str], *, top: int = 0, bottom: int = 0, left: int = 0, right: int = 0
) -> NDArray[np.bool_]:
    """A margin of rows and columns: of the other side where the texture repeats, else of the same."""
    modes = ["wrap" if mode == "repeat" else "edge" for mode in wrap]
    values = np.pad(values, ((top, bottom), (0, 0)), mode=modes[1])  # pyright: ignore[reportCallIssue, reportArgumentType]
    return np.pad(values, ((0, 0), (left, right)), mode=modes[0])  # pyright: ignore[reportCallIssue, reportArgumentType]
