"""Make the meadow of flowers, from two cut-outs, as the command does.

usage: python stages/umbrella_flowers/make.py        (rewrites umbrella_flowers.usda and umbrella_flowers_textures/)
"""

from __future__ import annotations

from pathlib import Path

from fexel_tools.umbrella import make_umbrella
from fexel_tools.umbrella_options import UmbrellaOptions

FOLDER = Path(__file__).resolve().parent
SOURCES = FOLDER / "sources"
OPTIONS = UmbrellaOptions(
    grid=(24, 14),
    count=400,
    background=str(SOURCES / "grass.jpg"),
    arrangement="blue-noise",
    size=(0.9, 1.6),
    morph=0.3,
    vertices=48,
    seed=2,
    fallback_size=448,
)

if __name__ == "__main__":
    make_umbrella(
        [str(SOURCES / name) for name in ("sunflower.png", "rose.png")], FOLDER / "umbrella_flowers.usda", OPTIONS
    )
