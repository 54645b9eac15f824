"""A texture prim of any fexel kind turned into the standard network that shows its baked picture.

The prim keeps its path and becomes a UsdUVTexture shader, so that whatever is connected to its outputs stays connected
and follows no node graph. Its children, patches, levels and fallback, go. Its coordinates come from the shader that
fed ``inputs:st`` where that lies outside, else from a UsdPrimvarReader_float2 beside it.
"""

from __future__ import annotations

from pxr import Gf, Sdf, Tf, Usd, UsdShade

from fexel.errors import FexelError
from fexel.filters.minification import minification_of_prim
from fexel.images import image_info
from fexel.schema.definition import base_types
from fexel.schema.wrapper import is_a
from fexel.textures.image_source import BIAS_ZERO, SCALE_ONE, toned
from fexel.textures.inputs import Inputs
from fexel_tools.fallback_coordinates import author_coordinates

__all__ = ["is_own", "make_explicit", "remove_own", "texture_roots", "tone_plain"]

_OUTPUT_TYPES = {
    "rgb": Sdf.ValueTypeNames.Float3,
    "r": Sdf.ValueTypeNames.Float,
    "g": Sdf.ValueTypeNames.Float,
    "b": Sdf.ValueTypeNames.Float,
    "a": Sdf.ValueTypeNames.Float,
}
_KEPT_FIELDS = ("specifier", "typeName", "active", "hidden", "displayName")
_MINIFICATION = "minification:"


def is_own(prim: Usd.Prim) -> bool:
    """Whether a prim is of one of fexel's types."""
    return any(prim.IsA(Tf.Type.FindByName(name)) for name in base_types())


def texture_roots(stage: Usd.Stage, below: Sdf.Path = Sdf.Path.absoluteRootPath) -> list[Usd.Prim]:
    """Textures of any kind that lie within no other texture, in namespace order.

    Parameters
    ----------
    stage : Usd.Stage
        Flattened: instances are references to prims that are looked through once.
    below : Sdf.Path
        Only textures at or below this prim.
    """
    found, prims = [], iter(Usd.PrimRange.Stage(stage, Usd.PrimIsActive & ~Usd.PrimIsAbstract))
    for prim in prims:
        if is_a(prim, "FexelTexture"):
            prims.PruneChildren()
            if prim.GetPath().HasPrefix(below):
                found.append(prim)
    return found


def make_explicit(
    texture: Usd.Prim,
    file: str,
    color_space: str,
    scale: tuple[float, ...] = SCALE_ONE,
    bias: tuple[float, ...] = BIAS_ZERO,
) -> None:
    """Turn a texture prim into a UsdUVTexture on the stage's root layer, which holds all there is of it.

    Parameters
    ----------
    texture : Usd.Prim
        A FexelTexture of a flattened stage.
    file : str
        The baked picture, as it is to be authored.
    color_space : str
        ``sRGB`` or ``raw``.
    scale, bias : 4 floats
        What is yet to be applied to the picture.
    """
    stage, path = texture.GetStage(), texture.GetPath()
    coordinates = _coordinates(texture)
    wraps = {name: _wrap(texture, name) for name in ("wrapS", "wrapT")}
    fallback = texture.GetAttribute("inputs:fallback")
    missing_color = fallback.Get() if fallback and fallback.HasAuthoredValue() else None
    _clear(stage.GetRootLayer().GetPrimAtPath(path))
    shader = UsdShade.Shader(stage.GetPrimAtPath(path))
    shader.CreateIdAttr("UsdUVTexture")
    shader.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(file))
    shader.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(color_space)
    shader.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(coordinates)
    for name, mode in wraps.items():
        shader.CreateInput(name, Sdf.ValueTypeNames.Token).Set(mode)
    if tuple(scale) != SCALE_ONE:
        shader.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*scale))
    if tuple(bias) != BIAS_ZERO:
        shader.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*bias))
    if missing_color is not None:
        shader.CreateInput("fallback", Sdf.ValueTypeNames.Float4).Set(missing_color)
    for name, type_name in _OUTPUT_TYPES.items():
        shader.CreateOutput(name, type_name)


def tone_plain(stage: Usd.Stage, time: Usd.TimeCode) -> None:
    """Contrast and brightness that plain UsdUVTexture shaders have at a time, as their scale and bias.

    Parameters
    ----------
    stage : Usd.Stage
        Flattened.
    time : Usd.TimeCode
    """
    for prim in stage.TraverseAll():
        asked = minification_of_prim(prim, time)
        if not asked.toned:
            continue
        inputs = Inputs(prim, time)
        values = toned(inputs.vector("scale", SCALE_ONE), inputs.vector("bias", BIAS_ZERO), asked)
        for name, value in zip(("scale", "bias"), values, strict=True):
            shader_input = UsdShade.Shader(prim).CreateInput(name, Sdf.ValueTypeNames.Float4)
            shader_input.GetAttr().Clear()
            shader_input.ClearSources()
            shader_input.Set(Gf.Vec4f(*value))


def remove_own(stage: Usd.Stage) -> None:
    """Take away what is left of fexel's types: prims that draw nothing (classes, inactive ones), and applied schemas.

    Parameters
    ----------
    stage : Usd.Stage
        Flattened, its textures made explicit.
    """
    layer = stage.GetRootLayer()
    paths = [prim.GetPath() for prim in stage.TraverseAll() if is_own(prim)]
    with Sdf.ChangeBlock():
        for path in Sdf.Path.RemoveDescendentPaths(paths):
            _remove_prim(layer, path)
        layer.Traverse(Sdf.Path.absoluteRootPath, lambda path: _strip_schemas(layer, path))
    if layer.pseudoRoot.HasInfo("fallbackPrimTypes"):
        layer.pseudoRoot.ClearInfo("fallbackPrimTypes")


def _coordinates(texture: Usd.Prim) -> UsdShade.Output:
    """The output that feeds the texture's st: a shader's outside of it, else one authored beside it."""
    st = UsdShade.ConnectableAPI(texture).GetInput("st")
    sources = st.GetConnectedSources()[0] if st else []
    source = sources[0].source.GetPrim() if sources else Usd.Prim()
    if source and UsdShade.Shader(source) and not source.GetPath().HasPrefix(texture.GetPath()):
        return UsdShade.Shader(source).GetOutput(sources[0].sourceName)
    return author_coordinates(texture, beside=True)


def _wrap(texture: Usd.Prim, name: str) -> str:
    """The wrap mode; ``useMetadata`` is what the texture's own file says, since the baked one says nothing."""
    mode = str(texture.GetAttribute(f"inputs:{name}").Get())
    if mode != "useMetadata":
        return mode
    file = texture.GetAttribute("inputs:file").Get()
    try:
        return image_info(file.resolvedPath).wrap[name == "wrapT"] if file and file.resolvedPath else "black"
    except FexelError:
        return "black"


def _clear(spec: Sdf.PrimSpec) -> None:
    """A prim spec without children, properties and most metadata, of type Shader."""
    with Sdf.ChangeBlock():
        for child in list(spec.nameChildren):
            del spec.nameChildren[child.name]
        for prop in list(spec.properties):
            spec.RemoveProperty(prop)
        for key in list(spec.ListInfoKeys()):
            if key not in _KEPT_FIELDS:
                spec.ClearInfo(key)
        spec.typeName = "Shader"


def _remove_prim(layer: Sdf.Layer, path: Sdf.Path) -> None:
    spec = layer.GetPrimAtPath(path)
    if spec:
        del (spec.nameParent or layer.pseudoRoot).nameChildren[spec.name]


def _strip_schemas(layer: Sdf.Layer, path: Sdf.Path) -> None:
    """Without fexel's applied schemas and their attributes."""
    spec = layer.GetPrimAtPath(path) if path.IsPrimPath() else None
    if not spec or not spec.HasInfo("apiSchemas"):
        return
    applied = spec.GetInfo("apiSchemas").GetAppliedItems()
    kept = [name for name in applied if name != "TextureMinificationAPI"]
    if len(kept) == len(applied):
        return
    spec.ClearInfo("apiSchemas")
    if kept:
        spec.SetInfo("apiSchemas", Sdf.TokenListOp.CreateExplicit(kept))
    for prop in [p for p in spec.properties if p.name.startswith(_MINIFICATION)]:
        spec.RemoveProperty(prop)
