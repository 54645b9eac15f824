"""Make the crease: a normal map of 8 x 8 pinchmap texels in which a fold begins smoothly, as in figure 10 of the paper.

Everything is computed: a curved sheet with a fold along an arc. The pinch strength goes from 0 to 1 over three texels
of the pinchmap; left of them nothing is pinched, and the line is open.

usage: python stages/pinchmap_crease/make.py        (rewrites pinchmap_crease.usda and textures/ beside this script)
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pxr import Sdf, UsdLux

from fexel_tools.pinchmap import Pinchmap
from fexel_tools.pinchmap_fit import fit
from fexel_tools.pinchmap_options import PinchmapOptions
from fexel_tools.pinchmap_signal import fill_signal
from fexel_tools.pinchmap_source import PinchmapSource
from fexel_tools.pinchmap_textures import as_stored

FOLDER = Path(__file__).resolve().parent
sys.path.insert(0, str(FOLDER.parent))
import pinchmap_parts  # noqa: E402 - beside the folders of the stages
import stage_parts  # noqa: E402

SIZE = 8  # pinchmap texels a side
OPTIONS = PinchmapOptions(size=SIZE, signal_size=SIZE, drives="normal", bits="16")
SOURCE_PX = 512
STARTS = 2.0 / SIZE  # of s: no pinching before, in full three texels further on
FULL = 5.0 / SIZE
FLAT = 7.0 / SIZE  # where the line has become level: the last column of cells can hold no other
BULGE = 0.45  # slope of the sheet at its border
FOLD = -0.55  # slope on either side of the fold
SOFT = 0.5 / SIZE  # half width of the fold where it is none yet, in s


def arc(s: np.ndarray) -> np.ndarray:
    """t of the line at s."""
    u = np.minimum(s / FLAT, 1.0)
    return 0.22 + 0.40 * (2 * u - u**2)


def strength(s: np.ndarray) -> np.ndarray:
    """Pinch strength at s."""
    return np.clip((s - STARTS) / (FULL - STARTS), 0, 1)


def slopes(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Gradient of the sheet's height, (H, W, 2): a bulge, and along the arc a ridge that narrows to a fold."""
    along = 0.80 / FLAT * (1 - np.minimum(s / FLAT, 1.0))
    across = (t - arc(s)) / np.sqrt(1 + along**2)
    narrow = SOFT * (1 - strength(s))
    fade = np.clip(s / STARTS, 0, 1) ** 2 * (3 - 2 * np.clip(s / STARTS, 0, 1))  # no ridge at the left border
    fold = FOLD * fade * across / np.hypot(across, np.maximum(narrow, 1e-9)) * np.exp(-((across / 0.3) ** 2))
    normal = np.stack([-along, np.ones_like(s)], -1) / np.sqrt(1 + along**2)[..., None]
    bulge = -BULGE * np.stack([2 * s - 1, 2 * t - 1], -1)
    return bulge + fold[..., None] * normal


def source() -> PinchmapSource:
    """The normal map at high resolution, encoded as (n + 1) / 2, and the side of the arc."""
    middle = (np.arange(SOURCE_PX) + 0.5) / SOURCE_PX
    s, t = np.meshgrid(middle, 1 - middle)
    gradient = slopes(s, t)
    normal = np.dstack([-gradient, np.ones_like(s)])
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    side = np.clip(0.5 + (t - arc(s)) * SOURCE_PX, 0, 1)
    opaque = np.ones(s.shape, np.float32)
    encoded = (0.5 + 0.5 * normal).astype(np.float32)
    return PinchmapSource(FOLDER / "make.py", encoded, opaque, side.astype(np.float32), True, 16)


def crease() -> Pinchmap:
    """The pinchmap whose line is open at its left end, and the normals that go with it."""
    image = source()
    fitted = fit(image.side, (SIZE, SIZE), wrap=OPTIONS.wrap, bits=16)
    texels = fitted.pinchmap.copy()
    texels[..., :2] *= strength(np.arange(SIZE) / SIZE)[None, :, None]  # texel c lies at s = c / SIZE
    texels = as_stored(texels, OPTIONS.bits)
    signal = fill_signal(image, texels, (OPTIONS.signal_size, OPTIONS.signal_size), wrap=OPTIONS.wrap)
    return Pinchmap(image, SIZE, fitted, texels, signal, OPTIONS.wrap, np.eye(3))


def main() -> None:
    """Write the textures, the stage and its fallback."""
    path = FOLDER / "pinchmap_crease.usda"
    prim = pinchmap_parts.write_textures(FOLDER, "normal", crease(), OPTIONS, "")
    stage = stage_parts.new_stage(path, "A crease in a normal map that starts smoothly, as in figure 10 of the paper.")
    stage_parts.add_scopes(stage)
    material, surface = stage_parts.add_matt_surface(stage, "/World/Materials/Paint", roughness=0.32, ior=1.5)
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set((0.05, 0.16, 0.32))
    texture = pinchmap_parts.add_texture(stage, "/World/Materials/Paint/Texture", prim)
    normal = surface.CreateInput("normal", Sdf.ValueTypeNames.Normal3f)
    normal.ConnectToSource(texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
    stage_parts.add_wall(stage, 1.0, 1.0, material, "/World/Sheet")
    UsdLux.DomeLight.Define(stage, "/World/Lights/Sky").CreateIntensityAttr(0.35)
    pinchmap_parts.add_key_light(stage, (-50.0, -20.0, 0.0), 3.0)
    pinchmap_parts.add_camera(stage, "Overview", (0.0, 0.0, 4.0), (0.0, 0.0, 0.0), 1.0, 1.0)
    pinchmap_parts.add_camera(stage, "Detail", (0.0, -0.02, 2.0), (0.14, 0.04, 0.0), 0.42, 1.0)
    stage_parts.save(stage, path)
    pinchmap_parts.write_fallbacks(path, {str(texture.GetPath()): ("textures/normal/fallback.png", 256)})


if __name__ == "__main__":
    main()
