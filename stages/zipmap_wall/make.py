"""Make the wall from its photos, which the command gets in alphabetical, that is in no order.

usage: python stages/zipmap_wall/make.py        (rewrites zipmap_wall.usda and zipmap_wall_textures/)
"""

from __future__ import annotations

import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent))
import stage_from_photos  # noqa: E402 - beside the folders of the stages

if __name__ == "__main__":
    stage_from_photos.author(sorted((FOLDER / "photos").glob("*.jpg")), FOLDER / "zipmap_wall.usda", shrink=0.7)
