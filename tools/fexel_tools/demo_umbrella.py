"""The demonstration of umbrellas: leaves to a ground, a flight from its veins to the horizon, beside a plain texture.

The plain texture takes as much memory as the umbrellas: as many texels as eq. (2) of Just-in-time texture synthesis
(2012) counts words. It is rendered from the same stage: a session layer gives the texture prim another file and no
umbrellas, which makes it a plain image, filtered as any.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, Vt

import fexel
from fexel.errors import FexelError
from fexel.images import linear_to_srgb
from fexel_tools import fallback
from fexel_tools.contact_sheet import SheetRow, contact_sheet, write_png
from fexel_tools.image_files import write_image
from fexel_tools.texture_files import encode
from fexel_tools.umbrella import make_umbrella
from fexel_tools.umbrella_cameras import FRAMES
from fexel_tools.umbrella_options import UmbrellaOptions

__all__ = ["ABOUT", "CAMERA", "UmbrellaDemo", "bundled_sources", "make_umbrella_demo", "run", "without_umbrellas"]

ABOUT = "leaves to a ground that never repeats, from its veins to the horizon"

CAMERA = "/World/Cameras/Flight"
_PICTURES = 5
_SKY = (0.55, 0.7, 0.85)  # linear
_TEXTURE = "/World/Materials/Umbrella/Texture"


@dataclass(frozen=True)
class UmbrellaDemo:
    """What `make_umbrella_demo` wrote.

    Attributes
    ----------
    stage, sheet : Path
        The stage, and a PNG: the flight over umbrellas above the same over a plain texture.
    plain : (int, int)
        Width and height of the plain texture, texels.
    """

    stage: Path
    sheet: Path
    plain: tuple[int, int]


def run(options: argparse.Namespace) -> str:
    """The part of `demo`: `make_umbrella_demo` of what is bundled; where the results are."""
    leaves, settings = bundled_sources()
    result = make_umbrella_demo(leaves, settings, options.output, options.width)
    return f"stage {result.stage}, beside a plain texture of as many bytes in {result.sheet}"


def bundled_sources() -> tuple[list[Path], UmbrellaOptions]:
    """The leaves that come with a checkout, and how they are strewn on the soil.

    Raises
    ------
    FexelError
        They are not there, as in an installed wheel.
    """
    folder = Path(__file__).resolve().parents[2] / "stages" / "umbrella_leaves" / "sources"
    leaves = sorted(folder.glob("leaf_*.jpg"))
    if not leaves:
        raise FexelError(f"{folder}: no leaves; they come with a checkout")
    settings = UmbrellaOptions(
        grid=(32, 16),
        count=1500,
        background=str(folder / "soil.jpg"),
        references=tuple(str(file) for file in sorted(folder.glob("autumn_*.jpg"))),
        seed=7,
        fallback_size=1024,
    )
    return leaves, settings


def make_umbrella_demo(leaves: Sequence[Path], settings: UmbrellaOptions, output: Path, width: int) -> UmbrellaDemo:
    """Author a ground and render the flight over it, beside a plain texture of as many bytes.

    Parameters
    ----------
    leaves : sequence of Path
    settings : UmbrellaOptions
    output : Path
        Folder, made if need be. Gets ``umbrella_demo.usda`` with its textures, and ``umbrella_sheet.png``.
    width : int
        Of a picture, pixels.

    Raises
    ------
    FexelError
        Unreadable photos, no OpenGL, a folder that cannot be written.
    """
    output.mkdir(parents=True, exist_ok=True)
    stage_path = output / "umbrella_demo.usda"
    made = make_umbrella([str(leaf) for leaf in leaves], stage_path, settings)
    stage = Usd.Stage.Open(str(stage_path))
    size, plain = _write_plain(stage, output / "umbrella_plain.png", made.words, made.grid)
    frames = np.linspace(*FRAMES, _PICTURES).round()[::-1]
    with fexel.Renderer() as renderer:
        umbrellas = [_render(renderer, stage, frame, width) for frame in frames]
        without_umbrellas(stage, plain)
        rival = [_render(renderer, stage, frame, width) for frame in frames]
    label = f"{made.n} umbrellas of {len(made.bases)} photographed leaves, {4 * made.words} bytes by eq. (2)"
    plain_label = f"the same, plain texture of {size[0]} x {size[1]} texels, {4 * size[0] * size[1]} bytes"
    sheet = output / "umbrella_sheet.png"
    write_png(sheet, contact_sheet([SheetRow(label, umbrellas), SheetRow(plain_label, rival)]))
    return UmbrellaDemo(stage_path, sheet, size)


def without_umbrellas(stage: Usd.Stage, file: Path) -> None:
    """Make the texture prim a plain image, in the session layer."""
    texture = fexel.UmbrellaTexture.Get(stage, _TEXTURE)
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        texture.GetPatchIndicesAttr().Set(Vt.IntArray())
        for attribute in (texture.GetMatricesAttr(), texture.GetMorphsAttr(), texture.GetColorsAttr()):
            attribute.Block()
        texture.GetFileAttr().Set(Sdf.AssetPath(str(file.resolve())))
        for level in texture.GetLevels():
            level.GetPrim().SetActive(False)


def _write_plain(stage: Usd.Stage, path: Path, words: int, grid: tuple[int, int]) -> tuple[tuple[int, int], Path]:
    """Area averages of the ground in at most so many texels of four bytes."""
    longer = math.floor(math.sqrt(words * max(grid) / min(grid)))
    picture = fallback.bake(stage.GetPrimAtPath(_TEXTURE), longer)
    write_image(path, encode(picture[..., :3], None, "uint8", "sRGB"))
    return (picture.shape[1], picture.shape[0]), path


def _render(renderer: fexel.Renderer, stage: Usd.Stage, frame: float, width: int) -> np.ndarray:
    """One picture, (H, W, 3) uint8, sRGB-encoded, before the sky."""
    color = renderer.render(stage, camera=CAMERA, time=float(frame), width=width)["color"]
    linear = color[..., :3] + (1.0 - color[..., 3:]) * np.array(_SKY, np.float32)
    return np.round(255 * np.clip(linear_to_srgb(linear), 0, 1)).astype(np.uint8)
