"""Stages with an UmbrellaTexture of squares, for tests of what is read and shown."""

import numpy as np
from pxr import Gf, Sdf, Usd, Vt

import fexel
from bench.zipmap_stage import front_view, quad, render_texture
from fexel.scene.model import Texture
from fexel.textures.umbrella import extract

SQUARE = [(0, 0), (-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
SOIL = (0.125, 0.25, 0.0625, 1.0)  # half floats hold it
WHOLE = front_view((0, 0), (1, 1), 64, 64)


def placement(x, y, size=0.1):
    return Gf.Matrix3d(size, 0, 0, 0, size, 0, x, y, 1)


def squares(placements, colors, names=("Square",), grid=(4, 4)):
    """One square after the other, of the first patch, each of one colour; without images."""
    assert fexel.__all__
    stage = Usd.Stage.CreateInMemory()
    umbrella = fexel.UmbrellaTexture.Define(stage, "/Lawn")
    umbrella.CreateGridAttr(Gf.Vec2i(*grid))
    umbrella.CreateFallbackAttr(Gf.Vec4f(*SOIL))
    umbrella.CreateWrapSAttr("repeat")
    umbrella.CreateWrapTAttr("repeat")
    umbrella.CreatePatchIndicesAttr([0] * len(placements))
    umbrella.CreateMatricesAttr(placements)
    repeated = np.repeat(np.asarray(colors, np.float32).reshape(-1, 3), len(SQUARE), axis=0)
    umbrella.CreateColorsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(repeated)))
    for name in names:
        add_patch(stage, name)
    return stage


def add_patch(stage, name, points=SQUARE, file=""):
    patch = fexel.UmbrellaPatch.Define(stage, f"/Lawn/{name}")
    patch.CreatePointsAttr(points)
    patch.CreateTexCoordsAttr([(x + 0.5, y + 0.5) for x, y in points])
    if file:
        patch.CreateFileAttr(Sdf.AssetPath(str(file)))
    return patch


def lawn_prim(stage):
    return fexel.UmbrellaTexture.Get(stage, "/Lawn")


def read(stage, time=None):
    return extract(stage.GetPrimAtPath("/Lawn"), Usd.TimeCode.Default() if time is None else Usd.TimeCode(time))


def shown(gl, stage, view=WHOLE, system=None, time=None, draw=None):
    """(H, W, 4) as rendered over the unit square, or what `draw` says."""
    return render_texture(gl, Texture("/Lawn", "umbrella", read(stage, time)), draw or quad(), view, system)
