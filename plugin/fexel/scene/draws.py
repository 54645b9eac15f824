"""Draws: every occurrence of a mesh, with its material and place.

Meshes are read when they are first seen and again only where they vary; instances share what was read from their
prototype. The draws of a prim are made anew only when its mesh, material or place is another object than before.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from pxr import Usd, UsdGeom, UsdShade

from fexel.errors import FexelError
from fexel.scene.gprims import extract_gprim
from fexel.scene.hierarchy import GPRIM, INSTANCER, MESH, PrimNode, Tree
from fexel.scene.instancer import Placements, place_instances
from fexel.scene.material import MaterialReader, shared_path, textures_of, without_textures
from fexel.scene.mesh import MeshParts, extract_mesh
from fexel.scene.model import Draw, Material, Mesh
from fexel.scene.sampling import Faults, Sampler

__all__ = ["DrawBuilder"]

_ONCE = np.eye(4)[None]


@dataclass(frozen=True, eq=False)
class _Occurrence:
    """A prim to draw: once for each matrix, with a display colour of its own where `colors` has one."""

    node: PrimNode
    matrices: np.ndarray
    colors: np.ndarray | None


@dataclass(eq=False)
class _Made:
    """Draws made for a node, and what they were made from."""

    parts: MeshParts
    materials: list[Material]
    occurrence: _Occurrence
    draws: list[Draw]

    def is_at(self, other: _Occurrence) -> bool:
        """Whether places and colours are those of another occurrence."""
        before, colors = self.occurrence, other.colors
        same_colors = before.colors is colors or (
            before.colors is not None and colors is not None and np.array_equal(before.colors, colors)
        )
        return same_colors and np.array_equal(before.matrices, other.matrices)


class DrawBuilder:
    """Makes the draws of a tree of prims at the time to which the tree was updated.

    Attributes
    ----------
    prim_paths : tuple of str
        Paths of all prims that may be drawn; `Draw.prim_id` is an index into it.
    """

    def __init__(
        self,
        stage: Usd.Stage,
        tree: Tree,
        refine_level: int,
        faults: Faults,
        lacking: dict[str, str] | None = None,
    ):
        self._stage = stage
        self._lacking = lacking
        self._tree = tree
        self._refine_level = refine_level
        self._faults = faults
        self._materials = MaterialReader(faults)
        self._meshes: dict[str, tuple[Sampler, MeshParts | None]] = {}
        self._placements: dict[int, tuple[Sampler, Placements]] = {}
        self._made: dict[tuple[int, int], _Made] = {}
        self._variants: dict[tuple[int, tuple], tuple[Material, Material]] = {}  # holds the original, so its id lasts
        self._draws: tuple[Draw, ...] = ()
        self._color_varies = False
        nodes = [node for node in _all_nodes(tree) if node.kind in (MESH, GPRIM) and node.drawn]
        self.prim_paths = tuple(dict.fromkeys(str(node.prim.GetPath()) for node in nodes))
        self._prim_ids = {path: index for index, path in enumerate(self.prim_paths)}
        self._bound = _bindings(nodes)

    def at(self, time: Usd.TimeCode) -> tuple[Draw, ...]:
        """All draws; the same tuple as before where nothing changed."""
        if self._made and self._serves(time):
            return self._draws
        collected: list[list[Draw]] = []
        used: dict[int, int] = {}
        for occurrence in self._occurrences(self._tree, _ONCE, None, time):
            turn = used[id(occurrence.node)] = used.get(id(occurrence.node), -1) + 1
            collected.append(self._draws_of(occurrence, turn, time))
        flat = tuple(draw for draws in collected for draw in draws)
        if len(flat) != len(self._draws) or any(a is not b for a, b in zip(flat, self._draws, strict=True)):
            self._draws = flat
        return self._draws

    def _serves(self, time: Usd.TimeCode) -> bool:
        """Whether nothing that the draws were made from varies."""
        read = (*self._meshes.values(), *self._placements.values())
        varies = self._tree.varies or self._color_varies or any(sampler.varies for sampler, _ in read)
        return not varies and self._materials.serves(time)

    def _occurrences(
        self, tree: Tree, outer: np.ndarray, colors: np.ndarray | None, time: Usd.TimeCode
    ) -> Iterator[_Occurrence]:
        """Prims of a tree that is placed at each of `outer`, prototypes of its instancers included."""
        for node in tree.nodes:
            if not node.visible or not node.drawn:
                continue
            if node.kind in (MESH, GPRIM):
                yield _Occurrence(node, node.world[None] if outer is _ONCE else node.world @ outer, colors)
            elif node.kind == INSTANCER:
                placements = self._place(node, time)
                for prototype, inner, own in zip(node.prototypes, placements.matrices, placements.colors, strict=True):
                    placed = ((inner @ node.world)[:, None] @ outer[None]).reshape(-1, 4, 4)
                    tints = _spread(own, colors, len(inner), len(outer))
                    if len(placed):
                        yield from self._occurrences(prototype, placed, tints, time)

    def _place(self, node: PrimNode, time: Usd.TimeCode) -> Placements:
        sampler, placements = self._placements.get(id(node), (None, None))
        if sampler is None or (sampler.varies and sampler.time != time):
            sampler = Sampler(time)
            placements = place_instances(node.prim, len(node.prototypes), sampler, self._faults)
            self._placements[id(node)] = (sampler, placements)
        return placements

    def _parts(self, node: PrimNode, time: Usd.TimeCode) -> MeshParts | None:
        """The mesh of a prim, read from its prototype where it is in an instance."""
        key = shared_path(node.prim)
        sampler, parts = self._meshes.get(key, (None, None))
        if sampler is None or (sampler.varies and sampler.time != time):
            sampler = Sampler(time)
            if node.kind == MESH:
                parts = extract_mesh(node.prim, sampler, self._faults, self._refine_level)
            else:
                mesh = extract_gprim(node.prim, sampler, self._faults)
                parts = mesh and MeshParts(mesh, (("", 0, len(mesh.triangles)),))
            self._meshes[key] = (sampler, parts)
        return parts

    def _draws_of(self, occurrence: _Occurrence, turn: int, time: Usd.TimeCode) -> list[Draw]:
        """Draws of one prim; `turn` tells apart the occurrences of a prototype under several instancers."""
        node = occurrence.node
        parts = self._parts(node, time)
        if parts is None:
            return []
        materials = [self._material(node, name, parts.mesh, time) for name, _, _ in parts.ranges]
        made = self._made.get((id(node), turn))
        if made and made.parts is parts and made.materials == materials and made.is_at(occurrence):
            return made.draws
        draws = self._make(occurrence, parts, materials)
        self._made[id(node), turn] = _Made(parts, materials, occurrence, draws)
        return draws

    def _make(self, occurrence: _Occurrence, parts: MeshParts, materials: list[Material]) -> list[Draw]:
        prim = occurrence.node.prim
        path, double_sided = str(prim.GetPath()), bool(UsdGeom.Gprim(prim).GetDoubleSidedAttr().Get())
        usable = np.flatnonzero(self._is_usable(path, occurrence.matrices))
        draws = []
        for (_, first, count), material in zip(parts.ranges, materials, strict=True):
            for index in usable:
                shown = material
                if occurrence.colors is not None and parts.mesh.display_color is None:
                    shown = self._tint(material, tuple(occurrence.colors[index].tolist()))
                matrix = occurrence.matrices[index]
                draws.append(Draw(parts.mesh, first, count, matrix, shown, path, self._prim_ids[path], double_sided))
        return draws

    def _is_usable(self, path: str, matrices: np.ndarray) -> np.ndarray:
        """(N,) bool: finite and invertible. A scale of 0 hides a prim without a word, as artists use it."""
        finite = np.isfinite(matrices).all(axis=(1, 2))
        if not finite.all():
            self._faults.warn(path, "its transform holds NaN or infinity; prim skipped")
        usable = finite.copy()
        usable[finite] = np.linalg.det(matrices[finite]) != 0
        return usable

    def _material(self, node: PrimNode, subset: str, mesh: Mesh, time: Usd.TimeCode) -> Material:
        """The material of a prim or subset, tinted by an inherited display colour, fit for what the mesh has."""
        path = str(node.prim.GetPath())
        material = self._materials.read(self._bound.get(f"{path}/{subset}" if subset else path), time)
        if node.color is not None and mesh.display_color is None:
            sampler = Sampler(time)
            color = sampler.array(node.color.GetAttribute("primvars:displayColor"), np.float64, 3)
            self._color_varies = self._color_varies or sampler.varies
            if color is not None and len(color) and np.isfinite(color[0]).all():
                material = self._tint(material, tuple(color[0].tolist()))
        missing = {t.st_primvar for _, t in textures_of(material) if t.st_primvar not in mesh.st}
        return self._without(material, node.prim, missing, time) if missing else material

    def _tint(self, material: Material, color: tuple[float, ...]) -> Material:
        """The material with a display colour from outside the mesh; the same object for the same colour."""
        if not material.uses_display_color:
            return material
        _, tinted = self._variants.get((id(material), color), (None, None))
        if tinted is None:
            tinted = replace(material, inputs={**material.inputs, "diffuseColor": color}, uses_display_color=False)
            self._variants[id(material), color] = (material, tinted)
        return tinted

    def _without(self, material: Material, prim: Usd.Prim, missing: set[str], time: Usd.TimeCode) -> Material:
        """The material without textures whose primvar was dropped as damaged; an error where it was never there.

        With `lacking` that is a note instead.
        """
        for name, texture in textures_of(material):
            if texture.st_primvar in missing and not _has_primvar(prim, texture.st_primvar):
                if self._lacking is not None:
                    self._lacking[texture.path] = f"{prim.GetPath()} lacks primvar {texture.st_primvar!r}"
                    continue
                reads = f"{name} of {material.path} reads texture {texture.path} through primvar {texture.st_primvar!r}"
                raise FexelError(
                    f"{prim.GetPath()}: {reads}, which the prim lacks; {_advice(prim, texture.st_primvar)}"
                )
        key = (id(material), tuple(sorted(missing)))
        _, plain = self._variants.get(key, (None, None))
        if plain is None:
            plain = without_textures(material, missing, self._stage, time)
            self._variants[key] = (material, plain)
        return plain


def _has_primvar(prim: Usd.Prim, name: str) -> bool:
    return bool(UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name).HasValue())


def _advice(prim: Usd.Prim, primvar: str) -> str:
    """What to do about missing texture coordinates."""
    if not prim.IsA(UsdGeom.Mesh):
        return f"a {prim.GetTypeName()} has only 'st'"
    file = prim.GetStage().GetRootLayer().realPath or "STAGE"
    option = "" if primvar == "st" else f" --primvar {primvar}"
    return f"make it with: fexel unwrap {file} -o OUT.usda{option}"


def _spread(own: np.ndarray | None, outer: np.ndarray | None, inner_count: int, outer_count: int) -> np.ndarray | None:
    """Colours of inner_count * outer_count instances, the inner index the slower: their own, else their instancer's."""
    if own is not None:
        return np.repeat(own, outer_count, axis=0)
    return None if outer is None else np.tile(outer, (inner_count, 1))


def _all_nodes(tree: Tree) -> Iterator[PrimNode]:
    for node in tree.nodes:
        yield node
        for prototype in node.prototypes:
            yield from _all_nodes(prototype)


def _bindings(nodes: list[PrimNode]) -> dict[str, Usd.Prim]:
    """Material prims by path of the prim or subset that they are bound to; usdrecord's purpose, preview."""
    prims = [node.prim for node in nodes]
    for node in nodes:
        if node.kind == MESH:
            subsets = UsdShade.MaterialBindingAPI(node.prim).GetMaterialBindSubsets()
            prims += [subset.GetPrim() for subset in subsets]
    if not prims:
        return {}
    materials, _ = UsdShade.MaterialBindingAPI.ComputeBoundMaterials(prims, UsdShade.Tokens.preview)
    return {str(p.GetPath()): m.GetPrim() for p, m in zip(prims, materials, strict=True) if m and m.GetPrim()}
