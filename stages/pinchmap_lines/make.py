"""Make the drawing with solid lines: smooth colours from a few texels, and an outline as wide as one asks for.

usage: python stages/pinchmap_lines/make.py        (rewrites pinchmap_lines.usda and textures/ beside this script)
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path

from fexel_tools.pinchmap_options import PinchmapOptions, parse_color
from fexel_tools.pinchmap_stage import PinchmapPrim

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent))
import pinchmap_parts  # noqa: E402 - beside the folders of the stages
import stage_parts  # noqa: E402

SHEET = (1.6, 1.2)  # metres
OPTIONS = PinchmapOptions(size=64, line_width=0.4, line_color=parse_color("#1c2440"))
WIDTHS = ((1, OPTIONS.line_width), (24, 1.2), (48, 0.0))  # frame, pinchmap texels


def outline(drawing: str) -> str:
    """The drawing with its background black and its shapes white."""
    flat = re.sub(r'(fill|stroke)="(?!none)[^"]*"', r'\1="white"', drawing)
    return flat.replace('id="background" width="256" height="192" fill="white"', 'width="256" height="192"')


def write_boat() -> PinchmapPrim:
    """The textures of the drawing: shapes on one side of the lines, sky and sea on the other."""
    source = FOLDER / "sources" / "boat.svg"
    with tempfile.TemporaryDirectory() as folder:
        shapes = Path(folder) / "outline.svg"
        shapes.write_text(outline(source.read_text(encoding="utf-8")), encoding="utf-8")
        pinchmap = pinchmap_parts.from_drawing(source, OPTIONS, shapes)
    return pinchmap_parts.write_textures(FOLDER, "boat", pinchmap, OPTIONS, source.name)


def main() -> None:
    """Write the textures, the stage and its fallback."""
    path = FOLDER / "pinchmap_lines.usda"
    boat = write_boat()
    stage = stage_parts.new_stage(path, "Solid lines along the discontinuities, as in figure 12 of the paper.")
    stage_parts.add_scopes(stage)
    material, surface = stage_parts.add_matt_surface(stage, "/World/Materials/Drawing")
    texture = pinchmap_parts.add_texture(stage, "/World/Materials/Drawing/Texture", boat)
    for frame, width in WIDTHS:
        texture.GetLineWidthAttr().Set(width, frame)
    stage.SetStartTimeCode(WIDTHS[0][0])
    stage.SetEndTimeCode(WIDTHS[-1][0])
    pinchmap_parts.connect_color(surface, texture)
    stage_parts.add_wall(stage, *SHEET, material, "/World/Sheet")
    stage_parts.add_even_light(stage)
    aspect = SHEET[0] / SHEET[1]
    pinchmap_parts.add_camera(stage, "Overview", (0.0, 0.0, 2.0), (0.0, 0.0, 0.0), SHEET[0], aspect)
    pinchmap_parts.add_camera(stage, "Detail", (-0.08, -0.17, 0.5), (-0.08, -0.17, 0.0), 0.3, aspect)
    stage_parts.save(stage, path)
    pinchmap_parts.write_fallbacks(path, {str(texture.GetPath()): ("textures/boat/fallback.png", 768)})


if __name__ == "__main__":
    main()
