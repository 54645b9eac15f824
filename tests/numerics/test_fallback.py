"""The baked fallback against float64 supersampled compositing, and its network against USD's validators."""

from __future__ import annotations

import subprocess
import sys

import cv2
import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdShade

import fexel
from fexel import homography
from fexel.errors import FexelError, FexelWarning
from fexel.images import image_info, linear_to_srgb, read_linear, read_pixels
from fexel.scene.sampling import Faults, Sampler
from fexel.scene.shader_network import texture_coordinates
from fexel.textures import extract_texture
from fexel.textures.pyramid_cache import PyramidCache
from fexel_tools import fallback
from fexel_tools.texture_files import write_texture
from fexel_tools.zipmap_baking import baked_size


def smooth(rng, height, width, sigma=2.0):
    image = cv2.GaussianBlur(rng.random((height, width, 3)).astype(np.float32), (0, 0), sigma)
    return (image - image.min()) / (image.max() - image.min())


def ramp(height, width, depth):
    """Alpha that rises from 0 on the border to 1 at `depth` texels."""
    y, x = np.indices((height, width))
    return np.clip(np.minimum.reduce([y, x, height - 1 - y, width - 1 - x]) / depth, 0, 1).astype(np.float32)


def supersampled(files, matrices, opacities, width, height, samples):
    """Eq. (1) from bilinear lookups in level 0, float64, averaged over samples x samples points of each pixel."""
    layers = []
    for number, file in enumerate(files):
        texels = read_linear(str(file)).astype(np.float64)
        if number:
            texels[[0, -1]] = texels[:, [0, -1]] = 0
        layers.append((texels, matrices[number], opacities[number]))
    offset = (np.arange(samples) + 0.5) / samples
    s = (np.arange(width)[:, None] + offset).ravel() / width
    rows = [supersampled_row(layers, s, 1 - (y + offset) / height) for y in range(height)]
    return np.array([row.reshape(samples, width, samples, 4).mean(axis=(0, 2)) for row in rows])


def supersampled_row(layers, s, t):
    points = np.stack(np.meshgrid(s, t), axis=-1).reshape(-1, 2)
    color = np.zeros((len(points), 4))
    for texels, matrix, opacity in layers:
        st = homography.apply(matrix, points)
        inside = ((st >= 0) & (st <= 1)).all(axis=1)
        layer = bilinear(texels, st[inside]) * opacity
        color[inside] = layer + color[inside] * (1 - layer[:, 3:])
    return color


def bilinear(texels, st):
    height, width = texels.shape[:2]
    x, y = st[:, 0] * width - 0.5, (1 - st[:, 1]) * height - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - left)[:, None], (y - top)[:, None]

    def at(row, column):
        return texels[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]

    upper = at(top, left) * (1 - fx) + at(top, left + 1) * fx
    return upper * (1 - fy) + (at(top + 1, left) * (1 - fx) + at(top + 1, left + 1) * fx) * fy


PATCH_TO_ROOT = np.array([[0.31, 0.05, 0.02], [-0.04, 0.28, 0.03], [0.4, 0.3, 1.0]])
NESTED_TO_PATCH = np.array([[0.3, 0.0, 0.0], [0.0, 0.25, 0.0], [0.35, 0.45, 1.0]])


@pytest.fixture
def zipmap(nest):
    return nest[1]


@pytest.fixture
def nest(tmp_path, rng):
    """Root, a tilted patch and one nested in it, textures with levels beside the stage."""
    write_texture(tmp_path / "root.tif", smooth(rng, 75, 100))
    write_texture(tmp_path / "patch.tif", smooth(rng, 120, 160, 3.0), ramp(120, 160, 15))
    write_texture(tmp_path / "nested.tif", smooth(rng, 150, 130, 4.0), ramp(150, 130, 20))
    stage = Usd.Stage.CreateNew(str(tmp_path / "stage.usda"))
    texture = fexel.ZipmapTexture.Define(stage, "/Material/Texture")
    texture.CreateFileAttr("./root.tif")
    patch = fexel.ZipmapTexture.Define(stage, "/Material/Texture/Patch")
    patch.CreateFileAttr("./patch.tif")
    patch.CreateMatrixAttr(Gf.Matrix3d(*np.linalg.inv(PATCH_TO_ROOT).ravel().tolist()))
    nested = fexel.ZipmapTexture.Define(stage, "/Material/Texture/Patch/Nested")
    nested.CreateFileAttr("./nested.tif")
    nested.CreateMatrixAttr(Gf.Matrix3d(*np.linalg.inv(NESTED_TO_PATCH).ravel().tolist()))
    nested.CreateOpacityAttr(0.75)
    return stage, texture


def truth(tmp_path, width, height, samples):
    to_patch = np.linalg.inv(PATCH_TO_ROOT)
    matrices = [np.eye(3), to_patch, to_patch @ np.linalg.inv(NESTED_TO_PATCH)]
    files = [tmp_path / name for name in ("root.tif", "patch.tif", "nested.tif")]
    return supersampled(files, matrices, [1, 1, 0.75], width, height, samples)


@pytest.mark.parametrize(("size", "samples"), [(160, 8), (51, 24)])
def test_baked_picture_is_the_supersampled_composite(tmp_path, zipmap, size, samples):
    baked = fallback.bake(zipmap.GetPrim(), size)
    height, width = baked.shape[:2]
    assert max(width, height) == size
    error = np.abs(baked - truth(tmp_path, width, height, samples))
    assert error.mean() < 0.25 / 255
    assert error.max() < 12 / 255  # on the noise of the nested patch: mip levels blur a little more than pixels do


def test_picture_is_as_fine_as_the_finest_patch_and_never_larger_than_asked(zipmap):
    data = extract_texture(zipmap.GetPrim(), Usd.TimeCode.Default())[1]
    width, height = baked_size(data, PyramidCache(), 100_000)
    to_nested = np.linalg.inv(PATCH_TO_ROOT) @ np.linalg.inv(NESTED_TO_PATCH)
    density = homography.jacobian(to_nested, homography.apply(np.linalg.inv(to_nested), [[0.5, 0.5]]))
    across, up = 130 * abs(density[0, 0, 0]) / 100, 150 * abs(density[0, 1, 1]) / 75  # texels per texel of the root
    assert width == pytest.approx(100 * max(across, up), rel=0.2)
    assert height == pytest.approx(width * 0.75, abs=1)
    assert fallback.bake(zipmap.GetPrim(), 64).shape == (48, 64, 4)


def test_root_alone_is_baked_at_its_own_size_and_unchanged(tmp_path, rng):
    pixels = smooth(rng, 60, 80)
    write_texture(tmp_path / "root.tif", pixels)
    stage = Usd.Stage.CreateInMemory()
    texture = fexel.ZipmapTexture.Define(stage, "/Texture")
    texture.CreateFileAttr(str(tmp_path / "root.tif"))
    baked = fallback.bake(texture.GetPrim(), 2048)
    assert baked.shape == (60, 80, 4)
    inside = (slice(1, -1), slice(1, -1))
    blurred = supersampled([tmp_path / "root.tif"], [np.eye(3)], [1], 80, 60, 8)
    assert np.abs(baked - blurred)[inside].max() < 2 / 255
    assert (baked[..., 3] == 1).all()


def test_fine_texture_does_not_alias(tmp_path):
    """A one-texel checkerboard of 1000 texels is grey at 50: the linear mean."""
    y, x = np.indices((1000, 1000))
    write_texture(tmp_path / "fine.tif", np.repeat(((x + y) % 2)[..., None], 3, axis=2))
    stage = Usd.Stage.CreateInMemory()
    texture = fexel.ZipmapTexture.Define(stage, "/Texture")
    texture.CreateFileAttr(str(tmp_path / "fine.tif"))
    assert np.abs(fallback.bake(texture.GetPrim(), 50)[..., :3] - 0.5).max() < 2 / 255


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.full((3, 3), np.nan), np.full((3, 3), np.inf)])
def test_unusable_patches_are_left_out(zipmap, matrix):
    expected = None
    patch = zipmap.GetPrim().GetStage().GetPrimAtPath("/Material/Texture/Patch")
    patch.SetActive(False)
    expected = fallback.bake(zipmap.GetPrim(), 200)
    patch.SetActive(True)
    patch.GetAttribute("inputs:matrix").Set(Gf.Matrix3d(*matrix.ravel().tolist()))
    with pytest.warns(FexelWarning, match="/Material/Texture/Patch"):
        assert np.array_equal(fallback.bake(zipmap.GetPrim(), 200), expected)


def test_missing_file_shows_the_fallback_colour_and_warns(tmp_path):
    stage = Usd.Stage.CreateInMemory()
    texture = fexel.ZipmapTexture.Define(stage, "/Texture")
    texture.CreateFileAttr(str(tmp_path / "none.tif"))
    texture.CreateFallbackAttr(Gf.Vec4f(0.25, 0.5, 1, 1))
    with pytest.warns(FexelWarning, match="none.tif"):
        baked = fallback.bake(texture.GetPrim(), 16)
    assert np.allclose(baked, [0.25, 0.5, 1, 1], atol=1e-3)


def test_srgb_root_gives_an_8_bit_srgb_png_and_a_network(tmp_path, zipmap):
    path = fallback.write_fallback(zipmap.GetPrim(), tmp_path / "textures.png", 128)
    info = image_info(str(path))
    assert (info.dtype, info.channels, info.color_space, max(info.width, info.height)) == ("uint8", 3, "sRGB", 128)
    expected = np.rint(linear_to_srgb(fallback.bake(zipmap.GetPrim(), 128)[..., :3]) * 255)
    assert np.array_equal(read_pixels(info), expected.astype(np.uint8))
    stage = zipmap.GetPrim().GetStage()
    shader = UsdShade.Shader(stage.GetPrimAtPath("/Material/Texture/Fallback"))
    assert shader.GetInput("file").Get().path == "./textures.png"
    assert shader.GetInput("sourceColorSpace").Get() == "sRGB"
    reader = UsdShade.Shader(stage.GetPrimAtPath("/Material/Texture/FallbackSt"))
    assert (reader.GetShaderId(), reader.GetInput("varname").Get()) == ("UsdPrimvarReader_float2", "st")


@pytest.mark.parametrize(("bits", "extension", "dtype"), [(8, ".png", "uint16"), ("half", ".exr", "float16")])
def test_data_keep_their_values(tmp_path, rng, bits, extension, dtype):
    data = smooth(rng, 40, 50) * 0.8 + 0.1
    name = "data.tif" if bits == 8 else "data.exr"
    write_texture(tmp_path / name, data, bits=bits, color_space="raw")
    stage = Usd.Stage.CreateNew(str(tmp_path / "stage.usda"))
    texture = fexel.ZipmapTexture.Define(stage, "/Texture")
    texture.CreateFileAttr(f"./{name}")
    texture.CreateSourceColorSpaceAttr("raw")
    texture.CreateScaleAttr(Gf.Vec4f(2, 2, 2, 1))
    texture.CreateBiasAttr(Gf.Vec4f(-1, -1, -1, 0))
    path = fallback.write_fallback(texture.GetPrim(), tmp_path / "fallback.png", 2048)
    info = image_info(str(path))
    assert (path.suffix, info.dtype) == (extension, dtype)
    values = read_pixels(info) / (65535 if dtype == "uint16" else 1)
    assert np.abs(values[1:-1, 1:-1, :3] - data[1:-1, 1:-1]).max() < 0.02  # bilinear over the pixel smooths a little
    shader = UsdShade.Shader(stage.GetPrimAtPath("/Texture/Fallback"))
    assert shader.GetInput("sourceColorSpace").Get() == "raw"
    assert shader.GetInput("scale").Get() == Gf.Vec4f(2, 2, 2, 1)
    assert shader.GetInput("bias").Get() == Gf.Vec4f(-1, -1, -1, 0)


def test_network_reads_what_feeds_the_texture(tmp_path, zipmap):
    """The renderer's own reading of both, the texture and its fallback, agrees; a varname of the material's interface
    and a value over time are copied.
    """
    stage = zipmap.GetPrim().GetStage()
    material = UsdShade.Material(stage.GetPrimAtPath("/Material"))
    material = material or UsdShade.Material.Define(stage, "/Material")
    name = material.CreateInput("uv", Sdf.ValueTypeNames.String)
    name.Set("UVMap")
    reader = UsdShade.Shader.Define(stage, "/Material/Reader")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).ConnectToSource(name)
    output = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    for number, values in enumerate((((2, 3), 30.0, (0.1, 0.2)), ((0.5, 4), -50.0, (3, 1)))):
        node = UsdShade.Shader.Define(stage, f"/Material/Transform{number}")
        node.CreateIdAttr("UsdTransform2d")
        node.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(output)
        node.CreateInput("scale", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(*values[0]))
        node.CreateInput("rotation", Sdf.ValueTypeNames.Float).Set(values[1])
        node.CreateInput("translation", Sdf.ValueTypeNames.Float2).Set(Gf.Vec2f(*values[2]))
        output = node.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    node.GetInput("rotation").Set(90.0, 7.0)
    UsdShade.NodeGraph(zipmap.GetPrim()).CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(output)
    fallback.author(zipmap.GetPrim(), tmp_path / "fallback.png")
    for time in (None, 7.0):
        ours, theirs = (
            texture_coordinates(prim, Sampler(time), Faults())
            for prim in (stage.GetPrimAtPath("/Material/Texture/Fallback"), zipmap.GetPrim())
        )
        assert ours.primvar == "UVMap"
        np.testing.assert_array_equal(ours.transform, theirs.transform)
    inner = stage.GetPrimAtPath("/Material/Texture/FallbackSt").GetAttribute("inputs:varname")
    assert (inner.Get(), inner.HasAuthoredConnections()) == ("UVMap", False)


CHECK = """
import sys
from pxr import Sdf, Usd, UsdShade, UsdValidation
if sys.argv[2] == "fexel":
    import fexel
stage = Usd.Stage.Open(sys.argv[1])
texture = stage.GetPrimAtPath("/Material/Texture")
assert UsdShade.NodeGraph(texture), texture.GetTypeName()
diffuse = UsdShade.Shader(stage.GetPrimAtPath("/Material/Surface")).GetInput("diffuseColor")
source = UsdShade.Utils.GetValueProducingAttributes(diffuse)
assert [str(a.GetPath()) for a in source] == ["/Material/Texture/Fallback.outputs:rgb"], source
errors = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators()).Validate(stage)
assert not errors, [e.GetMessage() for e in errors]
"""


@pytest.mark.parametrize("plugin", ["fexel", "stock"])
def test_network_passes_the_validators_with_and_without_the_plugin(tmp_path, zipmap, plugin):
    stage = zipmap.GetPrim().GetStage()
    material = UsdShade.Material.Define(stage, "/Material")
    stage.SetDefaultPrim(material.GetPrim())
    stage.SetMetadata("upAxis", "Y")
    stage.SetMetadata("metersPerUnit", 1.0)
    surface = UsdShade.Shader.Define(stage, "/Material/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    fallback.write_fallback(zipmap.GetPrim(), tmp_path / "fallback.png", 64)
    diffuse = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    diffuse.ConnectToSource(UsdShade.NodeGraph(zipmap.GetPrim()).GetOutput("rgb"))
    stage.GetRootLayer().Save()
    environment = {"PATH": "/usr/bin:/bin"}  # no PXR_PLUGINPATH_NAME
    done = subprocess.run(
        [sys.executable, "-c", CHECK, str(tmp_path / "stage.usda"), plugin],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_author_twice_changes_nothing(tmp_path, zipmap):
    fallback.author(zipmap.GetPrim(), tmp_path / "fallback.png")
    once = zipmap.GetPrim().GetStage().GetRootLayer().ExportToString()
    fallback.author(zipmap.GetPrim(), tmp_path / "fallback.png")
    assert zipmap.GetPrim().GetStage().GetRootLayer().ExportToString() == once


def test_errors(tmp_path, zipmap):
    prim = zipmap.GetPrim()
    with pytest.raises(FexelError, match="fallback size is 0, expected at least 1"):
        fallback.bake(prim, 0)
    with pytest.raises(FexelError, match=r"expected a file name ending in .png"):
        fallback.write_fallback(prim, tmp_path / "fallback.tif")
    with pytest.raises(FexelError, match="nowhere"):
        fallback.write_fallback(prim, tmp_path / "nowhere" / "fallback.png", 16)
    with pytest.raises(FexelError, match="/Material: prim of type"):
        fallback.bake(prim.GetStage().GetPrimAtPath("/Material"))
