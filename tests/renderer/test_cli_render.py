"""`fexel render`: options, files, one-line errors."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from fexel.errors import FexelError
from stages import two_camera_stage


@pytest.fixture
def stage_file(tmp_path):
    two_camera_stage(tmp_path / "shot.usda")
    return tmp_path / "shot.usda"


def invoke(*arguments):
    """Run the command in this process; an expected failure is returned as the exception."""
    from fexel_tools.cli import app

    return CliRunner().invoke(app, ["render", *map(str, arguments)])


def run(*arguments):
    result = invoke(*arguments)
    assert result.exit_code == 0, (result.output, result.exception)
    return result


def fails(*arguments) -> str:
    result = invoke(*arguments)
    assert result.exit_code != 0 and isinstance(result.exception, FexelError), (result.output, result.exception)
    assert "\n" not in str(result.exception)
    return str(result.exception)


def pixels(path):
    import OpenImageIO as oiio

    return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)


def test_image_has_the_asked_width_and_the_cameras_aspect(stage_file, tmp_path):
    run(stage_file, tmp_path / "a.png", "-cam", "/World/Cameras/Near", "-w", 64)
    assert pixels(tmp_path / "a.png").shape == (32, 64, 4)


def test_camera_by_path_or_name(stage_file, tmp_path):
    for i, name in enumerate(("/World/Cameras/Far", "Far", "Cameras/Far")):
        run(stage_file, tmp_path / f"{i}.png", "--camera", name, "-w", 32)
    first = pixels(tmp_path / "0.png")
    assert all(np.array_equal(first, pixels(tmp_path / f"{i}.png")) for i in (1, 2))
    run(stage_file, tmp_path / "near.png", "-cam", "Near", "-w", 32)
    assert pixels(tmp_path / "near.png")[..., 3].sum() > 4 * first[..., 3].sum()


def test_frames_go_to_numbered_files_and_move(stage_file, tmp_path):
    run(stage_file, tmp_path / "f.###.exr", "-f", "1:4x3,2", "-w", 64, "-cam", "Near")
    names = sorted(path.name for path in tmp_path.glob("*.exr"))
    assert names == ["f.001.exr", "f.002.exr", "f.004.exr"]
    centres = [np.average(np.arange(64), weights=pixels(tmp_path / name)[..., 3].sum(0)) for name in names]
    assert centres[0] < centres[1] < centres[2]


def test_without_frames_the_start_time_is_rendered_and_d_means_default(stage_file, tmp_path):
    run(stage_file, tmp_path / "start.png", "-w", 64, "-cam", "Near")
    run(stage_file, tmp_path / "one.png", "-w", 64, "-cam", "Near", "--frames", "1")
    run(stage_file, tmp_path / "default.png", "-w", 64, "-cam", "Near", "-d")
    start, one, default = (pixels(tmp_path / f"{name}.png") for name in ("start", "one", "default"))
    assert np.array_equal(start, one) and not np.array_equal(start, default)


def test_aovs_in_one_exr_or_one_png_each(stage_file, tmp_path):
    import OpenImageIO as oiio

    run(stage_file, tmp_path / "a.exr", "-w", 32, "--aov", "color,depth", "--aov", "normal")
    assert set(oiio.ImageBuf(str(tmp_path / "a.exr")).spec().channelnames) == {
        *"RGBA", "depth.Z", "normal.X", "normal.Y", "normal.Z",
    }  # fmt: skip
    run(stage_file, tmp_path / "b.png", "-w", 32, "--aov", "color,depth,primId")
    assert sorted(path.name for path in tmp_path.glob("*.png")) == ["b.depth.png", "b.png", "b.primId.png"]


def test_stats_tell_what_was_done(stage_file, tmp_path):
    run(stage_file, tmp_path / "a.##.png", "-w", 32, "-f", "1:3", "--stats", tmp_path / "stats.json")
    stats = json.loads((tmp_path / "stats.json").read_text())
    assert stats["frames"] == 3 and stats["programs"] == 1 and len(stats["files"]) == 3
    assert {"scene", "visibility", "textures", "color", "write"} <= set(stats["seconds"])
    assert stats["meshBytes"] > 0 and stats["device"]


def test_list_cameras_prints_paths_and_renders_nothing(stage_file):
    result = run(stage_file, "--list-cameras")
    assert result.output.split() == ["/World/Cameras/Near", "/World/Cameras/Far"]


def test_camera_light_and_color_correction(stage_file, tmp_path):
    common = (stage_file, "-w", 32, "-cam", "Near")
    run(*common, tmp_path / "dark.exr", "--disableCameraLight")
    assert not pixels(tmp_path / "dark.exr")[..., :3].any() and pixels(tmp_path / "dark.exr")[..., 3].any()
    run(*common, tmp_path / "linear.png", "-color", "disabled")
    run(*common, tmp_path / "srgb.png", "--colorCorrectionMode", "sRGB")
    run(*common, tmp_path / "own.png")
    linear, srgb, own = (pixels(tmp_path / f"{name}.png") for name in ("linear", "srgb", "own"))
    assert np.array_equal(srgb, own) and srgb[..., 0].sum() > linear[..., 0].sum()


def test_purposes_and_mask(tmp_path):
    from pxr import UsdGeom

    stage = two_camera_stage(tmp_path / "shot.usda")
    guide = UsdGeom.Cube.Define(stage, "/World/Guide")
    guide.AddTranslateOp().Set((-1.5, 0, 0))
    guide.CreatePurposeAttr("guide")
    other = UsdGeom.Cube.Define(stage, "/World/Other")
    other.AddTranslateOp().Set((2.5, 0, 0))
    stage.Save()
    counts = {}
    for name, options in {
        "plain": (),
        "guide": ("--purposes", "guide"),
        "masked": ("--mask", "/World/Other"),
        "both": ("--mask", "/World/Other,/World/Cube"),
    }.items():
        run(tmp_path / "shot.usda", tmp_path / f"{name}.exr", "-w", 64, "-cam", "Far", "--aov", "alpha", *options)
        counts[name] = pixels(tmp_path / f"{name}.exr").sum()
    assert counts["guide"] > counts["plain"] > counts["masked"] > 0
    assert counts["both"] == counts["plain"]


def test_session_layer_is_over_the_stage(stage_file, tmp_path):
    session = tmp_path / "session.usda"
    session.write_text('#usda 1.0\nover "World" {\n  over "Cube" (active = false) {\n  }\n}\n')
    with pytest.warns(match="nothing to draw"):
        run(stage_file, tmp_path / "a.exr", "-w", 32, "--sessionLayer", session)
    assert not pixels(tmp_path / "a.exr").any()


SETTINGS = """#usda 1.0
(
    subLayers = [@./shot.usda@]
    renderSettingsPrimPath = "/Render/Default"
)
def Scope "Render" {
    def RenderSettings "Default" {
        int2 resolution = (40, 30)
        rel camera = </World/Cameras/Far>
        rel products = </Render/Product>
    }
    def RenderSettings "Small" {
        int2 resolution = (8, 4)
        token aspectRatioConformPolicy = "cropAperture"
        rel camera = </World/Cameras/Near>
    }
    def RenderProduct "Product" {
        token productName = "PRODUCT"
        int2 resolution = (20, 10)
        rel orderedVars = [</Render/Color>, </Render/Depth>, </Render/Strange>]
    }
    def RenderVar "Color" { string sourceName = "color" }
    def RenderVar "Depth" { string sourceName = "depth" }
    def RenderVar "Strange" { string sourceName = "lpe:C<RD>" }
}
"""


def test_render_settings_give_camera_resolution_vars_and_products(stage_file, tmp_path):
    file = tmp_path / "settings.usda"
    file.write_text(
        SETTINGS.replace("PRODUCT", str(tmp_path / "product.exr")).replace(" { ", " {\n").replace(" }\n", "\n}\n")
    )
    with pytest.warns(match="lpe"):
        run(file, tmp_path / "a.exr")
    assert pixels(tmp_path / "a.exr").shape == (30, 40, 5) and pixels(tmp_path / "product.exr").shape == (10, 20, 5)
    run(file, tmp_path / "b.png", "-rs", "/Render/Small")
    assert pixels(tmp_path / "b.png").shape == (4, 8, 4)
    run(file, tmp_path / "c.png", "-rs", "/Render/Small", "-w", 16)
    assert pixels(tmp_path / "c.png").shape == (8, 16, 4)
    assert "/Render/Small" in fails(file, tmp_path / "d.png", "-rs", "/World/Cube")
    assert "/nowhere" in fails(file, tmp_path / "d.png", "-rs", "/nowhere")
    assert "not the absolute path" in fails(file, tmp_path / "d.png", "-rs", "a b;")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--camera", "/World/Nope"), "/World/Cameras/Near"),
        (("--camera", 'Near"; drop'), "/World/Cameras/Near"),
        (("--frames", "1:3"), "placeholder"),
        (("--frames", "1:x"), "FrameSpec"),
        (("--frames", "1", "-d"), "exclude"),
        (("--aov", "colour"), "unknown AOV 'colour'; valid are color"),
        (("--samples", "0"), "samples"),
        (("-w", "0"), "width"),
        (("--complexity", "extreme"), "low"),
        (("--purposes", "secret"), "secret"),
        (("--mask", "/World/Nope"), "/World/Nope"),
        (("-color", "srgb"), "disabled sRGB openColorIO"),
        (("--textureMemory", "0"), "texture memory"),
        (("--sessionLayer", "/no/such.usda"), "/no/such.usda"),
    ],
)
def test_bad_options_are_one_line_and_write_nothing(stage_file, tmp_path, options, message):
    assert message in fails(stage_file, tmp_path / "a.png", *options)
    assert not list(tmp_path.glob("*.png"))


def test_bad_files_are_one_line(stage_file, tmp_path):
    broken = tmp_path / "broken.usda"
    broken.write_text("#usda 1.0\ndef Xform {{{\n")
    assert "missing.usda" in fails(tmp_path / "missing.usda", tmp_path / "a.png")
    assert "broken.usda" in fails(broken, tmp_path / "a.png")
    assert "a.xyz" in fails(stage_file, tmp_path / "a.xyz")
    assert "does not exist" in fails(stage_file, tmp_path / "no" / "a.png")
    assert "placeholder" in fails(stage_file, tmp_path / "a.##.png")
    assert "stats.json" in fails(stage_file, tmp_path / "a.png", "-w", 4, "--stats", tmp_path / "no" / "stats.json")
    assert not (tmp_path / "a.png").exists(), "found out before rendering"


def test_missing_image_is_a_usage_error(stage_file):
    result = invoke(stage_file)
    assert result.exit_code == 2


def test_interruption_keeps_the_frames_written_and_exits_130(stage_file, tmp_path):
    code = (
        "import sys\n"
        "from fexel.renderer import record\n"
        "write = record.write_images\n"
        "def stop(path, *rest):\n"
        "    if '003' in str(path):\n"
        "        raise KeyboardInterrupt\n"
        "    return write(path, *rest)\n"
        "record.write_images = stop\n"
        "from fexel_tools.cli import main\n"
        f"sys.argv = ['fexel', 'render', {str(stage_file)!r}, {str(tmp_path / 'f.###.png')!r}]\n"
        "sys.argv += ['-f', '1:9', '-w', '16']\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 130, done.stderr
    assert done.stderr.strip().splitlines() == ["fexel: interrupted"] and done.stdout == ""
    assert sorted(path.name for path in tmp_path.glob("f.*")) == ["f.001.png", "f.002.png"]


def test_nothing_is_printed_on_a_pipe(stage_file, tmp_path):
    command = [sys.executable, "-m", "fexel_tools.cli", "render", str(stage_file), str(tmp_path / "a.png"), "-w", "8"]
    code = "import sys; from fexel_tools.cli import main; sys.argv = sys.argv[1:]; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "fexel", *command[3:]], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "") and (tmp_path / "a.png").exists()


def test_stage_without_camera_is_framed(tmp_path):
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(tmp_path / "bare.usda"))
    stage.SetDefaultPrim(UsdGeom.Sphere.Define(stage, "/Ball").GetPrim())
    stage.Save()
    run(tmp_path / "bare.usda", tmp_path / "a.exr", "-w", 64, "--aov", "alpha")
    alpha = pixels(tmp_path / "a.exr")[..., 0]
    assert (
        alpha[alpha.shape[0] // 2, 32] == 1
        and 0.05 < alpha.mean() < 0.95
        and not alpha[0].any()
        and not alpha[:, 0].any()
    )


def test_empty_stage_gives_a_transparent_image_and_a_warning(tmp_path):
    from pxr import Usd

    Usd.Stage.CreateNew(str(tmp_path / "empty.usda")).Save()
    with pytest.warns(match="nothing to draw"):
        run(tmp_path / "empty.usda", tmp_path / "a.png", "-w", 8)
    assert not pixels(tmp_path / "a.png").any()
