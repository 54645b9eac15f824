"""TextureMinificationAPI as it is read from prims."""

from __future__ import annotations

import math

import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

import fexel
from fexel.errors import FexelError
from fexel.filters import FILTERS, checked_filter
from fexel.filters.minification import NO_MINIFICATION, Minification, filter_of, minification_of
from fexel.scene import SceneReader
from fexel.textures.inputs import Inputs

TEXTURE = "/Mat/Texture"
KINDS = ("UsdUVTexture", "ZipmapTexture", "PinchmapTexture", "UmbrellaTexture")


@pytest.fixture
def textured(stage, define_mesh):
    """A square with a texture of a kind; the texture's prim."""

    def make(kind="UsdUVTexture", mesh="/Square", material_path="/Mat"):
        square = define_mesh(stage, mesh, st=("TexCoord2fArray", "vertex", [(0, 0), (1, 0), (1, 1), (0, 1)]))
        material = UsdShade.Material.Define(stage, material_path)
        surface = UsdShade.Shader.Define(stage, f"{material_path}/Surface")
        surface.CreateIdAttr("UsdPreviewSurface")
        material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
        prim = stage.DefinePrim(f"{material_path}/Texture", "Shader" if kind == "UsdUVTexture" else kind)
        if kind == "UsdUVTexture":
            UsdShade.Shader(prim).CreateIdAttr(kind)
        rgb = UsdShade.ConnectableAPI(prim).CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(rgb)
        UsdShade.MaterialBindingAPI.Apply(square.GetPrim()).Bind(material)
        return prim

    return make


def read_texture(scene):
    return scene.draws[0].material.inputs["diffuseColor"].texture


@pytest.mark.parametrize("kind", KINDS)
def test_all_that_is_authored_arrives(stage, textured, read, kind):
    api = fexel.TextureMinificationAPI.Apply(textured(kind))
    api.CreateFilterAttr("ripmap")
    api.CreateContrastAttr(0.5)
    api.CreateBrightnessAttr(-0.25)
    api.CreateAttenuationDistanceAttr(12.5)
    api.CreateAttenuationColorAttr(Gf.Vec3f(0.25, 0.5, 1.5))
    scene, told = read(stage)
    asked = read_texture(scene).minification
    assert asked == Minification("ripmap", 0.5, -0.25, 12.5, (0.25, 0.5, 1.5))
    assert asked.toned and asked.attenuates and told == []


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_authored_is_no_minification_at_all(stage, textured, read, kind):
    prim = textured(kind)
    assert read_texture(read(stage)[0]).minification is NO_MINIFICATION
    fexel.TextureMinificationAPI.Apply(prim)
    asked = read_texture(read(stage)[0]).minification
    assert asked == NO_MINIFICATION and not asked.toned and not asked.attenuates


@pytest.mark.parametrize("token", FILTERS)
def test_every_filter_is_taken_without_a_warning(stage, textured, read, token):
    fexel.TextureMinificationAPI.Apply(textured()).CreateFilterAttr(token)
    scene, told = read(stage)
    assert read_texture(scene).minification.filter == token and told == []


@pytest.mark.parametrize("kind", KINDS)
def test_unknown_filter_is_told_once_and_counts_as_anisotropic(stage, textured, read, kind):
    prim = textured(kind)
    fexel.TextureMinificationAPI.Apply(prim).CreateFilterAttr("Fipmap")
    scene, told = read(stage)
    assert read_texture(scene).minification.filter == "anisotropic"
    assert told == [
        "/Mat/Texture.minification:filter: is 'Fipmap', expected one of mipmap, anisotropic, ripmap, fipmap; "
        "anisotropic is used"
    ]


def test_every_fault_of_a_prim_is_told_once_whatever_the_time(stage, textured):
    api = fexel.TextureMinificationAPI.Apply(textured())
    api.CreateContrastAttr(math.nan)
    api.CreateAttenuationDistanceAttr(-1.0)
    api.CreateBrightnessAttr().Set(0.0, 1)
    api.GetBrightnessAttr().Set(1.0, 3)
    reader = SceneReader(stage)
    with pytest.warns(fexel.FexelWarning) as caught:
        asked = [read_texture(reader.at(time)).minification for time in (1.0, 2.0, 3.0)]
    assert [one.brightness for one in asked] == [0.0, 0.5, 1.0]
    assert {one.contrast for one in asked} == {1.0} and not any(one.attenuates for one in asked)
    assert sorted(str(one.message) for one in caught) == [
        "/Mat/Texture.minification:attenuationDistance: is -1, expected more than 0; nothing is attenuated",
        "/Mat/Texture.minification:contrast: is nan, expected a finite number; 1 is used",
    ]


def test_texture_of_which_nothing_varies_is_the_same_at_every_time(stage, textured):
    fexel.TextureMinificationAPI.Apply(textured()).CreateContrastAttr(0.5)
    reader = SceneReader(stage)
    assert read_texture(reader.at(1.0)) is read_texture(reader.at(2.0))


def test_instances_share_what_their_prototype_asks_for(stage, textured, read):
    prim = textured(mesh="/Prototype/Square", material_path="/Prototype/Mat")
    fexel.TextureMinificationAPI.Apply(prim).CreateFilterAttr("fipmap")
    stage.GetPrimAtPath("/Prototype").SetSpecifier(Sdf.SpecifierClass)
    for name in ("A", "B"):
        instance = UsdGeom.Xform.Define(stage, f"/{name}").GetPrim()
        instance.GetReferences().AddInternalReference("/Prototype")
        instance.SetInstanceable(True)
    scene, told = read(stage)
    textures = [draw.material.inputs["diffuseColor"].texture for draw in scene.draws]
    assert len(textures) == 2 and textures[0] is textures[1] and textures[0].minification.filter == "fipmap"
    assert told == []


def test_stronger_layer_says_what_is_asked_for(stage, textured, read):
    """As `fexel minify` writes it: a layer over the stage."""
    textured("ZipmapTexture")
    over = Usd.Stage.Open(Sdf.Layer.CreateAnonymous(".usda"))
    over.GetRootLayer().subLayerPaths = [stage.GetRootLayer().identifier]
    fexel.TextureMinificationAPI.Apply(over.OverridePrim(TEXTURE)).CreateFilterAttr("fipmap")
    assert read_texture(read(over)[0]).minification.filter == "fipmap"
    assert read_texture(read(stage)[0]).minification.filter is None


def test_value_of_another_type_is_told_and_left_out(stage, textured, read):
    prim = textured()
    prim.ApplyAPI("TextureMinificationAPI")
    spec = Sdf.CreatePrimInLayer(stage.GetRootLayer(), TEXTURE)
    Sdf.AttributeSpec(spec, "minification:attenuationColor", Sdf.ValueTypeNames.Float).default = 2.0
    Sdf.AttributeSpec(spec, "minification:contrast", Sdf.ValueTypeNames.String).default = "much"
    scene, told = read(stage)
    assert read_texture(scene).minification == NO_MINIFICATION
    assert sorted(told) == [
        "/Mat/Texture.minification:attenuationColor: is 2.0, expected 3 numbers; it is left out",
        "/Mat/Texture.minification:contrast: is 'much', expected a number; it is left out",
    ]


def test_kinds_read_their_own_filter_and_a_patch_all_of_it(stage, textured):
    prim = textured("ZipmapTexture")
    patch = fexel.ZipmapTexture.Define(stage, f"{TEXTURE}/Patch").GetPrim()
    fexel.TextureMinificationAPI.Apply(patch).CreateContrastAttr(0.5)
    time = Usd.TimeCode.Default()
    assert filter_of(Inputs(prim, time)) is None and minification_of(Inputs(prim, time)) is NO_MINIFICATION
    assert minification_of(Inputs(patch, time)) == Minification(contrast=0.5)


def test_checked_filter_quotes_what_was_found():
    assert checked_filter("ewa") == "ewa"
    with pytest.raises(FexelError, match=r"--filter: 'box', expected one of mipmap, .*, auto"):
        checked_filter("box", "--filter")
