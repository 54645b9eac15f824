"""Run in a process of its own, without fexel: opens a stage with stock usd-core and prints what it finds as JSON."""

import json
import sys

from pxr import Sdf, Usd, UsdShade, UsdValidation

TEXTURES = ("ZipmapTexture", "PinchmapTexture", "UmbrellaTexture")
PARTS = ("UmbrellaPatch", "UmbrellaLevel")
COLOUR_INPUTS = (
    "diffuseColor",
    "emissiveColor",
    "opacity",
    "normal",
    "roughness",
    "metallic",
)


def probe(path):
    stage = Usd.Stage.Open(path)
    report = {
        "modules": [name for name in sys.modules if name.startswith("fexel")],
        "textures": {},
        "parts": {},
        "materials": {},
    }
    for prim in stage.TraverseAll():
        if prim.GetTypeName() in TEXTURES:
            report["textures"][str(prim.GetPath())] = {
                "schema": str(prim.GetPrimTypeInfo().GetSchemaTypeName()),
                "is_node_graph": bool(prim.IsA(UsdShade.NodeGraph)),
            }
        if prim.GetTypeName() in (*TEXTURES, *PARTS):
            arrays = {a.GetName(): len(a.Get()) for a in prim.GetAuthoredAttributes() if a.GetTypeName().isArray}
            report["parts"][str(prim.GetPath())] = {"arrays": arrays, "files": resolved_files(prim)}
        if prim.IsA(UsdShade.Material):
            report["materials"][str(prim.GetPath())] = material_report(UsdShade.Material(prim))
    report["validation"] = validation_errors(stage)
    return report


def resolved_files(prim):
    values = [a.Get() for a in prim.GetAuthoredAttributes() if a.GetTypeName() == Sdf.ValueTypeNames.Asset]
    return [value.resolvedPath for value in values if value and value.path]


def material_report(material):
    surface = material.ComputeSurfaceSource()[0]
    found = {"surface": str(surface.GetIdAttr().Get()) if surface else "", "inputs": {}}
    for name in COLOUR_INPUTS:
        attributes = surface.GetInput(name).GetValueProducingAttributes() if surface and surface.GetInput(name) else []
        sources = [a for a in attributes if UsdShade.Utils.GetType(a.GetName()) == UsdShade.AttributeType.Output]
        if sources:
            found["inputs"][name] = source_report(UsdShade.Shader(sources[0].GetPrim()))
    return found


def source_report(shader):
    file = shader.GetInput("file").Get() if shader.GetInput("file") else None
    st = shader.GetInput("st").GetValueProducingAttributes() if shader.GetInput("st") else []
    return {
        "id": str(shader.GetIdAttr().Get()),
        "authored": file.path if file else "",
        "resolved": file.resolvedPath if file else "",
        "st_reader": str(UsdShade.Shader(st[0].GetPrim()).GetIdAttr().Get()) if st else "",
    }


def validation_errors(stage):
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    return [error.GetErrorAsString() for error in errors]


print(json.dumps(probe(sys.argv[1])))
