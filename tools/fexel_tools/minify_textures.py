"""Which textures of a stage can have a minification filter: of any fexel kind, and UsdUVTexture shaders.

A texture that is nested in another one takes the filter of the one around it and is left out, unless it authors a
filter of its own. So is the fallback inside a fexel texture, which fexel does not draw. Textures in variants that are
not selected are found as well: a filter must not be lost when somebody chooses another look. Of prims inside instances
only the selected ones are: the session layer, which selects the others, has no say there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from pxr import Sdf, Usd, UsdShade

from fexel.schema.wrapper import is_a
from fexel.textures.inputs import Inputs

__all__ = ["FoundTexture", "each_texture", "holds_data", "is_texture"]

_FILTER = "minification:filter"
_SHOWN = Usd.PrimIsActive & Usd.PrimIsLoaded & ~Usd.PrimIsAbstract  # also overs, as prototypes of instancers may be


@dataclass(frozen=True)
class FoundTexture:
    """A texture prim, valid until the next one is asked for.

    Attributes
    ----------
    prim : Usd.Prim
    variant : str
        Which variants show it, such as ``look=rust``; '' for those that the stage selects.
    """

    prim: Usd.Prim
    variant: str = ""


def is_texture(prim: Usd.Prim) -> bool:
    """Whether TextureMinificationAPI goes onto a prim: a fexel texture or a UsdUVTexture."""
    return is_a(prim, "FexelTexture") or (
        prim.IsA(UsdShade.Shader) and UsdShade.Shader(prim).GetShaderId() == "UsdUVTexture"
    )


def holds_data(texture: Usd.Prim) -> bool:
    """Whether a texture holds data, not colours: its file is raw."""
    return Inputs(texture, Usd.TimeCode.EarliestTime()).color_space() == "raw"


def each_texture(stage: Usd.Stage, limits: Sequence[Sdf.Path] = ()) -> Iterator[FoundTexture]:
    """Textures of a stage, those of its own variants first; one that several variants show comes once for each.

    Parameters
    ----------
    stage : Usd.Stage
        Its session layer selects variants meanwhile.
    limits : sequence of Sdf.Path
        Only textures at or below these prims; none: all. A nested texture that is named itself counts.
    """
    yield from _below(stage.GetPseudoRoot(), limits, "")
    yield from _in_variants(stage, Sdf.Path.absoluteRootPath, limits, "")


def _below(root: Usd.Prim, limits: Sequence[Sdf.Path], variant: str) -> Iterator[FoundTexture]:
    for prim in list(Usd.PrimRange(root, Usd.TraverseInstanceProxies(_SHOWN))):
        path = prim.GetPath()
        if limits and not any(path.HasPrefix(limit) for limit in limits):
            continue
        if is_texture(prim) and (not _is_inside_texture(prim) or _stands_out(prim, limits)):
            yield FoundTexture(prim, variant)


def _is_inside_texture(prim: Usd.Prim) -> bool:
    parent = prim.GetParent()
    while parent and not parent.IsPseudoRoot():
        if is_a(parent, "FexelTexture"):
            return True
        parent = parent.GetParent()
    return False


def _stands_out(nested: Usd.Prim, limits: Sequence[Sdf.Path]) -> bool:
    """Whether a texture inside another one has a filter of its own, or is to get one."""
    authored = nested.GetAttribute(_FILTER)
    has_own = bool(authored) and authored.HasAuthoredValue()
    return is_a(nested, "FexelTexture") and (has_own or nested.GetPath() in limits)


def _in_variants(
    stage: Usd.Stage, below: Sdf.Path, limits: Sequence[Sdf.Path], outer: str, known: frozenset[str] = frozenset()
) -> Iterator[FoundTexture]:
    """Textures at or below a prim under the variants that are not selected, a set at a time, nested ones within.

    `known` are sets of the prim itself that are looked at already.
    """
    for path, name, others in _variant_sets(stage.GetPrimAtPath(below), limits, known):
        sets = frozenset(stage.GetPrimAtPath(path).GetVariantSets().GetNames())
        for other in others:
            where = ", ".join(filter(None, (outer, f"{name}={other}")))
            with _selection(stage, path, name, other):
                prim = stage.GetPrimAtPath(path)
                yield from _below(prim, limits, where)
                yield from _in_variants(stage, path, limits, where, sets)


def _variant_sets(
    root: Usd.Prim, limits: Sequence[Sdf.Path], known: frozenset[str]
) -> list[tuple[Sdf.Path, str, list[str]]]:
    """(prim, set, variants that are not selected) at or below a prim, as far as they can hold what is asked for."""
    found = []
    for prim in Usd.PrimRange(root, _SHOWN):
        path = prim.GetPath()
        apart = limits and not any(path.HasPrefix(limit) or limit.HasPrefix(path) for limit in limits)
        if apart or not prim.HasVariantSets():
            continue
        sets = prim.GetVariantSets()
        for name in sets.GetNames():
            if prim != root or name not in known:
                selected = sets.GetVariantSelection(name)
                names = sets.GetVariantSet(name).GetVariantNames()
                found.append((path, name, [other for other in names if other != selected]))
    return found


@contextmanager
def _selection(stage: Usd.Stage, path: Sdf.Path, name: str, variant: str) -> Iterator[None]:
    """Select a variant in the session layer."""
    session = stage.GetSessionLayer()
    with Sdf.ChangeBlock():  # the stage is composed again once
        spec = Sdf.CreatePrimInLayer(session, path)
        before = dict(spec.variantSelections).get(name)
        spec.variantSelections[name] = variant
    try:
        yield
    finally:
        if before is None:
            del spec.variantSelections[name]
        else:
            spec.variantSelections[name] = before
