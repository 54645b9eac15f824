"""fexel:Minification, and fexel:Limits of TextureMinificationAPI."""

from __future__ import annotations

import math

import pytest
from pxr import Gf, Sdf

from fexel.schema.minification import TextureMinificationAPI


def applied(prim, **values):
    api = TextureMinificationAPI.Apply(prim)
    for name, value in values.items():
        api.GetPrim().GetAttribute(f"minification:{name}").Set(value)


def shader(sample):
    """The UsdUVTexture in the sample's zipmap."""
    return sample.stage.GetPrimAtPath("/World/Wall/Photo/Fallback")


@pytest.mark.parametrize("of", [lambda sample: sample.root.GetPrim(), lambda sample: sample.patch.GetPrim(), shader])
def test_values_that_can_be_used_have_no_findings(sample, of):
    applied(of(sample), filter="fipmap", contrast=-0.5, brightness=0.25, attenuationColor=Gf.Vec3f(0, 2, 0.5))
    applied(of(sample), attenuationDistance=math.inf)
    assert sample.findings() == []


BAD = [
    ("contrast", math.nan, "fexel:Minification", "nan, expected a finite number"),
    ("brightness", math.inf, "fexel:Minification", "inf, expected a finite number"),
    ("attenuationDistance", 0.0, "fexel:Minification", "0, expected more than 0"),
    ("attenuationDistance", -1.0, "fexel:Limits", "-1, expected at least 0"),
    ("attenuationDistance", math.nan, "fexel:Limits", "nan, expected at least 0"),
    ("attenuationColor", Gf.Vec3f(1, -1, 0), "fexel:Minification", "(1, -1, 0), expected finite values from 0"),
    ("filter", "auto", "fexel:Limits", "auto, expected one of mipmap, anisotropic, ripmap, fipmap"),
]


@pytest.mark.parametrize(("name", "value", "validator", "message"), BAD)
def test_value_that_cannot_be_used_is_an_error_on_textures(sample, name, value, validator, message):
    applied(sample.root.GetPrim(), **{name: value})
    (finding,) = sample.findings()
    assert finding.severity == "error" and finding.validator == validator
    assert finding.message == f"minification:{name}: {message}"


@pytest.mark.parametrize(("name", "value", "validator", "message"), BAD)
def test_value_that_cannot_be_used_is_an_error_on_shaders_too(sample, name, value, validator, message):
    applied(shader(sample), **{name: value})
    (finding,) = sample.findings()
    assert finding.severity == "error" and finding.validator == "fexel:Minification"
    assert finding.message == f"minification:{name}: {message}"


@pytest.mark.parametrize("of", [lambda sample: sample.root.GetPrim(), shader])
@pytest.mark.parametrize(
    ("name", "kind", "value", "message"),
    [
        ("contrast", Sdf.ValueTypeNames.String, "x", "'x', expected a number"),
        ("contrast", Sdf.ValueTypeNames.String, "0.5", "'0.5', expected a number"),
        ("brightness", Sdf.ValueTypeNames.Float3, Gf.Vec3f(1), "Gf.Vec3f(1.0, 1.0, 1.0), expected a number"),
        ("attenuationDistance", Sdf.ValueTypeNames.String, "far", "'far', expected a number"),
        ("attenuationDistance", Sdf.ValueTypeNames.StringArray, ["x"], "expected a number"),
        ("attenuationColor", Sdf.ValueTypeNames.String, "red", "'red', expected 3 numbers"),
        ("attenuationColor", Sdf.ValueTypeNames.Color3fArray, [Gf.Vec3f(1)] * 3, "expected 3 numbers"),
        ("attenuationColor", Sdf.ValueTypeNames.Float, 1.0, "1.0, expected 3 numbers"),
        ("filter", Sdf.ValueTypeNames.Float, 1.0, "1.0, expected one of mipmap, anisotropic, ripmap, fipmap"),
        ("filter", Sdf.ValueTypeNames.StringArray, ["x"], "expected one of mipmap, anisotropic, ripmap, fipmap"),
    ],
)
def test_value_of_another_type_is_an_error_and_no_traceback(sample, of, name, kind, value, message):
    applied(of(sample))
    spec = Sdf.CreatePrimInLayer(sample.stage.GetEditTarget().GetLayer(), of(sample).GetPath())
    Sdf.AttributeSpec(spec, f"minification:{name}", kind).default = value
    (finding,) = (each for each in sample.findings() if each.validator.startswith("fexel:"))  # USD itself has one, too
    assert finding.severity == "error"
    assert finding.message.startswith(f"minification:{name}: ") and finding.message.endswith(message)
    assert "\n" not in finding.message


def test_attenuation_of_another_type_on_a_patch_is_one_error(sample):
    applied(sample.patch.GetPrim())
    spec = Sdf.CreatePrimInLayer(sample.stage.GetEditTarget().GetLayer(), sample.patch.GetPrim().GetPath())
    Sdf.AttributeSpec(spec, "minification:attenuationDistance", Sdf.ValueTypeNames.String).default = "far"
    (finding,) = (each for each in sample.findings() if each.validator.startswith("fexel:"))
    assert finding.message == "minification:attenuationDistance: 'far', expected a number"


def test_time_samples_are_looked_at_too(sample):
    applied(sample.root.GetPrim())
    attribute = sample.root.GetPrim().GetAttribute("minification:contrast")
    attribute.Set(1.0, 1)
    attribute.Set(math.nan, 2)
    assert sample.the_only("fexel:Minification").message == (
        "minification:contrast: nan, expected a finite number at time 2"
    )


@pytest.mark.parametrize("of", [lambda sample: sample.root.GetPrim(), shader])
def test_attributes_without_the_api_are_an_error(sample, of):
    of(sample).CreateAttribute("minification:filter", Sdf.ValueTypeNames.Token).Set("ripmap")
    assert sample.the_only("fexel:Minification").message == (
        "minification:filter: TextureMinificationAPI is not applied to the prim, expected it in its apiSchemas; "
        "nothing of it is used"
    )


def test_api_on_another_shader_is_an_error(sample):
    sample.surface.GetPrim().ApplyAPI("TextureMinificationAPI")
    finding = sample.the_only("fexel:Minification")
    assert (finding.path, finding.severity) == ("/World/Wall/Surface", "error")
    assert finding.message == "TextureMinificationAPI on a shader UsdPreviewSurface, expected UsdUVTexture"


def test_attenuation_of_a_patch_is_a_warning(sample):
    applied(sample.patch.GetPrim(), attenuationDistance=5.0)
    finding = sample.the_only("fexel:Minification")
    assert finding.severity == "warning"
    assert finding.message.startswith("minification:attenuationDistance: has no effect on a patch")
