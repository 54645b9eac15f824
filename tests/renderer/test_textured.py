"""Textured materials through the whole chain: stage, scene, textures, frame."""

from __future__ import annotations

import numpy as np
import pytest

import fexel
from fexel.errors import FexelError, FexelWarning
from stages import textured_quad, write_image

BLACK = {"diffuseColor": (0.0, 0.0, 0.0), "useSpecularWorkflow": 1}
FLAT = {"camera_light": False, "samples": 1}


def srgb_to_linear(encoded):
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def emissive(tmp_path, pixels, output="rgb", pixel_type="uint8", name="image.png", **more):
    file = write_image(tmp_path / name, pixels, pixel_type)
    height, width = pixels.shape[:2]
    textures = {"emissiveColor": (f"./{file.name}", output, more)}
    return textured_quad(tmp_path / "quad.usda", textures, width / 8, height / 8, **BLACK)


@pytest.mark.parametrize("size", [(16, 16), (7, 13), (1, 5)])
def test_unlit_texture_comes_out_exactly_as_stored(renderer, tmp_path, rng, size):
    pixels = rng.integers(0, 256, (*size, 3), dtype=np.uint8)
    stage = emissive(tmp_path, pixels)
    color = renderer.render(stage, width=size[1], height=size[0], **FLAT)["color"]
    np.testing.assert_allclose(color[..., :3], srgb_to_linear(pixels / 255.0), atol=2e-3)
    encoded = np.round(255 * np.where(color <= 0.0031308, 12.92 * color, 1.055 * np.abs(color) ** (1 / 2.4) - 0.055))
    assert np.abs(encoded[..., :3] - pixels).max() <= 1
    assert np.mean(encoded[..., :3] != pixels) < 0.05 and np.all(color[..., 3] == 1)


def test_raw_float_texture_comes_out_to_half_precision(renderer, tmp_path, rng):
    pixels = rng.uniform(0, 4, (8, 8, 3)).astype(np.float32)
    stage = emissive(tmp_path, pixels, pixel_type="float", name="image.exr", sourceColorSpace="raw")
    color = renderer.render(stage, width=8, **FLAT)["color"][..., :3]
    np.testing.assert_allclose(color, pixels, rtol=2e-3)


@pytest.mark.parametrize(("output", "channel"), [("r", 0), ("g", 1), ("b", 2)])
def test_single_outputs_take_their_channel(renderer, tmp_path, output, channel):
    pixels = np.full((4, 4, 3), (51, 102, 204), np.uint8)
    file = write_image(tmp_path / "image.png", pixels)
    textures = {"roughness": (f"./{file.name}", output, {"sourceColorSpace": "raw"})}
    stage = textured_quad(tmp_path / "quad.usda", textures, diffuseColor=(1.0, 1.0, 1.0), metallic=1.0)
    constant = textured_quad(
        tmp_path / "constant.usda",
        {},
        diffuseColor=(1.0, 1.0, 1.0),
        metallic=1.0,
        roughness=float(pixels[0, 0, channel] / 255),
    )
    np.testing.assert_allclose(
        renderer.render(stage, width=4)["color"], renderer.render(constant, width=4)["color"], rtol=5e-3
    )


def test_opacity_from_alpha_gives_the_premultiplied_texture(renderer, tmp_path):
    pixels = np.zeros((4, 4, 4), np.uint8)
    pixels[..., :3], pixels[..., 3] = (255, 0, 128), np.array([0, 85, 170, 255])[:, None]
    file = f"./{write_image(tmp_path / 'image.png', pixels).name}"
    textures = {"emissiveColor": (file, "rgb", {}), "opacity": (file, "a", {})}
    color = renderer.render(textured_quad(tmp_path / "quad.usda", textures, **BLACK), width=4, **FLAT)["color"]
    alpha = pixels[..., 3:] / 255.0
    np.testing.assert_allclose(color[..., 3:], alpha, atol=2e-3)
    np.testing.assert_allclose(color[..., :3], srgb_to_linear(pixels[..., :3] / 255.0) * alpha, atol=3e-3)


def test_normal_map_tilts_the_shading_normal(renderer, tmp_path):
    tilt = np.array([0.6, 0.0, 0.8])
    pixels = np.full((4, 4, 3), np.round((tilt * 0.5 + 0.5) * 255), np.uint8)
    file = f"./{write_image(tmp_path / 'normal.png', pixels).name}"
    decode = {"scale": (2, 2, 2, 2), "bias": (-1, -1, -1, -1), "sourceColorSpace": "raw"}
    stage = textured_quad(tmp_path / "quad.usda", {"normal": (file, "rgb", decode)})
    normal = renderer.render(stage, width=4, aovs=("normal",))["normal"]
    np.testing.assert_allclose(normal, np.broadcast_to(tilt, normal.shape), atol=6e-3)  # 8-bit steps


def test_lod_and_patch_tell_of_the_main_texture(renderer, tmp_path, rng):
    pixels = rng.integers(0, 256, (64, 64, 3), dtype=np.uint8)
    stage = emissive(tmp_path, pixels)
    for width, level in ((128, 0.0), (64, 0.0), (16, 2.0), (4, 4.0)):
        images = renderer.render(stage, width=width, aovs=("lod", "patch"))
        np.testing.assert_allclose(images["lod"], level, atol=0.02, err_msg=str(width))
        assert np.all(images["patch"] == 0)


def test_many_frames_load_a_texture_once(tmp_path, rng):
    stage = emissive(tmp_path, rng.integers(0, 256, (32, 32, 3), dtype=np.uint8))
    with fexel.Renderer() as renderer:
        for time in range(5):
            renderer.render(stage, width=32, time=time)
        stats = renderer.stats()
    assert stats["frames"] == 5 and stats["textures"]["patches_seen"] == 1 and stats["programs"] == 1


def test_edited_stage_is_rendered_anew(renderer, tmp_path):
    stage = textured_quad(tmp_path / "quad.usda", {}, emissiveColor=(0.25, 0.0, 0.0), **BLACK)
    first = renderer.render(stage, width=2, **FLAT)["color"]
    stage.GetPrimAtPath("/World/Material/Surface").GetAttribute("inputs:emissiveColor").Set((0.0, 0.5, 0.0))
    second = renderer.render(stage, width=2, **FLAT)["color"]
    assert first[0, 0, 0] == 0.25 and second[0, 0, 0] == 0.0 and second[0, 0, 1] == 0.5


def test_file_that_is_written_again_is_rendered_anew(renderer, tmp_path):
    path = tmp_path / "quad.usda"
    textured_quad(path, {}, emissiveColor=(0.25, 0.0, 0.0), **BLACK)
    assert renderer.render(path, width=2, **FLAT)["color"][0, 0, 0] == 0.25


HOSTILE = '"; } void main() { gl_FragColor = vec4(1); } //\n#define main evil'


def test_strings_of_a_stage_do_not_enter_the_shader(renderer, tmp_path):
    from pxr import Sdf, UsdShade

    pixels = np.full((4, 4, 3), 255, np.uint8)
    stage = emissive(tmp_path, pixels)
    texture = UsdShade.Shader(stage.GetPrimAtPath("/World/Material/emissiveColor"))
    for name in ("wrapS", "wrapT", "sourceColorSpace"):
        texture.CreateInput(name, Sdf.ValueTypeNames.Token).Set(HOSTILE)
    with pytest.warns(FexelWarning, match="expected one of") as caught:
        color = renderer.render(stage, width=4, **FLAT)["color"]
    assert np.all(color == 1) and all("/World/Material" in str(warning.message) for warning in caught)
    UsdShade.Shader(stage.GetPrimAtPath("/World/Material/St")).GetInput("varname").Set("st; discard")
    with pytest.warns(FexelWarning, match="expected one of"), pytest.raises(FexelError, match="unwrap") as error:
        renderer.render(stage, width=4, **FLAT)
    assert "\n" not in str(error.value)


def test_textured_image_in_tiles_equals_the_image_in_one(renderer, tmp_path, rng, monkeypatch):
    from pxr import Gf, UsdGeom

    from fexel.renderer import viewport

    stage = emissive(tmp_path, rng.integers(0, 256, (256, 256, 3), dtype=np.uint8))
    UsdGeom.Xformable(stage.GetPrimAtPath("/World/Quad")).AddRotateXYZOp().Set(Gf.Vec3f(50, 30, 10))
    options = {"width": 150, "height": 100, "aovs": ("color", "lod", "patch"), "camera_light": False}
    whole = renderer.render(stage, **options)
    monkeypatch.setattr(viewport.tiles, "__defaults__", (64,))
    parts = renderer.render(stage, **options)
    assert renderer.stats()["tiles"] >= 7
    for name, tolerance in (("color", 5e-3), ("lod", 0.02), ("patch", 0)):
        different = np.abs(parts[name] - whole[name]).max(-1) > tolerance
        assert different.mean() < 2e-3, (name, different.mean())  # a sample that lies on an edge
