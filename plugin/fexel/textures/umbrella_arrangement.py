"""Umbrellas and where they lie, as plain arrays: what prims are read into, tools author, twin and GPU evaluate.

An umbrella is a star-shaped polygon about a centre, vertex 0, which sees its contour, vertices 1 to V - 1
(Just-in-time texture synthesis, 2012, section 4.1); the centre counts as a vertex (notes U3). A `Shape` is a base
umbrella, an `Arrangement` many modified ones, front to back. Its unit square repeats: an umbrella that leaves it comes
in again on the other side.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fexel.textures.image_source import ImageSource

__all__ = ["Arrangement", "Shape"]


@dataclass(frozen=True, eq=False)
class Shape:
    """A base umbrella: ``UmbrellaPatch``.

    Attributes
    ----------
    points : (V, 2) float64
        Patch space: the centre, then the contour, counter-clockwise.
    morph_points : (V, 2) float64
        The shape at a morph of 1; `points` where there is no other.
    tex_coords : (V, 2) float64
        Of the image, origin at its lower left.
    image : ImageSource or None
        None: no texture, the colours of vertices are the colour itself.
    """

    points: NDArray[np.float64]
    morph_points: NDArray[np.float64]
    tex_coords: NDArray[np.float64]
    image: ImageSource | None = None


@dataclass(frozen=True, eq=False)
class Arrangement:
    """Modified umbrellas over the unit square of st, the first on top. Equal ones compare and hash equal.

    Attributes
    ----------
    shapes : tuple of Shape
    shape_of : (n,) int32
        Index in `shapes` of each umbrella.
    matrices : (n, 3, 3) float64
        Patch space to st, row vectors, ``[x y 1] @ M``, then divided by w.
    morphs : (n,) float64
        In [0, 1].
    colors : (total, 3) float32
        Per umbrella and vertex, centre first: signed offsets in linear light, or the colour itself where the shape has
        no image. (0, 3): none.
    grid : (int, int)
        Cells along s and t: the unit of levels of detail and of the storage formula.
    color_blend : float
        f of c = clamp(c_texture + f c_vertices).
    shadow_offset : (float, float)
        In st: a point lies in the shadow of an umbrella that covers the point minus the offset.
    shadow_strength : float
        Share of light that a shadow takes away, in [0, 1].
    coverages : (n,) float64
        Alpha of each umbrella; 1 but for merged ones.
    """

    shapes: tuple[Shape, ...]
    shape_of: NDArray[np.int32]
    matrices: NDArray[np.float64]
    morphs: NDArray[np.float64]
    colors: NDArray[np.float32]
    grid: tuple[int, int] = (1, 1)
    color_blend: float = 1.0
    shadow_offset: tuple[float, float] = (0.0, 0.0)
    shadow_strength: float = 0.0
    coverages: NDArray[np.float64] = field(default_factory=lambda: np.ones(0))

    @cached_property
    def digest(self) -> str:
        """Of all that it holds."""
        state = hashlib.blake2b()
        for part in _parts(self):
            state.update(part)
        return state.hexdigest()

    @cached_property
    def neutral(self) -> Arrangement:
        """The same umbrellas, coloured in full, without shadows: what all states of an animated look share."""
        return replace(self, color_blend=1.0, shadow_offset=(0.0, 0.0), shadow_strength=0.0)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Arrangement) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    def __len__(self) -> int:
        return len(self.shape_of)

    @cached_property
    def vertex_counts(self) -> NDArray[np.int64]:
        """(n,) vertices of each umbrella, the centre included."""
        counts = np.array([len(shape.points) for shape in self.shapes], np.int64)
        return counts[self.shape_of] if len(self) else np.zeros(0, np.int64)

    @cached_property
    def first_vertex(self) -> NDArray[np.int64]:
        """(n + 1,) where the vertices of each umbrella begin in `colors`, `points` and `vertices`."""
        return np.concatenate([[0], np.cumsum(self.vertex_counts)])

    @cached_property
    def shape_vertex(self) -> NDArray[np.int64]:
        """(total,) which vertex of its shape each vertex is, counted through all `shapes`."""
        counts = [len(shape.points) for shape in self.shapes]
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        shift = first[self.shape_of] - self.first_vertex[:-1] if len(self) else np.zeros(0, np.int64)
        return np.arange(self.first_vertex[-1]) + np.repeat(shift, self.vertex_counts)

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """(total, 2) all vertices in patch space, morphed."""
        if not len(self):
            return np.zeros((0, 2))
        rest = np.concatenate([shape.points for shape in self.shapes])
        way = np.concatenate([shape.morph_points for shape in self.shapes]) - rest
        points = rest[self.shape_vertex]
        if self.morphs.any() and way.any():
            points += np.repeat(self.morphs, self.vertex_counts)[:, None] * way[self.shape_vertex]
        return points

    @cached_property
    def vertices(self) -> NDArray[np.float64]:
        """(total, 2) all vertices in st, morphed and placed; not wrapped."""
        x, y = self.points.T
        # Column by column: a matrix per vertex would be nine numbers for two.
        placed = np.empty_like(self.points)
        placed[:, 0], placed[:, 1] = self._mapped(x, y, 0), self._mapped(x, y, 1)
        if not self.is_affine:
            placed /= self._mapped(x, y, 2)[:, None]
        return placed

    @cached_property
    def is_affine(self) -> bool:
        """Whether no matrix has a perspective part."""
        return bool((self.matrices[:, :, 2] == (0.0, 0.0, 1.0)).all())

    def _mapped(self, x: NDArray[np.float64], y: NDArray[np.float64], column: int) -> NDArray[np.float64]:
        """One homogeneous coordinate of every vertex."""
        along_x, along_y, offset = (np.repeat(self.matrices[:, row, column], self.vertex_counts) for row in range(3))
        return x * along_x + y * along_y + offset


def _parts(value: Any) -> Iterator[bytes]:
    """Bytes that tell apart what differs."""
    if isinstance(value, np.ndarray):
        yield f"{value.dtype}{value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, Shape | Arrangement):
        for part in fields(value):
            yield from _parts(getattr(value, part.name))
    elif isinstance(value, tuple):
        yield str(len(value)).encode()
        for item in value:
            yield from _parts(item)
    else:
        yield repr(value).encode()
