"""What `fexel unwrap` writes: an indexed primvar into a layer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pxr import Sdf, UsdGeom, Vt

__all__ = ["UnwrapOptions", "Unwrapped", "author_primvar"]


@dataclass(frozen=True)
class Unwrapped:
    """What became of one mesh.

    Attributes
    ----------
    path : str
        Prim path in the output.
    face_count : int
    chart_count : int
        0 where the mesh kept the coordinates it had, or was skipped.
    utilization : float
        Share of the texture that charts cover, [0, 1].
    note : str
        Why the mesh was not unwrapped, or ''.
    """

    path: str
    face_count: int
    chart_count: int = 0
    utilization: float = 0.0
    note: str = ""


@dataclass(frozen=True)
class UnwrapOptions:
    """What a user asked for; see `fexel_tools.unwrap.unwrap`."""

    primvar: str
    redo: bool
    meshes: tuple[str, ...]
    resolution: int
    padding: int


def author_primvar(layer: Sdf.Layer, path: Sdf.Path, name: str, st: np.ndarray, indices: np.ndarray) -> None:
    """Author an indexed faceVarying primvar."""
    prim = Sdf.CreatePrimInLayer(layer, path)
    for attribute_name, type_name, value in (
        (
            f"primvars:{name}",
            Sdf.ValueTypeNames.TexCoord2fArray,
            Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(st, np.float32)),
        ),
        (
            f"primvars:{name}:indices",
            Sdf.ValueTypeNames.IntArray,
            Vt.IntArray.FromNumpy(np.ascontiguousarray(indices, np.int32)),
        ),
    ):
        attribute = prim.attributes.get(attribute_name) or Sdf.AttributeSpec(prim, attribute_name, type_name)
        attribute.default = value
    prim.attributes[f"primvars:{name}"].SetInfo("interpolation", UsdGeom.Tokens.faceVarying)
