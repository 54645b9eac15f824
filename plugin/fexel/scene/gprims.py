"""Sphere, Cube, Cylinder, Cone, Capsule and Plane as meshes with exact normals and an `st` parameterisation.

`st` runs around the axis in s and along it in t (0 at the low end) on round shapes, caps are discs within [0, 1]^2; a
cube has [0, 1]^2 on every face, a plane once. Images read the right way round from outside. Round shapes have
`_AROUND` sides, finer than usdrecord's tessellation at complexity low, because there is no refinement afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from pxr import Usd, UsdGeom

from fexel.scene.model import Mesh
from fexel.scene.sampling import Faults, Sampler

__all__ = ["GPRIM_TYPES", "extract_gprim"]

_AROUND = 64
_ALONG = 32  # rows of a half circle

# Columns: position (3), normal (3), st (2); and triangles.
_Surface = tuple[np.ndarray, np.ndarray]


def extract_gprim(prim: Usd.Prim, sampler: Sampler, faults: Faults) -> Mesh | None:
    """Tessellate an implicit gprim; None, with a warning, where its size is not a finite number above 0."""
    schema = prim.GetTypeName()
    sizes = {name: _size(prim, name, sampler) for name in _SIZES[schema]}
    bad = next((name for name, size in sizes.items() if not (math.isfinite(size) and size >= 0)), None)
    if bad or not any(sizes.values()):
        name = bad or next(iter(sizes))
        faults.warn(f"{prim.GetPath()}.{name}", f"{sizes[name]}, expected a finite number above 0; prim skipped")
        return None
    vertices, triangles = _BUILDERS[schema](**sizes)
    points, normals = _turn(vertices, sampler.get(prim.GetAttribute("axis"), UsdGeom.Tokens.z), schema == "Plane")
    if sampler.get(UsdGeom.Gprim(prim).GetOrientationAttr()) == UsdGeom.Tokens.leftHanded:
        triangles, normals = triangles[:, ::-1], -normals
    color = sampler.array(prim.GetAttribute("primvars:displayColor"), np.float32, 3)
    opacity = sampler.array(prim.GetAttribute("primvars:displayOpacity"), np.float32)
    count = len(points)
    return Mesh(
        path=str(prim.GetPath()),
        points=points,
        normals=normals.astype(np.float32),
        triangles=np.ascontiguousarray(triangles, np.int32),
        st={"st": np.ascontiguousarray(vertices[:, 6:8])},
        display_color=np.repeat(color[:1], count, axis=0) if color is not None and len(color) else None,
        display_opacity=np.repeat(opacity[:1], count) if opacity is not None and len(opacity) else None,
    )


def _size(prim: Usd.Prim, name: str, sampler: Sampler) -> float:
    return float(sampler.get(prim.GetAttribute(name), 1.0))


def _turn(vertices: np.ndarray, axis: str, is_plane: bool) -> tuple[np.ndarray, np.ndarray]:
    """Turn a shape about z to its axis; a plane's width lies along x (z for axis X), its length along y (z for Y)."""
    if axis == UsdGeom.Tokens.x:
        order, signs = ([2, 1, 0], (1, 1, -1)) if is_plane else ([2, 0, 1], (1, 1, 1))
    elif axis == UsdGeom.Tokens.y:
        order, signs = ([0, 2, 1], (1, 1, -1)) if is_plane else ([1, 2, 0], (1, 1, 1))
    else:
        order, signs = [0, 1, 2], (1, 1, 1)
    return vertices[:, :3][:, order] * signs, vertices[:, 3:6][:, order] * signs


def _grid_triangles(rows: int, columns: int) -> np.ndarray:
    """Two triangles per cell of a grid of vertices, counter-clockwise where columns run right and rows run up."""
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    return np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)


def _revolve(profile: np.ndarray) -> _Surface:
    """Surface of revolution about z from rows (radius, z, normal radius, normal z, t), lowest first."""
    s = np.linspace(0.0, 1.0, _AROUND + 1)
    turn = np.stack([np.cos(2 * np.pi * s), np.sin(2 * np.pi * s)], axis=1)
    turn[-1] = turn[0]
    rows, columns = len(profile), len(s)
    vertices = np.empty((rows, columns, 8))
    vertices[..., 0:2] = profile[:, None, 0:1] * turn
    vertices[..., 2] = profile[:, None, 1]
    vertices[..., 3:5] = profile[:, None, 2:3] * turn
    vertices[..., 5] = profile[:, None, 3]
    vertices[..., 6], vertices[..., 7] = s, profile[:, None, 4]
    flat = vertices.reshape(-1, 8)
    triangles = _grid_triangles(rows, columns)
    a, b, c = (flat[triangles[:, k], :3] for k in range(3))
    return flat, triangles[np.cross(b - a, c - a).any(axis=1)]  # none at a pole


def _join(*surfaces: _Surface) -> _Surface:
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in surfaces])
    triangles = [t + offset for (_, t), offset in zip(surfaces, offsets[:-1], strict=True)]
    return np.concatenate([vertices for vertices, _ in surfaces]), np.concatenate(triangles)


def _cap(radius: float, z: float, up: float) -> _Surface:
    """A disc across the axis that looks along +z (`up` 1) or -z (-1)."""
    if radius == 0:
        return np.zeros((0, 8)), np.zeros((0, 3), np.int64)
    turn = 2 * np.pi * np.arange(_AROUND) / _AROUND
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    vertices = np.zeros((_AROUND + 1, 8))
    vertices[1:, :2] = radius * ring
    vertices[:, 2], vertices[:, 5] = z, up
    vertices[:, 6:8] = 0.5
    vertices[1:, 6:8] += 0.5 * ring * (1, up)
    around = np.arange(_AROUND)
    triangles = np.stack([np.zeros(_AROUND, np.int64), 1 + around, 1 + (around + 1) % _AROUND], axis=1)
    return vertices, triangles if up > 0 else triangles[:, ::-1]


def _arc(radius: float, center: float, low: float, high: float, rows: int, t: tuple[float, float]) -> np.ndarray:
    """Profile of a part of a sphere between two latitudes (radians)."""
    latitude = np.linspace(low, high, rows + 1)
    cosine, sine = np.cos(latitude), np.sin(latitude)
    cosine[np.abs(latitude) == np.pi / 2] = 0.0
    return np.stack([radius * cosine, center + radius * sine, cosine, sine, np.linspace(*t, rows + 1)], axis=1)


def _side(bottom: float, top: float, height: float, t: tuple[float, float] = (0.0, 1.0)) -> np.ndarray:
    """Profile of a cylinder's or cone's side."""
    slope = np.array([height, bottom - top])
    normal = slope / max(float(np.hypot(*slope)), 1e-300)  # 1e-300: a side of no extent has no triangles
    return np.array([[bottom, -height / 2, *normal, t[0]], [top, height / 2, *normal, t[1]]])


def _sphere(radius: float) -> _Surface:
    return _revolve(_arc(radius, 0.0, -np.pi / 2, np.pi / 2, _ALONG, (0.0, 1.0)))


def _tapered_cylinder(height: float, radiusBottom: float, radiusTop: float) -> _Surface:
    side = _revolve(_side(radiusBottom, radiusTop, height))
    return _join(side, _cap(radiusBottom, -height / 2, -1.0), _cap(radiusTop, height / 2, 1.0))


def _tapered_capsule(height: float, radiusBottom: float, radiusTop: float) -> _Surface:
    """A cone's frustum between two parts of spheres that meet it tangentially; t follows the profile's length."""
    if height == 0:
        return _sphere(max(radiusBottom, radiusTop))
    slope = (radiusBottom - radiusTop) / height
    meeting, stretch = math.atan(slope), math.hypot(1.0, slope)
    lengths = np.array(
        [
            radiusBottom * stretch * (np.pi / 2 + meeting),
            math.hypot(height, radiusBottom - radiusTop),
            radiusTop * stretch * (np.pi / 2 - meeting),
        ]
    )
    t1, t2 = (np.cumsum(lengths)[:2] / lengths.sum()).tolist()
    rows = _ALONG // 2
    low = _arc(radiusBottom * stretch, -height / 2 - radiusBottom * slope, -np.pi / 2, meeting, rows, (0.0, t1))
    high = _arc(radiusTop * stretch, height / 2 - radiusTop * slope, meeting, np.pi / 2, rows, (t2, 1.0))
    return _join(*(_revolve(part) for part in (low, _side(radiusBottom, radiusTop, height, (t1, t2)), high)))


def _cone(height: float, radius: float) -> _Surface:
    """The side's normals are those of the cone; at the apex each side has its own."""
    return _tapered_cylinder(height, radius, 0.0)


def _plane(width: float, length: float) -> _Surface:
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    vertices = np.zeros((4, 8))
    vertices[:, :2] = corners * (width, length)
    vertices[:, 5] = 1.0
    vertices[:, 6:8] = corners + 0.5
    return vertices, np.array([[0, 1, 2], [0, 2, 3]])


def _cube(size: float) -> _Surface:
    """Six faces, upright in `st` as seen with z up."""
    front, triangles = _plane(size, size)
    front[:, 2] = size / 2
    faces = []
    for right, up in (
        ((1, 0, 0), (0, 0, 1)),
        ((0, 1, 0), (0, 0, 1)),
        ((-1, 0, 0), (0, 0, 1)),
        ((0, -1, 0), (0, 0, 1)),
        ((1, 0, 0), (0, 1, 0)),
        ((1, 0, 0), (0, -1, 0)),
    ):
        axes = np.array([right, up, np.cross(right, up)], np.float64)
        face = front.copy()
        face[:, :3], face[:, 3:6] = front[:, :3] @ axes, front[:, 3:6] @ axes
        faces.append((face, triangles))
    return _join(*faces)


_BUILDERS: dict[str, Callable[..., _Surface]] = {
    "Sphere": _sphere,
    "Cube": _cube,
    "Cylinder": lambda height, radius: _tapered_cylinder(height, radius, radius),
    "Cylinder_1": _tapered_cylinder,
    "Cone": _cone,
    "Capsule": lambda height, radius: _tapered_capsule(height, radius, radius),
    "Capsule_1": _tapered_capsule,
    "Plane": _plane,
}
_SIZES: dict[str, tuple[str, ...]] = {
    "Sphere": ("radius",),
    "Cube": ("size",),
    "Cylinder": ("height", "radius"),
    "Cylinder_1": ("height", "radiusBottom", "radiusTop"),
    "Cone": ("height", "radius"),
    "Capsule": ("height", "radius"),
    "Capsule_1": ("height", "radiusBottom", "radiusTop"),
    "Plane": ("width", "length"),
}
GPRIM_TYPES = frozenset(_BUILDERS)
