"""A stage with zipmaps, pinchmaps or umbrellas imports into Blender and shows its fallback image there."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

import fexel
from fexel_tools.minify import MinifyOptions, minify

REPOSITORY = Path(__file__).resolve().parents[2]
STAGES = sorted(p for p in (REPOSITORY / "stages").glob("*/*.usd*") if p.stem == p.parent.name)
IDS = [path.stem for path in STAGES]


def import_into_blender(python: Path, stage: Path, folder: Path, mesh: str = "") -> tuple[dict, np.ndarray]:
    """Report of `blender_probe` and the rendered albedo of a mesh, or all, (32, 32, 3) float32, linear."""
    albedo = folder / "albedo.exr"
    script = Path(__file__).with_name("blender_probe.py")
    done = subprocess.run(
        [str(python), str(script), str(stage), str(albedo), mesh],
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith("REPORT ")]
    assert done.returncode == 0, done.stderr
    assert lines, done.stdout + done.stderr
    return json.loads(lines[-1].removeprefix("REPORT ")), read_diffuse_colour(albedo)


def read_diffuse_colour(path: Path) -> np.ndarray:
    image_io = pytest.importorskip("OpenImageIO")
    image = image_io.ImageInput.open(str(path))
    try:
        subimage = 0
        while image.seek_subimage(subimage, 0):
            names = list(image.spec().channelnames)
            wanted = [
                i for end in "RGB" for i, name in enumerate(names) if name.split(".")[-2:] == ["Diffuse Color", end]
            ]
            if len(wanted) == 3:
                return image.read_image(subimage, 0, 0, len(names), "float")[..., wanted]
            subimage += 1
    finally:
        image.close()
    raise AssertionError(f"{path}: no diffuse colour pass")


def base_color_images(report: dict) -> dict[str, str]:
    """Image file that feeds Base Color, per material name."""
    return {
        name: link["image"]
        for name, material in report["materials"].items()
        for link in material["links"]
        if link["input"] == "Base Color" and link["from"] == "ShaderNodeTexImage"
    }


def normal_map_images(report: dict) -> dict[str, str]:
    """Image file that feeds a normal map, per material name."""
    return {
        name: link["image"]
        for name, material in report["materials"].items()
        for link in material["links"]
        if link["to"] == "ShaderNodeNormalMap" and link["from"] == "ShaderNodeTexImage"
    }


def shrunk(path: Path, width: int, height: int) -> np.ndarray:
    """Area averages of an sRGB image, (height, width, 3), linear."""
    cv2 = pytest.importorskip("cv2")
    image_io = pytest.importorskip("OpenImageIO")
    encoded = image_io.ImageBuf(str(path)).get_pixels(image_io.FLOAT)[..., :3]
    return cv2.resize(srgb_to_linear(encoded), (width, height), interpolation=cv2.INTER_AREA)


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def test_hand_written_stage_shows_its_fallback_in_blender(blender_python, hand_written_stage, tmp_path):
    report, albedo = import_into_blender(blender_python, hand_written_stage, tmp_path)
    fallback = str(hand_written_stage.parent / "textures" / "fallback.png")
    assert base_color_images(report) == {"Photo": fallback}
    assert report["meshes"] == {"Wall": ["Photo"]}
    check_green_with_a_blue_centre(albedo)


def test_hand_written_umbrellas_show_their_fallback_in_blender(blender_python, hand_written_ground, tmp_path):
    """Beside patches and levels, of types that Blender does not know, in a layer of their own."""
    report, albedo = import_into_blender(blender_python, hand_written_ground, tmp_path)
    fallback = str(hand_written_ground.parent / "textures" / "fallback.png")
    assert base_color_images(report) == {"Leaves": fallback}
    assert report["meshes"] == {"Ground": ["Leaves"]}
    check_green_with_a_blue_centre(albedo)


def check_green_with_a_blue_centre(albedo: np.ndarray) -> None:
    """Where the root's file is red: a wrong file or an unbound material cannot pass."""
    # Blender's albedo of a Principled BSDF is the base colour to about 2 %.
    np.testing.assert_allclose(
        albedo[2:6, 2:6].mean((0, 1)),
        srgb_to_linear(np.array([40, 160, 60]) / 255),
        atol=0.02,
    )
    np.testing.assert_allclose(
        albedo[15:17, 15:17].mean((0, 1)),
        srgb_to_linear(np.array([40, 40, 200]) / 255),
        atol=0.02,
    )


@pytest.mark.parametrize("stage", STAGES, ids=IDS)
def test_example_stage_shows_its_fallback_in_blender(blender_python, stage, tmp_path):
    report, albedo = import_into_blender(blender_python, stage, tmp_path, GROUNDS.get(stage.stem, ""))
    images = base_color_images(report) | normal_map_images(report)
    bound = {name for names in report["meshes"].values() for name in names}
    assert images.keys() & bound, "no mesh has a material whose Base Color or Normal is an image"
    assert any(Path(path).stem == PLAIN.get(stage.stem, "fallback") for path in images.values())
    for path in images.values():
        assert Path(path).is_file()
        assert min(report["images"][path]) > 0, f"{path} was not loaded"
    for path in normal_map_images(report).values():
        assert report["color_spaces"][path] == "Non-Color"
    assert np.isfinite(albedo).all()
    magenta = (albedo[..., 0] > 0.95) & (albedo[..., 1] < 0.05) & (albedo[..., 2] > 0.95)
    assert not magenta.any(), "Blender draws a missing image in magenta"
    seen = albedo[albedo.sum(-1) > 0]
    assert len(seen) > 100
    if base_color_images(report).keys() & bound:
        assert seen.std(0).max() > 0.01, "the picture is flat"
    if stage.stem in PICTURES:
        check_picture(albedo, stage)


# Grounds that go on as far as the horizon: the mesh to look at.
GROUNDS = dict.fromkeys(("umbrella_citrus", "umbrella_flowers", "umbrella_leaves", "umbrella_sweets"), "Surface")
GROUNDS["fipmap_anamorphosis"] = "Painting"

# Stages of plain textures: the image.
PLAIN = {"fipmap_anamorphosis": "ambassadors", "fipmap_floor": "chart"}

# Stages of a rectangle, seen from the front or above: fallback image, and rows of its 32 pixels.
PICTURES = {
    "fipmap_anamorphosis": ("textures/ambassadors.jpg", 32),
    "pinchmap_lines": ("textures/boat/fallback.png", 24),
    "pinchmap_in_zipmap": ("textures/fallback.jpg", 32),
    "umbrella_in_zipmap": ("textures/fallback.jpg", 32),
    "umbrella_leaves": ("umbrella_leaves_textures/fallback.png", 16),
}


def check_picture(albedo: np.ndarray, stage: Path) -> None:
    """Blender's albedo is the fallback image: sharp shapes, ink, logos, each in its place."""
    file, rows = PICTURES[stage.stem]
    picture = shrunk(stage.parent / file, 32, rows)
    top = (32 - rows) // 2
    error = np.abs(albedo[top : top + rows] - picture)[1:-1, 1:-1]
    # Cycles' pixel filter reaches into the neighbours, 16 samples scatter; a shift by one pixel gives twice the error.
    shifted = np.abs(albedo[top : top + rows] - np.roll(picture, 1, axis=1))[1:-1, 1:-1]
    assert error.mean() < 0.03
    assert error.mean() < 0.7 * shifted.mean()


def test_stage_exported_by_blender_takes_a_filter_and_imports_as_before(blender_python, tmp_path):
    image = REPOSITORY / "stages" / "fipmap_floor" / "textures" / "chart.png"
    exported, minified = tmp_path / "exported.usda", tmp_path / "minified.usda"
    script = Path(__file__).with_name("blender_export.py")
    command = [str(blender_python), str(script), str(image), str(exported)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=180, check=False)
    assert done.returncode == 0, done.stderr
    textures = minify(exported, minified, MinifyOptions(filter="fipmap", contrast=0.9)).textures
    assert sorted((t.prim, t.filter, t.note) for t in textures) == [
        ("/root/_materials/Paint/Image_Texture", "fipmap", ""),
        ("/root/_materials/Tiles/Image_Texture", "fipmap", ""),
    ]
    assert [str(finding) for finding in fexel.validate(Usd.Stage.Open(str(minified)))] == []
    (report, albedo), (before, expected) = (
        import_into_blender(blender_python, s, tmp_path) for s in (minified, exported)
    )
    assert base_color_images(report) == base_color_images(before) == {"Paint": str(image), "Tiles": str(image)}
    assert report["meshes"] == before["meshes"]
    np.testing.assert_allclose(albedo, expected, atol=1e-3)


def test_transparent_part_of_a_pinchmap_is_transparent_in_blender(blender_python, tmp_path):
    """Bricks show around the sign."""
    stage = REPOSITORY / "stages" / "pinchmap_sign" / "pinchmap_sign.usda"
    report, albedo = import_into_blender(blender_python, stage, tmp_path)
    alpha = [link for link in report["materials"]["Sign"]["links"] if link["input"] == "Alpha"]
    assert [Path(link["image"]).name for link in alpha] == ["fallback.png"]
    yellow = srgb_to_linear(np.array([247, 181, 0]) / 255)
    is_sign = np.abs(albedo - yellow).max(-1) < 0.1
    assert is_sign[9:23, 10:24].mean() > 0.3
    # One pixel of the square that carries the sign lies outside of its board on every side. Bricks are seen there; the
    # colour under the transparent texels is the board's yellow.
    assert not is_sign[:, :9].any() and not is_sign[:, 25:].any()
