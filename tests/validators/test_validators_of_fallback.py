"""fexel:Fallback, fexel:FallbackTypes: what other applications will show."""

from __future__ import annotations

import pytest
from pxr import Sdf, UsdShade

import fexel


def test_texture_without_connected_outputs_has_no_fallback(sample):
    fexel.ZipmapTexture.Define(sample.stage, "/World/Wall/Bare").CreateFileAttr(sample.file)
    finding = sample.the_only("fexel:Fallback")
    assert (finding.severity, finding.path) == ("warning", "/World/Wall/Bare")


def test_patch_needs_no_fallback_of_its_own(sample):
    fexel.PinchmapTexture.Define(sample.stage, "/World/Wall/Photo/Detail/Logo")
    assert sample.findings() == []


@pytest.mark.parametrize("name", ["file", "st"])
def test_fallback_must_not_rely_on_interface_inputs(sample, name):
    fallback = UsdShade.Shader.Get(sample.stage, "/World/Wall/Photo/Fallback")
    fallback.GetInput(name).ConnectToSource(sample.root.GetInput(name))
    finding = sample.the_only("fexel:Fallback")
    assert (finding.severity, finding.path) == ("warning", "/World/Wall/Photo/Fallback")
    assert f"inputs:{name} is connected" in finding.message


def test_fallback_must_have_a_reader_of_its_own(sample):
    outside = UsdShade.Shader.Define(sample.stage, "/World/Wall/Reader")
    outside.CreateIdAttr("UsdPrimvarReader_float2")
    result = outside.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    UsdShade.Shader.Get(sample.stage, "/World/Wall/Photo/Fallback").GetInput("st").ConnectToSource(result)
    assert "/World/Wall/Reader, expected" in sample.the_only("fexel:Fallback").message


def test_fallback_without_a_file_shows_nothing(sample):
    sample.stage.GetPrimAtPath("/World/Wall/Photo/Fallback").GetAttribute("inputs:file").Clear()
    assert "inputs:file is missing" in sample.the_only("fexel:Fallback").message


def test_output_driven_by_something_else_is_named(sample):
    UsdShade.Shader.Get(sample.stage, "/World/Wall/Photo/Fallback").CreateIdAttr("ND_image_color3")
    found = sample.found("fexel:Fallback")
    assert len(found) == 5
    assert all("(ND_image_color3), expected a UsdUVTexture" in finding.message for finding in found)


def test_connection_to_a_missing_prim_is_found(sample):
    sample.root.GetOutput("rgb").GetAttr().SetConnections(["/World/Wall/Photo/Gone.outputs:rgb"])
    assert any("outputs:rgb" in finding.message for finding in sample.found("fexel:Fallback"))


def test_stage_must_declare_the_fallback_types(sample):
    fexel.PinchmapTexture.Define(sample.stage, "/World/Wall/Photo/Logo")
    sample.stage.ClearMetadata("fallbackPrimTypes")
    found = sample.found("fexel:FallbackTypes")
    assert [finding.path for finding in found] == ["/World/Wall/Photo", "/World/Wall/Photo/Logo"]
    assert all("WriteFallbackPrimTypes" in finding.message for finding in found)
