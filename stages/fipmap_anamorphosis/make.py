"""Make the stage of Holbein's anamorphosis: a painting whose skull comes right for who stands at its right margin.

usage: python stages/fipmap_anamorphosis/make.py        (rewrites fipmap_anamorphosis.usda)
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pxr import Sdf, UsdShade

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent))
import fipmap_parts  # noqa: E402 - beside the folders of the stages
import stage_parts  # noqa: E402
from pinchmap_parts import add_camera  # noqa: E402

SIZE = (2.095, 2.07)  # of the panel, metres
PIXELS = (1039, 1024)  # of the scan
TEXTURE = "/World/Materials/Painting/Image"

# Found by trial: from here the skull is as round as a skull, and its jaw is level. The eye is 1.6 m from it, 6 degrees
# off the panel, where the line of sight crosses the right margin at a third of its height (section 3.2, fig. 9).
SKULL = (470.0, 905.0)  # pixel that it is looked at in
SLOPE = 0.42  # of the line of sight, seen from the front; the c of fig. 9 is -0.45
ELEVATION = np.radians(6.0)
DISTANCE = 1.6
WIDTH = 0.36  # seen there


def on_panel(x: float, y: float) -> np.ndarray:
    """Pixels to metres from the middle of the panel."""
    return np.array([(x / PIXELS[0] - 0.5) * SIZE[0], (0.5 - y / PIXELS[1]) * SIZE[1], 0.0])


def eye_of_the_skull() -> np.ndarray:
    """Where the skull is right."""
    along = np.array([1.0, SLOPE, 0.0]) / np.hypot(1.0, SLOPE)
    out = np.array([0.0, 0.0, 1.0])
    return on_panel(*SKULL) + DISTANCE * (np.cos(ELEVATION) * along + np.sin(ELEVATION) * out)


def walk() -> list[fipmap_parts.Pose]:
    """From before the middle of the painting, round, to the place of the skull."""
    start, end = np.array([0.0, 0.0, 2.6]), eye_of_the_skull()
    first, last = fipmap_parts.FRAMES
    poses = []
    for share in np.linspace(0, 1, last - first + 1):
        eased = share * share * (3 - 2 * share)
        turn = eased * (np.pi / 2 - np.arctan2(end[2], end[0]))
        radius = np.hypot(*start[[0, 2]]) ** (1 - eased) * np.hypot(*end[[0, 2]]) ** eased
        eye = np.array([radius * np.sin(turn), (1 - eased) * start[1] + eased * end[1], radius * np.cos(turn)])
        target = eased * on_panel(*SKULL)
        poses.append((eye, target, 2.6 ** (1 - eased) * WIDTH**eased))
    return poses


def main() -> None:
    """Write the stage."""
    path = FOLDER / "fipmap_anamorphosis.usda"
    stage = stage_parts.new_stage(path, "A painting for two observers: one of them sees the skull, with any filter.")
    stage_parts.add_scopes(stage)
    material = stage_parts.add_image_material(stage, "/World/Materials/Painting", "./textures/ambassadors.jpg")
    fipmap_parts.add_filter_variants(stage, TEXTURE)
    stage_parts.add_wall(stage, *SIZE, material, "/World/Painting")
    plaster, surface = stage_parts.add_matt_surface(stage, "/World/Materials/Plaster")
    UsdShade.Shader(surface).CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set((0.32, 0.3, 0.27))
    stage_parts.add_wall(stage, 60.0, 6.0, plaster, "/World/Wall", (0.0, 1.5, -0.03))
    stage_parts.add_even_light(stage)
    add_camera(stage, "Overview", (0.0, 0.0, 2.6), (0.0, 0.0, 0.0), 2.6, 1.0)
    add_camera(stage, "Detail", tuple(eye_of_the_skull()), tuple(on_panel(*SKULL)), WIDTH, 1.0)
    fipmap_parts.add_moving_camera(stage, "Walk", walk(), 1.0)
    stage_parts.save(stage, path)


if __name__ == "__main__":
    main()
