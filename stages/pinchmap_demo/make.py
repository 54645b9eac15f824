"""Make the stage of a photo with alpha, as the command does.

usage: python stages/pinchmap_demo/make.py        (rewrites pinchmap_demo.usda and pinchmap_demo_textures/)
"""

from __future__ import annotations

from pathlib import Path

from fexel_tools.pinchmap import make_pinchmap
from fexel_tools.pinchmap_options import PinchmapOptions

FOLDER = Path(__file__).resolve().parent

if __name__ == "__main__":
    options = PinchmapOptions(size=48, fallback_size=640)
    make_pinchmap(str(FOLDER / "sources" / "sweets.png"), FOLDER / "pinchmap_demo.usda", options)
