"""`fexel zipmap`: photos in, a stage out; every kind of unusable photo is named and the run goes on."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdShade
from typer.testing import CliRunner

import fexel
from fexel.errors import FexelError, FexelWarning
from fexel.images import image_info, read_linear
from fexel_tools.authoring import ZipmapOptions, prim_names
from fexel_tools.cli import app
from fexel_tools.zipmap import make_zipmap
from tests.authoring.synthetic_photos import corner_error, root_from_photo, write_image

ZIPMAP = "/World/Materials/Zipmap/Texture"


@pytest.fixture(scope="module")
def authored(zoom_series, tmp_path_factory):
    """The series, authored once: (folder, report)."""
    folder = tmp_path_factory.mktemp("series")
    files = [write_image(folder / f"{name}.png", shot.pixels) for name, shot in zoom_series.items()]
    report = make_zipmap(
        files, folder / "out.usda", report=folder / "out.json", options=ZipmapOptions(fallback_size=512)
    )
    return folder, report


def entries(report):
    return {Path(p.file).stem: p for p in report.photos}


def test_every_photo_finds_its_place(authored, zoom_series):
    _, report = authored
    assert Path(report.root).stem == "whole"
    for name, photo in entries(report).items():
        truth = root_from_photo(zoom_series, "whole", name)
        assert photo.status in ("root", "patch"), photo.reason
        assert corner_error(photo.root_from_photo, truth, (400, 300)) < 0.5, name


def test_nest_follows_the_photos(authored):
    photos = entries(authored[1])
    parents = {name: Path(p.parent).stem for name, p in photos.items() if p.parent}
    assert parents == {"door": "whole", "lock": "door", "window": "whole", "edge": "whole"}
    assert photos["lock"].scale == pytest.approx(600 / 220, rel=0.05)
    assert photos["door"].scale == pytest.approx(1400 / 600, rel=0.05)


def test_report_file_is_as_specified(authored):
    folder, report = authored
    data = json.loads((folder / "out.json").read_text("utf-8"))
    assert list(data) == ["root", "photos"]
    assert data["root"] == report.root
    for entry, photo in zip(data["photos"], report.photos, strict=True):
        keys = ["file", "status", "reason", "parent", "scale", "root_from_photo", "inliers", "rms_px"]
        assert list(entry) == keys
        assert entry["file"] == photo.file
        assert np.shape(entry["root_from_photo"]) == (3, 3)


def test_prim_matrices_are_those_of_the_report(authored):
    """A patch's corner, taken to the root by the prims, lies where the report's matrix takes the photo's pixel."""
    folder, report = authored
    stage = Usd.Stage.Open(str(folder / "out.usda"))
    patches = {p.prim.GetName(): p for p in fexel.ZipmapTexture(stage.GetPrimAtPath(ZIPMAP)).GetPatches()}
    for name in ("door", "lock"):  # neither is cropped, so the patch's corner is the photo's
        root_st = np.array([0.0, 1.0, 1.0]) @ np.linalg.inv(patches[name].root_to_patch)
        root_st = root_st[:2] / root_st[2]
        expected = np.array(entries(report)[name].root_from_photo) @ np.array([0.0, 0.0, 1.0])
        expected = expected[:2] / expected[2]
        np.testing.assert_allclose((root_st[0] * 400, (1 - root_st[1]) * 300), expected, atol=1e-6)


def test_texture_holds_the_photos_own_pixels(authored, zoom_series):
    """Where no colour had to be changed much, detail of the texture is the photo's, pixel by pixel."""
    folder, _ = authored
    photo = zoom_series["lock"].pixels.astype(np.float64)
    premultiplied = read_linear(str(folder / "out_textures" / "lock.tif")).astype(np.float64)
    texture = premultiplied[..., :3] / np.maximum(premultiplied[..., 3:], 1e-3)
    assert texture.shape == photo.shape
    fine = lambda image: np.diff(np.log(image[60:-60, 60:-60] + 1e-3), axis=1).ravel()  # noqa: E731
    assert np.corrcoef(fine(texture), fine((photo / 255.0) ** 2.2))[0, 1] > 0.98


def test_patch_meets_the_root_without_a_step(authored, zoom_series):
    """The photo was taken at 0.85 of the exposure; in the middle of the patch the colours are the root's."""
    folder, _ = authored
    door = read_linear(str(folder / "out_textures" / "door.tif"))
    root = read_linear(str(folder / "out_textures" / "root.tif"))[..., :3]
    matrix = root_from_photo(zoom_series, "whole", "door")
    rows, columns = np.mgrid[100:200:9, 120:280:9]
    places = np.stack([columns.ravel() + 0.5, rows.ravel() + 0.5, np.ones(rows.size)]).T @ matrix.T
    below = root[(places[:, 1] / places[:, 2]).astype(int), (places[:, 0] / places[:, 2]).astype(int)]
    above = door[rows.ravel(), columns.ravel()]
    ratio = (above[:, :3] / above[:, 3:]).mean() / below.mean()
    assert ratio == pytest.approx(1.0, abs=0.05)
    assert (door[[0, -1]][..., 3] == 0).all()


def test_stage_is_sound_and_self_contained(authored, tmp_path):
    folder, _ = authored
    moved = tmp_path / "elsewhere"
    shutil.copytree(folder, moved)
    findings = fexel.validate(Usd.Stage.Open(str(moved / "out.usda")))
    assert [str(f) for f in findings if f.severity == "error"] == []
    stage = Usd.Stage.Open(str(moved / "out.usda"))
    assert stage.GetDefaultPrim().GetPath() == "/World"
    cameras = [p.GetName() for p in stage.Traverse() if p.IsA(UsdGeom.Camera)]
    assert cameras == ["Zoom", "Overview", "Detail"]
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 48)
    text = (moved / "out.usda").read_text("utf-8")
    assert str(folder) not in text
    material, _ = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/World/Surface")).ComputeBoundMaterial()
    assert material.GetPath() == "/World/Materials/Zipmap"


def test_stage_opens_without_the_plugin_as_a_node_graph_that_resolves(authored):
    folder, _ = authored
    program = f"""
from pxr import Usd, UsdShade
stage = Usd.Stage.Open({str(folder / "out.usda")!r})
prim = stage.GetPrimAtPath({ZIPMAP!r})
assert prim.IsA(UsdShade.NodeGraph), prim.GetTypeName()
surface = UsdShade.Shader(stage.GetPrimAtPath("/World/Materials/Zipmap/Surface"))
source = UsdShade.Utils.GetValueProducingAttributes(surface.GetInput("diffuseColor"))[0]
shader = UsdShade.Shader(source.GetPrim())
assert shader.GetIdAttr().Get() == "UsdUVTexture"
assert shader.GetInput("file").Get().resolvedPath
"""
    subprocess.run([sys.executable, "-c", program], check=True, env={"PATH": "/usr/bin"})


def test_fallback_is_bounded(authored):
    info = image_info(str(authored[0] / "out_textures" / "fallback.png"))
    assert max(info.width, info.height) == 512


def test_root_can_be_given(series_files, tmp_path):
    """With a detail as root the whole lies partly outside and adds nothing; the detail's detail is its patch."""
    files = [series_files[name] for name in ("whole", "door", "lock")]
    report = make_zipmap(files, tmp_path / "out.usda", ZipmapOptions(root="door.png"))
    photos = entries(report)
    assert photos["door"].status == "root"
    assert photos["lock"].parent == series_files["door"]
    assert photos["whole"].status == "rejected"
    assert "adds nothing" in photos["whole"].reason


def test_one_photo_is_a_stage_with_the_root_alone(series_files, tmp_path):
    report = make_zipmap([series_files["whole"]], tmp_path / "out.usda")
    assert [p.status for p in report.photos] == ["root"]
    assert {p.name for p in (tmp_path / "out_textures").iterdir()} == {"root.tif", "fallback.png"}


def test_unusable_photos_are_named_and_the_run_goes_on(series_files, tmp_path, rng):
    whole, door = series_files["whole"], series_files["door"]
    folder = Path(whole).parent
    copy = shutil.copy(whole, folder / "whole again.png")
    blank = write_image(folder / "blank.png", np.full((300, 400, 3), 90, np.uint8))
    other = write_image(folder / "other.png", other_picture(rng))
    (folder / "cut.png").write_bytes(Path(door).read_bytes()[:20000])
    (folder / "text.jpg").write_text("hello")
    files = [whole, copy, blank, other, str(folder / "cut.png"), str(folder / "text.jpg"), door]
    report = make_zipmap(files, tmp_path / "out.usda")
    photos = {Path(p.file).name: p for p in report.photos}
    assert {name for name, p in photos.items() if p.status != "rejected"} == {"whole.png", "door.png"}
    assert photos["whole again.png"].reason == f"duplicate of '{whole}'"
    assert photos["blank.png"].reason.startswith("blank")
    assert photos["other.png"].reason.startswith("no match with the other photos")
    assert photos["cut.png"].reason.startswith("ends early")
    assert photos["text.jpg"].reason.startswith("cannot be read")


def other_picture(rng):
    import cv2

    picture = np.zeros((300, 400, 3), np.float32)
    for cell in (5, 20, 60):
        noise = rng.normal(size=(300 // cell + 2, 400 // cell + 2, 3)).astype(np.float32)
        picture += cv2.resize(noise, (400, 300), interpolation=cv2.INTER_LINEAR)
    return np.clip(128 + 40 * picture, 0, 255).astype(np.uint8)


def test_photos_that_share_nothing_leave_the_largest_as_root(series_files, tmp_path, rng):
    other = write_image(Path(series_files["whole"]).parent / "other.png", other_picture(rng)[:200, :300])
    report = make_zipmap([other, series_files["whole"]], tmp_path / "out.usda")
    assert [p.status for p in report.photos] == ["rejected", "root"]


def test_max_error_rejects_with_the_residual(series_files, tmp_path):
    files = [series_files["whole"], series_files["door"]]
    report = make_zipmap(files, tmp_path / "out.usda", ZipmapOptions(max_error_px=1e-6))
    assert "a homography leaves" in report.photos[1].reason
    assert "more than 1e-06" in report.photos[1].reason


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"files": ["gone.png"]}, "gone.png: no such file"),
        ({"out": "gone/out.usda"}, "does not exist"),
        ({"out": "out.png"}, "expected one of .usda"),
        ({"options": ZipmapOptions(root="nobody.png")}, "--root nobody.png: is not among the photos"),
        ({"options": ZipmapOptions(tau=0.0)}, "--tau"),
        ({"options": ZipmapOptions(bits=12)}, "--bits: 12, expected 8 or 16"),
        ({"options": ZipmapOptions(primitive="cube")}, "expected one of quad, sphere, cylinder"),
        ({"options": ZipmapOptions(mesh="gone.usda")}, "gone.usda: no such file"),
        ({"options": ZipmapOptions(fallback_size=0)}, "--fallbackSize"),
        ({"options": ZipmapOptions(fallback_size=-4)}, "--fallbackSize"),
        ({"options": ZipmapOptions(tau=-1.0)}, "--tau"),
        ({"options": ZipmapOptions(tau=float("nan"))}, "--tau"),
        ({"options": ZipmapOptions(max_error_px=float("nan"))}, "--max-error"),
        ({"options": ZipmapOptions(min_gain=float("nan"))}, "--min-gain"),
        ({"options": ZipmapOptions(min_gain=-1.0)}, "--min-gain"),
        ({"options": ZipmapOptions(jobs=-1)}, "--jobs"),
        ({"report": "gone/r.json"}, "does not exist"),
        ({"report": "photos"}, "photos: is a folder"),
        ({"report": "./out.usda"}, "an input or another output"),
        ({"report": "photos/whole.png"}, "an input or another output"),
    ],
)
def test_wrong_input_is_an_error_before_any_work(series_files, tmp_path, change, message, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("fexel_tools.zipmap.find_links", lambda *a, **k: pytest.fail("work was begun"))
    call = {"files": [series_files["whole"]], "out": "out.usda", "options": None, "report": None, **change}
    with pytest.raises(FexelError, match=re.escape(message)):
        make_zipmap(call["files"], call["out"], call["options"], report=call["report"])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["photos"]


def test_photos_beside_a_stage_of_the_same_name_are_kept(series_files, tmp_path):
    """A folder of photos that is named as the output's textures would be, with an earlier stage beside it."""
    folder = tmp_path / "own_textures"
    folder.mkdir()
    photo = shutil.copy(series_files["whole"], folder)
    stage = Usd.Stage.CreateNew(str(tmp_path / "own.usda"))
    stage.Save()
    with pytest.raises(FexelError, match="own_textures"):
        make_zipmap([photo], tmp_path / "own.usda")
    assert Path(photo).exists()


def test_nothing_usable_is_an_error_that_names_the_files(tmp_path):
    (tmp_path / "a.jpg").write_text("x")
    (tmp_path / "b.jpg").write_text("y")
    with pytest.raises(FexelError, match=r"no usable photo: .*a\.jpg.*b\.jpg"):
        make_zipmap([str(tmp_path / "a.jpg"), str(tmp_path / "b.jpg")], tmp_path / "out.usda")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.jpg", "b.jpg"]


def test_failure_in_the_middle_leaves_nothing(series_files, tmp_path, monkeypatch):
    def fail(*_, **__):
        raise MemoryError

    monkeypatch.setattr("fexel_tools.patches.clone", fail)
    with pytest.raises(MemoryError):
        make_zipmap([series_files["whole"], series_files["door"]], tmp_path / "out.usda", report=tmp_path / "r.json")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["photos"]


def test_deep_colour_stays_deep(zoom_series, tmp_path):
    """16-bit PNG gives a 16-bit sRGB texture; EXR with a NaN gives half floats and a warning."""
    whole = zoom_series["whole"].pixels
    files = [write_image(tmp_path / "w.png", whole.astype(np.uint16) * 257)]
    linear = ((zoom_series["door"].pixels / 255.0) ** 2.2).astype(np.float32)
    linear[100, 100] = np.nan
    files.append(write_image(tmp_path / "d.exr", linear))
    with pytest.warns(FexelWarning, match=r"d\.exr: 1 pixels"):
        report = make_zipmap(files, tmp_path / "out.usdc")
    assert [p.status for p in report.photos] == ["root", "patch"]
    assert image_info(str(tmp_path / "out_textures" / "root.tif")).dtype == "uint16"
    assert image_info(str(tmp_path / "out_textures" / "d.exr")).dtype == "float16"
    stage = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    spaces = [stage.GetPrimAtPath(p).GetAttribute("inputs:sourceColorSpace").Get() for p in (ZIPMAP, f"{ZIPMAP}/d")]
    assert spaces == ["sRGB", "raw"]
    assert np.isfinite(read_linear(str(tmp_path / "out_textures" / "d.exr"))).all()


def test_hand_made_alpha_limits_the_mask(zoom_series, tmp_path):
    """The transparent half of the photo stays transparent in the texture."""
    door = zoom_series["door"].pixels
    alpha = np.zeros((*door.shape[:2], 1), np.uint8)
    alpha[:, 200:] = 255
    files = [
        write_image(tmp_path / "w.png", zoom_series["whole"].pixels),
        write_image(tmp_path / "d.png", np.concatenate([door, alpha], axis=2), oiio__UnassociatedAlpha=1),
    ]
    make_zipmap(files, tmp_path / "out.usda")
    texture = read_linear(str(tmp_path / "out_textures" / "d.tif"))[..., 3]
    assert texture[:, :199].max() == 0.0
    assert texture[100:200, 240:360].mean() > 0.5


def test_exif_turned_photo_is_placed_as_displayed(zoom_series, tmp_path):
    """Stored turned by 90 degrees; the report speaks of the upright photo."""
    door = zoom_series["door"].pixels
    files = [
        write_image(tmp_path / "w.png", zoom_series["whole"].pixels),
        write_image(tmp_path / "d.jpg", np.rot90(door), Orientation=6, Compression="jpeg:97"),
    ]
    report = make_zipmap(files, tmp_path / "out.usda")
    truth = root_from_photo(zoom_series, "whole", "door")
    assert corner_error(report.photos[1].root_from_photo, truth, (400, 300)) < 0.5


def test_names_of_any_kind_make_valid_prims(series_files, tmp_path):
    folder = tmp_path / "a b's \u00fc"
    folder.mkdir()
    files = [folder / "1 whole'.png", folder / "T\u00fcr #%04d.png"]
    for file, name in zip(files, ("whole", "door"), strict=True):
        shutil.copy(series_files[name], file)
    report = make_zipmap([str(f) for f in files], folder / "out \u65e5.usda", report=folder / "r'.json")
    assert [p.file for p in report.photos] == [str(f) for f in files]
    stage = Usd.Stage.Open(str(folder / "out \u65e5.usda"))
    texture = stage.GetPrimAtPath(f"{ZIPMAP}/Tur_04d")
    assert texture.GetAttribute("inputs:file").Get().resolvedPath


def test_prim_names_are_unique_without_regard_to_case():
    names = prim_names(["a.png", "A.jpg", "b/a.tif", "7.png", "\u65e5.png", "root.png", ""])
    assert names == ["a", "A_2", "a_3", "photo_7", "photo", "root_2", "photo_2"]


def test_mesh_is_referenced_and_bound(series_files, tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "mesh.usda"))
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/M").GetPrim())
    from fexel_tools.geometry import define_surface, primitive

    define_surface(stage, "/M/Ball", primitive("sphere", 1.0), UsdShade.Material.Define(stage, "/M/Old"))
    stage.Save()
    (tmp_path / "sub").mkdir()
    make_zipmap([series_files["whole"]], tmp_path / "sub" / "out.usda", ZipmapOptions(mesh=str(tmp_path / "mesh.usda")))
    result = Usd.Stage.Open(str(tmp_path / "sub" / "out.usda"))
    ball = result.GetPrimAtPath("/World/Surface/Ball")
    assert ball.IsA(UsdGeom.Mesh)
    material, _ = UsdShade.MaterialBindingAPI(ball).ComputeBoundMaterial()
    assert material.GetPath() == "/World/Materials/Zipmap"
    assert "../mesh.usda" in (tmp_path / "sub" / "out.usda").read_text("utf-8")


def test_command_tells_what_became_of_each_photo(series_files, tmp_path):
    blank = write_image(tmp_path / "blank.png", np.full((300, 400, 3), 90, np.uint8))
    files = [series_files["whole"], series_files["door"], blank]
    result = CliRunner().invoke(app, ["zipmap", *files, "-o", str(tmp_path / "out.usda"), "--fallbackSize", "64"])
    assert result.exit_code == 0, result.output
    assert f"{files[0]}: root" in result.output
    assert f"{files[1]}: patch of {files[0]}" in result.output
    assert "blank.png: rejected: blank" in result.output


def test_command_wants_photos_or_a_layout(tmp_path):
    with pytest.raises(FexelError, match="photos or --place"):
        CliRunner().invoke(app, ["zipmap", "-o", str(tmp_path / "o.usda")], catch_exceptions=False)


@pytest.mark.parametrize(
    ("layout", "option"),
    [
        ("layout.yaml", ["--report", "r.json"]),
        ("layout.yaml", ["--root", "whole.png"]),
        ("layout.yaml", ["--max-error", "8"]),
        ("layout.yaml", ["--min-gain", "1.2"]),
        ("art.usda", ["--primitive", "quad"]),
        ("art.usda", ["--mesh", "mesh.usda"]),
    ],
)
def test_command_refuses_what_does_not_apply_to_a_layout(tmp_path, layout, option):
    arguments = ["zipmap", "--place", str(tmp_path / layout), "-o", str(tmp_path / "o.usda"), *option]
    with pytest.raises(FexelError, match=f"^{option[0]}: does not apply"):
        CliRunner().invoke(app, arguments, catch_exceptions=False)


def test_ground_truth_photos_within_a_pixel(shared_data, tmp_path):
    folder = shared_data / "zoom" / "synth_petra"
    truth = json.loads((folder / "ground_truth.json").read_text("utf-8"))
    to_outer = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # the file counts from pixel centres
    photo_from_source = {
        entry["file"]: to_outer @ np.array(entry["H_hires_to_image"]) @ np.linalg.inv(to_outer)
        for entry in truth["images"]
    }
    files = [str(folder / name) for name in sorted(photo_from_source)]
    report = make_zipmap(files, tmp_path / "out.usda", ZipmapOptions(fallback_size=256))
    assert Path(report.root).name == "a.jpg"
    for photo in report.photos:
        name = Path(photo.file).name
        exact = photo_from_source["a.jpg"] @ np.linalg.inv(photo_from_source[name])
        assert photo.root_from_photo is not None, photo.reason
        assert corner_error(photo.root_from_photo, exact, (800, 600)) < 1.0, name
