"""Vertex and index buffers of meshes, cached by the identity of the `Mesh`.

Positions are stored as float32 relative to the middle of the mesh's bounds, so that a mesh far from its own origin
keeps its shape; the matrix that goes with them is composed in float64. Buffers of a mesh that no longer exists are
freed at the next `collect`.
"""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING

import numpy as np

from fexel.scene.model import Mesh

if TYPE_CHECKING:
    import moderngl

    from fexel.renderer.visible import RebasedMesh

__all__ = ["MeshBuffers", "MeshCache", "rebased_buffers"]

_FORMATS = {1: "1f", 2: "2f", 3: "3f", 4: "4f"}


class MeshBuffers:
    """Buffers of one mesh and the vertex arrays that bind them to programs.

    `origin` (3,) float64: object-space point that the positions are relative to. `bounds` (2, 3) float64: object space.
    """

    def __init__(self, gl: moderngl.Context, attributes: dict[str, np.ndarray], triangles: np.ndarray) -> None:
        self._gl = gl
        self._buffers = {
            name: (_upload(gl, array), _FORMATS[1 if array.ndim == 1 else array.shape[1]])
            for name, array in attributes.items()
        }
        self._indices = gl.buffer(np.ascontiguousarray(triangles, np.int32).tobytes()) if len(triangles) else None
        self._arrays: dict[tuple, moderngl.VertexArray] = {}
        self.origin = np.zeros(3)
        self.bounds = np.zeros((2, 3))
        self.triangle_count = len(triangles)

    def vertex_array(self, program: moderngl.Program, names: dict[str, str]) -> moderngl.VertexArray:
        """Vertex array for `program`; `names`: attribute in the shader to the buffer's name."""
        key = (program.glo, tuple(sorted(names.items())))
        if key not in self._arrays:
            content = [
                (*self._buffers[source], attribute)
                for attribute, source in names.items()
                if attribute in program and source in self._buffers
            ]
            self._arrays[key] = self._gl.vertex_array(program, content, index_buffer=self._indices)
        return self._arrays[key]

    @property
    def nbytes(self) -> int:
        """Bytes on the GPU."""
        buffers = [buffer for buffer, _format in self._buffers.values()]
        return sum(buffer.size for buffer in buffers) + (self._indices.size if self._indices else 0)

    def release(self) -> None:
        """Free everything."""
        for array in self._arrays.values():
            array.release()
        for buffer, _format in self._buffers.values():
            buffer.release()
        if self._indices:
            self._indices.release()


def _upload(gl: moderngl.Context, array: np.ndarray) -> moderngl.Buffer:
    return gl.buffer(np.ascontiguousarray(array, np.float32).tobytes())


def _mesh_buffers(gl: moderngl.Context, mesh: Mesh) -> MeshBuffers:
    bounds = np.stack([mesh.points.min(axis=0), mesh.points.max(axis=0)])
    origin = bounds.mean(axis=0)
    attributes = {"position": mesh.points - origin, "normal": mesh.normals}
    if mesh.display_color is not None:
        attributes["displayColor"] = mesh.display_color
    if mesh.display_opacity is not None:
        attributes["displayOpacity"] = mesh.display_opacity
    attributes |= {f"st:{name}": st for name, st in mesh.st.items()}
    buffers = MeshBuffers(gl, attributes, mesh.triangles)
    buffers.origin, buffers.bounds = origin, bounds
    return buffers


def rebased_buffers(gl: moderngl.Context, rebased: RebasedMesh) -> MeshBuffers:
    """Buffers of a re-based mesh; the caller releases them after the draw."""
    attributes = {"clipPosition": rebased.clip_position, "normal": rebased.normal}
    if rebased.display_color is not None:
        attributes["displayColor"] = rebased.display_color
    if rebased.display_opacity is not None:
        attributes["displayOpacity"] = rebased.display_opacity
    attributes |= {f"st:{name}": st for name, st in rebased.st.items()}
    return MeshBuffers(gl, attributes, rebased.triangles)


class MeshCache:
    """`MeshBuffers` by mesh."""

    def __init__(self, gl: moderngl.Context) -> None:
        self._gl = gl
        self._buffers: dict[int, MeshBuffers] = {}
        self._dead: list[int] = []

    def get(self, mesh: Mesh) -> MeshBuffers:
        """Buffers of `mesh`, uploaded on first use."""
        self.collect()  # an id may have passed from a dead mesh to this one
        key = id(mesh)
        if key not in self._buffers:
            self._buffers[key] = _mesh_buffers(self._gl, mesh)
            weakref.finalize(mesh, self._dead.append, key)
        return self._buffers[key]

    def collect(self) -> None:
        """Free the buffers of meshes that no longer exist. To be called with the context current."""
        while self._dead:
            buffers = self._buffers.pop(self._dead.pop(), None)
            if buffers:
                buffers.release()

    @property
    def nbytes(self) -> int:
        """Bytes on the GPU."""
        return sum(buffers.nbytes for buffers in self._buffers.values())

    def release(self) -> None:
        """Free everything."""
        for buffers in self._buffers.values():
            buffers.release()
        self._buffers.clear()
