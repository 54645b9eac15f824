"""UsdGeomCamera to matrices, finding cameras by name, and a camera that frames the stage where there is none.

Follows usdrecord (UsdAppUtils): the horizontal aperture is kept and the picture's aspect ratio decides the vertical
one; `main_cam` is the camera it looks for when none is named; the framing camera has a 50 mm lens and stands before
the bounding box, along -z on a y-up stage and along +y on a z-up one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

from fexel.errors import FexelError
from fexel.scene.model import Camera, Draw
from fexel.scene.sampling import Faults, Sampler

__all__ = ["find_camera", "framing_camera", "image_height", "list_cameras", "read_camera"]

_PRIMARY_CAMERA = "main_cam"  # UsdUtils.GetPrimaryCameraName()
_DEFAULT_CLIPPING = (1.0, 1e6)
_APERTURE_UNIT = 0.1  # apertures and focal length are in tenths of a scene unit


def image_height(width: int, aspect: float) -> int:
    """Height in pixels of a picture `width` pixels wide, as usdrecord has it: single precision, cut off, at least 1."""
    return max(1, int(np.float32(width) / np.float32(aspect)))


def list_cameras(stage: Usd.Stage) -> tuple[str, ...]:
    """Paths of all cameras of a stage, in stage order, those inside instances included."""
    paths = []
    prims = iter(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
    for prim in prims:
        if prim.IsA(UsdShade.NodeGraph) or prim.IsA(UsdGeom.Gprim):
            prims.PruneChildren()  # a material may hold ten thousand patches
        elif prim.IsA(UsdGeom.Camera):
            paths.append(str(prim.GetPath()))
    return tuple(paths)


def find_camera(stage: Usd.Stage, camera: str | None) -> Usd.Prim | None:
    """The camera prim that a user means.

    Parameters
    ----------
    camera : str or None
        A path, a bare name, or the end of a path. None: `main_cam`, else the first camera, else None is returned.

    Raises
    ------
    FexelError
        No camera, or several, fit; the message lists the cameras of the stage.
    """
    if not camera:
        paths = list_cameras(stage)
        primary = [path for path in paths if path.rsplit("/", 1)[-1] == _PRIMARY_CAMERA]
        return stage.GetPrimAtPath((primary or paths)[0]) if paths else None
    if camera.startswith("/") and Sdf.Path.IsValidPathString(camera):
        prim = stage.GetPrimAtPath(camera)
        if prim and prim.IsA(UsdGeom.Camera):
            return prim
    found = [] if camera.startswith("/") else [p for p in list_cameras(stage) if p.endswith(f"/{camera}")]
    if len(found) == 1:
        return stage.GetPrimAtPath(found[0])
    raise FexelError(_camera_fault(stage, camera, found))


def _camera_fault(stage: Usd.Stage, camera: str, found: Sequence[str]) -> str:
    if found:
        return f"camera {camera!r} is ambiguous: {', '.join(found)}; name one by its path"
    paths = list_cameras(stage)
    prim = stage.GetPrimAtPath(camera) if camera.startswith("/") and Sdf.Path.IsValidPathString(camera) else None
    what = f"{camera} is a {prim.GetTypeName() or 'typeless prim'}, not a Camera" if prim else f"no camera {camera!r}"
    there = f"cameras there are: {', '.join(paths)}" if paths else "the stage has no camera"
    return f"{what} in {stage.GetRootLayer().identifier}; {there}"


def read_camera(prim: Usd.Prim, sampler: Sampler, aspect: float | None, faults: Faults) -> Camera:
    """Read a camera prim at the sampler's time.

    Parameters
    ----------
    aspect : float or None
        Width over height of the picture; the horizontal aperture is kept. None: the camera's own.

    Raises
    ------
    FexelError
        Aperture, focal length, aspect or transform from which no picture can be made.
    """
    schema, path = UsdGeom.Camera(prim), str(prim.GetPath())
    width = _positive(schema.GetHorizontalApertureAttr(), sampler)
    height = width / aspect if aspect else _positive(schema.GetVerticalApertureAttr(), sampler)
    offset = (
        float(sampler.get(schema.GetHorizontalApertureOffsetAttr(), 0.0)),
        float(sampler.get(schema.GetVerticalApertureOffsetAttr(), 0.0)),
    )
    orthographic = sampler.get(schema.GetProjectionAttr()) == UsdGeom.Tokens.orthographic
    near, far = _clipping_range(schema, sampler, orthographic, faults)
    scale = _APERTURE_UNIT if orthographic else 1.0 / _positive(schema.GetFocalLengthAttr(), sampler)
    window = np.array([offset[0] - width / 2, offset[0] + width / 2, offset[1] - height / 2, offset[1] + height / 2])
    camera_to_world = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(sampler.time))
    sampler.varies = sampler.varies or _transform_varies(prim)
    world_to_camera = _inverse(camera_to_world, path)
    planes = sampler.array(schema.GetClippingPlanesAttr(), np.float64, 4)
    return Camera(
        path=path,
        world_to_camera=world_to_camera,
        camera_to_clip=_projection(window * scale, near, far, orthographic),
        near=near,
        far=far,
        aspect=width / height,
        clipping_planes=() if planes is None else tuple(map(tuple, (world_to_camera @ planes.T).T.tolist())),
    )


def _positive(attribute: Usd.Attribute, sampler: Sampler) -> float:
    """A length that must be above 0."""
    value = float(sampler.get(attribute))
    if not (math.isfinite(value) and value > 0):
        raise FexelError(f"{attribute.GetPath()}: {value}, expected a number above 0")
    return value


def _clipping_range(
    schema: UsdGeom.Camera, sampler: Sampler, orthographic: bool, faults: Faults
) -> tuple[float, float]:
    """Near and far distance; the default range, with a warning, where the authored one is unusable."""
    near, far = (float(x) for x in sampler.get(schema.GetClippingRangeAttr(), _DEFAULT_CLIPPING))
    if math.isfinite(near) and far > near and (orthographic or near > 0):
        return near, min(far, 1e30)  # an infinite far plane: beyond float32 depth anyway
    expected = "near < far" if orthographic else "0 < near < far"
    attribute = schema.GetClippingRangeAttr().GetPath()
    faults.warn(attribute, f"({near}, {far}), expected {expected}; the default {_DEFAULT_CLIPPING} is used")
    return _DEFAULT_CLIPPING


def _projection(window: np.ndarray, near: float, far: float, orthographic: bool) -> np.ndarray:
    """Camera to OpenGL clip space, row vectors; `window` (left, right, bottom, top) is at distance 1 (perspective)."""
    left, right, bottom, top = window
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = 2 / (right - left), 2 / (top - bottom)
    centre = ((right + left) / (right - left), (top + bottom) / (top - bottom))
    if orthographic:
        matrix[2, 2] = -2 / (far - near)
        matrix[3] = (-centre[0], -centre[1], -(far + near) / (far - near), 1)
    else:
        matrix[2] = (*centre, -(far + near) / (far - near), -1)
        matrix[3, 2] = -2 * far * near / (far - near)
    return matrix


def _inverse(camera_to_world: np.ndarray, path: str) -> np.ndarray:
    if not np.isfinite(camera_to_world).all():
        raise FexelError(f"{path}: the camera's transform holds NaN or infinity")
    try:
        return np.linalg.inv(camera_to_world)
    except np.linalg.LinAlgError:
        raise FexelError(f"{path}: the camera's transform is singular, expected one that can be inverted") from None


def _transform_varies(prim: Usd.Prim) -> bool:
    while prim and not prim.IsPseudoRoot():
        xformable = UsdGeom.Xformable(prim)
        if xformable and xformable.TransformMightBeTimeVarying():
            return True
        prim = prim.GetParent()
    return False


def framing_camera(draws: Sequence[Draw], up_axis: str, aspect: float | None) -> Camera:
    """A 50 mm camera before the bounding box of some draws, for a stage without a camera.

    Where the box is taller than usdrecord's placing would show, the camera stands further back. Boxes are those of what
    is drawn, not of authored extents: UsdGeomBBoxCache, which usdrecord asks, ends the process on an instancer that
    is its own prototype and on very deep hierarchies.
    """
    low, high = _bounds(draws)
    center, (width, height, depth) = (low + high) / 2, high - low
    y_up = up_axis != UsdGeom.Tokens.z
    if not y_up:
        height, depth = depth, height
    lens = Gf.Camera()
    shape = aspect or lens.horizontalAperture / lens.verticalAperture
    half_x = lens.horizontalAperture / 2 / lens.focalLength
    distance = max(math.hypot(width, height) / 2 / half_x, height / 2 / (half_x / shape)) + depth / 2
    radius = math.sqrt(width**2 + height**2 + depth**2) / 2
    near, far = max((distance - radius) / 2, distance * 1e-3), (distance + radius) * 2
    to_world = np.eye(4) if y_up else np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    to_world[3, :3] = center + ((0, 0, distance) if y_up else (0, -distance, 0))
    window = np.array([-half_x, half_x, -half_x / shape, half_x / shape])
    return Camera("", np.linalg.inv(to_world), _projection(window, near, far, False), near, far, shape)


def _bounds(draws: Sequence[Draw]) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest world coordinates of the boxes of all meshes; a unit cube where there is nothing."""
    places: dict[int, tuple[np.ndarray, list[np.ndarray]]] = {}
    for draw in draws:
        places.setdefault(id(draw.mesh), (draw.mesh.points, []))[1].append(draw.object_to_world)
    corners = []
    for points, matrices in places.values():
        box = np.stack([points.min(axis=0), points.max(axis=0)])
        eight = np.array([(box[i, 0], box[j, 1], box[k, 2], 1.0) for i in (0, 1) for j in (0, 1) for k in (0, 1)])
        corners.append((eight @ np.array(matrices))[..., :3].reshape(-1, 3))
    if not corners:
        return np.full(3, -0.5), np.full(3, 0.5)
    low, high = np.concatenate(corners).min(axis=0), np.concatenate(corners).max(axis=0)
    return (low, high) if (high > low).any() else (low - 0.5, high + 0.5)
