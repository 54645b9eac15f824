"""The scene a frame needs, as plain frozen dataclasses: no USD, no GL.

`fexel.scene.SceneReader` makes it from a stage; `fexel.renderer` draws it.

Conventions that hold throughout
--------------------------------
Matrices are (4, 4) or (3, 3) float64 for row vectors as in USD: ``p_world = [x y z 1] @ object_to_world``; names say
*source to destination*. World units are the stage's. `st` has its origin at the lower left: row 0 of an image is at
t = 1. Colours are linear Rec.709. Arrays are never written to after construction; a `Mesh` that does not vary over
time is the same object in every frame, so GL buffers are cached by identity.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fexel.filters.minification import NO_MINIFICATION, Minification

__all__ = ["Camera", "Draw", "Light", "Material", "Mesh", "Scene", "Texture", "TextureInput"]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangulated geometry; every array is indexed by vertex, where a vertex is a point with all its primvars.

    Attributes
    ----------
    path : str
        Prim path, for messages.
    points : (V, 3) float64
        Object space.
    normals : (V, 3) float32
        Object space, unit length; smooth or faceted as authored or as USD prescribes.
    triangles : (T, 3) int32
        Vertex indices, counter-clockwise seen from outside (``orientation`` already resolved).
    st : dict of str to (V, 2) float64
        Texture coordinates by primvar name.
    display_color : (V, 3) float32 or None
        ``primvars:displayColor``, linear.
    display_opacity : (V,) float32 or None
        ``primvars:displayOpacity``, [0, 1].
    """

    path: str
    points: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
    st: dict[str, np.ndarray] = field(default_factory=dict)
    display_color: np.ndarray | None = None
    display_opacity: np.ndarray | None = None


@dataclass(frozen=True)
class Draw:
    """One drawn occurrence of (a range of) a mesh: an instance and one material.

    Attributes
    ----------
    mesh : Mesh
    first_triangle, triangle_count : int
        Range of ``mesh.triangles`` (a subset with its own material is a range).
    object_to_world : (4, 4) float64
    material : Material
    path : str
        Path of the drawn prim (an instance proxy's own path).
    prim_id : int
        Index of `path` in `Scene.prim_paths`; the ``primId`` AOV.
    double_sided : bool
    """

    mesh: Mesh
    first_triangle: int
    triangle_count: int
    object_to_world: np.ndarray
    material: Material
    path: str
    prim_id: int
    double_sided: bool = True


@dataclass(frozen=True, eq=False)
class Texture:
    """A texture prim, evaluated at one time. `data` belongs to the kind's module in `fexel.textures`.

    Attributes
    ----------
    path : str
        Path of the texture prim.
    kind : str
        Name of the kind: the stem of its module and shader, for example ``"zipmap"``.
    data : object
        The kind's own frozen dataclass; equal data compare equal, so that it can be reused from frame to frame.
    st_primvar : str
        Primvar that gives the texture coordinates.
    st_transform : (3, 3) float64
        From primvar to the texture's ``inputs:st``, row vectors (UsdTransform2d; identity if none).
    minification : Minification
        Filter, contrast, brightness and attenuation that the prim asks for.
    """

    path: str
    kind: str
    data: Any
    st_primvar: str = "st"
    st_transform: np.ndarray = field(default_factory=lambda: np.eye(3))
    minification: Minification = NO_MINIFICATION


@dataclass(frozen=True, eq=False)
class TextureInput:
    """A material input driven by a texture's output: ``rgb``, ``r``, ``g``, ``b`` or ``a``."""

    texture: Texture
    output: str


@dataclass(frozen=True, eq=False)
class Material:
    """UsdPreviewSurface. Every input is a float, a tuple of 3 floats (linear) or a `TextureInput`.

    `inputs` holds the names that differ from the defaults of the UsdPreviewSurface specification:
    ``diffuseColor emissiveColor useSpecularWorkflow specularColor metallic roughness clearcoat clearcoatRoughness
    opacity opacityThreshold ior normal occlusion``.
    `uses_display_color`: the mesh's display colour, where it has one, replaces ``diffuseColor``;
    `uses_display_opacity`: its display opacity replaces ``opacity``.
    """

    path: str
    inputs: dict[str, float | tuple[float, float, float] | TextureInput] = field(default_factory=dict)
    uses_display_color: bool = False
    uses_display_opacity: bool = False


@dataclass(frozen=True, eq=False)
class Light:
    """A UsdLux light. `kind` is ``distant``, ``sphere`` or ``dome``.

    `color` is linear and already multiplied by intensity, 2^exposure and colour temperature. For ``normalize`` and for
    what `radius` (world units) and `angle` (degrees) do to the radiance, see UsdLux. `texture_file` is a dome's
    latitude-longitude image or ''.
    """

    path: str
    kind: str
    color: tuple[float, float, float]
    light_to_world: np.ndarray
    radius: float = 0.5
    angle: float = 0.53
    normalize: bool = False
    diffuse: float = 1.0
    specular: float = 1.0
    texture_file: str = ""


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera at one time.

    Attributes
    ----------
    path : str
        Prim path, or '' for one made to frame the default prim.
    world_to_camera : (4, 4) float64
        Camera looks down -z, y up.
    camera_to_clip : (4, 4) float64
        OpenGL clip space (z in [-w, w]), for `aspect`, apertures and offsets included.
    near, far : float
        Clipping distances along -z, camera space (world units, unless the camera is scaled).
    aspect : float
        Width over height of the image.
    clipping_planes : tuple of 4-tuples
        World space plane equations of extra clipping planes; usually empty.
    """

    path: str
    world_to_camera: np.ndarray
    camera_to_clip: np.ndarray
    near: float
    far: float
    aspect: float
    clipping_planes: tuple[tuple[float, float, float, float], ...] = ()


@dataclass(frozen=True, eq=False)
class Scene:
    """All that one frame needs."""

    draws: tuple[Draw, ...]
    lights: tuple[Light, ...]
    camera: Camera
    prim_paths: tuple[str, ...]
    up_axis: str = "Y"
    time: float | None = None
