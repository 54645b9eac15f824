"""The demonstration of pinchmaps: a drawing and a photo, whole and close up, beside plain textures of as many bytes.

The plain texture is rendered from the same stage: a session layer gives the texture prim another file and no pinchmap,
which makes it a plain image, filtered as any.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

import fexel
from fexel.errors import FexelError
from fexel.images import linear_to_srgb
from fexel_tools.contact_sheet import SheetRow, contact_sheet, write_png
from fexel_tools.image_files import write_image
from fexel_tools.pinchmap import make_pinchmap
from fexel_tools.pinchmap_options import PinchmapOptions
from fexel_tools.pinchmap_sheet import plain_texture
from fexel_tools.pinchmap_source import load_source
from fexel_tools.pinchmap_stage import TEXTURE_PATH
from fexel_tools.texture_files import encode

__all__ = ["ABOUT", "MAGNIFICATION", "PinchmapDemo", "bundled_sources", "comparison", "make_pinchmap_demo", "run"]

ABOUT = "a drawing and a photo to pinchmaps, beside plain textures of as many bytes"

MAGNIFICATION = 6.0
"""How much larger the close-up shows the surface than the whole."""
_SIZES = {"fish.svg": 32, "sweets.png": 48}
_MARGIN = 1.06  # what the whole shows, over the surface's longer side
_PAPER = 0.78  # linear grey behind what is transparent
_CAMERA = "/World/Cameras/Demo"
_APERTURE = 24.0
_DISTANCE = 2.0


@dataclass(frozen=True)
class PinchmapDemo:
    """What `make_pinchmap_demo` wrote.

    Attributes
    ----------
    stages : tuple of Path
    sheet : Path
        PNG: a row per source; whole and close up, pinchmap and plain texture.
    """

    stages: tuple[Path, ...]
    sheet: Path


@dataclass(frozen=True, eq=False)
class _Rival:
    """The plain texture of a source: its file, and its bytes without compression."""

    file: Path
    size: tuple[int, int]
    nbytes: int


def run(options: argparse.Namespace) -> str:
    """The part of `demo`: `make_pinchmap_demo` of what is bundled; where the results are."""
    result = make_pinchmap_demo(bundled_sources(), options.output, options.width)
    stages = ", ".join(str(stage) for stage in result.stages)
    return f"stages {stages}, beside plain textures of as many bytes in {result.sheet}"


def bundled_sources() -> list[Path]:
    """The drawing and the photo that come with a checkout.

    Raises
    ------
    FexelError
        They are not there, as in an installed wheel.
    """
    folder = Path(__file__).resolve().parents[2] / "stages" / "pinchmap_demo" / "sources"
    sources = [folder / name for name in _SIZES]
    if not all(source.is_file() for source in sources):
        raise FexelError(f"{folder}: no drawing and photo; they come with a checkout")
    return sources


def make_pinchmap_demo(sources: Sequence[Path], output: Path, width: int) -> PinchmapDemo:
    """Author pinchmaps and render them beside plain textures of as many bytes.

    Parameters
    ----------
    sources : sequence of Path
        Drawings, or images with alpha.
    output : Path
        Folder, made if need be. Gets a stage per source with its textures, and ``pinchmap_sheet.png``.
    width : int
        Of a picture, pixels.

    Raises
    ------
    FexelError
        An unreadable source, no OpenGL, a folder that cannot be written.
    """
    output.mkdir(parents=True, exist_ok=True)
    rows, stages = [], []
    with fexel.Renderer() as renderer:
        for source in sources:
            stage_path = output / f"{source.stem}.usda"
            rows.append(comparison(renderer, source, stage_path, width))
            stages.append(stage_path)
    sheet = output / "pinchmap_sheet.png"
    close = f"{MAGNIFICATION:.0f} x closer"
    labels = ["pinchmap", "plain texture, as many bytes", f"pinchmap, {close}", f"plain texture, {close}"]
    write_png(sheet, contact_sheet(rows, labels))
    return PinchmapDemo(tuple(stages), sheet)


def comparison(renderer: fexel.Renderer, source: Path, stage_path: Path, width: int) -> SheetRow:
    """Author the pinchmap of a source at `stage_path`; its row of the sheet: whole, plain, close up, plain close up."""
    options = PinchmapOptions(size=_SIZES.get(source.name, 64))
    item = make_pinchmap(str(source), stage_path, options)
    rival = _write_plain(source, stage_path.with_name(f"{source.stem}_plain.png"), options, item.nbytes)
    pictures = []
    for magnification in (1.0, MAGNIFICATION):
        for plain in (None, rival):
            stage = Usd.Stage.Open(str(stage_path))
            _add_camera(stage, magnification)
            if plain:
                _replace_texture(stage, plain.file)
            pictures.append(_render(renderer, stage, width))
    (columns, rows), (signal_columns, signal_rows) = item.pinchmap, item.signal
    texels = f"map {columns} x {rows} and signal {signal_columns} x {signal_rows}, {item.nbytes} bytes"
    label = f"{source.name}: {texels}; plain texture {rival.size[0]} x {rival.size[1]}, {rival.nbytes} bytes"
    return SheetRow(label, pictures)


def _write_plain(source: Path, path: Path, options: PinchmapOptions, nbytes: int) -> _Rival:
    """Area averages of the source in at most `nbytes`, as a PNG with straight alpha."""
    size = int(options.size)
    loaded = load_source(source, size=(size, size))
    picture = np.dstack([loaded.color * loaded.opacity[..., None], loaded.opacity])
    texels = plain_texture(picture, nbytes, has_alpha=True)
    alpha = texels[..., 3]
    straight = texels[..., :3] / np.maximum(alpha, 1e-6)[..., None]  # 1e-6 guards transparent texels
    stored = encode(straight, alpha, "uint8", "sRGB")
    write_image(path, stored)
    return _Rival(path, (stored.shape[1], stored.shape[0]), stored.nbytes)


def _replace_texture(stage: Usd.Stage, file: Path) -> None:
    """Make the texture prim a plain image, in the session layer."""
    texture = fexel.PinchmapTexture.Get(stage, TEXTURE_PATH)
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        texture.GetPinchmapAttr().Block()
        texture.GetFileAttr().Set(Sdf.AssetPath(str(file.resolve())))
        texture.GetMatrixAttr().Set(Gf.Matrix3d(1.0))


def _add_camera(stage: Usd.Stage, magnification: float) -> None:
    """A square view, in the session layer: of the whole surface, or closer by so much where the camera Detail is."""
    box = UsdGeom.Boundable(stage.GetPrimAtPath("/World/Surface")).ComputeWorldBound(0, "default").ComputeAlignedRange()
    target = box.GetMidpoint()
    if magnification > 1.0:
        detail = UsdGeom.Camera.Get(stage, "/World/Cameras/Detail").ComputeLocalToWorldTransform(0)
        target = Gf.Vec3d(*detail.ExtractTranslation()[:2], target[2])
    seen = _MARGIN * max(box.GetSize()) / magnification
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        camera = UsdGeom.Camera.Define(stage, _CAMERA)
        camera.CreateHorizontalApertureAttr(_APERTURE)
        camera.CreateVerticalApertureAttr(_APERTURE)
        camera.CreateFocalLengthAttr(_APERTURE * _DISTANCE / seen)
        camera.CreateClippingRangeAttr(Gf.Vec2f(_DISTANCE / 10, _DISTANCE * 10))
        camera.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(target + Gf.Vec3d(0, 0, _DISTANCE))


def _render(renderer: fexel.Renderer, stage: Usd.Stage, width: int) -> np.ndarray:
    """One picture, (H, W, 3) uint8, sRGB-encoded, on grey."""
    color = renderer.render(stage, camera=_CAMERA, width=width)["color"]
    linear = color[..., :3] + (1.0 - color[..., 3:]) * _PAPER
    return np.round(255 * np.clip(linear_to_srgb(linear), 0, 1)).astype(np.uint8)
