"""`fexel unwrap`: texture coordinates for meshes that have none.

A USD stage is left as it is: the output is a layer over it that adds ``primvars:st`` to its meshes. Of OBJ, GLB, glTF,
PLY, STL and OFF files a new stage is made. Meshes inside scenegraph instances cannot be edited where they appear; the
layer gives every instance of a prototype the same inherited class with the coordinates in it, so that they stay
instances.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from fexel.errors import FexelError
from fexel.stage import open_stage
from fexel_tools.mesh_files import MESH_FORMATS
from fexel_tools.stage_overlay import StageOverlay, check_overlay
from fexel_tools.unwrap_file import convert_file
from fexel_tools.unwrap_layer import UnwrapOptions, Unwrapped, author_primvar
from fexel_tools.uv_atlas import make_atlas

__all__ = ["Unwrapped", "unwrap"]

_USD_FORMATS = (".usd", ".usda", ".usdc", ".usdz")

Progress = Callable[[str, int, int], None]


def unwrap(
    source: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    primvar: str = "st",
    redo: bool = False,
    meshes: Sequence[str] = (),
    resolution: int = 1024,
    padding: int = 2,
    progress: Progress | None = None,
) -> list[Unwrapped]:
    """Make texture coordinates for the meshes of a file.

    Parameters
    ----------
    source : path-like
        A USD stage, or an OBJ, GLB, glTF, PLY, STL or OFF file.
    output : path-like
        Layer to write, ``.usda``, ``.usdc`` or ``.usd``; written beside and renamed.
    primvar : str
        Name of the primvar, without ``primvars:``.
    redo : bool
        Also meshes that have the primvar.
    meshes : sequence of str
        Prim paths; only these meshes, or meshes below these prims. Of USD stages only.
    resolution, padding : int
        Side of the texture that is meant and distance between charts, in texels.
    progress : callable
        Called with what is done, how much of it and of how much.

    Returns
    -------
    list of Unwrapped
        One per mesh that was looked at.

    Raises
    ------
    FexelError
        Missing, damaged or unsupported input; no mesh, an empty mesh, or one that cannot be unwrapped; a wrong option.
    """
    source, output, progress = Path(source), Path(output), progress or _silent
    options = UnwrapOptions(primvar, redo, tuple(meshes), resolution, padding)
    _check_options(source, output, options)
    if source.suffix.lower() in _USD_FORMATS:
        return _unwrap_stage(source, output, options, progress)
    return convert_file(source, output, options, progress)


def _silent(_step: str, _done: int, _total: int) -> None:
    """No progress is shown."""


def _check_options(source: Path, output: Path, options: UnwrapOptions) -> None:
    if not source.is_file():
        raise FexelError(f"{source}: no such file")
    if source.suffix.lower() not in _USD_FORMATS + MESH_FORMATS:
        valid = ", ".join(_USD_FORMATS + MESH_FORMATS)
        raise FexelError(f"{source}: format {source.suffix or 'without extension'}, expected one of {valid}")
    check_overlay(source, output)
    if not Sdf.Path.IsValidNamespacedIdentifier(options.primvar):
        raise FexelError(f"--primvar {options.primvar!r}: not a valid primvar name")
    if options.resolution < 16 or options.padding < 0:
        found = f"--resolution {options.resolution}, --padding {options.padding}"
        raise FexelError(f"{found}: expected at least 16 and 0 texels")


def _unwrap_stage(source: Path, output: Path, options: UnwrapOptions, progress: Progress) -> list[Unwrapped]:
    """Write a layer over a stage."""
    stage = open_stage(source)
    overlay = StageOverlay(stage, source, output, "_fexel_st_")
    targets = list(_target_meshes(stage, source, options))
    results = []
    for done, prim in enumerate(targets):
        progress("meshes", done, len(targets))
        results.append(_unwrap_prim(overlay, prim, options))
    progress("meshes", len(targets), len(targets))
    overlay.write()
    return results


def _target_meshes(stage: Usd.Stage, source: Path, options: UnwrapOptions) -> Iterator[Usd.Prim]:
    """Mesh prims to look at, each shared one once: where it can be edited, or in its prototype."""
    wanted = [_wanted_path(stage, source, path) for path in options.meshes]
    predicate = Usd.PrimIsActive & Usd.PrimIsLoaded & ~Usd.PrimIsAbstract  # prototypes of instancers may be overs
    seen: set[Sdf.Path] = set()
    found = False
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(predicate)):
        path = prim.GetPath()
        if not prim.IsA(UsdGeom.Mesh) or (wanted and not any(path.HasPrefix(prefix) for prefix in wanted)):
            continue
        found = True
        shared = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        if shared.GetPath() not in seen:
            seen.add(shared.GetPath())
            yield prim
    if not found:
        where = f" at or below {', '.join(options.meshes)}" if wanted else ""
        raise FexelError(f"{source}: no mesh{where}")


def _wanted_path(stage: Usd.Stage, source: Path, path: str) -> Sdf.Path:
    if not Sdf.Path.IsValidPathString(path) or not path.startswith("/") or not stage.GetPrimAtPath(path):
        raise FexelError(f"--mesh {path}: no such prim in {source}")
    return Sdf.Path(path)


def _unwrap_prim(overlay: StageOverlay, prim: Usd.Prim, options: UnwrapOptions) -> Unwrapped:
    """Author coordinates for one mesh, unless it has them."""
    mesh, path = UsdGeom.Mesh(prim), str(prim.GetPath())
    points, counts, indices = (
        _first_value(a) for a in (mesh.GetPointsAttr(), mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
    )
    if not options.redo and UsdGeom.PrimvarsAPI(prim).GetPrimvar(options.primvar).HasValue():
        return Unwrapped(path, len(counts), note=f"has primvars:{options.primvar}")
    if any(a.ValueMightBeTimeVarying() for a in (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())):
        return Unwrapped(path, len(counts), note="its faces vary over time, which one unwrapping cannot follow")
    if not len(points) or not len(counts):
        return Unwrapped(path, 0, note="is empty")
    try:
        atlas = make_atlas(points, counts, indices, options.resolution, options.padding)
    except FexelError as error:
        raise FexelError(f"{path}: {error}") from None
    st = atlas.st
    if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
        st = np.float32([1, 0]) + st * np.float32([-1, 1])  # outside is the other side
    author_primvar(overlay.layer, overlay.editable_path(prim), options.primvar, st, atlas.corner_indices)
    return Unwrapped(path, len(counts), atlas.chart_count, atlas.utilization)


def _first_value(attribute: Usd.Attribute) -> np.ndarray:
    """The attribute's value at its first time sample, or its default."""
    value = attribute.Get(Usd.TimeCode.EarliestTime())
    return np.zeros(0) if value is None else np.asarray(value)
