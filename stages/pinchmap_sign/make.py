"""Make the sign on the wall: a deer-crossing sign, sharp at any distance, in front of a photographed brick wall.

usage: python stages/pinchmap_sign/make.py        (rewrites pinchmap_sign.usda and textures/ beside this script)
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from fexel.images import image_info, read_pixels
from fexel_tools.image_files import write_image
from fexel_tools.pinchmap_options import PinchmapOptions
from fexel_tools.pinchmap_stage import PinchmapPrim
from fexel_tools.texture_files import encode

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent))
import pinchmap_parts  # noqa: E402 - beside the folders of the stages
import stage_parts  # noqa: E402

WALL = (2.24, 2.08)  # metres
WALL_PX = (640, 594)
SIGN = 1.25  # side, metres
SIGN_AT = (0.06, 0.02, 0.03)
OPTIONS = PinchmapOptions(size=128)
# Corners of the wall, clockwise from its upper left, in the photo turned by 90 degrees, pixels: found where rows of
# bricks are horizontal.
PHOTO_CORNERS = ((50.0, 19.1), (456.8, 68.0), (484.6, 419.4), (10.8, 494.4))
MORTAR, BRICK = (0.34, 0.31, 0.28), (0.27, 0.085, 0.05)  # linear
SIGN_SVG = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 256 256">
<rect x="14" y="14" width="228" height="228" rx="26" fill="{board}"/>
<rect x="24" y="24" width="208" height="208" rx="18" fill="{border}"/>
<rect x="32" y="32" width="192" height="192" rx="12" fill="{board}"/>
<g transform="translate(66 38) scale(1.12)" fill="{deer}">{path}</g>
</svg>
"""


def wall_pixels() -> np.ndarray:
    """The photo, seen from the front, its greys made those of bricks and mortar; (H, W, 3) uint8, sRGB-encoded."""
    grey = read_pixels(image_info(str(FOLDER / "sources" / "brick_gray.png")))[..., 0]
    turned = cv2.rotate(grey, cv2.ROTATE_90_CLOCKWISE)
    width, height = WALL_PX
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)], np.float32)
    homography = cv2.getPerspectiveTransform(np.array(PHOTO_CORNERS, np.float32), corners)
    front = cv2.warpPerspective(turned, homography, WALL_PX, flags=cv2.INTER_CUBIC).astype(np.float32) / 255
    mortar = np.clip((front - 0.44) / 0.16, 0, 1)[..., None]
    linear = (mortar * MORTAR + (1 - mortar) * BRICK) * ((front / 0.42) ** 1.5)[..., None]
    return encode(linear.clip(0, 1).astype(np.float32), None, "uint8", "sRGB")


def sign_drawing(board: str, border: str, deer: str) -> str:
    """The sign as SVG, in the colours given."""
    path = re.search(r"<path[^>]*/>", (FOLDER / "sources" / "deer.svg").read_text(encoding="utf-8"), re.DOTALL)
    return SIGN_SVG.format(board=board, border=border, deer=deer, path=path[0] if path else "")


def write_sign() -> PinchmapPrim:
    """The textures of the sign: yellow is one side of the lines; black, and what is around the sign, the other."""
    with tempfile.TemporaryDirectory() as folder:
        drawing, outline = Path(folder) / "sign.svg", Path(folder) / "outline.svg"
        drawing.write_text(sign_drawing("#f7b500", "#16161a", "#16161a"), encoding="utf-8")
        outline.write_text(sign_drawing("white", "black", "black"), encoding="utf-8")
        pinchmap = pinchmap_parts.from_drawing(drawing, OPTIONS, outline)
    return pinchmap_parts.write_textures(FOLDER, "sign", pinchmap, OPTIONS, "deer.svg")


def main() -> None:
    """Write the textures, the stage and its fallback."""
    path = FOLDER / "pinchmap_sign.usda"
    sign = write_sign()
    write_image(FOLDER / "textures" / "wall.jpg", wall_pixels())
    stage = stage_parts.new_stage(path, "A sign whose edges are sharp from any distance, before a wall.")
    stage_parts.add_scopes(stage)
    stage_parts.add_wall(
        stage, *WALL, stage_parts.add_image_material(stage, "/World/Materials/Wall", "./textures/wall.jpg")
    )
    material, surface = stage_parts.add_matt_surface(stage, "/World/Materials/Sign")
    texture = pinchmap_parts.add_texture(stage, "/World/Materials/Sign/Texture", sign)
    pinchmap_parts.connect_color(surface, texture)
    pinchmap_parts.connect_opacity(surface, texture)
    stage_parts.add_wall(stage, SIGN, SIGN, material, "/World/Sign", SIGN_AT)
    stage_parts.add_even_light(stage)
    pinchmap_parts.add_camera(stage, "Overview", (0.0, 0.0, 3.0), (0.0, 0.0, 0.0), WALL[0], WALL[0] / WALL[1])
    antlers = (SIGN_AT[0] - 0.09 * SIGN, SIGN_AT[1] + 0.36 * SIGN, SIGN_AT[2])
    pinchmap_parts.add_camera(stage, "Detail", (*antlers[:2], 1.0), antlers, 0.42, WALL[0] / WALL[1])
    stage_parts.save(stage, path)
    pinchmap_parts.write_fallbacks(path, {str(texture.GetPath()): ("textures/sign/fallback.png", 768)})


if __name__ == "__main__":
    main()
