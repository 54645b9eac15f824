"""Mesh files other than USD: OBJ with its polygons as they are, GLB, glTF, PLY, STL and OFF through trimesh.

OBJ is read here because trimesh cuts polygons into triangles. Its objects and groups become one mesh. Scenes (glTF)
give one mesh per node, with the node's transform.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fexel.errors import FexelError

__all__ = ["MESH_FORMATS", "FileMesh", "read_mesh_file"]

MESH_FORMATS = (".obj", ".glb", ".gltf", ".ply", ".stl", ".off")


@dataclass(frozen=True, eq=False)
class FileMesh:
    """A mesh as a file has it.

    Attributes
    ----------
    name : str
    points : (P, 3) float64
    counts, indices : (F,), (C,) int64
    st : (U, 2) float64 or None
    st_indices : (C,) int64 or None
        Row of `st` for each corner.
    matrix : (4, 4) float64
        Mesh to scene, row vectors.
    texture : path, image or None
        Colour texture that the file binds: a Path, or a PIL image embedded in the file.
    """

    name: str
    points: np.ndarray
    counts: np.ndarray
    indices: np.ndarray
    st: np.ndarray | None
    st_indices: np.ndarray | None
    matrix: np.ndarray
    texture: Any = None


def read_mesh_file(path: Path) -> list[FileMesh]:
    """Read all meshes of a file.

    Raises
    ------
    FexelError
        Missing or damaged file, a format that is not supported, or no mesh in it.
    """
    if not path.is_file():
        raise FexelError(f"{path}: no such file")
    suffix = path.suffix.lower()
    if suffix not in MESH_FORMATS:
        raise FexelError(f"{path}: format {suffix or 'without extension'}, expected one of {', '.join(MESH_FORMATS)}")
    meshes = [_read_obj(path)] if suffix == ".obj" else list(_read_with_trimesh(path))
    meshes = [mesh for mesh in meshes if len(mesh.counts)]
    if not meshes:
        raise FexelError(f"{path}: no faces in it, expected a mesh")
    return meshes


def _read_obj(path: Path) -> FileMesh:
    """Polygons and texture coordinates of a Wavefront OBJ; lines of other kinds are skipped."""
    points: list[list[float]] = []
    coordinates: list[list[float]] = []
    counts: list[int] = []
    corners: list[tuple[int, int]] = []
    texture, number = None, 0
    try:
        for number, words in _obj_lines(path):  # noqa: B007, told by the error
            if words[0] == "v":
                points.append([float(word) for word in words[1:4]])
            elif words[0] == "vt":
                coordinates.append([float(word) for word in words[1:3]] + [0.0] * (3 - len(words)))
            elif words[0] == "f":
                face = [_obj_corner(word, len(points), len(coordinates)) for word in words[1:]]
                counts.append(len(face))
                corners += face
            elif words[0] == "mtllib" and texture is None:
                texture = _obj_texture(path.parent / " ".join(words[1:]))
    except (ValueError, IndexError) as error:
        raise FexelError(f"{path}: line {number}: {error}, expected an OBJ file") from None
    rows = np.array(corners, np.int64).reshape(-1, 2)
    _check_rows(path, rows, points, coordinates)
    mapped = bool(coordinates) and bool(len(rows)) and rows[:, 1].min() >= 0
    return FileMesh(
        name=path.stem,
        points=np.array(points, np.float64).reshape(-1, 3),
        counts=np.array(counts, np.int64),
        indices=rows[:, 0],
        st=np.array(coordinates, np.float64).reshape(-1, 2) if mapped else None,
        st_indices=rows[:, 1] if mapped else None,
        matrix=np.eye(4),
        texture=texture if mapped else None,
    )


def _obj_lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and words of the lines that hold any; a backslash continues a line."""
    pending = ""
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            text = pending + line.rstrip("\r\n")
            if text.endswith("\\"):
                pending = text[:-1] + " "
                continue
            pending = ""
            if words := text.split("#", 1)[0].split():
                yield number, words


def _obj_corner(word: str, point_count: int, coordinate_count: int) -> tuple[int, int]:
    """Point and texture coordinate of ``v/vt/vn``, from 0 (-1: no coordinate); negative numbers count from the end."""
    parts = word.split("/")
    point = int(parts[0])
    coordinate = int(parts[1]) if len(parts) > 1 and parts[1] else 0
    return (
        point - 1 if point > 0 else point_count + point,
        coordinate - 1 if coordinate > 0 else coordinate_count + coordinate if coordinate else -1,
    )


def _check_rows(path: Path, rows: np.ndarray, points: list, coordinates: list) -> None:
    for column, values, what in ((0, points, "vertex"), (1, coordinates, "texture coordinate")):
        if not len(rows):
            return
        low, high = rows[:, column].min(), rows[:, column].max()
        if high >= len(values) or low < -column:
            bad = high + 1 if high >= len(values) else low + 1
            raise FexelError(f"{path}: a face names {what} {bad}, expected 1 to {len(values)}")


def _obj_texture(path: Path) -> Path | None:
    """The first ``map_Kd`` of a material library, where the file exists."""
    if not path.is_file():
        return None
    for _, words in _obj_lines(path):
        if words[0] == "map_Kd":
            for name in (" ".join(words[1:]), words[-1]):  # the whole rest, or its end after options
                if (path.parent / name).is_file():
                    return path.parent / name
    return None


def _read_with_trimesh(path: Path) -> Iterator[FileMesh]:
    import trimesh

    try:
        scene = trimesh.load_scene(path, process=False)
    except Exception as error:  # each of trimesh's parsers raises its own kinds
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FexelError(f"{path}: cannot be read as {path.suffix.lower()}: {reason}") from None
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        mesh = scene.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh):
            continue
        faces = np.asarray(mesh.faces, np.int64)
        st = getattr(mesh.visual, "uv", None)
        st = np.asarray(st, np.float64) if st is not None and len(st) == len(mesh.vertices) else None
        yield FileMesh(
            name=path.stem if str(node) == path.name else str(node),
            points=np.asarray(mesh.vertices, np.float64),
            counts=np.full(len(faces), 3, np.int64),
            indices=faces.ravel(),
            st=st,
            st_indices=None if st is None else faces.ravel(),
            matrix=np.asarray(matrix, np.float64).T,
            texture=None if st is None else _embedded_texture(mesh.visual),
        )


def _embedded_texture(visual: Any) -> Any:
    """The base colour image of a trimesh material, or None."""
    material = getattr(visual, "material", None)
    return getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
