"""Kernels of the raster: one tile of samples, front to back, sector by sector.

Sectors of an umbrella are triangles, filled in rows: a sample belongs to the one triangle that its centre lies in,
neighbours share edges computed alike, so that nothing is drawn twice and nothing between them is missed. Colours of
samples go into the sums of their pixels right away; per sample only two numbers are kept: what is yet seen
(transmittance), and how much light the umbrellas in front let through.
"""

from __future__ import annotations

import numba
import numpy as np

from fexel_tools.umbrella_raster_lookup import lookup, lookup_wrapped, plane, sector_values, straight, turned, wrapped
from fexel_tools.umbrella_raster_shared import draw_shared
from fexel_tools.umbrella_raster_spans import (
    BLOCK,
    MOST_CROSSINGS,
    OPAQUE,
    any_open,
    contour_crossings,
    is_hidden,
    open_blocks,
    triangle_spans,
)

__all__ = ["draw_tile"]


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
    placed : (first, vertices, inverse_w, orientation, coverages, is_star)
    shapes : (shape_of (n,), first (b + 1,), tex_coords (total, 2))
    colors : (total, 3) float32
        Or (0, 3).
    blend : float
    texels : (texels (N, 4), place (n, 3), opaque (n,), is_shared (n,), group)
        The last two as `fexel_tools.umbrella_raster_shared` has them.
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
    is_shared, group = texels[3], texels[4]
    cells, planes = np.zeros((rows // group, columns // group, 4)), np.empty((MOST_CROSSINGS + 1, 19))
    seen = np.ones((rows, columns), np.float32)
    lit = np.ones((rows if strength > 0 else 1, columns if strength > 0 else 1), np.float32)
    open_samples = np.full(rows, columns, np.int64)
    still_open = rows * columns
    blocks = open_blocks(rows, columns)
    spans, crossings = np.empty((rows, 2), np.int64), np.empty((rows, MOST_CROSSINGS), np.int64)
    umbrella, shift = copies
    for entry in listed:
        number = umbrella[entry]
        dx, dy = shift[entry, 0] - x0, shift[entry, 1] - y0
        if is_shared[number]:
            still_open -= draw_shared(
                number, dx, dy, factor, placed, shapes, colors, blend, texels, vectors, strength, seen,
                lit, open_samples, blocks, spans, crossings, cells, planes, out,
            )  # fmt: skip
        else:
            still_open -= _draw_umbrella(
                number, dx, dy, factor, placed, shapes, colors, blend, texels, vectors, strength, seen,
                lit, open_samples, blocks, spans, out,
            )  # fmt: skip
        if still_open == 0:
            return
        if strength > 0:
            _cast_shadow(
                number, dx + shadow[0], dy + shadow[1], placed, shapes, texels,
                seen, lit, open_samples, blocks, spans, crossings,
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
    blocks,
    spans,
    out,
):
    """Add an umbrella to the sums; returns how many samples it closed."""
    first, vertices, inverse_w, orientation, coverages, _ = placed
    shape_of, shape_first, tex_coords = shapes
    all_texels, places, opaque, _, _ = texels
    rows, columns = seen.shape
    begin, count = first[number], first[number + 1] - first[number]
    if is_hidden(vertices[begin : begin + count], dx, dy, blocks):
        return 0
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
        if area * orientation[number] <= 0 or not any_open(
            min(cx, ax, bx), min(cy, ay, by), max(cx, ax, bx), max(cy, ay, by), blocks
        ):
            continue
        top, bottom = triangle_spans(cx, cy, ax, ay, bx, by, columns, rows, spans)
        if top >= bottom:
            continue
        sector_values(values, corner, begin, coords, inverse_w, tex_coords, width, height)
        if has_color:
            for k in range(3):
                for c in range(3):
                    values[k, 2 + c] = colors[begin + corner[k], c] * blend * values[k, 5]
        # Barycentric weights of a and b are linear in x and y.
        a_x, a_y = (by - cy) / area, -(bx - cx) / area
        b_x, b_y = -(ay - cy) / area, (ax - cx) / area
        u_x, u_0, u_y = plane(values, 0, a_x, a_y, b_x, b_y)
        v_x, v_0, v_y = plane(values, 1, a_x, a_y, b_x, b_y)
        r_x, r_0, r_y = plane(values, 2, a_x, a_y, b_x, b_y)
        g_x, g_0, g_y = plane(values, 3, a_x, a_y, b_x, b_y)
        l_x, l_0, l_y = plane(values, 4, a_x, a_y, b_x, b_y)
        w_x, w_0, w_y = plane(values, 5, a_x, a_y, b_x, b_y)
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
                        r, g, b, alpha = straight(all_texels, offset, width, height, u, v, is_opaque)
                        if alpha <= 0:
                            continue
                    if has_color:
                        r += (r_row + r_x * step) * inverse
                        g += (g_row + g_x * step) * inverse
                        b += (l_row + l_x * step) * inverse
                    r, g, b = min(1.0, max(0.0, r)), min(1.0, max(0.0, g)), min(1.0, max(0.0, b))
                    if is_turned:
                        r, g = turned(r, g, number, vectors)
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
                    if through < OPAQUE:
                        through = 0.0
                        closed += 1
                        open_samples[y] -= 1
                        blocks[y // BLOCK, x // BLOCK] -= 1
                    seen[y, x] = through
                out[pixel_row, pixel, 0] += sum_r
                out[pixel_row, pixel, 1] += sum_g
                out[pixel_row, pixel, 2] += sum_b
                out[pixel_row, pixel, 3] += sum_a
    return closed


@numba.njit(cache=True, nogil=True, inline="never")
def _cast_shadow(number, dx, dy, placed, shapes, texels, seen, lit, open_samples, blocks, spans, crossings):
    """Take away the light that an umbrella, moved to where its shadow falls, keeps from what lies behind it."""
    first, vertices, inverse_w, orientation, coverages, is_star = placed
    shape_of, shape_first, tex_coords = shapes
    all_texels, places, opaque, _, _ = texels
    rows, columns = lit.shape
    begin, count = first[number], first[number + 1] - first[number]
    coords = shape_first[shape_of[number]]
    offset, width, height = places[number]
    coverage = coverages[number]
    is_solid = opaque[number] or width == 0
    corners = vertices[begin : begin + count]
    if is_hidden(corners, dx, dy, blocks):
        return
    if is_solid and is_star[number]:
        top, bottom = contour_crossings(corners, dx, dy, columns, crossings, spans)
        for y in range(top, bottom):
            if open_samples[y] > 0:
                _darken(lit[y], crossings[y], spans[y, 0], 1 - coverage)
        return
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
        sector_values(values, corner, begin, coords, inverse_w, tex_coords, width, height)
        a_x, a_y = (by - cy) / area, -(bx - cx) / area
        b_x, b_y = -(ay - cy) / area, (ax - cx) / area
        u_x, u_0, u_y = plane(values, 0, a_x, a_y, b_x, b_y)
        v_x, v_0, v_y = plane(values, 1, a_x, a_y, b_x, b_y)
        w_x, w_0, w_y = plane(values, 5, a_x, a_y, b_x, b_y)
        for y in range(top, bottom):
            if open_samples[y] == 0:
                continue
            along = y + 0.5 - cy
            for x in range(spans[y, 0], spans[y, 1]):
                if seen[y, x] == 0:
                    continue
                step = x + 0.5 - cx
                inverse = 1.0 / (w_0 + w_y * along + w_x * step)
                u, v = (u_0 + u_y * along + u_x * step) * inverse, (v_0 + v_y * along + v_x * step) * inverse
                alpha = lookup(all_texels, offset, width, height, u, v)[3]
                lit[y, x] *= 1 - coverage * alpha


@numba.njit(cache=True, nogil=True)
def _darken(lit, crossings, count, factor):
    """Light of a row, inside a contour that crosses it so often."""
    for k in range(0, count - 1, 2):
        for x in range(crossings[k], crossings[k + 1]):
            lit[x] *= factor


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
            u = wrapped(frame[0] * across + frame[2] * down + frame[4], wraps[0]) * width
            v = (1 - wrapped(frame[1] * across + frame[3] * down + frame[5], wraps[1])) * height
            r, g, b, alpha = lookup_wrapped(texels, offset, width, height, u, v, wraps)
            light = through
            if strength > 0:
                light *= 1 - strength * (1 - lit[y, x])
            i, j = y // factor, x // factor
            out[i, j, 0] += light * r
            out[i, j, 1] += light * g
            out[i, j, 2] += light * b
            out[i, j, 3] += through * alpha
