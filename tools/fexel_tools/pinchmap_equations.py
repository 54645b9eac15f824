"""Normal equations of a pinched texture: what every pixel of a picture says about the texels of the signal.

A pixel sees, through the pinch of Tarini and Cignoni 2005, section 5.2 (with the corrections that
`fexel.textures.pinchmap_twin` documents; hard edge), a bilinear mean of four signal texels: one row of a sparse matrix
A. `accumulate` walks over the pixels once and sums, fexel by fexel, the moments of its weights, from which `stencils`
makes A^T W A, nine entries a texel, and A^T W b. Sums are float64; no matrix of the size of the picture is ever made.

Rows count upwards here (row 0 is the lowest), as in OpenGL, so that t and v run with them; positions u, v are in
pinchmap texels. The arrays of the callers are flipped on entry by `pinchmap_signal`.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["MOMENTS", "accumulate", "alpha_masses", "pinch_point", "stencils"]

MOMENTS = 34  # per fexel: 9 of the weights of colour, 9 of alpha, 4 of each of the three colours, 4 of alpha
SMALL_DIRECTION = 1e-5  # a decoded byte 127 is not exactly 0 in float32: below this a component of d counts as 0 (P13)
SMALL_DIVISOR = 1e-6  # keeps divisors positive that tend to 0 together with what they divide
LOST = 0.5  # k - gamma of a wrong pixel so far from the line that what it belongs to is not on the map: shown blurred
_LEAST_WEIGHT = 0.01  # of a pixel at the boundary, which may hold a mixture of both sides: used where nothing else is
_MIXED = 2  # pixels: so far from the boundary of a source one may hold a mixture of both sides
_PINCHED = 0.95  # strength above which a texel sees its own side alone
_NONE = -(1 << 30)  # no fexel
_INVISIBLE = 1e-3  # weight of the colour of a transparent pixel: plausible, but outvoted by any visible one
_RIM = 0.01  # of that weight: the rim of a cut-out says nothing of what lies beyond it


@numba.njit(cache=True, inline="always")
def _rectified(k, d_s, d_t, fu, fv):
    """Position along the pinch segment, linear where the bilinear k is not (5.1, with P3 and P4)."""
    if k == 0.0 or abs(d_s) < SMALL_DIRECTION or abs(d_t) < SMALL_DIRECTION:
        return k
    half = 0.5 if k > 0.0 else -0.5
    a = half - (fu - 0.5 if d_s > 0.0 else 0.5 - fu)
    b = half - (fv - 0.5 if d_t > 0.0 else 0.5 - fv)
    return a if abs(a - k) < abs(b - k) else b


@numba.njit(cache=True, inline="always")
def pinch_point(d_s, d_t, k_b, gamma_b, fu, fv, h):
    """Displacement of one point, hard edge.

    Parameters
    ----------
    d_s, d_t, k_b, gamma_b : float
        The pinchmap's four channels, interpolated at the point.
    fu, fv : float
        Fractional parts of its position in pinchmap texels.
    h : float
        Half a signal texel in pinchmap texels, 2^(-K-1).

    Returns
    -------
    du, dv : float
        Displacement, pinchmap texels.
    strength : float
        Pinch strength at the point, 0 to 1.
    """
    k = _rectified(k_b, d_s, d_t, fu, fv)
    gamma = gamma_b + (k - k_b)
    sign = 1.0 if k_b > gamma_b else -1.0
    along = min((1.0 - sign * k) / max(1.0 - sign * gamma, SMALL_DIVISOR), 1.0)  # 1 at the line, 0 at the segment's end
    target = sign * (1.0 - (1.0 - h) * along)
    scale = 1.0 / max(1.0 - max(abs(k), abs(k_b)), SMALL_DIVISOR)
    d_s = min(max(d_s * scale, -1.0), 1.0)
    d_t = min(max(d_t * scale, -1.0), 1.0)
    return (k - target) * d_s, (k - target) * d_t, max(abs(d_s), abs(d_t))


@numba.njit(cache=True)  # inlined by numba, not LLVM, it makes everything around it two to three times slower
def _encoded(value, table):
    """A table over the square root of the value, beyond 1 the formula; an empty table: the value itself."""
    if len(table) == 0:
        return np.float64(value)
    if value > 1.0:
        return 1.055 * value ** (1.0 / 2.4) - 0.055
    if value <= 0.0:
        return 12.92 * value
    place = np.sqrt(value) * (len(table) - 1)
    index = min(int(place), len(table) - 2)
    return table[index] + (place - index) * (table[index + 1] - table[index])


@numba.njit(cache=True, inline="always")
def _texel(index, count, wrap):
    """Index of a pixel or texel, repeated or clamped."""
    if wrap:
        return index % count
    return min(max(index, 0), count - 1)


@numba.njit(cache=True, inline="always")
def _purity(side, y, x, wraps, positive):
    """How far the 3 x 3 neighbourhood lies on one side: 0 for half of it or less, 1 for all of it, squared."""
    height, width = side.shape
    total = 0.0
    for dy in range(-1, 2):
        row = _texel(y + dy, height, wraps[1])
        for dx in range(-1, 2):
            total += side[row, _texel(x + dx, width, wraps[0])]
    share = total / 9.0 if positive else 1.0 - total / 9.0
    purity = max(0.0, 2.0 * share - 1.0)
    return purity * purity


@numba.njit(cache=True, nogil=True)
def _moving(pinchmap):
    """Whether anything is displaced in each fexel of the pinchmap, which is padded: (Nh, Nw) bool."""
    rows, columns = pinchmap.shape[0] - 1, pinchmap.shape[1] - 1
    moving = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            corners = np.abs(pinchmap[row : row + 2, column : column + 2, :2])
            moving[row, column] = corners.max() >= SMALL_DIRECTION
    return moving


@numba.njit(cache=True, inline="always")
def _mix(texels, r0, r1, c0, c1, channel, f, g):
    """Bilinear interpolation of one channel. Scalars throughout: views of texels would be counted references."""
    low = texels[r0, c0, channel] * (1.0 - f) + texels[r0, c1, channel] * f
    return low * (1.0 - g) + (texels[r1, c0, channel] * (1.0 - f) + texels[r1, c1, channel] * f) * g


@numba.njit(cache=True, inline="always")
def _pinched(pinchmap, j, i, fu, fv, h):
    """Displacement, strength and k - gamma at a point of fexel (j, i)."""
    d_s = _mix(pinchmap, j, j + 1, i, i + 1, 0, fu, fv)
    d_t = _mix(pinchmap, j, j + 1, i, i + 1, 1, fu, fv)
    k_b = _mix(pinchmap, j, j + 1, i, i + 1, 2, fu, fv)
    gamma_b = _mix(pinchmap, j, j + 1, i, i + 1, 3, fu, fv)
    du, dv, strength = pinch_point(d_s, d_t, k_b, gamma_b, fu, fv, h)
    return du, dv, strength, k_b - gamma_b


@numba.njit(cache=True, inline="always")
def _weight(side, y, x, wraps, strength, edge):
    """How far a pixel counts that is seen at k - gamma = `edge`: see `pinchmap_signal`."""
    positive = edge > 0.0
    if (side[y, x] > 0.5) == positive:
        return max(_LEAST_WEIGHT, 1.0 - strength * (1.0 - _purity(side, y, x, wraps, positive)))
    return 1.0 if abs(edge) > LOST else 1.0 - strength


@numba.njit(cache=True, inline="always")
def _read(color, opacity, y, x, table, values):
    """Encoded colours and opacity of a pixel into `values`; whether all are finite."""
    for c in range(3):
        values[c] = _encoded(color[y, x, c], table)
    values[3] = opacity[y, x]
    return np.isfinite(values[0] + values[1] + values[2] + values[3])


@numba.njit(cache=True, inline="always")
def _subtract_shown(texels, place_u, place_v, wraps, table, values):
    """What linear, premultiplied texels show there, encoded, straight, off `values`; alpha is left to be 0."""
    b, a = int(np.floor(place_v)), int(np.floor(place_u))
    f, g = place_u - a, place_v - b
    r0, r1 = _texel(b, texels.shape[0], wraps[1]), _texel(b + 1, texels.shape[0], wraps[1])
    c0, c1 = _texel(a, texels.shape[1], wraps[0]), _texel(a + 1, texels.shape[1], wraps[0])
    alpha = _mix(texels, r0, r1, c0, c1, 3, f, g)
    for c in range(3):
        values[c] -= _encoded(_mix(texels, r0, r1, c0, c1, c, f, g) / alpha, table)
    values[3] = 0.0


@numba.njit(cache=True, inline="always")
def _is_mixed(side, y, x, wraps):
    """Whether a pixel lies so near the boundary of the source that its alpha may be that of a mixture."""
    height, width = side.shape
    here = side[y, x] > 0.5
    for dy in range(-_MIXED, _MIXED + 1):
        row = _texel(y + dy, height, wraps[1])
        for dx in range(-_MIXED, _MIXED + 1):
            if (side[row, _texel(x + dx, width, wraps[0])] > 0.5) != here:
                return True
    return False


@numba.njit(cache=True, nogil=True)
def accumulate(color, opacity, side, pinchmap, signal_shape, wraps, table, texels, every, moments):
    """Sum the moments of all pixels, and return the range and squares of what they show.

    Parameters
    ----------
    color : (H, W, 3) float32
        Row 0 at the top, as sources are. Straight.
    opacity, side : (H, W) float32
    pinchmap : (Nh + 1, Nw + 1, 4) float64
        Row 0 lowest, padded at the far ends by the wrap mode.
    signal_shape : (int, int)
    wraps : (bool, bool)
        Whether texels repeat along s and t; else they are clamped.
    table : (n,) float32
        sRGB encoding over the square root of the linear value; empty: none.
    texels : (Sh, Sw, 4) float64
        Empty, or a signal whose error is to be summed instead of the picture: linear, premultiplied, alpha above 0, row
        0 lowest.
    every : int
        Only each so manieth row of pixels is looked at.
    moments : (Sh + 1, Sw + 1, MOMENTS) float64
        Zeros on entry; entry (b, a) is the fexel whose lowest texel is (b - 1, a - 1).

    Returns
    -------
    (3, 4) float64
        Least and largest value of the (encoded) colours and of the opacity, over pixels that count; weighted sums of
        their squares.
    """
    height, width = side.shape
    map_rows, map_columns = pinchmap.shape[0] - 1, pinchmap.shape[1] - 1
    finer = signal_shape[1] / map_columns
    moving = _moving(pinchmap)
    summary = np.zeros((3, 4))
    summary[0], summary[1] = np.inf, -np.inf
    sums, values = np.zeros(14), np.empty(4)
    for y in range(every // 2, height, every):
        v = (1.0 - (y + 0.5) / height) * map_rows
        j = min(int(v), map_rows - 1)
        last = _NONE
        for x in range(width):
            u = (x + 0.5) / width * map_columns
            i = min(int(u), map_columns - 1)
            du, dv, strength, weight = 0.0, 0.0, 0.0, 1.0
            if moving[j, i]:
                du, dv, strength, edge = _pinched(pinchmap, j, i, u - i, v - j, 0.5 / finer)
                weight = _weight(side, y, x, wraps, strength, edge)
            if weight <= 0.0 or not _read(color, opacity, y, x, table, values):
                continue
            place_u, place_v = (u + du) * finer - 0.5, (v + dv) * finer - 0.5
            visible = weight * (_INVISIBLE + values[3])
            if strength > _PINCHED and values[3] < 0.5 and _is_mixed(side, y, x, wraps):
                visible = weight * _INVISIBLE * _RIM
            if texels.size > 0:
                _subtract_shown(texels, place_u, place_v, wraps, table, values)
            for c in range(4):
                summary[0, c] = min(summary[0, c], values[c])
                summary[1, c] = max(summary[1, c], values[c])
                summary[2, c] += (visible if c < 3 else weight) * values[c] * values[c]
            if moving[j, i]:
                _add(moments, place_u, place_v, wraps, weight, visible, values)
                continue
            a = int(np.floor(place_u))
            if a != last:
                if last != _NONE:
                    _flush(sums, v * finer - 0.5, last, wraps, moments)
                last = a
            _add_to_row(sums, place_u - a, weight, visible, values)
        if last != _NONE:
            _flush(sums, v * finer - 0.5, last, wraps, moments)
    return summary


@numba.njit(cache=True, inline="always")
def _fexel(index, entries, wrap):
    """Entry of a fexel in `moments`. Beyond a clamped border both texels are the same, whatever the weights."""
    if wrap:
        return index % (entries - 1) + 1
    return min(max(index + 1, 0), entries - 1)


@numba.njit(cache=True, inline="always")
def _add_to_row(sums, f, weight, visible, values):
    """Moments along s of pixels of one row and fexel."""
    sums[0] += visible
    sums[1] += visible * f
    sums[2] += visible * f * f
    sums[3] += weight
    sums[4] += weight * f
    sums[5] += weight * f * f
    for c in range(3):
        sums[6 + 2 * c] += visible * values[c]
        sums[7 + 2 * c] += visible * values[c] * f
    sums[12] += weight * values[3]
    sums[13] += weight * values[3] * f


@numba.njit(cache=True, inline="always")
def _flush(sums, place, a, wraps, moments):
    """Moments along s, times powers of g, to the fexel of the row's position; clears `sums`."""
    b = int(np.floor(place))
    g = place - b
    target = moments[_fexel(b, moments.shape[0], wraps[1]), _fexel(a, moments.shape[1], wraps[0])]
    power = 1.0
    for n in range(3):
        for m in range(6):
            target[3 * n + (m if m < 3 else m + 6)] += sums[m] * power
        if n < 2:
            for m in range(8):
                target[18 + 4 * (m // 2) + 2 * n + m % 2] += sums[6 + m] * power
        power *= g
    sums[:] = 0.0


@numba.njit(cache=True, inline="always")
def _add(moments, place_u, place_v, wraps, weight, visible, values):
    """Moments of one pixel."""
    b, a = int(np.floor(place_v)), int(np.floor(place_u))
    f, g = place_u - a, place_v - b
    target = moments[_fexel(b, moments.shape[0], wraps[1]), _fexel(a, moments.shape[1], wraps[0])]
    power = 1.0
    for n in range(3):
        target[3 * n] += visible * power
        target[3 * n + 1] += visible * power * f
        target[3 * n + 2] += visible * power * f * f
        target[9 + 3 * n] += weight * power
        target[10 + 3 * n] += weight * power * f
        target[11 + 3 * n] += weight * power * f * f
        power *= g
    for c in range(4):
        value = values[c] * (visible if c < 3 else weight)
        target[18 + 4 * c] += value
        target[19 + 4 * c] += value * f
        target[20 + 4 * c] += value * g
        target[21 + 4 * c] += value * f * g


@numba.njit(cache=True, inline="always")
def _pair(m0, m1, m2, p, q):
    """Sum of w_p w_q from the moments of orders 0 to 2, with w_0 = 1 - f and w_1 = f."""
    if p != q:
        return m1 - m2
    return m2 if p == 1 else m0 - 2.0 * m1 + m2


@numba.njit(cache=True, nogil=True)
def stencils(moments, wrap_s, wrap_t):
    """Normal matrix and right side from the moments.

    Parameters
    ----------
    moments : (Sh + 1, Sw + 1, MOMENTS) float64
    wrap_s, wrap_t : bool
        Texels repeat; else they are clamped.

    Returns
    -------
    matrix : (2, Sh, Sw, 9) float64
        Of colour and of alpha; entry 3 (dy + 1) + dx + 1 of the neighbour at (y + dy, x + dx).
    right : (Sh, Sw, 4) float64
    """
    rows, columns = moments.shape[0] - 1, moments.shape[1] - 1
    matrix = np.zeros((2, rows, columns, 9))
    right = np.zeros((rows, columns, 4))
    along = np.empty((3, 3))
    for b in range(-1, rows):
        for a in range(-1, columns):
            m = moments[b + 1, a + 1]
            if m[9] == 0.0:
                continue
            for py in range(2):
                y = _texel(b + py, rows, wrap_t)
                for px in range(2):
                    x = _texel(a + px, columns, wrap_s)
                    for c in range(4):
                        at = 18 + 4 * c
                        low = m[at + 1] if px == 1 else m[at] - m[at + 1]
                        high = m[at + 3] if px == 1 else m[at + 2] - m[at + 3]
                        right[y, x, c] += high if py == 1 else low - high
                    for qy in range(2):
                        dy = qy - py if wrap_t else _texel(b + qy, rows, False) - y
                        for qx in range(2):
                            dx = qx - px if wrap_s else _texel(a + qx, columns, False) - x
                            for kind in range(2):
                                at = 9 * kind
                                for n in range(3):
                                    along[kind, n] = _pair(m[at + 3 * n], m[at + 3 * n + 1], m[at + 3 * n + 2], px, qx)
                                matrix[kind, y, x, 3 * (dy + 1) + dx + 1] += _pair(
                                    along[kind, 0], along[kind, 1], along[kind, 2], py, qy
                                )
    return matrix, right


@numba.njit(cache=True, nogil=True)
def alpha_masses(opacity, side, pinchmap, signal_shape, wraps, step):
    """How much of what every texel shows of its own side is nearly transparent, and how much nearly opaque.

    Where the texture is pinched, pixels that may be mixtures of both sides are left out, as are those of the other
    side (unless what they belong to is not on the map).

    Parameters
    ----------
    opacity, side, pinchmap, signal_shape, wraps
        As of :func:`accumulate`.
    step : float
        Alpha at most `step` is nearly transparent, at least 1 - `step` nearly opaque.

    Returns
    -------
    (Sh, Sw, 3) float64
        Row 0 lowest: sums of bilinear weights of all pixels, of nearly transparent and of nearly opaque ones.
    """
    height, width = side.shape
    map_rows, map_columns = pinchmap.shape[0] - 1, pinchmap.shape[1] - 1
    finer = signal_shape[1] / map_columns
    moving = _moving(pinchmap)
    masses = np.zeros((signal_shape[0], signal_shape[1], 3))
    for y in range(height):
        v = (1.0 - (y + 0.5) / height) * map_rows
        j = min(int(v), map_rows - 1)
        for x in range(width):
            alpha = opacity[y, x]
            if not np.isfinite(alpha):
                continue
            u = (x + 0.5) / width * map_columns
            i = min(int(u), map_columns - 1)
            du, dv = 0.0, 0.0
            if moving[j, i]:
                du, dv, strength, edge = _pinched(pinchmap, j, i, u - i, v - j, 0.5 / finer)
                wrong = (side[y, x] > 0.5) != (edge > 0.0)
                own = not wrong and not _is_mixed(side, y, x, wraps)
                if strength > _PINCHED and not own and not (wrong and abs(edge) > LOST):
                    continue
            place_u, place_v = (u + du) * finer - 0.5, (v + dv) * finer - 0.5
            b, a = int(np.floor(place_v)), int(np.floor(place_u))
            f, g = place_u - a, place_v - b
            for p in range(2):
                row = _texel(b + p, signal_shape[0], wraps[1])
                for q in range(2):
                    column = _texel(a + q, signal_shape[1], wraps[0])
                    weight = (g if p else 1.0 - g) * (f if q else 1.0 - f)
                    masses[row, column, 0] += weight
                    masses[row, column, 1] += weight if alpha <= step else 0.0
                    masses[row, column, 2] += weight if alpha >= 1.0 - step else 0.0
    return masses
