"""Typed wrappers behave as those of UsdGeom."""

from __future__ import annotations

import inspect

import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

import fexel

CONCRETE = [
    fexel.ZipmapTexture,
    fexel.PinchmapTexture,
    fexel.UmbrellaTexture,
    fexel.UmbrellaPatch,
    fexel.UmbrellaLevel,
]
ALL = [*CONCRETE, fexel.TextureMinificationAPI]


@pytest.fixture
def stage():
    return Usd.Stage.CreateInMemory()


@pytest.mark.parametrize("wrapper", CONCRETE)
def test_define_makes_a_prim_of_the_type(stage, wrapper):
    defined = wrapper.Define(stage, "/A/B")
    assert defined
    assert defined.GetPath() == Sdf.Path("/A/B")
    assert defined.GetPrim().GetTypeName() == wrapper.schema
    assert wrapper.Get(stage, Sdf.Path("/A/B"))
    assert not wrapper.Get(stage, "/A")
    assert not wrapper.Get(stage, "/nowhere")
    assert not wrapper()


@pytest.mark.parametrize("wrapper", CONCRETE)
def test_wrapper_of_another_type_is_false(stage, wrapper):
    assert not wrapper(UsdGeom.Mesh.Define(stage, "/Mesh").GetPrim())
    assert not wrapper(UsdShade.NodeGraph.Define(stage, "/Graph"))


def test_base_wraps_every_kind_but_defines_none(stage):
    for kind in ("ZipmapTexture", "PinchmapTexture", "UmbrellaTexture"):
        assert fexel.FexelTexture(stage.DefinePrim(f"/{kind}", kind))
    with pytest.raises(fexel.FexelError, match="abstract"):
        fexel.FexelTexture.Define(stage, "/T")
    assert not stage.GetPrimAtPath("/T")


@pytest.mark.parametrize("wrapper", ALL)
def test_every_attribute_has_documented_annotated_accessors(wrapper):
    registry = Usd.SchemaRegistry()
    definition = registry.FindConcretePrimDefinition(wrapper.schema)
    definition = definition or registry.FindAppliedAPIPrimDefinition(wrapper.schema)
    names = [name for name in definition.GetPropertyNames() if not name.startswith("outputs:")]
    for name in names:
        base = name.rsplit(":", 1)[-1]
        getter = getattr(wrapper, f"Get{base[0].upper()}{base[1:]}Attr")
        creator = getattr(wrapper, f"Create{base[0].upper()}{base[1:]}Attr")
        brief = definition.GetPropertyDocumentation(name)
        assert "".join(inspect.getdoc(getter).split()) == "".join(brief.split())
        assert list(inspect.signature(creator).parameters) == ["self", "defaultValue", "writeSparsely"]
        assert inspect.signature(getter).return_annotation == "Usd.Attribute"


@pytest.mark.parametrize("wrapper", ALL)
def test_create_authors_the_schema_s_own_attribute(stage, wrapper):
    prim = stage.DefinePrim("/P", "ZipmapTexture" if wrapper is fexel.TextureMinificationAPI else wrapper.schema)
    view = wrapper.Apply(prim) if wrapper is fexel.TextureMinificationAPI else wrapper(prim)
    creators = [name for name in dir(view) if name.startswith("Create") and name.endswith("Attr")]
    assert creators
    for name in creators:
        attribute = getattr(view, name)()
        assert attribute.IsAuthored()
        assert not attribute.IsCustom()
        assert (
            attribute.GetTypeName()
            == prim.GetPrimDefinition().GetAttributeDefinition(attribute.GetName()).GetTypeName()
        )
        assert getattr(view, "Get" + name.removeprefix("Create"))() == attribute


def test_sparse_creation_skips_the_default_but_not_what_differs(stage):
    texture = fexel.ZipmapTexture.Define(stage, "/T")
    assert not texture.CreateOpacityAttr(1.0, writeSparsely=True).IsAuthored()
    assert not texture.CreateMatrixAttr(Gf.Matrix3d(1), True).IsAuthored()
    assert texture.CreateOpacityAttr(0.5, writeSparsely=True).Get() == 0.5
    # An opinion that is there already has to be overridden, even with the default.
    assert texture.CreateOpacityAttr(1.0, writeSparsely=True).Get() == 1.0
    assert texture.CreateBiasAttr().IsAuthored()
    assert not texture.GetBiasAttr().HasAuthoredValue()


def test_texture_connects_as_a_node_graph(stage):
    surface = UsdShade.Shader.Define(stage, "/M/Surface")
    texture = fexel.PinchmapTexture.Define(stage, "/M/Logo")
    reader = UsdShade.Shader.Define(stage, "/M/Logo/Reader")
    assert texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3).ConnectToSource(reader.ConnectableAPI(), "rgb")
    color = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    assert color.ConnectToSource(texture.ConnectableAPI(), "rgb")
    assert texture.CreateInput("antialias", Sdf.ValueTypeNames.Float).Set(2.0)
    assert texture.GetAntialiasAttr().Get() == 2.0


def test_repr_names_wrapper_and_prim(stage):
    assert repr(fexel.UmbrellaPatch.Define(stage, "/U")) == "fexel.UmbrellaPatch(Usd.Prim(</U>))"


def test_minification_applies_to_textures_and_uv_textures_only(stage):
    api = fexel.TextureMinificationAPI
    texture = fexel.ZipmapTexture.Define(stage, "/T").GetPrim()
    reader = UsdShade.Shader.Define(stage, "/Reader")
    reader.CreateIdAttr("UsdUVTexture")
    other = UsdShade.Shader.Define(stage, "/Other")
    other.CreateIdAttr("UsdPreviewSurface")
    assert api.CanApply(texture)
    assert api.CanApply(reader.GetPrim())
    assert not api.CanApply(other.GetPrim())
    assert not api.CanApply(Usd.Prim())
    assert not api(texture)
    applied = api.Apply(texture)
    assert applied
    assert applied.CreateFilterAttr("fipmap").Get() == "fipmap"
    assert api.Get(stage, "/T").GetFilterAttr().Get() == "fipmap"


@pytest.mark.parametrize(
    ("prim", "message"),
    [("/Other", "/Other: Mesh, expected"), ("/Untyped", "/Untyped: untyped, expected"), ("/No", "nothing, expected")],
)
def test_refused_application_names_the_prim_and_what_it_is(stage, prim, message):
    stage.DefinePrim("/Other", "Mesh")
    stage.DefinePrim("/Untyped")
    with pytest.raises(fexel.FexelError, match=message) as error:
        fexel.TextureMinificationAPI.Apply(stage.GetPrimAtPath(prim))
    assert "\n" not in str(error.value)


def test_umbrella_lists_its_patches_and_levels(stage):
    umbrella = fexel.UmbrellaTexture.Define(stage, "/U")
    for name in ("Leaf", "Twig", "Off"):
        fexel.UmbrellaPatch.Define(stage, f"/U/{name}")
    fexel.UmbrellaLevel.Define(stage, "/U/Level1")
    stage.GetPrimAtPath("/U/Off").SetActive(False)
    assert [str(patch.GetPath()) for patch in umbrella.GetPatches()] == ["/U/Leaf", "/U/Twig"]
    assert [str(level.GetPath()) for level in umbrella.GetLevels()] == ["/U/Level1"]
    assert fexel.UmbrellaTexture(stage.GetPrimAtPath("/U/Leaf")).GetPatches() == []
