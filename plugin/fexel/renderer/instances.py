"""What a view sees of many small occurrences of one mesh, worked out once for all of them.

`visible_surface` clips every triangle of a draw, which is wasted on the thousandth small instance. Here the occurrences
of one mesh and material that are small on screen share one `VisibleSurface`: all of the texture, with footprints from
the finest that the nearest of them could show, facing the camera, to the coarsest of the farthest, seen at a grazing
angle. That asks for no less than each would by itself, and for little more, since small occurrences need small levels.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence

import numpy as np

from fexel.renderer.visible import Pieces, StFrame, VisibleSurface, merged_pieces
from fexel.scene.model import Draw, Mesh

__all__ = ["SMALL_PX", "pixels_per_unit", "shared_surface"]

SMALL_PX = 384.0  # larger ones are worth the exact treatment
_GRAZING = 16.0  # longest footprint over the one that faces the camera: beyond it anisotropic filtering blurs anyway
_PLANE_UNITS = 1e4  # extent that a mesh is flattened to, so that no threshold in pixels of `merged_pieces` applies

_mesh_pieces: weakref.WeakKeyDictionary[Mesh, dict[tuple, Pieces]] = weakref.WeakKeyDictionary()


def pixels_per_unit(corners_clip: np.ndarray, draw: Draw, world_to_clip: np.ndarray, size_px: tuple[int, int]) -> tuple:
    """Smallest and largest number of pixels that a unit of object space can take.

    Parameters
    ----------
    corners_clip : (8, 4) float64
        The draw's bounds, all with w > 0.
    draw : Draw
    world_to_clip : (4, 4) float64
        Of the tile of `size_px` (width, height).
    """
    w = corners_clip[:, 3]
    half = np.asarray(size_px) / 2
    across = np.linalg.norm(world_to_clip[:3, :2], axis=0) * half
    # d(x/w) = (dx - x/w dw) / w, where x/w is at most 1 within the picture.
    along = np.linalg.norm(world_to_clip[:3, 3]) * half
    stretch = np.linalg.svd(draw.object_to_world[:3, :3], compute_uv=False)
    return float(across.min() * stretch[-1] / w.max()), float((across + along).max() * stretch[0] / w.min())


def shared_surface(
    draws: Sequence[Draw], scales: Sequence[tuple[float, float]], primvars: Sequence[str]
) -> VisibleSurface | None:
    """The surface of all `draws`, which show the same triangles of the same mesh.

    Parameters
    ----------
    draws : sequence of Draw
    scales : sequence of tuple
        `pixels_per_unit` of each.
    primvars : sequence of str

    Returns
    -------
    VisibleSurface or None
        None when every triangle of the mesh is degenerate.
    """
    finest = max(largest for _, largest in scales)
    # A draw of no extent shows nothing; 1e-12 of the finest keeps the range of levels finite.
    coarsest = max(min(smallest for smallest, _ in scales), 1e-12 * finest, 1e-300)
    names = [name for name in dict.fromkeys(primvars) if name in draws[0].mesh.st]
    pieces = {name: _scaled(_pieces_of(draws[0], name), finest, coarsest) for name in names}
    if names and not any(len(seen.st_min) for seen in pieces.values()):
        return None
    return VisibleSurface(pieces, {name: StFrame() for name in names})


def _scaled(pieces: Pieces, finest: float, coarsest: float) -> Pieces:
    """Footprints per pixel from those per unit of object space."""
    fine, middle, coarse = np.moveaxis(pieces.jacobian, 1, 0)
    grazing = np.array([1.0, _GRAZING])
    jacobian = np.stack([fine / finest, middle / finest * grazing, coarse / coarsest * grazing], axis=1)
    return Pieces(pieces.st_min, pieces.st_max, jacobian)


def _pieces_of(draw: Draw, name: str) -> Pieces:
    """Pieces of all the draw's triangles, Jacobians d(st)/d(object space within the triangle's plane)."""
    by_range = _mesh_pieces.setdefault(draw.mesh, {})
    key = (draw.first_triangle, draw.triangle_count, name)
    if key not in by_range:
        indices = draw.mesh.triangles[draw.first_triangle : draw.first_triangle + draw.triangle_count]
        flat, scale = _flattened(np.asarray(draw.mesh.points, np.float64)[indices])
        pieces = merged_pieces(flat, np.asarray(draw.mesh.st[name], np.float64)[indices], np.ones(2))
        by_range[key] = Pieces(pieces.st_min, pieces.st_max, pieces.jacobian * scale)
    return by_range[key]


def _flattened(corners: np.ndarray) -> tuple[np.ndarray, float]:
    """Each triangle (T, 3, 3) laid into a plane, as clip positions (T, 3, 4) with w = 1, and the scale applied."""
    scale = _PLANE_UNITS / max(float(np.ptp(corners.reshape(-1, 3), axis=0).max()), 1e-300)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length = np.linalg.norm(first, axis=1)
    along = np.einsum("ti,ti->t", first, second) / np.maximum(length, 1e-300)
    across = np.linalg.norm(np.cross(first, second), axis=1) / np.maximum(length, 1e-300)
    flat = np.zeros((len(corners), 3, 4))
    flat[:, 1, 0], flat[:, 2, 0], flat[:, 2, 1], flat[..., 3] = length * scale, along * scale, across * scale, 1.0
    return flat, scale
