"""Sparse least squares of the texels of a signal: nine entries a texel, solved in place, bounded.

Conjugate gradients (Hestenes and Stiefel 1952), preconditioned by the diagonal, then, where a bound is exceeded,
Gauss-Seidel sweeps that stay within. Float64; the sums use no BLAS threads.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["conjugate_gradients", "projected_sweeps", "squared_error"]


@numba.njit(cache=True, inline="always")
def _neighbour(index, step, count):
    """Index of a neighbour: the ends meet. Clamped borders have no entries in the matrix that reach across."""
    index += step
    if index < 0:
        return index + count
    return index - count if index >= count else index


@numba.njit(cache=True, nogil=True)
def _product(matrix, x, out):
    """out = matrix x of one channel."""
    rows, columns = x.shape
    for r in range(rows):
        for c in range(columns):
            total = 0.0
            for dy in range(3):
                row = x[_neighbour(r, dy - 1, rows)]
                total += matrix[r, c, 3 * dy] * row[_neighbour(c, -1, columns)]
                total += matrix[r, c, 3 * dy + 1] * row[c]
                total += matrix[r, c, 3 * dy + 2] * row[_neighbour(c, 1, columns)]
            out[r, c] = total


@numba.njit(cache=True, nogil=True)
def conjugate_gradients(matrix, right, x, tolerance, most):
    """Solve matrix x = right for one channel, in place, preconditioned by the diagonal (Hestenes and Stiefel 1952).

    Parameters
    ----------
    matrix : (Sh, Sw, 9) float64
        Symmetric, positive definite.
    right, x : (Sh, Sw) float64
    tolerance : float
        Of the residual's preconditioned norm, relative to the right side's.
    most : int
        Iterations.
    """
    image = np.empty_like(x)
    _product(matrix, x, image)
    residual = right - image
    diagonal = matrix[:, :, 4]
    scaled = residual / diagonal
    direction = scaled.copy()
    square = (residual * scaled).sum()
    limit = tolerance * tolerance * (right * right / diagonal).sum()
    for _ in range(most):
        if square <= limit:
            return
        _product(matrix, direction, image)
        step = square / (direction * image).sum()
        x += step * direction
        residual -= step * image
        scaled = residual / diagonal
        former, square = square, (residual * scaled).sum()
        direction = scaled + (square / former) * direction


@numba.njit(cache=True, nogil=True)
def projected_sweeps(matrix, right, x, low, high, sweeps):
    """Gauss-Seidel sweeps under low <= x <= high, in place: the bounded least squares from a clipped start."""
    rows, columns = x.shape
    for sweep in range(sweeps):
        for n in range(rows * columns):
            at = n if sweep % 2 == 0 else rows * columns - 1 - n
            r, c = at // columns, at % columns
            total = right[r, c] + matrix[r, c, 4] * x[r, c]
            for dy in range(3):
                row = x[_neighbour(r, dy - 1, rows)]
                total -= matrix[r, c, 3 * dy] * row[_neighbour(c, -1, columns)]
                total -= matrix[r, c, 3 * dy + 1] * row[c]
                total -= matrix[r, c, 3 * dy + 2] * row[_neighbour(c, 1, columns)]
            x[r, c] = min(max(total / matrix[r, c, 4], low), high)


@numba.njit(cache=True, nogil=True)
def squared_error(matrix, right, x):
    """Squared error of one channel, less the sum of squares of the picture: x^T matrix x - 2 x^T right."""
    image = np.empty_like(x)
    _product(matrix, x, image)
    return (x * (image - 2.0 * right)).sum()
