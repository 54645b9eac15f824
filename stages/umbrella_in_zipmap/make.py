"""Make the heap of sweets on a table: umbrellas as a patch of a zipmap, each sweet placed by a row of a table.

usage: python stages/umbrella_in_zipmap/make.py        (rewrites umbrella_in_zipmap.usda, heap.* and textures/)
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd

import fexel
from fexel_tools import fallback
from fexel_tools.umbrella import make_umbrella
from fexel_tools.umbrella_options import UmbrellaOptions

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent))
import stage_parts  # noqa: E402 - beside the folders of the stages

SIDE = 1.0  # of the table, metres
TABLE = "/World/Materials/Table/Texture"
HEAP = "/World/Materials/Umbrella/Texture"  # in the stage that the command writes
COUNT, GRID = 320, 14
CENTRE, WIDTH, TURN = (0.54, 0.47), 0.6, 24.0  # of the heap on the table: st, share of the side, degrees
EDGE = 0.42  # of the patch: how far from its middle the furthest sweets lie
OPTIONS = UmbrellaOptions(
    grid=(GRID, GRID),
    background="none",
    arrangement=str(FOLDER / "heap.csv"),
    diversify=("color",),
    vertices=32,
    tolerance=0.3,
    size=(1.0, 1.15),
    rotation=(-20.0, 20.0),
    shadow=(0.1, -0.08),
    shadow_strength=0.55,
    seed=11,
    fallback_size=512,
)


def write_rows(path: Path) -> None:
    """Places in texture coordinates: dense in the middle, those nearest to it on top."""
    generator = np.random.default_rng(OPTIONS.seed)
    radius = EDGE * np.sqrt(generator.random(COUNT)) ** 1.25
    angle = 2 * np.pi * generator.random(COUNT)
    order = np.argsort(radius)
    places = 0.5 + np.stack([radius * np.cos(angle), 0.72 * radius * np.sin(angle)], -1)[order]
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["x", "y"])
        rows.writerows(places.round(4).tolist())


def heap_from_table() -> Gf.Matrix3d:
    """inputs:matrix: a turned square on the table to the heap's own unit square; row vectors."""
    cosine, sine = np.cos(np.radians(TURN)), np.sin(np.radians(TURN))
    turned = np.array([[cosine, -sine], [sine, cosine]]) / WIDTH
    offset = 0.5 - np.array(CENTRE) @ turned
    return Gf.Matrix3d(*turned[0], 0.0, *turned[1], 0.0, *offset, 1.0)


def on_table(s: float, t: float) -> tuple[float, float]:
    """Metres from the table's middle."""
    return (s - 0.5) * SIDE, (t - 0.5) * SIDE


def add_texture(stage: Usd.Stage, table: fexel.ZipmapTexture) -> None:
    """The table's own image, and the heap as its child: a reference to what the command wrote."""
    table.CreateFileAttr(Sdf.AssetPath("./sources/wood.jpg"))
    for create in (table.CreateWrapSAttr, table.CreateWrapTAttr):
        create("clamp")
    heap = fexel.UmbrellaTexture.Define(stage, f"{TABLE}/Heap")
    heap.GetPrim().GetReferences().AddReference("./heap.usda", HEAP)
    heap.CreateMatrixAttr(heap_from_table())


def main() -> None:
    """Write the heap, the stage and its fallback."""
    write_rows(FOLDER / "heap.csv")
    make_umbrella([str(FOLDER / "sources" / "sweets.png")], FOLDER / "heap.usda", OPTIONS)
    path = FOLDER / "umbrella_in_zipmap.usda"
    stage = stage_parts.new_stage(path, "Umbrellas as a patch of a zipmap: a heap of sweets on a table.")
    stage_parts.add_scopes(stage)
    material, table = stage_parts.add_zipmap_material(stage, "/World/Materials/Table")
    add_texture(stage, table)
    stage_parts.add_wall(stage, SIDE, SIDE, material, "/World/Table")
    stage_parts.add_even_light(stage)
    target, close = on_table(*CENTRE), 0.16 * SIDE
    stage_parts.add_zoom_camera(stage, "/World/Cameras/Zoom", target, (SIDE, close))
    stage_parts.add_zoom_camera(stage, "/World/Cameras/Overview", (0.0, 0.0), (SIDE, SIDE))
    stage_parts.add_zoom_camera(stage, "/World/Cameras/Detail", target, (close, close))
    stage_parts.save(stage, path)
    written = Usd.Stage.Open(str(path))
    fallback.write_fallback(written.GetPrimAtPath(TABLE), FOLDER / "textures" / "fallback.jpg", 768)
    written.Save()


if __name__ == "__main__":
    (FOLDER / "textures").mkdir(exist_ok=True)
    main()
