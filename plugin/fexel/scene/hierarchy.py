"""The prims of a stage that a picture can need, found once, with what their place and visibility depend on.

A `Tree` holds prims depth first, so that one pass in order brings all transforms and visibilities to a time; only what
varies is read again. Scenegraph instances are walked as instance proxies. The prototypes of a PointInstancer are trees
of their own whose root has no parent; what lies below the instancer is drawn through it alone.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdShade, UsdSkel

from fexel.scene.gprims import GPRIM_TYPES
from fexel.scene.sampling import Faults

__all__ = ["PrimNode", "Tree", "build_tree"]

MESH, GPRIM, INSTANCER, LIGHT, GROUP = "mesh", "gprim", "instancer", "light", "group"
_SHADING, _NOT_DRAWN = "shading", "not drawn"
_IDENTITY = np.eye(4)
_DEEPEST_NESTING = 16  # of instancers within prototypes: a prototype may name its own instancer


@dataclass(eq=False)
class PrimNode:
    """A prim and its state at the time last asked for.

    Attributes
    ----------
    parent : int
        Index into `Tree.nodes`, -1 for none.
    kind : str
    drawn : bool
        Whether purpose and mask let it be drawn.
    color : Usd.Prim or None
        The nearest prim, this one excluded, whose constant displayColor the prim inherits.
    prototypes : list of Tree
        Of an instancer.
    place_varies : bool
        Whether its own or an ancestor's transform varies.
    world : (4, 4) float64
        To the tree's root space.
    visible : bool
    """

    prim: Usd.Prim
    parent: int
    kind: str
    drawn: bool
    purpose: str
    color: Usd.Prim | None = None
    prototypes: list[Tree] = field(default_factory=list)
    local: np.ndarray | None = None
    resets: bool = False
    transform_varies: bool = False
    place_varies: bool = False
    visibility_varies: bool = False
    own_visible: bool = True
    world: np.ndarray = field(default_factory=lambda: _IDENTITY)
    visible: bool = True
    moved: bool = True


@dataclass(eq=False)
class Tree:
    """Prims depth first. `varies`: whether any transform or visibility in it, prototypes included, does."""

    nodes: list[PrimNode]
    time: Usd.TimeCode | None = None
    varies: bool = False

    def update(self, time: Usd.TimeCode) -> None:
        """Bring transforms and visibilities to `time`."""
        if self.time is not None and (self.time == time or not self.varies):
            return
        for node in self.nodes:
            parent = self.nodes[node.parent] if node.parent >= 0 else None
            self._place(node, parent, time)
            for prototype in node.prototypes:
                prototype.update(time)
        self.time = time

    def _place(self, node: PrimNode, parent: PrimNode | None, time: Usd.TimeCode) -> None:
        if node.transform_varies:
            node.local = _local_matrix(node.prim, time)
        if node.visibility_varies:
            node.own_visible = _is_visible(node.prim, time)
        node.moved = self.time is None or node.transform_varies or bool(parent and parent.moved and not node.resets)
        if node.moved:
            above = _IDENTITY if parent is None or node.resets else parent.world
            node.world = above if node.local is None else node.local @ above
        node.visible = node.own_visible and (parent is None or parent.visible)


def build_tree(
    stage: Usd.Stage, purposes: Collection[str], mask: Sequence[Sdf.Path], faults: Faults, time: Usd.TimeCode
) -> Tree:
    """The tree of a whole stage: what is active, loaded, defined and not abstract.

    Parameters
    ----------
    time : Usd.TimeCode
        What does not vary is read here. It may differ between the default time and all others (a lone time sample
        counts for the others only), so that a tree serves either the one or the others.
    """
    walk = _Walk(set(purposes), tuple(mask), faults, time)
    return walk.tree(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies(), None)


class _Walk:
    """Builds trees; holds what is the same for all of a stage."""

    def __init__(self, purposes: set[str], mask: tuple[Sdf.Path, ...], faults: Faults, time: Usd.TimeCode):
        self.time = time
        self.purposes = purposes
        self.mask = mask
        self.faults = faults
        self.kinds: dict[str, str] = {}

    def tree(self, root: Usd.Prim, predicate: Any, owner: PrimNode | None, depth: int = 0) -> Tree:
        """The tree below and including `root`, a prototype of the instancer `owner` unless that is None."""
        tree = Tree([])
        stack: list[tuple[Usd.Prim, int]] = [(root, -1)]
        while stack:
            prim, parent = stack.pop()
            if not self._may_be_drawn(prim, depth):
                continue
            node = self._node(prim, tree.nodes[parent] if parent >= 0 else owner, parent, depth)
            if node.kind == _SHADING or not (node.own_visible or node.visibility_varies):
                continue
            index = len(tree.nodes)
            tree.nodes.append(node)
            tree.varies |= node.transform_varies or node.visibility_varies
            if node.kind == INSTANCER:
                node.prototypes = self._prototypes(node, depth)
                tree.varies |= any(prototype.varies for prototype in node.prototypes)
            else:
                stack += [(child, index) for child in reversed(prim.GetFilteredChildren(predicate))]
        return tree

    def _may_be_drawn(self, prim: Usd.Prim, depth: int) -> bool:
        """Whether the mask leaves the prim or something below it; prototypes go with their instancer."""
        if not self.mask or depth:
            return True
        path = prim.GetPath()
        return any(path.HasPrefix(masked) or masked.HasPrefix(path) for masked in self.mask)

    def _node(self, prim: Usd.Prim, parent: PrimNode | None, parent_index: int, depth: int) -> PrimNode:
        kind = self._kind(prim)
        purpose = _purpose(prim, parent.purpose if parent else UsdGeom.Tokens.default_)
        masked = bool(self.mask) and not depth and not any(prim.GetPath().HasPrefix(path) for path in self.mask)
        if kind == _NOT_DRAWN:
            self.faults.warn(prim.GetPath(), f"{prim.GetTypeName()} is not drawn; only meshes and solids are")
        node = PrimNode(prim, parent_index, kind, purpose in self.purposes and not masked, purpose)
        node.color = _color_source(parent)
        _read_transform(node, self.time)
        _read_visibility(node, self.time)
        inherited_varies = parent is not None and parent_index >= 0 and not node.resets and parent.place_varies
        node.place_varies = node.transform_varies or inherited_varies
        return node

    def _kind(self, prim: Usd.Prim) -> str:
        type_name = prim.GetTypeName()
        kind = self.kinds.get(type_name)
        if kind is None:
            kind = self.kinds[type_name] = _classify(prim)
        if type_name == "SkelRoot":
            self.faults.warn(prim.GetPath(), "skeletal deformation is not evaluated; meshes show their rest shape")
        return kind

    def _prototypes(self, instancer: PrimNode, depth: int) -> list[Tree]:
        """A tree per prototype; an empty one, with a warning, for a target that does not exist."""
        trees, prim = [], instancer.prim
        predicate = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded & ~Usd.PrimIsAbstract)
        for path in UsdGeom.PointInstancer(prim).GetPrototypesRel().GetForwardedTargets():
            root = prim.GetStage().GetPrimAtPath(path)
            if not root or depth >= _DEEPEST_NESTING:
                fault = f"prototype {path} does not exist" if not root else f"nested over {_DEEPEST_NESTING} deep"
                self.faults.warn(prim.GetPath(), f"{fault}; its instances are left out")
                trees.append(Tree([]))
            else:
                trees.append(self.tree(root, predicate, instancer, depth + 1))
        return trees


def _classify(prim: Usd.Prim) -> str:
    """Kind of node for a prim's type."""
    if prim.IsPseudoRoot() or not prim.GetTypeName():
        return GROUP
    if prim.IsA(UsdGeom.Mesh):
        return MESH
    if prim.GetTypeName() in GPRIM_TYPES:
        return GPRIM
    if prim.IsA(UsdGeom.PointInstancer):
        return INSTANCER
    if prim.IsA(UsdLux.BoundableLightBase) or prim.IsA(UsdLux.NonboundableLightBase):
        return LIGHT
    if prim.IsA(UsdShade.NodeGraph) or prim.IsA(UsdShade.Shader) or prim.IsA(UsdGeom.Subset):
        return _SHADING
    if prim.IsA(UsdSkel.Skeleton) or prim.IsA(UsdSkel.Animation):
        return GROUP
    return _NOT_DRAWN if prim.IsA(UsdGeom.Boundable) else GROUP


def _purpose(prim: Usd.Prim, inherited: str) -> str:
    attribute = prim.GetAttribute("purpose")
    return attribute.Get() if attribute and attribute.HasAuthoredValue() else inherited


def _color_source(parent: PrimNode | None) -> Usd.Prim | None:
    """The parent where it has a constant displayColor, else what it inherits itself."""
    if parent is None:
        return None
    attribute = parent.prim.GetAttribute("primvars:displayColor")
    if attribute and attribute.HasAuthoredValue():
        return parent.prim if UsdGeom.Primvar(attribute).GetInterpolation() == UsdGeom.Tokens.constant else None
    return parent.color


def _read_transform(node: PrimNode, time: Usd.TimeCode) -> None:
    """Local matrix; None stands for the identity."""
    order = node.prim.GetAttribute("xformOpOrder")
    if not order or not order.HasAuthoredValue():
        return
    xformable = UsdGeom.Xformable(node.prim)
    node.resets = xformable.GetResetXformStack()
    node.transform_varies = xformable.TransformMightBeTimeVarying()
    if not node.transform_varies:
        node.local = _local_matrix(node.prim, time)


def _local_matrix(prim: Usd.Prim, time: Usd.TimeCode) -> np.ndarray:
    return np.array(UsdGeom.Xformable(prim).GetLocalTransformation(time))


def _read_visibility(node: PrimNode, time: Usd.TimeCode) -> None:
    attribute = node.prim.GetAttribute("visibility")
    if attribute and attribute.HasAuthoredValue():
        node.visibility_varies = attribute.ValueMightBeTimeVarying()
        if not node.visibility_varies:
            node.own_visible = _is_visible(node.prim, time)


def _is_visible(prim: Usd.Prim, time: Usd.TimeCode) -> bool:
    return prim.GetAttribute("visibility").Get(time) != UsdGeom.Tokens.invisible
