"""The example stages: complete, self-contained, valid, and looking as their READMEs promise."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdUtils

import fexel

REPOSITORY = Path(__file__).resolve().parents[2]
FOLDER = REPOSITORY / "stages"
FIPMAPS = ("fipmap_anamorphosis", "fipmap_floor")
PINCHMAPS = ("pinchmap_crease", "pinchmap_demo", "pinchmap_in_zipmap", "pinchmap_lines", "pinchmap_sign")
UMBRELLAS = ("umbrella_citrus", "umbrella_flowers", "umbrella_in_zipmap", "umbrella_leaves", "umbrella_sweets")
ZIPMAPS = ("zipmap_deep", "zipmap_demo", "zipmap_teapot", "zipmap_wall")
NAMES = FIPMAPS + PINCHMAPS + UMBRELLAS + ZIPMAPS
TEXTURES = {
    "zipmap_deep": "/World/Materials/Deep/Texture",
    "zipmap_demo": "/World/Materials/Zipmap/Texture",
    "zipmap_teapot": "/World/Materials/Dandelions/Texture",
    "zipmap_wall": "/World/Materials/Zipmap/Texture",
}
PATCHES = {"zipmap_deep": 12, "zipmap_demo": 2, "zipmap_teapot": 4, "zipmap_wall": 5}
DEPTHS = {"zipmap_deep": 12, "zipmap_demo": 2, "zipmap_teapot": 2, "zipmap_wall": 1}


def open_stage(name: str) -> Usd.Stage:
    return Usd.Stage.Open(str(FOLDER / name / f"{name}.usda"))


@pytest.fixture(scope="module")
def renderer():
    with fexel.Renderer() as renderer:
        yield renderer


def test_every_stage_folder_is_tested():
    assert sorted(path.name for path in FOLDER.iterdir() if (path / "README.md").is_file()) == list(NAMES)


@pytest.mark.parametrize("name", ZIPMAPS)
def test_stage_has_the_patches_that_its_readme_counts(name):
    stage = open_stage(name)
    patches = fexel.ZipmapTexture.Get(stage, TEXTURES[name]).GetPatches()
    assert len(patches) == 1 + PATCHES[name]
    assert max(patch.depth for patch in patches) == DEPTHS[name]


@pytest.mark.parametrize("name", NAMES)
def test_stage_is_self_contained_and_small(name):
    path = FOLDER / name / f"{name}.usda"
    layers, assets, unresolved = UsdUtils.ComputeAllDependencies(str(path))
    assert not unresolved
    inside = (FOLDER / name).resolve()
    for file in [layer.realPath for layer in layers] + list(assets):
        assert Path(file).resolve().is_relative_to(inside), file
    authored = re.findall(r"@([^@]*)@", path.read_text(encoding="utf-8"))
    assert authored
    assert not [asset for asset in authored if asset.startswith("/") or ":" in asset]
    limit = 1e6 if name in FIPMAPS + PINCHMAPS else 1.5e6 if name in UMBRELLAS else 6e6
    files = [file for file in inside.rglob("*") if file.is_file() and ".fexel-cache" not in file.parts]
    assert sum(file.stat().st_size for file in files) < limit


@pytest.mark.parametrize("name", NAMES)
def test_stage_validates_without_a_finding(name):
    assert [str(finding) for finding in fexel.validate(open_stage(name))] == []


@pytest.mark.parametrize("name", NAMES)
def test_readme_names_licence_and_origin(name):
    text = (FOLDER / name / "README.md").read_text(encoding="utf-8")
    assert re.search(r"Apache-2\.0", text)
    assert re.search(r"make\.py|fexel zipmap|fexel pinchmap|fexel umbrella", text)
    if (FOLDER / name / "photos").is_dir():
        assert "CC BY" in text


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("camera", ["Overview", "Detail"])
def test_stage_looks_as_before(golden, renderer, name, camera):
    color = renderer.render(open_stage(name), camera=camera, width=160)["color"]
    # llvmpipe rounds alike everywhere; what may differ is the vector width of the processor: last bits, some edges.
    golden(f"{name}.{camera}", color, mean=0.005, off=0.005, limit=0.4)


@pytest.mark.parametrize("name", ZIPMAPS)
def test_patches_sharpen_the_detail_and_leave_the_overview(renderer, name):
    """Without patches the close-up loses its fine gradients; from far off hardly anything changes."""
    stage = open_stage(name)
    widths = {"Overview": 160, "Detail": 640}  # a close-up in which the root is magnified
    with_patches = {c: renderer.render(stage, camera=c, width=w)["color"] for c, w in widths.items()}
    root = stage.GetPrimAtPath(TEXTURES[name])
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for patch in fexel.ZipmapTexture(root).GetPatches():
            if patch.depth == 1:
                patch.prim.SetActive(False)
    assert len(fexel.ZipmapTexture(root).GetPatches()) == 1
    without = {c: renderer.render(stage, camera=c, width=w)["color"] for c, w in widths.items()}
    assert gradient(with_patches["Detail"]) > 1.5 * gradient(without["Detail"])
    assert np.abs(with_patches["Overview"] - without["Overview"]).mean() < 0.02


def gradient(color: np.ndarray) -> float:
    """Mean absolute step between neighbours: how sharp a picture is."""
    return float(np.abs(np.diff(color[..., :3], axis=0)).mean() + np.abs(np.diff(color[..., :3], axis=1)).mean())


@pytest.fixture(scope="module")
def mandelbrot():
    spec = importlib.util.spec_from_file_location("mandelbrot", FOLDER / "zipmap_deep" / "mandelbrot.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("magnification_log2", [0, 4, 8, 12, 16, 20, 24])
def test_deep_zoom_shows_the_true_set_at_every_magnification(renderer, mandelbrot, magnification_log2):
    """Against the supersampled set itself, at views as wide as one of the textures: only a misplacement can fail.

    A texture of 128 texels fills a view of 32 pixels, so the picture is a minified one and the truth needs no blur.
    """
    from pxr import Gf, UsdGeom

    stage = open_stage("zipmap_deep")
    width = 2.0 / 2**magnification_log2
    s, t = mandelbrot.target_st() if magnification_log2 else (0.5, 0.5)
    center = ((s - 0.5) * 2, (t - 0.5) * 2)
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Cameras/Detail"))
        camera.GetPrim().GetAttribute("xformOp:translate").Set(Gf.Vec3d(*center, width))
        camera.GetClippingRangeAttr().Set(Gf.Vec2f(width / 4, width * 4))
    color = renderer.render(stage, camera="/World/Cameras/Detail", width=32, samples=16)["color"][..., :3]
    c = mandelbrot.TARGET if magnification_log2 else mandelbrot.ROOT_CENTER
    truth = mandelbrot.render(c, 1.5 * width, 32, samples=8)

    def blurred(image):
        return (image[:-1, :-1] + image[1:, :-1] + image[:-1, 1:] + image[1:, 1:]) / 4

    def error(x, y):
        shifted = np.roll(truth, (y, x), axis=(0, 1))
        return float(np.abs(blurred(color) - blurred(shifted))[4:-4, 4:-4].mean())

    assert error(0, 0) < 0.06
    assert error(0, 0) < 0.7 * min(error(1, 0), error(-1, 0), error(0, 1), error(0, -1))
