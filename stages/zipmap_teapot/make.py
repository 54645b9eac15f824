"""Make the teapot: Newell's mesh, printed with a photo of dandelions whose flower head is there in detail.

usage: python stages/zipmap_teapot/make.py [PHOTO]     (the photo of README.md, 5312 x 2988 pixels)

Without the photo, which is not part of the repository, the textures stay as they are; all else is made anew.

The patches are cut from the large photo and the root is the same photo, eight times smaller: what a photographer would
bring home as five pictures. Blend masks are images of their own, as an artist would paint them.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import newell
import numpy as np
import OpenImageIO as oiio
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, Vt

import fexel
from fexel_tools import fallback

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent))
import stage_parts  # noqa: E402 - beside the folders of the stages

PHOTO_SIZE = (5312, 2988)
ROOT_SHRINK = 8
SEGMENTS = 10


@dataclass(frozen=True)
class Cut:
    """A patch: a window of the photo in pixels (left, top, width, height), kept at 1 / `shrink` of its resolution."""

    name: str
    parent: str
    window: tuple[int, int, int, int]
    shrink: int


CUTS = (
    Cut("Head", "", (600, 150, 1920, 1600), 2),
    Cut("Seeds", "Head", (1300, 900, 800, 600), 1),
    Cut("Rim", "Head", (1980, 420, 400, 640), 1),
    Cut("Small", "", (3940, 1960, 820, 680), 2),
)


def read_photo(path: Path) -> np.ndarray:
    """The photo, (H, W, 3) float32, linear."""
    buffer = oiio.ImageBuf(str(path))
    pixels = buffer.get_pixels(oiio.FLOAT)
    if pixels is None or pixels.shape[1::-1] != PHOTO_SIZE:
        raise fexel.FexelError(f"{path}: expected the photo of {PHOTO_SIZE[0]} x {PHOTO_SIZE[1]} pixels, see README.md")
    return np.where(pixels <= 0.04045, pixels / 12.92, ((pixels + 0.055) / 1.055) ** 2.4)


def shrink(linear: np.ndarray, factor: int) -> np.ndarray:
    """Average over factor x factor pixels and encode: (h, w, 3) uint8."""
    height, width = (side // factor for side in linear.shape[:2])
    small = cv2.resize(linear[: height * factor, : width * factor], (width, height), interpolation=cv2.INTER_AREA)
    encoded = np.where(small <= 0.0031308, 12.92 * small, 1.055 * small ** (1 / 2.4) - 0.055)
    return np.round(encoded * 255).astype(np.uint8)


def mask(height: int, width: int) -> np.ndarray:
    """An oval that fades out toward the border: (h, w, 1) uint8, 0 along the border."""
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    distance = (x**4 + y**4) ** 0.25
    fade = np.clip((0.98 - distance) / 0.22, 0, 1)
    return np.round(255 * fade * fade * (3 - 2 * fade))[..., None].astype(np.uint8)


def write_jpeg(path: Path, pixels: np.ndarray) -> None:
    """Write (H, W, 3) uint8, sRGB-encoded."""
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, oiio.UINT8)
    spec.attribute("Compression", "jpeg:90")
    spec.attribute("oiio:ColorSpace", "sRGB")
    output = oiio.ImageOutput.create(str(path))
    if not (output and output.open(str(path), spec) and output.write_image(pixels) and output.close()):
        raise fexel.FexelError(f"{path}: could not be written")


def st_window(window: tuple[float, float, float, float]) -> np.ndarray:
    """Lower left and upper right corner of a window of the photo in the root's st: (2, 2)."""
    left, top, width, height = window
    corners = np.array([(left, top + height), (left + width, top)], float) / PHOTO_SIZE
    return np.column_stack([corners[:, 0], 1.0 - corners[:, 1]])


def matrix(parent: np.ndarray, child: np.ndarray) -> np.ndarray:
    """From the st of the window `parent` to that of `child`, row vectors; both given by corners in the root's st."""
    scale = (parent[1] - parent[0]) / (child[1] - child[0])
    offset = (parent[0] - child[0]) / (child[1] - child[0])
    return np.array([[scale[0], 0, 0], [0, scale[1], 0], [*offset, 1]])


def write_textures(photo: np.ndarray) -> None:
    """Cut the photo into the root's texture and those of the patches, with their masks."""
    textures = FOLDER / "textures"
    textures.mkdir(exist_ok=True)
    write_jpeg(textures / "root.jpg", shrink(photo, ROOT_SHRINK))
    for cut in CUTS:
        left, top, width, height = cut.window
        pixels = shrink(photo[top : top + height, left : left + width], cut.shrink)
        write_jpeg(textures / f"{cut.name.lower()}.jpg", pixels)
        stage_parts.write_png(textures / f"{cut.name.lower()}_mask.png", mask(*pixels.shape[:2]))


def add_patches(stage: Usd.Stage, root: fexel.ZipmapTexture) -> None:
    """Nest the prims."""
    root.CreateFileAttr(Sdf.AssetPath("./textures/root.jpg"))
    root.CreateWrapSAttr("clamp")
    root.CreateWrapTAttr("clamp")
    placed = {"": (root.GetPath(), st_window((0, 0, *PHOTO_SIZE)))}
    for cut in CUTS:
        path, corners = placed[cut.parent]
        patch = fexel.ZipmapTexture.Define(stage, path.AppendChild(cut.name))
        patch.CreateFileAttr(Sdf.AssetPath(f"./textures/{cut.name.lower()}.jpg"))
        patch.CreateMaskAttr(Sdf.AssetPath(f"./textures/{cut.name.lower()}_mask.png"))
        patch.CreateMatrixAttr(Gf.Matrix3d(*matrix(corners, st_window(cut.window)).ravel()))
        placed[cut.name] = (patch.GetPath(), st_window(cut.window))


def write_mesh(path: Path) -> None:
    """Write the mesh alone, in the material subsets ``body`` and ``rest``, as a binary layer.

    Every face is in a subset: Blender gives faces outside of all subsets the first subset's material.
    """
    pot = newell.teapot(SEGMENTS)
    stage = stage_parts.new_stage(path, "Newell's teapot, in the public domain; tessellated by newell.py.")
    mesh = UsdGeom.Mesh.Define(stage, "/World/Teapot")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(pot.points.astype(np.float32)))
    mesh.CreateExtentAttr([Gf.Vec3f(*pot.points.min(0)), Gf.Vec3f(*pot.points.max(0))])
    mesh.CreateFaceVertexCountsAttr(pot.face_counts.tolist())
    mesh.CreateFaceVertexIndicesAttr(pot.face_indices.tolist())
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(pot.normals.astype(np.float32)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    stage_parts.add_st(mesh, pot.st)
    binding = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    rest = np.concatenate([pot.faces[part] for part in newell.PARTS if part != "body"])
    binding.CreateMaterialBindSubset("body", pot.faces["body"].tolist())
    binding.CreateMaterialBindSubset("rest", np.sort(rest).tolist())
    stage_parts.save(stage, path)


def add_teapot(stage: Usd.Stage, printed: UsdShade.Material, glaze: UsdShade.Material) -> None:
    """The mesh by reference: its body carries the print, everything else plain glaze."""
    mesh = stage.DefinePrim("/World/Teapot")
    mesh.GetReferences().AddReference("./teapot.usdc", "/World/Teapot")
    for name, material in (("body", printed), ("rest", glaze)):
        subset = stage.OverridePrim(f"/World/Teapot/{name}")
        UsdShade.MaterialBindingAPI.Apply(subset).Bind(material)


def add_glaze(stage: Usd.Stage, path: str) -> UsdShade.Material:
    """Plain dark green glaze."""
    material = UsdShade.Material.Define(stage, path)
    surface = UsdShade.Shader.Define(stage, f"{path}/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set((0.05, 0.09, 0.03))
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.25)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    return material


def add_lights(stage: Usd.Stage) -> None:
    """A pale dome and a key light from the upper left."""
    dome = UsdLux.DomeLight.Define(stage, "/World/Lights/Sky")
    dome.CreateIntensityAttr(0.45)
    key = UsdLux.DistantLight.Define(stage, "/World/Lights/Key")
    key.CreateIntensityAttr(2.5)
    key.CreateAngleAttr(2.0)
    key.CreateNormalizeAttr(True)  # intensity is then the irradiance
    UsdGeom.Xformable(key).AddRotateXYZOp().Set((-35, -30, 0))


def add_camera(stage: Usd.Stage, name: str, eye: tuple, target: tuple, focal: float) -> None:
    """A camera at `eye` looking at `target`, y up; focal length in tenths of a unit for an aperture of 24."""
    camera = UsdGeom.Camera.Define(stage, f"/World/Cameras/{name}")
    camera.CreateFocalLengthAttr(focal)
    camera.CreateHorizontalApertureAttr(24.0)
    camera.CreateVerticalApertureAttr(18.0)
    camera.CreateClippingRangeAttr((0.01, 100.0))
    world_to_camera = Gf.Matrix4d().SetLookAt(Gf.Vec3d(*eye), Gf.Vec3d(*target), Gf.Vec3d(0, 1, 0))
    camera.AddTransformOp().Set(world_to_camera.GetInverse())


def main(photo: Path | None) -> None:
    """Write the textures, if there is a photo to cut them from, the stage and its fallback."""
    if photo:
        write_textures(read_photo(photo))
    path = FOLDER / "zipmap_teapot.usda"
    stage = stage_parts.new_stage(
        path, "Newell's teapot, printed with a zipmap of four patches, as in figure 4 of the paper."
    )
    stage_parts.add_scopes(stage)
    printed, zipmap = stage_parts.add_zipmap_material(stage, "/World/Materials/Dandelions", roughness=0.4, ior=1.4)
    add_patches(stage, zipmap)
    write_mesh(FOLDER / "teapot.usdc")
    add_teapot(stage, printed, add_glaze(stage, "/World/Materials/Glaze"))
    add_lights(stage)
    add_camera(stage, "Overview", (-1.6, 3.2, 9.0), (0.1, 1.35, 0.0), 28.0)
    add_camera(stage, "Head", (-1.6, 2.0, 4.2), (-0.85, 1.35, 1.7), 40.0)
    add_camera(stage, "Detail", (-1.55, 1.65, 2.9), (-1.13, 1.46, 1.6), 60.0)
    stage_parts.save(stage, path)
    opened = Usd.Stage.Open(str(path))
    fallback.write_fallback(opened.GetPrimAtPath(zipmap.GetPath()), FOLDER / "textures" / "fallback.jpg", size=1024)
    opened.Save()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
