"""The prim types that USD knows after `import fexel`: names, types, defaults, documentation, fallbacks."""

from __future__ import annotations

import math

import pytest
from pxr import Gf, Sdf, Tf, Usd, UsdShade

import fexel  # noqa: F401 - registers the schema

IDENTITY = Gf.Matrix3d(1)
WRAP = ["black", "clamp", "repeat", "mirror", "useMetadata"]

# The contract: property -> (type, default). None: no default.
FEXEL_TEXTURE = {
    "inputs:st": ("float2", None),
    "inputs:file": ("asset", None),
    "inputs:matrix": ("matrix3d", IDENTITY),
    "inputs:wrapS": ("token", "useMetadata"),
    "inputs:wrapT": ("token", "useMetadata"),
    "inputs:sourceColorSpace": ("token", "auto"),
    "inputs:scale": ("float4", (1, 1, 1, 1)),
    "inputs:bias": ("float4", (0, 0, 0, 0)),
    "inputs:fallback": ("float4", (0, 0, 0, 1)),
    "inputs:opacity": ("float", 1.0),
    "outputs:rgb": ("float3", None),
    "outputs:r": ("float", None),
    "outputs:g": ("float", None),
    "outputs:b": ("float", None),
    "outputs:a": ("float", None),
}
ARRANGEMENT = {"grid": ("int2", (1, 1)), "patchIndices": ("int[]", []), "matrices": ("matrix3d[]", [])}
SCHEMAS = {
    "ZipmapTexture": {**FEXEL_TEXTURE, "inputs:mask": ("asset", None)},
    "PinchmapTexture": {
        **FEXEL_TEXTURE,
        "inputs:pinchmap": ("asset", None),
        "inputs:antialias": ("float", 1.0),
        "inputs:lineWidth": ("float", 0.0),
        "inputs:lineColor": ("color4f", (0, 0, 0, 1)),
    },
    "UmbrellaTexture": {
        **FEXEL_TEXTURE,
        **ARRANGEMENT,
        "morphs": ("float[]", []),
        "colors": ("color3f[]", []),
        "inputs:colorBlend": ("float", 1.0),
        "inputs:shadowOffset": ("float2", (0, 0)),
        "inputs:shadowStrength": ("float", 0.0),
    },
    "UmbrellaPatch": {
        "file": ("asset", None),
        "texCoords": ("float2[]", []),
        "points": ("float2[]", []),
        "morphPoints": ("float2[]", []),
    },
    "UmbrellaLevel": {
        **ARRANGEMENT,
        "level": ("int", 1),
        "vertexCounts": ("int[]", []),
        "points": ("float2[]", []),
        "colors": ("color3f[]", []),
        "coverages": ("float[]", []),
        "file": ("asset", None),
    },
    "TextureMinificationAPI": {
        "minification:filter": ("token", "anisotropic"),
        "minification:contrast": ("float", 1.0),
        "minification:brightness": ("float", 0.0),
        "minification:attenuationDistance": ("float", math.inf),
        "minification:attenuationColor": ("color3f", (1, 1, 1)),
    },
}
TOKENS = {
    ("ZipmapTexture", "inputs:wrapS"): WRAP,
    ("ZipmapTexture", "inputs:wrapT"): WRAP,
    ("ZipmapTexture", "inputs:sourceColorSpace"): ["auto", "raw", "sRGB"],
    ("TextureMinificationAPI", "minification:filter"): ["mipmap", "anisotropic", "ripmap", "fipmap"],
}
TEXTURES = ["ZipmapTexture", "PinchmapTexture", "UmbrellaTexture"]
PROPERTIES = [(schema, name) for schema, properties in SCHEMAS.items() for name in properties]


def definition_of(schema: str) -> Usd.PrimDefinition:
    registry = Usd.SchemaRegistry()
    return registry.FindConcretePrimDefinition(schema) or registry.FindAppliedAPIPrimDefinition(schema)


@pytest.mark.parametrize("schema", SCHEMAS)
def test_schema_has_exactly_these_properties(schema):
    assert sorted(definition_of(schema).GetPropertyNames()) == sorted(SCHEMAS[schema])


@pytest.mark.parametrize(("schema", "name"), PROPERTIES)
def test_property_has_its_type_and_default(schema, name):
    attribute = definition_of(schema).GetAttributeDefinition(name)
    type_name, default = SCHEMAS[schema][name]
    assert attribute.GetTypeName() == Sdf.ValueTypeNames.Find(type_name)
    assert attribute.GetVariability() == Sdf.VariabilityVarying
    found = attribute.GetFallbackValue()
    assert (list(found) if isinstance(default, list) else found) == default


@pytest.mark.parametrize(("schema", "name"), PROPERTIES)
def test_property_documents_default_range_and_units(schema, name):
    doc = definition_of(schema).GetPropertyDocumentation(name)
    summary = doc.split(". ")[0]
    assert len(summary) > 10
    for part in ("Default:", "Range:", "Units:"):
        assert part in doc
    assert definition_of(schema).GetPropertyMetadata(name, "displayGroup")


@pytest.mark.parametrize(("schema", "name"), TOKENS)
def test_tokens_are_those_allowed_and_each_is_explained(schema, name):
    definition = definition_of(schema)
    allowed = list(definition.GetPropertyMetadata(name, "allowedTokens"))
    assert allowed == TOKENS[schema, name]
    doc = definition.GetPropertyDocumentation(name)
    assert all(f"\n{token}: " in doc for token in allowed)


@pytest.mark.parametrize(("schema", "name"), PROPERTIES)
def test_default_lies_within_the_limits(schema, name):
    limits = definition_of(schema).GetPropertyMetadata(name, "limits") or {}
    default = SCHEMAS[schema][name][1]
    for bounds in limits.values():
        assert bounds.get("minimum", default) <= default <= bounds.get("maximum", default)


@pytest.mark.parametrize("schema", SCHEMAS)
def test_schema_itself_is_documented(schema):
    assert definition_of(schema).GetDocumentation()


def test_fexel_texture_is_abstract():
    assert Usd.SchemaRegistry.IsAbstract("FexelTexture")
    assert not Usd.SchemaRegistry.IsConcrete("FexelTexture")


@pytest.mark.parametrize("schema", TEXTURES)
def test_texture_is_a_connectable_node_graph(schema):
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/T", schema)
    assert prim.IsA(UsdShade.NodeGraph)
    assert prim.IsA(Tf.Type.FindByName("FexelFexelTexture"))
    assert UsdShade.ConnectableAPI(prim).IsContainer()
    assert [output.GetBaseName() for output in UsdShade.NodeGraph(prim).GetOutputs(onlyAuthored=False)] == [
        "a",
        "b",
        "g",
        "r",
        "rgb",
    ]


def test_textures_fall_back_to_node_graph_and_helpers_to_nothing():
    fallbacks = Usd.SchemaRegistry().GetFallbackPrimTypes()
    ours = {name: list(types) for name, types in fallbacks.items() if name in SCHEMAS}
    assert ours == {name: ["NodeGraph"] for name in TEXTURES}


def test_written_fallback_types_survive_saving(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    stage.DefinePrim("/T", "ZipmapTexture")
    stage.WriteFallbackPrimTypes()
    stage.Save()
    text = (tmp_path / "a.usda").read_text()
    assert 'token[] ZipmapTexture = ["NodeGraph"]' in text


@pytest.mark.parametrize("type_name", [*TEXTURES, "Shader"])
def test_minification_applies_to_textures_and_shaders(type_name):
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/P", type_name)
    assert prim.CanApplyAPI("TextureMinificationAPI")


@pytest.mark.parametrize("type_name", ["", "Mesh", "Material", "NodeGraph", "UmbrellaPatch"])
def test_minification_is_refused_elsewhere(type_name):
    stage = Usd.Stage.CreateInMemory()
    prim = stage.DefinePrim("/P", type_name)
    assert not prim.CanApplyAPI("TextureMinificationAPI")
