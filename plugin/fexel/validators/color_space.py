"""Whether every image is read in the colour space that its use asks for.

Colours are stored sRGB-encoded in 8-bit images; normals, roughness, masks and other data are never encoded. An image
read in the wrong one gives a picture that looks nearly right.
"""

from __future__ import annotations

from collections.abc import Iterator

from pxr import Usd, UsdShade

from fexel.errors import FexelError
from fexel.schema.definition import data_attributes
from fexel.schema.wrapper import is_a
from fexel.schema.zipmap import ZipmapTexture
from fexel.validators.fault import Fault, authored_values
from fexel.validators.files import image_header, resolved_files
from fexel.validators.prim_validator import TEXTURES, PrimValidator

__all__ = ["VALIDATORS", "check_data_files", "check_surface", "encoding"]

_COLOR_INPUTS = ("diffuseColor", "emissiveColor", "specularColor")
_DATA_INPUTS = (
    "clearcoat",
    "clearcoatRoughness",
    "displacement",
    "metallic",
    "normal",
    "occlusion",
    "opacity",
    "roughness",
)
# Longest chain of node graphs followed from a material's input; guards against connections that form a circle.
_MAX_HOPS = 64


def encoding(prim: Usd.Prim) -> str:
    """How ``inputs:file`` of a texture is read: ``sRGB`` or ``raw``.

    A colorSpace authored on the attribute is strongest, then ``inputs:sourceColorSpace``, then what the file says;
    ``raw`` when there is no readable file.
    """
    attribute = prim.GetAttribute("inputs:file")
    if attribute and attribute.HasColorSpace():
        named = _encoding_of_name(attribute.GetColorSpace())
        if named != "auto":
            return named
    source = prim.GetAttribute("inputs:sourceColorSpace").Get()
    if source in ("raw", "sRGB"):
        return source
    for _, asset in authored_values(attribute):
        for file in resolved_files(attribute, asset):
            try:
                return image_header(file).color_space
            except FexelError:  # `check_files` says so
                continue
    return "raw"


def _encoding_of_name(name: str) -> str:
    lower = name.lower()
    if lower in ("auto", ""):
        return "auto"
    return "sRGB" if lower.startswith("srgb") else "raw"


def check_data_files(prim: Usd.Prim) -> Iterator[Fault]:
    """Masks, pinchmaps and what else the schema marks are data whatever they are used for."""
    for attribute in data_attributes(prim):
        if attribute.HasColorSpace() and _encoding_of_name(attribute.GetColorSpace()) == "sRGB":
            yield Fault(
                attribute.GetPath(), f"colorSpace is {attribute.GetColorSpace()}, expected raw: it holds no colours"
            )


def check_surface(prim: Usd.Prim) -> Iterator[Fault]:
    """Follow the inputs of a UsdPreviewSurface to fexel textures and compare their encoding with the use."""
    shader = UsdShade.Shader(prim)
    if shader.GetShaderId() != "UsdPreviewSurface":
        return
    for surface_input in shader.GetInputs():
        name = surface_input.GetBaseName()
        if name not in _COLOR_INPUTS and name not in _DATA_INPUTS:
            continue
        source = _texture_source(surface_input)
        if source is None or source[1] == "a":  # alpha is never encoded
            continue
        for texture in _with_patches(source[0]):
            yield from _check_use(texture, name, prim)


def _texture_source(surface_input: UsdShade.Input) -> tuple[Usd.Prim, str] | None:
    """The fexel texture behind an input and the name of its output, through any node graphs in between."""
    node = surface_input
    for _ in range(_MAX_HOPS):
        sources, _invalid = node.GetConnectedSources()
        if not sources:
            return None
        source = sources[0]
        prim = source.source.GetPrim()
        if is_a(prim, "FexelTexture"):
            return prim, source.sourceName
        if not source.source.IsContainer():
            return None
        is_output = source.sourceType == UsdShade.AttributeType.Output
        node = source.source.GetOutput(source.sourceName) if is_output else source.source.GetInput(source.sourceName)
    return None


def _with_patches(texture: Usd.Prim) -> list[Usd.Prim]:
    zipmap = ZipmapTexture(texture)
    return [patch.prim for patch in zipmap.GetPatches()] if zipmap else [texture]


def _check_use(texture: Usd.Prim, use: str, surface: Usd.Prim) -> Iterator[Fault]:
    attribute = texture.GetAttribute("inputs:file")
    files = [file for _, asset in authored_values(attribute) for file in resolved_files(attribute, asset)]
    if not files:
        return
    found = encoding(texture)
    where = f"{surface.GetPath()}.inputs:{use}"
    if use in _DATA_INPUTS and found == "sRGB":
        yield Fault(attribute.GetPath(), f"read as sRGB, expected raw: {where} takes data, not colours")
    elif use in _COLOR_INPUTS and found == "raw" and _is_8_bit_color(files[0]):
        yield Fault(
            attribute.GetPath(), f"8-bit image read as raw, expected sRGB: {where} takes colours", is_error=False
        )


def _is_8_bit_color(file: str) -> bool:
    try:
        info = image_header(file)
    except FexelError:  # `check_files` says so
        return False
    return info.dtype == "uint8" and info.channels >= 3


VALIDATORS = (
    PrimValidator(
        "fexel:ColorSpace",
        "Colours must be read as colours; normals, roughness, opacity and other data must be read raw.",
        ("UsdShadeShader",),
        check_surface,
    ),
    PrimValidator("fexel:DataColorSpace", "Masks and pinchmaps hold data and must be raw.", TEXTURES, check_data_files),
)
