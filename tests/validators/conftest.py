"""A small stage on disk at which no validator has anything to find, and a short way to spoil it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

import fexel


def write_image(path: Path, channels: int = 3, dtype: str = "uint8", size: int = 16) -> str:
    """A noisy image: what is cut off at its end cannot be guessed by a decoder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(1).random((size, size, channels))
    image = oiio.ImageBuf(oiio.ImageSpec(size, size, channels, dtype))
    image.set_pixels(oiio.ROI(), pixels.astype(np.float32))
    assert image.write(str(path)), image.geterror()
    return f"./{path.name}"


def define_texture(stage: Usd.Stage, path: str, file: str, kind=fexel.ZipmapTexture):
    """A texture with a self-contained fallback."""
    texture = kind.Define(stage, path)
    texture.CreateFileAttr(file)
    reader = UsdShade.Shader.Define(stage, f"{path}/FallbackST")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    fallback = UsdShade.Shader.Define(stage, f"{path}/Fallback")
    fallback.CreateIdAttr("UsdUVTexture")
    fallback.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
    result = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    fallback.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(result)
    for name, type_name in (("rgb", Sdf.ValueTypeNames.Float3), *((c, Sdf.ValueTypeNames.Float) for c in "rgba")):
        texture.CreateOutput(name, type_name).ConnectToSource(fallback.CreateOutput(name, type_name))
    return texture


class Sample:
    """A material with one zipmap on its diffuse colour, and a patch in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.file = write_image(folder / "wall.png")
        self.stage = Usd.Stage.CreateNew(str(folder / "sample.usda"))
        UsdGeom.SetStageUpAxis(self.stage, "Y")
        UsdGeom.SetStageMetersPerUnit(self.stage, 1.0)
        self.stage.SetDefaultPrim(UsdGeom.Xform.Define(self.stage, "/World").GetPrim())
        self.material = UsdShade.Material.Define(self.stage, "/World/Wall")
        self.surface = UsdShade.Shader.Define(self.stage, "/World/Wall/Surface")
        self.surface.CreateIdAttr("UsdPreviewSurface")
        surface = self.surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
        self.material.CreateSurfaceOutput().ConnectToSource(surface)
        self.root = define_texture(self.stage, "/World/Wall/Photo", self.file)
        self.connect("diffuseColor", self.root)
        self.patch = fexel.ZipmapTexture.Define(self.stage, "/World/Wall/Photo/Detail")
        self.patch.CreateFileAttr(self.file)
        self.patch.CreateMatrixAttr(Gf.Matrix3d(4, 0, 0, 0, 4, 0, -1, -1, 1))
        self.stage.WriteFallbackPrimTypes()

    def connect(self, name: str, texture: fexel.FexelTexture, output: str = "rgb") -> None:
        scalar = name not in ("diffuseColor", "normal", "emissiveColor")
        type_name = Sdf.ValueTypeNames.Float if scalar else Sdf.ValueTypeNames.Color3f
        type_name = Sdf.ValueTypeNames.Normal3f if name == "normal" else type_name
        self.surface.CreateInput(name, type_name).ConnectToSource(texture.ConnectableAPI(), output)

    def findings(self) -> list[fexel.validators.Finding]:
        self.stage.Save()
        return fexel.validate(self.stage)

    def found(self, validator: str) -> list[fexel.validators.Finding]:
        return [finding for finding in self.findings() if finding.validator == validator]

    def the_only(self, validator: str) -> fexel.validators.Finding:
        found = self.found(validator)
        assert len(found) == 1, found
        assert "\n" not in found[0].message
        return found[0]


@pytest.fixture
def sample(tmp_path):
    return Sample(tmp_path)


@pytest.fixture
def image():
    return write_image


@pytest.fixture
def texture():
    return define_texture
