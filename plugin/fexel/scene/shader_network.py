"""Following connections through a material: interface inputs, nested node graphs, and what feeds a texture's `st`.

A FexelTexture is a node graph as well; here it is a node like UsdUVTexture, and its inside, the fallback for other
applications, is not entered.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import Usd, UsdShade

from fexel.scene.sampling import Faults, Sampler

__all__ = [
    "Node",
    "TextureCoordinates",
    "is_fexel_texture",
    "resolve_input",
    "resolve_output",
    "shader_id",
    "texture_coordinates",
    "variable_name",
]

_DEEPEST = 64  # connections followed before a network counts as circular


@dataclass(frozen=True)
class Node:
    """An output of a shader or of a FexelTexture that feeds an input."""

    prim: Usd.Prim
    output: str


@dataclass(frozen=True, eq=False)
class TextureCoordinates:
    """Where a texture's `st` comes from: ``[s t 1] @ transform`` of a primvar (row vectors)."""

    primvar: str = "st"
    transform: np.ndarray = field(default_factory=lambda: np.eye(3))


def is_fexel_texture(prim: Usd.Prim) -> bool:
    """Whether a prim is of a type that inherits FexelTexture."""
    return prim.IsA("FexelTexture")


def shader_id(prim: Usd.Prim, sampler: Sampler) -> str:
    """``info:id`` of a shader prim, '' where it has none."""
    return str(sampler.get(prim.GetAttribute("info:id"), ""))


def resolve_input(prim: Usd.Prim, name: str, sampler: Sampler, faults: Faults) -> Any | Node | None:
    """What feeds ``inputs:name``: a value, the `Node` it is connected to, or None where neither is authored.

    Where a connection leads nowhere, the value authored beside it counts, as in USD.
    """
    return _resolve(prim.GetAttribute(f"inputs:{name}"), sampler, faults, 0)


def resolve_output(prim: Usd.Prim, name: str, sampler: Sampler, faults: Faults) -> Node | None:
    """The node behind ``outputs:name`` of a material; None where nothing is connected."""
    found = _resolve(prim.GetAttribute(f"outputs:{name}"), sampler, faults, 0)
    return found if isinstance(found, Node) else None


def _resolve(attribute: Usd.Attribute, sampler: Sampler, faults: Faults, depth: int) -> Any | Node | None:
    if not attribute:
        return None
    if depth > _DEEPEST:
        faults.warn(attribute.GetPath(), f"more than {_DEEPEST} connections in a row, perhaps a circle; not followed")
        return None
    for path in attribute.GetConnections():
        source = attribute.GetStage().GetPrimAtPath(path.GetPrimPath())
        if not source:
            faults.warn(attribute.GetPath(), f"connected to {path}, which does not exist; its value is used instead")
            continue
        name = path.name
        if name.startswith("outputs:") and (is_fexel_texture(source) or source.IsA(UsdShade.Shader)):
            return Node(source, name.removeprefix("outputs:"))
        result = _resolve(source.GetAttribute(name), sampler, faults, depth + 1)
        if result is not None:
            return result
    return sampler.get(attribute) if attribute.HasAuthoredValue() else None


def texture_coordinates(prim: Usd.Prim, sampler: Sampler, faults: Faults) -> TextureCoordinates:
    """Follow a texture's ``inputs:st`` through UsdTransform2d nodes to a UsdPrimvarReader_float2; else primvar `st`."""
    transform = np.eye(3)
    node = resolve_input(prim, "st", sampler, faults)
    for _ in range(_DEEPEST):
        if not isinstance(node, Node):
            break
        kind = shader_id(node.prim, sampler)
        if kind == "UsdPrimvarReader_float2":
            return TextureCoordinates(variable_name(node.prim, sampler, faults), transform)
        if kind != "UsdTransform2d":
            expected = "expected UsdPrimvarReader_float2 or UsdTransform2d; primvar st is used"
            faults.warn(node.prim.GetPath(), f"info:id {kind!r} feeds texture coordinates, {expected}")
            break
        transform = _transform_2d(node.prim, sampler, faults) @ transform
        node = resolve_input(node.prim, "in", sampler, faults)
    return TextureCoordinates("st", transform)


def variable_name(prim: Usd.Prim, sampler: Sampler, faults: Faults) -> str:
    """``inputs:varname`` of a primvar reader, a token or a string, perhaps from a material's interface."""
    name = resolve_input(prim, "varname", sampler, faults)
    return (
        str(name).removeprefix("primvars:") if name is not None and not isinstance(name, Node) and str(name) else "st"
    )


def _transform_2d(prim: Usd.Prim, sampler: Sampler, faults: Faults) -> np.ndarray:
    """UsdTransform2d: scale, then rotate counter-clockwise by degrees, then translate (row vectors)."""
    scale, angle, offset = (resolve_input(prim, name, sampler, faults) for name in ("scale", "rotation", "translation"))
    scale = np.array(scale if _is_number(scale) else (1.0, 1.0), np.float64)
    offset = np.array(offset if _is_number(offset) else (0.0, 0.0), np.float64)
    turn = np.radians(float(angle) if _is_number(angle) else 0.0)
    matrix = np.eye(3)
    matrix[:2, :2] = np.diag(scale) @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    matrix[2, :2] = offset
    if not np.isfinite(matrix).all():
        faults.warn(prim.GetPath(), "scale, rotation or translation is NaN or infinite; the transform is left out")
        return np.eye(3)
    return matrix


def _is_number(value: Any) -> bool:
    return value is not None and not isinstance(value, Node)
