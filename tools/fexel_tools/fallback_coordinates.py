"""The texture coordinates of a fallback: what feeds the texture's ``inputs:st``, copied into the texture prim.

Copied literally, as importers do not follow interface inputs: a UsdPrimvarReader_float2 and, where the texture reads
it through UsdTransform2d nodes, those too, with their time samples.
"""

from __future__ import annotations

import itertools

from pxr import Sdf, Usd, UsdShade

from fexel.scene.sampling import Faults, Sampler
from fexel.scene.shader_network import Node, resolve_input, shader_id, variable_name

__all__ = ["READER_NAME", "author_coordinates"]

READER_NAME = "FallbackSt"
_TRANSFORM_NAME = "FallbackTransform"
_TRANSFORM_INPUTS = {
    "scale": Sdf.ValueTypeNames.Float2,
    "rotation": Sdf.ValueTypeNames.Float,
    "translation": Sdf.ValueTypeNames.Float2,
}
_DEEPEST = 64  # nodes followed before a network counts as circular


def author_coordinates(texture_prim: Usd.Prim, beside: bool = False) -> UsdShade.Output:
    """Author the nodes inside a texture prim, or beside it, on the stage's edit target.

    Parameters
    ----------
    texture_prim : Usd.Prim
    beside : bool
        Siblings of the texture, their names beginning with its own, instead of children.

    Returns
    -------
    UsdShade.Output
        What to connect the fallback's ``inputs:st`` to: float2.

    Warns
    -----
    FexelWarning
        A connection that leads nowhere.
    """
    stage = texture_prim.GetStage()
    primvar, transforms = _source(texture_prim)
    reader = UsdShade.Shader.Define(stage, _node_path(texture_prim, READER_NAME, beside))
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(primvar)
    result = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    for number, source in enumerate(reversed(transforms), 1):  # from the reader on
        name = f"{_TRANSFORM_NAME}{number if number > 1 else ''}"
        node = UsdShade.Shader.Define(stage, _node_path(texture_prim, name, beside))
        result = _copy_transform(source, node, result)
    return result


def _node_path(texture_prim: Usd.Prim, name: str, beside: bool) -> Sdf.Path:
    """Where a node goes; beside the texture a name that is free."""
    if not beside:
        return texture_prim.GetPath().AppendChild(name)
    stage, parent = texture_prim.GetStage(), texture_prim.GetPath().GetParentPath()
    stem = texture_prim.GetName() + name.removeprefix("Fallback")
    numbered = (f"{stem}{number}" if number > 1 else stem for number in itertools.count(1))
    return next(path for path in map(parent.AppendChild, numbered) if not stage.GetPrimAtPath(path))


def _source(texture_prim: Usd.Prim) -> tuple[str, list[Usd.Prim]]:
    """The primvar and the UsdTransform2d nodes before it, the texture's neighbour first, as the renderer finds them."""
    sampler, faults = Sampler(None), Faults()
    transforms: list[Usd.Prim] = []
    node = resolve_input(texture_prim, "st", sampler, faults)
    while isinstance(node, Node) and len(transforms) < _DEEPEST:
        kind = shader_id(node.prim, sampler)
        if kind == "UsdPrimvarReader_float2":
            return variable_name(node.prim, sampler, faults), transforms
        if kind != "UsdTransform2d":
            break
        transforms.append(node.prim)
        node = resolve_input(node.prim, "in", sampler, faults)
    return "st", transforms


def _copy_transform(source: Usd.Prim, copy: UsdShade.Shader, st: UsdShade.Output) -> UsdShade.Output:
    copy.CreateIdAttr("UsdTransform2d")
    copy.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(st)
    for name, type_name in _TRANSFORM_INPUTS.items():
        original = UsdShade.Shader(source).GetInput(name)
        producers = UsdShade.Utils.GetValueProducingAttributes(original) if original else []
        if producers and producers[0].HasAuthoredValue():
            _copy_values(producers[0], copy.CreateInput(name, type_name))
    return copy.CreateOutput("result", Sdf.ValueTypeNames.Float2)


def _copy_values(source: Usd.Attribute, target: UsdShade.Input) -> None:
    value = source.Get()
    if value is not None:
        target.Set(value)
    for time in source.GetTimeSamples():
        target.Set(source.Get(time), time)
