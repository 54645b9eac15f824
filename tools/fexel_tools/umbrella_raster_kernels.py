"""Kernels of the raster: one tile of samples, front to back, sector by sector.

Sectors of an umbrella are triangles, filled in rows: a sample belongs to the one triangle that its centre lies in,
neighbours share edges computed alike, so that nothing is drawn twice and nothing between them is missed. Colours of
samples go into the sums of their pixels right away; per sample only two numbers are kept: what is yet seen
(transmittance), and how much light the umbrellas in front let through.
"""

from __future__ import annotations

import numba
import numpy as np

__all__ = ["draw_tile", "triangle_spans"]

_OPAQUE = 1e-4  # transmittance below which nothing behind is seen: a 26th of an 8-bit step


@numba.njit(cache=True, nogil=True)
def draw_tile(
    tile, factor, listed, copies, placed, shapes, colors, blend, texels, vectors, shadow, strength, background, out
):
    """Sums of the samples of each pixel of a tile.

    Parameters
    ----------
    tile : (x, y, columns, rows)
        Samples, whole pixels.
    factor : int
        Samples per pixel along each axis.
    listed : (m,) int64
        Copies that touch the tile, front to back.
    copies : (umbrella (m,), shift (m, 2))
    placed : (first, vertices, inverse_w, orientation, coverages)
    shapes : (shape_of (n,), first (b + 1,), tex_coords (total, 2))
    colors : (total, 3) float32
        Or (0, 3).
    blend : float
    texels : (texels (N, 4), place (n, 3), opaque (n,))
    vectors : (turns, zero_x, zero_y, aspect)
        Where x and y are components of a vector: (n, 2, 2) how umbrellas turn, else (0, 2, 2); the values that stand
        for 0; and the scale of x over that of y.
    shadow : (dx, dy)
        Samples.
    strength : float
    background : (texels (N, 4), places (1, 3), wraps (2,), st of the first sample's corner and steps (6,))
    out : (rows / factor, columns / factor, 4) float64
        Added to: linear, premultiplied.
    """
    x0, y0, columns, rows = tile
    seen = np.ones((rows, columns), np.float32)
    lit = np.ones((rows if strength > 0 else 1, columns if strength > 0 else 1), np.float32)
    open_samples = np.full(rows, columns, np.int64)
    still_open = rows * columns
    spans = np.empty((rows, 2), np.int64)
    umbrella, shift = copies
    for entry in listed:
        number = umbrella[entry]
        still_open -= _draw_umbrella(
            number, shift[entry, 0] - x0, shift[entry, 1] - y0, factor, placed, shapes, colors, blend, texels, vectors,
            strength, seen, lit, open_samples, spans, out,
        )  # fmt: skip
        if still_open == 0:
            return
        if strength > 0:
            _cast_shadow(
                number, shift[entry, 0] - x0 + shadow[0], shift[entry, 1] - y0 + shadow[1], placed, shapes, texels,
                lit, open_samples, spans,
            )  # fmt: skip
    _draw_background(tile, factor, background, strength, seen, lit, open_samples, out)


@numba.njit(cache=True, nogil=True, inline="never")
def _draw_umbrella(
    number,
    dx,
    dy,
    factor,
    placed,
    shapes,
    colors,
    blend,
    texels,
    vectors,
    strength,
    seen,
    lit,
    open_samples,
    spans,
    out,
):
    """Add an umbrella to the sums; returns how many samples it closed."""
    first, vertices, inverse_w, orientation, coverages = placed
    shape_of, shape_first, tex_coords = shapes
    all_texels, places, opaque = texels
    rows, columns = seen.shape
    begin, count = first[number], first[number + 1] - first[number]
    coords = shape_first[shape_of[number]]
    offset, width, height = places[number]
    has_color = len(colors) > 0 and blend != 0
    coverage, is_opaque = coverages[number], opaque[number]
    is_turned = len(vectors[0]) > 0
    values = np.zeros((3, 6))  # u, v in texels; r, g, b offsets; 1: each over w
    closed = 0
    for sector in range(1, count):
        corner = (0, sector, sector + 1 if sector + 1 < count else 1)
        cx, cy = vertices[begin, 0] + dx, vertices[begin, 1] + dy
        ax, ay = vertices[begin + corner[1], 0] + dx, vertices[begin + corner[1], 1] + dy
        bx, by = vertices[begin + corner[2], 0] + dx, vertices[begin + corner[2], 1] + dy
        area = (ax - cx) * (by - cy) - (ay - cy) * (bx - cx)
        if area * orientation[number] <= 0:
            continue
        top, bottom = triangle_spans(cx, cy, ax, ay, bx, by, columns, rows, spans)
        if top >= bottom:
            continue
        _fill(values, corner, begin, coords, inverse_w, tex_coords, width, height)
        if has_color:
            for k in range(3):
                for c in range(3):
                    values[k, 2 + c] = colors[begin + corner[k], c] * blend * values[k, 5]
        # Barycentric weights of a and b are linear in x and y.
        a_x, a_y = (by - cy) / area, -(bx - cx) / area
        b_x, b_y = -(ay - cy) / area, (ax - cx) / area
        u_x, u_0, u_y = _plane(values, 0, a_x, a_y, b_x, b_y)
        v_x, v_0, v_y = _plane(values, 1, a_x, a_y, b_x, b_y)
        r_x, r_0, r_y = _plane(values, 2, a_x, a_y, b_x, b_y)
        g_x, g_0, g_y = _plane(values, 3, a_x, a_y, b_x, b_y)
        l_x, l_0, l_y = _plane(values, 4, a_x, a_y, b_x, b_y)
        w_x, w_0, w_y = _plane(values, 5, a_x, a_y, b_x, b_y)
        # A flat w differs from 1 by rounding alone.
        affine = abs(values[1, 5] - 1) < 1e-12 and abs(values[2, 5] - 1) < 1e-12
        for y in range(top, bottom):
            if open_samples[y] == 0 or spans[y, 0] >= spans[y, 1]:
                continue
            along = y + 0.5 - cy
            u_row, v_row = u_0 + u_y * along, v_0 + v_y * along
            r_row, g_row, l_row = r_0 + r_y * along, g_0 + g_y * along, l_0 + l_y * along
            w_row = w_0 + w_y * along
            pixel_row = y // factor
            low, high = spans[y, 0], spans[y, 1]
            for pixel in range(low // factor, (high - 1) // factor + 1):
                sum_r, sum_g, sum_b, sum_a = 0.0, 0.0, 0.0, 0.0
                for x in range(max(low, pixel * factor), min(high, pixel * factor + factor)):
                    through = seen[y, x]
                    if through == 0:
                        continue
                    step = x + 0.5 - cx
                    inverse = 1.0 if affine else 1.0 / (w_row + w_x * step)
                    r, g, b, alpha = 0.0, 0.0, 0.0, 1.0
                    if width > 0:
                        u, v = (u_row + u_x * step) * inverse, (v_row + v_x * step) * inverse
                        r, g, b, alpha = _straight(all_texels, offset, width, height, u, v, is_opaque)
                        if alpha <= 0:
                            continue
                    if has_color:
                        r += (r_row + r_x * step) * inverse
                        g += (g_row + g_x * step) * inverse
                        b += (l_row + l_x * step) * inverse
                    r, g, b = min(1.0, max(0.0, r)), min(1.0, max(0.0, g)), min(1.0, max(0.0, b))
                    if is_turned:
                        r, g = _turned(r, g, number, vectors)
                    alpha *= coverage
                    weight = through * alpha
                    light = weight
                    if strength > 0:
                        light *= 1 - strength * (1 - lit[y, x])
                    sum_r += light * r
                    sum_g += light * g
                    sum_b += light * b
                    sum_a += weight
                    through *= 1 - alpha
                    if through < _OPAQUE:
                        through = 0.0
                        closed += 1
                        open_samples[y] -= 1
                    seen[y, x] = through
                out[pixel_row, pixel, 0] += sum_r
                out[pixel_row, pixel, 1] += sum_g
                out[pixel_row, pixel, 2] += sum_b
                out[pixel_row, pixel, 3] += sum_a
    return closed


@numba.njit(cache=True, nogil=True, inline="never")
def _cast_shadow(number, dx, dy, placed, shapes, texels, lit, open_samples, spans):
    """Take away the light that an umbrella, moved to where its shadow falls, keeps from what lies behind it."""
    first, vertices, inverse_w, orientation, coverages = placed
    shape_of, shape_first, tex_coords = shapes
    all_texels, places, opaque = texels
    rows, columns = lit.shape
    begin, count = first[number], first[number + 1] - first[number]
    coords = shape_first[shape_of[number]]
    offset, width, height = places[number]
    coverage = coverages[number]
    is_solid = opaque[number] or width == 0
    values = np.zeros((3, 6))
    for sector in range(1, count):
        corner = (0, sector, sector + 1 if sector + 1 < count else 1)
        cx, cy = vertices[begin, 0] + dx, vertices[begin, 1] + dy
        ax, ay = vertices[begin + corner[1], 0] + dx, vertices[begin + corner[1], 1] + dy
        bx, by = vertices[begin + corner[2], 0] + dx, vertices[begin + corner[2], 1] + dy
        area = (ax - cx) * (by - cy) - (ay - cy) * (bx - cx)
        if area * orientation[number] <= 0:
            continue
        top, bottom = triangle_spans(cx, cy, ax, ay, bx, by, columns, rows, spans)
        if is_solid:
            for y in range(top, bottom):
                if open_samples[y] > 0:
                    for x in range(spans[y, 0], spans[y, 1]):
                        lit[y, x] *= 1 - coverage
            continue
        _fill(values, corner, begin, coords, inverse_w, tex_coords, width, height)
        a_x, a_y = (by - cy) / area, -(bx - cx) / area
        b_x, b_y = -(ay - cy) / area, (ax - cx) / area
        u_x, u_0, u_y = _plane(values, 0, a_x, a_y, b_x, b_y)
        v_x, v_0, v_y = _plane(values, 1, a_x, a_y, b_x, b_y)
        w_x, w_0, w_y = _plane(values, 5, a_x, a_y, b_x, b_y)
        for y in range(top, bottom):
            if open_samples[y] == 0:
                continue
            along = y + 0.5 - cy
            for x in range(spans[y, 0], spans[y, 1]):
                step = x + 0.5 - cx
                inverse = 1.0 / (w_0 + w_y * along + w_x * step)
                u, v = (u_0 + u_y * along + u_x * step) * inverse, (v_0 + v_y * along + v_x * step) * inverse
                alpha = _lookup(all_texels, offset, width, height, u, v)[3]
                lit[y, x] *= 1 - coverage * alpha


@numba.njit(cache=True, nogil=True, inline="never")
def _draw_background(tile, factor, background, strength, seen, lit, open_samples, out):
    """What is still open shows the background, in the light that is left."""
    texels, place, wraps, frame = background
    offset, width, height = place
    rows, columns = seen.shape
    for y in range(rows):
        if open_samples[y] == 0:
            continue
        for x in range(columns):
            through = seen[y, x]
            if through == 0:
                continue
            across, down = tile[0] + x + 0.5, tile[1] + y + 0.5
            u = _wrapped(frame[0] * across + frame[2] * down + frame[4], wraps[0]) * width
            v = (1 - _wrapped(frame[1] * across + frame[3] * down + frame[5], wraps[1])) * height
            r, g, b, alpha = _lookup_wrapped(texels, offset, width, height, u, v, wraps)
            light = through
            if strength > 0:
                light *= 1 - strength * (1 - lit[y, x])
            i, j = y // factor, x // factor
            out[i, j, 0] += light * r
            out[i, j, 1] += light * g
            out[i, j, 2] += light * b
            out[i, j, 3] += through * alpha


@numba.njit(cache=True, nogil=True)
def triangle_spans(cx, cy, ax, ay, bx, by, columns, rows, spans):
    """Samples whose centres lie in a triangle, row by row; returns first row and the one after the last."""
    top = max(0, int(np.ceil(min(max(min(cy, ay, by), -1.0), rows + 1.0) - 0.5)))
    bottom = min(rows, int(np.ceil(max(min(max(cy, ay, by), rows + 1.0), -1.0) - 0.5)))
    if top >= bottom or max(cx, ax, bx) < 0 or min(cx, ax, bx) > columns:
        return 0, 0
    for y in range(top, bottom):
        spans[y, 0], spans[y, 1] = columns, 0
    _edge(cx, cy, ax, ay, top, bottom, columns, spans)
    _edge(ax, ay, bx, by, top, bottom, columns, spans)
    _edge(bx, by, cx, cy, top, bottom, columns, spans)
    return top, bottom


@numba.njit(cache=True, nogil=True)
def _edge(px, py, qx, qy, top, bottom, columns, spans):
    """Widen the spans to where an edge crosses the rows; the same whichever of its ends comes first."""
    if py > qy or (py == qy and px > qx):
        px, py, qx, qy = qx, qy, px, py
    first = max(top, int(np.ceil(max(py, -1.0) - 0.5)))
    last = min(bottom, int(np.ceil(min(qy, bottom + 1.0) - 0.5)))
    if first >= last:
        return
    slope = (qx - px) / (qy - py)
    for y in range(first, last):
        x = min(max(px + (y + 0.5 - py) * slope, -1.0), columns + 1.0)
        column = min(max(int(np.ceil(x - 0.5)), 0), columns)
        spans[y, 0] = min(spans[y, 0], column)
        spans[y, 1] = max(spans[y, 1], column)


@numba.njit(cache=True, nogil=True)
def _fill(values, corner, begin, coords, inverse_w, tex_coords, width, height):
    """Place in the image, in texels from its upper left corner, and 1, over w, at the corners of a sector."""
    for k in range(3):
        w = inverse_w[begin + corner[k]] / inverse_w[begin]
        values[k, 0] = tex_coords[coords + corner[k], 0] * width * w
        values[k, 1] = (1 - tex_coords[coords + corner[k], 1]) * height * w
        values[k, 5] = w


@numba.njit(cache=True, nogil=True)
def _straight(texels, offset, width, height, u, v, is_opaque):
    """Straight colour and alpha of an image."""
    r, g, b, alpha = _lookup(texels, offset, width, height, u, v)
    if is_opaque:
        return r, g, b, np.float32(1)
    over = np.float32(1) / max(alpha, np.float32(1e-6))  # 1e-6 guards what is nearly transparent
    return r * over, g * over, b * over, alpha


@numba.njit(cache=True, nogil=True)
def _turned(r, g, number, vectors):
    """Encoded x and y of a vector that turns with its umbrella."""
    turns, zero_x, zero_y, aspect = vectors
    x, y = (r - zero_x) * aspect, g - zero_y
    return (
        (turns[number, 0, 0] * x + turns[number, 0, 1] * y) / aspect + zero_x,
        turns[number, 1, 0] * x + turns[number, 1, 1] * y + zero_y,
    )


@numba.njit(cache=True, nogil=True)
def _plane(values, k, a_x, a_y, b_x, b_y):
    """Slope along x, value at the centre and slope along y of what is interpolated in a sector."""
    to_a, to_b = values[1, k] - values[0, k], values[2, k] - values[0, k]
    return to_a * a_x + to_b * b_x, values[0, k], to_a * a_y + to_b * b_y


@numba.njit(cache=True, nogil=True)
def _lookup(texels, offset, width, height, u, v):
    """Bilinear, clamped; u, v in texels from the upper left corner."""
    x, y = min(max(u - 0.5, 0.0), width - 1.0), min(max(v - 0.5, 0.0), height - 1.0)
    column, row = int(x), int(y)
    right = 1 if column + 1 < width else 0
    below = width if row + 1 < height else 0
    return _mixed(texels, offset + row * width + column, right, below, np.float32(x - column), np.float32(y - row))


@numba.njit(cache=True, nogil=True)
def _lookup_wrapped(texels, offset, width, height, u, v, wraps):
    """Bilinear, across the seam where the image repeats."""
    x, y = u - 0.5, v - 0.5
    if wraps[0] != 0:
        x = min(max(x, 0.0), width - 1.0)
    elif x < 0:
        x += width
    if wraps[1] != 0:
        y = min(max(y, 0.0), height - 1.0)
    elif y < 0:
        y += height
    column, row = min(int(x), width - 1), min(int(y), height - 1)
    right = 1 if column + 1 < width else (-column if wraps[0] == 0 else 0)
    below = width if row + 1 < height else (-row * width if wraps[1] == 0 else 0)
    return _mixed(texels, offset + row * width + column, right, below, np.float32(x - column), np.float32(y - row))


@numba.njit(cache=True, nogil=True)
def _mixed(texels, corner, right, below, across, down):
    """Bilinear mean of four texels."""
    upper = (np.float32(1) - across) * (np.float32(1) - down)
    upper_right = across * (np.float32(1) - down)
    lower = (np.float32(1) - across) * down
    lower_right = across * down
    p, q, r, s = corner, corner + right, corner + below, corner + right + below
    return (
        upper * texels[p, 0] + upper_right * texels[q, 0] + lower * texels[r, 0] + lower_right * texels[s, 0],
        upper * texels[p, 1] + upper_right * texels[q, 1] + lower * texels[r, 1] + lower_right * texels[s, 1],
        upper * texels[p, 2] + upper_right * texels[q, 2] + lower * texels[r, 2] + lower_right * texels[s, 2],
        upper * texels[p, 3] + upper_right * texels[q, 3] + lower * texels[r, 3] + lower_right * texels[s, 3],
    )


@numba.njit(cache=True, nogil=True)
def _wrapped(coordinate, mode):
    """Within [0, 1]: 0 repeats, 1 clamps, 2 mirrors."""
    if mode == 0:
        return coordinate - np.floor(coordinate)
    if mode == 2:
        return abs(coordinate - 2 * np.floor(0.5 * coordinate + 0.5))
    return min(1.0, max(0.0, coordinate))
