"""Make the table of citrus slices, all from one photo, as the command does.

usage: python stages/umbrella_citrus/make.py        (rewrites umbrella_citrus.usda and umbrella_citrus_textures/)
"""

from __future__ import annotations

from pathlib import Path

from fexel_tools.umbrella import make_umbrella
from fexel_tools.umbrella_options import UmbrellaOptions

FOLDER = Path(__file__).resolve().parent
SOURCES = FOLDER / "sources"
OPTIONS = UmbrellaOptions(
    grid=(24, 14),
    count=420,
    background=str(SOURCES / "wood.jpg"),
    diversify=("color",),
    color_blend=0.6,
    arrangement="blue-noise",
    vertices=32,
    size=(1.4, 1.8),
    texture_size=160,
    seed=3,
    fallback_size=448,
)

if __name__ == "__main__":
    make_umbrella([str(SOURCES / "citrus_slices.jpg")], FOLDER / "umbrella_citrus.usda", OPTIONS)
