"""What a view sees of a draw, in float64: which texture coordinates at which footprint, and re-based vertices for deep
zoom.

The triangles of a draw are clipped to the view (near plane included) and cut into pieces that are small on screen, so
that bounds of `st` and the Jacobian d(st)/d(pixel) are tight even where the view is grazing. From these a texture
decides what to load. Where float32 would misplace texture coordinates by more than `MAX_ERROR_PX` pixels, the clipped
triangles are returned as vertices of their own: clip-space positions and `st` relative to the view (`StFrame`), both
computed in float64, so that what the GPU interpolates is small and exact.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fexel.renderer.clipping import clip_triangles, frustum_codes, frustum_planes
from fexel.scene.model import Draw

__all__ = [
    "MAX_ERROR_PX",
    "Pieces",
    "RebasedMesh",
    "StFrame",
    "View",
    "VisibleSurface",
    "merged_pieces",
    "visible_surface",
]

# Largest error of a texture coordinate in float32 that is tolerated before vertices are re-based, in pixels.
MAX_ERROR_PX = 0.001
# Beyond so many visible triangles each is small, so float32 suffices on any mesh that was modelled in float32.
_MAX_REBASED_TRIANGLES = 200_000
# Texture coordinates just outside the view that multisampling and derivatives may touch, in pixels.
_MARGIN_PX = 2.0
_PIECE_PX = 48.0
_MAX_DEPTH_RATIO = 1.25
_MAX_SPLITS = 14
_MAX_PIECES = 6000
_MERGE_CELLS = 64
# Stands in for the corners (x w, y w, w) of triangles that are left out.
_ANY_TRIANGLE = np.array([[1.0, 0, 1], [0, 1, 1], [0, 0, 1]])


@dataclass(frozen=True, eq=False)
class View:
    """A tile of the picture: `world_to_clip` maps it to [-1, 1]^2 (row vectors, float64); size in pixels."""

    world_to_clip: NDArray[np.float64]
    width: int
    height: int


@dataclass(frozen=True)
class StFrame:
    """Local texture coordinates: ``st = origin + local / scale``."""

    origin: tuple[float, float] = (0.0, 0.0)
    scale: float = 1.0

    @property
    def local_to_st(self) -> NDArray[np.float64]:
        """(3, 3) float64 for row vectors."""
        return np.array([[1 / self.scale, 0, 0], [0, 1 / self.scale, 0], [*self.origin, 1]])


@dataclass(frozen=True, eq=False)
class Pieces:
    """What is seen of a primvar.

    Attributes
    ----------
    st_min, st_max : (P, 2) float64
        Bounds of each piece.
    jacobian : (P, 3, 2, 2) float64
        d(st)/d(pixel) at three places of it that bound its footprint; column j is per pixel along x, y.
    """

    st_min: NDArray[np.float64]
    st_max: NDArray[np.float64]
    jacobian: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RebasedMesh:
    """Clipped triangles whose positions and texture coordinates are relative to the view; float32.

    Attributes
    ----------
    clip_position : (M, 4)
    world_position, normal : (M, 3)
        World space; the normal has unit length.
    display_color : (M, 3) or None
    display_opacity : (M, 1) or None
    st : dict of str to (M, 2)
        Local to `VisibleSurface.st_frames`.
    triangles : (K, 3) int32
    """

    clip_position: NDArray[np.float32]
    world_position: NDArray[np.float32]
    normal: NDArray[np.float32]
    display_color: NDArray[np.float32] | None
    display_opacity: NDArray[np.float32] | None
    st: dict[str, NDArray[np.float32]]
    triangles: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class VisibleSurface:
    """What a view sees of one draw; see the module."""

    pieces: dict[str, Pieces]
    st_frames: dict[str, StFrame] = field(default_factory=dict)
    rebased: RebasedMesh | None = None


@dataclass(frozen=True, eq=False)
class _Triangles:
    """Visible triangles, some cut: `weights` (K, 3, 3) of each corner in mesh triangle `source`, and clip positions."""

    indices: NDArray[np.int32]
    weights: NDArray[np.float64] | None
    clip: NDArray[np.float64]

    def interpolate(self, values: NDArray) -> NDArray[np.float64]:
        """(K, 3, C) of a vertex attribute (V, C)."""
        corners = np.asarray(values, np.float64)[self.indices]
        return corners if self.weights is None else self.weights @ corners


def visible_surface(draw: Draw, view: View, primvars: Iterable[str] = ()) -> VisibleSurface | None:
    """Clip a draw to a view.

    Parameters
    ----------
    draw : Draw
    view : View
    primvars : iterable of str
        Names of the texture coordinates that the draw's textures use; ones the mesh lacks are left out.

    Returns
    -------
    VisibleSurface or None
        None when nothing of the draw is in view, or it covers no sample: seen exactly edge-on, or tiny and far off.
    """
    triangles = _visible_triangles(draw, view)
    if triangles is None:
        return None
    names = [name for name in dict.fromkeys(primvars) if name in draw.mesh.st]
    corners = {name: triangles.interpolate(draw.mesh.st[name]) for name in names}
    pieces = {name: _pieces(triangles.clip, st, view) for name, st in corners.items()}
    if names and not any(len(seen.st_min) for seen in pieces.values()):
        return None
    deep = len(triangles.clip) <= _MAX_REBASED_TRIANGLES and any(
        _float32_error_px(pieces[name], draw.mesh.st[name]) > MAX_ERROR_PX for name in names
    )
    if not deep:
        return VisibleSurface(pieces, {name: StFrame() for name in names})
    frames = {name: _frame(st, pieces[name]) for name, st in corners.items()}
    return VisibleSurface(pieces, frames, _rebase(draw, triangles, corners, frames))


def _visible_triangles(draw: Draw, view: View) -> _Triangles | None:
    mesh = draw.mesh
    indices = mesh.triangles[draw.first_triangle : draw.first_triangle + draw.triangle_count]
    object_to_clip = draw.object_to_world @ view.world_to_clip
    clip = np.asarray(mesh.points, np.float64) @ object_to_clip[:3] + object_to_clip[3]
    planes = frustum_planes((2 * _MARGIN_PX / view.width, 2 * _MARGIN_PX / view.height))
    codes = frustum_codes(clip, planes)[indices]
    indices = indices[(codes[:, 0] & codes[:, 1] & codes[:, 2]) == 0]
    if not len(indices):
        return None
    codes = codes[(codes[:, 0] & codes[:, 1] & codes[:, 2]) == 0]
    crossing = (codes[:, 0] | codes[:, 1] | codes[:, 2]) != 0
    if not crossing.any():
        return _Triangles(indices, None, clip[indices])
    cut = indices[crossing]
    source, weights = clip_triangles(clip[cut], planes)
    whole = indices[~crossing]
    indices = np.concatenate([whole, cut[source]])
    if not len(indices):
        return None
    weights = np.concatenate([np.broadcast_to(np.eye(3), (len(whole), 3, 3)), weights])
    return _Triangles(indices, weights, weights @ clip[indices])


def _pieces(clip: NDArray[np.float64], st: NDArray[np.float64], view: View) -> Pieces:
    """Cut triangles until they are small on screen, or merge them when they are many."""
    half = np.array([view.width, view.height]) / 2
    if len(clip) > _MAX_PIECES:
        return merged_pieces(clip, st, half)
    done: list[tuple[NDArray, NDArray]] = []
    total = 0
    for _ in range(_MAX_SPLITS):
        large = _is_large(clip, half)
        done.append((clip[~large], st[~large]))
        total += int((~large).sum())
        clip, st = clip[large], st[large]
        if not len(clip) or total + 4 * len(clip) > _MAX_PIECES:
            break
        clip, st = _split(clip), _split(st)
    done.append((clip, st))
    clip, st = (np.concatenate(arrays) for arrays in zip(*done, strict=True))
    jacobian, regular = _corner_jacobians(clip, st, half)
    return Pieces(st.min(axis=1)[regular], st.max(axis=1)[regular], jacobian[regular])


def _screen(clip: NDArray[np.float64], half: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pixels, origin at the centre of the view."""
    # Clipping to the near plane leaves w > 0; the bound only guards a camera whose near plane lies at its eye.
    return clip[..., :2] / np.maximum(clip[..., 3:], 1e-300) * half


def _is_large(clip: NDArray[np.float64], half: NDArray[np.float64]) -> NDArray[np.bool_]:
    screen = _screen(clip, half)
    size = np.ptp(screen, axis=1).max(axis=1)
    w = clip[..., 3]
    return (size > _PIECE_PX) | ((w.max(axis=1) > _MAX_DEPTH_RATIO * w.min(axis=1)) & (size > 4.0))


def _split(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Each triangle into four by the midpoints of its edges."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])


def _corner_jacobians(
    clip: NDArray[np.float64], st: NDArray[np.float64], half: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """d(st)/d(pixel) at the corners of perspective triangles (T, 3, 2, 2), and which are not edge-on.

    With rows [x w, y w, w] of the corners in A and [s, t, 1] in B, ``[x y 1] A^-1 B`` is st in homogeneous coordinates.
    """
    origin = st[:, :1]
    rows = np.concatenate([clip[..., :2] * half, clip[..., 3:]], axis=-1)
    rows = rows / np.maximum(np.abs(rows[..., 2:]).max(axis=1, keepdims=True), 1e-300)
    determinant = np.linalg.det(rows)
    # Twice the area in pixels; below this a triangle covers no sample, and its inverse would be noise.
    regular = np.abs(determinant) > 1e-9
    rows = np.where(regular[:, None, None], rows, _ANY_TRIANGLE)
    homogeneous = np.concatenate([st - origin, np.ones_like(st[..., :1])], axis=-1)
    pixel_to_st = np.linalg.solve(rows, homogeneous)
    pixels = rows[..., :2] / rows[..., 2:]
    w = np.einsum("tci,ti->tc", np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1), pixel_to_st[..., 2])
    w = np.where(np.abs(w) > 1e-300, w, 1.0)[..., None, None]
    linear = np.swapaxes(pixel_to_st[:, :2, :2], -1, -2)[:, None]
    local = (st - origin)[..., :, None]
    return (linear - local * pixel_to_st[:, None, None, :2, 2]) / w, regular


def merged_pieces(clip: NDArray[np.float64], st: NDArray[np.float64], half: NDArray[np.float64]) -> Pieces:
    """One piece per occupied cell of a grid over st, for dense meshes; its footprints are the extremes within."""
    screen = _screen(clip, half)
    edge, st_edge = screen[:, 1:] - screen[:, :1], st[:, 1:] - st[:, :1]
    area = edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0]
    # Slivers cover no sample; 1e-3 pixels also keeps their footprints, which are noise, out of the extremes.
    keep = np.abs(area) > 1e-3 if (np.abs(area) > 1e-3).any() else np.abs(area) > 0
    if not keep.any():
        return Pieces(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 3, 2, 2)))
    edge, st_edge, area, st = edge[keep], st_edge[keep], area[keep], st[keep]
    jacobian = _affine_jacobian(edge, st_edge, area)
    low, high = st.min(axis=1), st.max(axis=1)
    origin, extent = low.min(axis=0), np.maximum(np.ptp(low, axis=0), 1e-30)
    cell = np.minimum((low - origin) / extent * _MERGE_CELLS, _MERGE_CELLS - 1).astype(np.int64)
    order = np.lexsort((np.linalg.norm(jacobian, axis=(1, 2)), cell[:, 0], cell[:, 1]))
    keys = (cell[:, 1] * _MERGE_CELLS + cell[:, 0])[order]
    starts = np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]])
    ends = np.r_[starts[1:], len(keys)] - 1
    chosen = order[np.stack([starts, (starts + ends) // 2, ends], axis=1)]
    return Pieces(np.minimum.reduceat(low[order], starts), np.maximum.reduceat(high[order], starts), jacobian[chosen])


def _affine_jacobian(
    edge: NDArray[np.float64], st_edge: NDArray[np.float64], area: NDArray[np.float64]
) -> NDArray[np.float64]:
    """d(st)/d(pixel) (T, 2, 2) from two edges in pixels and in st."""
    inverse = np.stack([edge[:, 1, 1], -edge[:, 0, 1], -edge[:, 1, 0], edge[:, 0, 0]], axis=1).reshape(-1, 2, 2)
    inverse = inverse / area[:, None, None]
    # Rows of st_edge are edges: st_edge = edge @ J^T.
    return np.swapaxes(inverse @ st_edge, 1, 2)


def _float32_error_px(pieces: Pieces, st: NDArray[np.float64]) -> float:
    """Error of float32 texture coordinates in pixels: half a unit in the last place over the finest footprint."""
    if not len(pieces.st_min):
        return 0.0
    footprint = np.linalg.norm(pieces.jacobian, axis=(2, 3)).min(axis=1) / np.sqrt(2)
    largest = max(float(np.abs(st).max()), 1e-30)
    return largest * 2.0**-24 / max(float(np.percentile(footprint, 2)), 1e-300)


def _frame(st: NDArray[np.float64], pieces: Pieces) -> StFrame:
    """Origin where the footprint is smallest: there float32 has the most digits, which a grazing view needs there."""
    low, high = st.reshape(-1, 2).min(axis=0), st.reshape(-1, 2).max(axis=0)
    nearest = np.linalg.norm(pieces.jacobian, axis=(2, 3)).max(axis=1).argmin()
    origin = (pieces.st_min[nearest] + pieces.st_max[nearest]) / 2
    # A power of two keeps the change of scale exact.
    extent = max(float((high - low).max()), 1e-300)
    return StFrame((float(origin[0]), float(origin[1])), float(2.0 ** -np.ceil(np.log2(extent))))


def _rebase(
    draw: Draw,
    triangles: _Triangles,
    corners: Mapping[str, NDArray[np.float64]],
    frames: Mapping[str, StFrame],
) -> RebasedMesh:
    mesh, matrix = draw.mesh, draw.object_to_world
    world = triangles.interpolate(np.asarray(mesh.points, np.float64) @ matrix[:3, :3] + matrix[3, :3])
    normal = triangles.interpolate(mesh.normals) @ np.linalg.inv(matrix[:3, :3]).T
    # 1e-30 guards a zero normal, which stays zero.
    normal = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-30)
    color = None if mesh.display_color is None else _flat(triangles.interpolate(mesh.display_color))
    opacity = None if mesh.display_opacity is None else _flat(triangles.interpolate(mesh.display_opacity[:, None]))
    local = {name: (st - frames[name].origin) * frames[name].scale for name, st in corners.items()}
    return RebasedMesh(
        clip_position=_flat(triangles.clip),
        world_position=_flat(world),
        normal=_flat(normal),
        display_color=color,
        display_opacity=opacity,
        st={name: _flat(values) for name, values in local.items()},
        triangles=np.arange(3 * len(triangles.clip), dtype=np.int32).reshape(-1, 3),
    )


def _flat(values: NDArray[np.float64]) -> NDArray[np.float32]:
    return np.ascontiguousarray(values.reshape(-1, values.shape[-1]), dtype=np.float32)
