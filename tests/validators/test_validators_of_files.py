"""fexel:Files and the two colour space validators."""

from __future__ import annotations

import pytest
from pxr import Sdf, UsdShade

import fexel


def test_clean_stage_has_no_findings(sample):
    assert sample.findings() == []


def test_all_validators_of_usd_run_beside_ours(sample):
    from pxr import UsdValidation

    sample.findings()
    names = {str(metadata.name) for metadata in UsdValidation.ValidationRegistry().GetAllValidatorMetadata()}
    assert len({name for name in names if name.startswith("fexel:")}) == 12
    assert len(names) >= 12 + 25  # usd-core 26.5 has 27 of its own, 26.11 has 30
    ours = UsdValidation.ValidationRegistry().GetValidatorMetadataForKeyword("FexelValidators")
    assert len(ours) == 12
    assert all(metadata.doc for metadata in ours)


def test_usd_s_own_findings_are_reported(sample):
    sample.stage.ClearMetadata("upAxis")
    assert any(finding.validator.startswith("usdGeom") for finding in sample.findings())


@pytest.mark.parametrize("name", ["file", "mask"])
def test_missing_file_names_prim_and_file(sample, name):
    sample.patch.GetPrim().GetAttribute(f"inputs:{name}").Set("./nowhere.png")
    finding = sample.the_only("fexel:Files")
    assert (finding.severity, finding.path) == ("error", "/World/Wall/Photo/Detail")
    assert finding.message == f"inputs:{name}: ./nowhere.png: no such file"


def test_missing_files_of_pinchmaps_and_umbrellas(sample):
    fexel.PinchmapTexture.Define(sample.stage, "/World/Wall/Photo/Logo").CreatePinchmapAttr("./a.exr")
    umbrella = fexel.UmbrellaTexture.Define(sample.stage, "/World/Wall/Photo/Lawn")
    fexel.UmbrellaPatch.Define(sample.stage, "/World/Wall/Photo/Lawn/Leaf").CreateFileAttr("./b.png")
    fexel.UmbrellaLevel.Define(sample.stage, "/World/Wall/Photo/Lawn/Level").CreateFileAttr("./c.png")
    assert umbrella
    found = sorted(finding.message for finding in sample.found("fexel:Files"))
    assert [message.split(": ")[1] for message in found] == ["./b.png", "./c.png", "./a.exr"]


def test_text_in_a_png_s_clothes_is_unreadable(sample, tmp_path):
    (tmp_path / "text.png").write_text("not an image")
    sample.patch.GetFileAttr().Set("./text.png")
    assert "text.png" in sample.the_only("fexel:Files").message


@pytest.mark.parametrize("extension", ["jpg", "png", "tif", "exr"])
def test_truncated_image_is_found(sample, image, tmp_path, extension):
    dtype = "half" if extension == "exr" else "uint8"
    file = image(tmp_path / f"cut.{extension}", dtype=dtype, size=200)
    whole = (tmp_path / file).read_bytes()
    (tmp_path / file).write_bytes(whole[: len(whole) // 2])
    sample.patch.GetFileAttr().Set(file)
    assert sample.the_only("fexel:Files").severity == "error"


def test_every_time_sample_of_a_file_is_checked(sample):
    attribute = sample.patch.GetFileAttr()
    attribute.Set(sample.file, 1.0)
    attribute.Set("./gone.png", 2.0)
    assert sample.the_only("fexel:Files").message == "inputs:file: ./gone.png: no such file at time 2"


def test_udim_pattern_needs_one_tile_checks_each_and_warns_that_they_are_not_drawn(sample, image, tmp_path):
    def errors():
        found = sample.found("fexel:Files")
        (warning,) = (finding for finding in found if finding.severity == "warning")
        assert warning.message == "inputs:file: ./tile.<UDIM>.png: <UDIM> tiles are not drawn, expected one image"
        return [finding.message for finding in found if finding.severity == "error"]

    sample.patch.GetFileAttr().Set("./tile.<UDIM>.png")
    (message,) = errors()
    assert "no such file" in message
    image(tmp_path / "tile.1001.png")
    image(tmp_path / "tile.1002.png")
    assert errors() == []
    (tmp_path / "tile.1002.png").write_bytes(b"")
    (message,) = errors()
    assert "tile.1002.png" in message


def test_texture_without_a_file_shows_its_fallback_colour_and_is_no_fault(sample):
    fexel.ZipmapTexture.Define(sample.stage, "/World/Wall/Photo/Plain")
    assert sample.findings() == []


@pytest.mark.parametrize("use", ["normal", "roughness", "metallic", "opacity"])
def test_data_read_as_srgb_is_an_error(sample, texture, use):
    data = texture(sample.stage, "/World/Wall/Data", sample.file)
    data.CreateSourceColorSpaceAttr("sRGB")
    sample.connect(use, data, "rgb" if use == "normal" else "r")
    finding = sample.the_only("fexel:ColorSpace")
    assert (finding.severity, finding.path) == ("error", "/World/Wall/Data")
    assert f"/World/Wall/Surface.inputs:{use}" in finding.message
    data.CreateSourceColorSpaceAttr("raw")
    assert sample.found("fexel:ColorSpace") == []


def test_auto_reads_8_bit_rgb_as_srgb_and_16_bit_as_data(sample, texture, image, tmp_path):
    data = texture(sample.stage, "/World/Wall/Data", sample.file)
    sample.connect("normal", data)
    assert sample.the_only("fexel:ColorSpace").severity == "error"
    data.GetFileAttr().Set(image(tmp_path / "deep.png", dtype="uint16"))
    assert sample.found("fexel:ColorSpace") == []


def test_colour_space_of_the_attribute_is_stronger_than_the_input(sample, texture):
    data = texture(sample.stage, "/World/Wall/Data", sample.file)
    data.CreateSourceColorSpaceAttr("raw")
    data.GetFileAttr().SetColorSpace("srgb_rec709_scene")
    sample.connect("normal", data)
    assert sample.the_only("fexel:ColorSpace").severity == "error"


def test_alpha_is_never_encoded_so_it_may_drive_opacity(sample):
    sample.connect("opacity", sample.root, "a")
    assert sample.found("fexel:ColorSpace") == []


def test_colour_read_raw_is_a_warning_at_the_patch_that_does(sample):
    sample.patch.CreateSourceColorSpaceAttr("raw")
    finding = sample.the_only("fexel:ColorSpace")
    assert (finding.severity, finding.path) == ("warning", "/World/Wall/Photo/Detail")


def test_use_is_found_through_node_graphs(sample, texture):
    graph = UsdShade.NodeGraph.Define(sample.stage, "/World/Wall/Graph")
    inner = texture(sample.stage, "/World/Wall/Graph/Normal", sample.file)
    output = graph.CreateOutput("out", Sdf.ValueTypeNames.Float3)
    output.ConnectToSource(inner.ConnectableAPI(), "rgb")
    sample.surface.CreateInput("normal", Sdf.ValueTypeNames.Normal3f).ConnectToSource(output)
    assert sample.the_only("fexel:ColorSpace").path == "/World/Wall/Graph/Normal"


def test_connections_in_a_circle_end(sample):
    a = UsdShade.NodeGraph.Define(sample.stage, "/World/Wall/A")
    b = UsdShade.NodeGraph.Define(sample.stage, "/World/Wall/B")
    one, two = (graph.CreateOutput("out", Sdf.ValueTypeNames.Float3) for graph in (a, b))
    one.ConnectToSource(two)
    two.ConnectToSource(one)
    sample.surface.CreateInput("normal", Sdf.ValueTypeNames.Normal3f).ConnectToSource(one)
    assert sample.found("fexel:ColorSpace") == []


@pytest.mark.parametrize("name", ["mask", "pinchmap"])
def test_masks_and_pinchmaps_are_always_raw(sample, image, tmp_path, name):
    kind = fexel.ZipmapTexture if name == "mask" else fexel.PinchmapTexture
    prim = kind.Define(sample.stage, "/World/Wall/Photo/Extra").GetPrim()
    attribute = prim.CreateAttribute(f"inputs:{name}", Sdf.ValueTypeNames.Asset, custom=False)
    attribute.Set(image(tmp_path / "data.png", 4))
    attribute.SetColorSpace("sRGB")
    assert sample.the_only("fexel:DataColorSpace").message.startswith(
        f"inputs:{name}: colorSpace is sRGB, expected raw"
    )
    attribute.SetColorSpace("raw")
    assert sample.found("fexel:DataColorSpace") == []
