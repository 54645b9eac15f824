"""The demonstration of zipmaps: photos to a stage, a zoom into it, and the same zoom with the root texture alone.

`demo` runs it on the photos bundled with the checkout. The frames without patches are rendered from the same stage: a
session layer deactivates the patches (``active = false``).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom

import fexel
from fexel.errors import FexelError
from fexel.images import linear_to_srgb
from fexel_tools.contact_sheet import SheetRow, contact_sheet, write_png
from fexel_tools.zipmap import make_zipmap
from fexel_tools.zipmap_stage import FRAMES, TEXTURE_PATH

__all__ = [
    "ABOUT",
    "FRAME_COUNT",
    "WIDTH",
    "ZipmapDemo",
    "add_camera",
    "add_options",
    "bundled_photos",
    "make_zipmap_demo",
    "root_texture_alone",
    "run",
]

ABOUT = "photos to a zipmap to a zoom"

CAMERA = "/World/Cameras/Demo"
_ZOOM = "/World/Cameras/Zoom"
_PUSH_IN = 3.0  # how much closer than the camera Zoom the last frame is: pictures this small hide detail otherwise
FRAME_COUNT = 12
_FRAMES_PER_BAND = 6
WIDTH = 320


@dataclass(frozen=True)
class ZipmapDemo:
    """What `make_zipmap_demo` wrote.

    Attributes
    ----------
    stage, sheet : Path
        The stage and the contact sheet (PNG).
    frames : dict of str to list of Path
        Pictures of the zoom: ``zipmap`` and ``root``.
    """

    stage: Path
    sheet: Path
    frames: dict[str, list[Path]]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of `demo` that are about zipmaps."""
    parser.add_argument("--photos", type=Path, nargs="+", metavar="PHOTO", help="default: the bundled ones")
    frames = f"pictures of the zoom (default: {FRAME_COUNT})"
    parser.add_argument("--frames", type=int, default=FRAME_COUNT, help=frames)


def run(options: argparse.Namespace) -> str:
    """The part of `demo`: `make_zipmap_demo` with its options; where the results are."""
    photos = options.photos or bundled_photos()
    result = make_zipmap_demo(photos, options.output, options.frames, options.width)
    return f"stage {result.stage}, contact sheet {result.sheet}"


def bundled_photos() -> list[Path]:
    """The photos that come with a checkout.

    Raises
    ------
    FexelError
        There are none, as in an installed wheel.
    """
    folder = Path(__file__).resolve().parents[2] / "stages" / "zipmap_demo" / "photos"
    photos = sorted(folder.glob("*.jpg"))
    if not photos:
        raise FexelError(f"{folder}: no photos; they come with a checkout, elsewhere name your own with --photos")
    return photos


def make_zipmap_demo(photos: Sequence[Path], output: Path, frames: int = FRAME_COUNT, width: int = WIDTH) -> ZipmapDemo:
    """Author a zipmap from photos, render the zoom with and without its patches, and lay out a contact sheet.

    Parameters
    ----------
    photos : sequence of Path
    output : Path
        Folder, made if need be. Gets ``zipmap_demo.usda`` with its textures, ``frames/`` and ``contact_sheet.png``.
    frames : int
        Pictures along the zoom, at least 1.
    width : int
        Of a picture, pixels.

    Raises
    ------
    FexelError
        Unreadable photos, photos that share nothing, no OpenGL, a folder that cannot be written.
    """
    output.mkdir(parents=True, exist_ok=True)
    stage_path = output / "zipmap_demo.usda"
    make_zipmap([str(photo) for photo in photos], stage_path)
    stage = Usd.Stage.Open(str(stage_path))
    if len(fexel.ZipmapTexture.Get(stage, TEXTURE_PATH).GetPatches()) < 2:
        raise FexelError(f"{stage_path}: no photo could be placed on another, so there is nothing to zoom into")
    times = range(1, frames + 1)
    magnifications = add_camera(stage, frames)
    with fexel.Renderer() as renderer:
        zipmap = [_render(renderer, stage, t, width) for t in _progress(times, "zipmap")]
        root_texture_alone(stage)
        root = [_render(renderer, stage, t, width) for t in _progress(times, "root alone")]
    paths = {"zipmap": _write_frames(output, "zipmap", zipmap), "root": _write_frames(output, "root", root)}
    sheet = output / "contact_sheet.png"
    write_png(sheet, _sheet(zipmap, root, magnifications))
    return ZipmapDemo(stage_path, sheet, paths)


def add_camera(stage: Usd.Stage, count: int) -> list[float]:
    """Add the camera of the demonstration to the session layer: along the zoom of the stage, and further in at its end.

    Parameters
    ----------
    stage : Usd.Stage
        From `fexel_tools.zipmap`.
    count : int
        Frames, numbered from 1; the magnification grows by a constant factor from one to the next.

    Returns
    -------
    list of float
        How much larger the surface appears than at the first frame, one per frame.
    """
    zoom = UsdGeom.Camera.Get(stage, _ZOOM)
    distance = zoom.GetFocusDistanceAttr()
    zoomed = distance.Get(FRAMES[0]) / distance.Get(FRAMES[1])
    magnifications = [(zoomed * _PUSH_IN) ** (index / max(count - 1, 1)) for index in range(count)]
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        camera = UsdGeom.Camera.Define(stage, CAMERA)
        for name in ("focalLength", "horizontalAperture", "verticalAperture"):
            camera.GetPrim().GetAttribute(name).Set(zoom.GetPrim().GetAttribute(name).Get())
        transform = camera.AddTransformOp()
        for frame, magnification in enumerate(magnifications, start=1):
            share = min(1.0, np.log(magnification) / np.log(zoomed)) if zoomed > 1.0 else 1.0
            time = FRAMES[0] + share * (FRAMES[1] - FRAMES[0])
            wanted = distance.Get(FRAMES[0]) / magnification
            transform.Set(_moved_to(zoom, time, distance.Get(time) - wanted), frame)
            camera.GetClippingRangeAttr().Set(Gf.Vec2f(0.02 * wanted, 100.0 * wanted), frame)
    return magnifications


def _moved_to(camera: UsdGeom.Camera, time: float, forward: float) -> Gf.Matrix4d:
    """Camera to world at a time, moved `forward` along the direction of view."""
    camera_to_world = camera.ComputeLocalToWorldTransform(time)
    ahead = camera_to_world.TransformDir(Gf.Vec3d(0, 0, -1)).GetNormalized()
    moved = Gf.Matrix4d(camera_to_world)
    moved.SetTranslateOnly(camera_to_world.ExtractTranslation() + forward * ahead)
    return moved


def root_texture_alone(stage: Usd.Stage) -> None:
    """Deactivate every patch of the zipmap in the session layer; no file changes."""
    root = fexel.ZipmapTexture.Get(stage, TEXTURE_PATH)
    patches = [patch.path for patch in root.GetPatches() if patch.depth == 1]
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for path in patches:
            stage.GetPrimAtPath(path).SetActive(False)


def _render(renderer: fexel.Renderer, stage: Usd.Stage, frame: float, width: int) -> np.ndarray:
    """One picture, (H, W, 3) uint8, sRGB-encoded, on black."""
    color = renderer.render(stage, camera=CAMERA, time=frame, width=width)["color"]
    return np.round(255 * np.clip(linear_to_srgb(color[..., :3]), 0, 1)).astype(np.uint8)


def _write_frames(output: Path, name: str, pictures: Sequence[np.ndarray]) -> list[Path]:
    paths = [output / "frames" / f"{name}.{index:04d}.png" for index in range(1, len(pictures) + 1)]
    for path, picture in zip(paths, pictures, strict=True):
        write_png(path, picture)
    return paths


def _sheet(zipmap: list[np.ndarray], root: list[np.ndarray], magnifications: list[float]) -> np.ndarray:
    """Bands of a few frames, in each the zipmap above the root alone; the last band is filled up with black."""
    bands = []
    blank = np.zeros_like(zipmap[0])
    for first in range(0, len(zipmap), _FRAMES_PER_BAND):
        part = slice(first, first + _FRAMES_PER_BAND)
        missing = _FRAMES_PER_BAND - len(zipmap[part]) if first else 0
        rows = [
            SheetRow(label, pictures[part] + [blank] * missing)
            for label, pictures in (("zipmap", zipmap), ("the same, root texture alone", root))
        ]
        bands.append(contact_sheet(rows, [f"{value:.1f}x" for value in magnifications[part]] + [""] * missing))
    return np.concatenate(bands)


def _progress(frames: Sequence[float], description: str) -> Iterable[float]:
    if not sys.stderr.isatty():
        return frames
    from rich.console import Console
    from rich.progress import track

    return track(frames, description=description, console=Console(stderr=True))
