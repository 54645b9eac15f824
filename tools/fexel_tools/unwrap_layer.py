"""What `fexel unwrap` writes: an indexed primvar into a layer, and the layer to its file, whole or not at all."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Sdf, UsdGeom, Vt

from fexel.errors import FexelError

__all__ = ["UnwrapOptions", "Unwrapped", "author_primvar", "relative_path", "write_layer"]


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


def relative_path(source: Path, output: Path) -> str:
    """Path of a file as the output names it, anchored with ./ so that USD looks beside the layer."""
    relative = Path(os.path.relpath(source.resolve(), output.resolve().parent)).as_posix()
    return relative if relative.startswith("../") else f"./{relative}"


def write_layer(layer: Sdf.Layer, output: Path) -> None:
    """Export beside the output, then rename over it."""
    handle, temporary = tempfile.mkstemp(prefix=f".{output.stem}-", suffix=output.suffix, dir=output.parent)
    os.close(handle)
    try:
        if not layer.Export(temporary):
            raise FexelError(f"{output}: USD could not write it")
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, output)
    finally:
        Path(temporary).unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
