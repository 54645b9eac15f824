"""Small scenes for the renderer's tests, built without USD."""

from __future__ import annotations

import numpy as np

from fexel.renderer.aov import checked_aovs
from fexel.renderer.frame import FrameSettings
from fexel.scene.model import Camera, Draw, Light, Material, Mesh, Scene

__all__ = ["camera", "draw", "light", "quad", "scene", "settings", "sphere", "translation"]


def translation(x: float, y: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[3, :3] = x, y, z
    return matrix


def quad(size: float = 1.0, *, z: float = 0.0, slope: float = 0.0, **primvars) -> Mesh:
    """Square [-size, size]^2 that faces +z, st over [0, 1]^2; `slope` dz/dx."""
    points = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float) * size
    points[:, 2] = z + slope * points[:, 0]
    normal = np.array([-slope, 0, 1]) / np.hypot(slope, 1)
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    st = {"st": np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)}
    return Mesh("/Quad", points, np.tile(normal, (4, 1)).astype("f4"), triangles, st, **primvars)


def sphere(radius: float = 1.0, rings: int = 32) -> Mesh:
    """UV sphere with exact normals."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1), indexing="ij")
    normals = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), -np.sin(theta) * np.sin(phi)], -1).reshape(-1, 3)
    index = np.arange(normals.shape[0]).reshape(theta.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    triangles = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return Mesh("/Sphere", normals * radius, normals.astype("f4"), triangles.astype("i4"))


def draw(
    mesh: Mesh, matrix: np.ndarray | None = None, prim_id: int = 0, *, double_sided: bool = True, **inputs
) -> Draw:
    """One draw with a material of these inputs."""
    material = Material("/Material", inputs, uses_display_color=True, uses_display_opacity=True)
    to_world = np.eye(4) if matrix is None else matrix
    return Draw(mesh, 0, len(mesh.triangles), to_world, material, mesh.path, prim_id, double_sided)


def camera(
    eye=(0.0, 0.0, 4.0),
    *,
    half_height: float = 0.5,
    aspect: float = 1.0,
    near=0.1,
    far=100.0,
    orthographic=False,
    **more,
) -> Camera:
    """Looks down -z; `half_height` of the picture at distance 1 (perspective) or anywhere (orthographic)."""
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = 1 / (half_height * aspect), 1 / half_height
    if orthographic:
        projection[2, 2], projection[3, 2], projection[3, 3] = -2 / (far - near), -(far + near) / (far - near), 1.0
    else:
        projection[2, 2], projection[3, 2] = (far + near) / (near - far), 2 * far * near / (near - far)
        projection[2, 3] = -1.0
    return Camera("/Camera", translation(*(-np.asarray(eye, float))), projection, near, far, aspect, **more)


def light(kind: str, color=(1.0, 1.0, 1.0), matrix: np.ndarray | None = None, **more) -> Light:
    """A light at `matrix`."""
    return Light("/Light", kind, color, np.eye(4) if matrix is None else matrix, **more)


def scene(*draws: Draw, lights=(), view: Camera | None = None) -> Scene:
    """A scene of these draws."""
    return Scene(draws, tuple(lights), view or camera(), tuple(draw.path for draw in draws))


def settings(width: int, height: int, *aovs: str, **more) -> FrameSettings:
    """Frame settings; colour and no headlight by default."""
    return FrameSettings(width, height, checked_aovs(aovs or ("color",)), **({"camera_light": False} | more))
