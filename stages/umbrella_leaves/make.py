"""Make the ground of fallen leaves, as the command does.

usage: python stages/umbrella_leaves/make.py        (rewrites umbrella_leaves.usda and umbrella_leaves_textures/)
"""

from __future__ import annotations

from pathlib import Path

from fexel_tools.umbrella import make_umbrella
from fexel_tools.umbrella_options import UmbrellaOptions

FOLDER = Path(__file__).resolve().parent
SOURCES = FOLDER / "sources"
OPTIONS = UmbrellaOptions(
    grid=(28, 14),
    count=1000,
    background=str(SOURCES / "soil.jpg"),
    references=tuple(str(file) for file in sorted(SOURCES.glob("autumn_*.jpg"))),
    vertices=28,
    texture_size=160,
    seed=7,
    fallback_size=448,
)

if __name__ == "__main__":
    leaves = [str(file) for file in sorted(SOURCES.glob("leaf_*.jpg"))]
    make_umbrella(leaves, FOLDER / "umbrella_leaves.usda", OPTIONS)
