"""Umbrellas as a USD stage: texture prims with patches, a material, a ground to see it on, light, and cameras.

::

    /World                       default prim
      Materials/Umbrella         Material; Surface.inputs:diffuseColor, or what is driven <- Texture.outputs:rgb
        Texture                  UmbrellaTexture; below it UmbrellaPatch and UmbrellaLevel prims, the fallback network
        Normal, Roughness        UmbrellaTextures of companion maps, where there are any: the same arrangement
      Surface                    the ground: st in [0, 1], one unit along t, square cells of the grid
      Surroundings               the same texture on, around it, as far as the horizon
      Light                      DomeLight of radiance 1: a matt ground shows the texture's own colours; with a normal
                                 map half of it, and a `Sun`
      Cameras/Flight             over frames 1 to 48 from the veins of one element to the horizon; what renderers take
      Cameras/Overview, Detail   the whole, one element, from above

Large arrays do not belong into text, and are there once however many maps share them: they then lie in a layer of
their own, ``<stem>_textures/arrangement.usdc``, whose prim ``/Arrangement`` the textures reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdLux, UsdShade, Vt

import fexel
from fexel.textures.umbrella import DIGEST_KEY
from fexel.textures.umbrella_arrangement import Arrangement
from fexel_tools.geometry import Surface, define_surface, look_at
from fexel_tools.texture_stage import MATERIALS, begin_stage, define_preview_surface, finish_stage
from fexel_tools.umbrella_cameras import ASPECT, FRAMES, HORIZON_CELLS, ground_cameras, world_point

__all__ = ["MATERIAL_PATH", "LevelPrim", "UmbrellaMap", "create_stage", "define_level", "write_levels"]

MATERIAL_PATH = f"{MATERIALS}/Umbrella"
_FRAMES_PER_SECOND = 24.0
_MOST_NUMBERS_AS_TEXT = 20_000
_ARRANGEMENT_FILE, _ARRANGEMENT_PATH = "arrangement.usdc", "/Arrangement"
_SUN_SHARE = 0.5  # of the light on a level ground with relief
_GREY = 0.5  # diffuse colour of a surface whose texture is not its colour
_FLOAT, _FLOAT3 = Sdf.ValueTypeNames.Float, Sdf.ValueTypeNames.Float3
_TYPES = {
    "diffuseColor": Sdf.ValueTypeNames.Color3f,
    "emissiveColor": Sdf.ValueTypeNames.Color3f,
    "normal": Sdf.ValueTypeNames.Normal3f,
}
_MATT = ("diffuseColor", "emissiveColor")


@dataclass(frozen=True, eq=False)
class UmbrellaMap:
    """One quantity of the ground: its colour, normal or roughness.

    Attributes
    ----------
    name : str
        Of the prim.
    drives : str
        Input of UsdPreviewSurface.
    files : tuple of str
        Image of each base, relative to the stage.
    color_space : str
        ``sRGB`` or ``raw``.
    background : str
        Image behind the umbrellas, relative to the stage; '' for `background_color` alone.
    background_color : 4 floats
        Linear (or data), straight alpha: seen where there is no image.
    is_biased : bool
        The images store (v + 1) / 2, as integer normal maps do.
    has_colors : bool
        Vertex colours apply: not to data.
    """

    name: str
    drives: str
    files: tuple[str, ...]
    color_space: str = "sRGB"
    background: str = ""
    background_color: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    is_biased: bool = False
    has_colors: bool = True

    @property
    def path(self) -> str:
        """Of the prim."""
        return f"{MATERIAL_PATH}/{self.name}"


@dataclass(frozen=True, eq=False)
class LevelPrim:
    """A coarser level of detail: an image of the whole arrangement, or merged umbrellas.

    Attributes
    ----------
    level : int
        A cell of it stands for 2^level x 2^level cells.
    grid : (int, int)
    digest : str
        Of what it was made from (`fexel.textures.umbrella.level_digest`).
    file : str
        Image, relative to the stage; '' for merged umbrellas.
    arrangement : Arrangement or None
        Merged umbrellas, one shape each.
    """

    level: int
    grid: tuple[int, int]
    digest: str
    file: str = ""
    arrangement: Arrangement | None = None


def create_stage(
    path: Path,
    textures: Path,
    arrangement: Arrangement,
    names: Sequence[str],
    maps: Sequence[UmbrellaMap],
    source: str = "",
) -> Usd.Stage:
    """Author everything but levels and fallbacks. The stage is not saved.

    Parameters
    ----------
    path : Path
        File to create, ``.usd``, ``.usda`` or ``.usdc``.
    textures : Path
        Folder beside it, for the layer of arrays.
    arrangement : Arrangement
        Its images are not looked at: `maps` name them.
    names : sequence of str
        Names of the patch prims, one per shape, unique.
    maps : sequence of UmbrellaMap
        The first one is the ground's main texture.
    source : str
        What it was made from.
    """
    ground = _ground(arrangement.grid)
    stage = begin_stage(path, ground)
    stage.SetTimeCodesPerSecond(_FRAMES_PER_SECOND)
    stage.SetFramesPerSecond(_FRAMES_PER_SECOND)
    stage.SetStartTimeCode(FRAMES[0])
    stage.SetEndTimeCode(FRAMES[1])
    material, surface = _define_material(stage, maps)
    shared = _shared_layer(path, textures, arrangement, names, len(maps))
    for each in maps:
        _define_texture(stage, each, arrangement, names, shared, source)
        _connect(stage, surface, each)
    finish_stage(stage, ground, material, ground_cameras(arrangement), ASPECT)
    define_surface(stage, "/World/Surroundings", _surroundings(arrangement.grid), material)
    has_relief = any(each.drives == "normal" for each in maps)
    _define_lights(stage, arrangement.shadow_offset, arrangement.grid, has_relief)
    return stage


def define_level(texture: fexel.UmbrellaTexture, level: LevelPrim, arrays: str = "") -> None:
    """Author a level below a texture, on the stage's edit target.

    Parameters
    ----------
    texture : fexel.UmbrellaTexture
    level : LevelPrim
    arrays : str
        Layer, relative to the stage, from `write_levels`, that holds the arrays of merged umbrellas; '' authors them
        here.
    """
    prim = texture.GetPrim()
    path = prim.GetPath().AppendChild(f"Level{level.level}")
    author = fexel.UmbrellaLevel.Define(prim.GetStage(), path)
    author.CreateLevelAttr(level.level)
    author.CreateGridAttr(Gf.Vec2i(*level.grid))
    author.GetPrim().SetCustomDataByKey(DIGEST_KEY, level.digest)
    if level.file:
        color_space = texture.GetSourceColorSpaceAttr().Get()
        author.CreateFileAttr(Sdf.AssetPath(level.file)).SetColorSpace(color_space)
    if arrays:
        author.GetPrim().GetReferences().AddReference(arrays, f"/{path.name}")
    elif level.arrangement is not None:
        _define_merged(author, level.arrangement)


def write_levels(path: Path, levels: Sequence[LevelPrim]) -> None:
    """Write the arrays of merged levels as a layer for `define_level`."""
    stage = Usd.Stage.CreateNew(str(path))
    for level in levels:
        if level.arrangement is not None:
            _define_merged(fexel.UmbrellaLevel.Define(stage, f"/Level{level.level}"), level.arrangement)
    stage.GetRootLayer().Save()


def _define_merged(author: fexel.UmbrellaLevel, merged: Arrangement) -> None:
    counts = merged.vertex_counts.astype(np.int32)
    author.CreatePatchIndicesAttr(Vt.IntArray.FromNumpy(np.full(len(merged), -1, np.int32)))
    author.CreateVertexCountsAttr(Vt.IntArray.FromNumpy(counts))
    author.CreatePointsAttr(Vt.Vec2fArray.FromNumpy(merged.vertices.astype(np.float32)))
    author.CreateColorsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(merged.colors, np.float32)))
    if len(merged.coverages):
        author.CreateCoveragesAttr(Vt.FloatArray.FromNumpy(merged.coverages.astype(np.float32)))


def _define_lights(
    stage: Usd.Stage, shadow_offset: tuple[float, float], grid: tuple[int, int], has_relief: bool
) -> None:
    """A dome; where there are normals, which a dome alone does not show, half of its light is a sun's.

    The sun stands opposite to where shadows fall, at 45 degrees.
    """
    share = _SUN_SHARE if has_relief else 0.0
    UsdLux.DomeLight.Define(stage, "/World/Light").CreateIntensityAttr(1.0 - share)
    if not has_relief:
        return
    falls = world_point(0.5 + np.array(shadow_offset), grid)
    length = float(np.linalg.norm(falls))
    towards = -falls / length if length > 0.0 else np.array([-0.6, 0.0, -0.8])
    sun = UsdLux.DistantLight.Define(stage, "/World/Sun")
    sun.CreateNormalizeAttr(True)
    sun.CreateIntensityAttr(np.pi * share * np.sqrt(2.0))  # irradiance across its rays, 45 degrees off the ground's
    up = np.array([0.0, 1.0, 0.0])
    sun.AddTransformOp().Set(look_at(towards + up, np.zeros(3), up))


def _define_material(stage: Usd.Stage, maps: Sequence[UmbrellaMap]) -> tuple[UsdShade.Material, UsdShade.Shader]:
    driven = {each.drives for each in maps}
    is_matt = "roughness" not in driven and maps[0].drives in _MATT
    values = {"roughness": 1.0, "ior": 1.0} if is_matt else {"roughness": 0.6}
    material, surface = define_preview_surface(stage, "Umbrella", **values, metallic=0.0)
    if "diffuseColor" not in driven:
        grey = 0.0 if "emissiveColor" in driven else _GREY
        surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(grey))
    return material, surface


def _connect(stage: Usd.Stage, surface: UsdShade.Shader, each: UmbrellaMap) -> None:
    """The surface's input to the texture; its opacity as well where the background is transparent."""
    texture = UsdShade.NodeGraph(stage.GetPrimAtPath(each.path))
    output, output_type = ("rgb", _FLOAT3) if each.drives in _TYPES else ("r", _FLOAT)
    driven = surface.CreateInput(each.drives, _TYPES.get(each.drives, _FLOAT))
    driven.ConnectToSource(texture.CreateOutput(output, output_type))
    if each.drives in _MATT and not each.background and each.background_color[3] < 1.0:
        surface.CreateInput("opacity", _FLOAT).ConnectToSource(texture.CreateOutput("a", _FLOAT))


def _define_texture(
    stage: Usd.Stage,
    each: UmbrellaMap,
    arrangement: Arrangement,
    names: Sequence[str],
    shared: str,
    source: str,
) -> None:
    texture = fexel.UmbrellaTexture.Define(stage, each.path)
    if shared:
        texture.GetPrim().GetReferences().AddReference(shared, _ARRANGEMENT_PATH)
        if len(arrangement.colors) and not each.has_colors:
            texture.CreateColorsAttr(Vt.Vec3fArray())
    else:
        _author_arrangement(texture, arrangement, names, each.has_colors)
    for name, file in zip(names, each.files, strict=True):
        patch = fexel.UmbrellaPatch.Define(stage, f"{each.path}/{name}")
        patch.CreateFileAttr(Sdf.AssetPath(file)).SetColorSpace(each.color_space)
    if each.background:
        texture.CreateFileAttr(Sdf.AssetPath(each.background))
    texture.CreateFallbackAttr(Gf.Vec4f(*each.background_color))
    texture.CreateSourceColorSpaceAttr(each.color_space)
    texture.CreateWrapSAttr("repeat")
    texture.CreateWrapTAttr("repeat")
    if each.is_biased:
        texture.CreateScaleAttr(Gf.Vec4f(2.0, 2.0, 2.0, 1.0))
        texture.CreateBiasAttr(Gf.Vec4f(-1.0, -1.0, -1.0, 0.0))
    if each.has_colors:
        texture.CreateColorBlendAttr(arrangement.color_blend)
    if each.drives in _MATT and arrangement.shadow_strength > 0.0:
        texture.CreateShadowOffsetAttr(Gf.Vec2f(*arrangement.shadow_offset))
        texture.CreateShadowStrengthAttr(arrangement.shadow_strength)
    if source:
        texture.GetPrim().SetCustomDataByKey("fexel:source", source)


def _author_arrangement(
    texture: fexel.UmbrellaTexture, arrangement: Arrangement, names: Sequence[str], has_colors: bool
) -> None:
    """Arrays of the texture and of its patches, on the stage's edit target."""
    stage, path = texture.GetPrim().GetStage(), texture.GetPath()
    texture.CreateGridAttr(Gf.Vec2i(*arrangement.grid))
    texture.CreatePatchIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(arrangement.shape_of, np.int32)))
    texture.CreateMatricesAttr(Vt.Matrix3dArray.FromNumpy(np.ascontiguousarray(arrangement.matrices, np.float64)))
    if len(arrangement.morphs) and arrangement.morphs.any():
        texture.CreateMorphsAttr(Vt.FloatArray.FromNumpy(arrangement.morphs.astype(np.float32)))
    if len(arrangement.colors) and has_colors:
        texture.CreateColorsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(arrangement.colors, np.float32)))
    for name, shape in zip(names, arrangement.shapes, strict=True):
        patch = fexel.UmbrellaPatch.Define(stage, path.AppendChild(name))
        patch.CreateTexCoordsAttr(_pairs(shape.tex_coords))
        patch.CreatePointsAttr(_pairs(shape.points))
        if not np.array_equal(shape.points, shape.morph_points):
            patch.CreateMorphPointsAttr(_pairs(shape.morph_points))


def _pairs(values: np.ndarray) -> Vt.Vec2fArray:
    return Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(values, np.float32))


def _shared_layer(path: Path, textures: Path, arrangement: Arrangement, names: Sequence[str], maps: int) -> str:
    """Write the layer of arrays where there has to be one; returns it relative to the stage, or ''."""
    numbers = 9 * len(arrangement) + arrangement.colors.size + 6 * sum(len(s.points) for s in arrangement.shapes)
    if maps < 2 and not (path.suffix.lower() == ".usda" and numbers > _MOST_NUMBERS_AS_TEXT):
        return ""
    stage = Usd.Stage.CreateNew(str(textures / _ARRANGEMENT_FILE))
    texture = fexel.UmbrellaTexture.Define(stage, _ARRANGEMENT_PATH)
    _author_arrangement(texture, arrangement, names, has_colors=True)
    stage.SetDefaultPrim(texture.GetPrim())
    stage.WriteFallbackPrimTypes()
    stage.GetRootLayer().Save()
    return f"./{textures.name}/{_ARRANGEMENT_FILE}"


def _ground(grid: tuple[int, int]) -> Surface:
    """The unit square of st, lying: y is up."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    return Surface(world_point(corners, grid), triangles, corners[triangles], np.tile([0.0, 1.0, 0.0], (4, 1)))


def _surroundings(grid: tuple[int, int]) -> Surface:
    """A ring about the ground as far as the horizon, st as the plane has it."""
    inner = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    outer = 0.5 + np.sign(inner - 0.5) * np.maximum(HORIZON_CELLS / np.array(grid, np.float64), 1.0)
    st = np.concatenate([outer, inner])
    sides = [(k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)]
    triangles = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])
    return Surface(world_point(st, grid), triangles, st[triangles], np.tile([0.0, 1.0, 0.0], (8, 1)))
