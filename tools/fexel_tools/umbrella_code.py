"""An arrangement as few bytes: quantised finely enough that the picture stays the same, then deflated.

What it costs beside an explicit texture that is compressed too (Just-in-time texture synthesis, 2012, section 7.1) is
measured with this code; stages store full arrays.

Steps, and the largest errors that rounding makes: places 2^-16 of the unit square; directions 2 pi / 2^16; scales 2^-12
of their own size; morph weights 1/255; colours 1/256 in linear light. A matrix that is no similarity in cells of the
grid keeps its other entries in 32-bit floats. Bytes of like significance lie together; colours are stored as
differences from vertex to vertex, those that several umbrellas of a base share once.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fexel.textures.umbrella_arrangement import Arrangement

__all__ = ["COLOR_STEP", "ArrangementCode", "decode_arrangement", "encode_arrangement"]

COLOR_STEP = 1.0 / 256.0
_PLACES = 65536.0
_DIRECTIONS = 65536.0
_SCALES_PER_OCTAVE = 2048.0
_MORPHS = 255.0
_SIMILAR = 1e-6  # of a matrix's size, or of w: what a similarity may be off by, from float64 and the grid's division
_HEADER = struct.Struct("<I?")
_COUNT = struct.Struct("<I")


@dataclass(frozen=True)
class ArrangementCode:
    """An arrangement's numbers, deflated.

    Attributes
    ----------
    streams : tuple of bytes
        Header, shapes, places, directions and scales (or matrices), morphs, colours.
    """

    streams: tuple[bytes, ...]

    @property
    def nbytes(self) -> int:
        """Of all streams."""
        return sum(map(len, self.streams))


def encode_arrangement(arrangement: Arrangement) -> ArrangementCode:
    """Quantise and deflate what differs from umbrella to umbrella; the base shapes are not part of it."""
    matrices = _scaled_to_one(arrangement.matrices)
    cells = matrices[:, :2, :2] * np.array(arrangement.grid, np.float64)
    similar = _are_affine(matrices) and _are_similarities(cells)
    shapes = np.asarray(arrangement.shape_of)
    narrow = len(arrangement.shapes) <= 256
    parts = [_HEADER.pack(len(arrangement), similar), shapes.astype("<u1" if narrow else "<u4").tobytes()]
    if similar:
        place = np.rint((matrices[:, 2, :2] % 1.0) * _PLACES) % _PLACES
        turn = np.arctan2(cells[:, 0, 1], cells[:, 0, 0]) / (2 * np.pi)
        scale = np.log2(np.hypot(cells[:, 0, 0], cells[:, 0, 1]))
        parts += [
            _planes(place.astype("<u2")),
            _planes((np.rint(turn * _DIRECTIONS) % _DIRECTIONS).astype("<u2")),
            _planes(np.rint(scale * _SCALES_PER_OCTAVE).clip(-32768, 32767).astype("<i2")),
        ]
    else:
        parts += [_planes(arrangement.matrices.astype("<f4").reshape(-1, 9)), b"", b""]
    parts.append(np.rint(np.asarray(arrangement.morphs) * _MORPHS).astype("<u1").tobytes())
    parts.append(_encode_colors(arrangement))
    return ArrangementCode(tuple(zlib.compress(part, 9) for part in parts))


def decode_arrangement(code: ArrangementCode, like: Arrangement) -> Arrangement:
    """What a code holds, as an arrangement with the shapes, the grid and the settings of `like`."""
    parts = [zlib.decompress(stream) for stream in code.streams]
    count, similar = _HEADER.unpack(parts[0])
    shape_of = np.frombuffer(parts[1], "<u1" if len(like.shapes) <= 256 else "<u4").astype(np.int32)
    if similar:
        matrices = _similarities(
            _unplaned(parts[2], "<u2", (count, 2)) / _PLACES,
            _unplaned(parts[3], "<u2", (count,)) * (2 * np.pi / _DIRECTIONS),
            2.0 ** (_unplaned(parts[4], "<i2", (count,)) / _SCALES_PER_OCTAVE),
            like.grid,
        )
    else:
        matrices = _unplaned(parts[2], "<f4", (count, 9)).astype(np.float64).reshape(-1, 3, 3)
    morphs = np.frombuffer(parts[5], "<u1") / _MORPHS
    decoded = replace(like, shape_of=shape_of, matrices=matrices, morphs=morphs)
    return replace(decoded, colors=_decode_colors(parts[6], decoded))


def _scaled_to_one(matrices: NDArray[np.floating]) -> NDArray[np.float64]:
    """(n, 3, 3) matrices from patch space to st, scaled to w = 1 at the centre; as they are where w is 0 there."""
    matrices = np.asarray(matrices, np.float64)
    w = np.where(matrices[:, 2, 2] == 0, 1.0, matrices[:, 2, 2])
    return matrices / w[:, None, None]


def _are_affine(matrices: NDArray[np.float64]) -> bool:
    """Whether w is 1 all over the patches, which reach about as far as 1 from the centre."""
    return bool((np.abs(matrices[:, :, 2] - (0.0, 0.0, 1.0)) <= _SIMILAR).all())


def _are_similarities(cells: NDArray[np.float64]) -> bool:
    a, b, c, d = cells.reshape(-1, 4).T
    size = np.hypot(a, b)
    off = np.maximum(abs(a - d), abs(b + c))
    return bool(np.isfinite(size).all() and (size > 0).all() and (off <= _SIMILAR * size).all())


def _similarities(
    place: NDArray[np.float64], turn: NDArray[np.float64], scale: NDArray[np.float64], grid: tuple[int, int]
) -> NDArray[np.float64]:
    matrices = np.zeros((len(turn), 3, 3))
    cosine, sine = scale * np.cos(turn), scale * np.sin(turn)
    matrices[:, 0, 0], matrices[:, 0, 1] = cosine / grid[0], sine / grid[1]
    matrices[:, 1, 0], matrices[:, 1, 1] = -sine / grid[0], cosine / grid[1]
    matrices[:, 2, :2], matrices[:, 2, 2] = place, 1.0
    return matrices


def _encode_colors(arrangement: Arrangement) -> bytes:
    """Per base: how many sets there are, which set each of its umbrellas has, and the sets."""
    if not len(arrangement.colors):
        return b""
    steps = np.rint(arrangement.colors.astype(np.float64) / COLOR_STEP).astype(np.int64)
    parts = []
    for number, users in _users(arrangement):
        vertices = len(arrangement.shapes[number].points)
        rows = arrangement.first_vertex[users][:, None] + np.arange(vertices)
        sets, chosen = np.unique(steps[rows].reshape(len(users), -1), axis=0, return_inverse=True)
        difference = np.diff(sets.reshape(-1, vertices, 3), axis=1, prepend=0)
        zigzag = np.where(difference < 0, -2 * difference - 1, 2 * difference)
        parts += [_COUNT.pack(len(sets)), _planes(chosen.astype("<u4")), _planes(zigzag.T.astype("<u2"))]
    return b"".join(parts)


def _decode_colors(data: bytes, arrangement: Arrangement) -> NDArray[np.float32]:
    if not data:
        return np.zeros((0, 3), np.float32)
    colors, at = np.zeros((int(arrangement.first_vertex[-1]), 3), np.float32), 0
    for number, users in _users(arrangement):
        vertices = len(arrangement.shapes[number].points)
        (count,) = _COUNT.unpack_from(data, at)
        at += _COUNT.size
        chosen = _unplaned(data[at : at + 4 * len(users)], "<u4", (len(users),))
        at += 4 * len(users)
        size = 2 * 3 * vertices * count
        zigzag = _unplaned(data[at : at + size], "<u2", (3, vertices, count)).astype(np.int64)
        at += size
        difference = np.where(zigzag % 2, -(zigzag + 1) // 2, zigzag // 2)
        sets = np.cumsum(difference, axis=1).T * COLOR_STEP
        colors[arrangement.first_vertex[users][:, None] + np.arange(vertices)] = sets[chosen]
    return colors


def _users(arrangement: Arrangement) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Number of each base, and which umbrellas show it; those that none shows are left out."""
    for number in range(len(arrangement.shapes)):
        users = np.flatnonzero(arrangement.shape_of == number)
        if len(users):
            yield number, users


def _planes(values: NDArray) -> bytes:
    """Bytes of like significance together."""
    flat = np.ascontiguousarray(values).view(np.uint8).reshape(-1, values.dtype.itemsize)
    return flat.T.tobytes()


def _unplaned(data: bytes, dtype: str, shape: Sequence[int]) -> NDArray:
    size = np.dtype(dtype).itemsize
    flat = np.frombuffer(data, np.uint8).reshape(size, -1).T
    return np.ascontiguousarray(flat).view(dtype).reshape(shape)
