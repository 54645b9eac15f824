"""Opaque umbrellas whose samples share colours: coverage and shadow sample by sample, colour once per group of them.

A group of G x G samples takes the colour of an umbrella where the centroid of its visible samples lies, from the mip
level whose texels are about as wide as the group. The contour is filled as a whole; sectors, of which most are narrower
than a pixel, are searched once per group, beginning with that of the group before.
"""

from __future__ import annotations

import numba
import numpy as np

from fexel_tools.umbrella_raster_lookup import plane, sector_values, straight, turned
from fexel_tools.umbrella_raster_spans import BLOCK, OPAQUE, contour_crossings, is_hidden

__all__ = ["draw_shared"]


@numba.njit(cache=True, nogil=True, inline="never")
def draw_shared(
    number, dx, dy, factor, placed, shapes, colors, blend, texels, vectors, strength, seen, lit, open_samples, blocks,
    spans, crossings, cells, planes, out,
):  # fmt: skip
    """Add an umbrella, a star without transparent texels, to the sums; returns how many samples it closed.

    Parameters
    ----------
    cells : (rows / G, columns / G, 4) float64
        Zero, before and after: light, weight, and weighted x and y of the samples of each group.
    planes : (64 + 1, 19) float64
        Scratch: six quantities of each sector (`sector_values`) at the centre and along x and y; whether made.
    number, dx, dy, factor, placed, shapes, colors, blend, texels, vectors, strength, seen, lit, open_samples, blocks,
    spans, crossings, out
        As `fexel_tools.umbrella_raster_kernels` has them.
    """
    first, vertices = placed[0], placed[1]
    group = texels[4]
    columns = seen.shape[1]
    begin, count = first[number], first[number + 1] - first[number]
    corners = vertices[begin : begin + count]
    if is_hidden(corners, dx, dy, blocks):
        return 0
    top, bottom = contour_crossings(corners, dx, dy, columns, crossings, spans)
    closed, left, right = 0, columns, 0
    for y in range(top, bottom):
        if open_samples[y] == 0:
            continue
        for k in range(0, spans[y, 0] - 1, 2):
            low, high = crossings[y, k], crossings[y, k + 1]
            if low < high:
                found = _cover_row(y, low, high, group, placed[4][number], strength, seen, lit, blocks, cells)
                closed += found
                open_samples[y] -= found
                left, right = min(left, low), max(right, high)
    if left < right:
        _color_cells(
            number, dx, dy, factor, placed, shapes, colors, blend, texels, vectors, cells, planes, out,
            (left // group, top // group, (right - 1) // group + 1, (bottom - 1) // group + 1),
        )  # fmt: skip
    return closed


@numba.njit(cache=True, nogil=True)
def _cover_row(y, low, high, group, coverage, strength, seen, lit, blocks, cells):
    """Take what is seen of samples low to high of a row into their groups; returns how many are closed by that."""
    closed = 0
    for cell in range(low // group, (high - 1) // group + 1):
        light, weight, along = 0.0, 0.0, 0.0
        for x in range(max(low, cell * group), min(high, cell * group + group)):
            through = seen[y, x]
            if through == 0:
                continue
            share = through * coverage
            weight += share
            along += share * (x + 0.5)
            light += share * (1 - strength * (1 - lit[y, x])) if strength > 0 else share
            through *= 1 - coverage
            if through < OPAQUE:
                through = 0.0
                closed += 1
                blocks[y // BLOCK, x // BLOCK] -= 1
            seen[y, x] = through
        if weight > 0:
            row = y // group
            cells[row, cell, 0] += light
            cells[row, cell, 1] += weight
            cells[row, cell, 2] += along
            cells[row, cell, 3] += weight * (y + 0.5)
    return closed


@numba.njit(cache=True, nogil=True)
def _color_cells(
    number, dx, dy, factor, placed, shapes, colors, blend, texels, vectors, cells, planes, out, box
):  # fmt: skip
    """Colour the groups in a box, add them to the sums and empty them."""
    first, vertices, _, orientation, _, _ = placed
    offset, width, height = texels[1][number]
    begin, count = first[number], first[number + 1] - first[number]
    cx, cy, sign = vertices[begin, 0] + dx, vertices[begin, 1] + dy, orientation[number]
    has_color, is_turned = len(colors) > 0 and blend != 0, len(vectors[0]) > 0
    planes[:count, 18] = 0  # 1: made
    group = texels[4]
    sector, values = 1, np.zeros((3, 6))
    for j in range(box[1], box[3]):
        for i in range(box[0], box[2]):
            weight = cells[j, i, 1]
            if weight == 0:
                continue
            x, y = cells[j, i, 2] / weight - cx, cells[j, i, 3] / weight - cy
            sector = _sector_of(x, y, sector, vertices, begin, count, sign)
            p = planes[sector]
            if p[18] == 0:
                _make_planes(number, sector, placed, shapes, colors, blend, width, height, values, p)
            inverse = 1.0 / (p[15] + p[16] * x + p[17] * y)
            r, g, b = np.float32(0), np.float32(0), np.float32(0)
            if width > 0:
                u, v = (p[0] + p[1] * x + p[2] * y) * inverse, (p[3] + p[4] * x + p[5] * y) * inverse
                r, g, b, _ = straight(texels[0], offset, width, height, u, v, True)
            if has_color:
                r += (p[6] + p[7] * x + p[8] * y) * inverse
                g += (p[9] + p[10] * x + p[11] * y) * inverse
                b += (p[12] + p[13] * x + p[14] * y) * inverse
            r, g, b = min(1.0, max(0.0, r)), min(1.0, max(0.0, g)), min(1.0, max(0.0, b))
            if is_turned:
                r, g = turned(r, g, number, vectors)
            light = cells[j, i, 0]
            pixel = out[j * group // factor, i * group // factor]
            pixel[0] += light * r
            pixel[1] += light * g
            pixel[2] += light * b
            pixel[3] += weight
            cells[j, i] = 0


@numba.njit(cache=True, nogil=True)
def _sector_of(x, y, sector, vertices, begin, count, sign):
    """Sector of a star in the direction (x, y) of its centre, searched from another one on; never one without area."""
    cx, cy = vertices[begin, 0], vertices[begin, 1]
    for _ in range(2 * count):
        following = sector + 1 if sector + 1 < count else 1
        ax, ay = vertices[begin + sector, 0] - cx, vertices[begin + sector, 1] - cy
        bx, by = vertices[begin + following, 0] - cx, vertices[begin + following, 1] - cy
        if sign * (ax * by - ay * bx) <= 0 or sign * (x * by - y * bx) < 0:
            sector = following
        elif sign * (ax * y - ay * x) < 0:
            sector = sector - 1 if sector > 1 else count - 1
        else:
            break
    return sector


@numba.njit(cache=True, nogil=True)
def _make_planes(number, sector, placed, shapes, colors, blend, width, height, values, made):
    """What a sector interpolates, by distance from its centre."""
    first, vertices, inverse_w, _, _, _ = placed
    begin, count = first[number], first[number + 1] - first[number]
    corner = (0, sector, sector + 1 if sector + 1 < count else 1)
    sector_values(values, corner, begin, shapes[1][shapes[0][number]], inverse_w, shapes[2], width, height)
    if len(colors) > 0 and blend != 0:
        for k in range(3):
            for c in range(3):
                values[k, 2 + c] = colors[begin + corner[k], c] * blend * values[k, 5]
    ax, ay = vertices[begin + corner[1], 0] - vertices[begin, 0], vertices[begin + corner[1], 1] - vertices[begin, 1]
    bx, by = vertices[begin + corner[2], 0] - vertices[begin, 0], vertices[begin + corner[2], 1] - vertices[begin, 1]
    area = ax * by - ay * bx
    for k in range(6):
        made[3 * k + 1], made[3 * k], made[3 * k + 2] = plane(values, k, by / area, -bx / area, -ay / area, ax / area)
    made[18] = 1
