"""Make the floor: a chart for measuring line pairs per millimetre, repeated as far as the eye reaches, and a flight.

usage: python stages/fipmap_floor/make.py        (rewrites fipmap_floor.usda and textures/)
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdShade, Vt

import fexel
from fexel_tools.filter_textures import line_chart

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent))
import fipmap_parts  # noqa: E402 - beside the folders of the stages
import stage_parts  # noqa: E402
from pinchmap_parts import add_camera  # noqa: E402

TEXTURE = "/World/Materials/Chart/Image"
TEXELS = 1024
TILE = 10.0  # side of one chart, metres
TILES = 40  # of the floor's side
HAZE_DISTANCE, HAZE_COLOR = 40.0, (0.62, 0.7, 0.8)
ASPECT = 16 / 9


def add_floor(stage: Usd.Stage, material: UsdShade.Material) -> None:
    """A square in the plane y = 0 about the origin, one chart per `TILE`."""
    half = 0.5 * TILE * TILES
    mesh = UsdGeom.Mesh.Define(stage, "/World/Floor")
    corners = np.array([(-half, 0, half), (half, 0, half), (half, 0, -half), (-half, 0, -half)], np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(corners))
    mesh.CreateExtentAttr([Gf.Vec3f(-half, 0, -half), Gf.Vec3f(half, 0, half)])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateNormalsAttr([(0, 1, 0)] * 4)
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    stage_parts.add_st(mesh, TILES * np.array([(0, 0), (1, 0), (1, 1), (0, 1)]))
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def add_haze_variants(stage: Usd.Stage, api: fexel.TextureMinificationAPI) -> None:
    """Attenuation with distance as a variant of the default prim: none, or that of a hazy day."""
    variants = stage.GetDefaultPrim().GetVariantSets().AddVariantSet("haze")
    for name in ("hazy", "none"):
        variants.AddVariant(name)
        variants.SetVariantSelection(name)
        with variants.GetVariantEditContext():
            if name == "hazy":
                api.CreateAttenuationDistanceAttr(HAZE_DISTANCE)
                api.CreateAttenuationColorAttr(Gf.Vec3f(*HAZE_COLOR))


def flight() -> list[fipmap_parts.Pose]:
    """Low over the floor, turning by 75 degrees, from looking down at 40 degrees to looking along it at 4."""
    first, last = fipmap_parts.FRAMES
    poses = []
    for share in np.linspace(0, 1, last - first + 1):
        eased = share * share * (3 - 2 * share)
        azimuth, elevation = np.radians(75 * share), np.radians(40 + (4 - 40) * eased)
        eye = np.array([-2.0 + 12.0 * share, 2.4 - 0.8 * eased, 6.0 - 4.0 * share])
        ahead = np.array(
            [np.sin(azimuth) * np.cos(elevation), -np.sin(elevation), -np.cos(azimuth) * np.cos(elevation)]
        )
        poses.append((eye, eye + 4.0 * ahead, 4.0))
    return poses


def main() -> None:
    """Write the chart and the stage."""
    stage_parts.write_png(FOLDER / "textures" / "chart.png", line_chart(TEXELS))
    path = FOLDER / "fipmap_floor.usda"
    stage = stage_parts.new_stage(path, "A chart of line pairs, repeated as far as the eye reaches.")
    stage_parts.add_scopes(stage)
    material = stage_parts.add_image_material(stage, "/World/Materials/Chart", "./textures/chart.png")
    for wrap in ("wrapS", "wrapT"):
        UsdShade.Shader.Get(stage, TEXTURE).GetInput(wrap).Set("repeat")
    add_haze_variants(stage, fipmap_parts.add_filter_variants(stage, TEXTURE))
    add_floor(stage, material)
    stage_parts.add_even_light(stage)
    add_camera(stage, "Overview", (-1.0, 1.6, 6.0), (2.2, 1.2, 0.0), 7.0, ASPECT)
    add_camera(stage, "Detail", (-1.0, 0.8, 6.0), (14.0, -0.3, -16.0), 5.5, ASPECT)
    fipmap_parts.add_moving_camera(stage, "Flight", flight(), ASPECT)
    stage_parts.save(stage, path)


if __name__ == "__main__":
    (FOLDER / "textures").mkdir(exist_ok=True)
    main()
