"""`fexel umbrella`: photos of elements in, a ground out; whatever cannot be used is named in one line."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from pxr import Usd
from typer.testing import CliRunner

import fexel
from fexel.errors import FexelError, FexelWarning
from fexel.images import image_info, read_linear, srgb_to_linear
from fexel.textures import extract_texture
from fexel.validators import validate_file
from fexel_tools.cli import app
from fexel_tools.image_files import write_image
from fexel_tools.umbrella import make_umbrella
from fexel_tools.umbrella_options import UmbrellaOptions
from fexel_tools.umbrella_spelling import (
    parse_background,
    parse_centre,
    parse_diversify,
    parse_grid,
    parse_range,
    parse_vector,
)
from fexel_tools.umbrella_storage import jpeg_bytes

TEXTURE = "/World/Materials/Umbrella/Texture"
FAST = ("--grid", "6x4", "--count", "60", "--fallback-size", "64", "--texture-size", "48", "--vertices", "24")


def run(*arguments):
    return CliRunner().invoke(app, ["umbrella", *map(str, arguments)])


def made(*arguments):
    result = run(*arguments, *FAST)
    assert result.exit_code == 0, (result.output, result.exception)
    return result


def failure(*arguments):
    """The one line that the command ends with."""
    result = run(*arguments)
    assert isinstance(result.exception, FexelError), (result.output, result.exception)
    message = str(result.exception)
    assert "\n" not in message
    return message


def leaf_mask(size, lobes, turn=0.0):
    """(size, size) opacity of a lobed leaf in the middle."""
    y, x = np.indices((size, size)) + 0.5 - size / 2
    angle, radius = np.arctan2(y, x) + turn, np.hypot(x, y)
    reach = 0.42 * size * (1 - 0.22 * (0.5 + 0.5 * np.cos(lobes * angle)))
    return np.clip(reach - radius + 0.5, 0, 1)


def leaf(color, size=120, lobes=5, dtype=np.uint8):
    """RGBA cut-out with veins."""
    rgb = np.ones((size, size, 3)) * np.array(color) / 255
    y, x = np.indices((size, size)) - size / 2
    rgb *= (0.7 + 0.3 * (np.abs(np.sin(lobes * np.arctan2(y, x) / 2)) > 0.2))[..., None]
    image = np.dstack([rgb, leaf_mask(size, lobes)])
    return np.rint(image * np.iinfo(dtype).max).astype(dtype)


def on_ground(ground=(240, 238, 235), size=(420, 300)):
    """RGB photo of six coloured leaves on a plain ground."""
    picture = np.ones((size[1], size[0], 3)) * np.array(ground)
    rng = np.random.default_rng(5)
    picture += rng.normal(0, 1.5, picture.shape)
    for number in range(6):
        mask = leaf_mask(110, 4 + number % 3, 0.4 * number)[..., None]
        left, top = 15 + 135 * (number % 3), 20 + 145 * (number // 3)
        color = np.array([(200, 40, 30), (40, 140, 30), (190, 150, 20)][number % 3])
        place = picture[top : top + 110, left : left + 110]
        place[:] = place * (1 - mask) + color * mask
    return np.rint(picture.clip(0, 255)).astype(np.uint8)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current directory, with three cut-outs, a photo of many leaves and one of soil."""
    monkeypatch.chdir(tmp_path)
    for name, color, lobes in (("oak", (180, 60, 20), 5), ("ash", (60, 130, 30), 7), ("lime", (200, 170, 40), 3)):
        write_image(f"{name}.png", leaf(color, lobes=lobes))
    write_image("many.png", on_ground())
    write_image("soil.png", np.random.default_rng(1).integers(40, 90, (40, 60, 3)).astype(np.uint8))
    return tmp_path


CUTOUTS = ("oak.png", "ash.png", "lime.png")


def opened(path):
    """Stage and data of its texture; the one must be kept for the other to live."""
    stage = Usd.Stage.Open(str(path))
    return stage, extract_texture(stage.GetPrimAtPath(TEXTURE), 1.0)[1]


def digests(folder):
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(Path(folder).rglob("*")) if p.is_file()}


def test_cutouts_become_a_ground(folder):
    result = made(*CUTOUTS, "-o", "out.usda", "--background", "soil.png", "--report", "r.json", "--sheet", "s.png")
    assert result.output.startswith("out.usda: 60 umbrellas of 3 bases on 6 x 4 cells")
    assert validate_file("out.usda") == []
    report = json.loads(Path("r.json").read_text())
    stage, data = opened("out.usda")
    assert (report["b"], report["n"], report["grid"]) == (3, 60, [6, 4])
    assert len(data.arrangement) == 60 and [level.level for level in data.levels] == [1]
    assert report["v"] == max(len(shape.points) for shape in data.arrangement.shapes)
    assert report["J_words"] > 0 and report["T_words"]["min"] <= report["T_words"]["avg"] <= report["T_words"]["max"]
    textures = [path for path in Path("out_textures").iterdir() if not path.name.startswith("fallback")]
    on_disk = sum(path.stat().st_size for path in textures)
    stage_bytes = 0 if Path("out_textures/arrangement.usdc").exists() else report["array_bytes"]
    assert report["bytes"] == on_disk + stage_bytes
    assert image_info("s.png").width > 300
    assert stage.GetPrimAtPath(TEXTURE).GetCustomDataByKey("fexel:source") == "oak.png, ash.png, lime.png"


def test_opaque_elements_have_textures_without_alpha(folder):
    made(*CUTOUTS, "-o", "out.usda")
    for name in ("oak", "ash", "lime"):
        info = image_info(f"out_textures/{name}.png")
        assert info.channels == 3 and max(info.width, info.height) <= 48


def test_ground_shows_the_elements_colours(folder):
    """The baked picture has the leaves' colours, and where nothing lies, the background's."""
    made(*CUTOUTS, "-o", "out.usda", "--background", "#0000ff", "--diversify", "none", "--shadow-strength", "0")
    picture = read_linear("out_textures/fallback.png", "sRGB")[..., :3]
    encoded = np.array([(180, 60, 20), (60, 130, 30), (200, 170, 40)], np.float32) / 255
    colors = srgb_to_linear(np.concatenate([encoded, np.float32(0.7) * encoded]))  # leaves and their veins
    nearest = np.min([np.abs(picture - c).max(axis=-1) for c in [*colors, (0.0, 0.0, 1.0)]], axis=0)
    assert np.median(nearest) < 0.12
    assert (picture[..., 2] > 0.9).any(), "the background shows somewhere"


def test_photo_of_many_finds_its_elements_and_its_ground(folder):
    made("many.png", "-o", "out.usda", "--report", "r.json")
    report = json.loads(Path("r.json").read_text())
    assert report["b"] == 6
    _, data = opened("out.usda")
    ground = read_linear("many.png", "sRGB")[2, 2, :3]
    assert np.allclose(data.background.fallback[:3], ground, atol=0.05), "the photo's own ground lies behind"
    assert validate_file("out.usda") == []


def test_same_seed_gives_the_same_bytes_at_another_time_and_another_seed_does_not(folder, move_clock):
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        Path(name).mkdir()
        move_clock()
        made(*CUTOUTS, "-o", f"{name}/x.usdc", "--seed", seed)
    assert digests("a") == digests("b")
    assert digests("a")["x.usdc"] != digests("c")["x.usdc"]


@pytest.mark.parametrize("diversify", ["none", "color", "shape", "color,shape"])
def test_what_varies_is_what_was_asked_for(folder, diversify):
    made(*CUTOUTS, "-o", "out.usda", "--diversify", diversify)
    _, data = opened("out.usda")
    assert bool(data.arrangement.colors.any()) == ("color" in diversify)
    assert bool(data.arrangement.morphs.any()) == ("shape" in diversify)


@pytest.mark.parametrize("levels", ["image", "merged", "none"])
def test_levels_of_detail(folder, levels):
    made(*CUTOUTS, "-o", "out.usda", "--levels", levels, "--report", "r.json")
    _, data = opened("out.usda")
    nbytes = json.loads(Path("r.json").read_text())["level_bytes"]
    if levels == "none":
        assert data.levels == () and nbytes == 0
    elif levels == "image":
        assert data.levels[0].image is not None and nbytes == Path("out_textures/level.tif").stat().st_size
    else:
        assert all(level.arrangement is not None for level in data.levels) and len(data.levels) > 0 and nbytes > 0
    assert validate_file("out.usda") == []


def test_companion_maps_share_the_arrangement(folder):
    for kind, color in (("normals", (128, 128, 255)), ("rough", (90, 90, 90))):
        Path(kind).mkdir()
        for name in CUTOUTS:
            write_image(f"{kind}/{name}", np.full((120, 120, 3), color, np.uint8), "raw")
    made(*CUTOUTS, "-o", "out.usda", "--normal-maps", "normals", "--roughness-maps", "rough")
    stage, data = opened("out.usda")
    for name in ("Normal", "Roughness"):
        other = extract_texture(stage.GetPrimAtPath(TEXTURE.replace("Texture", name)), 1.0)[1]
        assert np.array_equal(other.arrangement.vertices, data.arrangement.vertices)
        assert len(other.levels) == 1
    picture = read_linear("out_textures/oak_Roughness.png", "raw")
    assert np.allclose(picture[..., 0], 90 / 255, atol=0.01)
    assert validate_file("out.usda") == []


def test_companion_maps_may_lie_beside_the_photos(folder):
    for name in CUTOUTS:
        stem = Path(name).stem
        write_image(f"{stem}_normal.tif", np.full((120, 120, 3), (128, 128, 255), np.uint8), "raw")
        write_image(f"{stem}_roughness.png", np.full((120, 120, 3), 70, np.uint8), "raw")
    beside = [f"{Path(name).stem}_roughness.png" for name in CUTOUTS]  # as *.png names them
    made(*CUTOUTS, *beside, "-o", "out.usda", "--normal-maps", ".", "--roughness-maps", ".", *FAST)
    _, data = opened("out.usda")
    assert len(data.arrangement.shapes) == len(CUTOUTS), "no map is taken for a photo"
    assert np.allclose(read_linear("out_textures/oak_Roughness.png", "raw")[..., 0], 70 / 255, atol=0.01)
    assert np.allclose(read_linear("out_textures/oak_Normal.png", "raw")[..., 2], 1.0, atol=0.01)
    assert "has no normal map for ash.png" in _without("ash_normal.tif")


def _without(name):
    Path(name).unlink()
    return failure(*CUTOUTS, "-o", "out.usda", "--normal-maps", ".", *FAST)


def test_companion_map_that_does_not_fit_is_named(folder):
    Path("normals").mkdir()
    assert "has no normal map for oak.png" in failure(*CUTOUTS, "-o", "out.usda", "--normal-maps", "normals", *FAST)
    write_image("normals/oak.png", np.zeros((5, 6, 3), np.uint8), "raw")
    for name in ("ash.png", "lime.png"):
        write_image(f"normals/{name}", np.zeros((120, 120, 3), np.uint8), "raw")
    message = failure(*CUTOUTS, "-o", "out.usda", "--normal-maps", "normals", *FAST)
    assert "normals/oak.png: 6 x 5 pixels, expected 120 x 120" in message


def test_companion_maps_are_looked_at_before_the_ground_is_computed(folder, monkeypatch):
    def computed(*_arguments):
        raise AssertionError("the ground was computed")

    monkeypatch.setattr("fexel_tools.umbrella.compute_ground", computed)
    Path("rough").mkdir()
    assert "has no roughness map for oak.png" in failure("oak.png", "-o", "out.usda", "--roughness-maps", "rough")
    write_image("rough/oak.png", np.zeros((7, 9, 3), np.uint8), "raw")
    message = failure("oak.png", "-o", "out.usda", "--roughness-maps", "rough")
    assert message == "rough/oak.png: 9 x 7 pixels, expected 120 x 120 as oak.png"
    Path("rough/oak.png").write_bytes(b"nothing")
    assert "rough/oak.png: cannot be read" in failure("oak.png", "-o", "out.usda", "--roughness-maps", "rough")


def test_map_of_a_photo_of_many_is_read_once(folder, monkeypatch):
    from fexel_tools import umbrella_companions

    opened_files, open_photo = [], umbrella_companions.open_photo
    monkeypatch.setattr(umbrella_companions, "open_photo", lambda f, **k: opened_files.append(f) or open_photo(f, **k))
    Path("rough").mkdir()
    write_image("rough/many.png", np.full((300, 420, 3), 90, np.uint8), "raw")
    made("many.png", "-o", "out.usda", "--roughness-maps", "rough")
    assert len(opened_files) == 1


def test_data_are_stored_as_they_are(folder):
    write_image("height.png", leaf((120, 120, 120), dtype=np.uint16), "raw")
    made("height.png", "-o", "out.usda", "--raw")
    stage, data = opened("out.usda")
    assert data.arrangement.shapes[0].image.color_space == "raw"
    info = image_info("out_textures/height.png")
    assert info.dtype == "uint16"
    surface = stage.GetPrimAtPath("/World/Materials/Umbrella/Surface")
    assert surface.GetAttribute("inputs:roughness").HasAuthoredConnections()


def test_sizes_of_data_are_measured_as_they_are_stored(folder):
    """Without sRGB encoding; vectors turned as the ground shows them, over the normal of a plain ground."""
    dark = leaf((255, 255, 255))
    dark[..., :3] = np.random.default_rng(2).integers(0, 40, (40, 40, 1)).repeat(3, axis=0).repeat(3, axis=1)
    write_image("height.png", dark, "raw")
    made("height.png", "-o", "out.usda", "--raw", "--report", "r.json", "--diversify", "none")
    sizes = json.loads(Path("r.json").read_text())["compressed_bytes"]
    stored = read_linear("out_textures/height.png", "raw")
    assert sizes["textures"] == pytest.approx(jpeg_bytes(stored, is_data=True), rel=0.05)
    assert sizes["textures"] < 0.9 * jpeg_bytes(stored), "encoded, dark values would be rougher"


def test_references_give_their_colours(folder):
    """Blue leaves as references make green ones bluer."""
    write_image("blue.png", leaf((20, 40, 200)))
    means = []
    for given in ([], ["--references", "blue.png"]):
        made("ash.png", "-o", "out.usda", "--diversify", "color", *given)
        _, data = opened("out.usda")
        means.append(data.arrangement.colors.mean(axis=0))
    assert means[1][2] > means[0][2] + 0.05


def test_centres_can_be_given(folder):
    """By a table, in pixels of the photo; the texture coordinates of the centre are where it was asked for."""
    Path("hints.csv").write_text("file,x,y\noak.png,70,50\n")
    made("oak.png", "ash.png", "-o", "out.usda", "--hints", "hints.csv", "--diversify", "none")
    _, data = opened("out.usda")
    shapes = dict(zip(("oak", "ash"), data.arrangement.shapes, strict=True))
    reach = np.ptp(shapes["oak"].points, axis=0)
    centre = -shapes["oak"].points[1:].min(axis=0) / reach
    middle = -shapes["ash"].points[1:].min(axis=0) / np.ptp(shapes["ash"].points, axis=0)
    assert np.allclose(middle, 0.5, atol=0.06)
    assert centre[0] > 0.53 and centre[1] > 0.53, "right of and above the middle"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--hints", "elm.csv"), r"elm\.csv: elm\.png at 5,5: no element is of a file .*; not used \(2 hints in all\)"),
        (("--hints", "far.csv"), r"far\.csv: oak at 900,5: lies in no element of it; not used"),
        (("--centre", "5000,5000"), r"--centre: 5000,5000 lies outside of oak in oak\.png .*\(3 elements in all\)"),
        (("--references", "refs"), r"--references: refs/notes\.txt: cannot be read: .*; left out"),
        (("--vertices", "4"), r"--vertices 4: the contour of \w+ is off by \d+.* \(3 elements in all\)"),
    ],
)
def test_what_is_given_in_vain_is_told_once(folder, given, said):
    Path("elm.csv").write_text("elm.png,5,5\nelm.png,6,6\noak.png,70,50\n")
    Path("far.csv").write_text("oak,900,5\n")
    Path("refs").mkdir()
    write_image("refs/blue.png", leaf((20, 40, 200)))
    Path("refs/notes.txt").write_text("no picture")
    with pytest.warns(FexelWarning) as caught:
        result = run(*CUTOUTS, "-o", "out.usda", *FAST, *given)
    assert result.exit_code == 0, (result.output, result.exception)
    messages = [str(w.message) for w in caught if issubclass(w.category, FexelWarning)]
    assert len(messages) == 1 and re.match(said, messages[0]) and "\n" not in messages[0]


def test_what_is_given_and_taken_is_not_told(folder, recwarn):
    Path("hints.csv").write_text("oak.png,70,50\nash,0.5,0.5\n")
    write_image("blue.png", leaf((20, 40, 200)))
    made(*CUTOUTS, "-o", "out.usda", "--hints", "hints.csv", "--centre", "60,60", "--references", "blue.png")
    assert not [w for w in recwarn if issubclass(w.category, FexelWarning)]


def test_places_can_be_given(folder):
    Path("places.csv").write_text("s,t,rotation\n0.25,0.5,0\n0.75,0.5,90\n")
    result = run(*CUTOUTS, "-o", "out.usda", "--arrangement", "places.csv", "--grid", "4x4", "--fallback-size", "32")
    assert result.exit_code == 0, (result.output, result.exception)
    _, data = opened("out.usda")
    assert sorted(data.arrangement.matrices[:, 2, 0].round(6).tolist()) == [0.25, 0.75]


def test_empty_ground_is_background_alone(folder):
    result = run(*CUTOUTS, "-o", "out.usda", "--grid", "1x1", "--count", "0", "--report", "r.json", "--sheet", "s.png")
    assert result.exit_code == 0, (result.output, result.exception)
    report = json.loads(Path("r.json").read_text())
    assert report["n"] == 0 and report["compressed_ratio"] is None
    assert validate_file("out.usda") == []


def test_flight_is_what_is_rendered(gl, folder):
    """Without a camera named: close to one element at first, a horizon at last."""
    made(*CUTOUTS, "-o", "out.usda")
    first = fexel.render("out.usda", time=1, width=64)["color"]
    last = fexel.render("out.usda", time=48, width=64)["color"]
    assert (first[..., 3] == 1).all()
    assert (last[0, :, 3] == 0).all() and (last[-1, :, 3] == 1).all()


def test_one_bad_file_among_good_ones_is_told(folder):
    Path("bad.png").write_bytes(Path("oak.png").read_bytes()[:100])
    write_image("blank.png", np.full((50, 50, 3), 200, np.uint8))
    result = run(*CUTOUTS, "bad.png", "blank.png", "-o", "out.usda", *FAST)
    assert result.exit_code == 0, (result.output, result.exception)
    assert "bad.png" in result.stderr and "blank.png" in result.stderr
    assert "of 3 bases" in result.stdout


def test_faults_are_named_in_one_line_and_leave_nothing(folder):
    Path("bad.png").write_bytes(b"nothing")
    write_image("blank.png", np.full((50, 50, 3), 200, np.uint8))
    before = sorted(p.name for p in folder.iterdir())
    assert "missing.png: no such file" in failure("missing.png", "-o", "out.usda")
    assert "bad.png" in failure("bad.png", "-o", "out.usda")
    assert "blank.png" in failure("blank.png", "-o", "out.usda")
    assert "is a folder" in failure(".", "-o", "out.usda")
    assert "--grid: '0x4'" in failure("oak.png", "-o", "out.usda", "--grid", "0x4")
    assert "--count: -1" in failure("oak.png", "-o", "out.usda", "--count", "-1")
    assert "--kind: 'tree'" in failure("oak.png", "-o", "out.usda", "--kind", "tree")
    assert "--levels: 'mip'" in failure("oak.png", "-o", "out.usda", "--levels", "mip")
    assert "--morph: 2" in failure("oak.png", "-o", "out.usda", "--morph", "2")
    assert "--shadow-strength: nan" in failure("oak.png", "-o", "out.usda", "--shadow-strength", "nan")
    assert "--background: sand.jpg: no such file" in failure("oak.png", "-o", "out.usda", "--background", "sand.jpg")
    assert "--background: .: is a folder, expected an image" in failure(
        "oak.png", "-o", "out.usda", "--background", "."
    )
    assert "--background: '#12'" in failure("oak.png", "-o", "out.usda", "--background", "#12")
    assert "--size" in failure("oak.png", "-o", "out.usda", "--size", "2:1")
    assert "--size: 5" in failure("oak.png", "-o", "out.usda", "--grid", "3x3", "--size", "50:59")
    assert "output is '.png'" in failure("oak.png", "-o", "out.png")
    assert "is an input" in failure("oak.png", "-o", "out.usda", "--report", "oak.png")
    assert "expected a .png" in failure("oak.png", "-o", "out.usda", "--sheet", "s.jpg")
    assert "places.csv" in failure("oak.png", "-o", "out.usda", "--arrangement", "places.csv")
    assert sorted(p.name for p in folder.iterdir()) == before


def test_failed_run_leaves_the_earlier_ground(folder):
    made(*CUTOUTS, "-o", "out.usda")
    before = digests(".")
    failure("bad", "-o", "out.usda")
    Path("oak2.png").write_bytes(b"x")
    failure("oak2.png", "-o", "out.usda")
    Path("oak2.png").unlink()
    assert digests(".") == before


def test_inputs_in_the_output_folder_are_not_replaced(folder):
    made(*CUTOUTS, "-o", "out.usda")
    message = failure("out_textures/oak.png", "-o", "out.usda")
    assert "lies in out_textures" in message


def test_odd_inputs(folder):
    """Grey with alpha, 16 bits, floats, a JPEG of an object on a plain ground, a photo of 3000 pixels."""
    write_image("grey.png", np.ascontiguousarray(leaf((120, 120, 120))[..., [0, 3]]))
    write_image("deep.png", leaf((150, 90, 30), dtype=np.uint16))
    rgba = leaf((90, 150, 30)).astype(np.float32) / 255
    rgba[..., :3] *= rgba[..., 3:]
    write_image("half.exr", rgba, "raw")
    write_image("object.jpg", cv2.resize(on_ground()[:150, :140], None, fx=2, fy=2))
    write_image("large.png", cv2.resize(leaf((60, 60, 160)), (3000, 2400), interpolation=cv2.INTER_CUBIC))
    made("grey.png", "deep.png", "half.exr", "object.jpg", "large.png", "-o", "out.usda", "--report", "r.json")
    report = json.loads(Path("r.json").read_text())
    assert report["b"] == 5
    assert validate_file("out.usda") == []


def test_library_call_is_the_command(folder):
    options = UmbrellaOptions(grid=(4, 3), count=20, fallback_size=32, texture_size=32)
    report = make_umbrella(list(CUTOUTS), "out.usda", options)
    assert report.n == 20 and report.compressed is None and set(report.phases) >= {"read", "bases", "levels"}
    assert report.seconds == pytest.approx(
        sum(s for name, s in report.phases.items() if name not in ("measure", "compile"))
    )


def test_progress_is_told_within_long_phases(folder):
    told = {}
    options = UmbrellaOptions(grid=(6, 4), count=20, fallback_size=256, texture_size=32)
    make_umbrella(["oak.png"], "out.usda", options, progress=lambda step, *done: told.setdefault(step, []).append(done))
    for step in ("umbrellas", "fallback", "levels"):
        dones, totals = zip(*told[step], strict=True)
        assert list(dones) == sorted(dones) and set(totals) == {dones[-1]} and dones[-1] > 1


def test_spelling_of_options():
    assert parse_grid(" 64X24 ") == (64, 24)
    assert parse_background("#FF0000") == (1.0, 0.0, 0.0, 1.0) and parse_background("None") == "none"
    assert parse_diversify("none") == () and parse_range("2", "--size") == (2.0, 2.0)
    assert parse_vector("-0.1, 0.2", "--shadow") == (-0.1, 0.2)
    assert parse_centre("12,7.5") == "12,7.5"
    for parse, text in (
        (parse_grid, "64"),
        (parse_grid, "0x2"),
        (parse_grid, "9999x2"),
        (parse_diversify, "hue"),
        (parse_centre, "middle"),
        (parse_background, "#12345"),
    ):
        with pytest.raises(FexelError, match=r"^[^\n]*expected[^\n]*$"):
            parse(text)
    for text in ("", "a:b", "2:1", "nan", "1:2:3"):
        with pytest.raises(FexelError, match="--size"):
            parse_range(text, "--size")
