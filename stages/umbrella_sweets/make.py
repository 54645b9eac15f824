"""Make the heap of sweets, all from one photo, as the command does.

usage: python stages/umbrella_sweets/make.py        (rewrites umbrella_sweets.usda and umbrella_sweets_textures/)
"""

from __future__ import annotations

from pathlib import Path

from fexel_tools.umbrella import make_umbrella
from fexel_tools.umbrella_options import UmbrellaOptions
from fexel_tools.umbrella_spelling import parse_background

FOLDER = Path(__file__).resolve().parent
OPTIONS = UmbrellaOptions(
    grid=(24, 14),
    layers=3.0,
    background=parse_background("#e8dcc8"),
    diversify=("color",),
    vertices=32,
    size=(1.0, 1.2),
    rotation=(-20.0, 20.0),
    shadow=(0.1, -0.08),
    shadow_strength=0.55,
    seed=5,
    tolerance=0.3,
    fallback_size=448,
)

if __name__ == "__main__":
    make_umbrella([str(FOLDER / "sources" / "sweets.png")], FOLDER / "umbrella_sweets.usda", OPTIONS)
