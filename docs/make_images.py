"""Make the pictures of the README from the example stages: ``python docs/make_images.py``."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from pxr import Usd

import fexel
from fexel.filters import FILTERS
from fexel.images import image_info, linear_to_srgb, read_pixels
from fexel.renderer.encoding import data_range, visible_data
from fexel_tools import demo_fipmap, demo_pinchmap, demo_umbrella, demo_zipmap
from fexel_tools.contact_sheet import SheetRow, contact_sheet

DOCS = Path(__file__).resolve().parent
STAGES = DOCS.parent / "stages"


def picture(renderer: fexel.Renderer, stage: Usd.Stage, width: int, **options: object) -> np.ndarray:
    """One frame, (H, W, 3) uint8, sRGB-encoded, on black."""
    color = renderer.render(stage, width=width, samples=8, **options)["color"]
    return np.round(255 * np.clip(linear_to_srgb(color[..., :3]), 0, 1)).astype(np.uint8)


def without_patches(name: str, texture: str) -> Usd.Stage:
    """The stage with the patches of one zipmap deactivated in the session layer."""
    stage = Usd.Stage.Open(str(STAGES / name / f"{name}.usda"))
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for patch in fexel.ZipmapTexture.Get(stage, texture).GetPatches():
            if patch.depth == 1:
                patch.prim.SetActive(False)
    return stage


def zoom_sheet(renderer: fexel.Renderer, name: str, texture: str, frames: list[int], width: int) -> np.ndarray:
    """Frames of the zoom camera, with patches above, with the root alone below."""
    with_patches = Usd.Stage.Open(str(STAGES / name / f"{name}.usda"))
    stages = {"zipmap": with_patches, "root texture alone": without_patches(name, texture)}
    rows = [
        SheetRow(label, [picture(renderer, stage, width, camera="Zoom", time=frame) for frame in frames])
        for label, stage in stages.items()
    ]
    return contact_sheet(rows, [magnification(with_patches, frame) for frame in frames])


def magnification(stage: Usd.Stage, frame: int) -> str:
    """How much larger the surface appears than at frame 1, from the widths of the clipping range."""
    clipping = stage.GetPrimAtPath("/World/Cameras/Zoom").GetAttribute("clippingRange")
    value = clipping.Get(1)[0] / clipping.Get(frame)[0]
    return f"{value:.1f}x" if value < 20 else f"{value:,.0f}x"


def demo_sheet(renderer: fexel.Renderer, count: int, width: int) -> np.ndarray:
    """The zoom of `make demo`, with patches above, with the root alone below."""
    rows, labels = [], []
    for label, root_alone in (("zipmap", False), ("root texture alone", True)):
        stage = Usd.Stage.Open(str(STAGES / "zipmap_demo" / "zipmap_demo.usda"))
        labels = [f"{value:.1f}x" for value in demo_zipmap.add_camera(stage, count)]
        if root_alone:
            demo_zipmap.root_texture_alone(stage)
        frames = range(1, count + 1)
        rows.append(
            SheetRow(label, [picture(renderer, stage, width, camera=demo_zipmap.CAMERA, time=f) for f in frames])
        )
    return contact_sheet(rows, labels)


def teapot_sheet(renderer: fexel.Renderer, width: int) -> np.ndarray:
    """The pot from afar, and a close-up with and without the patches."""
    stage = Usd.Stage.Open(str(STAGES / "zipmap_teapot" / "zipmap_teapot.usda"))
    root = without_patches("zipmap_teapot", "/World/Materials/Dandelions/Texture")
    pictures = [picture(renderer, stage, width, camera=name) for name in ("Overview", "Head")]
    pictures += [picture(renderer, s, width, camera="Detail") for s in (stage, root)]
    return contact_sheet([SheetRow("", pictures)], ["overview", "closer", "close-up", "close-up, root texture alone"])


def write_pinchmaps(width: int) -> None:
    """The sheet of `make demo` as ``docs/images/pinchmap.png``."""
    with tempfile.TemporaryDirectory() as folder:
        result = demo_pinchmap.make_pinchmap_demo(demo_pinchmap.bundled_sources(), Path(folder), width)
        shutil.copyfile(result.sheet, DOCS / "images" / "pinchmap.png")


def write_umbrellas(width: int) -> None:
    """The sheet of `make demo` as ``docs/images/umbrella.jpg``."""
    with tempfile.TemporaryDirectory() as folder:
        leaves, settings = demo_umbrella.bundled_sources()
        result = demo_umbrella.make_umbrella_demo(leaves, settings, Path(folder), width)
        write("umbrella", read_pixels(image_info(str(result.sheet)))[..., :3])


def write_filters(width: int) -> None:
    """The sheet of `make demo` as ``docs/images/fipmap.png``."""
    with tempfile.TemporaryDirectory() as folder:
        result = demo_fipmap.make_fipmap_demo(demo_fipmap.bundled_views(), Path(folder), width)
        shutil.copyfile(result.sheet, DOCS / "images" / "fipmap.png")


def write_filter_aovs(width: int) -> None:
    """Three frames of the flight and the AOVs of minification, in strips by filter: ``docs/images/fipmap_aovs.jpg``."""
    names, frames = ("color", "footprint", "fetches", "filter", "decision"), (12, 30, 42)
    stage = Usd.Stage.Open(str(STAGES / "fipmap_floor" / "fipmap_floor.usda"))
    strip = width // len(FILTERS)
    sheet = np.zeros((len(frames), len(names), width * 9 // 16, strip * len(FILTERS), 3), np.uint8)
    for number, token in enumerate(FILTERS):
        columns = slice(number * strip, (number + 1) * strip)
        with fexel.Renderer(filter=token) as renderer:
            for row, frame in enumerate(frames):
                size = {"width": sheet.shape[3], "height": sheet.shape[2]}
                images = renderer.render(stage, camera="Flight", time=frame, aovs=names, **size)
                for column, name in enumerate(names):
                    sheet[row, column, :, columns] = seen_aov(name, images[name])[:, columns]
    rows = [SheetRow(f"frame {frame}", list(sheet[row])) for row, frame in enumerate(frames)]
    write("fipmap_aovs", contact_sheet(rows, names))


def seen_aov(name: str, image: np.ndarray) -> np.ndarray:
    """An AOV (H, W, C) as (H, W, 3) uint8, sRGB-encoded."""
    if name == "color":
        seen = np.clip(linear_to_srgb(image[..., :3]), 0, 1)
    else:
        seen = visible_data(name, image, data_range(name, image))
    return np.round(255 * np.broadcast_to(seen, (*seen.shape[:2], 3))).astype(np.uint8)


def write(name: str, pixels: np.ndarray) -> None:
    """Write ``docs/images/<name>.jpg``."""
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, oiio.UINT8)
    spec.attribute("Compression", "jpeg:88")
    path = DOCS / "images" / f"{name}.jpg"
    path.parent.mkdir(exist_ok=True)
    output = oiio.ImageOutput.create(str(path))
    if not (output.open(str(path), spec) and output.write_image(np.ascontiguousarray(pixels)) and output.close()):
        raise fexel.FexelError(f"{path}: {output.geterror()}")


def main() -> None:
    """Write every picture."""
    with fexel.Renderer() as renderer:
        write("teapot", teapot_sheet(renderer, 320))
        write(
            "deep_zoom",
            zoom_sheet(renderer, "zipmap_deep", "/World/Materials/Deep/Texture", [1, 9, 17, 25, 33, 41, 48], 180),
        )
        write("zoom", demo_sheet(renderer, 6, 224))
    write_pinchmaps(240)
    write_umbrellas(300)
    write_filters(240)
    write_filter_aovs(288)


if __name__ == "__main__":
    main()
