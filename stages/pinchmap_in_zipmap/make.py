"""Make the pinchmaps in a zipmap: a wooden panel, a patch of finer grain, a logo in that, a butterfly in perspective.

usage: python stages/pinchmap_in_zipmap/make.py        (rewrites pinchmap_in_zipmap.usda and textures/)
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from pxr import Gf, Sdf, Usd

import fexel
from fexel.images import image_info, read_pixels
from fexel_tools.image_files import write_image
from fexel_tools.pinchmap_options import PinchmapOptions
from fexel_tools.pinchmap_stage import PinchmapPrim

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent))
import pinchmap_parts  # noqa: E402 - beside the folders of the stages
import stage_parts  # noqa: E402

SIDE = 2.0  # of the panel, metres
PANEL = "/World/Materials/Wood/Texture"
ROOT_PX = 320  # the whole panel
GRAIN_PX, GRAIN_AT = 384, (512, 440)  # the patch: its side and upper left corner in the photo
FADE = 0.1  # share of the patch's side over which it blends into the panel
LOGO = ((0.42, 0.40), 0.16)  # lower left corner and side, in the patch's st
TRISKEL_BOX, BUTTERFLY_BOX = "56 59 662 662", "0 0 256 256"  # of the drawings, the part that is drawn on
# Corners of the butterfly in the panel's st, counter-clockwise from its lower left: as if sprayed from the left.
BUTTERFLY = ((0.06, 0.20), (0.44, 0.33), (0.41, 0.65), (0.09, 0.90))


def in_color(drawing: Path, color: str, view_box: str) -> str:
    """The SVG's first path alone, in one colour."""
    found = re.search(r'<path\s[^>]*?\bd="([^"]*)"', drawing.read_text(encoding="utf-8"), re.DOTALL)
    data = found[1] if found else ""
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{view_box}"><path fill="{color}" d="{data}"/></svg>'


def write_drawing(name: str, color: str, view_box: str, options: PinchmapOptions) -> PinchmapPrim:
    """The textures of a drawing of one colour."""
    source = FOLDER / "sources" / f"{name}.svg"
    with tempfile.TemporaryDirectory() as folder:
        drawing = Path(folder) / source.name
        drawing.write_text(in_color(source, color, view_box), encoding="utf-8")
        pinchmap = pinchmap_parts.from_drawing(drawing, options)
    return pinchmap_parts.write_textures(FOLDER, name, pinchmap, options, source.name)


def write_wood() -> None:
    """The panel, the finer patch, and the mask that blends it."""
    photo = read_pixels(image_info(str(FOLDER / "sources" / "wood.jpg")))
    textures = FOLDER / "textures"
    textures.mkdir(exist_ok=True)
    write_image(textures / "panel.jpg", cv2.resize(photo, (ROOT_PX, ROOT_PX), interpolation=cv2.INTER_AREA))
    x, y = GRAIN_AT
    write_image(textures / "grain.jpg", np.ascontiguousarray(photo[y : y + GRAIN_PX, x : x + GRAIN_PX]))
    ramp = np.minimum(np.arange(128), np.arange(128)[::-1]) / (FADE * 128)
    mask = np.minimum(1.0, np.minimum.outer(ramp, ramp))
    write_image(textures / "grain_mask.png", np.round(255 * mask[..., None]).astype(np.uint8), "raw")


def onto_unit_square(corners: tuple[tuple[float, float], ...]) -> np.ndarray:
    """inputs:matrix of a patch with `corners` in its parent's st, counter-clockwise from its lower left; (3, 3)."""
    unit = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float64)
    a, b = [], []
    for (x, y), (s, t) in zip(corners, unit, strict=True):
        a += [[x, y, 1, 0, 0, 0, -s * x, -s * y], [0, 0, 0, x, y, 1, -t * x, -t * y]]
        b += [s, t]
    child_from_parent = np.append(np.linalg.solve(np.array(a), np.array(b)), 1.0).reshape(3, 3)
    return child_from_parent.T


def square(corner: tuple[float, float], side: float) -> tuple[tuple[float, float], ...]:
    """Corners of an upright square, counter-clockwise from the lower left."""
    x, y = corner
    return (x, y), (x + side, y), (x + side, y + side), (x, y + side)


def grain_square() -> tuple[tuple[float, float], float]:
    """Lower left corner and side of the patch in the panel's st."""
    photo_px = 1024
    x, y = GRAIN_AT
    return (x / photo_px, 1 - (y + GRAIN_PX) / photo_px), GRAIN_PX / photo_px


def add_patches(stage: Usd.Stage, panel: fexel.ZipmapTexture) -> None:
    """The panel's file, the patch of grain, the logo in it, and the butterfly."""
    panel.CreateFileAttr(Sdf.AssetPath("./textures/panel.jpg"))
    grain = fexel.ZipmapTexture.Define(stage, f"{PANEL}/Grain")
    grain.CreateFileAttr(Sdf.AssetPath("./textures/grain.jpg"))
    grain.CreateMaskAttr(Sdf.AssetPath("./textures/grain_mask.png"))
    grain.CreateMatrixAttr(Gf.Matrix3d(*onto_unit_square(square(*grain_square())).ravel().tolist()))
    for wood, wrap in ((panel, "clamp"), (grain, "black")):
        wood.CreateWrapSAttr(wrap)
        wood.CreateWrapTAttr(wrap)
    burnt = write_drawing("triskel", "#2a1408", TRISKEL_BOX, PinchmapOptions(size=64))
    pinchmap_parts.add_texture(stage, f"{PANEL}/Grain/Logo", burnt, onto_unit_square(square(*LOGO)))
    sprayed = write_drawing("butterfly", "#f4efe2", BUTTERFLY_BOX, PinchmapOptions(size=48))
    butterfly = pinchmap_parts.add_texture(stage, f"{PANEL}/Butterfly", sprayed, onto_unit_square(BUTTERFLY))
    butterfly.CreateOpacityAttr(0.9)


def logo_center() -> tuple[float, float]:
    """Where the logo's centre is on the panel, metres."""
    (s, t), side = grain_square()
    (x, y), extent = LOGO
    return SIDE * (s + side * (x + extent / 2) - 0.5), SIDE * (t + side * (y + extent / 2) - 0.5)


def main() -> None:
    """Write the textures, the stage and its fallback."""
    path = FOLDER / "pinchmap_in_zipmap.usda"
    write_wood()
    stage = stage_parts.new_stage(path, "Pinchmaps as patches of a zipmap: a sharp logo in a close-up.")
    stage_parts.add_scopes(stage)
    material, panel = stage_parts.add_zipmap_material(stage, "/World/Materials/Wood")
    add_patches(stage, panel)
    stage_parts.add_wall(stage, SIDE, SIDE, material, "/World/Panel")
    stage_parts.add_even_light(stage)
    width = 1.3 * SIDE * grain_square()[1] * LOGO[1]
    stage_parts.add_zoom_camera(stage, "/World/Cameras/Zoom", logo_center(), (SIDE, width))
    stage_parts.add_zoom_camera(stage, "/World/Cameras/Overview", (0.0, 0.0), (SIDE, SIDE))
    stage_parts.add_zoom_camera(stage, "/World/Cameras/Detail", logo_center(), (width, width))
    stage_parts.save(stage, path)
    pinchmap_parts.write_fallbacks(path, {PANEL: ("textures/fallback.jpg", 1024)})


if __name__ == "__main__":
    main()
