"""`fexel pinchmap`: an image or SVG in, a stage out; whatever cannot be used is named in one line."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd
from typer.testing import CliRunner

import fexel
from fexel.errors import FexelError
from fexel.images import image_info, read_linear, read_pixels
from fexel.textures.pinchmap_encoding import decode_texels
from fexel.textures.pinchmap_twin import sample_pinchmap
from fexel.validators import validate_file
from fexel_tools.cli import app
from fexel_tools.image_files import write_image
from fexel_tools.pinchmap import make_pinchmap
from fexel_tools.pinchmap_folder import make_pinchmaps
from fexel_tools.pinchmap_options import PinchmapOptions, map_shape, parse_color
from fexel_tools.pinchmap_stage import TEXTURE_PATH

REPORT_KEYS = ["file", "size", "bytes", "iou", "mismatch", "mean_px", "max_px", "psnr_db", "seconds"]
DROP = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 60 40">'
    '<ellipse cx="31" cy="20" rx="21" ry="12" fill="{}" transform="rotate(9 30 20)"/></svg>'
)


def run(*arguments):
    return CliRunner().invoke(app, ["pinchmap", *map(str, arguments)])


def failure(*arguments):
    """The one line that the command ends with."""
    result = run(*arguments)
    assert isinstance(result.exception, FexelError), result.output
    message = str(result.exception)
    assert "\n" not in message
    return message


def blob(height=90, width=120, dtype=np.uint8):
    """RGBA: a two-coloured blob with an anti-aliased edge on nothing."""
    y, x = np.indices((height, width)) + 0.5
    radius = np.hypot((y - 0.52 * height) / (0.36 * height), (x - 0.47 * width) / (0.4 * width))
    alpha = np.clip((1 - radius) * 0.3 * height + 0.5, 0, 1)
    rgb = np.dstack([0.2 + 0.6 * x / width, 0.7 - 0.5 * y / height, np.full_like(x, 0.3)])
    image = np.dstack([rgb, alpha])
    return image.astype(np.float32) if dtype == np.float32 else np.rint(image * np.iinfo(dtype).max).astype(dtype)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current directory, with a drawing and an image."""
    monkeypatch.chdir(tmp_path)
    Path("drop.svg").write_text(DROP.format("#c02040"))
    write_image("blob.png", blob())
    return tmp_path


def digests(folder):
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(Path(folder).rglob("*")) if p.is_file()}


def opened(path):
    """Stage and texture; the one must be kept for the other to live."""
    stage = Usd.Stage.Open(str(path))
    return stage, fexel.PinchmapTexture(stage.GetPrimAtPath(TEXTURE_PATH))


def files(folder="."):
    return sorted(str(p) for p in Path(folder).iterdir())


@pytest.mark.parametrize("source", ["drop.svg", "blob.png"])
def test_a_file_becomes_a_stage_that_shows_it(folder, source):
    result = run(source, "-o", "out.usda", "--size", "12", "--report", "out.json", "--sheet", "out.png")
    assert result.exit_code == 0, result.output
    assert result.output.startswith(f"{source}: 12 x ")
    assert validate_file("out.usda") == []
    item = json.loads(Path("out.json").read_text())["items"][0]
    assert item["iou"] > 0.98 and item["mismatch"] < 0.01
    assert item["psnr_db"] > 20
    _stage, prim = opened("out.usda")
    picture = read_linear(str(prim.GetPrim().GetChild("Fallback").GetAttribute("inputs:file").Get().resolvedPath))
    corner, middle = picture[0, 0], picture[picture.shape[0] // 2, picture.shape[1] // 2]
    assert corner[3] == 0 and middle[3] == 1
    assert image_info("out.png").width > 1000


def test_files_hold_what_the_report_says(folder):
    """The texels on disk, looked up through the matrix by the twin, are the source again."""
    run("blob.png", "-o", "out.usda", "--size", "16", "--signalSize", "32", "--report", "out.json")
    _stage, prim = opened("out.usda")
    pinchmap = decode_texels(read_pixels(image_info(prim.GetPinchmapAttr().Get().resolvedPath)))
    signal = read_linear(prim.GetFileAttr().Get().resolvedPath, "sRGB")
    item = json.loads(Path("out.json").read_text())["items"][0]
    assert (item["pinchmap"], item["signal"]) == ([16, 12], [32, 24])
    assert pinchmap.shape == (12, 16, 4) and signal.shape == (24, 32, 4)
    assert item["bytes"] == pinchmap.size + signal.size
    truth = read_linear("blob.png")
    height, width = truth.shape[:2]
    st = np.stack(np.meshgrid((np.arange(width) + 0.5) / width, 1 - (np.arange(height) + 0.5) / height), axis=-1)
    matrix = np.array(prim.GetMatrixAttr().Get())
    st = np.c_[st.reshape(-1, 2), np.ones(width * height)] @ matrix
    jacobian = np.diag([matrix[0, 0] / width, -matrix[1, 1] / height])
    picture = sample_pinchmap(pinchmap, signal.astype(float), st[:, :2], jacobian).reshape(truth.shape)
    wrong = (picture[..., 3] > 0.5) != (truth[..., 3] > 0.5)
    assert wrong.mean() == pytest.approx(item["mismatch"], abs=2e-3)  # transparency, not side
    assert np.abs(picture - truth).mean() < 0.02


def test_report_has_the_keys_in_order(folder):
    run("drop.svg", "blob.png", "-o", "out/", "--size", "12", "--report", "out.json", "--jobs", "1")
    report = json.loads(Path("out.json").read_text())
    assert list(report) == ["items", "failed"]
    assert [item["file"] for item in report["items"]] == ["drop.svg", "blob.png"]
    for item in report["items"]:
        assert list(item)[: len(REPORT_KEYS)] == REPORT_KEYS
        assert all(isinstance(item[key], (int, float)) for key in REPORT_KEYS[1:])
        authoring = [s for name, s in item["phases"].items() if name not in ("measure", "compile")]
        assert sum(authoring) == pytest.approx(item["seconds"], abs=0.001)


def test_same_seed_gives_the_same_bytes(folder):
    for name in ("a", "b"):
        Path(name).mkdir()
        assert run("drop.svg", "-o", f"{name}/x.usda", "--size", "16", "--seed", "3").exit_code == 0
    assert digests("a") == digests("b")
    assert len(digests("a")) == 4


def test_many_files_make_a_folder_and_a_bad_one_spoils_nothing(folder):
    """In processes of their own; the same bytes as one after the other."""
    Path("bad.png").write_bytes(Path("blob.png").read_bytes()[:200])
    Path("sub").mkdir()
    Path("sub/drop.svg").write_text(DROP.format("teal"))
    given = ["drop.svg", "bad.png", "missing.svg", "sub/drop.svg", "blob.png"]
    result = run(*given, "-o", "icons/", "--size", "12", "--jobs", "2", "--report", "icons.json")
    message = str(result.exception)
    assert isinstance(result.exception, FexelError)
    assert message == "2 of 5 files could not be made: bad.png, missing.svg"
    names = [Path(p).name for p in files("icons")]
    stages = ["blob.usda", "drop.usda", "drop_2.usda"]
    assert names == sorted([*stages, *(f"{Path(s).stem}_textures" for s in stages), "contact_sheet.png"])
    report = json.loads(Path("icons.json").read_text())
    assert [item["file"] for item in report["items"]] == ["drop.svg", "sub/drop.svg", "blob.png"]
    assert [failed["file"] for failed in report["failed"]] == ["bad.png", "missing.svg"]
    assert all(failed["error"].startswith(failed["file"]) for failed in report["failed"])
    one = make_pinchmaps(given, "one", PinchmapOptions(size=12), jobs=1)
    assert len(one.items) == 3
    assert digests("one") == digests("icons")


class Lethal(str):
    """A file name that ends the process that receives it, as a crash in a decoder would."""

    __slots__ = ()

    def __reduce__(self):
        return os._exit, (3,)


def test_file_that_kills_its_process_takes_no_other_with_it(folder):
    result = make_pinchmaps(["drop.svg", Lethal("lethal.png")], "icons", PinchmapOptions(size=8), jobs=2)
    assert [item.file for item in result.items] == ["drop.svg"]
    assert result.failed == (("lethal.png", "lethal.png: the process that read it ended unexpectedly"),)


def test_folder_of_nothing_but_failures_is_not_left_behind(folder):
    Path("bad.svg").write_text("<svg")
    assert "2 of 2" in failure("bad.svg", "missing.png", "-o", "icons/", "--jobs", "1")
    assert not Path("icons").exists()


def test_contact_sheet_that_nobody_named_replaces_no_input(folder):
    """A picture of that name, and the sheet of an earlier run among the files of the next."""
    Path("cs").mkdir()
    write_image("cs/a.png", blob())
    write_image("cs/contact_sheet.png", blob())
    before = digests(".")
    message = failure("cs/a.png", "cs/contact_sheet.png", "-o", "cs/", "--size", "8", "--jobs", "1")
    assert message.startswith("cs/contact_sheet.png: would be replaced by the contact sheet, expected a --sheet")
    assert failure("cs/a.png", "-o", "cs/", "--mask", "cs/contact_sheet.png").startswith("cs/contact_sheet.png: ")
    assert digests(".") == before
    elsewhere = run("cs/a.png", "cs/contact_sheet.png", "-o", "cs/", "--size", "8", "--jobs", "1", "--sheet", "s.png")
    assert elsewhere.exit_code == 0
    assert digests("cs")["contact_sheet.png"] == before["contact_sheet.png"]


def test_report_replaces_no_stage_of_the_folder(folder):
    Path("icons").mkdir()
    assert failure("drop.svg", "-o", "icons/", "--report", "icons/drop.usda").startswith("icons/drop.usda: is an input")


def test_one_file_into_a_folder(folder):
    assert run("drop.svg", "-o", "icons/", "--size", "8").exit_code == 0
    assert files("icons") == ["icons/contact_sheet.png", "icons/drop.usda", "icons/drop_textures"]


def test_auto_takes_the_smallest_size_that_meets_the_tolerance(folder):
    assert (
        run("drop.svg", "-o", "a.usda", "--size", "auto", "--tolerance", "0.004", "--report", "a.json").exit_code == 0
    )
    item = json.loads(Path("a.json").read_text())["items"][0]
    assert item["mismatch"] <= 0.004
    run("drop.svg", "-o", "b.usda", "--size", str(item["size"] - 1), "--report", "b.json")
    assert json.loads(Path("b.json").read_text())["items"][0]["mismatch"] > 0.004


def test_auto_that_cannot_be_met_says_how_near_it_came(folder):
    noise = np.random.default_rng(1).integers(0, 2, (64, 64, 1), np.uint8) * np.uint8(255)
    write_image("noise.png", np.repeat(noise, 4, axis=2))
    message = failure("noise.png", "-o", "a.usda", "--size", "auto", "--tolerance", "0.0001")
    assert message.startswith("noise.png: ")
    assert not Path("a.usda").exists()


STROKES = '<path d="M4 4V60M8 27.4H56M8 30.6H56" stroke="black" stroke-width="2.2"/><path d="M4 4h8v4H4z"/>'


def test_places_that_the_map_cannot_express_are_told_with_a_size_that_helps(folder):
    """Two strokes nearer to each other than a texel."""
    Path("strokes.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 64 64">{STROKES}</svg>')
    result = run("strokes.svg", "-o", "out.usda", "--size", "16", "--report", "r.json", "--sheet", "s.png")
    item = json.loads(Path("r.json").read_text())["items"][0]
    wrong = sum(fault["pixels"] for fault in item["faults"])
    assert wrong > 0.5 * item["mismatch"] * np.prod(item["source"])
    for fault in item["faults"]:
        assert list(fault) == ["x", "y", "reason", "pixels"]
        assert 0 <= fault["x"] <= 1024 and 0 <= fault["y"] <= 1024
    assert 350 < item["faults"][0]["y"] < 580, "the worst place is where the strokes are"
    assert f"--size {item['suggested_size']} would help" in result.output
    assert f"{item['faults'][0]['reason']} at pixel (" in result.output
    run("strokes.svg", "-o", "out.usda", "--size", item["suggested_size"], "--report", "r.json")
    better = json.loads(Path("r.json").read_text())["items"][0]
    assert sum(fault["pixels"] for fault in better["faults"]) < 0.25 * wrong


def test_largest_map_of_a_narrow_picture(folder):
    """As wide as sources may be, so that the image that is fitted is as wide as it can become."""
    image = np.full((24, 4096, 4), 255, np.uint8)
    image[:11, :, 3] = 0
    write_image("narrow.png", image)
    result = run("narrow.png", "-o", "out.usda", "--size", "2048")
    assert result.exit_code == 0, result.exception
    assert result.output.startswith("narrow.png: 2048 x 12, ")


def test_progress_goes_forward(folder):
    steps = []

    def watch(step, done, _total):
        if step == "pinchmap":
            steps.append(done)

    make_pinchmap("drop.svg", "out.usda", PinchmapOptions(size=8), progress=watch)
    assert steps == sorted(steps) and len(steps) == len(set(steps)) and steps[-1] == 7


def test_colours_that_stay_soft_are_told(folder):
    """An opaque checkerboard with a transparent margin: its outline alone says nothing of the colours inside."""
    y, x = np.indices((96, 96)) // 8
    image = np.zeros((96, 96, 4), np.uint8)
    image[..., :3] = (((x + y) % 2) * 255)[..., None]
    image[8:-8, 8:-8, 3] = 255
    write_image("board.png", image)
    told = run("board.png", "-o", "out.usda", "--size", "16", "--report", "r.json")
    assert "--regions auto may draw edges" in told.output
    item = json.loads(Path("r.json").read_text())["items"][0]
    assert item["psnr_db"] < item["plain_psnr_db"] + 2
    assert "--regions auto" not in run("drop.svg", "-o", "out.usda", "--size", "16", "--report", "r.json").output


def test_options_reach_the_prim(folder):
    result = run(
        "blob.png", "-o", "out.usdc", "--size", "8", "--bits", "16", "--antialias", "2", "--lineWidth", "0.4",
        "--lineColor", "#ff0000", "--wrap", "repeat,clamp", "--drives", "emissiveColor",
    )  # fmt: skip
    assert result.exit_code == 0, result.exception
    stage, prim = opened("out.usdc")
    assert prim.GetAntialiasAttr().Get() == 2.0
    assert prim.GetLineWidthAttr().Get() == pytest.approx(0.4)
    assert prim.GetLineColorAttr().Get() == Gf.Vec4f(1, 0, 0, 1)
    assert (prim.GetWrapSAttr().Get(), prim.GetWrapTAttr().Get()) == ("repeat", "clamp")
    assert image_info(prim.GetPinchmapAttr().Get().resolvedPath).dtype == "uint16"
    emission = stage.GetPrimAtPath("/World/Materials/Pinchmap/Surface").GetAttribute("inputs:emissiveColor")
    assert emission.GetConnections() == [f"{TEXTURE_PATH}.outputs:rgb"]


def test_normal_map_is_kept_raw(folder):
    height, width = 64, 64
    x = np.linspace(-1, 1, width)[None, :].repeat(height, axis=0)
    normals = np.dstack([0.4 * np.sign(x) * (1 - np.abs(x)), 0 * x, 0 * x])
    normals[..., 2] = np.sqrt(1 - normals[..., 0] ** 2)
    write_image("crease.png", np.rint((normals * 0.5 + 0.5) * 255).astype(np.uint8), "raw")
    write_image("side.png", np.where(x > 0, 255, 0).astype(np.uint8)[..., None], "raw")
    result = run("crease.png", "-o", "out.usda", "--size", "8", "--normal", "--mask", "side.png")
    assert result.exit_code == 0, result.exception
    assert validate_file("out.usda") == []
    _stage, prim = opened("out.usda")
    texture = prim.GetPrim()
    assert texture.GetAttribute("inputs:sourceColorSpace").Get() == "raw"
    assert texture.GetAttribute("inputs:bias").Get() == Gf.Vec4f(-1, -1, -1, 0)
    shown = read_pixels(image_info(texture.GetChild("Fallback").GetAttribute("inputs:file").Get().resolvedPath))
    row = shown[shown.shape[0] // 2, :, 0].astype(int)
    assert np.abs(np.diff(row)).max() > 80, "the crease is a step"
    assert np.abs(np.diff(row) > 60).sum() == 1


@pytest.mark.parametrize(("dtype", "suffix", "bits"), [(np.uint16, "png", "uint16"), (np.float32, "exr", "float16")])
def test_signal_has_the_bits_of_the_source(folder, dtype, suffix, bits):
    image = blob(dtype=dtype)
    if dtype == np.float32:
        image[..., :3] *= image[..., 3:]
    write_image(f"deep.{suffix}", image, "raw" if suffix == "exr" else "sRGB")
    assert run(f"deep.{suffix}", "-o", "out.usda", "--size", "8", "--bits", "float").exit_code == 0
    _stage, prim = opened("out.usda")
    assert image_info(prim.GetFileAttr().Get().resolvedPath).dtype == bits
    assert image_info(prim.GetPinchmapAttr().Get().resolvedPath).dtype == "float32"
    assert validate_file("out.usda") == []


@pytest.mark.parametrize("place", [(300, 400), (0, 0), (1023, 1023), (0, 1023)])
def test_one_pixel_in_a_large_picture_is_kept(folder, place):
    """The map covers it alone; that must not blow up what is fitted to its size over a pixel."""
    image = np.zeros((1024, 1024, 4), np.uint8)
    image[place] = 255
    write_image("pixel.png", image)
    assert run("pixel.png", "-o", "out.usda", "--size", "16", "--report", "r.json").exit_code == 0
    item = json.loads(Path("r.json").read_text())["items"][0]
    assert item["mismatch"] == 0.0 and item["iou"] == 1.0


@pytest.mark.parametrize("shape", [(1, 200), (200, 3), (7, 5), (37, 53)])
def test_any_size_of_image(folder, shape):
    image = np.zeros((*shape, 4), np.uint8)
    image[..., 1] = 255
    image[: -(-shape[0] // 2), : -(-shape[1] // 2), 3] = 255
    write_image("odd.png", image)
    assert run("odd.png", "-o", "out.usda", "--size", "16", "--report", "r.json", "--sheet", "s.png").exit_code == 0
    columns, rows = json.loads(Path("r.json").read_text())["items"][0]["pinchmap"]
    assert (rows, columns) == map_shape(shape[1], shape[0], 16) and min(rows, columns) >= 4
    assert validate_file("out.usda") == []


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["missing.svg"], "missing.svg: no such file"),
        (["."], ".: is a folder, expected an image or SVG"),
        (["drop.svg", "-o", "out.usdz"], "out.usdz: output is '.usdz', expected one of .usda, .usdc, .usd (textures"),
        (["drop.svg", "-o", "out.png"], "out.png: output is '.png'"),
        (["drop.svg", "-o", "nowhere/out.usda"], "nowhere/out.usda: the folder nowhere does not exist"),
        (["drop.svg", "blob.png", "-o", "out.usda"], "out.usda: 2 files make as many stages, expected a folder"),
        (["drop.svg", "blob.png", "-o", "blob.png"], "blob.png: is a file, expected a folder"),
        (["drop.svg", "--size", "3"], "--size: 3, expected 4 to 2048 texels, or auto"),
        (["drop.svg", "--size", "4096"], "--size: 4096, expected 4 to 2048 texels, or auto"),
        (["drop.svg", "--size", "big"], "--size: 'big', expected a number of texels, or auto"),
        (["drop.svg", "--size", "auto", "--tolerance", "0"], "--tolerance: 0.0, expected a share"),
        (["drop.svg", "--signalSize", "100"], "--signalSize: 100, expected --size times a power of two: 32, 64"),
        (["drop.svg", "--signalSize", "16"], "--signalSize: 16, expected --size times a power of two"),
        (["drop.svg", "--regions", "some"], "--regions: 'some', expected auto, a number, or an image of labels"),
        (["drop.svg", "--regions", "\u00b2"], "--regions: '\u00b2', expected auto, a number, or an image of labels"),
        (["drop.svg", "--mask", "nothing.png"], "--mask: nothing.png: no such file"),
        (["blob.png", "--mask", "blob.png", "--regions", "auto"], "--mask: says which side"),
        (["drop.svg", "--bits", "12"], "--bits: 12, expected one of 8, 16, float"),
        (["drop.svg", "--wrap", "wild"], "--wrap: 'wild', expected one or two of clamp, repeat, mirror"),
        (["drop.svg", "--wrap", "clamp,clamp,clamp"], "--wrap: 'clamp,clamp,clamp'"),
        (["drop.svg", "--antialias", "-1"], "--antialias: -1.0, expected a number that is not negative"),
        (["drop.svg", "--lineWidth", "nan"], "--lineWidth: nan, expected a number that is not negative"),
        (["drop.svg", "--lineColor", "blue"], "--lineColor: 'blue', expected r,g,b[,a] (linear) or #rrggbb[aa] (sRGB)"),
        (["drop.svg", "--lineColor", "1,0,0,2"], "--lineColor: '1,0,0,2', expected"),
        (["drop.svg", "--drives", "colour"], "--drives: 'colour' is unknown, expected one of diffuseColor,"),
        (["drop.svg", "--raw", "--drives", "diffuseColor"], "--raw: data cannot drive diffuseColor"),
        (["drop.svg", "--normal", "--drives", "roughness"], "--normal: drives the normal, but --drives says roughness"),
        (["drop.svg", "--fallbackSize", "0"], "--fallbackSize: 0, expected at least 1 pixel"),
        (["drop.svg", "--seed", "-1"], "--seed: -1, expected a number that is not negative"),
        (["drop.svg", "--jobs", "0"], "--jobs: 0, expected at least 1"),
        (["drop.svg", "--report", "nowhere/r.json"], "nowhere/r.json: the folder nowhere does not exist"),
        (["drop.svg", "--report", "drop.svg"], "drop.svg: is an input or another output"),
        (["drop.svg", "--sheet", "s.jpg"], "s.jpg: the sheet is a '.jpg', expected a .png"),
        (["blob.png", "--sheet", "blob.png"], "blob.png: is an input or another output"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_one_line_and_nothing_is_written(folder, arguments, expected):
    before = digests(".")
    assert failure(*arguments).startswith(expected)
    assert digests(".") == before


@pytest.mark.parametrize("content", [b"", b"not an image", b"<svg", b'<svg xmlns="http://www.w3.org/2000/svg"/>'])
@pytest.mark.parametrize("name", ["x.svg", "x.png"])
def test_damaged_files_are_named(folder, content, name):
    Path(name).write_bytes(content)
    before = digests(".")
    assert failure(name, "-o", "out.usda").startswith(f"{name}: ")
    assert digests(".") == before


@pytest.mark.parametrize("alpha", [0, 255])
def test_image_without_two_sides_is_refused(folder, alpha):
    write_image("flat.png", np.full((20, 20, 4), alpha, np.uint8))
    assert failure("flat.png", "-o", "out.usda").startswith("flat.png: ")
    assert not Path("out.usda").exists()


def test_failed_run_leaves_the_earlier_stage(folder):
    assert run("drop.svg", "-o", "out.usda", "--size", "8").exit_code == 0
    before = digests(".")
    Path("drop2.svg").write_text("<svg")
    failure("drop2.svg", "-o", "out.usda", "--size", "8")
    Path("drop2.svg").unlink()
    assert digests(".") == before
    assert run("blob.png", "-o", "out.usda", "--size", "8").exit_code == 0, "but a good one takes its place"
    assert digests(".") != before


@pytest.mark.parametrize(
    ("text", "color"),
    [("0.5,0.25,1", (0.5, 0.25, 1, 1)), ("0,0,0,0.5", (0, 0, 0, 0.5)), ("#fff", None), ("2,0,0", (2, 0, 0, 1))],
)
def test_line_colours(text, color):
    if color is None:
        with pytest.raises(FexelError, match="--lineColor"):
            parse_color(text)
    else:
        assert parse_color(text) == pytest.approx(color)


def test_encoded_line_colour_is_linearised():
    assert parse_color("#bc0000")[0] == pytest.approx(0.5, abs=0.005)


@pytest.mark.usefixtures("_gl_session")
@pytest.mark.parametrize("options", [[], ["--wrap", "mirror,clamp"], ["--signalSize", "64"]])
def test_renderer_shows_the_source_where_it_was(folder, options):
    """Through inputs:matrix of the prim: the map covers the blob alone, the quad the whole picture."""
    assert run("blob.png", "-o", "out.usda", "--size", "16", *options).exit_code == 0
    stage, prim = opened("out.usda")
    assert prim.GetMatrixAttr().HasAuthoredValue()
    shown = fexel.render(stage, width=360)["color"]
    source = read_linear("blob.png").repeat(3, axis=0).repeat(3, axis=1)
    assert shown.shape == source.shape
    assert ((shown[..., 3] > 0.5) != (source[..., 3] > 0.5)).mean() < 0.012
    inside = source[..., 3] == 1
    assert np.abs(shown[inside] - source[inside]).mean() < 0.02, "matt, lit from the camera: its own colours"


@pytest.mark.parametrize("mode", ["repeat", "mirror"])
def test_what_goes_on_outside_is_the_whole_picture(folder, mode):
    assert run("blob.png", "-o", "out.usda", "--size", "16", "--wrap", mode).exit_code == 0
    _stage, prim = opened("out.usda")
    assert not prim.GetMatrixAttr().HasAuthoredValue()
