"""What applications without fexel will show: a UsdUVTexture inside the texture prim that needs nothing from outside.

Checked by trial on stock applications (Blender 5): an inner node whose ``inputs:file`` or ``inputs:st`` is connected to
an interface input of the node graph is not followed.
"""

from __future__ import annotations

from collections.abc import Iterator

from pxr import Usd, UsdShade

from fexel.schema.wrapper import is_a
from fexel.validators.fault import Fault
from fexel.validators.prim_validator import TEXTURES, PrimValidator

__all__ = ["VALIDATORS", "check_fallback", "check_fallback_types"]

_OUTPUTS = ("rgb", "r", "g", "b", "a")


def check_fallback(prim: Usd.Prim) -> Iterator[Fault]:
    """Outputs of a texture that a material uses; a patch has none, its root stands for it."""
    if is_a(prim.GetParent(), "ZipmapTexture"):
        return
    graph = UsdShade.NodeGraph(prim)
    outputs = [graph.GetOutput(name) for name in _OUTPUTS]
    connected = [output for output in outputs if output and output.GetAttr().HasAuthoredConnections()]
    if not connected:
        message = "no output is connected to a UsdUVTexture inside; applications without fexel will show nothing"
        yield Fault(prim.GetPath(), message, is_error=False)
    readers = set()
    for output in connected:
        fault, reader = _check_output(prim, output)
        if fault:
            yield fault
        elif reader:
            readers.add(reader)
    for reader in sorted(readers):
        yield from _check_reader(prim, prim.GetStage().GetPrimAtPath(reader))


def _check_output(prim: Usd.Prim, output: UsdShade.Output) -> tuple[Fault | None, str | None]:
    """A fault, or else the path of the UsdUVTexture that drives the output."""
    sources, _invalid = output.GetConnectedSources()
    reader = sources[0].source.GetPrim() if sources else Usd.Prim()
    name = output.GetAttr().GetName()
    if not reader or not reader.GetPath().HasPrefix(prim.GetPath()) or reader == prim:
        return Fault(output.GetAttr().GetPath(), f"{name} is not driven by a node inside the texture", False), None
    shader_id = UsdShade.Shader(reader).GetShaderId()
    if shader_id != "UsdUVTexture":
        found = f"{reader.GetPath()} ({shader_id or reader.GetTypeName()})"
        return Fault(output.GetAttr().GetPath(), f"driven by {found}, expected a UsdUVTexture", False), None
    return None, str(reader.GetPath())


def _check_reader(prim: Usd.Prim, reader: Usd.Prim) -> Iterator[Fault]:
    shader = UsdShade.Shader(reader)
    file = shader.GetInput("file")
    if not file or file.HasConnectedSource() or not file.Get() or not file.Get().path:
        found = "connected to an interface input" if file and file.HasConnectedSource() else "missing"
        yield Fault(
            reader.GetPath(), f"inputs:file is {found}, expected a literal file: others do not follow it", False
        )
    st = shader.GetInput("st")
    sources = st.GetConnectedSources()[0] if st else []
    source = sources[0].source.GetPrim() if sources else Usd.Prim()
    if not source or source == prim or not source.GetPath().HasPrefix(prim.GetPath()):
        found = source.GetPath() if source else "nothing"
        message = f"inputs:st is connected to {found}, expected a UsdPrimvarReader_float2 inside {prim.GetPath()}"
        yield Fault(reader.GetPath(), message, False)


def check_fallback_types(stage: Usd.Stage) -> Iterator[Fault]:
    """The stage's ``fallbackPrimTypes``, without which others compose our prims as nothing at all."""
    declared = stage.GetMetadata("fallbackPrimTypes") or {}
    missing: dict[str, Usd.Prim] = {}
    for prim in stage.Traverse():
        if is_a(prim, "FexelTexture") and prim.GetTypeName() not in declared:
            missing.setdefault(prim.GetTypeName(), prim)
    for name, prim in missing.items():
        message = f"the root layer's fallbackPrimTypes do not name {name}; save after stage.WriteFallbackPrimTypes()"
        yield Fault(prim.GetPath(), message, is_error=False)


VALIDATORS = (
    PrimValidator(
        "fexel:Fallback",
        "A texture that a material uses should hold a self-contained UsdUVTexture for other applications.",
        TEXTURES,
        check_fallback,
    ),
)
