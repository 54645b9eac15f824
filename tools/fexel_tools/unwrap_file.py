"""A stage of a mesh file: polygons, transforms, texture coordinates, and the colour texture where there is one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdShade, Vt

from fexel.errors import FexelError
from fexel_tools.mesh_files import FileMesh, read_mesh_file
from fexel_tools.stage_overlay import relative_path, write_layer
from fexel_tools.unwrap_layer import UnwrapOptions, Unwrapped, author_primvar
from fexel_tools.uv_atlas import Atlas, make_atlas

__all__ = ["convert_file"]


def convert_file(
    source: Path, output: Path, options: UnwrapOptions, progress: Callable[[str, int, int], None]
) -> list[Unwrapped]:
    """Make a stage of a mesh file."""
    if options.meshes:
        raise FexelError(f"--mesh names prims of a USD stage; {source} is none")
    meshes = read_mesh_file(source)
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, f"/{Tf.MakeValidIdentifier(source.stem)}")
    stage.SetDefaultPrim(root.GetPrim())
    results = []
    images: dict[Path, Any] = {}  # embedded ones, written once every mesh is done
    for done, mesh in enumerate(meshes):
        progress("meshes", done, len(meshes))
        results.append(_convert_mesh(stage, root.GetPath(), mesh, source, output, options, images))
    progress("meshes", len(meshes), len(meshes))
    for path, image in images.items():
        temporary = path.with_name(f".{path.name}")
        image.save(temporary, format="PNG")
        temporary.replace(path)
    write_layer(stage.GetRootLayer(), output)
    return results


def _convert_mesh(
    stage: Usd.Stage,
    parent: Sdf.Path,
    mesh: FileMesh,
    source: Path,
    output: Path,
    options: UnwrapOptions,
    images: dict[Path, Any],
) -> Unwrapped:
    path = _free_path_below(stage, parent, "Mesh" if mesh.name == source.stem else Tf.MakeValidIdentifier(mesh.name))
    keeps = mesh.st is not None and not options.redo
    atlas = Atlas(mesh.st, mesh.st_indices, 0, 0.0) if keeps else None
    try:
        atlas = atlas or make_atlas(mesh.points, mesh.counts, mesh.indices, options.resolution, options.padding)
    except FexelError as error:
        raise FexelError(f"{source}: {mesh.name}: {error}") from None
    prim = UsdGeom.Mesh.Define(stage, path)
    points = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(mesh.points, np.float32))
    prim.CreatePointsAttr(points)
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(mesh.counts.astype(np.int32)))
    prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.indices.astype(np.int32)))
    prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    if not np.array_equal(mesh.matrix, np.eye(4)):
        prim.AddTransformOp().Set(Gf.Matrix4d(mesh.matrix.tolist()))
    author_primvar(stage.GetRootLayer(), path, options.primvar, atlas.st, atlas.corner_indices)
    if keeps and mesh.texture is not None:
        _bind_texture(stage, prim, _texture_path(prim, mesh.texture, output, images), options.primvar)
    note = "keeps the coordinates of the file" if keeps else ""
    return Unwrapped(str(path), len(mesh.counts), atlas.chart_count, atlas.utilization, note)


def _free_path_below(stage: Usd.Stage, parent: Sdf.Path, name: str) -> Sdf.Path:
    number, path = 0, parent.AppendChild(name)
    while stage.GetPrimAtPath(path):
        number += 1
        path = parent.AppendChild(f"{name}_{number}")
    return path


def _texture_path(mesh: UsdGeom.Mesh, texture: Any, output: Path, images: dict[Path, Any]) -> str:
    """The colour texture as the stage names it; an embedded image is put down to be written beside the output."""
    if isinstance(texture, Path):
        return relative_path(texture, output)
    path = output.with_name(f"{output.stem}_{mesh.GetPrim().GetName()}.png")
    images[path] = texture.convert("RGBA" if "A" in texture.getbands() else "RGB")
    return f"./{path.name}"


def _bind_texture(stage: Usd.Stage, mesh: UsdGeom.Mesh, file: str, primvar: str) -> None:
    """A UsdPreviewSurface with the file's colour texture."""
    name = mesh.GetPrim().GetName()
    material = UsdShade.Material.Define(stage, mesh.GetPath().GetParentPath().AppendChild(f"{name}_material"))
    surface, reader, image = (
        UsdShade.Shader.Define(stage, material.GetPath().AppendChild(part)) for part in ("surface", "reader", "texture")
    )
    surface.CreateIdAttr("UsdPreviewSurface")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    image.CreateIdAttr("UsdUVTexture")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(primvar)
    image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(file))
    for wrap in ("wrapS", "wrapT"):
        image.CreateInput(wrap, Sdf.ValueTypeNames.Token).Set("repeat")
    image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
        reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    )
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
        image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    )
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
