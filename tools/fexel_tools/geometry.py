"""Surfaces to put a texture on, the cameras that look at them, and where a texture coordinate lies in the world.

`--primitive` makes a surface (`quad`, `sphere`, `cylinder`), `--mesh` reads one from a USD stage or from any mesh
file that trimesh reads. A camera that frames a patch needs the point, the normal and the extent of its texture
rectangle in the world: `locate` finds them on any mesh whose triangles carry `st`.

Conventions: world units with y up unless the mesh says otherwise; quad and cylinder are one unit high and show the
texture undistorted; triangles are counter-clockwise seen from outside; `st` per triangle corner, origin at the lower
left.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from fexel.errors import FexelError

__all__ = ["PRIMITIVES", "Location", "Surface", "define_surface", "load_surface", "locate", "primitive"]

PRIMITIVES = ("quad", "sphere", "cylinder")
_USD = (".usd", ".usda", ".usdc", ".usdz")
_SEGMENTS = 128
_SMALLEST_PATCH = 1e-7  # of st; a texture rectangle smaller than this is framed as if it had this size


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle mesh in world space with texture coordinates.

    Attributes
    ----------
    points : (P, 3) float64
    triangles : (T, 3) int
    st : (T, 3, 2) float64
        Per triangle corner.
    normals : (P, 3) float64 or None
        None: facets.
    wrap : (str, str)
        How the texture goes on beyond [0, 1] along s and t.
    source : str
        USD stage that is to be referenced instead of writing the arrays; '' for none.
    up_axis : str
    meters_per_unit : float
    """

    points: np.ndarray
    triangles: np.ndarray
    st: np.ndarray
    normals: np.ndarray | None = None
    wrap: tuple[str, str] = ("repeat", "repeat")
    source: str = ""
    up_axis: str = "Y"
    meters_per_unit: float = 1.0


@dataclass(frozen=True, eq=False)
class Location:
    """A texture rectangle in the world.

    Attributes
    ----------
    center, normal, up : (3,) float64
        `up` is the direction of growing t along the surface; unit vectors.
    width, height : float
        World units along s and t.
    """

    center: np.ndarray
    normal: np.ndarray
    up: np.ndarray
    width: float
    height: float


def primitive(name: str, aspect: float) -> Surface:
    """Make a surface for a texture of the given aspect ratio (width over height).

    Raises
    ------
    FexelError
        Unknown name.
    """
    if name == "quad":
        return _quad(aspect)
    if name == "sphere":
        return _revolved(_SEGMENTS // 2, lambda t: (0.5 * np.sin(np.pi * t), -0.5 * np.cos(np.pi * t)))
    if name == "cylinder":
        radius = aspect / (2.0 * np.pi)
        return _revolved(1, lambda t: (radius + 0.0 * t, t - 0.5))
    raise FexelError(f"--primitive: '{name}' is unknown, expected one of {', '.join(PRIMITIVES)}")


def load_surface(file: str | Path) -> Surface:
    """Read a mesh with texture coordinates: all meshes of a USD stage, or what trimesh reads (OBJ, GLB, PLY ...).

    Raises
    ------
    FexelError
        Missing or unreadable file, no mesh in it, or a mesh without texture coordinates.
    """
    if not Path(file).is_file():
        raise FexelError(f"{file}: no such file")
    return _load_usd(str(file)) if Path(file).suffix.lower() in _USD else _load_trimesh(str(file))


def define_surface(stage: Usd.Stage, path: str, surface: Surface, material: UsdShade.Material) -> Usd.Prim:
    """Author the surface at `path` and bind the material to it.

    A surface with a `source` becomes an empty Xform, to which `reference_source` adds the reference once the stage
    lies where it belongs.
    """
    if surface.source:
        prim = UsdGeom.Xform.Define(stage, path).GetPrim()
        strength = UsdShade.Tokens.strongerThanDescendants
    else:
        prim = _define_mesh(stage, path, surface).GetPrim()
        strength = UsdShade.Tokens.weakerThanDescendants
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material, strength)
    return prim


def locate(surface: Surface, s_range: tuple[float, float], t_range: tuple[float, float]) -> Location:
    """Find a texture rectangle in the world: the triangle under its middle, extended linearly.

    Where no triangle holds the middle, the triangle nearest to it in st is taken.
    """
    target = np.array([0.5 * sum(s_range), 0.5 * sum(t_range)])
    triangle, weights = _triangle_at(surface.st, target)
    corners = surface.points[surface.triangles[triangle]]
    center = weights @ corners
    edges, st_edges = corners[1:] - corners[0], surface.st[triangle][1:] - surface.st[triangle][0]
    by_st = np.linalg.pinv(st_edges) @ edges  # rows: dP/ds, dP/dt; pinv: a triangle may be degenerate in st
    normal = np.cross(edges[0], edges[1])
    if surface.normals is not None:
        normal = weights @ surface.normals[surface.triangles[triangle]]
    normal = _unit(normal, np.array([0.0, 0.0, 1.0]))
    up = _unit(by_st[1] - normal * (by_st[1] @ normal), np.array([0.0, 1.0, 0.0]))
    width = np.linalg.norm(by_st[0]) * max(s_range[1] - s_range[0], _SMALLEST_PATCH)
    height = np.linalg.norm(by_st[1]) * max(t_range[1] - t_range[0], _SMALLEST_PATCH)
    return Location(center, normal, up, float(width), float(height))


def _unit(vector: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 1e-300 else otherwise  # a degenerate triangle has no direction


def _triangle_at(st: np.ndarray, target: np.ndarray) -> tuple[int, np.ndarray]:
    """Triangle that holds `target`, and its barycentric weights there (clamped to it where none holds it)."""
    a, b, c = st[:, 0], st[:, 1], st[:, 2]
    u, v, w = b - a, c - a, target - a
    det = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    safe = np.where(det == 0.0, 1.0, det)
    beta = np.where(det == 0.0, np.inf, (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / safe)
    gamma = np.where(det == 0.0, np.inf, (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / safe)
    with np.errstate(invalid="ignore"):
        least = np.minimum(np.minimum(beta, gamma), 1.0 - beta - gamma)
    least = np.where(np.isfinite(least), least, -np.inf)
    distance = np.where(least >= -1e-9, 0.0, np.linalg.norm((a + b + c) / 3.0 - target, axis=1) + 1.0)
    best = int(np.argmin(distance))
    weights = np.array([1.0 - beta[best] - gamma[best], beta[best], gamma[best]])
    weights = np.clip(np.where(np.isfinite(weights), weights, 1.0 / 3.0), 0.0, 1.0)
    return best, weights / weights.sum()


def _quad(aspect: float) -> Surface:
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    points = np.column_stack([(corners[:, 0] - 0.5) * aspect, corners[:, 1] - 0.5, np.zeros(4)])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    return Surface(points, triangles, corners[triangles], np.tile([0.0, 0.0, 1.0], (4, 1)), wrap=("clamp", "clamp"))


def _revolved(rings: int, profile) -> Surface:
    """Surface of revolution about y; s runs counter-clockwise seen from above, s = 0.5 faces +z."""
    s = np.linspace(0.0, 1.0, _SEGMENTS + 1)
    t = np.linspace(0.0, 1.0, rings + 1)
    radius, height = profile(t)
    angle = 2.0 * np.pi * (s - 0.5)
    direction = np.stack([np.sin(angle), 0.0 * angle, np.cos(angle)], axis=1)
    points = radius[:, None, None] * direction[None] + height[:, None, None] * np.array([0.0, 1.0, 0.0])
    slope = np.gradient(radius, height) if rings > 1 else np.zeros(2)
    normals = direction[None] - slope[:, None, None] * np.array([0.0, 1.0, 0.0])
    if rings > 1:
        normals = points.copy()  # a sphere's
    normals = normals / np.linalg.norm(normals, axis=2, keepdims=True)
    st = np.stack(np.meshgrid(s, t), axis=-1).reshape(-1, 2)
    triangles = _grid_triangles(rings, _SEGMENTS)
    return Surface(points.reshape(-1, 3), triangles, st[triangles], normals.reshape(-1, 3), wrap=("repeat", "clamp"))


def _grid_triangles(rows: int, columns: int) -> np.ndarray:
    corner = np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)[None, :]
    a, b, c, d = corner, corner + 1, corner + columns + 2, corner + columns + 1
    return np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)


def _define_mesh(stage: Usd.Stage, path: str, surface: Surface) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(surface.points, np.float32))
    mesh.CreatePointsAttr(points)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    if len(surface.triangles) == 2 and len(surface.points) == 4:  # a quad stays one face
        counts, indices, st = [4], [0, 1, 2, 3], surface.st[[0, 0, 0, 1], [0, 1, 2, 2]]
    else:
        counts, indices, st = [3] * len(surface.triangles), surface.triangles.ravel(), surface.st.reshape(-1, 2)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray(counts))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(indices, np.int32)))
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "faceVarying")
    primvar.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(st, np.float32)))
    if surface.normals is not None:
        mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(surface.normals, np.float32)))
        mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    return mesh


def _load_usd(file: str) -> Surface:
    try:
        stage = Usd.Stage.Open(file)
    except Exception as error:  # pxr raises Tf.ErrorException, which names the fault over several lines
        raise FexelError(f"{file}: cannot be opened as a USD stage") from error
    if not stage.GetDefaultPrim():
        raise FexelError(f"{file}: the stage has no default prim, which a reference needs")
    parts = [_usd_mesh(file, prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    if not parts:
        raise FexelError(f"{file}: no mesh found")
    offsets = np.cumsum([0] + [len(points) for points, _, _ in parts[:-1]])
    return Surface(
        points=np.concatenate([points for points, _, _ in parts]),
        triangles=np.concatenate([tri + offset for (_, tri, _), offset in zip(parts, offsets, strict=True)]),
        st=np.concatenate([st for _, _, st in parts]),
        source=str(Path(file).resolve()),
        up_axis=str(UsdGeom.GetStageUpAxis(stage)),
        meters_per_unit=float(UsdGeom.GetStageMetersPerUnit(stage)),
    )


def _usd_mesh(file: str, prim: Usd.Prim) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    mesh, path = UsdGeom.Mesh(prim), prim.GetPath()
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("st")
    values = primvar.ComputeFlattened() if primvar else None
    if values is None or not len(values):
        raise FexelError(f"{file}: {path} has no texture coordinates 'st'; `fexel unwrap` makes them")
    counts = np.asarray(mesh.GetFaceVertexCountsAttr().Get(), np.int64)
    indices = np.asarray(mesh.GetFaceVertexIndicesAttr().Get(), np.int64)
    first = np.repeat(np.cumsum(counts) - counts, np.maximum(counts - 2, 0))
    step = np.concatenate([np.arange(1, n - 1) for n in counts]) if len(counts) else np.zeros(0, np.int64)
    corners = np.stack([first, first + step, first + step + 1], axis=1).astype(np.int64)
    if str(mesh.GetOrientationAttr().Get()) == "leftHanded":
        corners = corners[:, ::-1]
    st = np.asarray(values, np.float64)
    per_corner = {
        "faceVarying": lambda: st[corners],
        "vertex": lambda: st[indices[corners]],
        "varying": lambda: st[indices[corners]],
    }.get(str(primvar.GetInterpolation()))
    if per_corner is None:
        raise FexelError(f"{file}: {path}: 'st' is {primvar.GetInterpolation()}, expected faceVarying or vertex")
    matrix = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim))
    points = np.asarray(mesh.GetPointsAttr().Get(), np.float64) @ matrix[:3, :3] + matrix[3, :3]
    return points, indices[corners], per_corner()


def _load_trimesh(file: str) -> Surface:
    import trimesh

    try:
        mesh = trimesh.load(file, force="mesh", process=False)
    except Exception as error:  # trimesh raises many types, according to format
        raise FexelError(f"{file}: cannot be read as a mesh: {' '.join(str(error).split())}") from error
    if not len(getattr(mesh, "faces", ())):
        raise FexelError(f"{file}: no triangles found")
    st = getattr(mesh.visual, "uv", None)
    if st is None or len(st) != len(mesh.vertices):
        raise FexelError(f"{file}: the mesh has no texture coordinates; `fexel unwrap` makes them")
    triangles = np.asarray(mesh.faces, np.int64)
    normals = np.asarray(mesh.vertex_normals, np.float64)
    return Surface(np.asarray(mesh.vertices, np.float64), triangles, np.asarray(st, np.float64)[triangles], normals)


def reference_source(layer: Sdf.Layer, path: str, surface: Surface, folder: Path) -> None:
    """Add the reference to the surface's source stage, relative to the folder in which the layer will lie."""
    import os

    relative = Path(os.path.relpath(surface.source, folder.resolve())).as_posix()
    spec = layer.GetPrimAtPath(path)
    spec.referenceList.prependedItems.append(Sdf.Reference(relative if relative.startswith(".") else f"./{relative}"))


def look_at(eye: np.ndarray, target: np.ndarray, up: np.ndarray) -> Gf.Matrix4d:
    """Camera to world, row vectors: the camera looks down -z with y up."""
    view = Gf.Matrix4d().SetLookAt(Gf.Vec3d(*eye), Gf.Vec3d(*target), Gf.Vec3d(*up))
    return view.GetInverse()
