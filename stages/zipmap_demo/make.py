"""Make the demo stage from its photos, reduced to 7/10 to keep the repository small.

usage: python stages/zipmap_demo/make.py        (rewrites zipmap_demo.usda and zipmap_demo_textures/)
"""

from __future__ import annotations

import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent))
import stage_from_photos  # noqa: E402 - beside the folders of the stages

if __name__ == "__main__":
    stage_from_photos.author(sorted((FOLDER / "photos").glob("*.jpg")), FOLDER / "zipmap_demo.usda", shrink=0.7)
