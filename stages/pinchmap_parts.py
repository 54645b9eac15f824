"""What the scripts of the pinchmap stages share: drawings to texture files, prims that read them, cameras."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade

import fexel
from fexel_tools import fallback
from fexel_tools.image_files import write_image
from fexel_tools.pinchmap import Pinchmap, compute_pinchmap
from fexel_tools.pinchmap_options import PinchmapOptions
from fexel_tools.pinchmap_stage import PinchmapPrim, define_texture
from fexel_tools.pinchmap_textures import write_pinchmap, write_signal
from fexel_tools.vector_image import rasterize

__all__ = [
    "add_camera",
    "add_key_light",
    "add_texture",
    "connect_color",
    "connect_opacity",
    "from_drawing",
    "write_fallbacks",
    "write_textures",
]


def from_drawing(drawing: Path, options: PinchmapOptions, outline: Path | None = None) -> Pinchmap:
    """A pinchmap of an SVG.

    Parameters
    ----------
    drawing : Path
        What it shows.
    options : PinchmapOptions
    outline : Path, optional
        SVG of the same size, white on one side of the lines, black or transparent on the other; default: the
        drawing's alpha.
    """
    if outline is None:
        return compute_pinchmap(str(drawing), options)
    with tempfile.TemporaryDirectory() as folder:
        mask = Path(folder) / "mask.png"
        size = int(options.size)
        pixels = rasterize(outline, max(1024, 16 * size)).astype(np.uint16)
        white = pixels[..., :1] * pixels[..., 3:] // 255
        write_image(mask, white.astype(np.uint8), "raw")
        return compute_pinchmap(str(drawing), replace(options, mask=str(mask)))


def write_textures(folder: Path, name: str, pinchmap: Pinchmap, options: PinchmapOptions, source: str) -> PinchmapPrim:
    """Write ``textures/<name>/pinchmap.png`` and ``signal.png`` below `folder`; returns what a prim says of them."""
    files = folder / "textures" / name
    files.mkdir(parents=True, exist_ok=True)
    map_path, _ = write_pinchmap(files, pinchmap.texels, options.bits)
    signal = write_signal(
        files,
        pinchmap.signal,
        pinchmap.source.bits,
        is_data=pinchmap.source.is_data,
        has_alpha=pinchmap.has_alpha,
    )
    return PinchmapPrim(
        file=f"./textures/{name}/{signal.path.name}",
        pinchmap=f"./textures/{name}/{map_path.name}",
        source_color_space=signal.color_space,
        drives=options.driven,
        has_alpha=pinchmap.has_alpha,
        is_biased=pinchmap.source.is_data,
        wrap=options.wrap,
        line_width=options.line_width,
        line_color=options.line_color,
        source=source,
        matrix=pinchmap.st_to_texture,
    )


def add_texture(
    stage: Usd.Stage, path: str, prim: PinchmapPrim, st_to_picture: np.ndarray | None = None
) -> fexel.PinchmapTexture:
    """The texture prim; `st_to_picture` (3, 3), row vectors, places its picture where it is a patch."""
    if st_to_picture is not None:
        prim = replace(prim, matrix=st_to_picture @ prim.matrix)
    return define_texture(stage, prim, path)


def connect_color(surface: UsdShade.Shader, texture: fexel.PinchmapTexture) -> None:
    """Let the texture be the surface's diffuseColor."""
    color = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    color.ConnectToSource(texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))


def connect_opacity(surface: UsdShade.Shader, texture: fexel.PinchmapTexture) -> None:
    """Let the texture's alpha be the surface's opacity, blended."""
    opacity = surface.CreateInput("opacity", Sdf.ValueTypeNames.Float)
    opacity.ConnectToSource(texture.CreateOutput("a", Sdf.ValueTypeNames.Float))


def add_key_light(stage: Usd.Stage, rotation_deg: tuple[float, float, float], irradiance: float) -> None:
    """A distant light from where `rotation_deg` turns +z to."""
    key = UsdLux.DistantLight.Define(stage, "/World/Lights/Key")
    key.CreateIntensityAttr(irradiance)
    key.CreateAngleAttr(2.0)
    key.CreateNormalizeAttr(True)  # intensity is then the irradiance
    UsdGeom.Xformable(key).AddRotateXYZOp().Set(Gf.Vec3f(*rotation_deg))


def add_camera(
    stage: Usd.Stage,
    name: str,
    eye: tuple[float, float, float],
    target: tuple[float, float, float],
    width: float,
    aspect: float = 4 / 3,
) -> None:
    """A camera at `eye`, y up, that sees `width` at `target`."""
    distance = (Gf.Vec3d(*target) - Gf.Vec3d(*eye)).GetLength()
    camera = UsdGeom.Camera.Define(stage, f"/World/Cameras/{name}")
    camera.CreateHorizontalApertureAttr(24.0)
    camera.CreateVerticalApertureAttr(24.0 / aspect)
    camera.CreateFocalLengthAttr(24.0 * distance / width)
    camera.CreateFocusDistanceAttr(distance)
    camera.CreateClippingRangeAttr(Gf.Vec2f(distance / 20, distance * 20))
    world_to_camera = Gf.Matrix4d().SetLookAt(Gf.Vec3d(*eye), Gf.Vec3d(*target), Gf.Vec3d(0, 1, 0))
    camera.AddTransformOp().Set(world_to_camera.GetInverse())


def write_fallbacks(stage_path: Path, pictures: dict[str, tuple[str, int]]) -> None:
    """Bake what other applications show.

    Parameters
    ----------
    stage_path : Path
    pictures : dict of str to (str, int)
        Per path of a texture prim: the file, relative to the stage, and its longer side in pixels.
    """
    stage = Usd.Stage.Open(str(stage_path))
    for path, (file, size) in pictures.items():
        fallback.write_fallback(stage.GetPrimAtPath(path), stage_path.parent / file, size)
    stage.Save()
