"""Inner loops of photometric alignment, compiled: sampling, correlation and one Gauss-Newton step.

`fexel_tools.alignment` explains the method. A warp maps homogeneous grid coordinates to continuous pixel coordinates
of the sampled image; a grid has `rows` x `columns` points that cover [-1, 1] x [-aspect, aspect].
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["correlate_many", "count_agreeing", "gauss_newton_step", "sample_grid"]

_UNIT = np.float32(1 / 65535)


@numba.njit(cache=True, nogil=True)
def sample_grid(image, warp, rows, columns, aspect, channels):
    """Look an image up at the grid's points by bicubic (Catmull-Rom) interpolation, clamped at the rim.

    Parameters
    ----------
    image : (H, W, 3) uint16
    warp : (3, 3) float64
    rows, columns : int
    aspect : float
    channels : {1, 3}
        1: luminance.

    Returns
    -------
    (rows * columns, channels) float32
        In [0, 1] but for overshoots; NaN outside the image.
    """
    height, width = image.shape[0], image.shape[1]
    result = np.empty((rows * columns, channels), np.float32)
    wx, wy = np.empty(4, np.float32), np.empty(4, np.float32)
    n = 0
    for j in range(rows):
        v = ((j + 0.5) * (2 / rows) - 1) * aspect
        for i in range(columns):
            u = (i + 0.5) * (2 / columns) - 1
            w = warp[2, 0] * u + warp[2, 1] * v + warp[2, 2]
            x = y = -1.0
            if w > 1e-9:  # in front; 1e-9 keeps the quotient finite
                x = (warp[0, 0] * u + warp[0, 1] * v + warp[0, 2]) / w
                y = (warp[1, 0] * u + warp[1, 1] * v + warp[1, 2]) / w
            if not (x >= 0 and y >= 0 and x <= width and y <= height):
                result[n] = np.nan
                n += 1
                continue
            x -= 0.5
            y -= 0.5
            x0, y0 = int(np.floor(x)), int(np.floor(y))
            _cubic(np.float32(x - x0), wx)
            _cubic(np.float32(y - y0), wy)
            red = green = blue = np.float32(0)
            for b in range(4):
                row = min(max(y0 - 1 + b, 0), height - 1)
                for a in range(4):
                    column = min(max(x0 - 1 + a, 0), width - 1)
                    weight = wx[a] * wy[b]
                    red += weight * image[row, column, 0]
                    green += weight * image[row, column, 1]
                    blue += weight * image[row, column, 2]
            if channels == 1:
                result[n, 0] = (np.float32(0.299) * red + np.float32(0.587) * green + np.float32(0.114) * blue) * _UNIT
            else:
                result[n, 0], result[n, 1], result[n, 2] = red * _UNIT, green * _UNIT, blue * _UNIT
            n += 1
    return result


@numba.njit(cache=True, nogil=True)
def _cubic(t, weights):
    weights[0] = np.float32(-0.5) * t * (1 - t) * (1 - t)
    weights[1] = 1 + t * t * (np.float32(1.5) * t - np.float32(2.5))
    weights[2] = t * (np.float32(0.5) + t * (2 - np.float32(1.5) * t))
    weights[3] = np.float32(0.5) * t * t * (t - 1)


@numba.njit(cache=True, nogil=True)
def correlation(values, sampled, least_inside):
    """Zero-mean normalised correlation where the sampling is finite; -1 for too few points or a flat image."""
    count, channels = 0, values.shape[1]
    sums = np.zeros((channels, 5))
    for n in range(len(values)):
        if np.isnan(sampled[n, 0]):
            continue
        count += 1
        for c in range(channels):
            a, b = np.float64(values[n, c]), np.float64(sampled[n, c])
            sums[c, 0] += a
            sums[c, 1] += b
            sums[c, 2] += a * a
            sums[c, 3] += b * b
            sums[c, 4] += a * b
    if count < least_inside * len(values) or count == 0:
        return -1.0
    aa = bb = ab = 0.0
    for c in range(channels):
        aa += sums[c, 2] - sums[c, 0] * sums[c, 0] / count
        bb += sums[c, 3] - sums[c, 1] * sums[c, 1] / count
        ab += sums[c, 4] - sums[c, 0] * sums[c, 1] / count
    if aa < 1e-6 * count or bb < 1e-6 * count:  # a deviation of 1e-3 of white: nothing to be seen
        return -1.0
    return ab / np.sqrt(aa * bb)


@numba.njit(cache=True, nogil=True)
def correlate_many(image, warps, values, aspect, least_inside):
    """Correlation of a luminance template (rows, columns) with the image under each of K warps, (K,) float64."""
    rows, columns = values.shape
    flat = values.copy().reshape(-1, 1)
    result = np.empty(len(warps))
    for k in range(len(warps)):
        result[k] = correlation(flat, sample_grid(image, warps[k], rows, columns, aspect, 1), least_inside)
    return result


@numba.njit(cache=True, nogil=True)
def count_agreeing(corners, order, radius):
    """Per vote the number of votes whose corners all lie within its radius; `order` sorts the first corner's x."""
    count = len(corners)
    result = np.zeros(count, np.int64)
    for position in range(count):
        k = order[position]
        for direction in (-1, 1):
            other = position + direction
            while 0 <= other < count and abs(corners[order[other], 0, 0] - corners[k, 0, 0]) < radius[k]:
                result[k] += _largest_difference(corners[order[other]], corners[k]) < radius[k]
                other += direction
        result[k] += 1
    return result


@numba.njit(cache=True, nogil=True)
def _largest_difference(a, b):
    largest = 0.0
    for i in range(4):
        largest = max(largest, abs(a[i, 0] - b[i, 0]), abs(a[i, 1] - b[i, 1]))
    return largest


@numba.njit(cache=True, nogil=True)
def tone_curve(x, y):
    """Least-squares quadratic from template values to sampled ones, where those are finite.

    Returns
    -------
    (4,) float64
        Coefficients of 1, d, d^2 with d = x - mean, and the mean.
    """
    count, mean = 0, 0.0
    for n in range(len(x)):
        if not np.isnan(y[n]):
            count += 1
            mean += x[n]
    mean /= max(count, 1)
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for n in range(len(x)):
        if np.isnan(y[n]):
            continue
        d = x[n] - mean
        powers = (1.0, d, d * d)
        for a in range(3):
            right[a] += powers[a] * y[n]
            for b in range(3):
                normal[a, b] += powers[a] * powers[b]
    normal[0, 0] += 1e-9  # these three keep a channel without contrast solvable
    normal[1, 1] += 1e-6 * count + 1e-9
    normal[2, 2] += 1e-4 * count + 1e-9
    result = np.empty(4)
    result[:3] = np.linalg.solve(normal, right)
    result[3] = mean
    return result


@numba.njit(cache=True, nogil=True)
def gauss_newton_step(values, sampled, aspect, unknowns, least_inside):
    """Update of the warp that makes the template look most like the sampling.

    Parameters
    ----------
    values : (rows, columns, C) float32
        The template.
    sampled : (rows * columns, C) float32
        NaN outside.
    aspect : float
    unknowns : {4, 6, 8}
    least_inside : float
        Share of the points that must be finite.

    Returns
    -------
    (8,) float64
        tx, ty, a, b, c, d, g, h of the motion [[1 + a, b, tx], [c, 1 + d, ty], [g, h, 1]] of the grid, to be inverted
        and applied first; zero when there is too little to go by.
    """
    rows, columns, channels = values.shape
    step = np.zeros(8)
    fitted = np.empty((rows, columns, channels), np.float32)
    for c in range(channels):
        curve = tone_curve(values[:, :, c].copy().reshape(-1), sampled[:, c].copy())
        for j in range(rows):
            for i in range(columns):
                d = values[j, i, c] - curve[3]
                fitted[j, i, c] = curve[0] + d * (curve[1] + d * curve[2])
    size, valid = _residual_sizes(fitted, sampled)
    if valid < max(least_inside * rows * columns, 2 * unknowns):
        return step
    stride = max(1, rows * columns // 4096)
    some = size[::stride]
    some = some[~np.isnan(some)]
    if not len(some):
        return step
    scale = 2.5 * 1.4826 * np.median(some) + 1e-4  # 1e-4: a perfect fit keeps weight one
    normal, right = _normal_equations(fitted, sampled, size, scale, aspect, unknowns)
    trace = 0.0
    for a in range(unknowns):
        trace += normal[a, a]
    for a in range(unknowns):
        normal[a, a] += 1e-4 * trace / unknowns + 1e-12  # keeps texture of one direction solvable
    solution = np.linalg.solve(normal, right)
    solution = np.minimum(np.maximum(solution, -0.3), 0.3)  # no jump beyond the linear range
    step[:unknowns] = solution
    if unknowns == 4:
        step[2], step[3], step[4], step[5] = solution[2], -solution[3], solution[3], solution[2]
    return step


@numba.njit(cache=True, nogil=True)
def _residual_sizes(fitted, sampled):
    rows, columns, channels = fitted.shape
    size = np.empty(rows * columns)
    valid = 0
    for j in range(rows):
        for i in range(columns):
            n = j * columns + i
            total = 0.0
            for c in range(channels):
                total += (sampled[n, c] - fitted[j, i, c]) ** 2
            size[n] = np.sqrt(total / channels)
            valid += not np.isnan(total)
    return size, valid


@numba.njit(cache=True, nogil=True)
def _normal_equations(fitted, sampled, size, scale, aspect, unknowns):
    """Weighted by Geman and McClure; gradients are the fitted template's, by central differences."""
    rows, columns, channels = fitted.shape
    normal, right, descent = np.zeros((unknowns, unknowns)), np.zeros(unknowns), np.empty(unknowns)
    per_u, per_v = columns / 2, rows / (2 * aspect)
    for j in range(rows):
        above, below = max(j - 1, 0), min(j + 1, rows - 1)
        y = ((j + 0.5) * (2 / rows) - 1) * aspect
        for i in range(columns):
            n = j * columns + i
            if np.isnan(size[n]):
                continue
            before, after = max(i - 1, 0), min(i + 1, columns - 1)
            x = (i + 0.5) * (2 / columns) - 1
            ratio = size[n] / scale
            weight = 1 / (1 + ratio * ratio) ** 2
            for c in range(channels):
                du = (fitted[j, after, c] - fitted[j, before, c]) * per_u / max(after - before, 1)
                dv = (fitted[below, i, c] - fitted[above, i, c]) * per_v / max(below - above, 1)
                descent[0], descent[1] = du, dv
                if unknowns == 4:
                    descent[2], descent[3] = du * x + dv * y, dv * x - du * y
                else:
                    descent[2], descent[3], descent[4], descent[5] = du * x, du * y, dv * x, dv * y
                    if unknowns == 8:
                        radial = du * x + dv * y
                        descent[6], descent[7] = -radial * x, -radial * y
                residual = sampled[n, c] - fitted[j, i, c]
                for a in range(unknowns):
                    weighted = weight * descent[a]
                    right[a] += weighted * residual
                    for b in range(a, unknowns):
                        normal[a, b] += weighted * descent[b]
    for a in range(unknowns):
        for b in range(a):
            normal[a, b] = normal[b, a]
    return normal, right
